//! `cd-pre from-outbox` on boxes full of grains: walls are taken out, put back and replaced, runs are mixed.

use std::fs;
use std::path::Path;

use cd_formats::bodies::Bodies;
use cd_tests::case::{Case, from_outbox};

/// Grains that have settled in a box with a lid; `shape` and `tol` of the run.
fn filled(shape: &str, tol: &str) -> Case {
    Case::from_scene(&format!(
        r#"(
        seed: 3,
        gravity: (0.0, 0.0, -9.81),
        materials: [(name: "ROCKx", density: 2700.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", shape: {shape}, sizes: Single(0.1), number: 30,
            placement: JitteredLattice(envelope: Box(lengths: (0.9, 0.9, 1.9))))],
        walls: [Box(material: "ROCKx", colour: "WALLx", centre: (0, 0, 0), lengths: (1, 1, 2), half_thickness: 0.05, lid: true)],
        compute: (dt: 2e-3, steps: 400, output_every: 400, tol: {tol}),
    )"#
    ))
    .solved(&["--threads", "1"])
}

/// The case made from the last snapshot of another, and its number of bodies.
fn next_case(from: &Case, changes: &str) -> (Case, usize) {
    let case = Case::empty();
    assert_eq!(from_outbox(from.path(), case.path(), changes), 0, "{changes}");
    let count = Bodies::read(&case.datbox("BODIES.DAT")).unwrap().0.len();
    (case, count)
}

/// The message with which a change is rejected.
fn rejection(from: &Case, changes: &str) -> String {
    let case = Case::empty();
    let file = case.path().join("changes.ron");
    fs::write(&file, changes).unwrap();
    let faults = cd_pre::from_outbox::write_datbox(from.path(), Some(&file), &[], case.path()).unwrap_err();
    assert!(!case.path().join("DATBOX").exists());
    faults.to_string()
}

/// A plate of the box as the scene made it: floor, -x, x, -y, y, lid.
fn plate(from: &Case, wall: usize, shift: f64) -> String {
    let body = &Bodies::read(&from.datbox("BODIES.DAT")).unwrap().0[29 + wall];
    let cd_formats::bodies::ShapeRecord::Plane { half_lengths: [a, b, c] } = body.contactors[0].shape else { panic!() };
    let [x, y, z] = body.position;
    let (normal, first) = [
        ("(0, 0, 1)", "(1, 0, 0)"),
        ("(1, 0, 0)", "(0, 1, 0)"),
        ("(-1, 0, 0)", "(0, 1, 0)"),
        ("(0, 1, 0)", "(0, 0, 1)"),
        ("(0, -1, 0)", "(0, 0, 1)"),
        ("(0, 0, -1)", "(1, 0, 0)"),
    ][wall - 1];
    format!(
        "Plate(material: \"ROCKx\", colour: \"WALLx\", centre: ({x:?}, {y:?}, {:?}), normal: {normal}, first_axis: {first}, \
         half_lengths: ({a:?}, {b:?}, {c:?}))",
        z + shift
    )
}

#[test]
fn walls_come_and_go_one_by_one() {
    // A loose tolerance leaves overlaps far above a millionth of the radius.
    for (shape, tol) in
        [("Sphere", "1e-2"), ("Random(vertices: (8, 12), ratios: (1.0, 0.8, 0.7), angularity: 0.2)", "1e-3")]
    {
        let run = filled(shape, tol);
        let (open, count) = next_case(&run, "(bodies: [(walls_except: [Wall(6)])])");
        assert_eq!(count, 35, "{shape}: the lid alone is gone");
        let open = open.solved(&["--steps", "20", "--threads", "1"]);
        let (closed, count) = next_case(&open, &format!("(walls: [{}])", plate(&run, 6, 0.0)));
        assert_eq!(count, 36, "{shape}: the lid is back");
        closed.solved(&["--steps", "2", "--threads", "1"]);
        // Floor and lid are kept by number, the sides put back where they were, against what leans on them.
        let sides: Vec<String> = (2..6).map(|wall| plate(&run, wall, 0.0)).collect();
        let kept =
            format!("bodies: [(walls: false, walls_except: [Body(31), Wall(6)])], walls: [{}]", sides.join(", "));
        assert_eq!(next_case(&run, &format!("({kept})")).1, 36, "{shape}");
        // All of them, and the floor in its own place again.
        let all: Vec<String> = (1..7).map(|wall| plate(&run, wall, 0.0)).collect();
        assert_eq!(
            next_case(&run, &format!("(bodies: [(walls: false)], walls: [{}])", all.join(", "))).1,
            36,
            "{shape}"
        );
        assert_eq!(next_case(&run, "(bodies: [(walls_except: [Colour(\"WALLx\")])])").1, 30, "{shape}");
        // Into a larger box; into one that is too small.
        let boxed = |lengths: &str, z: f64| {
            format!(
                "(bodies: [(walls: false)], walls: [Box(material: \"ROCKx\", colour: \"WALLx\", centre: (0, 0, {z}), lengths: {lengths}, half_thickness: 0.05)])"
            )
        };
        next_case(&run, &boxed("(3, 3, 3)", 0.45)).0.solved(&["--steps", "2", "--threads", "1"]);
        let found = rejection(&run, &boxed("(0.95, 1, 2)", 0.0));
        assert!(found.contains("overlap by") && found.contains("of the changes)"), "{found}");
        // A floor 1 mm higher is deeper than what the run had left.
        let found =
            rejection(&run, &format!("(bodies: [(walls_except: [Wall(1)])], walls: [{}])", plate(&run, 1, 1e-2)));
        assert!(found.contains("that the run had left") && found.contains("wall 1 of the changes"), "{found}");
    }
}

