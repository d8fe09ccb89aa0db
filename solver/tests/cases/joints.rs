//! Flush joints: plates, bricks and pieces of one body side by side act as one surface; steps, walls and corners do not.
//!
//! A body that slides at v with friction μ comes to rest after x = v²/(2 μ g).

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::compute::{Accuracy, NarrowPhase};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;

use crate::capsules::{self, ALONG_X, ALONG_Y, UPRIGHT};
use crate::case::{BOX, Case, Figures, Vec3, equal, near};
use crate::same_bits::{files, same};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const NARROW: [NarrowPhase; 2] = [NarrowPhase::Fast, NarrowPhase::Accurate];
const LAWS: [(&str, &[f64]); 5] = [
    ("IQS_CLB", &[0.5]),
    ("GAP_SGR_CLB", &[0.5]),
    ("VEL_SGR_CLB", &[0.5]),
    ("RST_CLB", &[0.5, 0.0, 0.5]),
    ("IQS_MOHR_DS_CLB", &[2e-9, 1e-9, 0.5, 0.5]),
];

/// A scene under 8 m/s² along -z, as accurate as runs are by default.
fn scene(law: &str, parameters: &[f64], narrow: NarrowPhase, dt: f64) -> Case {
    let mut case = Case::new();
    case.law_of_all(law, parameters);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.narrow_phase = Some(narrow);
    case.options.dt = dt;
    (case.options.tol, case.options.max_sweeps) = (None, None);
    case
}

/// Plates side by side along x, their upper faces in z = 0, each `length` long, from x = -2 on.
fn plates(case: &mut Case, length: f64, count: usize) {
    for k in 0..count {
        let x = -2.0 + length * (k as f64 + 0.5);
        case.plate([0.5 * length, 2.0, 0.5], [x, 0.0, -0.5], [X, Y, Z]);
    }
}

/// Steps to a time, s.
fn steps(case: &Case, time: f64) -> u64 {
    (time / case.options.dt).round() as u64
}

/// A cube of 0.5 m that began at x = 0 with 6 m/s has come to rest after 36/(2·0.5·8) = 4.5 m, as upright as it was.
#[track_caller]
fn has_slid(state: &Snapshot, cube: usize, longest: f64) {
    // A thousandth of the travel. VEL and RST let it fall for a step, at most `longest` (s), at a time: 8 m/s² h², a few times.
    let sunk = 1e-5 + 40.0 * longest * longest;
    equal(state.x(cube).x, 4.5, 4.5e-3);
    equal(state.x(cube).y, 0.1, 2e-3);
    equal(state.x(cube).z, 0.25, sunk);
    assert!(state.v(cube).norm() < 1e-3 && state.w(cube).norm() < 1e-2, "{} {}", state.v(cube), state.w(cube));
    let [_, x, y, z] = state.bodies.body_q[cube];
    assert!(2.0 * x.hypot(y) < sunk / 0.25 && z.abs() < 1e-3, "{:?}", state.bodies.body_q[cube]);
}

#[test]
fn a_cube_slides_over_plates() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            for (dt, preset) in [
                (1e-2, None),
                (1e-3, None),
                (1e-3, Some(Accuracy::Draft)),
                (1e-3, Some(Accuracy::Standard)),
                (1e-3, Some(Accuracy::Fine)),
                (1e-3, Some(Accuracy::Reference)),
            ] {
                println!("{law} {narrow:?} {dt} {preset:?}");
                let mut case = scene(law, parameters, narrow, dt);
                case.options.accuracy = preset;
                plates(&mut case, 1.3, 8);
                let cube = case.block([0.25; 3], [0.0, 0.1, 0.25], [X, Y, Z]);
                case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
                let steps = steps(&case, 1.6);
                let most = match preset {
                    Some(Accuracy::Draft) => 16.0,
                    Some(Accuracy::Standard) => 4.0,
                    _ => 1.0,
                };
                has_slid(&case.run(steps), cube, most * dt);
            }
        }
    }
}

