//! `NAME.fc3d`: the contact problem with friction of one step as plain text, which cd-solve writes for other solvers and for
//! its own tests.
//!
//! Given W, q and mu, find the impulses r and the relative velocities u = W r + q that satisfy
//! Signorini's condition and Coulomb's law. Words are separated by white space; lines that begin with `#`
//! are comments, and the first ones name the source:
//!
//! ```text
//! fc3d 1
//! # comments
//! name NAME
//! contacts N
//! blocks B
//! mu
//! mu_0 ... mu_{N-1}
//! q
//! q_n q_t1 q_t2                                   N lines
//! W
//! i j  w00 w01 w02 w10 w11 w12 w20 w21 w22        B lines, by i then j, from 0, row by row
//! end
//! ```
//!
//! Local order: normal, then the two tangents. Block (i, j) maps r_j to u_i. Blocks that are not listed are
//! zero; every diagonal block is listed. Numbers are the shortest decimals that read back the same.

use std::fmt::Write;
use std::path::Path;
use std::str::FromStr;

use crate::atomic::read_text;
use crate::error::{Fault, Faults};
use crate::names::number_text;

/// Contact problem with Coulomb friction in the format of a `.fc3d` file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Fc3d {
    /// Comment lines without the leading `#`.
    pub comments: Vec<String>,
    /// Name, one word.
    pub name: String,
    /// Coefficient of friction of each contact.
    pub mu: Vec<f64>,
    /// Relative velocity of each contact without impulses, along n, t1, t2; < 0 along n when closing.
    pub free_velocities: Vec<[f64; 3]>,
    /// Blocks of W, by row, then by column.
    pub blocks: Vec<Fc3dBlock>,
}

/// 3x3 block of W that maps the impulse of contact `column` to the velocity of contact `row`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fc3dBlock {
    pub row: usize,
    pub column: usize,
    pub w: [[f64; 3]; 3],
}

impl Fc3d {
    /// Reads a file. Errors: those of [`Fc3d::parse`], or the file cannot be read.
    pub fn read(path: &Path) -> Result<Self, Faults> {
        Self::parse(path, &read_text(path)?)
    }

    /// Reads the text of a file; `path` is for messages. Errors: all numbers out of range up to the first word that does not
    /// fit the format, and that word.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Faults> {
        let mut words = WordReader::new(path, text);
        let problem = words.read_problem();
        match problem {
            Ok(problem) => words.faults.into_result(problem),
            Err(last) => {
                words.faults.0.extend(last.0);
                Err(words.faults)
            }
        }
    }

    /// Text of the file.
    pub fn to_text(&self) -> String {
        let mut out = String::from("fc3d 1\n");
        for comment in &self.comments {
            let _ = writeln!(out, "#{comment}");
        }
        let _ = writeln!(out, "name {}\ncontacts {}\nblocks {}\nmu", self.name, self.mu.len(), self.blocks.len());
        for mu in &self.mu {
            let _ = writeln!(out, "{mu:?}");
        }
        out.push_str("q\n");
        for [n, t1, t2] in &self.free_velocities {
            let _ = writeln!(out, "{n:?} {t1:?} {t2:?}");
        }
        out.push_str("W\n");
        for Fc3dBlock { row, column, w } in &self.blocks {
            let _ = write!(out, "{row} {column}");
            for value in w.as_flattened() {
                let _ = write!(out, " {value:?}");
            }
            out.push('\n');
        }
        out + "end\n"
    }
}

/// Words of a file with their lines.
struct WordReader<'a> {
    path: &'a Path,
    words: Vec<(usize, &'a str)>,
    comments: Vec<String>,
    next: usize,
    faults: Faults,
}