#[test]
fn walls_that_are_not_there_are_named() {
    let run = filled("Sphere", "1e-2");
    for (which, found) in
        [("Wall(7)", "Wall(7)"), ("Body(3)", "Body(3)"), ("Colour(\"LIDxx\")", "Colour(\\\"LIDxx\\\")")]
    {
        let text = rejection(&run, &format!("(bodies: [(walls_except: [{which}])])"));
        let expected = "expected one of 6 bodies with imposed motion, numbers 31 to 36, colours WALLx";
        assert!(text.contains(expected) && text.contains(&found.replace('\\', "")), "{text}");
    }
}

/// Rocks next to each other whose surrounding balls overlap.
#[test]
fn two_runs_are_mixed_by_their_shapes() {
    let cube = |x: f64| {
        Case::from_scene(&format!(
            r#"(
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", shape: Box(lengths: (1, 1, 1)),
                placement: List(positions: [({x:?}, 0, 0)]), grain_orientation: Same((axis: (0, 0, 1), angle: 0)))],
            compute: (dt: 1e-3, steps: 1),
        )"#
        ))
        .solved(&["--threads", "1"])
    };
    let (left, right) = (cube(0.0), cube(1.01));
    let other = |case: &Path, more: &str| format!("(bodies: [(), (case: {:?}{more})])", case.display().to_string());
    assert_eq!(next_case(&left, &other(right.path(), "")).1, 2);
    let found = rejection(&left, &other(right.path(), ", centre: (0.9, 0, 0)"));
    assert!(found.contains("overlap by 1.000e-1 m"), "{found}");
    let ball = |x: f64| {
        format!(
            "(grains: [(material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(0.5), placement: List(positions: [({x:?}, 0, 0)]))])"
        )
    };
    assert_eq!(next_case(&left, &ball(1.0)).1, 2);
    assert!(rejection(&left, &ball(0.99)).contains("overlap by 1.000e-2 m"));
}

/// Capsules and cylinders of the length 2, upright, from a run and new: by their ends, which lie far beyond the spheres
/// of equal volume.
#[test]
fn rods_are_mixed_by_their_shapes() {
    let grain = |shape: &str, z: f64| {
        let upright = "grain_orientation: Same((axis: (0, 0, 1), angle: 0)),";
        let orientation = if shape.starts_with("shape") { upright } else { "" };
        format!(
            "(material: \"ROCKx\", colour: \"BLUEx\", {shape}, {orientation} placement: List(positions: [(0, 0, \
             {z:?})]))"
        )
    };
    let run = |shape: &str| {
        Case::from_scene(&format!(
            r#"(
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [{}],
            compute: (dt: 1e-3, steps: 1),
        )"#,
            grain(shape, 0.0)
        ))
        .solved(&["--threads", "1"])
    };
    let capsule = ("shape: Capsule(half_length: 0.75, radius: 0.25)", 1.0);
    let cylinder = ("shape: Cylinder(half_height: 1.0, radius: 0.25)", 1.0);
    let cube = ("shape: Box(lengths: (1, 1, 1))", 0.5);
    let ball = ("sizes: Single(0.5)", 0.5);
    for (shape, half) in [capsule, cylinder, cube, ball] {
        let first = run(shape);
        for (other, other_half) in [capsule, cylinder] {
            let new = |z: f64| format!("(grains: [{}])", grain(other, z));
            assert_eq!(next_case(&first, &new(half + other_half)).1, 2, "{shape} {other}");
            // The overlap of two cylinders is known to a thousandth of the radius.
            let found = rejection(&first, &new(half + other_half - 0.1));
            assert!(found.contains("overlap by 1.00"), "{shape} {other}: {found}");
            let second = run(other);
            let moved = |z: f64| format!("(bodies: [(), (case: {:?}, centre: (0, 0, {z:?}))])", second.path());
            assert_eq!(next_case(&first, &moved(half + other_half)).1, 2, "{shape} {other}");
            let found = rejection(&first, &moved(half + other_half - 0.1));
            assert!(found.contains("overlap by 1.00"), "{shape} {other}: {found}");
        }
        let floor = |z: f64| {
            format!(
                "(walls: [Plate(material: \"ROCKx\", colour: \"BLUEx\", centre: (0, 0, {z:?}), half_lengths: (3, 3, \
                 0.5))])"
            )
        };
        assert_eq!(next_case(&first, &floor(-half - 0.5)).1, 2, "{shape}");
        assert!(rejection(&first, &floor(-half - 0.4)).contains("overlap by 1.000e-1 m"), "{shape}");
    }
}

