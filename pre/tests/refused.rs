//! Every kind of scene that is rejected, with the whole of its message.

mod good;

use good::{Case, GOOD, check_messages, faults, faults_of_changed};

/// Faults of the good scene in which `from` is replaced by `to`.
#[track_caller]
fn messages(from: &str, to: &str) -> String {
    faults_of_changed(GOOD, &[(from, to)])
}

#[test]
fn the_good_scene_is_good() {
    assert_eq!(messages("dt", "dt"), "nothing");
}

#[track_caller]
fn check(cases: &[Case]) {
    check_messages(GOOD, cases);
}

#[test]
fn laws_of_events_are_those_of_contacts_and_cohesion_is_changed_where_there_is_some() {
    let event = |action: &str| {
        format!("compute: (\n dt: 1.0e-3,\n events: [\n(time: 1.0, action: Bond),\n(time: 1.0, action: {action})])")
    };
    let messages = |action: &str| messages("compute: (dt: 1.0e-3)", &event(action));
    assert_eq!(messages("SetFriction(\"iqsc0\", 0.5)"), "nothing");
    assert_eq!(
        messages("SetFriction(\"iqsc1\", 0.5)"),
        "scene.ron:18:33: compute, event 2, action 1: law 'iqsc1' is not in use; did you mean iqsc0?"
    );
    assert_eq!(
        messages("SetCohesion(\"iqsc0\", 0.5)"),
        "scene.ron:18:33: compute, event 2, action 1: law 'iqsc0' has no cohesion; expected a law with cohesion"
    );
}

#[test]
fn impacts_in_order_are_those_of_spheres() {
    let in_order = ("compute: (dt: 1.0e-3)", "compute: (dt: 1.0e-3, impacts: in_order)");
    let found = |changes: &[(&str, &str)]| faults_of_changed(GOOD, &[&[in_order], changes].concat());
    let plate = "half_lengths: (9.0, 9.0, 0.5)";
    let pressed = "half_lengths: (9.0, 9.0, 0.5), force: (None, None, Constant(1.0))";
    let wall = found(&[(plate, pressed)]);
    assert!(
        wall.contains("wall 1: a wall that moves by forces, with impacts: in_order; expected impacts: simul"),
        "{wall}"
    );
    let colour = "colour: \"BLUEx\",";
    let held = found(&[(colour, "colour: \"BLUEx\", driven: (None, None, Constant(0.0)),")]);
    let expected = "grains 1: neither free spheres nor bodies whose whole motion is imposed, with impacts: in_order";
    assert!(held.contains(expected), "{held}");
}

#[test]
fn strengths_of_the_bulk_are_those_of_pairs_and_no_second_value() {
    let law = |bulk: &str, stress: &str| {
        format!(
            "IQS_COH_DS_CLB(cohesive_stress: {stress}, full_range: 0, range: 0, dynamic_friction: 0, \
             static_friction: 0), bulk_strength: ({bulk})"
        )
    };
    let messages = |text: &str| messages("IQS_CLB(friction: 0.4)", text);
    assert_eq!(messages(&law("tension: 50, nu: 0.6, z: 5", "0")), "nothing");
    for (text, expected) in [
        (
            law("tension: 50, nu: 0.6, z: 5", "2"),
            "cohesive_stress: 2 together with a bulk_strength; expected 0: it follows from bulk_strength",
        ),
        (law("tension: -1, nu: 0.6, z: 5", "0"), "tension: -1; expected a stress >= 0 Pa"),
        (law("tension: 1, nu: 1.6, z: 5", "0"), "nu: 1.6; expected a solid fraction > 0 and <= 1"),
        (law("tension: 1, nu: 0.6, z: 0", "0"), "z: 0; expected a coordination number > 0"),
        (
            law("tension: 1, nu: 0.6", "0"),
            "bulk_strength: no nu or z; expected both in a scene: cd-pre from-outbox alone takes them from the snapshot \
             with which a run begins",
        ),
        (
            law("tension: 1, nu: 0.6, z: 4, diameter: 1", "0"),
            "diameter: 1; expected no diameter: the strength does not depend on it",
        ),
        (
            "IQS_CLB(friction: 0.4), bulk_strength: (tension: 1, nu: 0.6, z: 4)".into(),
            "bulk_strength: IQS_CLB; expected a law with cohesion of pairs, such as IQS_COH_DS_CLB, or no bulk_strength",
        ),
        (
            "IQS_VDW_DS_CLB(hamaker_constant: 0, surface_distance: 1e-9, full_range: 0, range: 0, dynamic_friction: 0, \
             static_friction: 0), bulk_strength: (tension: 1, nu: 0.6, z: 4)"
                .into(),
            "bulk_strength: no diameter; expected diameter: the strength depends on it",
        ),
        (
            "IQS_COH_DS_CLB(cohesive_stress: 1, full_range: 2, range: 1, dynamic_friction: 0, static_friction: 0)"
                .into(),
            "full_range: 2 is larger than range 1; expected full_range <= range",
        ),
    ] {
        let found = messages(&text);
        assert!(found.ends_with(expected) && !found.contains('\n'), "{found}");
    }
}

