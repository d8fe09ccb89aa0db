//! Faults of contact laws and their parameters.

use std::fmt;

use super::{LawParameter, computed_labels, law_entry, refusal_reason};
use crate::ron_text::known_names;

/// Name or number of parameters of which the programs have no law.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LawError {
    pub label: String,
    /// Number of parameters.
    pub count: usize,
}

impl LawError {
    /// Description of the law that was found.
    pub fn found(&self) -> String {
        let LawError { label, count } = self;
        match (law_entry(label), refusal_reason(label)) {
            (_, Some(reason)) => format!("its kind {label} is not computed: {reason}"),
            (None, None) => format!("its kind '{label}' is not known"),
            (Some(_), None) => format!("{label} with {count} parameters"),
        }
    }

    /// Laws or parameters that are expected, in words.
    pub fn expected(&self) -> String {
        match (law_entry(&self.label), refusal_reason(&self.label)) {
            (_, Some(_)) => format!("computed are {}", computed_labels().join(", ")),
            (None, None) => known_names(&self.label, &computed_labels()),
            (Some(entry), None) => {
                let names: Vec<&str> = entry.parameters().map(LawParameter::label).collect();
                format!("expected {}: {}", names.len(), names.join(", "))
            }
        }
    }
}

impl fmt::Display for LawError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.found(), self.expected())
    }
}

impl std::error::Error for LawError {}

/// Value of a parameter that a law in use cannot have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterFault {
    pub parameter: LawParameter,
    pub found: String,
    /// Values that are expected, without the word.
    pub expected: String,
}

impl fmt::Display for ParameterFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}; expected {}", self.parameter.name(), self.found, self.expected)
    }
}

impl std::error::Error for ParameterFault {}
