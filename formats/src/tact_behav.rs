//! `TACT_BEHAV.DAT`: contact laws, and the table of which contactors see each other by which law.

use std::path::Path;

use crate::error::Faults;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct TactBehav {
    pub laws: Vec<Law>,
    pub visibility: Vec<See>,
}

/// A contact law with its parameters in the order of the file, e.g. RST_CLB: e_n, e_t, mu.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Line of the law, 1-based; 0 when no file holds it yet.
    pub line: usize,
    /// Five characters, trimmed.
    pub nickname: String,
    /// e.g. `IQS_CLB`
    pub kind: String,
    pub parameters: Vec<f64>,
}

/// One row of the visibility table.
#[derive(Debug, Clone, PartialEq)]
pub struct See {
    pub line: usize,
    pub candidate: Side,
    /// Nickname of the law.
    pub law: String,
    pub antagonist: Side,
    /// Alert distance, m, surface to surface.
    pub alert: f64,
}

/// One side of a row; the names are five characters, trimmed.
#[derive(Debug, Clone, PartialEq)]
pub struct Side {
    /// `RBDY3`
    pub body: String,
    /// `SPHER`, `PLANx` ...
    pub contactor: String,
    pub colour: String,
}

impl TactBehav {
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