/// Over joints at an angle and over corners where four plates meet, turned about z: it goes straight on and does not turn.
#[test]
fn a_cube_slides_over_the_corners_of_tiles() {
    for narrow in NARROW {
        for (law, parameters) in [LAWS[0], LAWS[3]] {
            for (angle, turn) in
                [(0.0f64, 0.0f64), (0.3, 0.4), (std::f64::consts::FRAC_PI_4, 0.0), (1.2, std::f64::consts::FRAC_PI_4)]
            {
                println!("{law} {narrow:?} {angle} {turn}");
                let mut case = scene(law, parameters, narrow, 1e-3);
                for (i, j) in (0..64).map(|k| (f64::from(k / 8), f64::from(k % 8))) {
                    case.plate([0.4, 0.4, 0.5], [0.8 * i - 0.6, 0.8 * j - 0.6, -0.5], [X, Y, Z]);
                }
                let (sin, cos) = turn.sin_cos();
                let cube = case.block([0.25; 3], [0.1, 0.2, 0.25], [[cos, sin, 0.0], [-sin, cos, 0.0], Z]);
                case.launch(cube, [6.0 * angle.cos(), 6.0 * angle.sin(), 0.0], [0.0; 3]);
                let q = |state: &Snapshot| Vec3::from_row_slice(&state.bodies.body_q[cube][1..]);
                let states = case.states(1600, 1600);
                let (first, last) = (&states[0], &states[1]);
                near(last.x(cube), [0.1 + 4.5 * angle.cos(), 0.2 + 4.5 * angle.sin(), 0.25], 4.5e-3);
                assert!((q(last) - q(first)).norm() < 1e-3);
            }
        }
    }
}

/// A ball that rolls without slip keeps its speed, whether in scenes of spheres and plates alone or among other shapes.
#[test]
fn a_ball_rolls_over_plates_without_loss() {
    for (law, parameters) in LAWS {
        for dt in [1e-2, 1e-3] {
            for other_shapes in [false, true] {
                println!("{law} {dt} {other_shapes}");
                let mut case = scene(law, parameters, NarrowPhase::Fast, dt);
                plates(&mut case, 0.2, 60);
                let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
                case.launch(ball, [4.0, 0.0, 0.0], [0.0, 8.0, 0.0]);
                if other_shapes {
                    case.block([0.25; 3], [0.0, 1.5, 0.25], [X, Y, Z]);
                }
                let steps = steps(&case, 2.0);
                let state = case.run(steps);
                // Without a joint: VEL and RST fall 8 dt² at a time and slip while they do.
                let bound = if law.starts_with("VEL") || law.starts_with("RST") { 1e-3 } else { 1e-9 };
                equal(state.x(ball).x, 8.0, 8.0 * bound);
                equal(state.v(ball).x, 4.0, 4.0 * bound);
                equal(state.x(ball).y, 0.0, 1e-12);
            }
        }
    }
}

/// A course of bricks, driven or lying on a floor, which they do not sink into.
#[test]
fn a_cube_slides_over_bricks() {
    for (law, parameters) in LAWS {
        for (narrow, driven, preset) in [
            (NarrowPhase::Fast, true, None),
            (NarrowPhase::Accurate, true, None),
            (NarrowPhase::Fast, false, None),
            (NarrowPhase::Accurate, false, None),
            (NarrowPhase::Fast, false, Some(Accuracy::Draft)),
            (NarrowPhase::Accurate, false, Some(Accuracy::Standard)),
        ] {
            println!("{law} {narrow:?} {driven} {preset:?}");
            let mut case = scene(law, parameters, narrow, 1e-3);
            case.options.accuracy = preset;
            case.plate([8.0, 8.0, 0.5], [0.0, 0.0, -1.5], [X, Y, Z]);
            let cube = case.block([0.25; 3], [0.0, 0.1, 0.25], [X, Y, Z]);
            case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
            let bricks: Vec<usize> = (0..10)
                .map(|k| case.block([0.35, 1.0, 0.5], [-0.9 + 0.7 * f64::from(k), 0.0, -0.5], [X, Y, Z]))
                .collect();
            if driven {
                bricks.iter().for_each(|&brick| case.drive(brick, [0.0; 6].map(Evolution::constant)));
            }
            let state = case.run(1600);
            has_slid(&state, cube, 1e-3);
            bricks.iter().for_each(|&brick| equal(state.x(brick).z, -0.5, 1e-5));
        }
    }
}

