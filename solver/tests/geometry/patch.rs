//! Common part of two bodies, seen along the direction of their contact, by exhaustive search: number of points, positions,
//! depths, area. A corner is any crossing of two of all the sides' lines that no line leaves outside.

use cd_solve::geometry::Manifold;
use cd_solve::math::{Quat, Vec3, local_frame};

use crate::oracle::{Solid, hull};

/// Counts of the compared pairs by kind, to show that all kinds occur.
#[derive(Debug, Default)]
pub struct Tally {
    pub faces_on_faces: usize,
    pub edges_on_faces: usize,
    pub vertices_on_faces: usize,
    pub crossed_edges: usize,
    /// Vertices or parallel edges apart.
    pub nearest: usize,
    /// Pairs by their number of points.
    pub points: [usize; 12],
    /// Pairs with several faces equally aligned with the normal.
    pub several: usize,
    /// Corners are as near to each other as where they become one, or a face is seen as a line.
    pub unsure: usize,
    /// More than four corners.
    pub reduced: usize,
}

impl Tally {
    /// Number of pairs.
    pub fn met(&self) -> usize {
        self.points.iter().sum()
    }
}

/// A face in the world's directions.
struct Face {
    normal: Vec3,
    base: Vec3,
    corners: Vec<usize>,
}

/// A body in the world's directions.
struct Body {
    vertices: Vec<Vec3>,
    faces: Vec<Face>,
    /// Two vertices, two faces.
    edges: Vec<([usize; 2], [usize; 2])>,
}

impl Body {
    fn new(solid: &Solid, q: &Quat, moved: Vec3) -> Self {
        let turned = solid.turned_vertices(q);
        let mut faces: Vec<Face> = Vec::new();
        for t in &solid.triangles {
            let [p, r, s] = t.map(|k| turned[k as usize]);
            let normal = (r - p).cross(&(s - p)).normalize();
            // The distance from a plane up to which vertices belong to it.
            let flat = 1e-10 * solid.radius;
            let corners: Vec<usize> =
                (0..turned.len()).filter(|&k| normal.dot(&(turned[k] - p)).abs() <= flat).collect();
            if faces.iter().all(|face| face.corners != corners) {
                faces.push(Face { normal, base: p + moved, corners });
            }
        }
        let mut edges = Vec::new();
        for (f, face) in faces.iter().enumerate() {
            for (g, other) in faces[..f].iter().enumerate() {
                let both: Vec<usize> = face.corners.iter().copied().filter(|k| other.corners.contains(k)).collect();
                if let [v, w] = both[..] {
                    edges.push(([v, w], [f, g]));
                }
            }
        }
        Body { vertices: turned.iter().map(|v| v + moved).collect(), faces, edges }
    }

