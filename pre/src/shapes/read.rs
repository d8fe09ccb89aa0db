//! Surfaces from files: OBJ by tobj, STL by stl_io, VTK by vtkio; all are checked.

use std::io::Cursor;
use std::panic::catch_unwind;
use std::path::Path;

use cd_formats::error::{Fault, Faults};
use cd_formats::surface::Surface;
use rustc_hash::FxHashMap;
use vtkio::model::{DataSet, Piece, PolyDataPiece, VertexNumbers, Vtk};

/// So many faults of one surface are told one by one.
const TOLD: usize = 50;

/// A surface as its file has it, and how many of its triangles had to be turned to point outward with the others.
#[derive(Debug, Clone, PartialEq)]
pub struct Read {
    pub surface: Surface,
    pub turned: usize,
}

/// Polygons over points: what all the kinds of files come to.
#[derive(Debug, Default)]
struct Mesh {
    points: Vec<[f64; 3]>,
    polygons: Vec<Vec<usize>>,
}

/// Reads a closed surface.
///
/// The kind is told by the ending: `.obj`; `.stl`, as text or binary; `.vtk`, legacy polygonal data, and `.vtp`, its XML
/// form, both as text or binary but not appended or compressed. Points at the same place are one vertex; polygons are
/// cut into triangles from their first corner. Vertices count in the order in which the polygons name them.
///
/// Errors: a file that cannot be read, and every fault of the surface.
pub fn surface(path: &Path) -> Result<Read, Faults> {
    let refuse =
        |object: &str, found: String, expected: &str| Faults::from(Fault::new(path, None, object, found, expected));
    let bytes = std::fs::read(path).map_err(|error| Fault::io(path, "read", &error))?;
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    let (mesh, kind) = match ending.as_str() {
        "obj" => (obj(&bytes), "a Wavefront OBJ file"),
        "stl" => (stl(&bytes), "an STL file, as text or binary"),
        "vtk" | "vtp" => {
            (vtk(&bytes, ending == "vtp"), "polygonal data of VTK, as text or binary, not appended or compressed")
        }
        _ => return Err(refuse("file", format!("the ending '{ending}'"), "expected .obj, .stl, .vtk or .vtp")),
    };
    let mesh = mesh.map_err(|found| {
        let line = match ending.as_str() {
            "obj" => line_of_obj(&bytes, &found),
            "stl" => line_of_facet(&bytes, &found),
            _ => None,
        };
        Fault::new(path, line, "file", found, format!("expected {kind}"))
    })?;
    let (vertices, triangles) =
        welded(&mesh).map_err(|found| refuse("surface", found, "expected numbers of points that are there"))?;
    match Surface::new(&vertices, &triangles) {
        Ok(surface) => {
            let same = surface.triangles().iter().zip(&triangles).filter(|(a, b)| a == b).count();
            // All of them turned is a surface that was inside out, and coherent.
            let turned = (triangles.len() - same).min(same);
            Ok(Read { surface, turned })
        }
        Err(found) => {
            let mut faults = Faults::default();
            for fault in found.iter().take(TOLD) {
                let (found, expected) = fault.split_once("; ").unwrap_or((fault, "expected a closed surface"));
                faults.push(Fault::new(path, None, "surface", found, expected));
            }
            if found.len() > TOLD {
                let more = format!("{} more faults", found.len() - TOLD);
                faults.push(Fault::new(path, None, "surface", more, "expected a closed surface"));
            }
            Err(faults)
        }
    }
}

