//! `DATBOX/BODIES.DAT`: rigid bodies with their contactors. cd-pre and LMGC90 write it, cd-solve reads it.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use crate::error::{Fault, Faults};
use crate::foreign::foreign_bodies;
use crate::geometry::faces::FLATNESS_OF_FILES;
use crate::geometry::surface::{CleanedSurface, with_joined_vertices, without_unused_vertices};
use crate::geometry::wall_mesh::{MeshSides, WallMesh};
use crate::names::number_text;
use crate::scan::parts::{put_records, read_records};
use crate::scan::{
    AcceptedDeviation, AsciiText, GRID_COLUMNS, LineScanner, RealText, TextLine, format_e14, format_long14, put_grid,
    put_text,
};
use crate::words::CONTACTOR_TYPES;

/// Bodies in the order of the file, which gives their numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bodies(pub Vec<Body>);

/// Rigid body, a record of BODIES.DAT.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Line of `$bdyty`, 1-based; 0 for a body that is not from a file.
    pub line: usize,
    /// Name of a material of BULK_BEHAV.DAT, trimmed.
    pub material: String,
    /// `avrd`: radius of the sphere of equal volume, m; 0 selects the contactor's own volume.
    pub equivalent_radius: f64,
    /// `I1 I2 I3`: principal inertia at density 1, m^5.
    pub inertia: Option<[f64; 3]>,
    /// `coo1..3`: centre of mass in the reference configuration, m.
    pub position: [f64; 3],
    pub contactors: Vec<Contactor>,
}

/// Contactor of a body: its shape and colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Contactor {
    pub colour: String,
    pub shape: ShapeRecord,
    /// First, second, third axis and offset of the contactor in the body's frame, where given. Few contactors have it, and
    /// a file may have millions.
    pub local_frame: Option<Box<LocalFrame>>,
}

/// Axes and offset (m) of a contactor in the frame of its body.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalFrame {
    pub axes: [[f64; 3]; 3],
    pub offset: [f64; 3],
}

/// Shapes in the body's principal frame; lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub enum ShapeRecord {
    /// SPHER: a sphere at the body's centre.
    Sphere { radius: f64 },
    /// SPHEb: a sphere off the body's centre.
    OffsetSphere { radius: f64, offset: [f64; 3] },
    /// PLANx: a rectangular plate, its contact faces at +-axe3 along the third axis.
    Plane { half_lengths: [f64; 3] },
    /// CYLND, and DNLYC with contact on the inside; axis along the third axis.
    Cylinder { half_height: f64, radius: f64, hollow: bool },
    /// CAPSx: the points up to `radius` from a segment of half length `half_length` along the third axis.
    Capsule { half_length: f64, radius: f64 },
    /// POLYR: closed triangulated surface; triangles contain 0-based vertex numbers.
    Polyhedron { vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]> },
    /// PT3Dx: a point.
    Point { offset: [f64; 3] },
    /// MESHx: a triangulated surface in an OBJ file of its own, in the frame of its body. `radius`: that of a ball about the
    /// body that contains it. `surface`: content of the file, once [`Bodies::read_meshes`] has read it.
    Mesh { radius: f64, sides: MeshSides, file: Box<str>, surface: Option<Arc<WallMesh>> },
}

