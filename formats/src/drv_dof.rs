//! `DATBOX/DRV_DOF.DAT`: velocities, forces and servos that are imposed on bodies, as functions of time.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path;

use crate::atomic::path_exists;
use crate::error::Faults;
use crate::scan::{
    AcceptedDeviation, AsciiText, LineScanner, RealText, TextLine, format_e14, format_integer, format_long14,
    free_real, put_text,
};

/// Driven components, in the order of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DrvDof(pub Vec<DrivenComponent>);

/// One driven component of one body.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenComponent {
    pub line: usize,
    /// 0-based body number (1-based in the file).
    pub body: usize,
    /// 0..2 along the fixed axes, 3..5 about the body's principal axes (1..6 in the file).
    pub component: usize,
    pub kind: DrivenKind,
    pub evolution: Evolution,
}

/// Imposed quantity of a driven component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DrivenKind {
    /// `vlocy`: m/s or rad/s.
    Velocity,
    /// `force`: N or N m.
    Force,
    /// `press`: pressure on the current area of a wall, Pa, > 0 along the positive axis.
    Pressure,
    /// `strai`: rate d ln D/dt of the distance D of a plate from the plate opposite to it, 1/s.
    StrainRate,
    /// `surfv`: velocity of the surface of a wall beyond that of the wall, m/s or rad/s.
    SurfaceVelocity,
    /// `pivot`: coordinate of the point about which a wall turns, m; constant.
    Pivot,
}

impl DrivenKind {
    /// Kinds with their words in columns 2 to 6. LMGC90 knows the first two.
    pub const WORDS: [(&'static str, DrivenKind); 6] = [
        ("vlocy", DrivenKind::Velocity),
        ("force", DrivenKind::Force),
        ("press", DrivenKind::Pressure),
        ("strai", DrivenKind::StrainRate),
        ("surfv", DrivenKind::SurfaceVelocity),
        ("pivot", DrivenKind::Pivot),
    ];

    /// Word in columns 2 to 6.
    pub fn word(self) -> &'static str {
        let row = DrivenKind::WORDS.iter().find(|(_, kind)| *kind == self);
        row.map_or("", |(word, _)| word)
    }

    /// Whether the component of the velocity is imposed.
    pub fn imposes_velocity(self) -> bool {
        matches!(self, DrivenKind::Velocity | DrivenKind::StrainRate)
    }

    /// Number of components that the kind may have.
    fn component_count(self) -> u64 {
        match self {
            DrivenKind::Velocity | DrivenKind::Force | DrivenKind::SurfaceVelocity => 6,
            DrivenKind::Pressure | DrivenKind::StrainRate | DrivenKind::Pivot => 3,
        }
    }

    /// Index of the group of kinds of which a component can have one: 0 motions and loads, 1 surface velocities, 2
    /// pivots.
    fn exclusive_group(self) -> u8 {
        match self {
            DrivenKind::SurfaceVelocity => 1,
            DrivenKind::Pivot => 2,
            _ => 0,
        }
    }
}

/// Function of time.
#[derive(Debug, Clone, PartialEq)]
pub enum Evolution {
    /// (constant + amplitude cos(omega t + phase)) min(1, ramp_start + ramp_rate t)
    Harmonic { constant: f64, amplitude: f64, omega: f64, phase: f64, ramp_start: f64, ramp_rate: f64 },
    /// Points (time, value) by increasing time of the file `name` in DATBOX; linear between them and beyond both ends.
    Table { name: String, points: Vec<[f64; 2]> },
}

impl Evolution {
    /// Constant function.
    pub fn constant(value: f64) -> Self {
        Evolution::Harmonic { constant: value, amplitude: 0.0, omega: 0.0, phase: 0.0, ramp_start: 1.0, ramp_rate: 0.0 }
    }

    /// Whether the value is the same at all times.
    pub fn is_constant(&self) -> bool {
        match self {
            &Evolution::Harmonic { amplitude, omega, ramp_start, ramp_rate, .. } => {
                let is_steady = amplitude == 0.0 || omega == 0.0;
                let has_constant_ramp = ramp_rate == 0.0 || (ramp_rate > 0.0 && ramp_start >= 1.0);
                is_steady && has_constant_ramp
            }
            Evolution::Table { points, .. } => points.iter().all(|point| point[1] == points[0][1]),
        }
    }

