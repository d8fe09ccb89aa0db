//! A polyhedron against a rectangular plate, which is a cuboid.

use super::cache::CachedFeature;
use super::manifold::{Manifold, NarrowPhaseMode};
use super::pair::support_vertex;
use super::polyhedra::polyhedron_polyhedron;
use super::polyhedron::{Polyhedron, PosedPolyhedron};
use crate::math::{Quat, Vec3};

/// Contact of polyhedron A with a plate at `c` = x_B - x_A (m) with the orientation `q`; `None` if they are more than
/// `alert` (m) apart.
///
/// The contact faces are at ± half_lengths.z along the plate's third axis; the rim can be touched, too. For many contacts
/// of one plate keep its [`Polyhedron::cuboid`] and use [`polyhedron_polyhedron`], which this calls.
pub fn polyhedron_plane(a: &PosedPolyhedron, c: &Vec3, q: &Quat, half_lengths: &Vec3, alert: f64) -> Option<Manifold> {
    // Most bodies are farther than that from the plane of one of the faces.
    let n = q * Vec3::z();
    let centre = -n.dot(c);
    let below = support_vertex(a, &-n).1;
    let above = support_vertex(a, &n).1;
    if (centre - below).max(-centre - above) - half_lengths.z > alert {
        return None;
    }
    let plate = Polyhedron::cuboid(half_lengths);
    polyhedron_polyhedron(a, &plate.posed_by(q), c, alert, NarrowPhaseMode::Accurate, &mut CachedFeature::default())
}
