//! Solid cylinders and capsules on triangulated walls.

use std::f64::consts::PI;

use cd_formats::bodies::ShapeRecord;
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;
use nalgebra::Rotation3;

use crate::capsules::{ALONG_X, ALONG_Y, UPRIGHT, body, capsule, cylinder};
use crate::case::{AXES, Case, Figures, Vec3, equal, load_count, near, shaken_lattice, shaking_velocity, uniform};
use crate::mesh_polyhedra::{force_of, make_two_sided, random_plane};
use crate::meshes::{Triangles, terrain, turned_axes};
use crate::same_bits::{files, same};

const STEP: f64 = 1.0 / 128.0;
const G: f64 = 8.0;

/// Scene in 8 m/s² with one law of cylinders and capsules with surfaces and plates.
fn scene(kind: &str, parameters: &[f64]) -> Case {
    let mut case = Case::new();
    for antagonist in ["PLANx", "MESHx"] {
        for candidate in ["CAPSx", "CYLND"] {
            case.law_between(candidate, antagonist, kind, parameters);
        }
    }
    case.gravity = [0.0, 0.0, -G];
    case.options.dt = STEP;
    case
}

/// A wall whose upper face is in the plane across the third axis: a plate, or random triangles that push from one side or both.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Floor {
    Plate,
    OneSided,
    TwoSided,
}

fn add_floor(case: &mut Case, floor: Floor, axes: [[f64; 3]; 3]) -> usize {
    if floor == Floor::Plate {
        return case.plate([6.0, 6.0, 0.5], (Vec3::from(axes[2]) * -0.5).into(), axes);
    }
    let triangles = random_plane(32, 0.375);
    let wall = case.mesh(&triangles.0, &triangles.1, [0.0; 3], axes);
    if floor == Floor::TwoSided {
        make_two_sided(case, wall, &triangles);
    }
    wall
}

/// Body that moves on a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rider {
    RollingCapsule,
    RollingCylinder,
    StandingCylinder,
    /// Upright.
    StandingCapsule,
}

/// A rider that slides, rolls and spins on a wall, turned about the third axis against the edges of the wall.
fn rider_on_wall(
    rider: Rider,
    floor: Floor,
    law: (&str, &[f64]),
    axes: [[f64; 3]; 3],
    drive: &[(usize, Evolution)],
) -> Case {
    let mut case = scene(law.0, law.1);
    let [x, y, z] = axes.map(Vec3::from);
    let turn = Rotation3::from_scaled_axis(z * 0.3);
    let own = [x, y, z].map(|axis| turn * axis);
    let lying = [own[2], own[0], own[1]].map(Vec3::into);
    let upright = own.map(Vec3::into);
    let at = |height: f64| (z * height).into();
    let rider = match rider {
        Rider::RollingCapsule => capsule(&mut case, 0.5, 0.25, at(0.25), lying),
        Rider::RollingCylinder => cylinder(&mut case, 0.5, 0.25, at(0.25), lying),
        Rider::StandingCylinder => cylinder(&mut case, 0.125, 0.5, at(0.125), upright),
        Rider::StandingCapsule => capsule(&mut case, 0.125, 0.25, at(0.375), upright),
    };
    case.launch(rider, (x * 2.25 + y * 0.75).into(), (z * 0.5).into());
    let wall = add_floor(&mut case, floor, axes);
    let mut motion = [0.0; 6].map(Evolution::constant);
    drive.iter().for_each(|(component, evolution)| motion[*component] = evolution.clone());
    case.drive(wall, motion);
    case
}

