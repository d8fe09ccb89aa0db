//! Scenes whose result is known in closed form, from scene.ron to snapshots.

use std::f64::consts::PI;

use cd_formats::snapshot::Snapshot;
use cd_tests::case::{Case, surfaces_of_an_l};

/// Uniform gravity of the scenes, m/s².
const G: f64 = 9.81;

/// Density of all bodies, kg/m³.
const DENSITY: f64 = 2700.0;

/// A scene with one law for all contacts; `parts` are the fields `grains`, `walls` and `compute`.
fn scene(gravity: [f64; 3], law: &str, parts: &str) -> String {
    let [x, y, z] = gravity;
    let wall = if parts.contains("WALLx") { r#", (between: ("BLUEx", "WALLx"), law: "law_0")"# } else { "" };
    format!(
        r#"(
            gravity: ({x:?}, {y:?}, {z:?}),
            materials: [(name: "ROCKx", density: {DENSITY:?})],
            laws: [(name: "law_0", kind: {law})],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "law_0"){wall}],
            {parts}
        )"#
    )
}

const DOWN: [f64; 3] = [0.0, 0.0, -G];

/// A grain at `x`; `more` gives its shape or size, and its motion.
fn grain(x: [f64; 3], more: &str) -> String {
    let [x, y, z] = x;
    format!(r#"(material: "ROCKx", colour: "BLUEx", placement: List(positions: [({x:?}, {y:?}, {z:?})]), {more})"#)
}

fn ball(radius: f64, x: [f64; 3], motion: &str) -> String {
    grain(x, &format!("sizes: Single({radius:?}), {motion}"))
}

/// A box whose edges are along the axes.
fn block(lengths: [f64; 3], x: [f64; 3], motion: &str) -> String {
    let [a, b, c] = lengths;
    let shape =
        format!("shape: Box(lengths: ({a:?}, {b:?}, {c:?})), grain_orientation: Same((axis: (0, 0, 1), angle: 0.0))");
    grain(x, &format!("{shape}, {motion}"))
}

/// A plate of half thickness 0.5 m whose upper face is z = 0.
const FLOOR: &str = r#"Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, -0.5), half_lengths: (50, 50, 0.5))"#;

/// Fields of a scene with one grain.
fn parts(grain: &str, walls: &str, compute: &str) -> String {
    format!("grains: [{grain}], walls: [{walls}], compute: ({compute}),")
}

fn solved(scene: &str) -> Case {
    Case::from_scene(scene).solved(&["--threads", "1"])
}

/// The last state of a scene.
fn end_of(scene: &str) -> Snapshot {
    solved(scene).last_snapshot()
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[track_caller]
fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance:.1e}");
}

#[track_caller]
fn assert_all_near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for k in 0..3 {
        assert!(
            (found[k] - expected[k]).abs() <= tolerance,
            "found {found:?}, expected {expected:?} within {tolerance:.1e}"
        );
    }
}

/// A frictionless ball slides along a floor and a wall, which bear m g and m a, across the border of a period.
#[test]
fn a_ball_slides_along_a_wall_across_the_period() {
    let wall = r#"Plate(material: "ROCKx", colour: "WALLx", centre: (0, 1.5, 0), normal: (0, 1, 0), half_lengths: (4, 4, 0.5))"#;
    let floor = FLOOR.replace("(50, 50, 0.5)", "(4, 4, 0.5)");
    let ball = ball(0.5, [0.0, 0.5, 0.5], "velocity: (1.0, 0, 0)");
    let compute = "dt: 1e-3, end_time: 7.0, output_every: 500, xperiode: 3.0";
    let parts = parts(&ball, &format!("{floor}, {wall}"), compute);
    let case = solved(&scene([0.0, 1.0, -G], "IQS_CLB(friction: 0.0)", &parts));
    let mass = DENSITY * PI / 6.0;
    for step in (500..=7000).step_by(500) {
        let state = case.snapshot(step);
        let mut forces: Vec<f64> = state.contacts.contact_force.iter().map(|force| force[0]).collect();
        forces.retain(|force| *force > 0.0);
        forces.sort_by(f64::total_cmp);
        // The solver's tolerance is 1e-2 of what a step changes; one ball on two planes is solved exactly.
        assert_eq!(forces.len(), 2);
        assert_near(forces[0], mass, 1e-6 * mass);
        assert_near(forces[1], mass * G, 1e-6 * mass * G);
        // Overlaps stay below what the 8 digits of the files leave.
        assert_all_near(state.bodies.body_v[0], [1.0, 0.0, 0.0], 1e-6);
        assert_all_near(state.bodies.body_x[0], [1e-3 * step as f64, 0.5, 0.5], 1e-6);
    }
}

