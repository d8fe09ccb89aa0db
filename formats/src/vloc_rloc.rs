//! `Vloc_Rloc.INI`, `Vloc_Rloc.OUT.k`: contacts at one instant, with their forces and velocities.
//!
//! Frames and components here are this project's: rows n, t, s with n x t = s. The files of LMGC90 have s = t x n (n x t
//! for SPCDx and SPDCx); reader and writer reverse the sign of s and of its components, the sliding of interfaces
//! included.

use std::fmt::Write;
use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use crate::error::Faults;
use crate::law_table::INTERFACE_SLIDING;
use crate::scan::{
    AcceptedDeviation, AsciiText, FRAME_TOLERANCE, GRID_COLUMNS, LineScanner, TextLine, format_d14, format_integer,
    frame_defect, put_grid, put_steps, put_text,
};

/// Contents of a file: the contacts at one instant.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct VlocRloc {
    pub step: u64,
    /// Time, s.
    pub time: f64,
    pub contacts: Vec<ContactRecord>,
}

/// Contact with its law, force and velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactRecord {
    /// Line of `$icdan`, 1-based.
    pub line: usize,
    /// Kind of contact, `SPSPx`, `SPPLx` ...
    pub kind: String,
    pub candidate: ContactSide,
    pub antagonist: ContactSide,
    /// Nickname of the law.
    pub law: String,
    /// Status, `stick`, `slide`, `noctc` ...
    pub status: String,
    /// Force on the candidate along n, t, s, N.
    pub force: [f64; 3],
    /// Velocity of the candidate relative to the antagonist along n, t, s, m/s.
    pub velocity: [f64; 3],
    /// Gap predicted for the next detection, m.
    pub gap: f64,
    /// Rows n, t, s; n points from the antagonist to the candidate.
    pub frame: [[f64; 3]; 3],
    /// Whether the axes of the file are left-handed, as those of LMGC90 are on the side of a plate to which its third axis
    /// does not point; those of `frame` are not.
    pub is_left_handed: bool,
    /// Point of contact, m.
    pub point: [f64; 3],
    /// Internal variables of the law.
    pub internals: Vec<f64>,
}

/// Body and contactor on one side of a contact.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSide {
    /// Body number, 0-based (1-based in the file).
    pub body: usize,
    /// Contactor, `SPHER`, `PLANx` ...
    pub contactor: String,
    /// Number of the contactor in its body, 0-based (1-based in the file).
    pub number: usize,
}

/// Format in which LMGC90 writes a kind of contact.
struct ContactKind {
    name: &'static str,
    pair: &'static PairColumns,
    /// Order of the components of force and velocity.
    components: &'static str,
    gap_label: &'static str,
    /// Order of the lines of axes and point (`p`) after the gap. LMGC90 writes `tnsp` for SPCDx and SPDCx but reads
    /// `stnp`; ours are written so that it can read them. Our reader uses the labels.
    rows: &'static str,
    /// Whether s in the file is t x n.
    reversed_s: bool,
}

