//! Checks that a DATBOX is whole: that no program is writing it, none was ended while it did, and that it has the files that
//! cd-pre has written, as `DATBOX/SHA256SUMS` lists them. A DATBOX without that list is not compared.

use std::path::Path;

use cd_formats::atomic;
use cd_formats::checksums::{CHECKSUMS_FILE, ChecksumLine, FileState, file_state, read_whole_list};
use cd_formats::error::{Fault, Faults};
use cd_formats::lock::FolderLock;

/// Largest number of changed files that are named.
const MAX_SHOWN_NAMES: usize = 20;

/// Locks a DATBOX for reading. Errors: cd-pre is writing it, or was ended while it did.
pub fn lock_datbox(datbox: &Path) -> Result<FolderLock, Faults> {
    let lock = share_datbox(datbox)?;
    unfinished_fault(datbox).map_or(Ok(lock), |fault| Err(fault.into()))
}

/// Locks a DATBOX for reading, even if it is unfinished. Errors: cd-pre is writing it.
pub fn share_datbox(datbox: &Path) -> Result<FolderLock, Faults> {
    let fault = || Fault::new(datbox, None, "folder", "cd-pre is writing it", "wait for its end");
    FolderLock::shared(datbox).ok_or_else(|| fault().into())
}

/// Fault of a DATBOX that cd-pre was replacing when it was ended; `None` of others.
pub fn unfinished_fault(datbox: &Path) -> Option<Fault> {
    let found = "cd-pre was ended before it had replaced all files: some may belong to another scene";
    atomic::is_unfinished(datbox).then(|| Fault::new(datbox, None, "folder", found, "run cd-pre again"))
}

/// List of checksums that cd-pre has written.
pub struct WrittenList {
    /// Lines of the list.
    pub lines: Vec<ChecksumLine>,
    /// Name and version of cd-pre.
    program: String,
}

/// List of the checksums of a DATBOX; `None` if cd-pre has not written it. Errors: it cannot be read.
pub fn written_list(datbox: &Path) -> Result<Option<WrittenList>, Faults> {
    let Some(lines) = read_whole_list(datbox)? else { return Ok(None) };
    // An OUTBOX with text files may be used as a DATBOX; its list is of other files.
    let program = lines.iter().find_map(written_by_pre).map(str::to_string);
    Ok(program.map(|program| WrittenList { lines, program }))
}

/// Compares a DATBOX with the list of its checksums. Returns a warning about files that have changed since cd-pre wrote them.
/// Errors: files of the list that are missing.
pub fn changed_files_warning(datbox: &Path) -> Result<Option<String>, Faults> {
    let Some(WrittenList { lines, program }) = written_list(datbox)? else { return Ok(None) };
    let (mut changed, mut faults) = (Vec::new(), Faults::default());
    for line in &lines {
        let ChecksumLine::File { path: name, checksum } = line else { continue };
        let path = datbox.join(name);
        match faults.gather_result(file_state(&path, u64::MAX, *checksum)) {
            Some(FileState::Changed) => changed.push(name.as_str()),
            Some(FileState::Missing) => {
                let expected = format!("run cd-pre again, or remove {CHECKSUMS_FILE} if the file is not needed");
                faults.push(Fault::new(&path, None, "file", format!("is missing; {program} has written it"), expected));
            }
            Some(FileState::Sound) | None => {}
        }
    }
    let warning = (!changed.is_empty()).then(|| {
        let shown = changed.len().min(MAX_SHOWN_NAMES);
        let more = if changed.len() > shown { format!(", {} more", changed.len() - shown) } else { String::new() };
        let names = changed[..shown].join(", ") + &more;
        format!(
            "{}: changed since {program} wrote them: {names}; the run uses them; if they were not edited on purpose, run \
             cd-pre again",
            datbox.display()
        )
    });
    faults.into_result(warning)
}

/// Name and version of cd-pre in a line of a list that it has written.
fn written_by_pre(line: &ChecksumLine) -> Option<&str> {
    match line {
        ChecksumLine::Comment(comment) => Some(comment.trim()).filter(|program| program.starts_with("cd-pre")),
        _ => None,
    }
}
