//! `TACT_BEHAV.DAT`: contact laws, and the table of which contactors see each other by which law.

use std::fmt::Write;
use std::path::Path;

use crate::bodies::CONTACTORS;
use crate::error::Faults;
use crate::ron_text::known_names;
use crate::scan::{Line, Scan, Text, e14, fortran_real, long14, put};

#[derive(Debug, Clone, PartialEq, Default)]
pub struct TactBehav {
    pub laws: Vec<Law>,
    pub visibility: Vec<See>,
}

/// A contact law with its parameters in the order of the file, e.g. RST_CLB: e_n, e_t, mu.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Line of the law, 1-based; 0 when no file holds it yet.
    pub line: usize,
    /// Five characters, trimmed.
    pub nickname: String,
    /// e.g. `IQS_CLB`
    pub kind: String,
    pub parameters: Vec<f64>,
}

/// One row of the visibility table.
#[derive(Debug, Clone, PartialEq)]
pub struct See {
    pub line: usize,
    pub candidate: Side,
    /// Nickname of the law.
    pub law: String,
    pub antagonist: Side,
    /// Alert distance, m, surface to surface.
    pub alert: f64,
}

/// One side of a row; the names are five characters, trimmed.
#[derive(Debug, Clone, PartialEq)]
pub struct Side {
    /// `RBDY3`
    pub body: String,
    /// `SPHER`, `PLANx` ...
    pub contactor: String,
    pub colour: String,
}

/// The laws that can be read, with the labels of their parameters, one slice a line of the file.
/// Which of them are computed is the solver's concern.
pub const LAWS: [(&str, &[&[&str]]); 24] = [
    ("IQS_CLB", &[&["fric"]]),
    ("IQS_CLB_g0", &[&["fric"]]),
    ("IQS_DS_CLB", &[&["dyfr", "stfr"]]),
    ("RST_CLB", &[&["rstn", "rstt"], &["fric"]]),
    ("RST_DS_CLB", &[&["rstn", "rstt"], &["dyfr", "stfr"]]),
    ("IQS_WET_DS_CLB", WET),
    ("xQS_WET_DS_CLB", WET),
    ("RST_WET_CLB", &[&["cohn", "coht"], &["rstn", "rstt"], &["Wthk"], &["dyfr", "stfr"]]),
    ("IQS_MOHR_DS_CLB", &[&["cohn", "coht"], &["dyfr", "stfr"]]),
    ("IQS_CAP_MOHR_DS_CLB", &[&["cohn", "coht"], &["dyfr", "stfr"], &["sten", "scom"]]),
    ("GAP_SGR_CLB", &[&["fric"]]),
    ("GAP_SGR_CLB_g0", &[&["fric"]]),
    ("VEL_SGR_CLB", &[&["fric"]]),
    ("IQS_CLB_RGR", &[&["T/H", "gtol"], &["fric"]]),
    ("ELASTIC_REPELL_CLB", &[&["F/gp"], &["fric"]]),
    ("ELASTIC_REPELL_CLB_g0", &[&["F/gp"], &["fric"]]),
    ("VISCO_ELASTIC_REPELL_CLB", &[&["F/gp", "etan"], &["fric"]]),
    ("COUPLED_DOF", &[]),
    ("ELASTIC_WIRE", &[&["F/gp", "prst"]]),
    ("ELASTIC_ROD", &[&["F/gp", "prst"]]),
    ("VOIGT_WIRE", &[&["F/gp", "prst"], &["F/vl"]]),
    ("VOIGT_ROD", &[&["F/gp", "prst"], &["F/vl"]]),
    // Not of LMGC90.
    ("IQS_DS_ROLL_CLB", &[&["dyfr", "stfr"], &["roll", "spin"]]),
    ("IQS_WET_DS_ROLL_CLB", &[&["cohn", "coht"], &["Wthk"], &["dyfr", "stfr"], &["roll", "spin"]]),
];

const WET: &[&[&str]] = &[&["cohn", "coht"], &["Wthk"], &["dyfr", "stfr"]];

/// Parameters that a law makes no sense with when negative.
const NOT_NEGATIVE: [&str; 9] = ["fric", "dyfr", "stfr", "cohn", "Wthk", "rstn", "F/gp", "roll", "spin"];

/// First columns of the parameters of a line.
const PARAMETERS: [usize; 2] = [46, 67];

/// Columns of a row of the visibility table: body, contactor, colour of both sides, between them the law.
const CANDIDATE: [usize; 3] = [2, 9, 16];
const LAW: usize = 23;
const ANTAGONIST: [usize; 3] = [30, 37, 44];
const ALERT: usize = 55;

const TITLES: &str = " cdbdy  cdtac  cdcol  behav  anbdy  antac  ancol       alert";

/// Labels of the parameters of a kind of law, in their order; none of a kind that [`LAWS`] does not hold.
pub fn labels(kind: &str) -> impl Iterator<Item = &'static str> {
    parameters(kind).unwrap_or_default().iter().flat_map(|line| line.iter().copied())
}

