//! Positions of the values of a RON text.
//!
//! serde keeps no positions, so [`ValueLocations`] scans the text again. Since RON has accepted the text, brackets, field
//! names, strings and comments suffice to locate the values. Paths have current names, also where the text has
//! [former](former_names) ones.

use std::collections::HashMap;
use std::ops::Range;

use crate::former_names::{self, FormerName, FormerNameUse};
use crate::names::path_in_words;
use crate::ron_text::syntax::line_and_column;

/// Values of a RON text by their paths: field names and 0-based positions in lists and tuples, joined by points; the path
/// of the whole is empty.
pub struct ValueLocations<'a> {
    text: &'a str,
    values: HashMap<String, ValueLocation>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<NameConflict>,
}

/// Field that a text has under both its former and its current name.
#[derive(Debug, Clone)]
pub struct NameConflict {
    /// Byte of the second of the two names.
    pub offset: usize,
    /// Path of the value that has the field.
    pub holder: String,
    pub name: &'static FormerName,
}

/// Position of a value.
pub struct ValueLocation {
    /// Byte at which its name or, without one, the value begins.
    start: usize,
    /// Bytes of the value.
    pub span: Range<usize>,
    /// Byte after its opening bracket, if it has fields or items.
    pub content_start: Option<usize>,
}

impl<'a> ValueLocations<'a> {
    /// Locations of all values of a text, as far as its syntax is right.
    pub fn from_text(text: &'a str) -> Self {
        let mut walker = LocationWalker::new(text);
        walker.skip_extensions();
        walker.skip_value("", 0);
        walker.into_locations(text)
    }

    /// Locations in the text of a value whose path is `path`, and the byte after the value.
    pub fn from_value(text: &'a str, path: &str) -> (Self, usize) {
        let mut walker = LocationWalker::new(text);
        walker.skip_value(path, 0);
        let end = walker.offset;
        (walker.into_locations(text), end)
    }

    /// Location of the value at `path`.
    pub fn value(&self, path: &str) -> Option<&ValueLocation> {
        self.values.get(path)
    }

    /// Names of the fields of the value at `holder`, sorted.
    pub fn fields(&self, holder: &str) -> Vec<&str> {
        let parts = self.values.keys().map(|path| path.rsplit_once('.').unwrap_or(("", path)));
        let is_field = |name: &str| !name.is_empty() && name.parse::<usize>().is_err();
        let mut fields: Vec<&str> =
            parts.filter(|(parent, name)| *parent == holder && is_field(name)).map(|(_, name)| name).collect();
        fields.sort_unstable();
        fields
    }

    /// Former names of fields and values, in the order of the text.
    pub fn former_names(&self) -> &[FormerNameUse] {
        &self.former_names
    }

    /// Fields that the text has under both their former and their current name.
    pub fn conflicts(&self) -> &[NameConflict] {
        &self.conflicts
    }

    /// Line and column, 1-based, of the value at `path`, or of the innermost value around it if it was left out; none if
    /// no part of the path is in the text.
    pub fn position(&self, path: &str) -> Option<(usize, usize)> {
        let mut path = path;
        loop {
            match (self.values.get(path), path.rfind('.')) {
                (Some(value), _) => return Some(line_and_column(self.text, value.span.start)),
                (None, Some(end)) => path = &path[..end],
                (None, None) => return None,
            }
        }
    }

