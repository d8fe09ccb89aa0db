//! Files of POSTPRO.DAT: rows of figures in LMGC90's columns, in the folder POSTPRO next to OUTBOX.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::Faults;
use cd_formats::postpro::{PostproCommand, PostproKind};

use super::appended::AppendedFile;
use crate::math::{Twist, Vec3, Wrench, to_local, to_world};
use crate::scene::{BodyId, BodyShape, ContactorShape, Scene};
use crate::state::{SolvedContact, State};
use crate::step::{StepReport, StepStart};

/// Folder of the files, next to DATBOX.
pub const FOLDER: &str = "POSTPRO";

/// Names of the files of a command.
fn file_names(kind: &PostproKind) -> Vec<String> {
    let numbered_names = |prefixes: &[&str], numbers: &mut dyn Iterator<Item = usize>| {
        numbers.flat_map(|k| prefixes.iter().map(move |prefix| format!("{prefix}_{k:07}.DAT"))).collect()
    };
    match kind {
        PostproKind::SolverInformations => vec!["SOLVER_INFORMATIONS.DAT".into()],
        PostproKind::ViolationEvolution => vec!["VIOLATION_EVOLUTION.DAT".into()],
        PostproKind::KineticEnergy => vec!["KINETIC_ENERGY.DAT".into()],
        PostproKind::DissipatedEnergy => vec!["DISSIPATED_ENERGY.DAT".into()],
        PostproKind::CoordinationNumber => vec!["COORDINATION_NUMBER.DAT".into()],
        PostproKind::BodyTracking(bodies) => numbered_names(&["BODY"], &mut bodies.iter().map(|body| body + 1)),
        PostproKind::TorqueEvolution(bodies) => {
            numbered_names(&["REAC", "Fext", "Fine"], &mut bodies.iter().map(|body| body + 1))
        }
        PostproKind::NewRigidSets(sets) => {
            let prefixes = ["EVOL_RIGID_SET", "REAC_RIGID_SET", "Fext_RIGID_SET", "Fine_RIGID_SET"];
            numbered_names(&prefixes, &mut (1..=sets.len()))
        }
    }
}

/// Paths of all files that the commands of a scene request.
pub fn paths(case: &Path, scene: &Scene) -> Vec<PathBuf> {
    let names = scene.postpro.iter().flat_map(|command| file_names(&command.kind));
    names.map(|name| case.join(FOLDER).join(name)).collect()
}

/// Open files of all commands.
pub struct PostproFiles {
    /// Command, and its files.
    commands: Vec<(PostproCommand, Vec<AppendedFile>)>,
}

impl PostproFiles {
    /// Opens the files for a run that continues from `state`: rows up to its time are kept.
    pub fn open(case: &Path, scene: &Scene, state: &State) -> Result<Self, Faults> {
        let resumed = state.step > scene.start.step;
        let open = |command: &PostproCommand| {
            let paths = file_names(&command.kind).into_iter().map(|name| case.join(FOLDER).join(name));
            let files: Result<Vec<AppendedFile>, Faults> =
                paths.map(|path| open_row_file(&path, resumed.then_some(state.time))).collect();
            Ok((command.clone(), files?))
        };
        Ok(PostproFiles { commands: scene.postpro.iter().map(open).collect::<Result<_, Faults>>()? })
    }

