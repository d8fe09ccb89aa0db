//! Shapes and poses for the tests, from a seed.

use cd_solve::math::{Quat, Vec3};
use parry3d_f64::math::Vector;

use crate::oracle::Solid;

/// SplitMix64 of G. L. Steele et al. (2014).
pub struct Random(pub u64);

impl Random {
    /// In 0..1.
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn index(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = Vec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            if (0.01..1.0).contains(&v.norm()) {
                return v.normalize();
            }
        }
    }

    pub fn turn(&mut self) -> Quat {
        Quat::from_scaled_axis(self.direction() * self.between(0.0, 3.1))
    }
}

/// The hull of `count` points near an ellipsoid of these half axes.
pub fn rock(random: &mut Random, count: usize, half_axes: Vec3) -> Solid {
    loop {
        let point = |random: &mut Random| {
            let p = random.direction() * random.between(0.8, 1.0);
            Vector::new(p.x, p.y, p.z)
        };
        let points: Vec<Vector> = (0..count).map(|_| point(random)).collect();
        let (vertices, triangles) = parry3d_f64::transformation::convex_hull(&points);
        // Flattened afterwards: hulls of thin sets of points come out wrong.
        let mut vertices: Vec<Vec3> =
            vertices.iter().map(|v| Vec3::new(v.x, v.y, v.z).component_mul(&half_axes)).collect();
        let centre = vertices.iter().sum::<Vec3>() / vertices.len() as f64;
        vertices.iter_mut().for_each(|v| *v -= centre);
        // Sheets and needles of almost no volume come out of few points; the next draw is better.
        let volume: f64 = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|k| vertices[k as usize]);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum();
        if volume > 0.02 * half_axes.product() {
            return Solid::new(vertices, triangles);
        }
    }
}

/// A prism over a polygon of the plane z = 0 (counter-clockwise), from -h to h.
pub fn prism(polygon: &[[f64; 2]], h: f64) -> Solid {
    let count = polygon.len() as u32;
    let mut vertices: Vec<Vec3> = polygon.iter().map(|[x, y]| Vec3::new(*x, *y, -h)).collect();
    vertices.extend(polygon.iter().map(|[x, y]| Vec3::new(*x, *y, h)));
    let mut triangles = Vec::new();
    for k in 1..count - 1 {
        triangles.extend([[0, k + 1, k], [count, count + k, count + k + 1]]);
    }
    for k in 0..count {
        let next = (k + 1) % count;
        triangles.extend([[k, next, count + next], [k, count + next, count + k]]);
    }
    Solid::new(vertices, triangles)
}

/// A box of these half sides.
pub fn cuboid(x: f64, y: f64, z: f64) -> Solid {
    prism(&[[-x, -y], [x, -y], [x, y], [-x, y]], z)
}

/// A prism over a regular polygon with the circumradius 1.
pub fn regular(count: usize, h: f64) -> Solid {
    let corner = |k: usize| (k as f64 / count as f64 * std::f64::consts::TAU).sin_cos();
    let polygon: Vec<[f64; 2]> = (0..count).map(corner).map(|(sin, cos)| [cos, sin]).collect();
    prism(&polygon, h)
}

/// The cube of half side 1 standing on a vertex, z up.
pub fn on_vertex() -> Quat {
    Quat::rotation_between(&Vec3::repeat(-1.0), &-Vec3::z()).unwrap()
}
