//! `DATBOX/TACT_BEHAV.DAT`: contact laws with their parameters, and the visibility table, which has the law of each pair of
//! contactors and colours.

use std::collections::{HashMap, HashSet};
use std::fmt::Write;
use std::path::Path;

use crate::error::{Fault, Faults};
use crate::law_table::{FileLimit, LawEntry, LawError, LawModel, law_entry, rejection_reason};
use crate::ron_text::known_names;
use crate::scan::{
    AcceptedDeviation, AsciiText, LineScanner, RealText, TextLine, format_e14, format_long14, fortran_real, put_text,
};
use crate::words::{CONTACTOR_TYPES, is_foreign_row};

/// Content of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TactBehav {
    pub laws: Vec<LawRecord>,
    /// Rows of the visibility table (`$seety`); contactors of pairs without a row do not touch.
    pub visibility: Vec<VisibilityRow>,
}

/// Contact law with its parameters in the order of the file, e.g. RST_CLB: e_n, e_t, mu.
#[derive(Debug, Clone, PartialEq)]
pub struct LawRecord {
    /// Line of the law, 1-based; 0 for a law that is not from a file.
    pub line: usize,
    /// Nickname, five characters, trimmed.
    pub nickname: String,
    /// Kind, e.g. `IQS_CLB`.
    pub kind: String,
    pub parameters: Vec<f64>,
}

impl LawRecord {
    /// Law of the table with these parameters; an error if the programs do not compute with it.
    pub fn model(&self) -> Result<LawModel, LawError> {
        LawModel::from_values(&self.kind, &self.parameters)
    }
}

/// One row of the visibility table.
#[derive(Debug, Clone, PartialEq)]
pub struct VisibilityRow {
    pub line: usize,
    pub candidate: VisibilitySide,
    /// Nickname of the law.
    pub law: String,
    pub antagonist: VisibilitySide,
    /// Alert distance, m, surface to surface.
    pub alert: f64,
}

impl VisibilityRow {
    /// Both contactors with their colours, for messages: `SPHER BLUEx and PLANx FLOOR`.
    pub fn pair_name(&self) -> String {
        let [a, b] = [&self.candidate, &self.antagonist];
        format!("{} {} and {} {}", a.contactor, a.colour, b.contactor, b.colour)
    }
}

/// One side of a row; the names are five characters, trimmed.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VisibilitySide {
    /// Kind of body, `RBDY3`.
    pub body: String,
    /// Contactor, `SPHER`, `PLANx` ...
    pub contactor: String,
    pub colour: String,
}

/// First columns of the parameters of a line.
const PARAMETER_COLUMNS: [usize; 2] = [46, 67];

/// First columns of body, contactor and colour of the candidate in a row of the visibility table.
const CANDIDATE_COLUMNS: [usize; 3] = [2, 9, 16];
/// First column of the law in a row.
const LAW_COLUMN: usize = 23;
/// First columns of body, contactor and colour of the antagonist in a row.
const ANTAGONIST_COLUMNS: [usize; 3] = [30, 37, 44];
/// First column of the alert distance in a row.
const ALERT_COLUMN: usize = 55;

/// Line of titles above a row.
const TABLE_TITLES: &str = " cdbdy  cdtac  cdcol  behav  anbdy  antac  ancol       alert";

/// Comment of a file without laws, to distinguish it from one that is empty by mistake, with which all bodies would pass
/// through each other.
const NO_LAWS: &str = "! no contact laws";

/// Start of the comments of [`TactBehav::no_law_comment`].
const NO_LAW_PREFIX: &str = "! no law: ";

