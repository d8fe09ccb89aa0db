//! Regions that a user gives: a ball, box, cylinder or layer, at a fixed position or moving with the grains.

use std::str::FromStr;

use crate::derive::fragments::Fragment;
use crate::derive::heights::volume_below;
use crate::derive::region_kind::RegionKind;
use crate::frame::{Frame, Grain};
use crate::math::Vec3;

/// A region as the command line gives it.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    shape: ProbeShape,
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

/// A convex part of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProbeShape {
    /// Centre and radius, m.
    Ball { centre: Vec3, radius: f64 },
    /// Half lengths along x, y and z, m.
    Box { centre: Vec3, half: Vec3 },
    /// Radius and half of the length along the axis, a unit vector; m.
    Cylinder { centre: Vec3, axis: Vec3, radius: f64, half: f64 },
    /// Lower and upper height, m, along a unit vector.
    Layer { up: Vec3, from: f64, to: f64 },
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
            ("ball", &[radius]) if radius > 0.0 => ProbeShape::Ball { centre, radius },
            ("box", &[x, y, z]) if are_positive(&numbers) => ProbeShape::Box { centre, half: 0.5 * Vec3::new(x, y, z) },
            ("cylinder", &[radius, length]) if are_positive(&numbers) => {
                ProbeShape::Cylinder { centre, axis: Vec3::z(), radius, half: 0.5 * length }
            }
            ("cylinder", &[radius, length, x, y, z]) if are_positive(&numbers[..2]) => {
                let axis = Vec3::new(x, y, z).try_normalize(0.0).ok_or_else(fault)?;
                ProbeShape::Cylinder { centre, axis, radius, half: 0.5 * length }
            }
            ("layer", &[from, to]) if from < to && position.is_none() => ProbeShape::Layer { up: Vec3::z(), from, to },
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
    pub fn placed_shape(&self, frame: &Frame, fragments: &[Fragment]) -> Option<ProbeShape> {
        if let ProbeShape::Layer { .. } = self.shape {
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
            ProbeShape::Ball { centre, .. } | ProbeShape::Box { centre, .. } | ProbeShape::Cylinder { centre, .. } => {
                *centre = position
            }
            ProbeShape::Layer { .. } => {}
        }
        Some(shape)
    }
}

/// Number of points of equal weight in a sphere, for cuts without a closed form, and in a tetrahedron of a polyhedron:
/// shares are off by some 10^-3 of a grain.
const POINTS_IN_SPHERE: usize = 4096;
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
    inside: f64,
    all: f64,
}

impl ProbeShape {
    /// Number and name of the region in the tables.
    pub fn region_kind(&self) -> RegionKind {
        match self {
            ProbeShape::Ball { .. } => RegionKind::Ball,
            ProbeShape::Box { .. } => RegionKind::Box,
            ProbeShape::Cylinder { .. } => RegionKind::Cylinder,
            ProbeShape::Layer { .. } => RegionKind::Layer,
        }
    }

    /// Volume, m^3; infinite for a layer.
    pub fn volume(&self) -> f64 {
        let pi = std::f64::consts::PI;
        match self {
            ProbeShape::Ball { radius, .. } => 4.0 / 3.0 * pi * radius.powi(3),
            ProbeShape::Box { half, .. } => 8.0 * half.product(),
            ProbeShape::Cylinder { radius, half, .. } => pi * radius * radius * 2.0 * half,
            ProbeShape::Layer { .. } => f64::INFINITY,
        }
    }