/// Vertices at different places, and triangles of their numbers.
type Triangulation = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn welded(mesh: &Mesh) -> Result<Triangulation, String> {
    let mut vertices = Vec::new();
    let mut numbers: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    let mut triangles = Vec::new();
    for (k, polygon) in mesh.polygons.iter().enumerate() {
        let mut corners = Vec::with_capacity(polygon.len());
        for &point in polygon {
            let Some(point) = mesh.points.get(point) else {
                return Err(format!("polygon {} names point {} of {}", k + 1, point + 1, mesh.points.len()));
            };
            let point = point.map(|x| x + 0.0); // one zero
            let number = *numbers.entry(point.map(f64::to_bits)).or_insert(vertices.len() as u32);
            if number as usize == vertices.len() {
                vertices.push(point);
            }
            corners.push(number);
        }
        if corners.len() < 3 {
            return Err(format!("polygon {} has {} corners", k + 1, corners.len()));
        }
        triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    }
    Ok((vertices, triangles))
}

/// The lines without comments, and each with those in which it goes on: the reader knows neither behind a polygon.
fn statements(text: &str) -> String {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim_end());
    lines.map(|line| line.strip_suffix('\\').map_or_else(|| format!("{line}\n"), |begin| format!("{begin} "))).collect()
}

/// The number of parts of a file with which its reader begins to fail as with all of them: the readers tell no lines.
fn first_failing(parts: usize, whole: &str, read: impl Fn(usize) -> Result<Mesh, String>) -> Option<usize> {
    let numbers: Vec<usize> = (1..=parts).collect();
    let reads = |k: &usize| read(*k).err().as_deref() != Some(whole);
    numbers.get(numbers.partition_point(reads)).copied()
}

fn line_of_obj(bytes: &[u8], fault: &str) -> Option<usize> {
    let mut ends: Vec<usize> = (1..).zip(bytes).filter(|(_, byte)| **byte == b'\n').map(|(end, _)| end).collect();
    ends.push(bytes.len());
    first_failing(ends.len(), fault, |k| obj(&bytes[..ends[k - 1]]))
}

/// The line in which the facet begins that is no facet.
fn line_of_facet(bytes: &[u8], fault: &str) -> Option<usize> {
    let text = String::from_utf8_lossy(bytes).to_ascii_lowercase();
    let ends: Vec<usize> = text.match_indices("endfacet").map(|(at, word)| at + word.len()).collect();
    let facet = first_failing(ends.len(), fault, |k| stl(format!("{}\nendsolid\n", &text[..ends[k - 1]]).as_bytes()))?;
    let before = if facet == 1 { 0 } else { ends[facet - 2] };
    let begin = before + text[before..].find("facet")?;
    Some(1 + text[..begin].matches('\n').count())
}

fn obj(bytes: &[u8]) -> Result<Mesh, String> {
    let text = statements(&String::from_utf8_lossy(bytes));
    let options = tobj::LoadOptions::default();
    let no_material = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) =
        tobj::load_obj_buf(&mut Cursor::new(text), &options, no_material).map_err(|error| error.to_string())?;
    let mut mesh = Mesh::default();
    for tobj::Model { mesh: part, .. } in models {
        let first = mesh.points.len();
        mesh.points.extend(part.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        let mut corners = part.indices.iter().map(|&k| first + k as usize);
        if part.face_arities.is_empty() {
            mesh.polygons.extend(part.indices.chunks(3).map(|t| t.iter().map(|&k| first + k as usize).collect()));
        }
        for arity in part.face_arities {
            mesh.polygons.push(corners.by_ref().take(arity as usize).collect());
        }
    }
    Ok(mesh)
}

/// What a text that should be an STL file holds beside one solid: the reader passes over it.
fn beside_one_solid(text: &str) -> Option<&'static str> {
    let (_, after) = text.split_once("endsolid")?;
    let after = after.split_once('\n').map_or("", |(_, after)| after).trim();
    (!after.is_empty()).then_some("more than one solid")
}

