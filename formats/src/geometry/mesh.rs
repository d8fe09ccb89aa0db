//! Common parts of the readers of surfaces: polygons over points, to which each kind of file is read, the faults of files, and
//! numbers of text files.

use std::borrow::Cow;

use crate::names::count_text;

/// Polygons over points, the common form of all kinds of files.
#[derive(Debug, Default, PartialEq)]
pub struct PolygonMesh {
    pub points: Vec<[f64; 3]>,
    pub polygons: Vec<Vec<usize>>,
    /// Notes on repairs, each a phrase such as `dropped 1 degenerate triangle`.
    pub notes: Vec<String>,
}

/// Reason why a file is rejected.
#[derive(Debug, PartialEq)]
pub struct ReadError {
    pub line: Option<usize>,
    pub found: String,
    pub expected: Cow<'static, str>,
}

/// Number of errors after which a file is not read on: more than anybody reads.
pub const MAX_READ_ERRORS: usize = 10_000;

impl ReadError {
    /// Error in a line, 1-based, or in the file as a whole.
    pub fn new(
        line: impl Into<Option<usize>>,
        found: impl Into<String>,
        expected: impl Into<Cow<'static, str>>,
    ) -> Self {
        ReadError { line: line.into(), found: found.into(), expected: expected.into() }
    }
}

impl std::fmt::Display for ReadError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        write!(f, "{}; expected {}", self.found, self.expected)
    }
}

impl std::error::Error for ReadError {}

impl From<ReadError> for Vec<ReadError> {
    fn from(error: ReadError) -> Self {
        vec![error]
    }
}

impl PolygonMesh {
    /// Adds the note that `count` things named `noun` were ignored, unless the count is 0. `position`: end of the note, as
    /// ` after the last triangle`, or empty.
    pub fn note_ignored(&mut self, count: usize, noun: &str, position: &str) {
        if count > 0 {
            self.notes.push(format!("ignored {}{position}", count_text(count, noun)));
        }
    }
}

/// A text with line feeds at the ends of its lines, as old programs write carriage returns alone.
pub fn lines(text: &str) -> Cow<'_, str> {
    if text.contains('\n') { Cow::Borrowed(text) } else { Cow::Owned(text.replace('\r', "\n")) }
}

/// Reads a real number of a text file; Fortran's `1.0D+00` too.
pub fn parse_real(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| word.replace(['d', 'D'], "e").parse().ok())
}

/// Word that is not a coordinate.
#[derive(Debug, PartialEq)]
pub enum CoordinateError {
    NotANumber(String),
    NotFinite(String),
}

impl std::fmt::Display for CoordinateError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CoordinateError::NotANumber(word) => write!(f, "'{word}', which is not a number"),
            CoordinateError::NotFinite(word) => write!(f, "'{word}', which is not finite"),
        }
    }
}

impl std::error::Error for CoordinateError {}

/// Reads a coordinate. Errors: words that are not finite numbers.
pub fn coordinate(word: &str) -> Result<f64, CoordinateError> {
    match parse_real(word) {
        None => Err(CoordinateError::NotANumber(word.to_string())),
        Some(x) if !x.is_finite() => Err(CoordinateError::NotFinite(word.to_string())),
        Some(x) => Ok(x),
    }
}
