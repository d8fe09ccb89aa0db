//! Positions of the values of a RON text, and replacement of values.
//!
//! serde keeps no positions, so [`ValueLocations`] scans the text again. Since RON has accepted the text, brackets, field
//! names, strings and comments suffice to locate the values. Paths have current names, also where the text has
//! [former](former_names) ones.

use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

use crate::error::{Fault, Faults};
use crate::former_names::{self, FormerName, FormerNameUse};
use crate::ron_text;

/// Values of a RON text by their paths: field names and 0-based positions in lists and tuples, joined by points; the path
/// of the whole is empty.
pub struct ValueLocations<'a> {
    text: &'a str,
    places: HashMap<String, ValueLocation>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<(usize, String, &'static FormerName)>,
}

/// Position of a value.
struct ValueLocation {
    /// Byte at which its name or, without one, the value begins.
    start: usize,
    /// Bytes of the value.
    span: Range<usize>,
    /// Byte after its opening bracket, if it has fields or items.
    content_start: Option<usize>,
}

impl<'a> ValueLocations<'a> {
    pub fn from_text(text: &'a str) -> Self {
        let mut walk = LocationWalker::new(text);
        walk.skip_extensions();
        walk.skip_value("", 0);
        ValueLocations { text, places: walk.places, former_names: walk.former_names, conflicts: walk.conflicts }
    }

    /// Former names of fields and values, in the order of the text.
    pub fn former_names(&self) -> &[FormerNameUse] {
        &self.former_names
    }

    /// Fields that have both their former and their current name: byte of the second, path of the value that has the
    /// field, name.
    pub fn conflicts(&self) -> &[(usize, String, &'static FormerName)] {
        &self.conflicts
    }

    /// Line and column, 1-based, of the value at `path`, or of the innermost value around it if it was left out; none if
    /// no part of the path is in the text.
    pub fn position(&self, path: &str) -> Option<(usize, usize)> {
        let mut path = path;
        loop {
            match (self.places.get(path), path.rfind('.')) {
                (Some(place), _) => return Some(ron_text::line_and_column(self.text, place.span.start)),
                (None, Some(end)) => path = &path[..end],
                (None, None) => return None,
            }
        }
    }

    /// Text of the value at `path`, without its name.
    pub fn text(&self, path: &str) -> Option<&'a str> {
        self.places.get(path).map(|place| &self.text[place.span.clone()])
    }

    /// Path of the innermost value at a byte of the text; the name counts as part of the value.
    fn path_at(&self, byte: usize) -> Option<&str> {
        let holds = |place: &ValueLocation| place.start <= byte && byte <= place.span.end;
        let holders = self.places.iter().filter(|(_, place)| holds(place));
        holders.max_by_key(|(path, place)| (place.start, path.len())).map(|(path, _)| path.as_str())
    }
}

/// Replaces values in a RON text: each of `settings` is `PATH=VALUE`, with the path of field names and positions in
/// lists, counted from 1, as in `grains.1.number=2000`. A field that was left out is inserted. Lines keep their numbers.
///
/// Errors: settings that are not such pairs, and paths that do not exist.
pub fn apply_settings(text: &str, settings: &[String]) -> Result<String, Faults> {
    let mut text = text.to_string();
    let mut faults = Faults::default();
    for setting in settings {
        match apply_setting(&text, setting) {
            Ok(changed) => text = changed,
            Err((found, expected)) => faults.push(setting_fault(setting, found, expected)),
        }
    }
    faults.into_result(text)
}

/// Fault of a setting.
pub fn setting_fault(setting: &str, found: impl Into<String>, expected: impl Into<String>) -> Fault {
    Fault::new(Path::new("options"), None, format!("set {setting}"), found, expected)
}

/// Last of `settings` that sets the value at `path`, if any.
pub fn setting_of_path<'a>(settings: &'a [String], path: &str) -> Option<&'a str> {
    let is_part = |setting: &&String| {
        let rest = setting.split_once('=').and_then(|(of, _)| path.strip_prefix(&path_keys(of.trim())?.join(".")));
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    settings.iter().rfind(is_part).map(String::as_str)
}

/// Last of `settings` that sets the value at a line and column of `text`, 1-based, if any.
pub fn setting_at<'a>(settings: &'a [String], text: &str, line: usize, column: usize) -> Option<&'a str> {
    let before: usize = text.split_inclusive('\n').take(line - 1).map(str::len).sum();
    let within: usize = text[before..].chars().take(column - 1).map(char::len_utf8).sum();
    // RON reports some missing values where the blank before them begins.
    let byte = text.len() - text[before + within..].trim_start().len();
    setting_of_path(settings, ValueLocations::from_text(text).path_at(byte)?)
}

