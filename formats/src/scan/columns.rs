//! Writing of columns and head lines of LMGC90's text files.

use std::fmt::{Display, Write};

use super::numbers::{RealText, format_d14, format_integer};

/// First columns of the three reals of a grid line.
pub const GRID_COLUMNS: [usize; 3] = [35, 56, 77];

/// Writes `text` at a column of the last line of `out`, padded with blanks.
pub fn put_text(out: &mut String, column: usize, text: impl Display) {
    let line_start = out.rfind('\n').map_or(0, |end| end + 1);
    let blanks = (column - 1).saturating_sub(out.len() - line_start);
    write!(out, "{:blanks$}{text}", "").expect("a String takes all");
}

/// Writes a grid line: `head` in columns 1-29, then up to three reals, formatted by `real`, after their labels.
///
/// `out` ends with a whole line.
pub fn put_grid(out: &mut String, head: &str, labels: &[&str], values: &[f64], real: fn(f64) -> RealText) {
    let line_start = out.len();
    out.push_str(head);
    for ((&value, label), column) in values.iter().zip(labels).zip(GRID_COLUMNS) {
        let put_blanks_to = |out: &mut String, column: usize| {
            let blanks = (line_start + column - 1).saturating_sub(out.len());
            out.extend(std::iter::repeat_n(' ', blanks));
        };
        put_blanks_to(out, column - 5);
        out.push_str(label);
        put_blanks_to(out, column);
        out.push_str(&real(value));
    }
    out.push('\n');
}

/// Dashed comment line of state files.
pub const DASHED_LINE: &str = "!-----------------------------------------------------------------------\n";

/// Writes the head of a state file, with the number of the step and the time (s), in the form that LMGC90 can read.
pub fn put_steps(out: &mut String, title: &str, step: u64, time: f64) {
    let step = format_integer(step, 7);
    let time = format_d14(time);
    let _ = write!(out, "     \n! {title}\n     \n$steps  {step}{:14}time={time}\n \n{DASHED_LINE}", "");
}
