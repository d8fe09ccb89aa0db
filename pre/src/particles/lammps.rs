//! Text dumps of LAMMPS and LIGGGHTS, of the styles `atom` and `custom`.

use std::path::Path;

use cd_formats::error::{Fault, Faults};

use super::columns::{ParticleTable, words_with_columns};
use super::state::ParticleState;

/// Reads the last time of a dump. Particles are sorted by `id`.
pub fn read(path: &Path, text: &str, faults: &mut Faults) -> ParticleState {
    let lines: Vec<&str> = text.lines().collect();
    let Some(start) = lines.iter().rposition(|line| line.trim() == "ITEM: TIMESTEP") else {
        let expected = "expected the line 'ITEM: TIMESTEP' of a text dump";
        faults.push(Fault::new(path, Some(1), "dump", "no time step", expected));
        return ParticleState::default();
    };
    let mut bounds = [[0.0, 1.0]; 3];
    let (mut step, mut count) = (String::new(), None);
    let mut at = start;
    while let Some(line) = lines.get(at) {
        let value = |offset: usize| lines.get(at + offset).map_or("", |line| line.trim());
        if line.trim() == "ITEM: TIMESTEP" {
            step = value(1).to_string();
        } else if line.starts_with("ITEM: NUMBER OF ATOMS") {
            count = value(1).parse::<usize>().ok();
            if count.is_none() {
                let found = format!("'{}'", value(1));
                faults.push(Fault::new(path, Some(at + 2), "number of atoms", found, "expected an integer"));
            }
        } else if line.starts_with("ITEM: BOX BOUNDS") {
            for (axis, bounds) in bounds.iter_mut().enumerate() {
                read_bounds(path, at + 2 + axis, value(1 + axis), bounds, faults);
            }
        } else if let Some(names) = line.strip_prefix("ITEM: ATOMS") {
            let names: Vec<&str> = names.split_whitespace().collect();
            let mut table = ParticleTable::new(path, at + 1, &names, faults);
            let rows = (at + 2..).zip(lines.iter().skip(at + 1)).take(count.unwrap_or(usize::MAX));
            for (number, line) in rows.filter(|(_, line)| !line.trim().is_empty()) {
                table.add_row(number, &words_with_columns(line, None), faults);
            }
            if let Some(count) = count.filter(|count| *count != table.row_count() && faults.0.is_empty()) {
                let found = format!("{} lines for {count} atoms", table.row_count());
                faults.push(Fault::new(path, Some(at + 1), "atoms", found, "expected a line for each"));
            }
            return ParticleState { part: format!("step {step}"), ..table.into_state(bounds) };
        }
        at += 1;
    }
    faults.push(Fault::new(
        path,
        Some(start + 1),
        "dump",
        "no atoms",
        "expected 'ITEM: ATOMS' with the names of columns",
    ));
    ParticleState::default()
}

/// Reads the ends of the box along an axis; a third number, the tilt of a box that is not rectangular, must be 0.
fn read_bounds(path: &Path, number: usize, line: &str, bounds: &mut [f64; 2], faults: &mut Faults) {
    let ends: Vec<Option<f64>> =
        line.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|end| end.is_finite())).collect();
    match ends.as_slice() {
        [Some(low), Some(high)] | [Some(low), Some(high), Some(0.0)] => *bounds = [*low, *high],
        _ => {
            let expected = "expected the two ends of a rectangular box";
            faults.push(Fault::new(path, Some(number), "box bounds", format!("'{line}'"), expected));
        }
    }
}
