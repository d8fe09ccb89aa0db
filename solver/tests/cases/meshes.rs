//! Spheres on triangulated walls.

use cd_formats::bodies::{Contactor, ShapeRecord};
use cd_formats::drv_dof::Evolution;
use cd_formats::snapshot::Snapshot;
use cd_formats::wall_mesh::triangle_of;

use crate::case::{AXES, Case, Figures, Vec3, equal, load_count, near, shaken_lattice, uniform};
use crate::same_bits::{files, same};

const STEP: f64 = 1.0 / 128.0;

/// Vertices and triangles.
pub type Triangles = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Squares of side `side` about the origin, `count` along x and y, each cut in two, with the height of each corner.
pub fn terrain(count: u32, side: f64, mut height: impl FnMut() -> f64) -> Triangles {
    let at = |k: u32| side * (f64::from(k) - 0.5 * f64::from(count));
    let mut vertices = Vec::new();
    for (i, j) in (0..=count).flat_map(|j| (0..=count).map(move |i| (i, j))) {
        vertices.push([at(i), at(j), height()]);
    }
    let square = |k: u32| {
        let corner = |di: u32, dj: u32| (k / count + dj) * (count + 1) + k % count + di;
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        if k.is_multiple_of(3) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
    };
    (vertices, (0..count * count).flat_map(square).collect())
}

/// Right-handed axes of a wall that is turned about x and then about y.
pub fn turned_axes(about_x: f64, about_y: f64) -> [[f64; 3]; 3] {
    let turn = nalgebra::Rotation3::from_euler_angles(about_x, about_y, 0.0);
    [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| (turn * axis).into())
}

/// A sphere of radius 1/2 that slides and rolls on a wall, on a plate or on triangles in the plane of its face; the wall moves.
fn on_wall(is_mesh: bool, law: (&str, &[f64]), axes: [[f64; 3]; 3], drive: &[(usize, Evolution)]) -> Snapshot {
    let mut case = Case::new();
    case.law_with(if is_mesh { "MESHx" } else { "PLANx" }, law.0, law.1);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    let normal = Vec3::from(axes[2]);
    let sphere = case.sphere(0.5, (normal * 0.5).into());
    case.launch(sphere, (Vec3::from(axes[0]) * 1.25 + Vec3::from(axes[1]) * 0.75).into(), [0.5, 0.0, 2.0]);
    let wall = if is_mesh {
        let (vertices, triangles) = terrain(32, 0.375, || 0.0);
        case.mesh(&vertices, &triangles, [0.0; 3], axes)
    } else {
        case.plate([6.0, 6.0, 0.5], (normal * -0.5).into(), axes)
    };
    let mut motion = [0.0; 6].map(Evolution::constant);
    drive.iter().for_each(|(component, evolution)| motion[*component] = evolution.clone());
    case.drive(wall, motion);
    case.run(256)
}

/// Slides, rolls and is bonded as on a plate, across the edges of 20 triangles and more.
#[test]
fn a_plane_of_triangles_is_a_plate() {
    let harmonic = |amplitude: f64| Evolution::Harmonic {
        constant: 0.0,
        amplitude,
        omega: 5.0,
        phase: 0.25,
        ramp_start: 1.0,
        ramp_rate: 0.0,
    };
    let cases = [
        (("IQS_CLB", &[0.3][..]), turned_axes(0.0, 0.0), vec![]),
        (("IQS_CLB", &[0.3][..]), turned_axes(0.25, 0.125), vec![]),
        (("RST_CLB", &[0.5, 0.25, 0.3][..]), turned_axes(0.0, 0.0), vec![]),
        (("IQS_WET_DS_CLB", &[2.0, 0.0, 0.01, 0.3, 0.3][..]), turned_axes(0.25, 0.125), vec![]),
        (("IQS_CLB", &[0.3][..]), turned_axes(0.0, 0.0), vec![(2, harmonic(0.25)), (0, harmonic(0.5))]),
        (("IQS_CLB", &[0.3][..]), turned_axes(0.0, 0.0), vec![(5, Evolution::constant(0.5))]),
    ];
    for (law, axes, drive) in cases {
        let [plate, mesh] = [false, true].map(|is_mesh| on_wall(is_mesh, law, axes, &drive));
        // Away from the edge of the plate, after the edges of many triangles.
        assert!(plate.x(0).norm() > 1.5 && plate.x(0).norm() < 5.0, "{}", plate.x(0));
        assert!(mesh.contacts.contact_body.len() == 1, "{:?}", mesh.contacts.contact_gap);
        near(mesh.x(0), plate.x(0), 1e-12);
        near(mesh.v(0), plate.v(0), 1e-12);
        near(mesh.w(0), plate.w(0), 1e-12);
    }
}