/// A ball thrown along the inside of a turning drum ends rolling: its speed is 6/7 of that of the wall.
///
/// With the wall at 1 m/s and the ball at 0.8 m/s without spin, friction exchanges J = m (v − 0.8) = (2/5) m R w and
/// the slip 1 − v − R w vanishes: v = 0.8 + (1 − 0.8) · 2/7 = 6/7 m/s, w = 5/7 rad/s.
#[test]
fn a_ball_in_a_drum_rolls() {
    let drum = r#"Cylinder(material: "ROCKx", colour: "WALLx", centre: (0, 0, 0), axis: (0, 1, 0), half_height: 1.0, radius: 1.0,
        hollow: true, spin: Constant(1.0))"#;
    let ball = ball(0.2, [0.8, 0.0, 0.0], "velocity: (0, 0, -0.8)");
    let parts = parts(&ball, drum, "dt: 2e-3, end_time: 20, output_every: 1000");
    let state = end_of(&scene([0.0; 3], "IQS_CLB(friction: 0.5)", &parts));
    let speed = norm(state.bodies.body_v[0]);
    let mass = DENSITY * 4.0 / 3.0 * PI * 0.2f64.powi(3);
    // First order in the angle of a step, 2e-3.
    assert_near(speed, 6.0 / 7.0, 1e-4);
    assert_near(norm(state.bodies.body_w_world[0]), 5.0 / 7.0, 5e-4);
    assert_near(norm(state.bodies.body_x[0]), 0.8, 1e-5);
    let pressing = state.contacts.contact_force.iter().map(|force| force[0]).fold(0.0, f64::max);
    assert_near(pressing, mass * (6.0f64 / 7.0).powi(2) / 0.8, 1e-3 * pressing);
}

/// A ball that rolls on a turntable of angular velocity Ω goes round a circle at 2/7 Ω.
#[test]
fn a_ball_on_a_turntable_goes_round_at_two_sevenths() {
    let table = FLOOR.replace("(50, 50, 0.5)", "(50, 50, 0.5), spin: (Constant(0.0), Constant(0.0), Constant(2.0))");
    let ball = ball(0.5, [2.0, 0.0, 0.5], "velocity: (0, 1.0, 0), spin: (6.0, 0, 0)");
    let parts = parts(&ball, &table, "dt: 1e-3, end_time: 10.996, output_every: 500");
    let case = solved(&scene(DOWN, "IQS_CLB(friction: 2.0)", &parts));
    for step in (500..=10_500).step_by(500) {
        let state = case.snapshot(step);
        let angle = 4.0 / 7.0 * 1e-3 * step as f64;
        // v = 2/7 Ω r gives the radius 1.75 m; second order in the angle of a step.
        let expected = [0.25 + 1.75 * angle.cos(), 1.75 * angle.sin(), 0.5];
        assert_all_near(state.bodies.body_x[0], expected, 2e-5);
        assert_near(norm(state.bodies.body_v[0]), 1.0, 1e-6);
    }
}

