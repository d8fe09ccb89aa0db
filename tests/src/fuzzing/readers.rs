//! Readers of files of input as functions of bytes.

use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::checksums::{CHECKSUMS_FILE, read_list};
use cd_formats::compute::{Compute, ComputeFlags};
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::{Fault, Faults};
use cd_formats::fc3d::Fc3d;
use cd_formats::origin::SceneOrigin;
use cd_formats::postpro::Postpro;
use cd_formats::report::FaultReport;
use cd_formats::scan::AsciiText;
use cd_formats::snapshot::Snapshot;
use cd_formats::tact_behav::TactBehav;
use cd_formats::vloc_rloc::VlocRloc;
use cd_formats::wall_mesh::{MeshSides, WallMesh};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::bundle::files_of_bundle;

/// Reader of one kind of file.
#[derive(Clone, Copy)]
pub struct Reader {
    /// Name, that of the folder of its seeds in `fuzz/seeds` and of its target in `fuzz/fuzz_targets`.
    pub name: &'static str,
    /// Reads bytes; returns whether they were accepted.
    pub read: fn(&[u8]) -> bool,
}

/// All readers.
pub const READERS: [Reader; 30] = [
    Reader { name: "scene", read: read_scene },
    Reader { name: "changes", read: read_changes },
    Reader { name: "study", read: read_study },
    Reader { name: "bodies", read: read_bodies },
    Reader { name: "bulk_behav", read: |bytes| read_text(bytes, BulkBehav::parse_with_notices) },
    Reader { name: "tact_behav", read: |bytes| read_text(bytes, TactBehav::parse_with_notices) },
    Reader { name: "drv_dof", read: |bytes| read_text(bytes, DrvDof::parse_with_notices) },
    Reader { name: "dof", read: |bytes| read_text(bytes, Dof::parse_with_notices) },
    Reader { name: "vloc_rloc", read: |bytes| read_text(bytes, VlocRloc::parse_with_notices) },
    Reader { name: "postpro", read: |bytes| read_text(bytes, |path, text| Postpro::parse(path, text, 9)) },
    Reader { name: "compute", read: read_compute },
    Reader { name: "evolution", read: read_evolution },
    Reader { name: "snapshot", read: |bytes| read_file(bytes, "snapshot-000010.npz", Snapshot::read) },
    Reader { name: "snapshot_arrays", read: read_snapshot_arrays },
    Reader { name: "obj", read: |bytes| read_surface(bytes, "a.obj") },
    Reader { name: "stl", read: |bytes| read_surface(bytes, "a.stl") },
    Reader { name: "vtk", read: |bytes| read_surface(bytes, "a.vtk") },
    Reader { name: "vtp", read: |bytes| read_surface(bytes, "a.vtp") },
    Reader { name: "wall_mesh", read: |bytes| read_file(bytes, "a.obj", |path| WallMesh::read(path, MeshSides::One)) },
    Reader { name: "field_surface", read: |bytes| read_file(bytes, "a.obj", cd_formats::obj::read_surface) },
    Reader { name: "csv", read: |bytes| read_particles(bytes, "a.csv") },
    Reader { name: "xyz", read: |bytes| read_particles(bytes, "a.xyz") },
    Reader { name: "lammps", read: |bytes| read_particles(bytes, "a.dump") },
    Reader { name: "pkdgrav", read: |bytes| read_particles(bytes, "a.ss") },
    Reader { name: "fc3d", read: read_fc3d },
    Reader { name: "driver", read: read_driver },
    Reader {
        name: "steps",
        read: |bytes| read_file(bytes, "steps.csv", |path| cd_post::tables::read_log(path, &["step"])),
    },
    Reader {
        name: "checksums",
        read: |bytes| read_file(bytes, CHECKSUMS_FILE, |path| read_list(path.parent().unwrap_or(Path::new("")))),
    },
    Reader { name: "ron_value", read: read_flag },
    Reader { name: "case", read: read_case },
];

/// Reads bytes with the reader of this name; returns whether they were accepted. Panics if there is no such reader.
pub fn read(name: &str, bytes: &[u8]) -> bool {
    let reader = READERS.iter().find(|reader| reader.name == name).unwrap_or_else(|| panic!("no reader '{name}'"));
    (reader.read)(bytes)
}

/// Path that messages name.
const PATH: &str = "FILE";

/// Reads a text in columns.
fn read_text<T>(bytes: &[u8], read: impl Fn(&Path, &AsciiText) -> Result<T, Faults>) -> bool {
    is_accepted(read(Path::new(PATH), &AsciiText::new(bytes)))
}

/// Whether a result has no fault. The messages of the others are made, as a user would see them.
fn is_accepted<T>(result: Result<T, Faults>) -> bool {
    result.map_err(|faults| assert!(!faults.format_report("program").is_empty())).is_ok()
}

