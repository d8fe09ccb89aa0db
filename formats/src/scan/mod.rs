//! Lines, fixed columns and numbers of LMGC90's text files, with file and line for errors.
//!
//! Columns are 1-based and inclusive, as in `docs/reference/files/`. A reader requests a field from [`LineScanner`] by
//! its first column and continues in any case. A faulty field is reported, and its value fails no later comparison (NaN,
//! `None`, an empty name), so that one mistake gives one message. The parameter `field_name` of these functions is the name
//! of the field in messages.
//!
//! Most lines of all files share a grid:
//!
//! | columns | content |
//! |---|---|
//! | 2-6 | keyword behind `$`, or type of the object of the line |
//! | 9-13, in state files 9-15 | number of the object |
//! | 35-48, 56-69, 77-90 | reals, each behind a label of five columns that nobody reads |
//!
//! Only the internal variables of a contact lie beyond column 103, so LMGC90's limit of 180 columns a line is never
//! reached.

mod columns;
mod forms;
mod lenient;
mod numbers;
pub mod parts;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt::{Display, Write};
use std::path::Path;

use crate::atomic;
use crate::error::{Fault, Faults};
use crate::names::{known_names, number_text};
pub use columns::{DASHED_LINE, GRID_COLUMNS, put_grid, put_steps, put_text};
pub use forms::{AcceptedDeviation, AcceptedDeviations};
pub use numbers::{
    NumberError, RealText, format_d14, format_e14, format_integer, format_long14, fortran_real, free_real,
    wide_fortran_real,
};
use numbers::{REAL_WIDTH, number_fault};

/// Largest error of an axis or frame in the files against an orthonormal one; they have seven digits.
pub const FRAME_TOLERANCE: f64 = 1e-4;

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Text of a file as ASCII, so that bytes are columns. Any other byte becomes a control character, which is allowed in
/// comments only.
pub struct AsciiText<'a>(Cow<'a, str>);

impl AsciiText<'static> {
    /// Reads the text of a file. A file that cannot be read, or is not text with one byte a letter, is a fault.
    pub fn read_file(path: &Path) -> Result<Self, Faults> {
        let bytes = atomic::read_bytes(path)?;
        if bytes.contains(&0) {
            let found = "no text, or with two bytes a letter (UTF-16)";
            return Err(Fault::new(path, None, "file", found, "expected text in ASCII or UTF-8").into());
        }
        Ok(match String::from_utf8(bytes) {
            Ok(text) if text.is_ascii() => AsciiText(text.into()),
            Ok(text) => AsciiText::new(text.as_bytes()).into_owned(),
            Err(error) => AsciiText::new(error.as_bytes()).into_owned(),
        })
    }
}

impl<'a> AsciiText<'a> {
    /// Text of a file with these bytes, without a byte order mark.
    pub fn new(bytes: &'a [u8]) -> Self {
        let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
        if let Some(text) = std::str::from_utf8(bytes).ok().filter(|text| text.is_ascii()) {
            return AsciiText(text.into());
        }
        let ascii = |&byte: &u8| if byte.is_ascii() { byte } else { b'\x1a' };
        AsciiText(String::from_utf8(bytes.iter().map(ascii).collect()).expect("all bytes are ASCII").into())
    }

    fn into_owned(self) -> AsciiText<'static> {
        AsciiText(self.0.into_owned().into())
    }

    /// The whole text as one part.
    fn whole_text(&self) -> TextPart<'_> {
        TextPart { text: &self.0, lines_before: 0, records_before: 0 }
    }

    /// All lines with their numbers.
    pub fn lines(&self) -> impl Iterator<Item = TextLine<'_>> {
        self.whole_text().lines()
    }
}

/// Consecutive whole records of a text; the first part has the head of the file, too.
#[derive(Debug, Clone, Copy)]
struct TextPart<'a> {
    text: &'a str,
    /// Number of lines before it.
    lines_before: usize,
    /// Number of records before it.
    records_before: usize,
}

impl<'a> TextPart<'a> {
    /// All lines with their numbers in the file.
    fn lines(self) -> impl Iterator<Item = TextLine<'a>> {
        let has_comments = self.text.contains('!');
        let line = move |(k, text): (usize, &'a str)| {
            let width = if has_comments { without_comment(text).len() } else { text.len() };
            TextLine { number: self.lines_before + k + 1, text, width_before_comment: width }
        };
        self.text.lines().enumerate().map(line)
    }
}

