//! Files that appear complete or not at all: written to a temporary file, synced, renamed.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use crate::error::{Fault, Faults};

/// Writes `bytes` to `path` so that a reader finds the old file or the new one, both complete, even if the program or the
/// machine fails meanwhile. Creates missing folders.
///
/// The bytes go to a new file `.NAME.part` in the same folder first. One that a killed program has left behind is removed
/// before; if it is a link, so is the link, and the file to which it leads stays as it is.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), Faults> {
    create_folder_of(path)?;
    PendingFile::write(path, bytes)?.move_into_place()
}

/// Writes like `write` the bytes that `put` produces piece by piece, for files too large for memory.
pub fn write_with(path: &Path, put: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), Faults> {
    create_folder_of(path)?;
    PendingFile::write_with(path, |file| {
        let mut file = BufWriter::new(file);
        put(&mut file)?;
        file.flush()
    })?
    .move_into_place()
}

/// Writes like `write` a file that `put` fills in any order. Its folder must exist: one that was removed or renamed while a
/// program writes to it is not made again.
pub fn write_file(path: &Path, put: impl FnOnce(&mut File) -> std::io::Result<()>) -> Result<(), Faults> {
    PendingFile::write_with(path, put)?.move_into_place()
}

/// Name of the file that marks a folder some of whose files have been replaced and others not yet.
const UNFINISHED_FILE: &str = ".unfinished";

/// Writes several files that belong together like `write`: none is renamed before all are written.
pub fn write_all<'a>(files: impl IntoIterator<Item = (PathBuf, &'a [u8])>) -> Result<(), Faults> {
    write_pending_files(files)?.into_iter().try_for_each(PendingFile::move_into_place)
}

/// Writes files of a folder like [`write_all`], and removes those that are `removed`. If the program is killed
/// meanwhile, or a rename fails, the folder remains marked as unfinished, see [`is_unfinished`].
pub fn write_folder<'a>(
    folder: &Path,
    files: impl IntoIterator<Item = (&'a str, &'a [u8])>,
    removed: &[&str],
) -> Result<(), Faults> {
    let pending_files = write_pending_files(files.into_iter().map(|(name, bytes)| (folder.join(name), bytes)))?;
    let mark = folder.join(UNFINISHED_FILE);
    write(&mark, b"")?;
    pending_files.into_iter().try_for_each(PendingFile::move_into_place)?;
    let removed = removed.iter().map(|name| folder.join(name)).filter(|path| path_exists(path));
    for path in removed.chain([mark]) {
        fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
    }
    sync_folder(folder);
    Ok(())
}

/// Writes the temporary files of several files.
fn write_pending_files<'a>(files: impl IntoIterator<Item = (PathBuf, &'a [u8])>) -> Result<Vec<PendingFile>, Faults> {
    let files: Vec<(PathBuf, &[u8])> = files.into_iter().collect();
    let pending_files: Vec<Result<PendingFile, Faults>> = files
        .par_iter()
        .map(|(path, bytes)| create_folder_of(path).and_then(|()| PendingFile::write(path, bytes)))
        .collect();
    pending_files.into_iter().collect()
}

/// Whether a program was ended while it replaced files of the folder that belong together, so that some may be old and
/// others new.
pub fn is_unfinished(folder: &Path) -> bool {
    path_exists(&folder.join(UNFINISHED_FILE))
}

/// File that grows while the program runs, and appears complete at its path or not at all, like that of [`write()`].
pub struct GrowingFile {
    pending: PendingFile,
    file: File,
    length: u64,
}

impl GrowingFile {
    /// Starts a file of `length` zeros, to be replaced by [`GrowingFile::finish`].
    pub fn create(path: &Path, length: usize) -> Result<GrowingFile, Faults> {
        create_folder_of(path)?;
        let (pending, file) = PendingFile::create(path)?;
        let mut growing = GrowingFile { pending, file, length: 0 };
        growing.append(&vec![0; length])?;
        Ok(growing)
    }

