//! Wires and rods between points PT3Dx: one link, in closed form.

use std::f64::consts::{PI, TAU};

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::drv_dof::Evolution;

use crate::case::{Case, Figures, near};

/// Mass of a ball of radius 1/2 and density 1.
const MASS: f64 = PI / 6.0;

/// Gives a body a point in its own frame.
fn point(case: &mut Case, body: usize, offset: [f64; 3]) {
    let shape = ShapeRecord::Point { offset };
    case.bodies[body].contactors.push(Contactor { colour: "WALLx".into(), shape, local_frame: None });
}

/// A fixed ball and one that is thrown along x at `speed`, 2 m apart and joined between their centres.
fn pair(kind: &str, parameters: &[f64], speed: f64) -> Case {
    let mut case = Case::new();
    case.law_between("PT3Dx", "PT3Dx", kind, parameters);
    case.tact.visibility[0].alert = 2.0;
    case.options.dt = 1.0 / 1024.0;
    let held = case.sphere(0.5, [0.0; 3]);
    let thrown = case.sphere(0.5, [2.0, 0.0, 0.0]);
    case.drive(held, [0.0; 6].map(Evolution::constant));
    case.launch(thrown, [speed, 0.0, 0.0], [0.0; 3]);
    [held, thrown].into_iter().for_each(|body| point(&mut case, body, [0.0; 3]));
    case
}

/// Elongation and velocity after so many steps: v' = v - h f/m with the tension f = (k (z + h v' - 2 ε_0) + η v')/2 of the elongation
/// z at the middle of the step, of a wire at least 0.
fn swings([k, prestrain, eta]: [f64; 3], is_wire: bool, mut v: f64, h: f64, steps: u64) -> [f64; 2] {
    let mut z = 0.0;
    for _ in 0..steps {
        let middle: f64 = z + 0.5 * h * v;
        let (spring, damper) = (k / 2.0, eta / 2.0);
        let tied = (MASS * v - h * spring * (middle - 2.0 * prestrain)) / (MASS + h * (h * spring + damper));
        let tension = spring * (middle + h * tied - 2.0 * prestrain) + damper * tied;
        v = if is_wire && tension < 0.0 { v } else { tied };
        z = middle + 0.5 * h * v;
    }
    [z, v]
}

#[test]
fn links_follow_the_implicit_oscillator_at_any_stiffness() {
    for (kind, eta) in [("ELASTIC_ROD", 0.0), ("ELASTIC_WIRE", 0.0), ("VOIGT_ROD", 4.0), ("VOIGT_WIRE", 4.0)] {
        for k in [64.0, 4096.0, 1e9] {
            // A force of 0.64 N; its eight digits are exact.
            let strain = 0.64 / k;
            for (prestrain, speed) in [(0.0, 0.25), (0.0, -0.25), (-strain, -0.25), (strain, 0.25)] {
                let parameters: &[f64] = if eta > 0.0 { &[k, prestrain, eta] } else { &[k, prestrain] };
                let end = pair(kind, parameters, speed).run(200);
                let [z, v] = swings([k, prestrain, eta], kind.ends_with("WIRE"), speed, 1.0 / 1024.0, 200);
                // Rounding of 200 steps with forces up to k times the rounding of a length of 2 m.
                near(end.x(1), [2.0 + z, 0.0, 0.0], 1e-12);
                near(end.v(1), [v, 0.0, 0.0], 1e-10);
            }
        }
    }
}

