//! Contents of a folder, and their comparison with those of an unbroken run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cd_formats::dof::Dof;
use cd_formats::snapshot::Snapshot;
use cd_formats::vloc_rloc::VlocRloc;

/// Files below a folder by their paths relative to it, with their bytes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Contents(pub BTreeMap<String, Vec<u8>>);

/// Whether a file has durations, which no two runs share.
fn has_durations(name: &str) -> bool {
    ["TIMER.csv", "ERRORS.csv"].contains(&name)
}

/// Whether a file grows line by line under its final name.
fn is_growing_file(name: &str) -> bool {
    name == "OUTBOX/steps.csv"
        || name.starts_with("POSTPRO/probe-")
        || (name.starts_with("POSTPRO/") && name.ends_with(".DAT"))
}

/// Whether a file is one that has not got its final name yet, or marks that others have not.
fn is_temporary(name: &str) -> bool {
    name.rsplit('/').next().is_some_and(|name| name.starts_with('.'))
}

/// Step of a snapshot, or of a part of it, in OUTBOX.
fn snapshot_step(name: &str) -> Option<u64> {
    let digits = name.strip_prefix("OUTBOX/snapshot-")?;
    digits.split(['-', '.']).next()?.parse().ok()
}

impl Contents {
    /// Reads a folder. An absent one is empty.
    pub fn read(folder: &Path) -> Contents {
        let mut contents = Contents::default();
        contents.add(folder, "");
        contents
    }

    fn add(&mut self, folder: &Path, prefix: &str) {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = format!("{prefix}{}", entry.file_name().to_str().unwrap());
            if entry.path().is_dir() {
                self.add(&entry.path(), &format!("{name}/"));
            } else {
                self.0.insert(name, fs::read(entry.path()).unwrap());
            }
        }
    }

    /// Replaces a folder by these files.
    pub fn write(&self, folder: &Path) {
        let _ = fs::remove_dir_all(folder);
        fs::create_dir_all(folder).unwrap();
        for (name, bytes) in &self.0 {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
    }

    /// Names of the files that differ from those of `expected`, or are in one of the two only.
    pub fn differences(&self, expected: &Contents) -> Vec<String> {
        let names = self.0.keys().chain(expected.0.keys().filter(|name| !self.0.contains_key(*name)));
        let differ = |name: &&String| match [self, expected].map(|contents| contents.0.get(*name)) {
            [Some(_), Some(_)] if has_durations(name) => false,
            [own, other] => own != other,
        };
        names.filter(differ).cloned().collect()
    }

    /// Removes snapshots that `expected` has not: those of a run that was requested to stop, which remain. Returns their number.
    pub fn remove_further_snapshots(&mut self, expected: &Contents) -> usize {
        let count = self.0.len();
        let steps: Vec<_> = expected.0.keys().filter_map(|name| snapshot_step(name)).collect();
        self.0.retain(|name, _| snapshot_step(name).is_none_or(|step| steps.contains(&step)));
        count - self.0.len()
    }

    /// Names of the files that have a final name and are neither as they were before the program nor as it writes them; a file
    /// that grows may be the beginning of one of these. `folder` is the one that was read.
    pub fn half_written_files(&self, folder: &Path, before: &Contents, after: &Contents) -> Vec<String> {
        let is_whole = |name: &String, bytes: &Vec<u8>| {
            let known = [before, after].into_iter().filter_map(|contents| contents.0.get(name));
            let mut known = known.peekable();
            let path = folder.join(name);
            if snapshot_step(name).is_some() && known.peek().is_none() {
                // A snapshot of a run that was requested to stop; its parts are read with it.
                return name.contains("-part-") || Snapshot::read(&path).is_ok();
            }
            // A run that was requested to stop adds a row of its last step.
            let rows =
                bytes[..bytes.len().saturating_sub(1)].iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            known.any(|known| known == bytes || (is_growing_file(name) && known.starts_with(&bytes[..rows])))
                // Its lines are those of the files at that time: --verify and the run after it compare them.
                || name == "OUTBOX/SHA256SUMS"
                // The state of such a run in text.
                || (name.starts_with("OUTBOX/DOF.") && Dof::read(&path).is_ok())
                || (name.starts_with("OUTBOX/Vloc_Rloc.") && VlocRloc::read(&path).is_ok())
        };
        let files = self.0.iter().filter(|(name, _)| !is_temporary(name) && !has_durations(name));
        files.filter(|(name, bytes)| !is_whole(name, bytes)).map(|(name, _)| name.clone()).collect()
    }

    /// Names of temporary files.
    pub fn temporary_files(&self) -> Vec<&String> {
        self.0.keys().filter(|name| is_temporary(name)).collect()
    }
}
