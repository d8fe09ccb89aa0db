//! Convex polygons and polyhedra that are cut by planes.

use cd_formats::faces::doubled_area;

use crate::math::Vec3;

/// Share of the half side beyond which a point counts as lying on the cube: more than the rounding of cuts.
const NEAR_CUBE: f64 = 1.0 - 1e-9;

/// Convex polyhedron by its faces, within a cube that bounds it on open sides.
pub struct ConvexPolytope {
    /// Corners of each face, counter-clockwise seen from outside, m.
    faces: Vec<Vec<Vec3>>,
    /// Centre of the cube, m.
    centre: Vec3,
    /// Half of the side of the cube, m.
    half_side: f64,
}

impl ConvexPolytope {
    /// Cube of the half side `half_side` (m) about `centre`, which counts as unbounded.
    pub fn cube(centre: Vec3, half_side: f64) -> ConvexPolytope {
        let face = |axis: usize, sign: f64| {
            let face_point = |u: f64, v: f64| {
                let mut x = Vec3::zeros();
                (x[axis], x[(axis + 1) % 3], x[(axis + 2) % 3]) = (sign, u, v);
                centre + x * half_side
            };
            let mut face =
                vec![face_point(-1.0, -1.0), face_point(1.0, -1.0), face_point(1.0, 1.0), face_point(-1.0, 1.0)];
            if sign < 0.0 {
                face.reverse();
            }
            face
        };
        let faces = (0..3).flat_map(|axis| [face(axis, 1.0), face(axis, -1.0)]).collect();
        ConvexPolytope { faces, centre, half_side }
    }

    /// Cuts off the part with normal.x < offset; returns the area of the cut, m^2. A plane within rounding of a face changes
    /// nothing, and the area of that face is returned.
    pub fn cut_below(&mut self, normal: &Vec3, offset: f64) -> f64 {
        let near = 1e-12 * self.half_side;
        let value = |p: &Vec3| {
            let value = p.dot(normal) - offset;
            if value.abs() <= near { 0.0 } else { value }
        };
        let values = || self.faces.iter().flatten().map(value);
        if values().all(|value| value >= 0.0) {
            return self.face_on(normal, offset).map_or(0.0, |face| area_normal(face).norm());
        }
        if values().all(|value| value <= 0.0) {
            self.faces.clear();
            return 0.0;
        }
        let mut rim: Vec<Vec3> = Vec::new();
        let mut faces = Vec::with_capacity(self.faces.len() + 1);
        for face in &self.faces {
            let remainder = cut_polygon(face, value, |p, q, share| p + (q - p) * share);
            if face.iter().any(|p| value(p) < 0.0) {
                rim.extend(remainder.iter().filter(|p| value(p) == 0.0));
            }
            if remainder.len() > 2 {
                faces.push(remainder);
            }
        }
        self.faces = faces;
        if rim.len() < 3 {
            return 0.0;
        }
        // Around the middle, seen from outside: against the normal.
        let middle = rim.iter().sum::<Vec3>() / rim.len() as f64;
        let first = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
        let second = first.cross(normal);
        let angle = |p: &Vec3| (p - middle).dot(&second).atan2((p - middle).dot(&first));
        rim.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        let area = area_normal(&rim).norm();
        self.faces.push(rim);
        area
    }

    /// The face on a plane normal.x = offset that bounds the polyhedron from below, if there is one.
    pub fn face_on(&self, normal: &Vec3, offset: f64) -> Option<&[Vec3]> {
        // Ten times the rounding of corners that several cuts have made; a face narrower than that is an edge.
        let near = 1e-11 * self.half_side;
        let is_on = |face: &&Vec<Vec3>| {
            let length = face.iter().map(|p| (p - face[0]).norm()).fold(0.0, f64::max);
            face.iter().all(|p| (p.dot(normal) - offset).abs() <= near)
                && -area_normal(face).dot(normal) > near * length
        };
        self.faces.iter().find(is_on).map(Vec::as_slice)
    }

    /// Whether the polyhedron is bounded: no part of it reaches the cube.
    pub fn is_closed(&self) -> bool {
        let is_near_cube = |p: &Vec3| (p - self.centre).amax() < self.half_side * NEAR_CUBE;
        !self.faces.is_empty() && self.faces.iter().flatten().all(is_near_cube)
    }

    /// Volume, m^3.
    pub fn volume(&self) -> f64 {
        let cone = |face: &Vec<Vec3>| (face[0] - self.centre).dot(&area_normal(face)) / 3.0;
        self.faces.iter().map(cone).sum()
    }

    /// Height of the lowest point along the unit vector `up`, m; `None` if the polyhedron is open there.
    pub fn lowest_height(&self, up: &Vec3) -> Option<f64> {
        let lowest = self.faces.iter().flatten().min_by(|a, b| a.dot(up).total_cmp(&b.dot(up)))?;
        ((lowest - self.centre).amax() < self.half_side * NEAR_CUBE).then(|| lowest.dot(up))
    }
}

/// Area times normal of a polygon, m^2.
fn area_normal(polygon: &[Vec3]) -> Vec3 {
    0.5 * doubled_area(polygon)
}

/// Returns the part of a convex polygon where `value` is not negative; `between` gives the point at a share of an edge.
pub fn cut_polygon<P: Copy>(polygon: &[P], value: impl Fn(&P) -> f64, between: impl Fn(&P, &P, f64) -> P) -> Vec<P> {
    let mut remainder = Vec::with_capacity(polygon.len() + 1);
    for (k, p) in polygon.iter().enumerate() {
        let q = &polygon[(k + 1) % polygon.len()];
        let (value_p, value_q) = (value(p), value(q));
        if value_p >= 0.0 {
            remainder.push(*p);
        }
        if (value_p < 0.0) != (value_q < 0.0) {
            remainder.push(between(p, q, value_p / (value_p - value_q)));
        }
    }
    remainder
}
