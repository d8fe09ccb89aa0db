//! Positions of the values of a RON text.
//!
//! serde keeps no positions, so [`ValueLocations`] scans the text again. Since RON has accepted the text, brackets, field
//! names, strings and comments suffice to locate the values. Paths have current names, also where the text has
//! [former](former_names) ones.

use std::cell::OnceCell;
use std::fmt::Write;
use std::ops::Range;

use crate::former_names::{self, FormerName, FormerNameUse};
use crate::names::path_in_words;

/// Values of a RON text by their paths: field names and 0-based positions in lists and tuples, joined by points; the path
/// of the whole is empty.
pub struct ValueLocations<'a> {
    text: &'a str,
    /// First byte of each line, found with the first position.
    line_starts: OnceCell<Vec<usize>>,
    /// Number of characters before each block of [`BLOCK_BYTES`], and of all, found with the first position.
    block_chars: OnceCell<Vec<usize>>,
    /// Path of the first value, in which all others are.
    root: String,
    /// Values in the order of the text: each before those in it.
    values: Vec<ValueLocation<'a>>,
    /// Values by the values in which they are: those in value `k` begin at `first_items[k]`, up to `first_items[k + 1]`.
    items: Vec<u32>,
    first_items: Vec<u32>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<NameConflict>,
}

/// Number of bytes whose characters are counted together.
const BLOCK_BYTES: usize = 4096;

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
pub struct ValueLocation<'a> {
    /// Number of the value that it is in; of the first its own.
    holder: u32,
    /// Current name of its field; none for an item.
    name: Option<&'a str>,
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
        let mut walker = LocationWalker::new(text, "");
        walker.skip_extensions();
        walker.skip_item(0, None, 0);
        walker.into_locations(text, "")
    }

    /// Locations in the text of a value whose path is `path`, and the byte after the value.
    pub fn from_value(text: &'a str, path: &str) -> (Self, usize) {
        let mut walker = LocationWalker::new(text, path);
        walker.skip_item(0, None, 0);
        let end = walker.offset;
        (walker.into_locations(text, path), end)
    }

    /// Location of the value at `path`.
    pub fn value(&self, path: &str) -> Option<&ValueLocation<'a>> {
        Some(&self.values[self.number(path)?])
    }

    /// Number of the value at `path`.
    fn number(&self, path: &str) -> Option<usize> {
        if path == self.root {
            return Some(0);
        }
        let keys = if self.root.is_empty() { path } else { path.strip_prefix(&self.root)?.strip_prefix('.')? };
        keys.split('.').try_fold(0, |holder, key| {
            let items = self.items_in(holder);
            let is_named = |item: &&u32| self.values[**item as usize].name == Some(key);
            let item = match key.parse::<usize>() {
                Ok(index) => items.get(index).filter(|item| self.values[**item as usize].name.is_none()),
                Err(_) => items.iter().rfind(is_named),
            };
            item.map(|item| *item as usize)
        })
    }

    /// Numbers of the values in a value.
    fn items_in(&self, holder: usize) -> &[u32] {
        &self.items[self.first_items[holder] as usize..self.first_items[holder + 1] as usize]
    }

    /// Path of a value.
    fn path(&self, number: usize) -> String {
        if number == 0 {
            return self.root.clone();
        }
        let holder = self.values[number].holder as usize;
        let index = || self.items_in(holder).partition_point(|item| (*item as usize) < number).to_string();
        let key = self.values[number].name.map_or_else(index, str::to_string);
        let path = self.path(holder);
        if path.is_empty() { key } else { format!("{path}.{key}") }
    }

    /// Names of the fields of the value at `holder`, sorted.
    pub fn fields(&self, holder: &str) -> Vec<&'a str> {
        let items = self.number(holder).map_or(&[][..], |holder| self.items_in(holder));
        let mut fields: Vec<&str> = items.iter().filter_map(|item| self.values[*item as usize].name).collect();
        fields.sort_unstable();
        fields.dedup();
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
            match (self.value(path), path.rfind('.')) {
                (Some(value), _) => return Some(self.line_and_column(value.span.start)),
                (None, Some(end)) => path = &path[..end],
                (None, None) => return None,
            }
        }
    }

    /// Line and column of a byte, 1-based, columns in characters.
    fn line_and_column(&self, offset: usize) -> (usize, usize) {
        let starts = self.line_starts.get_or_init(|| {
            let newlines = self.text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
            std::iter::once(0).chain(newlines.map(|(end, _)| end + 1)).collect()
        });
        let line = starts.partition_point(|start| *start <= offset);
        (line, 1 + self.chars_before(offset) - self.chars_before(starts[line - 1]))
    }

    /// Number of characters before a byte. Blocks are counted once: a text may have many values in one long line.
    fn chars_before(&self, offset: usize) -> usize {
        let bytes = self.text.as_bytes();
        let char_count = |bytes: &[u8]| bytes.iter().filter(|&&byte| byte & 0b1100_0000 != 0b1000_0000).count();
        let blocks = self.block_chars.get_or_init(|| {
            let sum = |count: &mut usize, block: &[u8]| {
                *count += char_count(block);
                Some(*count)
            };
            std::iter::once(0).chain(bytes.chunks(BLOCK_BYTES).scan(0, sum)).collect()
        });
        let block = offset / BLOCK_BYTES;
        blocks[block] + char_count(&bytes[block * BLOCK_BYTES..offset])
    }

    /// Text of the value at `path`, without its name.
    pub fn text(&self, path: &str) -> Option<&'a str> {
        self.value(path).map(|value| &self.text[value.span.clone()])
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
    pub fn path_at(&self, byte: usize) -> Option<String> {
        // Inner values are behind outer ones.
        self.values
            .iter()
            .rposition(|value| value.start <= byte && byte <= value.span.end)
            .map(|number| self.path(number))
    }
}