/// Current names and 0-based positions of a path in which positions in lists count from 1; none if a position is 0.
fn path_keys(path: &str) -> Option<Vec<String>> {
    Some(path_with_current_names(path)?.0)
}

/// [`path_keys`], and the former names in the path.
fn path_with_current_names(path: &str) -> Option<(Vec<String>, Vec<&'static FormerName>)> {
    let (mut keys, mut former): (Vec<String>, _) = (Vec::new(), Vec::new());
    for key in path.split('.') {
        let key = match (key.parse::<usize>(), former_names::former_field(&keys.join("."), key)) {
            (Ok(index), _) => index.checked_sub(1)?.to_string(),
            (Err(_), Some(name)) => {
                former.push(name);
                name.current.to_string()
            }
            (Err(_), None) => key.to_string(),
        };
        keys.push(key);
    }
    Some((keys, former))
}

/// Former names in the path and in the value of a setting.
pub(crate) fn former_names_of_setting(setting: &str) -> Vec<&'static FormerName> {
    let Some((path, value)) = setting.split_once('=') else { return Vec::new() };
    let Some((keys, mut names)) = path_with_current_names(path.trim()) else { return Vec::new() };
    let mut walk = LocationWalker::new(value);
    walk.skip_value(&keys.join("."), 0);
    names.extend(walk.former_names.iter().map(|one| one.name));
    names
}

fn apply_setting(text: &str, setting: &str) -> Result<String, (String, String)> {
    let refuse = |found: &str, expected: &str| (found.to_string(), format!("expected {expected}"));
    let pair = setting.split_once('=').map(|(path, value)| (path.trim(), value.trim().replace('\n', " ")));
    let Some((path, value)) = pair.filter(|(path, _)| !path.is_empty()) else {
        return Err(refuse("is no pair", "PATH=VALUE, such as grains.1.number=2000"));
    };
    if let Some(mistake) = ron_text::syntax_faults(&value).into_iter().next().filter(|_| !value.is_empty()) {
        return Err((format!("value: {}", mistake.found), mistake.expected));
    }
    let mut walk = LocationWalker::new(&value);
    walk.skip_value("", 0);
    if walk.at < value.len() || walk.places[""].span.end < value.len() || value.is_empty() {
        return Err(refuse(&format!("'{value}'"), "one value in RON"));
    }
    let Some(keys) = path_keys(path) else {
        return Err(refuse("0", "positions in lists counted from 1"));
    };
    let places = ValueLocations::from_text(text).places;
    if let Some(place) = places.get(&keys.join(".")) {
        return Ok(format!("{}{value}{}", &text[..place.span.start], &text[place.span.end..]));
    }
    // A field that was left out is inserted behind the bracket of its holder.
    let known = (0..keys.len()).rev().find(|&k| places.contains_key(&keys[..k].join("."))).unwrap_or(0);
    let new = &keys[known..];
    let named = |key: &String| key.starts_with(|c: char| c.is_alphabetic() || c == '_');
    let holder = places.get(&keys[..known].join("."));
    let has_names = |place: &ValueLocation| {
        let first = format!("{}0", keys[..known].iter().map(|key| format!("{key}.")).collect::<String>());
        text.as_bytes()[place.content_start.unwrap_or(1) - 1] == b'(' && !places.contains_key(&first)
    };
    let Some(inside) =
        holder.filter(|place| has_names(place)).and_then(|place| place.content_start).filter(|_| new.iter().all(named))
    else {
        let shown: Vec<&str> = path.split('.').take(known + 1).collect();
        let found = format!("no '{}' in the file", shown.join("."));
        return Err(match nearest_field(&places, &keys[..known], &new[0]) {
            Some(near) => (found, format!("did you mean {}?", [&shown[..known], &[near]].concat().join("."))),
            None => refuse(&found, "the path of a value"),
        });
    };
    let value =
        new.iter().rev().skip(1).fold(format!("{}: {value}", new[new.len() - 1]), |v, key| format!("{key}: ({v})"));
    Ok(format!("{}{value}, {}", &text[..inside], &text[inside..]))
}

/// Name of the field of the value at `holder` that is nearest to `name`.
fn nearest_field<'a>(places: &'a HashMap<String, ValueLocation>, holder: &[String], name: &str) -> Option<&'a str> {
    let within = |path: &'a String| {
        let (parent, field) = path.rsplit_once('.').unwrap_or(("", path));
        (parent == holder.join(".") && field.parse::<usize>().is_err() && !field.is_empty()).then_some(field)
    };
    let mut fields: Vec<&str> = places.keys().filter_map(within).collect();
    fields.sort_unstable();
    ron_text::nearest_name(name, &fields)
}

struct LocationWalker<'a> {
    text: &'a [u8],
    at: usize,
    /// Number of open brackets.
    depth: usize,
    places: HashMap<String, ValueLocation>,
    former_names: Vec<FormerNameUse>,
    conflicts: Vec<(usize, String, &'static FormerName)>,
}

