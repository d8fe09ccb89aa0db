//! Polyhedra: rotation, resting, sliding, tipping, colliding, and walls of them.

use cd_formats::bodies::ShapeRecord;
use cd_formats::compute::{ComputeFlags, NarrowPhase};
use cd_formats::vloc_rloc::VlocRloc;
use cd_solve::state::DetectionCache;
use cd_solve::step::StageTimes;

use crate::case::{Case, Figures, Vec3, equal, is_long, near, shown, uniform};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// A scene of polyhedra under gravity `g` with friction `mu`.
fn scene(mu: f64, g: [f64; 3]) -> Case {
    let mut case = Case::new();
    case.law_of_all("IQS_CLB", &[mu]);
    case.gravity = g;
    case
}

/// Sum of the forces of the free bodies on body `floor`, N.
fn reaction(state: &cd_formats::snapshot::Snapshot, floor: usize) -> Vec3 {
    let contacts = &state.contacts;
    (0..contacts.contact_body.len())
        .map(|k| {
            let force = Vec3::from(contacts.contact_force[k]);
            let frame = contacts.contact_frame[k].map(Vec3::from);
            let on_candidate = frame[0] * force.x + frame[1] * force.y + frame[2] * force.z;
            let side = |side: usize| f64::from(contacts.contact_body[k][side] == floor as u32);
            on_candidate * (side(0) - side(1))
        })
        .sum()
}

