//! Surface files as CAD programs, scanners and meshers write them: a cube of 1 m^3 in each, or words that name the cause.

use std::path::Path;

use cd_pre::shapes::model::ModelSolid;
use cd_pre::shapes::read::{self, RepairedSurface};

fn file(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/surfaces").join(name)
}

fn read_bytes(name: &str, bytes: &[u8]) -> Result<RepairedSurface, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read::read_surface(&path).map_err(|faults| faults.to_string().replace(&format!("{}/", folder.path().display()), ""))
}

/// The text of a file with something replaced, which must be there.
fn edited_file(name: &str, old: &str, new: &str) -> Vec<u8> {
    let text = std::fs::read_to_string(file(name)).unwrap();
    assert!(text.contains(old), "{name}: {old}");
    text.replace(old, new).into_bytes()
}

#[test]
fn files_of_many_programs_hold_a_cube() {
    for (name, volume, repairs) in [
        ("bom.obj", 1.0, ""),
        ("degenerate-triangle.obj", 1.0, "dropped 1 degenerate triangle"),
        ("line-element.obj", 1.0, "ignored 1 line or point element"),
        ("negative.obj", 1.0, ""),
        ("one-face-turned.obj", 1.0, ""),
        ("last-digit-gaps.stl", 0.343, "welded 24 vertices closer than 7.0e-8 m"),
        ("leading-blank.stl", 1.0, ""),
        ("leading-newline.stl", 1.0, ""),
        ("name-endsolid.stl", 1.0, ""),
        ("nan-normals.stl", 1.0, "ignored 12 normals without numbers"),
        ("no-endsolid.stl", 1.0, ""),
        ("solid-binary.stl", 1.0, ""),
        ("trailing-bytes.stl", 1.0, "ignored 10 bytes after the last triangle"),
        ("appended-raw.vtp", 1.0, ""),
        ("appended-zlib-base64.vtp", 1.0, ""),
        ("appended-zlib-raw.vtp", 1.0, ""),
        ("big-endian.vtp", 1.0, ""),
        ("header-apart.vtp", 1.0, ""),
        ("inline-base64.vtp", 1.0, ""),
        ("two-pieces.vtp", 1.0, ""),
        ("binary.vtk", 1.0, ""),
        ("little-endian.vtk", 1.0, "read as little-endian, which legacy files should not be"),
        ("version-5.vtk", 1.0, ""),
    ] {
        let read = read::read_surface(&file(name)).unwrap_or_else(|faults| panic!("{faults}"));
        assert_eq!((read.surface.vertices().len(), read.surface.triangles().len()), (8, 12), "{name}");
        // Corners of last-digit-gaps.stl are off by up to 6e-8 of 0.35 m, in single precision.
        assert!((read.surface.volume() / volume - 1.0).abs() < 1e-6, "{name}: {}", read.surface.volume());
        assert_eq!(read.repairs.join(", "), repairs, "{name}");
    }
}