    /// How far the body reaches along `n`.
    fn top(&self, n: &Vec3) -> f64 {
        self.vertices.iter().map(|v| n.dot(v)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The vertices that are as far along `n` as any.
    fn level(&self, n: &Vec3, tiny: f64) -> Vec<usize> {
        let top = self.top(n);
        (0..self.vertices.len()).filter(|&k| n.dot(&self.vertices[k]) >= top - tiny).collect()
    }

    /// The face seen along `n`: of the two next to the edge that falls least from the top, the one that looks more along
    /// `n`. Several where that is not clear.
    fn facing(&self, n: &Vec3, level: &[usize]) -> Vec<usize> {
        let fall = |[v, w]: &[usize; 2]| {
            let along = self.vertices[*v] - self.vertices[*w];
            n.dot(&along).abs() / along.norm()
        };
        let of_top: Vec<_> = self.edges.iter().filter(|(ends, _)| ends.iter().any(|v| level.contains(v))).collect();
        let least = of_top.iter().map(|(ends, _)| fall(ends)).fold(f64::INFINITY, f64::min);
        let mut facing = Vec::new();
        for (_, beside) in of_top.into_iter().filter(|(ends, _)| fall(ends) <= least + 1e-8) {
            let toward = beside.map(|f| n.dot(&self.faces[f].normal));
            for k in 0..2 {
                if toward[k] >= toward[1 - k] - 1e-8 && !facing.contains(&beside[k]) {
                    facing.push(beside[k]);
                }
            }
        }
        facing
    }
}

struct Corner {
    at: [f64; 2],
    gap: f64,
}

/// The common part of two faces.
struct Common {
    corners: Vec<Corner>,
    area: f64,
    /// How much a rounding sideways changes a gap.
    steep: f64,
    /// Whether noise decides how many corners there are.
    unsure: bool,
}

impl Common {
    /// `None` where a face is seen as a line.
    fn from_bodies(a: (&Body, usize), b: (&Body, usize), n: &Vec3, small: f64) -> Option<Self> {
        let [_, t, s] = local_frame(*n);
        let seen = |(body, f): (&Body, usize)| {
            let flat = |&k: &usize| [t.dot(&body.vertices[k]), s.dot(&body.vertices[k])];
            hull(&body.faces[f].corners.iter().map(flat).collect::<Vec<_>>())
        };
        let (fa, fb) = (&a.0.faces[a.1], &b.0.faces[b.1]);
        let rises = [fa, fb].map(|face| n.dot(&face.normal));
        if rises.iter().any(|rise| rise.abs() < 1e-6) {
            return None;
        }
        let met = corners(&seen(a), &seen(b), small);
        let height = |face: &Face, rise: f64, [x, y]: [f64; 2]| {
            (face.normal.dot(&face.base) - face.normal.dot(&(t * x + s * y))) / rise
        };
        let mut merged: Vec<Corner> = Vec::new();
        let mut unsure = false;
        for at in &met {
            let away = |corner: &Corner| (corner.at[0] - at[0]).hypot(corner.at[1] - at[1]) / small;
            unsure |= merged.iter().any(|corner| (1e-10..1e-8).contains(&away(corner)));
            if merged.iter().all(|corner| away(corner) > 1e-9) {
                let gap = height(fb, rises[1], *at) - height(fa, rises[0], *at);
                merged.push(Corner { at: *at, gap });
            }
        }
        let steep = rises.iter().map(|rise| 1.0 / rise.abs()).sum();
        Some(Common { corners: merged, area: area(&met), steep, unsure })
    }
}

/// Corners of the common part of two convex polygons, counter-clockwise.
fn corners(p: &[[f64; 2]], q: &[[f64; 2]], small: f64) -> Vec<[f64; 2]> {
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let from_to = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    // Far above rounding, also next to a body a thousand times as large.
    let tiny = 1e-11 * small;
    let mut sides = Vec::new();
    for polygon in [p, q] {
        for (k, &from) in polygon.iter().enumerate() {
            let along = from_to(from, polygon[(k + 1) % polygon.len()]);
            let length = along[0].hypot(along[1]);
            if length > tiny {
                sides.push((from, along.map(|x| x / length)));
            }
        }
    }
    let mut met = Vec::new();
    for (i, &(from, along)) in sides.iter().enumerate() {
        for &(base, other) in &sides[..i] {
            let sine = cross(along, other);
            if sine.abs() < 1e-9 {
                continue; // parallel: corners of theirs are on other lines, too
            }
            let share = cross(from_to(from, base), other) / sine;
            let at = [from[0] + along[0] * share, from[1] + along[1] * share];
            if sides.iter().all(|&(base, u)| cross(u, from_to(base, at)) >= -tiny) {
                met.push(at);
            }
        }
    }
    met
}

/// Area of the hull of points.
fn area(points: &[[f64; 2]]) -> f64 {
    let Some(&[x, y]) = points.first() else { return 0.0 };
    let outline = hull(&points.iter().map(|p| [p[0] - x, p[1] - y]).collect::<Vec<_>>());
    let next = |k: usize| outline[(k + 1) % outline.len()];
    (0..outline.len()).map(|k| 0.5 * (outline[k][0] * next(k)[1] - outline[k][1] * next(k)[0])).sum()
}

/// Area of the common part of a convex polygon, counter-clockwise, and a disc about the origin: by slices across x = radius
/// sin(angle), between positions where a side begins, ends or meets the rim.
fn area_in_disc(polygon: &[[f64; 2]], radius: f64) -> f64 {
    let sides = || (0..polygon.len()).map(|k| (polygon[k], polygon[(k + 1) % polygon.len()]));
    let mut stops = vec![-1.0, 1.0];
    for (p, q) in sides() {
        let (u, v) = (q[0] - p[0], q[1] - p[1]);
        let (square, half) = (u * u + v * v, p[0] * u + p[1] * v);
        let root = half * half - square * (p[0] * p[0] + p[1] * p[1] - radius * radius);
        let shares = if root > 0.0 { [-root.sqrt(), root.sqrt()].map(|root| (root - half) / square) } else { [0.0; 2] };
        stops.extend([0.0, shares[0], shares[1]].map(|share| ((p[0] + u * share) / radius).clamp(-1.0, 1.0)));
    }
    stops.sort_by(f64::total_cmp);
    let slice = |angle: f64| {
        let (x, wide) = (radius * angle.sin(), radius * angle.cos());
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (p, q) in sides().filter(|(p, q)| (p[0] < x) != (q[0] < x)) {
            let y = p[1] + (q[1] - p[1]) * ((x - p[0]) / (q[0] - p[0]));
            (low, high) = (low.min(y), high.max(y));
        }
        (high.min(wide) - low.max(-wide)).max(0.0) * wide
    };
    // Gauss and Legendre's five places, in eight parts.
    let places =
        [(0.0, 0.5688888888888889), (0.5384693101056831, 0.4786286704993665), (0.906179845938664, 0.2369268850561891)];
    let mut sum = 0.0;
    for pair in stops.windows(2) {
        let [from, to] = [pair[0].asin(), pair[1].asin()];
        let half = (to - from) / 16.0;
        for part in 0..8 {
            let middle = from + half * f64::from(2 * part + 1);
            for (k, (place, weight)) in places.into_iter().enumerate() {
                let two = if k == 0 { 0.0 } else { slice(middle - half * place) };
                sum += half * weight * (slice(middle + half * place) + two);
            }
        }
    }
    sum
}

/// Expects the area that the direction `m` makes of the face of a polyhedron at `x` and the end of a cylinder of
/// `[half height, radius]` at the origin along z, and no fewer points than lie flat on it; none on its round side. Returns
/// whether a face lies flat.
pub fn agree_with_cylinder(
    a: &Solid,
    qa: &Quat,
    x: &Vec3,
    [height, radius]: [f64; 2],
    m: &Vec3,
    found: &Manifold,
) -> Result<bool, String> {
    let body = Body::new(a, qa, *x);
    let small = a.radius.min(radius.hypot(height));
    let level = body.level(&-m, 1e-11 * small);
    if m.z.abs() < m.xy().norm() {
        return if found.points.len() <= 2 && found.area == 0.0 { Ok(false) } else { Err("on the side".into()) };
    }
    let flat = level.len() > 2 && m.xy().norm() < 1e-11;
    let deep = found.points.iter().filter(|point| point.gap <= found.gap() + 1e-9 * small).count();
    let mut faults = Vec::new();
    for f in body.facing(&-m, &level) {
        let face = &body.faces[f];
        // Along m down to the plane of the end.
        let foot = |&k: &usize| {
            let v = body.vertices[k];
            let foot = v - m * ((v.z - height.copysign(m.z)) / m.z);
            [foot.x, foot.y]
        };
        let polygon = hull(&face.corners.iter().map(foot).collect::<Vec<_>>());
        let area = area_in_disc(&polygon, radius) * m.z.abs();
        if (found.area - area).abs() <= 1e-9 * small * small {
            let enough = !flat || deep >= 3 || area < 1e-6 * small * small;
            return if enough { Ok(flat) } else { Err(format!("{deep} points of an area")) };
        }
        faults.push(format!("area {area}"));
    }
    Err(faults.join("; or "))
}

/// Two bodies as they were given to the solver.
pub struct Posed<'a> {
    pub a: &'a Solid,
    pub qa: &'a Quat,
    pub b: &'a Solid,
    pub qb: &'a Quat,
    pub c: &'a Vec3,
    pub alert: f64,
}

/// Expects the points and the area that the direction found makes.
pub fn agree(posed: &Posed, found: &Manifold, tally: &mut Tally, what: &dyn Fn() -> String) {
    let Posed { a, qa, b, qb, c, .. } = posed;
    let (size, small) = (a.radius + b.radius, a.radius.min(b.radius));
    let n = -found.normal;
    let (a, b) = (Body::new(a, qa, Vec3::zeros()), Body::new(b, qb, **c));
    let s = -b.top(&-n) - a.top(&n);
    assert!((s - found.gap()).abs() < 1e-12 * size, "{}: {s} along {n}, {found:?}", what());
    tally.points[found.points.len() - 1] += 1;
    // Above noise of directions, below any tilt that is meant.
    let tiny = 1e-11 * small;
    let (of_a, of_b) = (a.level(&n, tiny), b.level(&-n, tiny));
    let alone = match (of_a.len(), of_b.len()) {
        (1, 1 | 2) | (2, 1) => Some(1),
        (2, 2) => {
            let along = |body: &Body, ends: &[usize]| (body.vertices[ends[1]] - body.vertices[ends[0]]).normalize();
            (along(&a, &of_a).cross(&along(&b, &of_b)).norm() < 1e-10).then_some(2)
        }
        _ => None,
    };
    // Vertices or parallel edges nearest to each other share no face.
    if let Some(count) = alone
        && s > tiny
    {
        tally.nearest += 1;
        assert_eq!((found.points.len(), found.area), (count, 0.0), "{}: {found:?}", what());
        return;
    }
    *match (of_a.len(), of_b.len()) {
        (1, _) | (_, 1) => &mut tally.vertices_on_faces,
        (2, 2) => &mut tally.crossed_edges,
        (2, _) | (_, 2) => &mut tally.edges_on_faces,
        _ => &mut tally.faces_on_faces,
    } += 1;
    let mut faults = Vec::new();
    let (seen_of_a, seen_of_b) = (a.facing(&n, &of_a), b.facing(&-n, &of_b));
    tally.several += usize::from(seen_of_a.len() * seen_of_b.len() > 1);
    for &fa in &seen_of_a {
        for &fb in &seen_of_b {
            let Some(common) = Common::from_bodies((&a, fa), (&b, fb), &n, small) else {
                tally.unsure += 1;
                return;
            };
            match same(&common, found, &n, posed.alert, [size, small]) {
                Ok(()) => {
                    tally.unsure += usize::from(common.unsure);
                    tally.reduced += usize::from(common.corners.len() > 4);
                    return;
                }
                Err(fault) => faults.push(fault),
            }
        }
    }
    panic!("{}: {}: {found:?}, {} and {} at the top", what(), faults.join("; or "), of_a.len(), of_b.len());
}

fn same(common: &Common, found: &Manifold, n: &Vec3, alert: f64, [size, small]: [f64; 2]) -> Result<(), String> {
    let Common { corners, area, steep, unsure } = common;
    if (found.area - area).abs() > 1e-9 * small * small {
        return Err(format!("area {area}"));
    }
    let [_, t, s] = local_frame(*n);
    // Sides that cross at a small angle meet somewhere along both.
    let (aside, deep) = (1e-9 * size, 1e-12 * size * steep);
    let shown = || corners.iter().map(|corner| format!("{:?} at {}", corner.at, corner.gap)).collect::<Vec<_>>();
    for point in &*found.points {
        let at = [t.dot(&point.position), s.dot(&point.position)];
        let is = |corner: &Corner| {
            (corner.at[0] - at[0]).hypot(corner.at[1] - at[1]) < aside && (corner.gap - point.gap).abs() < deep
        };
        if !corners.iter().any(is) {
            return Err(format!("no corner at {at:?}, but {:?}", shown()));
        }
    }
    if *unsure {
        return Ok(());
    }
    let [sure, most] = [-deep, deep].map(|more| corners.iter().filter(|corner| corner.gap <= alert + more).count());
    let count = found.points.len();
    if most <= 4 {
        return if (sure..=most).contains(&count) { Ok(()) } else { Err(format!("corners {:?}", shown())) };
    }
    // Of more than four those that hardly stand out may be left out; the others span what all do.
    let kept: Vec<[f64; 2]> = found.points.iter().map(|p| [t.dot(&p.position), s.dot(&p.position)]).collect();
    let listed = corners.iter().filter(|corner| corner.gap <= alert - deep);
    let size = corners.iter().map(|c| (c.at[0] - kept[0][0]).hypot(c.at[1] - kept[0][1])).fold(0.0, f64::max);
    let beyond = listed.map(|corner| outside(&kept, corner.at)).fold(0.0, f64::max);
    if count <= most && count >= 3 && beyond < 0.04 * size + aside {
        Ok(())
    } else {
        Err(format!("{beyond} is outside; of {most} corners {:?}", shown()))
    }
}

/// How far a place is outside the convex polygon of some points: beyond the line of two that have all others on one side.
fn outside(points: &[[f64; 2]], at: [f64; 2]) -> f64 {
    let mut most = 0f64;
    for a in points {
        for b in points {
            let [u, v] = [b[0] - a[0], b[1] - a[1]];
            let beyond = |p: &[f64; 2]| (u * (p[1] - a[1]) - v * (p[0] - a[0])) / u.hypot(v);
            if u.hypot(v) > 0.0 && points.iter().all(|p| beyond(p) <= 0.0) {
                most = most.max(beyond(&at));
            }
        }
    }
    most
}