/// Bond whose tensile strength times the area of the face is `share` of the weight of a cube of 1 m³.
fn bond(share: f64, tangential: f64) -> String {
    format!(
        "IQS_MOHR_DS_CLB(normal_cohesion: {:?}, tangential_cohesion: {tangential:?}, dynamic_friction: 0.5, static_friction: 0.5)",
        share * DENSITY * G
    )
}

/// Drop in half a second of a cube that is bonded to a held one at `held`, m.
fn drop_of_bonded_cube(bond: &str, held: [f64; 3]) -> f64 {
    let free = block([1.0; 3], [0.0; 3], "");
    let fixed = block([1.0; 3], held, "driven: (Constant(0.0), Constant(0.0), Constant(0.0))");
    let parts = format!(
        "grains: [{free}, {}], compute: (dt: 1e-3, end_time: 0.5, output_every: 50),",
        fixed.replace("BLUEx", "WALLx")
    );
    -end_of(&scene(DOWN, bond, &parts)).bodies.body_x[0][2]
}

/// A cube hangs by a bonded face as long as c_n S is at least its weight.
#[test]
fn a_hanging_cube_tears_off_at_its_weight() {
    for (share, falls) in [(0.98, true), (1.02, false)] {
        let drop = drop_of_bonded_cube(&bond(share, share * DENSITY * G), [0.0, 0.0, 1.0]);
        let free_fall = 0.5 * G * 0.25;
        if falls { assert_near(drop, free_fall, 0.01 * free_fall) } else { assert_near(drop, 0.0, 1e-6) }
    }
}

/// A cube bonded by its side: the moment of its weight at half a length is borne by the two upper corners, each with
/// c_n S/4 at a lever of 1 m, so it holds if c_n S is at least its weight.
#[test]
fn a_bonded_cantilever_breaks_at_its_weight() {
    for (share, falls) in [(0.98, true), (1.02, false)] {
        let drop = drop_of_bonded_cube(&bond(share, 1e9), [1.0, 0.0, 0.0]);
        if falls { assert!(drop > 0.1, "dropped by {drop} m only") } else { assert_near(drop, 0.0, 1e-6) }
    }
}

/// Small rocking of a box on a cylinder without slip: half periods of π √((k² + h²)/(g (R − h))).
///
/// h is half the height of the box, k² = (a² + b²)/12 with the lengths a, b across the axis.
#[test]
fn a_box_rocks_on_a_cylinder() {
    for (height, radius) in [(0.4, 1.0), (0.2, 2.0)] {
        let half = 0.5 * height;
        let motion = format!("spin: (0, 0.1, 0), velocity: ({:?}, 0, 0)", 0.1 * half);
        let cylinder = format!(
            r#"Cylinder(material: "ROCKx", colour: "WALLx", centre: (0, 0, {:?}), axis: (0, 1, 0), half_height: 3.0, radius: {radius:?})"#,
            -radius
        );
        let compute = "dt: 1e-4, end_time: 1.0, output_every: 100";
        let parts = parts(&block([1.0, 1.0, height], [0.0, 0.0, half], &motion), &cylinder, compute);
        let case = solved(&scene(DOWN, "IQS_CLB(friction: 1.0)", &parts));
        let spins: Vec<f64> = (0..=100).map(|k| case.snapshot(100 * k).bodies.body_w_world[0][1]).collect();
        let crossings: Vec<f64> = (1..spins.len())
            .filter(|&k| spins[k - 1] * spins[k] < 0.0)
            .map(|k| 0.01 * (k as f64 - spins[k] / (spins[k] - spins[k - 1])))
            .collect();
        let squared_gyration = (1.0 + height * height) / 12.0;
        let expected = PI * ((squared_gyration + half * half) / (G * (radius - half))).sqrt();
        assert!(crossings.len() >= 2, "{crossings:?}");
        for pair in crossings.windows(2) {
            // Linear interpolation between snapshots errs by up to 1e-3 of an interval's share of a period.
            assert_near(pair[1] - pair[0], expected, 2e-3 * expected);
        }
        assert!(spins.iter().all(|spin| spin.abs() < 0.1001), "amplitude grows");
    }
}

