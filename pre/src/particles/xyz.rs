//! XYZ files: the number of particles, a comment, and a line for each particle, once or for each of several times.

use std::path::Path;

use cd_formats::error::{Fault, Faults};

use super::columns::{DumpBox, ParticleTable, words_with_columns};
use super::state::ParticleState;

/// Reads the last frame of a file.
///
/// The columns are those of `Properties=` in the comment (extended XYZ), otherwise species, x, y, z, and, if the lines have
/// them, radius, vx, vy, vz.
pub fn read(path: &Path, text: &str, faults: &mut Faults) -> ParticleState {
    let lines: Vec<&str> = text.lines().collect();
    let mut state = ParticleState::default();
    let (mut start, mut frame) = (0, 0);
    while lines.get(start).is_some_and(|line| !line.trim().is_empty()) {
        frame += 1;
        let Ok(count) = lines[start].trim().parse::<usize>() else {
            let found = format!("'{}'", lines[start].trim());
            let fault = Fault::new(path, Some(start + 1), "number of particles", found, "expected an integer");
            faults.push(Fault { column: Some(1), ..fault });
            return state;
        };
        let first = start + 2;
        let Some(rows) = first.checked_add(count).and_then(|end| lines.get(first..end)) else {
            let found = format!("{} lines for {count} particles", (lines.len() - start).saturating_sub(2));
            faults.push(Fault::new(path, Some(start + 1), "number of particles", found, "expected a line for each"));
            return state;
        };
        let end = first + count;
        // Earlier frames are skipped.
        if lines.get(end).is_none_or(|line| line.trim().is_empty()) {
            let names = column_names(lines[start + 1], rows.first().copied().unwrap_or_default());
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let mut table = ParticleTable::new(path, start + 2, &names, faults);
            for (number, line) in (first + 1..).zip(rows) {
                table.add_row(number, &words_with_columns(line, None), faults);
            }
            state = table.into_state(&DumpBox::default());
            if frame > 1 {
                state.part = format!("frame {frame}");
            }
        }
        start = end;
    }
    state
}

/// Names of the columns: those of the comment, or as many of the usual ones as the first row has values.
fn column_names(comment: &str, first_row: &str) -> Vec<String> {
    let properties = comment.split_whitespace().find_map(|word| word.strip_prefix("Properties="));
    let Some(properties) = properties else {
        let usual = ["species", "x", "y", "z", "radius", "vx", "vy", "vz"];
        let count = first_row.split_whitespace().count();
        let count = if count >= 8 { 8 } else { count.clamp(4, 5) };
        return usual[..count].iter().map(ToString::to_string).collect();
    };
    let fields: Vec<&str> = properties.trim_matches('"').split(':').collect();
    let mut names = Vec::new();
    for field in fields.chunks(3) {
        let count = field.get(2).and_then(|count| count.parse::<usize>().ok()).unwrap_or(1).min(100);
        let prefix = match field[0].to_ascii_lowercase().as_str() {
            "pos" | "position" => "",
            "velo" | "vel" | "velocity" | "velocities" => "v",
            "angular_velocity" | "omega" | "spin" => "omega",
            _ => field[0],
        };
        for axis in 0..count {
            names.push(if count == 3 { format!("{prefix}{}", ["x", "y", "z"][axis]) } else { prefix.to_string() });
        }
    }
    names
}