impl ShapeRecord {
    /// Five-character name in the files.
    pub fn type_name(&self) -> &'static str {
        match self {
            ShapeRecord::Sphere { .. } => "SPHER",
            ShapeRecord::OffsetSphere { .. } => "SPHEb",
            ShapeRecord::Plane { .. } => "PLANx",
            ShapeRecord::Cylinder { hollow: false, .. } => "CYLND",
            ShapeRecord::Cylinder { hollow: true, .. } => "DNLYC",
            ShapeRecord::Capsule { .. } => "CAPSx",
            ShapeRecord::Polyhedron { .. } => "POLYR",
            ShapeRecord::Point { .. } => "PT3Dx",
            ShapeRecord::Mesh { .. } => "MESHx",
        }
    }

    /// Name in rows of TACT_BEHAV.DAT: SPHER also for SPHEb, whose own name LMGC90 ignores there.
    ///
    /// ```
    /// use cd_formats::bodies::ShapeRecord;
    /// let shape = ShapeRecord::OffsetSphere { radius: 1.0, offset: [2.0, 0.0, 0.0] };
    /// assert_eq!([shape.type_name(), shape.row_name()], ["SPHEb", "SPHER"]);
    /// ```
    pub fn row_name(&self) -> &'static str {
        match self {
            ShapeRecord::OffsetSphere { .. } => "SPHER",
            other => other.type_name(),
        }
    }

    /// Whether a point in the shape's own frame, m, is outside of a hollow cylinder, which has closed ends and pushes
    /// inwards only; false for other shapes.
    ///
    /// ```
    /// use cd_formats::bodies::ShapeRecord;
    /// let drum = ShapeRecord::Cylinder { half_height: 1.0, radius: 0.5, hollow: true };
    /// assert_eq!([[0.0, 0.4, -0.9], [0.4, 0.4, 0.0], [0.0, 0.0, 1.1]].map(|point| drum.is_outside_hollow(point)), [false, true, true]);
    /// ```
    pub fn is_outside_hollow(&self, [x, y, z]: [f64; 3]) -> bool {
        let ShapeRecord::Cylinder { half_height, radius, hollow: true } = self else { return false };
        z.abs() > *half_height || libm::hypot(x, y) > *radius
    }
}

/// Label of the name of the file of a surface MESHx.
const MESH_FILE_LABEL: &str = "file=";

/// Name of the file of a surface MESHx by its index.
fn mesh_file_name(index: usize) -> String {
    format!("MESHx-{}.obj", index + 1)
}

const COORDINATE_LABELS: [&str; 3] = ["coo1", "coo2", "coo3"];
/// Largest relative difference of a sphere's `avrd` and `byrd` that counts as rounding of the file.
const RADIUS_ROUNDING: f64 = 1e-5;

