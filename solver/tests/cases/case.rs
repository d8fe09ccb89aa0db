//! A case directory in the making, and the figures of a state.

use std::ffi::OsString;
use std::path::PathBuf;

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::bulk_behav::{BulkBehav, Material};
use cd_formats::compute::{Compute, Event, EventAction};
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof, Evolution, table_text};
use cd_formats::names::number_text;
use cd_formats::snapshot::{self, Snapshot};
use cd_formats::tact_behav::{LawRecord, TactBehav, VisibilityRow, VisibilitySide};
use cd_formats::wall_mesh::{MeshSides, WallMesh};
use cd_solve::limits::ParameterLimit;
use tempfile::TempDir;

pub type Vec3 = nalgebra::Vector3<f64>;

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Triangles of a box whose vertex k has bit i of k set on the positive side of axis i.
pub const BOX: [[u32; 3]; 12] = [
    [0, 2, 1],
    [1, 2, 3],
    [4, 5, 6],
    [5, 7, 6],
    [0, 1, 4],
    [1, 5, 4],
    [2, 6, 3],
    [3, 6, 7],
    [0, 4, 2],
    [2, 4, 6],
    [1, 3, 5],
    [3, 7, 5],
];

/// Fixed axes.
pub const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Velocity of a wall that is shaken, m/s.
pub fn shaking_velocity(amplitude: f64) -> Evolution {
    Evolution::Harmonic { constant: 0.0, amplitude, omega: 5.0, phase: 0.25, ramp_start: 1.0, ramp_rate: 0.0 }
}

/// Number of contacts with `wall` as antagonist that carry force.
pub fn load_count(state: &Snapshot, wall: usize) -> usize {
    let contacts = state.contacts.contact_body.iter().zip(&state.contacts.contact_impulse);
    contacts.filter(|(bodies, impulse)| bodies[1] as usize == wall && **impulse != [0.0; 3]).count()
}

/// Spheres and plates in a folder of their own. Angles and lengths that the files can hold exactly
/// (eight digits) are kept exactly; positions are exact to round-off, see [`Case::add`].
pub struct Case {
    folder: TempDir,
    pub bodies: Vec<Body>,
    pub dof: Vec<BodyDof>,
    pub driven: Vec<DrivenComponent>,
    pub tact: TactBehav,
    /// m/s^2
    pub gravity: [f64; 3],
    pub materials: Vec<Material>,
    pub options: Compute,
}

impl Case {
    /// An empty scene: density 1 kg/m^3, no gravity, contacts solved to nearly round-off.
    pub fn new() -> Self {
        let options = Compute {
            tol: Some(1e-12),
            max_sweeps: Some(20_000),
            threads: std::env::var("CD_TESTS_THREADS")
                .map_or(1, |threads| threads.parse().expect("a number of threads")),
            output_every: 1 << 40,
            ..Compute::default()
        };
        Case {
            folder: tempfile::tempdir().unwrap(),
            bodies: Vec::new(),
            dof: Vec::new(),
            driven: Vec::new(),
            tact: TactBehav::default(),
            gravity: [0.0; 3],
            materials: vec![Material { name: "ROCKx".into(), density: 1.0 }],
            options,
        }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().to_path_buf()
    }

    /// Adds a body at rest. DOF.INI carries the digits of its position that BODIES.DAT cannot hold.
    fn add(&mut self, shape: ShapeRecord, colour: &str, x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
        let written = x.map(|c| format!("{c:.7e}").parse().unwrap());
        let rest: [f64; 3] = std::array::from_fn(|k| x[k] - written[k]);
        let body = self.bodies.len();
        self.bodies.push(Body {
            line: 0,
            material: self.materials[0].name.clone(),
            equivalent_radius: 0.0,
            inertia: None,
            position: written,
            contactors: vec![Contactor { colour: colour.into(), shape, local_frame: None }],
        });
        let displacement = [rest[0], rest[1], rest[2], 0.0, 0.0, 0.0];
        self.dof.push(BodyDof { line: 0, body, displacement, velocity: [0.0; 6], axes });
        body
    }