/// A prism of the trapezium with these x below and above, as a piece of a body.
fn piece(below: [f64; 2], above: [f64; 2], half: [f64; 2]) -> Contactor {
    let vertices = (0..8usize)
        .map(|k| {
            let x = if k >> 2 & 1 == 1 { above } else { below }[k & 1];
            [x, if k >> 1 & 1 == 1 { half[0] } else { -half[0] }, if k >> 2 & 1 == 1 { half[1] } else { -half[1] }]
        })
        .collect();
    let shape = ShapeRecord::Polyhedron { vertices, triangles: BOX.to_vec() };
    Contactor { colour: "GRAIN".into(), shape, local_frame: None }
}

/// A floor of convex pieces of one body, with upright and slanted joints.
#[test]
fn a_cube_slides_over_pieces_of_one_body() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            for slant in [-0.3, 0.0, 0.3] {
                println!("{law} {narrow:?} {slant}");
                let mut case = scene(law, parameters, narrow, 1e-3);
                let cube = case.block([0.25; 3], [0.0, 0.1, 0.25], [X, Y, Z]);
                case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
                let floor = case.block([4.0, 2.0, 0.5], [2.0, 0.0, -0.5], [X, Y, Z]);
                case.drive(floor, [0.0; 6].map(Evolution::constant));
                let half = [2.0, 0.5];
                case.bodies[floor].contactors = vec![
                    piece([-4.0, -1.0 - slant], [-4.0, -1.0 + slant], half),
                    piece([-1.0 - slant, 1.5], [-1.0 + slant, 1.5], half),
                    piece([1.5, 4.0], [1.5, 4.0], half),
                ];
                has_slid(&case.run(1600), cube, 1e-3);
            }
        }
    }
}

/// A plank of pieces slides over two narrow plates: the joints are those of the moving body.
#[test]
fn a_plank_of_pieces_slides_over_rails() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            println!("{law} {narrow:?}");
            let mut case = scene(law, parameters, narrow, 1e-3);
            for x in [-1.25, 1.5] {
                case.plate([0.0625, 1.0, 0.5], [x, 0.0, -0.5], [X, Y, Z]);
            }
            let plank = case.block([4.0, 0.25, 0.25], [0.0, 0.0, 0.25], [X, Y, Z]);
            case.launch(plank, [3.0, 0.0, 0.0], [0.0; 3]);
            let ends = |k: usize| [-4.0 + 0.5 * k as f64, -3.5 + 0.5 * k as f64];
            case.bodies[plank].contactors = (0..16).map(|k| piece(ends(k), ends(k), [0.25; 2])).collect();
            let state = case.run(900);
            // 9/(2·0.5·8) m to a thousandth; VEL and RST fall for a step at a time.
            near(state.x(plank), [1.125, 0.0, 0.25], 1.125e-3);
            assert!(state.v(plank).norm() < 1e-3 && state.w(plank).norm() < 1e-2);
        }
    }
}

/// Along a wall of plates, on their faces and on their rims.
#[test]
fn a_cube_slides_along_walls_of_plates() {
    for narrow in NARROW {
        for axes in [[X, Y, Z], [Z, X, Y]] {
            let mut case = scene("IQS_CLB", &[0.5], narrow, 1e-3);
            case.gravity = [0.0, -8.0, 0.0];
            for k in 0..5 {
                let along = |axis: [f64; 3]| if axis == X { 2.0 } else { 0.75 };
                let x = [0.0, -0.75, -1.0 + 1.5 * f64::from(k)];
                case.plate(axes.map(along), x, axes);
            }
            let cube = case.block([0.25; 3], [0.1, 0.25, 0.0], [X, Y, Z]);
            case.launch(cube, [0.0, 0.0, 6.0], [0.0; 3]);
            near(case.run(1600).x(cube), [0.1, 0.25, 4.5], 4.5e-3);
        }
    }
}

/// At lengths of a thousandth and a thousand times, and the times that belong to them.
#[test]
fn joints_are_the_same_at_every_scale() {
    for scale in [1.0f64 / 1024.0, 1024.0] {
        for narrow in NARROW {
            let time = scale.sqrt();
            let mut case = scene("IQS_CLB", &[0.5], narrow, 1e-3 * time);
            for x in [0.0, 4.0] {
                case.plate([2.0 * scale, 2.0 * scale, 0.5 * scale], [x * scale, 0.0, -0.5 * scale], [X, Y, Z]);
            }
            let cube = case.block([0.25 * scale; 3], [0.0, 0.1 * scale, 0.25 * scale], [X, Y, Z]);
            case.launch(cube, [6.0 * scale / time, 0.0, 0.0], [0.0; 3]);
            let state = case.run(1600);
            near(state.x(cube) / scale, [4.5, 0.1, 0.25], 4.5e-3);
        }
    }
}