#[test]
fn materials_laws_and_colours() {
    assert!(
        messages("materials: [(name: \"ROCKx\", density: 2700.0)]", "materials: []")
            .contains("'ROCKx' is not defined; expected a material: none is defined")
    );
    check(&[
        (
            "name: \"ROCKx\"",
            "name: \"GRANITE\"",
            "3:24: material 1, name: 'GRANITE'; expected 1 to 5 printable ASCII characters without blanks\nscene.ron:7:19: grains 1, material: 'ROCKx' is not defined; expected a material: none is defined under a valid name\nscene.ron:13:29: wall 1, material: 'ROCKx' is not defined; expected a material: none is defined under a valid name",
        ),
        ("2700.0", "NaN", "3:42: material 1, density: NaN; expected a density > 0 kg/m^3"),
        (
            "2700.0)",
            "2700.0), (name: \"ROCKx\", density: 1.0)",
            "3:58: material 2, name: 'ROCKx' occurs twice; expected a name of its own",
        ),
        (
            "material: \"ROCKx\", colour: \"B",
            "material: \"ICExx\", colour: \"B",
            "7:19: grains 1, material: 'ICExx' is not defined; expected ROCKx",
        ),
        ("-9.81", "inf", "2:25: gravity 3: inf; expected a finite number (m/s^2)"),
        ("-9.81", "-1e200", "2:25: gravity 3: -1e200; expected a finite number (m/s^2), below 1e40 in magnitude"),
        (
            "-11.0),",
            "-11.0), velocity: (Constant(1e40), Table([(0, 0)]), Table([(1, 0), (2, 1), (0, 1)])),",
            "13:93: wall 1, velocity 1: Constant(1e40); expected finite numbers (m/s), below 1e40 in magnitude\n\
             scene.ron:13:109: wall 1, velocity 2: 1 point; expected at least two points, their times rising (s)\n\
             scene.ron:13:126: wall 1, velocity 3: the time 0 of point 3 after 2; expected times that rise from point to point (s)",
        ),
        ("friction: 0.4", "friction: -0.4", "4:52: law 1, kind, friction: -0.4; expected a finite number >= 0"),
        (
            "IQS_CLB(friction: 0.4)",
            "IQS_DS_CLB(dynamic_friction: 0.5, static_friction: 0.4)",
            "4:63: law 1, kind, dynamic_friction: 0.5 is larger than static_friction 0.4; expected dynamic_friction <= static_friction",
        ),
        (
            "IQS_CLB(friction: 0.4)",
            "RST_CLB(normal_restitution: 1.1, tangential_restitution: 0, friction: 0)",
            "4:62: law 1, kind, normal_restitution: 1.1; expected 0 to 1",
        ),
        ("law: \"iqsc0\"", "law: \"iqsc1\"", "5:51: contact 1, law: 'iqsc1' is not defined; did you mean iqsc0?"),
        (
            "(\"BLUEx\", \"WALLx\")",
            "(\"BLUEx\", \"REDxx\")",
            "5:81: contact 2, between 2: no grains and no wall have the colour 'REDxx'; expected one of BLUEx, WALLx\nscene.ron:5:15: contacts: no law between 'BLUEx' and 'WALLx'; expected one for each pair that can meet (law: None for none)",
        ),
        (
            "(\"BLUEx\", \"BLUEx\")",
            "(\"WALLx\", \"BLUEx\")",
            "5:71: contact 2, between: 'BLUEx' and 'WALLx' are listed twice; expected each pair once\nscene.ron:5:15: contacts: no law between 'BLUEx' and 'BLUEx'; expected one for each pair that can meet (law: None for none)",
        ),
        ("\"iqsc0\"),", "\"iqsc0\", alert: 0.0),", "5:67: contact 1, alert: 0.0; expected a distance > 0 m"),
        (
            "\"WALLx\"), law: \"iqsc0\")",
            "\"WALLx\"), law: None, alert: 0.1)",
            "5:109: contact 2, alert: alert without a law; expected no alert, or a law",
        ),
        (
            "\"WALLx\"), law: \"iqsc0\")",
            "\"WALLx\"), law: None), (between: (\"WALLx\", \"WALLx\"), law: \"iqsc0\")",
            "5:103: contact 3: a law between the walls 'WALLx' and 'WALLx'; expected no law: walls touch each other only if one has a force or moment, and one is a solid Cylinder, the other a Plate, Box or solid Cylinder",
        ),
        ("2700.0", "1e-120", "3:42: material 1, density: 1e-120; expected a density > 0 kg/m^3, at least 1e-99"),
    ]);
    // A law between bodies of which none can move; with one that can, it acts.
    let held = |axes: &str| {
        let driven = format!("driven: ({axes}), number: 1,");
        let more = "grains: [(material: \"ROCKx\", colour: \"REDxx\", DRIVEN sizes: Single(0.5), \
                    placement: List(positions: [(0.0, 0.0, 30.0)])), (";
        let contacts = "contacts: [(between: (\"REDxx\", \"WALLx\"), law: \"iqsc0\"), \
                        (between: (\"REDxx\", \"BLUEx\"), law: \"iqsc0\"), ";
        let scene = GOOD.replacen("contacts: [", contacts, 1);
        faults(&scene.replacen("grains: [(", &more.replace("DRIVEN", &driven), 1))
    };
    let all = "Constant(0.0), Constant(0.0), Constant(0.0)";
    let idle = "scene.ron:5:16: contact 1: a law between 'REDxx' and 'WALLx'; expected no law: bodies whose motion is all \
                imposed (of spheres: their translation) do not meet";
    assert_eq!(held(all), idle);
    // Normals of spheres pass through their centres, so that free rotation does not make them act.
    assert_eq!(held(&format!("{all}), driven_spin: (None, None, None")), idle);
    assert_eq!(held("Constant(0.0), Constant(0.0), None"), "nothing");
    // A law that reaches further than contacts are listed.
    let cohesive = "IQS_WET_DS_CLB(cohesion: 1.0, range: 0.2, dynamic_friction: 0.1, static_friction: 0.1)";
    let scene =
        GOOD.replace("IQS_CLB(friction: 0.4)", cohesive).replacen("law: \"iqsc0\"", "law: \"iqsc0\", alert: 0.1", 1);
    assert_eq!(
        faults(&scene),
        "scene.ron:5:67: contact 1, alert: 0.1 is less than the range 0.2 of law 'iqsc0'; expected at least the range (m), for beyond alert no law acts"
    );
}