    pub fn sphere(&mut self, radius: f64, x: [f64; 3]) -> usize {
        self.add(ShapeRecord::Sphere { radius }, "GRAIN", x, [X, Y, Z])
    }

    /// A sphere of its own density.
    pub fn sphere_of(&mut self, density: f64, radius: f64, x: [f64; 3]) -> usize {
        let name = format!("M{:04}", self.materials.len());
        self.materials.push(Material { name: name.clone(), density });
        let body = self.sphere(radius, x);
        self.bodies[body].material = name;
        body
    }

    /// A polyhedron by its vertices and triangles; principal axes are found by the program.
    pub fn polyhedron(&mut self, vertices: &[[f64; 3]], triangles: &[[u32; 3]], x: [f64; 3]) -> usize {
        let shape = ShapeRecord::Polyhedron { vertices: vertices.to_vec(), triangles: triangles.to_vec() };
        self.add(shape, "GRAIN", x, [X, Y, Z])
    }

    /// A box by its half lengths along its axes.
    pub fn block(&mut self, half: [f64; 3], x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
        let vertices = (0..8u32).map(|k| [0, 1, 2].map(|i| if k >> i & 1 == 1 { half[i] } else { -half[i] })).collect();
        let body = self.add(ShapeRecord::Polyhedron { vertices, triangles: BOX.to_vec() }, "GRAIN", x, axes);
        // The axes are those of the box.
        let [a, b, c] = half.map(|h| h * h);
        let volume = 8.0 * half.iter().product::<f64>();
        self.bodies[body].inertia = Some([b + c, a + c, a + b].map(|square| volume / 3.0 * square));
        body
    }

    /// Gives a body a velocity and an angular velocity.
    pub fn launch(&mut self, body: usize, v: [f64; 3], w: [f64; 3]) {
        self.dof[body].velocity = [v[0], v[1], v[2], w[0], w[1], w[2]];
    }

    /// A plate with its axes, at rest.
    pub fn plate(&mut self, half_lengths: [f64; 3], x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
        let plate = self.add(ShapeRecord::Plane { half_lengths }, "WALLx", x, axes);
        self.drive(plate, [0.0; 6].map(Evolution::constant));
        plate
    }

    /// A triangulated wall at rest, pushing from one side.
    pub fn mesh(&mut self, vertices: &[[f64; 3]], triangles: &[[u32; 3]], x: [f64; 3], axes: [[f64; 3]; 3]) -> usize {
        let surface = WallMesh::new(vertices, triangles, MeshSides::One).unwrap();
        let file = format!("wall-{}.obj", self.bodies.len()).into();
        let (radius, surface) = (surface.radius(), Some(surface.into()));
        let wall = self.add(ShapeRecord::Mesh { radius, sides: MeshSides::One, file, surface }, "WALLx", x, axes);
        self.drive(wall, [0.0; 6].map(Evolution::constant));
        wall
    }

    /// A wide plate at rest, its upper face in z = 0.
    pub fn floor(&mut self) -> usize {
        self.plate([1024.0, 1024.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z])
    }

    /// Four plates and a floor around |x|, |y| < half, z > 0.
    pub fn tub(&mut self, half: f64) {
        self.floor();
        for (axis, other) in [(X, Y), (Y, Z)] {
            let third =
                [0, 1, 2].map(|k| axis[(k + 1) % 3] * other[(k + 2) % 3] - axis[(k + 2) % 3] * other[(k + 1) % 3]);
            for side in [-1.0, 1.0] {
                let x = axis.map(|c| c * side * (half + 0.5));
                self.plate([64.0, 64.0, 0.5], x, [other, third, axis]);
            }
        }
    }