impl<'a> WordReader<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        let (mut words, mut comments) = (Vec::new(), Vec::new());
        for (k, line) in text.lines().enumerate() {
            match line.trim_start().strip_prefix('#') {
                Some(comment) => comments.push(comment.to_string()),
                None => words.extend(line.split_whitespace().map(|word| (k + 1, word))),
            }
        }
        WordReader { path, words, comments, next: 0, faults: Faults::default() }
    }

    fn read_problem(&mut self) -> Result<Fc3d, Faults> {
        for word in ["fc3d", "1", "name"] {
            self.expect_keyword(word)?;
        }
        let name = self.next_word("name", "a name")?.to_string();
        self.expect_keyword("contacts")?;
        let contacts: usize = self.read_count("contacts")?;
        self.expect_keyword("blocks")?;
        let count = self.read_count("blocks")?;

        // Lists grow as their numbers are read, so that a count too large for the file takes no memory.
        self.expect_keyword("mu")?;
        let mut mu = Vec::new();
        for k in 0..contacts {
            let object = format!("mu of contact {k}");
            let value = self.read_real(&object)?;
            if value < 0.0 {
                self.add_fault(&object, number_text(value), "expected 0 or more");
            }
            mu.push(value);
        }
        self.expect_keyword("q")?;
        let mut q = Vec::new();
        for k in 0..contacts {
            q.push(self.read_vector(&format!("q of contact {k}"))?);
        }
        self.expect_keyword("W")?;
        let mut blocks: Vec<Fc3dBlock> = Vec::new();
        for k in 0..count {
            let object = format!("block {k} of W");
            let [row, column] = [self.read_index(&object, contacts)?, self.read_index(&object, contacts)?];
            let [a, b, c] = [self.read_vector(&object)?, self.read_vector(&object)?, self.read_vector(&object)?];
            if blocks.last().is_some_and(|last| (last.row, last.column) >= (row, column)) {
                self.add_fault(
                    &object,
                    format!("({row}, {column})"),
                    "expected blocks by row, then by column, each once",
                );
            }
            blocks.push(Fc3dBlock { row, column, w: [a, b, c] });
        }
        self.expect_keyword("end")?;
        if let Some(&(line, word)) = self.words.get(self.next) {
            return Err(Fault::new(self.path, Some(line), "end", quoted_word(word), "expected nothing more").into());
        }
        let mut diagonal = vec![false; contacts];
        blocks.iter().filter(|block| block.row == block.column).for_each(|block| diagonal[block.row] = true);
        for k in (0..contacts).filter(|&k| !diagonal[k]) {
            self.add_fault(&format!("W of contact {k}"), "no diagonal block".into(), "expected every diagonal block");
        }
        Ok(Fc3d { comments: std::mem::take(&mut self.comments), name, mu, free_velocities: q, blocks })
    }

    fn next_word(&mut self, object: &str, expected: &str) -> Result<&'a str, Faults> {
        let Some(&(_, word)) = self.words.get(self.next) else {
            let line = self.words.last().map(|(line, _)| *line);
            return Err(Fault::new(self.path, line, object, "the file ends", format!("expected {expected}")).into());
        };
        self.next += 1;
        Ok(word)
    }

    fn expect_keyword(&mut self, keyword: &str) -> Result<(), Faults> {
        match self.next_word(keyword, keyword)? {
            word if word == keyword => Ok(()),
            word => Err(self.fault_at_word(keyword, quoted_word(word), &format!("expected {keyword}")).into()),
        }
    }

    fn parse_next<T: FromStr>(&mut self, object: &str, expected: &str) -> Result<T, Faults> {
        let word = self.next_word(object, expected)?;
        word.parse().map_err(|_| self.fault_at_word(object, quoted_word(word), &format!("expected {expected}")).into())
    }

    fn read_count(&mut self, object: &str) -> Result<usize, Faults> {
        self.parse_next(object, "a count")
    }

    fn read_index(&mut self, object: &str, end: usize) -> Result<usize, Faults> {
        match self.parse_next(object, "the number of a contact")? {
            index if index < end => Ok(index),
            index => {
                Err(self.fault_at_word(object, format!("contact {index}"), &format!("expected less than {end}")).into())
            }
        }
    }

    fn read_real(&mut self, object: &str) -> Result<f64, Faults> {
        let value: f64 = self.parse_next(object, "a number")?;
        if !value.is_finite() {
            self.add_fault(object, number_text(value), "expected a finite number");
        }
        Ok(value)
    }

    fn read_vector(&mut self, object: &str) -> Result<[f64; 3], Faults> {
        Ok([self.read_real(object)?, self.read_real(object)?, self.read_real(object)?])
    }

    /// Fault of the word read last.
    fn fault_at_word(&self, object: &str, found: String, expected: &str) -> Fault {
        Fault::new(self.path, self.words.get(self.next.wrapping_sub(1)).map(|(line, _)| *line), object, found, expected)
    }

    fn add_fault(&mut self, object: &str, found: String, expected: &str) {
        self.faults.push(self.fault_at_word(object, found, expected));
    }
}

