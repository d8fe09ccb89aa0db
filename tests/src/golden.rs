//! The expected files of `tests/golden/SCENE`: a stage starts from the expected files of the stage before, so that
//! one red test is one stage.
//!
//! ```text
//! scene.ron                     expected/pre/DATBOX/
//! expected/pre/DATBOX/          expected/solve/OUTBOX/
//! expected/solve/OUTBOX/        expected/post/POSTPRO/series.csv  expected/post/DISPLAY/ (with DATBOX)
//! ```
//!
//! Text of cd-pre is compared by its bytes. Numbers of cd-solve and cd-post are compared column by column: a solver that
//! sweeps in another order ends elsewhere within its tolerance, and functions of the C library, which cd-post calls, differ
//! in the last bits.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

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
            // The shapes of polyhedra stand in DATBOX.
            copy(&expected(scene, Stage::Pre).join("DATBOX"), &case.join("DATBOX"));
            copy(&expected(scene, Stage::Solve).join("OUTBOX"), &case.join("OUTBOX"));
            let status = post(case, &["--no-plots"]);
            fs::remove_file(case.join("DISPLAY/view.py")).unwrap(); // names the folder that it lies in
            status
        }
    };
    assert_eq!(status, 0, "{} of {}", stage.name(), scene.display());
}

/// How far a column may be off: `relative` times the largest value of the column `scale` (of the same file; without a
/// name, its own).
pub struct Tolerance {
    pub column: &'static str,
    pub relative: f64,
    pub scale: &'static str,
}

const fn within(column: &'static str, relative: f64, scale: &'static str) -> Tolerance {
    Tolerance { column, relative, scale }
}

/// Not compared, only that it is there.
const ANY: f64 = f64::INFINITY;
/// Scale of pure numbers.
const ONE: &str = "1";

/// Columns that are not named here are exact: numbers of contacts, which bodies touch, stick or slide, time, masses.
///
/// The scenes require a residual of 1e-10, make a few hundred steps and have few contacts at once. What the
/// solver leaves, 1e-10 of the impulses, and round-off, 1e-16, grow by the collisions that follow.
const SOLVE: &[Tolerance] = &[
    within("body_x", 1e-9, ""),
    within("body_q", 1e-8, ONE),
    within("body_v", 1e-7, ""),
    within("body_w", 1e-7, ""),
    within("body_w_world", 1e-7, ""),
    within("body_radius", 1e-14, ""), // of plates: a cube root
    within("contact_point", 1e-9, "body_x"),
    within("contact_gap", 1e-9, "body_x"),
    within("contact_frame", 1e-7, ONE),
    // An impulse is a difference of velocities, and where contacts share a load it is worse determined than these.
    within("contact_force", 1e-6, ""),
    within("contact_impulse", 1e-6, ""),
    within("contact_velocity", 1e-7, "body_v"), // zero of contacts that stick: no scale of its own
    within("contact_area", 1e-7, ""),
    within("interval_virial", 1e-6, ""), // adds up impulses
    within("turning_momentum", 1e-7, ""),
    within("pair_memory", ANY, ""), // features, but where a direction is remembered its bits
    within("meta.ledger.energy_start", 1e-12, ""),
    within("meta.ledger.contact_work", 1e-7, ""),
    within("meta.ledger.friction_work", 1e-7, "meta.ledger.contact_work"),
    within("meta.ledger.outside_work", 1e-7, ""),
    within("meta.ledger.momentum_expected", 1e-7, "meta.ledger.momentum_scale"),
    within("meta.ledger.angular_momentum_expected", 1e-7, ""),
    within("meta.ledger.momentum_scale", 1e-7, ""),
    within("meta.ledger.penetration_largest", 1e-8, ONE),
    within("meta.ledger.penetration_left", 1e-8, ONE),
    // How the solver gets there is its own affair.
    within("meta.ledger.sweeps", ANY, ""),
    within("sweeps", ANY, ""),
    within("contacts_solved", ANY, ""),
    within("residual", ANY, ""), // at most tol where `converged` is 1
    within("penetration_largest", 1e-8, ONE),
    within("penetration_mean", ANY, ""), // of the contacts with a gap below 0, which round-off decides for those that touch
    within("virial", 1e-6, ""),          // adds up impulses
    within("flight_error", 1e-20, ONE),  // exact under uniform gravity: what is left is round-off, squared
    within("kinetic_energy", 1e-7, ""),
    within("rotational_energy", 1e-7, ""),
    within("potential_energy", 1e-9, ""),
    within("contact_work", 1e-7, ""),
    within("friction_work", 1e-7, "contact_work"),
    within("outside_work", 1e-7, ""),
    within("momentum_drift", 1e-12, ONE), // round-off itself
    within("gravity_removed", 1e-12, ONE),
];

/// cd-post adds up values of the snapshots: round-off of sums.
const POST: f64 = 1e-12;

fn tolerance(stage: Stage, file: &str, column: &str) -> Tolerance {
    let exact = within("", 0.0, ONE);
    match stage {
        Stage::Pre => exact,
        Stage::Solve => SOLVE.iter().find(|t| t.column == column).map_or(exact, |t| Tolerance { ..*t }),
        Stage::Post if file.ends_with(".pvd") => exact,
        Stage::Post => within("", POST, ""),
    }
}

