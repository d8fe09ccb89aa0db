//! The library `shim.c`, which is preloaded into a program, and what it is to do there.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// Source of the library.
const SOURCE: &str = include_str!("shim.c");

/// Compiled library, in a temporary folder.
pub struct Shim(TempDir);

impl Shim {
    /// Compiles the library. Errors: this is not Linux, or there is no C compiler `cc` that can do so.
    pub fn compile() -> Result<Shim, String> {
        if !cfg!(target_os = "linux") {
            return Err("file operations can be made to fail on Linux only".into());
        }
        let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
        let source = folder.path().join("shim.c");
        std::fs::write(&source, SOURCE).map_err(|error| error.to_string())?;
        let shim = Shim(folder);
        let compiler =
            Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).arg(shim.shared_object()).arg(source).output();
        match compiler {
            Ok(output) if output.status.success() => Ok(shim),
            Ok(output) => Err(format!("cc: {}", String::from_utf8_lossy(&output.stderr).trim())),
            Err(error) => Err(format!("cc: {error}")),
        }
    }

    fn shared_object(&self) -> PathBuf {
        self.0.path().join("shim.so")
    }

    /// Preloads the library into a program, for the files of a folder.
    pub fn attach(&self, command: &mut Command, folder: &Path, sabotage: &Sabotage) {
        command.env("LD_PRELOAD", self.shared_object()).env("CD_SHIM_FOLDER", folder).envs(sabotage.variables());
    }
}

/// Kinds of file operations, each with its letter in `shim.c`.
pub const OPERATION_KINDS: [(char, &str); 7] = [
    ('o', "open to write"),
    ('w', "write"),
    ('s', "sync"),
    ('r', "rename"),
    ('u', "remove"),
    ('t', "truncate"),
    ('m', "create folder"),
];

/// Errors of file operations: name and number on Linux.
pub const FILE_ERRORS: [(&str, i32); 6] =
    [("ENOSPC", 28), ("EIO", 5), ("EDQUOT", 122), ("EROFS", 30), ("EACCES", 13), ("EMFILE", 24)];

/// Error of an operation that a signal has interrupted and that is to be repeated.
pub const INTERRUPTED_CALL: i32 = 4;

/// File operations to which an action applies, counted from 1.
#[derive(Debug, Clone, Copy)]
pub enum Operations {
    /// From the first to the second, both included.
    Range(u64, u64),
    /// Share of them, per million, drawn with a seed.
    Share(u64, u64),
}

/// Effect of the library in a program.
#[derive(Debug, Clone)]
pub enum Sabotage {
    /// Counts the operations, and writes their number to a file.
    Count(PathBuf),
    /// Ends the program; in a write after half of its bytes.
    Kill { kinds: String, operation: u64 },
    /// Lets operations fail; `half`: writes after half of their bytes.
    Fail { kinds: String, error: i32, operations: Operations, half: bool },
    /// Shortens writes to half of their bytes, which is no error.
    Shorten(Operations),
    /// Shifts all clocks by so many seconds.
    ShiftClocks(i64),
    /// Lets all clocks jump at each reading, by up to so many seconds forwards and backwards.
    ShakeClocks(i64),
}

impl Sabotage {
    /// Environment variables for the library.
    fn variables(&self) -> Vec<(&'static str, String)> {
        let range = |operations: Operations| match operations {
            Operations::Range(first, last) => {
                vec![("CD_SHIM_FIRST", first.to_string()), ("CD_SHIM_LAST", last.to_string())]
            }
            Operations::Share(share, seed) => {
                vec![("CD_SHIM_SHARE", share.to_string()), ("CD_SHIM_SEED", seed.to_string())]
            }
        };
        let action =
            |name: &str, kinds: &str| vec![("CD_SHIM_ACTION", name.to_string()), ("CD_SHIM_KINDS", kinds.to_string())];
        match self {
            Sabotage::Count(path) => vec![("CD_SHIM_COUNT", path.display().to_string())],
            Sabotage::Kill { kinds, operation } => {
                [action("kill", kinds), range(Operations::Range(*operation, *operation))].concat()
            }
            Sabotage::Fail { kinds, error, operations, half } => {
                let half = half.then(|| ("CD_SHIM_HALF", "1".to_string()));
                let error = [("CD_SHIM_ERROR", error.to_string())];
                action("fail", kinds).into_iter().chain(range(*operations)).chain(error).chain(half).collect()
            }
            Sabotage::Shorten(operations) => [action("short", "w"), range(*operations)].concat(),
            Sabotage::ShiftClocks(seconds) => vec![("CD_SHIM_CLOCK", seconds.to_string())],
            Sabotage::ShakeClocks(seconds) => vec![("CD_SHIM_CLOCK", format!("~{seconds}"))],
        }
    }
}
