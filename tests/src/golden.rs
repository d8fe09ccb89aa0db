//! The expected files of `tests/golden/SCENE`, and their comparison with those that the programs write now. A stage starts
//! from the expected files of the stage before, so that a failed test concerns one program:
//!
//! ```text
//! input of the stage            expected files
//! scene.ron                     expected/pre/DATBOX/
//! expected/pre/DATBOX/          expected/solve/OUTBOX/
//! expected/solve/OUTBOX/        expected/post/POSTPRO/series.csv  expected/post/DISPLAY/ (with DATBOX)
//! ```
//!
//! Text of cd-pre is compared by its bytes. Numbers of cd-solve and cd-post are compared column by column: a solver that
//! sweeps in another order finds another solution within its tolerance, and functions of the C library, which cd-post
//! calls, differ in the last bits.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::checksums::CHECKSUMS_FILE;

use crate::case::{copy, files, post, pre, solve};
use crate::columns::{Columns, read};

/// Program whose files are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    Pre,
    Solve,
    Post,
}

impl Stage {
    /// The programs in the order in which they run.
    pub const ALL: [Stage; 3] = [Stage::Pre, Stage::Solve, Stage::Post];

    /// Name of its folder of expected files.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Pre => "pre",
            Stage::Solve => "solve",
            Stage::Post => "post",
        }
    }

    /// The folders that its program writes.
    fn folders(self) -> &'static [&'static str] {
        match self {
            Stage::Pre => &["DATBOX"],
            Stage::Solve => &["OUTBOX"],
            Stage::Post => &["POSTPRO", "DISPLAY"],
        }
    }
}

/// The scenes, a folder each.
pub fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden");
    let entries = fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut scenes: Vec<PathBuf> = entries.filter(|path| path.join("scene.ron").is_file()).collect();
    scenes.sort();
    scenes
}

/// The folder of the expected files of a stage.
pub fn expected(scene: &Path, stage: Stage) -> PathBuf {
    scene.join("expected").join(stage.name())
}

/// Runs a stage in the folder `case`, from the expected files of the stage before.
pub fn run(scene: &Path, stage: Stage, case: &Path) {
    let status = match stage {
        Stage::Pre => pre(&scene.join("scene.ron"), case),
        Stage::Solve => {
            copy(&expected(scene, Stage::Pre).join("DATBOX"), &case.join("DATBOX"));
            solve(case, &[])
        }
        Stage::Post => {
            // DATBOX holds the shapes of polyhedra.
            copy(&expected(scene, Stage::Pre).join("DATBOX"), &case.join("DATBOX"));
            copy(&expected(scene, Stage::Solve).join("OUTBOX"), &case.join("OUTBOX"));
            let status = post(case, &["--no-plots"]);
            fs::remove_file(case.join("DISPLAY/view.py")).unwrap(); // names the folder that it lies in
            status
        }
    };
    assert_eq!(status, 0, "{} of {}", stage.name(), scene.display());
    if stage != Stage::Post {
        // Its checksums change with each bit of the others.
        fs::remove_file(case.join(stage.folders()[0]).join(CHECKSUMS_FILE)).unwrap();
    }
}

/// Largest change of a column that is allowed.
#[derive(Clone, Copy)]
pub struct Tolerance {
    pub column: &'static str,
    /// Allowed change in units of the scale.
    pub relative: f64,
    /// Column of the same file whose largest value is the scale, `OWN_MAXIMUM` or `UNIT_SCALE`.
    pub scale: &'static str,
}

const fn allowed_change(column: &'static str, relative: f64, scale: &'static str) -> Tolerance {
    Tolerance { column, relative, scale }
}

/// Relative change of a column that must only exist.
const UNLIMITED: f64 = f64::INFINITY;
/// Scale of a column that is its own largest value.
const OWN_MAXIMUM: &str = "";
/// Scale 1, for pure numbers.
const UNIT_SCALE: &str = "1";

