//! A case in a temporary folder, and the programs on it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::snapshot::{self, Snapshot};
use tempfile::TempDir;

use crate::columns::{Columns, csv};

/// The exit status of `cd-pre SCENE -o CASE`.
pub fn pre(scene: &Path, case: &Path) -> i32 {
    cd_pre::run(arguments(&["cd-pre".as_ref(), scene, "-o".as_ref(), case]))
}

/// The exit status of `cd-pre from-outbox FROM TO`, with a file of these changes if there are some.
pub fn from_outbox(from: &Path, to: &Path, changes: &str) -> i32 {
    let mut words = vec!["cd-pre".as_ref(), "from-outbox".as_ref(), from, to];
    let file = to.join("changes.ron");
    if !changes.is_empty() {
        fs::write(&file, changes).unwrap();
        words.extend(["--changes".as_ref(), file.as_path()]);
    }
    cd_pre::run(arguments(&words))
}

/// The exit status of `cd-solve CASE FLAGS`.
pub fn solve(case: &Path, flags: &[&str]) -> i32 {
    cd_solve::run(arguments(&["cd-solve".as_ref(), case]).chain(flags.iter().map(OsString::from)))
}

/// The exit status of `cd-post CASE FLAGS`.
pub fn post(case: &Path, flags: &[&str]) -> i32 {
    cd_post::run(arguments(&["cd-post".as_ref(), case]).chain(flags.iter().map(OsString::from)))
}

fn arguments(words: &[&Path]) -> impl Iterator<Item = OsString> {
    words.iter().map(OsString::from).collect::<Vec<_>>().into_iter()
}

/// A case in a temporary folder, which is deleted when this is dropped.
pub struct Case(TempDir);

impl Case {
    /// Writes the DATBOX of the text of a scene with cd-pre.
    pub fn from_scene(scene: &str) -> Case {
        Case::with_surfaces(scene, Path::new("no such folder"))
    }

    /// Writes the DATBOX of the text of a scene that names surfaces (`.obj`) of `folder`: they are copied next to it.
    pub fn with_surfaces(scene: &str, folder: &Path) -> Case {
        let case = Case::empty();
        let surfaces = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        for path in surfaces.filter(|path| path.extension().is_some_and(|ending| ending == "obj")) {
            fs::copy(&path, case.path().join(path.file_name().unwrap())).unwrap();
        }
        let file = case.path().join("scene.ron");
        fs::write(&file, scene).unwrap();
        assert_eq!(pre(&file, case.path()), 0, "cd-pre rejected\n{scene}");
        case
    }

    /// Case in an empty temporary folder.
    pub fn empty() -> Case {
        Case(tempfile::tempdir().unwrap())
    }

    /// A case with the DATBOX of this one.
    pub fn twin(&self) -> Case {
        let case = Case::empty();
        copy(&self.path().join("DATBOX"), &case.path().join("DATBOX"));
        case
    }

    /// Folder of the case.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Path of a file in DATBOX.
    pub fn datbox(&self, name: &str) -> PathBuf {
        self.path().join("DATBOX").join(name)
    }

    /// Path of OUTBOX.
    pub fn outbox(&self) -> PathBuf {
        self.path().join("OUTBOX")
    }

    /// The exit status of cd-solve.
    pub fn solve(&self, flags: &[&str]) -> i32 {
        solve(self.path(), flags)
    }

    /// Runs cd-solve, which must end well.
    pub fn solved(self, flags: &[&str]) -> Case {
        assert_eq!(self.solve(flags), 0, "cd-solve {flags:?}");
        self
    }

    /// Runs cd-post, which must end well, and reads the columns of series.csv.
    pub fn series(&self) -> Columns {
        assert_eq!(post(self.path(), &["--no-vtk", "--no-plots"]), 0);
        csv(&self.path().join("POSTPRO/series.csv")).unwrap()
    }