#[test]
fn a_block_rests_on_the_floor() {
    for driven_block in [false, true] {
        let mut case = scene(0.5, [0.0, 0.0, -9.81]);
        let floor = if driven_block {
            let floor = case.block([8.0, 8.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
            case.drive(floor, [0.0; 6].map(cd_formats::drv_dof::Evolution::constant));
            floor
        } else {
            case.floor()
        };
        let block = case.block([0.5, 1.0, 0.25], [0.0, 0.0, 0.25], [X, Y, Z]);
        case.options.dt = 0.01;
        let state = case.run(100);
        equal(state.mass(block), 1.0, 1e-15);
        near(state.x(block), [0.0, 0.0, 0.25], 1e-13);
        assert!(state.v(block).norm() < 1e-13 && state.w(block).norm() < 1e-13);
        near(reaction(&state, floor), [0.0, 0.0, -9.81], 1e-11);
        assert_eq!(state.contacts.contact_body.len(), 4);
        equal(state.shapes.unwrap().contacts.contact_area.iter().sum(), 2.0, 1e-12);
    }
}

/// A block on a slope of angle a slides with g (sin a - mu cos a) if tan a > mu, and stays else; a high one tips.
#[test]
fn blocks_on_a_slope() {
    let slope = |mu: f64, tan: f64, half: [f64; 3]| {
        let a = tan.atan();
        let mut case = scene(mu, [10.0 * a.sin(), 0.0, -10.0 * a.cos()]);
        case.floor();
        let block = case.block(half, [0.0, 0.0, half[2]], [X, Y, Z]);
        case.options.dt = 0.01;
        let state = case.run(50);
        (state.x(block).x, state.w(block).y)
    };
    let cube = [0.5; 3];
    let (moved, turned) = slope(0.5, 0.49, cube);
    assert!(moved.abs() < 1e-11 && turned.abs() < 1e-11, "{moved} {turned}");
    let (moved, turned) = slope(0.5, 0.6, cube);
    let a = 0.6f64.atan();
    let acceleration = 10.0 * (a.sin() - 0.5 * a.cos());
    // After n steps of the scheme from rest: v = n h a, x = h a (n²/2) h for theta = 1/2.
    equal(moved, 0.5 * acceleration * 0.25, 1e-7); // the file has eight digits of g
    assert!(turned.abs() < 1e-10);
    // Four times as high as wide: it tips where tan a > 1/4.
    assert!(slope(2.0, 0.24, [0.25, 0.5, 1.0]).1.abs() < 1e-10);
    assert!(slope(2.0, 0.26, [0.25, 0.5, 1.0]).1 > 1e-3);
}

/// On a slope of 20 degrees a block does not creep; one that slides on a floor neither lifts nor turns, and loses mu g h
/// of its speed in every step.
#[test]
fn a_block_neither_creeps_nor_lifts() {
    let a = 20f64.to_radians();
    let mut case = scene(0.5, [9.81 * a.sin(), 0.0, -9.81 * a.cos()]);
    case.floor();
    let block = case.block([0.5; 3], [0.0, 0.0, 0.5], [X, Y, Z]);
    case.options.dt = 1.0 / 240.0;
    for state in case.states(2400, 240) {
        // A step is solved to 1e-12 of the 0.04 m/s that gravity gives in it.
        near(state.v(block), [0.0; 3], 4e-14);
        near(state.w(block), [0.0; 3], 2.0 * 4e-14);
        near(state.x(block), [0.0, 0.0, 0.5], 10.0 * 4e-14);
    }

    let mut case = scene(0.5, [0.0, 0.0, -8.0]);
    case.floor();
    let block = case.block([0.5; 3], [0.0, 0.0, 0.5], [X, Y, Z]);
    case.launch(block, [8.0, 0.0, 0.0], [0.0; 3]);
    case.options.dt = 1.0 / 240.0;
    for state in case.states(440, 44) {
        // 440 roundings of 8 m/s, and their sum over the time.
        near(state.v(block), [8.0 - 4.0 * state.meta.time, 0.0, 0.0], 1e-12);
        near(state.w(block), [0.0; 3], 1e-12);
        equal(state.x(block).z, 0.5, 1e-13);
    }
}

/// Rocks thrown at each other without gravity: momentum to rounding, energy never grows.
#[test]
fn collisions_keep_momentum_and_energy_does_not_grow() {
    let mut random = uniform(11);
    for (mu, kind) in [(0.0, "IQS_CLB"), (0.6, "IQS_CLB"), (0.3, "GAP_SGR_CLB")] {
        let mut case = Case::new();
        case.law_of_all(kind, &[mu]);
        for k in 0..12 {
            let half = [0; 3].map(|_| 0.2 + 0.5 * random());
            let x = [f64::from(k % 3), f64::from(k / 3 % 2), f64::from(k / 6)].map(|c| 2.6 * c + 0.3 * random());
            let body = case.block(half, x, [X, Y, Z]);
            let towards = x.map(|c| -0.6 * c);
            case.launch(body, towards, [0; 3].map(|_| 2.0 * random() - 1.0));
        }
        case.sphere(0.4, [5.0, 1.0, 1.0]);
        case.options.dt = 0.01;
        case.options.tol = Some(1e-10);
        let states = case.states(400, 10);
        let first = &states[0];
        let scale = first.momentum_scale();
        let mut energy = first.kinetic();
        for state in &states {
            // Rounding of some thousand changes, of numbers up to the scale times the extent of 6.
            near(state.momentum(), first.momentum(), 1e-13 * scale);
            near(state.angular_momentum(), first.angular_momentum(), 1e-12 * scale);
            // The solver's tolerance leaves 1e-10 of the velocities.
            assert!(kind != "IQS_CLB" || state.kinetic() <= energy * (1.0 + 1e-9), "{} {energy}", state.kinetic());
            energy = state.kinetic();
        }
        assert!(states.last().unwrap().kinetic() < 0.9 * first.kinetic());
    }
}

/// A box in a frame of the file that is rotated and shifted: its centre of mass and principal moments are found.
#[test]
fn principal_axes_are_found_and_those_given_are_kept() {
    // A box of 2 x 4 x 6 turned by 30 degrees about z, its centre off the origin.
    let (sin, cos) = (0.5, 0.75f64.sqrt());
    let corner = |k: u32| [0, 1, 2].map(|i| if k >> i & 1 == 1 { 1.0 } else { -1.0 } * f64::from(i + 1));
    let turned = |[x, y, z]: [f64; 3]| [cos * x - sin * y + 0.25, sin * x + cos * y, z];
    let vertices: Vec<[f64; 3]> = (0..8).map(|k| turned(corner(k))).collect();
    let mut case = scene(0.0, [0.0; 3]);
    let body = case.polyhedron(&vertices, &crate::case::BOX, [1.0, 0.0, 0.0]);
    case.dof.clear();
    let state = case.run(1);
    near(state.x(body), [1.25, 0.0, 0.0], 1e-7);
    equal(state.mass(body), 48.0, 1e-5); // the file has eight digits
    let mut inertia = state.bodies.body_inertia[body];
    inertia.sort_by(f64::total_cmp);
    near(inertia, [16.0 * (1.0 + 4.0), 16.0 * (1.0 + 9.0), 16.0 * (4.0 + 9.0)], 1e-4);
    assert_eq!(state.shapes.unwrap().turning.turning_body, [body as u32]);
}

/// A heap of blocks that fall into a tub: any number of threads, two runs as one, accurate and fast.
#[test]
fn the_same_bytes_again() {
    for narrow_phase in [NarrowPhase::Accurate, NarrowPhase::Fast] {
        the_same_bytes_by(narrow_phase);
    }
}

fn the_same_bytes_by(narrow_phase: NarrowPhase) {
    let heap = || {
        let mut case = scene(0.4, [0.0, 0.0, -9.81]);
        case.tub(1.6);
        let mut random = uniform(5);
        for k in 0..30 {
            let x = [f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0, 0.8 + f64::from(k / 9)].map(|c| 1.0 * c);
            let half = [0; 3].map(|_| 0.15 + 0.2 * random());
            let body = case.block(half, x, [X, Y, Z]);
            case.launch(body, [0.0; 3], [0; 3].map(|_| 3.0 * random()));
        }
        case.sphere(0.2, [0.0, 0.0, 5.0]);
        (case.options.dt, case.options.tol, case.options.max_sweeps) = (0.005, Some(1e-4), Some(200));
        (case.options.steps, case.options.output_every, case.options.text) = (Some(120), 40, true);
        case.options.narrow_phase = Some(narrow_phase);
        case
    };
    let read = |case: &Case| -> Vec<(String, Vec<u8>)> {
        let entries = std::fs::read_dir(case.path().join("OUTBOX")).unwrap().map(Result::unwrap);
        let mut files: Vec<_> =
            entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect();
        files.sort();
        files
    };
    let case = heap();
    case.write();
    assert_eq!(case.solve(&["--threads", "1"]), 0);
    let first = read(&case);
    assert!(first.len() > 4);
    let other = heap();
    other.write();
    assert_eq!(other.solve(&["--threads", "3", "--steps", "80"]), 0);
    assert_eq!(other.solve(&["--threads", "2", "--resume", "--steps", "120"]), 0);
    for ((name, a), (other_name, b)) in first.iter().zip(&read(&other)) {
        assert!(name == other_name && a == b, "{name} {other_name}");
    }
    if narrow_phase == NarrowPhase::Fast {
        // Checked in steps 1 and 101; a search begins from data of the step before, so that it misses less than a hundredth of a size.
        let [mean, largest] = ["narrow_error", "narrow_error_largest"].map(|name| case.column(name));
        for (k, (mean, largest)) in mean.iter().zip(&largest).enumerate() {
            assert_eq!(mean.is_finite(), k % 100 == 0, "step {}", k + 1);
            assert!(mean.is_nan() || mean <= largest && *largest < 1e-2, "step {}: {mean} {largest}", k + 1);
        }
    }
    // Nothing has sunk or jumped: all within the tub, with small overlaps.
    let state = case.last();
    assert!(state.free().iter().all(|&i| state.x(i).z > 0.0 && state.x(i).x.abs() < 1.6 && state.x(i).y.abs() < 1.6));
}

/// Rocks that fall into a tub: what detection knows from step to step saves time and nothing else.
#[test]
fn what_is_known_of_pairs_changes_nothing() {
    let mut case = scene(0.4, [0.0, 0.0, -9.81]);
    case.tub(1.6);
    let mut random = uniform(11);
    for k in 0..36 {
        let x = [f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0, 0.6 + 0.9 * f64::from(k / 9)];
        let mut far = || 0.25 + 0.2 * random();
        let mut corners = [[0.0; 3]; 6];
        corners.iter_mut().enumerate().for_each(|(v, at)| at[v / 2] = if v % 2 == 0 { far() } else { -far() });
        let faces = [0, 1].map(|x| [2, 3].map(|y| [4, 5].map(|z| [x, y, z])));
        let outward = |[x, y, z]: [u32; 3]| if (x + y + z) % 2 == 0 { [x, y, z] } else { [y, x, z] };
        let body = case.polyhedron(&corners, &faces.concat().concat().into_iter().map(outward).collect::<Vec<_>>(), x);
        case.launch(body, [0; 3].map(|_| random() - 0.5), [0; 3].map(|_| 6.0 * random() - 3.0));
    }
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (0.004, Some(1e-4), Some(200));
    case.write();
    let (scene, mut state) = cd_solve::read::read_case(&case.path(), &ComputeFlags::default()).unwrap();
    let mut afresh = state.clone();
    let (mut looked_for, mut contacts) = (0, 0);
    for step in 0..250 {
        afresh.detection_cache =
            DetectionCache { restored_pairs: afresh.detection_cache.cached_pairs(), ..DetectionCache::default() };
        let before = state.detection_cache.neighbours.centres.clone();
        for state in [&mut state, &mut afresh] {
            cd_solve::step::step(&scene, state, &mut StageTimes::default());
        }
        assert!(state == afresh, "step {step}");
        looked_for += usize::from(state.detection_cache.neighbours.centres != before);
        contacts += state.contacts.len();
    }
    assert!(contacts > 250 * 40, "{contacts}");
    assert!((2..200).contains(&looked_for), "{looked_for}");
}

/// Contacts of polyhedra go through the text files: their impulses are there to start from, whoever stands first.
#[test]
fn the_texts_of_a_stack_start_another() {
    let mut case = scene(0.5, [0.0, 0.0, -10.0]);
    case.floor();
    (0..6).for_each(|k| _ = case.block([0.5; 3], [0.0, 0.0, 0.5 + f64::from(k)], [X, Y, Z]));
    case.sphere(0.25, [0.0, 0.0, 6.25]);
    let cylinder = case.plate([1.0; 3], [0.75, 0.0, 0.5], [Y, Z, X]);
    let shape = ShapeRecord::Cylinder { half_height: 0.25, radius: 0.25, hollow: false };
    case.bodies[cylinder].contactors[0].shape = shape;
    (case.options.dt, case.options.tol, case.options.text, case.options.output_every) = (0.01, Some(1e-4), true, 60);
    let settled = case.run(60);
    let sweeps = |case: &Case| case.column("sweeps")[0];
    let cold = sweeps(&case);
    let datbox = case.path().join("DATBOX");
    for (from, to) in [("DOF.OUT.1", "DOF.INI"), ("Vloc_Rloc.OUT.1", "Vloc_Rloc.INI")] {
        std::fs::copy(case.path().join("OUTBOX").join(from), datbox.join(to)).unwrap();
    }
    let file = datbox.join("Vloc_Rloc.INI");
    let mut history = VlocRloc::read(&file).unwrap();
    for kind in ["PRPLx", "PRPRx", "SPPRx"] {
        assert!(history.contacts.iter().any(|contact| contact.kind == kind), "{kind}");
    }
    let again = |case: &Case| {
        assert_eq!(case.solve(&["--force", "--steps", "61"]), 0);
        (sweeps(case), case.written().last().unwrap().contacts.clone())
    };
    let (warm, contacts) = again(&case);
    // Seven digits of places are gaps to 1e-7 m: over h a ten-thousandth of the speed that weight gives in a step.
    assert!(4.0 * warm < cold, "{warm} {cold}");
    assert_eq!(contacts.contact_body, settled.contacts.contact_body);
    // The same from files that name the sides the other way round.
    for contact in &mut history.contacts {
        if contact.kind == "PRPRx" && contact.antagonist.contactor == "POLYR" {
            std::mem::swap(&mut contact.candidate, &mut contact.antagonist);
            // The force on the other, along the other normal; n x t = s as before.
            contact.frame[0] = contact.frame[0].map(|x| -x);
            contact.frame[1] = contact.frame[1].map(|x| -x);
            contact.force[2] = -contact.force[2];
            contact.velocity[2] = -contact.velocity[2];
        }
    }
    std::fs::write(&file, history.to_text()).unwrap();
    let (turned, _) = again(&case);
    assert_eq!(turned, warm);
    // Without the file the step begins from nothing.
    std::fs::remove_file(&file).unwrap();
    assert!(again(&case).0 > 2.0 * warm);
}

/// Far from the origin positions are rounded, and nothing else: a blow of two cubes, off their centres, and a stack.
#[test]
fn far_from_the_origin_only_positions_are_rounded() {
    let out = |far: f64, x: [f64; 3]| [far + x[0], -far + x[1], far + x[2]];
    let blow = |far: f64| {
        let mut case = Case::new();
        case.law_of_all("RST_CLB", &[0.8, 0.0, 0.3]);
        case.options.dt = 0.01;
        case.block([0.5; 3], out(far, [0.1, 0.2, 0.3]), [X, Y, Z]);
        let other = case.block([0.5; 3], out(far, [1.3015, 0.6, 0.1]), [X, Y, Z]);
        case.launch(other, [-0.3, 0.1, 0.0], [0.0; 3]);
        case.run(150)
    };
    let stack = |far: f64| {
        let mut case = scene(0.5, [0.0, 0.0, -8.0]);
        case.options.dt = 0.005;
        for k in 0..4 {
            case.block([0.45; 3], out(far, [0.1, 0.1 * f64::from(k), 0.55 + 0.9 * f64::from(k)]), [X, Y, Z]);
        }
        let floor = case.plate([8.0, 8.0, 0.5], out(far, [0.0, 0.0, -0.4]), [X, Y, Z]);
        let end = case.run(200);
        let on_floor = reaction(&end, floor);
        (end, on_floor)
    };
    let (blow_here, (stack_here, _)) = (blow(0.0), stack(0.0));
    assert!(blow_here.w(0).norm() > 0.1 && blow_here.v(0).norm() > 0.1, "the blow is felt");
    for far in [1e6, 1e9] {
        // Between one number of that size and the next.
        let step = f64::EPSILON * 2f64.powi(f64::log2(far) as i32);
        let from = Vec3::from(out(far, [0.0; 3]));
        let (blow, (stack, on_floor)) = (blow(far), stack(far));
        for body in 0..2 {
            // Each of the 150 steps may round a place by half of that, and the levers of the blow, of half a metre, with
            // it: at 0.3 m/s that is less than as much in v and w. The way is the sum along three axes, and of v in 1.5 s.
            let places = 150.0 * 0.5 * step;
            near(blow.v(body), blow_here.v(body), places);
            near(blow.w(body), blow_here.w(body), places);
            near(blow.x(body) - from, blow_here.x(body), (3f64.sqrt() + 1.5) * places);
        }
        for body in 0..4 {
            // Each of four gaps begins and ends between two such numbers, and what is less than one keeps its speed.
            near(stack.x(body) - from, stack_here.x(body), 4.0 * 3f64.sqrt() * step);
            near(stack.v(body), [0.0; 3], 4.0 * step / 0.005 + 1e-12);
            near(stack.w(body), [0.0; 3], 4.0 * step / 0.005 + 1e-12);
        }
        // As much as such a change of speed would be within one step.
        let weight = 4.0 * 0.9f64.powi(3) * 8.0;
        near(on_floor, [0.0, 0.0, -weight], 4.0 * step / 0.005 * weight / 8.0 / 0.005 + 1e-9);
    }
}

/// A run warns of bodies that overlap from its start: how many, which most, and by how much; and once of deep ones that
/// steps have made.
#[test]
fn deep_overlaps_are_reported() {
    let message = |case: &mut Case| {
        case.options.steps = Some(2);
        case.write();
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_cd-solve")).arg(case.path()).output().unwrap();
        assert!(output.status.success());
        let text = String::from_utf8(output.stderr).unwrap();
        text.lines().find(|line| line.contains("overlap")).map(str::to_string)
    };
    // The mean radius is that of the ball of a cube's volume, 0.62035 m.
    let cubes = |places: &[f64]| {
        let mut case = scene(0.5, [0.0; 3]);
        places.iter().for_each(|&x| _ = case.block([0.5; 3], [x, 0.1, 0.2], [X, Y, Z]));
        case
    };
    let expected = |pairs: &str, most: &str| {
        Some(format!(
            "cd-solve: warning: {pairs} by more than 1 % of the smaller radius from the start, the deepest: \
             bodies {most} of the smaller radius; laws other than GAP_SGR_CLB keep these overlaps"
        ))
    };
    assert_eq!(
        message(&mut cubes(&[0.0, 0.9])),
        expected("1 pair of bodies overlaps", "1-2 overlap by 1.000e-1 m, 16.1 %")
    );
    assert_eq!(
        message(&mut cubes(&[0.0, 0.95, 5.0, 5.75])),
        expected("2 pairs of bodies overlap", "3-4 overlap by 2.500e-1 m, 40.3 %")
    );
    // Of 1 % on either side: 6.2035e-3 m.
    assert_eq!(
        message(&mut cubes(&[0.0, 0.9937])),
        expected("1 pair of bodies overlaps", "1-2 overlap by 6.300e-3 m, 1.0 %")
    );
    assert_eq!(message(&mut cubes(&[0.0, 0.9939])), None);
    // A blow on a row that one sweep does not solve.
    let struck = |speed: f64, sweeps: u64| {
        let mut case = cubes(&[0.0, 1.0, 2.0, 3.0, 4.1]);
        (case.options.dt, case.options.max_sweeps) = (1e-3, Some(sweeps));
        case.options.solver = cd_formats::compute::ContactSolver::Nlgs;
        case.launch(4, [-speed, 0.0, 0.0], [0.0; 3]);
        message(&mut case)
    };
    let deep = struck(2000.0, 1).unwrap();
    assert!(deep.starts_with("cd-solve: warning: step 2, t = 0.002 s: bodies "), "{deep}");
    assert!(
        deep.ends_with(" % of the smaller radius; the step did not converge; raise max_sweeps or use a smaller dt"),
        "{deep}"
    );
    assert_eq!((struck(2000.0, 10_000), struck(1.0, 1)), (None, None));
}

/// An upright prism on a regular octagon that reaches 1 m, turned about y by an angle.
fn tilted_octagon(angle: f64) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let corner = |k: u32| {
        let (sin, cos) = ((f64::from(k % 8) + 0.5) * std::f64::consts::TAU / 8.0).sin_cos();
        let z = if k < 8 { -0.5 } else { 0.5 };
        [cos * angle.cos() + z * angle.sin(), sin, z * angle.cos() - cos * angle.sin()]
    };
    let fan = |k: u32| [[0, k + 1, k], [8, 8 + k, 9 + k]];
    let side = |k: u32| [[k, (k + 1) % 8, 8 + k], [(k + 1) % 8, 8 + (k + 1) % 8, 8 + k]];
    ((0..16).map(corner).collect(), (1..7).flat_map(fan).chain((0..8).flat_map(side)).collect())
}

/// A plank on the raised edges of two prisms, of whose eight common corners with it two touch on each side.
#[test]
fn a_plank_stays_on_edges_whatever_else_is_listed() {
    for alert in [1e-3, 0.02, 0.1] {
        let mut case = scene(0.5, [0.0, 0.0, -10.0]);
        case.options.alert = Some(alert);
        let plank = case.block([5.0, 2.0, 0.25], [0.3, 0.2, 0.25], [X, Y, Z]);
        for side in [-1.0, 1.0] {
            let (vertices, triangles) = tilted_octagon(side * 0.03);
            let top = vertices.iter().map(|v| v[2]).fold(f64::NEG_INFINITY, f64::max);
            let pillar = case.polyhedron(&vertices, &triangles, [3.0 * side, 0.0, -top]);
            case.drive(pillar, [0.0; 6].map(cd_formats::drv_dof::Evolution::constant));
        }
        case.dof.truncate(1); // the program finds the axes of the others
        case.options.tol = Some(1e-9);
        let end = case.run(500);
        // The first step falls by half of g h² at most, and nothing creeps after it.
        near(end.x(plank), [0.3, 0.2, 0.25], 1e-5);
        near(end.v(plank), [0.0; 3], 1e-7);
    }
}

/// A cube that stands on an edge, glued along it: only the points near the plate share the strip of the face that is.
#[test]
fn a_bond_on_a_strip_does_not_depend_on_what_is_listed() {
    for alert in [1e-3, 0.1] {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e3, 1e3, 0.5, 0.5]);
        let (sin, cos) = 0.01f64.sin_cos();
        case.plate([3.0, 3.0, 0.5], [0.0, 0.0, -0.5], [X, Y, Z]);
        let cube = case.block([0.5; 3], [0.0, 0.0, 0.5 * (sin + cos)], [[cos, 0.0, -sin], Y, [sin, 0.0, cos]]);
        // On the strip the gap is up to 2 R/1000, R that of the ball of equal volume: 1.24e-3 / sin 0.01 wide, 124 N.
        case.gravity = [0.0, 0.0, 100.0];
        (case.options.alert, case.options.dt, case.options.tol) = (Some(alert), 1e-4, Some(1e-8));
        let end = case.run(2);
        let bonded: Vec<f64> = (end.memory.as_ref().unwrap().contact_bonded.iter().zip(&end.contacts.contact_gap))
            .filter_map(|(bonded, gap)| (*bonded == 1).then_some(*gap))
            .collect();
        assert_eq!(bonded.len(), 2, "{alert}: {bonded:?}");
        let areas = &end.shapes.as_ref().unwrap().contacts.contact_area;
        // At this tilt 1 % of it does not count.
        let strip = 2e-3 * (0.75 / std::f64::consts::PI).cbrt() / sin;
        equal(areas.iter().sum::<f64>(), 0.99 * strip, 1e-4);
        assert!(end.mass(cube) == 1.0);
    }
}