impl Bodies {
    /// Reads the file, and those of its surfaces MESHx in the same folder; reports all faults at once.
    ///
    /// Stricter than LMGC90: lengths must be positive, a lone sphere's `avrd` must equal its radius, and a polyhedron must
    /// have the announced number of lines. Bodies are counted by position, whatever their number, as in LMGC90.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        let mut bodies = Self::parse(path, &AsciiText::read_file(path)?)?;
        bodies.read_meshes(path)?;
        Ok(bodies)
    }

    /// Reads the surfaces of contactors MESHx from the folder of the file `path`, from which the bodies are; each file once.
    ///
    /// Errors: the faults of the surfaces, and those that reach beyond the radius of their contactor.
    pub fn read_meshes(&mut self, path: &Path) -> Result<(), Faults> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut faults = Faults::default();
        let mut surfaces: HashMap<(Box<str>, MeshSides), Option<Arc<WallMesh>>> = HashMap::new();
        for (number, body) in (1..).zip(&mut self.0) {
            for contactor in &mut body.contactors {
                let ShapeRecord::Mesh { radius, sides, file, surface } = &mut contactor.shape else { continue };
                let read = || faults.gather_result(WallMesh::read(&folder.join(&**file), *sides)).map(Arc::new);
                *surface = surfaces.entry((file.clone(), *sides)).or_insert_with(read).clone();
                let reach = surface.as_ref().map_or(0.0, |surface| surface.radius());
                if reach > *radius * (1.0 + RADIUS_ROUNDING) {
                    let found = format!("vertices of {file} up to {} m from the body", number_text(reach));
                    let expected = format!("expected byrd, {}, to be at least that", number_text(*radius));
                    faults.push(Fault::new(path, Some(body.line), format!("body {number}"), found, expected));
                }
            }
        }
        faults.into_result(())
    }

    /// Reads the text of a file; `path` is for messages. Errors: all faults of the text.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        Ok(Self::parse_with_notices(path, text)?.0)
    }

    /// Reads the text of a file like [`Bodies::parse`]; also returns notices about deviations from its form. Errors: a body
    /// of 2D or deformable kind, then nothing else; otherwise all faults of the text.
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        match foreign_bodies(path, text) {
            Some(fault) => Err(fault.into()),
            None => Self::parse_rigid_with_notices(path, text),
        }
    }

    /// Reads like [`Bodies::parse_with_notices`] a text in which [`foreign_bodies`] finds none.
    pub fn parse_rigid_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        let (parts, notices) = read_records(path, text, "bdyty", read_bodies)?;
        let mut bodies = Vec::with_capacity(parts.iter().map(Vec::len).sum());
        parts.into_iter().for_each(|part_bodies| bodies.extend(part_bodies));
        Ok((Bodies(bodies), notices))
    }

    /// Names the files of the surfaces MESHx in the order of the bodies, `MESHx-1.obj` and so on, equal surfaces alike, and
    /// returns the names and texts of the files.
    pub fn name_mesh_files(&mut self) -> Vec<(String, String)> {
        let mut known: Vec<Arc<WallMesh>> = Vec::new();
        for contactor in self.0.iter_mut().flat_map(|body| &mut body.contactors) {
            let ShapeRecord::Mesh { file, surface: Some(surface), .. } = &mut contactor.shape else { continue };
            let position = known.iter().position(|other| other == surface).unwrap_or_else(|| {
                known.push(surface.clone());
                known.len() - 1
            });
            *file = mesh_file_name(position).into();
        }
        known.iter().enumerate().map(|(k, surface)| (mesh_file_name(k), surface.to_text())).collect()
    }

    /// Names and texts of the files of the surfaces MESHx that have been read, each name once.
    pub fn mesh_files(&self) -> BTreeMap<&str, String> {
        let contactors = self.0.iter().flat_map(|body| &body.contactors);
        let file = contactors.filter_map(|contactor| match &contactor.shape {
            ShapeRecord::Mesh { file, surface: Some(surface), .. } => Some((&**file, surface.to_text())),
            _ => None,
        });
        file.collect()
    }

    /// Names of the files of surfaces MESHx in the file `path`; none if it cannot be read.
    pub fn mesh_names(path: &Path) -> Vec<String> {
        let Ok(text) = AsciiText::read_file(path) else { return Vec::new() };
        let names = text.lines().filter(|line| line.is_continuation() && line.first_label() == MESH_FILE_LABEL);
        let names = names.map(|line| line.columns(35, 90).trim().to_string());
        names.filter(|name| !name.contains(['/', '\\'])).collect()
    }

    /// Position, from 1, of the first body in the file `path` that has this number there; `None` if no body has it, or the
    /// file cannot be read.
    pub fn position_of_number(path: &Path, number: usize) -> Option<usize> {
        let text = AsciiText::read_file(path).ok()?;
        let numbers =
            text.lines().filter(|line| line.keyword() == "RBDY3").map(|line| line.columns(7, 15).trim().parse());
        Some(numbers.into_iter().position(|found| found == Ok(number))? + 1)
    }

    /// Line of the material of a body of the file `path`; the line of the body if the material cannot be found.
    pub fn line_of_material(path: &Path, body: &Body) -> usize {
        let Ok(text) = AsciiText::read_file(path) else { return body.line };
        let line = text.lines().skip(body.line).find(|line| line.keyword() == "PLAIN").map(|line| line.number);
        line.unwrap_or(body.line)
    }

    /// Text of the file, numbers with eight digits. Bodies with a polyhedron have up to twelve, see [`format_long14`],
    /// since neighbours in a broken solid share faces.
    ///
    /// Names must have at most five characters, numbers be finite and below 1e100.
    pub fn to_text(&self) -> String {
        self.text_with(format_e14)
    }

    /// Text of the file with as many digits as the columns can hold, see [`format_long14`].
    pub fn to_long_text(&self) -> String {
        self.text_with(format_long14)
    }

    fn text_with(&self, real: fn(f64) -> RealText) -> String {
        let mut out = String::new();
        put_records(&mut out, &self.0, |out, k, body| write_body(out, k + 1, body, real));
        out
    }
}

