//! Scenes that start dense: packings of spheres, polyhedra placed by their shapes, particles of other programs.

use std::path::Path;

use cd_pre::grain::{Grain, Population};
use cd_pre::scene::Scene;
use cd_pre::shapes::OrientedShape;
use nalgebra::Vector3;

/// Scene with these grains, and further fields.
fn scene(grains: &str, fields: &str) -> String {
    format!(
        r#"(
            seed: 1,
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {grains})],
            {fields}
        )"#
    )
}

/// Reads a scene in a folder.
fn read(folder: &Path, text: &str) -> Result<(Scene, Population), String> {
    cd_pre::read_scene(&folder.join("scene.ron"), text, &[])
        .map_err(|faults| faults.to_string().replace(&format!("{}/", folder.display()), ""))
}

fn placed(text: &str) -> Population {
    read(Path::new(""), text).unwrap_or_else(|faults| panic!("{faults}")).1
}

/// Solid fraction of the grains in their envelope.
fn solid_fraction(population: &Population) -> f64 {
    let volume: f64 = population.grains.iter().map(|grain| grain.volume()).sum();
    volume / population.regions[0].as_ref().unwrap().volume()
}

/// Rocks that are three times as long as thin: balls around them hardly fit at a solid fraction of 12 %.
const ROCKS: &str = "shape: Random(vertices: (8, 14), ratios: (1, 0.7, 0.4), angularity: 0.6), \
                     sizes: Uniform(min: 0.2, max: 0.4)";

#[test]
fn rocks_whose_balls_do_not_fit_are_placed_by_their_shapes() {
    // The reader rejects overlaps by the separating axes of the shapes.
    let box_of = |height: f64| {
        scene(
            &format!(
                "number: 40, {ROCKS}, placement: RandomSequential(envelope: Box(lengths: (2.5, 2.5, {height:?}))), \
                 centre: (0, 0, 4), orientation: (axis: (1, 2, 0), angle: 0.4)"
            ),
            "",
        )
    };
    let population = placed(&box_of(4.2));
    assert_eq!(population.grains.len(), 40);
    let balls_overlap = |a: usize, b: usize| {
        let [first, second] = [a, b].map(|k| &population.grains[k]);
        (first.position - second.position).norm() < first.reach + second.reach
    };
    assert!((0..40).any(|a| (0..a).any(|b| balls_overlap(a, b))), "the balls fit");
    assert_eq!(placed(&box_of(4.2)), population);
    let faults = read(Path::new(""), &box_of(2.1)).unwrap_err();
    assert!(faults.contains("of 40 grains (largest first) could be placed in a box"), "{faults}");
    assert!(faults.contains("tries found no free position for the next by its shape; expected"), "{faults}");
    let capsules = "number: 40, shape: Capsule(half_length: 1, radius: 0.5), placement: RandomSequential(envelope: \
                    Box(lengths: (5, 5, 5))), centre: (0, 0, 4)";
    let faults = read(Path::new(""), &scene(capsules, "")).unwrap_err();
    assert!(faults.contains("found no free position for the next; expected DensePacking, which packs"), "{faults}");
}

/// A cube in the middle, a sphere next to it and an inclined plate through the envelope; the positions are checked for overlaps
/// by the reader. Without obstacles the same grains are elsewhere.
#[test]
fn grains_are_placed_around_walls_and_the_groups_before() {
    let list = |positions: &str| format!("placement: List(positions: [{positions}])");
    let next = "), (material: \"ROCKx\", colour: \"BLUEx\"";
    let obstacles = format!(
        "shape: Cube, sizes: Single(1.2), {}{next}, sizes: Single(0.8), {}{next}, ",
        list("(0, 0, 0)"),
        list("(2.6, 0, 0)")
    );
    let wall = "walls: [Plate(material: \"ROCKx\", colour: \"BLUEx\", centre: (0, 0, -2), normal: (1, 0, 3), \
                half_lengths: (9, 9, 0.2))],";
    let clumps = "shape: Clump([(0, 0, 0, 0.4), (0.5, 0, 0, 0.3)])";
    let rocks = ROCKS.replace("0.2", "0.3");
    for (placement, grains) in [
        ("RandomSequential", "number: 150, sizes: Single(0.4)".to_string()),
        ("RandomSequential", format!("number: 60, {rocks}")),
        ("RandomSequential", format!("number: 30, {clumps}")),
        ("JitteredLattice", "number: 150, sizes: Single(0.4)".to_string()),
        ("JitteredLattice", format!("number: 50, {clumps}")),
        ("DensePacking", "number: 250, sizes: Single(0.4)".to_string()),
        ("DensePacking", format!("number: 200, {rocks}")),
        ("DensePacking", format!("number: 200, {clumps}")),
    ] {
        let grains = format!("{grains}, placement: {placement}(envelope: Box(lengths: (6, 6, 6)))");
        let around = scene(&format!("{obstacles}{grains}"), wall);
        let alone = placed(&scene(&grains, ""));
        let population = placed(&around);
        assert_eq!(population.grains.len(), alone.grains.len() + 2);
        let is_in_cube = |grain: &cd_pre::grain::Grain| grain.position.norm() < 0.9; // half of its edge is 0.97 m
        assert!(alone.grains.iter().any(is_in_cube), "{grains}: the cube is in no grain's place");
        assert_eq!(population.grains.iter().filter(|grain| is_in_cube(grain)).count(), 1, "{grains}");
        assert_eq!(placed(&around), population);
    }
}

