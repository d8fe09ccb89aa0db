//! Tables with a header, separated by commas, semicolons, tabs or blanks, and templates of clumps, which have none.

use std::path::Path;

use cd_formats::error::{Fault, Faults};

use super::columns::{DumpBox, ParticleTable, words_with_columns};
use super::state::ParticleState;

/// Reads the balls of a template of LIGGGHTS, a line each: x, y, z and radius, separated by blanks; `#` begins a comment.
pub fn read_multisphere(path: &Path, text: &str, faults: &mut Faults) -> ParticleState {
    let mut table = ParticleTable::new(path, 1, &["x", "y", "z", "r"], faults);
    for (number, line) in (1..).zip(text.lines()) {
        let words = words_with_columns(line.split('#').next().unwrap_or_default(), None);
        if !words.is_empty() {
            table.add_row(number, &words, faults);
        }
    }
    table.into_state(&DumpBox::default())
}

/// Reads a table. Its first line that is not empty is the header, with or without a `#` before it; later lines that begin
/// with `#` are comments.
pub fn read(path: &Path, text: &str, faults: &mut Faults) -> ParticleState {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let Some((number, header)) = lines.next() else { return ParticleState::default() };
    let header = header.trim().trim_start_matches('#').trim_start();
    let separator = [',', ';', '\t'].into_iter().find(|separator| header.contains(*separator));
    let column_name = |word: &str| word.trim_matches('"').trim().to_string();
    let names: Vec<String> = words_with_columns(header, separator).iter().map(|(_, word)| column_name(word)).collect();
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        let expected = "expected the names of the columns, such as x,y,z,radius";
        faults.push(Fault::new(path, Some(number), "header", "numbers", expected));
        return ParticleState::default();
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut table = ParticleTable::new(path, number, &names, faults);
    for (number, line) in lines.filter(|(_, line)| !line.trim_start().starts_with('#')) {
        table.add_row(number, &words_with_columns(line, separator), faults);
    }
    table.into_state(&DumpBox::default())
}