/// Forty bodies in one point: the tree ends, they stay, and attract like one of forty masses.
#[test]
fn coincident_bodies_attract_as_one() {
    let positions = format!("{} (100.0, 0.0, 0.0)", "(0.0, 0.0, 0.0), ".repeat(40));
    let grains = format!(
        r#"(material: "ROCKx", colour: "BLUEx", sizes: Single(0.5), placement: List(allow_overlap: true, positions: [{positions}]))"#
    );
    let compute = "dt: 1.0, end_time: 10.0, output_every: 5, self_gravity: true, gravity: fmm";
    let scene = format!(
        r#"(
            materials: [(name: "ROCKx", density: {DENSITY:?})],
            laws: [(name: "law_0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: None)],
            grains: [{grains}],
            compute: ({compute}),
        )"#
    );
    let state = end_of(&scene);
    let mass = DENSITY * PI / 6.0;
    let expected = -40.0 * 6.6743e-11 * mass / 1e4 * 10.0;
    // gravity_error is 1e-3.
    assert_near(state.bodies.body_v[40][0], expected, 1e-3 * expected.abs());
    for i in 1..40 {
        assert_eq!(state.bodies.body_x[i], state.bodies.body_x[0]);
    }
}

/// A sliding cube stops after v²/(2 μ g) in any direction, upright and without turning.
#[test]
fn a_cube_slides_as_far_in_every_direction() {
    for degrees in [0.0f64, 30.0, 45.0, 75.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let velocity = format!("velocity: ({:?}, {:?}, 0.0)", 6.0 * cos, 6.0 * sin);
        let compute = "dt: 1e-3, end_time: 2.0, output_every: 200";
        let parts = parts(&block([1.0; 3], [0.0, 0.0, 0.5], &velocity), FLOOR, compute);
        let case = solved(&scene(DOWN, "IQS_CLB(friction: 0.5)", &parts));
        let x = case.last_snapshot().bodies.body_x[0];
        let travel = 36.0 / (2.0 * 0.5 * G);
        // The first step slides at the full speed for half of dt.
        assert_all_near(x, [travel * cos, travel * sin, 0.5], 1e-4 * travel);
        for step in (0..=2000).step_by(200) {
            assert!(norm(case.snapshot(step).bodies.body_w_world[0]) < 1e-5, "turns at {degrees} degrees");
        }
    }
}

/// The acceleration of a sliding block does not depend on its size.
#[test]
fn a_slider_of_any_size_accelerates_alike() {
    let (sin, cos) = 30.0f64.to_radians().sin_cos();
    for size in [1.4e-6, 1.4e-3, 1.4] {
        let plate = format!(
            r#"Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, {:?}), half_lengths: ({:?}, {:?}, {size:?}))"#,
            -size,
            10.0 + 1000.0 * size,
            1000.0 * size
        );
        let slider = block([size, 0.37 * size, size], [0.0, 0.0, 0.5 * size], "");
        let parts = parts(&slider, &plate, "dt: 1e-3, end_time: 0.5, output_every: 100");
        let state = end_of(&scene([G * sin, 0.0, -G * cos], "IQS_CLB(friction: 0.3)", &parts));
        let expected = G * (sin - 0.3 * cos) * 0.5;
        assert_near(state.bodies.body_v[0][0], expected, 1e-5 * expected);
    }
}

/// An elastic ball keeps its energy over many bounces, and its height.
#[test]
fn an_elastic_ball_bounces_for_ever() {
    let parts = parts(&ball(0.5, [0.0, 0.0, 10.5], ""), FLOOR, "dt: 1e-2, end_time: 60.0, output_every: 10");
    let law = "RST_CLB(normal_restitution: 1.0, tangential_restitution: 0.0, friction: 0.0)";
    let case = solved(&scene(DOWN, law, &parts));
    let states: Vec<Snapshot> = (0..=600).map(|k| case.snapshot(10 * k)).collect();
    let energies =
        states.iter().map(|state| G * (state.bodies.body_x[0][2] - 0.5) + 0.5 * state.bodies.body_v[0][2].powi(2));
    for energy in energies {
        assert_near(energy, G * 10.0, 1e-11);
    }
    let bounces =
        states.windows(2).filter(|pair| pair[0].bodies.body_v[0][2] < 0.0 && pair[1].bodies.body_v[0][2] > 0.0);
    // A bounce every 2 √(2 H/g) = 2.856 s, the first after half of that.
    assert_eq!(bounces.count(), 21);
    let top = states[100..].iter().map(|state| state.bodies.body_x[0][2] - 0.5).fold(0.0, f64::max);
    // A snapshot every 0.1 s meets the top to ½ g (0.05 s)².
    assert!((9.98..=10.0 + 1e-12).contains(&top), "top {top}");
}

/// Two equal balls exchange their velocities across the border of a period.
#[test]
fn an_elastic_impact_across_the_period() {
    let grains =
        format!("{}, {}", ball(0.3, [1.2, 0.0, 0.0], "velocity: (1.0, 0, 0)"), ball(0.3, [-1.2, 0.0, 0.0], ""));
    let law = "RST_CLB(normal_restitution: 1.0, tangential_restitution: 0.0, friction: 0.0)";
    let parts = parts(&grains, "", "dt: 1e-3, end_time: 1.0, output_every: 100, xperiode: 3.2");
    let state = end_of(&scene([0.0; 3], law, &parts));
    assert_all_near(state.bodies.body_v[0], [0.0; 3], 1e-12);
    assert_all_near(state.bodies.body_v[1], [1.0, 0.0, 0.0], 1e-12);
    // They touch at x = 1.4 m; the blow is up to a step earlier, before they would overlap.
    assert!((1.4 - 1e-3..=1.4 + 1e-9).contains(&state.bodies.body_x[0][0]), "{:?}", state.bodies.body_x[0]);
}

/// A free box that spins near its middle axis follows Euler's equations through many turn-overs.
#[test]
fn a_free_body_follows_eulers_equations() {
    let parts = parts(
        &block([1.0, 2.0, 3.0], [0.0; 3], "spin: (0.01, 3.0, 0.02)"),
        "",
        "dt: 1e-2, end_time: 50, output_every: 5000",
    );
    let case = solved(&scene([0.0; 3], "IQS_CLB(friction: 0.5)", &parts));
    let (start, end) = (case.snapshot(0), case.last_snapshot());
    let inertia = start.bodies.body_inertia[0];
    let rate = |w: [f64; 3]| {
        let torque = cross(w, std::array::from_fn(|k| inertia[k] * w[k]));
        std::array::from_fn::<f64, 3, _>(|k| -torque[k] / inertia[k])
    };
    // Runge-Kutta of fourth order with steps of 1e-4 s: exact to 1e-12.
    let mut w = start.bodies.body_w[0];
    let at = |w: [f64; 3], slope: [f64; 3], h: f64| std::array::from_fn(|k| w[k] + h * slope[k]);
    for _ in 0..500_000 {
        let h = 1e-4;
        let a = rate(w);
        let b = rate(at(w, a, 0.5 * h));
        let c = rate(at(w, b, 0.5 * h));
        let d = rate(at(w, c, h));
        w = std::array::from_fn(|k| w[k] + h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]));
    }
    // Second order in the angle of a step, 0.03, over 24 turns.
    assert_all_near(end.bodies.body_w[0], w, 5e-4);
    let energy = |w: [f64; 3]| (0..3).map(|k| 0.5 * inertia[k] * w[k] * w[k]).sum::<f64>();
    let first = energy(start.bodies.body_w[0]);
    assert_near(energy(end.bodies.body_w[0]), first, 1e-13 * first);
    let momenta = |state: &Snapshot| state.shapes.as_ref().unwrap().turning.turning_momentum[0];
    assert_eq!(momenta(&start), momenta(&end));
}

