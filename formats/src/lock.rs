//! Locks of folders, by which programs that would write or read the same files exclude each other.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::atomic;
use crate::error::{Fault, Faults};

/// Lock of a folder, which ends when it is dropped. Where folders cannot be locked, every program gets it.
#[derive(Debug)]
pub struct FolderLock {
    folder: Option<File>,
    /// Path, if the lock created the folder.
    created: Option<PathBuf>,
}

impl FolderLock {
    /// Locks a folder for one program alone, and creates it if it is absent; `None` if another program has locked it.
    /// Errors: it cannot be created.
    pub fn exclusive(path: &Path) -> Result<Option<FolderLock>, Faults> {
        let created = match fs::create_dir(path) {
            Ok(()) => Some(path.to_path_buf()),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => None,
            Err(error) => return Err(Fault::from_io(path, "created", &error).into()),
        };
        Ok(FolderLock::open(path, created, File::try_lock))
    }

    /// Locks a folder for one program alone; if another program has locked it, calls `report_wait` and waits for that one. A
    /// folder that is absent is not created.
    pub fn exclusive_after_others(path: &Path, report_wait: impl FnOnce()) -> FolderLock {
        let lock = |folder: &File| match folder.try_lock() {
            Err(TryLockError::WouldBlock) => {
                report_wait();
                folder.lock().map_err(TryLockError::Error)
            }
            result => result,
        };
        FolderLock::open(path, None, lock).unwrap_or(FolderLock { folder: None, created: None })
    }

    /// Locks a folder together with other programs that read it; `None` if a program has locked it for itself.
    pub fn shared(path: &Path) -> Option<FolderLock> {
        FolderLock::open(path, None, File::try_lock_shared)
    }

    fn open(
        path: &Path,
        created: Option<PathBuf>,
        lock: impl FnOnce(&File) -> Result<(), TryLockError>,
    ) -> Option<FolderLock> {
        let folder = atomic::open_to_read(path).ok();
        let is_taken = folder.as_ref().is_some_and(|folder| matches!(lock(folder), Err(TryLockError::WouldBlock)));
        (!is_taken).then_some(FolderLock { folder, created })
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // A rejected run leaves no empty folder; a folder with files remains.
        self.created.take().into_iter().for_each(|path| drop(fs::remove_dir(path)));
        // Closing is not enough: a child process that is just being started has the file open, too.
        self.folder.take().into_iter().for_each(|folder| drop(folder.unlock()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_program_excludes_others_and_readers_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let lock = FolderLock::exclusive(&path).unwrap().unwrap();
        assert!(FolderLock::exclusive(&path).unwrap().is_none() && FolderLock::shared(&path).is_none());
        drop(lock);
        assert!(!path.exists(), "an empty folder that a lock has created goes with it");
        fs::create_dir(&path).unwrap();
        let first = FolderLock::shared(&path).unwrap();
        let second = FolderLock::shared(&path).unwrap();
        assert!(FolderLock::exclusive(&path).unwrap().is_none());
        drop((first, second));
        assert!(FolderLock::exclusive(&path).unwrap().is_some() && path.exists());
    }

    #[test]
    fn a_program_waits_for_another() {
        let folder = tempfile::tempdir().unwrap();
        let first = FolderLock::exclusive_after_others(folder.path(), || panic!("the folder is free"));
        let mut first = Some(first);
        let second = FolderLock::exclusive_after_others(folder.path(), || drop(first.take()));
        assert!(first.is_none() && FolderLock::shared(folder.path()).is_none());
        drop(second);
        assert!(FolderLock::shared(folder.path()).is_some());
        let absent = folder.path().join("absent");
        drop(FolderLock::exclusive_after_others(&absent, || panic!("there is no folder")));
        assert!(!absent.exists());
    }
}
