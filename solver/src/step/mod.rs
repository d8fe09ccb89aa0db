//! One time step as the list of its stages; the equations are numbered as in `docs/explanation/method/`.

mod admissible;
mod bond_closing;
mod cell_stress;
mod clock;
mod collectives;
mod conflict;
mod context;
mod ends;
mod error_loads;
mod implicit_step;
mod ledger;
mod overturning;
mod radius_stress;
mod totals;
mod velocity_errors;

pub use self::clock::StageTimes;
pub use self::collectives::deepest_overlap_of_ranks;
pub use self::ledger::{BalanceErrors, MotionTotals, StepReport, StepStart, WorstContact};
pub use self::radius_stress::side_impulse;
pub use self::totals::{OVERLAP_WARNING_SHARE, Overlap, deeper_overlap};

use rayon::prelude::*;

use self::admissible::solve_until_admissible;
use self::clock::StageClock;
use self::context::{PredictedStep, StepContext};
use self::ends::finish_contacts;
use self::ledger::update_ledger;
use self::overturning::approach;
use self::velocity_errors::refine_until_decided;
use crate::activity::{self, StepStage};
use crate::assemble::{self, AppliedEvents};
use crate::detect::{self, NarrowPhaseError};
use crate::integrate::{self, ContactConfiguration};
use crate::laws::ContactLaw;
use crate::math::simd::SimdWidth;
use crate::math::{PAR_MIN_LEN, Vec3};
use crate::ranks::lists::max_over_ranks;
use crate::scene::{RigidBody, Scene};
use crate::solve::{self, SolveRequest, StoppingCriteria};
use crate::state::{BondingMode, Contact, State, StateBackup, Velocities};

/// Advances the state by one step. Returns `None`, with the state unchanged, if the program was requested to stop within it.
pub fn step(scene: &Scene, state: &mut State, times: &mut StageTimes) -> Option<StepReport> {
    let clock = &mut StageClock::start(times);
    let before = StateBackup::new(scene, state);
    activity::begin_stage(StepStage::Forces, 0);
    let (events, q_c) = begin_step(scene, state); // M1  x_c = x + (1-θ) h V
    clock.add_lap(|times| &mut times.integration);
    let mut free = assemble::free_velocity(scene, state, &q_c, &events.shakes); // M2  V_free = V + h M⁻¹ F(x_c)
    state.attraction = free.attraction.take();
    clock.add_lap(|times| &mut times.gravity);
    activity::begin_stage(StepStage::Detection, 0);
    let contacts = detect::listed_contacts(scene, &q_c, free.velocities(), &mut state.detection_cache); // M3  g, (n, t, s)
    detect::migrate_contacts(scene, state);
    let narrow_phase_error = sample_narrow_phase_error(scene, state, &q_c, free.velocities(), &contacts);
    clock.add_lap(|times| &mut times.detection);
    let request = solve_request(scene, state, &q_c, &contacts, free.velocities());
    let mut predicted = PredictedStep { q_c, free, contacts };
    let solved = solve_until_admissible(scene, state, &mut predicted, request, clock); // M4, M5  W, b, r
    let Some(mut solved) = solved else {
        before.restore_to(state);
        return None;
    };
    let PredictedStep { q_c, free, contacts } = predicted;
    let context = StepContext { scene, q_c: &q_c, free: &free, contacts: &contacts };
    let errors = refine_until_decided(context, &state.laws, request, &mut solved);
    if activity::is_stopped() {
        // A refinement that was stopped leaves undecided which bonds break.
        before.restore_to(state);
        return None;
    }
    solve::update_backoff(&mut state.fallback, request, state.step, q_c.step_multiple, &solved.solution);
    clock.add_lap(|times| &mut times.solve);
    let outcome = finish_contacts(context, state, &solved, errors.as_ref());
    let mut report = StepReport { narrow_phase_error, ..update_ledger(context, state, &solved, &outcome) };
    if !events.shakes.is_empty() {
        report.flight_error = 0.0; // a shake is an impulse, and exact
    }
    if let Some(laws) = solved.original_laws.take() {
        state.laws = laws;
    }
    integrate::advance_response(scene, state, &q_c, &free.primary_impulse);
    integrate::advance_state(scene, state, &q_c, outcome.v, outcome.w); // M6  V⁺, x⁺ = x_c + θ h V⁺
    (state.contacts, state.order) = (outcome.contacts, q_c.order);
    state.memories = ends::end_memories(&mut solved);
    state.pair_attractions = std::mem::take(&mut solved.contact_problem.pair_attractions);
    bond_closing::close_bonds(scene, state, &solved.contact_problem);
    state.bonding = BondingMode::No;
    assemble::keep_problem_memory(solved.contact_problem);
    solve::keep_solution_memory(solved.solution);
    clock.add_lap(|times| &mut times.integration);
    Some(report)
}