/// Rolls, slides and spins as on a plate, across the edges of many triangles.
#[test]
fn round_bodies_ride_on_triangles_as_on_a_plate() {
    let level = turned_axes(0.0, 0.0);
    let slope = turned_axes(0.25, 0.125);
    let friction = ("IQS_CLB", &[0.3][..]);
    for rider in [Rider::RollingCapsule, Rider::RollingCylinder, Rider::StandingCylinder, Rider::StandingCapsule] {
        let cases = [
            (friction, level, vec![]),
            (("IQS_WET_DS_CLB", &[0.05, 0.0, 0.01, 0.3, 0.3][..]), slope, vec![]),
            (friction, level, vec![(2, shaking_velocity(0.25)), (0, shaking_velocity(0.5))]),
        ];
        for (law, axes, drive) in cases {
            let run = |floor: Floor| rider_on_wall(rider, floor, law, axes, &drive).run(24);
            let plate = run(Floor::Plate);
            // Away from the start, and not beyond the edge of the plate.
            assert!(plate.x(0).norm() > 0.375 && plate.x(0).norm() < 5.0, "{rider:?}: {}", plate.x(0));
            let two_sided = drive.is_empty().then(|| run(Floor::TwoSided));
            for mesh in [run(Floor::OneSided)].into_iter().chain(two_sided) {
                assert_eq!(mesh.contacts.contact_body.len(), plate.contacts.contact_body.len(), "{rider:?}");
                // Tolerance: solutions to 1e-12 of 24 steps, of which each starts from rounded positions.
                let difference = |of: fn(&Snapshot, usize) -> Vec3| (of(&mesh, 0) - of(&plate, 0)).norm();
                let found = [difference(Snapshot::x), difference(Snapshot::v), difference(Snapshot::w)];
                assert!(found.iter().all(|difference| *difference <= 1e-8), "{rider:?} {law:?} {drive:?}: {found:?}");
            }
        }
    }
}

/// Rolls down with a = g_x/(1 + I/m r²), and loses no speed at the edges between triangles.
#[test]
fn round_bodies_roll_down_a_slope_of_triangles() {
    // Capsule of h = r: I/m r² = (barrel/2 + 2/5 ball)/(barrel + ball) with the volumes 2 π r³ and 4/3 π r³.
    for (is_capsule, inertia_ratio) in [(true, (1.0 + 8.0 / 15.0) / (2.0 + 4.0 / 3.0)), (false, 0.5)] {
        let mut case = scene("IQS_CLB", &[0.5]);
        case.gravity = [3.0, 0.0, -G];
        add_floor(&mut case, Floor::OneSided, AXES);
        let add_roller = if is_capsule { capsule } else { cylinder };
        let roller = add_roller(&mut case, 0.5, 0.5, [-4.0, 0.25, 0.5], ALONG_Y);
        let end = case.run(256);
        let t = 256.0 * STEP;
        let a = 3.0 / (1.0 + inertia_ratio);
        // Tolerance: the sum of 256 solutions with a residual of 1e-12, and of rounded axes.
        near(end.v(roller), [a * t, 0.0, 0.0], 1e-8);
        near(end.w(roller), [0.0, a * t / 0.5, 0.0], 1e-8);
        near(end.x(roller), [-4.0 + 0.5 * a * t * t, 0.25, 0.5], 1e-8);
        // It lies on the ends of a line, with half of its weight on each.
        assert_eq!(end.contacts.contact_force.len(), 2);
        end.contacts.contact_force.iter().for_each(|force| equal(force[0] / (end.mass(roller) * G), 0.5, 1e-8));
    }
}