/// A sphere of radius 1/2 at rest on a wall of triangles without friction, in 8 m/s^2.
fn at_rest(triangles: &Triangles, height: f64) -> Snapshot {
    let mut case = Case::new();
    case.law_with("MESHx", "IQS_CLB", &[0.0]);
    case.gravity = [0.0, 0.0, -8.0];
    case.options.dt = STEP;
    case.sphere(0.5, [0.0, 0.0, height]);
    case.mesh(&triangles.0, &triangles.1, [0.0; 3], AXES);
    let state = case.run(32);
    near(state.v(0), [0.0; 3], 1e-10);
    state
}

/// Weight of the sphere, N, and the normal force of each contact along z.
fn weight_and_lifts(state: &Snapshot) -> (f64, Vec<f64>) {
    let contacts = &state.contacts;
    let lift = |(force, frame): (&[f64; 3], &[[f64; 3]; 3])| force[0] * frame[0][2];
    (8.0 * state.mass(0), contacts.contact_force.iter().zip(&contacts.contact_frame).map(lift).collect())
}

#[test]
fn a_groove_is_touched_on_both_sides() {
    let vertices = [-1.0, 0.0, 1.0].map(|x: f64| [-1.0, 1.0].map(|y| [x, y, 0.75 * x.abs()])).concat();
    let groove = (vertices, vec![[0, 2, 1], [2, 3, 1], [2, 4, 3], [4, 5, 3]]);
    // 3-4-5: the sides are 0.8 of the height away.
    let (weight, lifts) = weight_and_lifts(&at_rest(&groove, 0.625));
    assert_eq!(lifts.len(), 2);
    lifts.iter().for_each(|lift| equal(*lift, 0.5 * weight, 1e-9));
}