#[test]
fn a_cylinder_that_presses_touches_other_walls() {
    let messages = |cylinder: &str| {
        let press = "radius: 1.0, half_height: 1.0, centre: (0, 0, 20), colour: \"PRESS\"";
        let walls = format!("walls: [Cylinder(material: \"ROCKx\", {press}{cylinder}), ");
        let rows = "law: \"iqsc0\"), (between: (\"PRESS\", \"WALLx\"), law: \"iqsc0\"), \
                    (between: (\"BLUEx\", \"PRESS\"), law: \"iqsc0\"), ";
        messages_of_changes(&[("walls: [", walls.as_str()), ("law: \"iqsc0\"), ", rows)])
    };
    assert_eq!(messages(", force: (None, None, Constant(-5))"), "nothing");
    assert_eq!(messages(", moment: Constant(0)"), "nothing");
    for idle in ["", ", hollow: true, force: (None, None, Constant(-5))"] {
        assert!(
            messages(idle).contains("a law between the walls 'PRESS' and 'WALLx'; expected no law: "),
            "{}",
            messages(idle)
        );
    }
}

#[test]
fn sizes_and_numbers() {
    check(&[
        ("min: 0.5", "min: 1.5", "9:29: grains 1, sizes, min: 1.5 is larger than max 1.0; expected min <= max (m)"),
        ("min: 0.5", "min: 0.0", "9:29: grains 1, sizes, min: 0.0; expected a radius > 0 m"),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "PowerLaw(min: 0.5, max: 1.0, exponent: 0)",
            "9:55: grains 1, sizes, exponent: 0; expected a number > 0",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "LogNormal(median: 1, sigma: -1, min: 0.5, max: 1)",
            "9:44: grains 1, sizes, sigma: -1; expected a number > 0",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "LogNormal(median: 1, sigma: 0.1, min: 5, max: 6)",
            "9:16: grains 1, sizes: min 5 and max 6 leave less than a millionth of the distribution; expected cut-offs about the median (m)",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "List([0.5, 0.6])",
            "8:17: grains 1, number: 20 for 2 listed radii; expected their number, or none",
        ),
        (
            "Uniform(min: 0.5, max: 1.0)",
            "List([0.5, NaN])",
            "9:27: grains 1, size 2: NaN; expected a radius > 0 m\nscene.ron:8:17: grains 1, number: 20 for 2 listed radii; expected their number, or none",
        ),
        ("number: 20", "number: 0", "8:17: grains 1, number: 0; expected 1 to 9999999 grains"),
        (
            "number: 20,",
            "",
            "6:14: grains 1: size of the envelope given; expected exactly two of number, solid_fraction and size of the envelope",
        ),
        (
            "number: 20",
            "number: 20, solid_fraction: 0.2",
            "6:14: grains 1: number, solid_fraction, size of the envelope given; expected exactly two of number, solid_fraction and size of the envelope",
        ),
        (
            "number: 20",
            "solid_fraction: 1.5",
            "8:25: grains 1, solid_fraction: 1.5; expected more than 0 and less than 1",
        ),
        (
            "number: 20",
            "number: 2000",
            "10:20: grains 1, placement: 2000 grains, the largest of radius 0.99981832 m, in a ball of radius 10 m: the lattice has 555 sites; expected fewer or smaller grains, a larger envelope (a smaller solid fraction), or RandomSequential for very unequal grains",
        ),
    ]);
}

