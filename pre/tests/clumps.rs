//! Clumps: mass and inertia of their union in DATBOX, sizes, orientations, overlaps, files, surfaces, and scenes that are
//! rejected.

use std::f64::consts::PI;
use std::path::Path;

use cd_formats::bodies::{Bodies, Body, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::report::FaultReport;
use cd_formats::scan::AsciiText;
use cd_pre::write;
use nalgebra::{Matrix3, Vector3};

/// A scene of one group of grains, with the given fields.
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

/// BODIES.DAT, DOF.INI, TACT_BEHAV.DAT and the summary of a scene in `folder`.
fn files_in(folder: &Path, text: &str) -> (Bodies, Dof, String, String) {
    let (scene, population) =
        cd_pre::read_scene(&folder.join("scene.ron"), text, &[]).unwrap_or_else(|faults| panic!("{faults}"));
    let files = write::datbox_files(&scene, &population);
    let file_text = |name: &str| files.iter().find(|(known, _)| known == name).unwrap().1.clone();
    let bodies = Bodies::parse(Path::new("BODIES.DAT"), &AsciiText::new(file_text("BODIES.DAT").as_bytes())).unwrap();
    let dof = Dof::parse(Path::new("DOF.INI"), &AsciiText::new(file_text("DOF.INI").as_bytes())).unwrap();
    (bodies, dof, file_text("TACT_BEHAV.DAT"), cd_pre::summary::scene_summary(&scene, &population))
}

fn files(text: &str) -> (Bodies, Dof, String, String) {
    files_in(Path::new(""), text)
}

/// Faults of a scene in `folder`, a line each; "nothing" without any.
fn faults_in(folder: &Path, text: &str) -> String {
    match cd_pre::read_scene(&folder.join("scene.ron"), text, &[]) {
        Ok(_) => "nothing".to_string(),
        Err(faults) => faults.to_string().replace(&format!("{}/", folder.display()), ""),
    }
}

fn faults(fields: &str) -> String {
    faults_in(Path::new(""), &scene(fields))
}

/// Offset and radius of each ball.
fn balls(body: &Body) -> Vec<(Vector3<f64>, f64)> {
    let ball = |shape: &ShapeRecord| match shape {
        ShapeRecord::OffsetSphere { radius, offset } => (Vector3::from(*offset), *radius),
        other => panic!("{}", other.type_name()),
    };
    body.contactors.iter().map(|contactor| ball(&contactor.shape)).collect()
}

fn volume(body: &Body) -> f64 {
    4.0 / 3.0 * PI * body.equivalent_radius.powi(3)
}

/// Two balls of radius r, their centres 2 a apart: volume, moment along the axis and across it at density 1, as integrals of
/// discs from the middle plane to the tip.
fn dumbbell(a: f64, r: f64) -> [f64; 3] {
    let integral = |f: &dyn Fn(f64) -> f64| 2.0 * PI * (f(r) - f(-a));
    let volume = integral(&|u| r * r * u - u.powi(3) / 3.0);
    let fourth = integral(&|u| r.powi(4) * u - 2.0 / 3.0 * r * r * u.powi(3) + u.powi(5) / 5.0);
    // z = a + u.
    let second = integral(&|u| {
        a * a * (r * r * u - u.powi(3) / 3.0)
            + 2.0 * a * (r * r * u * u / 2.0 - u.powi(4) / 4.0)
            + r * r * u.powi(3) / 3.0
            - u.powi(5) / 5.0
    });
    [volume, 0.5 * fourth, 0.25 * fourth + second]
}

/// The dumbbell of radius 1/2 and distance 0.6, given off its centre.
const DUMBBELL: &str = "shape: Clump([(2.0, 1.0, 0.0, 0.5), (2.0, 1.0, 0.6, 0.5)])";

#[test]
fn a_dumbbell_has_the_mass_and_inertia_of_the_union() {
    let list = "placement: List(positions: [(1, 2, 3)]), grain_orientation: Same((axis: (0, 0, 1), angle: 0)), spin: (0.25, 0, 0.5)";
    let (bodies, dof, tact, summary) = files(&scene(&format!("{DUMBBELL}, {list}")));
    let [body] = bodies.0.as_slice() else { panic!("{} bodies", bodies.0.len()) };
    let [expected_volume, along, across] = dumbbell(0.3, 0.5);
    // Eight digits of the file.
    assert!((volume(body) / expected_volume - 1.0).abs() < 3e-7);
    for (moment, expected) in body.inertia.unwrap().into_iter().zip([across, across, along]) {
        assert!((moment / expected - 1.0).abs() < 1e-7, "{moment} {expected}");
    }
    assert_eq!(balls(body), [(Vector3::new(0.0, 0.0, -0.3), 0.5), (Vector3::new(0.0, 0.0, 0.3), 0.5)]);
    assert_eq!(body.position, [1.0, 2.0, 3.0]);
    assert_eq!(
        (dof.bodies[0].axes, dof.bodies[0].velocity),
        (Matrix3::identity().into(), [0.0, 0.0, 0.0, 0.25, 0.0, 0.5])
    );
    assert!(tact.contains("SPHER  BLUEx") && !tact.contains("SPHEb"), "{tact}");
    assert!(summary.contains("1 clump (2 balls each)"), "{summary}");
    assert!(
        summary.contains(
            "centre of mass at (2.00000000, 1.00000000, 0.30000000) m in the axes in which the shape is given"
        ),
        "{summary}"
    );
    // cd-solve accepts the body, at this density: the mass is that of the union, not of two balls.
    let checked = body.check_at_density(2000.0).unwrap().inertial;
    assert!((checked.mass / (2000.0 * expected_volume) - 1.0).abs() < 3e-7);
    assert!((checked.inertia[2] / (2000.0 * along) - 1.0).abs() < 1e-7);
}

#[test]
fn sizes_scale_clumps_by_volume_or_reach_and_turn_them_at_random() {
    for (radius, kind) in [(2.0, "EqualVolume"), (2.0, "Circumscribed")] {
        let fields = format!(
            "{DUMBBELL}, radius: {kind}, sizes: List([{radius}, 1.0, 1.5]), spin: (0, 0, 0.5), number: 3, \
             placement: RandomSequential(envelope: Ball(radius: 12))"
        );
        let (bodies, dof, _, summary) = files(&scene(&fields));
        let mut sizes: Vec<f64> = Vec::new();
        for (body, state) in bodies.0.iter().zip(&dof.bodies) {
            let found = balls(body);
            let reach = found.iter().map(|(x, r)| x.norm() + r).fold(0.0, f64::max);
            sizes.push(if kind == "EqualVolume" { body.equivalent_radius } else { reach });
            // The proportions stay: half the distance is 0.6 radii, and moments go with the fifth power.
            let (offset, r) = found[0];
            assert!((offset.norm() / r - 0.6).abs() < 1e-7);
            let expected = dumbbell(0.6 * r, r);
            assert!((volume(body) / expected[0] - 1.0).abs() < 3e-7);
            assert!((body.inertia.unwrap()[0] / expected[2] - 1.0).abs() < 5e-7);
            let axes = Matrix3::from_columns(&state.axes.map(Vector3::from));
            let spin = axes * Vector3::from_fn(|k, _| state.velocity[3 + k]);
            assert!((spin - Vector3::new(0.0, 0.0, 0.5)).norm() < 1e-6); // seven digits
        }
        sizes.sort_by(f64::total_cmp);
        assert!(sizes.iter().zip([1.0, 1.5, 2.0]).all(|(found, given)| (found - given).abs() < 2e-7), "{sizes:?}");
        assert!(dof.bodies.windows(2).all(|pair| pair[0].axes != pair[1].axes));
        // The solid fraction is that of the unions.
        let fraction: f64 = bodies.0.iter().map(volume).sum::<f64>() / (4.0 / 3.0 * PI * 1728.0);
        assert!(summary.contains(&format!("solid fraction {fraction:.4}")), "{summary}");
    }
}

/// Clumps in the places that the balls leave free: their bounding balls overlap, their balls do not.
#[test]
fn overlaps_are_those_of_the_balls() {
    let same = "grain_orientation: Same((axis: (0, 0, 1), angle: 0))";
    // Two Ls that interlock: three balls of radius 1/2 each.
    let l = "shape: Clump([(0, 0, 0, 0.5), (1, 0, 0, 0.5), (0, 1, 0, 0.5)])";
    let pair = |x: f64| faults(&format!("{l}, {same}, placement: List(positions: [(0, 0, 0), ({x}, 1, 0)])"));
    // The corner of the second one is at the distance 1 from both arms of the first at x = 1.
    assert_eq!(pair(1.0), "nothing");
    assert!(pair(0.9).contains("grain 1 of grains 1 and grain 2 of grains 1 overlap by 1.000e-1 m"), "{}", pair(0.9));
    let mixed = |other: &str, x: f64| {
        let first = format!("{l}, {same}, placement: List(positions: [(0.33333333, 0.33333333, 0)])");
        scene(&first).replace(
            "grains: [",
            &format!(r#"grains: [(material: "ROCKx", colour: "BLUEx", {other}, placement: List(positions: [({x}, {x}, 0)])), "#),
        )
    };
    // A sphere at (s, s) in the corner of the L touches the balls about (1, 0) and (0, 1): (1 - s)² + s² = (1/2 + r)².
    let corner = |r: f64| 0.5 + (0.5 * (0.5 + r).powi(2) - 0.25).sqrt();
    for r in [0.25, 0.5] {
        let sphere = format!("sizes: Single({r})");
        let at = corner(r);
        assert_eq!(faults_in(Path::new(""), &mixed(&sphere, at + 1e-7)), "nothing");
        let found = faults_in(Path::new(""), &mixed(&sphere, at - 0.01));
        assert!(found.contains("overlap by"), "{found}");
    }
    let cube = format!("shape: Box(lengths: (1, 1, 1)), {same}");
    // Faces of a cube of side 1 on the diagonal are x - 1/2 from the balls about (1, 0) and (0, 1).
    assert_eq!(faults_in(Path::new(""), &mixed(&cube, 1.0 + 1e-7)), "nothing");
    let found = faults_in(Path::new(""), &mixed(&cube, 0.98));
    assert!(found.contains("overlap by 2.000e-2 m"), "{found}");
    // A wall below one ball that is lower than the others.
    let wall = |z: f64| {
        let text = scene(&format!(
            "shape: Clump([(0, 0, 0, 0.5), (0, 0, 1, 0.5)]), {same}, placement: List(positions: [(0, 0, {z})])"
        ));
        let wall = r#"walls: [Plate(material: "ROCKx", colour: "BLUEx", centre: (0, 0, -1), half_lengths: (9, 9, 1))], grains: ["#;
        faults_in(Path::new(""), &text.replace("grains: [", wall))
    };
    assert_eq!(wall(1.0), "nothing");
    assert!(wall(0.9).contains("grain 1 of grains 1 and wall 1 overlap by 1.000e-1 m"), "{}", wall(0.9));
}

#[test]
fn clumps_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let fields = |shape: &str| {
        scene(&format!(
            "shape: {shape}, placement: List(positions: [(0, 0, 0)]), grain_orientation: Same((axis: (0, 0, 1), angle: 0))"
        ))
    };
    // In mm.
    write("pair.csv", "x,y,z,r\n# two balls\n2000,1000,0,500\n2000,1000,600,500\n");
    let [expected_volume, ..] = dumbbell(0.3, 0.5);
    for (scale, factor) in [
        ("Factor(0.001)", 1.0f64),
        ("Length(3.2)", 2.0),
        (&format!("Volume({})", 8.0 * expected_volume), 2.0),
        (&format!("Radius({})", (6.0 * expected_volume / PI).cbrt()), 2.0),
    ] {
        let text = fields(&format!("ClumpFile(file: \"pair.csv\", scale: {scale})"));
        let (bodies, _, _, summary) = files_in(folder.path(), &text);
        assert!((volume(&bodies.0[0]) / (factor.powi(3) * expected_volume) - 1.0).abs() < 3e-7, "{scale}");
        assert!((balls(&bodies.0[0])[1].0 - Vector3::new(0.0, 0.0, 0.3 * factor)).norm() < 2e-8 * factor, "{scale}");
        assert!(summary.contains("pair.csv: 2 balls, "), "{summary}");
    }
    write("none.csv", "x,y,z\n0,0,0\n");
    write("inner.csv", "x,y,z,r\n0,0,0,1\n0.5,0,0,0.5\n2,0,0,0.1\n");
    write("one.csv", "x,y,z,r\n0,0,0,1\n");
    for (file, expected) in [
        ("none.csv", "none.csv: balls: no radii; expected a column r, m"),
        (
            "inner.csv",
            "inner.csv: balls: ball 2 lies within ball 1; expected no ball within another: leave out the inner one, which adds nothing",
        ),
        ("one.csv", "one.csv: balls: 1 ball; expected 2 to 1000 balls"),
    ] {
        assert_eq!(faults_in(folder.path(), &fields(&format!("ClumpFile(file: \"{file}\")"))), expected);
    }
    // A template of LIGGGHTS, in mm.
    let template = "# stone\n0 0 0 500 # first\n\n 600\t0 0 4e2\n";
    std::fs::write(folder.path().join("stone.multisphere"), template).unwrap();
    let template = fields("ClumpFile(file: \"stone.multisphere\", scale: Factor(0.001))");
    assert_eq!(faults_in(folder.path(), &template), "nothing");
    std::fs::write(folder.path().join("wrong.multisphere"), "0 0 0 1\n0 0 2\n").unwrap();
    let found = faults_in(folder.path(), &fields("ClumpFile(file: \"wrong.multisphere\")"));
    assert!(found.contains("wrong.multisphere:2: particle 2: 3 values; expected 4, one for each column"), "{found}");
    let found = faults_in(folder.path(), &fields("ClumpFile(file: \"absent.csv\")"));
    assert!(found.contains("scene.ron:6:") && found.contains("absent.csv cannot be read"), "{found}");
    let found = faults_in(folder.path(), &fields("ClumpFile(file: \"pair.csv\", scale: Factor(1e39))"));
    assert!(found.contains("a clump of ") && found.contains("; expected at most 1e40 m"), "{found}");
}

/// A brick of 4 by 2 by 1, as an OBJ file.
const BRICK: &str = "\
v -2 -1 -0.5\nv 2 -1 -0.5\nv 2 1 -0.5\nv -2 1 -0.5\nv -2 -1 0.5\nv 2 -1 0.5\nv 2 1 0.5\nv -2 1 0.5\n\
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

#[test]
fn balls_cover_a_surface_and_mass_and_inertia_are_its_own() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("brick.obj"), BRICK).unwrap();
    let text = |max_balls: usize, max_error: f64| {
        scene(&format!(
            "shape: Model(file: \"brick.obj\", contact_shape: Balls(max_balls: {max_balls}, max_error: {max_error})), \
             placement: List(positions: [(0, 0, 0)]), grain_orientation: Same((axis: (0, 0, 1), angle: 0))"
        ))
    };
    let mut counts = Vec::new();
    for max_error in [0.5, 0.3, 0.2] {
        let (bodies, dof, _, summary) = files_in(folder.path(), &text(1000, max_error));
        let body = &bodies.0[0];
        // V = 8, I1 = V (2² + 1²)/12 ...
        assert!((volume(body) / 8.0 - 1.0).abs() < 3e-7);
        let moments = [5.0, 17.0, 20.0].map(|squares| 8.0 / 12.0 * squares);
        assert!((0..3).all(|k| (body.inertia.unwrap()[k] / moments[k] - 1.0).abs() < 1e-7));
        assert_eq!(dof.bodies[0].axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        let found = balls(body);
        counts.push(found.len());
        // Inscribed up to the tolerance of the search and the digits of the file.
        let half = Vector3::new(2.0, 1.0, 0.5);
        for (x, r) in &found {
            assert!((half - x.abs()).min() - r > -2e-6, "{x} {r}");
        }
        // The stated area is within the error; points of a grid on the upper face, away from its edges, too.
        assert!(summary.contains("1.0000 of its surface within max_error"), "{summary}");
        let unit = (6.0 / PI).cbrt();
        for (i, j) in (-17..=17).flat_map(|i| (-7..=7).map(move |j| (f64::from(i), f64::from(j)))) {
            let point = Vector3::new(0.1 * i, 0.1 * j, 0.5);
            let distance = found.iter().map(|(x, r)| (point - x).norm() - r).fold(f64::INFINITY, f64::min);
            // Half of the spacing of the points more.
            assert!(distance < 1.5 * max_error * unit, "{max_error}: {point} {distance}");
        }
    }
    assert!(counts[0] < counts[1] && counts[1] < counts[2], "{counts:?}");
    // The number is a limit.
    let (bodies, _, _, summary) = files_in(folder.path(), &text(5, 0.3));
    assert_eq!(bodies.0[0].contactors.len(), 5);
    assert!(!summary.contains("1.0000 of its area"), "{summary}");
    // The same scene gives the same bytes.
    assert_eq!(files_in(folder.path(), &text(40, 0.3)).0, files_in(folder.path(), &text(40, 0.3)).0);
    // The balls of a brick with a size of its own are scaled with it.
    let scaled = text(40, 0.3).replace("placement", "sizes: Single(1.0), placement");
    let (bodies, ..) = files_in(folder.path(), &scaled);
    assert!((bodies.0[0].equivalent_radius - 1.0).abs() < 1e-7);
    assert!((volume(&bodies.0[0]) - 4.0 / 3.0 * PI).abs() < 1e-6);
}