    /// Imposes all motion of a body, which moves so from the beginning.
    pub fn drive(&mut self, body: usize, velocity: [Evolution; 6]) {
        self.driven.retain(|driven| driven.body != body);
        for (component, evolution) in velocity.into_iter().enumerate() {
            self.dof[body].velocity[component] = evolution.value_at(0.0);
            self.driven.push(DrivenComponent { line: 0, body, component, kind: DrivenKind::Velocity, evolution });
        }
    }

    /// Imposes one velocity component of a body; the others are at rest.
    pub fn drive_along(&mut self, body: usize, component: usize, evolution: Evolution) {
        let mut velocity = [0.0; 6].map(Evolution::constant);
        velocity[component] = evolution;
        self.drive(body, velocity);
    }

    /// Imposes a constant force (components 0 to 2, N) or moment (3 to 5, N m).
    pub fn pull(&mut self, body: usize, component: usize, force: f64) {
        let evolution = Evolution::constant(force);
        self.driven.push(DrivenComponent { line: 0, body, component, kind: DrivenKind::Force, evolution });
    }

    /// Leaves a driven body to a constant force (N) along an axis.
    pub fn press(&mut self, body: usize, axis: usize, force: f64) {
        self.driven.retain(|driven| driven.body != body || driven.component != axis);
        self.pull(body, axis, force);
    }

    /// One law for all contacts.
    pub fn law(&mut self, kind: &str, parameters: &[f64]) {
        self.tact = TactBehav::default();
        self.law_with("SPHER", kind, parameters);
        self.law_with("PLANx", kind, parameters);
    }

    /// One law for all contacts, those of polyhedra and cylinders among them.
    pub fn law_of_all(&mut self, kind: &str, parameters: &[f64]) {
        self.law(kind, parameters);
        for (candidate, antagonist) in [
            ("SPHER", "POLYR"),
            ("SPHER", "CYLND"),
            ("SPHER", "DNLYC"),
            ("POLYR", "POLYR"),
            ("POLYR", "PLANx"),
            ("POLYR", "CYLND"),
            ("POLYR", "DNLYC"),
        ] {
            self.law_between(candidate, antagonist, kind, parameters);
        }
    }

    /// The law of spheres with contactors of one type.
    pub fn law_with(&mut self, antagonist: &str, kind: &str, parameters: &[f64]) {
        self.law_between("SPHER", antagonist, kind, parameters);
    }

    /// The law of contactors of two types.
    pub fn law_between(&mut self, candidate: &str, antagonist: &str, kind: &str, parameters: &[f64]) {
        let nickname = format!("law{:02}", self.tact.laws.len());
        let side = |contactor: &str| VisibilitySide {
            body: "RBDY3".into(),
            contactor: contactor.into(),
            colour: if ["SPHER", "POLYR"].contains(&contactor) { "GRAIN" } else { "WALLx" }.into(),
        };
        let (candidate, antagonist) = (side(candidate), side(antagonist));
        self.tact.visibility.push(VisibilityRow { line: 0, candidate, law: nickname.clone(), antagonist, alert: 1e-3 });
        self.tact.laws.push(LawRecord { line: 0, nickname, kind: kind.into(), parameters: parameters.into() });
    }

    pub fn event(&mut self, time: f64, action: EventAction) {
        self.options.events.push(Event::at_time(time, action));
    }

    /// Writes DATBOX.
    pub fn write(&self) {
        let datbox = self.path().join("DATBOX");
        std::fs::create_dir_all(&datbox).unwrap();
        let put = |name: &str, text: String| std::fs::write(datbox.join(name), text).unwrap();
        put("BODIES.DAT", Bodies(self.bodies.clone()).to_text());
        put("BULK_BEHAV.DAT", BulkBehav { gravity: self.gravity, materials: self.materials.clone() }.to_text());
        put("TACT_BEHAV.DAT", self.tact.to_text());
        put("DRV_DOF.DAT", DrvDof(self.driven.clone()).to_text());
        put("DOF.INI", Dof { step: 0, time: 0.0, bodies: self.dof.clone() }.to_text());
        put("COMPUTE.RON", self.options.to_text());
        for contactor in self.bodies.iter().flat_map(|body| &body.contactors) {
            if let ShapeRecord::Mesh { file, surface: Some(surface), .. } = &contactor.shape {
                put(file, surface.to_text());
            }
        }
        for driven in &self.driven {
            if let Evolution::Table { name, points } = &driven.evolution {
                put(name, table_text(points));
            }
        }
    }

