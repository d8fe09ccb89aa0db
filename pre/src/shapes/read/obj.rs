//! Wavefront OBJ: vertices and polygons; the other statements of polygonal files are read and not used.

use super::{Mesh, Refusal, coordinate, real};

const WORDS: &str = "v, f or another statement of a polygonal Wavefront OBJ file";

/// Statements without influence on the surface.
const UNUSED: [&str; 17] = [
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
const FREE_FORM: [&str; 16] = [
    "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end", "con",
    "ctech", "stech",
];

/// Reads the text of a file. Numbers after the third of `v` (a weight, a colour) are ignored: the weight is that of
/// free-form surfaces. Errors: every statement that cannot be read.
pub fn read(text: &str) -> Result<Mesh, Vec<Refusal>> {
    let mut mesh = Mesh::default();
    let mut refusals = Vec::new();
    let (mut weights, mut elements) = (0, 0);
    let mut lines_of_polygons = Vec::new();
    for (line, statement) in statements(text) {
        let mut words = statement.split_whitespace();
        let Some(keyword) = words.next().map(str::to_ascii_lowercase) else { continue };
        match keyword.as_str() {
            "v" => match vertex(words) {
                Ok((point, more)) => {
                    mesh.points.push(point);
                    weights += usize::from(more);
                }
                Err(found) => {
                    // Later numbers of vertices stay right.
                    mesh.points.push([0.0; 3]);
                    refusals.push(Refusal::new(line, found, "three coordinates, with decimal points"));
                }
            },
            "f" | "fo" => match words.map(|word| corner(word, mesh.points.len())).collect() {
                Ok(corners) => {
                    mesh.polygons.push(corners);
                    lines_of_polygons.push(line);
                }
                Err(found) => refusals.push(Refusal::new(line, found, "numbers of vertices, from 1, or from -1 back")),
            },
            "l" | "p" => elements += 1,
            unused if UNUSED.contains(&unused) => {}
            "call" | "csh" => {
                let found = format!("'{keyword}', with which other files come in");
                refusals.push(Refusal::new(line, found, "all vertices and polygons in this file"));
            }
            free if FREE_FORM.contains(&free) => {
                let found = format!("'{free}', a statement of free-form geometry");
                refusals.push(Refusal::new(line, found, "polygons; let the program that wrote it triangulate"));
            }
            other => refusals.push(Refusal::new(line, format!("the word '{other}'"), WORDS)),
        }
    }
    for (polygon, line) in mesh.polygons.iter().zip(lines_of_polygons) {
        if let Some(beyond) = polygon.iter().find(|&&corner| corner >= mesh.points.len()) {
            let found = format!("vertex {}", beyond + 1);
            refusals.push(Refusal::new(line, found, format!("1 to {}", mesh.points.len())));
        }
    }
    if refusals.is_empty() && mesh.polygons.is_empty() {
        refusals.push(Refusal::new(None, "no polygons", "f lines"));
    }
    mesh.note("ignored", elements, "line or point element", "");
    mesh.note("ignored", weights, "weight or colour", " after coordinates");
    if refusals.is_empty() { Ok(mesh) } else { Err(refusals) }
}

/// The lines without comments, each with those in which it is continued, and the number of the first.
fn statements(text: &str) -> Vec<(usize, String)> {
    let mut all: Vec<(usize, String)> = Vec::new();
    let mut continued = false;
    for (number, line) in (1..).zip(text.split('\n')) {
        let line = line.split('#').next().unwrap_or_default().trim();
        let (part, more) = line.strip_suffix('\\').map_or((line, false), |part| (part, true));
        match all.last_mut().filter(|_| continued) {
            Some((_, statement)) => *statement += &format!(" {part}"),
            None => all.push((number, part.to_string())),
        }
        continued = more;
    }
    all
}

/// The coordinates, and whether a weight other than 1 or a colour follows them.
fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> Result<([f64; 3], bool), String> {
    let words: Vec<&str> = words.collect();
    let [x, y, z, more @ ..] = words.as_slice() else {
        return Err(format!("a vertex of {} numbers", words.len()));
    };
    let point = [coordinate(x)?, coordinate(y)?, coordinate(z)?];
    for word in more {
        coordinate(word)?;
    }
    Ok((point, !more.is_empty() && more != ["1"] && more.iter().any(|word| real(word) != Some(1.0))))
}

/// The number of a corner's vertex, from 0, of a word such as `7`, `7/1`, `7//3` or `-2/1/1`; `known` vertices are
/// before it.
fn corner(word: &str, known: usize) -> Result<usize, String> {
    let number: i64 =
        (word.split('/').next().unwrap_or_default()).parse().map_err(|_| format!("the corner '{word}'"))?;
    let vertex = if number < 0 { number.saturating_add(known as i64) } else { number - 1 };
    usize::try_from(vertex).map_err(|_| format!("the corner '{word}' with {known} vertices before it"))
}
