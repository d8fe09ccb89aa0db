//! Convex parts of space over which means are taken, and the shares of balls and segments inside of them.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

/// A convex part of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ConvexRegion {
    /// Centre and radius, m.
    Ball { centre: Vector3<f64>, radius: f64 },
    /// Half lengths along x, y and z, m.
    Box { centre: Vector3<f64>, half: Vector3<f64> },
    /// Radius and half of the length along the axis, a unit vector; m.
    Cylinder { centre: Vector3<f64>, axis: Vector3<f64>, radius: f64, half: f64 },
    /// Lower and upper height, m, along a unit vector.
    Layer { up: Vector3<f64>, from: f64, to: f64 },
}

/// Largest number of images of a periodic cell in a region.
pub const MAX_REGION_IMAGES: f64 = 1e4;

/// Pieces of equal length in which slices of a ball are integrated, by [`GAUSS_POINTS`] each. Areas of slices have kinks
/// where the circle begins to reach a face: shares are off by less than 1e-3, as a test finds.
const SLICED_PIECES: usize = 4;

/// Points and weights of the Gauss-Legendre rule of order 10 on (-1, 1).
const GAUSS_POINTS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

impl ConvexRegion {
    /// Volume, m^3; infinite for a layer.
    pub fn volume(&self) -> f64 {
        match self {
            ConvexRegion::Ball { radius, .. } => 4.0 / 3.0 * PI * radius.powi(3),
            ConvexRegion::Box { half, .. } => 8.0 * half.product(),
            ConvexRegion::Cylinder { radius, half, .. } => PI * radius * radius * 2.0 * half,
            ConvexRegion::Layer { .. } => f64::INFINITY,
        }
    }

    /// Centre, and half lengths along x, y and z of a bounding box, m; None for a layer.
    pub fn bounds(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        match self {
            ConvexRegion::Ball { centre, radius } => Some((*centre, Vector3::repeat(*radius))),
            ConvexRegion::Box { centre, half } => Some((*centre, *half)),
            ConvexRegion::Cylinder { centre, axis, radius, half } => {
                let across = axis.map(|part| (1.0 - part * part).max(0.0).sqrt());
                Some((*centre, axis.abs() * *half + across * *radius))
            }
            ConvexRegion::Layer { .. } => None,
        }
    }

    /// Sums of whole periods along x, y and z that shift positions within `reach` (m) of the cell about the origin into the
    /// region; zero alone without periods and for a layer, which contains the whole cell. None for more than
    /// [`MAX_REGION_IMAGES`].
    pub fn image_shifts(&self, periods: [Option<f64>; 3], reach: f64) -> Option<Vec<Vector3<f64>>> {
        let Some((centre, half)) = self.bounds() else { return Some(vec![Vector3::zeros()]) };
        let counts = [0, 1, 2].map(|axis| {
            let Some(period) = periods[axis] else { return [0.0, 0.0] };
            let over = half[axis] + reach + 0.5 * period;
            [((centre[axis] - over) / period).ceil(), ((centre[axis] + over) / period).floor()]
        });
        let images: f64 = counts.iter().map(|[first, last]| last - first + 1.0).product();
        if images > MAX_REGION_IMAGES {
            return None;
        }
        let axis_shifts = |axis: usize| {
            let period = periods[axis].unwrap_or(0.0);
            let [first, last] = counts[axis].map(|count| count as i64);
            (first..=last).map(move |count| count as f64 * period)
        };
        let mut shifts = Vec::with_capacity(images as usize);
        for x in axis_shifts(0) {
            for y in axis_shifts(1) {
                shifts.extend(axis_shifts(2).map(|z| Vector3::new(x, y, z)));
            }
        }
        Some(shifts)
    }

    /// Whether a point (m) is inside or on the border.
    pub fn contains(&self, x: &Vector3<f64>) -> bool {
        self.inner_distance(x) >= 0.0
    }

    /// Distance to the border, m, for a point inside; for a point outside a negative value, at most that distance in size.
    pub fn inner_distance(&self, x: &Vector3<f64>) -> f64 {
        match self {
            ConvexRegion::Ball { centre, radius } => radius - (x - centre).norm(),
            ConvexRegion::Box { centre, half } => (half - (x - centre).abs()).min(),
            ConvexRegion::Cylinder { centre, axis, radius, half } => {
                let (along, across) = ((x - centre).dot(axis), (x - centre).cross(axis).norm());
                (radius - across).min(half - along.abs())
            }
            ConvexRegion::Layer { up, from, to } => (x.dot(up) - from).min(to - x.dot(up)),
        }
    }