/// One line of an [`AsciiText`].
#[derive(Debug, Clone, Copy)]
pub struct TextLine<'a> {
    /// Number, 1-based.
    pub number: usize,
    text: &'a str,
    width_before_comment: usize,
}

impl<'a> TextLine<'a> {
    /// Text in columns `first` to `last`; shorter where the line is.
    pub fn columns(self, first: usize, last: usize) -> &'a str {
        let end = last.min(self.text.len());
        self.text.get(first - 1..end).unwrap_or("")
    }

    /// Label of the first real of a grid line, in columns 30 to 34.
    pub fn first_label(self) -> &'a str {
        self.columns(30, 34)
    }

    /// Columns 2 to 6, by which LMGC90 recognizes a line.
    pub fn keyword(self) -> &'a str {
        self.columns(2, 6)
    }

    /// Whether it is not a keyword line.
    pub fn is_data(self) -> bool {
        !self.text.starts_with('$')
    }

    /// Whether columns 2 to 6 are blank: the line continues an earlier one.
    pub fn is_continuation(self) -> bool {
        self.keyword().trim().is_empty()
    }

    /// Number of columns up to the last that is not blank, without a comment at the end.
    pub fn used_width(self) -> usize {
        self.before_comment().trim_end().len()
    }

    /// Text up to a comment, a `!` after a blank.
    pub fn before_comment(self) -> &'a str {
        &self.text[..self.width_before_comment]
    }

    /// The whole line.
    pub fn text(self) -> &'a str {
        self.text
    }

    /// Whether neither of two columns is blank: one word extends across them.
    fn is_joined_across(self, left: usize, right: usize) -> bool {
        // Column 1 belongs to the keyword's sign.
        left > 1
            && !self.columns(left, left).trim().is_empty()
            && !["", "!"].contains(&self.columns(right, right).trim())
    }

    /// Returns `value`, unless the number in the columns begins before them or extends beyond them, of which LMGC90 would
    /// read a part, or is in a comment, which LMGC90 would read.
    fn expect_isolated<T>(self, (first, last): (usize, usize), value: T) -> Result<T, NumberError> {
        let before = self.columns(first - 1, first - 1);
        let digits_across = before.starts_with(|c: char| c.is_ascii_digit())
            && self.columns(first, first).starts_with(|c: char| c.is_ascii_digit() || c == '.');
        // Without a 0 before its point the number is the same.
        let is_leading_zero = before == "0" && self.columns(first, first) == "." && self.begins_in(first - 1);
        if (digits_across && !is_leading_zero) || ["-", "+", "."].contains(&before) {
            return Err(NumberError("which begins before its columns"));
        }
        let is_comment = self.before_comment().len() <= last;
        if !is_comment && !["", "!"].contains(&self.columns(last + 1, last + 1).trim()) {
            return Err(NumberError("which continues beyond its columns"));
        }
        if self.before_comment().len() + 2 < first && self.before_comment().len() < self.text.len() {
            return Err(NumberError("which is behind a '!', in a comment that LMGC90 would read"));
        }
        Ok(value)
    }

    /// Whether a word or value begins in a column: a blank or the label's `=` is before it.
    fn begins_in(self, column: usize) -> bool {
        column > 1 && ["", "="].contains(&self.columns(column - 1, column - 1).trim())
    }

    /// First byte that is not a blank; `None` of a blank line.
    fn first_letter(self) -> Option<u8> {
        self.text.bytes().find(|byte| !matches!(byte, b' ' | b'\t'..=b'\r'))
    }

    /// Whether it is a comment, in any column.
    fn is_comment(self) -> bool {
        matches!(self.first_letter(), Some(b'!' | b'#'))
    }
}

/// Reads a file line by line, without comments and blank lines, and collects its faults.
pub struct LineScanner<'a> {
    path: &'a Path,
    lines: Vec<TextLine<'a>>,
    /// Index of the next line.
    next: usize,
    /// Number of the line for faults at the end of the file.
    last: usize,
    /// Object of the next faults.
    object: String,
    faults: Faults,
    /// Forms that are read although they deviate.
    forms: AcceptedDeviations,
    /// Numbers of the lines with a comment that does not begin in column 1.
    indented_comments: BTreeSet<usize>,
}

impl<'a> LineScanner<'a> {
    /// Scanner at the first line of `text`; `path` is for messages.
    pub fn new(path: &'a Path, text: &'a AsciiText<'_>) -> Self {
        LineScanner::from_part(path, text.whole_text())
    }