    /// Text of the value at `path`, without its name.
    pub fn text(&self, path: &str) -> Option<&'a str> {
        self.values.get(path).map(|value| &self.text[value.span.clone()])
    }

    /// `path` in words: `grains.0.sizes.min` is `grains 1, sizes, min`. The only value of a kind, as in `Single(0.1)`, is
    /// named like the whole.
    pub fn path_in_words(&self, path: &str) -> String {
        let mut shown: Vec<&str> = Vec::new();
        let mut holder = String::new();
        for key in path.split('.') {
            let is_kind = self.text(&holder).is_some_and(|text| text.starts_with(|c: char| c.is_alphabetic()));
            let is_single = key == "0" && is_kind && self.value(&format!("{holder}.1")).is_none();
            if !is_single {
                shown.push(key);
            }
            holder = if holder.is_empty() { key.to_string() } else { format!("{holder}.{key}") };
        }
        path_in_words(&shown.join("."))
    }

    /// Path of the innermost value at a byte of the text; the name counts as part of the value.
    pub fn path_at(&self, byte: usize) -> Option<&str> {
        let holders = self.values.iter().filter(|(_, value)| value.start <= byte && byte <= value.span.end);
        holders.max_by_key(|(path, value)| (value.start, path.len())).map(|(path, _)| path.as_str())
    }
}

/// Scan of a text that collects its values.
struct LocationWalker<'a> {
    text: &'a [u8],
    /// Next byte.
    offset: usize,
    /// Number of open brackets.
    depth: usize,
    values: HashMap<String, ValueLocation>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<NameConflict>,
}

/// Deepest nesting that is scanned; RON rejects more.
const MAX_DEPTH: usize = 256;

impl<'a> LocationWalker<'a> {
    fn new(text: &'a str) -> Self {
        let (values, former_names, conflicts) = (HashMap::new(), Vec::new(), Vec::new());
        LocationWalker { text: text.as_bytes(), offset: 0, depth: 0, values, former_names, conflicts }
    }

    fn into_locations(self, text: &'a str) -> ValueLocations<'a> {
        ValueLocations { text, values: self.values, former_names: self.former_names, conflicts: self.conflicts }
    }

    fn current_byte(&self) -> u8 {
        self.text.get(self.offset).copied().unwrap_or(0)
    }

    fn advance(&mut self, bytes: usize) {
        let end = (self.offset + bytes).min(self.text.len());
        self.offset = end;
    }

    /// Moves after the next `mark`, or to the end.
    fn skip_past(&mut self, mark: &[u8]) {
        let rest = &self.text[self.offset..];
        let found = rest.windows(mark.len()).position(|window| window == mark);
        self.advance(found.map_or(rest.len(), |start| start + mark.len()));
    }

    fn skip_blank(&mut self) {
        loop {
            match (self.current_byte(), self.text.get(self.offset + 1)) {
                (byte, _) if byte.is_ascii_whitespace() => self.advance(1),
                (b'/', Some(b'/')) => self.skip_past(b"\n"),
                (b'/', Some(b'*')) => self.skip_comment(),
                _ => return,
            }
        }
    }

    /// Moves after a comment in `/* */`, which may contain others.
    fn skip_comment(&mut self) {
        let mut depth = 0;
        while let Some(two) = self.text.get(self.offset..self.offset + 2) {
            let depth_change = match two {
                b"/*" => 1,
                b"*/" => -1,
                _ => 0,
            };
            depth += depth_change;
            self.advance(if depth_change == 0 { 1 } else { 2 });
            if depth == 0 {
                return;
            }
        }
        self.advance(1);
    }

    /// Moves after extensions at the start of a text, such as `#![enable(implicit_some)]`.
    fn skip_extensions(&mut self) {
        self.skip_blank();
        while self.current_byte() == b'#' {
            self.skip_past(b"]");
            self.skip_blank();
        }
    }

    /// Word of ASCII letters, digits and underscores that begins here; may be empty.
    fn current_word(&self) -> &'a str {
        let length = self.text[self.offset..].iter().take_while(|b| b.is_ascii_alphanumeric() || **b == b'_').count();
        std::str::from_utf8(&self.text[self.offset..self.offset + length]).unwrap_or_default()
    }

    /// Reads a field's name followed by a colon, if there is one; moves after the colon.
    fn read_field_name(&mut self) -> Option<String> {
        let name = self.current_word().to_string();
        let (start, length) = (self.offset, name.len());
        self.advance(length);
        self.skip_blank();
        if length > 0 && self.current_byte() == b':' {
            self.advance(1);
            return Some(name);
        }
        self.offset = start;
        None
    }

