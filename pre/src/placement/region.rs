//! Region for a group of grains, centred on the origin, with its axes along the coordinates.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::names::six_digits;
use nalgebra::Vector3;

use super::inside::SurfaceRegion;
use crate::scene::{Envelope, ModelScale};
use crate::shapes::model;
use crate::sphere::sphere_volume;

/// Region in which grains are placed.
#[derive(Debug, Clone, PartialEq)]
pub enum GrainRegion {
    /// Radius, m.
    Ball(f64),
    /// Semi-axes, m.
    Ellipsoid([f64; 3]),
    /// Half lengths, m.
    Box([f64; 3]),
    /// Cylinder about the third axis, m.
    Cylinder { half_height: f64, radius: f64 },
    /// Inside of a surface from a file.
    Inside(SurfaceRegion),
}

impl Envelope {
    /// Whether the size is given.
    pub fn has_size(&self) -> bool {
        match self {
            Envelope::Ball { radius } => radius.is_some(),
            Envelope::Ellipsoid { semi_axes: lengths, .. } | Envelope::Box { lengths, .. } => lengths.is_some(),
            Envelope::Cylinder { .. } => true,
            Envelope::Model { scale, .. } => scale.is_some(),
        }
    }

    /// Converts to a region, and returns notes on a model's file. Without a size the region has the right proportions
    /// only. `folder` is the base of the paths of models.
    ///
    /// Errors: faults of a model's file.
    pub fn to_region(&self, folder: &Path) -> Result<(GrainRegion, String), Faults> {
        let half_of = |lengths: [f64; 3]| lengths.map(|length| 0.5 * length);
        let mut summary = String::new();
        let region = match self {
            Envelope::Ball { radius } => GrainRegion::Ball(radius.unwrap_or(1.0)),
            Envelope::Ellipsoid { semi_axes, ratios } => {
                GrainRegion::Ellipsoid(semi_axes.or(*ratios).unwrap_or([1.0; 3]))
            }
            Envelope::Box { lengths, ratios } => GrainRegion::Box(half_of(lengths.or(*ratios).unwrap_or([2.0; 3]))),
            &Envelope::Cylinder { half_height, radius } => GrainRegion::Cylinder { half_height, radius },
            Envelope::Model { file, scale } => {
                let read = model::read_surface(folder, file, scale.unwrap_or(ModelScale::Factor(1.0)))?;
                let flipped_note = (read.flipped > 0).then(|| format!("{} triangles turned outward", read.flipped));
                let changes: Vec<String> = flipped_note.into_iter().chain(read.repairs).collect();
                if !changes.is_empty() {
                    summary = format!("{file}: {}", changes.join(", "));
                }
                let inside = SurfaceRegion::new(&read.surface).map_err(|found| {
                    let expected = "expected a surface that encloses a volume";
                    Fault::new(&folder.join(file), None, "surface", found.to_string(), expected)
                })?;
                GrainRegion::Inside(inside)
            }
        };
        Ok((region, summary))
    }
}

/// Fewer positions in a region than grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PositionShortage {
    /// Number of positions that there are.
    pub count: usize,
}

impl std::fmt::Display for PositionShortage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "only {} positions in the region", self.count)
    }
}

impl std::error::Error for PositionShortage {}

