//! Solid fraction and coordination number of a packing, from the observables that cd-post has written for the run.

use cd_formats::atomic;
use cd_formats::report::FaultReport;

use super::source::SourceCase;
use crate::scene::Law;

/// Table of cd-post with a row for each snapshot, in the folder of a case.
const SERIES_FILE: &str = "POSTPRO/series.csv";

/// Measured values of the packing of a snapshot.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MeasuredPacking {
    solid_fraction: f64,
    coordination: f64,
}

/// Completes the bulk strengths of `laws` that do not give `nu` or `z` by the values of series.csv for the snapshot of the
/// source. Returns a line for each such law with these values, or reports it if the table does not have them.
pub fn complete_bulk_strengths(laws: &mut [Law], source: &SourceCase, report: &mut FaultReport) -> String {
    let mut lines = String::new();
    for (k, law) in laws.iter_mut().enumerate() {
        let Some(bulk) = law.bulk_strength.as_mut().filter(|bulk| bulk.nu.is_none() || bulk.z.is_none()) else {
            continue;
        };
        match measured_packing(source) {
            Ok(MeasuredPacking { solid_fraction, coordination }) => {
                bulk.nu = bulk.nu.or(Some(solid_fraction));
                bulk.z = bulk.z.or(Some(coordination));
                lines += &format!(
                    "law {}: the packing has nu {solid_fraction:.4} and z {coordination:.4}, see {}\n",
                    law.name,
                    source.case.join(SERIES_FILE).display()
                );
            }
            Err(found) => {
                let case = source.case.display();
                let expected =
                    format!("nu and z, or both as cd-post measures them: run cd-post {case} --no-vtk --no-plots first");
                report.add_fault(&format!("laws.{k}.bulk_strength"), found, expected);
            }
        }
    }
    lines
}

/// Row of series.csv with the step of the snapshot. Errors, in words: no such row or table, a table of another run, or a packing
/// without contacts.
fn measured_packing(source: &SourceCase) -> Result<MeasuredPacking, String> {
    let (path, meta) = (source.case.join(SERIES_FILE), &source.snapshot.meta);
    let shown = path.display();
    let Ok(text) = atomic::read_text(&path) else { return Err(format!("no nu or z, and no table {shown}")) };
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<&str>>());
    let header = lines.next().unwrap_or_default();
    let column = |name: &str| header.iter().position(|known| *known == name);
    let [Some(step), Some(nu), Some(z), Some(work)] = ["step", "nu", "Z", "E_contacts"].map(column) else {
        return Err(format!("no nu or z, and {shown} without the columns step, nu, Z and E_contacts"));
    };
    let number = |row: &[&str], k: usize| row.get(k).and_then(|field| field.parse::<f64>().ok());
    let row = lines.find(|row| row.get(step).and_then(|field| field.parse().ok()) == Some(meta.step));
    let Some(row) = row else {
        return Err(format!("no nu or z, and {shown} without the snapshot of step {}", meta.step));
    };
    // The table has all digits: another run of the case has done other work.
    if number(&row, work) != Some(meta.ledger.contact_work) {
        return Err(format!("no nu or z, and {shown} with step {} of another run", meta.step));
    }
    match (number(&row, nu), number(&row, z)) {
        (Some(solid_fraction), Some(coordination)) if solid_fraction > 0.0 && coordination > 0.0 => {
            Ok(MeasuredPacking { solid_fraction, coordination })
        }
        _ => Err(format!("no nu or z, and no packing with contacts at step {} in {shown}", meta.step)),
    }
}
