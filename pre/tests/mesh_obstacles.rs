//! Polyhedra and cylinders near triangulated walls: they are placed around them, and their overlaps are rejected.

use cd_pre::grain::Population;
use nalgebra::Vector3;

/// Reads a scene with these grains and the wall of the surface `obj`, with further fields.
fn read(obj: &str, wall: &str, grains: &str) -> Result<Population, String> {
    read_with_wall(obj, &format!("Mesh(material: \"ROCKx\", colour: \"WALLx\", file: \"wall.obj\"{wall})"), grains)
}

/// Reads a scene with these grains and a wall, next to the surface `obj`.
fn read_with_wall(obj: &str, wall: &str, grains: &str) -> Result<Population, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("wall.obj"), obj).unwrap();
    let text = format!(
        r#"(
            seed: 1,
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0"), (between: ("BLUEx", "WALLx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {grains})],
            walls: [{wall}],
        )"#
    );
    cd_pre::read_scene(&folder.path().join("scene.ron"), &text, &[])
        .map(|(_, population)| population)
        .map_err(|faults| faults.to_string().replace(&format!("{}/", folder.path().display()), ""))
}

/// Surface z = x/2 over a square of the half length 4 as `number` squared squares of two triangles.
fn slope(number: usize) -> String {
    let at = |k: usize| 8.0 * k as f64 / number as f64 - 4.0;
    let vertex = |k: usize| {
        let (x, y) = (at(k % (number + 1)), at(k / (number + 1)));
        format!("v {x} {y} {}\n", 0.5 * x)
    };
    let vertices: String = (0..(number + 1).pow(2)).map(vertex).collect();
    let faces = (0..number * number).map(|k| {
        let corner = k / number * (number + 1) + k % number + 1;
        format!("f {} {} {} {}\n", corner, corner + 1, corner + number + 2, corner + number + 1)
    });
    vertices + &faces.collect::<String>()
}

/// Cube of the half length 2, seen from outside.
const CUBE: &str = "v -2 -2 -2\nv 2 -2 -2\nv 2 2 -2\nv -2 2 -2\nv -2 -2 2\nv 2 -2 2\nv 2 2 2\nv -2 2 2\n\
                    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// Orientation of grains along the fixed axes.
const STRAIGHT: &str = "grain_orientation: Same((axis: (0, 0, 1), angle: 0))";

/// Cube of the half length 0.5 at a position.
fn cube_at(position: &str) -> String {
    format!("shape: Box(lengths: (1, 1, 1)), {STRAIGHT}, placement: List(positions: [{position}])")
}

/// Farthest points of a grain.
fn corners(population: &Population) -> Vec<Vec<Vector3<f64>>> {
    let of_grain = |grain: &cd_pre::grain::Grain| {
        let at = |local: Vector3<f64>| grain.position + grain.axes().tr_mul(&local);
        if let Some(solid) = grain.shape.round_solid() {
            let corner = |k: u32| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 32.0).sin_cos();
                let radius = solid.shape.radius;
                [1.0, -1.0].map(|side| at(Vector3::new(radius * cos, radius * sin, side * solid.shape.half_length)))
            };
            return (0..32).flat_map(corner).collect();
        }
        let polyhedron = grain.shape.polyhedron().unwrap();
        polyhedron.vertices().into_iter().flatten().map(|vertex| at(vertex.into())).collect()
    };
    population.grains.iter().map(of_grain).collect()
}

/// All corners of a grain are on one side of the slope, but for a millionth of the radius, to which bodies may overlap.
#[test]
fn rocks_and_cylinders_are_placed_around_a_surface() {
    let rocks = "shape: Random(vertices: (8, 14), ratios: (1, 0.7, 0.4)), sizes: Uniform(min: 0.3, max: 0.4)";
    for grains in [
        format!("number: 60, {rocks}, placement: RandomSequential(envelope: Box(lengths: (6, 6, 6)))"),
        "number: 20, shape: Cylinder(half_height: 0.5, radius: 0.3), placement: RandomSequential(envelope: Box(lengths: \
         (6, 6, 6)))"
            .into(),
        format!("solid_fraction: 0.4, {rocks}, placement: DensePacking(envelope: Box(lengths: (4, 4, 4)))"),
    ] {
        let population = read(&slope(6), "", &grains).unwrap();
        let heights = |points: &[Vector3<f64>]| -> Vec<f64> { points.iter().map(|p| p.z - 0.5 * p.x).collect() };
        let is_above = |heights: &[f64]| heights.iter().all(|height| *height > -1e-6);
        let is_below = |heights: &[f64]| heights.iter().all(|height| *height < 1e-6);
        let heights: Vec<Vec<f64>> = corners(&population).iter().map(|points| heights(points)).collect();
        assert!(heights.iter().all(|heights| is_above(heights) || is_below(heights)), "{grains}");
        // Their bounding balls may enter the surface, their shapes not.
        assert!(heights.iter().any(|heights| is_above(heights)) && heights.iter().any(|heights| is_below(heights)));
    }
}

