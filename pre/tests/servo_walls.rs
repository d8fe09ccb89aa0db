//! Servos of walls: their rows in DRV_DOF.DAT, ends of drums, and what is rejected.

#[allow(dead_code, reason = "other tests use the rest")]
mod good;

use cd_formats::bodies::{Bodies, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof};
use good::{GOOD, faults};

const PLATE: &str =
    r#"Plate(material: "ROCKx", colour: "WALLx", centre: (0.0, 0.0, -11.0), half_lengths: (9.0, 9.0, 0.5))"#;

/// The good scene with these walls.
fn scene_with_walls(walls: &str) -> String {
    assert!(GOOD.contains(PLATE));
    GOOD.replace(PLATE, walls)
}

/// A wall with other fields.
fn wall(kind: &str, shape: &str, fields: &str) -> String {
    format!("{kind}(material: \"ROCKx\", colour: \"WALLx\", {shape}, {fields})")
}

/// A plate below the grains with other fields.
fn plate(fields: &str) -> String {
    wall("Plate", "centre: (0.0, 0.0, -11.0), half_lengths: (9.0, 9.0, 0.5)", fields)
}

/// A cylinder about z around the grains, or a solid one below them.
fn cylinder(fields: &str) -> String {
    wall("Cylinder", "centre: (0.0, 0.0, 0.0), half_height: 15.0, radius: 20.0", fields)
}

/// Files of a scene: bodies, driven components and initial motion.
fn files(scene: &str) -> (Bodies, Vec<DrivenComponent>, Dof) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ron");
    std::fs::write(&path, scene).unwrap();
    assert_eq!(cd_pre::run(["cd-pre".into(), path.into_os_string()]), 0);
    let datbox = folder.path().join("DATBOX");
    let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT")).unwrap().0;
    (Bodies::read(&datbox.join("BODIES.DAT")).unwrap(), driven, Dof::read(&datbox.join("DOF.INI")).unwrap())
}

/// Component, kind and value at 1 s of the rows of the walls, in the order of the file.
fn rows(walls: &str) -> Vec<(usize, DrivenKind, f64)> {
    let (_, driven, _) = files(&scene_with_walls(walls));
    driven.iter().map(|row| (row.component, row.kind, row.evolution.value_at(1.0))).collect()
}

/// The rows that impose no velocity 0.
fn servo_rows(walls: &str) -> Vec<(usize, DrivenKind, f64)> {
    rows(walls).into_iter().filter(|row| (row.1, row.2) != (DrivenKind::Velocity, 0.0)).collect()
}

#[test]
fn servos_are_rows_of_their_own_kind() {
    use DrivenKind::{Pivot, Pressure, StrainRate, SurfaceVelocity, Velocity};
    let below = "normal: (0.0, 0.0, -2.0), pressure: Table([(0.0, 0.0), (1.0, 5.0)])";
    assert_eq!(servo_rows(&plate(below)), [(2, Pressure, -5.0)]);
    assert_eq!(rows(&plate(below)).len(), 6);
    let lid = wall("Plate", "centre: (0.0, 0.0, 50.0), half_lengths: (9.0, 9.0, 0.5)", "");
    let lid = lid.replace(", )", ")");
    let below_lid = |wall: &str| format!("{wall}, {lid}");
    assert_eq!(servo_rows(&below_lid(&plate("strain_rate: Constant(-0.5)"))), [(2, StrainRate, -0.5)]);
    let pillar =
        wall("Cylinder", "centre: (50.0, 0.0, 0.0), half_height: 5.0, radius: 5.0", "strain_rate: Constant(2.0)");
    let over =
        plate("spin: (Constant(0.0), Constant(0.0), Constant(0.0))").replace("(0.0, 0.0, -11.0)", "(50.0, 0.0, -11.0)");
    assert_eq!(servo_rows(&format!("{pillar}, {over}")), [(2, StrainRate, 2.0)]);
    let belt = "surface_velocity: (Constant(1.5), Constant(0.0), Harmonic(amplitude: 2.0, omega: 0.0))";
    let expected = [(0, SurfaceVelocity, 1.5), (1, SurfaceVelocity, 0.0), (2, SurfaceVelocity, 2.0)];
    assert_eq!(servo_rows(&plate(belt)), expected);
    let turn = "revolution: (axis: (0.0, 3.0, 4.0), point: (1.0, 0.0, -2.0), rate: Constant(10.0))";
    let pivot = [(0, Pivot, 1.0), (1, Pivot, 0.0), (2, Pivot, -2.0)];
    let [spin_y, spin_z] = [(4, Velocity, 6.0), (5, Velocity, 8.0)];
    assert_eq!(servo_rows(&plate(turn)), [&[spin_y, spin_z][..], &pivot].concat());
    assert_eq!(servo_rows(&cylinder("hollow: true, surface_spin: Constant(2.0)")), [(5, SurfaceVelocity, 2.0)]);
    let piston = "axis: (-1.0, 0.0, 0.0), pressure: Constant(7.0)";
    let far = wall("Cylinder", "centre: (50.0, 0.0, 0.0), half_height: 5.0, radius: 5.0", piston);
    assert_eq!(servo_rows(&far), [(0, Pressure, -7.0)]);
}