/// Columns that are not named here are exact: numbers of contacts, which bodies touch, stick or slide, time, masses.
///
/// The scenes require a residual of 1e-10, make a few hundred steps and have few contacts at once. The errors that the
/// solver leaves, 1e-10 of the impulses, and round-off, 1e-16, grow by the collisions that follow.
const SOLVE_TOLERANCES: &[Tolerance] = &[
    allowed_change("body_x", 1e-9, OWN_MAXIMUM),
    allowed_change("body_q", 1e-8, UNIT_SCALE),
    allowed_change("body_v", 1e-7, OWN_MAXIMUM),
    allowed_change("body_w", 1e-7, OWN_MAXIMUM),
    allowed_change("body_w_world", 1e-7, OWN_MAXIMUM),
    allowed_change("body_radius", 1e-14, OWN_MAXIMUM), // of plates: a cube root
    allowed_change("contact_point", 1e-9, "body_x"),
    allowed_change("contact_gap", 1e-9, "body_x"),
    allowed_change("contact_frame", 1e-7, UNIT_SCALE),
    // An impulse is a difference of velocities, and where contacts share a load it is worse determined than these.
    allowed_change("contact_force", 1e-6, OWN_MAXIMUM),
    allowed_change("contact_impulse", 1e-6, OWN_MAXIMUM),
    allowed_change("contact_velocity", 1e-7, "body_v"), // zero of contacts that stick: no scale of its own
    allowed_change("contact_area", 1e-7, OWN_MAXIMUM),
    allowed_change("interval_virial", 1e-6, OWN_MAXIMUM), // adds up impulses
    allowed_change("turning_momentum", 1e-7, OWN_MAXIMUM),
    allowed_change("pair_memory", UNLIMITED, OWN_MAXIMUM), // features, but where a direction is remembered its bits
    allowed_change("meta.ledger.energy_start", 1e-12, OWN_MAXIMUM),
    allowed_change("meta.ledger.contact_work", 1e-7, OWN_MAXIMUM),
    allowed_change("meta.ledger.friction_work", 1e-7, "meta.ledger.contact_work"),
    allowed_change("meta.ledger.outside_work", 1e-7, OWN_MAXIMUM),
    allowed_change("meta.ledger.momentum_expected", 1e-7, "meta.ledger.momentum_scale"),
    allowed_change("meta.ledger.angular_momentum_expected", 1e-7, OWN_MAXIMUM),
    allowed_change("meta.ledger.momentum_scale", 1e-7, OWN_MAXIMUM),
    allowed_change("meta.ledger.penetration_largest", 1e-8, UNIT_SCALE),
    allowed_change("meta.ledger.penetration_left", 1e-8, UNIT_SCALE),
    // Another order of the sweeps needs another number of them.
    allowed_change("meta.ledger.sweeps", UNLIMITED, OWN_MAXIMUM),
    allowed_change("sweeps", UNLIMITED, OWN_MAXIMUM),
    allowed_change("contacts_solved", UNLIMITED, OWN_MAXIMUM),
    allowed_change("residual", UNLIMITED, OWN_MAXIMUM), // at most tol where `converged` is 1
    allowed_change("penetration_largest", 1e-8, UNIT_SCALE),
    allowed_change("penetration_mean", UNLIMITED, OWN_MAXIMUM), // of the contacts with a gap below 0, which round-off decides for those that touch
    allowed_change("virial", 1e-6, OWN_MAXIMUM),                // adds up impulses
    allowed_change("flight_error", 1e-20, UNIT_SCALE), // exact under uniform gravity: what is left is round-off, squared
    allowed_change("kinetic_energy", 1e-7, OWN_MAXIMUM),
    allowed_change("rotational_energy", 1e-7, OWN_MAXIMUM),
    allowed_change("potential_energy", 1e-9, OWN_MAXIMUM),
    allowed_change("contact_work", 1e-7, OWN_MAXIMUM),
    allowed_change("friction_work", 1e-7, "contact_work"),
    allowed_change("outside_work", 1e-7, OWN_MAXIMUM),
    allowed_change("momentum_drift", 1e-12, UNIT_SCALE), // round-off itself
    allowed_change("gravity_removed", 1e-12, UNIT_SCALE),
];

