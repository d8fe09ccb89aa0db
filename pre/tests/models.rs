//! Surfaces from files: as grains, as clusters of pieces, as regions, as monoliths to break; and every way to be wrong.

use std::path::{Path, PathBuf};

use cd_formats::bodies::{Bodies, Body, ShapeRecord};
use cd_formats::dof::Dof;
use cd_formats::scan::AsciiText;
use cd_formats::surface::Surface;
use cd_pre::shapes::read;
use cd_pre::write;
use nalgebra::{Matrix3, Vector3};

type Triangle = [usize; 3];

/// A cube of side 2 about (10, 0, 0): eight corners and its six sides.
const SIDES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

fn corners() -> Vec<[f64; 3]> {
    (0..8)
        .map(|k: usize| {
            [0, 1, 2].map(|axis| (if k >> axis & 1 == 0 { -1.0 } else { 1.0 }) + if axis == 0 { 10.0 } else { 0.0 })
        })
        .collect()
}

fn triangles() -> Vec<Triangle> {
    SIDES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

/// An L: a beam of 3 x 1 x 1 with a block of 1 x 1 x 1 on its end, volume 4. Vertices, quadrilaterals, a hexagon each end.
fn angle() -> (Vec<[f64; 3]>, Vec<Vec<usize>>) {
    let profile = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let vertices = [0.0, 1.0].iter().flat_map(|&y| profile.map(|[x, z]| [x, y, z])).collect();
    let mut faces: Vec<Vec<usize>> = (0..6).map(|k| vec![k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k]).collect();
    // From the inner corner every other corner of the L can be seen.
    faces.push(vec![3, 2, 1, 0, 5, 4]);
    faces.push(vec![9, 10, 11, 6, 7, 8]);
    (vertices, faces)
}

fn obj(vertices: &[[f64; 3]], faces: &[Vec<usize>]) -> String {
    let vertex = |v: &[f64; 3]| format!("v {:?} {:?} {:?}\n", v[0], v[1], v[2]);
    let face = |f: &Vec<usize>| format!("f {}\n", f.iter().map(|k| (k + 1).to_string()).collect::<Vec<_>>().join(" "));
    format!(
        "# a comment\no body\n{}s off\n{}",
        vertices.iter().map(vertex).collect::<String>(),
        faces.iter().map(face).collect::<String>()
    )
}

fn stl_text(vertices: &[[f64; 3]], triangles: &[Triangle]) -> Vec<u8> {
    let corner = |k: usize| format!("vertex {} {} {}\n", vertices[k][0], vertices[k][1], vertices[k][2]);
    let facet = |t: &Triangle| format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", t.map(corner).concat());
    format!("solid body\n{}endsolid body\n", triangles.iter().map(facet).collect::<String>()).into_bytes()
}

fn stl_binary(vertices: &[[f64; 3]], triangles: &[Triangle]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0u8; 12]);
        bytes.extend(t.iter().flat_map(|&k| vertices[k]).flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0u8; 2]);
    }
    bytes
}

fn vtk_legacy(vertices: &[[f64; 3]], faces: &[Vec<usize>]) -> String {
    let numbers: usize = faces.iter().map(|face| face.len() + 1).sum();
    let face =
        |f: &Vec<usize>| format!("{} {}\n", f.len(), f.iter().map(usize::to_string).collect::<Vec<_>>().join(" "));
    let vertex = |v: &[f64; 3]| format!("{:?} {:?} {:?}\n", v[0], v[1], v[2]);
    format!(
        "# vtk DataFile Version 3.0\nbody\nASCII\nDATASET POLYDATA\nPOINTS {} double\n{}POLYGONS {} {numbers}\n{}",
        vertices.len(),
        vertices.iter().map(vertex).collect::<String>(),
        faces.len(),
        faces.iter().map(face).collect::<String>()
    )
}