impl GrainRegion {
    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        let product = |[a, b, c]: [f64; 3]| a * b * c;
        match self {
            GrainRegion::Ball(radius) => sphere_volume(*radius),
            GrainRegion::Ellipsoid(axes) => 4.0 / 3.0 * std::f64::consts::PI * product(*axes),
            GrainRegion::Box(halves) => 8.0 * product(*halves),
            GrainRegion::Cylinder { half_height, radius } => 2.0 * std::f64::consts::PI * radius * radius * half_height,
            GrainRegion::Inside(inside) => inside.volume(),
        }
    }

    /// Region of the same proportions with `volume`, m^3.
    pub fn scaled_to(&self, volume: f64) -> GrainRegion {
        let factor = libm::cbrt(volume / self.volume());
        let scaled_lengths = |lengths: [f64; 3]| lengths.map(|length| factor * length);
        match self {
            GrainRegion::Ball(radius) => GrainRegion::Ball(factor * radius),
            GrainRegion::Ellipsoid(axes) => GrainRegion::Ellipsoid(scaled_lengths(*axes)),
            GrainRegion::Box(halves) => GrainRegion::Box(scaled_lengths(*halves)),
            GrainRegion::Cylinder { half_height, radius } => {
                GrainRegion::Cylinder { half_height: factor * half_height, radius: factor * radius }
            }
            GrainRegion::Inside(inside) => GrainRegion::Inside(inside.scaled_by(factor)),
        }
    }

    /// Half the lengths of the smallest box around the region, m.
    pub fn half_extents(&self) -> Vector3<f64> {
        match self {
            GrainRegion::Ball(radius) => Vector3::repeat(*radius),
            GrainRegion::Ellipsoid(lengths) | GrainRegion::Box(lengths) => (*lengths).into(),
            GrainRegion::Cylinder { half_height, radius } => Vector3::new(*radius, *radius, *half_height),
            GrainRegion::Inside(inside) => inside.half_extents(),
        }
    }

    /// Calls `visit` with the distance of a point from walls of the region, m, negative beyond them, and their unit normals
    /// inward: all walls of a box or cylinder, of the others the nearest point of the surface. A point on a surface from a
    /// file has no wall.
    pub fn for_each_wall(&self, point: &Vector3<f64>, mut visit: impl FnMut(f64, Vector3<f64>)) {
        match self {
            GrainRegion::Ball(radius) => visit(radius - point.norm(), -direction_or(point, Vector3::z())),
            GrainRegion::Ellipsoid(axes) => {
                let axes_vector = Vector3::from(*axes);
                let nearest = nearest_on_ellipsoid(axes, point);
                let sign = if point.component_div(&axes_vector).norm_squared() <= 1.0 { 1.0 } else { -1.0 };
                let outward = nearest.component_div(&axes_vector).component_div(&axes_vector);
                visit(sign * (nearest - point).norm(), -direction_or(&outward, Vector3::z()));
            }
            GrainRegion::Box(halves) => {
                for (k, half) in halves.iter().enumerate() {
                    let unit = Vector3::from_fn(|row, _| if row == k { 1.0 } else { 0.0 });
                    visit(half - point[k], -unit);
                    visit(half + point[k], unit);
                }
            }
            GrainRegion::Cylinder { half_height, radius } => {
                let from_axis = Vector3::new(point.x, point.y, 0.0);
                visit(radius - from_axis.norm(), -direction_or(&from_axis, Vector3::x()));
                visit(half_height - point.z, -Vector3::z());
                visit(half_height + point.z, Vector3::z());
            }
            GrainRegion::Inside(inside) => {
                if let Some((distance, inward)) = inside.nearest_wall(point) {
                    visit(distance, inward);
                }
            }
        }
    }

    /// Whether the whole ball of `radius`, m, about `centre` lies in the region.
    pub fn contains_ball(&self, centre: &Vector3<f64>, radius: f64) -> bool {
        match self {
            GrainRegion::Ball(outer) => centre.norm() + radius <= *outer,
            GrainRegion::Ellipsoid(axes) => ellipsoid_contains_ball(axes, centre, radius),
            GrainRegion::Box(halves) => (0..3).all(|k| centre[k].abs() + radius <= halves[k]),
            GrainRegion::Cylinder { half_height, radius: outer } => {
                centre.xy().norm() + radius <= *outer && centre.z.abs() + radius <= *half_height
            }
            GrainRegion::Inside(inside) => inside.contains_ball(centre, radius),
        }
    }
}

impl std::fmt::Display for GrainRegion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let vector_text = |[a, b, c]: [f64; 3]| format!("({})", [a, b, c].map(six_digits).join(", "));
        match self {
            GrainRegion::Ball(radius) => write!(f, "a ball of radius {} m", six_digits(*radius)),
            GrainRegion::Ellipsoid(axes) => write!(f, "an ellipsoid of semi-axes {} m", vector_text(*axes)),
            GrainRegion::Box(halves) => write!(f, "a box of lengths {} m", vector_text(halves.map(|half| 2.0 * half))),
            GrainRegion::Cylinder { half_height, radius } => {
                write!(
                    f,
                    "a cylinder of radius {} m and length {} m",
                    six_digits(*radius),
                    six_digits(2.0 * half_height)
                )
            }
            GrainRegion::Inside(inside) => write!(f, "a surface around {:.6e} m^3", inside.volume()),
        }
    }
}

