//! DATBOX of polyhedra: its numbers are consistent to the digits of the files.

use std::path::Path;

use cd_formats::bodies::{Bodies, Body, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::scan::AsciiText;
use cd_formats::surface::Surface;
use cd_pre::write;
use nalgebra::{Matrix3, Vector3};

/// A scene of one group of grains, with the given fields and an envelope that suits `number` grains of radius 1.
fn scene(fields: &str) -> String {
    format!(
        r#"(
            seed: 3,
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {fields})],
        )"#
    )
}

fn files(text: &str) -> (Bodies, Dof, String) {
    let (scene, population) =
        cd_pre::read_scene(Path::new("scene.ron"), text, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let files = write::datbox_files(&scene, &population);
    let of = |name: &str| files.iter().find(|(known, _)| known == name).unwrap().1.clone();
    let bodies = Bodies::parse(Path::new("BODIES.DAT"), &AsciiText::new(of("BODIES.DAT").as_bytes())).unwrap();
    let dof = Dof::parse(Path::new("DOF.INI"), &AsciiText::new(of("DOF.INI").as_bytes())).unwrap();
    (bodies, dof, of("TACT_BEHAV.DAT"))
}

fn surface(body: &Body) -> Surface {
    let [contactor] = body.contactors.as_slice() else { panic!("{} contactors", body.contactors.len()) };
    let ShapeRecord::Polyhedron { vertices, triangles } = &contactor.shape else { panic!("no polyhedron") };
    Surface::new(vertices, triangles).unwrap()
}

/// Vertices as they stand, m.
fn standing(body: &Body, axes: &[[f64; 3]; 3]) -> Vec<Vector3<f64>> {
    let turn = Matrix3::from_columns(&axes.map(Vector3::from));
    surface(body).vertices().iter().map(|&v| Vector3::from(body.position) + turn * Vector3::from(v)).collect()
}

#[test]
fn random_rocks_are_in_their_principal_axes_with_their_mass_and_inertia() {
    for shape in [
        "Random(vertices: (8, 20))",
        "Random(vertices: (6, 12), ratios: (3, 2, 1), angularity: 0.9)",
        "Dodecahedron",
        "Prism(sides: 5, slenderness: 4)",
    ] {
        let (bodies, dof, _) = files(&scene(&format!(
            "number: 60, solid_fraction: 0.004, sizes: Uniform(min: 0.8, max: 1.2), shape: {shape}, \
             placement: JitteredLattice(envelope: Ball()), spin: (0, 0, 0.5)"
        )));
        assert_eq!(bodies.0.len(), 60);
        for (body, dof) in bodies.0.iter().zip(&dof.bodies) {
            let surface = surface(body);
            let properties = surface.mass_properties();
            // Vertices of about 1 have 11 or 12 digits; their errors add up to some 1e-11.
            let volume = 4.0 / 3.0 * std::f64::consts::PI * body.equivalent_radius.powi(3);
            assert!((properties.volume / volume - 1.0).abs() < 1e-10, "{shape}");
            assert!((0.8..=1.2).contains(&body.equivalent_radius));
            assert!(Vector3::from(properties.centre).norm() < 1e-10, "{shape}: {:?}", properties.centre);
            let inertia = Matrix3::from(properties.inertia);
            let written = Matrix3::from_diagonal(&body.inertia.unwrap().into());
            assert!((inertia - written).amax() < 1e-9 * inertia.trace(), "{shape}: {inertia}");
            assert!(surface.is_convex(1e-10));
            // Axes are orthonormal to their digits, and the spin is along the fixed third axis.
            let axes = Matrix3::from_columns(&dof.axes.map(Vector3::from));
            assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-10);
            let spin = axes * Vector3::from_fn(|k, _| dof.velocity[3 + k]);
            assert!((spin - Vector3::new(0.0, 0.0, 0.5)).norm() < 1e-6); // seven digits
        }
        // Random turns: no two grains stand alike.
        assert!(dof.bodies.windows(2).all(|pair| pair[0].axes != pair[1].axes));
    }
}