/// Folder of this process, in memory if the system has such a folder.
fn folder() -> PathBuf {
    let in_memory = Path::new("/dev/shm");
    let base = if in_memory.is_dir() { in_memory.to_path_buf() } else { std::env::temp_dir() };
    base.join(format!("cd-fuzz-{}", std::process::id()))
}

/// Writes a file to that folder.
fn file(bytes: &[u8], name: &str) -> PathBuf {
    let path = folder().join(name);
    fs::create_dir_all(folder()).and_then(|()| fs::write(&path, bytes)).expect("a file in a temporary folder");
    path
}

/// Removes the files that readers have read.
pub fn remove_files() {
    let _ = fs::remove_dir_all(folder());
}

/// Reads a file of that folder.
fn read_file<T>(bytes: &[u8], name: &str, read: impl Fn(&Path) -> Result<T, Faults>) -> bool {
    is_accepted(read(&file(bytes, name)))
}

fn read_surface(bytes: &[u8], name: &str) -> bool {
    read_file(bytes, name, cd_pre::shapes::read::read_surface)
}

fn read_particles(bytes: &[u8], name: &str) -> bool {
    read_file(bytes, name, |path| cd_pre::particles::read_particles(path, None))
}

/// Reads a scene and checks its values; makes no bodies, of which there may be many.
fn read_scene(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let scene = cd_pre::parse::parse_with_settings::<cd_pre::scene::Scene>(Path::new(PATH), &text, &[], "scene");
    is_accepted(scene.and_then(|scene| {
        let mut report = FaultReport::new(Path::new(PATH), &text);
        cd_pre::check::check_scene(&scene, &mut report);
        report.faults.into_result(())
    }))
}

fn read_changes(bytes: &[u8]) -> bool {
    is_accepted(cd_pre::from_outbox::read(Path::new(PATH), &String::from_utf8_lossy(bytes), &[]))
}

/// Reads a study and makes its combinations. As there are no scenes for them, no file is written; a study without other
/// faults counts as accepted.
fn read_study(bytes: &[u8]) -> bool {
    let path = file(bytes, "study.ron");
    let result = cd_pre::study::write(&path, &[], None, Some(&folder().join("cases")));
    let is_absent_file = |fault: &Fault| fault.found.contains("cannot be read");
    let only_lacks_files = result.as_ref().is_err_and(|faults| faults.0.iter().all(is_absent_file));
    is_accepted(result) || only_lacks_files
}

fn read_bodies(bytes: &[u8]) -> bool {
    read_text(bytes, Bodies::parse_rigid_with_notices) & read_text(bytes, Bodies::parse_with_notices)
}

fn read_compute(bytes: &[u8]) -> bool {
    let _ = SceneOrigin::from_compute_text(&String::from_utf8_lossy(bytes));
    read_file(bytes, "COMPUTE.RON", Compute::read)
}

/// Reads a table of an imposed velocity, which a DRV_DOF.DAT names.
fn read_evolution(bytes: &[u8]) -> bool {
    const DRIVEN: &str = include_str!("drv_dof.dat");
    let table = file(bytes, "v.dat");
    is_accepted(DrvDof::parse(&table.with_file_name("DRV_DOF.DAT"), &AsciiText::new(DRIVEN.as_bytes())))
}

/// Reads a snapshot with right checksums: the bytes are a bundle of its arrays.
fn read_snapshot_arrays(bytes: &[u8]) -> bool {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, array) in files_of_bundle(bytes) {
        // A name that is there already is an error of the writer.
        if archive.start_file(name, stored).is_ok() {
            archive.write_all(array).expect("bytes in memory");
        }
    }
    let archive = archive.finish().expect("bytes in memory").into_inner();
    read_file(&archive, "snapshot-000010.npz", Snapshot::read)
}

fn read_fc3d(bytes: &[u8]) -> bool {
    is_accepted(Fc3d::parse(Path::new(PATH), &String::from_utf8_lossy(bytes)))
}

fn read_driver(bytes: &[u8]) -> bool {
    let case = folder().join("case");
    read_file(bytes, "driver.py", |path| cd_solve::read::driver::read_driver(path, &case, &ComputeFlags::default()))
}

/// Reads a value as those of flags and settings.
fn read_flag(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    cd_formats::ron_text::from_flag::<Vec<cd_formats::compute::Event>>(&text).is_ok()
}

/// Reads a whole DATBOX: the bytes are a bundle of its files.
fn read_case(bytes: &[u8]) -> bool {
    let case = folder().join("case");
    let datbox = case.join("DATBOX");
    let _ = fs::remove_dir_all(&datbox);
    fs::create_dir_all(&datbox).expect("a folder in the temporary folder");
    for (name, file) in files_of_bundle(bytes) {
        // A file system may not allow the name.
        let _ = fs::write(datbox.join(name), file);
    }
    is_accepted(cd_solve::read::read_case(&case, &ComputeFlags::default()))
}
