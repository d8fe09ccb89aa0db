//! `cd-solve DIR --verify`: finds damaged files of a case by their checksums, and the snapshot from which a run can continue.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cd_formats::atomic::path_exists;
use cd_formats::checksums::{CHECKSUMS_FILE, Checksum, ChecksumLine, FileState, file_state, read_list};
use cd_formats::compute::ComputeFlags;
use cd_formats::error::{Fault, Faults, MAX_REPORTED_LINES};
use cd_formats::names::count_text;
use cd_formats::snapshot::{Snapshot, list_snapshots, snapshot_files};

use crate::read::resume::{check_resumable, snapshot_advice};
use crate::read::{self, wholeness};
use crate::scene::Scene;
use crate::write::checksums::{SnapshotLines, lines_of_snapshot};
use crate::write::{DAMAGED_LOG_ADVICE, outbox_path};

/// Result of a comparison of a case with its checksums, to which files are added one by one.
pub struct Verification {
    /// Text for people.
    pub text: String,
    /// Whether all files are sound.
    pub is_sound: bool,
    damage_count: usize,
}

/// Compares the files of a case with the checksums in DATBOX and OUTBOX, and reads all snapshots. Errors: a folder or a list
/// of checksums cannot be read, or cd-pre is writing DATBOX.
pub fn verify_case(case: &Path) -> Result<Verification, Faults> {
    let (datbox, outbox) = (case.join("DATBOX"), outbox_path(case));
    let mut verification = Verification { text: String::new(), is_sound: true, damage_count: 0 };
    let _lock = wholeness::share_datbox(&datbox)?;
    let unfinished = wholeness::unfinished_fault(&datbox);
    unfinished.iter().for_each(|fault| verification.add_damage(&fault.to_string()));
    let datbox_list = wholeness::written_list(&datbox)?;
    let missing = verification.add_list("DATBOX", &datbox, datbox_list.as_ref().map(|list| list.lines.as_slice()));
    let list = read_list(&outbox)?;
    let checksums = file_checksums(list.as_deref().unwrap_or_default());
    let mut sound_snapshots = Vec::new();
    let snapshots = list_snapshots(&outbox)?;
    for (step, path) in &snapshots {
        match snapshot_damage(&outbox, *step, path, &checksums) {
            None => sound_snapshots.push((*step, path)),
            Some(damage) => verification.add_damage(&damage),
        }
    }
    let scene = readable_scene(case);
    while let Some(reason) = sound_snapshots.last().and_then(|(_, path)| rejection(path, scene.as_ref())) {
        verification.add_damage(&reason);
        sound_snapshots.pop();
    }
    verification.add_list("OUTBOX", &outbox, list.as_deref());
    if verification.damage_count > MAX_REPORTED_LINES {
        verification
            .add_line(&format!("{} more", count_text(verification.damage_count - MAX_REPORTED_LINES, "damaged file")));
    }
    let sound_count = sound_snapshots.len();
    verification.add_line(&format!("snapshots: {sound_count} of {} sound", snapshots.len()));
    let last = snapshots.last().map(|(step, _)| *step);
    let last_sound = sound_snapshots.last().map(|(step, _)| *step);
    let next = match last_sound {
        None if snapshots.is_empty() => "a run starts from DATBOX".into(),
        None => "--force starts from DATBOX: no snapshot is sound".into(),
        Some(step) if Some(step) == last => format!("--resume continues from step {step}"),
        Some(step) => format!("--resume --skip-damaged continues from step {step}"),
    };
    // What rejects such a run, and what to do about it.
    let mut before = Vec::new();
    if unfinished.is_some() || missing > 0 {
        before.push("run cd-pre again");
    } else if scene.is_none() {
        before.push("mend DATBOX, whose faults cd-solve --plan names, or run cd-pre again");
    }
    if last_sound.is_some_and(|step| has_damaged_log(&outbox, list.as_deref().unwrap_or_default(), step)) {
        before.push("restore the damaged logs, or rename them to continue without their rows");
    }
    let first = if before.is_empty() { String::new() } else { format!("{}; then ", before.join("; ")) };
    verification.add_line(&format!("{first}{next}"));
    Ok(verification)
}

