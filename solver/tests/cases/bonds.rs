//! Cohesion that is lost for good: bonds and liquid bridges.

use std::f64::consts::PI;

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::{Accuracy, EventAction};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::case::{Case, Figures, Vec3, equal, expect_same_bytes, near, solve};

const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// c_n, Pa, of the bonds below; c_t is half of it.
const COHESION: f64 = 32.0;

/// A ball of radius 1/2 that is bonded to a floor by c_n pi/4.
fn on_floor(gravity: [f64; 3]) -> Case {
    let mut case = Case::new();
    case.law("IQS_MOHR_DS_CLB", &[COHESION, 0.5 * COHESION, 0.125, 0.25]);
    case.gravity = gravity;
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case
}

/// Two touching balls of radius 1/2, bonded by c_n pi/16, pulled apart.
fn pair(gap: f64, pull: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_MOHR_DS_CLB", &[COHESION, 0.5 * COHESION, 0.125, 0.25]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [1.0 + gap, 0.0, 0.0]);
    case.pull(0, 0, -pull);
    case.pull(1, 0, pull);
    case
}

fn bonded(state: &Snapshot) -> Vec<u8> {
    state.memory.clone().expect("a law that remembers").contact_bonded
}

#[test]
fn a_bond_holds_up_to_its_cohesion_and_no_further() {
    let strength = COHESION * PI / 16.0;
    let pull = 0.999 * strength;
    let held = pair(0.0, pull).run(200);
    // 8 digits of the force in the file; rounding of 200 steps.
    near(held.force(0, 1).unwrap(), [-pull, 0.0, 0.0], 1e-7 * pull);
    near(held.x(1) - held.x(0), [1.0, 0.0, 0.0], 1e-14);
    assert_eq!(bonded(&held), [1]);

    let mut case = pair(0.0, 1.001 * strength);
    let h = case.options.dt;
    let states = case.states(3, 1);
    // It gives its all in the step in which it breaks, then nothing.
    near(states[1].force(0, 1).unwrap(), [-strength, 0.0, 0.0], 1e-12 * strength);
    assert_eq!((bonded(&states[1]), bonded(&states[2])), (vec![0], vec![0]));
    near(states[2].force(0, 1).unwrap(), [0.0; 3], 0.0);
    let v = (3.0 * 1.001 - 1.0) * strength * h / states[3].mass(1);
    near(states[3].v(1), [v, 0.0, 0.0], 1e-7 * v);
}

/// Coefficient of restitution of the bonds below.
const RESTITUTION: f64 = 0.5;

/// Sets the law of bonds with restitution.
fn set_rebound_law(case: &mut Case) {
    case.law("RST_MOHR_DS_CLB", &[COHESION, 0.5 * COHESION, RESTITUTION, 0.0, 0.125, 0.25]);
}

/// A ball that is bonded to a floor, thrown along z.
fn thrown_ball(speed: f64, gravity: f64) -> Case {
    let mut case = on_floor([0.0, 0.0, gravity]);
    set_rebound_law(&mut case);
    case.launch(1, [0.0, 0.0, speed], [0.0; 3]);
    case.options.dt = 1.0 / 1024.0;
    case
}

#[test]
fn a_ball_rebounds_once_its_bond_has_broken() {
    let (h, mass) = (1.0 / 1024.0, PI / 6.0);
    // The bond gives at most h c_n S in a step: it holds a slower ball, also one that is thrown against the floor.
    let largest = h * COHESION * PI / 4.0 / mass;
    for speed in [0.999 * largest, -1.0] {
        let held = thrown_ball(speed, 0.0).run(4);
        near(held.v(1), [0.0; 3], 1e-12);
        // Half of the first step is flown before.
        equal(held.x(1).z, 0.5, 0.5 * h * f64::abs(speed));
        assert_eq!(bonded(&held), [1]);
    }
    let (speed, gravity) = (1.0, 8.0);
    let mut case = thrown_ball(speed, -gravity);
    let first = case.run(1);
    let left = speed - largest - gravity * h;
    near(first.v(1), [0.0, 0.0, left], 1e-6);
    assert_eq!(bonded(&first), [0]);
    // Back at the floor after 2 v/g, it rebounds with e v; 1/32 s later gravity has slowed it down.
    let flight = 2.0 * left / gravity;
    let steps = ((flight + 0.03125) / h).round();
    let end = case.run(steps as u64);
    let expected = RESTITUTION * left - gravity * (steps * h - flight);
    // The impact is early by less than a step.
    near(end.v(1), [0.0, 0.0, expected], 2.0 * gravity * h);
}

