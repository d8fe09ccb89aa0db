//! Faults of input files: where, what stands there, what was expected.
//!
//! A reader collects every fault of a file before it gives up, so that a user mends them in one go.

use std::collections::HashSet;
use std::fmt;
use std::path::{Path, PathBuf};

/// One fault: `file:line:column: object: found; expected`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    pub file: PathBuf,
    /// 1-based; none when the fault belongs to the file as a whole.
    pub line: Option<usize>,
    /// 1-based; given by readers that know it.
    pub column: Option<usize>,
    /// What the fault is in, e.g. `body 17, contactor POLYR 1`.
    pub object: String,
    /// What stands there.
    pub found: String,
    /// What should stand there, as a phrase: `expected 1 to 8`, `defined are iqsc0, rstc1`.
    pub expected: String,
}

impl Fault {
    pub fn new(
        file: &Path,
        line: Option<usize>,
        object: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Fault {
            file: file.to_path_buf(),
            line,
            column: None,
            object: object.into(),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// A file that cannot be read or written.
    pub fn io(file: &Path, doing: &str, error: &std::io::Error) -> Self {
        Fault::new(file, None, "file", format!("cannot be {doing}: {error}"), "expected a file that can")
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
            if let Some(column) = self.column {
                write!(f, ":{column}")?;
            }
        }
        write!(f, ": {}: {}; {}", readable(&self.object), readable(&self.found), readable(&self.expected))
    }
}

/// What a file holds on one line, without control characters, and not longer than a reader cares for.
fn readable(text: &str) -> String {
    const LONGEST: usize = 1000;
    let mut line = String::new();
    for (k, letter) in text.chars().enumerate() {
        if k == LONGEST {
            line += "...";
            break;
        }
        if letter.is_control() { line.extend(letter.escape_default()) } else { line.push(letter) }
    }
    line
}

/// All faults of one reading; at least one.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Faults(pub Vec<Fault>);

impl Faults {
    pub fn push(&mut self, fault: Fault) {
        self.0.push(fault);
    }

    /// `Ok(value)` if nothing was found at fault.
    pub fn into_result<T>(self, value: T) -> Result<T, Faults> {
        if self.0.is_empty() { Ok(value) } else { Err(self) }
    }

    /// Takes the faults of `result` into this collection, and its value if there is one.
    pub fn gather<T>(&mut self, result: Result<T, Faults>) -> Option<T> {
        result.map_err(|faults| self.0.extend(faults.0)).ok()
    }

    /// The message a program prints: each fault on its own line behind the program's name, once, however often the file was read.
    pub fn report(&self, program: &str) -> String {
        let mut told = HashSet::new();
        let lines = self.0.iter().map(|fault| format!("{program}: {fault}\n"));
        lines.filter(|line| told.insert(line.clone())).collect()
    }
}

impl From<Fault> for Faults {
    fn from(fault: Fault) -> Self {
        Faults(vec![fault])
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, fault) in self.0.iter().enumerate() {
            if k > 0 {
                writeln!(f)?;
            }
            write!(f, "{fault}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Faults {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_told_once() {
        let fault = |found: &str| Fault::new(Path::new("z.dat"), Some(2), "point 2", found, "later than point 1");
        let faults = Faults(vec![fault("time 0"), fault("time 1"), fault("time 0")]);
        let expected = "cd-solve: z.dat:2: point 2: time 0; later than point 1\ncd-solve: z.dat:2: point 2: time 1; later than point 1\n";
        assert_eq!(faults.report("cd-solve"), expected);
    }
}