#[test]
fn dense_packings_fill_every_envelope() {
    for (envelope, amount, nu) in [
        ("Ball()", "number: 250, solid_fraction: 0.5", 0.5),
        ("Ellipsoid(ratios: (2, 1.5, 1))", "number: 250, solid_fraction: 0.45", 0.45),
        ("Box(ratios: (1, 1, 2))", "number: 250, solid_fraction: 0.5", 0.5),
        ("Cylinder(half_height: 6, radius: 5)", "solid_fraction: 0.45", 0.45),
    ] {
        let population = placed(&scene(
            &format!(
                "{amount}, sizes: Uniform(min: 0.8, max: 1.2), placement: DensePacking(envelope: {envelope}), \
                 centre: (30, -20, 10), orientation: (axis: (1, 1, 1), angle: 0.7)"
            ),
            "",
        ));
        // Whole grains: half of the largest one in the given cylinder, 0.5 * 4.19 * 1.2^3 / 942.
        assert!((solid_fraction(&population) - nu).abs() < 4e-3, "{envelope}: {}", solid_fraction(&population));
        let region = population.regions[0].as_ref().unwrap();
        let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
        let turn = nalgebra::Rotation3::from_axis_angle(&axis, 0.7);
        for grain in &population.grains {
            let local = turn.inverse() * (grain.position - Vector3::new(30.0, -20.0, 10.0));
            assert!(region.contains_ball(&local, grain.radius), "{envelope}: {local}");
        }
    }
}

#[test]
fn a_dense_box_as_long_as_the_periods_has_no_walls_along_them() {
    let grains = "solid_fraction: 0.58, sizes: Single(0.5), \
                  placement: DensePacking(envelope: Box(lengths: (6, 6, 8))), centre: (10, 0, 4)";
    let population = placed(&scene(grains, "compute: (xperiode: 6.0, yperiode: 6.0),"));
    let positions: Vec<Vector3<f64>> = population.grains.iter().map(|grain| grain.position).collect();
    for axis in 0..2 {
        let (low, high) = positions.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), position| {
            (low.min(position[axis]), high.max(position[axis]))
        });
        // Centres reach nearer to the ends than a radius, and no farther than a period apart.
        assert!(high - low > 5.5 && high - low <= 6.0, "{low} {high}");
    }
    let image = |d: f64| d - 6.0 * (d / 6.0).round();
    for (k, a) in positions.iter().enumerate() {
        assert!((0.5..=7.5).contains(&a.z));
        for b in &positions[..k] {
            let separation = Vector3::new(image(a.x - b.x), image(a.y - b.y), a.z - b.z);
            assert!(separation.norm() >= 1.0, "{separation}");
        }
    }
    let closed = placed(&scene(grains, "compute: (xperiode: 6.0, yperiode: 6.0, zperiode: 8.0),"));
    let heights: Vec<f64> = closed.grains.iter().map(|grain| grain.position.z).collect();
    let (low, high) =
        heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(*z), high.max(*z)));
    assert!(high - low > 7.5 && high - low <= 8.0, "{low} {high}");
    // With walls on all sides such a packing jams below.
    let walled = read(Path::new(""), &scene(&grains.replace("0.58", "0.62"), "")).unwrap_err();
    assert!(walled.contains("jam: they fit at 0.5"), "{walled}");
}