#[test]
fn places_and_motion() {
    check(&[
        ("radius: 10.0", "radius: -1.0", "10:59: grains 1, placement, envelope, radius: -1.0; expected a length > 0 m"),
        (
            "Ball(radius: 10.0)",
            "Box(lengths: (1, 0, 1))",
            "10:63: grains 1, placement, envelope, length 2: 0; expected a length > 0 m",
        ),
        (
            "Ball(radius: 10.0)",
            "Box(lengths: (9, 9, 9), ratios: (1, 1, 1))",
            "10:46: grains 1, placement, envelope: both its size and ratios; expected one of them",
        ),
        ("10.0))", "10.0), jitter: 1.5)", "10:74: grains 1, placement, jitter: 1.5; expected 0 to 1"),
        ("0.1),", "NaN),", "11:26: grains 1, spin 3: NaN; expected a finite number (rad/s)"),
        ("0.1),", "0.1), thermal_velocity: -1", "11:50: grains 1, thermal_velocity: -1; expected a speed >= 0 m/s"),
        (
            "0.1),",
            "0.1), orientation: (axis: (0, 0, 0), angle: 1)",
            "11:52: grains 1, orientation, axis: (0, 0, 0); expected a finite vector that is not 0",
        ),
        (
            "0.1),",
            "0.1), driven: (Constant(0), Constant(0), Constant(0))",
            "11:40: grains 1, driven: the grains have a velocity, spin or thermal_velocity as well; expected their motion imposed or initial, not both\nscene.ron:6:13: grains: none is free to move; expected at least one group of grains whose motion is not all imposed",
        ),
        (
            "0.1),",
            "0.1), driven_spin: (None, Constant(1), None)",
            "11:45: grains 1, driven_spin: the grains have a spin as well; expected their rotation imposed or initial, not both",
        ),
        (
            "half_lengths: (9.0, 9.0, 0.5)",
            "half_lengths: (9.0, 9.0, 0.0)",
            "13:107: wall 1, half_length 3: 0.0; expected a length > 0 m",
        ),
        (
            "centre: (0.0, 0.0, -11.0)",
            "centre: (0, 0, -11), normal: (0, 0, 1), first_axis: (0, 0, 1)",
            "13:107: wall 1, first_axis: parallel to normal; expected two different directions",
        ),
        (
            "centre: (0.0, 0.0, -11.0)",
            "centre: (0, 0, -11), velocity: (Constant(1), Constant(0), Constant(0)), force: (Constant(2), None, None)",
            "13:87: wall 1, velocity 1: Constant(1), and a force along the same axis; expected one of the two",
        ),
        (
            "centre: (0.0, 0.0, -11.0)",
            "centre: (0, 0, -11), velocity: (Constant(0), Constant(0), Table([(1, 0), (0, 0)]))",
            "13:113: wall 1, velocity 3: the time 0 of point 2 after 1; expected times that rise from point to point (s)",
        ),
        ("dt: 1.0e-3", "dt: 0.0", "14:19: compute, dt: 0.0; expected a finite time step > 0 s"),
    ]);
}