/// The mass, centre and inertia of an L are those of its surface, not of its hull or of overlapping pieces.
#[test]
fn the_inertia_of_an_l_is_that_of_its_surface() {
    let folder = surfaces_of_an_l();
    let grain = grain(
        [0.0, 0.0, 5.0],
        r#"shape: Model(file: "l.obj", contact_shape: Pieces(max_pieces: 8)), grain_orientation: Same((axis: (0, 0, 1), angle: 0.0))"#,
    );
    let text = scene(DOWN, "IQS_CLB(friction: 0.5)", &parts(&grain, FLOOR, "dt: 1e-3, steps: 1"));
    let state = Case::with_surfaces(&text, folder.path()).solved(&["--threads", "1"]).snapshot(0);
    assert_near(state.bodies.body_mass[0], 3.0 * DENSITY, 1e-6 * DENSITY);
    let mut inertia = state.bodies.body_inertia[0].map(|i| i / DENSITY);
    inertia.sort_by(f64::total_cmp);
    // The files have 8 digits.
    assert_all_near(inertia, [5.0 / 6.0, 3.0 / 2.0, 11.0 / 6.0], 1e-6);
}

/// Rolling friction alone brakes a rolling ball by 5/7 μ_r g.
#[test]
fn rolling_friction_brakes_a_rolling_ball() {
    let law =
        "IQS_DS_ROLL_CLB(dynamic_friction: 0.5, static_friction: 0.5, rolling_friction: 0.1, spinning_friction: 0.0)";
    let ball = ball(0.5, [0.0, 0.0, 0.5], "velocity: (1.0, 0, 0), spin: (0, 2.0, 0.0)");
    let case = solved(&scene(DOWN, law, &parts(&ball, FLOOR, "dt: 1e-3, end_time: 2.0, output_every: 100")));
    let braking = 5.0 / 7.0 * 0.1 * G;
    for step in [200, 500, 1000] {
        let state = case.snapshot(step);
        assert_near(state.bodies.body_v[0][0], 1.0 - braking * 1e-3 * step as f64, 1e-5);
        assert_near(state.bodies.body_w_world[0][1], 2.0 * state.bodies.body_v[0][0], 1e-6);
    }
    assert_near(norm(case.last_snapshot().bodies.body_v[0]), 0.0, 1e-9);
}

