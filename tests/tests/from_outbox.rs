//! `cd-pre from-outbox`: the state of one run as the start of the next.

use std::fs;
use std::path::Path;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::compute::Compute;
use cd_formats::snapshot::{self, Snapshot, SnapshotMeta, WallCircle};
use cd_formats::tact_behav::{TactBehav, VisibilityRow};
use cd_pre::pour::{PourRequest, pour_grains};
use cd_tests::case::{Case, cloud, files, from_outbox, solve, surfaces_of_an_l};

/// Forty rocks in the thick of their collisions at step 150.
fn collapse() -> Case {
    Case::from_scene(&cloud(40, 0.4, 1, "dt: 8.0, steps: 300, output_every: 50"))
}

/// A case made from the last snapshot of another.
fn next_case(from: &Case, changes: &str) -> Case {
    let case = Case::empty();
    assert_eq!(from_outbox(from.path(), case.path(), changes), 0, "{changes}");
    case
}

/// Summary of the next case.
fn next_summary(from: &Case, changes: &str) -> String {
    let case = Case::empty();
    let file = case.path().join("changes.ron");
    fs::write(&file, changes).unwrap();
    cd_pre::from_outbox::write_datbox(from.path(), Some(&file), &[], case.path()).unwrap()
}

/// Bits of all that moves.
fn bits(snapshot: &Snapshot) -> Vec<u64> {
    let b = &snapshot.bodies;
    let vectors = [&b.body_x, &b.body_v, &b.body_w, &b.body_w_world];
    let impulses = snapshot.contacts.contact_impulse.as_flattened();
    let all = vectors.into_iter().flat_map(|v| v.as_flattened()).chain(b.body_q.as_flattened()).chain(impulses);
    all.map(|x| x.to_bits()).collect()
}

#[test]
fn a_run_that_continues_in_another_folder_equals_the_unbroken_one() {
    let unbroken = collapse().solved(&[]);
    let case = next_case(&unbroken, "(bodies: [(snapshot: 150)], keep_time: true)").solved(&["--steps", "150"]);
    assert_eq!(bits(&case.snapshot(150)), bits(&unbroken.snapshot(150)));
    assert_eq!(bits(&case.snapshot(300)), bits(&unbroken.snapshot(300)));
    assert!(unbroken.snapshot(150).contacts.contact_impulse.iter().any(|r| r[0] > 0.0), "nothing touches");
    // From time 0 the same steps are made.
    let anew = next_case(&unbroken, "(bodies: [(snapshot: 150)])").solved(&["--steps", "150"]);
    assert_eq!(bits(&anew.snapshot(150)), bits(&unbroken.snapshot(300)));
    assert!(origin(&anew).iter().all(|(body, number)| body == number));
}

/// Rocks that have fallen into a box: the friction of a face acts at points that move along it as the face spins, so that the
/// velocities of the contacts in the file are not those of the bodies, although these are the same.
#[test]
fn rocks_that_stick_in_faces_continue_bit_for_bit() {
    let scene = r#"(
        seed: 1,
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_DS_CLB(dynamic_friction: 0.3, static_friction: 0.6))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
        grains: [(
            material: "ROCKx",
            colour: "BLUEx",
            number: 6,
            sizes: Single(0.3),
            shape: Random(vertices: (8, 10)),
            placement: RandomSequential(envelope: Box(lengths: (1.5, 1.5, 4.0))),
            spin: (0.0, 0.0, 2.0),
        )],
        walls: [Box(material: "ROCKx", colour: "WALLx", lengths: (2.0, 2.0, 6.0), half_thickness: 0.5)],
        compute: (dt: 0.01, steps: 100, output_every: 10),
    )"#;
    let unbroken = Case::from_scene(scene).solved(&[]);
    for (keep_time, last) in [(true, 100), (false, 10)] {
        let changes = format!("(bodies: [(snapshot: 90)], keep_time: {keep_time})");
        let case = next_case(&unbroken, &changes).solved(&["--steps", "10"]);
        assert_eq!(bits(&case.snapshot(last)), bits(&unbroken.snapshot(100)), "{keep_time}");
    }
    // Bodies that have got other velocities begin a run anew.
    let continues = |changes: &str| {
        let case = next_case(&unbroken, changes);
        Snapshot::read(&case.datbox(snapshot::START_FILE)).unwrap().meta.continues_run
    };
    assert!(continues("(bodies: [(snapshot: 90)])"));
    for changes in [
        "(bodies: [(snapshot: 90, velocity: (0.0, 0.0, 1.0))])",
        "(bodies: [(snapshot: 90, walls: false)])",
        "(bodies: [(snapshot: 90)], contacts: [(between: (\"BLUEx\", \"BLUEx\"), law: \"iqsc0\")])",
        "(bodies: [(snapshot: 90)], compute: (dt: 0.01, theta: 0.6))",
        "(bodies: [(snapshot: 90)], materials: [(name: \"ROCKx\", density: 4000.0)])",
        "(bodies: [(snapshot: 0)])",
    ] {
        assert!(!continues(changes), "{changes}");
    }
}

/// A mass on an orbit that a run without `keep_time` sends along its path again.
#[test]
fn orbits_that_begin_again_are_reported() {
    let field =
        |mass: &str| format!("fields: [PointMass(mass: {mass}, orbit: Elements(periapsis: 1.0e3, eccentricity: 2.0))]");
    let run = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", &field("1.0e9"))).solved(&["--steps", "6"]);
    let summary = |changes: &str| next_summary(&run, changes);
    let note =
        "fields: the orbits begin at time 0 again, not at the 1.5 s of the snapshot; keep_time: true continues them\n";
    assert!(summary("()").contains(note), "{}", summary("()"));
    // The run continues, begins with the first snapshot, or has another orbit.
    let other = format!("(compute: (dt: 0.25, {}))", field("2.0e9"));
    for changes in ["(keep_time: true)", "(bodies: [(snapshot: 0)])", other.as_str()] {
        assert!(!summary(changes).contains("orbits begin"), "{changes}");
    }
}

/// Bytes of all arrays.
fn array_bytes(snapshot: Snapshot) -> Vec<u8> {
    Snapshot { meta: SnapshotMeta::default(), ..snapshot }.to_bytes()
}

/// A plate, a drum and a surface on circles, each of which pushes a ball; `rates` of the three.
fn walls_on_circles(rates: [&str; 3]) -> Case {
    let [plate, drum, surface] = rates;
    let ball = |colour: &str, position: &str| {
        format!(
            "(material: \"ROCKx\", colour: \"{colour}\", sizes: Single(0.1), placement: List(positions: [{position}]))"
        )
    };
    let grains = [("BLUEx", "(1.2, 1.8, 0.0)"), ("BLACK", "(20.4, 0.0, 0.0)"), ("BLUEx", "(-18.5, 0.5, 1.2)")];
    let grains = grains.map(|(colour, position)| ball(colour, position)).join(",");
    let scene = format!(
        r#"(
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [
                (between: ("BLUEx", "BLUEx"), law: "iqsc0"),
                (between: ("BLUEx", "BLACK"), law: "iqsc0"),
                (between: ("BLUEx", "WALLx"), law: "iqsc0"),
                (between: ("BLUEx", "DRUMx"), law: None),
                (between: ("BLACK", "WALLx"), law: "iqsc0"),
                (between: ("BLACK", "DRUMx"), law: "iqsc0"),
            ],
            grains: [{grains}],
            walls: [
                Plate(material: "ROCKx", colour: "WALLx", centre: (2.0, 0.0, 0.0), normal: (0.0, 1.0, 0.0),
                    half_lengths: (0.5, 0.2, 0.02), revolution: (axis: (0.0, 0.0, 1.0), rate: {plate})),
                Cylinder(material: "ROCKx", colour: "DRUMx", centre: (20.0, 0.0, 0.0), half_height: 0.5, radius: 0.6,
                    hollow: true, revolution: (axis: (0.0, 0.0, 1.0), point: (19.0, 0.0, 0.0), rate: {drum})),
                Mesh(material: "ROCKx", colour: "WALLx", file: "l.obj", position: (-20.0, 0.0, 0.0),
                    revolution: (axis: (0.0, 1.0, 0.0), point: (-22.0, 0.0, 0.0), rate: {surface})),
            ],
            compute: (dt: 0.02, steps: 60, output_every: 15),
        )"#
    );
    Case::with_surfaces(&scene, surfaces_of_an_l().path())
}

/// The end of a step is on a chord of the circle, from which each of four runs has to return to the circle of the first.
#[test]
fn walls_stay_on_their_circles_from_run_to_run() {
    let table = "Table([(0.0, 0.0), (0.4, -1.5), (1.0e3, -1.5)])";
    let harmonic = "Harmonic(constant: -0.5, amplitude: 0.5, omega: 3.0)";
    let functions = walls_on_circles(["Constant(2.0)", table, harmonic]).solved(&[]);
    let constant = walls_on_circles(["Constant(2.0)", "Constant(-1.5)", "Constant(-0.5)"]).solved(&[]);
    let pushed = functions.last_snapshot().bodies.body_v.into_iter().take(3);
    assert!(pushed.clone().all(|v| v != [0.0; 3]), "{:?}", pushed.collect::<Vec<_>>());
    for (unbroken, keep_time) in [(&functions, true), (&constant, true), (&constant, false)] {
        let changes = format!("(keep_time: {keep_time})");
        let first = unbroken.twin().solved(&["--steps", "15"]);
        // Each run is interrupted.
        let next =
            |case: &Case| next_case(case, &changes).solved(&["--steps", "7"]).solved(&["--resume", "--steps", "15"]);
        let last = (1..4).fold(first, |case, _| next(&case));
        let [expected, found] = [unbroken, &last].map(|case| array_bytes(case.last_snapshot()));
        assert!(expected == found, "{changes}");
    }
}

/// A selection of walls keeps their circles, under their new numbers; another pivot begins one at the position of the wall,
/// r cos(rate h/2) from it, as the end of a step with θ = 1/2 is the middle of a chord.
#[test]
fn circles_of_selected_walls_stay() {
    let run = walls_on_circles(["Constant(2.0)", "Constant(-1.5)", "Constant(-0.5)"]).solved(&["--steps", "15"]);
    let circles = |case: &Case| Snapshot::read(&case.datbox(snapshot::START_FILE)).unwrap().meta.revolutions;
    let known = run.last_snapshot().meta.revolutions;
    let bodies = |circles: &[WallCircle]| circles.iter().map(|circle| circle.body).collect::<Vec<_>>();
    assert_eq!(bodies(&known), [4, 5, 6]);
    assert_eq!((known[0].point, known[0].offset.map(f64::abs)), ([0.0; 3], [2.0, 0.0, 0.0]));
    let selected = next_case(&run, "(bodies: [(walls_except: [Wall(1)])])");
    assert_eq!(circles(&selected), [WallCircle { body: 4, ..known[1] }, WallCircle { body: 5, ..known[2] }]);

    let anew = next_case(&run, "()");
    let driven = fs::read_to_string(anew.datbox("DRV_DOF.DAT")).unwrap();
    let first_pivot = driven.lines().find(|line| line.contains("pivot")).unwrap();
    let moved = first_pivot.replacen("0.0000000E+00", "1.0000000E-09", 1);
    fs::write(anew.datbox("DRV_DOF.DAT"), driven.replacen(first_pivot, &moved, 1)).unwrap();
    let end = anew.solved(&["--steps", "1"]).last_snapshot();
    let [x, y, _] = end.meta.revolutions[0].offset;
    let radius = x.hypot(y);
    assert!((radius - 2.0 * 0.9998000066665778).abs() < 1e-7, "{radius}"); // cos 0.02; eight digits in BODIES.DAT
}