#[test]
fn rocks_placed_by_their_balls_do_not_overlap_and_files_are_the_same_again() {
    for (solid_fraction, place) in
        [(0.002, "JitteredLattice(envelope: Ball())"), (0.08, "RandomSequential(envelope: Box(ratios: (1, 2, 1)))")]
    {
        let text = scene(&format!(
            "number: 100, solid_fraction: {solid_fraction}, sizes: PowerLaw(min: 0.5, max: 2, exponent: 3), \
             shape: Random(vertices: (12, 20)), radius: Circumscribed, placement: {place}"
        ));
        let (bodies, dof, _) = files(&text);
        let reach = |body: &Body| surface(body).vertices().iter().map(|&v| Vector3::from(v).norm()).fold(0.0, f64::max);
        for (k, a) in bodies.0.iter().enumerate() {
            assert!((0.5 - 1e-7..=2.0 + 1e-7).contains(&reach(a)), "circumscribed {}", reach(a));
            for b in &bodies.0[..k] {
                let distance = (Vector3::from(a.position) - Vector3::from(b.position)).norm();
                assert!(distance >= reach(a) + reach(b));
            }
        }
        assert_eq!(files(&text), (bodies, dof, files(&text).2));
    }
}

#[test]
fn given_vertices_about_their_centre_keep_their_digits() {
    // A brick along its own axes, with lengths that eight digits do not hold.
    let (a, b, c) = (1.0 / 3.0, 0.123456789012, 0.7777777777777);
    let corner = |k: usize| {
        let side = |axis: usize, half: f64| if k >> axis & 1 == 0 { -half } else { half };
        format!("({:?}, {:?}, {:?})", side(0, a), side(1, b), side(2, c))
    };
    let vertices: Vec<String> = (0..8).map(corner).collect();
    let (bodies, dof, _) = files(&scene(&format!(
        "shape: Vertices([{}]), grain_orientation: Same((axis: (0, 0, 1), angle: 0)), placement: List(positions: [(1, 2, 3)])",
        vertices.join(", ")
    )));
    let [x, y, z] = surface(&bodies.0[0]).vertices()[7];
    // In columns of 14: 0.33333333333 and so on; the last digit that there is.
    assert_eq!((x, y, z), (0.33333333333, 0.12345678901, 0.77777777778));
    assert_eq!(dof.bodies[0].axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(bodies.0[0].position, [1.0, 2.0, 3.0]);
}

#[test]
fn given_vertices_are_moved_and_turned_with_a_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.ron");
    // The corner tetrahedron: its principal axes are not the given ones.
    let vertices = [[10.0, 0.0, 0.0], [13.0, 0.0, 0.0], [10.0, 2.0, 0.0], [10.0, 0.0, 1.0]];
    let text = scene(
        "shape: Vertices([(10, 0, 0), (13, 0, 0), (10, 2, 0), (10, 0, 1)]), \
         grain_orientation: Same((axis: (0, 0, 1), angle: 0)), placement: List(positions: [(0.75, 0.5, 0.25)])",
    );
    std::fs::write(&path, &text).unwrap();
    let said = cd_pre::write_datbox(&path, &[], &folder.path().join("DATBOX")).unwrap();
    assert!(
        said.contains(
            "centre of mass at (10.75000000, 0.50000000, 0.25000000) m in the axes in which the shape is given"
        ),
        "{said}"
    );
    assert!(said.contains("principal axes rotated by 0."), "{said}");
    assert!(said.contains("1 polyhedron (4 vertices each)"), "{said}");
    // Turned back and moved, the vertices are those that were given, less 10 along x.
    let (bodies, dof, _) = files(&text);
    for (found, given) in standing(&bodies.0[0], &dof.bodies[0].axes).iter().zip(vertices) {
        assert!((found - (Vector3::from(given) - Vector3::new(10.0, 0.0, 0.0))).norm() < 1e-10);
    }
}