    /// Number of bytes so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Appends bytes; returns their position in the file.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64, Faults> {
        self.file.write_all(bytes).map_err(|error| self.pending.fault(&error))?;
        let position = self.length;
        self.length += bytes.len() as u64;
        Ok(position)
    }

    /// Replaces the first bytes, and moves the file to its path.
    pub fn finish(mut self, start: &[u8]) -> Result<(), Faults> {
        let file = &mut self.file;
        let written = file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(start)).and_then(|()| sync_file(file));
        written.map_err(|error| self.pending.fault(&error))?;
        self.pending.move_into_place()
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
        let (pending, mut file) = PendingFile::create(path)?;
        put(&mut file).and_then(|()| sync_file(&file)).map_err(|error| pending.fault(&error))?;
        Ok(pending)
    }

    fn fault(&self, error: &std::io::Error) -> Faults {
        Fault::from_io(&self.path, "written", error).into()
    }

    /// Creates the empty temporary file.
    fn create(path: &Path) -> Result<(PendingFile, File), Faults> {
        let fault = |error: std::io::Error| Faults::from(Fault::from_io(path, "written", &error));
        let folder = folder_of(path).to_path_buf();
        if path.is_dir() {
            return Err(fault(ErrorKind::IsADirectory.into()));
        }
        let pending = PendingFile { path: path.to_path_buf(), temporary_path: temporary_path(path), folder };
        remove_temporary_file(path)?;
        // A new file: a link that has appeared meanwhile is not followed.
        let file = OpenOptions::new().write(true).create_new(true).open(&pending.temporary_path).map_err(fault)?;
        Ok((pending, file))
    }

    fn move_into_place(self) -> Result<(), Faults> {
        fs::rename(&self.temporary_path, &self.path).map_err(|error| Fault::from_io(&self.path, "written", &error))?;
        sync_folder(&self.folder);
        Ok(())
    }
}

impl Drop for PendingFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.temporary_path);
    }
}

/// Folder of a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Creates the folder of a file, if it is missing. Errors: it cannot be created.
pub fn create_folder_of(path: &Path) -> Result<(), Faults> {
    fs::create_dir_all(folder_of(path)).map_err(|error| Fault::from_io(path, "written", &error).into())
}

/// Path of the file that is written in place of `path`, until it is complete.
pub fn temporary_path(path: &Path) -> PathBuf {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    path.with_file_name(format!(".{name}.part"))
}

/// Removes the temporary file that a killed program has left behind for the file `path`, or a link of that name.
pub fn remove_temporary_file(path: &Path) -> Result<(), Faults> {
    match fs::remove_file(temporary_path(path)) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(Fault::from_io(path, "written", &error).into()),
        _ => Ok(()),
    }
}

/// Removes all temporary files that killed programs have left behind in `folder`. One that cannot be removed stays: it does
/// no harm.
pub fn remove_temporary_files(folder: &Path) {
    let is_temporary = |entry: &fs::DirEntry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        name.starts_with('.') && name.ends_with(".part")
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(is_temporary).for_each(|entry| {
        let _ = fs::remove_file(entry.path());
    });
}

/// Whether files are synced.
static ARE_FILES_SYNCED: AtomicBool = AtomicBool::new(true);

/// Sets whether this process waits until its files have reached the disk, as it does by default. Otherwise the last files
/// may be damaged or lost if the machine fails, but not if only the program is killed.
pub fn set_syncing(are_files_synced: bool) {
    ARE_FILES_SYNCED.store(are_files_synced, Ordering::Relaxed);
}

/// Waits until the contents of a file have reached the disk, unless files are not synced, see [`set_syncing`].
pub fn sync_file(file: &File) -> std::io::Result<()> {
    if ARE_FILES_SYNCED.load(Ordering::Relaxed) { file.sync_data() } else { Ok(()) }
}

/// Waits until renames and removals in a folder have reached the disk. Not every system lets a folder be synced.
fn sync_folder(folder: &Path) {
    if ARE_FILES_SYNCED.load(Ordering::Relaxed) {
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
}

/// Opens an existing file to append to it. Errors: it cannot be written, or is a link.
pub fn open_to_append(path: &Path) -> Result<File, Faults> {
    let mut options = OpenOptions::new();
    options.append(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NOFOLLOW);
    options.open(path).map_err(|error| Fault::from_io(path, "written", &error).into())
}

/// Whether `path` leads to the open file or folder, and not to another that has replaced it. True where a system does not number
/// its files.
pub fn leads_to(path: &Path, file: &File) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
        let (here, opened) = (fs::metadata(path).map(identity), file.metadata().map(identity));
        here.is_ok_and(|here| opened.is_ok_and(|opened| here == opened))
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        path.exists()
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
    !path.symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound)
}

/// Paths of the entries of a folder, in any order; none if it is absent. A folder that cannot be read is a fault.
pub fn folder_entries(folder: &Path) -> Result<Vec<PathBuf>, Faults> {
    if !path_exists(folder) {
        return Ok(Vec::new());
    }
    let paths = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    paths.map_err(|error| Fault::from_io(folder, "read", &error).into())
}

