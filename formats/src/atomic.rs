//! Files that appear complete or not at all: written aside, synced, renamed.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::{Fault, Faults};

/// Writes `bytes` to `path` so that a reader finds the old file or the new one, never a part,
/// whatever happens to the program or the machine meanwhile. Missing folders are made.
///
/// The bytes go to `.NAME.part` in the same folder first; a part left behind by a killed program
/// is overwritten by the next writing.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Faults> {
    let fault = |error: std::io::Error| Faults::from(Fault::io(path, "written", &error));
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
        _ => PathBuf::from("."),
    };
    fs::create_dir_all(&folder).map_err(fault)?;
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let part = folder.join(format!(".{name}.part"));
    let written = (|| {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&part, path)?;
        // The rename itself must reach the disk; not every system lets a folder be synced.
        File::open(&folder)?.sync_all().or(Ok(()))
    })();
    written.map_err(|error| {
        let _ = fs::remove_file(&part);
        fault(error)
    })
}

/// The whole of a text file; a file that is missing or not UTF-8 is a fault.
pub fn read_text(path: &Path) -> Result<String, Faults> {
    fs::read_to_string(path).map_err(|error| Fault::io(path, "read", &error).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_whole_files_and_leaves_no_part_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.txt");
        write(&path, b"first").unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn names_the_file_it_cannot_write() {
        let folder = tempfile::tempdir().unwrap();
        let taken = folder.path().join("x");
        fs::create_dir(&taken).unwrap();
        let faults = write(&taken, b"").unwrap_err();
        assert!(faults.to_string().contains("x: file: cannot be written"), "{faults}");
    }
}