/// Whether the ball lies in the ellipsoid: its centre inside, and no nearer to the surface than `radius`.
fn ellipsoid_contains_ball(axes: &[f64; 3], centre: &Vector3<f64>, radius: f64) -> bool {
    let level = (0..3).map(|k| (centre[k] / axes[k]).powi(2)).sum::<f64>().sqrt();
    if level > 1.0 {
        return false;
    }
    // The ellipsoid shrunk to the share 1 - level fits about any point of that level: a fast acceptance test.
    let shortest = axes.iter().copied().fold(f64::INFINITY, f64::min);
    (1.0 - level) * shortest >= radius || distance_to_ellipsoid(axes, centre) >= radius
}

/// Unit vector along `vector`, or `other` if that has no direction.
fn direction_or(vector: &Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
    let length = vector.norm();
    if length > 0.0 { vector / length } else { other }
}

/// Distance, m, of a point inside an ellipsoid to its surface, to a relative 1e-12.
fn distance_to_ellipsoid(axes: &[f64; 3], point: &Vector3<f64>) -> f64 {
    (nearest_in_octant(axes, &point.abs()) - off_plane(axes, &point.abs())).norm()
}

/// Point of an ellipsoid's surface that is nearest to `point`, inside or outside, m.
fn nearest_on_ellipsoid(axes: &[f64; 3], point: &Vector3<f64>) -> Vector3<f64> {
    let nearest = nearest_in_octant(axes, &point.abs());
    Vector3::from_fn(|k, _| nearest[k].copysign(point[k]))
}

/// Point with coordinates of at least 0, moved off the plane across the shortest axis: there the root that
/// [`nearest_in_octant`] seeks can be lost at s = 0.
fn off_plane(axes: &[f64; 3], point: &Vector3<f64>) -> Vector3<f64> {
    let short = Vector3::from(*axes).imin();
    let mut point = *point;
    point[short] = point[short].max(1e-12 * axes[short]);
    point
}