    /// Adds a step, which follows step `previous_step`, to the sums of `state`, and its rows to the files that are due.
    pub fn add_step(
        &mut self,
        scene: &Scene,
        state: &mut State,
        report: &StepReport,
        previous_step: u64,
    ) -> Result<(), Faults> {
        let Some(start) = &report.start else { return Ok(()) };
        let figures = StepFigures::new(scene, state, report, start);
        let is_requested = |kind: PostproKind| scene.postpro.iter().any(|command| command.kind == kind);
        let dissipated = if is_requested(PostproKind::DissipatedEnergy) { figures.dissipated_energy() } else { 0.0 };
        let work = if is_requested(PostproKind::KineticEnergy) { figures.work_of_forces() } else { 0.0 };
        let mut sums = state.postpro;
        sums.dissipated += dissipated;
        sums.outside_work += work;
        for (command, files) in &mut self.commands {
            let is_due = command.period > 0 && state.step / command.period > previous_step / command.period;
            if !is_due {
                continue;
            }
            let rows: Vec<Vec<f64>> = match &command.kind {
                PostproKind::SolverInformations => {
                    files[0].append(&format!("{}\n", figures.solver_row()))?;
                    continue;
                }
                PostproKind::ViolationEvolution => vec![figures.violation().to_vec()],
                PostproKind::KineticEnergy => {
                    let (kinetic, potential) = (figures.kinetic_energy(), figures.potential_energy());
                    vec![vec![kinetic, kinetic, -sums.outside_work, potential, 0.0]]
                }
                PostproKind::DissipatedEnergy => vec![vec![sums.dissipated, dissipated]],
                PostproKind::CoordinationNumber => figures.coordination().into_iter().map(|row| row.to_vec()).collect(),
                PostproKind::BodyTracking(bodies) => bodies.iter().map(|&i| figures.body_motion(i).to_vec()).collect(),
                PostproKind::TorqueEvolution(bodies) => {
                    bodies.iter().flat_map(|&i| figures.forces(i)).map(|load| load.components().to_vec()).collect()
                }
                PostproKind::NewRigidSets(sets) => sets.iter().flat_map(|set| figures.set_rows(set)).collect(),
            };
            for (file, row) in files.iter_mut().zip(rows) {
                let mut text = fortran_es(state.time, 8);
                row.iter().for_each(|&x| text += &format!(" {}", fortran_es(x, 7)));
                file.append(&format!("{text}\n"))?;
            }
        }
        state.postpro = sums;
        Ok(())
    }

    /// Writes the rows so far, so that other programs can read them.
    pub fn flush_to_file(&mut self) -> Result<(), Faults> {
        self.files_mut().try_for_each(AppendedFile::flush_to_file)
    }

    /// Writes the rows so far and waits until they are on the disk.
    pub fn sync_to_disk(&mut self) -> Result<(), Faults> {
        self.files_mut().try_for_each(AppendedFile::sync_to_disk)
    }

    /// All files, in the order of their commands.
    pub fn files(&self) -> impl Iterator<Item = &AppendedFile> {
        self.commands.iter().flat_map(|(_, files)| files)
    }

    fn files_mut(&mut self) -> impl Iterator<Item = &mut AppendedFile> {
        self.commands.iter_mut().flat_map(|(_, files)| files)
    }
}

/// Opens a file whose rows begin with the time; with the time of a resumed state (s) its complete rows up to that time are
/// kept. Errors: it cannot be read or written.
fn open_row_file(path: &Path, resume_time: Option<f64>) -> Result<AppendedFile, Faults> {
    let last: Option<f64> = resume_time.and_then(|time| fortran_es(time, 8).trim().parse().ok());
    let old = last.and_then(|last| Some((last, atomic::open_to_read(path).ok()?)));
    atomic::write_with(path, |file| {
        let Some((last, old)) = old else { return Ok(()) };
        let mut old = BufReader::new(old);
        let mut row = String::new();
        while old.read_line(&mut row)? > 0 {
            let time = row.get(..TIME_WIDTH).and_then(|time| time.trim().parse::<f64>().ok());
            if !row.ends_with('\n') || time.is_none_or(|time| time > last) {
                break;
            }
            file.write_all(row.as_bytes())?;
            row.clear();
        }
        Ok(())
    })?;
    AppendedFile::open(path)
}

/// Width of the time in a row, characters.
const TIME_WIDTH: usize = 15;

/// Number as Fortran's `ES` writes it with so many digits after the point, `digits + 7` columns wide.
fn fortran_es(x: f64, digits: usize) -> String {
    let text = format!("{:.digits$e}", x + 0.0); // without a negative zero
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let sign = if exponent < 0 { '-' } else { '+' };
    // As in Fortran, an exponent of three digits has no letter.
    let letter = if exponent.abs() < 100 { "E" } else { "" };
    format!("{:>width$}", format!("{mantissa}{letter}{sign}{:02}", exponent.abs()), width = digits + 7)
}

