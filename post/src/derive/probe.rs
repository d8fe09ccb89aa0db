//! Regions that a user gives: a ball, box, cylinder or layer, at a fixed position or moving with the grains.

use std::str::FromStr;

use cd_formats::geometry::convex_region::ConvexRegion;

use crate::derive::fragments::Fragment;
use crate::derive::heights::volume_below;
use crate::derive::region_kind::RegionKind;
use crate::frame::{Frame, Grain};
use crate::math::Vec3;

/// A region as the command line gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    shape: ConvexRegion,
    centre: ProbeCentre,
}

/// Position of the centre of a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ProbeCentre {
    /// Fixed position, m.
    Fixed(Vec3),
    /// Centre of mass of all grains.
    CentreOfMass,
    /// Centre of mass of the largest remnant of touching grains.
    Largest,
}

/// Forms of a probe, as messages list them.
const EXPECTED_PROBE: &str = "expected ball:RADIUS, box:X,Y,Z, cylinder:RADIUS,LENGTH or cylinder:RADIUS,LENGTH,AXIS_X,AXIS_Y,AXIS_Z, \
                        each with @X,Y,Z, @com or @largest for its centre, or layer:FROM,TO above the floor; lengths in m, > 0";

/// Text that is no probe; the message lists the forms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProbeError;

impl std::fmt::Display for ProbeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(EXPECTED_PROBE)
    }
}

impl std::error::Error for ProbeError {}

impl FromStr for Probe {
    type Err = ProbeError;