/// Faces are bonded up to R/1000, R that of the ball of equal volume, however many points share them.
#[test]
fn faces_are_bonded_up_to_a_thousandth_of_the_radius() {
    let radius = (0.75 / std::f64::consts::PI).cbrt();
    for (share, bonds) in [(0.9, 4), (1.1, 0)] {
        let mut case = Case::new();
        case.law_of_all("IQS_MOHR_DS_CLB", &[1e3, 1e3, 0.5, 0.5]);
        case.floor();
        case.block([0.5; 3], [0.0, 0.0, 0.5 + share * 1e-3 * radius], [X, Y, Z]);
        let bonded = case.run(1).memory.unwrap().contact_bonded;
        assert_eq!(bonded.iter().filter(|bonded| **bonded == 1).count(), bonds, "{share}");
    }
}

/// A prism of 1 m height upright on a regular triangle.
fn prism(case: &mut Case, x: [f64; 3]) -> usize {
    let corner = |k: u32| {
        let (sin, cos) = (f64::from(k % 3) * std::f64::consts::TAU / 3.0).sin_cos();
        [cos, sin, f64::from(k / 3) - 0.5]
    };
    let triangles = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]];
    case.polyhedron(&(0..6).map(corner).collect::<Vec<_>>(), &triangles, x)
}