/// A ball that strikes one of two bonded balls of its mass rebounds from both as from one: u = v (1 + e)/3 of the pair, u - e v of
/// its own.
#[test]
fn a_ball_rebounds_from_bonded_balls_as_from_one_body() {
    let case = || {
        let mut case = Case::new();
        set_rebound_law(&mut case);
        for x in [-1.125, 0.0, 1.0] {
            case.sphere(0.5, [x, 0.0, 0.0]);
        }
        case.launch(0, [2.0, 0.0, 0.0], [0.0; 3]);
        (case.options.dt, case.options.output_every) = (1.0 / 256.0, 30);
        case
    };
    let end = case().run(60);
    let pair = 2.0 * (1.0 + RESTITUTION) / 3.0;
    for (body, v) in [(0, pair - 2.0 * RESTITUTION), (1, pair), (2, pair)] {
        near(end.v(body), [v, 0.0, 0.0], 1e-10);
    }
    near(end.x(2) - end.x(1), [1.0, 0.0, 0.0], 1e-10);
    expect_same_bytes(case);
}

/// Plates and cylinders are flat next to a sphere, whatever of their motion is imposed: S = π R².
#[test]
fn a_bond_on_a_wall_that_may_turn_has_the_area_of_the_sphere() {
    let strength = COHESION * PI / 4.0;
    for cylinder in [false, true] {
        for free in [&[5][..], &[3], &[0, 5], &[0, 1, 3, 4, 5]] {
            for (share, held) in [(0.999, 1), (1.001, 0)] {
                let mut case = Case::new();
                case.law_of_all("IQS_MOHR_DS_CLB", &[COHESION, 0.5 * COHESION, 0.125, 0.25]);
                let wall = case.plate([2.0, 2.0, 0.125], [0.0, 0.0, -0.125], AXES);
                if cylinder {
                    let shape = ShapeRecord::Cylinder { half_height: 0.125, radius: 2.0, hollow: false };
                    case.bodies[wall].contactors[0].shape = shape;
                }
                case.drive(wall, [0.0; 6].map(Evolution::constant));
                case.driven.retain(|driven| !free.contains(&driven.component));
                let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
                case.pull(ball, 2, share * strength);
                assert_eq!(bonded(&case.run(3)), [held], "{free:?} {share} {cylinder}");
            }
        }
    }
}

#[test]
fn what_has_broken_once_never_holds_again() {
    let weight = COHESION * PI / 4.0 / (PI / 6.0); // the acceleration that the bond carries
    let mut case = on_floor([0.0, 0.0, 1.01 * weight]);
    // Torn off in the first step, thrown back onto the floor, and lifted gently.
    case.event(0.01, EventAction::SetGravity([0.0, 0.0, -2.0 * weight]));
    case.event(0.2, EventAction::SetGravity([0.0, 0.0, 0.01 * weight]));
    let states = case.states(300, 100);
    near(states[1].v(1), [0.0; 3], 1e-12);
    let lying = states[1].force(1, 0).unwrap().x;
    assert!((lying / (2.0 * weight * states[1].mass(1)) - 1.0).abs() < 1e-9, "{lying}");
    assert_eq!(bonded(&states[2]), [0]);
    near(states[3].v(1), [0.0, 0.0, 0.01 * weight * 0.1], 1e-9 * weight);
    // With an event it does: the same as before, but for the last sentence.
    case.event(0.199, EventAction::Bond);
    case.options.output_every = 300;
    case.write();
    assert_eq!(case.solve(&["--force", "--steps", "300"]), 0);
    assert_eq!(bonded(&case.last()), [1]);
    near(case.last().v(1), [0.0; 3], 1e-12);
}