#[test]
fn what_does_not_change_the_surface_is_read() {
    let stl = "nan-normals.stl";
    let upper = |name: &str| std::fs::read_to_string(file(name)).unwrap().to_uppercase().into_bytes();
    let lines = |name: &str, end: &str| std::fs::read_to_string(file(name)).unwrap().replace('\n', end).into_bytes();
    let text = std::fs::read_to_string(file("no-endsolid.stl")).unwrap();
    let halves = {
        let middle = text.match_indices(" facet normal").nth(6).unwrap().0;
        format!("{}endsolid c\nsolid d\n{}endsolid d\n", &text[..middle], &text[middle..])
    };
    let one_line = format!("solid c\n{}", text.lines().skip(1).collect::<Vec<_>>().join(" "));
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "name.stl",
            edited_file(stl, "solid c", "solid facet vertex endfacet 1 2"),
            "ignored 12 normals without numbers",
        ),
        ("nameless.stl", edited_file("no-endsolid.stl", "solid c", "solid"), ""),
        ("capital.stl", upper("leading-newline.stl"), ""),
        ("tabs.stl", edited_file("no-endsolid.stl", " ", "\t"), ""),
        ("windows.stl", lines("no-endsolid.stl", "\r\n"), ""),
        ("exponents.stl", edited_file("no-endsolid.stl", "0.5", "5.000E-001"), ""),
        ("fortran.stl", edited_file("no-endsolid.stl", "0.5", "0.5D+00"), ""),
        ("normals.stl", edited_file(stl, "nan nan nan", "-nan(ind) 1.#QNAN inf"), "ignored 12 normals without numbers"),
        ("solids.stl", halves.into_bytes(), "read 2 solids as one surface"),
        ("line.stl", one_line.into_bytes(), ""),
        ("dos.stl", [text.as_bytes(), b"endsolid\r\n\x1a\0"].concat(), "ignored 2 control characters"),
        ("end.stl", text.trim_end().as_bytes().to_vec(), ""),
        (
            "weight.obj",
            edited_file("negative.obj", "v 0.5 0.5 -0.5", "v 0.5 0.5 -0.5 2.0"),
            "ignored 1 weight or colour after coordinates",
        ),
        ("weights.obj", edited_file("line-element.obj", "5\nv", "5 1.0\nv"), "ignored 1 line or point element"),
        (
            "colour.obj",
            edited_file("line-element.obj", "l 1 2", "v 9 9 9 0.5 0.5 0.25"),
            "ignored 1 weight or colour after coordinates",
        ),
        (
            "normals.obj",
            edited_file("line-element.obj", "f 1 3 4 2", "vn 0 0 1\nvt 0 0\nf 1/1/1 3//1 \\\n 4/1 2"),
            "ignored 1 line or point element",
        ),
        (
            "words.obj",
            edited_file("line-element.obj", "l 1 2", "o endsolid f\ng v\ns off\nusemtl a b\np 1\n# f 9 9 9"),
            "ignored 1 line or point element",
        ),
        ("windows.obj", lines("bom.obj", "\r\n"), ""),
        (
            "dos.obj",
            [std::fs::read(file("negative.obj")).unwrap(), b"\r\n\x1a".to_vec()].concat(),
            "ignored 1 control character",
        ),
        ("newline.vtk", [b"\n".to_vec(), std::fs::read(file("binary.vtk")).unwrap()].concat(), ""),
        ("twice.obj", edited_file("line-element.obj", "l 1 2", "f 1 3 4 2"), "dropped 2 duplicate triangles"),
        ("tabs.vtp", edited_file("two-pieces.vtp", " 0.5", "\n\t0.5"), ""),
        ("xml.vtk", std::fs::read(file("two-pieces.vtp")).unwrap(), ""),
        ("old.vtp", std::fs::read(file("binary.vtk")).unwrap(), ""),
    ];
    for (name, bytes, repairs) in cases {
        let read = read_bytes(name, &bytes).unwrap_or_else(|faults| panic!("{faults}"));
        assert!((read.surface.volume() - 1.0).abs() < 1e-14, "{name}: {}", read.surface.volume());
        assert_eq!(read.repairs.join(", "), repairs, "{name}");
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let binary = |name: &str, old: &[u8], new: &[u8]| {
        let mut bytes = std::fs::read(file(name)).unwrap();
        let at = bytes.windows(old.len()).position(|window| window == old).unwrap();
        bytes.splice(at..at + old.len(), new.iter().copied());
        bytes
    };
    let stl = std::fs::read(file("solid-binary.stl")).unwrap();
    let few = [&stl[..80], &11_u32.to_le_bytes(), &stl[84..]].concat();
    let mut many = stl.clone();
    many[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        (
            "comma.obj",
            edited_file("negative.obj", "v 0.5 0.5 -0.5", "v 0,5 0,5 -0,5"),
            "comma.obj:4: file: '0,5', which is not a number; expected three coordinates, with decimal points",
        ),
        ("short.obj", edited_file("negative.obj", "v 0.5 0.5 -0.5", "v 0.5 0.5"), "a vertex of 2 numbers"),
        (
            "zero.obj",
            edited_file("line-element.obj", "f 1 3 4 2", "f 0 3 4 2"),
            "zero.obj:9: file: the corner '0' with 8 vertices before it",
        ),
        (
            "beyond.obj",
            edited_file("line-element.obj", "f 1 3 4 2", "f 1 3 4 9"),
            "beyond.obj:9: file: vertex 9; expected 1 to 8",
        ),
        (
            "back.obj",
            edited_file("line-element.obj", "f 1 3 4 2", "f -9 3 4 2"),
            "the corner '-9' with 8 vertices before it",
        ),
        (
            "nurbs.obj",
            edited_file("line-element.obj", "l 1 2", "surf 0 1 0 1 1 2"),
            "'surf', a statement of free-form geometry; expected polygons",
        ),
        ("word.obj", edited_file("line-element.obj", "l 1 2", "vertex 1 2 3"), "word.obj:15: file: the word 'vertex'"),
        ("points.obj", b"v 0 0 0\n".to_vec(), "no polygons; expected f lines"),
        ("wide.obj", b"\xff\xfev\x00 \x00".to_vec(), "text in UTF-16"),
        ("packed.stl", b"\x1f\x8b\x08\x00".to_vec(), "compressed by gzip"),
        (
            "torn.stl",
            stl[..300].to_vec(),
            "12 triangles announced, 4 found: 300 bytes; expected an STL file, text or binary, that is complete",
        ),
        ("few.stl", few, "file: 11 triangles announced, 12 found: 684 bytes; expected an STL file with"),
        ("many.stl", many, "4294967295 triangles announced, 12 found"),
        ("text.stl", std::fs::read(file("negative.obj")).unwrap(), "text that does not begin with 'solid'"),
        (
            "facet.stl",
            edited_file("no-endsolid.stl", "endloop", "endlop"),
            "facet.stl:7: file: the word 'endlop'; expected vertex and three coordinates, or endloop",
        ),
        (
            "number.stl",
            edited_file("leading-newline.stl", "vertex -0.5 0.5", "vertex -0.5 O.5"),
            "'o.5', which is not a number",
        ),
        (
            "within.stl",
            std::fs::read(file("no-endsolid.stl")).unwrap()[..900].to_vec(),
            "the end of the file within facet 8",
        ),
        (
            "counts.vtk",
            binary("version-5.vtk", b"POINTS 8", b"POINTS 88888888888888888888"),
            "'88888888888888888888'; expected the number of points",
        ),
        ("huge.vtk", binary("binary.vtk", b"POINTS 8", b"POINTS 8888888888888888888"), "numbers announced"),
        ("torn.vtk", std::fs::read(file("binary.vtk")).unwrap()[..200].to_vec(), "corners: 30 numbers announced, "),
        (
            "grid.vtk",
            binary("binary.vtk", b"POLYDATA", b"UNSTRUCTURED_GRID"),
            "DATASET UNSTRUCTURED_GRID; expected DATASET POLYDATA; in ParaView: Extract Surface",
        ),
        (
            "grid.vtp",
            edited_file("two-pieces.vtp", "VTKFile type=\"PolyData\"", "VTKFile type=\"UnstructuredGrid\""),
            "VTKFile of the type 'UnstructuredGrid'; expected PolyData",
        ),
        (
            "lz4.vtp",
            edited_file("two-pieces.vtp", "header_type", "compressor=\"vtkLZ4DataCompressor\" header_type"),
            "compressed by vtkLZ4DataCompressor; expected vtkZLibDataCompressor or none",
        ),
        (
            "block.vtp",
            binary("appended-zlib-raw.vtp", &[0x78, 0x9c], &[0x78, 0x9d]),
            "block 1 of 1 is not a complete zlib stream",
        ),
        ("long.vtp", binary("appended-raw.vtp", &[192, 0, 0, 0, 0, 0, 0, 0], &[255; 8]), "bytes announced"),
        (
            "few.vtp",
            edited_file("two-pieces.vtp", "NumberOfPoints=\"8\"", "NumberOfPoints=\"9\""),
            "NumberOfPoints=\"9\", and 8 found",
        ),
        ("tags.vtp", edited_file("two-pieces.vtp", "</Polys>", "</Poly>"), "</Poly> where <Polys> is open"),
        ("torn.vtp", std::fs::read(file("two-pieces.vtp")).unwrap()[..700].to_vec(), "the end of the file within"),
    ];
    for (name, bytes, expected) in cases {
        let found = read_bytes(name, &bytes).map(|read| read.surface.volume()).unwrap_err();
        assert!(found.contains(expected) && found.starts_with(name), "{name}: {found}");
    }
}