    /// The columns of OUTBOX/steps.csv.
    pub fn steps(&self) -> Columns {
        csv(&self.outbox().join("steps.csv")).unwrap()
    }

    /// Reads the snapshot of a step.
    pub fn snapshot(&self, step: u64) -> Snapshot {
        Snapshot::read(&snapshot::snapshot_path(&self.outbox(), step)).unwrap()
    }

    /// Reads the last snapshot.
    pub fn last_snapshot(&self) -> Snapshot {
        Snapshot::read(&snapshot::list_snapshots(&self.outbox()).unwrap().pop().expect("a snapshot").1).unwrap()
    }

    /// Name and bytes of every file in OUTBOX.
    pub fn results(&self) -> BTreeMap<String, Vec<u8>> {
        files(&self.outbox())
            .into_iter()
            .map(|name| (name.clone(), fs::read(self.outbox().join(name)).unwrap()))
            .collect()
    }
}

/// The names of a folder's files, in order; an absent folder has none.
pub fn files(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().filter(|entry| entry.path().is_file());
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Copies the files of a folder.
pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for name in files(from) {
        fs::copy(from.join(&name), to.join(&name)).unwrap();
    }
}

/// Fails with the names of the files that differ, not with their bytes.
pub fn assert_same_results(expected: &Case, found: &Case) {
    let (expected, found) = (expected.results(), found.results());
    assert_eq!(expected.keys().collect::<Vec<_>>(), found.keys().collect::<Vec<_>>(), "files in OUTBOX");
    assert!(expected.len() > 2, "nothing to compare");
    let different: Vec<_> =
        expected.iter().filter(|(name, bytes)| found[*name] != **bytes).map(|(name, _)| name).collect();
    assert!(different.is_empty(), "bytes differ in {different:?}");
}

/// Scene of a cloud of `number` rocks with radii 8 to 12 m at rest that falls together under its own gravity; `compute`
/// holds the options but for self-gravity.
pub fn cloud(number: usize, friction: f64, seed: u64, compute: &str) -> String {
    format!(
        r#"(
            seed: {seed},
            materials: [(name: "ROCKx", density: 2700.0)],
            laws: [(name: "iqsc0", kind: IQS_CLB(friction: {friction:?}))],
            contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
            grains: [(
                material: "ROCKx",
                colour: "BLUEx",
                number: {number},
                solid_fraction: 0.2,
                sizes: Uniform(min: 8.0, max: 12.0),
                placement: JitteredLattice(envelope: Ball()),
            )],
            compute: (self_gravity: true, {compute}),
        )"#
    )
}

/// The surface `l.obj` of an L, 3 m^3, and those of two cuboids that make it and share 1 m^3: `leg.obj`, `foot.obj`.
pub fn surfaces_of_an_l() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let l = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]];
    let leg = [[0, 0], [1, 0], [1, 2], [0, 2]];
    let foot = [[0, 0], [2, 0], [2, 1], [0, 1]];
    for (name, profile) in [("l", &l[..]), ("leg", &leg), ("foot", &foot)] {
        let n = profile.len();
        // A prism: its ends at y = 0 and y = 1, and the sides between them.
        let vertices = [0, 1].iter().flat_map(|y| profile.iter().map(move |[x, z]| format!("v {x} {y} {z}\n")));
        let ends = [(0..n).collect::<Vec<_>>(), (n..2 * n).collect()];
        let sides = (0..n).map(|k| vec![k, (k + 1) % n, n + (k + 1) % n, n + k]);
        let faces = ends.into_iter().chain(sides).map(|face| {
            // Numbers of vertices start from 1 in this format.
            let corners: Vec<String> = face.iter().map(|k| (k + 1).to_string()).collect();
            format!("f {}\n", corners.join(" "))
        });
        fs::write(folder.path().join(format!("{name}.obj")), vertices.chain(faces).collect::<String>()).unwrap();
    }
    folder
}