#[test]
fn a_bond_shears_at_coulombs_limit_with_cohesion() {
    // Pulled along the floor the ball grips with 2/7 of the pull: up to c_t S + (c_t/c_n) N.
    let (weight, area) = (8.0 * PI / 6.0, PI / 4.0);
    let limit = 0.5 * COHESION * area + 0.5 * weight;
    let pulled = |share: f64| {
        let mut case = on_floor([0.0, 0.0, -8.0]);
        case.pull(1, 0, 3.5 * share * limit);
        (case.options.dt, case.states(3, 1))
    };
    let (_, states) = pulled(0.999);
    assert_eq!(bonded(&states[3]), [1]);
    let tangential = |state: &Snapshot| state.force(1, 0).unwrap().yz().norm();
    assert!((tangential(&states[3]) / (0.999 * limit) - 1.0).abs() < 1e-6); // 8 digits in the files
    let (h, states) = pulled(1.01);
    assert_eq!(bonded(&states[1]), [0]);
    assert!((tangential(&states[1]) / limit - 1.0).abs() < 1e-6);
    // Dynamic friction alone from then on.
    assert!((tangential(&states[2]) / (0.125 * weight) - 1.0).abs() < 1e-9);
    let v = (3.0 * 3.5 * 1.01 * limit - limit - 2.0 * 0.125 * weight) * h / states[3].mass(1);
    near(states[3].v(1), [v, 0.0, 0.0], 1e-6 * v);
}

#[test]
fn a_bond_keeps_the_gap_at_which_it_was_made() {
    // A thousandth of the effective radius 1/4 is the limit of touching.
    for pull in [3.0, -3.0] {
        let mut case = pair(2e-4, pull);
        let states = case.states(100, 100);
        near(states[1].x(1) - states[1].x(0), states[0].x(1) - states[0].x(0), 1e-15);
        assert_eq!(states[1].memory.as_ref().unwrap().contact_bond_gap.len(), 1);
    }
    let parted = pair(3e-4, 3.0).run(1);
    assert_eq!(bonded(&parted), [0]);
}

#[test]
fn a_liquid_bridge_that_was_too_long_once_is_gone() {
    // Wet within 1/16 m: pulled at 4 N against 2 N until beyond, then pushed back gently.
    let wet = |gap: f64| {
        let mut case = Case::new();
        case.law("xQS_WET_DS_CLB", &[2.0, 0.0, 0.0625, 0.3, 0.3]);
        case.sphere(0.5, [0.0; 3]);
        case.sphere(0.5, [1.0 + gap, 0.0, 0.0]);
        case.run(10)
    };
    near(wet(0.03125).force(0, 1).unwrap(), [-2.0, 0.0, 0.0], 1e-12);
    // Beyond the range at the start: never wet. A pair that comes into reach later is dry, too.
    assert_eq!(wet(0.07).force(0, 1).unwrap_or_default().x, 0.0);
    let mut case = Case::new();
    case.law("xQS_WET_DS_CLB", &[2.0, 0.0, 0.0625, 0.3, 0.3]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [1.125, 0.0, 0.0]);
    case.launch(1, [-1.0, 0.0, 0.0], [0.0; 3]);
    near(case.run(100).v(1), [-1.0, 0.0, 0.0], 0.0); // 0.1 m nearer, 0.025 m apart
    // One that was wet, is torn apart and comes back.
    let mut case = Case::new();
    case.law("xQS_WET_DS_CLB", &[2.0, 0.0, 0.0625, 0.3, 0.3]);
    case.options.theta = 0.5;
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5 + 0.03125]);
    case.launch(ball, [0.0, 0.0, 4.0], [0.0; 3]);
    case.event(0.1, EventAction::SetGravity([0.0, 0.0, -80.0]));
    case.event(0.3, EventAction::SetGravity([0.0, 0.0, 0.5]));
    let states = case.states(400, 300);
    near(states[1].v(ball), [0.0; 3], 1e-12); // lies on the floor
    near(states[2].v(ball), [0.0, 0.0, 0.5 * 0.1], 1e-12);
}

#[test]
fn events_change_friction_and_cohesion_of_a_law() {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.25]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [8.0, 0.0, 0.0], [0.0; 3]);
    let plane_law = case.tact.laws[1].nickname.clone();
    case.event(0.05, EventAction::SetFriction(plane_law, 0.125));
    near(case.run(100).v(ball), [8.0 - 0.05 * 8.0 * (0.25 + 0.125), 0.0, 0.0], 1e-12);

    let strength = COHESION * PI / 16.0;
    let mut case = pair(0.0, 0.9 * strength);
    let law = case.tact.laws[0].nickname.clone();
    case.event(0.05, EventAction::SetCohesion(law, 0.8 * COHESION));
    let states = case.states(60, 50);
    assert_eq!((bonded(&states[1]), bonded(&states[2])), (vec![1], vec![0]));
    let v = (10.0 * 0.9 - 0.8) * strength * 1e-3 / states[2].mass(1);
    near(states[2].v(1), [v, 0.0, 0.0], 1e-7 * v);
}