/// Reads bodies up to the end of the text, before which there are `bodies_before` bodies.
fn read_bodies(scan: &mut LineScanner, bodies_before: usize) -> Vec<Body> {
    let mut bodies = Vec::new();
    // Position of the present body in the file, from 1.
    let mut position = bodies_before;
    loop {
        scan.skip_to_keyword("bdyty");
        let Some(begin) = scan.peek_line() else { break };
        position += usize::from(begin.keyword() == "bdyty");
        if position == 0 {
            scan.set_object("file");
        } else {
            scan.set_object(format_args!("body {position}"));
        }
        let body = scan.expect_keyword("bdyty").and_then(|_| read_body(scan, begin.number, position as u64));
        if body.is_none() {
            scan.skip_record();
        }
        bodies.extend(body);
    }
    if position == 0 && !scan.has_faults() {
        scan.add_file_fault("no body", "expected a $bdyty for each");
    }
    bodies
}

/// Reads the record after `$bdyty` on the line `begin`; `None` after a fault that leaves the scan inside the record.
/// `position`: number of the body in the file, from 1.
fn read_body(scan: &mut LineScanner, begin: usize, position: u64) -> Option<Body> {
    let line = scan.expect_line("expected RBDY3 and the number of the body", TextLine::is_data)?;
    if !scan.expect_rigid_body(line, 2) {
        return None;
    }
    // LMGC90 ignores the number, and writes stars for bodies above 99 999.
    match line.columns(7, 15).replace(' ', "").parse::<u64>() {
        Ok(number) if number == position => {}
        Ok(_) => scan.add_form(AcceptedDeviation::BodyNumber, line.number),
        Err(_) => scan.add_form(AcceptedDeviation::BodyWithoutNumber, line.number),
    }

    scan.expect_keyword("blmty")?;
    let plain = scan.expect_line("expected PLAIN", |line| line.keyword() == "PLAIN")?;
    let material = scan.read_name5(plain, 23, "material");
    let equivalent_radius = scan.read_length(plain, 35, "avrd");
    let inertia = scan.next_line_if(|line| line.is_continuation() && line.columns(30, 31) == "I1").map(|line| {
        let names = ["I1", "I2", "I3"];
        [0, 1, 2].map(|k| scan.read_moment(line, GRID_COLUMNS[k], names[k]))
    });

    scan.expect_keyword("nodty")?;
    let node = scan.expect_line("expected NO6xx", |line| line.keyword() == "NO6xx")?;
    let coordinates = scan.read_grid(node, COORDINATE_LABELS);
    // The angles are read as numbers, but LMGC90 sets them to zero.
    let angles = scan.expect_continuation("coo4 coo5 coo6")?;
    scan.read_grid(angles, ["coo4", "coo5", "coo6"]);

    let tacty = scan.expect_keyword("tacty")?;
    let mut contactors = Vec::with_capacity(1);
    let mut are_all_read = true;
    for k in 1.. {
        scan.set_object(format_args!("body {position}"));
        if scan.next_line_if(|line| line.keyword() == "$$$$$").is_some() {
            break;
        }
        let line = scan.expect_line("expected a contactor or $$$$$$", TextLine::is_data)?;
        scan.set_object(format_args!("body {position}, contactor {} {k}", line.keyword().trim()));
        let contactor = read_contactor(scan, line);
        are_all_read &= contactor.is_some();
        contactors.extend(contactor);
        // LMGC90 skips lines that belong to no contactor; those of a faulty contactor are already reported.
        if are_all_read && scan.peek_line().is_some_and(TextLine::is_continuation) {
            // LMGC90 skips a localframe where it reads none, so that the axes would not be those of the file.
            let is_frame = scan.peek_line().is_some_and(|line| line.columns(30, 39) == "localframe");
            let expected = "expected a contactor or $$$$$$";
            let no_frame = "expected none: only PLANx, CYLND and CAPSx have one; write the axes into DOF.INI";
            scan.unexpected_line(if is_frame { no_frame } else { expected });
        }
        while scan.next_line_if(TextLine::is_continuation).is_some() {}
    }
    match contactors.as_slice() {
        [] if are_all_read => scan.add_fault(tacty.number, "no contactor", "expected one or more"),
        // LMGC90 takes the mass from avrd but the inertia from the contactor.
        [Contactor { shape: ShapeRecord::Sphere { radius }, .. }]
            if *radius > 0.0
                && equivalent_radius > 0.0
                && (equivalent_radius - radius).abs() > RADIUS_ROUNDING * radius =>
        {
            let found = format!(
                "avrd {} is not the radius {} of the body's one sphere",
                number_text(equivalent_radius),
                number_text(*radius)
            );
            scan.add_fault(plain.number, found, "expected the radius, or 0");
        }
        _ => {}
    }
    Some(Body { line: begin, material, equivalent_radius, inertia, position: coordinates, contactors })
}