#[test]
fn a_group_that_overlaps_the_image_of_a_dense_one_is_reported() {
    let grains = "solid_fraction: 0.3, sizes: Single(0.5), placement: DensePacking(envelope: Box(lengths: (6, 6, 4)))), \
                  (material: \"ROCKx\", colour: \"BLUEx\", sizes: Single(0.5), \
                  placement: List(positions: [POSITION])";
    let of = |position: Vector3<f64>| {
        let position = format!("({:?}, {:?}, {:?})", position.x, position.y, position.z);
        read(Path::new(""), &scene(&grains.replace("POSITION", &position), "compute: (xperiode: 6.0, yperiode: 6.0),"))
    };
    let free = of(Vector3::new(0.0, 0.0, 3.0)).unwrap().1;
    // The packed grain that is farthest along x: a grain a little more than half a period away overlaps its image.
    let outermost = free.grains.iter().map(|grain| grain.position).max_by(|a, b| a.x.total_cmp(&b.x)).unwrap();
    let faults = of(outermost - Vector3::new(5.5, 0.0, 0.0)).unwrap_err();
    assert!(faults.contains("overlap by 5.000e-1 m"), "{faults}"); // distance 0.5 of spheres of radius 0.5
}

/// Extents of the farthest points of all grains along x and y, m.
fn extents(population: &Population) -> [f64; 2] {
    let ends = |axis: usize| {
        let corners = population.grains.iter().flat_map(corners);
        corners.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (corner, radius)| {
            (low.min(corner[axis] - radius), high.max(corner[axis] + radius))
        })
    };
    [0, 1].map(|axis| {
        let (low, high) = ends(axis);
        high - low
    })
}

/// Balls around the grains reach beyond the period, their shapes do not.
#[test]
fn shapes_in_a_box_up_to_a_period_long_fit_into_it() {
    let periods = "compute: (xperiode: 3.0, yperiode: 3.0),";
    let rocks = "solid_fraction: 0.12, shape: Random(vertices: (8, 14), ratios: (1, 0.7, 0.4)), \
                 sizes: Uniform(min: 0.2, max: 0.25)";
    let bricks = "number: 20, shape: Box(lengths: (0.4, 0.4, 1.2)), \
                  grain_orientation: Same((axis: (1, 0, 0), angle: 0.0))";
    let clumps = "solid_fraction: 0.25, shape: Clump([(0, 0, 0, 0.3), (0.5, 0, 0, 0.2)]), sizes: Single(0.25)";
    for (grains, placement, length) in [
        (rocks, "RandomSequential", 3.0),
        (rocks, "RandomSequential", 2.95),
        (rocks, "DensePacking", 2.9),
        (bricks, "DensePacking", 2.9),
        (clumps, "DensePacking", 2.98),
    ] {
        let envelope = format!("placement: {placement}(envelope: Box(lengths: ({length:?}, {length:?}, 4)))");
        let population = placed(&scene(&format!("{grains}, {envelope}"), periods));
        let reaches = |axis: usize| population.grains.iter().map(move |grain| (grain.position[axis], grain.reach));
        let is_past_period = |axis: usize| {
            reaches(axis).map(|(x, reach)| x + reach).fold(0.0, f64::max)
                - reaches(axis).map(|(x, reach)| x - reach).fold(0.0, f64::min)
                > 3.0
        };
        assert!((0..2).any(is_past_period), "{grains} {envelope}: the balls fit");
        let found = extents(&population);
        assert!(found.iter().all(|extent| *extent <= length), "{grains} {envelope}: {found:?}");
    }
}

/// A boulder of radius 1 across the border of a cell of the length 6: its image is at x = -3.1.
#[test]
fn grains_are_placed_around_the_images_of_a_boulder() {
    let periods = "compute: (xperiode: 6.0, yperiode: 6.0),";
    let boulder = "sizes: Single(1), placement: List(positions: [(2.9, 0, 0)])";
    let next = "), (material: \"ROCKx\", colour: \"BLUEx\", ";
    for (placement, length) in
        [("RandomSequential", 6.0), ("JitteredLattice", 5.9), ("DensePacking", 5.9), ("DensePacking", 6.0)]
    {
        let number = if placement == "DensePacking" { 250 } else { 80 };
        let grains = format!(
            "number: {number}, sizes: Single(0.4), placement: {placement}(envelope: Box(lengths: ({length:?}, 6, 4)))"
        );
        let alone = placed(&scene(&grains, periods));
        let around = placed(&scene(&format!("{boulder}{next}{grains}"), periods));
        let gap_to_image = |grain: &Grain| (grain.position - Vector3::new(-3.1, 0.0, 0.0)).norm() - grain.reach - 1.0;
        assert!(alone.grains.iter().any(|grain| gap_to_image(grain) < 0.0), "{grains}: no grain at the image");
        // Bodies may overlap by a millionth of the radius.
        assert!(around.grains[1..].iter().all(|grain| gap_to_image(grain) > -1e-6), "{grains}");
        assert_eq!(around.grains.len(), alone.grains.len() + 1);
    }
}

