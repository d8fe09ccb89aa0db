//! Snapshots in parts: `snapshot-NNNNNN.npz` is then an index of files `snapshot-NNNNNN-part-KKKKKK.npz`.
//!
//! A part has a range of the bodies, and the contacts, pairs and other rows whose first body is one of these: the same
//! arrays as a whole snapshot, without `meta`. The index has `meta` alone, whose field `parts` names the number of bodies
//! and the checksum of each part. It is written last, so that a snapshot whose parts are incomplete does not exist.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::atomic;
use crate::error::{Fault, Faults};

/// A part of a snapshot, as the index names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SnapshotPart {
    /// Number of bodies.
    pub bodies: u64,
    /// CRC-32 of the bytes of the file.
    pub crc32: u32,
}

/// Rows of each group of arrays in a part.
#[derive(Debug, Clone, Default)]
pub(super) struct PartRows {
    pub bodies: Range<usize>,
    pub contacts: Range<usize>,
    pub turning: Range<usize>,
    pub pairs: Range<usize>,
    pub interval: Range<usize>,
}

/// First body of each row of each group of arrays, in the order of the rows. The first bodies of `contacts`, `turning`,
/// `pairs` and `interval` do not decrease.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FirstBodies<'a> {
    pub contacts: &'a [[u32; 2]],
    pub turning: &'a [u32],
    pub pairs: &'a [[u32; 2]],
    pub interval: &'a [[u32; 2]],
}

/// Separates the step from the number of the part in a name.
const PART_INFIX: &str = "-part-";

/// Path of a part of the snapshot at `path`; `number` counts from 0.
pub fn part_path(path: &Path, number: usize) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("{PART_INFIX}{number:06}.npz"));
    path.with_file_name(name)
}

/// Path of the index of a part; `None` for other names.
fn index_path(part: &Path) -> Option<PathBuf> {
    let (stem, number) = part.file_name()?.to_str()?.strip_suffix(".npz")?.rsplit_once(PART_INFIX)?;
    let path = part.with_file_name(format!("{stem}.npz"));
    number.parse::<usize>().ok().and(step_of(&path)).map(|_| path)
}

/// Removes parts without an index, which a killed program may leave.
pub fn remove_orphan_parts(outbox: &Path) -> Result<(), Faults> {
    for path in atomic::folder_entries(outbox)? {
        if index_path(&path).is_some_and(|index| !atomic::path_exists(&index)) {
            fs::remove_file(&path).map_err(|error| Fault::from_io(&path, "removed", &error))?;
        }
    }
    Ok(())
}

/// Step in the name of a snapshot or of a part of one; `None` for other names.
pub fn step_of_file(path: &Path) -> Option<u64> {
    step_of(path).or_else(|| step_of(&index_path(path)?))
}

/// Step in the name of a snapshot.
pub(super) fn step_of(path: &Path) -> Option<u64> {
    path.file_name()?.to_str()?.strip_prefix("snapshot-")?.strip_suffix(".npz")?.parse().ok()
}

impl SnapshotPart {
    /// Part with these bytes.
    pub(super) fn new(bodies: usize, bytes: &[u8]) -> Self {
        SnapshotPart { bodies: bodies as u64, crc32: crc32fast::hash(bytes) }
    }

    /// Returns the bytes of the part at `path`, which the index at `index` names. Errors: it cannot be read, or has other
    /// bytes.
    pub(super) fn read_bytes(&self, path: &Path, index: &Path) -> Result<Vec<u8>, Faults> {
        let bytes = atomic::read_bytes(path)?;
        match crc32fast::hash(&bytes) {
            sum if sum == self.crc32 => Ok(bytes),
            sum => Err(other_part(path, index, format!("CRC-32 {sum}, not {}", self.crc32))),
        }
    }
}

/// Fault of a part that is not the one that the index names.
pub(super) fn other_part(path: &Path, index: &Path, found: String) -> Faults {
    let expected = format!("expected the part that {} names, as cd-solve wrote it", index.display());
    Fault::new(path, None, "part of a snapshot", found, expected).into()
}

impl PartRows {
    /// Rows of the part with the `bodies`, the next after this one; the last part has all rows that remain.
    pub fn next_part(&self, bodies: Range<usize>, is_last: bool, first_bodies: FirstBodies) -> PartRows {
        let next_range = |before: &Range<usize>, bodies_of_rows: &mut dyn Iterator<Item = u32>| {
            let belongs = |body: &u32| is_last || (*body as usize) < bodies.end;
            before.end..before.end + bodies_of_rows.skip(before.end).take_while(belongs).count()
        };
        let next_pairs =
            |before: &Range<usize>, pairs: &[[u32; 2]]| next_range(before, &mut pairs.iter().map(|pair| pair[0]));
        PartRows {
            contacts: next_pairs(&self.contacts, first_bodies.contacts),
            turning: next_range(&self.turning, &mut first_bodies.turning.iter().copied()),
            pairs: next_pairs(&self.pairs, first_bodies.pairs),
            interval: next_pairs(&self.interval, first_bodies.interval),
            bodies,
        }
    }
}
