//! Bonds that carry moments: beams of balls against the closed forms of beams.

use std::f64::consts::PI;

use cd_formats::compute::EventAction;
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{AXES, Case, Figures, Vec3, equal, near, uniform};
use crate::same_bits::{files, same};

/// Radius of the balls, m.
const RADIUS: f64 = 0.5;
/// Mass of a ball, kg.
const MASS: f64 = PI / 6.0;
/// Weight of a ball, N.
const WEIGHT: f64 = 8.0 * MASS;

/// Strengths (Pa) and radius of the bonds.
#[derive(Clone, Copy)]
struct Bonds {
    normal: f64,
    tangential: f64,
    radius: f64,
}

/// Bonds that nothing here breaks.
const STRONG: Bonds = Bonds { normal: 1e6, tangential: 1e6, radius: 1.0 };

impl Bonds {
    /// R_b, m.
    fn radius(&self) -> f64 {
        self.radius * RADIUS
    }

    /// S, m².
    fn area(&self) -> f64 {
        PI * self.radius().powi(2)
    }

    /// I/R_b, m³.
    fn bending_modulus(&self) -> f64 {
        PI / 4.0 * self.radius().powi(3)
    }

    /// J/R_b, m³.
    fn torsion_modulus(&self) -> f64 {
        2.0 * self.bending_modulus()
    }
}

/// A row of touching balls along x, the first in the origin, without gravity.
fn row(balls: usize, bonds: Bonds) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_BEAM_DS_CLB", &[bonds.normal, bonds.tangential, bonds.radius, 0.125, 0.25]);
    (0..balls).for_each(|k| {
        case.sphere(RADIUS, [k as f64, 0.0, 0.0]);
    });
    case
}

/// A row of which the first ball is fixed.
fn cantilever(free: usize, bonds: Bonds) -> Case {
    let mut case = row(free + 1, bonds);
    case.drive(0, [0.0; 6].map(Evolution::constant));
    case
}

fn bonded(state: &Snapshot) -> Vec<u8> {
    state.memory.clone().expect("a law that remembers").contact_bonded
}

/// Force (N) and moment (N m) of contact `k` on its body with the lower number, world frame.
fn load(state: &Snapshot, k: usize) -> [Vec3; 2] {
    let [candidate, antagonist] = state.contacts.contact_body[k];
    let sign = if candidate < antagonist { 1.0 } else { -1.0 };
    let [n, t, s] = state.contacts.contact_frame[k].map(Vec3::from);
    let to_world = |[a, b, c]: [f64; 3]| n * a + t * b + s * c;
    let moment = state.memory.as_ref().unwrap().contact_moment[k];
    [to_world(state.contacts.contact_force[k]) * sign, to_world(moment) * (sign / state.meta.h)]
}

#[test]
fn every_bond_of_a_cantilever_carries_the_weight_beyond_it() {
    for free in [1, 3, 12] {
        let mut case = cantilever(free, STRONG);
        case.gravity = [0.0, 0.0, -8.0];
        let end = case.run(20);
        assert_eq!(bonded(&end), vec![1; free]);
        for k in 0..free {
            let beyond = (free - k) as f64;
            let [force, moment] = load(&end, k);
            // The outer balls pull the inner one down and bend it.
            near(force, [0.0, 0.0, -beyond * WEIGHT], 1e-9 * beyond * WEIGHT);
            let root = 0.5 * beyond * beyond * WEIGHT;
            near(moment, [0.0, root, 0.0], 1e-9 * (free * free) as f64 * WEIGHT);
        }
        assert!(case.column("sweeps").iter().sum::<f64>() < 2e3, "gradients, not sweeps");
    }
}

