//! Text dumps of LAMMPS and LIGGGHTS, of the styles `atom` and `custom`.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use nalgebra::{Matrix3, Vector3};

use super::columns::{DumpBox, ParticleTable, words_with_columns};
use super::state::ParticleState;

/// Reads the last time of a dump. Particles are sorted by `id`.
pub fn read(path: &Path, text: &str, faults: &mut Faults) -> ParticleState {
    let lines: Vec<&str> = text.lines().collect();
    let Some(start) = lines.iter().rposition(|line| line.trim() == "ITEM: TIMESTEP") else {
        let expected = "expected the line 'ITEM: TIMESTEP' of a text dump";
        faults.push(Fault::new(path, Some(1), "dump", "no time step", expected));
        return ParticleState::default();
    };
    let mut dump_box = DumpBox::default();
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
            let lines = [0, 1, 2].map(|axis| (at + 2 + axis, value(1 + axis)));
            dump_box = if line.contains("abc origin") {
                general_box(lines.map(|(number, line)| read_edge(path, number, line, faults)))
            } else {
                dump_box_of(lines.map(|(number, line)| read_bounds(path, number, line, faults)))
            };
        } else if let Some(names) = line.strip_prefix("ITEM: ATOMS") {
            let names: Vec<&str> = names.split_whitespace().collect();
            let mut table = ParticleTable::new(path, at + 1, &names, faults);
            let rows = (at + 2..).zip(lines.iter().skip(at + 1)).take_while(|(_, line)| !line.starts_with("ITEM:"));
            for (number, line) in rows.filter(|(_, line)| !line.trim().is_empty()) {
                table.add_row(number, &words_with_columns(line, None), faults);
            }
            if let Some(count) = count.filter(|count| *count != table.row_count() && faults.0.is_empty()) {
                let found = format!("{} lines for {count} atoms", table.row_count());
                faults.push(Fault::new(path, Some(at + 1), "atoms", found, "expected a line for each"));
            }
            if let Some(number) = table.repeated_number() {
                let found = format!("id {number} is that of two lines");
                faults.push(Fault::new(path, Some(at + 1), "atoms", found, "expected each id once"));
            }
            return ParticleState { part: format!("step {step}"), ..table.into_state(&dump_box) };
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

/// Reads the lower and upper end of the box, or of the rectangular box around one that is tilted, along an axis, and its tilt,
/// m: xy in the line of x, xz in that of y, yz in that of z.
fn read_bounds(path: &Path, number: usize, line: &str, faults: &mut Faults) -> [f64; 3] {
    match finite_numbers(line).as_deref() {
        Some(&[low, high]) => [low, high, 0.0],
        Some(&[low, high, tilt]) => [low, high, tilt],
        _ => {
            let expected = "expected the two ends of the box, and the tilt of one that is not rectangular";
            faults.push(Fault::new(path, Some(number), "box bounds", format!("'{line}'"), expected));
            [0.0, 1.0, 0.0]
        }
    }
}

/// Box of the three lines of bounds. The edges are (a, 0, 0), (xy, b, 0) and (xz, yz, c); the bounds of LAMMPS are those of the
/// rectangular box around them: `xlo_bound` = `xlo` + min(0, xy, xz, xy + xz), `ylo_bound` = `ylo` + min(0, yz), and the upper
/// ones with the maximum.
fn dump_box_of([[x_low, x_high, xy], [y_low, y_high, xz], [z_low, z_high, yz]]: [[f64; 3]; 3]) -> DumpBox {
    let x_tilts = [0.0, xy, xz, xy + xz];
    let [x_below, y_below] = [x_tilts.into_iter().fold(0.0, f64::min), yz.min(0.0)];
    let [x_above, y_above] = [x_tilts.into_iter().fold(0.0, f64::max), yz.max(0.0)];
    let corner = Vector3::new(x_low - x_below, y_low - y_below, z_low);
    let lengths = Vector3::new(x_high - x_above, y_high - y_above, z_high) - corner;
    DumpBox { corner, edges: Matrix3::new(lengths.x, xy, xz, 0.0, lengths.y, yz, 0.0, 0.0, lengths.z) }
}

/// Reads an edge of a box that is tilted in any direction, and the component of its origin along the axis of the line, m.
fn read_edge(path: &Path, number: usize, line: &str, faults: &mut Faults) -> [f64; 4] {
    if let Some(&[x, y, z, origin]) = finite_numbers(line).as_deref() {
        return [x, y, z, origin];
    }
    let expected = "expected the three components of an edge, and one of the origin";
    faults.push(Fault::new(path, Some(number), "box bounds", format!("'{line}'"), expected));
    [0.0; 4]
}

/// Box of the lines of the three edges.
fn general_box(rows: [[f64; 4]; 3]) -> DumpBox {
    let edges = rows.map(|[x, y, z, _]| Vector3::new(x, y, z));
    DumpBox { corner: rows.map(|[.., origin]| origin).into(), edges: Matrix3::from_columns(&edges) }
}

/// Numbers of a line; `None` if a word is not a finite number.
fn finite_numbers(line: &str) -> Option<Vec<f64>> {
    line.split_whitespace().map(|word| word.parse().ok().filter(|number: &f64| number.is_finite())).collect()
}