/// Opens a file to read it. Errors: it cannot be read, or is a pipe, a socket or a device, whose end may never come.
pub fn open_to_read(path: &Path) -> Result<File, Faults> {
    let read_fault = |error: std::io::Error| Faults::from(Fault::from_io(path, "read", &error));
    let kind = fs::metadata(path).map_err(read_fault)?.file_type();
    if !kind.is_file() && !kind.is_dir() {
        let found = "is a pipe, a socket or a device";
        return Err(Fault::new(path, None, "file", found, "expected a file on a disk; copy it to one").into());
    }
    File::open(path).map_err(read_fault)
}

/// Bytes of a file. Errors as those of [`open_to_read`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, Faults> {
    let mut file = open_to_read(path)?;
    let mut bytes = Vec::with_capacity(file.metadata().map_or(0, |metadata| metadata.len() as usize));
    file.read_to_end(&mut bytes).map_err(|error| Fault::from_io(path, "read", &error))?;
    Ok(bytes)
}

/// Text of a file, without a byte order mark. A file that is missing or not UTF-8 is a fault, as those of [`open_to_read`].
pub fn read_text(path: &Path) -> Result<String, Faults> {
    let bytes = read_bytes(path)?;
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
    fn replaces_whole_files_and_leaves_no_temporary_file_behind() {
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
    fn a_folder_is_marked_until_all_its_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let files = || [("first", &b"new"[..]), ("second", &b"new"[..])];
        write_folder(folder.path(), files(), &[]).unwrap();
        assert!(!is_unfinished(folder.path()));
        // A folder in the place of the second file: it is rejected before any rename.
        let second = folder.path().join("second");
        fs::remove_file(&second).unwrap();
        fs::create_dir(&second).unwrap();
        write_folder(folder.path(), files(), &[]).unwrap_err();
        assert!(!is_unfinished(folder.path()), "nothing was renamed");
        fs::remove_dir(&second).unwrap();
        fs::write(folder.path().join(UNFINISHED_FILE), "").unwrap();
        assert!(is_unfinished(folder.path()));
        write_folder(folder.path(), files(), &[]).unwrap();
        assert!(!is_unfinished(folder.path()) && fs::read(second).unwrap() == b"new");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed_for_writing() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a.csv", "precious"].map(|name| folder.path().join(name));
        fs::write(&other, "precious").unwrap();
        for link in [temporary_path(&path), path.clone()] {
            std::os::unix::fs::symlink(&other, &link).unwrap();
        }
        assert!(open_to_append(&path).is_err());
        write(&path, b"new").unwrap();
        assert!(!path_exists(&temporary_path(&path)) && !path.is_symlink());
        assert_eq!((fs::read(&path).unwrap(), fs::read(&other).unwrap()), (b"new".to_vec(), b"precious".to_vec()));
        open_to_append(&path).unwrap().write_all(b"er").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"newer");
    }

    #[cfg(unix)]
    #[test]
    fn devices_are_not_read() {
        let refused = read_text(Path::new("/dev/zero")).unwrap_err().to_string();
        assert!(refused.contains("is a pipe, a socket or a device"), "{refused}");
    }

    #[cfg(unix)]
    #[test]
    fn a_replaced_file_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write(&path, b"a").unwrap();
        let file = File::open(&path).unwrap();
        assert!(leads_to(&path, &file));
        write(&path, b"a").unwrap();
        assert!(!leads_to(&path, &file));
        fs::remove_file(&path).unwrap();
        assert!(!leads_to(&path, &file));
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

    #[test]
    fn a_file_written_in_pieces_appears_complete_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b");
        let full = |_: &mut dyn Write| Err(std::io::Error::other("full"));
        let faults = write_with(&path, full).unwrap_err().to_string();
        assert!(faults.contains("b: file: cannot be written") && faults.contains("full"), "{faults}");
        assert_eq!(fs::read_dir(folder.path().join("a")).unwrap().count(), 0);
        write_with(&path, |out| out.write_all(b"ab").and_then(|()| out.write_all(b"c"))).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"abc");
    }

    #[test]
    fn temporary_files_of_killed_programs_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let names = [".snapshot-000448.npz.part", "a.part", ".a", "b"];
        names.iter().for_each(|name| fs::write(folder.path().join(name), "").unwrap());
        fs::create_dir(folder.path().join(".c.part")).unwrap();
        remove_temporary_files(folder.path());
        let mut left: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        assert_eq!(left, [".a", ".c.part", "a.part", "b"]);
        remove_temporary_files(&folder.path().join("absent"));
    }

    #[test]
    fn a_temporary_file_that_cannot_be_removed_is_a_fault() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        assert_eq!(remove_temporary_file(&path), Ok(()));
        fs::create_dir(temporary_path(&path)).unwrap();
        assert!(remove_temporary_file(&path).is_err());
    }
}