#[test]
fn grains_that_overlap_an_image_or_extend_beyond_a_period_are_reported() {
    let faults = |shape: &str, x: f64| {
        let grains = format!("{shape}, placement: List(positions: [(0, 0, 0), ({x:?}, 0, 0)])");
        read(Path::new(""), &scene(&grains, "compute: (xperiode: 6.0),")).err().unwrap_or_default()
    };
    let cube = "shape: Box(lengths: (1, 1, 1)), grain_orientation: Same((axis: (0, 0, 1), angle: 0))";
    assert_eq!(faults(cube, 5.0), "");
    assert_eq!(faults("sizes: Single(0.5)", 5.0), "");
    let overlap = faults(cube, 5.25);
    assert!(
        overlap.contains("grain 1 of grains 1 and the periodic image of grain 2 of grains 1 overlap by 2.500e-1 m")
    );
    assert!(
        overlap.contains("expected grains that touch the images of others at most, as in an envelope"),
        "{overlap}"
    );
    let centres = faults(cube, 6.5);
    assert!(centres.contains("xperiode: 6, but the centres of the grains extend over 6.5 m; expected a period of"));
    let rod = "shape: Box(lengths: (6.5, 1, 1)), grain_orientation: Same((axis: (0, 0, 1), angle: 0))";
    let wide = read(
        Path::new(""),
        &scene(&format!("{rod}, placement: List(positions: [(0, 0, 0)])"), "compute: (xperiode: 6.0),"),
    );
    assert!(wide.unwrap_err().contains("xperiode: 6, but a grain extends over 6.5 m; expected a period of at least"));
    // A rod across, which turns its long side along y.
    let across = rod.replace("(6.5, 1, 1)", "(1, 6.5, 1)");
    let across = format!("{across}, placement: List(positions: [(0, 0, 0)])");
    assert!(read(Path::new(""), &scene(&across, "compute: (xperiode: 6.0),")).is_ok());
}

/// Shapes and solid fractions at which their bounding balls would never fit.
const DENSE_SHAPES: [(&str, f64); 6] = [
    (
        "shape: Random(vertices: (8, 14), ratios: (1, 0.8, 0.6), angularity: 0.5), sizes: Uniform(min: 0.8, max: 1.2)",
        0.42,
    ),
    ("shape: Cube, sizes: Single(1)", 0.4),
    ("shape: Prism(sides: 6, slenderness: 3), sizes: PowerLaw(min: 0.7, max: 1.4, exponent: 2.5)", 0.35),
    ("shape: Clump([(0, 0, 0, 1), (1, 0, 0, 0.8), (0, 1, 0, 0.6)]), sizes: Single(1)", 0.42),
    ("shape: Capsule(half_length: 1, radius: 0.5)", 0.4),
    ("shape: Cylinder(half_height: 0.8, radius: 0.6)", 0.38),
];

/// Farthest points of a grain, and the radius of balls about them that it contains.
fn corners(grain: &Grain) -> Vec<(Vector3<f64>, f64)> {
    let to_fixed_axes = grain.axes().transpose();
    let at = |local: Vector3<f64>| grain.position + to_fixed_axes * local;
    match &grain.shape {
        OrientedShape::Polyhedron(polyhedron) => {
            polyhedron.vertices().into_iter().flatten().map(|v| (at(v.into()), 0.0)).collect()
        }
        OrientedShape::Clump(clump) => clump.balls().map(|ball| (at(ball.centre), ball.radius)).collect(),
        OrientedShape::RoundSolid(solid) if solid.shape.is_capsule => {
            [1.0, -1.0].map(|side| (at(side * solid.shape.half_length * Vector3::z()), solid.shape.radius)).into()
        }
        OrientedShape::RoundSolid(solid) => {
            let corner = |k: u32| {
                let (sin, cos) = (0.1 * f64::from(k)).sin_cos();
                let half_height = if k.is_multiple_of(2) { solid.shape.half_length } else { -solid.shape.half_length };
                (at(Vector3::new(solid.shape.radius * cos, solid.shape.radius * sin, half_height)), 0.0)
            };
            (0..126).map(corner).collect()
        }
        OrientedShape::Sphere => vec![(grain.position, grain.radius)],
    }
}