    /// Scanner at the first line of a part of a text.
    fn from_part(path: &'a Path, part: TextPart<'a>) -> Self {
        let (comments, lines): (Vec<TextLine>, Vec<_>) =
            part.lines().filter(|line| line.first_letter().is_some()).partition(|line| line.is_comment());
        let indented = comments.iter().filter(|line| !line.text.starts_with(['!', '#'])).map(|line| line.number);
        let indented_comments: BTreeSet<usize> = indented.collect();
        let mut forms = AcceptedDeviations::default();
        indented_comments.iter().for_each(|&line| forms.add(AcceptedDeviation::IndentedComment, line));
        let commented = lines.iter().filter(|line| line.width_before_comment < line.text.len());
        commented.for_each(|line| forms.add(AcceptedDeviation::TrailingComment, line.number));
        let last = lines.last().map_or(1, |line| line.number);
        let (object, faults) = ("file".into(), Faults::default());
        LineScanner { path, lines, next: 0, last, object, faults, forms, indented_comments }
    }

    /// Returns the value that was read, or all faults.
    pub fn finish<T>(&mut self, value: T) -> Result<T, Faults> {
        std::mem::take(&mut self.faults).into_result(value)
    }

    /// Returns the value that was read and the notices about the form of the file, or all faults.
    pub fn finish_with_notices<T>(&mut self, value: T) -> Result<(T, Vec<String>), Faults> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let notices = self.forms.notices(&name);
        self.finish((value, notices))
    }

    /// Whether a fault has been found.
    pub fn has_faults(&self) -> bool {
        !self.faults.0.is_empty()
    }

    /// Counts a form that is read although it deviates.
    pub fn add_form(&mut self, form: AcceptedDeviation, line: usize) {
        self.forms.add(form, line);
    }

    /// Returns the value read from another file that this one names; `None` if it has faults, which are added.
    pub fn gather_result<T>(&mut self, result: Result<T, Faults>) -> Option<T> {
        self.faults.gather_result(result)
    }

    /// Names the object of the next faults.
    pub fn set_object(&mut self, object: impl Display) {
        self.object.clear();
        let _ = write!(self.object, "{object}"); // a String takes all
    }

    /// Adds a fault of the present object.
    pub fn add_fault(&mut self, line: usize, found: impl Into<String>, expected: impl Into<String>) {
        self.faults.push(Fault::new(self.path, Some(line), self.object.as_str(), found, expected));
    }

    /// Adds a fault of a name that is not in `candidates`, with the nearest of them.
    pub fn add_unknown_name(&mut self, line: usize, found: impl Into<String>, name: &str, candidates: &[&str]) {
        if !self.faults.are_too_many() {
            self.add_fault(line, found, known_names(name, candidates));
        }
    }

    /// Adds a fault of the file as a whole.
    pub fn add_file_fault(&mut self, found: impl Into<String>, expected: impl Into<String>) {
        self.faults.push(Fault::new(self.path, None, "file", found, expected));
    }

    /// Returns the next line without consuming it.
    pub fn peek_line(&self) -> Option<TextLine<'a>> {
        self.lines.get(self.next).copied()
    }

    /// Returns the line that was consumed last.
    fn last_line(&self) -> Option<TextLine<'a>> {
        self.lines[..self.next].last().copied()
    }

    /// Consumes and returns the next line.
    pub fn next_line(&mut self) -> Option<TextLine<'a>> {
        let line = self.peek_line();
        self.next += usize::from(line.is_some());
        line
    }

    /// Consumes and returns the next line if it fits.
    pub fn next_line_if(&mut self, fits: impl Fn(TextLine<'a>) -> bool) -> Option<TextLine<'a>> {
        if self.peek_line().is_some_and(fits) { self.next_line() } else { None }
    }

    /// Consumes and returns the next line if it fits; otherwise adds a fault, and the line stays.
    pub fn expect_line(&mut self, expected: &str, fits: impl Fn(TextLine<'a>) -> bool) -> Option<TextLine<'a>> {
        self.next_line_if(fits).or_else(|| self.unexpected_line(expected))
    }

    /// Consumes the next line, which must be a keyword line such as `$nodty`.
    pub fn expect_keyword(&mut self, keyword: &str) -> Option<TextLine<'a>> {
        let line = self.next_line_if(|line| line.keyword() == keyword);
        line.or_else(|| self.unexpected_line(&format!("expected ${keyword}")))
    }

    /// Consumes the next line, which must continue the present object, with blank columns 2 to 6.
    pub fn expect_continuation(&mut self, content: &str) -> Option<TextLine<'a>> {
        let line = self.next_line_if(TextLine::is_continuation);
        line.or_else(|| self.unexpected_line(&format!("expected a line with {content}")))
    }

    /// Reports that the next line, or the end of the file, is not expected here. Returns `None`, for use at the end of a
    /// search.
    pub fn unexpected_line(&mut self, expected: &str) -> Option<TextLine<'a>> {
        match self.peek_line() {
            Some(line) => {
                let text: String = line.text.trim_end().chars().take(40).collect();
                self.add_fault(line.number, format!("the line is '{}'", display_text(&text)), expected);
            }
            None => self.add_fault(self.last, "the file ends", expected),
        }
        None
    }

    /// Leaves the present record: moves past its `$$$$$$`, or to the `$bdyty` that begins another.
    pub fn skip_record(&mut self) {
        while let Some(line) = self.next_line_if(|line| line.keyword() != "bdyty") {
            if line.keyword() == "$$$$$" {
                break;
            }
        }
    }

    /// Reads the real in the 14 columns from `first`; NaN and a fault if there is none.
    pub fn read_real(&mut self, line: TextLine, first: usize, field_name: impl Display) -> f64 {
        self.read_real_by(fortran_real, line, first, field_name)
    }

    /// Reads a real like [`LineScanner::read_real`] with the function `parse`.
    fn read_real_by(
        &mut self,
        parse: fn(&str) -> Result<f64, NumberError>,
        line: TextLine,
        first: usize,
        field_name: impl Display,
    ) -> f64 {
        let columns = (first, first + REAL_WIDTH - 1);
        match parse(line.columns(columns.0, columns.1)).and_then(|value| line.expect_isolated(columns, value)) {
            Ok(value) => value,
            Err(NumberError(fault)) => {
                self.report_no_number(line, columns, field_name, fault, "expected a real such as 1.0000000E+00");
                f64::NAN
            }
        }
    }

    /// Reads the three reals of a grid line.
    pub fn read_grid(&mut self, line: TextLine, names: [&str; 3]) -> [f64; 3] {
        let mut values = [f64::NAN; 3];
        for (k, first) in GRID_COLUMNS.into_iter().enumerate() {
            values[k] = self.read_real(line, first, names[k]);
            if line.is_joined_across(first + REAL_WIDTH - 1, first + REAL_WIDTH) {
                break; // too wide a number shifts all behind it
            }
        }
        values
    }

    /// Reads a real that must not be negative.
    pub fn read_length(&mut self, line: TextLine, first: usize, field_name: &str) -> f64 {
        let value = self.read_real(line, first, field_name);
        self.expect_not_negative(line, field_name, value)
    }

    /// Reads a moment of inertia, a product of lengths, which must not be negative.
    pub fn read_moment(&mut self, line: TextLine, first: usize, field_name: &str) -> f64 {
        let value = self.read_real_by(wide_fortran_real, line, first, field_name);
        self.expect_not_negative(line, field_name, value)
    }

    /// Reports a value of a line that is negative; returns the value.
    fn expect_not_negative(&mut self, line: TextLine, field_name: &str, value: f64) -> f64 {
        if value < 0.0 {
            self.add_fault(line.number, format!("{field_name} is {}", number_text(value)), "expected 0 or more");
        }
        value
    }

    /// Reads a real that must be positive.
    pub fn read_positive(&mut self, line: TextLine, first: usize, field_name: &str) -> f64 {
        let value = self.read_real(line, first, field_name);
        if value <= 0.0 {
            self.add_fault(line.number, format!("{field_name} is {}", number_text(value)), "expected more than 0");
        }
        value
    }

    /// Reads the integer in columns `first` to `last`, blanks ignored; `None` and a fault if there is none.
    pub fn read_integer(&mut self, line: TextLine, columns: (usize, usize), field_name: impl Display) -> Option<u64> {
        let digits = line.columns(columns.0, columns.1.min(line.before_comment().len())).replace(' ', "");
        let fault = |_| number_fault(&digits).unwrap_or(NumberError("not an integer of 0 or more"));
        let number = digits.parse().map_err(fault);
        match number.and_then(|value| line.expect_isolated(columns, value)) {
            Ok(value) => Some(value),
            Err(NumberError(fault)) => {
                self.report_no_number(line, columns, field_name, fault, "expected an integer such as 12");
                None
            }
        }
    }

    /// Reports that columns contain no number: `avrd is '100', without ...`.
    fn report_no_number(
        &mut self,
        line: TextLine,
        (first, last): (usize, usize),
        field_name: impl Display,
        fault: &str,
        expected: &str,
    ) {
        let found = match line.columns(first, last).trim_matches(' ') {
            "" => format!("{field_name} is blank"),
            field => format!("{field_name} is '{}', {fault}", display_text(field)),
        };
        self.add_fault(line.number, found, expected);
    }

    /// Reads a number that counts from 1 in the file; returns it counted from 0.
    pub fn read_index(&mut self, line: TextLine, columns: (usize, usize), field_name: &str) -> Option<usize> {
        let number = self.read_integer(line, columns, field_name)?;
        if number == 0 {
            self.add_fault(line.number, format!("{field_name} is 0"), "expected 1 or more");
            return None;
        }
        usize::try_from(number - 1).ok()
    }

    /// Reads the name in columns `first` to `last`, trimmed; empty and a fault if there is none.
    pub fn read_name(&mut self, line: TextLine, (first, last): (usize, usize), field_name: &str) -> String {
        let field = line.columns(first, last);
        let field = without_comment(field);
        let shown = display_text(field.trim_matches(' '));
        let (found, expected) = if field.trim_matches(' ').is_empty() {
            (format!("{field_name} is blank"), format!("expected a name in columns {first} to {last}"))
        } else if field.bytes().any(|byte| !(b' '..=b'~').contains(&byte)) {
            (format!("{field_name} is '{shown}'"), "expected a name of printable ASCII characters".into())
        } else if line.is_joined_across(first - 1, first) || line.is_joined_across(last, last + 1) {
            let found = format!("{field_name} is '{shown}', part of a longer word");
            (found, format!("expected a name in columns {first} to {last} and blanks around it"))
        } else {
            return field.trim_matches(' ').to_string();
        };
        self.add_fault(line.number, found, expected);
        String::new()
    }

    /// Reads the five-column name from `first`.
    pub fn read_name5(&mut self, line: TextLine, first: usize, field_name: &str) -> String {
        self.read_name(line, (first, first + 4), field_name)
    }

    /// Returns whether `RBDY3`, the only supported kind of body, is in columns `first` to `first + 4`; if not, adds a fault.
    pub fn expect_rigid_body(&mut self, line: TextLine, first: usize) -> bool {
        let word = line.columns(first, first + 4);
        if word != "RBDY3" {
            let found = format!("a body of type '{}'", word.trim());
            self.add_fault(line.number, found, "expected RBDY3, a rigid body in 3D: no other can be read");
        }
        word == "RBDY3"
    }

    /// Adds a fault if the rows, which it calls `rows_name`, are not an orthonormal, right-handed triad.
    pub fn check_orthonormal(&mut self, line: usize, rows_name: &str, rows: &[[f64; 3]; 3]) {
        let defect = frame_defect(rows);
        if defect > FRAME_TOLERANCE {
            let found = format!("{rows_name} are off by {defect:.1e} from an orthonormal right-handed triad");
            self.add_fault(line, found, format!("expected at most {FRAME_TOLERANCE:e}"));
        }
    }
}

