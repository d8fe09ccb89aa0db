//! LMGC90's text files: files of LMGC90 itself and by hand in `tests/good`, faults in `tests/bad`,
//! random values and random damage.

use std::fs;
use std::path::{Path, PathBuf};

use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::Faults;
use cd_formats::scan::AsciiText;
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;

mod bad;
mod good;
mod random;

/// The kinds of file, by the beginning of their names.
const KINDS: [&str; 6] = ["BODIES", "BULK_BEHAV", "TACT_BEHAV", "DRV_DOF", "DOF", "Vloc_Rloc"];

/// Reads a file of one of [`KINDS`] and writes it again.
fn rewrite(path: &Path, bytes: &[u8]) -> Result<String, Faults> {
    let text = &AsciiText::new(bytes);
    Ok(match kind(path) {
        "BODIES" => Bodies::parse(path, text)?.to_text(),
        "BULK_BEHAV" => BulkBehav::parse(path, text)?.to_text(),
        "TACT_BEHAV" => TactBehav::parse(path, text)?.to_text(),
        "DRV_DOF" => DrvDof::parse(path, text)?.to_text(),
        "DOF" => Dof::parse(path, text)?.to_text(),
        _ => VlocRloc::parse(path, text)?.to_text(),
    })
}

fn kind(path: &Path) -> &'static str {
    let name = path.file_name().unwrap().to_str().unwrap();
    KINDS.into_iter().find(|kind| name.starts_with(kind)).unwrap_or_else(|| panic!("{name} is of no known kind"))
}

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

/// All files of the known kinds below a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.extension().is_some_and(|extension| extension != "dat") {
            found.push(path); // .dat: tables that a DRV_DOF.DAT names
        }
    }
    found.sort();
    found
}
