//! Reader of Wavefront OBJ: vertices and polygons; the other statements of polygonal files are read and not used.

use std::path::Path;

use super::mesh::{MAX_READ_ERRORS, PolygonMesh, ReadError, coordinate, lines, parse_real};
use super::surface::Surface;
use crate::atomic;
use crate::error::{Fault, Faults};

const EXPECTED_STATEMENTS: &str = "v, f or another statement of a polygonal Wavefront OBJ file";

/// Statements without influence on the surface.
const IGNORED_STATEMENTS: [&str; 17] = [
    "vt",
    "vn",
    "o",
    "g",
    "s",
    "mg",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "lod",
    "bevel",
    "c_interp",
    "d_interp",
    "shadow_obj",
    "trace_obj",
    "vp",
];

/// Statements of free-form curves and surfaces.
const FREE_FORM_STATEMENTS: [&str; 16] = [
    "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end", "con",
    "ctech", "stech",
];

/// Reads the text of a file. Numbers after the third of `v` (a weight, a colour) are ignored: the weight is that of
/// free-form surfaces. Errors: every statement that cannot be read.
pub fn read(text: &str) -> Result<PolygonMesh, Vec<ReadError>> {
    let mut mesh = PolygonMesh::default();
    let mut errors = Vec::new();
    // DOS marks the end of a text by Ctrl-Z.
    let end = text.trim_end_matches(|c: char| c.is_whitespace() || matches!(c, '\0' | '\u{1a}')).len();
    let (text, marks) = (&text[..end], text[end..].matches(['\0', '\u{1a}']).count());
    let (mut weights, mut elements) = (0, 0);
    let mut lines_of_polygons = Vec::new();
    for (line, statement) in logical_lines(text) {
        if errors.len() > MAX_READ_ERRORS {
            break;
        }
        let mut words = statement.split_whitespace();
        let Some(keyword) = words.next().map(str::to_ascii_lowercase) else { continue };
        match keyword.as_str() {
            "v" => match parse_vertex(words, line) {
                Ok((point, has_weight)) => {
                    mesh.points.push(point);
                    weights += usize::from(has_weight);
                }
                Err(error) => {
                    // A point is added so that later vertices keep their numbers.
                    mesh.points.push([0.0; 3]);
                    errors.push(error);
                }
            },
            "f" | "fo" => match words.map(|word| parse_corner(word, mesh.points.len(), line)).collect() {
                Ok(corners) => {
                    mesh.polygons.push(corners);
                    lines_of_polygons.push(line);
                }
                Err(error) => errors.push(error),
            },
            "l" | "p" => elements += 1,
            unused if IGNORED_STATEMENTS.contains(&unused) => {}
            "call" | "csh" => {
                let found = format!("'{keyword}', which includes other files");
                errors.push(ReadError::new(line, found, "all vertices and polygons in this file"));
            }
            free if FREE_FORM_STATEMENTS.contains(&free) => {
                let found = format!("'{free}', a statement of free-form geometry");
                errors.push(ReadError::new(line, found, "polygons; let the program that wrote it triangulate"));
            }
            other => errors.push(ReadError::new(line, format!("the word '{other}'"), EXPECTED_STATEMENTS)),
        }
    }
    // Vertices behind the last line that was read are not known.
    let is_whole = errors.len() <= MAX_READ_ERRORS;
    for (polygon, line) in mesh.polygons.iter().zip(lines_of_polygons).filter(|_| is_whole) {
        if let Some(beyond) = polygon.iter().find(|&&corner| corner >= mesh.points.len()) {
            let found = format!("vertex {}", beyond + 1);
            errors.push(ReadError::new(line, found, format!("1 to {}", mesh.points.len())));
        }
    }
    if errors.is_empty() && mesh.polygons.is_empty() {
        errors.push(ReadError::new(None, "no polygons", "f lines"));
    }
    mesh.note_ignored(marks, "control character", "");
    mesh.note_ignored(elements, "line or point element", "");
    mesh.note_ignored(weights, "weight or colour", " after coordinates");
    if errors.is_empty() { Ok(mesh) } else { Err(errors) }
}