/// Overlaps are checked by the reader, from separating axes; the packing uses GJK.
#[test]
fn dense_packings_of_shapes_fill_every_envelope() {
    let envelopes = ["Ball()", "Ellipsoid(ratios: (1.5, 1.2, 1))", "Box(ratios: (1, 1, 1.5))"];
    for (k, (shape, nu)) in DENSE_SHAPES.into_iter().enumerate() {
        let population = placed(&scene(
            &format!(
                "number: 40, solid_fraction: {nu}, {shape}, placement: DensePacking(envelope: {}), \
                 centre: (30, -20, 10), orientation: (axis: (1, 1, 1), angle: 0.7)",
                envelopes[k % 3]
            ),
            "",
        ));
        assert_eq!(population.grains.len(), 40);
        // Rounding of a cube root.
        assert!((solid_fraction(&population) / nu - 1.0).abs() < 1e-12, "{shape}: {}", solid_fraction(&population));
        let region = population.regions[0].as_ref().unwrap();
        let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 1.0));
        let turn = nalgebra::Rotation3::from_axis_angle(&axis, 0.7);
        for (corner, radius) in population.grains.iter().flat_map(corners) {
            let local = turn.inverse() * (corner - Vector3::new(30.0, -20.0, 10.0));
            assert!(region.contains_ball(&local, radius), "{shape}: {local}");
        }
        let balls_overlap = |a: usize, b: usize| {
            let [first, second] = [a, b].map(|k| &population.grains[k]);
            (first.position - second.position).norm() < first.reach + second.reach
        };
        assert!((0..40).any(|a| (0..a).any(|b| balls_overlap(a, b))), "{shape}");
    }
}

#[test]
fn dense_shapes_fill_a_cylinder_of_given_size_and_keep_chosen_orientations() {
    let grains = "solid_fraction: 0.4, shape: Cube, sizes: Single(0.5), \
                  placement: DensePacking(envelope: Cylinder(half_height: 2.5, radius: 1.8))";
    let population = placed(&scene(grains, ""));
    // Whole grains, of 0.01 of the envelope each.
    assert!((solid_fraction(&population) - 0.4).abs() < 0.006, "{}", solid_fraction(&population));
    let mean: Vector3<f64> = population.grains.iter().map(|grain| grain.axes().row(0).transpose()).sum();
    assert!(mean.norm() < 0.5 * population.grains.len() as f64, "{mean}");
    let fixed = format!("{grains}, grain_orientation: Same((axis: (0, 0, 1), angle: 0.5))").replace("0.4,", "0.3,");
    let population = placed(&scene(&fixed, ""));
    let axes = population.grains[0].axes();
    assert!(population.grains.iter().all(|grain| grain.axes() == axes) && axes[(2, 2)] == 1.0, "{axes}");
}

/// Without walls no direction is preferred: the mean of the squares of a component of the axes is 1/3, with the variance 4/45
/// of a random direction; four standard errors.
#[test]
fn a_periodic_packing_of_capsules_favours_no_direction() {
    let grains = "number: 150, shape: Capsule(half_length: 0.5, radius: 0.5), \
                  placement: DensePacking(envelope: Box(lengths: (7.2, 7.2, 7.2)))";
    let population = placed(&scene(grains, "compute: (xperiode: 7.2, yperiode: 7.2, zperiode: 7.2),"));
    // A sphere and a cylinder of radius 0.5 and length 1: 150 (pi/6 + pi/4) of 7.2^3.
    assert!((solid_fraction(&population) - 0.52605).abs() < 1e-5, "{}", solid_fraction(&population));
    let number = population.grains.len() as f64;
    for k in 0..3 {
        let share = population.grains.iter().map(|grain| grain.axes()[(2, k)].powi(2)).sum::<f64>() / number;
        assert!((share - 1.0 / 3.0).abs() < 4.0 * (4.0 / 45.0 / number).sqrt(), "axis {k}: {share}");
        let farthest = population.grains.iter().map(|grain| grain.position[k].abs()).fold(0.0, f64::max);
        assert!(farthest > 3.1 && farthest <= 3.6, "no grain is across the end: {farthest}");
    }
}

#[test]
fn shapes_that_jam_are_reported_with_the_solid_fraction_at_which_they_fit() {
    let faults = read(
        Path::new(""),
        &scene(
            "number: 30, solid_fraction: 0.9, shape: Cube, sizes: Single(1), placement: DensePacking(envelope: Box())",
            "",
        ),
    )
    .unwrap_err();
    assert!(faults.contains("30 grains at a solid fraction of 0.9000 in a box of lengths"), "{faults}");
    assert!(faults.contains("jam: they fit at 0."), "{faults}");
}