    /// Centre, and half lengths along x, y and z of a bounding box, m; None for a layer.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        match self {
            ProbeShape::Ball { centre, radius } => Some((*centre, Vec3::repeat(*radius))),
            ProbeShape::Box { centre, half } => Some((*centre, *half)),
            ProbeShape::Cylinder { centre, axis, radius, half } => {
                let across = axis.map(|part| (1.0 - part * part).max(0.0).sqrt());
                Some((*centre, axis.abs() * *half + across * *radius))
            }
            ProbeShape::Layer { .. } => None,
        }
    }

    /// Whether a point (m) is inside or on the border.
    pub fn contains(&self, x: &Vec3) -> bool {
        self.inner_distance(x) >= 0.0
    }

    /// Distance to the border, m, for a point inside; for a point outside a negative value, at most that distance in size.
    fn inner_distance(&self, x: &Vec3) -> f64 {
        match self {
            ProbeShape::Ball { centre, radius } => radius - (x - centre).norm(),
            ProbeShape::Box { centre, half } => (half - (x - centre).abs()).min(),
            ProbeShape::Cylinder { centre, axis, radius, half } => {
                let (along, across) = ((x - centre).dot(axis), (x - centre).cross(axis).norm());
                (radius - across).min(half - along.abs())
            }
            ProbeShape::Layer { up, from, to } => (x.dot(up) - from).min(to - x.dot(up)),
        }
    }

    /// Share of a segment that lies inside, exact.
    pub fn share_of_segment(&self, from: &Vec3, to: &Vec3) -> f64 {
        let d = to - from;
        // Interval of t in which low <= start + t step <= high; from 1 to 0 if it is empty.
        let in_slab = |start: f64, step: f64, low: f64, high: f64| -> [f64; 2] {
            if step == 0.0 {
                return if (low..=high).contains(&start) { [0.0, 1.0] } else { [1.0, 0.0] };
            }
            let ends = [(low - start) / step, (high - start) / step];
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        };
        // Interval of t in which |a + t b| <= radius.
        let in_ball = |a: Vec3, b: Vec3, radius: f64| -> [f64; 2] {
            let (square, half, rest) = (b.norm_squared(), a.dot(&b), a.norm_squared() - radius * radius);
            let root = half * half - square * rest;
            if square == 0.0 || root < 0.0 {
                return if square == 0.0 && rest <= 0.0 { [0.0, 1.0] } else { [1.0, 0.0] };
            }
            [(-half - root.sqrt()) / square, (-half + root.sqrt()) / square]
        };
        let intervals: Vec<[f64; 2]> = match self {
            ProbeShape::Ball { centre, radius } => vec![in_ball(from - centre, d, *radius)],
            ProbeShape::Box { centre, half } => {
                (0..3).map(|k| in_slab(from[k] - centre[k], d[k], -half[k], half[k])).collect()
            }
            ProbeShape::Cylinder { centre, axis, radius, half } => {
                let a = from - centre;
                let perpendicular_part = |v: Vec3| v - axis * v.dot(axis);
                vec![
                    in_ball(perpendicular_part(a), perpendicular_part(d), *radius),
                    in_slab(a.dot(axis), d.dot(axis), -half, *half),
                ]
            }
            ProbeShape::Layer { up, from: low, to: high } => vec![in_slab(from.dot(up), d.dot(up), *low, *high)],
        };
        let [first, last] = intervals.iter().fold([0f64, 1f64], |[a, b], [from, to]| [a.max(*from), b.min(*to)]);
        (last - first).max(0.0)
    }

    /// Share of a grain's volume that lies inside; overlapping pieces count separately.
    ///
    /// Exact for spheres cut by a ball, a layer or parallel faces of a box, and for every grain cut by a layer. Other cases
    /// use points of equal weight: `POINTS_IN_SPHERE` and `POINTS_IN_TETRAHEDRON`.
    pub fn share_of_grain(&self, grain: &Grain) -> f64 {
        let (depth, reach) = (self.inner_distance(&grain.x), grain.bounding_radius());
        if depth >= reach || depth <= -reach {
            return f64::from(u8::from(depth > 0.0));
        }
        if let ProbeShape::Layer { up, from, to } = self {
            let grain_volume_below = |height: f64| volume_below(grain, up, height);
            return (grain_volume_below(*to) - grain_volume_below(*from)) / grain_volume_below(f64::INFINITY);
        }
        let ball = |(x, r): (Vec3, f64)| {
            let volume = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
            ContainedVolume { inside: volume * self.share_of_ball(&x, r), all: volume }
        };
        let parts = grain.balls().map(ball).chain([self.polyhedron_volumes(grain)]);
        let sum = parts.fold(ContainedVolume::default(), |sum, part| ContainedVolume {
            inside: sum.inside + part.inside,
            all: sum.all + part.all,
        });
        sum.inside / sum.all
    }

    /// Share of the volume of a ball that lies inside.
    fn share_of_ball(&self, x: &Vec3, r: f64) -> f64 {
        let depth = self.inner_distance(x);
        if depth >= r || depth <= -r {
            return f64::from(u8::from(depth > 0.0));
        }
        // Share of a ball below a plane that is s above its centre.
        let share_below = |s: f64| {
            let s = (s / r).clamp(-1.0, 1.0);
            0.25 * (1.0 + s).powi(2) * (2.0 - s)
        };
        match self {
            ProbeShape::Ball { centre, radius } => {
                let d = (x - centre).norm();
                if d + radius <= r {
                    return (radius / r).powi(3); // the probe within the ball
                }
                // The lens of two spheres at the distance d.
                let lens = std::f64::consts::PI
                    * (radius + r - d).powi(2)
                    * (d * d + 2.0 * d * (r + radius) - 3.0 * (radius - r).powi(2))
                    / (12.0 * d);
                lens / (4.0 / 3.0 * std::f64::consts::PI * r.powi(3))
            }
            ProbeShape::Box { centre, half } => {
                let d = x - centre;
                let crossed: Vec<usize> = (0..3).filter(|&k| half[k] - d[k].abs() < r).collect();
                match crossed[..] {
                    [k] => share_below(half[k] - d[k]) - share_below(-half[k] - d[k]),
                    _ => self.share_of_points(x, r),
                }
            }
            _ => self.share_of_points(x, r),
        }
    }

    /// Share of [`POINTS_IN_SPHERE`] points of a ball that lie inside.
    fn share_of_points(&self, x: &Vec3, r: f64) -> f64 {
        let point_in_ball = |[s, t, u]: [f64; 3]| {
            let (z, (sin, cos)) = (2.0 * t - 1.0, (std::f64::consts::TAU * u).sin_cos());
            let across = (1.0 - z * z).sqrt();
            x + Vec3::new(across * cos, across * sin, z) * (r * s.cbrt())
        };
        even_points(POINTS_IN_SPHERE).map(point_in_ball).filter(|point| self.contains(point)).count() as f64
            / POINTS_IN_SPHERE as f64
    }

    /// Volumes of a grain's polyhedra, by tetrahedra from its centre to triangles of its faces.
    fn polyhedron_volumes(&self, grain: &Grain) -> ContainedVolume {
        let vertices: Vec<Vec3> = grain.vertices().collect();
        let points: Vec<[f64; 3]> = even_points(POINTS_IN_TETRAHEDRON).map(fold_to_tetrahedron).collect();
        let faces = grain.solid.iter().flat_map(|solid| &solid.faces);
        let triangles = faces.flat_map(|face| (2..face.len()).map(|k| [face[0], face[k - 1], face[k]]));
        triangles.fold(ContainedVolume::default(), |sum, triangle| {
            let [a, b, c] = triangle.map(|k| vertices[k as usize] - grain.x);
            let volume = a.dot(&b.cross(&c)) / 6.0;
            let contained =
                points.iter().filter(|[s, t, u]| self.contains(&(grain.x + a * *s + b * *t + c * *u))).count();
            ContainedVolume {
                inside: sum.inside + volume * contained as f64 / points.len() as f64,
                all: sum.all + volume,
            }
        })
    }
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

    fn shape(text: &str) -> ProbeShape {
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
        assert!(matches!(parsed.shape, ProbeShape::Cylinder { axis, half: 1.0, .. } if axis == Vec3::y()));
    }

    #[test]
    fn spheres_that_are_cut_have_their_closed_forms() {
        let box_of = shape("box:2,2,2@0,0,0");
        assert_eq!(box_of.share_of_grain(&ball([1.0, 0.0, 0.0], 0.5)), 0.5);
        assert_eq!(box_of.share_of_grain(&ball([0.2, 0.0, 0.0], 0.5)), 1.0);
        assert_eq!(box_of.share_of_grain(&ball([2.2, 0.0, 0.0], 0.5)), 0.0);
        // At an edge a quarter, at a corner an eighth: by points.
        assert!((box_of.share_of_grain(&ball([1.0, -1.0, 0.0], 0.5)) - 0.25).abs() < 3e-3);
        assert!((box_of.share_of_grain(&ball([1.0, 1.0, 1.0], 0.5)) - 0.125).abs() < 3e-3);
        // The cap of height r/2: (pi h^2 / 3) (3 r - h).
        let cap = 0.25 * (3.0 - 0.5) / 4.0;
        assert!((box_of.share_of_grain(&ball([0.0, 1.25, 0.0], 0.5)) - cap).abs() < 1e-14);
        // Two unit balls 1 apart: a lens of 5 pi / 12; one within the other.
        let unit = shape("ball:1@0,0,0");
        assert!((unit.share_of_grain(&ball([0.0, 1.0, 0.0], 1.0)) - 5.0 / 16.0).abs() < 1e-14);
        assert!((unit.share_of_grain(&ball([0.1, 0.0, 0.0], 2.0)) - 0.125).abs() < 1e-14);
        // On a cylinder's axis at its end: half; far from its end on a wide one nearly half.
        let cylinder = shape("cylinder:200,2,1,0,0@0,0,0");
        assert!((cylinder.share_of_grain(&ball([1.0, 0.0, 0.0], 0.5)) - 0.5).abs() < 3e-3);
        assert!((cylinder.share_of_grain(&ball([0.0, 200.0, 0.0], 0.5)) - 0.5).abs() < 3e-3);
    }

    #[test]
    fn polyhedra_are_cut_too() {
        let box_of = shape("box:2,2,2@0,0,0");
        assert!((box_of.share_of_grain(&cube([1.0, 0.0, 0.0], 0.5)) - 0.5).abs() < 1e-2);
        assert!((box_of.share_of_grain(&cube([1.0, 1.0, 1.0], 0.5)) - 0.125).abs() < 1e-2);
        let layer = shape("layer:0,1");
        assert!((layer.share_of_grain(&cube([0.0, 0.0, 1.25], 0.5)) - 0.25).abs() < 1e-14);
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