/// A ball that rolls and a block that sticks on a slope: from one step to the next nothing holds them, and what held
/// them is no part of what is solved.
#[test]
fn friction_that_is_set_to_nothing_leaves_nothing_behind() {
    for block in [false, true] {
        let mut case = Case::new();
        case.law_of_all("IQS_CLB", &[0.5]);
        case.gravity = [1.0, 0.0, -8.0];
        case.floor();
        let body = match block {
            true => case.block([0.5; 3], [0.0, 0.0, 0.5], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            false => case.sphere(0.5, [0.0, 0.0, 0.5]),
        };
        for nickname in case.tact.laws.iter().map(|law| law.nickname.clone()).collect::<Vec<_>>() {
            if case.tact.visibility.iter().any(|see| see.law == nickname && see.antagonist.contactor == "PLANx") {
                case.event(0.05, EventAction::SetFriction(nickname, 0.0));
            }
        }
        case.options.dt = 0.01;
        let end = case.run(10);
        // Five steps with friction, of which a rolling ball makes 5/7 of the pull, and five without.
        let (held, w) = if block { (0.0, 0.0) } else { (5.0 / 7.0 * 0.05, 5.0 / 7.0 * 0.05 / 0.5) };
        // Each step is solved to 1e-12 of the impulse of gravity.
        near(end.v(body), [held + 0.05, 0.0, 0.0], 1e-10);
        near(end.w(body), [0.0, w, 0.0], 1e-10);
        assert!(case.column("converged").iter().all(|converged| *converged == 1.0), "block {block}");
    }
}

/// A bonded pair that spins from the first step on, or is set spinning at once.
#[test]
fn a_bond_bears_what_turns_the_pair() {
    let spin = 2.0;
    for suddenly in [false, true] {
        let mut case = pair(0.0, 0.0);
        case.options.dt = 1e-3;
        let first = if suddenly { 10 } else { 0 };
        if suddenly {
            case.event(0.01, EventAction::AddSpin([0.0, 0.0, spin]));
        } else {
            case.launch(0, [0.0, -0.5 * spin, 0.0], [0.0, 0.0, spin]);
            case.launch(1, [0.0, 0.5 * spin, 0.0], [0.0, 0.0, spin]);
        }
        let states = case.states(2000, 1);
        let tension = states[1].mass(0) * spin * spin * 0.5;
        // Up to second order of the angle of a step, 4e-6.
        for k in [1, 2, 3, 1900] {
            equal(-states[first + k].force(0, 1).unwrap().x / tension, 1.0, 1e-5);
        }
        // The scheme turns it without any error but the solver's.
        equal((states[2000].x(1) - states[2000].x(0)).norm(), 1.0, 1e-11);
        equal(states[2000].w(0).z, spin, 1e-10);
    }
}

/// Bonds are made of what touches when the step begins, however far it turns within: here by 0.09 rad, which opens the gap by twice
/// what counts as touching.
#[test]
fn bonds_are_made_of_what_turns_fast() {
    let mut case = pair(0.0, 0.0);
    case.options.dt = 0.09;
    case.law("IQS_MOHR_DS_CLB", &[1e3, 1e3, 0.125, 0.25]);
    for (ball, side) in [(0, -0.5), (1, 0.5)] {
        case.launch(ball, [0.0, side, 0.0], [0.0, 0.0, 1.0]);
    }
    let end = case.run(100);
    assert_eq!(bonded(&end), [1]);
    equal((end.x(1) - end.x(0)).norm(), 1.0, 1e-10);
}

/// An octahedron of six balls has twelve bonds, eight more than it takes to hold together what each pair of them holds; what
/// turns it, about no axis of its own, is all that they bear, and none breaks.
#[test]
fn more_bonds_than_it_takes_bear_no_more_than_what_turns_them() {
    let mut case = Case::new();
    let strength = 1e4 * PI / 16.0;
    case.law("IQS_MOHR_DS_CLB", &[1e4, 1e4, 0.125, 0.25]);
    case.options.dt = 0.01;
    let spin = Vec3::new(0.6, 0.64, 0.48);
    let at = 0.5 * 2f64.sqrt();
    for (axis, side) in (0..3).flat_map(|axis| [(axis, at), (axis, -at)]) {
        let mut x = [0.0; 3];
        x[axis] = side;
        let ball = case.sphere(0.5, x);
        case.launch(ball, spin.cross(&Vec3::from(x)).into(), spin.into());
    }
    let states = case.states(700, 100);
    let weight = states[0].mass(0) * at;
    for state in &states[1..] {
        assert_eq!(bonded(state).iter().map(|bond| u32::from(*bond)).sum::<u32>(), 12);
        let largest = state.contacts.contact_force.iter().map(|f| Vec3::from(*f).norm()).fold(0.0, f64::max);
        assert!(largest < weight && largest < 1e-3 * strength, "{largest}");
        // Every distance is that of the start, up to what the solver leaves; rounding of the places among it.
        let distance = |a: usize, b: usize| (state.x(a) - state.x(b)).norm();
        for (a, b) in [(0, 1), (2, 3), (4, 5)] {
            equal(distance(a, b), 2.0 * at, 1e-8);
        }
        equal(distance(0, 2), 1.0, 1e-8);
    }
}

#[test]
fn a_restart_from_text_knows_what_is_bonded() {
    for (share, holds) in [(0.9, true), (1.1, false)] {
        let strength = COHESION * PI / 16.0;
        let mut case = pair(0.0, share * strength);
        case.options.text = true;
        case.options.output_every = 2;
        case.run(2);
        let (datbox, outbox) = (case.path().join("DATBOX"), case.path().join("OUTBOX"));
        for kind in ["DOF", "Vloc_Rloc"] {
            std::fs::copy(outbox.join(format!("{kind}.OUT.1")), datbox.join(format!("{kind}.INI"))).unwrap();
        }
        assert_eq!(solve(case.path(), &["--force", "--steps", "2"]), 0);
        assert_eq!(bonded(&case.last()), [u8::from(holds)]);
    }
}

#[test]
fn a_restart_from_text_keeps_a_liquid_bridge_and_lets_it_close() {
    let mut case = Case::new();
    case.law_of_all("xQS_WET_DS_CLB", &[2.0, 0.0, 0.1, 0.5, 0.5]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.5, [1.05, 0.0, 0.0]);
    case.options.text = true;
    case.options.output_every = 2;
    case.options.dt = 1e-2;
    case.run(2);
    let (datbox, outbox) = (case.path().join("DATBOX"), case.path().join("OUTBOX"));
    for kind in ["DOF", "Vloc_Rloc"] {
        std::fs::copy(outbox.join(format!("{kind}.OUT.1")), datbox.join(format!("{kind}.INI"))).unwrap();
    }
    // 2 N on half of half a kilogram close 5 cm within 0.1 s.
    assert_eq!(solve(case.path(), &["--force", "--steps", "40"]), 0);
    let end = case.last();
    assert_eq!(bonded(&end), [1]);
    equal((end.x(1) - end.x(0)).norm(), 1.0, 1e-7); // eight digits of the text
}

#[test]
fn a_bond_whose_cohesion_ends_is_gone() {
    let mut case = pair(0.0, -1.0);
    for law in ["law00", "law01"] {
        case.event(0.01, EventAction::SetCohesion(law.into(), 0.0));
    }
    let end = case.run(20);
    assert_eq!(bonded(&end), [0]);
    near(end.force(0, 1).unwrap(), [1.0, 0.0, 0.0], 1e-7); // eight digits of the file
    assert!(case.column("residual").iter().all(|residual| residual.is_finite()));
    assert!(case.column("converged").iter().all(|converged| *converged == 1.0));
}

#[test]
fn events_about_laws_that_are_not_there_are_rejected() {
    for action in [
        EventAction::SetFriction("other".into(), 0.1),
        EventAction::SetCohesion("other".into(), 0.1),
        EventAction::SetCohesion("law00".into(), 0.1), // IQS_CLB has none
        EventAction::SetFriction("law00".into(), -0.1),
        EventAction::SetFriction("law00".into(), f64::INFINITY),
    ] {
        let mut case = Case::new();
        case.law("IQS_CLB", &[0.25]);
        case.sphere(0.5, [0.0; 3]);
        case.event(0.0, action.clone());
        case.write();
        assert_eq!(case.solve(&["--steps", "1"]), 2, "{action:?}");
    }
}

/// Two dumbbells, side by side: each of the two bonds is that of the small balls that touch, of R = 1/4.
#[test]
fn bonds_of_clusters_are_those_of_their_balls() {
    let strength = 2.0 * COHESION * PI / 16.0;
    let broken = |pull: f64| {
        let mut case = pair(0.0, pull);
        for body in &mut case.bodies {
            let ball = |y: f64| Contactor {
                colour: "GRAIN".into(),
                shape: ShapeRecord::OffsetSphere { radius: 0.5, offset: [0.0, y, 0.0] },
                local_frame: None,
            };
            body.contactors = vec![ball(1.0), ball(-1.0)];
        }
        case.dof.clear();
        case.run(50).x(1).x > 1.0 + 1e-6
    };
    assert_eq!([0.999, 1.001].map(|share| broken(share * strength)), [false, true]);
}

/// A cube that hangs by four points of its upper face, at the tolerance that runs have: what the sweeps have not yet shared out
/// among points that could hold breaks none.
#[test]
fn a_face_holds_what_its_area_holds() {
    let drop = |strength: f64| {
        let mut case = Case::new();
        // 8e-3 kg in 8 m/s², on 0.04 m².
        let cohesion = strength * 8e-3 * 8.0 / 0.04;
        case.law_of_all("IQS_MOHR_DS_CLB", &[cohesion, cohesion, 0.3, 0.3]);
        case.gravity = [0.0, 0.0, -8.0];
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let cube = case.block([0.1; 3], [0.0, 0.0, -0.1], axes);
        case.plate([0.5, 0.5, 0.05], [0.0, 0.0, 0.05], axes);
        (case.options.dt, case.options.tol) = (1e-3, Some(1e-2));
        let fallen = -0.1 - case.run(300).x(cube).z;
        (fallen, case.column("bonds"))
    };
    for strength in [1.1, 1.3, 1.5, 2.0, 4.0] {
        let (fallen, bonds) = drop(strength);
        assert!(fallen < 1e-4, "{strength}: {fallen}");
        assert_eq!(bonds, [4.0; 300], "{strength}");
    }
    let (fallen, bonds) = drop(0.9);
    equal(fallen, 0.5 * 8.0 * 0.09, 0.01); // falls from some step on, of a hundred at first
    assert_eq!(bonds[299], 0.0);
}

/// A thin plate under its weight that is drawn along: its strength is c_t S and c_t/c_n of its weight, however its points share them.
#[test]
fn a_face_bears_the_shear_that_its_points_add_up_to() {
    let held = |share: f64, accuracy: Option<Accuracy>| {
        let mut case = Case::new();
        case.materials[0].density = 20_000.0;
        case.law_of_all("IQS_MOHR_DS_CLB", &[2e4, 1e4, 0.2, 0.3]);
        case.gravity = [0.0, 0.0, -10.0];
        case.floor();
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        case.block([0.5, 0.5, 0.05], [0.0, 0.0, 0.05], axes);
        case.event(0.02, EventAction::SetGravity([share * (1e4 + 0.5 * 2e4) / 2e3, 0.0, -10.0]));
        (case.options.dt, case.options.tol, case.options.accuracy) = (1e-3, None, accuracy);
        case.run(150);
        case.column("bonds").last() == Some(&4.0)
    };
    for accuracy in [None, Some(Accuracy::Draft), Some(Accuracy::Standard), Some(Accuracy::Fine)] {
        assert!(held(0.97, accuracy) && !held(1.04, accuracy), "{accuracy:?}");
    }
}

#[test]
fn what_a_bridge_or_a_bond_without_shear_joins_slides_without_sinking_in() {
    for (kind, parameters) in [
        ("IQS_WET_DS_CLB", &[1.0, 0.0, 0.01, 0.0, 0.0][..]),
        ("xQS_WET_DS_CLB", &[1.0, 0.0, 0.01, 0.0, 0.0]),
        ("IQS_MOHR_DS_CLB", &[COHESION, 0.0, 0.0, 0.0]),
    ] {
        let mut case = Case::new();
        case.law(kind, parameters);
        case.sphere(0.5, [0.0; 3]);
        let spinning = case.sphere(0.5, [1.0, 0.0, 0.0]);
        case.launch(spinning, [0.0; 3], [0.0, 0.0, 8.0]);
        let end = case.run(1000);
        // Without friction it spins on the spot. Rounding of 1000 steps.
        near(end.x(1) - end.x(0), [1.0, 0.0, 0.0], 1e-12);
        near(end.w(1), [0.0, 0.0, 8.0], 0.0);
    }
}

#[test]
fn bonds_go_on_where_other_shapes_have_come() {
    let hanging = |others: bool| {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e4, 1e4, 0.125, 0.25]);
        case.gravity = [0.0, 0.0, -8.0];
        let above = case.sphere(0.5, [0.0, 0.0, 1.0]);
        case.drive(above, [0.0; 6].map(Evolution::constant));
        case.sphere(0.5, [0.0; 3]);
        if others {
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            case.block([0.5; 3], [8.0, 0.0, 0.0], axes);
        }
        case
    };
    let mut before = hanging(false);
    before.run(10);
    let mut after = hanging(true);
    after.options.steps = Some(100);
    after.write();
    let start = before.path().join("OUTBOX/snapshot-000010.npz");
    std::fs::copy(start, after.path().join("DATBOX/START.npz")).unwrap();
    assert_eq!(after.solve(&[]), 0);
    let end = after.last();
    // Next to a block the body that is not driven is the candidate.
    assert_eq!((bonded(&end), end.contacts.contact_body.clone()), (vec![1], vec![[1, 0]]));
    let weight = 8.0 * end.mass(1);
    near(end.force(1, 0).unwrap(), [-weight, 0.0, 0.0], 1e-9 * weight);
    near(end.v(1), [0.0; 3], 1e-12);
}