/// Two spheres of a file, in a scene with further fields of the grains.
fn from_file(name: &str, content: &[u8], fields: &str) -> Result<Population, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), content).unwrap();
    let text = scene(&format!("placement: File(path: \"{name}\"{fields}"), "");
    read(folder.path(), &text).map(|(_, population)| population)
}

/// Positions, radii, velocities and spins of two spheres, exact in the digits of DATBOX.
fn expect_two(population: &Population, moves: bool) {
    let [a, b] = population.grains.as_slice() else { panic!("{} grains", population.grains.len()) };
    let vector = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    assert_eq!((a.position, a.radius), (vector(1.0, 2.0, 3.0), 0.5));
    assert_eq!((b.position, b.radius), (vector(-1.0, 0.25, 0.0), 0.75));
    if moves {
        assert_eq!((a.velocity, b.velocity), (vector(0.5, 0.0, 0.0), vector(0.0, -0.5, 2.0)));
        assert_eq!((a.spin, b.spin), (vector(0.0, 0.0, 1.0), vector(4.0, 0.0, 0.0)));
    }
}

#[test]
fn tables_dumps_and_xyz_files_give_the_same_spheres() {
    let csv = "# a comment that names no column? no: the header\n";
    assert!(from_file("a.csv", csv.as_bytes(), ")").unwrap_err().contains("expected one position"));
    let csv = "x, y, z, radius, vx, vy, vz, wx, wy, wz, colour\n\
               1, 2, 3, 0.5, 0.5, 0, 0, 0, 0, 1, red\n\
               # between\n\
               -1.0, 0.25, 0, 7.5e-1, 0, -0.5, 2, 4, 0, 0, blue\n";
    expect_two(&from_file("a.csv", csv.as_bytes(), ")").unwrap(), true);
    let tabs = csv.replace(", ", "\t");
    expect_two(&from_file("table.txt", tabs.as_bytes(), ", format: Csv)").unwrap(), true);
    let dump = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS ff ff ff\n0 1\n0 1\n0 1\n\
                ITEM: ATOMS id x y z radius\n1 9 9 9 9\n\
                ITEM: TIMESTEP\n2000\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp ff ff\n-1 1\n0 4\n0 6\n\
                ITEM: ATOMS id type x y z vx vy vz omegax omegay omegaz radius\n\
                7 1 -1 0.25 0 0 -0.5 2 4 0 0 0.75\n3 1 1 2 3 0.5 0 0 0 0 1 0.5\n";
    let population = from_file("a.dump", dump.as_bytes(), ")").unwrap();
    expect_two(&population, true);
    assert_eq!(population.file_summaries, ["a.dump step 2000"]);
    let scaled = "ITEM: TIMESTEP\n5\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n-3 1\n0 4\n-6 6\n\
                  ITEM: ATOMS id xs ys zs diameter\n1 1 0.5 0.75 1\n2 0.5 0.0625 0.5 1.5\n";
    expect_two(&from_file("dump.5", scaled.as_bytes(), ", format: Lammps)").unwrap(), false);
    // Edges (4, 0, 0), (1, 4, 0) and (-2, -0.5, 12) at the corner (-3, 0, -6), within the bounds of LAMMPS.
    let tilted = "ITEM: TIMESTEP\n5\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS xy xz yz pp pp pp\n-5 2 1\n-0.5 4 -2\n\
                  -6 6 -0.5\nITEM: ATOMS id xs ys zs diameter\n\
                  1 1.2265625 0.59375 0.75 1\n2 0.71875 0.125 0.5 1.5\n";
    expect_two(&from_file("dump.6", tilted.as_bytes(), ", format: Lammps)").unwrap(), false);
    // Edges (0, 4, 0), (2, 0, 2) and (-4, 0, 0) at the corner (1, -1, 2): (1, 2, 3) is 3/4, 1/2 and 1/4 along them.
    let general = "ITEM: TIMESTEP\n5\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS abc origin pp pp pp\n0 4 0 1\n\
                   2 0 2 -1\n-4 0 0 2\nITEM: ATOMS id xs ys zs diameter\n\
                   1 0.75 0.5 0.25 1\n2 0.3125 -1 0 1.5\n";
    expect_two(&from_file("dump.7", general.as_bytes(), ", format: Lammps)").unwrap(), false);
    let absolute =
        dump.replace("BOX BOUNDS pp ff ff\n-1 1\n0 4\n0 6", "BOX BOUNDS xy xz yz pp ff ff\n-1 1 0.5\n0 4 0\n0 6 -1");
    expect_two(&from_file("a.dump", absolute.as_bytes(), ")").unwrap(), true);
    let xyz = "1\nfirst frame\nA 0 0 0 1\n2\nsecond frame\nA 1 2 3 0.5 0.5 0 0\nB -1 0.25 0 0.75 0 -0.5 2\n";
    expect_two(&from_file("a.xyz", xyz.as_bytes(), ")").unwrap(), false);
    let extended = "2\nLattice=\"9 0 0 0 9 0 0 0 9\" Properties=species:S:1:radius:R:1:pos:R:3:velo:R:3:omega:R:3\n\
                    A 0.5 1 2 3 0.5 0 0 0 0 1\nB 0.75 -1 0.25 0 0 -0.5 2 4 0 0\n";
    expect_two(&from_file("a.extxyz", extended.as_bytes(), ")").unwrap(), true);
}