#[test]
fn overlaps() {
    let list = "placement: List(positions: [(0, 0, 0), (0, 0, 1.5), (5, 0, 0)]), // ";
    let sizes = "sizes: Single(1.0), // ";
    let scene = GOOD.replace("placement:", list).replace("sizes:", sizes).replace("number: 20", "number: 3");
    let messages = faults;
    let expected = "expected grains that touch at most (a List or File may have allow_overlap: true)";
    assert_eq!(
        messages(&scene),
        format!(
            "scene.ron:10:20: grains 1, placement: grain 1 of grains 1 and grain 2 of grains 1 overlap by 5.000e-1 m; {expected}"
        )
    );
    assert_eq!(messages(&scene.replace("1.5)", "2.0)")), "nothing"); // touching
    assert_eq!(messages(&scene.replace("1.5), (5, 0, 0)]", "1.5), (5, 0, 0)], allow_overlap: true")), "nothing");
    assert_eq!(
        messages(&scene.replace("1.5)", "3.0)").replace("-11.0", "-1.25")),
        format!(
            "scene.ron:10:20: grains 1, placement: grain 1 of grains 1 and wall 1 overlap by 2.500e-1 m; {expected}\n"
        ) + &format!(
            "scene.ron:10:20: grains 1, placement: grain 3 of grains 1 and wall 1 overlap by 2.500e-1 m; {expected}"
        )
    );
}

#[test]
fn shapes_and_how_they_stand() {
    let at = |from: &'static str, to: &'static str, message: &'static str| check(&[(from, to, message)]);
    let shape = "sizes: Uniform(min: 0.5, max: 1.0),";
    at(
        shape,
        "sizes: Single(1), shape: Random(vertices: (3, 2), ratios: (1, 0, 1), angularity: 2),",
        "9:51: grains 1, shape, vertices: 3 to 2; expected 4 to 1000, the fewest first\nscene.ron:9:71: grains 1, shape, ratio 2: 0; expected a number > 0\nscene.ron:9:90: grains 1, shape, angularity: 2; expected 0 to 1",
    );
    at(shape, "shape: Box(lengths: (1, -1, 1)),", "9:33: grains 1, shape, length 2: -1; expected a length > 0 m");
    at(
        shape,
        "sizes: Single(1), shape: Prism(sides: 2, slenderness: 0),",
        "9:47: grains 1, shape, sides: 2; expected 3 to 500\nscene.ron:9:63: grains 1, shape, slenderness: 0; expected a number > 0",
    );
    at(
        shape,
        "shape: Cube,",
        "6:14: grains 1: no sizes; expected sizes, or a shape with a size of its own (Box, Cylinder, Capsule, Vertices, Model, Clump, ClumpFile)",
    );
    at(
        shape,
        "",
        "6:14: grains 1: no sizes; expected sizes, or a shape with a size of its own (Box, Cylinder, Capsule, Vertices, Model, Clump, ClumpFile)",
    );
    at(
        shape,
        "shape: Vertices([(0, 0, 0), (1, 0, 0), (0, NaN, 0)]),",
        "9:52: grains 1, shape 3.2: NaN; expected a finite number (m)\nscene.ron:9:16: grains 1, shape: 3 vertices; expected 4 to 1000",
    );
    at(
        shape,
        "shape: Vertices([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]),",
        "9:16: grains 1, shape: the points lie in a plane; expected a non-degenerate convex solid",
    );
    at(
        shape,
        "sizes: Single(1), radius: Circumscribed,",
        "6:14: grains 1: grain_orientation or radius given for spheres; expected neither: they are for polyhedra, clumps, cylinders and capsules",
    );
    at(
        shape,
        "shape: Box(lengths: (1, 1, 1)), radius: Circumscribed,",
        "6:14: grains 1: radius given without sizes; expected sizes, whose meaning it says",
    );
    at(
        shape,
        "sizes: Single(1), shape: Cube, grain_orientation: List([(axis: (0, 0, 0), angle: 1)]),",
        "9:72: grains 1, grain_orientation 1, axis: (0, 0, 0); expected a finite vector that is not 0\nscene.ron:9:59: grains 1, grain_orientation: 1 rotations for 0 listed positions; expected one for each listed position",
    );
}

/// Faults of a scene of one sphere with a floor; `fields` of the grains, half length `half` of the floor, m, and `options`.
fn of_one(fields: &str, half: f64, options: &str) -> String {
    let scene = format!(
        r#"(
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: None), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {fields})],
            walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (-9.5, 0, 0), half_lengths: (0.5, {half:?}, 2))],
            compute: (dt: 1.0e-3, {options}),
        )"#
    );
    faults(&scene)
}

/// Faults of the good scene with several changes.
#[track_caller]
fn messages_of_changes(changes: &[(&str, &str)]) -> String {
    faults_of_changed(GOOD, changes)
}

