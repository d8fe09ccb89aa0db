//! `DOF.INI`, `DOF.OUT.k`: displacement, velocity and frame of bodies at one instant.

use std::path::Path;

use crate::error::Faults;

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dof {
    pub step: u64,
    /// s
    pub time: f64,
    pub bodies: Vec<BodyDof>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct BodyDof {
    pub line: usize,
    /// 0-based (1-based in the file).
    pub body: usize,
    /// `X(1..6)`: displacement from the reference position of BODIES.DAT, m; the last three are not used.
    pub displacement: [f64; 6],
    /// `V(1..6)`: velocity in fixed axes, m/s; angular velocity along the body's axes, rad/s.
    pub velocity: [f64; 6],
    /// `a`, `b`, `g`: the body's principal axes in fixed axes, one a row.
    pub axes: [[f64; 3]; 3],
}

impl Dof {
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    /// The text of the file.
    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
