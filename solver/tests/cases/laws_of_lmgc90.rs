//! Laws that LMGC90's folders use besides those of `laws`: one contact, in closed form.

use std::f64::consts::{PI, TAU};

use cd_formats::drv_dof::Evolution;
use cd_formats::law_table::{LawInterface, LawModel};
use cd_solve::laws::interface::{soundness, stiffness_share};

use crate::case::{Case, Figures, near};
use crate::constrained_rotation::{hold, impose};

/// Mass of a ball of radius 1/2 and density 1.
const MASS: f64 = PI / 6.0;

/// A ball of radius 1/2, its lowest point at `height` over a floor, thrown along z at `speed` under the gravity `g` upwards.
fn ball(kind: &str, parameters: &[f64], height: f64, speed: f64, g: f64) -> Case {
    let mut case = Case::new();
    case.law(kind, parameters);
    case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
    case.gravity = [0.0, 0.0, g];
    case.options.dt = 1.0 / 1024.0;
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5 + height]);
    case.launch(ball, [0.0, 0.0, speed], [0.0; 3]);
    case
}

#[test]
fn a_wet_ball_rebounds_and_is_drawn_back_within_the_range() {
    let wet = [2.0, 0.0, 0.5, 0.0, 0.015625, 0.3, 0.3];
    let mut case = ball("RST_WET_CLB", &wet, 0.0, -1.0, 0.0);
    let states = case.states(8, 1);
    let h = case.options.dt;
    // Thrown back at e_n times the speed; then the attraction of 2 N slows it down, within 1/64 m: 32 steps at 1/2 m/s.
    for (k, state) in (0..).zip(&states[1..]) {
        near(state.v(1), [0.0, 0.0, 0.5 - 2.0 / MASS * h * f64::from(k)], 1e-13);
    }
    // Beyond the range it flies on.
    let free = ball("RST_WET_CLB", &wet, 0.03125, 1.0, 0.0).run(4);
    near(free.v(1), [0.0, 0.0, 1.0], 1e-15);
}

#[test]
fn a_wet_ball_hangs_by_less_than_the_attraction() {
    let wet = |pull: f64| ball("RST_WET_CLB", &[2.0, 0.0, 0.0, 0.0, 0.015625, 0.3, 0.3], 0.0, 0.0, pull / MASS);
    let held = wet(1.5).run(100);
    near(held.x(1), [0.0, 0.0, 0.5], 1e-13);
    near(held.force(1, 0).unwrap(), [-1.5, 0.0, 0.0], 1e-6); // eight digits of gravity
    let mut case = wet(2.5);
    near(case.run(10).v(1), [0.0, 0.0, 10.0 * case.options.dt * 0.5 / MASS], 1e-6);
}

#[test]
fn deep_overlaps_are_pushed_out_gently() {
    let (steps, gap) = (16.0, -1.0 / 256.0);
    // In one step an overlap of 1/64 m gets 2 (2π/16)² (1/64 - 1/256) m/h.
    let mut case = ball("IQS_CLB_RGR", &[steps, gap, 0.3], -1.0 / 64.0, 0.0, 0.0);
    let push = 2.0 * (TAU / steps).powi(2) * (1.0 / 64.0 + gap) / case.options.dt;
    near(case.run(1).v(1), [0.0, 0.0, push], 1e-13 * push);
    // A shallow one is kept, with and without a weight.
    for g in [0.0, -8.0] {
        let kept = ball("IQS_CLB_RGR", &[steps, gap, 0.3], gap, 0.0, g).run(100);
        near(kept.x(1), [0.0, 0.0, 0.5 + gap], 1e-13);
    }
}

/// Velocity and height of a ball on a spring over `steps`, by the implicit step v' = v + h (g - f/m), f = max(0, -k (z + h v') - η
/// v'), of the gap z at the middle of the step; a damper acts only where z <= 0.
fn on_spring([k, eta]: [f64; 2], [mut z, mut v]: [f64; 2], g: f64, h: f64, steps: u64) -> [f64; 2] {
    for _ in 0..steps {
        let middle = z + 0.5 * h * v;
        let free = v + h * g;
        let acts = eta == 0.0 || middle <= 0.0;
        let pressed = (MASS * free - h * k * middle) / (MASS + h * (h * k + eta));
        let pushes = acts && k * (middle + h * pressed) + eta * pressed < 0.0;
        let next = if pushes { pressed } else { free };
        z = middle + 0.5 * h * next;
        v = next;
    }
    [z, v]
}

