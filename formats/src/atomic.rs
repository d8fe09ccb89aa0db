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
    Part::write(path, bytes)?.put()
}

/// The same of files that belong together: none is put in its place before all are written.
pub fn write_all<'a>(files: impl IntoIterator<Item = (PathBuf, &'a [u8])>) -> Result<(), Faults> {
    let parts: Result<Vec<Part>, Faults> = files.into_iter().map(|(path, bytes)| Part::write(&path, bytes)).collect();
    parts?.into_iter().try_for_each(Part::put)
}

/// A file that is written and not in its place yet; removed if it never gets there.
struct Part {
    path: PathBuf,
    folder: PathBuf,
    part: PathBuf,
}

impl Part {
    fn write(path: &Path, bytes: &[u8]) -> Result<Part, Faults> {
        let fault = |error: std::io::Error| Faults::from(Fault::io(path, "written", &error));
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        fs::create_dir_all(&folder).map_err(fault)?;
        if path.is_dir() {
            return Err(fault(std::io::ErrorKind::IsADirectory.into()));
        }
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let part = Part { path: path.to_path_buf(), part: folder.join(format!(".{name}.part")), folder };
        let written = File::create(&part.part).and_then(|mut file| {
            file.write_all(bytes)?;
            file.sync_all()
        });
        written.map_err(fault).map(|()| part)
    }

    fn put(self) -> Result<(), Faults> {
        fs::rename(&self.part, &self.path).map_err(|error| Fault::io(&self.path, "written", &error))?;
        // The rename itself must reach the disk; not every system lets a folder be synced.
        let _ = File::open(&self.folder).and_then(|folder| folder.sync_all());
        Ok(())
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.part);
    }
}

/// The whole of a text file, without the mark that some editors put at its start; a file that is missing or not UTF-8
/// is a fault.
pub fn read_text(path: &Path) -> Result<String, Faults> {
    let text = fs::read_to_string(path).map_err(|error| Fault::io(path, "read", &error))?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text))
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
    fn files_that_belong_together_change_together() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
        let both = || [(first.clone(), &b"new"[..]), (second.clone(), &b"new"[..])];
        fs::write(&first, "old").unwrap();
        fs::create_dir(&second).unwrap();
        write_all(both()).unwrap_err();
        assert_eq!(fs::read(&first).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        fs::remove_dir(&second).unwrap();
        write_all(both()).unwrap();
        assert_eq!((fs::read(&first).unwrap(), fs::read(&second).unwrap()), (b"new".to_vec(), b"new".to_vec()));
    }

    #[test]
    fn a_byte_order_mark_is_no_text() {
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), "\u{feff}step,a\n").unwrap();
        assert_eq!(read_text(file.path()).unwrap(), "step,a\n");
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