/// A step from which figures are computed.
struct StepFigures<'a> {
    scene: &'a Scene,
    state: &'a State,
    report: &'a StepReport,
    start: &'a StepStart,
    /// Force (N, fixed axes) and moment (N m, axes of the body) of all contacts on each body.
    reaction: Vec<Wrench>,
}

impl<'a> StepFigures<'a> {
    fn new(scene: &'a Scene, state: &'a State, report: &'a StepReport, start: &'a StepStart) -> Self {
        let mut reaction = vec![Wrench::default(); state.x.len()];
        for solved in &state.contacts {
            let frame = solved.contact.frame();
            let (force, couple) =
                (to_world(&frame, &solved.impulse) / state.h, to_world(&frame, &solved.moment) / state.h);
            for (body, arm, sign) in start.arms(solved) {
                let sum = &mut reaction[body.index()];
                sum.force += force * sign;
                sum.torque += (arm.cross(&force) + couple) * sign;
            }
        }
        for (i, load) in reaction.iter_mut().enumerate() {
            load.torque = start.q[i].inverse_transform_vector(&load.torque);
        }
        StepFigures { scene, state, report, start, reaction }
    }

    /// Velocity, m/s, and angular velocity in the axes of the body, rad/s.
    fn velocity(&self, i: usize) -> Twist {
        Twist { v: self.state.v[i], w: self.state.q[i].inverse_transform_vector(&self.state.w[i]) }
    }

    /// Moments of inertia about the axes of the body, kg m².
    fn inertia(&self, i: usize) -> Vec3 {
        self.scene.bodies[i].inertia.into()
    }

    /// Force and moment on a body other than by contacts: for a free body the rest of its change of momentum, for a driven
    /// one its weight and imposed loads; imposed and gyroscopic moments.
    fn external_force(&self, i: usize) -> Wrench {
        let (scene, state) = (self.scene, self.state);
        let body = &scene.bodies[i];
        let mut loads = [Vec3::zeros(); 2];
        let (theta, before) = (scene.options.theta, state.time - state.h);
        for load in scene.loads.iter().filter(|load| load.body.index() == i) {
            let value = (1.0 - theta) * load.value.value_at(before) + theta * load.value.value_at(state.time);
            loads[load.component / 3][load.component % 3] +=
                load.load_at(value, &state.x, |drum| state.radius_of(drum));
        }
        let [mut force, mut torque] = loads;
        if body.driven {
            force += state.gravity * body.mass;
        } else {
            force = (state.v[i] - self.start.v[i]) * (body.mass / state.h) - self.reaction[i].force;
        }
        let w = self.start.q[i].inverse_transform_vector(&self.start.w[i]);
        torque -= w.cross(&self.inertia(i).component_mul(&w));
        Wrench { force, torque }
    }

    /// Rows of contact force, other force, and rate of change of momentum.
    fn forces(&self, i: usize) -> [Wrench; 3] {
        let body = &self.scene.bodies[i];
        let before = self.start.q[i].inverse_transform_vector(&self.start.w[i]);
        let inertial = Wrench {
            force: (self.state.v[i] - self.start.v[i]) * (body.mass / self.state.h),
            torque: self.inertia(i).component_mul(&(self.velocity(i).w - before)) / self.state.h,
        };
        [self.reaction[i], self.external_force(i), inertial]
    }

    /// Position, displacement and velocity of a body.
    fn body_motion(&self, i: usize) -> [f64; 12] {
        self.motion_at(i, self.state.x[i])
    }

    /// Position of the first contactor of a body, and displacement and velocity of the body.
    fn contactor_motion(&self, i: usize) -> [f64; 12] {
        let part = self.scene.find_part(BodyId::new(i), 0);
        self.motion_at(i, part.map_or(self.state.x[i], |part| self.state.x[i] + self.state.q[i] * part.offset))
    }