#[test]
fn an_end_before_the_state_is_rejected() {
    let run = Case::from_scene(&cloud(4, 0.1, 1, "dt: 8.0, steps: 2")).solved(&[]);
    let exit_code = |end: f64, keep: bool| {
        let changes = format!("(keep_time: {keep}, compute: (dt: 8.0, end_time: {end}))");
        from_outbox(run.path(), Case::empty().path(), &changes)
    };
    assert_eq!([exit_code(8.0, true), exit_code(8.0, false), exit_code(16.0, true)], [2, 0, 0]);
}

/// A cylinder that moves by a force gets the law of its pairs with plates.
#[test]
fn a_new_press_touches_the_floor() {
    let scene = r#"(
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
        grains: [(
            material: "ROCKx",
            colour: "BLUEx",
            sizes: Single(0.1),
            placement: List(positions: [(0.0, 0.0, 0.5)]),
        )],
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, 0.0), half_lengths: (1.0, 1.0, 0.1))],
        compute: (dt: 1.0e-3, steps: 1),
    )"#;
    let run = Case::from_scene(scene).solved(&[]);
    let changes = |force: &str| {
        format!(
            r#"(
                walls: [Cylinder(material: "ROCKx", colour: "PRESS", centre: (0.0, 0.0, 2.0), half_height: 0.1,
                    radius: 0.1, {force})],
                contacts: [(between: ("PRESS", "WALLx"), law: "iqsc0"), (between: ("PRESS", "BLUEx"), law: "iqsc0")],
            )"#
        )
    };
    let case = next_case(&run, &changes("force: (None, None, Constant(-5.0))"));
    let tact = TactBehav::read(&case.datbox("TACT_BEHAV.DAT")).unwrap();
    let kinds = |row: &VisibilityRow| [&row.candidate, &row.antagonist].map(|side| side.contactor.clone());
    let of_press = tact.visibility.iter().filter(|row| row.candidate.colour == "PRESS").map(kinds);
    assert_eq!(of_press.collect::<Vec<_>>(), [["CYLND", "PLANx"].map(String::from)]);
    assert_eq!(from_outbox(run.path(), Case::empty().path(), &changes("")), 2);
}

#[test]
fn what_unfinished_solutions_have_left_is_made_good_in_the_next_run() {
    let scene = r#"(
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
        grains: [(
            material: "ROCKx",
            colour: "BLUEx",
            number: 40,
            sizes: Uniform(min: 0.3, max: 0.45),
            placement: RandomSequential(envelope: Box(lengths: (4.0, 4.0, 6.0))),
        )],
        walls: [Box(material: "ROCKx", colour: "WALLx", lengths: (4.4, 4.4, 6.4), half_thickness: 0.5)],
        compute: (
            dt: 0.01, steps: 120, penetration_tol: 1e-5, output_every: 20,
            events: [(time: 0.5, every: 0.05, action: Shake(speed: 1.0))],
        ),
    )"#;
    let unbroken = Case::from_scene(scene).solved(&[]);
    let left = unbroken.snapshot(100).meta.ledger.penetration_left;
    assert!(left > 1e-5, "{left}"); // or nothing is to be made good
    let case = next_case(&unbroken, "(bodies: [(snapshot: 100)], keep_time: true)").solved(&["--steps", "20"]);
    assert_eq!(bits(&case.snapshot(120)), bits(&unbroken.snapshot(120)));
}

/// Moves the vertices of all lone polyhedra in BODIES.DAT by 3 m along x, and their bodies back.
fn put_off_centre(case: &Case) {
    let file = case.datbox("BODIES.DAT");
    let mut bodies = Bodies::read(&file).unwrap();
    for body in &mut bodies.0 {
        if let [lone] = &mut body.contactors[..]
            && let ShapeRecord::Polyhedron { vertices, .. } = &mut lone.shape
        {
            vertices.iter_mut().for_each(|vertex| vertex[0] += 3.0);
            body.position[0] -= 3.0;
        }
    }
    fs::write(file, bodies.to_text()).unwrap();
}

/// Rocks that fall on two L's of two pieces each, which stand side by side; an event bonds them to each other and to
/// the floor before the first snapshot.
fn heap() -> Case {
    let scene = r#"(
        seed: 3,
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 1000.0)],
        laws: [(name: "mohr0", kind: IQS_MOHR_DS_CLB(normal_cohesion: 1.0e6, tangential_cohesion: 1.0e6, dynamic_friction: 0.5, static_friction: 0.5))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "mohr0"), (between: ("BLUEx", "FLOOR"), law: "mohr0")],
        grains: [
            (
                material: "ROCKx",
                colour: "BLUEx",
                number: 9,
                sizes: Single(0.4),
                shape: Random(vertices: (10, 14), ratios: (3.0, 2.0, 1.0)),
                placement: RandomSequential(envelope: Box(lengths: (6.0, 6.0, 5.0))),
                centre: (0.0, 0.0, 5.5),
                spin: (0.0, 0.0, 0.5),
            ),
            (
                material: "ROCKx",
                colour: "BLUEx",
                shape: Model(file: "l.obj", contact_shape: Files(["leg.obj", "foot.obj"])),
                grain_orientation: Same((axis: (0.0, 0.0, 1.0), angle: 0.0)),
                placement: List(positions: [(0.0, -0.5, 0.8334), (0.0, 0.5, 0.8334)]),
            ),
        ],
        walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0.0, 0.0, -0.1), half_lengths: (9.0, 9.0, 0.1))],
        compute: (dt: 0.01, steps: 120, output_every: 40, events: [(time: 0.1, action: Bond)]),
    )"#;
    Case::with_surfaces(scene, surfaces_of_an_l().path())
}

/// How many bonds hold.
fn bonds(snapshot: &Snapshot) -> usize {
    snapshot.memory.as_ref().unwrap().contact_bonded.iter().filter(|&&bonded| bonded == 1).count()
}

#[test]
fn rocks_and_clusters_go_on_bit_for_bit_and_keep_their_bonds() {
    let unbroken = heap();
    put_off_centre(&unbroken);
    let unbroken = unbroken.solved(&[]);
    let case = next_case(&unbroken, "(bodies: [(snapshot: 40)], keep_time: true)").solved(&["--steps", "80"]);
    for step in [40, 80, 120] {
        let (expected, found) = (unbroken.snapshot(step), case.snapshot(step));
        assert_eq!(bits(&found), bits(&expected), "step {step}");
        assert_eq!((found.shapes, found.memory), (expected.shapes, expected.memory), "step {step}");
    }
    let start = unbroken.snapshot(40);
    let parts = start.shapes.as_ref().unwrap().contacts.contact_rank.iter();
    let bonded = start.memory.as_ref().unwrap().contact_bonded.iter();
    assert!(parts.zip(bonded).any(|(pair, bonded)| *pair != [0, 0] && *bonded == 1), "no bond of a second piece");
    assert!(unbroken.snapshot(120).contacts.contact_body.iter().any(|&[a, b]| a < 9 && b < 11), "no rock touches");

    // Turned, the L's hold each other as before; without the floor those are all bonds.
    let of_ls = start.contacts.contact_body.iter().zip(&start.memory.as_ref().unwrap().contact_bonded);
    let of_ls = of_ls.filter(|([a, b], bonded)| *a < 11 && *b < 11 && **bonded == 1).count();
    let turn = "(bodies: [(snapshot: 40, walls: false, rotate: (axis: (1.0, 2.0, 3.0), angle: 2.0))])";
    let turned = next_case(&unbroken, turn).solved(&["--steps", "2"]);
    assert!(of_ls > 0 && of_ls == bonds(&turned.last_snapshot()), "{of_ls}, {}", bonds(&turned.last_snapshot()));

    // Rocks of twice the density, in free flight, continue to turn as fast. In a step of 0.01 s at 0.5 rad/s they turn
    // by 0.005, and their angular velocities change by as much of 0.5.
    let heavy = "(bodies: [(snapshot: 40)], materials: [(name: \"ROCKx\", density: 2000.0)])";
    let heavy = next_case(&unbroken, heavy).solved(&["--steps", "1"]).last_snapshot();
    for (w, before) in heavy.bodies.body_w_world.iter().zip(&start.bodies.body_w_world).take(9) {
        assert!(w.iter().zip(before).all(|(w, before)| (w - before).abs() < 0.0025), "{w:?} {before:?}");
    }
}

#[test]
fn cubes_with_vertices_off_their_centres_stand_where_they_are() {
    let scene = spheres("[(0.0, 0.0, 0.0)]", "").replace("sizes: Single(1.0)", "shape: Box(lengths: (1.0, 1.0, 1.0))");
    let from = Case::from_scene(&scene);
    put_off_centre(&from);
    // The balls about them have a radius of 0.87 m.
    let copies = "(bodies: [(), (centre: (2.0, 0.0, 0.0))])";
    let case = next_case(&from.solved(&[]), copies).solved(&["--steps", "1"]);
    let places = case.snapshot(0).bodies.body_x;
    assert!((places[0][0] - 0.125).abs() < 1e-12 && (places[1][0] - 2.0).abs() < 1e-12, "{places:?}");
}

