//! Polyhedral solids in their principal axes about their centres of mass, and oriented copies of them.

use std::sync::Arc;

use cd_formats::surface::{MassProperties, Surface, SurfaceFault};
use nalgebra::{Matrix3, Vector3};

use crate::rounding::{round_14_columns, round_axes};
use crate::shapes::hull;

/// Ratio of the distance from the centre to the extent, or error of the principal axes, below which vertices stay as
/// they are. A file with twelve digits leaves about 1e-12.
const ALIGNMENT_TOLERANCE: f64 = 1e-10;

/// Centre of mass and principal axes of a shape in the axes in which it was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CentredFrame {
    /// Centre of mass, m.
    pub shift: Vector3<f64>,
    /// Principal moments of inertia at density 1, m^5.
    pub moments: [f64; 3],
    /// Principal axes, one a row, in the order and with the signs closest to the given axes.
    pub axes: Matrix3<f64>,
}

impl CentredFrame {
    /// Frame of a shape with these mass properties, whose farthest point is at the distance `extent`, m, from its centre of mass.
    /// A centre and axes that are those of the shape up to rounding stay exactly these.
    pub fn from_properties(properties: &MassProperties, extent: f64) -> CentredFrame {
        let mut shift = Vector3::from(properties.centre);
        if shift.norm() <= ALIGNMENT_TOLERANCE * extent {
            shift = Vector3::zeros();
        }
        let inertia = Matrix3::from(properties.inertia);
        let products_of_inertia = inertia - Matrix3::from_diagonal(&inertia.diagonal());
        let (moments, axes) = if products_of_inertia.amax() <= ALIGNMENT_TOLERANCE * inertia.trace() {
            (inertia.diagonal().into(), Matrix3::identity())
        } else {
            let (moments, axes) = properties.principal_axes();
            nearest_axes(moments, axes.map(Vector3::from))
        };
        CentredFrame { shift, moments, axes }
    }

    /// Point along the principal axes about the centre of mass, m, of one in the given axes.
    pub fn centred_point(&self, point: &Vector3<f64>) -> Vector3<f64> {
        if self.axes == Matrix3::identity() { point - self.shift } else { self.axes * (point - self.shift) }
    }
}

/// Body of density 1 in its principal axes about its centre of mass.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalSolid {
    /// Convex surfaces that touch other bodies; one if the solid is convex itself.
    pub pieces: Vec<Surface>,
    /// Volume, m^3.
    pub volume: f64,
    /// Principal moments of inertia, m^5.
    pub moments: [f64; 3],
    /// Distance of the farthest vertex from the centre of mass, m.
    pub reach: f64,
    /// Centre of mass in the axes in which the shape was given, m.
    pub shift: Vector3<f64>,
    /// Principal axes in those axes, one a row.
    pub axes: Matrix3<f64>,
}

impl PrincipalSolid {
    /// Computes volume, centre and inertia of `whole`, and translates and rotates the `pieces` (in the same axes) to match.
    ///
    /// Errors: a piece with triangles so small relative to the rest that they have no area after the translation.
    pub fn new(whole: &Surface, pieces: &[Surface]) -> Result<PrincipalSolid, hull::HullError> {
        let properties = whole.mass_properties();
        let extent = whole.vertices().iter().map(|&v| (Vector3::from(v) - Vector3::from(properties.centre)).norm());
        let frame = CentredFrame::from_properties(&properties, extent.fold(0.0, f64::max));
        let centred_surface = |surface: &Surface| {
            let vertices: Vec<[f64; 3]> =
                surface.vertices().iter().map(|&v| frame.centred_point(&v.into()).into()).collect();
            Surface::new(&vertices, surface.triangles()).map_err(|faults| {
                hull::HullError::Moved(faults.0.first().map(SurfaceFault::to_string).unwrap_or_default())
            })
        };
        let pieces: Vec<Surface> = pieces.iter().map(centred_surface).collect::<Result<_, _>>()?;
        let vertices = pieces.iter().flat_map(|piece| piece.vertices());
        let reach = vertices.map(|&v| Vector3::from(v).norm()).fold(0.0, f64::max);
        let CentredFrame { shift, moments, axes } = frame;
        Ok(PrincipalSolid { pieces, volume: properties.volume, moments, reach, shift, axes })
    }

