//! Folder of DATBOX: its lock, and its files, which are replaced together.

use std::path::Path;

use cd_formats::atomic;
use cd_formats::checksums::{self, CHECKSUMS_FILE};
use cd_formats::error::{Fault, Faults};
use cd_formats::lock::FolderLock;
use cd_formats::snapshot::START_FILE;

/// File that records the origin of each body.
pub const ORIGIN_FILE: &str = "ORIGIN.csv";

/// Files that only `from-outbox` writes, and that would be misread with another scene.
pub const FROM_OUTBOX_FILES: [&str; 2] = [START_FILE, ORIGIN_FILE];

/// Creates the folder `datbox` and locks it for this run. Errors: it cannot be created, or another program reads or writes it.
pub fn lock_datbox(datbox: &Path) -> Result<FolderLock, Faults> {
    let case = datbox.parent().unwrap_or(Path::new(""));
    std::fs::create_dir_all(case).map_err(|error| Fault::from_io(case, "written", &error))?;
    FolderLock::exclusive(datbox)?.ok_or_else(|| {
        let found = "another program is reading or writing it";
        Fault::new(datbox, None, "folder", found, "wait for its end, or use another folder").into()
    })
}

/// Writes the files of DATBOX with the list of their checksums, by which cd-solve finds files that are changed, missing or of
/// another scene, and removes those that are `removed`. Errors: a file cannot be written or removed.
pub fn write_files<'a>(
    datbox: &Path,
    files: impl IntoIterator<Item = (&'a str, &'a [u8])>,
    removed: &[&str],
) -> Result<(), Faults> {
    let mut files: Vec<(&str, &[u8])> = files.into_iter().collect();
    let list = checksums::list_text(concat!("cd-pre ", env!("CARGO_PKG_VERSION")), files.iter().copied());
    files.push((CHECKSUMS_FILE, list.as_bytes()));
    atomic::write_folder(datbox, files, removed)
}