    /// Share of a segment that lies inside, exact.
    pub fn share_of_segment(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
        let d = to - from;
        let overlap = |[a, b]: [f64; 2], [first, last]: [f64; 2]| [a.max(first), b.min(last)];
        let [first, last] = match self {
            ConvexRegion::Ball { centre, radius } => segment_in_ball(from - centre, d, *radius),
            ConvexRegion::Box { centre, half } => {
                (0..3).map(|k| segment_in_slab(from[k] - centre[k], d[k], -half[k], half[k])).fold([0.0, 1.0], overlap)
            }
            ConvexRegion::Cylinder { centre, axis, radius, half } => {
                let a = from - centre;
                let perpendicular_part = |v: Vector3<f64>| v - axis * v.dot(axis);
                overlap(
                    segment_in_ball(perpendicular_part(a), perpendicular_part(d), *radius),
                    segment_in_slab(a.dot(axis), d.dot(axis), -half, *half),
                )
            }
            ConvexRegion::Layer { up, from: low, to: high } => segment_in_slab(from.dot(up), d.dot(up), *low, *high),
        };
        (last.min(1.0) - first.max(0.0)).max(0.0)
    }

    /// Share of the volume of a ball that lies inside.
    ///
    /// Exact for a ball that is cut by a ball or by parallel planes: a layer, opposite faces of a box, the ends of a
    /// cylinder. Other shares are integrals over 20 slices, off by less than 1e-3. A ball whose centre is on a face, and that
    /// no other face reaches, has 1/2.
    pub fn share_of_ball(&self, x: &Vector3<f64>, r: f64) -> f64 {
        let depth = self.inner_distance(x);
        if depth >= r || depth <= -r {
            return f64::from(u8::from(depth > 0.0));
        }
        match self {
            ConvexRegion::Ball { centre, radius } => {
                let d = (x - centre).norm();
                if d + radius <= r {
                    return (radius / r).powi(3); // the region within the ball
                }
                // The lens of two spheres at the distance d.
                let lens =
                    PI * (radius + r - d).powi(2) * (d * d + 2.0 * d * (r + radius) - 3.0 * (radius - r).powi(2))
                        / (12.0 * d);
                lens / (4.0 / 3.0 * PI * r.powi(3))
            }
            ConvexRegion::Layer { up, from, to } => share_between(from - x.dot(up), to - x.dot(up), r),
            ConvexRegion::Box { centre, half } => {
                let d = x - centre;
                let [low, high] = [-half - d, half - d];
                let is_crossed = |k: usize| half[k] - d[k].abs() < r;
                match [is_crossed(0), is_crossed(1), is_crossed(2)] {
                    [true, false, false] => share_between(low.x, high.x, r),
                    [false, true, false] => share_between(low.y, high.y, r),
                    [false, false, true] => share_between(low.z, high.z, r),
                    _ => share_by_slices([low.z, high.z], r, SLICED_PIECES, |slice| {
                        disc_quadrant(high.x, high.y, slice)
                            - disc_quadrant(low.x, high.y, slice)
                            - disc_quadrant(high.x, low.y, slice)
                            + disc_quadrant(low.x, low.y, slice)
                    }),
                }
            }
            ConvexRegion::Cylinder { centre, axis, radius, half } => {
                let (along, across) = ((x - centre).dot(axis), (x - centre).cross(axis).norm());
                let [low, high] = [-half - along, half - along];
                if across + r <= *radius {
                    return share_between(low, high, r);
                }
                share_by_slices([low, high], r, SLICED_PIECES, |slice| disc_overlap(across, slice, *radius))
            }
        }
    }
}

/// Interval of t in which low <= start + t step <= high; from 1 to 0 if it is empty.
fn segment_in_slab(start: f64, step: f64, low: f64, high: f64) -> [f64; 2] {
    if step == 0.0 {
        return if (low..=high).contains(&start) { [0.0, 1.0] } else { [1.0, 0.0] };
    }
    let ends = [(low - start) / step, (high - start) / step];
    [ends[0].min(ends[1]), ends[0].max(ends[1])]
}

/// Interval of t in which |a + t b| <= radius; from 1 to 0 if it is empty.
fn segment_in_ball(a: Vector3<f64>, b: Vector3<f64>, radius: f64) -> [f64; 2] {
    let (square, half, rest) = (b.norm_squared(), a.dot(&b), a.norm_squared() - radius * radius);
    let root = half * half - square * rest;
    if square == 0.0 || root < 0.0 {
        return if square == 0.0 && rest <= 0.0 { [0.0, 1.0] } else { [1.0, 0.0] };
    }
    [(-half - root.sqrt()) / square, (-half + root.sqrt()) / square]
}

