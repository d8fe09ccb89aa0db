//! `DOF.INI`, `DOF.OUT.k`: displacement, velocity and frame of bodies at one instant.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path;

use crate::error::{Fault, Faults};
use crate::scan::parts::{put_records, read_file_records, read_records};
use crate::scan::{
    AsciiText, DASHED_LINE, FRAME_TOLERANCE, LineScanner, RealText, TextLine, format_d14, format_integer,
    format_long14, fortran_real, frame_defect, put_grid, put_steps,
};

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dof {
    pub step: u64,
    /// Time, s.
    pub time: f64,
    pub bodies: Vec<BodyDof>,
}

/// Displacement, velocity and axes of one body.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyDof {
    pub line: usize,
    /// Body number, 0-based (1-based in the file).
    pub body: usize,
    /// `X(1..6)`: displacement from the reference position of BODIES.DAT, m; the last three are not used.
    pub displacement: [f64; 6],
    /// `V(1..6)`: velocity in fixed axes, m/s; angular velocity along the body's axes, rad/s.
    pub velocity: [f64; 6],
    /// `a`, `b`, `g`: the body's principal axes in fixed axes, one a row; orthonormal, and perhaps left-handed.
    pub axes: [[f64; 3]; 3],
}

/// Labels of the seven lines of a body, in their order.
const LINE_LABELS: [[&str; 3]; 7] = [
    ["X(1)=", "X(2)=", "X(3)="],
    ["X(4)=", "X(5)=", "X(6)="],
    ["V(1)=", "V(2)=", "V(3)="],
    ["V(4)=", "V(5)=", "V(6)="],
    ["a(1)=", "a(2)=", "a(3)="],
    ["b(1)=", "b(2)=", "b(3)="],
    ["g(1)=", "g(2)=", "g(3)="],
];

impl Dof {
    /// Reads the file; reports all its faults at once. It may list any of the bodies, in any order, without repetition.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Ok(Self::read_with_notices(path)?.0)
    }

    /// Reads the file like [`Dof::read`]; also returns notices about deviations from its form.
    pub fn read_with_notices(path: &Path) -> Result<(Self, Vec<String>), Faults> {
        Self::from_parts(path, read_file_records(path, "bdyty", read_part)?)
    }

    /// Reads the text of a file; `path` is for messages. Errors: all faults of the text.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        Ok(Self::parse_with_notices(path, text)?.0)
    }

    /// Reads the text of a file like [`Dof::parse`]; also returns notices about deviations from its form.
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        Self::from_parts(path, read_records(path, text, "bdyty", read_part)?)
    }

    /// Joins the parts of a file, of which the first has the head.
    fn from_parts(path: &Path, (parts, notices): (Vec<DofPart>, Vec<String>)) -> Result<(Self, Vec<String>), Faults> {
        let (step, time) = parts[0].step_and_time.expect("the first part has the head");
        let mut bodies = Vec::with_capacity(parts.iter().map(|part| part.bodies.len()).sum());
        parts.into_iter().for_each(|part| bodies.extend(part.bodies));
        let (mut faults, mut lines) = (Faults::default(), HashMap::new());
        // In rising order, as all programs write them, no body is repeated.
        if !bodies.is_sorted_by(|a, b| a.body < b.body) {
            for body in &bodies {
                if let Some(found) = repetition(&mut lines, body) {
                    faults.push(Fault::new(path, Some(body.line), object_name(body.body), found, EXPECTED_ONCE));
                }
            }
        }
        Ok((faults.into_result(Dof { step, time, bodies })?, notices))
    }

    /// Text of the file as LMGC90 writes it, numbers with seven digits; axes that need more have more, see
    /// [`format_long14`].
    ///
    /// Numbers must be finite and below 1e100; step and bodies have seven columns.
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        put_steps(&mut out, "DOF", self.step, self.time);
        put_records(&mut out, &self.bodies, |out, _, body| write_record(out, body));
        out + DASHED_LINE + DASHED_LINE
    }
}

fn write_record(out: &mut String, BodyDof { body, displacement, velocity, axes, .. }: &BodyDof) {
    let number = format_integer(body + 1, 7);
    let _ = write!(out, "$bdyty\n RBDY3  {number}\n$nodty\n");
    let (motion_labels, axis_labels) = LINE_LABELS.split_at(4);
    let motion_lines = displacement.chunks(3).chain(velocity.chunks(3));
    for (k, (values, labels)) in motion_lines.zip(motion_labels).enumerate() {
        put_grid(out, if k == 0 { " NO6xx      1" } else { "" }, labels, values, format_d14);
    }
    for (axis, labels) in axes.iter().zip(axis_labels) {
        put_grid(out, "", labels, axis, format_axis);
    }
    out.push_str("$$$$$$\n      \n");
}