#[test]
fn events_that_have_happened_do_not_come_again() {
    let events = "events: [
        (time: 0.5, action: SetGravity((0.0, 0.0, -0.25))),
        (time: 0.5, action: AddVelocity((1.0, 0.0, 0.0))),
        (time: 1.0, every: 0.75, action: AddVelocity((0.0, 1.0, 0.0))),
    ]";
    let unbroken = Case::from_scene(&spheres("[(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)]", events));
    let unbroken = unbroken.solved(&["--steps", "16", "--output-every", "1"]);
    let expected = unbroken.snapshot(16);
    // In 4 s four of those that are repeated; the pair turns by 1e-4 rad/s, 2.5 m from its middle.
    assert_eq!(expected.meta.parameters.events_done, 6);
    assert!((expected.bodies.body_v[0][1] - 4.0).abs() < 3e-4, "{:?}", expected.bodies.body_v[0]);
    // At 1.75 s one is about to happen, at 2 s it has; before 0.5 s none has.
    for step in [1, 7, 8] {
        for options in ["", "compute: (dt: 0.25, EVENTS)"] {
            let changes =
                format!("(bodies: [(snapshot: {step})], keep_time: true, {options})").replace("EVENTS", events);
            let case = next_case(&unbroken, &changes);
            // Stopped once in between.
            assert_eq!(case.solve(&["--steps", "2"]), 0);
            assert_eq!(case.solve(&["--steps", &(16 - step).to_string(), "--resume"]), 0);
            let found = case.snapshot(16);
            assert_eq!(bits(&found), bits(&expected), "from step {step}, {options}");
            assert_eq!(found.meta.parameters, expected.meta.parameters, "from step {step}, {options}");
        }
    }
    // From time 0 none has happened.
    let anew = next_case(&unbroken, &format!("(compute: (dt: 0.25, steps: 3, {events}))")).solved(&[]).last_snapshot();
    assert_eq!(anew.meta.parameters.events_done, 2);
    assert!((anew.bodies.body_v[0][0] - 2.5).abs() < 3e-4, "{:?}", anew.bodies.body_v[0]);
}

#[test]
fn what_events_have_set_holds_in_the_next_run() {
    let events = r#"events: [
        (time: 0.5, action: SetFriction("iqsc0", 0.7)),
        (time: 0.5, action: SetGravity((0.0, 0.0, -0.25))),
        (time: 0.5, action: SetQuench(0.1)),
        (time: 0.5, action: SetTorque((0.0, 0.0, 300.0))),
        (time: 1.75, action: SetFriction("iqsc0", 0.9)),
    ]"#;
    let unbroken = Case::from_scene(&spheres("[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]", events));
    let unbroken = unbroken.solved(&["--steps", "6", "--output-every", "1"]);
    let expected = unbroken.snapshot(6);
    assert_eq!(expected.meta.laws[0].parameters, [0.7]);
    let case = next_case(&unbroken, "(bodies: [(snapshot: 4)])").solved(&["--steps", "2"]);
    let found = case.last_snapshot();
    assert_eq!(bits(&found), bits(&expected));
    assert_eq!((&found.meta.laws, found.meta.parameters.events_done), (&expected.meta.laws, 1));
    // Before them nothing is set.
    let start = next_case(&unbroken, "(bodies: [(snapshot: 1)])").solved(&["--steps", "1"]).last_snapshot();
    assert_eq!((start.meta.laws[0].parameters[0], start.meta.parameters.quench), (0.3, 0.0));
}

/// A sphere with a radius of twelve digits on a floor whose table has more; events set a gravity and a friction of as many.
#[test]
fn numbers_of_many_digits_go_on() {
    let scene = |gravity: &str| {
        let table = "[(0.0, 0.0), (0.3333333333333333, 0.012345678901234), (200000.001, 0.1), (200000.002, 0.0)]";
        spheres("[(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)]", &format!("output_every: 1, events: [(time: 0.5, action: SetGravity((0.0, 0.0, {gravity}))), (time: 0.5, action: SetFriction(\"iqsc0\", 0.33333333333))]"))
            .replace("law: \"iqsc0\")]", "law: \"iqsc0\"), (between: (\"BLUEx\", \"FLOOR\"), law: \"iqsc0\")]")
            .replace("compute:", &format!("walls: [Plate(material: \"ROCKx\", colour: \"FLOOR\", centre: (0, 0, -1.75), half_lengths: (9, 9, 0.5), velocity: (Constant(0), Constant(0), Table({table})))], compute:"))
    };
    let solved = |gravity: &str| {
        let case = Case::from_scene(&scene(gravity));
        let bodies = fs::read_to_string(case.datbox("BODIES.DAT")).unwrap();
        fs::write(case.datbox("BODIES.DAT"), bodies.replacen("= 1.0000000E+00\n", "= 1.12345678901\n", 2)).unwrap();
        case.solved(&["--steps", "8"])
    };
    let unbroken = solved("-1.2345678901");
    let changes = "(bodies: [(snapshot: 4)], keep_time: true, compute: (dt: 0.25))";
    let case = next_case(&unbroken, changes).solved(&["--steps", "4", "--output-every", "1"]);
    let [expected, found] = [&unbroken, &case].map(Case::last_snapshot);
    assert!(expected.contacts.contact_impulse.iter().any(|r| r[0] > 0.0), "nothing touches");
    assert_eq!(bits(&found), bits(&expected));
    assert_eq!((found.bodies.body_radius, found.meta.laws), (expected.bodies.body_radius, expected.meta.laws));
    let [table, copy] = [&unbroken, &case].map(|case| fs::read(case.datbox("evolution-1.dat")).unwrap());
    assert_eq!(table, copy);

    // Nine digits below a thousandth are one too many.
    let message = |gravity: &str| {
        let (case, file) = (Case::empty(), unbroken.path().join("changes.ron"));
        fs::write(&file, changes).unwrap();
        cd_pre::from_outbox::write_datbox(solved(gravity).path(), Some(&file), &[], case.path()).unwrap()
    };
    let note = "BULK_BEHAV.DAT: gravity: grv3 -0.000123456789 is written as -1.2345679E-04, the largest number of digits that fits its columns\n";
    assert!(message("-1.23456789e-4").contains(note));
    assert!(!message("-1.2345678901").contains("is written as"));
}

#[test]
fn what_moves_as_a_whole_is_solved_as_if_at_rest() {
    let from = collapse().solved(&[]);
    let contacts = |changes: &str| {
        let case = next_case(&from, changes).solved(&["--steps", "5"]);
        let table = fs::read_to_string(case.path().join("OUTBOX/steps.csv")).unwrap();
        let listed = |row: &str| row.split(',').nth(2).unwrap().parse::<usize>().unwrap();
        table.lines().skip(1).map(listed).collect::<Vec<_>>()
    };
    assert_eq!(
        contacts("(bodies: [(velocity: (4000.0, 0.0, 0.0))])"),
        contacts("(bodies: [(remove_motion: Translation)])")
    );
}

/// The new and the old number of each body.
fn origin(case: &Case) -> Vec<(u64, u64)> {
    let text = fs::read_to_string(case.datbox("ORIGIN.csv")).unwrap();
    let line = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        (fields[0].parse().unwrap(), fields[3].parse().unwrap())
    };
    text.lines().skip(1).map(line).collect()
}

/// Spheres of 1 m that rest where they are; `positions` in RON.
fn spheres(positions: &str, compute: &str) -> String {
    format!(
        r#"(
            materials: [(name: "ROCKx", density: 3000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.3))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(
                material: "ROCKx",
                colour: "BLUEx",
                sizes: Single(1.0),
                placement: List(positions: {positions}),
                velocity: (0.5, 0.0, 0.0),
                spin: (0.0, 0.0, 1.0e-4),
            )],
            compute: (dt: 0.25, steps: 1, {compute}),
        )"#
    )
}

/// A primary that responds continues with the run, and begins anew if time, masses or the orbit do.
#[test]
fn a_response_of_the_primary_continues() {
    let field = |mass: &str| {
        format!(
            "fields: [PointMass(mass: {mass}, orbit: Elements(semi_major_axis: 1.0e3, eccentricity: 0.1), response: true)]"
        )
    };
    let options = format!("gravity_constant: 1.0e-6, output_every: 20, {}", field("1.0e9"));
    let unbroken =
        Case::from_scene(&spheres("[(30.0, 0.0, 5.0), (0.0, -20.0, 0.0)]", &options)).solved(&["--steps", "40"]);
    let response = |snapshot: Snapshot| snapshot.meta.primary_response.unwrap();
    let [before, expected] = [20, 40].map(|step| response(unbroken.snapshot(step)));
    assert!(before.displacement.iter().chain(&before.velocity).all(|x| *x != 0.0), "{before:?}");
    let whole = "bodies: [(snapshot: 20)], keep_time: true";
    assert!(!next_summary(&unbroken, &format!("({whole})")).contains("responds"));
    let case = next_case(&unbroken, &format!("({whole})")).solved(&["--steps", "20"]);
    assert_eq!(bits(&case.snapshot(40)), bits(&unbroken.snapshot(40)));
    assert_eq!((response(case.snapshot(20)), response(case.snapshot(40))), (before, expected));

    let heavy = "materials: [(name: \"ROCKx\", density: 6000.0)]";
    let other_orbit = format!("compute: (dt: 0.25, gravity_constant: 1.0e-6, {})", field("2.0e9"));
    let without_one = "bodies: [(snapshot: 20, select: Below(2.0))], keep_time: true".to_string();
    for (changes, mass_ratio) in [
        ("bodies: [(snapshot: 20)]".to_string(), 1.0),
        (format!("{whole}, {heavy}"), 2.0),
        (format!("{whole}, {other_orbit}"), 1.0),
        (without_one, 0.5),
    ] {
        let changes = format!("({changes})");
        let text = next_summary(&unbroken, &changes);
        assert_eq!(
            text.contains("the primary that responds begins on its orbit, "),
            changes.contains("keep_time"),
            "{text}"
        );
        let case = next_case(&unbroken, &changes).solved(&["--steps", "1"]);
        let first = &snapshot::list_snapshots(&case.outbox()).unwrap()[0].1;
        let anew = response(Snapshot::read(first).unwrap());
        assert_eq!((anew.displacement, anew.velocity), ([0.0; 3], [0.0; 3]), "{changes}");
        assert!((anew.bodies_mass / before.bodies_mass / mass_ratio - 1.0).abs() < 1e-12, "{changes}");
    }
}