/// Reads the contactor that begins on `line`; `None` after a fault in its structure.
fn read_contactor(scan: &mut LineScanner, line: TextLine) -> Option<Contactor> {
    let colour = scan.read_name5(line, 23, "colour");
    let half_length_names = ["axe1", "axe2", "axe3"];
    let shape = match line.keyword() {
        "SPHER" => ShapeRecord::Sphere { radius: scan.read_positive(line, 35, "radius") },
        "SPHEb" => {
            let radius = scan.read_positive(line, 35, "radius");
            let offset = scan.expect_continuation("coo1 coo2 coo3")?;
            ShapeRecord::OffsetSphere { radius, offset: scan.read_grid(offset, COORDINATE_LABELS) }
        }
        "PLANx" => ShapeRecord::Plane {
            half_lengths: [0, 1, 2].map(|k| scan.read_positive(line, GRID_COLUMNS[k], half_length_names[k])),
        },
        "CYLND" | "DNLYC" => ShapeRecord::Cylinder {
            half_height: scan.read_positive(line, 35, "half height"),
            radius: scan.read_positive(line, 56, "radius"),
            hollow: line.keyword() == "DNLYC",
        },
        "CAPSx" => ShapeRecord::Capsule {
            half_length: scan.read_positive(line, 35, "half length"),
            radius: scan.read_positive(line, 56, "radius"),
        },
        "POLYR" => read_polyhedron(scan, line)?,
        "POLYF" => read_patches(scan, line)?,
        "PT3Dx" => ShapeRecord::Point { offset: scan.read_grid(line, COORDINATE_LABELS) },
        "MESHx" => read_surface_name(scan, line)?,
        _ => {
            let found = format!("a contactor of type '{}'", line.keyword().trim());
            let known = [&CONTACTOR_TYPES[..], &["POLYF"]].concat();
            scan.add_unknown_name(line.number, found, line.keyword().trim(), &known);
            return None;
        }
    };
    let local_frame = match shape {
        ShapeRecord::Plane { .. } | ShapeRecord::Cylinder { hollow: false, .. } | ShapeRecord::Capsule { .. } => {
            read_local_frame(scan)?
        }
        _ => None,
    };
    Some(Contactor { colour, shape, local_frame })
}

/// Reads the optional `localframe` block: `Some(None)` if there is none, `None` after a fault.
fn read_local_frame(scan: &mut LineScanner) -> Option<Option<Box<LocalFrame>>> {
    let Some(begin) = scan.next_line_if(|line| line.is_continuation() && line.columns(30, 39) == "localframe") else {
        return Some(None);
    };
    let mut rows = [[0.0; 3]; 4];
    for (row, names) in rows.iter_mut().zip(LOCAL_FRAME_LABELS) {
        let line = scan.expect_continuation(&names.join(" "))?;
        *row = scan.read_grid(line, names);
    }
    let [a, b, c, offset] = rows;
    let axes = [a, b, c];
    scan.check_orthonormal(begin.number, "the axes of the localframe", &axes);
    Some(Some(Box::new(LocalFrame { axes, offset })))
}