/// cd-post adds up values of the snapshots: round-off of sums.
const POST_TOLERANCE: f64 = 1e-12;

fn tolerance(stage: Stage, file: &str, column: &str) -> Tolerance {
    let exact = allowed_change("", 0.0, UNIT_SCALE);
    match stage {
        Stage::Pre => exact,
        Stage::Solve => SOLVE_TOLERANCES.iter().find(|tolerance| tolerance.column == column).copied().unwrap_or(exact),
        Stage::Post if file.ends_with(".pvd") => exact,
        Stage::Post => allowed_change("", POST_TOLERANCE, OWN_MAXIMUM),
    }
}

/// Change of a column of a file.
#[derive(Debug, Clone)]
pub struct Change {
    pub file: String,
    pub column: String,
    /// Largest |found - expected|; infinite where the two cannot be compared.
    pub largest: f64,
    /// Largest value of the column of the scale, see [`Tolerance`].
    pub scale: f64,
    /// Largest change that is allowed.
    pub allowed: f64,
    /// Reason why the two cannot be compared; empty if they can.
    pub note: String,
}

impl Change {
    /// Whether the largest change is within the allowed one.
    pub fn is_allowed(&self) -> bool {
        self.largest <= self.allowed
    }
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Change { file, column, largest, scale, allowed, note } = self;
        write!(f, "{file}: {column}: ")?;
        if note.is_empty() {
            write!(f, "{largest:.2e} off, largest value {scale:.2e}; {allowed:.2e} allowed")
        } else {
            write!(f, "{note}")
        }
    }
}

/// Every column of every file of a stage whose values are not the same, allowed or not.
pub fn changes(stage: Stage, expected: &Path, found: &Path) -> Vec<Change> {
    let mut changes = Vec::new();
    for folder in stage.folders() {
        let names = |root: &Path| files(&root.join(folder)).into_iter().collect::<BTreeSet<_>>();
        for name in names(expected).union(&names(found)) {
            let file = format!("{folder}/{name}");
            match (read(&expected.join(&file)), read(&found.join(&file))) {
                (Ok(old), Ok(new)) => changes.extend(changed_columns(stage, &file, &old, &new)),
                (Err(_), Ok(_)) => changes.push(incomparable(&file, "file", "is new")),
                (_, Err(error)) => changes.push(incomparable(&file, "file", &error)),
            }
        }
    }
    changes
}

/// Change of a column, or of a whole file, that cannot be compared, for the reason `note`.
fn incomparable(file: &str, column: &str, note: &str) -> Change {
    let (file, column, note) = (file.to_string(), column.to_string(), note.to_string());
    Change { file, column, largest: f64::INFINITY, scale: 0.0, allowed: 0.0, note }
}

/// Changes of the columns of a file whose values are not the same.
fn changed_columns(stage: Stage, file: &str, expected: &Columns, found: &Columns) -> Vec<Change> {
    let names: BTreeSet<&String> = expected.keys().chain(found.keys()).collect();
    let change_of = |name: &String| match (expected.get(name), found.get(name)) {
        (None, _) => Some(incomparable(file, name, "is new")),
        (_, None) => Some(incomparable(file, name, "is gone")),
        (Some(a), Some(b)) if name == "text" => (a != b).then(|| incomparable(file, name, &first_difference(a, b))),
        (Some(a), Some(b)) if a.len() != b.len() => {
            Some(incomparable(file, name, &format!("{} values, expected {}", b.len(), a.len())))
        }
        (Some(a), Some(b)) => {
            let Tolerance { relative, scale, .. } = tolerance(stage, file, name);
            let scale = match scale {
                UNIT_SCALE => 1.0,
                OWN_MAXIMUM => magnitude(a),
                other => expected.get(other).map_or(0.0, |column| magnitude(column)),
            };
            let largest = a.iter().zip(b).map(|(x, y)| difference(*x, *y)).fold(0.0, f64::max);
            let allowed = if relative == UNLIMITED { UNLIMITED } else { relative * scale };
            let (file, column, note) = (file.to_string(), name.clone(), String::new());
            (largest != 0.0).then_some(Change { file, column, largest, scale, allowed, note })
        }
    };
    names.into_iter().filter_map(change_of).collect()
}