/// Applies the events, the torque and the damping of the next step, chooses its length and predicts the configuration in
/// which its contacts are detected.
fn begin_step(scene: &Scene, state: &mut State) -> (AppliedEvents, ContactConfiguration) {
    let events = assemble::apply_events(scene, state);
    let multiple = integrate::choose_step_multiple(scene, state, events.any_event || state.bodies_entered);
    assemble::apply_torque_and_damping(scene, state, multiple);
    let unbounded = implicit_step::velocities_are_unbounded(scene, state, &events);
    let is_implicit = implicit_step::needs_implicit_step(scene, state, multiple, unbounded);
    let changed = implicit_step::velocities_have_changed(scene, state, &events);
    let predict = if is_implicit { integrate::implicit_configuration } else { integrate::predict_configuration };
    (events, ContactConfiguration { changed, ..predict(scene, state, multiple) })
}

/// Contacts that the fast narrow phase missed, in the steps in which this is checked.
fn sample_narrow_phase_error(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    free: Velocities,
    contacts: &[Contact],
) -> Option<NarrowPhaseError> {
    let is_checked = scene.narrow_phase_is_fast() && state.is_diagnostic_step(q_c.step_multiple);
    is_checked.then(|| detect::narrow_phase_error(scene, q_c, free, &state.detection_cache, contacts))
}

/// Largest residual with which no pair passes another: velocities are wrong by at most the residual times the largest velocity
/// at which a contact closes, and over the step this may be a small share of the radius. Infinite if any residual will do,
/// as in steps in which bodies move by less than their radius.
///
/// `free`: velocities after the step if nothing touched. `is_divided`: whether other ranks have other contacts.
fn travel_tolerance(
    scene: &Scene,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
    is_divided: bool,
) -> f64 {
    let span = q_c.reach_time(scene);
    let allowed = MAX_TRAVEL_ERROR * scene.smallest_radius;
    // Without fast bodies no contact is evaluated.
    let speed = |(i, ((body, v), w)): (usize, ((&RigidBody, &Vec3), &Vec3))| {
        q_c.relative_motion(i, v).norm() + w.norm() * body.radius
    };
    let bodies = scene.bodies.par_iter().zip(free.v).zip(free.w).enumerate().with_min_len(PAR_MIN_LEN);
    let fastest = bodies.map(speed).reduce(|| 0.0, f64::max);
    if 2.0 * span * fastest * scene.options.tol() <= allowed {
        return f64::INFINITY;
    }
    // Contacts that cannot close depend on the alert distance and must not change a result.
    let contacts = contacts.par_iter().with_min_len(PAR_MIN_LEN);
    let approaches = contacts.map(|contact| (approach(q_c, span, contact, free), contact.gap));
    let closing = approaches.filter(|(approach, gap)| approach > gap).map(|(approach, _)| approach);
    let largest = closing.reduce(|| 0.0, f64::max);
    allowed / if is_divided { max_over_ranks(largest) } else { largest }
}

/// Largest error of a displacement by unfinished solutions, divided by the smallest radius. The residual is a mean over
/// contacts: a single one may err by several times as much.
const MAX_TRAVEL_ERROR: f64 = 0.01;

/// Requirements of the step for its solver.
///
/// The solution has converged at `tol`; a smaller residual is sought where errors are not corrected by later steps.
fn solve_request(
    scene: &Scene,
    state: &State,
    q_c: &ContactConfiguration,
    contacts: &[Contact],
    free: Velocities,
) -> SolveRequest {
    let options = &scene.options;
    let is_divided = state.detection_cache.is_divided();
    let tol = options.tol().min(travel_tolerance(scene, q_c, contacts, free, is_divided));
    // Errors of a restitution impulse are not corrected by later steps.
    let restitution_factor =
        if state.laws.iter().any(ContactLaw::has_restitution) { MIN_TOLERANCE_FACTOR } else { 1.0 };
    // Errors in breaking bonds or starting to slide are not corrected either.
    let loss_factor = if state.laws.iter().any(ContactLaw::has_irreversible_loss) {
        LOSS_TOLERANCE_FACTOR.min(MAX_LOSS_RESIDUAL / tol)
    } else {
        1.0
    };
    // Velocity errors scale with the residual times the velocity change of the step, which grows with its length.
    let length_factor = 1.0 / q_c.step_multiple as f64;
    let penetration_factor = penetration_tolerance_factor(options.penetration_tol(), state.ledger.penetration_left);
    let criteria = StoppingCriteria {
        target_residual: tol * restitution_factor.min(loss_factor).min(penetration_factor).min(length_factor),
        // One sweep for each `dt`; LMGC90's blocks have a set number of sweeps.
        min_sweeps: if options.check_every.is_some() { 0 } else { q_c.step_multiple },
        check_every: options.check_every,
        precision: options.sweep_precision,
        ..StoppingCriteria::new(tol, options.max_sweeps())
    };
    SolveRequest {
        solver: options.solver,
        criteria,
        width: SimdWidth::detect(),
        fallback_suppressed: state.step < state.fallback.due,
    }
}

