//! Closed surfaces from OBJ, STL and VTK files, repaired where that is safe, and checked.
//!
//! | module | |
//! |---|---|
//! | `obj` | Wavefront OBJ |
//! | `stl` | STL, text and binary |
//! | `legacy` | VTK legacy polygonal data |
//! | `vtp` | VTK XML polygonal data, also with zlib blocks |
//! | `repair` | from polygons over points to a triangulation: weld, drop, flip |

mod legacy;
mod obj;
mod repair;
mod stl;
mod vtp;

use std::borrow::Cow;
use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::surface::Surface;

/// Number of faults of one file that are printed one by one; a broken surface has thousands of the same kind.
const MAX_PRINTED_FAULTS: usize = 5;

/// A surface from a file, and what was changed to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct RepairedSurface {
    pub surface: Surface,
    /// Number of triangles that were turned to point outward with the others.
    pub flipped: usize,
    /// Parts that were ignored, dropped or welded, each in a phrase such as `dropped 1 degenerate triangle`.
    pub repairs: Vec<String>,
}

/// Polygons over points, the common form of all kinds of files.
#[derive(Debug, Default, PartialEq)]
struct PolygonMesh {
    points: Vec<[f64; 3]>,
    polygons: Vec<Vec<usize>>,
    /// Notes on repairs, as in [`RepairedSurface`].
    notes: Vec<String>,
}

/// Reason why a file is rejected.
#[derive(Debug, PartialEq)]
struct ReadError {
    line: Option<usize>,
    found: String,
    expected: String,
}

impl ReadError {
    fn new(line: impl Into<Option<usize>>, found: impl Into<String>, expected: impl Into<String>) -> Self {
        ReadError { line: line.into(), found: found.into(), expected: expected.into() }
    }
}

impl std::fmt::Display for ReadError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        write!(f, "{}; expected {}", self.found, self.expected)
    }
}

impl std::error::Error for ReadError {}

impl From<ReadError> for Vec<ReadError> {
    fn from(refusal: ReadError) -> Self {
        vec![refusal]
    }
}

impl PolygonMesh {
    /// Adds a phrase with a count, unless the count is 0.
    fn add_note(&mut self, verb: &str, count: usize, what: &str, rest: &str) {
        if count > 0 {
            self.notes.push(format!("{verb} {}{rest}", count_text(count, what)));
        }
    }
}

/// Returns `1 triangle` or `2 triangles`.
fn count_text(count: usize, what: &str) -> String {
    let plural = match (count, what) {
        (1, _) => what.to_string(),
        (_, "vertex") => "vertices".into(),
        (_, "weight or colour") => "weights or colours".into(),
        _ => format!("{what}s"),
    };
    format!("{count} {plural}")
}

/// Reads a closed surface.
///
/// The ending selects the kind: `.obj`; `.stl`, text or binary; `.vtk` and `.vtp`, legacy or XML, whichever the file
/// is. Points at the same position are one vertex; polygons are cut into triangles from their first corner. Vertices
/// are numbered in the order in which the polygons name them. Repairs are those of `repair`; all are listed in
/// [`RepairedSurface::repairs`].
///
/// Errors: a file that cannot be read, and every fault of the surface.
pub fn read_surface(path: &Path) -> Result<RepairedSurface, Faults> {
    let bytes = std::fs::read(path).map_err(|error| Fault::from_io(path, "read", &error))?;
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    let refused = |refusals: Vec<ReadError>| {
        let mut faults = Faults::default();
        for ReadError { line, found, expected } in refusals.iter().take(MAX_PRINTED_FAULTS) {
            faults.push(Fault::new(path, *line, "file", found, format!("expected {expected}")));
        }
        if refusals.len() > MAX_PRINTED_FAULTS {
            let more = format!("{} more faults", refusals.len() - MAX_PRINTED_FAULTS);
            faults.push(Fault::new(path, None, "file", more, format!("expected {}", refusals[0].expected)));
        }
        faults
    };
    let mesh = read_mesh(&bytes, &ending).map_err(refused)?;
    let (vertices, triangles, repairs) = repair::triangulate(mesh);
    match Surface::new(&vertices, &triangles) {
        Ok(surface) => {
            let same = surface.triangles().iter().zip(&triangles).filter(|(a, b)| a == b).count();
            // If all triangles are turned, the surface was coherent but inside out.
            let turned = (triangles.len() - same).min(same);
            Ok(RepairedSurface { surface, flipped: turned, repairs })
        }
        Err(found) => {
            let mut faults = Faults::default();
            for fault in found.0.iter().take(MAX_PRINTED_FAULTS) {
                let (found, expected) = fault.split_once("; ").unwrap_or((fault, "expected a closed surface"));
                faults.push(Fault::new(path, None, "surface", found, expected));
            }
            if found.0.len() > MAX_PRINTED_FAULTS {
                let more = format!("{} more faults", found.0.len() - MAX_PRINTED_FAULTS);
                faults.push(Fault::new(path, None, "surface", more, "expected a closed surface in one piece"));
            }
            Err(faults)
        }
    }
}