    /// Moves after the value at `path`; the value, or its name, begins at the byte `start`.
    fn skip_value(&mut self, path: &str, start: usize) {
        self.skip_blank();
        let word = self.current_word();
        if let Some(name) = former_names::former_value(path, word) {
            self.former_names.push(FormerNameUse { name, span: self.offset..self.offset + word.len() });
        }
        let mut value = ValueLocation { start, span: self.offset..self.offset, content_start: None };
        loop {
            self.skip_blank();
            match self.current_byte() {
                b'(' if word == "Some" => {
                    self.skip_optional(path, start);
                    value.content_start = self.values.get(path).and_then(|inner| inner.content_start);
                }
                b'(' | b'[' | b'{' => {
                    value.content_start = Some(self.offset + 1);
                    self.skip_items(path);
                }
                b'"' => self.skip_string(),
                b'r' => self.skip_raw_string(),
                b',' | b')' | b']' | b'}' => break,
                _ if self.offset >= self.text.len() => break,
                _ => self.advance(1),
            }
            value.span.end = self.offset;
        }
        self.values.insert(path.to_string(), value);
    }

    /// Moves from the bracket of `Some(...)` to after its closing one. The value in it has the path of the whole.
    fn skip_optional(&mut self, path: &str, start: usize) {
        if self.depth == MAX_DEPTH {
            self.advance(self.text.len());
            return;
        }
        self.depth += 1;
        self.advance(1);
        self.skip_value(path, start);
        if self.current_byte() == b',' {
            self.advance(1);
            self.skip_blank();
        }
        self.advance(1);
        self.depth -= 1;
    }

    /// Returns the current name of the field `name` of the value at `holder`; `start` is the byte of the name.
    fn current_field(&mut self, holder: &str, name: String, start: usize) -> String {
        let former = former_names::former_field(holder, &name);
        let current = former.map_or(name.as_str(), |name| name.current).to_string();
        if let Some(known) = self.values.get(&format!("{holder}.{current}")) {
            let known_former = self.former_names.iter().find(|one| one.span.start == known.start).map(|one| one.name);
            // The same name twice is reported when the text is parsed.
            if let (Some(name), true) = (former.or(known_former), former.is_some() != known_former.is_some()) {
                self.conflicts.push(NameConflict { offset: start, holder: holder.to_string(), name });
            }
        }
        if let Some(former) = former {
            self.former_names.push(FormerNameUse { name: former, span: start..start + name.len() });
        }
        current
    }

    fn skip_string(&mut self) {
        self.advance(1);
        while self.offset < self.text.len() && self.current_byte() != b'"' {
            self.advance(if self.current_byte() == b'\\' { 2 } else { 1 });
        }
        self.advance(1);
    }

    /// Moves after `r"..."` or `r#"..."#`, which have no escapes; or after the letter only.
    fn skip_raw_string(&mut self) {
        self.advance(1);
        let marks = self.text[self.offset..].iter().take_while(|byte| **byte == b'#').count();
        if self.text.get(self.offset + marks) == Some(&b'"') {
            self.advance(marks + 1);
            self.skip_past(&[b"\"", &b"#".repeat(marks)[..]].concat());
        }
    }

