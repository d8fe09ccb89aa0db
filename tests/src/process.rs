//! The three programs as processes of their own, which a test can kill, limit and listen to.

use std::ffi::{OsStr, OsString};
#[cfg(unix)]
use std::fs::File;
use std::path::PathBuf;
use std::process::{Command, ExitStatus};

/// Environment variable with the command line of a process, a word in each line.
const WORDS: &str = "CD_TESTS_WORDS";

/// Environment variable with a file that takes the place of standard output, to which an executable of tests itself prints.
pub const STDOUT: &str = "CD_TESTS_STDOUT";

/// Executables of the programs.
#[derive(Debug, Clone)]
pub enum Executables {
    /// The executable that runs now, with these arguments; it calls [`run_requested_program`].
    Own(&'static [&'static str]),
    /// Folder with `cd-pre`, `cd-solve` and `cd-post`.
    Folder(PathBuf),
}

impl Executables {
    /// The executable of a test with the function `program_process`, which only calls [`run_requested_program`].
    pub fn of_test() -> Executables {
        Executables::Own(&["--exact", "program_process", "--nocapture"])
    }

    /// The programs of `folder`, or the executable that runs now.
    pub fn in_folder(folder: Option<PathBuf>) -> Executables {
        match folder {
            Some(folder) => Executables::Folder(std::path::absolute(&folder).unwrap_or(folder)),
            None => Executables::Own(&[]),
        }
    }

    /// Process of a command line, whose first word is the name of a program.
    pub fn command(&self, words: &[impl AsRef<OsStr>]) -> Command {
        match self {
            Executables::Own(arguments) => {
                let mut command = Command::new(std::env::current_exe().unwrap());
                let words: Vec<&OsStr> = words.iter().map(AsRef::as_ref).collect();
                command.args(*arguments).env(WORDS, words.join(OsStr::new("\n")));
                command
            }
            Executables::Folder(folder) => {
                let mut command = Command::new(folder.join(words[0].as_ref()));
                command.args(&words[1..]);
                command
            }
        }
    }
}

/// Runs the program that the parent process has requested, and ends this process with its exit code. Returns at once if there
/// is no request.
pub fn run_requested_program() {
    let Some(text) = std::env::var_os(WORDS) else { return };
    let words: Vec<OsString> = text.to_str().unwrap().lines().map(OsString::from).collect();
    cd_formats::atomic::turn_size_limit_into_error();
    #[cfg(unix)]
    if let Some(path) = std::env::var_os(STDOUT) {
        rustix::stdio::dup2_stdout(File::options().append(true).create(true).open(path).unwrap()).unwrap();
    }
    let program = words[0].to_str().unwrap().to_string();
    let code = match program.as_str() {
        "cd-pre" => cd_pre::run(words),
        "cd-solve" => cd_solve::run(words),
        "cd-post" => cd_post::run(words),
        other => panic!("{other} is none of the programs"),
    };
    std::process::exit(cd_formats::messages::exit_code(&program, code));
}

/// Exit code of a process; 128 and the number of the signal if one has ended it, as shells count.
pub fn exit_code(status: ExitStatus) -> i32 {
    #[cfg(unix)]
    if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
        return 128 + signal;
    }
    status.code().unwrap_or(-1)
}