    /// Time until which the value at `time` remains, s: `time` itself while it changes, infinite if it never changes again.
    ///
    /// ```
    /// use cd_formats::drv_dof::Evolution;
    /// let gate = Evolution::Table { name: "v.dat".into(), points: vec![[0.0, 0.0], [2.0, 0.0], [3.0, 5.0], [4.0, 5.0]] };
    /// assert_eq!([0.5, 2.5, 3.0].map(|t| gate.constant_until(t)), [2.0, 2.5, f64::INFINITY]);
    /// ```
    pub fn constant_until(&self, time: f64) -> f64 {
        match self {
            _ if self.is_constant() => f64::INFINITY,
            // Only the ramp of a function that changes can end.
            &Evolution::Harmonic { amplitude, omega, ramp_start, ramp_rate, .. } => {
                let is_steady = amplitude == 0.0 || omega == 0.0;
                let has_ramp_ended = ramp_rate > 0.0 && ramp_start + ramp_rate * time >= 1.0;
                if is_steady && has_ramp_ended { f64::INFINITY } else { time }
            }
            Evolution::Table { points, .. } => {
                let Some(last) = points.len().checked_sub(1).filter(|last| *last > 0) else { return f64::INFINITY };
                let first = points.partition_point(|point| point[0] <= time).clamp(1, last);
                // Pieces of the table by their ends; the first and the last extend beyond it.
                let changes = (first..=last).find(|&end| points[end - 1][1] != points[end][1]);
                changes.map_or(f64::INFINITY, |end| if end == first { time } else { points[end - 1][0] })
            }
        }
    }

    /// Largest difference from `value`, in its unit, between the times `from` and `to`, s: exact for a table; for a harmonic an
    /// upper bound for any time after its ramp, which does not hold during the ramp.
    pub fn max_difference(&self, value: f64, [from, to]: [f64; 2]) -> f64 {
        match self {
            Evolution::Harmonic { constant, amplitude, .. } => (constant - value).abs() + amplitude.abs(),
            Evolution::Table { points, .. } => {
                let between = points.iter().filter(|[t, _]| from < *t && *t < to).map(|point| point[1]);
                between.chain([self.value_at(from), self.value_at(to)]).map(|x| (x - value).abs()).fold(0.0, f64::max)
            }
        }
    }

    /// Value at time `t`, s: (constant + amplitude cos(omega t + phase)) min(1, ramp_start + ramp_rate t), or the
    /// straight line through the two points next to `t`.
    ///
    /// A table of one point is constant, one of none gives NaN; readers reject both.
    ///
    /// ```
    /// use cd_formats::drv_dof::Evolution;
    /// let table = Evolution::Table { name: "v.dat".into(), points: vec![[0.0, 1.0], [2.0, 5.0]] };
    /// assert_eq!(table.value_at(1.0), 3.0);
    /// assert_eq!(table.value_at(3.0), 7.0); // beyond the last point
    /// ```
    pub fn value_at(&self, t: f64) -> f64 {
        match self {
            &Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
                (constant + amplitude * libm::cos(omega * t + phase)) * (ramp_start + ramp_rate * t).min(1.0)
            }
            Evolution::Table { points, .. } => match points.as_slice() {
                [] => f64::NAN,
                [point] => point[1],
                points => {
                    let after = points.partition_point(|point| point[0] <= t).clamp(1, points.len() - 1);
                    let ([t0, v0], [t1, v1]) = (points[after - 1], points[after]);
                    v0 + (v1 - v0) * ((t - t0) / (t1 - t0))
                }
            },
        }
    }
}

/// First columns of the six reals: constant, amplitude, omega, phase, start and rate of the ramp.
const HARMONIC_COLUMNS: [usize; 6] = [15, 30, 45, 60, 75, 90];
/// Names of the six reals in the titles.
const HARMONIC_NAMES: [&str; 6] = ["CT", "AMP", "OMEGA", "PHI", "RAMPI", "RAMP"];
/// First and last column of the name of a table.
const TABLE_NAME_COLUMNS: (usize, usize) = (25, 64);
/// Line of titles above the components of a body.
const TITLES: &str =
    "$dofty  numbr [CT......+......AMP..*..cos.(..OMEGA.*.time.+.PHI..)]...*...[RAMPI.....+.....RAMP.*.time]\n";