    /// Convex solid. Errors: the errors of [`PrincipalSolid::new`].
    pub fn from_convex(surface: &Surface) -> Result<PrincipalSolid, hull::HullError> {
        PrincipalSolid::new(surface, std::slice::from_ref(surface))
    }

    /// Radius of the sphere of equal volume, m.
    pub fn equivalent_radius(&self) -> f64 {
        libm::cbrt(0.75 * self.volume / std::f64::consts::PI)
    }
}

/// Axes (rows, right-handed) in the order and with the signs that are closest to the given ones.
fn nearest_axes(moments: [f64; 3], axes: [Vector3<f64>; 3]) -> ([f64; 3], Matrix3<f64>) {
    const AXIS_ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]];
    let alignment = |order: &[usize; 3]| (0..3).map(|k| axes[order[k]][k].abs()).sum::<f64>();
    let order = AXIS_ORDERS.into_iter().rev().max_by(|a, b| alignment(a).total_cmp(&alignment(b))).unwrap_or([0, 1, 2]);
    let signed_axis = |k: usize| axes[order[k]] * axes[order[k]][k].signum();
    let mut rows = [0, 1, 2].map(signed_axis);
    let matrix = |rows: &[Vector3<f64>; 3]| Matrix3::from_rows(&rows.map(|row| row.transpose()));
    if matrix(&rows).determinant() < 0.0 {
        // Axis whose sign matters the least.
        let least_aligned = (0..3).min_by(|&a, &b| rows[a][a].total_cmp(&rows[b][b])).unwrap_or(2);
        rows[least_aligned] = -rows[least_aligned];
    }
    (order.map(|k| moments[k]), matrix(&rows))
}

/// Solid of some size in its orientation; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientedPolyhedron {
    pub solid: Arc<PrincipalSolid>,
    /// Factor of all lengths of the solid.
    pub scale: f64,
    /// Principal axes along the fixed axes, one a row.
    pub axes: Matrix3<f64>,
}

impl OrientedPolyhedron {
    /// Solid rotated by `rotation`, from the axes in which the shape was given to the fixed ones.
    pub fn new(solid: Arc<PrincipalSolid>, scale: f64, rotation: &Matrix3<f64>) -> Self {
        let axes = round_axes(&(solid.axes * rotation.transpose()));
        OrientedPolyhedron { solid, scale, axes }
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        self.scale.powi(3) * self.solid.volume
    }

    /// Principal moments at density 1, m^5.
    pub fn moments(&self) -> [f64; 3] {
        self.solid.moments.map(|moment| self.scale.powi(5) * moment)
    }

    /// Vertices of each piece, along the principal axes, m.
    pub fn vertices(&self) -> Vec<Vec<[f64; 3]>> {
        let scaled_vertex = |v: &[f64; 3]| v.map(|x| round_14_columns(self.scale * x));
        self.solid.pieces.iter().map(|piece| piece.vertices().iter().map(scaled_vertex).collect()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_too_small_to_be_moved_are_reported() {
        // A cube of a kilometre with a sliver of 1e-14 m on one of its edges, at the origin.
        let corner = |k: usize| [[0, 1, 1, 0][k % 4], [0, 0, 1, 1][k % 4], k / 4].map(|x| 1e3 * x as f64);
        let corners: Vec<[f64; 3]> = (0..8).map(corner).chain([[0.1, 0.0, 0.0], [0.05, 1e-14, 0.0]]).collect();
        let below = [[3, 0, 9], [3, 9, 8], [3, 8, 1], [3, 1, 2], [0, 9, 8]];
        let before = [[4, 0, 8], [4, 8, 1], [4, 1, 5]];
        let others = [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7], [4, 5, 6], [4, 6, 7]];
        let faces = [&below[..], &before, &others].concat();
        let surface = Surface::new(&corners, &faces).unwrap();
        let summary = PrincipalSolid::from_convex(&surface).unwrap_err().to_string();
        assert!(summary.starts_with("about its centre of mass,") && summary.contains("has no area"), "{summary}");
    }
}
