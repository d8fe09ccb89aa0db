//! `cd-pre pour SCENE DIR`: grains of a scene fall and come to rest, and their last state starts the next run.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use cd_formats::error::{Fault, Faults};
use cd_formats::messages::print_line;

use crate::datbox;
use crate::from_outbox;

/// Folder of the first run below that of the next.
pub const POUR_FOLDER: &str = "pour";

/// Arguments of the command.
#[derive(Debug, Clone, Copy)]
pub struct PourRequest<'a> {
    /// Scene of the first run.
    pub scene: &'a Path,
    /// Settings `PATH=VALUE`, which replace values of the scene.
    pub settings: &'a [String],
    /// Folder of the next run.
    pub dir: &'a Path,
    /// File of changes between the two runs.
    pub changes: Option<&'a Path>,
}

/// Writes DATBOX of the scene below `dir`/pour, computes it by `run_solver`, which returns the exit code of cd-solve, none if
/// that was killed, and makes `dir`/DATBOX from the last snapshot. Returns a summary for people.
///
/// Errors: faults of the changes that need no run, before it starts; faults of the scene; a run that does not end; and the
/// other faults of the changes, see [`datbox::write_datbox`] and [`from_outbox::write_datbox`].
pub fn pour_grains(
    request: &PourRequest,
    run_solver: impl FnOnce(&Path) -> io::Result<Option<i32>>,
) -> Result<String, Faults> {
    let PourRequest { scene, settings, dir, changes } = *request;
    if let Some(file) = changes {
        from_outbox::check_file(file)?;
    }
    let case = dir.join(POUR_FOLDER);
    print_line(datbox::write_datbox(scene, settings, &case.join("DATBOX"))?.trim_end());
    let code = run_solver(&case).map_err(|error| {
        let expected = "expected cd-solve in the folder of cd-pre, or in one of PATH";
        Fault::new(&case, None, "cd-solve", format!("cannot be started: {error}"), expected)
    })?;
    // With 1 its text could not be printed, but its files are whole.
    if !matches!(code, Some(0 | 1)) {
        let ending = code.map_or("was killed".to_string(), |code| format!("ended with exit code {code}"));
        let expected = format!("expected a run to its end; {}", advice_after(code, &case, request));
        return Err(Fault::new(&case, None, "cd-solve", ending, expected).into());
    }
    from_outbox::write_datbox(&case, changes, &[], dir)
}

/// Advice after a run of cd-solve that has not ended, with its exit code: the commands that continue, unless its input or its
/// results are faulty.
fn advice_after(code: Option<i32>, case: &Path, request: &PourRequest) -> String {
    if let Some(2 | 3) = code {
        return "correct the errors that cd-solve has printed".into();
    }
    let (case, dir) = (case.display(), request.dir.display());
    let changes = request.changes.map_or(String::new(), |changes| format!(" --changes {}", changes.display()));
    format!(
        "continue with cd-solve {case} --resume and the same options, then cd-pre from-outbox {case} {dir}{changes}"
    )
}

/// Runs `cd-solve CASE --force` with further arguments. Returns its exit code, none if it was killed.
///
/// Errors: a program that cannot be started.
pub fn run_solver(case: &Path, arguments: &[OsString]) -> io::Result<Option<i32>> {
    let status = Command::new(solver_path()).arg(case).arg("--force").args(arguments).status()?;
    Ok(status.code())
}

/// Path of cd-solve: in the folder of this program, or else a name for which PATH is searched.
fn solver_path() -> PathBuf {
    let name = format!("cd-solve{}", std::env::consts::EXE_SUFFIX);
    let sibling = std::env::current_exe().map(|program| program.with_file_name(&name));
    sibling.ok().filter(|path| path.is_file()).unwrap_or_else(|| name.into())
}