/// Point of an ellipsoid's surface that is nearest to `point`, m, with coordinates of at least 0.
///
/// The nearest surface point is x_k = a_k^2 p_k / (a_k^2 - c^2 + s), c the shortest semi-axis, with the
/// root s > 0 of sum (a_k p_k / (a_k^2 - c^2 + s))^2 = 1, whose left side falls with s; s <= c^2 for points inside (Eberly,
/// "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid", 2013, with s = t + c^2).
fn nearest_in_octant(axes: &[f64; 3], point: &Vector3<f64>) -> Vector3<f64> {
    let short = Vector3::from(*axes).imin();
    let c = axes[short];
    let excess = axes.map(|a| (a - c) * (a + c));
    let point = off_plane(axes, point);
    let sum = |s: f64| (0..3).map(|k| (axes[k] * point[k] / (excess[k] + s)).powi(2)).sum::<f64>();
    // At the lower end the term of the shortest axis alone is 1. Outside, no term is larger than that of an excess of 0.
    let farthest = if sum(c * c) > 1.0 { point.component_mul(&Vector3::from(*axes)).norm() } else { c * c };
    let (mut low, mut high) = (c * point[short], farthest);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if sum(middle) >= 1.0 { low = middle } else { high = middle }
    }
    Vector3::from_fn(|k, _| axes[k] * axes[k] * point[k] / (excess[k] + low))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distances_known_by_hand() {
        let axes = [3.0, 2.0, 1.0];
        let distance = |x, y, z| distance_to_ellipsoid(&axes, &Vector3::new(x, y, z));
        assert!((distance(0.0, 0.0, 0.0) - 1.0).abs() < 1e-11);
        assert!((distance(0.0, 0.0, 0.75) - 0.25).abs() < 1e-11);
        // On the long axis the tip is nearest only beyond its centre of curvature, a - c^2/a = 8/3 from the centre.
        assert!((distance(2.9, 0.0, 0.0) - 0.1).abs() < 1e-11);
        assert!(distance(2.0, 0.0, 0.0) < 0.99);
        // x = 2: nearest at x/(1 - c^2/a^2) = 2.25, z^2 = 1 - 2.25^2/9.
        assert!((distance(2.0, 0.0, 0.0) - (0.0625f64 + 1.0 - 2.25f64.powi(2) / 9.0).sqrt()).abs() < 1e-11);
        assert!((distance_to_ellipsoid(&[2.0; 3], &Vector3::new(0.3, 0.4, 0.0)) - 1.5).abs() < 1e-11);
    }

    #[test]
    fn scaling_gives_the_volume() {
        for region in
            [GrainRegion::Ball(2.0), GrainRegion::Ellipsoid([1.0, 2.0, 3.0]), GrainRegion::Box([1.0, 2.0, 3.0])]
        {
            assert!((region.scaled_to(7.0).volume() - 7.0).abs() < 1e-14 * 7.0); // a cube root and its cube
        }
    }

    #[test]
    fn walls_are_where_the_closed_forms_put_them() {
        let walls = |region: &GrainRegion, point: [f64; 3]| {
            let mut found = Vec::new();
            region.for_each_wall(&point.into(), |distance, inward| found.push((distance, inward)));
            found
        };
        // Inside and outside; the normal of a sphere points to its centre.
        for (region, x, distance) in [
            (GrainRegion::Ball(2.0), 1.5, 0.5),
            (GrainRegion::Ball(2.0), 2.5, -0.5),
            (GrainRegion::Ellipsoid([2.0, 3.0, 4.0]), 2.5, -0.5),
            (GrainRegion::Ellipsoid([2.0; 3]), 1.75, 0.25),
            (GrainRegion::Ellipsoid([3.0, 2.0, 1.0]), -5.0, -2.0),
        ] {
            let found = walls(&region, [x, 0.0, 0.0]);
            assert!((found[0].0 - distance).abs() < 1e-11, "{region}: {found:?}"); // a bisection to 1e-12
            assert!((found[0].1 + x.signum() * Vector3::x()).norm() < 1e-11, "{region}: {found:?}");
        }
        let cylinder = GrainRegion::Cylinder { half_height: 1.0, radius: 2.0 };
        let distances: Vec<f64> = walls(&cylinder, [0.0, -1.25, 0.5]).iter().map(|wall| wall.0).collect();
        assert_eq!(distances, [0.75, 0.5, 1.5]);
        // The sum over a closed box: each pair of faces is the full length apart.
        let found = walls(&GrainRegion::Box([1.0, 2.0, 3.0]), [0.5, -0.5, 9.0]);
        let lengths: Vec<f64> = found.chunks(2).map(|pair| pair[0].0 + pair[1].0).collect();
        assert_eq!(lengths, [2.0, 4.0, 6.0]);
        assert_eq!(found.iter().map(|wall| wall.0).fold(f64::INFINITY, f64::min), -6.0);
    }

    proptest! {
        /// The nearest point of an ellipsoid lies on it, and the vector to it is along its normal.
        #[test]
        fn vectors_to_an_ellipsoid_are_normal_to_it(
            axes in prop::array::uniform3(0.5..2.0f64),
            point in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let (axes_vector, point) = (Vector3::from(axes), Vector3::from(point));
            let nearest = nearest_on_ellipsoid(&axes, &point);
            prop_assert!((nearest.component_div(&axes_vector).norm() - 1.0).abs() < 1e-9, "{nearest}");
            let normal = nearest.component_div(&axes_vector).component_div(&axes_vector).normalize();
            let vector = point - nearest;
            // A relative error of 1e-12 of the root, enlarged where the point is near a centre of curvature.
            prop_assert!(vector.cross(&normal).norm() < 1e-8 * (1.0 + vector.norm()), "{vector} {normal}");
        }

        /// Compares with a fine sampling of the surface: no sample is nearer, and one is nearly as near.
        #[test]
        fn distance_is_that_of_the_nearest_surface_point(
            axes in prop::array::uniform3(0.5..2.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            level in 0.0..1.0f64,
            flat in 0..4usize,
        ) {
            let axes_vector = Vector3::from(axes);
            let mut point = Vector3::from(direction).component_mul(&axes_vector);
            if flat < 3 { point[flat] = 0.0 } // the plane across an axis is the special case
            let norm = point.component_div(&axes_vector).norm();
            prop_assume!(norm > 1e-3);
            point *= level / norm;
            let found = distance_to_ellipsoid(&axes, &point);
            let n = 200;
            let spacing = std::f64::consts::PI / n as f64;
            let mut sampled = f64::INFINITY;
            for i in 0..=n {
                for j in 0..2 * n {
                    let (theta, phi) = (i as f64 * spacing, j as f64 * spacing);
                    let unit = Vector3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                    sampled = sampled.min((unit.component_mul(&axes_vector) - point).norm());
                }
            }
            prop_assert!(found <= sampled + 1e-11, "{found} {sampled}");
            // Sample spacing at most pi/200 * 2 = 0.031 in either angle.
            prop_assert!(found >= sampled - 0.04, "{found} {sampled}");
        }
    }
}