fn vtp(vertices: &[[f64; 3]], faces: &[Vec<usize>]) -> String {
    let join = |numbers: Vec<String>| numbers.join(" ");
    let points = join(vertices.iter().flatten().map(|x| format!("{x:?}")).collect());
    let connectivity = join(faces.iter().flatten().map(usize::to_string).collect());
    let ends = faces.iter().scan(0, |end, face| {
        *end += face.len();
        Some(end.to_string())
    });
    let offsets = join(ends.collect());
    format!(
        r#"<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian">
<PolyData><Piece NumberOfPoints="{}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{}">
<PointData/><CellData/>
<Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" format="ascii">{points}</DataArray></Points>
<Polys><DataArray type="Int64" Name="connectivity" format="ascii">{connectivity}</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">{offsets}</DataArray></Polys>
</Piece></PolyData></VTKFile>
"#,
        vertices.len(),
        faces.len()
    )
}

fn quads() -> Vec<Vec<usize>> {
    SIDES.iter().map(|side| side.to_vec()).collect()
}

fn folder(files: &[(&str, Vec<u8>)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder
}

fn cube_files() -> tempfile::TempDir {
    let (v, t) = (corners(), triangles());
    folder(&[
        ("cube.obj", obj(&v, &quads()).into_bytes()),
        ("text.stl", stl_text(&v, &t)),
        ("binary.stl", stl_binary(&v, &t)),
        ("cube.vtk", vtk_legacy(&v, &quads()).into_bytes()),
        ("cube.vtp", vtp(&v, &quads()).into_bytes()),
    ])
}

#[test]
fn all_kinds_of_files_hold_the_same_cube() {
    let folder = cube_files();
    for name in ["cube.obj", "text.stl", "binary.stl", "cube.vtk", "cube.vtp"] {
        let read = read::read_surface(&folder.path().join(name)).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!((read.surface.vertices().len(), read.surface.triangles().len(), read.flipped), (8, 12, 0), "{name}");
        let properties = read.surface.mass_properties();
        assert!((properties.volume - 8.0).abs() < 1e-14 && (properties.centre[0] - 10.0).abs() < 1e-14, "{name}");
    }
}

#[test]
fn every_fault_of_a_file_is_reported() {
    let (v, t) = (corners(), triangles());
    let mut turned = quads();
    turned[3].reverse();
    let scribble = |text: &str| text.as_bytes().to_vec();
    let folder = folder(&[
        ("open.stl", stl_text(&v, &t[1..])),
        ("turned.obj", obj(&v, &turned).into_bytes()),
        ("nan.obj", obj(&v, &quads()).replacen("v 9.0", "v NaN", 1).into_bytes()),
        ("nan.vtk", vtk_legacy(&v, &quads()).replacen("9.0", "NaN", 1).into_bytes()),
        ("nan.vtp", vtp(&v, &quads()).replacen("9.0", "NaN", 1).into_bytes()),
        ("word.obj", obj(&v, &quads()).replacen("v 9.0", "v nine", 1).into_bytes()),
        ("side.obj", obj(&v, &quads()).replacen("\nf ", "\nf 1 2 3\nf 1 2 3\nf one ", 1).into_bytes()),
        (
            "word.stl",
            String::from_utf8(stl_text(&v, &t))
                .unwrap()
                .replacen("vertex", "vortex", 7)
                .replacen("vortex", "vertex", 6)
                .into_bytes(),
        ),
        ("beyond.vtk", vtk_legacy(&v, &[vec![0, 1, 99]]).into_bytes()),
        ("torn.vtk", vtk_legacy(&v, &quads()).as_bytes()[..200].to_vec()),
        ("torn.vtp", vtp(&v, &quads()).as_bytes()[..500].to_vec()),
        ("ends.vtp", vtp(&v, &quads()).replace("4 8 12", "4 8 1200").into_bytes()),
        ("few.vtp", vtp(&v, &quads()).replace("NumberOfPoints=\"8\"", "NumberOfPoints=\"80\"").into_bytes()),
        ("appended.vtp", vtp(&v, &quads()).replace("ascii", "appended").into_bytes()),
        ("empty.obj", Vec::new()),
        ("empty.stl", Vec::new()),
        ("empty.vtk", Vec::new()),
        ("empty.vtp", Vec::new()),
        ("short.stl", stl_binary(&v, &t)[..300].to_vec()),
        ("noise.stl", (0..4000u32).map(|k| (k * k % 251) as u8).collect()),
        ("noise.vtk", (0..4000u32).map(|k| (k * k % 251) as u8).collect()),
        ("noise.vtp", (0..4000u32).map(|k| (k * k % 251) as u8).collect()),
        ("noise.obj", (0..4000u32).map(|k| (k * k % 251) as u8).collect()),
        (
            "grid.vtk",
            scribble(
                "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n",
            ),
        ),
        ("body.ply", scribble("ply\n")),
    ]);
    let messages = |name: &str| match read::read_surface(&folder.path().join(name)) {
        Ok(read) => format!("{} turned", read.flipped),
        Err(faults) => faults.to_string().replace(&format!("{}/", folder.path().display()), ""),
    };
    assert_eq!(
        messages("open.stl"),
        "open.stl: surface: the edge of vertices 1 and 2 belongs to 1 triangle; expected 2\n\
         open.stl: surface: the edge of vertices 1 and 6 belongs to 1 triangle; expected 2\n\
         open.stl: surface: the edge of vertices 2 and 6 belongs to 1 triangle; expected 2"
            .replace("1 and 2", "EDGE")
            .replace("1 and 6", "EDGE")
            .replace("2 and 6", "EDGE")
            .lines()
            .zip(messages("open.stl").lines())
            .map(|(pattern, line)| {
                let words: Vec<&str> = line.split_whitespace().collect();
                pattern.replace("EDGE", &format!("{} and {}", words[6], words[8]))
            })
            .collect::<Vec<_>>()
            .join("\n"),
        "three open edges"
    );
    assert_eq!(messages("turned.obj"), "2 turned"); // both triangles of that side
    assert_eq!(messages("nan.obj").lines().count(), 1, "{}", messages("nan.obj"));
    assert!(messages("nan.obj").starts_with("nan.obj:3: file: 'NaN', which is not finite"), "{}", messages("nan.obj"));
    for (name, expected) in [
        ("nan.vtk", "file: 'NaN', which is not finite; expected points"),
        ("nan.vtp", "file: 'NaN', which is not finite; expected polygonal data of VTK"),
        ("word.obj", "word.obj:3: file: 'nine', which is not a number; expected three coordinates"),
        ("side.obj", "side.obj:14: file: "),
        ("word.stl", "word.stl:18: file: the word 'vortex'"),
        ("beyond.vtk", "file: cell 1 names point 99, where points are 0 to 7; expected polygonal data of VTK"),
        ("torn.vtk", "numbers announced"),
        ("torn.vtp", "expected a complete file"),
        ("ends.vtp", "cell 3 ends at corner 1200 of 24; expected polygonal data of VTK"),
        ("appended.vtp", "file: array 'Points': it ends before the number of its bytes; expected a complete file"),
        ("empty.obj", "it is empty"),
        ("empty.stl", "expected"),
        ("empty.vtk", "expected polygonal data of VTK"),
        ("empty.vtp", "expected polygonal data of VTK"),
        ("short.stl", "expected an STL file, text or binary, that is complete"),
        ("noise.stl", "expected"),
        ("noise.vtk", "expected polygonal data of VTK"),
        ("noise.vtp", "expected polygonal data of VTK"),
        ("noise.obj", "expected"),
        ("grid.vtk", "DATASET STRUCTURED_POINTS; expected DATASET POLYDATA"),
        ("body.ply", "file: the ending 'ply'; expected .obj, .stl, .vtk or .vtp"),
    ] {
        let said = messages(name);
        assert!(said.contains(expected) && said.starts_with(name), "{name}: {said}");
    }
    assert!(messages("few.vtp").contains("NumberOfPoints=\"80\", and 8 found"), "{}", messages("few.vtp"));
}

/// The same with what editors and scanners write too.
#[test]
fn comments_continued_lines_and_capital_letters_are_read() {
    let (v, t) = (corners(), triangles());
    let bent = obj(&v, &quads()).replace("f 1 5 7 3\n", "f 1/2/3 5//9 \\\n  7 -6 # to the left\n");
    assert!(bent.contains("-6"), "{bent}");
    let text = String::from_utf8(stl_text(&v, &t)).unwrap();
    let folder = folder(&[
        ("bent.obj", bent.into_bytes()),
        ("windows.obj", obj(&v, &quads()).replace('\n', "\r\n").into_bytes()),
        ("capital.stl", text.to_uppercase().into_bytes()),
        ("windows.stl", text.replace('\n', "\r\n").into_bytes()),
        ("nameless.stl", text.replace("solid body", "solid").into_bytes()),
    ]);
    for name in ["bent.obj", "windows.obj", "capital.stl", "windows.stl", "nameless.stl"] {
        let read = read::read_surface(&folder.path().join(name)).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!((read.surface.vertices().len(), read.surface.triangles().len(), read.flipped), (8, 12, 0), "{name}");
        assert!((read.surface.volume() - 8.0).abs() < 1e-14, "{name}");
    }
}

fn scene(fields: &str) -> String {
    format!(
        r#"(
            seed: 5,
            materials: [(name: "ROCKx", density: 2000.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.4))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(material: "ROCKx", colour: "BLUEx", {fields})],
        )"#
    )
}