#[test]
fn listed_polyhedra_have_their_orientations_and_may_touch_but_not_overlap() {
    // Three cubes of side 2: one on the other, and one on its edge next to them, as near as possible.
    let beside = 1.0 + 2f64.sqrt();
    let stack = |x: f64, z: f64| {
        scene(&format!(
            "shape: Box(lengths: (2, 2, 2)), placement: List(positions: [(0, 0, 0), (0, 0, {z:?}), ({x:?}, 0, 0)]), \
             grain_orientation: List([(axis: (1, 0, 0), angle: 0), (axis: (0, 0, 1), angle: 0.3), (axis: (0, 1, 0), angle: 0.7853981633974483)])"
        ))
    };
    let (bodies, dof, tact) = files(&stack(beside, 2.0));
    let lowest = standing(&bodies.0[1], &dof.bodies[1].axes).iter().map(|v| v.z).fold(f64::INFINITY, f64::min);
    assert!((lowest - 1.0).abs() < 1e-11);
    assert!(tact.contains("RBDY3  POLYR  BLUEx  iqsc0  RBDY3  POLYR  BLUEx"), "{tact}");
    for (x, z, found) in [
        (beside, 1.99, "grain 1 of grains 1 and grain 2 of grains 1 overlap by 1.000e-2 m"),
        (beside - 0.01, 2.0, "grain 1 of grains 1 and grain 3 of grains 1 overlap by 1.000e-2 m"),
    ] {
        let said = cd_pre::read_scene(Path::new("scene.ron"), &stack(x, z), &[]).unwrap_err().to_string();
        assert!(said.contains(found), "{said}");
    }
}

#[test]
fn spheres_polyhedra_and_walls_see_each_other_in_the_order_of_lmgc90() {
    let text = r#"(
        materials: [(name: "ROCKx", density: 2000.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
        contacts: [
            (between: ("CUBEx", "BALLx"), law: "iqsc0"), (between: ("CUBEx", "CUBEx"), law: "iqsc0"),
            (between: ("BALLx", "BALLx"), law: "iqsc0"), (between: ("WALLx", "CUBEx"), law: "iqsc0"),
            (between: ("WALLx", "BALLx"), law: None),
        ],
        grains: [
            (material: "ROCKx", colour: "CUBEx", sizes: Single(1), shape: Cube, grain_orientation: Same((axis: (0, 0, 1), angle: 0)),
             placement: List(positions: [(0, 0, 0)])),
            (material: "ROCKx", colour: "BALLx", sizes: Single(0.5), placement: List(positions: [(BALL, 0, 0)])),
        ],
        walls: [Plate(material: "ROCKx", colour: "WALLx", centre: (0, 0, FLOOR), half_lengths: (3, 3, 0.5))],
    )"#;
    // The cube of the volume of the ball of radius 1 has this half side.
    let half = (std::f64::consts::PI / 6.0).cbrt();
    let with =
        |ball: f64, floor: f64| text.replace("BALL,", &format!("{ball:?},")).replace("FLOOR", &format!("{floor:?}"));
    let (bodies, _, tact) = files(&with(half + 0.5, -half - 0.5));
    assert_eq!(bodies.0.len(), 3);
    let sees: Vec<&str> = tact.lines().filter(|line| line.trim_start().starts_with("RBDY3")).collect();
    let pairs: Vec<(&str, &str)> = sees
        .iter()
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            (words[1], words[5])
        })
        .collect();
    assert_eq!(pairs, [("SPHER", "POLYR"), ("POLYR", "POLYR"), ("SPHER", "SPHER"), ("POLYR", "PLANx")]);
    for (ball, floor, found) in [
        (half + 0.4, -half - 0.5, "grain 1 of grains 1 and grain 1 of grains 2 overlap by 1.000e-1 m"),
        (half + 0.5, -half - 0.4, "grain 1 of grains 1 and wall 1 overlap by 1.000e-1 m"),
    ] {
        let said = cd_pre::read_scene(Path::new("scene.ron"), &with(ball, floor), &[]).unwrap_err().to_string();
        assert!(said.contains(found), "{said}");
    }
}