/// A step of a ten-thousandth of the size is one: it stops a cube's front, and takes from a ball of radius R at the height s
/// the share 5 s/7R of its speed in the blow, and as much again and more as it is lifted and comes down.
#[test]
fn a_small_step_is_a_step() {
    let raised = 5e-5;
    let laws: [(&str, &[f64]); 5] = [
        ("IQS_CLB", &[0.0]),
        ("GAP_SGR_CLB", &[0.0]),
        ("VEL_SGR_CLB", &[0.0]),
        ("RST_CLB", &[0.0, 0.0, 0.0]),
        ("IQS_MOHR_DS_CLB", &[0.0, 0.0, 0.0, 0.0]),
    ];
    for (law, parameters) in laws {
        for narrow in NARROW {
            println!("{law} {narrow:?}");
            let mut case = scene(law, parameters, narrow, 1e-3);
            case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
            case.plate([2.0, 2.0, 0.5], [4.0, 0.0, -0.5 + raised], [X, Y, Z]);
            let cube = case.block([0.25; 3], [1.0, 0.1, 0.25], [X, Y, Z]);
            case.launch(cube, [1.0, 0.0, 0.0], [0.0; 3]);
            // 1 m/s over 0.75 m without friction: the front is at the step after 0.75 s. The cube then turns about its lower
            // edge: (a/2) v = (2/3) a² ω, which leaves 3/8 m/s.
            let state = case.run(740);
            equal(state.x(cube).x, 1.74, 1e-6);
            let state = case.run(760);
            assert!(state.v(cube).x < 0.7 && state.w(cube).y > 0.1, "{} {}", state.v(cube), state.w(cube));
        }
    }
    let mut case = scene("IQS_CLB", &[0.5], NarrowPhase::Fast, 1e-3);
    case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
    case.plate([2.0, 2.0, 0.5], [4.0, 0.0, -0.5 + raised], [X, Y, Z]);
    let ball = case.sphere(0.5, [0.0, 0.0, 0.5]);
    case.launch(ball, [4.0, 0.0, 0.0], [0.0, 8.0, 0.0]);
    let state = case.run(700);
    let lost = (4.0 - state.v(ball).x) / 4.0;
    let blow = 5.0 / 7.0 * raised / 0.5;
    assert!(lost > blow && lost < 4.0 * blow, "{lost:.2e} {blow:.2e}");
    equal(state.x(ball).z, 0.5 + raised, 1e-7);
}

/// A wall on the floor, on its plate or next to it, stops a cube that is pushed into the corner, and carries its push.
#[test]
fn a_corner_of_floor_and_wall_holds() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            for bottom in [0.0, -0.5] {
                println!("{law} {narrow:?} {bottom}");
                let mut case = scene(law, parameters, narrow, 1e-3);
                case.gravity = [8.0, 0.0, -8.0];
                case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
                let wall = case.plate([0.5, 2.0, 1.0], [2.5, 0.0, 1.0 + bottom], [X, Y, Z]);
                let cube = case.block([0.25; 3], [1.75, 0.1, 0.25], [X, Y, Z]);
                let state = case.run(1000);
                // VEL and RST fall for a step at a time.
                near(state.x(cube), [1.75, 0.1, 0.25], 4e-5);
                assert!(state.v(cube).norm() < 1e-2 && state.w(cube).norm() < 1e-2);
                if law == "IQS_CLB" {
                    // With what friction of floor and wall can take off or add: m g (1 - μ)/(1 + μ²) to m g (1 + μ)/(1 - μ²).
                    let push = state.mass(cube) * 8.0;
                    let normals = &state.contacts;
                    let of_wall =
                        (0..normals.contact_body.len()).filter(|&k| normals.contact_body[k][1] == wall as u32);
                    let force: f64 = of_wall.map(|k| normals.contact_force[k][0]).sum();
                    assert!(force > 0.4 * push * 0.99 && force < 2.0 * push, "{force} {push}");
                }
            }
        }
    }
}