#[test]
fn springs_follow_the_implicit_oscillator_at_any_stiffness() {
    for (kind, eta) in [("ELASTIC_REPELL_CLB", 0.0), ("VISCO_ELASTIC_REPELL_CLB", 4.0)] {
        for k in [16.0, 1024.0, 1e9] {
            let parameters: &[f64] = if eta > 0.0 { &[k, eta, 0.3] } else { &[k, 0.3] };
            let mut case = ball(kind, parameters, 1.0 / 256.0, 0.0, -8.0);
            let end = case.run(200);
            let [z, v] = on_spring([k, eta], [1.0 / 256.0, 0.0], -8.0, case.options.dt, 200);
            // Rounding of 200 steps with forces up to k times the rounding of a gap in 1 m.
            near(end.x(1), [0.0, 0.0, 0.5 + z], 1e-13);
            near(end.v(1), [0.0, 0.0, v], 1e-12);
        }
    }
}

#[test]
fn a_spring_counts_from_the_first_gap_and_carries_the_weight() {
    for first in [1.0 / 64.0, -1.0 / 64.0] {
        let mut case = ball("ELASTIC_REPELL_CLB_g0", &[1024.0, 0.3], first, 0.0, -8.0);
        let states = case.states(20, 20);
        let [z, v] = on_spring([1024.0, 0.0], [0.0, 0.0], -8.0, case.options.dt, 20);
        near(states[1].x(1), [0.0, 0.0, 0.5 + first + z], 1e-13);
        near(states[1].v(1), [0.0, 0.0, v], 1e-13);
    }
}

#[test]
fn coupled_bodies_move_as_one_and_may_pull() {
    let mut case = Case::new();
    case.law("COUPLED_DOF", &[]);
    let one = case.sphere(0.5, [0.0; 3]);
    let two = case.sphere(0.5, [1.0 + 1.0 / 2048.0, 0.0, 0.0]);
    case.launch(two, [1.0, 0.5, 0.0], [0.0; 3]);
    let states = case.states(50, 1);
    let end = &states[50];
    // Half of the momentum each along the normal; along t the point of contact does not slide.
    near(states[1].v(one) + states[1].v(two), [1.0, 0.5, 0.0], 1e-13);
    // The normal at the middle of the step is turned by h/4, and so a quarter of the velocities across is along x.
    near([states[1].v(one).x, 0.0, 0.0], [0.5, 0.0, 0.0], 0.25 * 0.25 * case.options.dt);
    let force = states[1].force(one, two).unwrap();
    assert!(force.x < 0.0, "it pulls: {force:?}");
    near(end.v(one) + end.v(two), [1.0, 0.5, 0.0], 1e-12);
    // They keep the distance of the middle of the first step, to second order in the 0.5 rad/s over 50 ms.
    let distance = (end.x(two) - end.x(one)).norm();
    assert!((distance - 1.0 - 1.0 / 2048.0 - 0.5 * case.options.dt).abs() < 5e-5, "{distance}");
    // Beyond the alert distance nothing holds them.
    let mut apart = ball("COUPLED_DOF", &[], 0.125, 0.0, -8.0);
    near(apart.run(10).v(1), [0.0, 0.0, -80.0 * apart.options.dt], 1e-13);
}

/// A sphere whose centre or whose rotation is held hangs on a held sphere, whether or not it could move along the normal.
#[test]
fn coupled_bodies_that_are_driven_in_part_do_not_move() {
    let held_components: [&[usize]; 3] = [&[0, 1, 3, 4, 5], &[1, 3, 4, 5], &[0, 1, 2]];
    for (axis, held) in [0, 2].into_iter().flat_map(|axis| held_components.map(|held| (axis, held))) {
        let mut case = Case::new();
        case.law("COUPLED_DOF", &[]);
        case.gravity = [0.0, 0.0, -8.0];
        let support = case.sphere(0.5, [0.0; 3]);
        hold(&mut case, support, &[0, 1, 2, 3, 4, 5]);
        let mut position = [0.0; 3];
        position[axis] = 1.0;
        let hanging = case.sphere(0.5, position);
        hold(&mut case, hanging, held);
        if !held.contains(&4) {
            // About y its point of contact moves along z, or along x if the normal is along z.
            case.pull(hanging, 4, 0.125);
        }
        // A run needs a body that moves freely.
        case.sphere(0.5, [9.0, 0.0, 0.0]);
        let end = case.run(20);
        // Gravity brings 0.16 m/s in these 20 steps of 1 ms.
        near(end.v(hanging), [0.0; 3], 1e-12);
        near(end.w(hanging), [0.0; 3], 1e-12);
        assert!(end.force(support, hanging).is_some(), "axis {axis}, held {held:?}");
    }
}

