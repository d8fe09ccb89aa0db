//! A sphere that rolls and slides.

use crate::case::{Case, Figures, equal, near};

/// A sphere of radius 1/2 on a floor that slopes by a 3-4-5 triangle, tan = 3/4, under 10 m/s^2.
fn on_slope(friction: f64, theta: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [6.0, 0.0, -8.0];
    case.options.theta = theta;
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    case
}

#[test]
fn a_sphere_rolls_down_a_gentle_slope_at_five_sevenths() {
    // Rolling needs 2/7 of the pull, m g sin / (m g cos) <= 7/2 mu: here from mu = 3/14 = 0.21429 on.
    for (friction, theta) in [(0.2143, 0.5), (0.5, 0.5), (5.0, 0.5), (0.5, 0.75), (0.5, 1.0)] {
        let mut case = on_slope(friction, theta);
        let h = case.options.dt;
        let states = case.states(1000, 500);
        for (state, t) in states.iter().zip([0.0, 0.5, 1.0]) {
            let a = 5.0 / 7.0 * 6.0;
            // Sums of up to 1000 equal terms; the scheme's own position is h (theta - 1/2) v ahead.
            near(state.v(1), [a * t, 0.0, 0.0], 1e-12);
            near(state.w(1), [0.0, a * t / 0.5, 0.0], 1e-12);
            near(state.x(1), [0.5 * a * t * t + (theta - 0.5) * h * a * t, 0.0, 0.5], 1e-12);
        }
        equal(states[2].force(1, 0).unwrap().yz().norm(), 2.0 / 7.0 * 6.0 * states[2].mass(1), 1e-11);
    }
}

#[test]
fn a_sphere_slides_down_a_steep_slope() {
    for friction in [0.0, 0.1, 0.2142] {
        let state = on_slope(friction, 0.5).run(1000);
        // Sums of 1000 equal terms.
        near(state.v(1), [6.0 - friction * 8.0, 0.0, 0.0], 1e-12);
        near(state.w(1), [0.0, 2.5 * friction * 8.0 / 0.5, 0.0], 1e-11);
    }
}

/// A sphere of radius 1/2 on a level floor, mu = 1/4, g = 8 m/s^2, 2 s in steps of 1 ms.
fn launched(v: f64, w: f64) -> Vec<cd_formats::snapshot::Snapshot> {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.25]);
    case.gravity = [0.0, 0.0, -8.0];
    case.floor();
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [v, 0.0, 0.0], [0.0, w, 0.0]);
    case.states(2000, 40)
}

#[test]
fn a_bowled_sphere_ends_rolling_at_five_sevenths_of_its_speed() {
    let states = launched(3.5, 0.0);
    let time = 2.0 * 3.5 / (7.0 * 0.25 * 8.0); // 1/2 s
    for state in &states {
        let t = state.meta.time;
        let v = (3.5 - 0.25 * 8.0 * t).max(2.5);
        // Sums of up to 2000 terms. Angular momentum about the line of contact is kept: 5/7 exactly.
        near(state.v(1), [v, 0.0, 0.0], 1e-12);
        let w = 2.5 * 0.25 * 8.0 / 0.5 * t.min(time);
        near(state.w(1), [0.0, w, 0.0], 1e-11);
    }
    // Slides for 2 v0 / (7 mu g), then rolls without any friction.
    let end = states.last().unwrap();
    near(end.force(1, 0).unwrap(), [8.0 * end.mass(1), 0.0, 0.0], 1e-11);
    // Braked at 2 m/s^2 for 1/2 s, then free for 3/2 s at 5/2 m/s.
    near(end.x(1), [3.5 * 0.5 - 0.25 + 2.5 * 1.5, 0.0, 0.5], 1e-11);
}

#[test]
fn a_spinning_sphere_set_down_rolls_off_at_two_sevenths_of_its_rim() {
    let end = launched(0.0, 14.0).pop().unwrap();
    near(end.v(1), [2.0 / 7.0 * 14.0 * 0.5, 0.0, 0.0], 1e-12);
    near(end.w(1), [0.0, 2.0 / 7.0 * 14.0, 0.0], 1e-12);
    // Backspin: bowled forwards at 1 m/s, it comes back.
    let end = launched(1.0, -21.0).pop().unwrap();
    near(end.v(1), [5.0 / 7.0 - 2.0 / 7.0 * 21.0 * 0.5, 0.0, 0.0], 1e-12);
}

#[test]
fn a_spin_about_the_normal_goes_on() {
    let mut case = on_slope(0.5, 0.5);
    case.gravity = [0.0, 0.0, -8.0];
    case.launch(1, [0.0; 3], [0.0, 0.0, 3.0]);
    // A point of contact holds no moment.
    near(case.run(100).w(1), [0.0, 0.0, 3.0], 0.0);
}

/// A sphere in a groove of two plates whose normals are (0, +-0.6, 0.8), gravity along and across.
fn in_groove(friction: f64, along: f64) -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[friction]);
    case.gravity = [along, 0.0, -8.0];
    for side in [1.0, -1.0] {
        let n = [0.0, 0.6 * side, 0.8];
        case.plate([64.0, 64.0, 0.5], n.map(|c| -c * 1.0), [[1.0, 0.0, 0.0], [0.0, 0.8, -0.6 * side], n]);
    }
    case.sphere(0.5, [0.0, 0.0, 0.0]);
    case
}

#[test]
fn a_sphere_in_a_groove_rolls_on_a_smaller_circle() {
    // It turns on a circle of 0.8 r: a = g / (1 + (2/5) / 0.64). How much the sides squeeze it is not determined.
    let mut case = in_groove(0.4, 2.0);
    let end = case.run(500);
    let a = 2.0 / (1.0 + 0.4 / 0.64);
    // The contacts are coupled: iterated to 1e-12, 500 times.
    near(end.v(2), [a * 0.5, 0.0, 0.0], 1e-10);
    near(end.w(2), [0.0, a * 0.5 / (0.8 * 0.5), 0.0], 1e-10);
    // Slides when its friction, 2 - a along the groove, is more than mu times 8 / 1.6 on each side.
    let mut case = in_groove(0.05, 2.0);
    let end = case.run(500);
    near(end.v(2), [0.5 * (2.0 - 2.0 * 0.05 * 5.0), 0.0, 0.0], 1e-10);
    for plate in [0, 1] {
        let force = end.force(2, plate).unwrap() / end.mass(2);
        equal(force.x, 5.0, 1e-9);
        equal(force.yz().norm(), 0.05 * 5.0, 1e-9);
    }
}