    fn from_str(text: &str) -> Result<Probe, ProbeError> {
        let fault = || ProbeError;
        let (shape, position) = text.split_once('@').map_or((text, None), |(shape, position)| (shape, Some(position)));
        let (name, numbers) = shape.split_once(':').ok_or_else(fault)?;
        let list = |text: &str| -> Option<Vec<f64>> {
            text.split(',').map(|x| x.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect()
        };
        let numbers = list(numbers).ok_or_else(fault)?;
        let centre = Vec3::zeros();
        let are_positive = |lengths: &[f64]| lengths.iter().all(|x| *x > 0.0);
        let shape = match (name.trim(), &numbers[..]) {
            ("ball", &[radius]) if radius > 0.0 => ConvexRegion::Ball { centre, radius },
            ("box", &[x, y, z]) if are_positive(&numbers) => {
                ConvexRegion::Box { centre, half: 0.5 * Vec3::new(x, y, z) }
            }
            ("cylinder", &[radius, length]) if are_positive(&numbers) => {
                ConvexRegion::Cylinder { centre, axis: Vec3::z(), radius, half: 0.5 * length }
            }
            ("cylinder", &[radius, length, x, y, z]) if are_positive(&numbers[..2]) => {
                let axis = Vec3::new(x, y, z).try_normalize(0.0).ok_or_else(fault)?;
                ConvexRegion::Cylinder { centre, axis, radius, half: 0.5 * length }
            }
            ("layer", &[from, to]) if from < to && position.is_none() => {
                ConvexRegion::Layer { up: Vec3::z(), from, to }
            }
            _ => return Err(fault()),
        };
        let probe_centre = match position.map(str::trim) {
            None | Some("com") => ProbeCentre::CentreOfMass,
            Some("largest") => ProbeCentre::Largest,
            Some(position) => match list(position).as_deref() {
                Some(&[x, y, z]) => ProbeCentre::Fixed(Vec3::new(x, y, z)),
                _ => return Err(fault()),
            },
        };
        Ok(Probe { shape, centre: probe_centre })
    }
}

impl Probe {
    /// Returns the shape at its position in a frame; of a layer the heights above the floor. None without grains.
    pub fn placed_shape(&self, frame: &Frame, fragments: &[Fragment]) -> Option<ConvexRegion> {
        if let ConvexRegion::Layer { .. } = self.shape {
            return Some(self.shape);
        }
        let position = match self.centre {
            ProbeCentre::Fixed(x) => x,
            ProbeCentre::CentreOfMass if frame.grains.is_empty() => return None,
            ProbeCentre::CentreOfMass => frame.grains.iter().map(|g| g.mass * g.x).sum::<Vec3>() / frame.total_mass(),
            ProbeCentre::Largest => fragments.first()?.sums.x,
        };
        let mut shape = self.shape;
        match &mut shape {
            ConvexRegion::Ball { centre, .. }
            | ConvexRegion::Box { centre, .. }
            | ConvexRegion::Cylinder { centre, .. } => *centre = position,
            ConvexRegion::Layer { .. } => {}
        }
        Some(shape)
    }
}

/// Number of points of equal weight in a tetrahedron of a polyhedron: shares are off by some 10^-3 of a grain.
const POINTS_IN_TETRAHEDRON: usize = 512;

/// Points spread evenly in the unit cube: M. Roberts (2018), the additive recurrence R_3.
fn even_points(count: usize) -> impl Iterator<Item = [f64; 3]> {
    // Powers of the inverse of the root of x^4 = x + 1.
    let step = 1.0 / 1.220_744_084_605_759_5;
    (1..=count).map(move |k| [1, 2, 3].map(|power| (0.5 + k as f64 * f64::powi(step, power)).fract()))
}

/// Volume of a grain or of parts of it, m^3.
#[derive(Default)]
struct ContainedVolume {
    /// Volume inside of a probe.
    contained: f64,
    total: f64,
}

/// Number and name of a region in the tables.
pub fn region_kind(region: &ConvexRegion) -> RegionKind {
    match region {
        ConvexRegion::Ball { .. } => RegionKind::Ball,
        ConvexRegion::Box { .. } => RegionKind::Box,
        ConvexRegion::Cylinder { .. } => RegionKind::Cylinder,
        ConvexRegion::Layer { .. } => RegionKind::Layer,
    }
}

/// Share of a grain's volume that lies in a region; overlapping pieces count separately.
///
/// Exact for every grain cut by a layer. Spheres otherwise have [`ConvexRegion::share_of_ball`], polyhedra points of equal
/// weight, `POINTS_IN_TETRAHEDRON`.
pub fn share_of_grain(region: &ConvexRegion, grain: &Grain) -> f64 {
    let (depth, reach) = (region.inner_distance(&grain.x), grain.bounding_radius());
    if depth >= reach || depth <= -reach {
        return f64::from(u8::from(depth > 0.0));
    }
    if let ConvexRegion::Layer { up, from, to } = region {
        let grain_volume_below = |height: f64| volume_below(grain, up, height);
        return (grain_volume_below(*to) - grain_volume_below(*from)) / grain_volume_below(f64::INFINITY);
    }
    let ball = |(x, r): (Vec3, f64)| {
        let volume = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        ContainedVolume { contained: volume * region.share_of_ball(&x, r), total: volume }
    };
    let parts = grain.balls().map(ball).chain([polyhedron_volumes(region, grain)]);
    let sum = parts.fold(ContainedVolume::default(), |sum, part| ContainedVolume {
        contained: sum.contained + part.contained,
        total: sum.total + part.total,
    });
    sum.contained / sum.total
}

/// Volumes of a grain's polyhedra, by tetrahedra from its centre to triangles of its faces.
fn polyhedron_volumes(region: &ConvexRegion, grain: &Grain) -> ContainedVolume {
    let vertices: Vec<Vec3> = grain.vertices().collect();
    let points: Vec<[f64; 3]> = even_points(POINTS_IN_TETRAHEDRON).map(fold_to_tetrahedron).collect();
    let faces = grain.solid.iter().flat_map(|solid| &solid.faces);
    let triangles = faces.flat_map(|face| (2..face.len()).map(|k| [face[0], face[k - 1], face[k]]));
    triangles.fold(ContainedVolume::default(), |sum, triangle| {
        let [a, b, c] = triangle.map(|k| vertices[k as usize] - grain.x);
        let volume = a.dot(&b.cross(&c)) / 6.0;
        let count = points.iter().filter(|[s, t, u]| region.contains(&(grain.x + a * *s + b * *t + c * *u))).count();
        ContainedVolume {
            contained: sum.contained + volume * count as f64 / points.len() as f64,
            total: sum.total + volume,
        }
    })
}

/// A point of the unit cube folded to the tetrahedron s + t + u <= 1, evenly.
///
/// Source: Rocchini & Cignoni (2000), "Generating random points in a tetrahedron".
fn fold_to_tetrahedron([mut s, mut t, mut u]: [f64; 3]) -> [f64; 3] {
    if s + t > 1.0 {
        (s, t) = (1.0 - s, 1.0 - t);
    }
    if t + u > 1.0 {
        (t, u) = (1.0 - u, 1.0 - s - t);
    } else if s + t + u > 1.0 {
        (s, u) = (1.0 - t - u, s + t + u - 1.0);
    }
    [s, t, u]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    fn shape(text: &str) -> ConvexRegion {
        text.parse::<Probe>().unwrap().placed_shape(&Scene::default().frame(), &[]).unwrap()
    }

    fn ball(x: [f64; 3], radius: f64) -> Grain {
        let mut scene = Scene::default();
        scene.grain(x, radius);
        scene.frame().grains.remove(0)
    }

    fn cube(x: [f64; 3], half: f64) -> Grain {
        let mut scene = Scene::default();
        scene.cube(x, half);
        scene.frame().grains.remove(0)
    }

    #[test]
    fn what_is_no_probe_is_rejected() {
        for text in [
            "",
            "ball",
            "ball:",
            "ball:0",
            "ball:-1",
            "ball:1,2",
            "ball:inf",
            "box:1,2",
            "layer:2,1",
            "layer:1,2@com",
            "cylinder:1,2,0,0,0",
            "ball:1@",
            "ball:1@1,2",
            "cone:1",
        ] {
            assert!(text.parse::<Probe>().unwrap_err().to_string().contains("expected ball:RADIUS"), "{text}");
        }
        let parsed: Probe = "cylinder: 1, 2, 0, 3, 0 @ largest".parse().unwrap();
        assert_eq!(parsed.centre, ProbeCentre::Largest);
        assert!(matches!(parsed.shape, ConvexRegion::Cylinder { axis, half: 1.0, .. } if axis == Vec3::y()));
    }

    #[test]
    fn spheres_that_are_cut_have_their_closed_forms() {
        let box_of = shape("box:2,2,2@0,0,0");
        assert_eq!(share_of_grain(&box_of, &ball([1.0, 0.0, 0.0], 0.5)), 0.5);
        assert_eq!(share_of_grain(&box_of, &ball([0.2, 0.0, 0.0], 0.5)), 1.0);
        assert_eq!(share_of_grain(&box_of, &ball([2.2, 0.0, 0.0], 0.5)), 0.0);
        // At an edge a quarter, at a corner an eighth.
        assert!((share_of_grain(&box_of, &ball([1.0, -1.0, 0.0], 0.5)) - 0.25).abs() < 1e-14);
        assert!((share_of_grain(&box_of, &ball([1.0, 1.0, 1.0], 0.5)) - 0.125).abs() < 1e-14);
        // The cap of height r/2: (pi h^2 / 3) (3 r - h).
        let cap = 0.25 * (3.0 - 0.5) / 4.0;
        assert!((share_of_grain(&box_of, &ball([0.0, 1.25, 0.0], 0.5)) - cap).abs() < 1e-14);
        // Two unit balls 1 apart: a lens of 5 pi / 12; one within the other.
        let unit = shape("ball:1@0,0,0");
        assert!((share_of_grain(&unit, &ball([0.0, 1.0, 0.0], 1.0)) - 5.0 / 16.0).abs() < 1e-14);
        assert!((share_of_grain(&unit, &ball([0.1, 0.0, 0.0], 2.0)) - 0.125).abs() < 1e-14);
        // On a cylinder's axis at its end: half; far from its end on a wide one nearly half.
        let cylinder = shape("cylinder:200,2,1,0,0@0,0,0");
        assert!((share_of_grain(&cylinder, &ball([1.0, 0.0, 0.0], 0.5)) - 0.5).abs() < 1e-14);
        assert!((share_of_grain(&cylinder, &ball([0.0, 200.0, 0.0], 0.5)) - 0.5).abs() < 3e-3);
    }

    #[test]
    fn polyhedra_are_cut_too() {
        let box_of = shape("box:2,2,2@0,0,0");
        assert!((share_of_grain(&box_of, &cube([1.0, 0.0, 0.0], 0.5)) - 0.5).abs() < 1e-2);
        assert!((share_of_grain(&box_of, &cube([1.0, 1.0, 1.0], 0.5)) - 0.125).abs() < 1e-2);
        let layer = shape("layer:0,1");
        assert!((share_of_grain(&layer, &cube([0.0, 0.0, 1.25], 0.5)) - 0.25).abs() < 1e-14);
    }

    #[test]
    fn segments_have_the_share_of_their_length() {
        let [a, b] = [Vec3::new(-2.0, 0.0, 0.0), Vec3::new(2.0, 0.0, 0.0)];
        for text in ["ball:1@0,0,0", "box:2,9,9@0,0,0", "cylinder:1,9@0,0,0", "cylinder:9,2,1,0,0@0,0,0"] {
            let found = shape(text);
            assert_eq!(found.share_of_segment(&a, &b), 0.5, "{text}");
            assert_eq!(found.share_of_segment(&b, &a), 0.5);
            let up = Vec3::z() * 20.0;
            assert_eq!(found.share_of_segment(&(a + up), &(b + up)), 0.0);
        }
        assert_eq!(shape("layer:0,1").share_of_segment(&Vec3::zeros(), &(Vec3::z() * 4.0)), 0.25);
        assert_eq!(shape("layer:0,1").share_of_segment(&a, &b), 1.0);
    }
}
