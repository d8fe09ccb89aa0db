//! `OUTBOX/SHA256SUMS`: checksums of the files of DATBOX with which a run began, of its snapshots, and of its logs.
//!
//! Each snapshot has its line, and before it each log a comment with the checksum of its bytes at that time, so that both are
//! covered if the run is killed. At the end of a run the logs have lines as well. Sample:
//!
//! ```text
//! # cd-solve 0.1.0
//! 9c1e...  ../DATBOX/BODIES.DAT
//! # first 2310 bytes: 07aa...  steps.csv
//! 51f0...  snapshot-000010.npz
//! 07aa...  steps.csv
//! ```

use std::path::{Path, PathBuf};

use cd_formats::atomic::{self, folder_entries};
use cd_formats::checksums::{CHECKSUMS_FILE, Checksum, ChecksumLine, read_list};
use cd_formats::error::Faults;
use cd_formats::snapshot::{snapshot_files, step_of_file};

use super::appended::AppendedFile;

/// Path of a file of DATBOX in the list.
const DATBOX_PREFIX: &str = "../DATBOX/";

/// Snapshot from which a run continues.
#[derive(Debug, Clone, Copy)]
pub struct ResumedSnapshot {
    pub step: u64,
    /// Whether an unbroken run writes it, too.
    pub is_due: bool,
}

/// List of checksums that a run extends.
pub struct ResultChecksums {
    outbox: PathBuf,
    list: AppendedFile,
}

impl ResultChecksums {
    /// Removes the lines of the snapshot of `step`, of the logs up to it and of all that follows, before the logs are opened to
    /// continue from it: meanwhile they may have other bytes. Errors: the list cannot be read or written.
    pub fn reopen(outbox: &Path, step: u64) -> Result<(), Faults> {
        let Some(old) = read_list(outbox)? else { return Ok(()) };
        let is_head = |line: &&ChecksumLine| matches!(line, ChecksumLine::Comment(_)) || is_of_datbox(line);
        let lines = old.iter().filter(is_head).cloned().chain(lines_before(&old, step));
        let text: String = lines.map(|line| line.to_text()).collect();
        atomic::write(&outbox.join(CHECKSUMS_FILE), text.as_bytes())
    }

    /// Begins the list of a run, or continues that of a run which was resumed after a step, whose `logs` are open. The second
    /// value names the files of DATBOX that have changed since the list was begun.
    ///
    /// A last snapshot that is not due, which remains where a run was stopped, has no line from then on: the list is that of
    /// the unbroken run.
    ///
    /// Errors: a file of DATBOX or the last snapshot cannot be read, or the list not be written.
    pub fn open(
        case: &Path,
        outbox: &Path,
        resumed: Option<ResumedSnapshot>,
        logs: &[&AppendedFile],
    ) -> Result<(Self, Vec<String>), Faults> {
        let old = if resumed.is_some() { read_list(outbox)?.unwrap_or_default() } else { Vec::new() };
        let mut lines = vec![ChecksumLine::Comment(concat!(" cd-solve ", env!("CARGO_PKG_VERSION")).into())];
        lines.extend(datbox_lines(&case.join("DATBOX"))?);
        let old_datbox = old.iter().filter(|line| is_of_datbox(line));
        let changed =
            old_datbox.filter(|line| !lines.contains(line)).filter_map(file_path).map(str::to_string).collect();
        if let Some(ResumedSnapshot { step, is_due }) = resumed {
            lines.extend(lines_before(&old, step));
            if is_due {
                lines.extend(log_lines(outbox, logs));
                lines.extend(snapshot_lines(outbox, step)?);
            }
        }
        let path = outbox.join(CHECKSUMS_FILE);
        let text: String = lines.iter().map(ChecksumLine::to_text).collect();
        atomic::write(&path, text.as_bytes())?;
        Ok((ResultChecksums { outbox: outbox.to_path_buf(), list: AppendedFile::open(&path)? }, changed))
    }

    /// Adds the snapshot of a step, after the logs up to it. Errors: it cannot be read again, or the list not be written.
    pub fn add_snapshot(&mut self, step: u64, logs: &[&AppendedFile]) -> Result<(), Faults> {
        let lines = log_lines(&self.outbox, logs).chain(snapshot_lines(&self.outbox, step)?);
        let text: String = lines.map(|line| line.to_text()).collect();
        self.list.append(&text)?;
        self.list.flush_to_file()
    }