    /// Position `x`, moved into the period, with the displacement and velocity of a body.
    fn motion_at(&self, i: usize, mut x: Vec3) -> [f64; 12] {
        let (scene, state) = (self.scene, self.state);
        for (axis, period) in scene.options.periods().into_iter().enumerate() {
            x[axis] = period.map_or(x[axis], |period| x[axis].rem_euclid(period));
        }
        let (displacement, velocity) = (state.x[i] - scene.reference[i], self.velocity(i));
        let columns = [x, displacement, velocity.v, velocity.w];
        std::array::from_fn(|k| columns[k / 3][k % 3])
    }

    /// Rows of a set: mean motion, and sums of forces.
    fn set_rows(&self, bodies: &[usize]) -> [Vec<f64>; 4] {
        let mut motion = vec![0.0; 12];
        let mut sums = [0; 3].map(|_| vec![0.0; 6]);
        for &i in bodies {
            motion.iter_mut().zip(self.contactor_motion(i)).for_each(|(sum, x)| *sum += x);
            for (sum, load) in sums.iter_mut().zip(self.forces(i)) {
                sum.iter_mut().zip(load.components()).for_each(|(sum, x)| *sum += x);
            }
        }
        motion.iter_mut().for_each(|x| *x /= bodies.len().max(1) as f64);
        let [reaction, external, inertial] = sums;
        [motion, reaction, external, inertial]
    }

    /// Kinetic energy of all bodies, J.
    fn kinetic_energy(&self) -> f64 {
        let energy = |i: usize| {
            let Twist { v, w } = self.velocity(i);
            0.5 * (self.scene.bodies[i].mass * v.norm_squared() + w.dot(&self.inertia(i).component_mul(&w)))
        };
        (0..self.state.x.len()).map(energy).sum()
    }

    /// Energy of the displacements in uniform gravity, J.
    fn potential_energy(&self) -> f64 {
        let (scene, state) = (self.scene, self.state);
        let energy = |i: usize| -scene.bodies[i].mass * (state.x[i] - scene.reference[i]).dot(&state.gravity);
        (0..state.x.len()).map(energy).sum()
    }

    /// Work of all forces over the step at its end velocities, J.
    fn work_of_forces(&self) -> f64 {
        let work = |i: usize| {
            let (velocity, external, reaction) = (self.velocity(i), self.external_force(i), self.reaction[i]);
            let power = (reaction.force + external.force).dot(&velocity.v);
            self.state.h * (power + (reaction.torque + external.torque).dot(&velocity.w))
        };
        (0..self.state.x.len()).map(work).sum()
    }

    /// Energy that the contacts dissipate in the step, J: −Σ r·((1−θ) u⁻ + θ u⁺).
    fn dissipated_energy(&self) -> f64 {
        let (start, theta) = (self.start, self.scene.options.theta);
        let work = |solved: &SolvedContact| {
            let frame = solved.contact.frame();
            let [mut u, mut relative_rotation] = [Vec3::zeros(), Vec3::zeros()];
            for (body, arm, sign) in start.arms(solved) {
                let i = body.index();
                u += (start.v[i] + start.w[i].cross(&arm)) * sign;
                relative_rotation += (start.w[i] * (1.0 - theta) + self.state.w[i] * theta) * sign;
            }
            let mean_u = to_local(&frame, &u) * (1.0 - theta) + solved.velocity * theta;
            solved.impulse.dot(&mean_u) + solved.moment.dot(&to_local(&frame, &relative_rotation))
        };
        -self.state.contacts.iter().map(work).sum::<f64>()
    }

    /// Mean penetrations in the contact configuration and in the next, and the largest in each, m.
    fn violation(&self) -> [f64; 4] {
        let mut row = [0.0f64; 4];
        for solved in &self.state.contacts {
            let gap = solved.contact.gap;
            for (k, depth) in
                [-gap, -gap - self.state.h * solved.velocity.x].map(|depth| depth.max(0.0)).into_iter().enumerate()
            {
                row[k] += depth;
                row[k + 2] = row[k + 2].max(depth);
            }
        }
        let count = self.state.contacts.len().max(1) as f64;
        [row[0] / count, row[1] / count, row[2], row[3]]
    }

