//! Contact geometry against trying everything: random pairs, degenerate ones, symmetry, continuity.

mod capsules;
mod cylinder;
mod degenerate;
mod oracle;
mod other;
mod patch;
mod random;
mod round_on_mesh;
mod shapes;
mod table;

use cd_solve::geometry::{CachedFeature, Manifold, NarrowPhaseMode, polyhedron_polyhedron};
use cd_solve::math::{Quat, Vec3};

use oracle::Solid;

/// The contact of two solids, with nothing remembered.
pub fn contact(a: &Solid, qa: &Quat, b: &Solid, qb: &Quat, c: &Vec3, alert: f64) -> Option<Manifold> {
    remembered(a, qa, b, qb, c, alert, NarrowPhaseMode::Accurate, &mut CachedFeature::default())
}

#[allow(clippy::too_many_arguments)]
pub fn remembered(
    a: &Solid,
    qa: &Quat,
    b: &Solid,
    qb: &Quat,
    c: &Vec3,
    alert: f64,
    narrow: NarrowPhaseMode,
    memory: &mut CachedFeature,
) -> Option<Manifold> {
    polyhedron_polyhedron(&a.shape.posed_by(qa), &b.shape.posed_by(qb), c, alert, narrow, memory)
}

/// Checks properties that hold for every contact.
pub fn check(found: &Manifold, alert: f64, size: f64, what: &dyn Fn() -> String) {
    assert!(!found.points.is_empty(), "{}: {found:?}", what());
    // A few roundings of components up to 1.
    assert!((found.normal.norm() - 1.0).abs() < 1e-14, "{}: {found:?}", what());
    assert!(found.area >= 0.0 && found.area <= 20.0 * size * size, "{}: {found:?}", what());
    for (k, point) in found.points.iter().enumerate() {
        assert!(point.gap <= alert && point.gap.is_finite(), "{}: {found:?}", what());
        assert!(point.position.iter().all(|x| x.is_finite()), "{}: {found:?}", what());
        assert!(found.points[..k].iter().all(|p| p.features < point.features), "{}: {found:?}", what());
    }
}