#[test]
fn springs_reject_solvers_that_do_not_know_them() {
    let mut case = ball("ELASTIC_REPELL_CLB", &[1024.0, 0.3], 0.0, 0.0, -8.0);
    case.options.solver = cd_formats::compute::ContactSolver::Admm;
    assert!(case.attempt(1).is_none());
}

/// Parameters of the cohesive zones: k = 2^14 Pa/m, strength 4 Pa, energy 2^-9 J/m² along n, in LMGC90's order.
fn interfaces() -> [(&'static str, Vec<f64>); 3] {
    let (k, strength, energy) = (16384.0, 4.0, 1.0 / 512.0);
    let with = |more: &[f64]| [&[0.3, 0.3, k, k, strength, strength, energy, energy][..], more].concat();
    [("IQS_MAL_CZM", with(&[])), ("IQS_EXPO_CZM", with(&[1e-3])), ("IQS_TH_CZM", with(&[3e-4, 3e-4]))]
}

/// The ball is pulled off at the force `pull` (N) by an explicit share s of the stiffness: v' = v + h (f - S s k (z + h v'))/m. Returns gap,
/// speed and soundness.
fn pulled_off(interface: &LawInterface, pull: f64, h: f64, steps: u64) -> [f64; 3] {
    let area = PI / 4.0; // π R² of the ball on a plate
    let (mut z, mut v, mut beta) = (0.0, 0.0, 1.0);
    for _ in 0..steps {
        let middle: f64 = z + 0.5 * h * v;
        let spring = h * area * stiffness_share(interface, beta) * interface.normal_stiffness;
        v = (MASS * v + h * pull - spring * middle) / (MASS + spring * h);
        beta = soundness(interface, beta, middle + h * v, 0.0, h);
        z = middle + 0.5 * h * v;
    }
    [z, v, beta]
}

#[test]
fn cohesive_zones_hold_and_break_by_their_curve() {
    let viscous = ("IQS_MAC_CZM", vec![0.3, 0.3, 16384.0, 16384.0, 1e-4, 1.0 / 4096.0]);
    for (kind, parameters) in interfaces().into_iter().chain([viscous]) {
        let interface = LawModel::from_values(kind, &parameters).unwrap().interface().unwrap();
        // 1.5 N on π/4 m² is below half of 4 Pa, as the ball swings to twice its displacement; 4 N is above all of it.
        for (pull, breaks) in [(1.5, false), (4.0, true)] {
            let mut case = ball(kind, &parameters, 0.0, 0.0, 0.0);
            case.options.dt = 1.0 / 16384.0;
            case.pull(1, 2, pull);
            let end = case.run(400);
            let h = case.options.dt;
            let [z, v, beta] = pulled_off(&interface, pull, h, 400);
            // Eight digits of the files.
            near(end.x(1), [0.0, 0.0, 0.5 + z], 1e-7 * z.abs().max(1e-3));
            near(end.v(1), [0.0, 0.0, v], 1e-6 * v.abs().max(0.01));
            let found = end.laws.unwrap().contact_soundness[0];
            assert!((found - beta).abs() < 1e-6, "{kind}: {found} {beta}");
            assert!(kind == "IQS_MAC_CZM" || (found < 1.0) == breaks, "{kind} under {pull} N: {found}");
        }
    }
}

#[test]
fn friction_grows_as_an_interface_loses_its_soundness() {
    for (kind, parameters) in interfaces() {
        let interface = LawModel::from_values(kind, &parameters).unwrap().interface().unwrap();
        let mut case = ball(kind, &parameters, 0.0, 0.0, 0.0);
        case.options.dt = 1.0 / 16384.0;
        case.pull(1, 2, -2.0);
        case.launch(1, [0.25, 0.0, 0.0], [0.0; 3]);
        let (h, area) = (case.options.dt, PI / 4.0);
        // An impulse r along t changes the velocity of the point of contact of a ball by 7/2 r/m, and that of its centre by r/m.
        let (mut slid, mut u, mut beta, mut v) = (0.0, 0.25, 1.0, 0.25);
        for (k, state) in (0..).zip(&case.states(60, 1)[1..]) {
            let spring = h * area * stiffness_share(&interface, beta) * interface.tangential_stiffness;
            let rubbing = h * 0.3 * (1.0 - beta) * 2.0;
            let next = (u - 3.5 / MASS * (spring * slid + rubbing)) / (1.0 + 3.5 / MASS * spring * h);
            v += (next - u) / 3.5;
            u = next;
            slid += h * u;
            beta = soundness(&interface, beta, 0.0, slid, h);
            // Eight digits of the files, and the turning of the tangents.
            near(state.v(1), [v, 0.0, 0.0], 1e-6);
            let found = state.laws.as_ref().unwrap().contact_soundness[0];
            assert!((found - beta).abs() < 1e-5, "{kind}, step {k}: {found} {beta}");
        }
        assert!(beta < 0.5, "{kind}: {beta}");
    }
}

#[test]
fn damage_survives_a_resume_and_a_restart_from_text() {
    for (kind, parameters) in interfaces() {
        let scene = || {
            let mut case = ball(kind, &parameters, 0.0, 0.0, -1.0);
            case.options.dt = 1.0 / 16384.0;
            case.launch(1, [0.02, 0.01, 0.0], [0.0; 3]);
            case.pull(1, 2, 2.0);
            case.options.text = true;
            case
        };
        let unbroken = scene().run(300);
        let mut case = scene();
        case.run(150);
        let middle = case.first_text_states();
        assert_eq!(case.solve(&["--resume", "--steps", "300"]), 0);
        assert!(case.last().bodies == unbroken.bodies && case.last().laws == unbroken.laws, "{kind}");
        let restarted = case.run_from_text(&middle, 150);
        near(restarted.x(1), unbroken.x(1), 1e-6);
        let soundness = |state: &cd_formats::snapshot::Snapshot| state.laws.as_ref().unwrap().contact_soundness[0];
        let (again, before) = (soundness(&restarted), soundness(&unbroken));
        // Seven digits of displacements of 1e-4 m, over the lengths of the interfaces.
        assert!((again - before).abs() < 1e-3, "{kind}: {again} {before}");
    }
}

/// The sliding of an interface on a fixed block that is the first body: files have it along LMGC90's tangents, with the
/// first body as the candidate, where the program has the free one.
#[test]
fn sliding_keeps_its_direction_through_files() {
    let [(kind, parameters), ..] = interfaces();
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut case = Case::new();
    case.law_of_all(kind, &parameters);
    case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
    case.gravity = [0.0, 0.0, -1.0];
    let base = case.block([1.0, 1.0, 0.5], [0.0, 0.0, -0.5], axes);
    case.drive(base, [0.0; 6].map(Evolution::constant));
    let block = case.block([0.25; 3], [0.0, 0.0, 0.25], axes);
    case.launch(block, [0.02, 0.01, 0.0], [0.0; 3]);
    (case.options.dt, case.options.text) = (1.0 / 16384.0, true);
    case.run(20);
    let sliding = case.last().laws.as_ref().unwrap().contact_sliding.clone();
    let middle = case.first_text_states();
    let records = cd_formats::vloc_rloc::VlocRloc::read(&case.path().join("OUTBOX/Vloc_Rloc.LAST")).unwrap().contacts;
    for record in &records {
        assert_eq!((record.candidate.body, record.antagonist.body), (base, block));
        // t = (0, -n3, n2) and s = t x n, as LMGC90 computes them; the first body slides backwards.
        near(record.frame[1], [0.0, 1.0, 0.0], 1e-12);
        assert!(record.internals[1] < 0.0 && (record.internals[3] / record.internals[1]).abs() > 1.9, "{record:?}");
    }
    let unbroken = case.run(40);
    let restarted = case.run_from_text(&middle, 20);
    near(restarted.x(block), unbroken.x(block), 1e-9);
    let again = restarted.laws.as_ref().unwrap().contact_sliding.clone();
    let before = unbroken.laws.as_ref().unwrap().contact_sliding.clone();
    assert_eq!(again.len(), before.len());
    assert!(!sliding.is_empty());
    // Seven digits of sliding.
    again.iter().zip(&before).for_each(|(a, b)| near(*a, *b, 1e-9));
}

/// Axes that LMGC90 computes are skew for two spheres whose normal has a component of zero, and left-handed on the side of a
/// plate to which its third axis does not point: the sliding is written along them, and read as the same vector.
#[test]
fn sliding_is_kept_along_skew_and_left_handed_axes_of_files() {
    let [(kind, parameters), ..] = interfaces();
    let interface_case = || {
        let mut case = Case::new();
        case.law_of_all(kind, &parameters);
        case.tact.visibility.iter_mut().for_each(|row| row.alert = 0.0625);
        (case.options.dt, case.options.text) = (1.0 / 16384.0, true);
        case
    };
    let mut spheres = interface_case();
    spheres.sphere(0.5, [0.0; 3]);
    spheres.sphere(0.5, [0.6, 0.8, 0.0]);
    // Their normal keeps a component of exactly 0.
    impose(&mut spheres, 1, 2, Evolution::constant(0.0));
    let mut below_plate = interface_case();
    // Turned by the angle of the triangle 3, 4, 5 about z.
    below_plate.plate([2.0, 2.0, 0.5], [0.0, 0.0, 1.0], [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]);
    below_plate.sphere(0.5, [0.0; 3]);
    for (mut case, v, t, s) in [
        (spheres, [0.008, -0.006, 0.0], [0.0, 0.6, 0.8], [0.8 * 0.8, -0.6 * 0.8, 0.6 * 0.6]),
        (below_plate, [0.02, 0.01, 0.0], [-0.6, -0.8, 0.0], [0.8, -0.6, 0.0]),
    ] {
        case.drive(0, [0.0; 6].map(Evolution::constant));
        case.launch(1, v, [0.0; 3]);
        case.run(20);
        let middle = case.first_text_states();
        let records = cd_formats::vloc_rloc::VlocRloc::parse_with_notices(
            std::path::Path::new("Vloc_Rloc.OUT.1"),
            &cd_formats::scan::AsciiText::new(middle[1].as_bytes()),
        );
        assert_eq!(records.unwrap().1.len(), 1, "axes of LMGC90 are noticed");
        let memory = case.last().laws.as_ref().unwrap().contact_sliding[0];
        let along = |axis: [f64; 3]| axis.iter().zip(memory).map(|(a, b)| a * b).sum::<f64>();
        let line = middle[1].lines().skip_while(|line| !line.starts_with("#")).nth(1).unwrap();
        let internals: Vec<f64> =
            line.split_whitespace().map(|word| word.replace('D', "E").parse::<f64>().unwrap()).collect();
        for (found, expected) in [(internals[1], along(t)), (internals[3], along(s))] {
            // The normal turns by 1e-5, and the file has seven digits.
            assert!((found.abs() - expected.abs()).abs() < 1e-4 * expected.abs(), "{found} {expected}");
            assert!(expected.abs() > 1e-9, "{expected}");
        }
        let unbroken = case.run(40);
        let restarted = case.run_from_text(&middle, 20);
        near(restarted.x(1), unbroken.x(1), 1e-9);
        let sliding = |state: &cd_formats::snapshot::Snapshot| state.laws.as_ref().unwrap().contact_sliding[0];
        near(sliding(&restarted), sliding(&unbroken), 1e-9);
    }
}

/// Contacts of interfaces need their soundness in Vloc_Rloc.INI, as without it they would be broken.
#[test]
fn interfaces_without_a_soundness_are_rejected() {
    let [(kind, parameters), ..] = interfaces();
    let mut case = ball(kind, &parameters, 0.0, 0.0, -1.0);
    case.options.text = true;
    case.run(5);
    let [dof, contacts] = case.first_text_states();
    let (head, values) = contacts.split_once("#internals\n").unwrap();
    let datbox = case.path().join("DATBOX");
    std::fs::write(datbox.join("DOF.INI"), dof).unwrap();
    let with_values = |values: &str| {
        std::fs::write(datbox.join("Vloc_Rloc.INI"), format!("{head}#internals\n{values}\n")).unwrap();
        case.solve(&["--force"])
    };
    assert_eq!(with_values(values.trim_end()), 0);
    assert_eq!(with_values("  0.0000000D+00  0.0000000D+00  0.0000000D+00"), 2);
    for soundness in ["2.0000000D+00", "-0.3000000D+00"] {
        assert_eq!(with_values(&format!("{}  {soundness}", "  0.0000000D+00".repeat(4))), 2);
    }
}

/// LMGC90 has left-handed axes on the back of plates only: on the front, an axis has been reversed by mistake.
#[test]
fn left_handed_axes_in_front_of_a_plate_are_rejected() {
    let mut case = ball("IQS_CLB", &[0.3], 0.0, 0.0, -1.0);
    case.options.text = true;
    case.run(5);
    let [dof, contacts] = case.first_text_states();
    let datbox = case.path().join("DATBOX");
    std::fs::write(datbox.join("DOF.INI"), dof).unwrap();
    let with_text = |text: &str| {
        std::fs::write(datbox.join("Vloc_Rloc.INI"), text).unwrap();
        case.solve(&["--force"])
    };
    assert_eq!(with_text(&contacts), 0);
    let reversed = contacts.replace("s(2)=-0.1", "s(2)= 0.1");
    assert!(reversed != contacts);
    assert_eq!(with_text(&reversed), 2);
}