/// Change of a column of a file.
#[derive(Debug, Clone)]
pub struct Change {
    pub file: String,
    pub column: String,
    /// Largest |found - expected|; infinite where the two cannot be compared.
    pub largest: f64,
    /// The largest value that it is relative to.
    pub scale: f64,
    pub allowed: f64,
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
        match note.is_empty() {
            true => write!(f, "{largest:.2e} off, largest value {scale:.2e}; {allowed:.2e} allowed"),
            false => write!(f, "{note}"),
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
                (Ok(old), Ok(new)) => changes.extend(compare(stage, &file, &old, &new)),
                (Err(_), Ok(_)) => changes.push(incomparable(&file, "file", "is new")),
                (_, Err(error)) => changes.push(incomparable(&file, "file", &error)),
            }
        }
    }
    changes
}

fn incomparable(file: &str, column: &str, note: &str) -> Change {
    let (file, column, note) = (file.to_string(), column.to_string(), note.to_string());
    Change { file, column, largest: f64::INFINITY, scale: 0.0, allowed: 0.0, note }
}

fn compare(stage: Stage, file: &str, expected: &Columns, found: &Columns) -> Vec<Change> {
    let names: BTreeSet<&String> = expected.keys().chain(found.keys()).collect();
    let of = |name: &String| match (expected.get(name), found.get(name)) {
        (None, _) => Some(incomparable(file, name, "is new")),
        (_, None) => Some(incomparable(file, name, "is gone")),
        (Some(a), Some(b)) if name == "text" => (a != b).then(|| incomparable(file, name, &first_difference(a, b))),
        (Some(a), Some(b)) if a.len() != b.len() => {
            Some(incomparable(file, name, &format!("{} values, expected {}", b.len(), a.len())))
        }
        (Some(a), Some(b)) => {
            let Tolerance { relative, scale, .. } = tolerance(stage, file, name);
            let scale = match scale {
                ONE => 1.0,
                "" => magnitude(a),
                other => expected.get(other).map_or(0.0, |column| magnitude(column)),
            };
            let largest = a.iter().zip(b).map(|(x, y)| difference(*x, *y)).fold(0.0, f64::max);
            let allowed = if relative == ANY { ANY } else { relative * scale };
            let (file, column, note) = (file.to_string(), name.clone(), String::new());
            (largest != 0.0).then_some(Change { file, column, largest, scale, allowed, note })
        }
    };
    names.into_iter().filter_map(of).collect()
}

fn magnitude(column: &[f64]) -> f64 {
    column.iter().filter(|x| !x.is_nan()).fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// 0 if both are undefined, infinite if one is.
fn difference(a: f64, b: f64) -> f64 {
    match (a.is_nan(), b.is_nan()) {
        (true, true) => 0.0,
        (false, false) => (a - b).abs(),
        _ => f64::INFINITY,
    }
}

/// The first line in which two texts differ.
fn first_difference(a: &[f64], b: &[f64]) -> String {
    let text =
        |bytes: &[f64]| String::from_utf8_lossy(&bytes.iter().map(|b| *b as u8).collect::<Vec<u8>>()).into_owned();
    let (a, b) = (text(a), text(b));
    let (mut a, mut b) = (a.lines(), b.lines());
    for line in 1.. {
        match (a.next(), b.next()) {
            (None, None) => break,
            (a, b) if a != b => {
                return format!("line {line}: {}; expected {}", b.unwrap_or("missing"), a.unwrap_or("no more"));
            }
            _ => {}
        }
    }
    "the ends of lines differ".into()
}

/// Makes the expected files of a scene anew, stage by stage; returns a table of the largest change of each column.
/// The files of a stage in which every change is allowed stay, so that another machine's round-off is no change
/// (without its folder a stage is made in any case).
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
            for gone in files(&old).iter().filter(|name| !new.join(name).exists()) {
                fs::remove_file(old.join(gone)).unwrap();
            }
            copy(&new, &old);
        }
    }
    report
}

/// The largest change of each column over the files of a stage.
fn table(stage: Stage, changes: &[Change]) -> String {
    let mut columns: BTreeMap<(String, &String), (&Change, usize)> = BTreeMap::new();
    for change in changes {
        let kind = change.file.replace(char::is_numeric, ""); // snapshots of all steps together
        let entry = columns.entry((kind, &change.column)).or_insert((change, 0));
        entry.1 += 1;
        if change.largest > entry.0.largest {
            entry.0 = change;
        }
    }
    if columns.is_empty() {
        return format!("  {:<6} nothing has changed\n", stage.name());
    }
    let verdict = if changes.iter().all(Change::is_allowed) { "all allowed, files kept" } else { "files made anew" };
    let mut text = format!("  {:<6} largest change of each column; {verdict}\n", stage.name());
    for ((_, column), (change, count)) in columns {
        let Change { file, largest, scale, allowed, note, .. } = change;
        let what = match note.is_empty() {
            true => format!("{largest:9.2e} of {scale:8.2e}, {allowed:8.2e} allowed"),
            false => note.clone(),
        };
        let verdict = if change.is_allowed() { ' ' } else { '!' };
        text += &format!("  {verdict} {column:<36} {what}   {file}, {count} in all\n");
    }
    text
}
