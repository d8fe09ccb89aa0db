//! Expected contact geometry by exhaustive search, independent of the solver's code.

use cd_solve::geometry::Polyhedron;
use cd_solve::math::{Quat, Vec3};

/// A closed outward surface about its body's centre, with what the solver makes of it.
#[derive(Clone)]
pub struct Solid {
    pub vertices: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub shape: Polyhedron,
    pub radius: f64,
}

impl Solid {
    pub fn new(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let shape = Polyhedron::new(&vertices, &triangles).unwrap_or_else(|fault| panic!("{fault}: {vertices:?}"));
        let radius = shape.circumradius();
        Solid { vertices, triangles, shape, radius }
    }

    /// Corners after a turn.
    pub fn turned_vertices(&self, q: &Quat) -> Vec<Vec3> {
        let turn = q.to_rotation_matrix();
        self.vertices.iter().map(|v| turn * v).collect()
    }

    fn edges(&self) -> Vec<[usize; 2]> {
        let mut edges: Vec<[usize; 2]> = Vec::new();
        for t in &self.triangles {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                if a < b {
                    edges.push([a as usize, b as usize]);
                }
            }
        }
        edges
    }
}

/// The cross product of (b - a) and (d - c), as if computed with twice the digits.
fn cross(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> Vec3 {
    // A sum and its rounding error.
    let two_sum = |x: f64, y: f64| {
        let s = x + y;
        let z = s - x;
        (s, (x - (s - z)) + (y - z))
    };
    let product = |(x, dx): (f64, f64), (y, dy): (f64, f64)| {
        let p = x * y;
        (p, x.mul_add(y, -p) + (x * dy + dx * y))
    };
    let u: Vec<(f64, f64)> = (0..3).map(|k| two_sum(b[k], -a[k])).collect();
    let v: Vec<(f64, f64)> = (0..3).map(|k| two_sum(d[k], -c[k])).collect();
    let minor = |i: usize, j: usize| {
        let (p, dp) = product(u[i], v[j]);
        let (q, dq) = product(u[j], v[i]);
        let (s, ds) = two_sum(p, -q);
        s + (ds + (dp - dq))
    };
    Vec3::new(minor(1, 2), minor(2, 0), minor(0, 1))
}

/// Distance, or minus the least translation that parts the bodies, and the direction of it from A to B.
pub fn separation(a: &Solid, qa: &Quat, b: &Solid, qb: &Quat, c: &Vec3) -> (f64, Vec3) {
    let (va, vb) = (a.turned_vertices(qa), b.turned_vertices(qb).iter().map(|v| v + c).collect::<Vec<_>>());
    let mut best = (f64::NEG_INFINITY, Vec3::zeros());
    let mut try_axis = |n: Vec3| {
        let length = n.norm();
        if length == 0.0 {
            return;
        }
        let n = n / length;
        let range = |v: &[Vec3]| {
            v.iter().map(|v| n.dot(v)).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)))
        };
        let ((low_a, high_a), (low_b, high_b)) = (range(&va), range(&vb));
        for (s, n) in [(low_b - high_a, n), (low_a - high_b, -n)] {
            if s > best.0 {
                best = (s, n);
            }
        }
    };
    for (v, triangles) in [(&va, &a.triangles), (&vb, &b.triangles)] {
        for t in triangles {
            let [p, q, r] = t.map(|k| &v[k as usize]);
            try_axis(cross(p, q, p, r));
        }
    }
    let (edges_a, edges_b) = (a.edges(), b.edges());
    for [i, j] in &edges_a {
        for [k, l] in &edges_b {
            try_axis(cross(&va[*i], &va[*j], &vb[*k], &vb[*l]));
        }
    }
    if best.0 <= 0.0 {
        return best;
    }
    // Apart: the least distance of features.
    let mut nearest = (f64::INFINITY, best.1);
    let mut take = |from: Vec3, to: Vec3| {
        let between = to - from;
        if between.norm() < nearest.0 {
            nearest = (between.norm(), if between == Vec3::zeros() { best.1 } else { between.normalize() });
        }
    };
    for v in &vb {
        a.triangles.iter().for_each(|t| take(on_triangle(v, &t.map(|k| va[k as usize])), *v));
    }
    for v in &va {
        b.triangles.iter().for_each(|t| take(*v, on_triangle(v, &t.map(|k| vb[k as usize]))));
    }
    for [i, j] in &edges_a {
        for [k, l] in &edges_b {
            let (p, q) = between_segments(&va[*i], &va[*j], &vb[*k], &vb[*l]);
            take(p, q);
        }
    }
    nearest
}