const LOCAL_FRAME_LABELS: [[&str; 3]; 4] =
    [["alp1", "alp2", "alp3"], ["bet1", "bet2", "bet3"], ["gam1", "gam2", "gam3"], COORDINATE_LABELS];

/// Reads a MESHx, whose surface is in another file; `None` after a fault.
fn read_surface_name(scan: &mut LineScanner, line: TextLine) -> Option<ShapeRecord> {
    let radius = scan.read_positive(line, 35, "radius");
    let sides = match scan.read_name(line, (56, 69), "side").as_str() {
        "one" => MeshSides::One,
        "both" => MeshSides::Both,
        "" => return None,
        other => {
            scan.add_fault(line.number, format!("side is '{other}'"), "expected one or both");
            return None;
        }
    };
    let line = scan.expect_continuation("file")?;
    let file = scan.read_name(line, (35, 90), "file");
    if file.contains(['/', '\\']) {
        scan.add_fault(line.number, format!("file is '{file}'"), "expected the name of a file in DATBOX");
    }
    (!file.is_empty()).then(|| ShapeRecord::Mesh { radius, sides, file: file.into(), surface: None })
}

/// Reads a POLYR: its vertices, then its triangles; `None` after a fault.
fn read_polyhedron(scan: &mut LineScanner, line: TextLine) -> Option<ShapeRecord> {
    let counts = read_counts(scan, line)?;
    // All lines are read first, so that a missing line does not make every later line look wrong.
    let lines: Vec<_> = std::iter::from_fn(|| scan.next_line_if(TextLine::is_continuation)).collect();
    if counts.iter().try_fold(0u64, |sum, count| sum.checked_add(*count)) != Some(lines.len() as u64) {
        report_counts(scan, line, counts, &lines);
        return None;
    }
    if counts.iter().any(|count| *count < 4) {
        let found = format!("vertices {}, triangles {}", counts[0], counts[1]);
        scan.add_fault(line.number, found, "expected at least 4 of each: a closed surface");
        return None;
    }
    let (mut vertices, mut triangles) = read_mesh(scan, counts[0], &lines);
    let mut replace_by = |cleaned: CleanedSurface, form: AcceptedDeviation| {
        (0..cleaned.removed).for_each(|_| scan.add_form(form, line.number));
        (cleaned.vertices, cleaned.triangles)
    };
    if let Some(joined) = with_joined_vertices(&vertices, &triangles, FLATNESS_OF_FILES) {
        (vertices, triangles) = replace_by(joined, AcceptedDeviation::JoinedVertex);
    }
    if let Some(used) = without_unused_vertices(&vertices, &triangles, FLATNESS_OF_FILES) {
        (vertices, triangles) = replace_by(used, AcceptedDeviation::UnusedVertex);
    }
    Some(ShapeRecord::Polyhedron { vertices, triangles })
}

/// Reads a POLYF: patches, each with its own numbers of vertices. Patches share the vertices on their rims.
fn read_patches(scan: &mut LineScanner, line: TextLine) -> Option<ShapeRecord> {
    let patch_count = scan.read_integer(line, (40, 47), "number of patches")?;
    let lines: Vec<_> = std::iter::from_fn(|| scan.next_line_if(TextLine::is_continuation)).collect();
    let (mut unread, mut patches) = (lines.as_slice(), Vec::new());
    while let Some((head, rest)) = unread.split_first() {
        let counts = read_counts(scan, *head)?;
        let end = counts[0].saturating_add(counts[1]).try_into().unwrap_or(usize::MAX);
        let Some((patch_lines, rest)) = rest.split_at_checked(end) else {
            report_counts(scan, *head, counts, rest);
            return None;
        };
        patches.push(read_mesh(scan, counts[0], patch_lines));
        unread = rest;
    }
    if patches.len() as u64 != patch_count {
        let found = format!("patches {} follow", patches.len());
        scan.add_fault(line.number, found, format!("expected {patch_count}, as announced"));
        return None;
    }
    scan.add_form(AcceptedDeviation::PatchedSurface, line.number);
    let (vertices, triangles) = join_patches(&patches);
    Some(ShapeRecord::Polyhedron { vertices, triangles })
}

