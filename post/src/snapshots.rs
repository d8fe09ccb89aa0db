//! Lists and selections of the snapshots of a case, and the lock of a case.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use cd_formats::error::{Fault, Faults};
use cd_formats::lock::FolderLock;
use cd_formats::messages::print_error;
use cd_formats::{atomic, snapshot};
use indicatif::{ProgressBar, ProgressStyle};

/// Lists the snapshots of a folder by step; errors if there are none.
pub fn list_snapshots(outbox: &Path) -> Result<Vec<(u64, PathBuf)>, Faults> {
    let expected = "expected snapshot-*.npz, the results of cd-solve";
    let folder_fault = |found: &str| Err(Fault::new(outbox, None, "folder", found, expected).into());
    match snapshot::list_snapshots(outbox)? {
        _ if !atomic::path_exists(outbox) => folder_fault("is missing"),
        all if all.is_empty() => folder_fault("has no snapshot"),
        all => Ok(all),
    }
}

/// Returns step and path of every `every`th snapshot, and of the last. Errors: OUTBOX is missing or has no snapshot.
pub fn select_snapshots(outbox: &Path, every: u32) -> Result<Vec<(u64, PathBuf)>, Faults> {
    let all = list_snapshots(outbox)?;
    let last = all.len() - 1;
    let is_selected = |k: usize| k == last || k.is_multiple_of(every as usize);
    Ok(all.into_iter().enumerate().filter(|(k, _)| is_selected(*k)).map(|(_, found)| found).collect())
}

/// Whether snapshot `k` of `count` is one of `selection_count` that are spread evenly from the first to the last; of one, the first.
pub fn is_evenly_chosen(k: usize, count: usize, selection_count: usize) -> bool {
    let gaps = selection_count.max(2) - 1;
    (0..selection_count).any(|gap| (count - 1) * gap / gaps == k)
}

/// Progress bar on a terminal, hidden otherwise.
pub fn progress_bar(count: usize) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("cd-post {bar:40} {pos}/{len} snapshots, {eta} left");
    ProgressBar::new(count as u64).with_style(style.expect("a fixed template"))
}

/// Locks a case for this run; waits for another run that works in it. Two runs would write the same files, and each would remove
/// files of the other.
pub fn lock_case(case: &Path) -> FolderLock {
    FolderLock::exclusive_after_others(case, || {
        print_error(format_args!(
            "cd-post: {}: another cd-post runs in this case; waiting for its end",
            case.display()
        ));
    })
}
