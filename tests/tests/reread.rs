//! Files of cd-pre as cd-solve reads them.

use std::fs;
use std::path::Path;

use cd_formats::compute::ComputeFlags;
use cd_tests::case::{Case, pre};

/// A scene of one group of grains with this shape; `more` are further fields of it.
fn scene(shape: &str, more: &str) -> String {
    format!(
        r#"(
        materials: [(name: "ROCKx", density: 2700.0)],
        laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
        contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
        grains: [(material: "ROCKx", colour: "BLUEx", shape: {shape}, {more})],
        compute: (dt: 1e-3, steps: 5),
    )"#
    )
}

/// Whether cd-pre accepts a scene; then cd-solve must read it.
fn accepted(scene: &str) -> bool {
    let case = Case::empty();
    let file = case.path().join("scene.ron");
    fs::write(&file, scene).unwrap();
    let code = pre(&file, case.path());
    assert!(code == 0 || code == 2, "{code}\n{scene}");
    if code == 0 {
        let read = cd_solve::read::read_case(case.path(), &ComputeFlags::default());
        read.map(drop).unwrap_or_else(|faults| panic!("{scene}\n{faults}"));
    }
    code == 0
}

const ALONE: &str = "placement: List(positions: [(0.0, 0.0, 0.0)])";

