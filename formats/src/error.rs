//! Faults of input files: location, value found, value expected.
//!
//! A reader collects every fault of a file before it returns, so that a user can correct them all at once.

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::names::count_text;

/// One fault: `file:line:column: object: found; expected`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    pub file: PathBuf,
    /// Line, 1-based; none when the fault belongs to the file as a whole.
    pub line: Option<usize>,
    /// Column, 1-based; given by readers that know it.
    pub column: Option<usize>,
    /// Object that has the fault, e.g. `body 17, contactor POLYR 1`.
    pub object: String,
    /// Text or value that was found.
    pub found: String,
    /// Phrase about the expected value: `expected 1 to 8`, `did you mean number?`; empty where there is nothing to say.
    pub expected: String,
}

impl Fault {
    /// Fault of `object` in line `line` of a file, without a column.
    pub fn new(
        file: &Path,
        line: Option<usize>,
        object: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Fault {
            file: file.to_path_buf(),
            line,
            column: None,
            object: object.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// Fault of a file that cannot be `participle`, as `read` or `written`; its expectation is empty.
    pub fn from_io(file: &Path, participle: &str, error: &std::io::Error) -> Self {
        let why = match error.kind() {
            ErrorKind::NotFound => "there is no such file".into(),
            ErrorKind::PermissionDenied => "permission denied".into(),
            ErrorKind::IsADirectory => "it is a folder".into(),
            ErrorKind::NotADirectory => "part of its path is not a folder".into(),
            ErrorKind::AlreadyExists => "a file is in its place".into(),
            ErrorKind::StorageFull => FULL_DISK.into(),
            // The text omits the number of the system's error.
            _ => error.to_string().split(" (os error").next().unwrap_or_default().to_string(),
        };
        Fault::new(file, None, "file", format!("cannot be {participle}: {why}"), "")
    }

    /// Whether a file could not be written because the disk is full.
    fn is_of_full_disk(&self) -> bool {
        self.line.is_none() && self.found.ends_with(FULL_DISK)
    }
}

/// Reason why a file cannot be written to a full disk.
const FULL_DISK: &str = "the disk is full";

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
            if let Some(column) = self.column {
                write!(f, ":{column}")?;
            }
        }
        write!(f, ": {}: {}", printable_line(&self.object), printable_line(&self.found))?;
        if self.expected.is_empty() { Ok(()) } else { write!(f, "; {}", printable_line(&self.expected)) }
    }
}

impl std::error::Error for Fault {}

/// Fault of one record of a file, whose reader adds file, line and object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordFault {
    /// Phrase about the value that was found, as in [`Fault::found`].
    pub found: String,
    /// Phrase about the expected value, as in [`Fault::expected`].
    pub expected: String,
    /// Part of the record that has the fault.
    pub part: RecordPart,
}

/// Part of a record whose faults its reader reports in another way than those of the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RecordPart {
    /// Any other part.
    #[default]
    Rest,
    /// Name of the material of a body, which has a line of its own.
    Material,
    /// Surface of a body that cannot be split into convex pieces: many bodies may have it, and the remedy is the same.
    UnsplitSurface,
}

impl RecordFault {
    /// Fault of a record; `expected` is a whole phrase.
    pub fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        RecordFault { found: found.into(), expected: expected.into(), part: RecordPart::Rest }
    }

    /// The fault, ascribed to a part of the record.
    pub fn in_part(self, part: RecordPart) -> Self {
        RecordFault { part, ..self }
    }
}

impl fmt::Display for RecordFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.found, self.expected)
    }
}

impl std::error::Error for RecordFault {}

/// Text of a file on one line, without control characters, shortened to a readable length.
fn printable_line(text: &str) -> String {
    const MAX_LINE_CHARS: usize = 1000;
    let mut line = String::new();
    for (k, letter) in text.chars().enumerate() {
        if k == MAX_LINE_CHARS {
            line += "...";
            break;
        }
        if letter.is_control() { line.extend(letter.escape_default()) } else { line.push(letter) }
    }
    line
}

/// All faults of one reading; at least one. Of very many the first are kept.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Faults(pub Vec<Fault>);

/// Number of faults after which no more are kept: more than anybody reads, and the memory for a file full of faults is bounded.
const MAX_KEPT_FAULTS: usize = 10_000;

impl Faults {
    /// Adds a fault, unless [`Faults::are_too_many`].
    pub fn push(&mut self, fault: Fault) {
        if !self.are_too_many() {
            self.0.push(fault);
        }
    }

    /// Whether there are more faults than are kept.
    pub fn are_too_many(&self) -> bool {
        self.0.len() > MAX_KEPT_FAULTS
    }

    /// Returns `Ok(value)` if there are no faults.
    pub fn into_result<T>(self, value: T) -> Result<T, Faults> {
        if self.0.is_empty() { Ok(value) } else { Err(self) }
    }

    /// Moves the faults of `result` into this collection; returns its value if there is one.
    pub fn gather_result<T>(&mut self, result: Result<T, Faults>) -> Option<T> {
        result.map_err(|faults| faults.0.into_iter().for_each(|fault| self.push(fault))).ok()
    }