fn read_mesh(bytes: &[u8], ending: &str) -> Result<PolygonMesh, Vec<ReadError>> {
    let kind = match ending {
        "obj" => "a Wavefront OBJ file",
        "stl" => "an STL file, text or binary",
        "vtk" | "vtp" => "polygonal data of VTK, legacy or XML",
        _ => return Err(ReadError::new(None, format!("the ending '{ending}'"), ".obj, .stl, .vtk or .vtp").into()),
    };
    let refuse = |found: &str| Err(ReadError::new(None, found, kind).into());
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match bytes {
        [] => return refuse("it is empty"),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] if ending != "stl" => return refuse("text in UTF-16, not UTF-8 or ASCII"),
        [0x1f, 0x8b, ..] => return refuse("compressed by gzip; uncompress it first"),
        [b'P', b'K', 3, 4, ..] => return refuse("a zip archive; unpack it first"),
        _ => {}
    }
    match ending {
        "obj" => obj::read(&lines(&String::from_utf8_lossy(bytes))),
        "stl" => stl::read(bytes),
        _ if bytes.trim_ascii_start().starts_with(b"<") => vtp::read(bytes).map_err(Into::into),
        _ => legacy::read(bytes).map_err(Into::into),
    }
}

/// A text with line feeds at the ends of its lines, as old programs write carriage returns alone.
fn lines(text: &str) -> Cow<'_, str> {
    if text.contains('\n') { Cow::Borrowed(text) } else { Cow::Owned(text.replace('\r', "\n")) }
}

/// Reads a real number of a text file; Fortran's `1.0D+00` too.
fn parse_real(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| word.replace(['d', 'D'], "e").parse().ok())
}

/// Reads a coordinate. Errors: the reason why it is not a number.
fn coordinate(word: &str) -> Result<f64, String> {
    match parse_real(word) {
        None => Err(format!("'{word}', which is no number")),
        Some(x) if !x.is_finite() => Err(format!("'{word}', which is not finite")),
        Some(x) => Ok(x),
    }
}

/// Type of the numbers in a binary array of VTK, by its name in legacy or XML files.
#[derive(Debug, Clone, Copy, PartialEq)]
enum NumberType {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl NumberType {
    fn from_name(name: &str) -> Option<NumberType> {
        Some(match name.to_ascii_lowercase().as_str() {
            "char" | "int8" => NumberType::Signed(1),
            "unsigned_char" | "uint8" => NumberType::Unsigned(1),
            "short" | "int16" => NumberType::Signed(2),
            "unsigned_short" | "uint16" => NumberType::Unsigned(2),
            "int" | "int32" | "vtkidtype" | "vtktypeint32" => NumberType::Signed(4),
            "unsigned_int" | "uint32" | "vtktypeuint32" => NumberType::Unsigned(4),
            "long" | "int64" | "vtktypeint64" => NumberType::Signed(8),
            "unsigned_long" | "uint64" | "vtktypeuint64" => NumberType::Unsigned(8),
            "float" | "float32" => NumberType::Float,
            "double" | "float64" => NumberType::Double,
            _ => return None,
        })
    }

    /// Bytes of one number.
    fn byte_size(self) -> usize {
        match self {
            NumberType::Signed(size) | NumberType::Unsigned(size) => size,
            NumberType::Float => 4,
            NumberType::Double => 8,
        }
    }