/// Vertices and triangles of a surface or patch.
type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Surface of patches: vertices of different patches that are equal up to the digits of files become one.
fn join_patches(patches: &[Mesh]) -> Mesh {
    let extent = |k: usize| {
        let coordinates = || patches.iter().flat_map(|(vertices, _)| vertices).map(|vertex| vertex[k]);
        coordinates().fold(f64::NEG_INFINITY, f64::max) - coordinates().fold(f64::INFINITY, f64::min)
    };
    let tolerance = FLATNESS_OF_FILES * (0..3).map(extent).fold(0.0, f64::max);
    let is_same = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance);
    let (mut vertices, mut triangles): Mesh = Default::default();
    for (patch_vertices, patch_triangles) in patches {
        // Vertices of one patch are different ones, however near.
        let vertices_before = vertices.len();
        let numbers: Vec<u32> = patch_vertices
            .iter()
            .map(|vertex| {
                let known = vertices[..vertices_before].iter().position(|other| is_same(other, vertex));
                known.unwrap_or_else(|| {
                    vertices.push(*vertex);
                    vertices.len() - 1
                }) as u32
            })
            .collect();
        // Triangles with missing vertices are reported.
        let joined_triangle = |triangle: &[u32; 3]| triangle.map(|v| numbers.get(v as usize).copied().unwrap_or(v));
        triangles.extend(patch_triangles.iter().map(joined_triangle));
    }
    (vertices, triangles)
}

/// Reads the numbers of vertices and triangles.
fn read_counts(scan: &mut LineScanner, line: TextLine) -> Option<[u64; 2]> {
    let vertex_count = scan.read_integer(line, (40, 47), "number of vertices")?;
    Some([vertex_count, scan.read_integer(line, (60, 67), "number of triangles")?])
}

/// Reports that `lines` are fewer or more than the vertices and triangles that `head` announces.
fn report_counts(scan: &mut LineScanner, head: TextLine, [vertices, triangles]: [u64; 2], lines: &[TextLine]) {
    let line_count = lines.iter().take_while(|line| line.columns(35, 90).contains('.')).count();
    let found = format!("vertices {line_count}, triangles {} follow", lines.len() - line_count);
    let expected = format!("expected vertices {vertices}, triangles {triangles}, as announced");
    scan.add_fault(head.number, found, expected);
}

/// Reads `vertex_count` lines of vertices, then lines of triangles.
fn read_mesh(scan: &mut LineScanner, vertex_count: u64, lines: &[TextLine]) -> Mesh {
    let (vertex_lines, triangle_lines) = lines.split_at(vertex_count as usize);
    let vertices = (1..).zip(vertex_lines);
    let vertices = vertices
        .map(|(k, &line)| {
            [0, 1, 2].map(|c| scan.read_real(line, GRID_COLUMNS[c], format_args!("vertex {k}, coo{}", c + 1)))
        })
        .collect();
    let mut triangles = Vec::with_capacity(triangle_lines.len());
    for (k, &line) in (1..).zip(triangle_lines) {
        let numbers =
            GRID_COLUMNS.map(|first| scan.read_integer(line, (first, first + 12), format_args!("face {k}, vertex")));
        let [Some(a), Some(b), Some(c)] = numbers else { continue };
        if let Some(wrong) = [a, b, c].into_iter().find(|n| !(1..=vertex_count).contains(n)) {
            let found = format!("face {k} names vertex {wrong}");
            scan.add_fault(line.number, found, format!("expected 1 to {vertex_count}"));
        } else if a == b || b == c || c == a {
            scan.add_fault(
                line.number,
                format!("face {k} names vertices {a}, {b}, {c}"),
                "expected three different ones",
            );
        }
        triangles.push([a, b, c].map(|n| (n as u32).wrapping_sub(1)));
    }
    (vertices, triangles)
}