fn datbox(folder: &Path, fields: &str) -> Result<(Bodies, Dof), String> {
    let path: PathBuf = folder.join("scene.ron");
    let (scene, population) = cd_pre::read_scene(&path, &scene(fields), &[])
        .map_err(|faults| faults.to_string().replace(&format!("{}/", folder.display()), ""))?;
    let files = write::datbox_files(&scene, &population);
    let text = |name: &str| AsciiText::new(files.iter().find(|(known, _)| known == name).unwrap().1.as_bytes());
    let bodies = Bodies::parse(Path::new("BODIES.DAT"), &text("BODIES.DAT")).unwrap();
    Ok((bodies, Dof::parse(Path::new("DOF.INI"), &text("DOF.INI")).unwrap()))
}

/// The pieces as they stand, m.
fn pieces(body: &Body, axes: &[[f64; 3]; 3]) -> Vec<Surface> {
    let turn = Matrix3::from_columns(&axes.map(Vector3::from));
    let piece = |shape: &ShapeRecord| {
        let ShapeRecord::Polyhedron { vertices, triangles } = shape else { panic!("no polyhedron") };
        let standing: Vec<[f64; 3]> =
            vertices.iter().map(|&v| (Vector3::from(body.position) + turn * Vector3::from(v)).into()).collect();
        Surface::new(&standing, triangles).unwrap()
    };
    body.contactors.iter().map(|contactor| piece(&contactor.shape)).collect()
}