impl TactBehav {
    /// Reads the file; reports all its faults at once.
    ///
    /// Lines outside laws and rows are skipped, as in LMGC90, unless they look like a row, or like a law that a row names. A row
    /// that repeats an earlier one is dropped. The halo line (`+`) is not kept.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &AsciiText::read_file(path)?)
    }

    /// Reads the text of a file; `path` is for messages. A row with a law that is not defined is a fault.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        let (tact, _) = Self::parse_with_notices(path, text)?;
        tact.check_laws(path, |_| true).into_result(tact)
    }

    /// Reads the text of a file like [`TactBehav::parse`]; also returns notices about deviations from its form.
    ///
    /// Laws of unknown kind are kept without parameters; rows for 2D and deformable bodies are left out. Whether the laws of
    /// rows are defined is not checked, see [`TactBehav::check_laws`].
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        let scan = &mut LineScanner::new(path, text);
        let mut laws: Vec<LawRecord> = Vec::new();
        let mut law_names = HashSet::new();
        // Rows with their numbers, from 1, and the number of rows with those that have faults.
        let (mut rows, mut row_count) = (Vec::new(), 0);
        // Lines like those of laws without `$behav`, which LMGC90 skips.
        let mut skipped_laws = Vec::new();
        while let Some(begin) = scan.next_line() {
            match begin.keyword() {
                "behav" => {
                    scan.set_object(format!("law {}", laws.len() + 1));
                    let Some(law) = read_law(scan) else { continue };
                    if !law.nickname.is_empty() && !law_names.insert(law.nickname.clone()) {
                        scan.add_fault(
                            law.line,
                            format!("'{}' is defined twice", law.nickname),
                            "expected each name once",
                        );
                    }
                    laws.push(law);
                }
                "seety" => {
                    row_count += 1;
                    scan.set_object(format!("visibility row {row_count}"));
                    rows.extend(read_row(scan).map(|row| (row_count, row)));
                }
                "RBDY3" => {
                    row_count += 1;
                    scan.set_object(format!("visibility row {row_count}"));
                    scan.add_fault(
                        begin.number,
                        "a row that LMGC90 would skip",
                        "expected $seety and a line of titles before",
                    );
                }
                _ if begin.is_data() && names_law(begin) => skipped_laws.push(begin),
                // Rows may have a line with a halo.
                _ if begin.is_data() && begin.text().starts_with('+') => {}
                _ if begin.is_data() => scan.add_form(AcceptedDeviation::OutsideLine, begin.number),
                _ => scan.reject_unknown_keyword(begin, "expected $behav or $seety"),
            }
        }
        if laws.is_empty() && row_count == 0 && !text.lines().any(|line| line.text().starts_with(NO_LAWS)) {
            let expected = format!("expected a $behav for each law; a file without laws says so by a line '{NO_LAWS}'");
            scan.add_file_fault("no contact laws", expected);
        }
        // LMGC90 stops at rows that name such a law.
        let named_laws: HashSet<String> = rows.iter().map(|(_, row): &(_, VisibilityRow)| row.law.clone()).collect();
        for line in skipped_laws {
            if named_laws.contains(line.columns(2, 6).trim()) {
                scan.set_object("file");
                scan.add_fault(line.number, "a law that LMGC90 would skip", "expected $behav before it, from column 1");
            } else {
                scan.add_form(AcceptedDeviation::OutsideLine, line.number);
            }
        }
        let visibility = check_rows(scan, rows);
        scan.finish_with_notices(TactBehav { laws, visibility })
    }

    /// Faults of rows with a law that is not defined, where `is_needed`.
    pub fn check_laws(&self, path: &Path, is_needed: impl Fn(&VisibilityRow) -> bool) -> Faults {
        let defined: Vec<_> = self.laws.iter().map(|law| law.nickname.as_str()).collect();
        let mut faults = Faults::default();
        for row in self.rows_without_law().filter(|row| is_needed(row)) {
            let expected = match defined.as_slice() {
                [] => "expected a law before it: none is defined".to_string(),
                names => known_names(&row.law, names),
            };
            let found = format!("law '{}' is not defined", row.law);
            faults.push(Fault::new(path, Some(row.line), row.pair_name(), found, expected));
        }
        faults
    }

    /// Rows with a law that is not defined.
    pub fn rows_without_law(&self) -> impl Iterator<Item = &VisibilityRow> {
        let names: HashSet<&str> = self.laws.iter().map(|law| law.nickname.as_str()).collect();
        self.visibility.iter().filter(move |row| !row.law.is_empty() && !names.contains(row.law.as_str()))
    }

    /// Text of the file, numbers with eight digits.
    ///
    /// Names must have at most five characters. A law of a kind that is not in
    /// [`LAW_TABLE`](crate::law_table::LAW_TABLE) is written with its parameters one a line.
    pub fn to_text(&self) -> String {
        self.text_with(format_e14)
    }

    /// Comment of the file that two colours have no law on purpose.
    pub fn no_law_comment(a: &str, b: &str) -> String {
        format!("{NO_LAW_PREFIX}{a} {b}\n")
    }

    /// Pairs of colours in the comments of [`TactBehav::no_law_comment`].
    ///
    /// ```
    /// use cd_formats::tact_behav::TactBehav;
    /// let text = format!("$behav\n{}", TactBehav::no_law_comment("BLUEx", "BOULD"));
    /// assert_eq!(TactBehav::colour_pairs_without_law(&text), [["BLUEx", "BOULD"]]);
    /// ```
    pub fn colour_pairs_without_law(text: &str) -> Vec<[String; 2]> {
        let pair = |line: &str| {
            let (a, b) = line.strip_prefix(NO_LAW_PREFIX)?.trim_end().split_once(' ')?;
            Some([a, b].map(str::to_string))
        };
        text.lines().filter_map(pair).collect()
    }

    /// Text of the file with as many digits as the columns can hold, see [`format_long14`].
    pub fn to_long_text(&self) -> String {
        self.text_with(format_long14)
    }

    fn text_with(&self, real: fn(f64) -> RealText) -> String {
        let mut out = String::new();
        if self.laws.is_empty() && self.visibility.is_empty() {
            out += &format!("{NO_LAWS}\n");
        }
        for LawRecord { nickname, kind, parameters: values, .. } in &self.laws {
            let _ = write!(out, "$behav\n {nickname:<5}  {kind}");
            let labels = |entry: &LawEntry| -> Vec<Vec<&str>> {
                entry.lines.iter().map(|line| line.iter().map(|parameter| parameter.label()).collect()).collect()
            };
            let lines = law_entry(kind).map_or_else(|| vec![vec!["parm"]; values.len()], labels);
            let mut values = values.iter();
            for (k, labels) in lines.iter().enumerate() {
                if k > 0 {
                    out.push('\n');
                }
                for ((label, value), column) in labels.iter().zip(&mut values).zip(PARAMETER_COLUMNS) {
                    put_text(&mut out, column - 5, format_args!("{label:<4}={}", real(*value)));
                }
            }
            out.push('\n');
        }
        for VisibilityRow { candidate, law, antagonist, alert, .. } in &self.visibility {
            let _ = write!(out, "$seety\n{TABLE_TITLES}\n");
            for (side, columns) in [(candidate, CANDIDATE_COLUMNS), (antagonist, ANTAGONIST_COLUMNS)] {
                if columns == ANTAGONIST_COLUMNS {
                    put_text(&mut out, LAW_COLUMN, law);
                }
                for (name, column) in [&side.body, &side.contactor, &side.colour].into_iter().zip(columns) {
                    put_text(&mut out, column, name);
                }
            }
            put_text(&mut out, ALERT_COLUMN, real(*alert));
            out.push('\n');
        }
        out
    }
}