/// An attraction at each contact adds up between clumps; one of pairs does not.
#[test]
fn attractions_at_each_contact_are_warned_of() {
    let warnings = |law: &str| {
        let list = "placement: List(positions: [(0, 0, 0), (3, 0, 0)])";
        let text = scene(&format!("{DUMBBELL}, {list}")).replace("IQS_CLB(friction: 0.4)", law);
        let (scene, population) = cd_pre::read_scene(Path::new("scene.ron"), &text, &[]).unwrap();
        let mut report = FaultReport::new(Path::new("scene.ron"), &text);
        cd_pre::attraction::warn_of_attractions(&scene, &population, &mut report);
        report.warnings.to_string()
    };
    let wet = warnings("IQS_WET_DS_CLB(cohesion: 1.0, range: 0.01, dynamic_friction: 0.3, static_friction: 0.4)");
    assert!(wet.contains("bodies that meet in several points do so under it: BLUEx and BLUEx"), "{wet}");
    assert!(wet.contains("use a law with cohesion of pairs such as IQS_COH_DS_CLB"), "{wet}");
    let pairs = "IQS_COH_DS_CLB(cohesive_stress: 1.0, full_range: 0.01, range: 0.01, dynamic_friction: 0.3, static_friction: 0.4)";
    assert_eq!(warnings(pairs), "");
}