/// A door that hangs on a hinge along z: its position is on the hinge, with the inertia about it.
#[test]
fn walls_that_turn_freely_have_their_position_on_the_axis() {
    let turn = "revolution: (axis: (0.0, 0.0, 2.0), point: (-9.0, 0.0, 5.0), moment: Constant(3.0))";
    let (bodies, driven, dof) = files(&scene_with_walls(&plate(turn)));
    let rows: Vec<_> = driven.iter().map(|row| (row.component, row.kind, row.evolution.value_at(1.0))).collect();
    use DrivenKind::{Force, Pivot, Velocity};
    let held = [0, 1, 2, 3, 4].map(|component| (component, Velocity, 0.0));
    let pivot = [(0, Pivot, -9.0), (1, Pivot, 0.0), (2, Pivot, -11.0)];
    assert_eq!(rows, [&held[..], &[(5, Force, 3.0)], &pivot].concat());
    let door = bodies.0.last().unwrap();
    assert_eq!(door.position, [-9.0, 0.0, -11.0]);
    let [contactor, point] = &door.contactors[..] else { panic!("{door:?}") };
    assert_eq!(contactor.local_frame.as_ref().unwrap().offset, [9.0, 0.0, 0.0]);
    assert_eq!(point.shape, ShapeRecord::Point { offset: [0.0; 3] });
    let volume = 8.0 * 9.0 * 9.0 * 0.5;
    let moment = door.inertia.unwrap()[2] / (volume * (2.0 * 81.0 / 3.0 + 81.0));
    assert!((moment - 1.0).abs() < 1e-7, "{moment}"); // eight digits
    assert_eq!(dof.bodies.last().unwrap().axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
}

#[test]
fn ends_of_a_drum_are_plates_after_all_other_walls() {
    let ends = "axis: (0.0, 2.0, 0.0), hollow: true, spin: Constant(1.0), velocity: (Constant(0.0), Constant(3.0), \
                Constant(0.0)), ends: (material: \"ROCKx\", colour: \"ENDxx\", spin: Constant(-2.0))";
    let walls = format!(
        "{}, {}",
        cylinder(ends),
        wall("Plate", "centre: (0.0, 0.0, -50.0), half_lengths: (1.0, 1.0, 1.0)", "")
    );
    let scene = scene_with_walls(&walls.replace(", )", ")"));
    let row = "(between: (\"BLUEx\", \"WALLx\"), law: \"iqsc0\")";
    let scene = scene.replace(row, &format!("{row}, (between: (\"BLUEx\", \"ENDxx\"), law: \"iqsc0\")"));
    let (bodies, driven, dof) = files(&scene);
    let [drum, plate, first, second] = &bodies.0[20..] else { panic!("{} bodies", bodies.0.len()) };
    // Half thickness of the ends: a twentieth of the radius.
    let shape = |body: &cd_formats::bodies::Body| body.contactors[0].shape.clone();
    assert_eq!(shape(drum), ShapeRecord::Cylinder { half_height: 17.0, radius: 20.0, hollow: true });
    assert_eq!(plate.position, [0.0, 0.0, -50.0]);
    assert_eq!([first.position, second.position], [[0.0, 16.0, 0.0], [0.0, -16.0, 0.0]]);
    assert_eq!(shape(first), ShapeRecord::Plane { half_lengths: [20.0, 20.0, 1.0] });
    assert_eq!(first.contactors[0].colour, "ENDxx");
    assert_eq!(dof.bodies[22].axes[2], [0.0, 1.0, 0.0]);
    let velocity = |body: usize| [0, 1, 2, 3, 4, 5].map(|k| driven[6 * (body - 20) + k].evolution.value_at(0.0));
    assert_eq!(velocity(20), [0.0, 3.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!([velocity(22), velocity(23)], [[0.0, 3.0, 0.0, 0.0, 0.0, -2.0]; 2]);
}

#[test]
fn servos_of_other_walls_are_rejected() {
    let over = |fields: &str| wall("Plate", "centre: (0.0, 0.0, 50.0), half_lengths: (9.0, 9.0, 0.5)", fields);
    for (walls, expected) in [
        (
            plate("normal: (0.0, 1.0, 1.0), pressure: Constant(5.0)"),
            "pressure: along an oblique direction; expected a wall whose normal or axis is along x, y or z",
        ),
        (
            plate("velocity: (Constant(0.0), Constant(0.0), Constant(1.0)), pressure: Constant(5.0)"),
            "pressure: a wall that also moves otherwise; expected no other motion or load along the axis, and none that \
             tilts the wall",
        ),
        (plate("moment: (Some(Constant(0.0)), None, None), strain_rate: Constant(5.0)"), "that tilts the wall"),
        (plate("pressure: Constant(1.0), strain_rate: Constant(5.0)"), "strain_rate: a wall that also moves otherwise"),
        (
            plate(
                "spin: (Constant(0.0), Constant(0.0), Constant(1.0)), revolution: (axis: (0, 0, 1), rate: Constant(5.0))",
            ),
            "revolution: a wall that also moves otherwise; expected no other velocity, spin, force or moment",
        ),
        (plate("revolution: (axis: (0, 0, 0), rate: Constant(5.0))"), "axis"),
        (plate("revolution: (axis: (0, 0, 1))"), "revolution: neither a rate nor a moment; expected one of the two"),
        (
            plate("revolution: (axis: (0, 0, 1), rate: Constant(5.0), moment: Constant(0.0))"),
            "revolution: a rate and a moment; expected one of the two",
        ),
        (
            plate("moment: (None, None, Constant(1.0)), revolution: (axis: (0, 0, 1), moment: Constant(0.0))"),
            "revolution: a wall that also moves otherwise; expected no other velocity, spin, force or moment",
        ),
        (
            cylinder("hollow: true, revolution: (axis: (0, 0, 1), moment: Constant(0.0))"),
            "of a hollow cylinder; expected a solid one, or a rate",
        ),
        (
            cylinder("surface_spin: Constant(1.0), revolution: (axis: (0, 0, 1), moment: Constant(0.0))"),
            "of a cylinder with a surface_spin; expected a rate, or no surface_spin",
        ),
        (
            plate("strain_rate: Constant(5.0)"),
            "strain_rate: without a plate opposite to the wall; expected a second plate across the line",
        ),
        (
            format!("{}, {}", plate("strain_rate: Constant(5.0)"), over("force: (None, None, Constant(1.0))")),
            "relative to wall 2, whose velocity along the axis is not imposed; expected a plate opposite to it",
        ),
        (
            cylinder("hollow: true, strain_rate: Constant(5.0)"),
            "of a hollow cylinder; expected a solid one: the strain rate",
        ),
        (cylinder("hollow: true, pressure: Constant(5.0)"), "pressure: of a hollow cylinder; expected a solid one"),
        (
            cylinder("ends: (material: \"ROCKx\", colour: \"WALLx\")"),
            "ends: of a solid cylinder; expected a hollow one",
        ),
    ] {
        let found = faults(&scene_with_walls(&walls.replace("moment: (Some(Constant(0.0))", "moment: (Constant(0.0)")));
        // Messages have blanks in place of dots and path elements from 1.
        let words = expected
            .replace("pressure: ", "")
            .replace("strain_rate: ", "")
            .replace("revolution: ", "")
            .replace("ends: ", "");
        assert!(found.contains(&words), "{walls}\n{found}");
    }
}