#[test]
fn needles_plates_and_skew_bodies_of_all_sizes() {
    for size in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
        for slender in [1.0, 1e2, 1e4, 1e5, 1e6, 1e7] {
            let vertices = |points: [[f64; 3]; 4]| {
                let points = points.map(|[x, y, z]| format!("({:e}, {:e}, {:e})", size * x, size * y, size * z));
                format!("Vertices([{}])", points.join(", "))
            };
            let needle = vertices([[0.0; 3], [slender, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
            let skew = vertices([[0.0; 3], [slender, 0.3, 0.2], [0.9 * slender, 1.1, 0.4], [0.2 * slender, 0.5, 1.0]]);
            let plate = format!("Box(lengths: ({0:e}, {0:e}, {1:e}))", size * slender, size);
            let bar = format!("Box(lengths: ({0:e}, {1:e}, {1:e}))", size * slender, size);
            for (shape, turn) in [needle, skew, plate, bar].iter().flat_map(|shape| [(shape, "0.0"), (shape, "0.7")]) {
                let turn = format!("{ALONE}, grain_orientation: Same((axis: (0.3, 0.5, 1.0), angle: {turn}))");
                let known = accepted(&scene(shape, &turn));
                assert!(known || slender > 1e5, "{size} {slender} {shape}");
            }
        }
    }
}

/// The needle that cd-pre once wrote and cd-solve rejected runs.
#[test]
fn a_needle_a_million_times_longer_than_wide_runs() {
    let needle = "Vertices([(0, 0, 0), (1000000, 0, 0), (0, 1, 0), (0, 0, 1)])";
    let case = Case::from_scene(&scene(needle, ALONE)).solved(&["--threads", "1"]);
    // A fourth of the long side from its thick end.
    assert!((case.last_snapshot().bodies.body_mass[0] / (2700.0 * 1e6 / 6.0) - 1.0).abs() < 1e-6);
}

#[test]
fn regular_and_random_bodies_fragments_and_pieces() {
    let placed =
        "sizes: Uniform(min: 0.1, max: 1.0), number: 20, placement: JitteredLattice(envelope: Ball(radius: 20.0))";
    for shape in
        ["Cube", "Tetrahedron", "Octahedron", "Dodecahedron", "Icosahedron", "Prism(sides: 97, slenderness: 300.0)"]
    {
        for (number, size) in [(1, 1e-6), (1, 1e6), (20, 1.0)] {
            let placed = placed.replace("20, place", &format!("{number}, place"));
            let scaled = placed
                .replace("min: 0.1, max: 1.0", &format!("min: {:e}, max: {:e}", 0.1 * size, size))
                .replace("20.0", &format!("{:e}", 20.0 * size));
            accepted(&scene(shape, &scaled));
        }
    }
    for vertices in ["(4, 6)", "(20, 40)", "(200, 300)"] {
        for ratios in ["(1.0, 1.0, 1.0)", "(1.0, 0.5, 0.01)", "(1.0, 0.01, 0.01)"] {
            let shape = format!("Random(vertices: {vertices}, ratios: {ratios}, angularity: 0.5)");
            accepted(&scene(&shape, &placed.replace("Ball(radius: 20.0)", "Ball(radius: 200.0)")));
        }
    }
}

#[test]
fn fragments_of_all_sizes() {
    for size in [1e-6, 1.0, 1e6] {
        for envelope in ["Ball(radius: SIZE)", "Box(lengths: (SIZE, SIZE, THIN))"] {
            let envelope =
                envelope.replace("SIZE", &format!("{size:e}")).replace("THIN", &format!("{:e}", 1e-2 * size));
            let more = format!("number: 60, placement: Fragments(envelope: {envelope})");
            assert!(accepted(&scene("Sphere", &more)), "{more}");
        }
    }
}

/// Scenes that cd-solve would reject: a grain outside of a drum that it can touch, a grain longer than half a period, a
/// plate that leans along one.
#[test]
fn what_cd_solve_cannot_mean_is_rejected_by_cd_pre() {
    let ball = |place: &str| format!("sizes: Single(1.0), placement: List(positions: [{place}])");
    let with = |place: &str, walls: &str, compute: &str| {
        scene("Sphere", &ball(place))
            .replace("law: \"iqsc0\")]", "law: \"iqsc0\"), (between: (\"BLUEx\", \"WALLx\"), law: \"iqsc0\")]")
            .replace("compute: (", &format!("walls: [{walls}], compute: ({compute}"))
    };
    let drum = "Cylinder(material: \"ROCKx\", colour: \"WALLx\", centre: (0, 0, 0), axis: (0, 0, 1), half_height: 5, radius: 5, hollow: true)";
    assert!(accepted(&with("(1, 2, 3)", drum, "")));
    assert!(!accepted(&with("(9, 9, 9)", drum, "")));
    let plate = |normal: &str| {
        format!(
            "Plate(material: \"ROCKx\", colour: \"WALLx\", centre: (0, 0, -9), normal: {normal}, half_lengths: (20, 20, 0.5))"
        )
    };
    assert!(accepted(&with("(1, 2, 3)", &plate("(0, 0, 1)"), "xperiode: 20.0, ")));
    assert!(!accepted(&with("(1, 2, 3)", &plate("(0.1, 0, 1)"), "xperiode: 20.0, ")));
    assert!(!accepted(&with("(1, 2, 3)", &plate("(0, 0, 1)"), "xperiode: 3.9, ")));
}

/// Scenes at random, of extreme sizes, turns, offsets and densities.
#[test]
fn whatever_cd_pre_accepts_cd_solve_reads() {
    let mut state = 7u64;
    let mut draw = |least: f64, most: f64| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        least + (most - least) * ((state >> 11) as f64 / (1u64 << 53) as f64)
    };
    let mut count = 0;
    for _ in 0..150 {
        let (size, far, slender) =
            (10f64.powf(draw(-7.0, 7.0)), 10f64.powf(draw(-2.0, 8.0)), 10f64.powf(draw(0.0, 7.0)));
        let density = 10f64.powf(draw(-3.0, 5.0));
        let points = 4 + draw(0.0, 9.0) as usize;
        let points: Vec<String> = (0..points)
            .map(|_| {
                let [x, y, z] = [draw(-1.0, 1.0) * slender, draw(-1.0, 1.0), draw(-1.0, 1.0)];
                let far = if draw(0.0, 1.0) < 0.3 { far } else { 0.0 };
                format!("({:e}, {:e}, {:e})", size * (x + far), size * (y - far), size * z)
            })
            .collect();
        let shape = match draw(0.0, 4.0) as usize {
            0 => format!("Prism(sides: {}, slenderness: {:e})", 3 + draw(0.0, 50.0) as usize, slender),
            1 => format!("Box(lengths: ({:e}, {:e}, {:e}))", size * slender, size, size * draw(0.1, 1.0)),
            _ => format!("Vertices([{}])", points.join(", ")),
        };
        let sizes = if draw(0.0, 1.0) < 0.5 || shape.starts_with("Prism") {
            format!("sizes: Single({size:e}), ")
        } else {
            String::new()
        };
        let more = format!(
            "{sizes}placement: List(positions: [({:e}, {:e}, 0.0)]), grain_orientation: Same((axis: (1.0, {}, 0.3), angle: {}))",
            far * draw(-1.0, 1.0),
            far,
            draw(0.0, 1.0),
            draw(0.0, 3.0)
        );
        count += usize::from(accepted(&scene(&shape, &more).replace("2700.0", &format!("{density:e}"))));
    }
    assert!(count > 75, "{count} of 150 scenes accepted");
}

/// A missing file is named with the location in the scene that names it.
#[test]
fn a_missing_model_is_named_with_its_place_in_the_scene() {
    let case = Case::empty();
    let file = case.path().join("scene.ron");
    fs::write(&file, scene("Model(file: \"rock.obj\")", ALONE)).unwrap();
    let faults = cd_pre::write_datbox(&file, &[], Path::new("none")).unwrap_err().to_string();
    assert!(
        faults.contains("scene.ron:5:")
            && faults.contains(": grains 1, shape: ")
            && faults.contains("rock.obj cannot be read"),
        "{faults}"
    );
}