/// Surfaces of fields are copied to the next DATBOX, from that of the run or from next to the changes.
#[test]
fn surfaces_of_fields_come_along() {
    let l = surfaces_of_an_l();
    let fields = "fields: [Polyhedron(surface: \"l.obj\", scale: 3.3, density: 1.0e9, position: (0.1, 12.3, 0.7)), \
                  Polyhedron(surface: \"leg.obj\", density: 1.0e9, position: (-7.0, 0.0, 0.0))]";
    let unbroken =
        Case::with_surfaces(&spheres("[(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)]", fields), l.path()).solved(&["--steps", "6"]);
    let first = next_case(&unbroken, "(bodies: [(snapshot: 0)], keep_time: true)").solved(&["--steps", "3"]);
    // The folder of the first run is not needed any more, nor are the surfaces of the scene.
    let second = next_case(&first, "(keep_time: true)").solved(&["--steps", "3"]);
    assert_eq!(bits(&second.snapshot(6)), bits(&unbroken.snapshot(6)));
    for name in ["l.obj", "leg.obj"] {
        let [copy, of_run] = [&second, &unbroken].map(|case| fs::read(case.datbox(name)).unwrap());
        assert_eq!(copy, of_run, "{name}");
    }
    // cd-post reads them, too.
    assert_eq!(second.series()["E_fields"].len(), second.series()["time"].len());

    let other = Case::empty();
    fs::copy(l.path().join("foot.obj"), other.path().join("foot.obj")).unwrap();
    let changes = "(compute: (dt: 0.25, fields: [Polyhedron(surface: \"foot.obj\", density: 1.0e9)]))";
    assert_eq!(from_outbox(unbroken.path(), other.path(), changes), 0);
    assert!(other.datbox("foot.obj").exists() && !other.datbox("l.obj").exists());
    assert_eq!(other.solve(&["--steps", "1"]), 0);
    let changes = "(compute: (dt: 0.25, fields: [Polyhedron(surface: \"none.obj\", density: 1.0e9)]))";
    let missing = Case::empty();
    assert_eq!(from_outbox(unbroken.path(), missing.path(), changes), 2);
    assert!(!missing.path().join("DATBOX").exists());
}

/// A pair that gravity holds together, and a sphere far away.
fn pair_and_one() -> Case {
    let positions = "[(100.0, 0.0, 0.0), (0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]";
    Case::from_scene(&spheres(positions, "self_gravity: true")).solved(&[])
}

#[test]
fn attractions_of_pairs_are_kept() {
    let law = "IQS_COH_DS_CLB(cohesive_stress: 2.0, full_range: 0.1, range: 0.1, dynamic_friction: 0.3, static_friction: 0.3)";
    let scene = spheres("[(100.0, 0.0, 0.0), (0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]", "");
    let (before, behind) = scene.split_once("IQS_CLB(").unwrap();
    let from = Case::from_scene(&format!("{before}{law}{}", behind.split_once(')').unwrap().1)).solved(&[]);
    let case = next_case(&from, "()").solved(&[]);
    let attraction = |path: std::path::PathBuf| Snapshot::read(&path).unwrap().attractions.unwrap().contact_attraction;
    // R = 1/2 m.
    let force = 2.0 * std::f64::consts::PI * 0.25;
    for path in [case.datbox("START.npz"), case.path().join("OUTBOX/snapshot-000000.npz")] {
        let found: f64 = attraction(path).iter().sum();
        assert!((found - force).abs() < 1e-12, "{found}");
    }
}

#[test]
fn the_largest_remnant_is_kept_and_moved() {
    let from = pair_and_one();
    let changes = "(bodies: [(select: Largest, remove_motion: RigidMotion, centre: (1.0, 2.0, 3.0), \
                   rotate: (axis: (0.0, 0.0, 1.0), angle: 1.5707963267948966), spin: (1.0e-4, 0.0, 0.0), \
                   velocity: (0.0, 0.0, 0.25))])";
    let case = next_case(&from, &changes.replace('\\', ""));
    assert_eq!(origin(&case), [(1, 2), (2, 3)]);
    let start = Snapshot::read(&case.datbox("START.npz")).unwrap();
    // In its one step of a quarter second the pair has turned by 2.5e-5, and gravity has given it 1e-7 m/s.
    let close = |found: [f64; 3], expected: [f64; 3]| {
        let distance = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(distance < 1e-4, "{found:?} {expected:?}");
    };
    let slow = |found: [f64; 3], expected: [f64; 3]| {
        let distance = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(distance < 1e-6, "{found:?} {expected:?}");
    };
    // Along x before, along y after the quarter turn; v = (0, 0, 1/4) + spin x arm.
    close(start.bodies.body_x[0], [1.0, 1.0, 3.0]);
    close(start.bodies.body_x[1], [1.0, 3.0, 3.0]);
    slow(start.bodies.body_v[0], [0.0, 0.0, 0.25 - 1e-4]);
    slow(start.bodies.body_v[1], [0.0, 0.0, 0.25 + 1e-4]);
    slow(start.bodies.body_w_world[1], [1e-4, 0.0, 0.0]);
    // Their contact is kept and turned: from body 1 to body 2, or back.
    assert_eq!(start.contacts.contact_body.len(), 1);
    // Where it was found, half a step back: 1/16 m at 1/2 m/s, and what the spin of all three adds, below a millimetre.
    let p = start.contacts.contact_point[0];
    assert!((p[0] - 1.0).abs() < 1e-3 && (p[1] - 1.9375).abs() < 1e-3 && p[2] == 3.0, "{p:?}");
    let n = start.contacts.contact_frame[0][0];
    close([n[0], n[1].abs(), n[2]], [0.0, 1.0, 0.0]);
    case.solved(&["--steps", "2"]);
}

#[test]
fn a_copy_an_impactor_and_other_laws_come_together() {
    let from = pair_and_one();
    let changes = r#"(
        bodies: [
            (select: Largest, remove_motion: Translation, centre: (1.0, 0.0, 0.0)),
            (select: Largest, remove_motion: Translation, centre: (10.0, 0.5, 0.0), velocity: (-0.1, 0.0, 0.0), colour: "REDxx"),
        ],
        grains: [(material: "IRONx", colour: "IRONx", sizes: Single(0.5), placement: List(positions: [(0.0, 0.0, 9.0)]), velocity: (0.0, 0.0, -2.0))],
        materials: [(name: "IRONx", density: 7800.0)],
        laws: [(name: "wet00", kind: IQS_WET_DS_CLB(cohesion: 10.0, range: 0.5, dynamic_friction: 0.3, static_friction: 0.4))],
        contacts: [
            (between: ("BLUEx", "BLUEx"), law: "wet00"),
            (between: ("BLUEx", "REDxx"), law: "iqsc0"),
            (between: ("BLUEx", "IRONx"), law: "iqsc0"),
            (between: ("REDxx", "IRONx"), law: None),
            (between: ("IRONx", "IRONx"), law: None),
        ],
        compute: (dt: 0.125, steps: 8, self_gravity: true),
    )"#;
    let case = next_case(&from, changes);
    let bodies = Bodies::read(&case.datbox("BODIES.DAT")).unwrap().0;
    let colours: Vec<&str> = bodies.iter().map(|body| body.contactors[0].colour.as_str()).collect();
    assert_eq!(colours, ["BLUEx", "BLUEx", "REDxx", "REDxx", "IRONx"]);
    let rows = TactBehav::read(&case.datbox("TACT_BEHAV.DAT")).unwrap().visibility;
    let law = |a: &str, b: &str| {
        let of = rows.iter().find(|row| (row.candidate.colour.as_str(), row.antagonist.colour.as_str()) == (a, b));
        of.map(|row| (row.law.as_str(), row.alert))
    };
    // The range of the law is the least alert.
    assert_eq!(law("BLUEx", "BLUEx"), Some(("wet00", 0.5)));
    assert_eq!(law("REDxx", "REDxx").unwrap().0, "iqsc0");
    assert_eq!(law("BLUEx", "REDxx").unwrap().0, "iqsc0");
    assert_eq!(law("IRONx", "REDxx"), None);
    let case = case.solved(&[]);
    let last = case.last_snapshot();
    assert_eq!(last.bodies.body_id, [1, 2, 3, 4, 5]);
    assert!((last.bodies.body_x[4][2] - 7.0).abs() < 1e-3); // 9 - 2 * 1 s
    assert!((last.bodies.body_x[2][0] - last.bodies.body_x[0][0] - 8.9).abs() < 1e-2);
}

#[test]
fn a_sampler_moves_as_imposed() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "")).solved(&[]);
    let sampler = |motion: &str| {
        let contacts = r#"[(between: ("BLUEx", "IRONx"), law: "iqsc0")]"#;
        format!(
            r#"(bodies: [(remove_motion: All)], materials: [(name: "IRONx", density: 7800.0)], contacts: {contacts}, compute: (dt: 0.25, steps: 8),
               grains: [(material: "IRONx", colour: "IRONx", sizes: Single(0.5), placement: List(positions: [(0.0, 0.0, 2.75)]), {motion})])"#
        )
    };
    let down = "driven: (Constant(0.0), Constant(0.0), Table([(0.0, -1.0), (1.0, -1.0), (2.0, 0.0)]))";
    let last = next_case(&from, &sampler(down)).solved(&[]).last_snapshot();
    // 1 m in the first second, half a metre in the next, while it slows down.
    assert_eq!(last.bodies.body_driven, [0, 63]);
    assert!((last.bodies.body_x[1][2] - 1.25).abs() < 1e-9, "{:?}", last.bodies.body_x[1]);
    assert_eq!(last.bodies.body_v[1], [0.0; 3]);
    // It has pushed the other, whose centre is less than a metre and a half below its own at first.
    assert!(last.bodies.body_x[0][2] < -0.2, "{:?}", last.bodies.body_x[0]);
    let both = format!("velocity: (0.0, 0.0, 1.0), {down}");
    expect_rejection(from.path(), &sampler(&both));
}

#[test]
fn new_bodies_meet_old_ones_of_their_colour_and_another_shape() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "")).solved(&[]);
    let changes = r#"(
        bodies: [(remove_motion: All)],
        grains: [(material: "ROCKx", colour: "BLUEx", shape: Cube, sizes: Single(1.0), grain_orientation: Same((axis: (0, 0, 1), angle: 0)),
            placement: List(positions: [(0.125, 0.0, 3.0), (9.0, 0.0, 0.0)]), velocity: (0.0, 0.0, -1.0))],
        compute: (dt: 0.01, steps: 200),
    )"#;
    let case = next_case(&from, changes);
    let rows = TactBehav::read(&case.datbox("TACT_BEHAV.DAT")).unwrap().visibility;
    let names: Vec<_> =
        rows.iter().map(|row| [&row.candidate, &row.antagonist].map(|side| &side.contactor[..])).collect();
    assert_eq!(names, [["SPHER", "SPHER"], ["POLYR", "POLYR"], ["SPHER", "POLYR"]]);
    assert!(rows.iter().all(|row| (&row.law, row.alert) == (&rows[0].law, rows[0].alert)), "{rows:?}");
    // As heavy as the sphere, half of its side 0.81 m: they meet after 1.2 s, and both continue at half the speed.
    let speeds = case.solved(&[]).last_snapshot().bodies.body_v;
    assert!((speeds[0][2] + 0.5).abs() < 1e-6 && (speeds[1][2] + 0.5).abs() < 1e-6, "{speeds:?}");
}