/// The same line by line.
fn parameters(kind: &str) -> Option<&'static [&'static [&'static str]]> {
    LAWS.iter().find(|(name, _)| *name == kind).map(|(_, lines)| *lines)
}

/// Comment of a file without laws: one that is empty by mistake would let all bodies pass through each other.
const NO_LAWS: &str = "! no contact laws";

/// Begin of the comments of [`TactBehav::no_law`].
const NO_LAW: &str = "! no law: ";

impl TactBehav {
    /// Reads the file; all its faults at once.
    ///
    /// Lines outside laws and rows are passed over, as LMGC90 does, unless they look like a row that
    /// would be lost. A row that says again what an earlier one said is dropped. The halo line (`+`)
    /// is not kept.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &Text::load(path)?)
    }

    /// Reads the text of a file; `path` is for messages.
    pub fn parse(path: &Path, text: &Text) -> Result<Self, Faults> {
        let scan = &mut Scan::new(path, text);
        let mut laws: Vec<Law> = Vec::new();
        let mut rows = Vec::new();
        while let Some(begin) = scan.line() {
            match begin.keyword() {
                "behav" => {
                    scan.about(format!("law {}", laws.len() + 1));
                    let Some(law) = read_law(scan) else { continue };
                    if !law.nickname.is_empty() && laws.iter().any(|known| known.nickname == law.nickname) {
                        scan.fault(law.line, format!("'{}' is defined twice", law.nickname), "expected each name once");
                    }
                    laws.push(law);
                }
                "seety" => {
                    scan.about(format!("see row {}", rows.len() + 1));
                    rows.push(read_row(scan));
                }
                "RBDY3" => {
                    scan.about(format!("see row {}", rows.len() + 1));
                    scan.fault(
                        begin.number,
                        "a row that LMGC90 would skip",
                        "expected $seety and a line of titles before",
                    );
                    rows.push(None);
                }
                _ => {}
            }
        }
        if laws.is_empty() && rows.is_empty() && !text.lines().any(|line| line.text().starts_with(NO_LAWS)) {
            let expected = format!("expected a $behav for each law; a file without laws says so by a line '{NO_LAWS}'");
            scan.fault_of_file("no contact laws", expected);
        }
        let visibility = check_rows(scan, &laws, rows);
        scan.finish(TactBehav { laws, visibility })
    }

    /// The text of the file, numbers with eight digits.
    ///
    /// Names must have at most five characters. A law of a kind that [`LAWS`] does not hold is
    /// written with its parameters one a line.
    pub fn to_text(&self) -> String {
        self.text(e14)
    }

    /// A comment of the file: two colours are meant to have no law.
    pub fn no_law(a: &str, b: &str) -> String {
        format!("{NO_LAW}{a} {b}\n")
    }

    /// The pairs of colours of such comments.
    ///
    /// ```
    /// use cd_formats::tact_behav::TactBehav;
    /// let text = format!("$behav\n{}", TactBehav::no_law("BLUEx", "BOULD"));
    /// assert_eq!(TactBehav::without_law(&text), [["BLUEx", "BOULD"]]);
    /// ```
    pub fn without_law(text: &str) -> Vec<[String; 2]> {
        let pair = |line: &str| {
            let (a, b) = line.strip_prefix(NO_LAW)?.trim_end().split_once(' ')?;
            Some([a, b].map(str::to_string))
        };
        text.lines().filter_map(pair).collect()
    }

    /// The same with as many digits as the columns hold, see [`long14`].
    pub fn to_long_text(&self) -> String {
        self.text(long14)
    }

    fn text(&self, real: fn(f64) -> String) -> String {
        let mut out = String::new();
        if self.laws.is_empty() && self.visibility.is_empty() {
            out += &format!("{NO_LAWS}\n");
        }
        for Law { nickname, kind, parameters: values, .. } in &self.laws {
            let _ = write!(out, "$behav\n {nickname:<5}  {kind}");
            let lines = parameters(kind).map_or_else(|| vec![&["parm"][..]; values.len()], <[_]>::to_vec);
            let mut values = values.iter();
            for (k, labels) in lines.iter().enumerate() {
                if k > 0 {
                    out.push('\n');
                }
                for ((label, value), column) in labels.iter().zip(&mut values).zip(PARAMETERS) {
                    put(&mut out, column - 5, format_args!("{label:<4}={}", real(*value)));
                }
            }
            out.push('\n');
        }
        for See { candidate, law, antagonist, alert, .. } in &self.visibility {
            let _ = write!(out, "$seety\n{TITLES}\n");
            for (side, columns) in [(candidate, CANDIDATE), (antagonist, ANTAGONIST)] {
                if columns == ANTAGONIST {
                    put(&mut out, LAW, law);
                }
                for (name, column) in [&side.body, &side.contactor, &side.colour].into_iter().zip(columns) {
                    put(&mut out, column, name);
                }
            }
            put(&mut out, ALERT, real(*alert));
            out.push('\n');
        }
        out
    }
}