/// More than can be counted are not drawn one by one first.
#[test]
fn more_grains_than_there_are_numbers_for() {
    for shape in ["Sphere", "Cube"] {
        let said = messages_of_changes(&[
            ("number: 20,", &format!("solid_fraction: 0.1, shape: {shape},")),
            ("Ball(radius: 10.0)", "Ball(radius: 1.0e6)"),
        ]);
        let expected = "more than 9999999 grains for a solid fraction of 0.1 in a ball of radius 1e6 m";
        assert!(said.contains(expected), "{said}");
    }
}

/// Rejects a text that is nested deeper than RON reads, in a scene and in a value that is set.
#[test]
fn brackets_without_end() {
    let deep = format!("{}{}", "(".repeat(100_000), ")".repeat(100_000));
    assert!(messages_of_changes(&[("gravity:", &format!("x: {deep}, gravity:"))]).starts_with("scene.ron:"));
    let settings = [format!("seed={deep}")];
    let text = cd_formats::settings::apply_settings(GOOD, &settings).unwrap();
    let faults = cd_pre::read_scene(std::path::Path::new("scene.ron"), &text, &settings).err().unwrap();
    assert!(faults.to_string().starts_with("options: --set seed"), "{faults}");
}

#[test]
fn moments_of_contacts_need_a_solver_that_knows_them() {
    let rolling = "kind: IQS_DS_ROLL_CLB(dynamic_friction: 0.3, static_friction: 0.4, rolling_friction: 0.1, spinning_friction: 0.1)";
    let used = ("kind: IQS_CLB(friction: 0.4)", rolling);
    let solver = |name: &str| format!("compute: (solver: {name}, ");
    let messages = |law, name: &str| messages_of_changes(&[law, ("compute: (", &solver(name))]);
    for (name, printed) in [("admm", "admm"), ("prox_newton", "prox-newton")] {
        let expected = format!(
            "scene.ron:14:23: compute, solver: {printed} with law 'iqsc0', IQS_DS_ROLL_CLB; expected auto or nlgs"
        );
        assert_eq!(messages(used, name), expected);
    }
    assert_eq!([messages(used, "nlgs"), messages(used, "auto")], ["nothing"; 2]);
    let unused = format!("laws: [(name: \"roll0\", {rolling}), ");
    assert_eq!(messages(("laws: [", &unused), "admm"), "nothing");
}

#[test]
fn driven_in_part_in_axes_that_turn() {
    let fields = |rate: f64| format!("compute: (fields: [RotatingFrame(rate: (0, {rate:?}, 0), centre: (0, 0, 0))], ");
    let messages = |changes: &[(&str, &str)], rate: f64| {
        messages_of_changes(&[changes, &[("compute: (", fields(rate).as_str())]].concat())
    };
    let message = "driven in part in a rotating frame; \
                   expected motion imposed along all axes or none: Coriolis' force on such a body is not computed";
    let press = [("half_lengths", "force: (None, None, Constant(-5)), half_lengths")];
    assert_eq!(messages(&press, 1.0), format!("scene.ron:13:89: wall 1, force: {message}"));
    assert_eq!([messages(&press, 0.0), messages(&[], 1.0)], ["nothing"; 2]);
    let rough = |driven: &str| {
        let list = "sizes: Single(1), placement: List(positions: [(0, 0, 30)])";
        format!("grains: [(material: \"ROCKx\", colour: \"BLUEx\", {list},\n driven: {driven}), (")
    };
    let messages = |driven: &str| messages(&[("grains: [(", rough(driven).as_str())], 1.0);
    assert_eq!(messages("(Constant(1), None, Constant(0))"), format!("scene.ron:7:10: grains 1, driven: {message}"));
    assert_eq!(messages("(None, None, None)"), format!("scene.ron:7:10: grains 1, driven: {message}"));
    assert_eq!(messages("(Constant(1), Constant(1), Constant(0))"), "nothing");
}

#[test]
fn bodies_whose_motion_is_imposed_need_no_law_for_each_other() {
    let rough = |driven: &str| {
        let list = "placement: List(positions: [(0, 0, -15)])";
        messages(
            "    )],\n    walls",
            &format!(
                "    ), (material: \"ROCKx\", colour: \"ROUGH\", sizes: Single(1), {list}, driven: {driven})],\n    walls"
            ),
        )
    };
    let still = "(Constant(0), Constant(0), Constant(0))";
    assert_eq!(
        rough(still),
        "scene.ron:5:15: contacts: no law between 'BLUEx' and 'ROUGH'; expected one for each pair that can meet (law: None for none)"
    );
    // Driven in part it may move against the wall too; one alone does not meet itself.
    let partly = rough("(Constant(0), Constant(0), None)");
    assert_eq!(partly.lines().count(), 2, "{partly}");
}