    /// Runs cd-solve on DATBOX as it stands; returns its exit code.
    pub fn solve(&self, flags: &[&str]) -> i32 {
        solve(self.path(), flags)
    }

    /// Runs so many steps from the beginning; returns the last state.
    pub fn run(&mut self, steps: u64) -> Snapshot {
        self.attempt(steps).expect("cd-solve does it")
    }

    /// The same; none if cd-solve rejects or gives up.
    pub fn attempt(&mut self, steps: u64) -> Option<Snapshot> {
        self.options.steps = Some(steps);
        self.write();
        (self.solve(&["--force"]) == 0).then(|| self.last())
    }

    /// Runs so many steps from the beginning; returns the states after every `every` steps, from step 0.
    pub fn states(&mut self, steps: u64, every: u64) -> Vec<Snapshot> {
        self.options.output_every = every;
        self.run(steps);
        self.written()
    }

    /// Like [`Case::states`]; None if the run fails.
    pub fn attempt_states(&mut self, steps: u64, every: u64) -> Option<Vec<Snapshot>> {
        self.options.output_every = every;
        self.attempt(steps).map(|_| self.written())
    }

    pub fn written(&self) -> Vec<Snapshot> {
        let list = snapshot::list_snapshots(&self.path().join("OUTBOX")).unwrap();
        list.iter().map(|(_, path)| Snapshot::read(path).unwrap()).collect()
    }

    pub fn last(&self) -> Snapshot {
        let list = snapshot::list_snapshots(&self.path().join("OUTBOX")).unwrap();
        Snapshot::read(&list.last().expect("a run writes its last state").1).unwrap()
    }

    /// Texts of OUTBOX/DOF.OUT.1 and Vloc_Rloc.OUT.1.
    pub fn first_text_states(&self) -> [String; 2] {
        ["DOF.OUT.1", "Vloc_Rloc.OUT.1"]
            .map(|name| std::fs::read_to_string(self.path().join("OUTBOX").join(name)).unwrap())
    }

    /// Runs so many steps from these texts of a state; returns the last state.
    pub fn run_from_text(&self, [dof, contacts]: &[String; 2], steps: u64) -> Snapshot {
        let datbox = self.path().join("DATBOX");
        std::fs::write(datbox.join("DOF.INI"), dof).unwrap();
        std::fs::write(datbox.join("Vloc_Rloc.INI"), contacts).unwrap();
        assert_eq!(self.solve(&["--force", "--steps", &steps.to_string()]), 0);
        self.last()
    }

    /// A column of OUTBOX/steps.csv; empty fields are NaN.
    pub fn column(&self, name: &str) -> Vec<f64> {
        let text = std::fs::read_to_string(self.path().join("OUTBOX/steps.csv")).unwrap();
        let (header, rows) = text.split_once('\n').unwrap();
        let k = header.split(',').position(|column| column == name).expect(name);
        rows.lines().map(|row| row.split(',').nth(k).unwrap()).map(|cell| cell.parse().unwrap_or(f64::NAN)).collect()
    }
}

/// Expects the same bytes of the snapshot after 60 steps from an unbroken run, one resumed after 30 and one on three threads, each
/// of a new `case`.
pub fn expect_same_bytes(case: impl Fn() -> Case) {
    let bytes = |runs: &[&[&str]]| {
        let case = case();
        case.write();
        runs.iter().for_each(|flags| assert_eq!(case.solve(flags), 0, "{flags:?}"));
        std::fs::read(case.path().join("OUTBOX/snapshot-000060.npz")).unwrap()
    };
    let unbroken = bytes(&[&["--steps", "60"]]);
    assert!(unbroken == bytes(&[&["--steps", "30"], &["--resume", "--steps", "60"]]));
    assert!(unbroken == bytes(&[&["--steps", "60", "--threads", "3"]]));
}