#[test]
fn a_tip_is_touched_once() {
    let vertices = vec![[0.0, 0.0, 0.0], [1.0, 0.0, -1.0], [-0.5, 0.75, -1.0], [-0.5, -0.75, -1.0]];
    let tip = (vertices, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
    let state = at_rest(&tip, 0.5);
    let (weight, lifts) = weight_and_lifts(&state);
    assert_eq!(lifts.len(), 1);
    equal(lifts[0], weight, 1e-9);
    // The corner of the lowest triangle that has it.
    assert_eq!(state.contacts.contact_feature, [[0, 4]]);
}

/// The forces of all sides of a funnel carry the sphere, and their normals have the slope of the sides.
#[test]
fn a_funnel_is_touched_on_each_side() {
    const SIDES: u32 = 16;
    let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(SIDES);
    let ring = (0..SIDES).map(|k| [2.0 * angle(k).cos(), 2.0 * angle(k).sin(), 1.5]);
    let vertices = [[0.0; 3]].into_iter().chain(ring).collect();
    let triangles: Vec<[u32; 3]> = (0..SIDES).map(|k| [0, k + 1, (k + 1) % SIDES + 1]).collect();
    // The middle of each side rises by 1.5 over 2 cos(pi/16).
    let slope = 0.75 / (std::f64::consts::PI / f64::from(SIDES)).cos();
    let vertical = 1.0 / (1.0 + slope * slope).sqrt();
    let state = at_rest(&(vertices, triangles), 0.5 / vertical);
    let (weight, lifts) = weight_and_lifts(&state);
    assert_eq!(lifts.len(), SIDES as usize);
    // Tolerance: files with 14 digits, divided by the step.
    equal(lifts.iter().sum(), weight, 1e-9);
    for (frame, feature) in state.contacts.contact_frame.iter().zip(&state.contacts.contact_feature) {
        equal(frame[0][2], vertical, 1e-12);
        // The side that the normal faces.
        let direction = frame[0][1].atan2(frame[0][0]) + std::f64::consts::PI;
        let side = (direction / angle(1)).floor() as u32 % SIDES;
        assert_eq!(triangle_of(feature[1]), side);
    }
}

/// Spheres, of which two make a body, that fall on shaken terrain.
fn grains_on_terrain() -> Case {
    let mut case = Case::new();
    case.law_with("SPHER", "IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]);
    case.law_with("MESHx", "IQS_WET_DS_CLB", &[0.05, 0.0, 0.02, 0.3, 0.5]);
    case.gravity = [0.1, 0.0, -4.0];
    for (radius, [x, y, z]) in shaken_lattice(3, 4) {
        case.sphere(radius, [x, y, z + 2.5]);
    }
    let pair = case.sphere(0.25, [2.25, 0.25, 1.5]);
    let ball = |x: f64| Contactor {
        colour: "GRAIN".into(),
        shape: ShapeRecord::OffsetSphere { radius: 0.25, offset: [x, 0.0, 0.0] },
        local_frame: None,
    };
    case.bodies[pair].contactors = vec![ball(0.125), ball(-0.125)];
    let mut random = uniform(3);
    let (vertices, triangles) = terrain(16, 0.5, || 0.5 * random());
    let wall = case.mesh(&vertices, &triangles, [0.0; 3], AXES);
    let shaking =
        Evolution::Harmonic { constant: 0.0, amplitude: 0.5, omega: 9.0, phase: 0.0, ramp_start: 0.1, ramp_rate: 2.0 };
    case.drive_along(wall, 0, shaking);
    let options = &mut case.options;
    (options.dt, options.tol, options.max_sweeps) = (0.01, Some(1e-5), Some(500));
    (options.steps, options.output_every, options.text) = (Some(120), 30, true);
    case
}

#[test]
fn threads_and_resume_change_nothing_on_terrain() {
    let one = files(&grains_on_terrain(), &[&["--threads", "1"]]);
    same(&one, &files(&grains_on_terrain(), &[&["--threads", "4"]]));
    same(&one, &files(&grains_on_terrain(), &[&["--steps", "60"], &["--resume", "--steps", "120"]]));
    let case = grains_on_terrain();
    case.write();
    assert_eq!(case.solve(&[]), 0);
    let state = case.last();
    let wall = state.bodies.body_x.len() - 1;
    let count = load_count(&state, wall);
    // Grains rest on the terrain at the end, and none has fallen through it.
    assert!(count > 5, "{count}");
    for body in 0..wall {
        assert!(state.x(body).z > 0.2, "body {body}: {}", state.x(body));
    }
}

/// A scene of a sphere over two triangles.
fn sound() -> Case {
    let mut case = Case::new();
    case.law_with("MESHx", "IQS_CLB", &[0.3]);
    case.sphere(0.5, [0.0, 0.0, 0.5]);
    let (vertices, triangles) = terrain(1, 2.0, || 0.0);
    case.mesh(&vertices, &triangles, [0.0; 3], AXES);
    case.options.steps = Some(2);
    case
}

/// Expects that cd-solve rejects DATBOX with a message that has these words.
#[track_caller]
fn rejected(case: &Case, words: &str) {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && text.contains(words), "{text}");
    assert!(!case.path().join("OUTBOX").exists());
}

#[test]
fn walls_that_are_not_computed_are_rejected() {
    let mut case = sound();
    case.driven.retain(|driven| driven.component != 4);
    case.write();
    rejected(&case, "BODIES.DAT:11: body 2: a MESHx whose motion is not all imposed; expected vlocy lines");

    let mut case = sound();
    case.law_between("PLANx", "MESHx", "IQS_CLB", &[0.3]);
    let plate = case.plate([1.0; 3], [0.0, 0.0, 2.0], AXES);
    case.driven.retain(|driven| driven.body != plate);
    case.write();
    rejected(&case, "body 3, which is not all driven, and body 2; expected no such row: a surface MESHx has");

    let mut case = sound();
    let ball = Contactor { colour: "WALLx".into(), shape: ShapeRecord::Sphere { radius: 1.0 }, local_frame: None };
    case.bodies[1].contactors.push(ball);
    case.write();
    rejected(
        &case,
        "BODIES.DAT:11: body 2: a MESHx among other contactors; expected it to be the only one of its body",
    );

    let mut case = sound();
    case.options.xperiode = Some(5.0);
    case.write();
    rejected(&case, "in a scene with the period 5 m; expected less than half of that");
}

#[test]
fn files_of_surfaces_with_faults_are_rejected() {
    let with_file = |text: Option<&str>| {
        let case = sound();
        case.write();
        let path = case.path().join("DATBOX/wall-1.obj");
        match text {
            Some(text) => std::fs::write(path, text).unwrap(),
            None => std::fs::remove_file(path).unwrap(),
        }
        case
    };
    rejected(&with_file(None), "wall-1.obj: file: cannot be read");
    rejected(&with_file(Some("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 4\n")), "wall-1.obj:4: file: vertex 4; expected 1 to 3");
    let flat = "v 0 0 0\nv 1 0 0\nv 0.5 0 0\nf 1 2 3\n";
    rejected(&with_file(Some(flat)), "wall-1.obj: surface: triangle 1 of vertices 1, 2, 3 has no area");
    let turned = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 4 3\n";
    rejected(
        &with_file(Some(turned)),
        "triangles 1 and 2 at the edge of vertices 1 and 3 are seen from different sides",
    );
    let large = "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n";
    rejected(&with_file(Some(large)), "BODIES.DAT:11: body 2: vertices of wall-1.obj up to 9 m from the body");
}