/// Formats by [`format_d14`] if that is exact.
fn format_axis(x: f64) -> RealText {
    let short = format_d14(x);
    if fortran_real(&short) == Ok(x) { short } else { format_long14(x) }
}

/// Content of a part of a long file.
struct DofPart {
    /// Step and time (s) of the head, which the first part has.
    step_and_time: Option<(u64, f64)>,
    bodies: Vec<BodyDof>,
}

/// Reads a part of a file, before which there are `records_before` records.
fn read_part(scan: &mut LineScanner, records_before: usize) -> DofPart {
    let step_and_time = (records_before == 0).then(|| scan.read_steps());
    DofPart { step_and_time, bodies: read_bodies(scan, records_before) }
}

/// Reads bodies up to the end of the text, before which there are `records_before` records.
fn read_bodies(scan: &mut LineScanner, records_before: usize) -> Vec<BodyDof> {
    let mut bodies = Vec::new();
    let mut lines = HashMap::new();
    for record in records_before + 1.. {
        scan.set_object(format!("record {record}"));
        scan.skip_to_keyword("bdyty");
        if scan.peek_line().is_none() {
            break;
        }
        let Some(body) = read_record(scan) else {
            scan.skip_record();
            continue;
        };
        if let Some(found) = repetition(&mut lines, &body) {
            scan.add_fault(body.line, found, EXPECTED_ONCE);
        }
        bodies.push(body);
    }
    bodies
}

/// Expectation in faults of bodies that are repeated.
const EXPECTED_ONCE: &str = "expected each body once";

/// Adds the line of a body to `lines`, the lines by bodies; returns the fault if the body has one there already.
fn repetition(lines: &mut HashMap<usize, usize>, body: &BodyDof) -> Option<String> {
    lines.insert(body.body, body.line).map(|earlier| format!("the body is on line {earlier}, too"))
}

fn object_name(body: usize) -> String {
    format!("body {}", body + 1)
}

/// Reads one body; `None` after a fault that leaves the scan inside the record.
fn read_record(scan: &mut LineScanner) -> Option<BodyDof> {
    scan.expect_keyword("bdyty")?;
    let line = scan.expect_line("expected RBDY3 and the number of the body", TextLine::is_data)?;
    if !scan.expect_rigid_body(line, 2) {
        return None;
    }
    let body = scan.read_index(line, (9, 15), "number")?;
    scan.set_object(object_name(body));
    scan.expect_keyword("nodty")?;
    let mut rows = [[0.0; 3]; 7];
    for (k, (row, labels)) in rows.iter_mut().zip(LINE_LABELS).enumerate() {
        let line = match k {
            0 => scan.expect_line("expected NO6xx", |line| line.keyword() == "NO6xx")?,
            _ => scan.expect_continuation(&labels.join(" "))?,
        };
        // LMGC90 reads by position, whatever the label: lines in another order would be read as others.
        let label = line.first_label();
        if label != labels[0] && LINE_LABELS.iter().any(|row| row[0] == label) {
            scan.add_fault(line.number, format!("'{label}' is in columns 30 to 34"), format!("expected {}", labels[0]));
        }
        *row = scan.read_grid(line, labels.map(|label| label.trim_end_matches('=')));
    }
    scan.expect_keyword("$$$$$")?;
    let [[x1, x2, x3], [x4, x5, x6], [v1, v2, v3], [v4, v5, v6], a, b, g] = rows;
    let axes = [a, b, g];
    // Left-handed axes are accepted here; cd-solve rejects them unless the shape of the body is its own mirror image.
    let is_left_handed = frame_defect(&[a, b, g.map(|x| -x)]) <= FRAME_TOLERANCE;
    if !is_left_handed {
        scan.check_orthonormal(line.number, "the axes a, b, g", &axes);
    }
    let (displacement, velocity) = ([x1, x2, x3, x4, x5, x6], [v1, v2, v3, v4, v5, v6]);
    Some(BodyDof { line: line.number, body, displacement, velocity, axes })
}
