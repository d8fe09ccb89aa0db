//! Folder in which programs run, and their processes.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::shim::{Sabotage, Shim};
use crate::process::{Executables, exit_code};

/// Longest duration of a program before it counts as one that hangs. The scenes take a second; other programs may use the
/// machine.
const MAX_DURATION: Duration = Duration::from_secs(600);

/// Exit code in place of that of a program that hangs.
pub const HANGS: i32 = -2;

/// Folder in which programs run.
pub struct Workplace {
    folder: TempDir,
    executables: Executables,
    shim: Shim,
}

/// End of a process.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Exit code, see [`exit_code`], or [`HANGS`].
    pub code: i32,
    pub stderr: String,
}

/// Process whose end is awaited, and the file of its messages.
pub struct RunningProgram(Child, PathBuf);

impl RunningProgram {
    /// Waits for the end.
    pub fn outcome(mut self) -> Outcome {
        let start = Instant::now();
        let mut pause = Duration::from_micros(100);
        let code = loop {
            match self.0.try_wait().unwrap() {
                Some(status) => break exit_code(status),
                None if start.elapsed() > MAX_DURATION => {
                    let _ = self.0.kill();
                    let _ = self.0.wait();
                    break HANGS;
                }
                None => std::thread::sleep(pause),
            }
            pause = (pause * 2).min(Duration::from_millis(5));
        };
        Outcome { code, stderr: String::from_utf8_lossy(&fs::read(&self.1).unwrap()).into_owned() }
    }

    /// Sends signals, one after the other.
    pub fn send(&self, signals: &[&str]) {
        let kills: Vec<String> =
            signals.iter().map(|signal| format!("kill -{signal} {} || true", self.0.id())).collect();
        let sent = Command::new("sh").args(["-c", &kills.join("; ")]).stderr(Stdio::null()).status();
        assert!(sent.is_ok_and(|status| status.success()), "no signal could be sent");
    }
}

impl Workplace {
    /// New temporary folder: in memory where the system has such a folder, as each file is synced.
    pub fn new(executables: Executables, shim: Shim) -> Workplace {
        let in_memory = tempfile::tempdir_in("/dev/shm");
        let folder = in_memory.or_else(|_| tempfile::tempdir()).expect("a temporary folder");
        Workplace { folder, executables, shim }
    }

    /// Folder in which the programs run.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Folder of the case, the same for all runs, as some files have its path.
    pub fn case(&self) -> PathBuf {
        self.folder.path().join("case")
    }

    /// Starts a program on the case. `shell`: command of the shell to run before it in the same process.
    pub fn start(&self, words: &[String], sabotage: Option<&Sabotage>, shell: &str) -> RunningProgram {
        let mut command = self.executables.command(words);
        if !shell.is_empty() {
            let mut limited = Command::new("sh");
            limited.arg("-c").arg(format!("{shell}; exec \"$@\"")).arg("sh").arg(command.get_program());
            limited.args(command.get_args());
            limited.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
            command = limited;
        }
        if let Some(sabotage) = sabotage {
            self.shim.attach(&mut command, &self.case(), sabotage);
        }
        static NUMBER: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
        let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let stderr = self.folder.path().join(format!("stderr-{}", number % 8));
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(&stderr).unwrap());
        RunningProgram(command.spawn().unwrap(), stderr)
    }

    /// Runs a program on the case to its end.
    pub fn run(&self, words: &[String], sabotage: Option<&Sabotage>) -> Outcome {
        self.start(words, sabotage, "").outcome()
    }
}