#[test]
fn files_of_pkdgrav_are_read_in_si_units() {
    let file = |particles: &[[f64; 11]], mark: i32| {
        let mut bytes = Vec::new();
        bytes.extend(2.0f64.to_be_bytes());
        bytes.extend((particles.len() as i32).to_be_bytes());
        bytes.extend(mark.to_be_bytes());
        for particle in particles {
            particle.iter().for_each(|x| bytes.extend(x.to_be_bytes()));
            bytes.extend([3i32, 0].iter().flat_map(|x| x.to_be_bytes()));
        }
        bytes
    };
    // A sphere of 1 km at 1 au moves once around a circle in a sidereal year, at 2 pi au per year.
    let kilometre = 1e3 / 1.495978707e11;
    let mass = 2000.0 * 4.0 / 3.0 * std::f64::consts::PI * 1e9 / 1.9884e30;
    let particle = [mass, kilometre, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let population = from_file("a.ss", &file(&[particle], -1), ")").unwrap();
    let [grain] = population.grains.as_slice() else { panic!() };
    let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-7, "{found} {expected}");
    close(grain.radius, 1e3); // eight digits
    close(grain.position.x, 1.495978707e11);
    close(grain.velocity.y, std::f64::consts::TAU * 1.495978707e11 / 3.15581497635e7);
    close(grain.spin.z, std::f64::consts::TAU / 3.15581497635e7);
    // The density of the scene counts: 2700 kg/m^3, with 2000 in the file.
    close(grain.mass, 2700.0 * 4.0 / 3.0 * std::f64::consts::PI * 1e9);
    let note = &population.file_summaries[0];
    assert!(
        note.starts_with("a.ss time 1.00452") && note.ends_with("those of the file differ by up to 25.93 %"),
        "{note}"
    );
    for (bytes, fault) in [
        (file(&[particle], -10101), "a.ss: header: a reduced ss file; expected an ss file with velocities"),
        (file(&[particle], -1)[..50].to_vec(), "a.ss: header: 1 particles in 50 bytes; expected 16 bytes and 96"),
        (vec![1, 2], "a.ss: header: 2 bytes; expected an ss file of pkdgrav"),
        (file(&[[f64::NAN; 11]], -1), "a.ss: particle 1: mass NaN kg, radius NaN m; expected finite numbers"),
        (file(&[], -1), "a.ss: file: no particles; expected at least one"),
    ] {
        let found = from_file("a.ss", &bytes, ")").unwrap_err();
        assert!(found.contains(fault), "{found}");
    }
}