fn quoted_word(word: &str) -> String {
    format!("'{}'", word.chars().take(40).collect::<String>().escape_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "fc3d 1\n# source\nname two\ncontacts 2\nblocks 3\nmu\n0.5\n0.0\nq\n-1.0 0.1 0.0\n1.0 0.0 -2e-7\n\
                        W\n0 0 1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0\n0 1 1.0 2.0 3.0 4.0 5.0 6.0 7.0 8.0 9.0\n\
                        1 1 2.0 0.0 0.0 0.0 2.0 0.0 0.0 0.0 2.0\nend\n";

    fn faults(text: &str) -> String {
        Fc3d::parse(Path::new("a.fc3d"), text).unwrap_err().to_string()
    }

    #[test]
    fn what_is_read_is_written() {
        let problem = Fc3d::parse(Path::new("a.fc3d"), GOOD).unwrap();
        assert_eq!(problem.blocks[1].w[1], [4.0, 5.0, 6.0]);
        assert_eq!(
            (problem.comments.as_slice(), problem.free_velocities[1][2]),
            ([" source".to_string()].as_slice(), -2e-7)
        );
        assert_eq!(problem.to_text(), GOOD);
    }

    #[test]
    fn faults_name_line_and_object() {
        for (old, new, message) in [
            ("0.5", "x", "a.fc3d:7: mu of contact 0: 'x'; expected a number"),
            ("0.5", "-0.5", "a.fc3d:7: mu of contact 0: -0.5; expected 0 or more"),
            ("-1.0", "nan", "a.fc3d:10: q of contact 0: NaN; expected a finite number"),
            ("9.0", "-inf", "a.fc3d:14: block 1 of W: -inf; expected a finite number"),
            ("\n0 1", "\n0 2", "a.fc3d:14: block 1 of W: contact 2; expected less than 2"),
            ("\n0 1", "\n0 0", "a.fc3d:14: block 1 of W: (0, 0); expected blocks by row, then by column, each once"),
            ("\n0 0", "\n1 0", "a.fc3d:14: block 1 of W: (0, 1); expected blocks by row, then by column, each once"),
            ("\n1 1 ", "\n1 0 ", "a.fc3d:16: W of contact 1: no diagonal block; expected every diagonal block"),
            ("blocks 3", "blocks 2", "a.fc3d:15: end: '1'; expected end"),
            ("blocks 3", "blocks 18446744073709551615", "a.fc3d:16: block 3 of W: 'end'; expected the number"),
            ("end", "", "a.fc3d:15: end: the file ends; expected end"),
            ("end", "end more", "a.fc3d:16: end: 'more'; expected nothing more"),
            ("fc3d 1", "fc3d 2", "a.fc3d:1: 1: '2'; expected 1"),
        ] {
            let found = faults(&GOOD.replacen(old, new, 1));
            assert!(found.contains(message), "{found}\nexpected {message}");
        }
        assert_eq!(faults(&GOOD.replace("2.0", "nan")).lines().count(), 4, "all numbers at once");
        assert!(faults("").starts_with("a.fc3d: fc3d: the file ends"));
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_fail_otherwise(text in "[a-z0-9 .\n#-]{0,200}") {
            let _ = Fc3d::parse(Path::new("a"), &text);
        }

        #[test]
        fn numbers_come_back_the_same(value in prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL) {
            let mut problem = Fc3d::parse(Path::new("a"), GOOD).unwrap();
            problem.free_velocities[0][1] = value;
            problem.blocks[0].w[2][1] = -value;
            prop_assert_eq!(Fc3d::parse(Path::new("a"), &problem.to_text()).unwrap(), problem);
        }
    }
}