/// Appends the record of a body with its number, from 1; numbers are formatted by `real`, or by [`format_long14`] if the body
/// has a polyhedron.
fn write_body(out: &mut String, number: usize, body: &Body, real: fn(f64) -> RealText) {
    let coordinate_labels = ["coo1=", "coo2=", "coo3="];
    let is_polyhedron = |contactor: &Contactor| matches!(contactor.shape, ShapeRecord::Polyhedron { .. });
    let real = if body.contactors.iter().any(is_polyhedron) { format_long14 } else { real };
    let _ = write!(out, "$bdyty\n RBDY3  {number:5}\n$blmty\n");
    let head = format!(" PLAIN      1  behav  {:<5}", body.material);
    put_grid(out, &head, &["avrd="], &[body.equivalent_radius], real);
    if let Some(inertia) = &body.inertia {
        put_grid(out, "", &["I1  =", "I2  =", "I3  ="], inertia, real);
    }
    out.push_str("$nodty\n");
    put_grid(out, " NO6xx      1", &coordinate_labels, &body.position, real);
    put_grid(out, "", &["coo4=", "coo5=", "coo6="], &[0.0; 3], real);
    out.push_str("$tacty\n");
    for (number, Contactor { colour, shape, local_frame }) in (1..).zip(&body.contactors) {
        let head = format!(" {}  {number:5}  color  {colour:<5}", shape.type_name());
        match shape {
            ShapeRecord::Sphere { radius } => put_grid(out, &head, &["byrd="], &[*radius], real),
            ShapeRecord::OffsetSphere { radius, offset } => {
                put_grid(out, &head, &["byrd="], &[*radius], real);
                put_grid(out, "", &coordinate_labels, offset, real);
            }
            ShapeRecord::Plane { half_lengths } => {
                put_grid(out, &head, &["axe1=", "axe2=", "axe3="], half_lengths, real)
            }
            ShapeRecord::Cylinder { half_height: half_length, radius, .. }
            | ShapeRecord::Capsule { half_length, radius } => {
                put_grid(out, &head, &["High=", "byrd="], &[*half_length, *radius], real);
            }
            ShapeRecord::Polyhedron { vertices, triangles } => {
                let (vertex_count, triangle_count) = (vertices.len(), triangles.len());
                let _ = writeln!(out, "{head}  nb_vertex={vertex_count:7}    nb_faces={triangle_count:7}");
                for vertex in vertices {
                    put_grid(out, "", &coordinate_labels, vertex, real);
                }
                for triangle in triangles {
                    for (k, column) in GRID_COLUMNS.iter().enumerate() {
                        put_text(out, column - 5, format_args!("ver{}={:7}", k + 1, triangle[k] + 1));
                    }
                    out.push('\n');
                }
            }
            ShapeRecord::Point { offset } => put_grid(out, &head, &coordinate_labels, offset, real),
            ShapeRecord::Mesh { radius, sides, file, .. } => {
                put_grid(out, &head, &["byrd="], &[*radius], real);
                out.pop();
                put_text(out, 51, format_args!("side= {}\n", if *sides == MeshSides::One { "one" } else { "both" }));
                put_text(out, 30, format_args!("{MESH_FILE_LABEL} {file}\n"));
            }
        }
        if let Some(LocalFrame { axes: [a, b, c], offset }) = local_frame.as_deref() {
            put_text(out, 30, "localframe\n");
            for (names, row) in LOCAL_FRAME_LABELS.iter().zip([a, b, c, offset]) {
                put_grid(out, "", &names.map(|name| format!("{name}=")).each_ref().map(String::as_str), row, real);
            }
        }
    }
    out.push_str("$$$$$$\n");
}