#[test]
fn ramps_that_do_nothing() {
    let plate = |ramp: &str| {
        let velocity = format!("(Harmonic(amplitude: 1.0, omega: 2.0, {ramp}), Constant(0), Constant(0))");
        messages("half_lengths: (9.0, 9.0, 0.5)", &format!("half_lengths: (9.0, 9.0, 0.5), velocity: {velocity}"))
    };
    for sound in ["ramp_rate: 0.5", "ramp_start: 0.5, ramp_rate: 0.5", "ramp_start: 2.0, ramp_rate: -0.5"] {
        assert_eq!(plate(sound), "nothing", "{sound}");
    }
    assert_eq!(
        plate("ramp_start: 1.0, ramp_rate: 0.5"),
        "scene.ron:13:124: wall 1, velocity 1: ramp_start 1 and ramp_rate 0.5, a factor of 1 at all times; \
         expected a start below 1, or no ramp"
    );
}

#[test]
fn cylinders() {
    let wall = |fields: &str| {
        let plate =
            "Plate(material: \"ROCKx\", colour: \"WALLx\", centre: (0.0, 0.0, -11.0), half_lengths: (9.0, 9.0, 0.5))";
        messages(plate, &format!("Cylinder(material: \"ROCKx\", colour: \"WALLx\", {fields})"))
    };
    let drum = "centre: (0, 0, 0), half_height: 10.5, radius: 10.5, hollow: true";
    assert_eq!(wall(drum), "nothing");
    assert_eq!(wall(&drum.replace("true", "true, force: (None, None, Constant(2)), spin: Constant(1)")), "nothing");
    for (fields, message) in [
        ("centre: (0, 0, 0), half_height: 0, radius: 1", "13:90: wall 1, half_height: 0; expected a length > 0 m"),
        ("centre: (0, 0, 0), half_height: 1, radius: NaN", "13:101: wall 1, radius: NaN; expected a length > 0 m"),
        (
            "centre: (0, 0, -99), half_height: 1, radius: 1, axis: (0, 0, 0)",
            "13:112: wall 1, axis: (0, 0, 0); expected a finite vector that is not 0",
        ),
    ] {
        assert_eq!(wall(fields), format!("scene.ron:{message}"));
    }
    // A pillar through the envelope, which leaves too few sites, a drum in which the grains fit, and one in which they do not.
    let solid = wall("centre: (0, 0, 0), half_height: 20, radius: 8");
    assert!(solid.contains("in a ball of radius 10 m: the lattice has 2 sites"), "{solid}");
    assert_eq!(wall(&drum.replace("radius: 10.5", "radius: 5")), "nothing");
    let small = wall(&drum.replace("radius: 10.5", "radius: 1.1"));
    assert!(small.contains("in a ball of radius 10 m: the lattice has "), "{small}");
}

#[test]
fn numbers_that_the_files_cannot_hold() {
    let place = "placement: List(positions: [(0, 0, 0)])";
    assert_eq!(of_one(&format!("sizes: Single(1), {place}"), 2.0, ""), "nothing");
    let expected = "numbers below 1e40, and sizes of at least 1e-99";
    let expected_moment = "at least 1e-99 and below 1e99";
    // A star of the size of the sun.
    assert_eq!(of_one("sizes: Single(7e8), placement: List(positions: [(1e11, 0, 0)])", 2.0, ""), "nothing");
    for (fields, half, found) in [
        ("sizes: Single(1e21), placement: List(positions: [(1e25, 0, 0)])".to_string(), 2.0, "grains 1: inertia "),
        (format!("sizes: Single(1e-120), {place}"), 2.0, "grains 1, sizes: 1e-120; expected a radius > 0 m"),
        (format!("sizes: Single(1e-40), {place}"), 2.0, "grains 1: mass "),
        (format!("sizes: Single(1), {place}"), 1e39, "wall 1: inertia "),
        (
            "sizes: Single(1), placement: List(positions: [(0, 1e20, 0), (9, 0, 0)]), spin: (0, 0, 1e30)".to_string(),
            2.0,
            "grains 1: velocity ",
        ),
    ] {
        let said = of_one(&fields, half, "");
        assert!(said.contains(found), "{fields}: {said}");
        assert!(found.contains("expected") || said.contains(expected) || said.contains(expected_moment), "{said}");
    }
}

#[test]
fn one_grain_has_no_thermal_velocity() {
    let said = of_one("sizes: Single(1), placement: List(positions: [(0, 0, 0)]), thermal_velocity: 1", 2.0, "");
    assert!(said.ends_with("grains 1, thermal_velocity: given for one grain; expected several grains, or 0: a single grain has no motion about the mean"), "{said}");
}

