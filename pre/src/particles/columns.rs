//! Named columns of numbers, of all text formats of particles.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use nalgebra::{Matrix3, Vector3};

use super::state::ParticleState;

/// Quantity in a column of a table of particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnQuantity {
    /// Coordinate along an axis, m.
    Position(usize),
    /// Coordinate along an axis as a fraction of the box of the dump.
    ScaledPosition(usize),
    /// m
    Radius,
    /// m
    Diameter,
    /// m/s
    Velocity(usize),
    /// rad/s
    Spin(usize),
    /// kg
    Mass,
    /// Number of the particle, by which particles are sorted.
    Number,
    /// Column that is not used.
    Unused,
}

impl ColumnQuantity {
    /// Quantity of a column with this name, in upper or lower case; `Unused` for names that are not known.
    pub fn from_name(name: &str) -> ColumnQuantity {
        let name = name.to_ascii_lowercase();
        let axis = |prefixes: &[&str], suffix: &str| {
            let axis_of = |prefix: &&str| {
                let letter = name.strip_prefix(prefix)?.strip_suffix(suffix)?;
                ["x", "y", "z"].iter().position(|axis| *axis == letter)
            };
            prefixes.iter().find_map(axis_of)
        };
        match name.as_str() {
            "radius" | "r" => return ColumnQuantity::Radius,
            "diameter" | "d" => return ColumnQuantity::Diameter,
            "mass" | "m" => return ColumnQuantity::Mass,
            "id" => return ColumnQuantity::Number,
            _ => {}
        }
        if let Some(axis) = axis(&[""], "").or(axis(&[""], "u")) {
            ColumnQuantity::Position(axis)
        } else if let Some(axis) = axis(&[""], "s").or(axis(&[""], "su")) {
            ColumnQuantity::ScaledPosition(axis)
        } else if let Some(axis) = axis(&["v", "velo_", "vel_"], "") {
            ColumnQuantity::Velocity(axis)
        } else if let Some(axis) = axis(&["omega", "w", "spin_", "omega_"], "") {
            ColumnQuantity::Spin(axis)
        } else {
            ColumnQuantity::Unused
        }
    }
}

/// Box of a dump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DumpBox {
    /// Corner at which all fractions of the box are 0, m.
    pub corner: Vector3<f64>,
    /// Edges as columns, m.
    pub edges: Matrix3<f64>,
}

impl Default for DumpBox {
    /// The unit cube.
    fn default() -> Self {
        DumpBox { corner: Vector3::zeros(), edges: Matrix3::identity() }
    }
}

/// Columns of a table, and the rows that were read.
pub struct ParticleTable<'a> {
    path: &'a Path,
    columns: Vec<ColumnQuantity>,
    /// Numbers of each row, in the order of the columns; 0 in those that are not used.
    rows: Vec<Vec<f64>>,
}

impl<'a> ParticleTable<'a> {
    /// Empty table with columns of these names, given in `line` of the file.
    ///
    /// Errors: no position, some components of a vector without the others, or two columns of one quantity.
    pub fn new(path: &'a Path, line: usize, names: &[&str], faults: &mut Faults) -> ParticleTable<'a> {
        let columns: Vec<ColumnQuantity> = names.iter().map(|name| ColumnQuantity::from_name(name)).collect();
        let count = |quantity: ColumnQuantity| columns.iter().filter(|column| **column == quantity).count();
        let mut fault =
            |found: String, expected: &str| faults.push(Fault::new(path, Some(line), "columns", found, expected));
        let listed = names.join(" ");
        let kinds: [fn(usize) -> ColumnQuantity; 4] =
            [ColumnQuantity::Position, ColumnQuantity::ScaledPosition, ColumnQuantity::Velocity, ColumnQuantity::Spin];
        for (kind, axes) in kinds.into_iter().zip(["x y z", "xs ys zs", "vx vy vz", "omegax omegay omegaz"]) {
            let counts = [0, 1, 2].map(|axis| count(kind(axis)));
            if counts.iter().any(|count| *count > 0) && counts != [1; 3] {
                fault(format!("'{listed}'"), &format!("expected each of {axes} once, or none"));
            }
        }
        if count(ColumnQuantity::Position(0)) + count(ColumnQuantity::ScaledPosition(0)) != 1 {
            fault(format!("'{listed}'"), "expected one position: the columns x y z");
        }
        if count(ColumnQuantity::Radius) + count(ColumnQuantity::Diameter) > 1 || count(ColumnQuantity::Mass) > 1 {
            fault(format!("'{listed}'"), "expected radius or diameter, and mass, at most once");
        }
        ParticleTable { path, columns, rows: Vec::new() }
    }

    /// Adds the row in `line` of the file from its `words`, each with its column of the text, from 1.
    pub fn add_row(&mut self, line: usize, words: &[(usize, &str)], faults: &mut Faults) {
        let particle = format!("particle {}", self.rows.len() + 1);
        if words.len() < self.columns.len() {
            let found = format!("{} values", words.len());
            let expected = format!("expected {}, one for each column", self.columns.len());
            return faults.push(Fault::new(self.path, Some(line), particle, found, expected));
        }
        let mut row = Vec::with_capacity(self.columns.len());
        for (quantity, (column, word)) in self.columns.iter().zip(words) {
            if *quantity == ColumnQuantity::Unused {
                row.push(0.0);
                continue;
            }
            let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
            let is_size = matches!(quantity, ColumnQuantity::Radius | ColumnQuantity::Diameter | ColumnQuantity::Mass);
            match value {
                Some(value) if !is_size || value > 0.0 => row.push(value),
                _ => {
                    let expected = if is_size { "expected a number > 0" } else { "expected a finite number" };
                    let fault = Fault::new(self.path, Some(line), particle.clone(), format!("'{word}'"), expected);
                    faults.push(Fault { column: Some(*column), ..fault });
                    row.push(1.0);
                }
            }
        }
        self.rows.push(row);
    }

    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.rows.len()
    }