/// Weights and gaps of bodies at rest on random triangles: two points of a line, four of a rim, one of a cap.
#[test]
fn round_bodies_rest_on_random_triangles() {
    type Add = fn(&mut Case) -> usize;
    let bodies: [(Add, usize); 4] = [
        (|case| capsule(case, 0.5, 0.25, [0.1, 0.2, 0.25], ALONG_X), 2),
        (|case| cylinder(case, 0.5, 0.25, [0.1, 0.2, 0.25], ALONG_X), 2),
        (|case| cylinder(case, 0.5, 0.75, [0.1, 0.2, 0.5], UPRIGHT), 4),
        (|case| capsule(case, 0.5, 0.25, [0.1, 0.2, 0.75], UPRIGHT), 1),
    ];
    for (add_body, count) in bodies {
        for floor in [Floor::OneSided, Floor::TwoSided] {
            let mut case = scene("IQS_CLB", &[0.5]);
            let rider = add_body(&mut case);
            add_floor(&mut case, floor, AXES);
            let start = case.bodies[rider].position;
            let state = case.run(32);
            near(state.x(rider), start, 1e-11);
            let weight = G * state.mass(rider);
            near(force_of(&state, |_| true), [0.0, 0.0, weight], 1e-9 * weight);
            assert_eq!(state.contacts.contact_gap.len(), count);
            // Tolerance: gaps of a body whose position has 14 digits.
            state.contacts.contact_gap.iter().for_each(|gap| equal(*gap, 0.0, 1e-11));
            if count == 4 {
                equal(state.shapes.unwrap().contacts.contact_area.iter().sum(), PI * 0.5625, 1e-12);
            }
        }
    }
}

/// Two sides that rise by 3/4 on both sides of the y axis; falls of a ridge for a negative `slope`.
fn folded(slope: f64, half_length: f64) -> Triangles {
    let vertices = [-2.0, 0.0, 2.0].map(|x: f64| [-half_length, half_length].map(|y| [x, y, slope * x.abs()])).concat();
    (vertices, vec![[0, 2, 1], [2, 3, 1], [2, 4, 3], [4, 5, 3]])
}

/// Without friction each side of a groove carries half of the weight along z, on two points.
#[test]
fn a_groove_carries_round_bodies_on_both_sides() {
    for add_body in [capsule, cylinder] {
        let mut case = scene("IQS_CLB", &[0.0]);
        // 3-4-5: the sides are 0.8 of the height away.
        let rider = add_body(&mut case, 1.0, 0.5, [0.0, 0.25, 0.625], ALONG_Y);
        let (vertices, triangles) = folded(0.75, 2.0);
        case.mesh(&vertices, &triangles, [0.0; 3], AXES);
        let state = case.run(32);
        near(state.v(rider), [0.0; 3], 1e-9);
        assert_eq!(state.contacts.contact_gap.len(), 4);
        let half_weight = 0.5 * G * state.mass(rider);
        for side in [-1.0, 1.0] {
            // Tolerance: files with 8 digits of the axes.
            let force = force_of(&state, |n| n.x * side > 0.0);
            near(force, [0.75 * half_weight * side, 0.0, half_weight], 1e-6 * half_weight);
        }
    }
}

/// A body along a ridge has two points on it, also where the ridge is shorter; across a ridge, and over a tip, one.
#[test]
fn ridges_and_tips_carry_round_bodies() {
    let ridge = folded(-0.75, 2.0);
    let short = folded(-0.75, 0.5);
    let tip = vec![[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [-0.5, 0.75, -1.0], [-0.5, -0.75, -1.0]];
    let tip = (tip, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1]]);
    let cases =
        [(&ridge, ALONG_Y, 2, 1.0), (&short, ALONG_Y, 2, 0.5), (&ridge, ALONG_X, 1, 0.0), (&tip, ALONG_Y, 1, 0.0)];
    for ((vertices, triangles), axes, count, reach) in cases {
        for add_body in [capsule, cylinder] {
            let mut case = scene("IQS_CLB", &[0.5]);
            let rider = add_body(&mut case, 1.0, 0.25, [0.0, 0.0, 0.25], axes);
            case.mesh(vertices, triangles, [0.0; 3], AXES);
            let state = case.run(16);
            assert_eq!(state.contacts.contact_gap.len(), count, "{axes:?} {reach}: {:?}", state.contacts.contact_point);
            let weight = G * state.mass(rider);
            near(force_of(&state, |n| n.z > 1.0 - 1e-12), [0.0, 0.0, weight], 1e-9 * weight);
            near(state.x(rider), [0.0, 0.0, 0.25], 1e-11);
            state.contacts.contact_point.iter().for_each(|point| equal(point[1].abs(), reach, 1e-9));
        }
    }
}

