//! Tables: `POSTPRO/series.csv`, a header, then a line a snapshot; and tables of any numbers.

use crate::derive::{ColumnCondition, Row, SeriesValue};

/// Text of the file: names of [`Row::COLUMNS`], then the fields of each row. Columns of a deforming cell, and of a
/// hollow cylinder whose radius changes, are left out if the scene has none.
///
/// Numbers are the shortest decimals that read back as the same f64; an undefined value is an
/// empty field, never `NaN`.
pub fn series_text(rows: &[Row]) -> String {
    let has_column = |condition: ColumnCondition| match condition {
        ColumnCondition::Always => true,
        ColumnCondition::DeformingCell => rows.iter().any(|row| !row.cell_x.is_nan()),
        ColumnCondition::ChangingRadius => rows.iter().any(|row| !row.cylinder_radius.is_nan()),
    };
    let line = |fields: Vec<String>| {
        let fields = fields.into_iter().zip(Row::CONDITIONS).filter(|(_, condition)| has_column(**condition));
        fields.map(|(field, _)| field).collect::<Vec<_>>().join(",") + "\n"
    };
    let header = line(Row::COLUMNS.iter().map(|(name, _, _)| name.to_string()).collect());
    header + &rows.iter().map(|row| line(row.texts())).collect::<String>()
}

/// Name, unit and meaning of a column.
pub type Column = (&'static str, &'static str, &'static str);

/// CSV text with the names of `columns`.
pub fn csv_table<const N: usize>(columns: &[Column; N], rows: impl IntoIterator<Item = [f64; N]>) -> String {
    csv_text(&columns.map(|(name, _, _)| name), rows)
}

/// Text of a CSV file: names, then numbers; an undefined value is an empty field.
pub fn csv_text(header: &[&str], rows: impl IntoIterator<Item = impl AsRef<[f64]>>) -> String {
    csv_with_counts(header, &[], rows)
}

/// Text of a CSV file in which the columns of `counts` contain whole numbers, written as `38` and not `38.0`.
pub fn csv_with_counts(header: &[&str], counts: &[&str], rows: impl IntoIterator<Item = impl AsRef<[f64]>>) -> String {
    let is_count: Vec<bool> = header.iter().map(|name| counts.contains(name)).collect();
    let field = |(k, value): (usize, &f64)| {
        if is_count.get(k) == Some(&true) && value.is_finite() { format!("{value:.0}") } else { value.text() }
    };
    let lines = rows.into_iter().map(|row| row.as_ref().iter().enumerate().map(field).collect::<Vec<_>>().join(","));
    let mut text = header.join(",") + "\n";
    for line in lines {
        text += &line;
        text.push('\n');
    }
    text
}

/// Name of a run or group as a field: separators, quotes and line ends are replaced.
pub fn name_field(name: &str) -> String {
    let letter = |letter: char| match letter {
        ',' => ';',
        '"' => '\'',
        '\u{2028}' | '\u{2029}' => ' ', // ends of lines to some readers
        letter if letter.is_control() => ' ',
        letter => letter,
    };
    name.chars().map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn a_name_is_one_field_and_a_count_has_no_point() {
        assert_eq!(name_field("a,b \"c\"\nd\te\u{85}f\u{2028}é"), "a;b 'c' d e f é");
        let table = csv_with_counts(&["grains", "mass"], &["grains"], [[38.0, 2.0], [f64::NAN, f64::NAN]]);
        assert_eq!(table, "grains,mass\n38,2.0\n,\n");
    }

    #[test]
    fn numbers_read_back_exactly_and_undefined_ones_are_blank() {
        let mut scene = Scene::default();
        scene.grain([1e-300, 0.1 + 0.2, -1.0 / 3.0], 1e-3);
        scene.snapshot.meta.time = 5e-324;
        let (full, empty) = (Row::from_frame(&scene.frame()), Row::from_frame(&Scene::default().frame()));
        let text = series_text(&[full.clone(), empty.clone()]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        for (line, row) in lines[1..].iter().zip([full, empty]) {
            let fields: Vec<&str> = line.split(',').collect();
            // Three lengths and three shears of a deforming cell, their strains, and radius and pressure of a cylinder are
            // left out.
            assert_eq!(fields.len(), Row::COLUMNS.len() - 14);
            let is_written = |condition: &ColumnCondition| *condition == ColumnCondition::Always;
            let numbers = row.numbers().into_iter().zip(Row::CONDITIONS).filter(|(_, condition)| is_written(condition));
            for (field, (number, _)) in fields.iter().zip(numbers) {
                match field.parse::<f64>() {
                    Ok(read) => assert_eq!(read, number),
                    Err(_) => assert!(field.is_empty() && number.is_nan(), "{field} {number}"),
                }
            }
        }
        assert!(!text.contains("NaN") && !text.contains("inf"));
    }
}