#[test]
fn scenes_of_clumps_that_are_rejected() {
    let list = "placement: List(positions: [(0, 0, 0)])";
    let shape_faults = |shape: &str| faults(&format!("shape: {shape}, {list}"));
    assert_eq!(
        shape_faults("Clump([(0, 0, 0, 1)])"),
        "scene.ron:6:66: grains 1, shape: 1 ball; expected 2 to 1000 balls"
    );
    assert_eq!(
        shape_faults("Clump([(0, 0, 0, 1), (1, NaN, 0, -1)])"),
        "scene.ron:6:91: grains 1, shape 2.2: NaN; expected a finite number (m)\n\
         scene.ron:6:99: grains 1, shape 2.4: -1; expected a radius > 0 m"
    );
    assert!(
        shape_faults("Clump([(0, 0, 0, 1), (0, 0, 0, 1)])")
            .contains("ball 1 lies within ball 2; expected no ball within")
    );
    assert!(
        shape_faults("Clump([(0, 0, 0, 1), (0.5, 0, 0, 0.5)])")
            .contains("ball 2 lies within ball 1; expected no ball within")
    );
    assert!(shape_faults("Clump([(0, 0, 0, 9e39), (9e39, 0, 0, 9e39)])").contains("; expected at most 1e40 m"));
    // Bodies so small that their mass is lost are found when the files are checked.
    assert_ne!(shape_faults("Clump([(0, 0, 0, 1e-80), (1e-80, 0, 0, 1e-80)])"), "nothing");
    let model = |balls: &str| shape_faults(&format!("Model(file: \"a.obj\", contact_shape: Balls({balls}))"));
    assert!(model("max_balls: 1").contains("max_balls: 1; expected 2 to 1000"), "{}", model("max_balls: 1"));
    assert!(model("max_balls: 9, max_error: 0.01").contains("max_error: 0.01; expected 0.02 to 0.5"));
    let file = faults("shape: Clump([(0, 0, 0, 1), (1, 0, 0, 1)]), placement: File(path: \"a.csv\")");
    assert!(file.contains("given for the spheres of a file"), "{file}");
    let large = faults(
        "shape: Clump([(0, 0, 0, 1), (1, 0, 0, 1)]), number: 3, placement: JitteredLattice(envelope: Ball(radius: 1.4))",
    );
    assert!(large.contains("the smallest grain, of radius 1.5 m, is larger than a ball of radius 1.4 m"), "{large}");
}