impl DrvDof {
    /// Reads the file and the tables that it names in the same folder; reports all faults at once. An absent file drives
    /// no body.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        if path_exists(path) { Self::parse(path, &AsciiText::read_file(path)?) } else { Ok(DrvDof::default()) }
    }

    /// Reads the text of a file; `path` is for messages and to find tables. Errors: all faults of the text and of its tables.
    pub fn parse(path: &Path, text: &AsciiText) -> Result<Self, Faults> {
        Ok(Self::parse_with_notices(path, text)?.0)
    }

    /// Reads the text of a file like [`DrvDof::parse`]; also returns notices about deviations from its form.
    pub fn parse_with_notices(path: &Path, text: &AsciiText) -> Result<(Self, Vec<String>), Faults> {
        let scan = &mut LineScanner::new(path, text);
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut components = Vec::new();
        let mut lines_of_bodies = HashMap::new();
        for record in 1.. {
            scan.set_object(format!("record {record}"));
            scan.skip_to_keyword("bdyty");
            if scan.peek_line().is_none() {
                break;
            }
            if read_record(scan, folder, &mut components, &mut lines_of_bodies).is_none() {
                scan.skip_record();
            }
        }
        scan.finish_with_notices(DrvDof(components))
    }

    /// Text of the file, numbers with eight digits; tables are files of their own, see [`table_text`].
    pub fn to_text(&self) -> String {
        self.text_with(format_e14)
    }

    /// Text of the file with as many digits as the columns can hold, see [`format_long14`].
    pub fn to_long_text(&self) -> String {
        self.text_with(format_long14)
    }

    fn text_with(&self, real: fn(f64) -> RealText) -> String {
        let mut out = String::new();
        // One record a body, as LMGC90 uses the last one alone.
        let mut by_body: Vec<&DrivenComponent> = self.0.iter().collect();
        by_body.sort_by_key(|driven| driven.body);
        for driven in by_body.chunk_by(|a, b| a.body == b.body) {
            // Readers use columns 7 to 15. LMGC90's preprocessor writes numbers up to column 13, as is done here while five
            // digits suffice.
            let number = driven[0].body + 1;
            let number = if number > 99_999 { format_integer(number, 9) } else { format_integer(number, 7) };
            let _ = write!(out, "$bdyty\n RBDY3{number}\n$nodty\n NO6xx      1\n{TITLES}");
            for DrivenComponent { component, kind, evolution, .. } in driven {
                let _ = write!(out, " {}  {:5}", kind.word(), component + 1);
                match evolution {
                    &Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
                        let values = [constant, amplitude, omega, phase, ramp_start, ramp_rate];
                        for (value, column) in values.into_iter().zip(HARMONIC_COLUMNS) {
                            put_text(&mut out, column, real(value));
                        }
                    }
                    Evolution::Table { name, .. } => {
                        put_text(&mut out, HARMONIC_COLUMNS[0], "evolution");
                        put_text(&mut out, TABLE_NAME_COLUMNS.0, name);
                    }
                }
                out.push('\n');
            }
            out.push_str("$$$$$$\n");
        }
        out
    }
}