    /// Message that a program prints: each distinct fault on its own line after the program's name. A fault repeated at
    /// more than five positions of a file is printed once, with the next lines, or lines and columns, and their number. After
    /// a hundred lines only the number of the others is printed, if it is known.
    pub fn format_report(&self, program: &str) -> String {
        let mut reported = HashSet::new();
        let mut faults: Vec<&Fault> = self.0.iter().filter(|fault| reported.insert(fault.to_string())).collect();
        // A full disk has one cause, however many files it stops.
        let unwritten_count = faults.iter().filter(|fault| fault.is_of_full_disk()).count();
        let first_unwritten = faults.iter().position(|fault| fault.is_of_full_disk());
        let mut positions = 0..;
        faults.retain(|fault| positions.next() == first_unwritten || !fault.is_of_full_disk());
        // Key of the faults that differ in numbers only, and the position of the fault. Faults of a file as a whole have no
        // line and are not grouped.
        let group_and_position = |fault: &Fault| {
            let sentence = [&fault.object, &fault.found, &fault.expected].map(|text| without_numbers(text));
            fault.line.map(|line| ((fault.file.clone(), sentence), (line, fault.column)))
        };
        let mut positions: HashMap<_, Vec<_>> = HashMap::new();
        let mut known = HashSet::new();
        for (group, position) in faults.iter().filter_map(|fault| group_and_position(fault)) {
            if known.insert((group.clone(), position)) {
                positions.entry(group).or_default().push(position);
            }
        }
        let mut printed_groups = HashSet::new();
        let (mut text, mut line_count) = (String::new(), 0);
        for fault in faults {
            let group = group_and_position(fault).map(|(group, _)| group);
            let positions = group.as_ref().map_or(&[][..], |group| &positions[group][..]);
            let mut others = String::new();
            if positions.len() > MAX_ALIKE_FAULTS {
                if !printed_groups.insert(group) {
                    continue;
                }
                others = format!("; the same {}", further_positions(positions));
            }
            if fault.is_of_full_disk() && unwritten_count > 1 {
                others = format!("; the same holds for {}", count_text(unwritten_count - 1, "further file"));
            }
            line_count += 1;
            if line_count <= MAX_REPORTED_LINES {
                text += &format!("{program}: {fault}{others}\n");
            }
        }
        if self.are_too_many() {
            text += &format!("{program}: more than {MAX_KEPT_FAULTS} faults; correct those above first\n");
        } else if line_count > MAX_REPORTED_LINES {
            let further = line_count - MAX_REPORTED_LINES;
            text += &format!("{program}: {further} more; correct those above first\n");
        }
        text
    }
}

/// Positions after the first in words: `in 49 more lines: 10, 15, 20, ...`, or with columns if lines have several.
fn further_positions(positions: &[(usize, Option<usize>)]) -> String {
    let lines: HashSet<usize> = positions.iter().map(|(line, _)| *line).collect();
    let are_on_own_lines = lines.len() == positions.len();
    let text = |(line, column): &(usize, Option<usize>)| match column {
        Some(column) if !are_on_own_lines => format!("{line}:{column}"),
        _ => line.to_string(),
    };
    let next: Vec<String> = positions[1..=MAX_LISTED_LINES].iter().map(text).collect();
    let (preposition, noun) = if are_on_own_lines { ("in", "lines") } else { ("at", "positions") };
    format!("{preposition} {} more {noun}: {}, ...", positions.len() - 1, next.join(", "))
}

/// Largest number of lines of a report.
pub const MAX_REPORTED_LINES: usize = 100;

/// Largest number of faults of one kind that are printed line by line.
const MAX_ALIKE_FAULTS: usize = 5;

/// Largest number of lines listed for a repeated fault.
const MAX_LISTED_LINES: usize = 3;

/// Sentence with each number, with its sign, replaced by `#`.
fn without_numbers(text: &str) -> String {
    let mut sentence = String::new();
    let mut was_in_number = false;
    for letter in text.chars() {
        let is_in_number =
            letter.is_ascii_digit() || was_in_number && (letter == '.' || letter == 'e' || letter == 'E');
        if is_in_number && !was_in_number && (sentence.ends_with(" -") || sentence.ends_with("(-")) {
            sentence.pop();
        }
        if is_in_number && !was_in_number {
            sentence.push('#');
        } else if !is_in_number {
            sentence.push(letter);
        }
        was_in_number = is_in_number;
    }
    sentence
}