/// A row between two hinges, the centres of its first and last ball: M = R x - Σ m g (x - x_k).
#[test]
fn a_beam_on_two_hinges_bends_most_in_its_middle() {
    let balls = 8;
    let hinged = |bonds: Bonds| {
        let mut case = row(balls, bonds);
        case.gravity = [0.0, 0.0, -8.0];
        for end in [0, balls - 1] {
            case.drive(end, [0.0; 6].map(Evolution::constant));
            // Free to turn about y, and the second one to move along x.
            case.driven.retain(|driven| driven.body != end || ![4].contains(&driven.component));
        }
        case.driven.retain(|driven| driven.body != balls - 1 || driven.component != 0);
        case
    };
    let reaction = 0.5 * (balls - 2) as f64 * WEIGHT;
    let moment_at = |x: f64| {
        let own: f64 = (1..balls - 1).map(|k| WEIGHT * (x - k as f64).max(0.0)).sum();
        reaction * x - own
    };
    let end = hinged(STRONG).run(20);
    let largest = moment_at(0.5 * (balls - 1) as f64);
    for k in 0..balls - 1 {
        let [_, moment] = load(&end, k);
        near(moment, [0.0, -moment_at(k as f64 + 0.5), 0.0], 1e-8 * largest);
    }
    for (share, held) in [(0.99, true), (1.01, false)] {
        let normal = largest / STRONG.bending_modulus() / share;
        let end = hinged(Bonds { normal, tangential: 10.0 * normal, ..STRONG }).run(2);
        let expected: Vec<u8> = (0..balls - 1).map(|k| u8::from(held || k != balls / 2 - 1)).collect();
        assert_eq!(bonded(&end), expected, "{share}");
    }
}

/// σ_t = M R_b/I: the root breaks at 1.005 of its strength and not at 0.995.
#[test]
fn a_cantilever_breaks_at_its_root_at_the_strength_of_the_outermost_fibre() {
    for (free, radius) in [(1, 1.0), (3, 0.5), (10, 1.0), (20, 0.75)] {
        for (share, held) in [(0.995, 1), (1.005, 0)] {
            let bonds = Bonds { radius, ..STRONG };
            let moment = 0.5 * (free * free) as f64 * WEIGHT;
            let normal = moment / bonds.bending_modulus() / share;
            let mut case = cantilever(free, Bonds { normal, tangential: 10.0 * normal, radius });
            case.gravity = [0.0, 0.0, -8.0];
            let mut expected = vec![1; free];
            expected[0] = held;
            assert_eq!(bonded(&case.run(20)), expected, "{free} {radius} {share}");
        }
    }
}

/// A hanging row that is bent by a couple at its end: σ = F/S + M R_b/I.
#[test]
fn tension_and_bending_add_up() {
    for (share, held) in [(0.995, 1), (1.005, 0)] {
        let bonds = Bonds { normal: 40.0, tangential: 40.0, radius: 0.8 };
        let (pull, couple) = (0.3 * bonds.normal * bonds.area(), 0.7 * bonds.normal * bonds.bending_modulus());
        let mut case = cantilever(1, bonds);
        case.pull(1, 0, share * pull);
        case.pull(1, 4, share * couple);
        assert_eq!(bonded(&case.run(3)), [held], "{share}");
        // Pressed instead, it carries as much more.
        let mut case = cantilever(1, bonds);
        case.pull(1, 0, -pull);
        case.pull(1, 4, share * 1.3 * bonds.normal * bonds.bending_modulus());
        assert_eq!(bonded(&case.run(3)), [held], "{share}");
    }
}

/// τ = |F_T|/S + |T| R_b/J against c_t + (c_t/c_n) F_n/S.
#[test]
fn shear_and_torsion_share_one_strength() {
    for (pressure, shear_share) in [(0.0, 1.0), (0.0, 0.0), (0.0, 0.4), (0.5, 0.4), (-0.5, 0.4), (-0.5, 1.0)] {
        for (share, held) in [(0.995, 1), (1.005, 0)] {
            let bonds = Bonds { normal: 40.0, tangential: 20.0, radius: 0.8 };
            let strength = share * (1.0 + pressure) * bonds.tangential;
            let shear = shear_share * strength * bonds.area();
            let torque = (1.0 - shear_share) * strength * bonds.torsion_modulus();
            let mut case = cantilever(1, bonds);
            case.pull(1, 0, -pressure * bonds.normal * bonds.area());
            // Across, with the couple that leaves no moment in the bond.
            case.pull(1, 2, shear);
            case.pull(1, 4, RADIUS * shear);
            case.pull(1, 3, torque);
            assert_eq!(bonded(&case.run(3)), [held], "{pressure} {shear_share} {share}");
        }
    }
}

#[test]
fn a_twisted_row_hands_its_torque_on() {
    let mut case = cantilever(6, STRONG);
    case.pull(6, 3, 2.0);
    let end = case.run(3);
    for k in 0..6 {
        let [force, moment] = load(&end, k);
        near(force, [0.0; 3], 1e-10);
        near(moment, [2.0, 0.0, 0.0], 1e-10);
    }
}