/// Kinds that can be read, in their order in a file.
const CONTACT_KINDS: [ContactKind; 13] = [
    ContactKind {
        name: "CDCDx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
    // Cylinders with surfaces MESHx, which LMGC90 does not have.
    ContactKind {
        name: "CDMSx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
    ContactKind {
        name: "CDPLx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
    // Polyhedra with surfaces MESHx, which LMGC90 does not have.
    ContactKind {
        name: "PRMSx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gapTT",
        rows: "ptns",
        reversed_s: true,
    },
    ContactKind {
        name: "PRPLx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gapTT",
        rows: "ptns",
        reversed_s: true,
    },
    ContactKind {
        name: "PRPRx",
        pair: &LONG_COLUMNS,
        components: "tns",
        gap_label: "gapTT",
        rows: "ptns",
        reversed_s: true,
    },
    ContactKind {
        name: "PTPT3",
        pair: &SHORT_COLUMNS,
        components: "tns",
        gap_label: "gapTT",
        rows: "np",
        reversed_s: true,
    },
    ContactKind {
        name: "SPCDx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: false,
    },
    ContactKind {
        name: "SPDCx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: false,
    },
    // Spheres with surfaces MESHx, which LMGC90 does not have.
    ContactKind {
        name: "SPMSx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
    ContactKind {
        name: "SPPLx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
    ContactKind {
        name: "SPPRx",
        pair: &SHORT_COLUMNS,
        components: "tns",
        gap_label: "gapTT",
        rows: "ptns",
        reversed_s: true,
    },
    ContactKind {
        name: "SPSPx",
        pair: &LONG_COLUMNS,
        components: "stn",
        gap_label: "gTT =",
        rows: "stnp",
        reversed_s: true,
    },
];

/// Columns of the line that names the pair: the first one of words, the first and last of numbers.
struct PairColumns {
    candidate: SideColumns,
    /// Column of the candidate vertex or face of a polyhedron; not kept.
    vertex: Option<usize>,
    law: usize,
    antagonist: SideColumns,
    status: usize,
}

/// Columns of one side of a pair.
struct SideColumns {
    body: usize,
    body_number: (usize, usize),
    contactor: usize,
    contactor_number: (usize, usize),
}

const LONG_COLUMNS: PairColumns = PairColumns {
    candidate: SideColumns { body: 2, body_number: (9, 13), contactor: 16, contactor_number: (23, 27) },
    vertex: Some(30),
    law: 37,
    antagonist: SideColumns { body: 44, body_number: (51, 55), contactor: 58, contactor_number: (65, 69) },
    status: 72,
};

const SHORT_COLUMNS: PairColumns = PairColumns {
    candidate: SideColumns { body: 2, body_number: (9, 13), contactor: 16, contactor_number: (23, 27) },
    vertex: None,
    law: 30,
    antagonist: SideColumns { body: 37, body_number: (44, 48), contactor: 51, contactor_number: (58, 62) },
    status: 65,
};

/// Columns of SPSPx in a file with more than 99 999 of them.
const WIDE_COLUMNS: PairColumns = PairColumns {
    candidate: SideColumns { body: 2, body_number: (9, 15), contactor: 18, contactor_number: (25, 31) },
    vertex: None,
    law: 41,
    antagonist: SideColumns { body: 48, body_number: (55, 61), contactor: 64, contactor_number: (71, 77) },
    status: 80,
};

/// Largest number that fits into five columns.
const MAX_FIVE_DIGITS: usize = 99_999;
/// Last column that the titles of [`LONG_COLUMNS`] use; the titles of [`WIDE_COLUMNS`] use more.
const MAX_LONG_WIDTH: usize = 80;

/// Index of an axis, n t s, in the arrays of a record.
fn axis_index(letter: char) -> usize {
    match letter {
        'n' => 0,
        't' => 1,
        _ => 2,
    }
}

/// Labels of a line of an axis, or of the point.
fn row_labels(letter: char) -> [&'static str; 3] {
    match letter {
        'n' => ["n(1)=", "n(2)=", "n(3)="],
        't' => ["t(1)=", "t(2)=", "t(3)="],
        's' => ["s(1)=", "s(2)=", "s(3)="],
        _ => ["coo1=", "coo2=", "coo3="],
    }
}

impl ContactKind {
    fn from_name(name: &str) -> Option<&'static ContactKind> {
        CONTACT_KINDS.iter().find(|kind| kind.name == name)
    }

    /// Reverses s where the file's convention differs from ours, in either direction.
    fn convert_s_axis(&self, contact: &mut ContactRecord) {
        if self.reversed_s {
            contact.reverse_s_axis();
        }
    }
}

impl ContactRecord {
    /// Reverses s and all components along it.
    fn reverse_s_axis(&mut self) {
        self.frame[2] = self.frame[2].map(|x| -x);
        (self.force[2], self.velocity[2]) = (-self.force[2], -self.velocity[2]);
        if let Some([t, s]) = self.sliding() {
            self.set_sliding([t, -s]);
        }
    }

    /// Sliding of the candidate of an interface along t and s, m; `None` for other laws, which have fewer internal variables.
    pub fn sliding(&self) -> Option<[f64; 2]> {
        let has_sliding = INTERFACE_SLIDING.into_iter().all(|k| k < self.internals.len());
        has_sliding.then(|| INTERFACE_SLIDING.map(|k| self.internals[k]))
    }

    /// Sets the sliding of the candidate of an interface along t and s, m.
    pub fn set_sliding(&mut self, along_t_s: [f64; 2]) {
        INTERFACE_SLIDING.into_iter().zip(along_t_s).for_each(|(k, value)| self.internals[k] = value);
    }
}

/// Tangents t and s = n x t that LMGC90 computes for a contact of a kind and its unit normal; `None` for kinds in which they
/// also depend on the bodies.
///
/// Tangents of spheres on cylinders, and of two spheres if a component of n is zero, are only orthogonal where n is along
/// an axis; s is then no unit vector either. Verified with files of LMGC90 2025.
pub fn lmgc90_tangents(kind: &str, n: [f64; 3]) -> Option<[[f64; 3]; 2]> {
    let [x, y, z] = n;
    let cyclic = Vector3::new(z, x, y);
    let t = match kind {
        "SPCDx" | "SPDCx" => cyclic,
        "SPSPx" if n.contains(&0.0) => cyclic,
        "SPSPx" => Vector3::new(-y * z, -x * z, 2.0 * x * y).normalize(),
        "PRPRx" => Vector3::new(0.0, -z, y).try_normalize(0.0)?,
        _ => return None,
    };
    Some([t.into(), Vector3::from(n).cross(&t).into()])
}

impl VlocRloc {
    /// Reads the file; reports all its faults at once. PTPT3 contacts have n only: their t and s are zero.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &AsciiText::read_file(path)?)
    }

    /// Reads the text of a file; `path` is for messages. Errors: all faults of the text.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        Ok(Self::parse_with_notices(path, text)?.0)
    }

    /// Reads the text of a file like [`VlocRloc::parse`]; also returns notices about deviations from its form.
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        let scan = &mut LineScanner::new(path, text);
        let (step, time) = scan.read_steps();
        let mut contacts = Vec::new();
        for record in 1.. {
            scan.set_object(format!("contact {record}"));
            scan.skip_to_keyword("icdan");
            if scan.peek_line().is_none() {
                break;
            }
            let contact = read_contact(scan);
            if contact.is_none() {
                while scan.next_line_if(|line| line.keyword() != "icdan").is_some() {}
            }
            contacts.extend(contact);
        }
        scan.finish_with_notices(VlocRloc { step, time, contacts })
    }

    /// Text of the file as LMGC90 writes it, numbers with seven digits: kind by kind in its order, contacts of a kind in
    /// the order given and numbered from 1.
    ///
    /// Numbers must be finite and below 1e100, names have at most five characters. Bodies above 99 999 fit in SPSPx
    /// contacts only, in a form that LMGC90 writes but does not read. In other contacts their numbers become stars, which
    /// every reader rejects.
    ///
    /// # Panics
    /// If a contact is of a kind that readers do not know.
    pub fn to_text(&self) -> String {
        for contact in &self.contacts {
            assert!(
                ContactKind::from_name(&contact.kind).is_some(),
                "contacts of kind '{}' cannot be written",
                contact.kind
            );
        }
        let mut out = String::new();
        put_steps(&mut out, "Vloc_Rloc", self.step, self.time);
        for kind in &CONTACT_KINDS {
            let contacts: Vec<_> = self.contacts.iter().filter(|contact| contact.kind == kind.name).collect();
            let largest_number =
                contacts.iter().map(|c| c.candidate.body.max(c.antagonist.body) + 1).max().unwrap_or(0);
            let needs_six_digits = kind.name == "SPSPx" && contacts.len().max(largest_number) > MAX_FIVE_DIGITS;
            let pair = if needs_six_digits { &WIDE_COLUMNS } else { kind.pair };
            for (number, &contact) in (1..).zip(&contacts) {
                write_contact(&mut out, kind, pair, number, contact.clone());
            }
        }
        out
    }
}

/// Reads the block that begins on the next line; `None` after a fault that leaves the scan inside it.
fn read_contact(scan: &mut LineScanner) -> Option<ContactRecord> {
    let begin = scan.expect_keyword("icdan")?;
    let name = begin.columns(9, 13).trim();
    scan.set_object(format!("contact {name} {}", begin.columns(16, 22).trim()));
    let Some(kind) = ContactKind::from_name(name) else {
        let known = CONTACT_KINDS.map(|kind| kind.name);
        scan.add_unknown_name(begin.number, format!("a contact of type '{name}'"), name, &known);
        return None;
    };
    let next_is_pair =
        scan.peek_line().is_some_and(|line| line.keyword() == "RBDY3" && scan.follows_indented_comment(line));
    let title =
        if next_is_pair { None } else { Some(scan.expect_line("expected a line of titles", TextLine::is_data)?) };
    if let Some(title) = title.filter(|title| title.keyword() == "RBDY3") {
        scan.add_fault(
            title.number,
            "a pair that LMGC90 would skip",
            "expected a line of titles between $icdan and it",
        );
        return None;
    }
    let line = scan.expect_line("expected the pair in contact", TextLine::is_data)?;
    let pair = if kind.name == "SPSPx" && title.is_some_and(|title| title.used_width() > MAX_LONG_WIDTH) {
        &WIDE_COLUMNS
    } else {
        kind.pair
    };
    let candidate = read_side(scan, line, &pair.candidate, "candidate");
    let antagonist = read_side(scan, line, &pair.antagonist, "antagonist");
    let law = scan.read_name5(line, pair.law, "law");
    let status = scan.read_name5(line, pair.status, "status");

    let force = read_components(scan, kind, 'r')?;
    let velocity = read_components(scan, kind, 'v')?;
    let gap = scan.expect_continuation("the gap").map(|line| scan.read_real(line, GRID_COLUMNS[0], "gap"))?;
    let (frame, point) = read_rows(scan, kind)?;
    let internals = match scan.next_line_if(|line| line.is_data() && !line.columns(2, 15).trim().is_empty()) {
        Some(line) => read_internals(scan, line),
        None => Vec::new(),
    };
    let (candidate, antagonist) = (candidate?, antagonist?);
    let (line, kind_name) = (begin.number, kind.name.to_string());
    let mut contact = ContactRecord {
        line,
        kind: kind_name,
        candidate,
        antagonist,
        law,
        status,
        force,
        velocity,
        gap,
        frame,
        is_left_handed: false,
        point,
        internals,
    };
    kind.convert_s_axis(&mut contact);
    if kind.rows.contains('t') {
        contact.is_left_handed = make_right_handed(&mut contact);
        if contact.is_left_handed {
            scan.add_form(AcceptedDeviation::LeftHandedAxes, line);
        }
        if make_orthonormal(&mut contact) {
            scan.add_form(AcceptedDeviation::SkewAxes, line);
        }
        scan.check_orthonormal(line, "n, t, s", &contact.frame);
    }
    Some(contact)
}

/// Reverses s of a contact on a plate whose axes are left-handed, as LMGC90 writes those on the side to which the plate's
/// third axis does not point. Returns whether it has changed the axes.
fn make_right_handed(contact: &mut ContactRecord) -> bool {
    let [n, t, s] = contact.frame.map(Vector3::from);
    let reversed = [n, t, -s].map(Into::into);
    let is_left_handed = contact.antagonist.contactor == "PLANx" && frame_defect(&reversed) <= FRAME_TOLERANCE;
    if is_left_handed {
        contact.reverse_s_axis();
    }
    is_left_handed
}

/// Whether the tangents are those that LMGC90 computes for a contact of a kind. Those of a sphere on a polyhedron are the
/// tangents of a face, also where n is that of an edge or a corner.
fn has_axes_of_lmgc90(kind: &str, [n, t, s]: [Vector3<f64>; 3]) -> bool {
    if kind == "SPPRx" {
        let face_normal = t.cross(&s);
        return n.dot(&face_normal) > FRAME_TOLERANCE
            && frame_defect(&[face_normal, t, s].map(Into::into)) <= FRAME_TOLERANCE;
    }
    lmgc90_tangents(kind, n.into()).is_some_and(|[computed_t, computed_s]| {
        (t - Vector3::from(computed_t)).amax().max((s - Vector3::from(computed_s)).amax()) <= FRAME_TOLERANCE
    })
}

/// Turns t and s into the plane normal to n, if they are the axes of LMGC90 that are not orthogonal, and takes force,
/// velocity and sliding with them. Returns whether it has changed the axes.
///
/// The force is the sum of its components times the axes of the file; components of velocity and sliding are their
/// projections on these.
fn make_orthonormal(contact: &mut ContactRecord) -> bool {
    let [n, t, s] = contact.frame.map(Vector3::from);
    let is_unit = (n.norm_squared() - 1.0).abs() <= FRAME_TOLERANCE;
    if !is_unit || frame_defect(&contact.frame) <= FRAME_TOLERANCE || !has_axes_of_lmgc90(&contact.kind, [n, t, s]) {
        return false;
    }
    let rows = Matrix3::from_fn(|i, j| contact.frame[i][j]);
    let in_plane = (t - n * n.dot(&t)).try_normalize(FRAME_TOLERANCE);
    let (Some(to_world), Some(t)) = (rows.try_inverse(), in_plane) else { return false };
    let axes = [n, t, n.cross(&t)];
    let components = |v: Vector3<f64>| axes.map(|axis| axis.dot(&v));
    contact.force = components(rows.tr_mul(&Vector3::from(contact.force)));
    contact.velocity = components(to_world * Vector3::from(contact.velocity));
    if let Some([along_t, along_s]) = contact.sliding() {
        let [_, t, s] = components(to_world * Vector3::new(0.0, along_t, along_s));
        contact.set_sliding([t, s]);
    }
    contact.frame = axes.map(Into::into);
    true
}

/// Reads one side of a pair, which faults name `side_name`; `None` after a fault.
fn read_side(scan: &mut LineScanner, line: TextLine, columns: &SideColumns, side_name: &str) -> Option<ContactSide> {
    let is_rigid = scan.expect_rigid_body(line, columns.body);
    let body = scan.read_index(line, columns.body_number, &format!("{side_name}'s body"));
    let contactor = scan.read_name5(line, columns.contactor, &format!("{side_name}'s contactor"));
    let number = scan.read_index(line, columns.contactor_number, &format!("{side_name}'s contactor number"));
    Some(ContactSide { body: body.filter(|_| is_rigid)?, contactor, number: number? })
}

/// Reads the line of forces (`r`) or velocities (`v`), by position; a different label is a fault.
fn read_components(scan: &mut LineScanner, kind: &ContactKind, letter: char) -> Option<[f64; 3]> {
    let labels: Vec<_> = kind.components.chars().map(|component| format!("{letter}l{component}")).collect();
    let line = scan.expect_continuation(&labels.join(" "))?;
    let mut values = [0.0; 3];
    for ((component, label), value_column) in kind.components.chars().zip(&labels).zip(GRID_COLUMNS) {
        // The first three of the five columns of a label, as `rln` of `rln/H`.
        let (first, last) = (value_column - 5, value_column - 3);
        let found_label = line.columns(first, last);
        if ["rl", "vl"].iter().any(|known| found_label.starts_with(known)) && found_label != label {
            let found = format!("'{found_label}' is in columns {first} to {last}");
            scan.add_fault(line.number, found, format!("expected {label}, which LMGC90 reads there"));
        }
        values[axis_index(component)] = scan.read_real(line, value_column, label);
    }
    Some(values)
}

/// Reads the frame, as in the file, and the point, m; each line is recognized by its label.
fn read_rows(scan: &mut LineScanner, kind: &ContactKind) -> Option<([[f64; 3]; 3], [f64; 3])> {
    let (mut frame, mut point) = ([[0.0; 3]; 3], [0.0; 3]);
    let mut missing = kind.rows.to_string();
    while !missing.is_empty() {
        let row_letter = |line: TextLine| missing.chars().find(|&letter| line.first_label() == row_labels(letter)[0]);
        let line = scan.next_line_if(|line| line.is_continuation() && row_letter(line).is_some()).or_else(|| {
            let expected: Vec<_> = missing.chars().map(|letter| row_labels(letter)[0]).collect();
            scan.unexpected_line(&format!("expected a line with {} in columns 30 to 34", expected.join(" or ")))
        })?;
        let letter = row_letter(line)?;
        let labels = row_labels(letter);
        let row = scan.read_grid(line, labels.map(|label| label.trim_end_matches('=')));
        match letter {
            'p' => point = row,
            _ => frame[axis_index(letter)] = row,
        }
        missing.retain(|other| other != letter);
    }
    Some((frame, point))
}

/// Reads the reals in columns 2-15, 17-30, ... up to the end of the line.
fn read_internals(scan: &mut LineScanner, line: TextLine) -> Vec<f64> {
    let first_columns = (2..=line.used_width()).step_by(15);
    (1..).zip(first_columns).map(|(k, first)| scan.read_real(line, first, format_args!("internal {k}"))).collect()
}

/// Appends the record of a contact; `number` counts the contacts of its kind from 1.
fn write_contact(out: &mut String, kind: &ContactKind, pair: &PairColumns, number: usize, mut contact: ContactRecord) {
    kind.convert_s_axis(&mut contact);
    let _ = writeln!(out, "$icdan  {:<5}  {}", kind.name, format_integer(number, 7));

    let side_titles =
        |body, contactor| SideWords { body, body_number: "numbr".into(), contactor, contactor_number: "numbr".into() };
    let titles = PairWords {
        candidate: side_titles("cdbdy", "cdtac"),
        vertex: "CDVER",
        law: "behav",
        antagonist: side_titles("anbdy", "antac"),
        status: "sttus",
    };
    put_pair(out, pair, &titles);
    let words = PairWords {
        candidate: SideWords::new(&contact.candidate),
        vertex: if kind.name.starts_with("PR") { "    0" } else { "" },
        law: &contact.law,
        antagonist: SideWords::new(&contact.antagonist),
        status: &contact.status,
    };
    put_pair(out, pair, &words);

    for (letter, unit, values) in [('r', "/H", &contact.force), ('v', " =", &contact.velocity)] {
        let labels: Vec<_> = kind.components.chars().map(|component| format!("{letter}l{component}{unit}")).collect();
        let labels: Vec<_> = labels.iter().map(String::as_str).collect();
        let values: Vec<_> = kind.components.chars().map(|component| values[axis_index(component)]).collect();
        put_grid(out, "", &labels, &values, format_d14);
    }
    put_grid(out, "", &[kind.gap_label], &[contact.gap], format_d14);
    for letter in kind.rows.chars() {
        let row = if letter == 'p' { &contact.point } else { &contact.frame[axis_index(letter)] };
        put_grid(out, "", &row_labels(letter), row, format_d14);
    }
    if !contact.internals.is_empty() {
        out.push_str("#internals\n");
        for &value in &contact.internals {
            let _ = write!(out, " {}", format_d14(value));
        }
        out.push('\n');
    }
    out.push_str(" \n");
}

/// Words of the line of a pair, or its titles, for [`PairColumns`].
struct PairWords<'a> {
    candidate: SideWords<'a>,
    vertex: &'a str,
    law: &'a str,
    antagonist: SideWords<'a>,
    status: &'a str,
}