    /// Numbers in `bytes`; a remainder at the end is ignored.
    fn decode_all(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        let of_one = |chunk: &[u8]| {
            let mut word = [0; 8];
            for (k, byte) in chunk.iter().enumerate() {
                word[if big_endian { chunk.len() - 1 - k } else { k }] = *byte;
            }
            let bits = u64::from_le_bytes(word);
            match self {
                NumberType::Unsigned(_) => bits as f64,
                NumberType::Signed(size) => {
                    let unused = 64 - 8 * size as u32;
                    (((bits << unused) as i64) >> unused) as f64
                }
                NumberType::Float => f64::from(f32::from_bits(bits as u32)),
                NumberType::Double => f64::from_bits(bits),
            }
        };
        bytes.chunks_exact(self.byte_size()).map(of_one).collect()
    }
}

/// One piece of polygonal data of VTK.
#[derive(Debug, Default)]
struct PolyDataPiece {
    coordinates: Vec<f64>,
    polygons: CellLists,
    strips: CellLists,
    /// Number of points and lines that are cells of their own.
    ignored: usize,
}

/// Corners of cells, one after the other, and where each cell ends.
#[derive(Debug, Default)]
struct CellLists {
    corners: Vec<f64>,
    ends: Vec<f64>,
}

impl CellLists {
    /// Converts the lists of legacy files before version 5: for each cell a count, then that number of corners.
    fn from_counted(numbers: &[f64], count: usize) -> Result<CellLists, String> {
        let mut cells = CellLists::default();
        let mut rest = numbers;
        for k in 1..=count {
            let Some((&corners, behind)) = rest.split_first() else {
                return Err(format!("lists of corners that end at cell {k} of {count}"));
            };
            let fits = corners >= 0.0 && corners <= behind.len() as f64;
            if !fits {
                return Err(format!(
                    "cell {k} of {count} with {corners} corners where {} numbers follow",
                    behind.len()
                ));
            }
            let (own, behind) = behind.split_at(corners as usize);
            cells.corners.extend(own);
            cells.ends.push(cells.corners.len() as f64);
            rest = behind;
        }
        Ok(cells)
    }

    /// Corners of each cell; `points` is the number of points.
    fn corner_lists(&self, points: usize) -> Result<Vec<Vec<usize>>, String> {
        let (mut lists, mut begin) = (Vec::new(), 0);
        // Lists of legacy files from version 5 on begin with the start of the first cell, 0.
        let ends = self.ends.strip_prefix(&[0.0]).unwrap_or(&self.ends);
        for (k, &end) in (1..).zip(ends) {
            if !(end >= begin as f64 && end <= self.corners.len() as f64) {
                return Err(format!("cell {k} ends at corner {end} of {}", self.corners.len()));
            }
            let corners = &self.corners[begin..end as usize];
            if let Some(wrong) = corners.iter().find(|&&corner| !(corner >= 0.0 && corner < points as f64)) {
                return Err(format!("cell {k} names point {wrong}, where points are 0 to {}", points as f64 - 1.0));
            }
            lists.push(corners.iter().map(|&corner| corner as usize).collect());
            begin = end as usize;
        }
        if begin < self.corners.len() {
            return Err(format!("{} corners, of which the cells use {begin}", self.corners.len()));
        }
        Ok(lists)
    }
}

impl PolyDataPiece {
    /// Appends the piece to a mesh. Errors: lists that do not fit together.
    fn add_to(&self, mesh: &mut PolygonMesh) -> Result<(), String> {
        if !self.coordinates.len().is_multiple_of(3) {
            return Err(format!("{} coordinates, which are no multiple of 3", self.coordinates.len()));
        }
        let (first, points) = (mesh.points.len(), self.coordinates.len() / 3);
        mesh.points.extend(self.coordinates.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        let moved = |list: Vec<usize>| -> Vec<usize> { list.into_iter().map(|k| first + k).collect() };
        mesh.polygons.extend(self.polygons.corner_lists(points)?.into_iter().map(moved));
        for strip in self.strips.corner_lists(points)?.into_iter().map(moved) {
            // Every other triangle runs against the strip.
            let turned = |(k, t): (usize, &[usize])| if k % 2 == 0 { t.to_vec() } else { vec![t[1], t[0], t[2]] };
            mesh.polygons.extend(strip.windows(3).enumerate().map(turned));
        }
        mesh.add_note("ignored", self.ignored, "line or point element", "");
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binary_numbers_of_all_kinds() {
        let of = |name: &str, bytes: &[u8]| NumberType::from_name(name).unwrap().decode_all(bytes, true);
        assert_eq!(of("char", &[0xff, 2]), [-1.0, 2.0]);
        assert_eq!(of("UInt8", &[0xff]), [255.0]);
        assert_eq!(of("short", &[0xff, 0xfe]), [-2.0]);
        assert_eq!(of("vtktypeint64", &[0, 0, 0, 0, 0, 0, 1, 2]), [258.0]);
        assert_eq!(of("float", &1.5f32.to_be_bytes()), [1.5]);
        assert_eq!(NumberType::from_name("Float64").unwrap().decode_all(&(-2.5f64).to_le_bytes(), false), [-2.5]);
        assert_eq!(NumberType::from_name("bit"), None);
    }
}