/// Text for messages, without control characters.
fn display_text(text: &str) -> String {
    text.replace('\x1a', "?").escape_default().to_string()
}

/// Largest error of three rows against an orthonormal, right-handed triad: in lengths, angles and `c - a x b`.
pub fn frame_defect([a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let dot = |x: &[f64; 3], y: &[f64; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let errors = [dot(a, a) - 1.0, dot(b, b) - 1.0, dot(a, b), c[0] - cross[0], c[1] - cross[1], c[2] - cross[2]];
    errors.iter().fold(0.0, |largest: f64, error| largest.max(error.abs()))
}

/// Text up to a `!` after a blank. A search for the single byte is some ten times as fast as one for both.
fn without_comment(text: &str) -> &str {
    let starts = text.match_indices('!').map(|(at, _)| at);
    let after_blank = starts.filter(|&at| at > 0 && text.as_bytes()[at - 1] == b' ').map(|at| at - 1).next();
    after_blank.map_or(text, |at| &text[..at])
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn marks_of_editors_are_no_text_and_tabs_are_named() {
        let text = AsciiText::new(b"\xef\xbb\xbf$bdyty\n RBDY3\t1\n");
        let mut scan = LineScanner::new(Path::new("a"), &text);
        assert!(scan.expect_keyword("bdyty").is_some());
        let line = scan.next_line().unwrap();
        assert_eq!(scan.read_integer(line, (7, 15), "number"), None);
        let refused = scan.finish(()).unwrap_err().to_string();
        assert!(refused.contains("number is '\\t1', with a tab, which is one column wide"), "{refused}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, b"$\0b\0").unwrap();
        assert!(AsciiText::read_file(&path).is_err());
    }

    #[test]
    fn frames() {
        assert_eq!(frame_defect(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 0.0);
        assert_eq!(frame_defect(&[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 0.0);
        assert_eq!(frame_defect(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]), 2.0);
        assert_eq!(frame_defect(&[[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]), 3.0);
    }

    #[test]
    fn a_number_across_the_edge_of_its_columns_is_rejected() {
        let path = Path::new("f");
        let text = AsciiText::new(b"x-1.0000000E+00 -1.0000000E-100  12");
        let scan = &mut LineScanner::new(path, &text);
        let line = scan.next_line().unwrap();
        assert_eq!(scan.read_real(line, 2, "a"), -1.0);
        assert!(scan.read_real(line, 3, "b").is_nan());
        assert!(scan.read_real(line, 17, "c").is_nan());
        assert_eq!(scan.read_integer(line, (34, 34), "d"), None);
        assert_eq!(scan.read_integer(line, (34, 35), "e"), Some(12));
        let faults = scan.finish(()).unwrap_err().to_string();
        assert_eq!(
            faults,
            "f:1: file: b is '1.0000000E+00', which begins before its columns; expected a real such as 1.0000000E+00\n\
             f:1: file: c is '-1.0000000E-10', which continues beyond its columns; expected a real such as 1.0000000E+00\n\
             f:1: file: d is '1', which continues beyond its columns; expected an integer such as 12"
        );
    }

    #[test]
    fn a_number_whose_first_digits_are_before_its_columns_is_rejected() {
        let path = Path::new("f");
        // Only a single 0 before the point, behind a blank or a label, changes nothing.
        for (line, first, expected) in [
            ("  0.5000000E+00", 4, Some(0.5)),
            ("= 0.5000000E+00", 4, Some(0.5)),
            (" =0.5000000E+00", 4, Some(0.5)),
            ("  1.5000000E+00", 4, None),
            (" 10.5000000E+00", 4, None),
            (" 15.0000000E+00", 3, None),
            ("0.5000000E+00", 2, None),
        ] {
            let text = AsciiText::new(line.as_bytes());
            let scan = &mut LineScanner::new(path, &text);
            let read = scan.next_line().map(|line| scan.read_real(line, first, "a"));
            assert_eq!(read.filter(|value| !value.is_nan()), expected, "{line}");
            assert_eq!(scan.has_faults(), expected.is_none(), "{line}");
        }
    }

    /// LMGC90 reads columns, also of a comment.
    #[test]
    fn a_number_in_a_comment_is_rejected() {
        let path = Path::new("f");
        for (line, first, expected) in
            [(" 1.0000000E+00 ! 2", 2, Some(1.0)), (" a ! 1.0000000E+00", 5, None), (" abc ! 1.0000000E+00", 7, None)]
        {
            let text = AsciiText::new(line.as_bytes());
            let scan = &mut LineScanner::new(path, &text);
            let read = scan.next_line().map(|line| scan.read_real(line, first, "a"));
            assert_eq!(read.filter(|value| !value.is_nan()), expected, "{line}");
            let faults = scan.finish(()).err().map_or(String::new(), |faults| faults.to_string());
            assert_eq!(faults.contains("in a comment that LMGC90 would read"), expected.is_none(), "{faults}");
        }
        let text = AsciiText::new(b" RBDY3  7 ! x");
        let scan = &mut LineScanner::new(path, &text);
        let line = scan.next_line().unwrap();
        assert_eq!(scan.read_integer(line, (9, 13), "number"), Some(7));
    }

    #[test]
    fn the_sign_of_a_keyword_is_no_part_of_the_word() {
        let text = AsciiText::new(b"$nodty");
        let scan = &mut LineScanner::new(Path::new("f"), &text);
        let line = scan.next_line().unwrap();
        assert_eq!(scan.read_name5(line, 2, "keyword"), "nodty");
    }

    #[test]
    fn files_have_no_letters_but_ascii() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for bytes in [&b"1 \xc2\xb5m"[..], b"1 \xb5m", b"1 m"] {
            fs::write(file.path(), bytes).unwrap();
            let read = AsciiText::read_file(file.path()).unwrap();
            assert!(read.0.is_ascii() && read.0.len() == bytes.len(), "{bytes:?}");
        }
    }
}
