//! `BULK_BEHAV.DAT`: uniform gravity and the materials' densities.

use std::path::Path;

use crate::error::Faults;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct BulkBehav {
    /// m/s^2, fixed axes.
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Trimmed, at most five characters.
    pub name: String,
    /// `Umas`, kg/m^3.
    pub density: f64,
}

impl BulkBehav {
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