/// Largest magnitude of the values that are defined.
fn magnitude(column: &[f64]) -> f64 {
    column.iter().filter(|x| !x.is_nan()).fold(0.0, |largest: f64, x| largest.max(x.abs()))
}

/// Difference of two values: 0 if both are undefined, infinite if one is.
fn difference(a: f64, b: f64) -> f64 {
    match (a.is_nan(), b.is_nan()) {
        (true, true) => 0.0,
        (false, false) => (a - b).abs(),
        _ => f64::INFINITY,
    }
}

/// The first line in which two texts, given as the numbers of their bytes, differ.
fn first_difference(expected: &[f64], found: &[f64]) -> String {
    let text = |numbers: &[f64]| {
        let bytes: Vec<u8> = numbers.iter().map(|number| *number as u8).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    let (expected, found) = (text(expected), text(found));
    let (mut expected_lines, mut found_lines) = (expected.lines(), found.lines());
    for number in 1.. {
        match (expected_lines.next(), found_lines.next()) {
            (None, None) => break,
            (expected, found) if expected != found => {
                let (expected, found) = (expected.unwrap_or("no more"), found.unwrap_or("missing"));
                return format!("line {number}: {found}; expected {expected}");
            }
            _ => {}
        }
    }
    "the ends of lines differ".into()
}

/// Makes the expected files of a scene anew, stage by stage; returns a table of the largest change of each column.
///
/// The files of a stage in which every change is allowed stay, so that another machine's round-off is no change. A stage
/// without expected files is made in any case.
pub fn rewrite(scene: &Path) -> String {
    let mut report = format!("{}\n", scene.file_name().unwrap_or_default().display());
    for stage in Stage::ALL {
        let case = tempfile::tempdir().unwrap();
        run(scene, stage, case.path());
        let expected = expected(scene, stage);
        let changes = changes(stage, &expected, case.path());
        report += &table(stage, &changes);
        if changes.iter().all(Change::is_allowed) {
            continue;
        }
        for folder in stage.folders() {
            let (old, new) = (expected.join(folder), case.path().join(folder));
            for removed in files(&old).iter().filter(|name| !new.join(name).exists()) {
                fs::remove_file(old.join(removed)).unwrap();
            }
            copy(&new, &old);
        }
    }
    report
}

/// The largest change of each column over the files of a stage.
fn table(stage: Stage, changes: &[Change]) -> String {
    // The largest change and the number of changes of each column of each kind of files.
    let mut columns: BTreeMap<(String, &String), (&Change, usize)> = BTreeMap::new();
    for change in changes {
        let kind = change.file.replace(char::is_numeric, ""); // snapshots of all steps together
        let (largest, count) = columns.entry((kind, &change.column)).or_insert((change, 0));
        *count += 1;
        if change.largest > largest.largest {
            *largest = change;
        }
    }
    if columns.is_empty() {
        return format!("  {:<6} nothing has changed\n", stage.name());
    }
    let verdict = if changes.iter().all(Change::is_allowed) { "all allowed, files kept" } else { "files made anew" };
    let mut text = format!("  {:<6} largest change of each column; {verdict}\n", stage.name());
    for ((_, column), (change, count)) in columns {
        let Change { file, largest, scale, allowed, note, .. } = change;
        let description = if note.is_empty() {
            format!("{largest:9.2e} of {scale:8.2e}, {allowed:8.2e} allowed")
        } else {
            note.clone()
        };
        let mark = if change.is_allowed() { ' ' } else { '!' };
        text += &format!("  {mark} {column:<36} {description}   {file}, {count} in all\n");
    }
    text
}