/// Reads the law after `$behav`; its parameters are left empty if its kind is not known.
fn read_law(scan: &mut LineScanner) -> Option<LawRecord> {
    let first = scan.expect_line("expected a law", TextLine::is_data)?;
    let nickname = scan.read_name5(first, 2, "nickname");
    let kind = scan.read_name(first, (9, 38), "kind");
    scan.set_object(format!("law '{nickname}'"));
    let mut law = LawRecord { line: first.number, nickname, kind, parameters: Vec::new() };
    let Some(&LawEntry { lines, .. }) = law_entry(&law.kind) else {
        // The law is rejected where a contact needs it.
        while scan.next_line_if(|line| line.is_data() && !names_law(line)).is_some() {}
        return Some(law);
    };
    let mut line = first;
    for (k, parameters) in lines.iter().enumerate() {
        let labels: Vec<&str> = parameters.iter().map(|parameter| parameter.label()).collect();
        if k > 0 {
            let what = format!("{} of {}", labels.join(" "), law.kind);
            let Some(next) = scan.expect_continuation(&what) else { break };
            line = next;
        }
        for (parameter, column) in parameters.iter().zip(PARAMETER_COLUMNS) {
            let value = match parameter.file_limit() {
                FileLimit::NonNegative => scan.read_length(line, column, parameter.label()),
                FileLimit::Finite => scan.read_real(line, column, parameter.label()),
            };
            law.parameters.push(value);
        }
        // LMGC90 would ignore further parameters.
        if let Some(&first) = PARAMETER_COLUMNS.get(labels.len()).filter(|&&first| has_real(line, first)) {
            let found = format!("a parameter in columns {first} to {}", first + 13);
            scan.add_fault(
                line.number,
                found,
                format!("expected {} alone on this line of {}", labels.join(" "), law.kind),
            );
        }
    }
    if let Some(continuation) = scan.next_line_if(|line| line.is_continuation() && has_real(line, PARAMETER_COLUMNS[0]))
    {
        let found = format!("one more line of parameters than {} has", law.kind);
        scan.add_fault(continuation.number, found, format!("expected {}", lines.len()));
    }
    Some(law)
}