/// Every file cut off anywhere, and with any byte changed, is read or rejected: no panic, no endless loop.
#[test]
fn torn_and_damaged_files_end_in_words() {
    for entry in std::fs::read_dir(file("")).unwrap() {
        let path = entry.unwrap().path();
        let (bytes, name) = (std::fs::read(&path).unwrap(), path.file_name().unwrap().to_str().unwrap());
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join(name);
        let mut state = 1u64;
        for k in 0..60 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = (state >> 33) as usize % bytes.len();
            let mut bytes = bytes.clone();
            if k % 2 == 0 {
                bytes.truncate(at)
            } else {
                bytes[at] ^= (state >> 20) as u8 | 1
            }
            std::fs::write(&copy, bytes).unwrap();
            if let Err(faults) = read::read_surface(&copy) {
                assert!(!faults.0.is_empty() && faults.0.iter().all(|fault| !fault.found.is_empty()), "{name}");
            }
        }
    }
}

/// Surfaces that are no body: the edges that are wrong are counted, not listed without end.
#[test]
fn surfaces_that_are_no_body_are_rejected() {
    let cube = std::fs::read_to_string(file("line-element.obj")).unwrap().replace("l 1 2\n", "");
    let other = |shift: [f64; 3], first: usize| {
        let mut text = String::new();
        for line in cube.lines() {
            let mut words = line.split_whitespace();
            let kind = words.next().unwrap();
            text += kind;
            for (k, word) in words.enumerate() {
                match kind {
                    "v" => text += &format!(" {}", word.parse::<f64>().unwrap() + shift[k]),
                    _ => text += &format!(" {}", word.parse::<usize>().unwrap() + first),
                }
            }
            text += "\n";
        }
        text
    };
    for (name, more, expected) in [
        ("apart.obj", other([3.0, 0.0, 0.0], 8), "is not connected with triangle 1; expected one piece"),
        ("edge.obj", other([1.0, 1.0, 0.0], 8), "belongs to 4 triangles; expected 2"),
        ("fin.obj", "v 2 2 2\nf 1 2 9\n".to_string(), "belongs to 3 triangles; expected 2"),
        ("nan.obj", "v nan 2 2\nf 1 2 9\n".to_string(), "file: 'nan', which is not finite"),
    ] {
        let found = read_bytes(name, format!("{cube}{more}").as_bytes()).map(|read| read.surface.volume()).unwrap_err();
        assert!(found.contains(expected) && found.lines().count() <= 6, "{name}: {found}");
    }
    let inside_out: String = cube
        .lines()
        .map(|line| match line.strip_prefix("f ") {
            Some(corners) => format!("f {}\n", corners.split(' ').rev().collect::<Vec<_>>().join(" ")),
            None => format!("{line}\n"),
        })
        .collect();
    let read = read_bytes("inside-out.obj", inside_out.as_bytes()).unwrap();
    assert!((read.surface.volume() - 1.0).abs() < 1e-14);
}