/// In the step in which it breaks a bond gives its all; then the contact rubs, and no bond returns without an event.
#[test]
fn a_broken_bond_leaves_friction() {
    let bonds = Bonds { normal: 40.0, tangential: 40.0, radius: 0.8 };
    let strength = bonds.normal * bonds.bending_modulus();
    let mut case = cantilever(1, bonds);
    case.pull(1, 4, 1.25 * strength);
    case.event(0.01, EventAction::SetGravity([-8.0, 0.0, 0.0]));
    let states = case.states(100, 1);
    near(load(&states[1], 0)[1], [0.0, strength, 0.0], 1e-9 * strength);
    assert_eq!([1, 2, 90].map(|k| bonded(&states[k])[0]), [0; 3]);
    near(load(&states[2], 0)[1], [0.0; 3], 0.0);
    // It spins about y on the fixed ball, pressed with its weight: dynamic friction.
    let force = states[50].force(0, 1).unwrap();
    equal(force.yz().norm() / force.x, 0.125, 1e-9);
}

/// A free bar turns about an axis of its own as a rigid body; its bonds carry what keeps the balls on their circles.
#[test]
fn a_spinning_bar_keeps_its_shape() {
    let (balls, spin) = (5, 2.0);
    let mut case = row(balls, STRONG);
    for k in 0..balls {
        case.launch(k, [0.0, spin * (k as f64 - 2.0), 0.0], [0.0, 0.0, spin]);
    }
    let states = case.states(2000, 500);
    for state in &states[1..] {
        assert_eq!(bonded(state), [1; 4]);
        equal((state.x(4) - state.x(0)).norm(), 4.0, 1e-9);
        equal((state.x(4) - state.x(2)).cross(&(state.x(0) - state.x(2))).norm(), 0.0, 1e-9);
        for k in 0..balls {
            near(state.w(k), [0.0, 0.0, spin], 1e-9);
        }
        let tension = MASS * spin * spin;
        let [force, moment] = load(state, 1);
        // Second order of the angle of a step.
        equal(force.norm() / (3.0 * tension), 1.0, 1e-5);
        near(moment, [0.0; 3], 1e-8 * tension);
    }
}

/// A brick with a ball on one of its faces turns about no principal axis: the ball stays where it is on the brick.
#[test]
fn a_brick_and_a_ball_turn_as_one() {
    let mut case = Case::new();
    case.law_of_all("IQS_BEAM_DS_CLB", &[1e6, 1e6, 0.5, 0.125, 0.25]);
    let brick = case.block([0.5, 0.25, 0.75], [0.0; 3], AXES);
    let ball = case.sphere(RADIUS, [1.0, 0.1, 0.2]);
    let (masses, places) = ([0.75, MASS], [Vec3::zeros(), Vec3::new(1.0, 0.1, 0.2)]);
    let centre = (places[0] * masses[0] + places[1] * masses[1]) / (masses[0] + masses[1]);
    let spin = Vec3::new(0.6, 0.64, 0.48) * 2.0;
    for (body, place) in [brick, ball].into_iter().zip(places) {
        case.launch(body, spin.cross(&(place - centre)).into(), spin.into());
    }
    case.options.dt = 0.005;
    let states = case.states(2000, 500);
    for state in &states[1..] {
        let [w, x, y, z] = state.bodies.body_q[brick];
        let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
        let place = q.inverse() * (state.x(ball) - state.x(brick));
        // The square of the angle of a step; it does not grow.
        near(place, places[1], 1e-4);
        assert!((state.kinetic() / states[0].kinetic() - 1.0).abs() < 1e-4);
        near(state.angular_momentum(), states[0].angular_momentum(), 1e-10);
        assert_eq!(bonded(state), [1]);
    }
}

/// On a plate and on a block the disc is that of the ball.
#[test]
fn a_post_on_a_wall_or_a_block_breaks_at_its_foot() {
    let bonds = Bonds { normal: 40.0, tangential: 40.0, radius: 0.6 };
    for block in [false, true] {
        for (share, held) in [(0.995, 1), (1.005, 0)] {
            let mut case = Case::new();
            case.law_of_all("IQS_BEAM_DS_CLB", &[bonds.normal, bonds.tangential, bonds.radius, 0.125, 0.25]);
            let base = match block {
                true => case.block([1.0, 1.0, 0.5], [0.0, 0.0, -0.5], AXES),
                false => case.floor(),
            };
            case.drive(base, [0.0; 6].map(Evolution::constant));
            let ball = case.sphere(RADIUS, [0.0, 0.0, RADIUS]);
            case.pull(ball, 4, share * bonds.normal * bonds.bending_modulus());
            assert_eq!(bonded(&case.run(3)), [held], "{block} {share}");
        }
    }
}

