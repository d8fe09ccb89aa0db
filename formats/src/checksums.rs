//! SHA-256 checksums of the files of a folder, in a file that `sha256sum --check` reads, too.

use std::fmt::{self, Write as _};
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::atomic::{self, path_exists};
use crate::error::{Fault, Faults};

/// Name of the list of checksums in DATBOX and in OUTBOX.
pub const CHECKSUMS_FILE: &str = "SHA256SUMS";

/// SHA-256 checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Checksum([u8; 32]);

impl Checksum {
    /// Checksum of bytes.
    pub fn from_bytes(bytes: &[u8]) -> Checksum {
        Checksum(Sha256::digest(bytes).into())
    }

    /// Checksum of a file. A file that cannot be read is a fault.
    pub fn from_file(path: &Path) -> Result<Checksum, Faults> {
        let mut running = RunningChecksum::default();
        running.add_file(path, u64::MAX)?;
        Ok(running.checksum())
    }

    /// Checksum that is written in hexadecimal digits; `None` for another text.
    pub fn from_text(text: &str) -> Option<Checksum> {
        let digit = |k: usize| char::from(text.as_bytes()[k]).to_digit(16);
        (text.len() == 64).then_some(())?;
        let mut bytes = [0; 32];
        for (k, byte) in bytes.iter_mut().enumerate() {
            *byte = (16 * digit(2 * k)? + digit(2 * k + 1)?) as u8;
        }
        Some(Checksum(bytes))
    }
}

impl fmt::Display for Checksum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// Checksum of a file that grows.
#[derive(Debug, Clone, Default)]
pub struct RunningChecksum {
    hash: Sha256,
    length: u64,
}

impl RunningChecksum {
    /// Adds bytes behind those so far.
    pub fn add(&mut self, bytes: &[u8]) {
        self.hash.update(bytes);
        self.length += bytes.len() as u64;
    }

    /// Adds the first `length` bytes of a file, or all if it has fewer. A file that cannot be read is a fault.
    pub fn add_file(&mut self, path: &Path, length: u64) -> Result<(), Faults> {
        let mut file = atomic::open_to_read(path)?.take(length);
        let mut buffer = vec![0; 1 << 16];
        loop {
            match file.read(&mut buffer) {
                Ok(0) => return Ok(()),
                Ok(count) => self.add(&buffer[..count]),
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => return Err(Fault::from_io(path, "read", &error).into()),
            }
        }
    }

    /// Number of bytes so far.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Checksum of the bytes so far.
    pub fn checksum(&self) -> Checksum {
        Checksum(self.hash.clone().finalize().into())
    }
}

/// Line of a list of checksums.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ChecksumLine {
    /// Checksum of a file.
    File { path: String, checksum: Checksum },
    /// Checksum of the first `length` bytes of a file that grows; a comment for `sha256sum`.
    Start { path: String, length: u64, checksum: Checksum },
    /// Any other comment, without its `#`.
    Comment(String),
}

impl ChecksumLine {
    /// Line without its end; `None` for a text that is no such line.
    pub fn from_text(line: &str) -> Option<ChecksumLine> {
        let checksum_and_path = |text: &str| {
            let (checksum, path) = text.split_once("  ")?;
            Some((Checksum::from_text(checksum)?, path.to_string()))
        };
        let Some(comment) = line.strip_prefix('#') else {
            let (checksum, path) = checksum_and_path(line)?;
            return Some(ChecksumLine::File { path, checksum });
        };
        let start = comment.strip_prefix(" first ").and_then(|start| {
            let (length, rest) = start.split_once(" bytes: ")?;
            let (checksum, path) = checksum_and_path(rest)?;
            Some(ChecksumLine::Start { path, length: length.parse().ok()?, checksum })
        });
        Some(start.unwrap_or_else(|| ChecksumLine::Comment(comment.to_string())))
    }

    /// Line with its end.
    pub fn to_text(&self) -> String {
        match self {
            ChecksumLine::File { path, checksum } => format!("{checksum}  {path}\n"),
            ChecksumLine::Start { path, length, checksum } => format!("# first {length} bytes: {checksum}  {path}\n"),
            ChecksumLine::Comment(comment) => format!("#{comment}\n"),
        }
    }
}

/// List of checksums of files of a folder, which `program` has written.
pub fn list_text<'a>(program: &str, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> String {
    let mut text = format!("# {program}\n");
    for (name, bytes) in files {
        let _ = writeln!(text, "{}  {name}", Checksum::from_bytes(bytes));
    }
    text
}

/// Reads the list of checksums of a folder; `None` if it has none. Errors: the file cannot be read, or has another line than
/// those of [`ChecksumLine`]. A last line without an end, which a killed program may leave in a list that grows, is left out.
pub fn read_list(folder: &Path) -> Result<Option<Vec<ChecksumLine>>, Faults> {
    read_lines(folder, true)
}