/// Scan of a text that collects its values.
struct LocationWalker<'a> {
    text: &'a [u8],
    /// Next byte.
    offset: usize,
    /// Number of open brackets.
    depth: usize,
    /// Path of the present value.
    path: String,
    values: Vec<ValueLocation<'a>>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<NameConflict>,
}

/// Deepest nesting that is scanned; RON rejects more.
pub(crate) const MAX_DEPTH: usize = 256;

impl<'a> LocationWalker<'a> {
    /// Scan of a text whose first value has the path `root`.
    fn new(text: &'a str, root: &str) -> Self {
        let (values, former_names, conflicts) = (Vec::new(), Vec::new(), Vec::new());
        let path = root.to_string();
        LocationWalker { text: text.as_bytes(), offset: 0, depth: 0, path, values, former_names, conflicts }
    }

    fn into_locations(self, text: &'a str, root: &str) -> ValueLocations<'a> {
        let LocationWalker { values, former_names, mut conflicts, .. } = self;
        conflicts.sort_by_key(|conflict| conflict.offset);
        // The first value is in none.
        let inner = || (1..).zip(&values[1..]);
        let mut first_items = vec![0; values.len() + 1];
        inner().for_each(|(_, value)| first_items[value.holder as usize + 1] += 1);
        (0..values.len()).for_each(|holder| first_items[holder + 1] += first_items[holder]);
        let (mut next, mut items) = (first_items.clone(), vec![0; values.len() - 1]);
        for (number, value) in inner() {
            let place = &mut next[value.holder as usize];
            items[*place as usize] = number;
            *place += 1;
        }
        let (line_starts, block_chars, root) = (OnceCell::new(), OnceCell::new(), root.to_string());
        ValueLocations { text, line_starts, block_chars, root, values, items, first_items, former_names, conflicts }
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
    fn read_field_name(&mut self) -> Option<&'a str> {
        let name = self.current_word();
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

    /// Moves after a value of the value `holder`; it, or its `name`, begins at the byte `start`.
    fn skip_item(&mut self, holder: u32, name: Option<&'a str>, start: usize) {
        let number = self.values.len();
        self.values.push(ValueLocation { holder, name, start, span: start..start, content_start: None });
        self.skip_value(number);
    }

    /// Moves after the value with this number, or after a value in `Some( )` that stands for it.
    fn skip_value(&mut self, number: usize) {
        self.skip_blank();
        let start = self.offset;
        let word = self.current_word();
        if let Some(name) = former_names::former_value(&self.path, word) {
            self.former_names.push(FormerNameUse { name, span: start..start + word.len() });
        }
        let mut end = start;
        loop {
            self.skip_blank();
            match self.current_byte() {
                b'(' if word == "Some" => self.skip_optional(number),
                b'(' | b'[' | b'{' => {
                    self.values[number].content_start = Some(self.offset + 1);
                    self.skip_items(number);
                }
                b'"' => self.skip_string(),
                b'r' => self.skip_raw_string(),
                b',' | b')' | b']' | b'}' => break,
                _ if self.offset >= self.text.len() => break,
                _ => self.advance(1),
            }
            end = self.offset;
        }
        self.values[number].span = start..end;
    }

    /// Moves from the bracket of `Some(...)` to after its closing one. The value in it has the path of the whole.
    fn skip_optional(&mut self, number: usize) {
        if self.depth == MAX_DEPTH {
            self.advance(self.text.len());
            return;
        }
        self.depth += 1;
        self.advance(1);
        self.skip_value(number);
        if self.current_byte() == b',' {
            self.advance(1);
            self.skip_blank();
        }
        self.advance(1);
        self.depth -= 1;
    }

    /// Adds the fields of the present value that are there under their former and their current names. `fields`: all its
    /// fields with their first bytes and, where they have one, their former names.
    fn add_conflicts(&mut self, fields: &mut [FieldName<'a>]) {
        if fields.iter().all(|field| field.former.is_none()) {
            return;
        }
        fields.sort_by_key(|field| (field.current, field.start));
        for pair in fields.windows(2).filter(|pair| pair[0].current == pair[1].current) {
            // The same name twice is reported when the text is parsed.
            let formers = [pair[1].former, pair[0].former];
            if let [Some(name), None] | [None, Some(name)] = formers {
                self.conflicts.push(NameConflict { offset: pair[1].start, holder: self.path.clone(), name });
            }
        }
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
    fn skip_items(&mut self, number: usize) {
        if self.depth == MAX_DEPTH {
            self.advance(self.text.len());
            return;
        }
        self.depth += 1;
        self.advance(1);
        let (path_length, mut fields, mut index) = (self.path.len(), Vec::new(), 0);
        loop {
            self.skip_blank();
            if self.offset >= self.text.len() || matches!(self.current_byte(), b')' | b']' | b'}') {
                break;
            }
            if self.current_byte() == b',' {
                self.advance(1); // a comma without a value
                continue;
            }
            let start = self.offset;
            let name = self.read_field_name().map(|name| {
                let former = former_names::former_field(&self.path, name);
                if let Some(name) = former {
                    self.former_names.push(FormerNameUse { name, span: start..start + name.former.len() });
                }
                let current = former.map_or(name, |name| name.current);
                fields.push(FieldName { current, start, former });
                current
            });
            let point = if path_length == 0 { "" } else { "." };
            // A String takes all.
            let _ = match name {
                Some(name) => write!(self.path, "{point}{name}"),
                None => write!(self.path, "{point}{index}"),
            };
            self.skip_item(number as u32, name, start);
            self.path.truncate(path_length);
            index += 1;
            if self.current_byte() == b',' {
                self.advance(1);
            }
        }
        self.add_conflicts(&mut fields);
        self.advance(1);
        self.depth -= 1;
    }
}

/// Name of a field in a text.
struct FieldName<'a> {
    current: &'a str,
    /// First byte of the name.
    start: usize,
    /// Former name, if the text has that one.
    former: Option<&'static FormerName>,
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
    fn long_texts_are_searched_once() {
        // Each of these took minutes when the time grew with the square of the number of values or names.
        let many = 200_000;
        let list = format!("(list: [{}])", "1, ".repeat(many));
        let locations = ValueLocations::from_text(&list);
        let last = format!("list.{}", many - 1);
        assert_eq!(locations.path_at(list.len() - 5), Some(last.clone()));
        assert!((0..many).all(|k| locations.text(&format!("list.{k}")) == Some("1")));
        assert_eq!(locations.value(&format!("list.{many}")).map(|value| value.span.clone()), None);
        let lines = "(a: 1),\n".repeat(many);
        let text = format!("[\n{lines}]");
        let locations = ValueLocations::from_text(&text);
        assert!((0..many).all(|k| locations.position(&format!("{k}.a")) == Some((k + 2, 5))));
        let names: String = (0..many).map(|k| format!("n{k}: 1, ")).collect();
        let text = format!("({names})");
        assert_eq!(ValueLocations::from_text(&text).fields("").len(), many);
    }

    #[test]
    fn columns_of_a_long_line_count_characters() {
        let text = format!("// \u{e9}\n[{}]", "/*\u{e9}\u{221a}*/ 1, ".repeat(2000));
        let locations = ValueLocations::from_text(&text);
        for k in 0..2000 {
            assert_eq!(locations.position(&k.to_string()), Some((2, 2 + 10 * k + 7)));
        }
    }

    #[test]
    fn commas_without_values_are_no_values() {
        let locations = ValueLocations::from_text("(,, a: 1,, b: [,1,,2,])");
        assert_eq!(locations.fields(""), ["a", "b"]);
        assert_eq!(["b.0", "b.1", "b.2"].map(|path| locations.text(path)), [Some("1"), Some("2"), None]);
    }

    #[test]
    fn fields_under_both_names_are_conflicts() {
        let text = "(grains: [(place: 1, number: 2, placement: 3), (placement: 1, place: 2), (place: 1)])";
        let locations = ValueLocations::from_text(text);
        let found: Vec<_> = locations.conflicts().iter().map(|one| (one.holder.as_str(), one.offset)).collect();
        let second = |name: &str, from: usize| from + text[from..].find(name).unwrap();
        assert_eq!(found, [("grains.0", second("placement", 20)), ("grains.1", second("place:", 60))]);
        assert_eq!(locations.former_names().len(), 3);
    }

    #[test]
    fn values_know_where_they_are_from() {
        let text = "(a: 1, list: [(b: x, c: (2, 3))])";
        let locations = ValueLocations::from_text(text);
        let at = |what: &str| locations.path_at(text.find(what).unwrap());
        let found = ["a:", "1", "x", "c:", "(2", "3"].map(at);
        assert_eq!(
            found,
            ["a", "a", "list.0.b", "list.0.c", "list.0.c", "list.0.c.1"].map(|path| Some(path.to_string()))
        );
        assert_eq!(locations.path_at(text.len() + 1), None);
    }
}