#[test]
fn a_rod_swings_with_its_frequency_and_a_slack_wire_flies() {
    // ω² = k/(L_0 m): half a period later the ball comes back at its speed, less the damping of first order, π ω h/2 = 1.6e-3.
    let stiffness = 2.0 * MASS * (TAU * 4.0).powi(2);
    let mut case = pair("ELASTIC_ROD", &[stiffness, 0.0], 0.25);
    case.options.dt = 1.0 / 8192.0 * 0.5;
    let states = case.states(2048, 1024);
    near(states[2].v(1), [-0.25, 0.0, 0.0], 0.25 * 0.01);
    near(states[2].x(1), [2.0, 0.0, 0.0], 0.25 / 25.0 * 0.01);
    // A wire is slack on the way in; 0.125 m shorter the ball still flies.
    near(pair("ELASTIC_WIRE", &[stiffness, 0.0], -0.25).run(512).v(1), [-0.25, 0.0, 0.0], 0.0);
    let pulls = pair("ELASTIC_WIRE", &[stiffness, 0.0], 0.25).run(16);
    assert!(pulls.force(0, 1).unwrap().x < 0.0);
    assert_eq!(pulls.contacts.contact_gap.len(), 1);
}

#[test]
fn a_link_off_the_centres_conserves_momentum() {
    let mut case = Case::new();
    case.law_between("PT3Dx", "PT3Dx", "ELASTIC_WIRE", &[1e4, -0.125]);
    case.tact.visibility[0].alert = 4.0;
    case.options.dt = 1.0 / 4096.0;
    let one = case.sphere(0.5, [0.0; 3]);
    let two = case.sphere(0.25, [2.0, 0.5, 0.25]);
    case.launch(one, [0.0, 0.5, 0.0], [1.0, 0.0, 2.0]);
    point(&mut case, one, [0.25, 0.25, 0.0]);
    point(&mut case, two, [0.0, -0.125, 0.125]);
    let states = case.states(400, 1);
    let (first, last) = (&states[0], &states[400]);
    assert!((last.v(two) - first.v(two)).norm() > 0.5 && last.w(two).norm() > 0.5);
    near(last.momentum(), first.momentum(), 1e-13);
    // The impulse acts at the middle of the step: rounding only.
    near(last.angular_momentum(), first.angular_momentum(), 1e-12);
}

#[test]
fn a_link_is_for_good_and_survives_a_resume_and_a_restart_from_text() {
    let scene = || {
        let mut case = pair("VOIGT_ROD", &[512.0, 0.0, 1.0], 0.25);
        case.options.text = true;
        case
    };
    let unbroken = scene().run(300);
    let mut case = scene();
    case.run(150);
    let middle = case.first_text_states();
    assert!(middle[1].contains("PTPT3") && middle[1].contains("PT3Dx"), "{}", middle[1]);
    assert_eq!(case.solve(&["--resume", "--steps", "300"]), 0);
    assert!(case.last().bodies == unbroken.bodies && case.last().contacts == unbroken.contacts);
    // Eight digits of the files.
    near(case.run_from_text(&middle, 150).x(1), unbroken.x(1), 1e-6);
    // The distance in BODIES.DAT decides, not that at the start; what lies beyond the alert distance is not joined.
    let mut apart = pair("ELASTIC_ROD", &[512.0, 0.0], 0.25);
    apart.tact.visibility[0].alert = 1.99;
    near(apart.run(64).v(1), [0.25, 0.0, 0.0], 0.0);
    let mut drawn = pair("ELASTIC_ROD", &[512.0, 0.0], 0.0);
    drawn.dof[1].displacement[0] = 0.5;
    assert!(drawn.run(1).v(1).x < 0.0);
}

#[test]
fn links_that_cannot_be_are_rejected() {
    let mut case = pair("ELASTIC_ROD", &[512.0, 0.0], 0.0);
    case.options.xperiode = Some(16.0);
    assert!(case.attempt(1).is_none());
    let mut case = pair("ELASTIC_ROD", &[512.0, 0.0], 0.0);
    case.bodies[1].contactors[1].shape = ShapeRecord::Point { offset: [-2.0, 0.0, 0.0] };
    assert!(case.attempt(1).is_none(), "no length");
    assert!(pair("IQS_CLB", &[0.3], 0.0).attempt(1).is_none());
    let mut case = pair("ELASTIC_ROD", &[512.0, 0.0], 0.0);
    case.law_with("SPHER", "ELASTIC_ROD", &[512.0, 0.0]);
    assert!(case.attempt(1).is_none());
}