/// Three bodies hang below each other from a plate, face to face: rounding decides which features meet in their corners,
/// and whether nearly parallel sides of triangles cross in a fourth point.
#[test]
fn bonds_and_liquid_bridges_outlive_the_names_of_corners() {
    let bond: (_, &[f64], _) = ("IQS_MOHR_DS_CLB", &[1e3, 5e2, 0.3, 0.3], 1e-9);
    let bridge: (_, &[f64], _) = ("xQS_WET_DS_CLB", &[20.0, 0.0, 0.0625, 0.3, 0.3], 1e-6);
    let mut renamed = 0;
    for ((law, parameters, tol), prisms) in [(bond, false), (bond, true), (bridge, false), (bridge, true)] {
        let mut case = Case::new();
        case.law_of_all(law, parameters);
        case.gravity = [0.5, 0.3, -9.81];
        let plate = case.plate([3.0, 3.0, 0.5], [0.0, 0.0, 0.5], [X, Y, Z]);
        for z in [-0.5, -1.5, -2.5] {
            let x = [0.0, 0.0, z];
            if prisms {
                prism(&mut case, x)
            } else {
                case.block([0.5; 3], x, [X, Y, Z])
            };
        }
        if prisms {
            case.dof.retain(|dof| dof.body == plate); // the program finds their axes
        }
        (case.options.dt, case.options.tol) = (0.01, Some(tol));
        let states = case.states(1000, 10);
        let mass: f64 = states[0].free().iter().map(|&i| states[0].mass(i)).sum();
        for pair in states[1..].windows(2) {
            renamed += usize::from(pair[0].contacts.contact_feature != pair[1].contacts.contact_feature);
            let bonded = &pair[1].memory.as_ref().unwrap().contact_bonded;
            assert!(bonded.iter().all(|bonded| *bonded == 1), "{law}: {bonded:?} at {} s", pair[1].meta.time);
            // `tol` is of the cohesion of nine to twelve contacts, on each face a hundred times a weight at most.
            near(reaction(&pair[1], plate) / mass, [0.5, 0.3, -9.81], 1e4 * tol);
        }
    }
    assert!(renamed >= 5, "{renamed}"); // a check of the check
}