/// Whether a log up to the snapshot of `step` differs from its checksum or cannot be read, so that no run continues from there.
fn has_damaged_log(outbox: &Path, list: &[ChecksumLine], step: u64) -> bool {
    lines_of_snapshot(list, step).logs.iter().any(|line| match line {
        ChecksumLine::Start { path, length, checksum } => {
            let state = file_state(&listed_path(outbox, path), *length, *checksum);
            !matches!(state, Ok(FileState::Sound | FileState::Missing))
        }
        _ => false,
    })
}

/// Compares the last snapshot, and the logs up to it, with their checksums, before a run continues from it. Errors: one of them
/// differs or cannot be read. A log that is missing is no error, as the run then begins a new one.
pub fn check_last_snapshot(case: &Path) -> Result<(), Faults> {
    let outbox = outbox_path(case);
    let (Some(list), snapshots) = (read_list(&outbox)?, list_snapshots(&outbox)?) else { return Ok(()) };
    let Some((step, _)) = snapshots.last() else { return Ok(()) };
    let SnapshotLines { logs, files } = lines_of_snapshot(&list, *step);
    let mut faults = Faults::default();
    for line in logs.iter().chain(&files) {
        let (path, length, checksum, object, advice) = match line {
            ChecksumLine::File { path, checksum } => {
                (path, u64::MAX, *checksum, "snapshot", snapshot_advice(&snapshots))
            }
            ChecksumLine::Start { path, length, checksum } => (path, *length, *checksum, "log", DAMAGED_LOG_ADVICE),
            ChecksumLine::Comment(_) => continue,
        };
        let file = listed_path(&outbox, path);
        if faults.gather_result(file_state(&file, length, checksum)) == Some(FileState::Changed) {
            faults.push(Fault::new(&file, None, object, difference("OUTBOX"), advice));
        }
    }
    faults.into_result(())
}

/// Renames the files of the damaged snapshots after the last sound one to `NAME.damaged`, so that a run continues from that
/// one. Returns the new paths. Errors: no snapshot is sound, or a file cannot be read or renamed.
pub fn set_damaged_aside(case: &Path) -> Result<Vec<PathBuf>, Faults> {
    let outbox = outbox_path(case);
    let list = read_list(&outbox)?.unwrap_or_default();
    let (checksums, snapshots) = (file_checksums(&list), list_snapshots(&outbox)?);
    let scene = readable_scene(case);
    let is_sound = |(step, path): &&(u64, PathBuf)| {
        snapshot_damage(&outbox, *step, path, &checksums).is_none() && rejection(path, scene.as_ref()).is_none()
    };
    let Some(last_sound) = snapshots.iter().rev().find(is_sound).map(|(step, _)| *step) else {
        if snapshots.is_empty() {
            return Ok(Vec::new());
        }
        let expected = "use --force to start from DATBOX";
        return Err(Fault::new(&outbox, None, "snapshots", "none is sound", expected).into());
    };
    let mut renamed = Vec::new();
    for (step, path) in snapshots.iter().filter(|(step, _)| *step > last_sound) {
        // The index goes first: parts without an index are no snapshot.
        let parts = snapshot_files(&outbox, *step).into_iter().filter(|part| part != path && part.is_file());
        for file in [path.clone()].into_iter().chain(parts) {
            let target = unused_path(&file.with_extension("npz.damaged"));
            std::fs::rename(&file, &target).map_err(|error| Fault::from_io(&file, "renamed", &error))?;
            renamed.push(target);
        }
    }
    Ok(renamed)
}

/// The path, or with the first number from 2 with which there is no such file.
fn unused_path(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let numbered = (2..).map(|k: u64| path.with_file_name(format!("{name}-{k}")));
    std::iter::once(path.to_path_buf()).chain(numbered).find(|path| !path_exists(path)).unwrap_or_default()
}

/// Checksums of the files of a list by path; the last one counts.
fn file_checksums(list: &[ChecksumLine]) -> BTreeMap<&str, Checksum> {
    list.iter()
        .filter_map(|line| match line {
            ChecksumLine::File { path, checksum } => Some((path.as_str(), *checksum)),
            _ => None,
        })
        .collect()
}

