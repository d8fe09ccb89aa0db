//! Closed surfaces from OBJ, STL and VTK files, repaired where that is safe, and checked.
//!
//! | module | |
//! |---|---|
//! | `stl` | STL, text and binary |
//! | `legacy` | VTK legacy polygonal data |
//! | `vtp` | VTK XML polygonal data, also with zlib blocks |
//! | `vtk` | numbers and cells of both |
//! | `junctions` | split of triangles at vertices on their edges |
//! | `repair` | from polygons over points to a triangulation: weld, drop, flip |

mod junctions;
mod legacy;
mod repair;
mod stl;
mod vtk;
mod vtp;

use std::path::Path;

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults, RecordFault};
use cd_formats::mesh::{MAX_READ_ERRORS, PolygonMesh, ReadError, lines};
use cd_formats::obj;
use cd_formats::report::FaultReport;
use cd_formats::surface::{Surface, SurfaceFaults};

use repair::Triangulation;

/// Number of faults of one file that are printed one by one; a broken surface has thousands of the same kind.
const MAX_PRINTED_FAULTS: usize = 5;

/// A surface from a file, and the repairs that were needed to read it.
#[derive(Debug, Clone, PartialEq)]
pub struct RepairedSurface {
    pub surface: Surface,
    /// Number of triangles that were turned to point outward with the others.
    pub flipped: usize,
    /// Parts that were ignored, dropped or welded, each in a phrase such as `dropped 1 degenerate triangle`.
    pub repairs: Vec<String>,
}

/// Triangles of a file, and the repairs that were needed to read it.
pub struct FileTriangles {
    pub vertices: Vec<[f64; 3]>,
    /// Triangles by the numbers of their vertices, from 0, as they are oriented in the file.
    pub triangles: Vec<[u32; 3]>,
    /// Parts that were ignored, dropped or welded, as in [`RepairedSurface::repairs`].
    pub repairs: Vec<String>,
}

/// Reads the triangles of a surface that may be open; kinds of files and repairs as in [`read_surface`].
///
/// Errors: a file that cannot be read, and points that are not finite.
pub fn read_triangles(path: &Path) -> Result<FileTriangles, Faults> {
    let bytes = atomic::read_bytes(path)?;
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_ascii_lowercase();
    let mesh = read_mesh(&bytes, &ending).map_err(|errors| read_faults(path, &errors))?;
    if let Some(RecordFault { found, expected, .. }) = repair::point_fault(&mesh) {
        return Err(Fault::new(path, None, "surface", found, expected).into());
    }
    let Triangulation { vertices, triangles, repairs } = repair::triangulate(mesh);
    Ok(FileTriangles { vertices, triangles, repairs })
}

/// Reads a closed surface.
///
/// The ending selects the kind: `.obj`; `.stl`, text or binary; `.vtk` and `.vtp`, legacy or XML, whichever the file
/// is. Points at the same position are one vertex; polygons are cut into triangles from their first corner. Vertices
/// are numbered in the order in which the polygons name them. `repair` makes the repairs; all are listed in
/// [`RepairedSurface::repairs`].
///
/// Errors: a file that cannot be read, and every fault of the surface.
pub fn read_surface(path: &Path) -> Result<RepairedSurface, Faults> {
    let FileTriangles { vertices, triangles, repairs } = read_triangles(path)?;
    let surface = Surface::new(&vertices, &triangles).map_err(|faults| surface_faults(path, &faults))?;
    let unchanged = surface.triangles().iter().zip(&triangles).filter(|(a, b)| a == b).count();
    // If all triangles are turned, the surface was coherent but inside out.
    let flipped = (triangles.len() - unchanged).min(unchanged);
    Ok(RepairedSurface { surface, flipped, repairs })
}

/// Faults of a file that is rejected: the first few, and the count of the others.
fn read_faults(path: &Path, errors: &[ReadError]) -> Faults {
    let mut faults = Faults::default();
    for ReadError { line, found, expected } in errors.iter().take(MAX_PRINTED_FAULTS) {
        faults.push(Fault::new(path, *line, "file", found, format!("expected {expected}")));
    }
    if errors.len() > MAX_PRINTED_FAULTS {
        let bound = if errors.len() > MAX_READ_ERRORS { "at least " } else { "" };
        let others = format!("{bound}{} more faults", errors.len() - MAX_PRINTED_FAULTS);
        faults.push(Fault::new(path, None, "file", others, format!("expected {}", errors[0].expected)));
    }
    faults
}

/// Faults of the surface of a file: the first few, and the count of the others.
fn surface_faults(path: &Path, found: &SurfaceFaults) -> Faults {
    let mut faults = Faults::default();
    for fault in found.0.iter().take(MAX_PRINTED_FAULTS) {
        faults.push(fault.file_fault(path));
    }
    if found.0.len() > MAX_PRINTED_FAULTS {
        let others = format!("{} more faults", found.0.len() - MAX_PRINTED_FAULTS);
        faults.push(Fault::new(path, None, "surface", others, "expected a closed surface in one piece"));
    }
    faults
}

/// Reads the polygons of a file with this ending. Errors: reasons why it is rejected, at least one.
fn read_mesh(bytes: &[u8], ending: &str) -> Result<PolygonMesh, Vec<ReadError>> {
    let kind = match ending {
        "obj" => "a Wavefront OBJ file",
        "stl" => "an STL file, text or binary",
        "vtk" | "vtp" => "polygonal data of VTK, legacy or XML",
        _ => return Err(ReadError::new(None, format!("the ending '{ending}'"), ".obj, .stl, .vtk or .vtp").into()),
    };
    let read_error = |found: &str| Err(ReadError::new(None, found, kind).into());
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match bytes {
        [] => return read_error("it is empty"),
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] if ending != "stl" => {
            return read_error("text in UTF-16, not UTF-8 or ASCII");
        }
        [0x1f, 0x8b, ..] => return read_error("compressed by gzip; uncompress it first"),
        [b'P', b'K', 3, 4, ..] => return read_error("a zip archive; unpack it first"),
        _ => {}
    }
    match ending {
        "obj" => obj::read(&lines(&String::from_utf8_lossy(bytes))),
        "stl" => stl::read(bytes),
        _ if bytes.trim_ascii_start().starts_with(b"<") => vtp::read(bytes).map_err(Into::into),
        _ => legacy::read(bytes).map_err(Into::into),
    }
}

/// Adds the faults of a file to the report. If the file cannot be read, the fault belongs to the value at `path` that
/// names it.
pub fn report_file_faults(faults: Faults, path: &str, report: &mut FaultReport) {
    for fault in faults.0 {
        if fault.line.is_none() && fault.object == "file" && fault.found.starts_with("cannot be read") {
            let found = format!("{} {}", fault.file.display(), fault.found);
            report.add_fault(path, found, "a file next to the scene, or an absolute path");
        } else {
            report.faults.push(fault);
        }
    }
}