/// Runs cd-solve in this process; returns its exit code.
pub fn solve(case: PathBuf, flags: &[&str]) -> i32 {
    let words = ["cd-solve".into(), OsString::from(case)].into_iter().chain(flags.iter().map(OsString::from));
    cd_solve::run(words)
}

/// Figures of a state for tests.
pub trait Figures {
    fn x(&self, body: usize) -> Vec3;
    fn v(&self, body: usize) -> Vec3;
    /// World frame.
    fn w(&self, body: usize) -> Vec3;
    /// Angular momentum about the centre of mass, world frame.
    fn own_angular_momentum(&self, body: usize) -> Vec3;
    fn mass(&self, body: usize) -> f64;
    /// Bodies whose motion is not imposed.
    fn free(&self) -> Vec<usize>;
    fn momentum(&self) -> Vec3;
    /// About the origin.
    fn angular_momentum(&self) -> Vec3;
    /// Sum of m |v| of the free bodies.
    fn momentum_scale(&self) -> f64;
    fn kinetic(&self) -> f64;
    /// In uniform gravity and in self-gravity.
    fn potential(&self) -> f64;
    /// Force on the candidate along n, t, s of the contact of two bodies; none if it is not listed.
    fn force(&self, candidate: usize, antagonist: usize) -> Option<Vec3>;
}

impl Figures for Snapshot {
    fn x(&self, body: usize) -> Vec3 {
        self.bodies.body_x[body].into()
    }

    fn v(&self, body: usize) -> Vec3 {
        self.bodies.body_v[body].into()
    }

    fn w(&self, body: usize) -> Vec3 {
        self.bodies.body_w_world[body].into()
    }

    fn own_angular_momentum(&self, body: usize) -> Vec3 {
        let inertia = Vec3::from(self.bodies.body_inertia[body]);
        let [w, x, y, z] = self.bodies.body_q[body];
        let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        q * Vec3::from(self.bodies.body_w[body]).component_mul(&inertia)
    }

    fn mass(&self, body: usize) -> f64 {
        self.bodies.body_mass[body]
    }

    fn free(&self) -> Vec<usize> {
        (0..self.bodies.body_x.len()).filter(|&i| self.bodies.body_driven[i] == 0).collect()
    }

    fn momentum(&self) -> Vec3 {
        self.free().iter().map(|&i| self.v(i) * self.mass(i)).sum()
    }

    fn angular_momentum(&self) -> Vec3 {
        let of = |&i: &usize| self.x(i).cross(&self.v(i)) * self.mass(i) + self.own_angular_momentum(i);
        self.free().iter().map(of).sum()
    }

    fn momentum_scale(&self) -> f64 {
        self.free().iter().map(|&i| self.v(i).norm() * self.mass(i)).sum()
    }

    fn kinetic(&self) -> f64 {
        let of =
            |&i: &usize| 0.5 * (self.mass(i) * self.v(i).norm_squared() + self.own_angular_momentum(i).dot(&self.w(i)));
        self.free().iter().map(of).sum()
    }

    fn potential(&self) -> f64 {
        let (free, parameters) = (self.free(), &self.meta.parameters);
        let gravity = Vec3::from(parameters.uniform_gravity);
        let uniform: f64 = free.iter().map(|&i| -self.mass(i) * gravity.dot(&self.x(i))).sum();
        let pair = |i: usize, j: usize| self.mass(i) * self.mass(j) / (self.x(i) - self.x(j)).norm();
        let pairs = free.iter().enumerate().flat_map(|(k, &i)| free[..k].iter().map(move |&j| (i, j)));
        let own: f64 = if parameters.self_gravity { pairs.map(|(i, j)| pair(i, j)).sum() } else { 0.0 };
        uniform - parameters.gravity_constant * own
    }

