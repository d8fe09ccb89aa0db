//! File to which a run appends lines, with a checksum of its bytes so far.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::checksums::RunningChecksum;
use cd_formats::error::{Fault, Faults};

/// Size of the text that waits in memory, bytes.
const MAX_WAITING_TEXT: usize = 8192;

/// File to which a run appends lines.
pub struct AppendedFile {
    path: PathBuf,
    file: File,
    /// Text that is not yet in the file.
    waiting: String,
    /// Error of a write, which all later ones have as well: no later line follows a gap in the file.
    failure: Option<io::ErrorKind>,
    sum: RunningChecksum,
}

impl AppendedFile {
    /// Opens an existing file. Errors: it cannot be read or written, or is a link.
    pub fn open(path: &Path) -> Result<Self, Faults> {
        let file = atomic::open_to_append(path)?;
        let mut sum = RunningChecksum::default();
        sum.add_file(path, u64::MAX)?;
        Ok(AppendedFile { path: path.to_path_buf(), file, waiting: String::new(), failure: None, sum })
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
        self.waiting.push_str(text);
        if self.waiting.len() < MAX_WAITING_TEXT {
            return Ok(());
        }
        self.write_waiting_text().map_err(|error| self.fault(&error))
    }

    /// Writes the waiting text. Errors: this or an earlier write fails.
    fn write_waiting_text(&mut self) -> io::Result<()> {
        if let Some(failure) = self.failure {
            return Err(failure.into());
        }
        let written = self.file.write_all(self.waiting.as_bytes());
        self.failure = written.as_ref().err().map(io::Error::kind);
        self.waiting.clear();
        written
    }

    /// Flushes the text so far, so that other programs can read it. Errors: the file cannot be written, or was removed or
    /// replaced.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.write_waiting_text().map_err(|error| self.fault(&error))?;
        check_in_place(&self.path, &self.file, "file")
    }

    /// Flushes the text so far and waits until it is on the disk. Errors as those of [`AppendedFile::flush_to_file`].
    pub fn sync_to_disk(&mut self) -> Result<(), Faults> {
        self.flush_to_file()?;
        atomic::sync_file(&self.file).map_err(|error| self.fault(&error))
    }

    fn fault(&self, error: &std::io::Error) -> Faults {
        Fault::from_io(&self.path, "written", error).into()
    }
}

impl Drop for AppendedFile {
    /// Writes the waiting text of a run that ends early.
    fn drop(&mut self) {
        let _ = self.write_waiting_text();
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
