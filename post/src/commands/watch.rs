//! `cd-post watch`: keeps the report of a running case up to date until the run ends.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cd_formats::error::Faults;
use cd_formats::lock::FolderLock;
use cd_formats::messages::print_line;
use cd_formats::names::count_text;
use cd_formats::snapshot;

use crate::commands::report;
use crate::options::MeasurementFlags;
use crate::snapshots::lock_case;

/// Least ratio of the time between two reports to the time that one takes, so that the run keeps its cores.
const PAUSE_RATIO: f64 = 4.0;

/// Time between two checks whether the run continues.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// Whether cd-solve computes the case: it has locked OUTBOX. If folders cannot be locked, no run is known.
fn is_run_active(dir: &Path) -> bool {
    // A shared lock does not disturb other observers; it ends here.
    FolderLock::shared(&dir.join("OUTBOX")).is_none()
}

/// Writes the report whenever there are new snapshots, at most every `interval`, s, and prints a line for each; ends with
/// the run, after the report of its last state. Returns the path of the report and notes for the user. Errors: those of
/// [`report::write`].
pub fn write(
    dir: &Path,
    interval: f64,
    every: u32,
    measures: &MeasurementFlags,
) -> Result<(PathBuf, Vec<String>), Faults> {
    let mut shown_step = None;
    loop {
        // Checked first, so that the last report has all snapshots.
        let is_active = is_run_active(dir);
        let snapshots = snapshot::list_snapshots(&dir.join("OUTBOX"))?;
        let last_step = snapshots.last().map(|(step, _)| *step);
        let mut duration = 0.0;
        // A run that has just begun has no snapshot.
        if !is_active || last_step != shown_step && last_step.is_some() {
            let started = Instant::now();
            let lock = lock_case(dir);
            let (path, notes) = report::write(dir, every, measures, is_active.then_some(interval))?;
            drop(lock);
            shown_step = last_step;
            duration = started.elapsed().as_secs_f64();
            if !is_active {
                return Ok((path, notes));
            }
            print_line(format_args!(
                "cd-post: {}: {}, to step {}",
                path.display(),
                count_text(snapshots.len(), "snapshot"),
                last_step.unwrap_or(0)
            ));
        }
        // The end of the run ends the pause.
        let pause = Duration::from_secs_f64(interval.max(PAUSE_RATIO * duration));
        let started = Instant::now();
        while started.elapsed() < pause && is_run_active(dir) {
            std::thread::sleep(CHECK_INTERVAL);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_known_by_its_lock() {
        let case = tempfile::tempdir().unwrap();
        assert!(!is_run_active(case.path()));
        std::fs::create_dir(case.path().join("OUTBOX")).unwrap();
        assert!(!is_run_active(case.path()));
        // Folders cannot be opened on all systems.
        let Ok(outbox) = std::fs::File::open(case.path().join("OUTBOX")) else { return };
        outbox.lock().unwrap();
        assert!(is_run_active(case.path()));
        outbox.unlock().unwrap();
        assert!(!is_run_active(case.path()));
    }
}