    fn force(&self, candidate: usize, antagonist: usize) -> Option<Vec3> {
        let pair = [candidate as u32, antagonist as u32];
        let k = self.contacts.contact_body.iter().position(|bodies| *bodies == pair)?;
        Some(self.contacts.contact_force[k].into())
    }
}

/// |a - b| <= bound.
#[track_caller]
pub fn near(a: impl Into<Vec3>, b: impl Into<Vec3>, bound: f64) {
    let (a, b) = (a.into(), b.into());
    let away = (a - b).norm();
    assert!(away <= bound, "{:?} is {away:.2e} away from {:?}; allowed are {bound:.1e}", a.as_slice(), b.as_slice());
}

/// |a - b| <= bound.
#[track_caller]
pub fn equal(a: f64, b: f64, bound: f64) {
    assert!((a - b).abs() <= bound, "{a} is {:.2e} away from {b}; allowed are {bound:.1e}", (a - b).abs());
}

/// The least and the largest of some values, as text; one value where they are equal.
pub fn range(values: &[f64]) -> String {
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    if least == most { format!("{least:e}") } else { format!("{least:e} to {most:e}") }
}

/// Largest number of trials of a search for a limit, on each side of the stated range.
#[derive(Clone, Copy)]
pub struct SearchEffort {
    /// Trials outwards: 1, 2, 4, ... decades beyond the stated range.
    pub strides: i32,
    /// Trials between the last value at which the property holds and the first at which it fails.
    pub bisections: u32,
}

/// Ratio of the two values between which a property fails at which a search ends.
const LIMIT_ACCURACY: f64 = 1.1;

impl SearchEffort {
    /// From 1 to 128 decades; of the last stride, 64 decades, bisections leave 1/64 of one.
    pub const WHOLE: SearchEffort = SearchEffort { strides: 8, bisections: 12 };
    /// In every `make test`, by which the searches are tested.
    pub const SMALL: SearchEffort = SearchEffort { strides: 1, bisections: 1 };
    /// No search, in tests that take seconds: only the stated range is tested.
    pub const NONE: SearchEffort = SearchEffort { strides: 0, bisections: 0 };
}

/// Whether the tests are those of `make extremes`.
pub fn is_long() -> bool {
    std::env::var_os("CD_TESTS_LONG").is_some()
}

/// Limits of a parameter as a search has found them.
pub struct Envelope {
    limit: &'static ParameterLimit,
    /// On either side the last value tried at which the property holds, and the value nearest to it at which it fails.
    pub sides: [(f64, Option<f64>); 2],
    /// Largest error in the stated range.
    pub worst: f64,
}

impl Envelope {
    /// Searches for the limits of a parameter: `error` must stay within `bound` at the ends of the stated range and for the
    /// values `inside`, and may exceed it beyond. `effort` is that without `make extremes`, in which the search is whole.
    #[track_caller]
    pub fn search(
        effort: SearchEffort,
        limit: &'static ParameterLimit,
        inside: &[f64],
        bound: f64,
        mut error: impl FnMut(f64) -> f64,
    ) -> Envelope {
        let effort = if is_long() { SearchEffort::WHOLE } else { effort };
        Self::search_with(effort, limit, inside, bound, &mut error)
    }

    /// Searches with this effort.
    #[track_caller]
    pub fn search_with(
        effort: SearchEffort,
        limit: &'static ParameterLimit,
        inside: &[f64],
        bound: f64,
        error: &mut dyn FnMut(f64) -> f64,
    ) -> Envelope {
        let mut worst = 0f64;
        let ends = limit.stated.into_iter().filter(|end| *end > 0.0 && end.is_finite());
        for value in inside.iter().copied().chain(ends) {
            let found = error(value);
            assert!(
                found <= bound,
                "{}: {value:e} is in the stated range, {}: error {found:e}; allowed are {bound:e}",
                limit.parameter,
                limit.stated_text()
            );
            worst = worst.max(found);
        }
        let mut holds = |value: f64| error(value) <= bound;
        let sides = [0, 1].map(|side| Self::search_side(effort, limit.stated[side], limit.search[side], &mut holds));
        Envelope { limit, sides, worst }
    }