/// Cards of half lengths (thickness, width, length) in three storeys of tents, a roof over each but the last.
fn card_house(case: &mut Case) -> Vec<usize> {
    let (length, thick, wide, lean) = (1.0, 0.02, 0.4, 12f64.to_radians());
    let (sin, cos) = lean.sin_cos();
    let storey = length * cos + thick * sin;
    let span = 2.0 * (length * sin + thick * cos) + 0.06;
    let mut cards = Vec::new();
    let mut z = 0.0;
    for level in 0..3 {
        let tents = 3 - level;
        for k in 0..tents {
            let middle = (f64::from(k) - 0.5 * f64::from(tents - 1)) * span;
            for side in [-1.0, 1.0] {
                let axes = [[cos, 0.0, side * sin], Y, [-side * sin, 0.0, cos]];
                let x = middle + side * (0.5 * length * sin + 0.5 * thick * cos);
                let centre = [x, 0.0, z + 0.5 * (length * cos + thick * sin)];
                cards.push(case.block([0.5 * thick, wide, 0.5 * length], centre, axes));
            }
        }
        z += storey;
        for k in 1..tents {
            let middle = (f64::from(k) - 0.5 * f64::from(tents)) * span;
            cards.push(case.block([0.49 * span, wide, 0.5 * thick], [middle, 0.0, z + 0.5 * thick], [X, Y, Z]));
        }
        z += thick;
    }
    cards
}