/// Signed distance of the point `c` from a solid and the direction to it; inside, through the nearest face.
pub fn nearest_to(a: &Solid, q: &Quat, c: &Vec3) -> (f64, Vec3) {
    let v = a.turned_vertices(q);
    let planes = a.triangles.iter().map(|t| {
        let [p, r, s] = t.map(|k| v[k as usize]);
        let n = cross(&p, &r, &p, &s).normalize();
        (n.dot(&(c - p)), n)
    });
    let inside = planes.max_by(|x, y| x.0.total_cmp(&y.0)).unwrap();
    if inside.0 <= 0.0 {
        return inside;
    }
    let points = a.triangles.iter().map(|t| on_triangle(c, &t.map(|k| v[k as usize])));
    let point = points.min_by(|x, y| (x - c).norm().total_cmp(&(y - c).norm())).unwrap();
    ((c - point).norm(), (c - point).normalize())
}

fn on_segment(p: &Vec3, a: &Vec3, b: &Vec3) -> Vec3 {
    let u = b - a;
    a + u * ((p - a).dot(&u) / u.norm_squared()).clamp(0.0, 1.0)
}

/// The point of a triangle nearest to `p`.
fn on_triangle(p: &Vec3, [a, b, c]: &[Vec3; 3]) -> Vec3 {
    let n = cross(a, b, a, c).normalize();
    let foot = p - n * (p - a).dot(&n);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|(u, v)| (*v - *u).cross(&(foot - *u)).dot(&n) >= 0.0);
    let sides = [on_segment(p, a, b), on_segment(p, b, c), on_segment(p, c, a)];
    let side = sides.into_iter().min_by(|x, y| (x - p).norm().total_cmp(&(y - p).norm())).unwrap();
    if inside && (foot - p).norm() < (side - p).norm() { foot } else { side }
}

/// Nearest points of two segments.
fn between_segments(a: &Vec3, b: &Vec3, c: &Vec3, d: &Vec3) -> (Vec3, Vec3) {
    let ends =
        [(*a, on_segment(a, c, d)), (*b, on_segment(b, c, d)), (on_segment(c, a, b), *c), (on_segment(d, a, b), *d)];
    let mut best = ends.into_iter().min_by(|x, y| (x.0 - x.1).norm().total_cmp(&(y.0 - y.1).norm())).unwrap();
    let n = cross(a, b, c, d);
    if n.norm() > 0.0 {
        let (u, v, w, nn) = (b - a, d - c, c - a, n.norm_squared());
        let (x, y) = (w.cross(&v).dot(&n) / nn, w.cross(&u).dot(&n) / nn);
        let inside = |x: f64| (0.0..=1.0).contains(&x);
        let (p, q) = (a + u * x, c + v * y);
        if inside(x) && inside(y) && (p - q).norm() < (best.0 - best.1).norm() {
            best = (p, q);
        }
    }
    best
}

/// Area common to two convex polygons in the plane, each in any order: hulls, then clipping.
pub fn common_area(p: &[[f64; 2]], q: &[[f64; 2]]) -> f64 {
    let (mut clipped, by) = (hull(p), hull(q));
    for k in 0..by.len() {
        let (a, b) = (by[k], by[(k + 1) % by.len()]);
        let side = |x: &[f64; 2]| (b[0] - a[0]) * (x[1] - a[1]) - (b[1] - a[1]) * (x[0] - a[0]);
        let mut next = Vec::new();
        for i in 0..clipped.len() {
            let (u, v) = (clipped[i], clipped[(i + 1) % clipped.len()]);
            let (du, dv) = (side(&u), side(&v));
            if du >= 0.0 {
                next.push(u);
            }
            if (du > 0.0 && dv < 0.0) || (du < 0.0 && dv > 0.0) {
                let share = du / (du - dv);
                next.push([u[0] + (v[0] - u[0]) * share, u[1] + (v[1] - u[1]) * share]);
            }
        }
        clipped = next;
    }
    (0..clipped.len())
        .map(|k| {
            let (u, v) = (clipped[k], clipped[(k + 1) % clipped.len()]);
            0.5 * (u[0] * v[1] - u[1] * v[0])
        })
        .sum()
}

/// Counter-clockwise hull of points in the plane.
pub fn hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])));
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..]
                && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut sorted.iter().copied());
    all.extend(half(&mut sorted.iter().rev().copied()));
    all
}
