//! Room: state and reports to the files of OUTBOX.

pub mod errors;
mod log;
mod problem;
mod snapshot;
pub mod summary;
mod text;

use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use cd_formats::atomic::{entries, is_there};
use cd_formats::error::{Fault, Faults};
use cd_formats::snapshot::list;

use crate::scene::Scene;
use crate::state::State;
use crate::step::{Clock, StepReport};

use errors::Tally;
use log::Table;
pub use problem::{expect as expect_problem, write as problem};

/// The results of a case: snapshots and `steps.csv` in OUTBOX, `TIMER.csv` beside it. Durations
/// stand apart, so that equal runs have equal bytes in OUTBOX.
pub struct Results {
    outbox: PathBuf,
    steps: Table,
    timer: Table,
    /// What is added to the numbers of text files.
    numbered: u64,
}

/// OUTBOX of a case.
pub fn outbox(case: &Path) -> PathBuf {
    case.join("OUTBOX")
}

/// An OUTBOX that is this run's alone.
pub struct Lock {
    folder: Option<File>,
    /// If it was not there before.
    made: Option<PathBuf>,
}

impl Drop for Lock {
    fn drop(&mut self) {
        // What was refused leaves nothing behind; a folder with files stays.
        self.made.take().into_iter().for_each(|path| drop(std::fs::remove_dir(path)));
        // Closing is not enough: a program that is just being started from this process has the file open, too.
        self.folder.take().into_iter().for_each(|folder| drop(folder.unlock()));
    }
}

/// Takes the OUTBOX of a case for this run alone, and makes it if need be. A DATBOX may be shared.
///
/// Errors: another run has it, or it cannot be made. Where folders cannot be locked, every run gets it.
pub fn lock(case: &Path) -> Result<Lock, Faults> {
    let path = outbox(case);
    let made = match std::fs::create_dir(&path) {
        Ok(()) => Some(path.clone()),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => None,
        Err(error) => return Err(Fault::io(&path, "made", &error).into()),
    };
    let folder = File::open(&path).ok();
    if folder.as_ref().is_some_and(|folder| matches!(folder.try_lock(), Err(TryLockError::WouldBlock))) {
        let expected = "expected one run of a case at a time";
        return Err(Fault::new(case, None, "folder", "another run is at work in it", expected).into());
    }
    Ok(Lock { folder, made })
}

/// Refuses a case that has results; LMGC90's count only if this run would write over them (`text`).
pub fn expect_none(case: &Path, text: bool) -> Result<(), Faults> {
    let outbox = outbox(case);
    let (found, expected) = match list(&outbox)?.last() {
        Some((_, last)) => {
            let found = format!("{} exists", last.file_name().unwrap_or_default().display());
            (found, "use --resume to continue from it, --force to overwrite all results")
        }
        None if text && is_there(&outbox.join("DOF.OUT.1")) => {
            ("DOF.OUT.1 exists".into(), "--text would overwrite it; use --force to remove such files")
        }
        None => return Ok(()),
    };
    Err(Fault::new(&outbox, None, "results", found, expected).into())
}

/// Removes what an earlier run wrote, and nothing else.
pub fn remove(case: &Path) -> Result<(), Faults> {
    let outbox = outbox(case);
    let ours = |name: &str| {
        (name.starts_with("snapshot-") && name.ends_with(".npz"))
            || name == log::STEPS
            || name.starts_with("DOF.OUT.")
            || name.starts_with("Vloc_Rloc.OUT.")
    };
    let mut doomed = vec![case.join(log::TIMER), case.join(errors::ERRORS)];
    let is_ours = |path: &PathBuf| path.file_name().and_then(|name| name.to_str()).is_some_and(ours);
    doomed.extend(entries(&outbox)?.into_iter().filter(is_ours));
    for path in doomed.iter().filter(|path| is_there(path)) {
        std::fs::remove_file(path).map_err(|error| Fault::io(path, "removed", &error))?;
    }
    Ok(())
}

impl Results {
    /// Opens the results for a run that goes on from `state`: rows of later steps are dropped. Those of earlier ones make the
    /// tally.
    pub fn open(case: &Path, scene: &Scene, state: &State) -> Result<(Self, Tally), Faults> {
        let outbox = outbox(case);
        let mut columns = log::steps_header();
        if scene.options.adaptive().is_on() {
            columns = format!("{columns},{}", log::length_header());
        }
        if scene.bonds() {
            columns = format!("{columns},{}", log::bonds_header());
        }
        if scene.narrow_phase_is_fast() {
            columns = format!("{columns},{}", log::missed_header());
        }
        if scene.options.lmgc90_norms {
            columns = format!("{columns},{}", log::norms_header());
        }
        let first = scene.start.0;
        let (steps, figures) = Table::open(&outbox.join(log::STEPS), &columns, first, state.step)?;
        let (timer, seconds) = Table::open(&case.join(log::TIMER), &log::timer_header(), first, state.step)?;
        let numbered = if scene.options.text { text::numbered(&outbox, scene, state)? } else { 0 };
        Ok((Results { outbox, steps, timer, numbered }, Tally::of(&figures, &seconds)))
    }

    /// Enters a step in the logs.
    pub fn step(&mut self, scene: &Scene, state: &State, report: &StepReport, lap: &Clock) -> Result<(), Faults> {
        let mut row = log::steps_row(scene, state, report);
        if scene.options.adaptive().is_on() {
            row = format!("{row},{}", log::length_row(report));
        }
        if scene.bonds() {
            row = format!("{row},{}", log::bonds_row(state));
        }
        if scene.narrow_phase_is_fast() {
            row = format!("{row},{}", log::missed_row(scene, report));
        }
        if let Some(norms) = &report.norms {
            row = format!("{row},{}", log::norms_row(norms));
        }
        self.steps.row(&row)?;
        self.timer.row(&log::timer_row(state.step, lap))
    }

    /// Lets others see the rows so far.
    pub fn show(&mut self) -> Result<(), Faults> {
        self.steps.show()?;
        self.timer.show()
    }

    /// Writes the state, after the log of the steps that led to it.
    pub fn state(&mut self, scene: &Scene, state: &State) -> Result<(), Faults> {
        self.steps.flush()?;
        self.timer.flush()?;
        if scene.options.text {
            text::write(&self.outbox, scene, state, self.numbered)?;
        }
        snapshot::of(scene, state).write(&cd_formats::snapshot::path(&self.outbox, state.step))
    }
}