/// Dense packings keep out of a solid cube, and those that reach out of a drum are rejected.
#[test]
fn dense_packings_keep_out_of_solids() {
    let spheres = |number: usize, length: usize| {
        format!(
            "number: {number}, sizes: Uniform(min: 0.5, max: 0.6), placement: DensePacking(envelope: Box(lengths: \
             ({length}, {length}, {length})))"
        )
    };
    let drum = "Cylinder(material: \"ROCKx\", colour: \"WALLx\", centre: (0, 0, 0), axis: (0, 1, 0), half_height: 2.5, \
                radius: 3, hollow: true)";
    let faults = read_with_wall("", drum, &spheres(80, 6)).unwrap_err();
    assert!(faults.contains("expected an envelope within the hollow cylinder, such as a Cylinder"), "{faults}");
    let population = read(CUBE, "", &spheres(150, 8)).unwrap();
    for grain in &population.grains {
        let beyond = grain.position.abs().add_scalar(-2.0);
        assert!(beyond.sup(&Vector3::zeros()).norm() > (1.0 - 1e-6) * grain.radius, "{grain:?}");
    }
}

#[test]
fn overlaps_of_rocks_and_cylinders_with_a_surface_are_rejected() {
    let flat = "v -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\nf 1 2 3 4\n";
    let cylinder = "shape: Cylinder(half_height: 0.5, radius: 0.3), placement: List(positions: [(0, 0, 0.4)])";
    for grains in [cube_at("(0.3, 0.2, 0.4)"), format!("{cylinder}, {STRAIGHT}")] {
        let faults = read(flat, "", &grains).unwrap_err();
        let found = "grain 1 of grains 1 and wall 1 overlap by 1.000e-1 m; expected grains that touch at most";
        assert!(faults.contains(found), "{faults}");
        let allowed = grains.replace("])", "], allow_overlap: true)");
        assert!(read(flat, "", &allowed).is_ok());
    }
    // A cube that lies on the surface, next to it, and behind one with one side.
    for (position, wall) in [
        ("(0.3, 0.2, 0.5)", ""),
        ("(4.5, 0, 0)", ""),
        ("(0, 0, -0.6)", ", side: Front"),
        ("(0, 0, -0.5)", ", side: Back"),
    ] {
        assert_eq!(read(flat, wall, &cube_at(position)).err(), None, "{position}");
    }
}

/// Cubes in and on a solid cube, in a container and in a thin shell.
#[test]
fn a_rock_inside_of_a_solid_overlaps_it() {
    for (position, wall, overlap) in [
        // The middle of the small cube is 1 m behind the nearest face.
        ("(1, 0, 0.3)", "", Some("1.000e0")),
        ("(2.4, 0, 0)", "", Some("1.000e-1")),
        ("(2.5, 0, 0)", "", None),
        ("(1, 0, 0.3)", ", side: Both", None),
        ("(1.5, -1.5, -1.5)", ", side: Back", None),
        ("(1.6, 0, 0)", ", side: Back", Some("1.000e-1")),
        ("(4, 0, 0)", ", side: Back", Some("2.000e0")),
    ] {
        let found = read(CUBE, wall, &cube_at(position)).err();
        match overlap {
            None => assert_eq!(found, None, "{position}{wall}"),
            Some(depth) => {
                let found = found.unwrap_or_default();
                assert!(found.contains(&format!("overlap by {depth} m")), "{position}{wall}: {found}");
            }
        }
    }
}