/// Smallest factor on the residual sought, reached as overlap accumulates.
const MIN_TOLERANCE_FACTOR: f64 = 1e-2;

/// Factor on the residual sought where contacts have irreversible losses.
const LOSS_TOLERANCE_FACTOR: f64 = 0.1;

/// Largest residual with which irreversible losses are decided: a load of 0.9 or 1.1 of a limit is then on its side of it.
const MAX_LOSS_RESIDUAL: f64 = 1e-3;

/// Factor on `tol` for the residual sought, <= 1, where the penetration that earlier solutions have left (divided by
/// the mean radius) exceeds `penetration_tol`: with twice as much, 1/4.
///
/// The approach velocity that a residual leaves becomes overlap, which laws keep. Where loaded grains move slowly for a long
/// time it accumulates, and a smaller residual is needed.
fn penetration_tolerance_factor(penetration_tol: f64, penetration_left: f64) -> f64 {
    let factor = penetration_tol / penetration_left.max(penetration_tol);
    (factor * factor).max(MIN_TOLERANCE_FACTOR)
}

/// Number of `dt` in the next step, and the contact problem of that step, written out.
pub fn next_problem(scene: &Scene, state: &State) -> (u64, assemble::StoredProblem) {
    let (step_multiple, contact_problem, contacts) = next_contact_problem(scene, state);
    (step_multiple, assemble::stored_problem(&contact_problem, &contacts))
}

/// Number of `dt` in the next step, and the contact problem of that step with its contacts.
pub fn next_contact_problem(scene: &Scene, state: &State) -> (u64, assemble::ContactProblem, Vec<Contact>) {
    let mut state = state.clone();
    let (events, q_c) = begin_step(scene, &mut state);
    let free = assemble::free_velocity(scene, &state, &q_c, &events.shakes);
    let contacts = detect::listed_contacts(scene, &q_c, free.velocities(), &mut state.detection_cache);
    let contact_problem = assemble::contact_problem(scene, &state, &q_c, &contacts, free.velocities());
    (q_c.step_multiple, contact_problem, contacts)
}