#[test]
fn new_bodies_wear_the_colour_of_some_that_were_left_behind() {
    let scene = spheres("[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]", "").replace(
        "            )],",
        r#"            ), (material: "ROCKx", colour: "REDxx", sizes: Single(0.5), placement: List(positions: [(50.0, 0.0, 0.0)]))],"#,
    );
    let law = r#"contacts: [(between: ("BLUEx", "REDxx"), law: "iqsc0", alert: 0.25), (between: ("REDxx", "REDxx"), law: "iqsc0", alert: 0.5),"#;
    let from = Case::from_scene(&scene.replace("contacts: [", law)).solved(&[]);
    let red =
        r#"material: "ROCKx", colour: "REDxx", sizes: Single(0.5), placement: List(positions: [(0.0, 9.0, 0.0)])"#;
    let case = next_case(&from, &format!("(bodies: [(select: Largest)], grains: [({red})])"));
    let rows = TactBehav::read(&case.datbox("TACT_BEHAV.DAT")).unwrap().visibility;
    let alert = |a: &str, b: &str| {
        let row = rows.iter().find(|row| (&row.candidate.colour[..], &row.antagonist.colour[..]) == (a, b));
        row.map(|row| row.alert)
    };
    assert_eq!((alert("BLUEx", "REDxx"), alert("REDxx", "REDxx")), (Some(0.25), Some(0.5)));
    // Where nobody wears it, its rows are gone.
    let without = next_case(&from, "(bodies: [(select: Largest)])");
    let rows = TactBehav::read(&without.datbox("TACT_BEHAV.DAT")).unwrap().visibility;
    assert_eq!(rows.len(), 1);
}

#[test]
fn a_lander_of_another_shape_comes_to_rest_on_what_was_there() {
    let scene = r#"(
        gravity: (0.0, 0.0, -1.0),
        materials: [(name: "ROCKx", density: 3000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.3))],
        contacts: [(between: ("BLUEx", "FLOOR"), law: "iqsc0"), (between: ("BLUEx", "BLUEx"), law: None)],
        grains: [(material: "ROCKx", colour: "BLUEx", sizes: Single(0.5), placement: List(positions: [(5, 0, 0.5)]))],
        walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0, 0, -0.5), half_lengths: (20, 20, 0.5))],
        compute: (dt: 0.01, steps: 10),
    )"#;
    let from = Case::from_scene(scene).solved(&[]);
    let changes = r#"(
        grains: [(material: "STEEL", colour: "LANDx", shape: Box(lengths: (1.0, 1.2, 0.6)), grain_orientation: Same((axis: (0, 0, 1), angle: 0.5)), placement: List(positions: [(0.0, 0.0, 1.0)]))],
        materials: [(name: "STEEL", density: 7800.0)],
        contacts: [(between: ("LANDx", "FLOOR"), law: "iqsc0"), (between: ("LANDx", "BLUEx"), law: "iqsc0"), (between: ("LANDx", "LANDx"), law: None)],
        compute: (dt: 0.01, end_time: 4.0),
    )"#;
    let case = next_case(&from, changes).solved(&[]);
    let last = case.last_snapshot();
    assert_eq!(last.bodies.body_driven, [0, 63, 0]);
    assert!((last.bodies.body_mass[2] - 7800.0 * 0.72).abs() < 1e-6, "{}", last.bodies.body_mass[2]);
    // Half its height above the floor, but for what it goes in within the step of the impact: 1.2 m/s for 0.01 s.
    assert!((last.bodies.body_x[2][2] - 0.3).abs() < 0.012, "{:?}", last.bodies.body_x[2]);
    assert!(last.bodies.body_v[2].iter().all(|v| v.abs() < 1e-3), "{:?}", last.bodies.body_v[2]);
}

#[test]
fn walls_stay_where_they_are_with_their_motion() {
    let scene = r#"(
        gravity: (0.0, 0.0, -1.0),
        materials: [(name: "ROCKx", density: 3000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.3))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "FLOOR"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", sizes: Single(1.0), placement: List(positions: [(0, 0, 1), (5, 0, 1)]))],
        walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0, 0, -0.5), half_lengths: (20, 20, 0.5),
            velocity: (Constant(0), Constant(0), Table([(0, 0), (1, 0.1), (9, 0.1)])))],
        compute: (dt: 0.01, steps: 200, output_every: 50),
    )"#;
    let unbroken = Case::from_scene(scene).solved(&[]);
    let case = next_case(&unbroken, "(bodies: [(snapshot: 100)], keep_time: true)").solved(&["--steps", "100"]);
    assert_eq!(bits(&case.snapshot(200)), bits(&unbroken.snapshot(200)));
    let without = next_case(&unbroken, "(bodies: [(walls: false)])");
    assert_eq!(Bodies::read(&without.datbox("BODIES.DAT")).unwrap().0.len(), 2);
    assert!(!files(&without.path().join("DATBOX")).iter().any(|name| name.starts_with("evolution")));
}

#[test]
fn a_drum_holds_new_grains() {
    let scene = spheres("[(0.0, 0.0, 0.0)]", "")
        .replace("law: \"iqsc0\")]", "law: \"iqsc0\"), (between: (\"BLUEx\", \"DRUMx\"), law: \"iqsc0\")]")
        .replace("compute:", "walls: [Plate(material: \"ROCKx\", colour: \"DRUMx\", centre: (0, 0, -20), half_lengths: (1, 1, 1))], compute:");
    let from = Case::from_scene(&scene);
    let mut bodies = Bodies::read(&from.datbox("BODIES.DAT")).unwrap();
    let drum = &mut bodies.0[1];
    drum.contactors[0].shape = ShapeRecord::Cylinder { half_height: 4.0, radius: 3.0, hollow: true };
    (drum.position, drum.equivalent_radius, drum.inertia) = ([0.0; 3], 0.0, None);
    fs::write(from.datbox("BODIES.DAT"), bodies.to_text()).unwrap();
    let tact = fs::read_to_string(from.datbox("TACT_BEHAV.DAT")).unwrap();
    fs::write(from.datbox("TACT_BEHAV.DAT"), tact.replace("PLANx", "DNLYC")).unwrap();
    let from = from.solved(&[]);
    let grain = |place: &str| {
        format!(
            "(grains: [(material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(0.5), placement: List(positions: [{place}]))])"
        )
    };
    next_case(&from, &grain("(2.4, 0.0, 0.0)")).solved(&["--steps", "1"]);
    expect_rejection(from.path(), &grain("(0.0, 2.6, 0.0)"));
    expect_rejection(from.path(), &grain("(0.0, 0.0, -3.6)"));
}