/// A capsule that slides off an edge without friction keeps its speed up to the edge, and then its distance from it until it
/// leaves at cos θ = (2 + v²/g r)/3 from the vertical, with v² = v₀² + 2 g r (1 - cos θ).
#[test]
fn a_capsule_slides_over_an_outer_edge() {
    let mut case = scene("IQS_CLB", &[0.0]);
    // A table that ends at x = 0, in squares of 0.25 m.
    let (mut vertices, triangles) = terrain(16, 0.25, || 0.0);
    vertices.iter_mut().for_each(|vertex| vertex[0] -= 2.0);
    let slider = capsule(&mut case, 0.5, 0.25, [-0.0625, 0.0, 0.25], ALONG_Y);
    case.launch(slider, [0.5, 0.0, 0.0], [0.0; 3]);
    case.mesh(&vertices, &triangles, [0.0; 3], AXES);
    case.options.dt = 1.0 / 512.0;
    let mut farthest = 0.0f64;
    for state in case.states(200, 4) {
        let x = state.x(slider);
        if x.x < -0.01 {
            equal(state.v(slider).x, 0.5, 1e-9);
            equal(x.z, 0.25, 1e-9);
        } else if x.x > 0.01 && state.contacts.contact_force.iter().any(|force| force[0] > 0.0) {
            // Tolerance: a few per cent of the displacement of 2 mm in a step of the circle.
            equal((x.x * x.x + x.z * x.z).sqrt(), 0.25, 1e-4);
            equal(state.v(slider).norm_squared(), 0.25 + 2.0 * G * (0.25 - x.z), 2e-2);
            farthest = farthest.max(x.x / 0.25);
        }
    }
    let cosine: f64 = (2.0 + 0.25 / (G * 0.25)) / 3.0;
    equal(farthest, (1.0 - cosine * cosine).sqrt(), 0.05);
}

/// A capsule whose segment has passed a surface by less than the radius is pushed to the front of one side, and to the side
/// of its centre by two.
#[test]
fn a_capsule_behind_a_surface_is_pushed_back() {
    for axes in [UPRIGHT, ALONG_X, turned_axes(0.25, 0.125)] {
        for (floor, normal) in [(Floor::OneSided, 1.0), (Floor::TwoSided, -1.0)] {
            let mut case = scene("IQS_CLB", &[0.3]);
            case.gravity = [0.0; 3];
            let depth = 0.125 + 0.25 * axes[2][2].abs();
            capsule(&mut case, 0.25, 0.25, [0.1, 0.2, -depth], axes);
            add_floor(&mut case, floor, AXES);
            let state = case.run(1);
            let lowest = state.contacts.contact_gap.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(state.contacts.contact_frame.iter().all(|frame| (frame[0][2] - normal).abs() < 1e-12), "{axes:?}");
            let reach = 0.25 * axes[2][2].abs();
            // The farthest point of the segment behind the front, or the nearest behind the back, and the radius.
            let expected = if normal > 0.0 { -depth - reach - 0.25 } else { depth - reach - 0.25 };
            equal(lowest, expected, 1e-11);
        }
    }
}

/// Fast bodies stop at a thin surface of small triangles as at a plate.
#[test]
fn fast_round_bodies_do_not_pass_a_surface() {
    for (add_body, axes, height) in [
        (capsule as fn(&mut Case, f64, f64, [f64; 3], [[f64; 3]; 3]) -> usize, ALONG_X, 0.25),
        (cylinder, ALONG_X, 0.25),
        (cylinder, UPRIGHT, 0.5),
    ] {
        for travel in [0.3, 100.0] {
            for floor in [Floor::OneSided, Floor::TwoSided] {
                let mut case = scene("IQS_CLB", &[0.3]);
                let rider = add_body(&mut case, 0.5, 0.25, [0.1, 0.2, height + 2.2 * travel], axes);
                case.launch(rider, [0.0, 0.0, -travel / STEP], [0.0; 3]);
                add_floor(&mut case, floor, AXES);
                let state = case.run(8);
                let lowest = state.x(rider).z;
                assert!(lowest > height - 1e-3 && state.v(rider).z.abs() < 1.0, "{travel} {floor:?}: {lowest}");
            }
        }
    }
}