/// Whether a line has the name of a law in its columns.
fn names_law(line: TextLine) -> bool {
    let kind = line.columns(9, 38).split_ascii_whitespace().next().unwrap_or("");
    !line.is_continuation() && (law_entry(kind).is_some() || rejection_reason(kind).is_some())
}

/// Whether the 14 columns from `first` have a real.
fn has_real(line: TextLine, first: usize) -> bool {
    line.before_comment().len() >= first && fortran_real(line.columns(first, first + 13)).is_ok()
}

/// Reads the row after `$seety`.
fn read_row(scan: &mut LineScanner) -> Option<VisibilityRow> {
    let title = scan.expect_line("expected a line of titles, then a row", TextLine::is_data)?;
    let line = if title.keyword() == "RBDY3" && scan.follows_indented_comment(title) {
        title
    } else if title.keyword() == "RBDY3" {
        scan.add_fault(title.number, "a row that LMGC90 would skip", "expected a line of titles between $seety and it");
        title
    } else {
        scan.expect_line("expected a row of the visibility table", TextLine::is_data)?
    };
    let name = |first: usize| line.columns(first, first + 4);
    let sides = [CANDIDATE_COLUMNS, ANTAGONIST_COLUMNS].map(|[body, contactor, _]| [name(body), name(contactor)]);
    if is_foreign_row(sides) {
        scan.add_form(AcceptedDeviation::ForeignRow, line.number);
        return None;
    }
    if !(scan.expect_rigid_body(line, CANDIDATE_COLUMNS[0]) && scan.expect_rigid_body(line, ANTAGONIST_COLUMNS[0])) {
        return None;
    }
    let mut read_side = |[body, contactor, colour]: [usize; 3], side_name: &str| VisibilitySide {
        body: scan.read_name5(line, body, &format!("{side_name}'s body")),
        contactor: scan.read_name5(line, contactor, &format!("{side_name}'s contactor")),
        colour: scan.read_name5(line, colour, &format!("{side_name}'s colour")),
    };
    let candidate = read_side(CANDIDATE_COLUMNS, "candidate");
    let antagonist = read_side(ANTAGONIST_COLUMNS, "antagonist");
    let law = scan.read_name5(line, LAW_COLUMN, "law");
    let alert = scan.read_length(line, ALERT_COLUMN, "alert");
    Some(VisibilityRow { line: line.number, candidate, law, antagonist, alert })
}