/// Fifteen stones of a half circle, without mortar.
fn arch(case: &mut Case) -> Vec<usize> {
    let stone = |k: u32| {
        let angle = |end: u32| std::f64::consts::PI * f64::from(k + end) / 15.0;
        let corner = |c: u32| {
            let (radius, (sin, cos)) = (4.0 + f64::from(c & 1), angle(c >> 2).sin_cos());
            [radius * cos, if c >> 1 & 1 == 1 { 0.5 } else { -0.5 }, radius * sin]
        };
        (0..8).map(corner).collect::<Vec<_>>()
    };
    (0..15).map(|k| case.polyhedron(&stone(k), &crate::case::BOX, [0.0; 3])).collect()
}

/// Twenty cubes of 1 m on each other.
fn stack(case: &mut Case) -> Vec<usize> {
    (0..20).map(|k| case.block([0.5; 3], [0.0, 0.0, 0.5 + f64::from(k)], [X, Y, Z])).collect()
}

/// Ten courses of ten bricks of 1 x 0.5 x 0.5 m, every other one shifted by half a brick between two halves of one.
fn wall(case: &mut Case) -> Vec<usize> {
    let mut bricks = Vec::new();
    for course in 0..10 {
        let z = 0.25 + 0.5 * f64::from(course);
        let mut lay = |from: f64, length: f64| {
            bricks.push(case.block([0.5 * length, 0.25, 0.25], [from + 0.5 * length, 0.0, z], [X, Y, Z]));
        };
        if course % 2 == 0 {
            (0..10).for_each(|k| lay(f64::from(k), 1.0));
        } else {
            lay(0.0, 0.5);
            (0..9).for_each(|k| lay(0.5 + f64::from(k), 1.0));
            lay(9.5, 0.5);
        }
    }
    bricks
}