/// Held bricks in a floor plate: neither can move, so the plate can be put back; a free brick may not overlap it.
#[test]
fn a_floor_is_put_back_among_held_bricks() {
    let bricks = |driven: &str| {
        Case::from_scene(&format!(
            r#"(
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", shape: Box(lengths: (1, 1, 1)), {driven}
                placement: List(positions: [(0, 0, 0)]), grain_orientation: Same((axis: (0, 0, 1), angle: 0))),
                (material: "ROCKx", colour: "BLUEx", sizes: Single(0.5), placement: List(positions: [(0, 0, 9)]))],
            compute: (dt: 1e-3, steps: 1),
        )"#
        ))
        .solved(&["--threads", "1"])
    };
    let floor =
        "(walls: [Plate(material: \"ROCKx\", colour: \"BLUEx\", centre: (0, 0, 0), half_lengths: (3, 3, 0.1))])";
    let held = bricks("driven: (Constant(0), Constant(0), Constant(0)),");
    assert_eq!(next_case(&held, floor).1, 3);
    assert!(rejection(&bricks(""), floor).contains("overlap by 6.000e-1 m"));
}

/// A hollow cylinder is closed and pushes inwards alone: grains outside of it are rejected as in a scene, whoever comes later.
#[test]
fn grains_outside_of_a_hollow_cylinder_are_rejected() {
    let run = filled("Sphere", "1e-2");
    let drum = |x: f64, colour: &str| {
        format!(
            "Cylinder(material: \"ROCKx\", colour: \"{colour}\", centre: ({x}, 0, 0), half_height: 2, radius: 1.2, hollow: true)"
        )
    };
    let found = rejection(&run, &format!("(bodies: [(walls: false)], walls: [{}])", drum(3.0, "WALLx")));
    let expected = "is outside of wall 1, a hollow cylinder; expected bodies that can touch it inside: it is closed and has \
                    contacts on its inside only";
    assert!(found.contains("body 1: body 1 ") && found.contains(expected), "{found}");
    // Around them all, and where none meets it.
    let (around, _) = next_case(&run, &format!("(bodies: [(walls: false)], walls: [{}])", drum(0.0, "WALLx")));
    let apart = "contacts: [(between: (\"BLUEx\", \"DRUMx\"), law: None)]";
    next_case(&run, &format!("(bodies: [(walls: false)], walls: [{}], {apart})", drum(9.0, "DRUMx")));
    // The drum of a run, and a grain that is added.
    let around = around.solved(&["--steps", "1", "--threads", "1"]);
    let grain = "grains: [(material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(0.1), placement: List(positions: [(4, 0, 0)]))]";
    let found = rejection(&around, &format!("({grain})"));
    assert!(found.contains("body 32 is outside of body 31, a hollow cylinder"), "{found}");
}

#[test]
fn datbox_names_the_changes_and_the_snapshot_that_it_is_from() {
    use cd_formats::origin::SceneOrigin;
    let folder = tempfile::tempdir().unwrap();
    let run = filled("Sphere", "1e-2");
    let (from, to) = (folder.path().join("run"), folder.path().join("new"));
    fs::rename(run.path(), &from).unwrap();
    fs::create_dir(&to).unwrap();
    assert_eq!(from_outbox(&from, &to, "(seed: 1)"), 0);
    let text = fs::read_to_string(to.join("DATBOX/COMPUTE.RON")).unwrap();
    assert!(
        text.starts_with("// Made by from-outbox ../run, --changes changes.ron\n// Made with changes.ron, "),
        "{text}"
    );
    let origin = SceneOrigin::from_compute_text(&text).unwrap();
    assert_eq!(origin.change_warning(&to), None);
    fs::write(to.join("changes.ron"), "(seed: 2)").unwrap();
    let said = origin.change_warning(&to).unwrap();
    assert!(
        said.contains("changes.ron has changed since DATBOX was made from it; ") && said.contains("from-outbox"),
        "{said}"
    );
    fs::write(from.join("OUTBOX/snapshot-000400.npz"), "other").unwrap();
    assert!(origin.change_warning(&to).unwrap().contains("snapshot-000400.npz have changed since"));
}