/// Reads one body and appends its driven components to `components`; `None` after a fault that leaves the scan inside the
/// record. `lines_of_bodies`: lines of the bodies so far.
fn read_record(
    scan: &mut LineScanner,
    folder: &Path,
    components: &mut Vec<DrivenComponent>,
    lines_of_bodies: &mut HashMap<usize, usize>,
) -> Option<()> {
    scan.expect_keyword("bdyty")?;
    let line = scan.expect_line("expected RBDY3 and the number of the body", TextLine::is_data)?;
    if !scan.expect_rigid_body(line, 2) {
        return None;
    }
    let body = scan.read_index(line, (7, 15), "number")?;
    scan.set_object(format!("body {}", body + 1));
    if let Some(earlier) = lines_of_bodies.insert(body, line.number) {
        let found = format!("has another record in line {earlier}");
        scan.add_fault(line.number, found, "expected one with all components: LMGC90 uses the last one alone");
    }
    let mut lines_of_components = HashMap::new();
    scan.expect_keyword("nodty")?;
    let node = scan.expect_line("expected NO6xx", |line| line.keyword() == "NO6xx")?;
    if let Some(number) = scan.read_integer(node, (9, 13), "number of the node").filter(|&number| number != 1) {
        scan.add_fault(node.number, format!("the number of the node is {number}"), "expected 1");
    }
    scan.expect_keyword("dofty")?;
    while scan.next_line_if(|line| line.keyword() == "$$$$$").is_none() {
        let line =
            scan.expect_line("expected vlocy, force, press, strai, surfv, pivot or $$$$$$", TextLine::is_data)?;
        let known_kind = DrivenKind::WORDS.iter().find(|(word, _)| *word == line.keyword());
        let Some(&(_, kind)) = known_kind else {
            let found = format!("'{}' is driven", line.keyword().trim());
            scan.add_fault(line.number, found, "expected vlocy, force, press, strai, surfv or pivot in columns 2 to 6");
            continue;
        };
        let component = scan.read_integer(line, (9, 13), "component");
        let evolution = read_evolution(scan, line, folder);
        let (Some(component), Some(evolution)) = (component, evolution) else { continue };
        let count = kind.component_count();
        if !(1..=count).contains(&component) {
            scan.add_fault(line.number, format!("component is {component}"), format!("expected 1 to {count}"));
            continue;
        }
        if kind == DrivenKind::Pivot && !evolution.is_constant() {
            scan.add_fault(line.number, "a pivot that moves", "expected a constant coordinate");
            continue;
        }
        if let Some(earlier) = lines_of_components.insert((kind.exclusive_group(), component), line.number) {
            let found = format!("component {component} is driven already by line {earlier}");
            scan.add_fault(line.number, found, "expected each component once");
        }
        let component = component as usize - 1;
        components.push(DrivenComponent { line: line.number, body, component, kind, evolution });
    }
    Some(())
}

/// Reads the function of time of a component, with its table, a file in `folder`; `None` after a fault.
fn read_evolution(scan: &mut LineScanner, line: TextLine, folder: &Path) -> Option<Evolution> {
    if line.columns(15, 23) != "evolution" {
        let values: [f64; 6] = std::array::from_fn(|k| scan.read_real(line, HARMONIC_COLUMNS[k], HARMONIC_NAMES[k]));
        let [constant, amplitude, omega, phase, ramp_start, ramp_rate] = values;
        return Some(Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate });
    }
    let name = scan.read_name(line, TABLE_NAME_COLUMNS, "name of the table");
    if name.is_empty() {
        return None;
    }
    if name.contains(['/', '\\']) {
        scan.add_fault(line.number, format!("the table is '{name}'"), "expected a file in the folder of this one");
        return None;
    }
    let (points, is_sorted) = scan.gather_result(read_table(&folder.join(&name)))?;
    if !is_sorted {
        scan.add_form(AcceptedDeviation::UnsortedTable, line.number);
    }
    Some(Evolution::Table { name, points })
}

/// Reads the points (time, value) of a table, two numbers a line in any columns; returns them by increasing time, and
/// whether the lines are in that order.
fn read_table(path: &Path) -> Result<(Vec<[f64; 2]>, bool), Faults> {
    let text = AsciiText::read_file(path)?;
    let scan = &mut LineScanner::new(path, &text);
    scan.set_object("table");
    let mut points = Vec::new();
    while let Some(line) = scan.next_line() {
        let words: Vec<_> = line.before_comment().split([' ', '\t', ',']).filter(|word| !word.is_empty()).collect();
        // Free format: an integer is accepted as a real here.
        let numbers: Vec<_> = words.iter().map_while(|word| free_real(word).ok()).collect();
        match numbers.as_slice() {
            &[time, value] if words.len() == 2 => points.push((line.number, [time, value])),
            _ => scan.add_fault(
                line.number,
                format!("'{}'", line.text().trim().escape_default()),
                "expected a time and a value",
            ),
        }
    }
    let is_sorted = points.is_sorted_by(|(_, a), (_, b)| a[0] <= b[0]);
    points.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]));
    for pair in points.windows(2) {
        let [(earlier_line, [earlier_time, _]), (line, [time, _])] = [pair[0], pair[1]];
        if earlier_time == time {
            scan.add_fault(line, format!("time {time} is on line {earlier_line}, too"), "expected each time once");
        }
    }
    if points.len() < 2 {
        scan.add_file_fault(format!("the number of points is {}", points.len()), "expected at least 2");
    }
    scan.finish((points.into_iter().map(|(_, point)| point).collect(), is_sorted))
}