/// Reads a list of checksums that was written at once like [`read_list`]; a last line without an end is an error, too.
pub fn read_whole_list(folder: &Path) -> Result<Option<Vec<ChecksumLine>>, Faults> {
    read_lines(folder, false)
}

fn read_lines(folder: &Path, grows: bool) -> Result<Option<Vec<ChecksumLine>>, Faults> {
    let path = folder.join(CHECKSUMS_FILE);
    if !path_exists(&path) {
        return Ok(None);
    }
    let text = atomic::read_text(&path)?;
    let (mut lines, mut faults) = (Vec::new(), Faults::default());
    for (number, line) in (1..).zip(text.split_inclusive('\n')) {
        let ended_line = line.strip_suffix('\n');
        if ended_line.is_none() && grows {
            break;
        }
        match ended_line.and_then(|line| ChecksumLine::from_text(line.strip_suffix('\r').unwrap_or(line))) {
            Some(line) => lines.push(line),
            None => {
                let expected = "expected a checksum, two blanks, a path and the end of the line, as of sha256sum; restore \
                                the file, or remove it: other files are then not compared";
                faults.push(Fault::new(&path, Some(number), "checksum", line.trim_end(), expected));
            }
        }
    }
    faults.into_result(Some(lines))
}

/// State of a file compared with its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileState {
    Sound,
    /// Other bytes than when the checksum was taken.
    Changed,
    Missing,
}

/// Compares a file, or its first `length` bytes, with a checksum. A file that cannot be read is a fault.
pub fn file_state(path: &Path, length: u64, checksum: Checksum) -> Result<FileState, Faults> {
    if !path_exists(path) {
        return Ok(FileState::Missing);
    }
    let mut running = RunningChecksum::default();
    running.add_file(path, length)?;
    let is_whole = length == u64::MAX || running.length() == length;
    Ok(if is_whole && running.checksum() == checksum { FileState::Sound } else { FileState::Changed })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The digests are those of FIPS 180-4's examples.
    #[test]
    fn checksums_of_known_texts() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(Checksum::from_bytes(b"abc").to_string(), abc);
        assert_eq!(Checksum::from_text(abc), Some(Checksum::from_bytes(b"abc")));
        for other in ["", "ba78", &abc.replace('b', "g"), &abc.replace('b', "é")] {
            assert_eq!(Checksum::from_text(other), None, "{other}");
        }
        let mut running = RunningChecksum::default();
        running.add(b"a");
        running.add(b"bc");
        assert_eq!((running.length(), running.checksum()), (3, Checksum::from_bytes(b"abc")));
        // A folder can be opened, but not read.
        assert!(Checksum::from_file(tempfile::tempdir().unwrap().path()).is_err());
    }

    #[test]
    fn lines_are_read_as_they_are_written() {
        let checksum = Checksum::from_bytes(b"abc");
        let path = || "a b.csv".to_string();
        for line in [
            ChecksumLine::File { path: path(), checksum },
            ChecksumLine::Start { path: path(), length: 3, checksum },
            ChecksumLine::Comment(" cd-pre 0.1.0".into()),
            ChecksumLine::Comment(" first steps".into()),
        ] {
            assert_eq!(ChecksumLine::from_text(line.to_text().trim_end()), Some(line));
        }
    }

    #[test]
    fn changed_and_missing_files_are_found() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read_list(folder.path()), Ok(None));
        let [list, a] = [CHECKSUMS_FILE, "a"].map(|name| folder.path().join(name));
        std::fs::write(&list, list_text("test", [("a", &b"abc"[..])])).unwrap();
        let lines = read_list(folder.path()).unwrap().unwrap();
        let [ChecksumLine::Comment(_), ChecksumLine::File { path, checksum }] = &lines[..] else { panic!("{lines:?}") };
        assert_eq!(path, "a");
        let state = |length: u64| file_state(&a, length, *checksum).unwrap();
        assert_eq!(state(u64::MAX), FileState::Missing);
        for (text, whole, start) in [
            ("abc", FileState::Sound, FileState::Sound),
            ("abcd", FileState::Changed, FileState::Sound),
            ("abd", FileState::Changed, FileState::Changed),
            ("ab", FileState::Changed, FileState::Changed),
        ] {
            std::fs::write(&a, text).unwrap();
            assert_eq!((state(u64::MAX), state(3)), (whole, start), "{text}");
        }
        std::fs::write(&list, "abc  a\n# x\nunfinished").unwrap();
        let refused = read_list(folder.path()).unwrap_err().to_string();
        assert!(
            refused.contains("SHA256SUMS:1: checksum: abc  a; expected") && refused.lines().count() == 1,
            "{refused}"
        );
    }
}
