//! Copies of DATBOX in OUTBOX, for `--text`: with them and a state, OUTBOX is the DATBOX of a continued run of LMGC90 or
//! cd-solve.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::bodies::Bodies;
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::Compute;
use cd_formats::drv_dof::{DrvDof, Evolution, table_text};
use cd_formats::error::{Fault, Faults};
use cd_formats::scan::AsciiText;
use cd_formats::tact_behav::TactBehav;

const DRIVEN_COPY: &str = "DRV_DOF.OUT";

const BODIES_COPY: &str = "BODIES.OUT";

/// Names in OUTBOX, apart from names of tables and surfaces.
pub const INPUT_COPIES: [&str; 5] = [BODIES_COPY, "BULK_BEHAV.OUT", "TACT_BEHAV.OUT", DRIVEN_COPY, "COMPUTE.RON"];

/// Writes BODIES.OUT, with centred bodies in the axes of DOF.OUT.k, the surfaces that it names, BULK_BEHAV.OUT,
/// TACT_BEHAV.OUT, DRV_DOF.OUT and the tables that it names, all with as many digits as their columns hold, and COMPUTE.RON
/// with the options of the run on which results depend, without which a continued run would have those of a folder of
/// LMGC90.
pub fn write_input_copies(datbox: &Path, outbox: &Path, options: &Compute) -> Result<(), Faults> {
    let file = datbox.join("BODIES.DAT");
    let bodies = Bodies::read(&file)?
        .centred_bodies()
        .map_err(|found| Fault::new(&file, None, "bodies", found.to_string(), "expected closed surfaces"))?;
    let driven = DrvDof::read(&datbox.join("DRV_DOF.DAT"))?;
    // Rows that name laws that are not defined are copied, too; the run has reported them.
    let tact = datbox.join("TACT_BEHAV.DAT");
    let (tact, _) = TactBehav::parse_with_notices(&tact, &AsciiText::read_file(&tact)?)?;
    let Compute { steps, end_time, threads, .. } = Compute::default();
    let texts = [
        bodies.to_long_text(),
        BulkBehav::read(&datbox.join("BULK_BEHAV.DAT"))?.to_long_text(),
        tact.to_long_text(),
        driven.to_long_text(),
        // The length of the run and its threads are its own: they change no result, and a resumed run may have others.
        Compute { steps, end_time, threads, ..options.clone() }.to_text(),
    ];
    let mut files: Vec<(PathBuf, String)> = tables(&driven).map(|(name, text)| (outbox.join(name), text)).collect();
    files.extend(bodies.mesh_files().into_iter().map(|(name, text)| (outbox.join(name), text)));
    files.extend(INPUT_COPIES.iter().map(|name| outbox.join(name)).zip(texts));
    atomic::write_all(files.iter().map(|(path, text)| (path.clone(), text.as_bytes())))
}

/// Files of an earlier run by [`write_input_copies`].
pub fn written_copies(outbox: &Path) -> BTreeSet<PathBuf> {
    let driven = outbox.join(DRIVEN_COPY);
    let driven =
        if atomic::path_exists(&driven) { DrvDof::read(&driven).unwrap_or_default() } else { DrvDof::default() };
    let table_copies = tables(&driven).map(|(name, _)| outbox.join(name));
    let mesh_copies = Bodies::mesh_names(&outbox.join(BODIES_COPY)).into_iter().map(|name| outbox.join(name));
    INPUT_COPIES.iter().map(|name| outbox.join(name)).chain(table_copies).chain(mesh_copies).collect()
}

/// Names and texts of the tables of imposed motion.
fn tables(driven: &DrvDof) -> impl Iterator<Item = (&str, String)> {
    driven.0.iter().filter_map(|row| match &row.evolution {
        Evolution::Table { name, points } => Some((name.as_str(), table_text(points))),
        Evolution::Harmonic { .. } => None,
    })
}
