//! `Vloc_Rloc.INI`, `Vloc_Rloc.OUT.k`: contacts at one instant, with their forces and velocities.
//!
//! Frames and components here are this project's: rows n, t, s with n x t = s. The files of LMGC90
//! hold s = t x n (n x t for SPCDx and SPDCx); reader and writer turn the sign of s and of its components.

use std::path::Path;

use crate::error::Faults;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct VlocRloc {
    pub step: u64,
    /// s
    pub time: f64,
    pub contacts: Vec<ContactRecord>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ContactRecord {
    pub line: usize,
    /// `SPSPx`, `SPPLx` ...
    pub kind: String,
    pub candidate: ContactSide,
    pub antagonist: ContactSide,
    /// Nickname of the law.
    pub law: String,
    /// `stick`, `slide`, `noctc` ...
    pub status: String,
    /// Force on the candidate along n, t, s, N.
    pub force: [f64; 3],
    /// Velocity of the candidate relative to the antagonist along n, t, s, m/s.
    pub velocity: [f64; 3],
    /// Gap foreseen at the next detection, m.
    pub gap: f64,
    /// Rows n, t, s; n points from the antagonist to the candidate.
    pub frame: [[f64; 3]; 3],
    /// m
    pub point: [f64; 3],
    /// Internal variables of the law.
    pub internals: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ContactSide {
    /// 0-based (1-based in the file).
    pub body: usize,
    /// `SPHER`, `PLANx` ...
    pub contactor: String,
    /// Rank of the contactor in its body, 0-based (1-based in the file).
    pub rank: usize,
}

impl VlocRloc {
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
