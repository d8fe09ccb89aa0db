//! Reading of RON texts, with errors at the position of the mistake, in plain words.
//!
//! [`syntax_faults`] finds all faults of the text itself (brackets, commas, quotes, comments) at once. A text without
//! such faults is parsed by the RON library. Its error is described with the value at its position, and reading continues
//! after it; the library's own text never reaches the user.

mod parse;
mod recovery;
pub(crate) mod syntax;

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::{Fault, Faults};
pub use crate::names::{known_names, nearest_name};
use crate::value_locations::ValueLocations;

pub(crate) use parse::ron_options;
pub(crate) use recovery::parse_ron;
pub(crate) use syntax::display_text;
pub use syntax::{TextFault, line_and_column, syntax_faults};

/// Faults of the text of a file, with line and column; `object` is the name of the text as a whole.
pub(crate) fn located_faults(path: &Path, text: &str, object: &str, mistakes: Vec<TextFault>) -> Faults {
    let locations = ValueLocations::from_text(text);
    let fault = |mistake: TextFault| {
        let (line, column) = line_and_column(text, mistake.offset);
        let object = if mistake.path.is_empty() { object.to_string() } else { locations.path_in_words(&mistake.path) };
        Fault { column: Some(column), ..Fault::new(path, Some(line), object, mistake.found, mistake.expected) }
    };
    Faults(mistakes.into_iter().map(fault).collect())
}

/// Faults of the value of a flag, on one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlagError(String);

impl FlagError {
    /// Error of the value `text` with these mistakes.
    pub(crate) fn new(text: &str, mistakes: &[TextFault]) -> FlagError {
        let locations = ValueLocations::from_text(text);
        let fault_text = |TextFault { offset, path, found, expected }: &TextFault| {
            let object = if path.is_empty() { String::new() } else { format!("{}: ", locations.path_in_words(path)) };
            let (_, column) = line_and_column(text, *offset);
            format!("column {column}: {object}{found}; {expected}")
        };
        FlagError(mistakes.iter().map(fault_text).collect::<Vec<_>>().join("; "))
    }
}

impl std::fmt::Display for FlagError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for FlagError {}

/// Reads the value of a flag; the error is one line without a position in a file.
pub fn from_flag<T: DeserializeOwned>(text: &str) -> Result<T, FlagError> {
    parse_ron(text).map_err(|mistakes| FlagError::new(text, &mistakes))
}