/// Rows that do not contradict an earlier row, without repetitions.
fn check_rows(scan: &mut LineScanner, rows: Vec<(usize, VisibilityRow)>) -> Vec<VisibilityRow> {
    // Rows with their numbers, from 1.
    let mut distinct_rows: Vec<(usize, VisibilityRow)> = Vec::new();
    // Index of the row of each pair of sides, in either order.
    let mut rows_of_pairs: HashMap<[VisibilitySide; 2], usize> = HashMap::new();
    for (number, row) in rows {
        scan.set_object(format!("visibility row {number}"));
        for contactor in [&row.candidate.contactor, &row.antagonist.contactor] {
            if !contactor.is_empty() && !CONTACTOR_TYPES.contains(&contactor.as_str()) {
                // Rows that name SPHEb have no effect.
                let names: Vec<&str> = CONTACTOR_TYPES.into_iter().filter(|name| *name != "SPHEb").collect();
                scan.add_unknown_name(row.line, format!("a contactor of type '{contactor}'"), contactor, &names);
            }
        }
        let sides = |row: &VisibilityRow| [row.candidate.clone(), row.antagonist.clone()];
        let [a, b] = sides(&row);
        let pair = if a <= b { [a, b] } else { [b, a] };
        match rows_of_pairs.get(&pair).map(|&index| &distinct_rows[index]) {
            Some((first, known)) if known.law != row.law => {
                let found =
                    format!("law '{}' for the pair of visibility row {first}, which has '{}'", row.law, known.law);
                scan.add_fault(row.line, found, "expected one law for a pair");
            }
            Some((first, known)) if known.alert != row.alert => {
                let found =
                    format!("alert {} for the pair of visibility row {first}, which has {}", row.alert, known.alert);
                scan.add_fault(row.line, found, "expected one alert distance for a pair");
            }
            Some(_) => {}
            None => {
                rows_of_pairs.insert(pair, distinct_rows.len());
                distinct_rows.push((number, row));
            }
        }
    }
    distinct_rows.into_iter().map(|(_, row)| row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_behind_a_law_is_skipped_but_no_law() {
        let read = |text: &str| TactBehav::parse_with_notices(Path::new("T"), &AsciiText::new(text.as_bytes()));
        let fields = |name: &str, kind: &str| format!(" {name}  {kind:<29}  fric= 3.0000000E-01\n");
        let law = format!("$behav\n{}", fields("iqsc0", "IQS_CLB"));
        let (tact, notices) = read(&format!("{law}iqsc is quasi-static\n    friction of wet sand\n")).unwrap();
        assert_eq!(tact.laws.len(), 1);
        assert_eq!(notices, ["T:3: 2 lines outside of the records are skipped"]);
        let row =
            format!("$seety\n{TABLE_TITLES}\n RBDY3  SPHER  BLUEx  iqsc1  RBDY3  SPHER  BLUEx       1.0000000E-02\n");
        let other = format!("$behav\n{}{:40}alpha= 2.0\n", fields("xxx01", "NO_SUCH_LAW"), "");
        for kind in ["IQS_CLB", "IQS_BW_CLB"] {
            let second = fields("iqsc1", kind);
            // Also behind one that is not computed, whose parameters are not read.
            for (before, line) in [(&law, 3), (&other, 4)] {
                let (tact, notices) = read(&format!("{before}{second}")).unwrap();
                assert_eq!(tact.laws.len(), 1);
                assert_eq!(notices, [format!("T:{line}: 1 line outside of the records is skipped")]);
                let refused = read(&format!("{before}{second}{row}")).unwrap_err().to_string();
                let expected = "a law that LMGC90 would skip; expected $behav before it, from column 1";
                assert_eq!(refused, format!("T:{line}: file: {expected}"));
            }
        }
    }
}