/// Building that stands without mortar: name, size in m, friction, and function that builds it.
type Building = (&'static str, f64, f64, fn(&mut Case) -> Vec<usize>);
const BUILDINGS: [Building; 4] = [
    ("stack of 20 cubes", 20.0, 0.6, stack),
    ("wall of 10 x 10 bricks", 5.0, 0.6, wall),
    ("arch of 15 stones", 5.0, 0.7, arch),
    ("card house of 15 cards", 3.0, 0.8, card_house),
];

/// The floor carries the weight to a millionth at the end of so many steps of 5 ms; returns the largest way that a body
/// has moved in each stretch of `every` steps over the size, and what the reaction misses of the weight.
fn stands((name, size, mu, build): Building, steps: u64, every: u64, max_sweeps: u64) -> (Vec<f64>, f64) {
    let mut case = scene(mu, [0.0, 0.0, -9.81]);
    let bodies = build(&mut case);
    let floor = case.floor();
    if name.starts_with("arch") {
        case.dof.retain(|dof| dof.body == floor); // the program finds the axes of the stones
    }
    (case.options.dt, case.options.tol, case.options.max_sweeps) = (0.005, Some(3e-7), Some(max_sweeps));
    let states = case.states(steps, every);
    let moved = |pair: &[cd_formats::snapshot::Snapshot]| {
        bodies.iter().map(|&i| (pair[1].x(i) - pair[0].x(i)).norm()).fold(0.0, f64::max) / size
    };
    let last = states.last().unwrap();
    let weight: f64 = bodies.iter().map(|&i| 9.81 * last.mass(i)).sum();
    let missed = reaction(last, floor).z / weight + 1.0;
    assert!(missed.abs() < 1e-6, "{name}: {missed:e}");
    // Along the floor is what sways within the tolerance, which the wall's steps do not reach.
    let sways = if name.starts_with("wall") { 1e-3 } else { 1e-4 };
    near(reaction(last, floor) / weight, [0.0, 0.0, -1.0], sways);
    (states.windows(2).map(moved).collect(), missed)
}

/// They stand: after the first second nothing creeps, and the floor carries their weight.
#[test]
fn a_stack_an_arch_and_a_card_house_stand() {
    for building in BUILDINGS.into_iter().filter(|building| !building.0.starts_with("wall")) {
        let (moved, _) = stands(building, 300, 150, 5000);
        assert!(moved[1] < 1e-6, "{}: {moved:?}", building.0);
    }
}

/// The same for a minute, printed for docs/explanation/limits.md.
#[test]
fn a_minute_on_their_feet() {
    BUILDINGS
        .into_iter()
        .filter(|building| !building.0.starts_with("wall"))
        .for_each(|building| stay(building, 12_000));
}

/// The thousand contacts of the wall are solved by the methods that follow the sweeps. For a minute in `make extremes` alone.
#[test]
fn a_wall_stands() {
    stay(BUILDINGS[1], if is_long() { 12_000 } else { 3_000 });
}

/// They stay where they are for so many steps of 5 ms.
fn stay(building: Building, steps: u64) {
    let (moved, missed) = stands(building, steps, 1_000, 10_000);
    let most = moved[1..].iter().copied().fold(0.0, f64::max);
    let (name, size, mu, _) = building;
    let range = format!("{size} m, friction {mu}");
    let seconds = steps / 200;
    shown(
        &format!("{name}, {seconds} s"),
        &range,
        "largest displacement of a body in 5 s over the size, from 5 s on",
        most,
    );
    shown(&format!("{name}, the floor"), &range, "its reaction less the weight, over the weight", missed.abs());
    assert!(most < 1e-6, "{}: {moved:?}", building.0);
}

/// A cube set on a floor that leans, with its corners at gaps of all last digits: laws on the velocity see them all, or none.
#[test]
fn a_cube_that_lies_flat_strikes_with_its_whole_face() {
    for (kind, parameters) in [("RST_CLB", vec![0.5, 0.0, 0.3]), ("VEL_SGR_CLB", vec![0.3])] {
        for lean in [0.1, 0.37, 0.73, 1.1] {
            let (s, c) = f64::sin_cos(lean);
            let (along, across) = ([c, 0.0, s], [-s, 0.0, c]);
            let at = |height: f64| across.map(|x| height * x);
            let mut case = Case::new();
            case.law_of_all(kind, &parameters);
            case.gravity = at(-10.0);
            case.plate([4.0, 4.0, 0.5], at(-0.5), [along, Y, across]);
            let cube = case.block([0.5; 3], at(0.5), [along, Y, across]);
            for state in case.states(400, 8) {
                // The digits of the frames, 1e-8, over the length of a step, 2e-3.
                assert!(state.w(cube).norm() < 1e-5, "{kind} {lean}: {:?} at {}", state.w(cube), state.meta.time);
            }
        }
    }
}
