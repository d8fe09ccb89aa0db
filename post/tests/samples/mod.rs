//! Small snapshots made by hand. A sphere has density 1 where nothing else is said.

#![allow(dead_code)] // each test uses its part

use std::f64::consts::PI;

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::snapshot::{
    DRIVEN_ALL, IntervalArrays, LawName, MaterialName, MemoryArrays, SHAPE_PARTS, SHAPE_PLANE, SHAPE_SPHERE,
    STATUS_NO_CONTACT, STATUS_SLIDE, STATUS_STICK, Snapshot,
};
use nalgebra::Vector3;

type Vec3 = Vector3<f64>;

pub struct Scene {
    pub snapshot: Snapshot,
    /// Row and half side of each cube.
    pub cubes: Vec<(usize, [f64; 3])>,
}

impl Default for Scene {
    /// Nothing yet; no gravity, h = 0.
    fn default() -> Self {
        let mut snapshot = Snapshot::default();
        let meta = &mut snapshot.meta;
        meta.program = "by hand".into();
        meta.colours = vec!["BLUEx".into(), "REDxx".into()];
        meta.materials = vec![MaterialName { name: "ROCKx".into(), density: 1.0 }];
        meta.laws = vec![LawName { nickname: "iqsc0".into(), kind: "IQS_CLB".into(), parameters: vec![0.5] }];
        meta.parameters.theta = 0.5;
        Scene { snapshot, cubes: Vec::new() }
    }
}

impl Scene {
    pub fn self_gravitating(constant: f64) -> Scene {
        let mut scene = Scene::default();
        scene.snapshot.meta.parameters.self_gravity = true;
        scene.snapshot.meta.parameters.gravity_constant = constant;
        scene
    }

    /// Adds a sphere at rest; returns its row.
    pub fn grain(&mut self, x: [f64; 3], radius: f64) -> usize {
        let mass = 4.0 / 3.0 * PI * radius.powi(3);
        self.body(x, SHAPE_SPHERE, 0, mass, radius, [radius; 3])
    }

    /// Adds a cube at rest, its sides of length 2 `half` along the axes; returns its row.
    pub fn cube(&mut self, x: [f64; 3], half: f64) -> usize {
        self.cuboid(x, [half; 3])
    }

    /// Adds a box at rest, its sides of lengths 2 `half` along the axes; returns its row.
    pub fn cuboid(&mut self, x: [f64; 3], half: [f64; 3]) -> usize {
        let volume = 8.0 * half.iter().product::<f64>();
        let radius = (0.75 * volume / PI).cbrt();
        let row = self.body(x, SHAPE_PARTS, 0, volume, radius, [Vec3::from(half).norm(); 3]);
        let [a, b, c] = half.map(|length| volume * length * length / 3.0);
        self.snapshot.bodies.body_inertia[row] = [b + c, a + c, a + b];
        self.cubes.push((row, half));
        row
    }

    /// Adds a wall that does not turn; returns its row.
    pub fn plate(&mut self, x: [f64; 3], half_lengths: [f64; 3]) -> usize {
        let [a, b, c] = half_lengths;
        let volume = 8.0 * a * b * c;
        let row = self.body(x, SHAPE_PLANE, DRIVEN_ALL, volume, (0.75 * volume / PI).cbrt(), half_lengths);
        let squares = [b * b + c * c, a * a + c * c, a * a + b * b];
        self.snapshot.bodies.body_inertia[row] = squares.map(|square| volume / 3.0 * square);
        row
    }

    fn body(&mut self, x: [f64; 3], shape: u8, driven: u8, mass: f64, radius: f64, half_lengths: [f64; 3]) -> usize {
        let bodies = &mut self.snapshot.bodies;
        let row = bodies.body_id.len();
        bodies.body_id.push(row as u64 + 1);
        bodies.body_x.push(x);
        bodies.body_q.push([1.0, 0.0, 0.0, 0.0]);
        bodies.body_v.push([0.0; 3]);
        bodies.body_w.push([0.0; 3]);
        bodies.body_w_world.push([0.0; 3]);
        bodies.body_mass.push(mass);
        bodies.body_inertia.push([0.4 * mass * radius * radius; 3]);
        bodies.body_radius.push(radius);
        bodies.body_half_lengths.push(half_lengths);
        bodies.body_shape.push(shape);
        bodies.body_driven.push(driven);
        bodies.body_colour.push((row % 2) as u16);
        bodies.body_material.push(0);
        row
    }