fn stl(bytes: &[u8]) -> Result<Mesh, String> {
    let announced =
        bytes.get(80..84).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize);
    let binary = announced.is_some_and(|count| bytes.len() == 84 + 50 * count);
    let mut bytes = bytes.to_vec();
    if !binary {
        // The reader knows words in small letters alone, and a solid that has a name.
        let text = String::from_utf8_lossy(&bytes).to_ascii_lowercase().replacen("solid", "solid ", 1);
        match announced {
            Some(count) if !text.starts_with("solid") => {
                return Err(format!("{} bytes with {count} triangles", bytes.len()));
            }
            _ => beside_one_solid(&text).map_or(Ok(()), |found| Err(found.to_string()))?,
        }
        bytes = text.into_bytes();
    }
    let read = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|error| error.to_string())?;
    Ok(Mesh {
        points: read.vertices.iter().map(|v| v.0.map(f64::from)).collect(),
        polygons: read.faces.iter().map(|face| face.vertices.to_vec()).collect(),
    })
}

fn vtk(bytes: &[u8], xml: bool) -> Result<Mesh, String> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]).into_owned();
    for (word, what) in [("format=\"appended\"", "appended data"), ("compressor=", "compressed data")] {
        if xml && head.contains(word) {
            return Err(what.to_string());
        }
    }
    // vtkio takes some things that it does not expect for impossible.
    let parsed =
        catch_unwind(
            || if xml { Vtk::parse_xml(Cursor::new(bytes)) } else { Vtk::parse_legacy_be(Cursor::new(bytes)) },
        );
    let parsed = parsed.map_err(|_| "what cannot be read".to_string())?.map_err(|error| error.to_string())?;
    let DataSet::PolyData { pieces, .. } = parsed.data else { return Err("another kind of data".to_string()) };
    let mut mesh = Mesh::default();
    for piece in pieces {
        let Piece::Inline(piece) = piece else { return Err("pieces in other files".to_string()) };
        take_piece(&mut mesh, *piece)?;
    }
    Ok(mesh)
}

fn take_piece(mesh: &mut Mesh, piece: PolyDataPiece) -> Result<(), String> {
    let first = mesh.points.len();
    let numbers: Vec<f64> = piece.points.cast_into().ok_or("points that are no numbers")?;
    if !numbers.len().is_multiple_of(3) {
        return Err(format!("{} coordinates", numbers.len()));
    }
    mesh.points.extend(numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
    for polygon in cells(piece.polys)? {
        mesh.polygons.push(polygon.into_iter().map(|k| first + k).collect());
    }
    for strip in cells(piece.strips)? {
        let strip: Vec<usize> = strip.into_iter().map(|k| first + k).collect();
        // Every other triangle runs against the strip.
        mesh.polygons.extend(
            strip.windows(3).enumerate().map(
                |(k, t)| {
                    if k % 2 == 0 { vec![t[0], t[1], t[2]] } else { vec![t[1], t[0], t[2]] }
                },
            ),
        );
    }
    if mesh.polygons.is_empty() {
        return Err("no polygons".to_string());
    }
    Ok(())
}

/// The corners of each cell.
fn cells(numbers: Option<VertexNumbers>) -> Result<Vec<Vec<usize>>, String> {
    let wrong = || "lists of corners that do not add up".to_string();
    let mut found = Vec::new();
    match numbers {
        None => {}
        Some(VertexNumbers::XML { connectivity, offsets }) => {
            let mut begin = 0;
            // Legacy files from version 5 on begin with that of the first cell, 0.
            for &end in offsets.strip_prefix(&[0]).unwrap_or(&offsets) {
                let corners = connectivity.get(begin..end as usize).ok_or_else(wrong)?;
                found.push(corners.iter().map(|&k| k as usize).collect());
                begin = end as usize;
            }
        }
        Some(VertexNumbers::Legacy { num_cells, vertices }) => {
            let mut rest = vertices.as_slice();
            for _ in 0..num_cells {
                let (&count, behind) = rest.split_first().ok_or_else(wrong)?;
                let (corners, behind) = behind.split_at_checked(count as usize).ok_or_else(wrong)?;
                found.push(corners.iter().map(|&k| k as usize).collect());
                rest = behind;
            }
        }
    }
    Ok(found)
}