/// Damage of a snapshot, in words: a file that differs from its checksum, or one that cannot be read. A file without a line in
/// the list is checked by the checksums inside it alone, when it is read.
fn snapshot_damage(outbox: &Path, step: u64, path: &Path, checksums: &BTreeMap<&str, Checksum>) -> Option<String> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for file in snapshot_files(outbox, step).iter().filter(|file| file.is_file()) {
        if let Some(checksum) = checksums.get(name(file).as_str()) {
            match file_state(file, u64::MAX, *checksum) {
                Ok(FileState::Sound) => {}
                Ok(_) => return Some(difference_text(file, "OUTBOX")),
                Err(faults) => return Some(faults.to_string()),
            }
        }
    }
    Snapshot::read(path).err().map(|faults| faults.0.first().map_or(String::new(), Fault::to_string))
}

/// Scene of a case; `None` if DATBOX is rejected, which each run reports.
fn readable_scene(case: &Path) -> Option<Scene> {
    read::read_case(case, &ComputeFlags::default()).ok().map(|(scene, _)| scene)
}

/// Reason for which no run of the scene can continue from a sound snapshot, in words; `None` if one can.
fn rejection(path: &Path, scene: Option<&Scene>) -> Option<String> {
    let snapshot = Snapshot::read(path).ok()?;
    let faults = check_resumable(path, scene?, &snapshot).err()?;
    faults.0.first().map(Fault::to_string)
}

/// Damage of a file that differs from its checksum in the list of a folder, in words.
fn difference_text(file: &Path, folder: &str) -> String {
    format!("{}: {}", file.display(), difference(folder))
}

/// Difference of a file from its checksum in the list of a folder, in words.
fn difference(folder: &str) -> String {
    format!("differs from its checksum in {folder}/{CHECKSUMS_FILE}")
}

/// Path of a file that a list of `folder` names, which may be in another folder of the case: `../DATBOX/BODIES.DAT`.
fn listed_path(folder: &Path, name: &str) -> PathBuf {
    match (name.strip_prefix("../"), folder.parent()) {
        (Some(name), Some(case)) => case.join(name),
        _ => folder.join(name),
    }
}

impl Verification {
    fn add_line(&mut self, line: &str) {
        self.text += line;
        self.text += "\n";
    }

    fn add_damage(&mut self, damage: &str) {
        self.is_sound = false;
        self.damage_count += 1;
        if self.damage_count <= MAX_REPORTED_LINES {
            self.add_line(damage);
        }
    }

    /// Adds the files of the list in `folder`, without snapshots that exist, which are reported one by one. Of the checksums
    /// of a log the last counts. Returns the number of missing files.
    fn add_list(&mut self, name: &str, folder: &Path, list: Option<&[ChecksumLine]>) -> usize {
        let Some(lines) = list else {
            self.add_line(&format!("{name}: no {CHECKSUMS_FILE} of its own: its files are not compared"));
            return 0;
        };
        let mut latest: BTreeMap<&str, (u64, Checksum)> = BTreeMap::new();
        for line in lines {
            match line {
                ChecksumLine::File { path, checksum } => latest.insert(path, (u64::MAX, *checksum)),
                ChecksumLine::Start { path, length, checksum } => latest.insert(path, (*length, *checksum)),
                ChecksumLine::Comment(_) => None,
            };
        }
        let (mut sound, mut missing) = (0, 0);
        for (path, (length, checksum)) in latest {
            let file = listed_path(folder, path);
            let is_snapshot = path.starts_with("snapshot-");
            match file_state(&file, length, checksum) {
                Ok(FileState::Sound) => sound += usize::from(!is_snapshot),
                Ok(FileState::Missing) => {
                    missing += 1;
                    self.add_damage(&format!("{}: is missing", file.display()));
                }
                _ if is_snapshot => {}
                Ok(FileState::Changed) => self.add_damage(&difference_text(&file, name)),
                Err(faults) => self.add_damage(&faults.to_string()),
            }
        }
        self.add_line(&format!("{name}: {} sound", count_text(sound, "file")));
        missing
    }
}
