//! Reading of lines outside of records, which are skipped, and of heads of state files whose numbers are not in their
//! columns.

use super::{AcceptedDeviation, LineScanner, NumberError, REAL_WIDTH, TextLine, fortran_real, free_real};
use crate::words::is_data_word;

/// Smallest number of `$` in a line that ends a record.
const MIN_END_DOLLARS: usize = 5;

/// Whether a line has a keyword or a word of data lines: it may belong to a record whose head is damaged.
fn names_data(line: TextLine) -> bool {
    let text = line.text().trim();
    let is_end = text.len() >= MIN_END_DOLLARS && text.chars().all(|letter| letter == '$');
    (text.starts_with('$') && !is_end) || text.split_ascii_whitespace().any(is_data_word)
}

/// Whether a line has a labelled value or a real with an exponent, as lines of records have.
fn has_value(line: TextLine) -> bool {
    let is_real = |word: &str| word.contains('.') && word.contains(['E', 'e', 'D', 'd']) && free_real(word).is_ok();
    line.text().contains('=') || line.text().split_ascii_whitespace().any(is_real)
}

impl<'a> LineScanner<'a> {
    /// Skips lines up to the next with this keyword, which LMGC90 searches for, or to the end of the file. A line that may
    /// be part of a damaged record stays, for the caller to report. Behind the end of a record these are only lines with a
    /// keyword or a word of data lines: values alone belong to no record, whose lines are all before its end.
    pub fn skip_to_keyword(&mut self, keyword: &str) {
        let follows_record = self.last_line().is_some_and(|line| line.keyword() == "$$$$$");
        let may_be_data = |line: TextLine| names_data(line) || (has_value(line) && !follows_record);
        while let Some(line) = self.next_line_if(|line| line.keyword() != keyword && !may_be_data(line)) {
            self.forms.add(AcceptedDeviation::OutsideLine, line.number);
        }
    }

    /// Rejects a `$` line with another keyword; other lines are skipped, as in LMGC90.
    pub fn reject_unknown_keyword(&mut self, line: TextLine, expected: &str) {
        if line.text().starts_with('$') && line.keyword() != "$$$$$" {
            self.set_object("file");
            self.add_fault(line.number, format!("keyword '${}' is not known", line.keyword().trim()), expected);
        }
    }

    /// Whether a comment that is not in column 1 is on the line before this one: LMGC90 takes it for a line of titles.
    pub fn follows_indented_comment(&self, line: TextLine) -> bool {
        self.indented_comments.contains(&(line.number - 1))
    }

    /// Reads the `$steps` line of a state file: number of the step, time in s.
    ///
    /// Numbers that are not in their columns are read next to `$steps` and `time=`, unless LMGC90 reads others.
    pub fn read_steps(&mut self) -> (u64, f64) {
        self.skip_to_keyword("steps");
        let Some(line) = self.next_line_if(|line| line.keyword() == "steps") else {
            self.unexpected_line("expected $steps with the number of the step and the time");
            return (0, f64::NAN);
        };
        let text = line.before_comment();
        let label = text.find("time=").unwrap_or(TIME_LABEL_START);
        let word_between = |start: usize, end: usize| text.get(start..end).unwrap_or("").trim();
        let step = word_between("$steps".len(), label);
        let time = word_between(label + "time=".len(), text.len());
        let is_shifted = label != TIME_LABEL_START;
        let in_columns = line.columns(STEP_COLUMNS.0, STEP_COLUMNS.1).replace(' ', "");
        let step = match step.parse::<u64>() {
            // LMGC90 reads 0 from blank columns.
            Ok(number) if in_columns.is_empty() || in_columns.parse() == Ok(number) => {
                self.expect_same_number(line, "step number", number as f64, in_columns.parse().ok().or(Some(0.0)));
                number
            }
            Ok(number) if is_shifted && in_columns.parse::<u64>().is_err() => number,
            _ => self.read_integer(line, STEP_COLUMNS, "step number").unwrap_or(0),
        };
        let time_column = TIME_LABEL_START + "time=".len() + 1;
        let time = match fortran_real(time) {
            Ok(value) if is_shifted => {
                let lmgc90_value = lmgc90_real(line.columns(time_column, time_column + REAL_WIDTH - 1)).ok();
                self.expect_same_number(line, "time", value, lmgc90_value);
                self.forms.add(AcceptedDeviation::ShiftedHead, line.number);
                value
            }
            _ => self.read_real(line, time_column, "time"),
        };
        (step, time)
    }