/// A binary STL file of the cube with other byte order, normals or bytes before it; text with other line ends.
#[test]
fn stl_and_obj_as_old_and_careless_programs_write_them() {
    let stl = std::fs::read(file("solid-binary.stl")).unwrap();
    let count = u32::from_le_bytes(stl[80..84].try_into().unwrap()) as usize;
    let swapped = {
        let mut bytes = stl.clone();
        bytes[80..84].reverse();
        for triangle in bytes[84..].chunks_exact_mut(50) {
            triangle[..48].chunks_exact_mut(4).for_each(<[u8]>::reverse);
        }
        bytes
    };
    let nan = {
        let mut bytes = stl.clone();
        bytes[84..88].copy_from_slice(&f32::NAN.to_le_bytes());
        bytes
    };
    assert_eq!(count, 12);
    let text = std::fs::read_to_string(file("no-endsolid.stl")).unwrap();
    let old = |name: &str| std::fs::read_to_string(file(name)).unwrap().replace('\n', "\r").into_bytes();
    let one_line = text.split_whitespace().collect::<Vec<_>>().join(" ") + " endsolid c";
    let two_lines = format!("{one_line} solid d {}", &one_line[8..]);
    for (name, bytes, repairs) in [
        ("nul.stl", [b"\0", text.as_bytes()].concat(), "ignored 1 control character"),
        ("newline.stl", [b"\n", stl.as_slice()].concat(), "ignored 1 byte before the header"),
        ("blanks.stl", [b"\r\n  ", stl.as_slice()].concat(), "ignored 4 bytes before the header"),
        ("big-endian.stl", swapped, "read as big-endian, which STL files should not be"),
        ("nan.stl", nan, "ignored 1 normal without numbers"),
        ("old.stl", old("no-endsolid.stl"), ""),
        ("old.obj", old("negative.obj"), ""),
        ("one-line.stl", one_line.clone().into_bytes(), ""),
        ("copies.stl", two_lines.into_bytes(), "dropped 12 duplicate triangles"),
        (
            "normal.stl",
            edited_file("no-endsolid.stl", "normal 0 0 0", "normal 0 0"),
            "ignored 12 normals without numbers",
        ),
    ] {
        let read = read_bytes(name, &bytes).unwrap_or_else(|faults| panic!("{name}: {faults}"));
        assert!((read.surface.volume() - 1.0).abs() < 1e-14, "{name}: {}", read.surface.volume());
        assert_eq!(read.repairs.join(", "), repairs, "{name}");
    }
}