/// The search for overlaps ends long before it has compared each grain with each.
#[test]
fn grains_at_one_point_are_not_counted_pair_by_pair() {
    let list = format!("sizes: Single(1), placement: List(positions: [{}])", "(0, 0, 0), ".repeat(3000));
    let said = of_one(&list, 2.0, "");
    let overlap =
        "scene.ron:5:88: grains 1, placement: grain 1 of grains 1 and grain 2 of grains 1 overlap by 2.000e0 m; ";
    assert!(said.starts_with(overlap) && said.lines().count() == 6, "{said}");
    // The first 46 grains have 46 * 45 / 2 pairs, of which five are printed.
    assert!(said.contains("grains: at least 1030 more overlaps; "), "{said}");
}

/// A plate among many whose bounding balls it overlaps coincides with one of the last of them.
#[test]
fn an_overlap_behind_many_near_grains_is_found() {
    let plates: String = (0..150).map(|k| format!("(0, 0, {}), ", 0.02 * f64::from(k))).collect();
    let fields = |last: f64| {
        format!(
            "shape: Box(lengths: (2, 2, 0.01)), grain_orientation: Same((axis: (0, 0, 1), angle: 0)), \
             placement: List(positions: [{plates}(0, 0, {last})])"
        )
    };
    assert_eq!(of_one(&fields(3.0), 2.0, ""), "nothing");
    let said = of_one(&fields(2.8), 2.0, "");
    assert!(said.contains("grain 141 of grains 1 and grain 151 of grains 1 overlap by 1.000e-2 m"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

/// Rows of contacts with an unknown law, and a law that is defined many times.
#[test]
fn each_of_many_names_is_checked() {
    let rows: String = (0..4000).map(|k| format!("(between: (\"Q{k:04}\", \"BLUEx\"), law: \"q{k:04}\"), ")).collect();
    let said = messages("contacts: [", &format!("contacts: [{rows}"));
    assert!(said.contains("contact 4000, law: 'q3999' is not defined; expected a law that is defined"), "{said}");
    let laws = "(name: \"q0000\", kind: IQS_CLB(friction: 0.5)), ".repeat(5000);
    let said = messages("laws: [", &format!("laws: [{laws}"));
    assert_eq!(said.lines().count(), 4999);
    assert!(said.lines().all(|line| line.ends_with("'q0000' occurs twice; expected a name of its own")), "{said}");
}

#[test]
fn walls_that_repeat_are_not_overlapped() {
    for shape in ["Sphere", "Box(lengths: (2, 2, 2)), grain_orientation: Same((axis: (0, 0, 1), angle: 0))"] {
        let sizes = if shape == "Sphere" { "sizes: Single(1), " } else { "" };
        let fields = |x: f64| format!("{sizes}shape: {shape}, placement: List(positions: [({x}, 0, 0)])");
        // The floor reaches from -10 to -9 and so, in a scene that repeats after 20 m, from 10 to 11.
        for (x, options, found) in [
            (9.9, "", "nothing"),
            (8.9, "xperiode: 20.0", "nothing"),
            (9.9, "xperiode: 20.0", "grain 1 of grains 1 and wall 1 overlap by 9.000e-1 m"),
            (29.9, "xperiode: 20.0", "grain 1 of grains 1 and wall 1 overlap by 9.000e-1 m"),
        ] {
            let said = of_one(&fields(x), 2.0, options);
            assert!(said.contains(found), "{shape} {x} {options}: {said}");
        }
    }
}

#[test]
fn one_grain_may_spin_where_a_scene_repeats() {
    for (number, positions, found) in [
        (", number: 1", "(0, 0, 0)", "nothing"),
        ("", "(0, 0, 0)", "nothing"),
        ("", "(0, 0, 0), (4, 0, 0)", "grains 1, spin: (1, 0, 0); expected a rotation about the only axis"),
    ] {
        let fields = format!("sizes: Single(1), placement: List(positions: [{positions}]){number}, spin: (1, 0, 0)");
        let said = of_one(&fields, 2.0, "yperiode: 20.0");
        assert!(said.contains(found), "{positions}: {said}");
    }
}

#[test]
fn small_radii_are_printed_with_five_digits() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ron");
    let [from, to] = ["min: 0.5, max: 1.0", "min: 1.2345678e-5, max: 1.2345678e-5"];
    std::fs::write(&file, GOOD.replace(from, to)).unwrap();
    let said = cd_pre::write_datbox(&file, &[], &folder.path().join("DATBOX")).unwrap();
    assert!(said.contains("radius 1.2346e-5 to 1.2346e-5 m (mean 1.2346e-5 m)"), "{said}");
}