impl From<Fault> for Faults {
    fn from(fault: Fault) -> Self {
        Faults(vec![fault])
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, fault) in self.0.iter().enumerate() {
            if k > 0 {
                writeln!(f)?;
            }
            write!(f, "{fault}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_fault_of_many_lines_is_printed_once_with_their_number() {
        let fault = |line: usize, found: &str| {
            let object = format!("body {}, contactor SPHER 1", line / 5);
            Fault::new(Path::new("BODIES.DAT"), Some(line), object, found, "expected more than 0")
        };
        let many =
            |count: usize| (1..=count).map(|k| fault(5 * k, &format!("radius is -{k}.5e-1"))).collect::<Vec<_>>();
        let first = "cd-solve: BODIES.DAT:5: body 1, contactor SPHER 1: radius is -1.5e-1; expected more than 0";
        let mut faults = Faults(many(50));
        faults.0.insert(20, fault(7, "no radius"));
        let other = "cd-solve: BODIES.DAT:7: body 1, contactor SPHER 1: no radius; expected more than 0\n";
        assert_eq!(
            faults.format_report("cd-solve"),
            format!("{first}; the same in 49 more lines: 10, 15, 20, ...\n{other}")
        );
        // A few are printed one by one, and so are those of a file as a whole.
        assert_eq!(Faults(many(MAX_ALIKE_FAULTS)).format_report("cd-solve").lines().count(), MAX_ALIKE_FAULTS);
        assert_eq!(Faults(many(MAX_ALIKE_FAULTS)).format_report("cd-solve").lines().next(), Some(first));
        // Those of one line are at different columns.
        let column = |(k, fault)| Fault { line: Some(1), column: Some(k), ..fault };
        let one_line: Vec<Fault> = (1..).zip(many(6)).map(column).collect();
        let first = "cd-solve: BODIES.DAT:1:1: body 1, contactor SPHER 1: radius is -1.5e-1; expected more than 0";
        let more = "the same at 5 more positions: 1:2, 1:3, 1:4, ...";
        assert_eq!(Faults(one_line).format_report("cd-solve"), format!("{first}; {more}\n"));
        let whole = many(9).into_iter().map(|fault| Fault { line: None, ..fault }).collect();
        assert_eq!(Faults(whole).format_report("cd-solve").lines().count(), 9);
    }

    #[test]
    fn a_file_that_cannot_be_read_says_why() {
        let error = std::fs::read("no/such/file").unwrap_err();
        assert_eq!(
            Fault::from_io(Path::new("a.obj"), "read", &error).to_string(),
            "a.obj: file: cannot be read: there is no such file"
        );
        let other = std::io::Error::from_raw_os_error(5); // EIO
        let said = Fault::from_io(Path::new("a.obj"), "read", &other).to_string();
        assert!(said.starts_with("a.obj: file: cannot be read: ") && !said.contains("os error"), "{said}");
    }

    #[test]
    fn a_full_disk_is_reported_once() {
        let full = |name: &str| Fault::from_io(Path::new(name), "written", &ErrorKind::StorageFull.into());
        let other = Fault::from_io(Path::new("b"), "written", &ErrorKind::PermissionDenied.into());
        let report = Faults(vec![full("a"), other.clone(), full("c"), full("d")]).format_report("cd-post");
        let expected = "cd-post: a: file: cannot be written: the disk is full; the same holds for 2 further files\n\
                        cd-post: b: file: cannot be written: permission denied\n";
        assert_eq!(report, expected);
        let report = Faults(vec![other, full("a")]).format_report("cd-post");
        assert!(report.ends_with("a: file: cannot be written: the disk is full\n"), "{report}");
    }

    #[test]
    fn the_length_of_a_report_is_bounded() {
        let object = |k: usize| ["a", "b", "c"].map(|letter| letter.repeat(k)).concat();
        let faults = |count| (1..=count).map(|k| Fault::new(Path::new("f"), Some(k), object(k), "", "")).collect();
        let report = Faults(faults(MAX_REPORTED_LINES + 7)).format_report("cd-pre");
        assert_eq!(report.lines().count(), MAX_REPORTED_LINES + 1);
        assert_eq!(report.lines().last(), Some("cd-pre: 7 more; correct those above first"));
        assert_eq!(Faults(faults(MAX_REPORTED_LINES)).format_report("cd-pre").lines().count(), MAX_REPORTED_LINES);
    }

    #[test]
    fn the_number_of_kept_faults_is_bounded() {
        let mut faults = Faults::default();
        let fault = |line: usize| Fault::new(Path::new("f"), Some(line), "row", "x", "expected 3 numbers");
        (1..=MAX_KEPT_FAULTS).for_each(|line| faults.push(fault(line)));
        let first = "cd-post: f:1: row: x; expected 3 numbers; the same in 9999 more lines: 2, 3, 4, ...\n";
        assert_eq!(faults.format_report("cd-post"), first);
        let all: Result<(), Faults> = Err(Faults((1..=2 * MAX_KEPT_FAULTS).map(fault).collect()));
        faults.gather_result(all);
        assert_eq!(faults.0.len(), MAX_KEPT_FAULTS + 1);
        let report = faults.format_report("cd-post");
        assert_eq!(report.lines().last(), Some("cd-post: more than 10000 faults; correct those above first"));
    }

    #[test]
    fn a_fault_is_reported_once() {
        let fault = |found: &str| Fault::new(Path::new("z.dat"), Some(2), "point 2", found, "later than point 1");
        let faults = Faults(vec![fault("time 0"), fault("time 1"), fault("time 0")]);
        let expected = "cd-solve: z.dat:2: point 2: time 0; later than point 1\ncd-solve: z.dat:2: point 2: time 1; later than point 1\n";
        assert_eq!(faults.format_report("cd-solve"), expected);
    }
}
