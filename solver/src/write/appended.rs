//! File to which a run appends lines, with a checksum of its bytes so far.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::checksums::RunningChecksum;
use cd_formats::error::{Fault, Faults};

/// File to which a run appends lines.
pub struct AppendedFile {
    path: PathBuf,
    file: BufWriter<File>,
    sum: RunningChecksum,
}

impl AppendedFile {
    /// Opens an existing file. Errors: it cannot be read or written, or is a link.
    pub fn open(path: &Path) -> Result<Self, Faults> {
        let file = BufWriter::new(atomic::open_to_append(path)?);
        let mut sum = RunningChecksum::default();
        sum.add_file(path, u64::MAX)?;
        Ok(AppendedFile { path: path.to_path_buf(), file, sum })
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checksum of the bytes so far, with those that are not flushed yet.
    pub fn checksum(&self) -> &RunningChecksum {
        &self.sum
    }

    /// Appends text. Errors: the file cannot be written.
    pub fn append(&mut self, text: &str) -> Result<(), Faults> {
        self.sum.add(text.as_bytes());
        self.file.write_all(text.as_bytes()).map_err(|error| self.fault(&error))
    }

    /// Flushes the text so far, so that other programs can read it. Errors: the file cannot be written, or was removed or
    /// replaced.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.file.flush().map_err(|error| self.fault(&error))?;
        check_in_place(&self.path, self.file.get_ref(), "file")
    }

    /// Flushes the text so far and waits until it is on the disk. Errors as those of [`AppendedFile::flush_to_file`].
    pub fn sync_to_disk(&mut self) -> Result<(), Faults> {
        self.flush_to_file()?;
        self.file.get_ref().sync_data().map_err(|error| self.fault(&error))
    }

    fn fault(&self, error: &std::io::Error) -> Faults {
        Fault::from_io(&self.path, "written", error).into()
    }
}

/// Errors if `path` does not lead to the open file or folder any more: what the run writes would be lost.
pub fn check_in_place(path: &Path, opened: &File, object: &str) -> Result<(), Faults> {
    if atomic::leads_to(path, opened) {
        return Ok(());
    }
    let found = "was removed, renamed or replaced while the run was writing to it";
    Err(Fault::new(path, None, object, found, "leave the results in place until the run has ended").into())
}