/// Words of one side of a pair: body and contactor with their numbers.
struct SideWords<'a> {
    body: &'a str,
    body_number: String,
    contactor: &'a str,
    contactor_number: String,
}

impl<'a> SideWords<'a> {
    fn new(side: &'a ContactSide) -> Self {
        SideWords {
            body: "RBDY3",
            body_number: (side.body + 1).to_string(),
            contactor: &side.contactor,
            contactor_number: (side.number + 1).to_string(),
        }
    }
}

/// Appends the line of a pair.
fn put_pair(out: &mut String, columns: &PairColumns, words: &PairWords) {
    let put_number = |out: &mut String, (first, last): (usize, usize), number: &str| {
        put_text(out, first, format_integer(number, last - first + 1));
    };
    let put_side = |out: &mut String, columns: &SideColumns, words: &SideWords| {
        put_text(out, columns.body, words.body);
        put_number(out, columns.body_number, &words.body_number);
        put_text(out, columns.contactor, words.contactor);
        put_number(out, columns.contactor_number, &words.contactor_number);
    };
    put_side(out, &columns.candidate, &words.candidate);
    if let Some(column) = columns.vertex {
        put_text(out, column, words.vertex);
    }
    put_text(out, columns.law, words.law);
    put_side(out, &columns.antagonist, &words.antagonist);
    put_text(out, columns.status, words.status);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contact of a sphere and a cylinder as LMGC90 writes it.
    const SPHERE_ON_CYLINDER: &str = "\
$steps       20              time= 0.2000000D-01

$icdan  SPCDx        1
 cdbdy  numbr  cdtac  numbr  CDVER  behav  anbdy  numbr  antac  numbr  sttus
 RBDY3      2  SPHER      1         iqsc0  RBDY3      1  CYLND      1  stick      1
                             rls/H 0.1201711D+00  rlt/H-0.1181704D+01  rln/H 0.4099774D+02
                             vls = 0.1000000D+00  vlt = 0.2000000D+00  vln =-0.3000000D+00
                             gTT = 0.0000000D+00
                             t(1)= 0.9949207D+00  t(2)= 0.1006621D+00  t(3)= 0.0000000D+00
                             n(1)= 0.1006621D+00  n(2)= 0.0000000D+00  n(3)= 0.9949207D+00
                             s(1)=-0.1001508D+00  s(2)= 0.9898671D+00  s(3)= 0.1013287D-01
                             coo1= 0.1006621D-01  coo2= 0.1000001D-01  coo3=-0.5079329D-03
";

    #[test]
    fn skew_axes_of_spheres_on_cylinders_are_turned_about_the_normal() {
        let read =
            |text: &str| VlocRloc::parse_with_notices(Path::new("Vloc_Rloc.INI"), &AsciiText::new(text.as_bytes()));
        let (file, notices) = read(SPHERE_ON_CYLINDER).unwrap();
        assert_eq!(notices.len(), 1);
        assert!(notices[0].contains("not orthogonal"), "{notices:?}");
        let contact = &file.contacts[0];
        assert!(frame_defect(&contact.frame) < 1e-6);
        let [n, t, s] = contact.frame.map(Vector3::from);
        let n_of_file = Vector3::new(0.1006621, 0.0, 0.9949207);
        let (t_of_file, s_of_file) =
            (Vector3::new(0.9949207, 0.1006621, 0.0), Vector3::new(-0.1001508, 0.9898671, 0.01013287));
        assert!((n - n_of_file).norm() < 1e-12);
        // The same force, and the same projections of the velocity on the axes of the file; n has eight digits.
        let sum = |[a, b, c]: [f64; 3]| n * a + t * b + s * c;
        let force = n_of_file * 40.99774 - t_of_file * 1.181704 + s_of_file * 0.1201711;
        assert!((sum(contact.force) - force).norm() < 1e-5 * force.norm());
        let velocity = sum(contact.velocity);
        for (axis, value) in [(n_of_file, -0.3), (t_of_file, 0.2), (s_of_file, 0.1)] {
            assert!((axis.dot(&velocity) - value).abs() < 1e-6, "{axis} {value}");
        }
        // The sliding is given by its projections on t and s of the file, too.
        let with_sliding = format!(
            "{SPHERE_ON_CYLINDER}  0.0000000D+00  1.0000000D-03  0.0000000D+00  2.0000000D-03{}\n",
            "  0.0000000D+00".repeat(3)
        );
        let contact = read(&with_sliding).unwrap().0.contacts.remove(0);
        let [_, t, s] = contact.frame.map(Vector3::from);
        let [along_t, along_s] = contact.sliding().unwrap();
        let sliding = t * along_t + s * along_s;
        for (axis, value) in [(t_of_file, 1e-3), (s_of_file, 2e-3)] {
            assert!((axis.dot(&sliding) - value).abs() < 1e-9, "{axis} {value}");
        }
        // Some laws have less than seven internal variables.
        let shorter = read(with_sliding.trim_end().strip_suffix("  0.0000000D+00").unwrap()).unwrap().0;
        assert_eq!(shorter.contacts[0].sliding(), contact.sliding());
        // A sphere on an edge of a polyhedron, with the tangents of a face.
        let edge = |n: &str| {
            let text =
                SPHERE_ON_CYLINDER.replace("SPCDx", "SPPRx").replace("CYLND      1  stick", "POLYR      1  stick");
            let pair = " RBDY3      2  SPHER      1  iqsc0  RBDY3      1  POLYR      1  stick";
            let lines = text.lines().map(|line| match line.trim_start().get(..4) {
                Some("RBDY") => pair.to_string(),
                Some("rls/") => format!("{:29}rlt/H 0.1000000D+01  rln/H 0.2000000D+01  rls/H 0.0000000D+00", ""),
                Some("vls ") => format!("{:29}vlt = 0.1000000D+00  vln = 0.0000000D+00  vls = 0.0000000D+00", ""),
                Some("gTT ") => line.replace("gTT =", "gapTT"),
                Some("t(1)") => format!("{:29}t(1)=-0.7071068D+00  t(2)= 0.0000000D+00  t(3)= 0.7071068D+00", ""),
                Some("n(1)") => format!("{:29}{n}", ""),
                Some("s(1)") => format!("{:29}s(1)= 0.0000000D+00  s(2)= 0.1000000D+01  s(3)= 0.0000000D+00", ""),
                _ => line.to_string(),
            });
            lines.collect::<Vec<_>>().join("\n") + "\n"
        };
        let on_edge = read(&edge("n(1)= 0.6000000D+00  n(2)= 0.0000000D+00  n(3)= 0.8000000D+00")).unwrap();
        assert!(on_edge.1[0].contains("not orthogonal"), "{:?}", on_edge.1);
        assert!(read(&edge("n(1)= 0.6000000D+00  n(2)= 0.1000000D+00  n(3)= 0.8000000D+00")).is_err());
        // Two spheres have such axes only with a normal in a coordinate plane, and with s = t x n.
        let spheres = SPHERE_ON_CYLINDER.replace("SPCDx", "SPSPx").replace("CYLND", "SPHER");
        assert!(read(&spheres).unwrap_err().to_string().contains("orthonormal"));
        let reversed = spheres.replace(
            "s(1)=-0.1001508D+00  s(2)= 0.9898671D+00  s(3)= 0.1013287D-01",
            "s(1)= 0.1001508D+00  s(2)=-0.9898671D+00  s(3)=-0.1013287D-01",
        );
        assert!(reversed != spheres && read(&reversed).unwrap().1[0].contains("not orthogonal"));
        let long = SPHERE_ON_CYLINDER.replace("n(3)= 0.9949207D+00", "n(3)= 0.9949207D+01");
        assert!(read(&long).unwrap_err().to_string().contains("orthonormal"));
    }

    #[test]
    fn left_handed_axes_of_plates_are_made_right_handed() {
        let on_plate = SPHERE_ON_CYLINDER.replace("SPCDx", "SPPLx").replace("CYLND", "PLANx");
        let axes = |s: &str| {
            on_plate
                .replace("t(1)= 0.9949207D+00  t(2)= 0.1006621D+00", "t(1)=-0.1000000D+01  t(2)= 0.0000000D+00")
                .replace(
                    "n(1)= 0.1006621D+00  n(2)= 0.0000000D+00  n(3)= 0.9949207D+00",
                    "n(1)= 0.0000000D+00  n(2)= 0.0000000D+00  n(3)=-0.1000000D+01",
                )
                .replace("s(1)=-0.1001508D+00  s(2)= 0.9898671D+00  s(3)= 0.1013287D-01", s)
        };
        let read =
            |text: &str| VlocRloc::parse_with_notices(Path::new("Vloc_Rloc.INI"), &AsciiText::new(text.as_bytes()));
        let (file, notices) = read(&axes("s(1)= 0.0000000D+00  s(2)= 0.1000000D+01  s(3)= 0.0000000D+00")).unwrap();
        assert!(notices[0].contains("left-handed"), "{notices:?}");
        let contact = &file.contacts[0];
        assert_eq!(frame_defect(&contact.frame), 0.0);
        // The same vectors: force and velocity along (s, t, n) of the file are (0.1201711, ...) and (0.1, ...).
        assert_eq!(
            (contact.force[2] * contact.frame[2][1], contact.velocity[2] * contact.frame[2][1]),
            (0.1201711, 0.1)
        );
        let (right_handed, notices) =
            read(&axes("s(1)= 0.0000000D+00  s(2)=-0.1000000D+01  s(3)= 0.0000000D+00")).unwrap();
        assert!(notices.is_empty() && right_handed.contacts[0].force[2] == -0.1201711);
        let spheres = axes("s(1)= 0.0000000D+00  s(2)= 0.1000000D+01  s(3)= 0.0000000D+00")
            .replace("SPPLx", "SPSPx")
            .replace("PLANx", "SPHER");
        assert!(read(&spheres).unwrap_err().to_string().contains("orthonormal"));
    }
}