/// Cylinders and capsules, of which some make bodies of two, that fall on terrain which shakes.
fn rods_on_terrain() -> Case {
    let mut case = scene("IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]);
    for (one, other) in [("CAPSx", "CAPSx"), ("CAPSx", "CYLND"), ("CYLND", "CYLND")] {
        case.law_between(one, other, "IQS_CLB", &[0.4]);
    }
    case.gravity = [0.1, 0.0, -4.0];
    for (k, (radius, [x, y, z])) in (0..).zip(shaken_lattice(3, 5)) {
        let (position, axes) = ([x, y, z + 2.75], turned_axes(0.4 * f64::from(k), 0.7 * f64::from(k)));
        if k % 2 == 0 {
            capsule(&mut case, 0.6 * radius, 0.4 * radius, position, axes);
        } else {
            cylinder(&mut case, [0.8, 0.2][k as usize / 2 % 2] * radius, 0.55 * radius, position, axes);
        }
    }
    let mut random = uniform(3);
    let (vertices, triangles) = terrain(16, 0.5, || 0.5 * random());
    let wall = case.mesh(&vertices, &triangles, [0.0; 3], AXES);
    let shaking =
        Evolution::Harmonic { constant: 0.0, amplitude: 0.5, omega: 9.0, phase: 0.0, ramp_start: 0.1, ramp_rate: 2.0 };
    case.drive_along(wall, 0, shaking);
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-5), Some(500));
    (options.steps, options.output_every) = (Some(120), 30);
    case
}

#[test]
fn threads_and_resume_change_nothing_for_rods_on_terrain() {
    let one = files(&rods_on_terrain(), &[&["--threads", "1"]]);
    same(&one, &files(&rods_on_terrain(), &[&["--threads", "4"]]));
    same(&one, &files(&rods_on_terrain(), &[&["--steps", "60"], &["--resume", "--steps", "120"]]));
    let case = rods_on_terrain();
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let state = case.last();
    let wall = state.bodies.body_x.len() - 1;
    let count = load_count(&state, wall);
    assert!(count > 15, "{count}");
    for body in 0..wall {
        // None has fallen through the terrain, which is between 0 and 0.5 m high.
        assert!(state.x(body).z > 0.0, "body {body}: {}", state.x(body));
    }
}

#[test]
fn a_cylinder_on_triangles_restarts_from_text() {
    let mut case = scene("IQS_CLB", &[0.3]);
    let roller = cylinder(&mut case, 0.5, 0.5, [0.0, 0.0, 0.5], ALONG_Y);
    add_floor(&mut case, Floor::OneSided, AXES);
    (case.options.text, case.options.output_every) = (true, 10);
    case.run(10);
    let restarted = case.run_from_text(&case.first_text_states(), 10);
    near(restarted.x(roller), [0.0, 0.0, 0.5], 1e-9);
    assert_eq!(restarted.contacts.contact_gap.len(), 2);
}

/// A hollow cylinder has no contacts with a surface.
#[test]
fn hollow_cylinders_on_surfaces_are_rejected() {
    let mut case = scene("IQS_CLB", &[0.3]);
    case.law_between("DNLYC", "MESHx", "IQS_CLB", &[0.3]);
    let drum =
        body(&mut case, ShapeRecord::Cylinder { half_height: 0.5, radius: 0.5, hollow: true }, [0.0; 3], UPRIGHT);
    case.drive_along(drum, 0, Evolution::constant(0.0));
    case.press(drum, 2, 1.0);
    add_floor(&mut case, Floor::OneSided, AXES);
    case.options.steps = Some(1);
    case.write();
    assert_eq!(case.solve(&[]), 2);
}