    /// Adds a fault if LMGC90 reads another number from its columns; `None` where it stops with an error.
    fn expect_same_number(&mut self, line: TextLine, field: &str, value: f64, lmgc90_value: Option<f64>) {
        // The two are read from the same decimals, and differ by rounding at most.
        let is_different = |lmgc90_value: &f64| (lmgc90_value - value).abs() > 1e-12 * value.abs();
        if let Some(lmgc90_value) = lmgc90_value.filter(is_different) {
            let found = format!("{field} is {value}, but LMGC90 reads {lmgc90_value} from its columns");
            self.add_fault(
                line.number,
                found,
                "expected the number in its columns: the step in 9 to 15, the time in 35 to 48",
            );
        }
    }
}

/// Columns of the number of the step.
const STEP_COLUMNS: (usize, usize) = (9, 15);
/// Position of `time=` in its line, from 0.
const TIME_LABEL_START: usize = 29;

/// Real that Fortran's `D14.7` takes from these columns: blank columns are 0, and the last seven digits of a number without
/// point are decimals.
fn lmgc90_real(field: &str) -> Result<f64, NumberError> {
    if field.trim().is_empty() {
        return Ok(0.0);
    }
    let value = free_real(field)?;
    Ok(if field.contains('.') { value } else { 1e-7 * value })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::AsciiText;
    use super::*;

    fn head(text: &str) -> Result<(u64, f64), String> {
        let text = AsciiText::new(text.as_bytes());
        let mut scan = LineScanner::new(Path::new("f"), &text);
        let read = scan.read_steps();
        scan.finish(read).map_err(|faults| faults.to_string())
    }

    #[test]
    fn the_head_is_read_where_it_has_one_reading() {
        let at = |shift: i32, time: &str| format!("$steps       12{:1$}time={time}\n", "", (14 + shift) as usize);
        assert_eq!(head(&at(0, " 0.5000000D+00")), Ok((12, 0.5)));
        assert_eq!(head(&at(0, "  .5000000D+00")), Ok((12, 0.5)));
        for shift in [-3, -2, -1, 1, 2, 3] {
            // Without the point LMGC90 takes the last seven digits for decimals.
            assert_eq!(head(&at(shift, " 0.5000000D+00")), Ok((12, 0.5)), "{shift}");
            assert_eq!(head(&at(shift, " 0.0000000D+00")), Ok((12, 0.0)), "{shift}");
        }
        let refused = head(&at(-2, " 1.5000000E+00")).unwrap_err();
        assert!(refused.contains("time is 1.5, but LMGC90 reads 0.5 from its columns"), "{refused}");
        // Behind column 15 LMGC90 reads 0.
        assert_eq!(head("$steps          0             time= 0.0000000D+00\n"), Ok((0, 0.0)));
        let refused = head("$steps          7             time= 0.0000000D+00\n").unwrap_err();
        assert!(refused.contains("step number is 7, but LMGC90 reads 0 from its columns"), "{refused}");
    }

    #[test]
    fn only_lines_that_are_no_data_are_skipped() {
        let skipped = |text: &str| {
            let text = AsciiText::new(text.as_bytes());
            let mut scan = LineScanner::new(Path::new("f"), &text);
            scan.skip_to_keyword("bdyty");
            scan.next_line().is_none_or(|line| line.keyword() == "bdyty")
        };
        for text in ["$$$$$$\n", "  two bodies, version 1.2\n$bdyty\n", " ! RBDY3\n", "-----\n", ""] {
            assert!(skipped(text), "{text}");
        }
        // Behind a record only what names data stays.
        let behind = |text: &str| {
            let text = format!("$$$$$$\n{text}");
            let text = AsciiText::new(text.as_bytes());
            let mut scan = LineScanner::new(Path::new("f"), &text);
            scan.next_line();
            scan.skip_to_keyword("bdyty");
            scan.peek_line().is_none_or(|line| line.keyword() == "bdyty")
        };
        for text in [" xxx 1.0E+00\n", "   coo1= 1\n$$$$$$\n$bdyty\n", "t_end = 3\n"] {
            assert!(behind(text), "{text}");
        }
        for text in ["$bdytx\n", " RBDY3      1\n", " vlocy      1  0.0000000e+00\n"] {
            assert!(!behind(text), "{text}");
        }
        for text in [" $bdyty\n", "$bdytx\n", " RBDY3      1\n", " xxx 1.0E+00\n", "   coo1= 1\n", "a SPHER\n"] {
            assert!(!skipped(text), "{text}");
        }
    }
}
