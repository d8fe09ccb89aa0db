//! `DRV_DOF.DAT`: imposed velocities and forces.

use std::path::Path;

use crate::error::Faults;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct DrvDof(pub Vec<Driven>);

/// One driven component of one body.
#[derive(Debug, Clone, PartialEq)]
pub struct Driven {
    pub line: usize,
    /// 0-based body number (1-based in the file).
    pub body: usize,
    /// 0..2 along the fixed axes, 3..5 about the body's principal axes (1..6 in the file).
    pub component: usize,
    pub kind: DrivenKind,
    pub evolution: Evolution,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrivenKind {
    /// `vlocy`: m/s or rad/s.
    Velocity,
    /// `force`: N or N m.
    Force,
}

/// A function of time.
#[derive(Debug, Clone, PartialEq)]
pub enum Evolution {
    /// (constant + amplitude cos(omega t + phase)) min(1, ramp_start + ramp_rate t)
    Harmonic { constant: f64, amplitude: f64, omega: f64, phase: f64, ramp_start: f64, ramp_rate: f64 },
    /// Points (time, value) by increasing time of the file `name` in DATBOX; linear between them and beyond both ends.
    Table { name: String, points: Vec<[f64; 2]> },
}

impl Evolution {
    /// A constant value.
    pub fn constant(value: f64) -> Self {
        Evolution::Harmonic { constant: value, amplitude: 0.0, omega: 0.0, phase: 0.0, ramp_start: 1.0, ramp_rate: 0.0 }
    }

    /// The value at time `t`, s.
    pub fn at(&self, t: f64) -> f64 {
        let _ = t;
        unimplemented!()
    }
}

impl DrvDof {
    /// Reads the file and the tables that it names in the same folder. A file that is absent drives nothing.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    /// The text of the file; tables are files of their own.
    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
