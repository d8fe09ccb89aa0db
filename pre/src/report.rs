//! Faults of a scene with the line they stand on.
//!
//! serde keeps no positions, so `Lines` walks the text once more: a text that RON has accepted needs
//! no more than its brackets, field names, strings and comments to be found again.

use std::path::Path;

use cd_formats::error::{Fault, Faults};
use rustc_hash::FxHashMap;

/// Faults of one scene, each by the path of its value, e.g. `grains.0.sizes`.
pub struct Report<'a> {
    file: &'a Path,
    lines: Lines,
    pub faults: Faults,
}

impl<'a> Report<'a> {
    pub fn new(file: &'a Path, text: &str) -> Self {
        Report { file, lines: Lines::of(text), faults: Faults::default() }
    }

    /// Takes down a fault of the value at `path`: `found` says what stands there, `expected` what should.
    pub fn fault(&mut self, path: &str, found: impl Into<String>, expected: impl Into<String>) {
        let line = self.lines.of_path(path);
        self.faults.push(Fault::new(self.file, line, object(path), found, format!("expected {}", expected.into())));
    }

    /// As [`Report::fault`], unless `holds`.
    pub fn expect(&mut self, holds: bool, path: &str, found: impl Into<String>, expected: &str) {
        if !holds {
            self.fault(path, found, expected);
        }
    }
}

/// A path in words: `grains.0.sizes` is `grains 1, sizes`; `materials.2` is `material 3`.
fn object(path: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    for key in path.split('.') {
        match (key.parse::<usize>(), words.last_mut()) {
            (Ok(index), Some(list)) => {
                let one = if list == "grains" { list.as_str() } else { list.trim_end_matches('s') };
                *list = format!("{one} {}", index + 1);
            }
            _ => words.push(key.to_string()),
        }
    }
    words.join(", ")
}

/// The line, 1-based, on which each value of a RON text starts, by its path: field names and
/// 0-based places in lists and tuples, joined by points.
struct Lines(FxHashMap<String, usize>);

impl Lines {
    fn of(text: &str) -> Self {
        let mut walk = Walk { text: text.as_bytes(), at: 0, line: 1, lines: FxHashMap::default() };
        walk.value("");
        Lines(walk.lines)
    }

    /// The line of the value at `path`, or of what holds it if it was left out.
    fn of_path(&self, path: &str) -> Option<usize> {
        let mut path = path;
        loop {
            match (self.0.get(path), path.rfind('.')) {
                (Some(&line), _) => return Some(line),
                (None, Some(end)) => path = &path[..end],
                (None, None) => return None,
            }
        }
    }
}

struct Walk<'a> {
    text: &'a [u8],
    at: usize,
    line: usize,
    lines: FxHashMap<String, usize>,
}

impl Walk<'_> {
    fn here(&self) -> u8 {
        self.text.get(self.at).copied().unwrap_or(0)
    }

    fn advance(&mut self, bytes: usize) {
        let end = (self.at + bytes).min(self.text.len());
        self.line += self.text[self.at..end].iter().filter(|&&byte| byte == b'\n').count();
        self.at = end;
    }

    /// Goes behind the next `mark`, or to the end.
    fn behind(&mut self, mark: &[u8]) {
        let rest = &self.text[self.at..];
        let found = rest.windows(mark.len()).position(|window| window == mark);
        self.advance(found.map_or(rest.len(), |start| start + mark.len()));
    }

    fn skip_blank(&mut self) {
        loop {
            match (self.here(), self.text.get(self.at + 1)) {
                (byte, _) if byte.is_ascii_whitespace() => self.advance(1),
                (b'/', Some(b'/')) => self.behind(b"\n"),
                (b'/', Some(b'*')) => self.behind(b"*/"),
                _ => return,
            }
        }
    }

    /// A field's name, if one stands here with its colon; goes behind the colon.
    fn field(&mut self) -> Option<String> {
        let length = self.text[self.at..].iter().take_while(|b| b.is_ascii_alphanumeric() || **b == b'_').count();
        let name = String::from_utf8_lossy(&self.text[self.at..self.at + length]).into_owned();
        let start = (self.at, self.line);
        self.advance(length);
        self.skip_blank();
        if length > 0 && self.here() == b':' {
            self.advance(1);
            return Some(name);
        }
        (self.at, self.line) = start;
        None
    }

    fn value(&mut self, path: &str) {
        loop {
            self.skip_blank();
            match self.here() {
                b'(' | b'[' | b'{' => self.items(path),
                b'"' => self.string(),
                b',' | b')' | b']' | b'}' => return,
                _ if self.at >= self.text.len() => return,
                _ => self.advance(1),
            }
        }
    }

    fn string(&mut self) {
        self.advance(1);
        while self.at < self.text.len() && self.here() != b'"' {
            self.advance(if self.here() == b'\\' { 2 } else { 1 });
        }
        self.advance(1);
    }

    /// From an opening bracket to behind its closing one.
    fn items(&mut self, path: &str) {
        self.advance(1);
        for index in 0.. {
            self.skip_blank();
            if self.at >= self.text.len() || matches!(self.here(), b')' | b']' | b'}') {
                break;
            }
            let line = self.line;
            let key = self.field().unwrap_or_else(|| index.to_string());
            let path = if path.is_empty() { key } else { format!("{path}.{key}") };
            self.value(&path);
            self.lines.insert(path, line);
            if self.here() == b',' {
                self.advance(1);
            }
        }
        self.advance(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_lines_behind_comments_strings_and_brackets() {
        let text = "Scene( // grains: [\n seed: 1, /* \n */\n name: \"a\\\")\",\n grains: [\n  (sizes: Uniform(\n   \
                    min: 1)),\n  (x: (1,\n 2)),\n ],\n)";
        let lines = Lines::of(text);
        let line = |path| lines.of_path(path);
        assert_eq!(line("seed"), Some(2));
        assert_eq!(line("name"), Some(4));
        assert_eq!(line("grains.0"), Some(6));
        assert_eq!(line("grains.0.sizes.min"), Some(7));
        assert_eq!(line("grains.0.sizes.max"), Some(6)); // left out: the line of what holds it
        assert_eq!(line("grains.1.x.1"), Some(9));
        assert_eq!(line("walls"), None);
    }

    #[test]
    fn paths_read_as_words() {
        assert_eq!(object("grains.0.sizes"), "grains 1, sizes");
        assert_eq!(object("materials.2.name"), "material 3, name");
        assert_eq!(object("compute.dt"), "compute, dt");
    }
}