/// Deepest nesting that is scanned; RON rejects more.
const MAX_DEPTH: usize = 256;

impl<'a> LocationWalker<'a> {
    fn new(text: &'a str) -> Self {
        let (places, former_names, conflicts) = (HashMap::new(), Vec::new(), Vec::new());
        LocationWalker { text: text.as_bytes(), at: 0, depth: 0, places, former_names, conflicts }
    }

    fn current_byte(&self) -> u8 {
        self.text.get(self.at).copied().unwrap_or(0)
    }

    fn advance(&mut self, bytes: usize) {
        let end = (self.at + bytes).min(self.text.len());
        self.at = end;
    }

    /// Moves after the next `mark`, or to the end.
    fn skip_past(&mut self, mark: &[u8]) {
        let rest = &self.text[self.at..];
        let found = rest.windows(mark.len()).position(|window| window == mark);
        self.advance(found.map_or(rest.len(), |start| start + mark.len()));
    }

    fn skip_blank(&mut self) {
        loop {
            match (self.current_byte(), self.text.get(self.at + 1)) {
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
        while let Some(two) = self.text.get(self.at..self.at + 2) {
            let deeper = match two {
                b"/*" => 1,
                b"*/" => -1,
                _ => 0,
            };
            depth += deeper;
            self.advance(if deeper == 0 { 1 } else { 2 });
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
        let length = self.text[self.at..].iter().take_while(|b| b.is_ascii_alphanumeric() || **b == b'_').count();
        std::str::from_utf8(&self.text[self.at..self.at + length]).unwrap_or_default()
    }

    /// Reads a field's name followed by a colon, if there is one; moves after the colon.
    fn read_field_name(&mut self) -> Option<String> {
        let name = self.current_word().to_string();
        let (start, length) = (self.at, name.len());
        self.advance(length);
        self.skip_blank();
        if length > 0 && self.current_byte() == b':' {
            self.advance(1);
            return Some(name);
        }
        self.at = start;
        None
    }

    /// Moves after the value at `path`; the value, or its name, begins at the byte `start`.
    fn skip_value(&mut self, path: &str, start: usize) {
        self.skip_blank();
        let word = self.current_word();
        if let Some(name) = former_names::former_value(path, word) {
            self.former_names.push(FormerNameUse { name, span: self.at..self.at + word.len() });
        }
        let mut place = ValueLocation { start, span: self.at..self.at, content_start: None };
        loop {
            self.skip_blank();
            match self.current_byte() {
                b'(' | b'[' | b'{' => {
                    place.content_start = Some(self.at + 1);
                    self.skip_items(path);
                }
                b'"' => self.skip_string(),
                b'r' => self.skip_raw_string(),
                b',' | b')' | b']' | b'}' => break,
                _ if self.at >= self.text.len() => break,
                _ => self.advance(1),
            }
            place.span.end = self.at;
        }
        self.places.insert(path.to_string(), place);
    }

    /// Returns the current name of the field `name` of the value at `holder`; `start` is the byte of the name.
    fn current_field(&mut self, holder: &str, name: String, start: usize) -> String {
        let former = former_names::former_field(holder, &name);
        let current = former.map_or(name.as_str(), |name| name.current).to_string();
        if let Some(known) = self.places.get(&format!("{holder}.{current}")) {
            let first = self.former_names.iter().find(|one| one.span.start == known.start).map(|one| one.name);
            // The same name twice is reported when the text is parsed.
            if let (Some(name), true) = (former.or(first), former.is_some() != first.is_some()) {
                self.conflicts.push((start, holder.to_string(), name));
            }
        }
        if let Some(former) = former {
            self.former_names.push(FormerNameUse { name: former, span: start..start + name.len() });
        }
        current
    }

    fn skip_string(&mut self) {
        self.advance(1);
        while self.at < self.text.len() && self.current_byte() != b'"' {
            self.advance(if self.current_byte() == b'\\' { 2 } else { 1 });
        }
        self.advance(1);
    }

    /// Moves after `r"..."` or `r#"..."#`, which have no escapes; or after the letter only.
    fn skip_raw_string(&mut self) {
        self.advance(1);
        let marks = self.text[self.at..].iter().take_while(|byte| **byte == b'#').count();
        if self.text.get(self.at + marks) == Some(&b'"') {
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
            if self.at >= self.text.len() || matches!(self.current_byte(), b')' | b']' | b'}') {
                break;
            }
            let start = self.at;
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

    #[test]
    fn finds_values_behind_comments_strings_and_brackets() {
        let text = "Scene( // grains: [\n seed: 1, /* \n */\n name: \"a\\\")\",\n grains: [\n  (sizes: Uniform(\n   \
                    min: 1)),\n  (x: (1,\n 2)),\n ],\n)";
        let places = ValueLocations::from_text(text);
        let at = |path| places.position(path);
        assert_eq!(at("seed"), Some((2, 8)));
        assert_eq!(at("name"), Some((4, 8)));
        assert_eq!(at("grains.0"), Some((6, 3)));
        assert_eq!(at("grains.0.sizes.min"), Some((7, 9)));
        assert_eq!(at("grains.0.sizes.max"), Some((6, 11))); // left out: the value around it
        assert_eq!(at("grains.1.x.1"), Some((9, 2)));
        assert_eq!(at("walls"), None);
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
            assert_eq!(set_to(&text, "a=7"), Ok(text.replacen(after, &after.replacen("a: 1", "a: 7", 1), 1)));
            assert_eq!(set_to(&text, "new=7").map(|text| text.matches("(new: 7, ").count()), Ok(1), "{text}");
        }
        // Nesting so deep that it ends the scan, also as a setting; RON rejects it.
        let deep = format!("(b: {}{}, a: 1)", "(".repeat(100_000), ")".repeat(100_000));
        assert_eq!(ValueLocations::from_text(&deep).position("b").map(|(line, _)| line), Some(1));
        assert!(set_to("(a: 1)", &format!("a={}", &deep[4..deep.len() - 7])).is_ok_and(|text| text.len() > 200_000));
        // Text without an end, which RON rejects.
        for text in ["(a: 1, /* /* */", "(a: 1, r#\"\"", "#![enable("] {
            ValueLocations::from_text(text);
        }
    }

    #[test]
    fn values_know_where_they_are_from() {
        let text = "(a: 1, list: [(b: x, c: (2, 3))])";
        let places = ValueLocations::from_text(text);
        let at = |what: &str| places.path_at(text.find(what).unwrap());
        let found = ["a:", "1", "x", "c:", "(2", "3"].map(at);
        assert_eq!(found, ["a", "a", "list.0.b", "list.0.c", "list.0.c", "list.0.c.1"].map(Some));
        assert_eq!(places.path_at(text.len() + 1), None);
        let settings = ["list.1.b=x", "list.1=(b: 1)", "a=2", "no pair"].map(String::from);
        let of = |path| setting_of_path(&settings, path);
        assert_eq!(["list.0.b", "list.0", "a"].map(of), ["list.1=(b: 1)", "list.1=(b: 1)", "a=2"].map(Some));
        assert_eq!([of("list"), of("list.1.b"), of("ab"), of("")], [None; 4]);
        let text = "(\n  ä: 1,\n  a: x)";
        let found = [(2, 5), (3, 4), (3, 5), (3, 6)].map(|(line, column)| setting_at(&settings, text, line, column));
        assert_eq!(found, [None, Some("a=2"), Some("a=2"), Some("a=2")]);
    }

    fn set_to(text: &str, setting: &str) -> Result<String, String> {
        apply_settings(text, &[setting.to_string()]).map_err(|faults| faults.to_string())
    }

    #[test]
    fn other_values_take_the_place_of_those_that_stand_there() {
        let text = "( // a (b: 1)\n a: 1, list: [(b: \"x, y\" /* b */), Kind(c: 2)], pair: Single(3.0),\n)";
        for (setting, from, to) in [
            ("a=7", "a: 1,", "a: 7,"),
            ("list.1.b = \"z\"", "\"x, y\"", "\"z\""),
            ("list.2.c=[1, (2)]", "c: 2", "c: [1, (2)]"),
            ("list.2=Other", "Kind(c: 2)", "Other"),
            ("pair.1=4", "Single(3.0)", "Single(4)"),
            ("list.2.d=5", "Kind(", "Kind(d: 5, "),
            ("new=5", "( // a", "(new: 5,  // a"),
            ("new.x.y=5", "( // a", "(new: (x: (y: 5)),  // a"),
        ] {
            assert_eq!(set_to(text, setting).as_deref(), Ok(text.replacen(from, to, 1).as_str()), "{setting}");
        }
        let both = apply_settings(text, &["new.x=1".into(), "new.y=2".into()]).unwrap();
        assert!(both.contains("new: (y: 2, x: 1)"), "{both}");
    }

    #[test]
    fn paths_that_lead_nowhere_are_refused() {
        let text = "(a: 1, list: [(b: 1)], pair: (1.0, 2.0))";
        for setting in [
            "a",
            "=1",
            "a=",
            "a=1)",
            "a=1, 2",
            "a.b=1",
            "list.2=(b: 2)",
            "list.0=1",
            "list.b=1",
            "pair.x=1",
            "9=1",
            "=",
            ".",
        ] {
            assert!(set_to(text, setting).is_err(), "{setting}");
        }
    }
}
