//! Positions of grains along a direction, and the volume of a grain below a height.

use crate::derive::polytope::cut_polygon;
use crate::frame::Grain;
use crate::math::Vec3;

/// Centre of mass, m; NaN without grains.
pub fn centre_of_mass<'a>(grains: impl Iterator<Item = &'a Grain>) -> Vec3 {
    let (moment, mass) = grains.fold((Vec3::zeros(), 0.0), |(moment, mass), g| (moment + g.mass * g.x, mass + g.mass));
    moment / mass
}

/// Lowest and highest point of a grain along `up`, m.
pub fn height_range(grain: &Grain, up: &Vec3) -> [f64; 2] {
    let balls = grain.balls().flat_map(|(x, radius)| [x.dot(up) - radius, x.dot(up) + radius]);
    let points = grain.vertices().map(|v| v.dot(up));
    balls.chain(points).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(h), high.max(h)])
}

/// Volume of a grain's pieces below a height along `up`, m^3; overlapping pieces count separately.
///
/// A ball has the cap pi (r + s)^2 (2 r - s) / 3, with s the height of the plane above its centre. A polyhedron has the
/// cones over the parts of its faces below the plane, from a point of the plane: from there the cut is seen edge-on.
pub fn volume_below(grain: &Grain, up: &Vec3, height: f64) -> f64 {
    let ball = |(x, r): (Vec3, f64)| {
        let s = (height - x.dot(up)).clamp(-r, r);
        std::f64::consts::PI * (r + s).powi(2) * (2.0 * r - s) / 3.0
    };
    let [_, highest] = height_range(grain, up);
    let origin = grain.x + up * (height.min(highest) - grain.x.dot(up));
    let vertices: Vec<Vec3> = grain.vertices().map(|v| v - origin).collect();
    let cone = |face: &Vec<u32>| {
        let corners: Vec<Vec3> = face.iter().map(|&v| vertices[v as usize]).collect();
        let below = cut_polygon(&corners, |p| -p.dot(up), |p, q, share| p + (q - p) * share);
        (2..below.len()).map(|k| below[0].dot(&below[k - 1].cross(&below[k])) / 6.0).sum::<f64>()
    };
    let faces = grain.solid.iter().flat_map(|solid| &solid.faces);
    grain.balls().map(ball).sum::<f64>() + faces.map(cone).sum::<f64>()
}