/// A bond at one point carries no moment: a ball that rolls on a free plank neither sinks in nor lifts.
#[test]
fn a_bonded_ball_rolls_on_a_free_body_at_its_height() {
    for driven in [false, true] {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e-3, 1e-3, 0.5, 0.6]);
        case.gravity = [0.0, 0.0, -8.0];
        case.options.dt = 5e-3;
        case.options.tol = Some(1e-8);
        case.floor();
        let plank = case.block([5.0, 1.0, 0.25], [0.0, 0.0, 0.25], AXES);
        if driven {
            case.drive(plank, [0.0; 6].map(Evolution::constant));
        }
        let ball = case.sphere(0.25, [0.0, 0.0, 0.75]);
        case.launch(ball, [3.0, 0.0, 0.0], [0.0, 12.0, 0.0]);
        let state = case.run(200);
        near(state.x(ball), [3.0, 0.0, 0.75], 1e-5);
        near(state.x(plank), [0.0, 0.0, 0.25], 1e-6);
    }
}

/// Bonded balls of two sizes that turn as wheels of a gear stay where they are.
#[test]
fn bonded_wheels_of_a_gear_stay_where_they_are() {
    let mut case = Case::new();
    case.law("IQS_MOHR_DS_CLB", &[COHESION, 0.5 * COHESION, 0.125, 0.25]);
    case.sphere(0.5, [0.0; 3]);
    case.sphere(0.25, [0.75, 0.0, 0.0]);
    case.launch(0, [0.0; 3], [0.0, 0.0, 2.0]);
    case.launch(1, [0.0; 3], [0.0, 0.0, -4.0]);
    let end = case.run(1000);
    // Up to third order of the angles of 1000 steps.
    near(end.x(1) - end.x(0), [0.75, 0.0, 0.0], 1e-6);
    assert_eq!(bonded(&end), [1]);
}

/// A body at the start of the step next to one in the middle of it would be pushed by half of the common displacement.
#[test]
fn events_move_an_aggregate_as_one() {
    let mut case = Case::new();
    case.law_of_all("IQS_MOHR_DS_CLB", &[1e6, 1e6, 0.2, 0.3]);
    case.gravity = [0.0; 3];
    for k in 0..27 {
        let [x, y, z] = [k / 9, k / 3 % 3, k % 3].map(f64::from);
        case.block([0.5; 3], [x, y, z], AXES);
    }
    case.event(0.05, EventAction::AddSpin([0.0, 0.0, 0.15]));
    case.event(0.10, EventAction::AddSpin([0.0, 0.0, 0.15]));
    case.event(0.15, EventAction::AddVelocity([10.0, 0.0, 0.0]));
    (case.options.dt, case.options.tol) = (1e-2, None);
    case.run(25);
    // 54 pairs of faces with four bonds each; their load is a thousandth of the strength.
    assert_eq!(case.column("bonds").last(), Some(&216.0));
    let deepest = case.column("penetration_largest").into_iter().fold(0.0, f64::max);
    assert!(deepest < 1e-6, "{deepest} radii");
}