/// A sphere that has come to rest on a floor gets a plate on top, pushed by a force.
#[test]
fn what_has_settled_is_pressed() {
    let scene = r#"(
        gravity: (0.0, 0.0, -10.0),
        materials: [(name: "ROCKx", density: 1000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "FLOOR"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", sizes: Single(0.5), placement: List(positions: [(0.0, 0.0, 0.5)]))],
        walls: [Plate(material: "ROCKx", colour: "FLOOR", centre: (0.0, 0.0, -0.5), half_lengths: (2.0, 2.0, 0.5))],
        compute: (dt: 0.01, steps: 5),
    )"#;
    let from = Case::from_scene(scene).solved(&[]);
    let press = |height: f64, law: &str| {
        format!(
            "(walls: [Plate(material: \"STEEL\", colour: \"PRESS\", centre: (0, 0, {height}), half_lengths: (1, 1, 0.1), \
             force: (None, None, Constant(-500.0)))], materials: [(name: \"STEEL\", density: 8000.0)], \
             contacts: [(between: (\"BLUEx\", \"PRESS\"), law: {law})])"
        )
    };
    let case = next_case(&from, &press(1.1, "\"iqsc0\"")).solved(&["--steps", "20", "--tol", "1e-10"]);
    let end = case.last_snapshot();
    let [sphere, plate] = [0, 2].map(|k| end.bodies.body_mass[k]);
    let pushed = |body: u32| {
        let of = (0..end.contacts.contact_body.len()).filter(|&k| end.contacts.contact_body[k] == [0, body]);
        of.map(|k| end.contacts.contact_force[k][0]).sum::<f64>()
    };
    // Its weight and the force; that and the sphere's weight on the floor.
    assert!((pushed(2) / (500.0 + 10.0 * plate) - 1.0).abs() < 1e-6, "{}", pushed(2));
    assert!((pushed(1) / (500.0 + 10.0 * (plate + sphere)) - 1.0).abs() < 1e-6, "{}", pushed(1));
    // In the sphere, and without a law.
    expect_rejection(from.path(), &press(1.0, "\"iqsc0\""));
    expect_rejection(from.path(), &press(1.1, "\"other\""));
    expect_rejection(from.path(), &press(1.1, "\"iqsc0\"").replace("STEEL\", colour", "OTHER\", colour"));
    expect_rejection(
        from.path(),
        &press(1.1, "\"iqsc0\"").replace("between: (\"BLUEx\", \"PRESS\")", "between: (\"BLUEx\", \"BLUEx\")"),
    );
}

#[test]
fn images_of_a_scene_that_repeats_are_not_overlapped() {
    let scene = spheres("[(0.0, 0.0, 0.0)]", "xperiode: 20.0").replace("(0.0, 0.0, 1.0e-4)", "(1.0e-4, 0.0, 0.0)");
    let from = Case::from_scene(&scene).solved(&[]);
    let grain = |x: f64| {
        format!(
            "(grains: [(material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(1.0), placement: List(positions: [({x}, 0.0, 0.0)]))])"
        )
    };
    next_case(&from, &grain(10.0));
    expect_rejection(from.path(), &grain(19.0));
    expect_rejection(from.path(), &grain(-41.0));
    // A period that its own bodies have not had.
    let pair = pair_and_one();
    expect_rejection(pair.path(), "(compute: (dt: 0.25, steps: 1, xperiode: 50.0))");
    next_case(&pair, "(compute: (dt: 0.25, steps: 1, xperiode: 110.0))");
}

#[test]
fn motion_is_taken_away_with_the_new_masses() {
    let one = "material: \"ROCKx\",\n                colour: \"BLUEx\",";
    let scene = spheres("[(0.0, 0.0, 0.0)]", "")
        .replace("density: 3000.0)", "density: 3000.0), (name: \"IRONx\", density: 3000.0)")
        .replace("spin: (0.0, 0.0, 1.0e-4),\n            )", "), (material: \"IRONx\", colour: \"BLUEx\", sizes: Single(1.0), placement: List(positions: [(0.0, 9.0, 0.0)]))");
    assert!(scene.contains(one) && scene.contains("9.0"), "{scene}");
    let from = Case::from_scene(&scene).solved(&[]);
    let case =
        next_case(&from, "(bodies: [(remove_motion: Translation)], materials: [(name: \"IRONx\", density: 9000.0)])");
    let start = Snapshot::read(&case.datbox("START.npz")).unwrap().bodies;
    let last = case.solved(&[]).last_snapshot().bodies;
    // One part of four moves at 1/2 m/s.
    for bodies in [start, last] {
        assert!((bodies.body_v[0][0] - 0.375).abs() < 1e-15 && (bodies.body_v[1][0] + 0.125).abs() < 1e-15);
        assert!((bodies.body_mass[1] / bodies.body_mass[0] - 3.0).abs() < 1e-15);
    }
}

#[test]
fn options_that_are_set_leave_the_others() {
    let from = pair_and_one();
    let case = Case::empty();
    let set = ["compute.dt=0.125".to_string(), "compute.steps=7".to_string()];
    cd_pre::from_outbox::write_datbox(from.path(), None, &set, case.path()).unwrap();
    let options = Compute::read(&case.datbox("COMPUTE.RON")).unwrap();
    assert_eq!((options.dt, options.steps, options.self_gravity), (0.125, Some(7), true));
    let wrong = cd_pre::from_outbox::write_datbox(from.path(), None, &["compute.dt=-1".to_string()], case.path());
    assert!(wrong.unwrap_err().to_string().contains("set compute.dt=-1"));
}

/// Messages of cd-pre about a case without changes, with other values as in `--set`, and the options that it writes.
fn options_after(from: &Case, set: &[&str]) -> (String, Compute) {
    let case = Case::empty();
    let set: Vec<String> = set.iter().map(|setting| setting.to_string()).collect();
    let message = cd_pre::from_outbox::write_datbox(from.path(), None, &set, case.path()).unwrap();
    (message, Compute::read(&case.datbox("COMPUTE.RON")).unwrap())
}

#[test]
fn flags_of_the_run_are_options_of_the_next() {
    let positions = "[(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]";
    let flags = "--dt 0.5 --theta 1.0 --self-gravity --gravity-constant 1e-9 --gravity direct --quench=0.1 \
                 --gravity-quadrupole --accuracy fine --tol 0.5 --max-sweeps 77 --solver nlgs --alert 0.25 --gravity-error 0.01 --output-every 1";
    let fields = "[PointMass(mass: 1e10, position: (100.0, 0.0, 0.0))]";
    let mut flags: Vec<&str> = flags.split_whitespace().collect();
    flags.extend(["--fields", fields]);
    for with_file in [true, false] {
        let from = Case::from_scene(&spheres(positions, "threads: 1"));
        if !with_file {
            fs::remove_file(from.datbox("COMPUTE.RON")).unwrap();
            fs::remove_file(from.datbox("SHA256SUMS")).unwrap();
        }
        let from = from.solved(&[&flags[..], &["--steps", "4"]].concat());
        let (message, options) = options_after(&from, &[]);
        assert_eq!((options.dt, options.theta, options.quench, options.steps), (0.5, 1.0, 0.1, None));
        assert!(options.self_gravity && options.gravity_quadrupole);
        // What it does not know is of the file, or the default.
        assert_eq!((options.threads, options.output_every), (usize::from(with_file), 100));
        let dt = if with_file { "COMPUTE.RON has 0.25" } else { "the default is 0.001" };
        for note in [&format!("dt: 0.5 as in the run; {dt}"), "self_gravity: true as in the run; ", "fields: [Point"] {
            assert!(message.contains(note), "{note}: {message}");
        }
        assert!(!message.contains("threads") && !message.contains("events"), "{message}");
        let (case, expected) =
            (next_case(&from, "(bodies: [(snapshot: 3)])").solved(&["--steps", "1"]), from.last_snapshot());
        let found = case.last_snapshot();
        assert_eq!(found.meta.parameters, expected.meta.parameters);
        assert_eq!(bits(&found), bits(&expected));
        // What is extrapolated begins anew.
        let further = [&flags[..], &["--gravity-refresh", "4", "--gravity-moved", "0.5", "--resume", "--steps", "5"]];
        assert_eq!(from.solve(&further.concat()), 0);
        let options = options_after(&from, &[]).1;
        assert_eq!((options.gravity_refresh, options.gravity_moved), (Some(4), 0.5));
    }
}

#[test]
fn changes_win_over_the_flags_of_the_run() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "")).solved(&["--dt", "0.5", "--theta", "1.0"]);
    let (message, options) = options_after(&from, &["compute.dt=0.125"]);
    assert_eq!((options.dt, options.theta), (0.125, 1.0));
    assert!(
        message.contains("theta: 1.0 as in the run; COMPUTE.RON has 0.5") && !message.contains("dt: "),
        "{message}"
    );
    let case = next_case(&from, "(compute: (dt: 0.0625))");
    let options = Compute::read(&case.datbox("COMPUTE.RON")).unwrap();
    assert_eq!((options.dt, options.theta), (0.0625, 0.5));
}

#[test]
fn options_that_accuracy_decides_stay_open() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "accuracy: draft, adaptive: (max_multiple: 1)"))
        .solved(&["--accuracy", "fine"]);
    let (message, options) = options_after(&from, &[]);
    let file = Compute::read(&from.datbox("COMPUTE.RON")).unwrap();
    assert_eq!(options, Compute { accuracy: Some(cd_formats::compute::Accuracy::Fine), steps: None, ..file });
    assert_eq!(message.matches("as in the run").count(), 1, "{message}");
}

#[test]
fn of_steps_of_several_lengths_the_shortest_is_not_known() {
    // Two steps of 0.25 s, then one of two of these.
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "adaptive: (max_multiple: 4), end_time: 5.0"))
        .solved(&["--steps", "8"]);
    let h = from.last_snapshot().meta.h;
    assert!(h > 0.25, "{h}");
    let (message, options) = options_after(&from, &[]);
    assert!(options.dt == 0.25 && !message.contains("dt: "), "{message}");
    let mut file = Compute::read(&from.datbox("COMPUTE.RON")).unwrap();
    file.dt = 0.2;
    fs::write(from.datbox("COMPUTE.RON"), file.to_text()).unwrap();
    let (message, options) = options_after(&from, &[]);
    assert!(options.dt == 0.2 && message.contains("dt: 0.2 as in DATBOX; the last step of the run, "), "{message}");
    assert!(!options_after(&from, &["compute.dt=0.25"]).0.contains("dt: "));
}

#[test]
fn a_start_has_the_step_of_the_run_before() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "")).solved(&[]);
    let case = next_case(&from, "(compute: (dt: 0.125, steps: 2))").solved(&["--output-every", "1"]);
    let of_step = |step: u64| {
        let to = Case::empty();
        assert_eq!(from_outbox(case.path(), to.path(), &format!("(bodies: [(snapshot: {step})])")), 0);
        Compute::read(&to.datbox("COMPUTE.RON")).unwrap().dt
    };
    assert_eq!([0, 1].map(of_step), [0.125; 2]);
}

#[test]
fn events_and_gravity_that_datbox_has_not_are_reported() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", ""));
    let events = "[(time: 0.25, action: SetGravity((0.0, 0.0, -0.5))), (time: 0.5, action: SetQuench(0.25))]";
    let from = from.solved(&["--steps", "4", "--events", events]);
    for changes in ["()", "(keep_time: true)"] {
        let (case, file) = (Case::empty(), from.path().join("changes.ron"));
        fs::write(&file, changes).unwrap();
        let message = cd_pre::from_outbox::write_datbox(from.path(), Some(&file), &[], case.path()).unwrap();
        assert!(message.contains("events: 2 had happened in the run, 0 of DATBOX"), "{message}");
        assert!(
            message.contains("uniform gravity: (0, 0, -0.5) m/s^2 as in the run; BULK_BEHAV.DAT has "),
            "{message}"
        );
        let start = case.solved(&["--steps", "1"]).last_snapshot().meta.parameters;
        assert_eq!((start.quench, start.uniform_gravity), (0.25, [0.0, 0.0, -0.5]), "{changes}");
    }
}

#[test]
fn files_that_were_edited_after_the_run_are_rejected() {
    let from = pair_and_one();
    // Radius and avrd of body 1, the density, the friction.
    let edits = [
        ("BODIES.DAT", "1.0000000E+00", "1.5000000E+00", 2),
        ("BULK_BEHAV.DAT", "3.0000000E+03", "2.6000000E+03", 1),
        ("TACT_BEHAV.DAT", "3.0000000E-01", "4.0000000E-01", 1),
    ];
    let kept = edits.map(|(name, ..)| fs::read_to_string(from.datbox(name)).unwrap());
    let edit = |k: usize| {
        let (name, old, new, times) = edits[k];
        fs::write(from.datbox(name), kept[k].replacen(old, new, times)).unwrap();
    };
    (0..3).for_each(edit);
    let case = Case::empty();
    let faults = cd_pre::from_outbox::write_datbox(from.path(), None, &[], case.path()).unwrap_err().to_string();
    let expected = [
        "BODIES.DAT:1: body 1: radius 1.5 m, mass 42411.50082346",
        "BULK_BEHAV.DAT: material ROCKx: density 2600 kg/m^3; expected 3000 kg/m^3 as in ",
        "law 'iqsc0': IQS_CLB [0.4]; expected IQS_CLB [0.3] as in ",
    ];
    assert_eq!(faults.lines().count(), 3, "{faults}");
    for (line, expected) in faults.lines().zip(expected) {
        assert!(line.contains(expected) && line.ends_with("OUTBOX/snapshot-000001.npz"), "{line}");
    }
    assert!(!case.path().join("DATBOX").exists());
    // One by one, as cd-solve does not continue with them.
    for k in 0..3 {
        edits.iter().zip(&kept).for_each(|((name, ..), text)| fs::write(from.datbox(name), text).unwrap());
        next_case(&from, "");
        edit(k);
        expect_rejection(from.path(), "");
        assert_eq!(from.solve(&["--resume", "--steps", "2"]), 2, "{}", edits[k].0);
    }
}

#[test]
fn new_bodies_count_for_the_alert() {
    let from = Case::from_scene(&spheres("[(0.0, 0.0, 0.0)]", "")).solved(&[]);
    let changes = r#"(
        bodies: [(remove_motion: All)],
        grains: [(material: "ROCKx", colour: "REDxx", sizes: Single(1.0), placement: List(positions: [(0.0, 0.0, 9.0)]), velocity: (0.0, 0.0, -8.0))],
        contacts: [(between: ("BLUEx", "REDxx"), law: "iqsc0"), (between: ("REDxx", "REDxx"), law: None)],
    )"#;
    let rows = TactBehav::read(&next_case(&from, changes).datbox("TACT_BEHAV.DAT")).unwrap().visibility;
    // A tenth of the mean radius, however fast they are.
    assert!(rows.iter().all(|row| row.alert == 0.1), "{rows:?}");
    expect_rejection(from.path(), &changes.replace("law: None", "law: None, alert: 0.1"));
}

/// Exit status 2, and no DATBOX.
fn expect_rejection(from: &Path, changes: &str) {
    let case = Case::empty();
    assert_eq!(from_outbox(from, case.path(), changes), 2, "{changes}");
    assert!(!case.path().join("DATBOX").exists());
}