/// A ball at 1 m/s falls into a gap that it spans, and rests on both edges at its depth.
#[test]
fn a_gap_is_a_gap() {
    let mut case = scene("IQS_CLB", &[0.5], NarrowPhase::Fast, 1e-3);
    case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
    case.plate([2.0, 2.0, 0.5], [4.6, 0.0, -0.5], [X, Y, Z]);
    let ball = case.sphere(0.5, [1.0, 0.0, 0.5]);
    case.launch(ball, [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
    // 3-4-5.
    near(case.run(4000).x(ball), [2.3, 0.0, 0.4], 1e-3);
}

/// A floor of plates that comes again with a period: joints inside of it and at its boundary, which the cube crosses.
fn periodic(narrow: NarrowPhase, other_shapes: bool) -> (Case, usize) {
    let mut case = scene("IQS_CLB", &[0.5], narrow, 1e-3);
    (case.options.xperiode, case.options.yperiode) = (Some(2.5), Some(4.0));
    for x in [0.625, 1.875] {
        case.plate([0.625, 2.0, 0.5], [x, 2.0, -0.5], [X, Y, Z]);
    }
    let body = match other_shapes {
        true => case.block([0.25; 3], [0.3, 2.1, 0.25], [X, Y, Z]),
        false => case.sphere(0.25, [0.3, 2.1, 0.25]),
    };
    (case, body)
}

/// Over the boundary of a period nothing is stopped.
#[test]
fn what_slides_and_rolls_crosses_a_period() {
    for narrow in NARROW {
        let (mut case, cube) = periodic(narrow, true);
        case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
        let state = case.run(1600);
        // 4.8 less a period or two.
        equal((state.x(cube).x - 4.8).rem_euclid(2.5), 0.0, 1e-9 + 4.5e-3);
        near([0.0, state.x(cube).y, state.x(cube).z], [0.0, 2.1, 0.25], 2e-3);
    }
    let (mut case, ball) = periodic(NarrowPhase::Fast, false);
    case.launch(ball, [4.0, 0.0, 0.0], [0.0, 16.0, 0.0]);
    equal(case.run(1000).v(ball).x, 4.0, 1e-8);
}

/// Bricks on a floor that a cube slides over: the same bytes with two threads, and after a pause.
#[test]
fn joints_are_the_same_with_threads_and_after_a_pause() {
    let course = || {
        let mut case = scene("RST_CLB", &[0.5, 0.0, 0.5], NarrowPhase::Fast, 1e-3);
        case.plate([8.0, 8.0, 0.5], [0.0, 0.0, -1.5], [X, Y, Z]);
        let cube = case.block([0.25; 3], [0.0, 0.1, 0.25], [X, Y, Z]);
        case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
        for (candidate, antagonist) in [("CYLND", "PLANx"), ("CAPSx", "POLYR"), ("CAPSx", "PLANx")] {
            case.law_between(candidate, antagonist, "RST_CLB", &[0.5, 0.0, 0.5]);
        }
        let disc = capsules::cylinder(&mut case, 0.05, 0.2, [0.0, 0.7, 0.05], UPRIGHT);
        let capsule = capsules::capsule(&mut case, 0.2, 0.1, [0.0, -0.6, 0.1], ALONG_X);
        [disc, capsule].into_iter().for_each(|body| case.launch(body, [6.0, 0.0, 0.0], [0.0; 3]));
        for k in 0..10 {
            case.block([0.35, 1.0, 0.5], [-0.9 + 0.7 * f64::from(k), 0.0, -0.5], [X, Y, Z]);
        }
        (case.options.steps, case.options.output_every) = (Some(400), 100);
        case
    };
    let one = files(&course(), &[&["--threads", "1"]]);
    same(&one, &files(&course(), &[&["--threads", "2"]]));
    same(&one, &files(&course(), &[&["--steps", "200"], &["--resume"]]));
}

/// A body that slides into a wall stops at it under every law, without an overlap as large as its displacement in a step.
#[test]
fn a_wall_stops_what_slides_at_it() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            println!("{law} {narrow:?}");
            let mut case = scene(law, parameters, narrow, 1e-3);
            case.plate([2.0, 2.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
            case.plate([0.5, 2.0, 1.0], [2.5, 0.0, 1.0], [X, Y, Z]);
            let cube = case.block([0.25; 3], [0.0037, 0.1, 0.25], [X, Y, Z]);
            case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
            let states = case.states(400, 1);
            let furthest = states.iter().map(|state| state.x(cube).x).fold(f64::NEG_INFINITY, f64::max);
            // 6 m/s are 6 mm a step, which a pair thrown back before it touches may leave.
            assert!(furthest < 1.75 + 1e-5 && furthest > 1.75 - 6e-3, "{furthest}");
        }
    }
}

/// The flat top of a pillar between two plates.
#[test]
fn a_cube_slides_over_the_flush_end_of_a_cylinder() {
    for (law, parameters) in LAWS {
        for narrow in NARROW {
            for dt in [1e-2, 1e-3] {
                println!("{law} {narrow:?} {dt}");
                let mut case = scene(law, parameters, narrow, dt);
                case.plate([2.0, 5.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
                case.plate([3.0, 5.0, 0.5], [6.0, 0.0, -0.5], [X, Y, Z]);
                let pillar = case.plate([1.0; 3], [2.5, 0.0, -1.0], [X, Y, Z]);
                let shape = ShapeRecord::Cylinder { half_height: 1.0, radius: 1.0, hollow: false };
                case.bodies[pillar].contactors[0].shape = shape;
                let (sin, cos) = 0.1f64.sin_cos();
                let cube = case.block([0.25; 3], [0.0, 0.1, 0.25], [[cos, sin, 0.0], [-sin, cos, 0.0], Z]);
                case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
                let steps = steps(&case, 1.6);
                let state = case.run(steps);
                equal(state.x(cube).x, 4.5, 4.5e-3);
                equal(state.x(cube).z, 0.25, 1e-5 + 40.0 * dt * dt);
                assert!(state.v(cube).norm() < 1e-3 && state.w(cube).norm() < 1e-2);
            }
        }
    }
}

/// Pillars smaller than the cube, side by side: between their round tops the cube is carried by what is flush.
#[test]
fn a_cube_slides_over_the_flush_ends_of_many_cylinders() {
    const RADIUS: f64 = 0.125;
    for (law, parameters) in LAWS {
        for spacing in [2.0 * RADIUS, 1.5 * RADIUS] {
            let mut case = scene(law, parameters, NARROW[0], 1e-3);
            for i in 0..(6.0 / spacing) as i32 {
                for j in -2..=2 {
                    let x = [f64::from(i) * spacing - 0.5, f64::from(j) * spacing, -0.5];
                    let pillar = case.plate([RADIUS; 3], x, [X, Y, Z]);
                    let shape = ShapeRecord::Cylinder { half_height: 0.5, radius: RADIUS, hollow: false };
                    case.bodies[pillar].contactors[0].shape = shape;
                }
            }
            let cube = case.block([0.25; 3], [0.0, 0.02, 0.25], [X, Y, Z]);
            case.launch(cube, [6.0, 0.0, 0.0], [0.0; 3]);
            let steps = steps(&case, 1.6);
            let state = case.run(steps);
            equal(state.x(cube).x, 4.5, 4.5e-3);
            assert!((state.x(cube).z - 0.25).abs() < 1e-4 && state.w(cube).norm() < 1e-2, "{law} {spacing}");
        }
    }
}

/// Cylinders and capsules at x = -0.45, side by side along y, that slide along x at 1.5 m/s: the heights of their centres,
/// and their numbers.
fn launch_round_bodies(case: &mut Case) -> Vec<(f64, usize)> {
    let cylinder = |half_height: f64, radius: f64| ShapeRecord::Cylinder { half_height, radius, hollow: false };
    let capsule = ShapeRecord::Capsule { half_length: 0.3, radius: 0.1 };
    let (sin, cos) = 0.7f64.sin_cos();
    let shapes = [
        (cylinder(0.2, 0.2), 0.2, UPRIGHT),
        (cylinder(0.05, 0.3), 0.05, UPRIGHT),
        (cylinder(0.2, 0.2), 0.2, [[cos, sin, 0.0], [-sin, cos, 0.0], Z]),
        (cylinder(0.2, 0.2), 0.2, ALONG_X),
        (cylinder(0.2, 0.2), 0.2, ALONG_Y),
        (capsule.clone(), 0.1, ALONG_X),
        (capsule, 0.1, ALONG_Y),
    ];
    let launched = shapes.into_iter().enumerate().map(|(k, (shape, height, axes))| {
        let body = capsules::body(case, shape, [-0.45, 0.9 * (k as f64 - 3.0), height], axes);
        case.launch(body, [1.5, 0.0, 0.0], [0.0; 3]);
        (height, body)
    });
    launched.collect()
}

/// A frictionless scene, as accurate as runs are by default.
fn frictionless() -> Case {
    let mut case = capsules::scene(0.0);
    case.options.dt = 1e-3;
    (case.options.tol, case.options.max_sweeps) = (None, None);
    case
}

/// After 0.6 s at 1.5 m/s from x = -0.45, on a plane.
#[track_caller]
fn has_passed(state: &Snapshot, body: usize, height: f64) {
    // 2e-5 of the speed; a joint that acts takes 1e-4 of it from a lying capsule, 0.6 from a cylinder.
    near(state.v(body), [1.5, 0.0, 0.0], 3e-5);
    equal(state.x(body).x, 0.45, 2e-5);
    equal(state.x(body).z, height, 1e-5);
    // A wobble of 1e-4 of the radius per second.
    assert!(state.w(body).norm() < 1e-4, "{}", state.w(body));
}

/// Over the joint of two plates or driven bricks, standing or lying.
#[test]
fn cylinders_and_capsules_slide_over_joints() {
    for bricks in [false, true] {
        let mut case = frictionless();
        let bodies = launch_round_bodies(&mut case);
        for x in [-1.0, 1.0] {
            if bricks {
                let brick = case.block([1.0, 4.0, 0.5], [x, 0.0, -0.5], [X, Y, Z]);
                case.drive(brick, [0.0; 6].map(Evolution::constant));
            } else {
                case.plate([1.0, 4.0, 0.5], [x, 0.0, -0.5], [X, Y, Z]);
            }
        }
        let state = case.run(600);
        for (height, body) in bodies {
            println!("{body} bricks: {bricks}");
            has_passed(&state, body, height);
        }
    }
}

/// Over the flush end of a pillar that reaches through the gap between two plates.
#[test]
fn cylinders_and_capsules_slide_over_the_end_of_a_cylinder() {
    for k in [1, 3, 5] {
        let mut case = frictionless();
        let (height, body) = launch_round_bodies(&mut case)[k];
        for other in (0..7).filter(|other| *other != body) {
            case.launch(other, [-1.5, 0.0, 0.0], [0.0; 3]);
        }
        let y = 0.9 * (k as f64 - 3.0) + 0.05;
        let pillar = capsules::cylinder(&mut case, 0.5, 0.5, [0.0, y, -0.5], UPRIGHT);
        case.drive(pillar, [0.0; 6].map(Evolution::constant));
        for x in [-2.25, 1.25] {
            case.plate([if x < 0.0 { 2.0 } else { 1.0 }, 4.0, 0.5], [x, 0.0, -0.5], [X, Y, Z]);
        }
        has_passed(&case.run(600), body, height);
    }
}

/// A step of 5e-5 m stops the front of a standing cylinder of radius and half height R: it turns about its foot with
/// ω = m v R / I, I = m (7/12 R² + 2 R²), which leaves 12/31 of the speed.
#[test]
fn a_small_step_stops_a_cylinder() {
    let mut case = frictionless();
    case.plate([1.0, 2.0, 0.5], [-1.0, 0.0, -0.5], [X, Y, Z]);
    case.plate([1.0, 2.0, 0.5], [1.0, 0.0, -0.5 + 5e-5], [X, Y, Z]);
    let cylinder = capsules::cylinder(&mut case, 0.2, 0.2, [-0.35, 0.05, 0.2], UPRIGHT);
    case.launch(cylinder, [1.5, 0.0, 0.0], [0.0; 3]);
    equal(case.run(98).v(cylinder).x, 1.5, 1e-6);
    let state = case.run(105);
    // Its weight takes 8 m/s² · 5 ms at most.
    equal(state.v(cylinder).x, 1.5 * 12.0 / 31.0, 0.05);
    assert!(state.w(cylinder).y > 1.0, "{}", state.w(cylinder));
}