/// Share of a ball of radius `r` between two parallel planes, `low` and `high` above its centre.
fn share_between(low: f64, high: f64, r: f64) -> f64 {
    let share_below = |s: f64| {
        let s = (s / r).clamp(-1.0, 1.0);
        0.25 * (1.0 + s).powi(2) * (2.0 - s)
    };
    share_below(high) - share_below(low)
}

/// Share of a ball of radius `r` in a prism with these ends above its centre. `area` is the area in the prism of the slice of
/// the ball with the given radius.
fn share_by_slices(ends: [f64; 2], r: f64, pieces: usize, area: impl Fn(f64) -> f64) -> f64 {
    let [low, high] = ends.map(|end| end.clamp(-r, r));
    let half_piece = 0.5 * (high - low) / pieces as f64;
    let mut volume = 0.0;
    for piece in 0..pieces {
        let middle = low + (2 * piece + 1) as f64 * half_piece;
        for (point, weight) in GAUSS_POINTS {
            let height = middle + point * half_piece;
            volume += weight * half_piece * area((r * r - height * height).max(0.0).sqrt());
        }
    }
    volume / (4.0 / 3.0 * PI * r.powi(3))
}

/// Area of the part with x <= a and y <= b of the disc of this radius about the origin. With a = b = 0 it is π radius²/4.
fn disc_quadrant(a: f64, b: f64, radius: f64) -> f64 {
    let (a, b) = (a.clamp(-radius, radius), b.clamp(-radius, radius));
    // Area of the disc below a chord.
    let area_below = |c: f64| radius * radius * (FRAC_PI_2 + angle(c, radius)) + c * half_chord(c, radius);
    if a * a + b * b < radius * radius {
        let sector = 0.5 * radius * radius * (angle(a, radius) + angle(b, radius) + FRAC_PI_2);
        return a * b + 0.5 * (a * half_chord(a, radius) + b * half_chord(b, radius)) + sector;
    }
    match (a > 0.0, b > 0.0) {
        (true, true) => area_below(a) + area_below(b) - PI * radius * radius,
        (false, true) => area_below(a),
        (true, false) => area_below(b),
        (false, false) => 0.0,
    }
}

/// Area that two discs share whose centres are a distance `d` apart.
fn disc_overlap(d: f64, a: f64, b: f64) -> f64 {
    if d + a.min(b) <= a.max(b) {
        return PI * a.min(b).powi(2);
    }
    if d >= a + b {
        return 0.0;
    }
    // Distance of the common chord from the centre of `a`.
    let chord = 0.5 * (d + (a - b) * (a + b) / d);
    let area_beyond =
        |c: f64, radius: f64| radius * radius * (FRAC_PI_2 - angle(c, radius)) - c * half_chord(c, radius);
    area_beyond(chord, a) + area_beyond(d - chord, b)
}

fn angle(c: f64, radius: f64) -> f64 {
    if radius > 0.0 { libm::asin((c / radius).clamp(-1.0, 1.0)) } else { 0.0 }
}