#[test]
fn what_cannot_be_is_rejected_and_nothing_written() {
    let from = pair_and_one();
    expect_rejection(Path::new("no/such/case"), "");
    expect_rejection(from.path(), "(bodies: [(snapshot: 77)])");
    expect_rejection(from.path(), "(bodies: [(keep: Smallest)])");
    expect_rejection(from.path(), "(bodies: [(), (centre: (34.0, 0.5, 0.0))])"); // in each other
    expect_rejection(from.path(), "(bodies: [(), (centre: (0.0, 99.0, 0.0), colour: \"REDxx\")])"); // no law
    let grain = |material: &str, place: &str| {
        format!(
            "(grains: [(material: \"{material}\", colour: \"BLUEx\", sizes: Single(1.0), placement: List(positions: [{place}]))])"
        )
    };
    expect_rejection(from.path(), &grain("IRONx", "(0, 50, 0)")); // no such material
    expect_rejection(from.path(), &grain("ROCKx", "(1.0, 0.5, 0.0)")); // in another
    expect_rejection(from.path(), "(contacts: [(between: (\"BLUEx\", \"BLUEx\"), law: \"other\")])");
    expect_rejection(from.path(), "(compute: (dt: -1.0))");
    expect_rejection(from.path(), "(materials: [(name: \"ROCKx\", density: 1.0), (name: \"ROCKx\", density: 2.0)])");
    let law = "(name: \"other\", kind: IQS_CLB(friction: 0.3))";
    expect_rejection(from.path(), &format!("(laws: [{law}, {law}])"));
    // What cd-solve does not compute.
    let roll = "kind: IQS_DS_ROLL_CLB(dynamic_friction: 0.3, static_friction: 0.3, rolling_friction: 0.1, spinning_friction: 0.1)";
    let roll = format!("laws: [(name: \"iqsc0\", {roll})]");
    next_case(&from, &format!("({roll})"));
    expect_rejection(from.path(), &format!("({roll}, compute: (solver: admm))"));
    let press = "walls: [Plate(material: \"ROCKx\", colour: \"PRESS\", centre: (0, 0, 50), half_lengths: (1, 1, 1), \
                 force: (None, None, Constant(-1)))], contacts: [(between: (\"BLUEx\", \"PRESS\"), law: \"iqsc0\")]";
    let turning = |rate: &str| format!("compute: (fields: [RotatingFrame(rate: (0, 0, {rate}), centre: (0, 0, 0))])");
    next_case(&from, &format!("({press}, {})", turning("0")));
    expect_rejection(from.path(), &format!("({press}, {})", turning("1")));
    let pressed = next_case(&from, &format!("({press})")).solved(&["--steps", "1"]);
    expect_rejection(pressed.path(), &format!("({})", turning("1")));
    // Grains imposed along one axis meet held ones; bodies of which none can move have no law.
    let grains = |colour: &str, x: f64, axis: &str| {
        let driven = format!("driven: (Constant(0), Constant(0), {axis})");
        format!(
            "(material: \"ROCKx\", colour: \"{colour}\", sizes: Single(1.0), placement: List(positions: [({x}, 0, 90)]), {driven})"
        )
    };
    let rows = |law: &str| {
        let row = |a: &str, b: &str, law: &str| format!("(between: (\"{a}\", \"{b}\"), law: {law})");
        [row("BLUEx", "REDxx", "None"), row("BLUEx", "GREEN", "None"), row("REDxx", "REDxx", "None"), law.into()]
            .join(", ")
    };
    let changes = |axis: &str, law: &str| {
        let grains = [grains("REDxx", 0.0, "Constant(0)"), grains("GREEN", 9.0, axis)].join(", ");
        format!("(grains: [{grains}], contacts: [{}])", rows(law))
    };
    let own = "(between: (\"GREEN\", \"GREEN\"), law: None)";
    let between = "(between: (\"GREEN\", \"REDxx\"), law: \"iqsc0\")";
    next_case(&from, &changes("None", &format!("{own}, {between}")));
    expect_rejection(from.path(), &changes("None", own));
    next_case(&from, &changes("Constant(0)", own));
    expect_rejection(from.path(), &changes("Constant(0)", &format!("{own}, {between}")));
    // Into the case itself.
    assert_eq!(from_outbox(from.path(), from.path(), ""), 2);
}

#[test]
fn a_start_that_does_not_belong_to_its_datbox_is_rejected() {
    let from = pair_and_one();
    let case = next_case(&from, "");
    let start = case.datbox("START.npz");
    let own = Snapshot::read(&start).unwrap();
    let changes: [fn(&mut Snapshot); 3] = [
        |other| other.bodies.body_x[1][2] += 1.0,
        |other| other.bodies.body_v[1][2] += 1.0,
        |other| other.bodies.body_w_world[1][2] += 1.0,
    ];
    for change in changes {
        let mut other = own.clone();
        change(&mut other);
        other.write(&start).unwrap();
        assert_eq!(case.solve(&["--force"]), 2);
    }
    own.write(&start).unwrap();
    assert_eq!(case.solve(&["--force"]), 0);
    // A new scene takes it away.
    let scene = case.path().join("scene.ron");
    fs::write(&scene, spheres("[(0.0, 0.0, 0.0)]", "")).unwrap();
    assert_eq!(cd_tests::case::pre(&scene, case.path()), 0);
    assert!(!start.exists() && !case.datbox("ORIGIN.csv").exists());
    assert_eq!(case.solve(&["--force"]), 0);
}

#[test]
fn what_stands_out_of_a_level_is_left_behind() {
    let from = collapse().solved(&[]);
    let height = 5.0;
    let all = from.last_snapshot();
    let low = |k: usize| all.bodies.body_x[k][2] + all.bodies.body_radius[k] <= height;
    let kept: Vec<[f64; 3]> = (0..all.bodies.body_id.len()).filter(|&k| low(k)).map(|k| all.bodies.body_x[k]).collect();
    assert!(!kept.is_empty() && kept.len() < all.bodies.body_id.len());
    let case = next_case(&from, &format!("(bodies: [(select: Below({height:?}))])")).solved(&["--steps", "1"]);
    assert_eq!(case.snapshot(0).bodies.body_x, kept);
}

/// Files of a DATBOX but for the comment in COMPUTE.RON that names the case.
fn datbox_without_origin(case: &Path) -> Vec<(String, Vec<u8>)> {
    let datbox = case.join("DATBOX");
    let content = |name: &String| {
        let bytes = fs::read(datbox.join(name)).unwrap();
        if name != "COMPUTE.RON" {
            return bytes;
        }
        let text = String::from_utf8(bytes).unwrap();
        text.lines().filter(|line| !line.starts_with("//")).collect::<String>().into_bytes()
    };
    let names = files(&datbox).into_iter().filter(|name| name != "SHA256SUMS");
    names.map(|name| (name.clone(), content(&name))).collect()
}

#[test]
fn pouring_is_a_run_to_rest_and_a_datbox_from_its_end() {
    let scene = r#"(
        gravity: (0, 0, -9.81),
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", shape: Cube, sizes: Single(0.5), number: 4,
            placement: DensePacking(envelope: Box(lengths: (4, 4, 2))), centre: (0, 0, 1.1))],
        walls: [Plate(material: "ROCKx", colour: "BLUEx", centre: (0, 0, -0.1), half_lengths: (4, 4, 0.1))],
        compute: (dt: 5e-3, end_time: 50, output_every: 50, events: [(time: 1.5, action: SetQuench(0.1))],
            until: [AtRest(speed: 1e-3, during: 0.05)]),
    )"#;
    let folder = Case::empty();
    let [scene_file, changes, bed, twin] =
        ["scene.ron", "changes.ron", "bed", "twin"].map(|name| folder.path().join(name));
    fs::write(&scene_file, scene).unwrap();
    fs::write(&changes, "(bodies: [(remove_motion: All)], compute: (dt: 5e-3, end_time: 0.5))").unwrap();
    let request =
        PourRequest { scene: &scene_file, settings: &["seed=3".to_string()], dir: &bed, changes: Some(&changes) };
    // A run that does not end makes no DATBOX. One that was stopped can be continued, one that was rejected cannot.
    let [case, dir, file] = [&bed.join("pour"), &bed, &changes].map(|path| path.display().to_string());
    let commands = format!(
        "continue with cd-solve {case} --resume and the same options, then cd-pre from-outbox {case} {dir} --changes {file}"
    );
    let correction = "correct the errors that cd-solve has printed".to_string();
    for (code, ending, advice) in [
        (Some(4), "ended with exit code 4", &commands),
        (None, "was killed", &commands),
        (Some(2), "ended with exit code 2", &correction),
        (Some(3), "ended with exit code 3", &correction),
    ] {
        let faults = pour_grains(&request, |_| Ok(code)).unwrap_err().to_string();
        let message = format!("pour: cd-solve: {ending}; expected a run to its end; {advice}");
        assert!(faults.ends_with(&message), "{faults}");
        assert!(!bed.join("DATBOX").exists());
    }
    // Mistakes of the changes are found before the run.
    let misspelt = folder.path().join("misspelt.ron");
    fs::write(&misspelt, "(lawz: [])").unwrap();
    let request_of_misspelt = PourRequest { changes: Some(&misspelt), ..request };
    let faults = pour_grains(&request_of_misspelt, |_| panic!("the run has started")).unwrap_err().to_string();
    assert!(faults.contains("lawz"), "{faults}");
    let faults = pour_grains(&request, |_| Err(std::io::ErrorKind::NotFound.into())).unwrap_err().to_string();
    assert!(faults.contains("cd-solve: cannot be started: "), "{faults}");

    // With exit code 1 a run has lost text on its standard output, no files.
    pour_grains(&request, |case| Ok(Some(solve(case, &["--force"]).max(1)))).unwrap();
    let last = snapshot::list_snapshots(&bed.join("pour/OUTBOX")).unwrap().pop().unwrap();
    assert!(last.0 < 10_000, "the run did not end by itself: {last:?}");
    assert_eq!(solve(&bed, &["--steps", "10"]), 0);
    fs::create_dir(&twin).unwrap();
    assert_eq!(from_outbox(&bed.join("pour"), &twin, &fs::read_to_string(&changes).unwrap()), 0);
    assert_eq!(datbox_without_origin(&bed), datbox_without_origin(&twin));
}