    /// Contacts per grain: all listed, then compressive, tensile and either per grain that has such a contact. Pairs of
    /// contactors count once; grains are spheres and polyhedra. None without grains.
    fn coordination(&self) -> Option<[f64; 4]> {
        let scene = self.scene;
        let is_grain = |body: BodyId, part_number: u16| match scene.bodies[body.index()].shape {
            BodyShape::Sphere { .. } => true,
            BodyShape::Plane { .. } => false,
            BodyShape::Parts => matches!(
                scene.find_part(body, part_number).map(|part| &part.geometry),
                Some(ContactorShape::Sphere { .. } | ContactorShape::Polyhedron(_))
            ),
        };
        let contactors = |i: usize| if scene.has_parts() { scene.parts_of(BodyId::new(i)).len() } else { 1 };
        // Numbers of all listed, of compressive and of tensile pairs by grain.
        let mut counts_of_grains = std::collections::BTreeMap::<(BodyId, u16), [u32; 3]>::new();
        for i in 0..scene.bodies.len() {
            let part_numbers = (0..contactors(i) as u16).filter(|&part_number| is_grain(BodyId::new(i), part_number));
            counts_of_grains.extend(part_numbers.map(|part_number| ((BodyId::new(i), part_number), [0; 3])));
        }
        let pair = |a: &SolvedContact| (a.contact.candidate, a.contact.antagonist, a.contact.part_numbers);
        for contacts in self.state.contacts.chunk_by(|a, b| pair(a) == pair(b)) {
            let (candidate, antagonist, part_numbers) = pair(&contacts[0]);
            let any_force = |holds: fn(f64) -> bool| u32::from(contacts.iter().any(|solved| holds(solved.impulse.x)));
            let counts = [1, any_force(|r_n| r_n > 0.0), any_force(|r_n| r_n < 0.0)];
            for grain in [(candidate, part_numbers.candidate), (antagonist, part_numbers.antagonist)] {
                let Some(sums) = counts_of_grains.get_mut(&grain) else { continue };
                sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
            }
        }
        let sum = |k: usize| counts_of_grains.values().map(|counts| counts[k]).sum::<u32>();
        let grains_with =
            |holds: fn(&[u32; 3]) -> bool| counts_of_grains.values().filter(|counts| holds(counts)).count();
        let mean = |sum: u32, grains: usize| if grains > 0 { f64::from(sum) / grains as f64 } else { 0.0 };
        (!counts_of_grains.is_empty()).then(|| {
            [
                mean(sum(0), counts_of_grains.len()),
                mean(sum(1), grains_with(|counts| counts[1] > 0)),
                mean(sum(2), grains_with(|counts| counts[2] > 0)),
                mean(sum(1) + sum(2), grains_with(|counts| counts[1] + counts[2] > 0)),
            ]
        })
    }

    /// Sweeps, criteria divided by the tolerance, and the number of contacts.
    fn solver_row(&self) -> String {
        let norms = self.report.norms.unwrap_or_default();
        let criteria =
            [norms.mean_dvor, norms.quad_dv, norms.quad_dvr].map(|norm| fortran_es(norm / self.report.tol, 7));
        let (sweeps, contacts) = (self.report.sweeps, self.report.contacts_listed);
        format!("{} {sweeps:8} {} {contacts:8}", fortran_es(self.state.time, 8), criteria.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::fortran_es;

    #[test]
    fn numbers_are_those_of_fortran() {
        let written = [0.03, -41.092_033, 0.0, -0.0, 1e-123, -2.5e100].map(|x| fortran_es(x, 7));
        let expected = [
            " 3.0000000E-02",
            "-4.1092033E+01",
            " 0.0000000E+00",
            " 0.0000000E+00",
            " 1.0000000-123",
            "-2.5000000+100",
        ];
        assert_eq!(written, expected);
        assert_eq!(fortran_es(0.03, 8), " 3.00000000E-02");
    }
}
