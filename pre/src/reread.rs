//! Checks of the files of DATBOX, with the digits that are to be written, by the functions of cd-solve: bodies that cd-solve
//! would reject are rejected before anything is written.

use std::collections::BTreeSet;
use std::path::Path;

use cd_formats::bodies::{Bodies, Body};
use cd_formats::bulk_behav::BulkBehav;
use cd_formats::compute::Compute;
use cd_formats::dof::Dof;
use cd_formats::drv_dof::DrvDof;
use cd_formats::error::{Faults, RecordFault};
use cd_formats::names::{number_text, rounded_number};
use cd_formats::probe::{check_energy_conditions, named_bodies, unknown_bodies};
use cd_formats::report::FaultReport;
use cd_formats::scan::AsciiText;
use cd_formats::sinks_and_sources::source_bodies;
use cd_formats::tact_behav::TactBehav;
use rayon::prelude::*;

/// Reads the files (name and bytes) of the folder `datbox` and checks each body by the functions that cd-solve uses.
/// `driven` are the rows of DRV_DOF.DAT, whose tables may not be written yet.
///
/// A fault of body k (from 0) is reported at the path `scene_path(k)` of the scene: the first fault of each path, with a count
/// of the others. Faults of the files themselves name the files.
pub fn check_files<'a>(
    datbox: &Path,
    files: impl Iterator<Item = (&'a str, &'a [u8])>,
    driven: &DrvDof,
    options: &Compute,
    scene_path: impl Fn(usize) -> String,
    report: &mut FaultReport,
) {
    let (mut bodies, mut bulk) = (None, None);
    let faults: &mut Faults = &mut report.faults;
    for (file, bytes) in files {
        let (path, text) = (datbox.join(file), AsciiText::new(bytes));
        match file {
            "BODIES.DAT" => bodies = faults.gather_result(Bodies::parse(&path, &text)),
            "BULK_BEHAV.DAT" => bulk = faults.gather_result(BulkBehav::parse(&path, &text)),
            "TACT_BEHAV.DAT" => drop(faults.gather_result(TactBehav::parse(&path, &text))),
            "DOF.INI" => drop(faults.gather_result(Dof::parse(&path, &text))),
            _ => {}
        }
    }
    let (Some(bodies), Some(bulk)) = (bodies, bulk) else { return };
    check_probes(&bodies, options, report);
    let has_potential = options.has_potential(&bulk.gravity, bodies.0.len());
    check_energy_conditions(&options.until, has_potential, "compute.", report);
    let mut is_driven = vec![false; bodies.0.len()];
    for row in driven.0.iter().filter(|row| row.kind.imposes_velocity()) {
        is_driven.get_mut(row.body).into_iter().for_each(|is_driven| *is_driven = true);
    }
    let periods = options.periods();
    let body_fault = |(k, body): (usize, &Body)| {
        let density = bulk.materials.iter().find(|m| m.name == body.material).map_or(1.0, |m| m.density);
        match body.check_at_density(density) {
            Err(fault) => Some((k, fault)),
            Ok(checked) => {
                // A larger body could touch more than the nearest image. Walls, which are driven, may span the period.
                let extent = 2.0 * checked.bounding_radius(body);
                let period = periods.into_iter().flatten().find(|period| !is_driven[k] && 2.0 * extent >= *period)?;
                let found = format!(
                    "up to {} m long in a scene with the period {} m",
                    rounded_number(extent),
                    number_text(period)
                );
                Some((k, RecordFault::new(found, "expected less than half of that")))
            }
        }
    };
    let faults: Vec<(usize, RecordFault)> = bodies.0.par_iter().enumerate().filter_map(body_fault).collect();
    // The first fault of each path.
    let mut body_faults: Vec<BodyFault> = Vec::new();
    for (k, fault) in faults {
        let path = scene_path(k);
        match body_faults.iter_mut().find(|known| known.path == path) {
            Some(known) => known.others += 1,
            None => body_faults.push(BodyFault { path, body: k, fault, others: 0 }),
        }
    }
    for BodyFault { path, body, fault, others } in body_faults {
        let others = if others > 0 { format!(" (and {others} more like it)") } else { String::new() };
        let found = format!("body {} as written in BODIES.DAT{others}: {}", body + 1, fault.found);
        report.add_fault(&path, found, fault.expected.trim_start_matches("expected "));
    }
}

/// Fault of the first body from a path of the scene.
struct BodyFault {
    path: String,
    body: usize,
    fault: RecordFault,
    /// Number of other bodies from this path that have a fault.
    others: usize,
}

/// Reports probes, end conditions and sources of bodies that are not among `bodies`.
fn check_probes(bodies: &Bodies, options: &Compute, report: &mut FaultReport) {
    let colours: BTreeSet<&str> =
        bodies.0.iter().flat_map(|body| &body.contactors).map(|contactor| contactor.colour.as_str()).collect();
    let colours: Vec<&str> = colours.into_iter().collect();
    for (path, selection) in named_bodies(&options.probes, &options.until).chain(source_bodies(&options.sources)) {
        if let Some((found, expected)) = unknown_bodies(selection, bodies.0.len(), &colours) {
            report.add_fault(&format!("compute.{path}"), found, expected);
        }
    }
}