/// Half length of the chord at the distance `c` from the centre of a disc.
fn half_chord(c: f64, radius: f64) -> f64 {
    ((radius - c) * (radius + c)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_box() -> ConvexRegion {
        ConvexRegion::Box { centre: Vector3::zeros(), half: Vector3::repeat(1.0) }
    }

    #[test]
    fn balls_at_edges_and_corners_have_their_shares() {
        let share = |x: [f64; 3]| unit_box().share_of_ball(&x.into(), 0.5);
        assert_eq!(share([1.0, 0.0, 0.0]), 0.5);
        // An area of slices without kinks is a polynomial, which the rule integrates exactly.
        for edge in [[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [-1.0, 0.0, -1.0]] {
            assert!((share(edge) - 0.25).abs() < 1e-14, "{edge:?}: {}", share(edge));
        }
        assert!((share([1.0, -1.0, 1.0]) - 0.125).abs() < 1e-14);
        // A ball that the box is within.
        assert!((unit_box().share_of_ball(&Vector3::zeros(), 4.0) - 8.0 / (4.0 / 3.0 * PI * 64.0)).abs() < 1e-14);
    }

    #[test]
    fn shares_of_the_eight_boxes_about_a_point_add_up_to_one() {
        let offsets = [-8.0, 8.0];
        let corners = offsets.map(|x| offsets.map(|y| offsets.map(|z| Vector3::new(x, y, z))));
        for k in 0..50 {
            let x = [0.117, 0.231, 0.353].map(|step| (k as f64 * step).fract() - 0.5);
            let share = |centre: &Vector3<f64>| {
                let half = Vector3::repeat(8.0);
                ConvexRegion::Box { centre: *centre, half }.share_of_ball(&x.into(), 0.75)
            };
            // The kinks of a box and its neighbours are the same, and upper and lower boxes are sliced in other pieces.
            let sum: f64 = corners.iter().flatten().flatten().map(share).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        }
    }

    #[test]
    fn few_slices_agree_with_many() {
        let mut largest = 0.0f64;
        for k in 0..400 {
            let [across, low, height, x, y, b] =
                [0.117, 0.231, 0.353, 0.419, 0.547, 0.681].map(|step| (k as f64 * step).fract());
            let (ends, radius) = ([2.0 * low - 1.0, 2.0 * low - 1.0 + 2.0 * height], 0.3 + 2.0 * b);
            let error = |area: &dyn Fn(f64) -> f64| {
                share_by_slices(ends, 1.0, SLICED_PIECES, area) - share_by_slices(ends, 1.0, 400, area)
            };
            let of_cylinder = error(&|slice| disc_overlap(radius - 1.0 + 2.0 * across, slice, radius));
            let of_edge = error(&|slice| disc_quadrant(2.0 * x - 1.0, 2.0 * y - 1.0, slice));
            largest = largest.max(of_cylinder.abs()).max(of_edge.abs());
        }
        // The error that the docs state.
        assert!(largest < 1e-3, "{largest}");
    }

    #[test]
    fn slices_agree_with_points() {
        let cylinder = ConvexRegion::Cylinder { centre: Vector3::zeros(), axis: Vector3::z(), radius: 1.0, half: 1.0 };
        let thin = ConvexRegion::Cylinder { centre: Vector3::zeros(), axis: Vector3::x(), radius: 0.2, half: 0.3 };
        let r = 0.5;
        let count = 40;
        let grid = |k: usize| ((2 * k + 1) as f64 / count as f64 - 1.0) * r;
        let arms = || (0..count * count * count).map(|k| [k % count, k / count % count, k / count / count].map(grid));
        let all = arms().filter(|arm| Vector3::from(*arm).norm_squared() <= r * r).count() as f64;
        for (region, x) in [
            (unit_box(), [0.8, 0.9, 0.1]),
            (unit_box(), [1.2, 0.75, -0.7]),
            (unit_box(), [-0.7, 1.1, 1.05]),
            (cylinder, [0.5, 0.6, 0.0]),
            (cylinder, [0.0, -1.2, 0.8]),
            (cylinder, [0.1, 0.0, 1.1]),
            (thin, [0.05, 0.1, 0.0]),
        ] {
            let x = Vector3::from(x);
            let is_inside = |arm: &Vector3<f64>| arm.norm_squared() <= r * r && region.contains(&(x + arm));
            let expected = arms().filter(|arm| is_inside(&Vector3::from(*arm))).count() as f64 / all;
            let found = region.share_of_ball(&x, r);
            // Faces along the grid are off by up to half of its 40 points across the ball.
            assert!((found - expected).abs() < 2e-2, "{region:?}, {x:?}: {found} is not {expected}");
        }
    }

    #[test]
    fn images_cover_a_region_wider_than_the_cell() {
        let wide = ConvexRegion::Box { centre: Vector3::new(3.0, 0.0, 0.0), half: Vector3::new(4.0, 1.0, 1.0) };
        let shifts = wide.image_shifts([Some(2.0), None, None], 0.5).unwrap();
        // Positions from -1.5 to 1.5 m reach -1 to 7 m with -1 to 4 periods.
        assert_eq!(shifts.iter().map(|shift| shift.x).collect::<Vec<_>>(), [-2.0, 0.0, 2.0, 4.0, 6.0, 8.0]);
        // Along z positions from -1.5 to 1.5 m reach -1 to 1 m with -1 to 1 periods.
        assert_eq!(wide.image_shifts([Some(2.0), None, Some(2.0)], 0.5).unwrap().len(), 6 * 3);
        let huge = ConvexRegion::Ball { centre: Vector3::zeros(), radius: 1e9 };
        assert_eq!(huge.image_shifts([Some(1.0), None, None], 0.5), None);
        assert_eq!(huge.image_shifts([None; 3], 0.5).map(|shifts| shifts.len()), Some(1));
    }
}