/// Rumpf's strength of spheres with nu = 0.5, Z = 5 and F = c π R² (R = 4 m the radius of a pair of equal balls of 8 m, 1/R =
/// 2/8): σ = nu Z F / (π d²) = c nu Z / 16 with d = 4 R, so c = 320 Pa for 50 Pa, and F = 320 π R².
#[test]
fn forces_that_follow_from_a_bulk_strength_are_printed() {
    let scene = cloud(4, 0.4, 1, "dt: 8.0, steps: 1").replace("Uniform(min: 8.0, max: 12.0)", "Single(8.0)");
    let run = Case::from_scene(&scene).solved(&[]);
    let case = Case::empty();
    let changes = case.path().join("changes.ron");
    let text = r#"(laws: [(
        name: "iqsc0",
        bulk_strength: (tension: 50.0, nu: 0.5, z: 5.0),
        kind: IQS_COH_DS_CLB(cohesive_stress: 0.0, full_range: 0.01, range: 0.05, dynamic_friction: 0.4,
            static_friction: 0.5),
    )])"#;
    fs::write(&changes, text).unwrap();
    let summary = cd_pre::from_outbox::write_datbox(run.path(), Some(&changes), &[], case.path()).unwrap();
    let force = 320.0 * std::f64::consts::PI * 16.0;
    let line = format!(
        "law iqsc0: two equal grains attract each other with {force:.5} N, cohesive_stress 320.00000 Pa for a tensile strength of 50 Pa\n"
    );
    assert!(summary.contains(&line), "{summary}\n{line}");
}

/// The packing of a snapshot, as cd-post has measured it, takes the place of `nu` and `z`.
#[test]
fn a_bulk_strength_follows_from_the_measured_packing() {
    let run = Case::from_scene(&cloud(40, 0.4, 1, "dt: 8.0, steps: 200, output_every: 100")).solved(&[]);
    let case = Case::empty();
    let changes = case.path().join("changes.ron");
    let text = |packing: &str| {
        format!(
            r#"(laws: [(
                name: "iqsc0",
                bulk_strength: (tension: 50.0{packing}),
                kind: IQS_COH_DS_CLB(cohesive_stress: 0.0, full_range: 0.01, range: 0.05, dynamic_friction: 0.4,
                    static_friction: 0.5),
            )])"#
        )
    };
    let attempt = |packing: &str| {
        fs::write(&changes, text(packing)).unwrap();
        let written = cd_pre::from_outbox::write_datbox(run.path(), Some(&changes), &[], case.path());
        written.map_err(|faults| faults.to_string())
    };
    let advice = format!("run cd-post {} --no-vtk --no-plots first", run.path().display());
    let fault = attempt("").unwrap_err();
    assert!(fault.contains("bulk_strength: no nu or z, and no table") && fault.contains(&advice), "{fault}");
    let series = run.series();
    let [nu, z] = ["nu", "Z"].map(|name| *series[name].last().unwrap());
    let stress = |summary: &str| -> f64 {
        let (_, after) = summary.split_once("cohesive_stress ").unwrap();
        after.split_once(" Pa").unwrap().0.parse().unwrap()
    };
    // Five decimals of c = 16 σ/(ν Z).
    let summary = attempt("").unwrap();
    assert!((stress(&summary) - 16.0 * 50.0 / (nu * z)).abs() < 1e-5, "{summary}");
    let line = format!(
        "law iqsc0: the packing has nu {nu:.4} and z {z:.4}, see {}/POSTPRO/series.csv\n",
        run.path().display()
    );
    assert!(summary.contains(&line), "{summary}\n{line}");
    // Given values come first.
    assert!((stress(&attempt(", z: 4.0").unwrap()) - 16.0 * 50.0 / (nu * 4.0)).abs() < 1e-5);
    assert!((stress(&attempt(", nu: 0.5, z: 4.0").unwrap()) - 400.0).abs() < 1e-5);
    // A table of an earlier end, and one of another run with the same steps: the contacts have done other work.
    let table = run.path().join("POSTPRO/series.csv");
    let text = fs::read_to_string(&table).unwrap();
    let (earlier_rows, _) = text.trim_end().rsplit_once('\n').unwrap();
    fs::write(&table, earlier_rows).unwrap();
    let fault = attempt("").unwrap_err();
    assert!(fault.contains("without the snapshot of step 200") && fault.contains(&advice), "{fault}");
    let work = format!("{:?}", series["E_contacts"].last().unwrap());
    fs::write(&table, text.replace(&work, "-1.0")).unwrap();
    let fault = attempt("").unwrap_err();
    assert!(fault.contains("series.csv with step 200 of another run") && fault.contains(&advice), "{fault}");
}

/// Times are products k `dt` of the step from the start of the first run, also in the runs that continue it: with `dt` =
/// 1e-3 s they differ in the last bits from sums, and so would a wall that follows a function of time.
#[test]
fn functions_of_time_continue_bit_for_bit() {
    let scene = r#"(
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
        contacts: [(between: ("BLUEx", "WALLx"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", sizes: Single(0.1),
            placement: List(positions: [(0.0, 0.0, 0.21)]))],
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, 0.0), half_lengths: (1.0, 1.0, 0.1),
            velocity: (Harmonic(amplitude: 0.2, omega: 30.0), Table([(0.0, 0.0), (0.1, 0.05), (0.3, -0.1)]),
                Constant(0.0)))],
        compute: (dt: 1.0e-3, steps: 240, output_every: 30),
    )"#;
    let unbroken = Case::from_scene(scene).solved(&[]);
    let change = "(bodies: [(snapshot: 90)], keep_time: true)";
    let second = next_case(&unbroken, change).solved(&["--steps", "60"]);
    assert_eq!(bits(&second.snapshot(150)), bits(&unbroken.snapshot(150)));
    // The second run continues another one itself.
    let third = next_case(&second, "(keep_time: true)").solved(&["--steps", "90"]);
    assert_eq!(bits(&third.snapshot(240)), bits(&unbroken.snapshot(240)));
    // From time 0, and with steps of another length, they are counted anew.
    assert_eq!(next_case(&second, "()").solve(&["--steps", "2"]), 0);
    let other = next_case(&second, "(keep_time: true, compute: (dt: 7.0e-4, steps: 2))").solved(&[]);
    assert!((other.last_snapshot().meta.time - (0.15 + 2.0 * 7.0e-4)).abs() < 1e-15);
}

/// Balls on springs in a cell of 4 m that shears along x and closes along z, with the changes of its options in `cell`.
fn sheared_cell(cell: &str) -> Case {
    let scene = r#"(
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "elast", kind: ELASTIC_REPELL_CLB(stiffness: 1.0e4, friction: 0.3))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "elast")],
        grains: [(
            material: "ROCKx",
            colour: "BLUEx",
            number: 40,
            sizes: Uniform(min: 0.35, max: 0.5),
            placement: RandomSequential(envelope: Box(lengths: (3.9, 3.9, 3.9))),
            thermal_velocity: 0.3,
        )],
        compute: (
            dt: 0.002, steps: 200, output_every: 100, xperiode: 4.0, yperiode: 4.0, zperiode: 4.0,
            cell: (z: Rate(-0.2), CELL),
        ),
    )"#;
    Case::from_scene(&scene.replace("CELL", cell)).solved(&[])
}

#[test]
fn a_sheared_cell_continues_bit_for_bit() {
    let unbroken = sheared_cell("shear_xz: 0.5");
    let [middle, end] = [100, 200].map(|step| unbroken.snapshot(step));
    assert!(middle.meta.cell.unwrap().shears[1].abs() > 0.1);
    assert!(end.contacts.contact_impulse.iter().any(|r| r[0] > 0.0), "nothing touches");
    let case = next_case(&unbroken, "(bodies: [(snapshot: 100)], keep_time: true)").solved(&["--steps", "100"]);
    assert_eq!((bits(&case.snapshot(100)), bits(&case.snapshot(200))), (bits(&middle), bits(&end)));
    assert_eq!(case.snapshot(200).meta.cell, end.meta.cell);
    // From time 0 the strains are those since then.
    let anew = next_case(&unbroken, "(bodies: [(snapshot: 100)])").solved(&["--steps", "100"]);
    assert_eq!(bits(&anew.snapshot(100)), bits(&end));
    let [strain, before, whole] = [&anew.snapshot(100), &middle, &end].map(|state| state.meta.cell.unwrap());
    assert!((strain.shear_strains[1] - 0.1).abs() < 1e-12);
    let log_strain = whole.log_strains()[2] - before.log_strains()[2];
    assert!((strain.log_strains()[2] - log_strain).abs() < 1e-12);
}

/// Other rates give the bodies the velocities of the new affine field, and leave those about it.
#[test]
fn a_cell_continues_with_other_rates() {
    let run = sheared_cell("shear_xz: 0.5");
    let before = run.snapshot(200);
    let case = next_case(&run, "(compute: (dt: 0.002, steps: 1, cell: (shear_xz: -0.25)))").solved(&[]);
    let start = case.snapshot(0);
    let [old, new] = [&before, &start].map(|state| state.meta.cell.unwrap());
    assert_eq!((old.periods, old.shears), (new.periods, new.shears));
    assert!((new.gradient()[(0, 2)] + 0.25).abs() < 1e-14);
    for (k, x) in start.bodies.body_x.iter().enumerate() {
        assert_eq!(*x, before.bodies.body_x[k]);
        let [a, b] = [(&old, &before), (&new, &start)]
            .map(|(cell, state)| cell.fluctuation(&(*x).into(), &state.bodies.body_v[k].into()));
        assert!((a - b).norm() < 1e-13, "{a} {b}"); // some roundings of velocities of 1 m/s
    }
}

#[test]
fn periods_of_a_cell_are_not_lost() {
    let run = sheared_cell("shear_xz: 0.0");
    let length = run.snapshot(200).meta.cell.unwrap().periods[2];
    let case = next_case(&run, "(compute: (dt: 0.002, steps: 1, cell: (shear_xz: 0.5)))");
    let options = Compute::read(&case.datbox("COMPUTE.RON")).unwrap();
    assert_eq!(options.periods(), [Some(4.0), Some(4.0), Some(length)]);
    for changes in [
        // The period is that of the start of the run.
        "(compute: (dt: 0.002, steps: 1, xperiode: 4.0, yperiode: 4.0, zperiode: 4.0, cell: (shear_xz: 0.5)))",
        "(compute: (dt: 0.1, steps: 1, cell: (shear_xz: 0.5)))",
    ] {
        expect_rejection(run.path(), changes);
    }
    // A cell with right angles may be left, one that is sheared may not.
    next_case(&run, "(compute: (dt: 0.002, steps: 1, xperiode: 4.0, yperiode: 4.0))");
    let sheared = sheared_cell("shear_xz: 0.5");
    for changes in [
        "(compute: (dt: 0.002, steps: 1, xperiode: 4.0, yperiode: 4.0))",
        "(bodies: [(velocity: (1.0, 0.0, 0.0))], compute: (dt: 0.002, steps: 1, cell: ()))",
    ] {
        expect_rejection(sheared.path(), changes);
    }
}