#[test]
fn faults_of_files_of_particles_have_line_and_column() {
    for (name, content, fields, fault) in [
        (
            "a.csv",
            "x,y,z,radius\n1,2,3,0.5\n1, 2,three,0.5\n",
            ")",
            "a.csv:3:6: particle 2: 'three'; expected a finite number",
        ),
        ("a.csv", "x,y,z,radius\n1,2,3,0\n", ")", "a.csv:2:7: particle 1: '0'; expected a number > 0"),
        ("a.csv", "x,y,z,radius\n1,2,3\n", ")", "a.csv:2: particle 1: 3 values; expected 4, one for each column"),
        ("a.csv", "1,2,3,4\n1,2,3,4\n", ")", "a.csv:1: header: numbers; expected the names of the columns"),
        ("a.csv", "x,y,radius\n1,2,3\n", ")", "a.csv:1: columns: 'x y radius'; expected each of x y z once, or none"),
        ("a.csv", "x,y,z,r,vx\n1,2,3,4,5\n", ")", "a.csv:1: columns: 'x y z r vx'; expected each of vx vy vz once"),
        ("a.csv", "", ")", "a.csv: file: no particles; expected at least one"),
        ("a.xyz", "two\n", ")", "a.xyz:1:1: number of particles: 'two'; expected an integer"),
        (
            "a.xyz",
            "2\n\nA 0 0 0 1\n",
            ")",
            "a.xyz:1: number of particles: 1 lines for 2 particles; expected a line for each",
        ),
        ("a.xyz", "18446744073709551615\n\nA 0 0 0 1\n", ")", "1 lines for 18446744073709551615 particles"),
        ("a.dump", "1 2 3\n", ")", "a.dump:1: dump: no time step; expected the line 'ITEM: TIMESTEP'"),
        ("a.dump", "ITEM: TIMESTEP\n1\n", ")", "a.dump:1: dump: no atoms; expected 'ITEM: ATOMS'"),
        (
            "a.dump",
            "ITEM: TIMESTEP\n1\nITEM: BOX BOUNDS xy xz yz pp pp pp\n0 1 0 0\n0 1 0\n0 1 0\n",
            ")",
            "a.dump:4: box bounds: '0 1 0 0'; expected the two ends of the box, and the tilt of one that is not rectangular",
        ),
        (
            "a.dump",
            "ITEM: TIMESTEP\n1\nITEM: BOX BOUNDS abc origin pp pp pp\n1 0 0 0\n0 1 0\n0 0 1 0\n",
            ")",
            "a.dump:5: box bounds: '0 1 0'; expected the three components of an edge, and one of the origin",
        ),
        (
            "a.dump",
            "ITEM: TIMESTEP\n1\nITEM: NUMBER OF ATOMS\n1\nITEM: ATOMS id x y z radius\n1 0 0 0 1\n2 3 0 0 1\n",
            ")",
            "a.dump:5: atoms: 2 lines for 1 atoms; expected a line for each",
        ),
        (
            "a.dump",
            "ITEM: TIMESTEP\n1\nITEM: NUMBER OF ATOMS\n2\nITEM: ATOMS id x y z radius\n7 0 0 0 1\n7 3 0 0 1\n",
            ")",
            "a.dump:5: atoms: id 7 is that of two lines; expected each id once",
        ),
        ("a.dat", "", ")", "a.dat: file: an ending that names no format; expected .csv"),
        (
            "a.csv",
            "x y z\n0 0 0\n",
            ")",
            "grains 1, placement: the file has no radii, and no sizes are given; expected sizes",
        ),
        (
            "a.csv",
            "x y z r\n0 0 0 1\n",
            "), sizes: Single(1)",
            "the file has radii, and sizes are given; expected no sizes",
        ),
        (
            "a.csv",
            "x y z r\n0 0 0 1\n",
            "), number: 1",
            "grains 1: shape, number or solid_fraction given for the spheres",
        ),
        (
            "a.csv",
            "x y z r\n0 0 0 1\n0 0 1.5 1\n",
            ")",
            "grain 1 of grains 1 and grain 2 of grains 1 overlap by 5.000e-1 m",
        ),
        (
            "a.csv",
            "x y z\n0 0 0\n0 0 5\n",
            "), sizes: List([1, 1, 1])",
            "grains 1, placement: 3 radii in sizes for 2 particles; expected one for each",
        ),
        (
            "a.csv",
            "x y z r vx vy vz\n0 0 0 1 0 0 0\n",
            "), driven: (None, None, Constant(1))",
            "a.csv has velocities, and the motion is imposed as well",
        ),
    ] {
        let found = from_file(name, content.as_bytes(), fields).map(|_| ()).unwrap_err();
        assert!(found.contains(fault), "{content}: {found}");
    }
    let missing = read(Path::new("/nowhere"), &scene("placement: File(path: \"a.csv\")", "")).unwrap_err();
    assert!(missing.contains("grains 1, placement, path: ") && missing.contains("a.csv cannot be read"), "{missing}");
    // Radii of the scene, and overlaps that are wanted.
    let population =
        from_file("a.csv", b"x y z\n0 0 0\n0 0 1\n", ", allow_overlap: true), sizes: List([1, 2])").unwrap();
    assert_eq!(population.grains.iter().map(|grain| grain.radius).collect::<Vec<_>>(), [1.0, 2.0]);
}