    /// A number that two rows have, if there is one.
    pub fn repeated_number(&self) -> Option<f64> {
        let column = self.columns.iter().position(|column| *column == ColumnQuantity::Number)?;
        let mut numbers: Vec<f64> = self.rows.iter().map(|row| row[column]).collect();
        numbers.sort_by(f64::total_cmp);
        numbers.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
    }

    /// Particles of the rows, by increasing number if there is such a column. Positions that are fractions of a box are those of
    /// `dump_box`.
    pub fn into_state(mut self, dump_box: &DumpBox) -> ParticleState {
        let position = |quantity: ColumnQuantity| self.columns.iter().position(|column| *column == quantity);
        if let Some(number) = position(ColumnQuantity::Number) {
            self.rows.sort_by(|a, b| a[number].total_cmp(&b[number]));
        }
        let vectors = |kind: fn(usize) -> ColumnQuantity| {
            let [x, y, z] = [position(kind(0))?, position(kind(1))?, position(kind(2))?];
            Some(self.rows.iter().map(|row| Vector3::new(row[x], row[y], row[z])).collect::<Vec<_>>())
        };
        let numbers = |quantity: ColumnQuantity| {
            let column = position(quantity)?;
            Some(self.rows.iter().map(|row| row[column]).collect::<Vec<f64>>())
        };
        let position_of_share = |share: &Vector3<f64>| dump_box.corner + dump_box.edges * share;
        let scaled =
            vectors(ColumnQuantity::ScaledPosition).map(|points| points.iter().map(position_of_share).collect());
        ParticleState {
            centres: vectors(ColumnQuantity::Position).or(scaled).unwrap_or_default(),
            radii: numbers(ColumnQuantity::Radius)
                .or(numbers(ColumnQuantity::Diameter).map(|diameters| diameters.iter().map(|d| 0.5 * d).collect())),
            velocities: vectors(ColumnQuantity::Velocity),
            spins: vectors(ColumnQuantity::Spin),
            masses: numbers(ColumnQuantity::Mass),
            part: String::new(),
        }
    }
}

/// Words of a line with their columns, from 1. Without `separator` blanks separate, several in a row once; else each
/// `separator` does, and blanks around words are dropped.
pub fn words_with_columns(line: &str, separator: Option<char>) -> Vec<(usize, &str)> {
    let mut words = Vec::new();
    // Byte and column of the start of the word.
    let (mut start, mut column) = (0, 1);
    let is_end = |letter: char| separator.map_or(letter.is_whitespace(), |separator| letter == separator);
    for (end, letter) in line.char_indices().chain([(line.len(), '\0')]) {
        if end < line.len() && !is_end(letter) {
            continue;
        }
        let word = &line[start..end];
        if separator.is_some() || !word.is_empty() {
            let blanks = word.chars().take_while(|letter| letter.is_whitespace()).count();
            words.push((column + blanks, word.trim()));
        }
        column += word.chars().count() + 1;
        start = end + letter.len_utf8().min(line.len() - end);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_have_their_columns_in_characters() {
        assert_eq!(words_with_columns("  a\tbé  c ", None), [(3, "a"), (5, "bé"), (9, "c")]);
        assert_eq!(words_with_columns("é, b,,\u{3000}c", Some(',')), [(1, "é"), (4, "b"), (6, ""), (8, "c")]);
        assert_eq!(words_with_columns("", Some(',')), [(1, "")]);
        // A long line took minutes when each column was counted from its start.
        let words = 500_000;
        let line = "1 ".repeat(words);
        let columns = words_with_columns(&line, None).into_iter().map(|(column, _)| column);
        assert!(columns.eq((0..words).map(|k| 2 * k + 1)));
    }
}