#[cfg(test)]
mod tests {
    use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
    use cd_formats::bulk_behav::{BulkBehav, Material};
    use cd_formats::compute::{Compute, ComputeFlags, ContactSolver};
    use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof, Evolution};
    use cd_formats::tact_behav::{LawRecord, TactBehav, VisibilityRow, VisibilitySide};

    use super::*;
    use crate::activity::QUERIES_UNTIL_STOP;

    /// Three cubes of 1 m and 1 kg, or balls of this diameter, one below the other under a ceiling at z = 0.
    struct Column {
        has_cubes: bool,
        law: (&'static str, &'static [f64]),
        gravity: [f64; 3],
        solver: ContactSolver,
    }

    impl Column {
        fn bodies(&self) -> Vec<Body> {
            let body = |colour: &str, z: f64, shape: ShapeRecord| Body {
                line: 0,
                material: "ROCKx".into(),
                equivalent_radius: 0.0,
                inertia: None,
                position: [0.0, 0.0, z],
                contactors: vec![Contactor { colour: colour.into(), shape, local_frame: None }],
            };
            let vertices = (0..8).map(|k| [0, 1, 2].map(|i| f64::from(k >> i & 1) - 0.5)).collect();
            let triangles: [[u32; 3]; 12] = [
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
            let grain = match self.has_cubes {
                true => ShapeRecord::Polyhedron { vertices, triangles: triangles.into() },
                false => ShapeRecord::Sphere { radius: 0.5 },
            };
            let ceiling = ShapeRecord::Plane { half_lengths: [2.0, 2.0, 0.5] };
            let grains = [-0.5, -1.5, -2.5].map(|z| body("GRAIN", z, grain.clone()));
            grains.into_iter().chain([body("WALLx", 0.5, ceiling)]).collect()
        }

        fn tact(&self) -> TactBehav {
            let (kind, parameters) = self.law;
            let grain = if self.has_cubes { "POLYR" } else { "SPHER" };
            let side = |contactor: &str, colour: &str| VisibilitySide {
                body: "RBDY3".into(),
                contactor: contactor.into(),
                colour: colour.into(),
            };
            let row = |antagonist: VisibilitySide| VisibilityRow {
                line: 0,
                candidate: side(grain, "GRAIN"),
                law: "law00".into(),
                antagonist,
                alert: 1e-3,
            };
            TactBehav {
                visibility: vec![row(side(grain, "GRAIN")), row(side("PLANx", "WALLx"))],
                laws: vec![LawRecord {
                    line: 0,
                    nickname: "law00".into(),
                    kind: kind.into(),
                    parameters: parameters.into(),
                }],
            }
        }

        /// Scene and state at the start.
        fn read(&self) -> (Scene, State) {
            let folder = tempfile::tempdir().unwrap();
            let datbox = folder.path().join("DATBOX");
            std::fs::create_dir_all(&datbox).unwrap();
            let put = |name: &str, text: String| std::fs::write(datbox.join(name), text).unwrap();
            put("BODIES.DAT", Bodies(self.bodies()).to_text());
            let materials = vec![Material { name: "ROCKx".into(), density: 1.0 }];
            put("BULK_BEHAV.DAT", BulkBehav { gravity: self.gravity, materials }.to_text());
            put("TACT_BEHAV.DAT", self.tact().to_text());
            let driven = |component| DrivenComponent {
                line: 0,
                body: 3,
                component,
                kind: DrivenKind::Velocity,
                evolution: Evolution::constant(0.0),
            };
            put("DRV_DOF.DAT", DrvDof((0..6).map(driven).collect()).to_text());
            let options = Compute {
                dt: 1.0 / 1024.0,
                tol: Some(1e-3),
                max_sweeps: Some(2000),
                solver: self.solver,
                ..Compute::default()
            };
            put("COMPUTE.RON", options.to_text());
            crate::read::read_case(folder.path(), &ComputeFlags::default()).unwrap()
        }
    }

    /// The next step and the number of its queries, stopped at the query `stop`.
    fn stopped_step(scene: &Scene, state: &mut State, stop: u64) -> (Option<StepReport>, u64) {
        QUERIES_UNTIL_STOP.set(stop);
        let report = step(scene, state, &mut StageTimes::default());
        (report, stop - QUERIES_UNTIL_STOP.replace(u64::MAX))
    }

    /// A step that is stopped at any query of any solver is abandoned, and repeated with the result of an unbroken one.
    #[test]
    fn a_step_that_is_stopped_anywhere_is_repeated() {
        use ContactSolver::{Admm, Auto, InteriorPoint, Nlgs, NlgsAnderson, ProxNewton};
        let (hanging, pressed) = ([0.0, 0.0, -8.0], [1.0, 0.5, 8.0]);
        // On 1 m² hang three cubes of 24 N in all: the bonds of the first break, which a refinement decides.
        let bonds: (_, &[f64]) = ("IQS_MOHR_DS_CLB", &[20.0, 20.0, 0.3, 0.3]);
        let beams: (_, &[f64]) = ("IQS_BEAM_DS_CLB", &[1e3, 1e3, 0.5, 0.3, 0.3]);
        let elastic_beams: (_, &[f64]) = ("ELASTIC_BEAM_DS_CLB", &[1e6, 4e5, 1e3, 1e3, 0.5, 0.3, 0.3]);
        let friction: (_, &[f64]) = ("IQS_CLB", &[0.3]);
        let mut columns = Vec::new();
        for solver in [Auto, Nlgs, NlgsAnderson, ProxNewton, Admm, InteriorPoint] {
            columns.push(Column { has_cubes: true, law: bonds, gravity: hanging, solver });
            columns.push(Column { has_cubes: false, law: friction, gravity: pressed, solver });
        }
        for law in [beams, elastic_beams] {
            columns.push(Column { has_cubes: false, law, gravity: hanging, solver: Auto });
            columns.push(Column { has_cubes: true, law, gravity: hanging, solver: Auto });
        }
        for column in &columns {
            let (name, solver) = (column.law.0, column.solver);
            let (scene, before) = column.read();
            let mut end = before.clone();
            let (report, queries) = stopped_step(&scene, &mut end, u64::MAX);
            assert!(queries > 2, "{name}, {solver}: {queries} queries");
            // The last queries are those of the refinement.
            for stop in (1..=queries).rev().step_by(1 + queries as usize / 30) {
                let mut state = before.clone();
                let (stopped, _) = stopped_step(&scene, &mut state, stop);
                let place = format!("{name}, {solver}: query {stop} of {queries}");
                assert!(stopped.is_none() && state == before, "{place}");
                let repeated = step(&scene, &mut state, &mut StageTimes::default());
                assert_eq!(repeated, report, "{place}");
                assert!(state == end, "{place}");
            }
        }
    }
}
