//! `BODIES.DAT`: rigid bodies with their contactors.

use std::path::Path;

use crate::error::Faults;

/// The bodies in the order of the file, which is their number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bodies(pub Vec<Body>);

#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Line of `$bdyty`, 1-based; 0 for a body that no file holds yet.
    pub line: usize,
    /// Name of a material of BULK_BEHAV.DAT, trimmed.
    pub material: String,
    /// `avrd`: radius of the sphere of equal volume, m; 0 asks for the contactor's own volume.
    pub equivalent_radius: f64,
    /// `I1 I2 I3`: principal inertia at density 1, m^5.
    pub inertia: Option<[f64; 3]>,
    /// `coo1..3`: centre of mass in the reference configuration, m.
    pub position: [f64; 3],
    pub contactors: Vec<Contactor>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Contactor {
    pub colour: String,
    pub shape: Shape,
    /// First, second, third axis and offset of the contactor in the body's frame, where given.
    pub local_frame: Option<LocalFrame>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct LocalFrame {
    pub axes: [[f64; 3]; 3],
    pub offset: [f64; 3],
}

/// Shapes in the body's principal frame; lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// SPHER
    Sphere { radius: f64 },
    /// SPHEb: a sphere off the body's centre.
    OffsetSphere { radius: f64, offset: [f64; 3] },
    /// PLANx: a rectangular plate, its contact faces at +-axe3 along the third axis.
    Plane { half_lengths: [f64; 3] },
    /// CYLND, and DNLYC with contact on the inside; axis along the third axis.
    Cylinder { half_height: f64, radius: f64, hollow: bool },
    /// POLYR: closed triangulated surface; triangles hold 0-based vertex numbers.
    Polyhedron { vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]> },
    /// PT3Dx
    Point { offset: [f64; 3] },
}

impl Shape {
    /// The five-character name in the files.
    pub fn name(&self) -> &'static str {
        match self {
            Shape::Sphere { .. } => "SPHER",
            Shape::OffsetSphere { .. } => "SPHEb",
            Shape::Plane { .. } => "PLANx",
            Shape::Cylinder { hollow: false, .. } => "CYLND",
            Shape::Cylinder { hollow: true, .. } => "DNLYC",
            Shape::Polyhedron { .. } => "POLYR",
            Shape::Point { .. } => "PT3Dx",
        }
    }
}

impl Bodies {
    /// Reads the file; all its faults at once.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let _ = path;
        unimplemented!()
    }

    /// The text of the file.
    pub fn to_text(&self) -> String {
        unimplemented!()
    }
}