    /// Searches from `start`, where the property holds, to `end`.
    fn search_side(
        effort: SearchEffort,
        start: f64,
        end: f64,
        holds: &mut dyn FnMut(f64) -> bool,
    ) -> (f64, Option<f64>) {
        let (mut good, mut bad) = (start, None);
        for stride in 0..effort.strides {
            if good == end {
                break;
            }
            let decades = 1 << stride;
            let next = trial_value(if end > start {
                (start * 10f64.powi(decades)).min(end)
            } else {
                (start * 10f64.powi(-decades)).max(end)
            });
            if !holds(next) {
                bad = Some(next);
                break;
            }
            good = next;
        }
        for _ in 0..effort.bisections {
            let Some(failing) = bad.filter(|bad| (bad / good).max(good / bad) > LIMIT_ACCURACY) else { break };
            let middle = trial_value((good * failing).sqrt());
            if holds(middle) { good = middle } else { bad = Some(middle) }
        }
        (good, bad)
    }

    /// Prints the row of the table in docs/explanation/limits.md.
    pub fn print(&self) {
        let ParameterLimit { parameter, property, typical, search, stated, .. } = self.limit;
        let is_searched = |side: usize| stated[side] != search[side];
        let searched = (0..2).filter(|side| is_searched(*side)).map(|side| match self.sides[side] {
            (_, Some(bad)) => format!("**fails at {bad:.1e}**"),
            (good, None) => format!("holds to {good:.1e}, the end"),
        });
        let margins = (0..2).filter(|side| is_searched(*side)).map(|side| {
            let (good, bad) = self.sides[side];
            let factor = |value: f64| if side == 0 { typical[0] / value } else { value / typical[1] };
            bad.map_or_else(|| format!("≥ {:.0e}", factor(good)), |bad| format!("{:.0e}", factor(bad)))
        });
        let joined = |texts: Vec<String>| if texts.is_empty() { "-".to_string() } else { texts.join("; ") };
        let [from, to] = typical.map(number_text);
        print_row(&[
            parameter,
            &self.limit.stated_text(),
            &joined(searched.collect()),
            &format!("{from} to {to}"),
            &joined(margins.collect()),
            property,
            &format!("{:.1e}", self.worst),
        ]);
    }
}

/// The value with two significant digits, which the page shows.
fn trial_value(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap()
}

/// Prints the result of the test that calls it, for docs/explanation/limits.md: a parameter, its range, the property that holds
/// there, and the figure found. No limit was searched for.
pub fn shown(parameter: &str, range: &str, holds: &str, found: f64) {
    print_row(&[parameter, range, "not searched", "-", "-", holds, &format!("{found:.1e}")]);
}

/// Prints the cells of a row, and the name of the test.
fn print_row(cells: &[&str]) {
    let test = std::thread::current().name().unwrap_or_default().to_string();
    println!("limit | {} | `{test}` |", cells.join(" | "));
}

/// Spheres on a cubic lattice around the origin, shaken by a generator with a seed: radii from 0.3 to 0.5
/// in cells of 1.1, so that none touch.
pub fn shaken_lattice(side: i64, seed: u64) -> Vec<(f64, [f64; 3])> {
    let mut random = uniform(seed);
    let cells = (0..side.pow(3)).map(|k| [k % side, k / side % side, k / side / side]);
    cells
        .map(|cell| {
            let radius = (0.3 + 0.2 * random()).clamp(0.3, 0.5);
            let shake = 2.0 * (0.55 - radius);
            (radius, cell.map(|c| 1.1 * (c as f64 - 0.5 * (side - 1) as f64) + shake * (random() - 0.5)))
        })
        .collect()
}

/// Numbers from 0 to 1: a linear congruential generator (Knuth's MMIX), its upper bits.
pub fn uniform(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}