const STANDING: &str = "grain_orientation: Same((axis: (0, 0, 1), angle: 0)), placement: List(positions: [(0, 0, 0)])";

#[test]
fn a_model_has_the_given_size() {
    let folder = cube_files();
    for (scaled, half) in [
        ("", 1.0),
        (", scale: Factor(1000)", 1000.0),
        (", scale: Volume(64)", 2.0),
        (", scale: Length(3)", 1.5),
        (", scale: Radius(1)", (std::f64::consts::PI / 6.0).cbrt()),
    ] {
        let (bodies, dof) =
            datbox(folder.path(), &format!("shape: Model(file: \"cube.vtp\"{scaled}), {STANDING}")).unwrap();
        let ShapeRecord::Polyhedron { vertices, .. } = &bodies.0[0].contactors[0].shape else { panic!() };
        // Eleven digits.
        assert!(vertices.iter().flatten().all(|x| (x.abs() / half - 1.0).abs() < 1e-10), "{scaled}: {vertices:?}");
        assert_eq!(dof.bodies[0].axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }
    // With sizes, the model's own does not matter.
    let (bodies, _) = datbox(
        folder.path(),
        "shape: Model(file: \"cube.obj\", scale: Factor(7)), sizes: Single(2), radius: Circumscribed, \
         placement: List(positions: [(0, 0, 0)])",
    )
    .unwrap();
    let ShapeRecord::Polyhedron { vertices, .. } = &bodies.0[0].contactors[0].shape else { panic!() };
    assert!(vertices.iter().all(|&v| (Vector3::from(v).norm() - 2.0).abs() < 1e-10));
}

#[test]
fn a_surface_that_is_not_convex_is_a_cluster_with_the_mass_of_the_surface() {
    let (v, f) = angle();
    let (block, beam) = ([0.0, 1.0, 1.0, 2.0], [0.0, 3.0, 0.0, 1.0]);
    let cuboid = |[x0, x1, z0, z1]: [f64; 4]| -> Vec<[f64; 3]> {
        (0..8usize).map(|k| [[x0, x1][k & 1], [0.0, 1.0][k >> 1 & 1], [z0, z1][k >> 2 & 1]]).collect()
    };
    let folder = folder(&[
        ("angle.obj", obj(&v, &f).into_bytes()),
        ("block.obj", obj(&cuboid(block), &quads()).into_bytes()),
        ("beam.obj", obj(&cuboid(beam), &quads()).into_bytes()),
    ]);
    let refused = datbox(folder.path(), &format!("shape: Model(file: \"angle.obj\"), {STANDING}")).unwrap_err();
    assert_eq!(
        refused,
        "angle.obj: surface: it is not convex; expected a convex one, or contact_shape: Hull, Pieces(...), Files([...]) or Balls(...)"
    );
    // By hand: centre of the beam (1.5, 0.5, 0.5), of the block (0.5, 0.5, 1.5), weights 3 and 1.
    let centre = Vector3::new(1.25, 0.5, 0.75);
    for (contact, counts, covered) in [
        ("Files([\"beam.obj\", \"block.obj\"])", 2..=2, 1e-10),
        // Pieces on voxels of 3/64, which overlap or miss about one layer at each cut.
        ("Pieces(max_pieces: 8)", 2..=8, 0.1),
        ("Pieces(max_pieces: 2, concavity: 0.1)", 2..=2, 0.1),
    ] {
        let fields = format!("shape: Model(file: \"angle.obj\", contact_shape: {contact}), {STANDING}");
        let (bodies, dof) = datbox(folder.path(), &fields).unwrap();
        let body = &bodies.0[0];
        assert!(counts.contains(&body.contactors.len()), "{contact}: {}", body.contactors.len());
        let volume = 4.0 / 3.0 * std::f64::consts::PI * body.equivalent_radius.powi(3);
        assert!((volume - 4.0).abs() < 1e-9, "{volume}");
        // Tensor about the centre in the fixed axes: of the beam and of the block, each moved to the common centre.
        let turn = Matrix3::from_columns(&dof.bodies[0].axes.map(Vector3::from));
        let tensor = turn * Matrix3::from_diagonal(&body.inertia.unwrap().into()) * turn.transpose();
        let part = |[x0, x1, z0, z1]: [f64; 4]| {
            let (lx, ly, lz) = (x1 - x0, 1.0, z1 - z0);
            let mass = lx * ly * lz;
            let own = Vector3::new(ly * ly + lz * lz, lx * lx + lz * lz, lx * lx + ly * ly) * (mass / 12.0);
            let arm = Vector3::new(0.5 * (x0 + x1), 0.5, 0.5 * (z0 + z1)) - centre;
            Matrix3::from_diagonal(&own)
                + mass * (Matrix3::from_diagonal_element(arm.norm_squared()) - arm * arm.transpose())
        };
        assert!((tensor - part(beam) - part(block)).amax() < 1e-9, "{contact}: {tensor}");
        let pieces = pieces(body, &dof.bodies[0].axes);
        assert!(pieces.iter().all(|piece| piece.is_convex(1e-9)));
        let sum: f64 = pieces.iter().map(Surface::volume).sum();
        assert!((sum / 4.0 - 1.0).abs() < covered, "{contact}: {sum}");
        // The position is that of the centre of mass: the ends of the L about it.
        let lowest = pieces.iter().flat_map(|piece| piece.vertices()).map(|v| v[0]).fold(f64::INFINITY, f64::min);
        assert!((lowest + 1.25).abs() < 1e-9, "{contact}: {lowest}");
    }
    let hull =
        datbox(folder.path(), &format!("shape: Model(file: \"angle.obj\", contact_shape: Hull), {STANDING}")).unwrap();
    // The hull adds the wedge of 2 x 1 / 2 over the beam.
    let volume = 4.0 / 3.0 * std::f64::consts::PI * hull.0.0[0].equivalent_radius.powi(3);
    assert!((volume - 5.0).abs() < 1e-9, "{volume}");
    let wrong = datbox(
        folder.path(),
        &format!("shape: Model(file: \"angle.obj\", contact_shape: Files([\"angle.obj\", \"none.obj\"])), {STANDING}"),
    );
    let wrong = wrong.unwrap_err();
    assert!(
        wrong.starts_with("angle.obj: surface: it is not convex; expected convex pieces\nscene.ron:6:")
            && wrong.contains(": grains 1, shape: none.obj cannot be read"),
        "{wrong}"
    );
    let shifted: Vec<[f64; 3]> = cuboid(block).into_iter().map(|[x, y, z]| [x + 5.0, y, z]).collect();
    std::fs::write(folder.path().join("outside.obj"), obj(&shifted, &quads())).unwrap();
    let files = "Files([\"beam.obj\", \"outside.obj\"])";
    let wrong =
        datbox(folder.path(), &format!("shape: Model(file: \"angle.obj\", contact_shape: {files}), {STANDING}"));
    let expected = "outside.obj: surface: it is outside the model; expected a piece of the model, in the same axes";
    assert_eq!(wrong.unwrap_err(), expected);
}

#[test]
fn there_are_never_more_pieces_than_requested_at_any_scale() {
    let (v, f) = angle();
    let folder = folder(&[("angle.obj", obj(&v, &f).into_bytes())]);
    for factor in [1.0, 1.1, 3.0] {
        for most in [1, 3, 4, 5] {
            let contact = format!("Pieces(max_pieces: {most}, concavity: 0.0)");
            let shape = format!("Model(file: \"angle.obj\", scale: Factor({factor:?}), contact_shape: {contact})");
            let (bodies, dof) = datbox(folder.path(), &format!("shape: {shape}, {STANDING}")).unwrap();
            let pieces = pieces(&bodies.0[0], &dof.bodies[0].axes);
            assert!((1..=most).contains(&pieces.len()), "{most}: {}", pieces.len());
            // All of the L is covered, by its hull if there is but one.
            let sum = pieces.iter().map(Surface::volume).sum::<f64>() / (factor * factor * factor);
            assert!(sum > 3.6 && sum < 5.1, "{factor}, {most}: {sum}");
        }
    }
}

#[test]
fn a_model_as_an_envelope_holds_its_grains() {
    let (v, f) = angle();
    let folder = folder(&[("angle.obj", obj(&v, &f).into_bytes())]);
    for (place, amount) in [
        ("RandomSequential(envelope: Model(file: \"angle.obj\", scale: Factor(10)))", "solid_fraction: 0.2"),
        ("JitteredLattice(envelope: Model(file: \"angle.obj\"))", "number: 200, solid_fraction: 0.15"),
        ("RandomSequential(envelope: Model(file: \"angle.obj\", scale: Volume(4000)))", "number: 100"),
    ] {
        let (bodies, _) = datbox(folder.path(), &format!("sizes: Single(0.8), placement: {place}, {amount}")).unwrap();
        let count = bodies.0.len();
        let total = count as f64 * 4.0 / 3.0 * std::f64::consts::PI * 0.8f64.powi(3);
        let size = if place.contains("Jittered") { (total / 0.15 / 4.0).cbrt() } else { 10.0 };
        assert!(count > 90, "{place}: {count}");
        for body in &bodies.0 {
            // Back to the axes of the file.
            let p = Vector3::from(body.position) / size + Vector3::new(1.25, 0.5, 0.75);
            let r = 0.8 / size * (1.0 - 1e-9);
            let within = |x: f64, low: f64, high: f64| x - r >= low && x + r <= high;
            // In the beam, in the upright, or in the corner between them off the edge where they meet.
            let beam = within(p.x, 0.0, 3.0) && within(p.z, 0.0, 1.0);
            let upright = within(p.x, 0.0, 1.0) && within(p.z, 0.0, 2.0);
            let corner = within(p.x, 0.0, 3.0)
                && within(p.z, 0.0, 2.0)
                && p.x < 1.0
                && p.z < 1.0
                && (p.x - 1.0).hypot(p.z - 1.0) >= r;
            assert!(within(p.y, 0.0, 1.0) && (beam || upright || corner), "{place}: {p}");
        }
    }
    let wrong = datbox(
        folder.path(),
        "number: 3, sizes: Single(1), placement: RandomSequential(envelope: Model(file: \"no.stl\", scale: Factor(1)))",
    );
    assert!(wrong.unwrap_err().contains("grains 1, placement: no.stl cannot be read: there is no such file"));
}

/// No corner of a cube leaves the L, and no part of the edge at its inner corner is in a cube: a point of it, in the axes of the
/// cube, is not within its half edge along all of them.
#[test]
fn a_dense_packing_of_cubes_keeps_within_a_concave_model() {
    let (v, f) = angle();
    let folder = folder(&[("angle.obj", obj(&v, &f).into_bytes())]);
    let grains = "shape: Cube, sizes: Single(1.6), solid_fraction: 0.3, \
                  placement: DensePacking(envelope: Model(file: \"angle.obj\", scale: Factor(10)))";
    let (bodies, dof) = datbox(folder.path(), grains).unwrap();
    assert_eq!(bodies.0.len(), 70); // 0.3 * 4000 / (4/3 pi 1.6^3)
    for (body, state) in bodies.0.iter().zip(&dof.bodies) {
        let centre: Vector3<f64> = Vector3::from(body.position) + 10.0 * Vector3::new(1.25, 0.5, 0.75);
        let ShapeRecord::Polyhedron { vertices, .. } = &body.contactors[0].shape else { panic!() };
        let to_fixed_axes: Matrix3<f64> = state.axes.into();
        let half = vertices[0][0].abs();
        for vertex in vertices {
            let p: Vector3<f64> = centre + to_fixed_axes * Vector3::from(*vertex);
            let is_inside = p.min() > 0.0 && p.y < 10.0 && p.x < 30.0 && p.z < if p.x < 10.0 { 20.0 } else { 10.0 };
            assert!(is_inside, "{p}");
        }
        for k in 0..1000 {
            let on_edge = Vector3::new(10.0, 0.01 * f64::from(k), 10.0);
            let local: Vector3<f64> = to_fixed_axes.transpose() * (on_edge - centre);
            assert!(local.abs().max() > half, "{on_edge} {centre}");
        }
    }
}

#[test]
fn a_broken_monolith_moves_as_one_and_fills_its_solid() {
    let folder = cube_files();
    for (envelope, volume) in [
        ("Ball(radius: 50)", 4.0 / 3.0 * std::f64::consts::PI * 125000.0),
        ("Box(lengths: (1, 2, 3))", 6.0),
        ("Model(file: \"cube.obj\", scale: Length(40))", 64000.0),
    ] {
        let (bodies, dof) = datbox(
            folder.path(),
            &format!(
                "number: 120, placement: Fragments(envelope: {envelope}), centre: (100, 0, 0), \
                 orientation: (axis: (1, 1, 0), angle: 0.7), spin: (0, 0, 0.5)"
            ),
        )
        .unwrap();
        assert_eq!(bodies.0.len(), 120);
        let solids: Vec<Surface> =
            bodies.0.iter().zip(&dof.bodies).map(|(b, d)| pieces(b, &d.axes).remove(0)).collect();
        let sum: f64 = solids.iter().map(Surface::volume).sum();
        // Twelve digits of each vertex.
        assert!((sum / volume - 1.0).abs() < 1e-10, "{envelope}: {sum}");
        let mut centre = Vector3::zeros();
        for solid in &solids {
            let properties = solid.mass_properties();
            centre += Vector3::from(properties.centre) * properties.volume / sum;
        }
        assert!((centre - Vector3::new(100.0, 0.0, 0.0)).norm() < 1e-8 * volume.cbrt(), "{envelope}: {centre}");
        for (body, dof) in bodies.0.iter().zip(&dof.bodies) {
            let velocity = Vector3::from_fn(|k, _| dof.velocity[k]);
            let expected = Vector3::new(0.0, 0.0, 0.5).cross(&(Vector3::from(body.position) - centre));
            assert!((velocity - expected).norm() < 1e-6 * volume.cbrt()); // seven digits
        }
    }
    let wrong = datbox(folder.path(), "number: 5, sizes: Single(1), placement: Fragments(envelope: Ball(radius: 1))")
        .unwrap_err();
    assert!(
        wrong.contains(
            "grains 1: shape, grain_orientation, radius, sizes or solid_fraction given for fragments; expected none of them"
        ),
        "{wrong}"
    );
    let wrong = datbox(folder.path(), "placement: Fragments(envelope: Ball())").unwrap_err();
    assert!(wrong.contains("fragments without number or size of the envelope, or too many"), "{wrong}");
}

#[test]
fn surfaces_of_attracting_bodies_are_written_next_to_the_options() {
    let field = |name: &str| format!("Polyhedron(surface: \"{name}\", scale: 2.0, density: 500.0)");
    let write = |fields: &str, files: &[(&str, Vec<u8>)]| {
        let folder = folder(files);
        let grain = "sizes: Single(1), placement: List(positions: [(9, 0, 0)])";
        let options = format!("compute: (dt: 1.0e-3, fields: [{fields}]),\ngrains:");
        std::fs::write(folder.path().join("scene.ron"), scene(grain).replace("grains:", &options)).unwrap();
        let datbox = folder.path().join("case/DATBOX");
        let written = cd_pre::write_datbox(&folder.path().join("scene.ron"), &[], &datbox);
        (folder, datbox, written)
    };
    let body = stl_text(&corners(), &triangles());
    let (_folder, datbox, written) =
        write(&[field("shapes/body.stl"), field("shapes/body.stl")].join(", "), &[("shapes/body.stl", body.clone())]);
    written.unwrap();
    let surface = cd_formats::obj::read_surface(&datbox.join("body.obj")).unwrap();
    assert!((surface.volume() - 8.0).abs() < 1e-6);
    let text = std::fs::read_to_string(datbox.join("COMPUTE.RON")).unwrap();
    assert_eq!(text.matches("surface: \"body.obj\"").count(), 2, "{text}");

    let twice = [field("a/body.stl"), field("b/body.stl")].join(", ");
    let (_, datbox, refused) = write(&twice, &[("a/body.stl", body.clone()), ("b/body.stl", body)]);
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("two files of the name body") && !datbox.exists(), "{message}");
    let (_, _, missing) = write(&field("none.obj"), &[]);
    assert!(missing.unwrap_err().to_string().contains("none.obj"));
}
