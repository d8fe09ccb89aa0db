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

/// Distance, m, of a point inside an ellipsoid to its surface, to a relative 1e-12.
///
/// The nearest surface point is x_k = a_k^2 p_k / (a_k^2 - c^2 + s), c the shortest semi-axis, with the
/// root s in (0, c^2] of sum (a_k p_k / (a_k^2 - c^2 + s))^2 = 1, whose left side falls with s (Eberly,
/// "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid", 2013, with s = t + c^2).
fn distance_to_ellipsoid(axes: &[f64; 3], point: &Vector3<f64>) -> f64 {
    let short = Vector3::from(*axes).imin();
    let c = axes[short];
    let excess = axes.map(|a| (a - c) * (a + c));
    let mut point = point.abs();
    // In the plane across the shortest axis the root can be lost at s = 0: such a point is moved off it.
    point[short] = point[short].max(1e-12 * c);
    let sum = |s: f64| (0..3).map(|k| (axes[k] * point[k] / (excess[k] + s)).powi(2)).sum::<f64>();
    // At the lower end the term of the shortest axis alone is 1.
    let (mut low, mut high) = (c * point[short], c * c);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if sum(middle) >= 1.0 { low = middle } else { high = middle }
    }
    (Vector3::from_fn(|k, _| axes[k] * axes[k] * point[k] / (excess[k] + low)) - point).norm()
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

    proptest! {
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