/// Reads a closed surface of triangles from a file. Errors: all faults of the file or of the surface.
pub fn read_surface(path: &Path) -> Result<Surface, Faults> {
    let text = atomic::read_text(path)?;
    let mut faults = Faults::default();
    let mesh = match read(&lines(&text)) {
        Ok(mesh) => mesh,
        Err(errors) => {
            for ReadError { line, found, expected } in errors {
                faults.push(Fault::new(path, line, "file", found, format!("expected {expected}")));
            }
            return Err(faults);
        }
    };
    let triangle = |corners: &Vec<usize>| match corners[..] {
        [a, b, c] => Some([a as u32, b as u32, c as u32]),
        _ => None,
    };
    let Some(triangles) = mesh.polygons.iter().map(triangle).collect::<Option<Vec<[u32; 3]>>>() else {
        let expected = "expected triangles; cd-pre cuts polygons into triangles";
        return Err(Fault::new(path, None, "file", "polygons of other than three corners", expected).into());
    };
    Surface::new(&mesh.points, &triangles).map_err(|found| {
        found.0.iter().for_each(|fault| faults.push(fault.file_fault(path)));
        faults
    })
}

/// Text of a surface, its coordinates with all their digits.
pub fn surface_text(surface: &Surface) -> String {
    let vertices = surface.vertices().iter().map(|[x, y, z]| format!("v {x:?} {y:?} {z:?}\n"));
    let triangles = surface.triangles().iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(triangles).collect()
}

/// Lines without comments, each joined with its continuations, and the number of the first.
fn logical_lines(text: &str) -> Vec<(usize, String)> {
    let mut statements: Vec<(usize, String)> = Vec::new();
    let mut is_continuation = false;
    for (number, line) in (1..).zip(text.split('\n')) {
        let line = line.split('#').next().unwrap_or_default().trim();
        let (part, is_continued) = line.strip_suffix('\\').map_or((line, false), |part| (part, true));
        match statements.last_mut().filter(|_| is_continuation) {
            Some((_, statement)) => *statement += &format!(" {part}"),
            None => statements.push((number, part.to_string())),
        }
        is_continuation = is_continued;
    }
    statements
}

/// Coordinates of the vertex on a line, and whether a weight other than 1 or a colour follows them.
fn parse_vertex<'a>(words: impl Iterator<Item = &'a str>, line: usize) -> Result<([f64; 3], bool), ReadError> {
    let words: Vec<&str> = words.collect();
    let error = |found: String| ReadError::new(line, found, "three coordinates, with decimal points");
    let [x, y, z, extra @ ..] = words.as_slice() else {
        return Err(error(format!("a vertex of {} numbers", words.len())));
    };
    let coordinate = |word: &str| coordinate(word).map_err(|found| error(found.to_string()));
    let point = [coordinate(x)?, coordinate(y)?, coordinate(z)?];
    for word in extra {
        coordinate(word)?;
    }
    Ok((point, extra.iter().any(|word| parse_real(word) != Some(1.0))))
}

/// Vertex number of a corner on a line, from 0, from a word such as `7`, `7/1`, `7//3` or `-2/1/1`; `vertex_count` is the number
/// of vertices before it.
fn parse_corner(word: &str, vertex_count: usize, line: usize) -> Result<usize, ReadError> {
    let error = |found: String| ReadError::new(line, found, "numbers of vertices, from 1, or from -1 back");
    let number: i64 =
        (word.split('/').next().unwrap_or_default()).parse().map_err(|_| error(format!("the corner '{word}'")))?;
    let vertex = if number < 0 { number.saturating_add(vertex_count as i64) } else { number - 1 };
    usize::try_from(vertex).map_err(|_| error(format!("the corner '{word}' with {vertex_count} vertices before it")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_read_as_it_was_written() {
        let vertices = [[0.1, 0.0, 0.0], [1.0, 1.0 / 3.0, 0.0], [0.0, 1e-7, 0.0], [0.0, 0.0, 1.0 / 7.0]];
        let surface = Surface::new(&vertices, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.obj");
        std::fs::write(&path, surface_text(&surface)).unwrap();
        assert_eq!(read_surface(&path).unwrap(), surface);

        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let message = read_surface(&path).unwrap_err().to_string();
        assert!(message.contains("surface") && message.contains("edge"), "{message}");
        std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
        assert!(read_surface(&path).unwrap_err().to_string().contains("triangles"));
        std::fs::write(&path, "v 0 0\n").unwrap();
        assert!(read_surface(&path).unwrap_err().to_string().contains(":1: "));
    }
}