    /// Adds the complete logs at the end of a run. Errors: the list cannot be written.
    pub fn add_logs(&mut self, logs: &[&AppendedFile]) -> Result<(), Faults> {
        let line = |log: &&AppendedFile| ChecksumLine::File {
            path: path_from(&self.outbox, log.path()),
            checksum: log.checksum().checksum(),
        };
        let text: String = logs.iter().map(|log| line(log).to_text()).collect();
        self.list.append(&text)?;
        self.list.sync_to_disk()
    }
}

/// Path of the file of a line; none for comments.
fn file_path(line: &ChecksumLine) -> Option<&str> {
    match line {
        ChecksumLine::File { path, .. } => Some(path),
        _ => None,
    }
}

/// Whether a line is of a file of DATBOX.
fn is_of_datbox(line: &ChecksumLine) -> bool {
    file_path(line).is_some_and(|path| path.starts_with(DATBOX_PREFIX))
}

/// Lines of the snapshot of a step.
#[derive(Debug, Default, PartialEq)]
pub struct SnapshotLines {
    /// Lines of the first bytes of the logs up to it.
    pub logs: Vec<ChecksumLine>,
    /// Lines of its files.
    pub files: Vec<ChecksumLine>,
}

/// Lines of the snapshot of `step` in a list; those of the last such snapshot, if there are several.
pub fn lines_of_snapshot(list: &[ChecksumLine], step: u64) -> SnapshotLines {
    let (mut found, mut pending) = (SnapshotLines::default(), Vec::new());
    for line in list {
        match line {
            ChecksumLine::Start { .. } => pending.push(line.clone()),
            ChecksumLine::File { path, .. } if step_of_file(Path::new(path)) == Some(step) => {
                if !pending.is_empty() {
                    found = SnapshotLines { logs: std::mem::take(&mut pending), files: Vec::new() };
                }
                found.files.push(line.clone());
            }
            _ => pending.clear(),
        }
    }
    found
}

/// Lines of the files of DATBOX, by name.
fn datbox_lines(datbox: &Path) -> Result<Vec<ChecksumLine>, Faults> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_input = |path: &PathBuf| path.is_file() && !name(path).starts_with('.') && name(path) != CHECKSUMS_FILE;
    let mut paths: Vec<PathBuf> = folder_entries(datbox)?.into_iter().filter(is_input).collect();
    paths.sort();
    let line = |path: PathBuf| {
        let checksum = Checksum::from_file(&path)?;
        Ok(ChecksumLine::File { path: format!("{DATBOX_PREFIX}{}", name(&path)), checksum })
    };
    paths.into_iter().map(line).collect()
}

/// Lines of the snapshots before `step`, and of the logs up to each.
fn lines_before(old: &[ChecksumLine], step: u64) -> Vec<ChecksumLine> {
    let (mut lines, mut pending) = (Vec::new(), Vec::new());
    for line in old {
        match line {
            ChecksumLine::Start { .. } => pending.push(line.clone()),
            ChecksumLine::File { path, .. } => match step_of_file(Path::new(path)) {
                Some(line_step) if line_step < step => {
                    lines.append(&mut pending);
                    lines.push(line.clone());
                }
                _ => pending.clear(),
            },
            ChecksumLine::Comment(_) => {}
        }
    }
    lines
}

/// Lines of the logs so far.
fn log_lines(outbox: &Path, logs: &[&AppendedFile]) -> impl Iterator<Item = ChecksumLine> {
    logs.iter().map(|log| ChecksumLine::Start {
        path: path_from(outbox, log.path()),
        length: log.checksum().length(),
        checksum: log.checksum().checksum(),
    })
}

/// Lines of a snapshot and its parts.
fn snapshot_lines(outbox: &Path, step: u64) -> Result<Vec<ChecksumLine>, Faults> {
    let line = |path: PathBuf| {
        Ok(ChecksumLine::File { checksum: Checksum::from_file(&path)?, path: path_from(outbox, &path) })
    };
    snapshot_files(outbox, step).into_iter().map(line).collect()
}

/// Path of a file relative to OUTBOX: of one in it, or in another folder of the case.
fn path_from(outbox: &Path, path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match path.parent() {
        Some(folder) if folder != outbox => {
            format!("../{}/{name}", folder.file_name().unwrap_or_default().to_string_lossy())
        }
        _ => name.into_owned(),
    }
}
