//! `cd-solve DIR --verify`: finds damaged files of a case by their checksums, and the snapshot from which a run can continue.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use cd_formats::checksums::{CHECKSUMS_FILE, ChecksumLine, FileState, file_state, read_list};
use cd_formats::error::{Fault, Faults};
use cd_formats::names::count_text;
use cd_formats::snapshot::{Snapshot, list_snapshots, snapshot_files};

use crate::write::outbox_path;

/// Result of a comparison of a case with its checksums.
pub struct Verification {
    /// Text for people.
    pub text: String,
    /// Whether all files are sound.
    pub is_sound: bool,
}

/// Compares the files of a case with the checksums in DATBOX and OUTBOX, and reads all snapshots. Errors: a folder or a list
/// of checksums cannot be read.
pub fn verify_case(case: &Path) -> Result<Verification, Faults> {
    let outbox = outbox_path(case);
    let mut report = Report { text: String::new(), is_sound: true };
    report.add_list("DATBOX", &case.join("DATBOX"), read_list(&case.join("DATBOX"))?)?;
    let list = read_list(&outbox)?;
    let checksums = file_lines(list.as_deref().unwrap_or_default());
    let mut sound_steps = Vec::new();
    let snapshots = list_snapshots(&outbox)?;
    for (step, path) in &snapshots {
        match snapshot_damage(&outbox, *step, path, &checksums) {
            None => sound_steps.push(*step),
            Some(damage) => report.add_damage(&damage),
        }
    }
    report.add_list("OUTBOX", &outbox, list)?;
    let _ = writeln!(report.text, "snapshots: {} of {} sound", sound_steps.len(), snapshots.len());
    let last = snapshots.last().map(|(step, _)| *step);
    let next = match sound_steps.last() {
        None if snapshots.is_empty() => "a run starts from DATBOX".into(),
        None => "no snapshot is sound: --force starts from DATBOX".into(),
        Some(step) if Some(*step) == last => format!("--resume continues from step {step}"),
        Some(step) => format!("--resume --skip-damaged continues from step {step}"),
    };
    let _ = writeln!(report.text, "{next}");
    Ok(Verification { text: report.text, is_sound: report.is_sound })
}

/// Renames the files of the damaged snapshots after the last sound one to `NAME.damaged`, so that a run continues from that
/// one. Returns the new paths. Errors: no snapshot is sound, or a file cannot be read or renamed.
pub fn set_damaged_aside(case: &Path) -> Result<Vec<PathBuf>, Faults> {
    let outbox = outbox_path(case);
    let list = read_list(&outbox)?.unwrap_or_default();
    let (checksums, snapshots) = (file_lines(&list), list_snapshots(&outbox)?);
    let is_sound = |(step, path): &&(u64, PathBuf)| snapshot_damage(&outbox, *step, path, &checksums).is_none();
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
            let target = file.with_extension("npz.damaged");
            std::fs::rename(&file, &target).map_err(|error| Fault::from_io(&file, "renamed", &error))?;
            renamed.push(target);
        }
    }
    Ok(renamed)
}

/// Checksums of the files of a list by path.
fn file_lines(list: &[ChecksumLine]) -> BTreeMap<&str, &ChecksumLine> {
    list.iter()
        .filter_map(|line| match line {
            ChecksumLine::File { path, .. } => Some((path.as_str(), line)),
            _ => None,
        })
        .collect()
}

/// Damage of a snapshot, in words: a file that differs from its checksum, or one that cannot be read. A file without a
/// checksum is read only, which its own checksums cover.
fn snapshot_damage(outbox: &Path, step: u64, path: &Path, checksums: &BTreeMap<&str, &ChecksumLine>) -> Option<String> {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for file in snapshot_files(outbox, step).iter().filter(|file| file.is_file()) {
        if let Some(ChecksumLine::File { checksum, .. }) = checksums.get(name(file).as_str()) {
            match file_state(file, u64::MAX, *checksum) {
                Ok(FileState::Sound) => {}
                Ok(_) => return Some(format!("{}: differs from its checksum in {CHECKSUMS_FILE}", file.display())),
                Err(faults) => return Some(faults.to_string()),
            }
        }
    }
    Snapshot::read(path).err().map(|faults| faults.0.first().map_or(String::new(), Fault::to_string))
}

/// Report that is being made.
struct Report {
    text: String,
    is_sound: bool,
}

impl Report {
    fn add_damage(&mut self, damage: &str) {
        let _ = writeln!(self.text, "{damage}");
        self.is_sound = false;
    }

    /// Adds the files of the list in `folder`, without snapshots that exist, which are reported one by one. Of the checksums
    /// of a log the last counts.
    fn add_list(&mut self, name: &str, folder: &Path, list: Option<Vec<ChecksumLine>>) -> Result<(), Faults> {
        let Some(lines) = list else {
            let _ = writeln!(self.text, "{name}: no {CHECKSUMS_FILE}: its files are not compared");
            return Ok(());
        };
        let mut latest: BTreeMap<&str, (u64, &ChecksumLine)> = BTreeMap::new();
        for line in &lines {
            match line {
                ChecksumLine::File { path, .. } => latest.insert(path, (u64::MAX, line)),
                ChecksumLine::Start { path, length, .. } => latest.insert(path, (*length, line)),
                ChecksumLine::Comment(_) => None,
            };
        }
        let mut sound_count = 0;
        for (path, (length, line)) in latest {
            let (ChecksumLine::File { checksum, .. } | ChecksumLine::Start { checksum, .. }) = line else { continue };
            let file = folder.join(path);
            let is_snapshot = path.starts_with("snapshot-");
            match file_state(&file, length, *checksum)? {
                FileState::Sound => sound_count += u64::from(!is_snapshot),
                FileState::Missing => self.add_damage(&format!("{}: is missing", file.display())),
                FileState::Changed if is_snapshot => {}
                FileState::Changed => {
                    let damage = format!("{}: differs from its checksum in {name}/{CHECKSUMS_FILE}", file.display());
                    self.add_damage(&damage);
                }
            }
        }
        let _ = writeln!(self.text, "{name}: {} sound", count_text(sound_count as usize, "file"));
        Ok(())
    }
}