/// Spinning friction alone brakes a spinning ball by 5/2 μ_s g/R.
#[test]
fn spinning_friction_brakes_a_spinning_ball() {
    let law =
        "IQS_DS_ROLL_CLB(dynamic_friction: 0.5, static_friction: 0.5, rolling_friction: 0.0, spinning_friction: 0.1)";
    let ball = ball(0.5, [0.0, 0.0, 0.5], "spin: (0, 0, 10.0)");
    let state = end_of(&scene(DOWN, law, &parts(&ball, FLOOR, "dt: 1e-3, end_time: 1.0, output_every: 100")));
    assert_near(state.bodies.body_w_world[0][2], 10.0 - 2.5 * 0.1 * G / 0.5, 1e-5);
    assert_all_near(state.bodies.body_x[0], [0.0, 0.0, 0.5], 1e-6);
}

/// Four plates that turn about a common axis outside of them stay on their circle and carry a box round.
#[test]
fn a_square_drum_of_plates_turns() {
    let plate = |quarter: usize| {
        let angle = quarter as f64 * 0.5 * PI;
        let (sin, cos) = angle.sin_cos();
        format!(
            r#"Plate(material: "ROCKx", colour: "WALLx", centre: ({:?}, 0, {:?}), normal: ({cos:?}, 0, {sin:?}), first_axis: (0, 1, 0),
                half_lengths: (1, 1.2, 0.1), spin: (Constant(0.5), Constant(0.0), Constant(0.0)),
                velocity: (Harmonic(amplitude: 0.55, omega: 0.5, phase: {:?}), Constant(0.0), Harmonic(amplitude: 0.55, omega: 0.5, phase: {:?})))"#,
            1.1 * cos,
            1.1 * sin,
            0.5 * PI - angle,
            PI - angle
        )
    };
    let plates: Vec<String> = (0..4).map(plate).collect();
    let parts = parts(
        &block([0.4; 3], [0.0, 0.0, -0.7], ""),
        &plates.join(", "),
        "dt: 1e-3, end_time: 12.566, output_every: 3141",
    );
    let case = solved(&scene(DOWN, "IQS_CLB(friction: 0.5)", &parts));
    for step in [3141, 6282, 9423, 12_566] {
        let state = case.snapshot(step);
        let turned = 0.5 * 1e-3 * step as f64;
        let (sin, cos) = turned.sin_cos();
        for quarter in 0..4 {
            let start = quarter as f64 * 0.5 * PI;
            // About y the plates turn from z to x; first order in the angle of a step, 5e-4.
            let expected = [1.1 * (start - turned).cos(), 0.0, 1.1 * (start - turned).sin()];
            assert_all_near(state.bodies.body_x[1 + quarter], expected, 1e-3);
        }
        let [x, _, z] = state.bodies.body_x[0];
        for along in [x * cos - z * sin, x * sin + z * cos] {
            assert!(along.abs() < 1.0, "the box is out at step {step}: {along}");
        }
    }
}