    /// Moves from an opening bracket to after its closing one.
    fn skip_items(&mut self, path: &str) {
        if self.depth == MAX_DEPTH {
            self.advance(self.text.len());
            return;
        }
        self.depth += 1;
        self.advance(1);
        for index in 0.. {
            self.skip_blank();
            if self.offset >= self.text.len() || matches!(self.current_byte(), b')' | b']' | b'}') {
                break;
            }
            let start = self.offset;
            let key = match self.read_field_name() {
                Some(name) => self.current_field(path, name, start),
                None => index.to_string(),
            };
            let path = if path.is_empty() { key } else { format!("{path}.{key}") };
            self.skip_value(&path, start);
            if self.current_byte() == b',' {
                self.advance(1);
            }
        }
        self.advance(1);
        self.depth -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::apply_settings;

    #[test]
    fn finds_values_behind_comments_strings_and_brackets() {
        let text = "Scene( // grains: [\n seed: 1, /* \n */\n name: \"a\\\")\",\n grains: [\n  (sizes: Uniform(\n   \
                    min: 1)),\n  (x: (1,\n 2)),\n ],\n)";
        let locations = ValueLocations::from_text(text);
        let at = |path| locations.position(path);
        assert_eq!(at("seed"), Some((2, 8)));
        assert_eq!(at("name"), Some((4, 8)));
        assert_eq!(at("grains.0"), Some((6, 3)));
        assert_eq!(at("grains.0.sizes.min"), Some((7, 9)));
        assert_eq!(at("grains.0.sizes.max"), Some((6, 11))); // left out: the value around it
        assert_eq!(at("grains.1.x.1"), Some((9, 2)));
        assert_eq!(at("walls"), None);
        // Fields of an optional value have the same path with and without `Some`, which belongs to the value.
        for text in ["(a: (b: 1), c: 2)", "(a: Some((b: 1)), c: 2)", "(a: Some ( (b: 1) , ), c: Some(2))"] {
            let locations = ValueLocations::from_text(text);
            assert!(locations.position("a.b").is_some() && locations.position("c").is_some(), "{text}");
            assert_eq!(apply_settings(text, &["a=None".into()]).unwrap().replace("Some(2)", "2"), "(a: None, c: 2)");
        }
        // Columns are characters.
        assert_eq!(ValueLocations::from_text("(ä: \"é\", b: 1)").position("b"), Some((1, 13)));
    }

    #[test]
    fn passes_over_all_that_ron_passes_over() {
        for (before, after) in [
            ("( /* a: 1, /* b */ /**/\n a: 2, */ ", "a: 1)"),
            ("#![enable(implicit_some)] // a\n#![enable(unwrap_newtypes)]\n(", "a: 1)"),
            ("(b: r#\"\", a: (\"#, c: r\"\n\\\", ", "a: 1)"),
            ("(b: [r, ri], ", "a: 1) /* ( /* */ /*/ */ */"),
        ] {
            let text = format!("{before}{after}");
            let line = ValueLocations::from_text(&text).position("a").map(|(line, _)| line);
            assert_eq!(line, Some(before.lines().count()), "{text}");
            let set_to = |setting: &str| apply_settings(&text, &[setting.to_string()]);
            assert_eq!(set_to("a=7"), Ok(text.replacen(after, &after.replacen("a: 1", "a: 7", 1), 1)));
            assert_eq!(set_to("new=7").map(|text| text.matches("(new: 7, ").count()), Ok(1), "{text}");
        }
        // Nesting so deep that it ends the scan, also as a setting; RON rejects it.
        let deep = format!("(b: {}{}, a: 1)", "(".repeat(100_000), ")".repeat(100_000));
        assert_eq!(ValueLocations::from_text(&deep).position("b").map(|(line, _)| line), Some(1));
        let setting = format!("a={}", &deep[4..deep.len() - 7]);
        assert!(apply_settings("(a: 1)", &[setting]).is_ok_and(|text| text.len() > 200_000));
        // Text without an end, which RON rejects.
        for text in ["(a: 1, /* /* */", "(a: 1, r#\"\"", "#![enable("] {
            ValueLocations::from_text(text);
        }
    }

    #[test]
    fn values_know_where_they_are_from() {
        let text = "(a: 1, list: [(b: x, c: (2, 3))])";
        let locations = ValueLocations::from_text(text);
        let at = |what: &str| locations.path_at(text.find(what).unwrap());
        let found = ["a:", "1", "x", "c:", "(2", "3"].map(at);
        assert_eq!(found, ["a", "a", "list.0.b", "list.0.c", "list.0.c", "list.0.c.1"].map(Some));
        assert_eq!(locations.path_at(text.len() + 1), None);
    }
}