    /// The bodies as BODIES.DAT has them.
    pub fn records(&self) -> Bodies {
        let bodies = &self.snapshot.bodies;
        let record = |(row, &radius): (usize, &f64)| {
            let cube = self.cubes.iter().find(|(cube, _)| *cube == row);
            let shape = match cube {
                Some(&(_, half)) => {
                    let corner =
                        |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { -half[axis] } else { half[axis] });
                    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
                    let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
                    ShapeRecord::Polyhedron { vertices: (0..8).map(corner).collect(), triangles }
                }
                None if bodies.body_shape[row] == SHAPE_PLANE => {
                    ShapeRecord::Plane { half_lengths: bodies.body_half_lengths[row] }
                }
                None => ShapeRecord::Sphere { radius },
            };
            Body {
                line: 0,
                material: "ROCKx".into(),
                equivalent_radius: radius,
                inertia: cube.map(|_| bodies.body_inertia[row]),
                position: [0.0; 3],
                contactors: vec![Contactor { colour: "BLUEx".into(), shape, local_frame: None }],
            }
        };
        Bodies(bodies.body_radius.iter().enumerate().map(record).collect())
    }

    /// Two spheres push each other along the line of their centres with a force in N.
    pub fn push(&mut self, candidate: usize, antagonist: usize, force: f64) {
        let n = self.between(candidate, antagonist).normalize();
        self.contact(candidate, antagonist, n * force);
    }

    /// Whether a bond or a bridge holds, of each contact.
    pub fn remember(&mut self, bonded: &[u8]) {
        let (contact_bond_gap, contact_moment) = (vec![0.0; bonded.len()], vec![[0.0; 3]; bonded.len()]);
        self.snapshot.memory = Some(MemoryArrays { contact_bonded: bonded.to_vec(), contact_bond_gap, contact_moment });
    }

    /// Sets the effect of contacts since a time, s: rows of the bodies, and the sum of impulses times branches, J s.
    pub fn since(&mut self, start: f64, pairs: &[([u32; 2], f64)]) {
        self.snapshot.meta.interval_start = Some(start);
        let (interval_body, interval_virial) = pairs.iter().copied().unzip();
        self.snapshot.interval = Some(IntervalArrays { interval_body, interval_virial });
    }

    /// A contact between two spheres with any force on the candidate, N, on the surface of the antagonist.
    pub fn contact(&mut self, candidate: usize, antagonist: usize, force: Vec3) {
        let n = self.between(candidate, antagonist).normalize();
        let point =
            Vec3::from(self.snapshot.bodies.body_x[antagonist]) + n * self.snapshot.bodies.body_radius[antagonist];
        self.contact_along(n, candidate, antagonist, point.into(), force);
    }

    /// A contact at a point, its normal along the force on the candidate, N.
    pub fn contact_at(&mut self, candidate: usize, antagonist: usize, point: [f64; 3], force: Vec3) {
        self.contact_along(force.normalize(), candidate, antagonist, point, force);
    }

    fn between(&self, candidate: usize, antagonist: usize) -> Vec3 {
        let x = &self.snapshot.bodies.body_x;
        Vec3::from(x[candidate]) - Vec3::from(x[antagonist])
    }

    fn contact_along(&mut self, n: Vec3, candidate: usize, antagonist: usize, point: [f64; 3], force: Vec3) {
        let h = if self.snapshot.meta.h > 0.0 { self.snapshot.meta.h } else { 1.0 };
        let distance = self.between(candidate, antagonist).norm();
        let bodies = &self.snapshot.bodies;
        let gap = if bodies.body_shape[candidate] == bodies.body_shape[antagonist] {
            distance - bodies.body_radius[candidate] - bodies.body_radius[antagonist]
        } else {
            0.0
        };
        let t = n.cross(&Vec3::ith(n.iamin(), 1.0)).normalize();
        let s = n.cross(&t);
        let mut local = [n.dot(&force), t.dot(&force), s.dot(&force)];
        if force.cross(&n).norm() <= 1e-12 * force.norm() {
            local = [n.dot(&force), 0.0, 0.0]; // along the normal: no round-off across it
        }
        let status = match (force.norm() > 0.0, local[1] != 0.0) {
            (false, _) => STATUS_NO_CONTACT,
            (true, false) => STATUS_STICK,
            (true, true) => STATUS_SLIDE,
        };
        let contacts = &mut self.snapshot.contacts;
        contacts.contact_body.push([candidate as u32, antagonist as u32]);
        contacts.contact_feature.push([0, 0]);
        contacts.contact_point.push(point);
        contacts.contact_frame.push([n.into(), t.into(), s.into()]);
        contacts.contact_gap.push(gap);
        contacts.contact_force.push(local);
        contacts.contact_impulse.push(local.map(|f| f * h));
        contacts.contact_velocity.push([0.0; 3]);
        contacts.contact_status.push(status);
        contacts.contact_law.push(0);
    }
}