/// Bonded faces carry moments by their area, as under IQS_MOHR_DS_CLB.
#[test]
fn faces_are_bonded_as_without_moments() {
    let run = |law: &str, parameters: &[f64]| {
        let mut case = Case::new();
        case.law_of_all(law, parameters);
        case.gravity = [0.0, 0.0, -8.0];
        case.block([0.5; 3], [0.0; 3], AXES);
        case.drive(0, [0.0; 6].map(Evolution::constant));
        case.block([0.5; 3], [1.0, 0.0, 0.0], AXES);
        let end = case.run(20);
        (bonded(&end), end.contacts.contact_force, end.bodies.body_x)
    };
    let moments = run("IQS_BEAM_DS_CLB", &[100.0, 100.0, 0.5, 0.125, 0.25]);
    assert_eq!(moments, run("IQS_MOHR_DS_CLB", &[100.0, 100.0, 0.125, 0.25]));
    assert_eq!(moments.0, [1; 4]);
}

/// A ball of bonded balls on a lattice that hits the floor.
fn projectile(speed: f64) -> Case {
    let mut case = Case::new();
    case.law_with("SPHER", "IQS_BEAM_DS_CLB", &[2e3, 2e3, 0.5, 0.3, 0.4]);
    case.law_with("PLANx", "IQS_CLB", &[0.3]);
    case.floor();
    let mut random = uniform(5);
    let turn = [random(), random(), random()].map(|angle| 2.0 * PI * angle);
    let q = nalgebra::Rotation3::from_euler_angles(turn[0], turn[1], turn[2]);
    let cells = (0..125).map(|k| [k % 5, k / 5 % 5, k / 25].map(|c| f64::from(c) - 2.0));
    let places: Vec<Vec3> = cells.map(|x| q * Vec3::from(x)).filter(|x| x.norm() < 2.1).collect();
    let lowest = places.iter().map(|x| x.z).fold(0.0, f64::min);
    for x in places {
        let ball = case.sphere(RADIUS, [x.x, x.y, x.z - lowest + RADIUS + 0.05]);
        case.launch(ball, [0.0, 0.0, -speed], [0.0; 3]);
    }
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (0.0025, Some(1e-6), Some(2000));
    case
}

/// Number of groups of bonded balls.
fn fragments(state: &Snapshot) -> usize {
    let mut groups: Vec<usize> = (0..state.bodies.body_x.len()).collect();
    for (pair, _) in state.contacts.contact_body.iter().zip(bonded(state)).filter(|(_, bond)| *bond == 1) {
        let [a, b] = pair.map(|body| groups[body as usize]);
        groups.iter_mut().filter(|group| **group == a).for_each(|group| *group = b);
    }
    let mut found: Vec<usize> = state.free().iter().map(|&body| groups[body]).collect();
    found.sort_unstable();
    found.dedup();
    found.len()
}

#[test]
fn a_faster_impact_makes_more_fragments() {
    let mut numbers = Vec::new();
    for speed in [0.25, 1.0, 4.0] {
        let mut case = projectile(speed);
        let states = case.states(200, 20);
        let bonds: Vec<u32> = states[1..].iter().map(|state| bonded(state).into_iter().map(u32::from).sum()).collect();
        assert!(bonds.is_sorted_by(|a, b| a >= b), "no bond returns: {bonds:?}");
        // The energy lost is the work of the contacts, as walls do none.
        let (start, work) = (states[0].kinetic(), *case.column("contact_work").last().unwrap());
        equal(states.last().unwrap().kinetic(), start + work, 1e-10 * start);
        assert!(case.column("momentum_drift").iter().all(|drift| *drift < 1e-11));
        numbers.push(fragments(states.last().unwrap()));
    }
    assert!(numbers[0] == 1 && numbers[1] > 1 && numbers[2] > 2 * numbers[1], "{numbers:?}"); // 1, 5, 27
}

#[test]
fn threads_and_resume_change_nothing() {
    let case = || {
        let mut case = projectile(1.0);
        (case.options.steps, case.options.output_every, case.options.text) = (Some(40), 10, true);
        case
    };
    let whole = case();
    let unbroken = files(&whole, &[&["--threads", "1"]]);
    let held: Vec<usize> = whole.written()[1..].iter().map(fragments).collect();
    assert!(held[0] == 1 && held[3] > 1, "{held:?}"); // a check of the check
    same(&unbroken, &files(&case(), &[&["--threads", "2", "--steps", "10"], &["--resume", "--threads", "3"]]));
}