/// Text of a table of an [`Evolution::Table`], with all digits, so that two different times stay different when read
/// again.
pub fn table_text(points: &[[f64; 2]]) -> String {
    points.iter().map(|[time, value]| format!("{time:.16E} {value:.16E}\n")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_table_are_taken_by_increasing_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f.dat");
        let table = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read_table(&path).map_err(|faults| faults.to_string().replace(path.to_str().unwrap(), "f.dat"))
        };
        assert_eq!(table("0 1\n0.5 2.\n").unwrap(), (vec![[0.0, 1.0], [0.5, 2.0]], true));
        assert_eq!(table("0.5 2.\n0 1\n").unwrap(), (vec![[0.0, 1.0], [0.5, 2.0]], false));
        let expected = "f.dat:4: table: time 2 is on line 1, too; expected each time once";
        assert_eq!(table("2 0\n1 0\n3 0\n2 1\n").unwrap_err().trim_end(), expected);
    }

    #[test]
    fn harmonic_and_ramp() {
        let e = Evolution::Harmonic {
            constant: 1.0,
            amplitude: 2.0,
            omega: std::f64::consts::PI,
            phase: 0.0,
            ramp_start: 0.0,
            ramp_rate: 0.5,
        };
        assert_eq!(e.value_at(0.0), 0.0);
        assert!((e.value_at(1.0) + 0.5).abs() < 1e-15); // (1 - 2) / 2
        assert!((e.value_at(2.0) - 3.0).abs() < 1e-15); // the ramp has reached 1
        assert!((e.value_at(4.0) - 3.0).abs() < 1e-14); // and stays there
        assert_eq!(Evolution::constant(0.7).value_at(12.0), 0.7);
        assert_eq!((e.max_difference(0.0, [0.0, 1.0]), e.max_difference(4.0, [0.0, 1.0])), (3.0, 5.0));
    }

    #[test]
    fn bodies_have_one_record() {
        let component = |body: usize, component: usize| DrivenComponent {
            line: 0,
            body,
            component,
            kind: DrivenKind::Force,
            evolution: Evolution::constant(1.0),
        };
        let text = DrvDof(vec![component(1, 0), component(0, 2), component(1, 1)]).to_text();
        let read = |text: &str| DrvDof::parse("DRV_DOF.DAT".as_ref(), &AsciiText::new(text.as_bytes()));
        let order = read(&text).unwrap().0.iter().map(|driven| (driven.body, driven.component)).collect::<Vec<_>>();
        assert_eq!(order, [(0, 2), (1, 0), (1, 1)]);
        let one = DrvDof(vec![component(1, 0)]).to_text();
        let faults = read(&(one + &text)).unwrap_err().to_string();
        let expected = "DRV_DOF.DAT:16: body 2: has another record in line 2; expected one with all components: LMGC90 \
                        uses the last one alone";
        assert_eq!(faults.trim_end(), expected);
    }

    #[test]
    fn tables_are_lines_beyond_both_ends() {
        let e = Evolution::Table { name: "f".into(), points: vec![[1.0, 10.0], [2.0, 20.0], [4.0, 0.0]] };
        for (t, value) in [(0.0, 0.0), (1.0, 10.0), (1.5, 15.0), (2.0, 20.0), (3.0, 10.0), (4.0, 0.0), (5.0, -10.0)] {
            assert_eq!(e.value_at(t), value, "t = {t}");
        }
        assert!(e.value_at(f64::NAN).is_nan());
        let farthest = [[1.0, 4.0], [0.0, 1.5], [3.0, 7.0]].map(|times| e.max_difference(0.0, times));
        assert_eq!(farthest, [20.0, 15.0, 30.0]);
    }
}
