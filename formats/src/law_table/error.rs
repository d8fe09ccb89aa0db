//! Error of a contact law that a file or a scene names, but the table of laws does not have.

use std::fmt;

/// Law that the programs do not compute, or a wrong number of its parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LawError {
    pub(super) found: String,
    pub(super) expected: String,
}

impl LawError {
    /// Description of the law that was found.
    pub fn found(&self) -> &str {
        &self.found
    }

    /// Laws or parameters that are expected, in words.
    pub fn expected(&self) -> &str {
        &self.expected
    }
}

impl fmt::Display for LawError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.found, self.expected)
    }
}

impl std::error::Error for LawError {}
