//! Checks that a DATBOX is whole: that no program is writing it, none was ended while it did, and that it has the files that
//! cd-pre has written, as `DATBOX/SHA256SUMS` lists them. A DATBOX without that list is not compared.

use std::path::Path;

use cd_formats::atomic;
use cd_formats::checksums::{CHECKSUMS_FILE, ChecksumLine, FileState, file_state, read_list};
use cd_formats::error::{Fault, Faults};
use cd_formats::lock::FolderLock;

/// Locks a DATBOX for reading. Errors: cd-pre is writing it, or was ended while it did.
pub fn lock_datbox(datbox: &Path) -> Result<FolderLock, Faults> {
    let fault = |found: &str, expected: &str| Faults::from(Fault::new(datbox, None, "folder", found, expected));
    let lock = FolderLock::shared(datbox).ok_or_else(|| fault("cd-pre is writing it", "wait for its end"))?;
    if atomic::is_unfinished(datbox) {
        let found = "cd-pre was ended before it had replaced all files: some may belong to another scene";
        return Err(fault(found, "run cd-pre again"));
    }
    Ok(lock)
}

/// Compares a DATBOX with the list of its checksums. Returns a warning about files that have changed since cd-pre wrote them.
/// Errors: files of the list that are missing.
pub fn changed_files_warning(datbox: &Path) -> Result<Option<String>, Faults> {
    let Some(lines) = read_list(datbox)? else { return Ok(None) };
    // An OUTBOX with text files may be used as a DATBOX; its list is of other files.
    let Some(program) = lines.iter().find_map(written_by_pre) else { return Ok(None) };
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
        let names = changed.join(", ");
        format!("{}: changed since {program} wrote it: {names}; the run takes it as it is", datbox.display())
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