/// The law after `$behav`; its parameters are left empty after a fault in its kind.
fn read_law(scan: &mut Scan) -> Option<Law> {
    let first = scan.expect("expected a law", Line::is_data)?;
    let nickname = scan.name5(first, 2, "nickname");
    let kind = scan.name(first, (9, 38), "kind");
    scan.about(format!("law '{nickname}'"));
    let mut law = Law { line: first.number, nickname, kind, parameters: Vec::new() };
    let Some(lines) = parameters(&law.kind) else {
        if !law.kind.is_empty() {
            let known: Vec<_> = LAWS.iter().map(|(name, _)| *name).collect();
            let expected = known_names(&law.kind, &known);
            scan.fault(first.number, format!("its kind '{}' is not known", law.kind), expected);
        }
        return Some(law);
    };
    let mut line = first;
    for (k, labels) in lines.iter().enumerate() {
        if k > 0 {
            let what = format!("{} of {}", labels.join(" "), law.kind);
            let Some(next) = scan.expect_continuation(&what) else { break };
            line = next;
        }
        for (label, column) in labels.iter().zip(PARAMETERS) {
            let value = if NOT_NEGATIVE.contains(label) {
                scan.length(line, column, label)
            } else {
                scan.real(line, column, label)
            };
            law.parameters.push(value);
        }
        // LMGC90 would not look at them.
        if let Some(&beyond) = PARAMETERS.get(labels.len()).filter(|&&first| has_real(line, first)) {
            let found = format!("a parameter in columns {beyond} to {}", beyond + 13);
            scan.fault(line.number, found, format!("expected {} alone on this line of {}", labels.join(" "), law.kind));
        }
    }
    if let Some(more) = scan.line_if(|line| line.continues() && has_real(line, PARAMETERS[0])) {
        let found = format!("one more line of parameters than {} has", law.kind);
        scan.fault(more.number, found, format!("expected {}", lines.len()));
    }
    Some(law)
}

fn has_real(line: Line, first: usize) -> bool {
    fortran_real(line.columns(first, first + 13)).is_ok()
}

/// The row after `$seety`.
fn read_row(scan: &mut Scan) -> Option<See> {
    let title = scan.expect("expected a line of titles, then a row", Line::is_data)?;
    let line = if title.keyword() == "RBDY3" {
        scan.fault(title.number, "a row that LMGC90 would skip", "expected a line of titles between $seety and it");
        title
    } else {
        scan.expect("expected a row of the visibility table", Line::is_data)?
    };
    if !(scan.rigid(line, CANDIDATE[0]) && scan.rigid(line, ANTAGONIST[0])) {
        return None;
    }
    let mut side = |[body, contactor, colour]: [usize; 3], what: &str| Side {
        body: scan.name5(line, body, &format!("{what}'s body")),
        contactor: scan.name5(line, contactor, &format!("{what}'s contactor")),
        colour: scan.name5(line, colour, &format!("{what}'s colour")),
    };
    let candidate = side(CANDIDATE, "candidate");
    let antagonist = side(ANTAGONIST, "antagonist");
    let law = scan.name5(line, LAW, "law");
    let alert = scan.length(line, ALERT, "alert");
    Some(See { line: line.number, candidate, law, antagonist, alert })
}

/// Rows that name a law that there is and do not contradict an earlier row, without repetitions.
fn check_rows(scan: &mut Scan, laws: &[Law], rows: Vec<Option<See>>) -> Vec<See> {
    let mut kept: Vec<(usize, See)> = Vec::new();
    for (number, row) in (1..).zip(rows) {
        let Some(row) = row else { continue };
        scan.about(format!("see row {number}"));
        for contactor in [&row.candidate.contactor, &row.antagonist.contactor] {
            if !contactor.is_empty() && !CONTACTORS.contains(&contactor.as_str()) {
                let expected = known_names(contactor, &CONTACTORS);
                scan.fault(row.line, format!("a contactor of type '{contactor}'"), expected);
            }
        }
        if !row.law.is_empty() && laws.iter().all(|law| law.nickname != row.law) {
            let defined: Vec<_> = laws.iter().map(|law| law.nickname.as_str()).collect();
            let expected = match defined.as_slice() {
                [] => "expected a law before it: none is defined".to_string(),
                names => known_names(&row.law, names),
            };
            scan.fault(row.line, format!("law '{}' is not defined", row.law), expected);
        }
        let sides = |row: &See| [row.candidate.clone(), row.antagonist.clone()];
        let [a, b] = sides(&row);
        let earlier = kept.iter().find(|(_, known)| [[&a, &b], [&b, &a]].contains(&sides(known).each_ref()));
        match earlier {
            Some((first, known)) if known.law != row.law => {
                let found = format!("law '{}' for the pair of see row {first}, which has '{}'", row.law, known.law);
                scan.fault(row.line, found, "expected one law for a pair");
            }
            Some((first, known)) if known.alert != row.alert => {
                let found = format!("alert {} for the pair of see row {first}, which has {}", row.alert, known.alert);
                scan.fault(row.line, found, "expected one alert distance for a pair");
            }
            Some(_) => {}
            None => kept.push((number, row)),
        }
    }
    kept.into_iter().map(|(_, row)| row).collect()
}