#[test]
fn the_cause_is_named_in_its_line() {
    let wide: Vec<u8> = "solid c\n facet".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let marked: Vec<u8> = "\u{feff}solid c\n facet".encode_utf16().flat_map(u16::to_be_bytes).collect();
    for (name, bytes, expected) in [
        ("wide.stl", wide, "text in UTF-16, not UTF-8 or ASCII"),
        ("marked.stl", marked, "text in UTF-16, not UTF-8 or ASCII"),
        (
            "two.stl",
            edited_file("no-endsolid.stl", "vertex -0.5 0.5 0.5", "vertex -0.5 0.5"),
            "file: a vertex of 2 numbers; expected vertex and three coordinates",
        ),
        (
            "nan.obj",
            edited_file("negative.obj", "v 0.5 0.5 -0.5", "v nan 0.5 -0.5"),
            "nan.obj:4: file: 'nan', which is not finite",
        ),
        ("call.obj", edited_file("line-element.obj", "l 1 2", "call other.obj"), "'call', which includes other files"),
        (
            "order.vtp",
            edited_file("two-pieces.vtp", "LittleEndian", "MiddleEndian"),
            "byte_order=\"MiddleEndian\"; expected LittleEndian or BigEndian",
        ),
        (
            "head.vtp",
            edited_file("two-pieces.vtp", "header_type=\"UInt", "header_type=\"Real"),
            "expected UInt32 or UInt64",
        ),
        (
            "plane.vtp",
            edited_file("two-pieces.vtp", "NumberOfComponents=\"3\"", "NumberOfComponents=\"2\""),
            "NumberOfComponents=\"2\" of Points; expected 3",
        ),
    ] {
        let found = read_bytes(name, &bytes).map(|read| read.surface.volume()).unwrap_err();
        assert!(found.contains(expected), "{name}: {found}");
    }
    let text = edited_file("no-endsolid.stl", "vertex -0.5 0.5 0.5", "vertex -0.5 0.5");
    let line = String::from_utf8_lossy(&text).lines().position(|line| line.trim() == "vertex -0.5 0.5").unwrap() + 1;
    assert!(read_bytes("a.stl", &text).unwrap_err().starts_with(&format!("a.stl:{line}: ")));
}

/// A turned cube of 5 cm whose coordinates have six decimals: convex but for 1e-5 of its size.
#[test]
fn a_cube_of_few_digits_is_taken_as_its_hull() {
    use cd_pre::scene::{ContactSurface, ModelScale};
    let folder = tempfile::tempdir().unwrap();
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1);
    let cube_solid = |side: f64, dent: f64| {
        let mut text = String::new();
        for k in 0..8 {
            let corner = nalgebra::Vector3::from([k & 1, k >> 1 & 1, k >> 2 & 1].map(|bit| f64::from(bit) - 0.5));
            let x = turn * corner * side * if k == 7 { 1.0 - dent } else { 1.0 };
            text += &format!("v {:.6} {:.6} {:.6}\n", x.x, x.y, x.z);
        }
        text += "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
        std::fs::write(folder.path().join("cube.obj"), text).unwrap();
        cd_pre::shapes::model::model_solid(folder.path(), "cube.obj", ModelScale::Factor(1.0), &ContactSurface::Surface)
    };
    let mut hulls = 0;
    for k in 1..=10 {
        let side = 0.01 * f64::from(k);
        let (ModelSolid::Polyhedron(solid), message) = cube_solid(side, 0.0).unwrap() else { panic!("a clump") };
        hulls += usize::from(message.contains("replaced by its convex hull, from which it deviates by "));
        assert_eq!(solid.pieces.len(), 1);
        assert!((solid.pieces[0].volume() / side.powi(3) - 1.0).abs() < 3e-4);
    }
    // Which way digits are rounded decides whether corners stand out or in.
    assert!(hulls > 0);
    assert!(!cube_solid(1.0, 0.0).unwrap().1.contains("hull"));
    let found = cube_solid(1.0, 0.05).unwrap_err().to_string();
    assert!(found.contains("it is not convex"), "{found}");
}
