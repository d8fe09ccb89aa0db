//! Particles from files of other programs: positions, radii, velocities, spins and masses in SI units.
//!
//! | module | |
//! |---|---|
//! | `state` | particles of a file |
//! | `columns` | named columns of numbers, of all text formats |
//! | `csv` | tables with a header, templates of clumps of LIGGGHTS |
//! | `xyz` | XYZ and extended XYZ |
//! | `lammps` | text dumps of LAMMPS and LIGGGHTS |
//! | `pkdgrav` | `ss` files of pkdgrav |

mod columns;
mod csv;
mod lammps;
mod pkdgrav;
mod state;
mod xyz;

use std::path::Path;

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};

use crate::scene::ParticleFormat;
pub use state::ParticleState;

/// Number of faults of one file that are printed one by one.
const MAX_PRINTED_FAULTS: usize = 5;

/// Reads the particles of a file; without `format` its ending decides.
///
/// Errors: a file that cannot be read, and every fault of its numbers, with line and column.
pub fn read_particles(path: &Path, format: Option<ParticleFormat>) -> Result<ParticleState, Faults> {
    let Some(format) = format.or_else(|| format_of_ending(path)) else {
        let expected = "expected .csv, .xyz, .extxyz, .dump, .lammpstrj, .multisphere or .ss, or a format in the scene";
        return Err(Fault::new(path, None, "file", "an ending that names no format", expected).into());
    };
    let mut faults = Faults::default();
    let state = match format {
        ParticleFormat::Pkdgrav => {
            let bytes = atomic::read_bytes(path)?;
            pkdgrav::read(path, &bytes, &mut faults)
        }
        ParticleFormat::Csv => csv::read(path, &atomic::read_text(path)?, &mut faults),
        ParticleFormat::Multisphere => csv::read_multisphere(path, &atomic::read_text(path)?, &mut faults),
        ParticleFormat::Xyz => xyz::read(path, &atomic::read_text(path)?, &mut faults),
        ParticleFormat::Lammps => lammps::read(path, &atomic::read_text(path)?, &mut faults),
    };
    if faults.0.is_empty() && state.centres.is_empty() {
        faults.push(Fault::new(path, None, "file", "no particles", "expected at least one"));
    }
    if faults.0.len() > MAX_PRINTED_FAULTS {
        let others = faults.0.len() - MAX_PRINTED_FAULTS;
        let found = format!("{}{others} more faults", if faults.are_too_many() { "at least " } else { "" });
        faults.0.truncate(MAX_PRINTED_FAULTS);
        faults.push(Fault::new(path, None, "file", found, "correct those above first"));
    }
    faults.into_result(state)
}

/// Format of the files with an ending; none for others.
fn format_of_ending(path: &Path) -> Option<ParticleFormat> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    Some(match ending.as_str() {
        "csv" => ParticleFormat::Csv,
        "xyz" | "extxyz" => ParticleFormat::Xyz,
        "dump" | "lammpstrj" => ParticleFormat::Lammps,
        "multisphere" => ParticleFormat::Multisphere,
        "ss" => ParticleFormat::Pkdgrav,
        _ => return None,
    })
}