/// Two aggregates fall onto each other: linear and angular momentum are kept to rounding, however coarse the multipoles.
#[test]
fn two_aggregates_keep_their_angular_momentum() {
    let cloud = |number: usize, solid_fraction: f64, place: &str, motion: &str| {
        format!(
            r#"(material: "ROCKx", colour: "BLUEx", number: {number}, solid_fraction: {solid_fraction:?},
                sizes: Uniform(min: 0.5, max: 1.0), placement: {place}(envelope: Ball()), {motion})"#
        )
    };
    let grains = [
        cloud(300, 0.25, "JitteredLattice", ""),
        cloud(30, 0.15, "RandomSequential", "centre: (40, 3, 0), velocity: (0, -1.0e-4, 0)"),
    ]
    .join(", ");
    let compute =
        "dt: 20.0, end_time: 6000.0, output_every: 100, self_gravity: true, gravity: fmm, gravity_error: 1e-2";
    let case = solved(&scene([0.0; 3], "IQS_CLB(friction: 0.5)", &parts(&grains, "", compute)));
    let momenta = |state: &Snapshot| {
        let bodies = &state.bodies;
        let (mut p, mut l, mut scale) = ([0.0; 3], [0.0; 3], 0.0);
        for i in 0..bodies.body_x.len() {
            let momentum = bodies.body_v[i].map(|v| bodies.body_mass[i] * v);
            let orbital = cross(bodies.body_x[i], momentum);
            for k in 0..3 {
                p[k] += momentum[k];
                l[k] += orbital[k] + bodies.body_inertia[i][0] * bodies.body_w_world[i][k];
            }
            scale += norm(momentum);
        }
        (p, l, scale)
    };
    let ((p_0, l_0, _), (p_1, l_1, scale)) = (momenta(&case.snapshot(0)), momenta(&case.last_snapshot()));
    // Rounding of 300 steps, in units of Σ m |v| and, with an arm of 50 m, of the angular momenta that it makes.
    assert_all_near(p_1, p_0, 1e-13 * scale);
    assert_all_near(l_1, l_0, 1e-13 * scale * 50.0);
}
