//! Files that appear complete or not at all: written to a temporary file, synced, renamed.

use std::fs::{self, File};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Fault, Faults};

/// Writes `bytes` to `path` so that a reader finds the old file or the new one, never a part, even if the program or the
/// machine fails meanwhile. Creates missing folders.
///
/// The bytes go to `.NAME.part` in the same folder first; a part left behind by a killed program is overwritten by the
/// next write.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Faults> {
    PendingFile::write(path, bytes)?.move_into_place()
}

/// Writes like `write` the bytes that `put` produces piece by piece, for files too large for memory.
pub fn write_with(path: &Path, put: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), Faults> {
    PendingFile::write_with(path, |file| {
        let mut file = BufWriter::new(file);
        put(&mut file)?;
        file.flush()
    })?
    .move_into_place()
}

/// Writes like `write` a file that `put` fills in any order.
pub fn write_file(path: &Path, put: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<(), Faults> {
    PendingFile::write_with(path, put)?.move_into_place()
}

/// Writes several files that belong together like `write`: none is renamed before all are written.
pub fn write_all<'a>(files: impl IntoIterator<Item = (PathBuf, &'a [u8])>) -> Result<(), Faults> {
    let files: Vec<(PathBuf, &[u8])> = files.into_iter().collect();
    let parts: Vec<Result<PendingFile, Faults>> =
        files.par_iter().map(|(path, bytes)| PendingFile::write(path, bytes)).collect();
    let parts: Result<Vec<PendingFile>, Faults> = parts.into_iter().collect();
    parts?.into_iter().try_for_each(PendingFile::move_into_place)
}

/// File that grows while the program runs, and appears complete at its path or not at all, like that of [`write()`].
pub struct GrowingFile {
    part: PendingFile,
    file: File,
    length: u64,
}

impl GrowingFile {
    /// Starts a file of `length` zeros, to be replaced by [`GrowingFile::finish`].
    pub fn create(path: &Path, length: usize) -> Result<GrowingFile, Faults> {
        let (part, file) = PendingFile::create(path)?;
        let mut growing = GrowingFile { part, file, length: 0 };
        growing.append(&vec![0; length])?;
        Ok(growing)
    }

    /// Number of bytes so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends bytes; returns their position in the file.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64, Faults> {
        self.file.write_all(bytes).map_err(|error| self.part.fault(&error))?;
        let position = self.length;
        self.length += bytes.len() as u64;
        Ok(position)
    }

    /// Replaces the first bytes, and moves the file to its path.
    pub fn finish(mut self, start: &[u8]) -> Result<(), Faults> {
        let file = &mut self.file;
        let written = file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(start)).and_then(|()| file.sync_all());
        written.map_err(|error| self.part.fault(&error))?;
        self.part.move_into_place()
    }
}

/// File that is written but not renamed yet; removed when dropped before.
struct PendingFile {
    path: PathBuf,
    folder: PathBuf,
    temporary_path: PathBuf,
}

impl PendingFile {
    fn write(path: &Path, bytes: &[u8]) -> Result<PendingFile, Faults> {
        PendingFile::write_with(path, |file| file.write_all(bytes))
    }

    fn write_with(path: &Path, put: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<PendingFile, Faults> {
        let (part, mut file) = PendingFile::create(path)?;
        put(&mut file).and_then(|()| file.sync_all()).map_err(|error| part.fault(&error))?;
        Ok(part)
    }

    fn fault(&self, error: &std::io::Error) -> Faults {
        Fault::from_io(&self.path, "written", error).into()
    }

    /// Creates the folder and the empty temporary file.
    fn create(path: &Path) -> Result<(PendingFile, File), Faults> {
        let fault = |error: std::io::Error| Faults::from(Fault::from_io(path, "written", &error));
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        fs::create_dir_all(&folder).map_err(fault)?;
        if path.is_dir() {
            return Err(fault(std::io::ErrorKind::IsADirectory.into()));
        }
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let part =
            PendingFile { path: path.to_path_buf(), temporary_path: folder.join(format!(".{name}.part")), folder };
        let file = File::create(&part.temporary_path).map_err(fault)?;
        Ok((part, file))
    }

    fn move_into_place(self) -> Result<(), Faults> {
        fs::rename(&self.temporary_path, &self.path).map_err(|error| Fault::from_io(&self.path, "written", &error))?;
        // The rename itself must reach the disk; not every system lets a folder be synced.
        let _ = File::open(&self.folder).and_then(|folder| folder.sync_all());
        Ok(())
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.temporary_path);
    }
}

/// Turns writes beyond the size limit (`ulimit -f`) into write errors, as on a full disk. By default the system ends the
/// program, and no temporary file is removed. To be called at the start of a program.
pub fn turn_size_limit_into_error() {
    // If the signal cannot be caught, it ends the program as by default.
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
}

/// Whether a folder has an entry of this name, even one that cannot be read, such as a broken link. Reading that is a
/// fault.
pub fn path_exists(path: &Path) -> bool {
    !path.symlink_metadata().is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound)
}

/// Paths of the entries of a folder, in any order; none if it is absent. A folder that cannot be read is a fault.
pub fn folder_entries(folder: &Path) -> Result<Vec<PathBuf>, Faults> {
    if !path_exists(folder) {
        return Ok(Vec::new());
    }
    let paths = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    paths.map_err(|error| Fault::from_io(folder, "read", &error).into())
}

/// Text of a file, without a byte order mark. A file that is missing or not UTF-8 is a fault.
pub fn read_text(path: &Path) -> Result<String, Faults> {
    let bytes = fs::read(path).map_err(|error| Fault::from_io(path, "read", &error))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
        Fault::new(path, Some(line), "file", "a letter is not encoded in UTF-8", "expected text in UTF-8")
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_link_that_leads_nowhere_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        assert!(!path_exists(&path) && folder_entries(&path) == Ok(Vec::new()));
        std::os::unix::fs::symlink("nowhere", &path).unwrap();
        assert!(path_exists(&path) && folder_entries(&path).is_err());
        assert_eq!(folder_entries(folder.path()), Ok(vec![path]));
    }

    #[test]
    fn texts_that_are_not_utf_8_are_rejected_with_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ron");
        fs::write(&path, b"(\n// caf\xe9\n)").unwrap();
        let refused = read_text(&path).unwrap_err().to_string();
        assert!(
            refused.ends_with("a.ron:2: file: a letter is not encoded in UTF-8; expected text in UTF-8"),
            "{refused}"
        );
    }

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
    fn a_growing_file_appears_when_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let grow = || {
            let mut file = GrowingFile::create(&path, 2).unwrap();
            assert_eq!((file.append(b"cde"), file.append(b"f"), file.length()), (Ok(2), Ok(5), 6));
            file
        };
        drop(grow());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = grow();
        assert!(!path.exists());
        file.finish(b"ab").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"abcdef");
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
