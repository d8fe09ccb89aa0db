//! Reading of RON texts, with errors at the position of the mistake, in plain words.
//!
//! [`syntax_faults`] finds all faults of the text itself (brackets, commas, quotes, comments) at once. A text without
//! such faults is parsed by the RON library. Its error is described with the value at its position; the library's own
//! text never reaches the user.

use std::ops::Range;
use std::path::Path;

use ron::error::Error;
use serde::de::DeserializeOwned;

use crate::error::{Fault, Faults};
use crate::report;

/// Fault at a byte of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextFault {
    pub at: usize,
    /// Path of the value that it belongs to, as `grains.0.number`; empty for the whole text.
    pub path: String,
    pub found: String,
    /// Expectation that begins with `expected`, or a question, `did you mean ...?`.
    pub expected: String,
}

/// Faults of the value of a flag, on one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlagError(String);

impl std::fmt::Display for FlagError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for FlagError {}

/// RON options of our files: `field: x` is read as `field: Some(x)`.
pub(crate) fn ron_options() -> ron::Options {
    ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
}

/// Reads RON.
///
/// Errors: all faults of the syntax, or else the first value that does not fit its type, with line and column. `object`
/// is the name of the text as a whole in faults.
pub fn from_ron<T: DeserializeOwned>(path: &Path, text: &str, object: &str) -> Result<T, Faults> {
    parse_ron(text).map_err(|mistakes| {
        let fault = |mistake: TextFault| {
            let (line, column) = line_and_column(text, mistake.at);
            let object =
                if mistake.path.is_empty() { object.to_string() } else { report::path_in_words(&mistake.path) };
            Fault { column: Some(column), ..Fault::new(path, Some(line), object, mistake.found, mistake.expected) }
        };
        Faults(mistakes.into_iter().map(fault).collect())
    })
}

/// Reads the value of a flag; the error is one line without a position in a file.
pub fn from_flag<T: DeserializeOwned>(text: &str) -> Result<T, FlagError> {
    parse_ron(text).map_err(|mistakes| {
        let one = |TextFault { at, path, found, expected }: &TextFault| {
            let of = if path.is_empty() { String::new() } else { format!("{}: ", report::path_in_words(path)) };
            format!("column {}: {of}{found}; {expected}", line_and_column(text, *at).1)
        };
        FlagError(mistakes.iter().map(one).collect::<Vec<_>>().join("; "))
    })
}

fn parse_ron<T: DeserializeOwned>(text: &str) -> Result<T, Vec<TextFault>> {
    // Only the library decides which texts are accepted.
    ron_options().from_str(text).map_err(|error| {
        let (nodes, mistakes) = RonParser::parse(text);
        if mistakes.is_empty() { vec![describe_error::<T>(text, &nodes, &error)] } else { mistakes }
    })
}

/// Line and column of a byte, 1-based, columns in characters.
pub fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let before = &text[..at.min(text.len())];
    let begin = before.rfind('\n').map_or(0, |end| end + 1);
    (1 + before.matches('\n').count(), 1 + before[begin..].chars().count())
}

/// All faults of the syntax of a text.
pub fn syntax_faults(text: &str) -> Vec<TextFault> {
    RonParser::parse(text).1
}

/// Question with the known name nearest to an unknown one, if it is near enough: `did you mean output_every?`.
pub fn nearest_name<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let plain = |name: &str| name.to_lowercase().replace(['-', '_'], "");
    let wanted = plain(name);
    let distance = |other: &str| strsim::damerau_levenshtein(&wanted, &plain(other));
    let best = known.iter().copied().min_by_key(|other| distance(other))?;
    // A third of the letters may differ; with more, unrelated short names would match.
    let letters = wanted.chars().count().max(plain(best).chars().count());
    (distance(best) <= letters / 3 || plain(best).starts_with(&wanted) && wanted.len() >= 3).then_some(best)
}

/// Suggestion for an unknown name: the nearest known name, or all.
pub fn known_names(name: &str, known: &[&str]) -> String {
    match (nearest_name(name, known), known) {
        (Some(near), _) => format!("did you mean {near}?"),
        (None, []) => "expected none".into(),
        (None, [one]) => format!("expected {one}"),
        (None, all) => format!("expected one of {}", all.join(", ")),
    }
}

// ------------------------------------------------------------------------------------------------ the library's errors

/// Value of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ValueNode {
    path: String,
    /// Name of its field, if it has one.
    name: Option<Range<usize>>,
    span: Range<usize>,
}

/// Largest number of characters of a value that a message shows.
const MAX_SHOWN_CHARS: usize = 40;

fn display_text(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= MAX_SHOWN_CHARS {
        line
    } else {
        format!("{}...", line.chars().take(MAX_SHOWN_CHARS).collect::<String>())
    }
}

/// Byte of a position of the library, and the next byte that is neither blank nor comment.
fn byte_offsets(text: &str, line: usize, column: usize) -> (usize, usize) {
    let before: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
    let within: usize = text[before..].chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
    let raw = before + within;
    let mut parser = RonParser { at: raw, ..RonParser::new(text) };
    parser.skip_blank();
    (raw, if parser.at < text.len() { parser.at } else { raw })
}

/// Describes the library's error in words.
fn describe_error<T: DeserializeOwned>(text: &str, nodes: &[ValueNode], error: &ron::error::SpannedError) -> TextFault {
    let (raw, at) = byte_offsets(text, error.span.start.line, error.span.start.col);
    let inner = |holds: &dyn Fn(&ValueNode) -> bool| {
        nodes.iter().filter(|node| holds(node)).min_by_key(|node| node.span.end - node.span.start)
    };
    let value = inner(&|node| node.span.start <= at && at < node.span.end.max(node.span.start + 1));
    let named = inner(&|node| node.name.as_ref().is_some_and(|name| name.start <= at && at < name.end));
    let text_of = |node: &ValueNode| display_text(&text[node.span.clone()]);
    let of = |node: Option<&ValueNode>, found: String, expected: String| {
        let (at, path) = node.map_or((at, String::new()), |node| (node.span.start, node.path.clone()));
        TextFault { at, path, found, expected }
    };
    let wrong = |expected: &str| of(value, value.map_or("no value".into(), text_of), format!("expected {expected}"));
    let holder = |node: Option<&ValueNode>| {
        node.and_then(|node| node.path.rsplit_once('.')).map_or(String::new(), |(holder, _)| holder.to_string())
    };
    match &error.code {
        Error::NoSuchStructField { expected, found, .. } => {
            let path = holder(named.or(value));
            return TextFault {
                at,
                path,
                found: format!("unknown field '{found}'"),
                expected: known_names(found, expected),
            };
        }
        Error::DuplicateStructField { field, .. } => {
            let found = format!("'{field}' is there twice");
            return TextFault { at, path: holder(named), found, expected: "expected it once".into() };
        }
        Error::MissingStructField { field, outer } => {
            let kind =
                outer.as_ref().filter(|kind| value.is_some_and(|node| text[node.span.clone()].starts_with(*kind)));
            let kind = kind.map_or(String::new(), |kind| format!(" of {kind}"));
            return of(value, format!("no field '{field}'"), format!("expected the field {field}{kind}"));
        }
        Error::NoSuchEnumVariant { expected, found, .. } => {
            return of(value, format!("unknown '{found}'"), known_names(found, expected));
        }
        Error::ExpectedBoolean => return wrong("true or false"),
        Error::ExpectedArray | Error::ExpectedArrayEnd => return wrong("a list in [ ]"),
        Error::ExceededRecursionLimit => {
            return of(value, "brackets nested too deeply".into(), format!("expected at most {MAX_DEPTH} levels"));
        }
        Error::ExpectedString | Error::ExpectedStringEnd => {
            let word = value.map(text_of).filter(|word| word.starts_with(char::is_alphabetic));
            return wrong(&word.map_or("a text in quotes".into(), |word| format!("a text in quotes, \"{word}\"")));
        }
        Error::ExpectedDifferentLength { expected, found } => {
            let count = if *found == 1 { "one value".to_string() } else { format!("{found} values") };
            let found = format!("{count} in {}", value.map_or(String::new(), text_of));
            return of(value, found, format!("expected {}", expectation_in_words(expected)));
        }
        Error::IntegerOutOfBounds => {
            let negative = value.is_some_and(|node| text_of(node).starts_with('-'));
            return wrong(if negative { "an integer of 0 or more" } else { "a smaller integer" });
        }
        _ => {}
    }
    // A name where values have no names.
    if let Some(node) = named.filter(|node| value.is_none_or(|value| value.span.start < node.span.start)) {
        let name = &text[node.name.clone().unwrap_or_default()];
        return TextFault {
            at,
            path: holder(Some(node)),
            found: format!("'{name}:'"),
            expected: "expected a value without a name".into(),
        };
    }
    match &error.code {
        Error::ExpectedFloat | Error::FloatUnderscore => return wrong("a number"),
        Error::ExpectedInteger | Error::InvalidIntegerDigit { .. } | Error::UnderscoreAtBeginning => {
            return wrong("an integer");
        }
        _ => {}
    }
    // A number that the library has read partly.
    if value.is_some_and(|node| node.span.start < at && text[node.span.clone()].parse::<f64>().is_ok()) {
        return wrong("an integer");
    }
    // A number followed by other characters.
    if let Some(node) = value.filter(|node| begins_with_number(&text[node.span.clone()])) {
        let word = &text[node.span.clone()];
        let plain = word.replace(['d', 'D'], "e");
        match plain.parse::<f64>() {
            Ok(_) if plain != word => return wrong(&format!("a number, {plain}")),
            Err(_) if word.ends_with(char::is_alphabetic) && !word.ends_with(['e', 'E']) => {
                return wrong("a number without unit");
            }
            _ => {}
        }
    }
    // A variant whose fields were left out.
    let bare = inner(&|node| node.span.end == raw && text[node.span.clone()].starts_with(char::is_alphabetic));
    if let Some(node) = bare.filter(|node| !text[node.span.clone()].contains('(')) {
        let kind = text_of(node);
        let fields = match probe_error::<T>(text, node, &format!("{kind}({UNKNOWN_NAME}: 0)")) {
            Some(Error::NoSuchStructField { expected, .. }) => format!("{kind}(...) with {}", field_list(expected)),
            _ => format!("{kind}(...) with its values"),
        };
        return of(bare, kind, format!("expected {fields}"));
    }
    let Some(node) = value else { return wrong("another value") };
    // The library lists the expected names only for an unknown name.
    match probe_error::<T>(text, node, UNKNOWN_NAME) {
        Some(Error::NoSuchEnumVariant { expected, .. }) if expected.contains(&"Constant") => {
            let found = text_of(node);
            let example = found.parse::<f64>().map_or(String::new(), |_| format!(", such as Constant({found})"));
            return wrong(&format!("a function, one of {}{example}", expected.join(", ")));
        }
        Some(Error::NoSuchEnumVariant { expected, .. }) => return wrong(&format!("one of {}", expected.join(", "))),
        _ => {}
    }
    if let Some(Error::NoSuchStructField { expected, .. }) = probe_error::<T>(text, node, &format!("{UNKNOWN_NAME}: 0"))
    {
        return wrong(&format!("name: value, with {}", field_list(expected)));
    }
    if let Some(Error::NoSuchStructField { expected, .. }) =
        probe_error::<T>(text, node, &format!("({UNKNOWN_NAME}: 0)"))
    {
        return wrong(&format!("( ) around {}", field_list(expected)));
    }
    // Too many values in the enclosing bracket.
    let around = inner(&|node| node.span.start < raw && raw < node.span.end && Some(node) != value);
    for (node, found) in
        [(value, value.map(text_of)), (around, around.map(|list| format!("too many values in {}", text_of(list))))]
    {
        let (Some(node), Some(found)) = (node, found) else { continue };
        if let Some(Error::ExpectedDifferentLength { expected, .. }) = probe_error::<T>(text, node, "()") {
            return of(Some(node), found, format!("expected {}", expectation_in_words(&expected)));
        }
    }
    match &error.code {
        Error::ExpectedStructLikeEnd | Error::ExpectedOptionEnd => {
            let found = around.map_or(String::new(), |list| format!("too many values in {}", text_of(list)));
            of(around, found, "expected one value".into())
        }
        Error::InvalidValueForType { expected, .. } => wrong(&expectation_in_words(expected)),
        Error::ExpectedStructLike | Error::ExpectedNamedStructLike(_) | Error::ExpectedDifferentStructName { .. } => {
            wrong("values in ( )")
        }
        _ => wrong("another value"),
    }
}

/// Name that no type has.
const UNKNOWN_NAME: &str = "Unknown_name";

/// Error of the library after a value is replaced by another text, if the error concerns that value.
fn probe_error<T: DeserializeOwned>(text: &str, node: &ValueNode, other: &str) -> Option<Error> {
    let text = format!("{}{other}{}", &text[..node.span.start], &text[node.span.end..]);
    match ron_options().from_str::<T>(&text).err()?.code {
        Error::NoSuchEnumVariant { found, .. } | Error::NoSuchStructField { found, .. } if found != UNKNOWN_NAME => {
            None
        }
        code => Some(code),
    }
}

fn field_list(fields: &[&str]) -> String {
    if let [one] = fields { format!("the field {one}") } else { format!("fields of {}", fields.join(", ")) }
}

/// Converts an expectation of serde to plain words.
fn expectation_in_words(expected: &str) -> String {
    let number = expected.split_whitespace().rev().find_map(|word| word.parse::<usize>().ok());
    match number {
        Some(1) => "one value".into(),
        Some(number) => format!("{number} values in ( )"),
        _ if expected.contains("f64") || expected.contains("float") => "a number".into(),
        _ if expected.contains("string") => "a text in quotes".into(),
        _ => "another value".into(),
    }
}

// ------------------------------------------------------------------------------------------------------------- syntax

/// Nesting depth beyond which the library refuses a text.
const MAX_DEPTH: usize = 128;

/// Parser that continues after mistakes.
struct RonParser<'a> {
    text: &'a str,
    at: usize,
    /// Byte after the last token.
    last_end: usize,
    /// Open brackets, with the byte of each.
    open: Vec<(char, usize)>,
    /// Brackets with the bytes of their opening and closing.
    brackets: Vec<(char, usize, usize)>,
    nodes: Vec<ValueNode>,
    mistakes: Vec<TextFault>,
    /// Whether parsing has stopped after a mistake from which it cannot recover.
    aborted: bool,
}

impl<'a> RonParser<'a> {
    fn new(text: &'a str) -> Self {
        RonParser {
            text,
            at: 0,
            last_end: 0,
            open: vec![],
            brackets: vec![],
            nodes: vec![],
            mistakes: vec![],
            aborted: false,
        }
    }

    /// Values of a text and all mistakes in it.
    fn parse(text: &'a str) -> (Vec<ValueNode>, Vec<TextFault>) {
        let mut parser = RonParser::new(text);
        parser.skip_blank();
        while parser.remaining_text().starts_with("#!") {
            let end = parser.remaining_text().find(']').map_or(parser.remaining_text().len(), |end| end + 1);
            parser.advance(end);
            parser.skip_blank();
        }
        if parser.at_end() && !parser.aborted && parser.mistakes.is_empty() {
            parser.add_fault(0, "", "no value", "expected one");
        } else {
            let start = parser.at;
            parser.skip_value("", None);
            parser.skip_blank();
            if !parser.aborted && !parser.at_end() && parser.mistakes.is_empty() {
                let rest = display_text(parser.remaining_text().lines().next().unwrap_or(""));
                match parser.current_char() {
                    Some(':' | '=') => {
                        let word = &text[start..parser.last_end];
                        parser.add_fault(start, "", &format!("'{word}' outside of ( )"), "expected '(' before it");
                    }
                    Some(close @ (')' | ']' | '}')) => {
                        parser.add_fault(parser.at, "", &format!("'{close}' closes nothing"), "expected nothing more");
                    }
                    _ => parser.add_fault(parser.at, "", &format!("'{rest}' behind the end"), "expected nothing more"),
                }
            }
        }
        if let Some((bracket, at)) = parser.suspect_bracket() {
            let close = closing_bracket(bracket);
            parser.mistakes.retain(|mistake| mistake.at < at);
            let (found, expected) =
                (format!("'{bracket}' without '{close}'"), format!("expected '{close}' in this line"));
            parser.mistakes.push(TextFault { at, path: String::new(), found, expected });
        }
        let RonParser { nodes, mut mistakes, .. } = parser;
        mistakes.sort_by_key(|mistake| mistake.at);
        mistakes.dedup();
        (nodes, mistakes)
    }

    /// First bracket that seems to lack its end, after a mistake in brackets: one that its line leaves open, while the
    /// next line is not indented more.
    fn suspect_bracket(&self) -> Option<(char, usize)> {
        if !self.aborted || !self.mistakes.iter().any(|mistake| mistake.found.contains("is open")) {
            return None;
        }
        let open = self.open.iter().map(|&(bracket, at)| (bracket, at, self.text.len()));
        let mut brackets: Vec<_> = self.brackets.iter().copied().chain(open).collect();
        brackets.sort_unstable_by_key(|bracket| bracket.1);
        let seems_open = |&(_, at, end): &(char, usize, usize)| {
            let line = self.text[..at].rfind('\n').map_or(0, |end| end + 1);
            let Some((this, rest)) = self.text[line..end.max(line)].split_once('\n') else { return false };
            let rest =
                &self.text[line + this.len() + 1..][..rest.len().max(1).min(self.text.len() - line - this.len() - 1)];
            let indent = |line: &str| line.len() - line.trim_start().len();
            let next = rest.lines().find(|line| !line.trim().is_empty());
            at > line + indent(this)
                && next
                    .is_some_and(|next| indent(next) <= indent(this) && !next.trim_start().starts_with([')', ']', '}']))
        };
        brackets.into_iter().find(seems_open).map(|(bracket, at, _)| (bracket, at))
    }

    fn remaining_text(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn current_char(&self) -> Option<char> {
        self.remaining_text().chars().next()
    }

    fn at_end(&self) -> bool {
        self.at >= self.text.len()
    }

    /// Skips the bytes of a token.
    fn advance(&mut self, bytes: usize) {
        self.at = (self.at + bytes).min(self.text.len());
        self.last_end = self.at;
    }

    fn add_fault(&mut self, at: usize, path: &str, found: &str, expected: &str) {
        if !self.aborted {
            let [found, expected] = [found, expected].map(str::to_string);
            self.mistakes.push(TextFault { at, path: path.into(), found, expected });
        }
    }

    /// Stops parsing.
    fn give_up(&mut self) {
        self.aborted = true;
        self.at = self.text.len();
    }

    fn skip_blank(&mut self) {
        loop {
            let rest = self.remaining_text();
            let blank = |c: char| c.is_ascii_whitespace() || "\u{b}\u{85}\u{200e}\u{200f}\u{2028}\u{2029}".contains(c);
            if let Some(blank) = rest.chars().next().filter(|c| blank(*c)) {
                self.at += blank.len_utf8();
            } else if rest.starts_with("//") {
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("/*") {
                self.skip_comment();
            } else if rest.starts_with('#') && !rest.starts_with("#!") {
                self.add_fault(self.at, "", "'#' begins no comment", "expected // before it, or /* */ around it");
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else {
                return;
            }
        }
    }

    /// Skips a comment in `/* */`, which may contain others.
    fn skip_comment(&mut self) {
        let start = self.at;
        let mut depth = 0;
        loop {
            let rest = self.remaining_text();
            if rest.starts_with("/*") {
                (depth, self.at) = (depth + 1, self.at + 2);
            } else if rest.starts_with("*/") {
                (depth, self.at) = (depth - 1, self.at + 2);
            } else if let Some(next) = self.current_char() {
                self.at += next.len_utf8();
            } else {
                self.add_fault(start, "", "a comment without end", "expected */ behind it");
                return self.give_up();
            }
            if depth == 0 {
                return;
            }
        }
    }

    /// Length of a word: a name or a number.
    fn word_length(&self) -> usize {
        let rest = self.remaining_text();
        let raw = if rest.starts_with("r#") && !rest.starts_with("r#\"") { 2 } else { 0 };
        let part = |c: char| c.is_alphanumeric() || "_.+-".contains(c);
        raw + rest[raw..].find(|c| !part(c)).unwrap_or(rest.len() - raw)
    }

    /// Reads and skips a field's name before a colon, or before another mark in place of a colon.
    fn read_field_name(&mut self, path: &str) -> Option<Range<usize>> {
        let start = self.at;
        let (behind, mistakes, lost) = (self.last_end, self.mistakes.len(), self.aborted);
        let quoted = self.current_char() == Some('"');
        let name = if quoted {
            self.skip_string(path);
            start + 1..(self.at - 1).max(start + 1)
        } else {
            let length = self.word_length();
            if length == 0 || !self.remaining_text().starts_with(|c: char| c.is_alphabetic() || c == '_') {
                return None;
            }
            self.advance(length);
            start..self.at
        };
        let end = self.at;
        self.skip_blank();
        let word = &self.text[name.clone()];
        match self.current_char() {
            Some(':') if !self.remaining_text().starts_with("::") => {
                if !quoted && word.contains(['-', '.', '+']) && !word.starts_with("r#") {
                    let plain = word.replace(['-', '.', '+'], "_");
                    self.add_fault(start, path, &format!("the name '{word}'"), &format!("did you mean {plain}?"));
                }
                if quoted {
                    let found = format!("the name \"{word}\" in quotes");
                    self.add_fault(start, path, &found, &format!("expected {word}: without quotes"));
                }
                self.advance(1);
                return Some(name);
            }
            Some('=') if !quoted => {
                self.add_fault(self.at, path, &format!("'=' behind {word}"), &format!("expected {word}: value"));
                self.advance(1);
                return Some(name);
            }
            // A name and a value on one line, as `number 50`.
            Some(next) if !quoted && !self.aborted => {
                let same_line = !self.text[end..self.at].contains('\n') && self.at > end;
                let value = next.is_alphanumeric() || "\"[-+.".contains(next);
                if same_line && value {
                    self.add_fault(end, path, &format!("no ':' behind '{word}'"), &format!("expected {word}: value"));
                    return Some(name);
                }
            }
            _ => {}
        }
        (self.at, self.last_end, self.aborted) = (start, behind, lost);
        self.mistakes.truncate(mistakes);
        None
    }

    /// Skips a text in quotes.
    fn skip_string(&mut self, path: &str) {
        let start = self.at;
        self.advance(1);
        loop {
            match self.current_char() {
                Some('"') => return self.advance(1),
                Some('\\') => {
                    let next = self.remaining_text().chars().nth(1).map_or(0, char::len_utf8);
                    self.advance(1 + next);
                }
                // Strings of our files have one line: the closing quote is missing.
                None | Some('\n') => {
                    let found = format!("no '\"' behind {}", display_text(&self.text[start..self.at]));
                    self.add_fault(start, path, &found, "expected '\"' at the end of the text");
                    return self.give_up();
                }
                Some(other) => self.advance(other.len_utf8()),
            }
        }
    }

    /// Skips `r"..."` or `r#"..."#`, if there is one.
    fn skip_raw_string(&mut self) -> bool {
        let rest = self.remaining_text();
        let marks = rest.strip_prefix('r').map_or(0, |rest| rest.bytes().take_while(|&b| b == b'#').count());
        if !rest.starts_with('r') || !rest[1 + marks..].starts_with('"') {
            return false;
        }
        let end = format!("\"{}", "#".repeat(marks));
        let body = &rest[marks + 2..];
        match body.find(&end) {
            Some(length) => self.advance(marks + 2 + length + end.len()),
            None => {
                self.add_fault(self.at, "", "no end of the text in quotes", &format!("expected {end}"));
                self.give_up();
            }
        }
        true
    }

    /// Skips the value at `path`.
    fn skip_value(&mut self, path: &str, name: Option<Range<usize>>) {
        self.skip_blank();
        let start = self.at;
        match self.current_char() {
            Some('"') => self.skip_string(path),
            Some('r') if self.skip_raw_string() => {}
            Some('\'') => self.skip_character(path),
            Some(bracket @ ('(' | '[' | '{')) => self.skip_items(path, bracket),
            _ => {
                let length = self.word_length();
                if length == 0 {
                    return self.report_missing_value(path);
                }
                self.advance(length);
                let head = self.at;
                self.skip_blank();
                match self.current_char() {
                    Some('(') => self.skip_items(path, '('),
                    _ => self.last_end = head,
                }
            }
        }
        self.nodes.push(ValueNode { path: path.into(), name, span: start..self.last_end });
    }

    /// Reports that a value is missing, with the text at its position.
    fn report_missing_value(&mut self, path: &str) {
        match self.current_char() {
            None if self.open.is_empty() => self.add_fault(self.last_end, path, "the text ends", "expected a value"),
            None => {}
            Some(mark @ (',' | ')' | ']' | '}' | ';' | ':' | '=')) => {
                self.add_fault(self.at, path, &format!("'{mark}'"), "expected a value before it");
                if mark == ':' || mark == '=' {
                    self.advance(1);
                }
            }
            Some(mark) => {
                let found = if mark.is_ascii_graphic() {
                    format!("'{mark}'")
                } else {
                    format!(
                        "the character U+{:04X}{}",
                        u32::from(mark),
                        if mark.is_control() { String::new() } else { format!(" '{mark}'") }
                    )
                };
                let quotes = "\u{201c}\u{201d}\u{201e}\u{ab}\u{bb}`".contains(mark);
                self.add_fault(
                    self.at,
                    path,
                    &found,
                    if quotes { "expected plain quotes \"" } else { "expected a value" },
                );
                self.give_up();
            }
        }
    }

    /// Skips `'x'`; a longer text in such quotes is a mistake.
    fn skip_character(&mut self, path: &str) {
        let start = self.at;
        let line = self.remaining_text()[1..].split('\n').next().unwrap_or("");
        match line.find('\'') {
            Some(end) => {
                let inside = &line[..end];
                if inside.chars().count() != 1 && !inside.starts_with('\\') {
                    self.add_fault(start, path, &format!("'{inside}'"), &format!("expected \"{inside}\""));
                }
                self.advance(end + 2);
            }
            None => {
                self.add_fault(start, path, "'", "expected a value; texts are in \" \"");
                self.give_up();
            }
        }
    }

    /// Skips a bracket, its contents and its closing bracket.
    fn skip_items(&mut self, path: &str, bracket: char) {
        let start = self.at;
        let (line, column) = line_and_column(self.text, start);
        let right = closing_bracket(bracket);
        if bracket == '{' {
            self.add_fault(start, path, "'{'", "expected '(' around fields, '[' around lists");
        }
        self.open.push((bracket, start));
        self.advance(1);
        if self.open.len() > MAX_DEPTH {
            // The library reports this.
            self.mistakes.clear();
            self.give_up();
        }
        // Number of items so far, and number of those with a name.
        let (mut count, mut names) = (0, 0);
        loop {
            self.skip_blank();
            match self.current_char() {
                None => {
                    self.add_fault(
                        start,
                        path,
                        &format!("'{bracket}' without '{right}'"),
                        &format!("expected '{right}' before the end of the text"),
                    );
                    self.aborted = true;
                    return;
                }
                Some(close @ (')' | ']' | '}')) if close == right || bracket == '{' => {
                    self.brackets.push((bracket, start, self.at));
                    self.open.pop();
                    return self.advance(1);
                }
                Some(close @ (')' | ']' | '}')) => {
                    let found = format!("'{close}', while '{bracket}' of {line}:{column} is open");
                    self.add_fault(self.at, path, &found, &format!("expected '{right}' before it"));
                    return self.give_up();
                }
                Some(',') => {
                    self.add_fault(self.at, path, "','", "expected a value before it");
                    self.advance(1);
                    continue;
                }
                Some(_) => {}
            }
            let item = self.at;
            let name = self.read_field_name(path);
            let word = name.as_ref().map_or("", |name| &self.text[name.clone()]);
            if name.is_some() && bracket == '[' {
                let found = format!("'{word}:' in a list, while '[' of {line}:{column} is open");
                self.add_fault(
                    item,
                    path,
                    &found,
                    if count == 0 { "expected '(' before it" } else { "expected ']' before it" },
                );
                return self.give_up();
            }
            if name.is_some() && count > names && names == 0 {
                let found = format!("'{word}:', while '(' of {line}:{column} is open");
                self.add_fault(item, path, &found, "expected ')' before it");
                return self.give_up();
            }
            let key = if name.is_some() { word.to_string() } else { (count - names).to_string() };
            let path_of_item = if path.is_empty() { key } else { format!("{path}.{key}") };
            (count, names) = (count + 1, names + usize::from(name.is_some()));
            let unnamed = name.is_none() && names > 0 && bracket == '(';
            let named = name.is_some();
            let known = self.mistakes.len();
            self.skip_blank();
            let begin = self.at;
            self.skip_value(&path_of_item, name);
            let value = &self.text[begin..self.last_end.max(begin)];
            if unnamed && self.mistakes.len() == known && !self.aborted {
                self.report_missing_name(item, path, value);
            }
            self.skip_blank();
            match self.current_char() {
                Some(',') => self.advance(1),
                Some(';') => {
                    self.add_fault(self.at, &path_of_item, "';'", "expected ','");
                    self.advance(1);
                }
                Some(')' | ']' | '}') | None => {}
                Some(':' | '=') if named => {
                    self.add_fault(
                        begin,
                        &path_of_item,
                        &format!("a second name, '{value}'"),
                        "expected '(' before it",
                    );
                    return self.give_up();
                }
                Some(mark) => self.report_missing_comma(&path_of_item, value, mark),
            }
        }
    }

    /// Reports a value without a name among values with names, once for each bracket.
    fn report_missing_name(&mut self, item: usize, path: &str, value: &str) {
        let before = &self.text[..item];
        let digit = |c: char| c.is_ascii_digit();
        if before.ends_with(',') && before[..item - 1].ends_with(digit) && value.starts_with(digit) {
            let number = before.rfind(|c: char| !(digit(c) || c == ',' || c == '-')).map_or(0, |at| at + 1);
            let found = self.text[number..item + value.len()].to_string();
            self.add_fault(number, path, &found, &format!("expected a decimal point, {}", found.replace(',', ".")));
        } else if !self.mistakes.iter().any(|mistake| mistake.path == path && mistake.found.ends_with("without a name"))
        {
            self.add_fault(item, path, &format!("{} without a name", display_text(value)), "expected name: value");
        }
    }

    /// Reports the text that follows a value instead of a comma.
    fn report_missing_comma(&mut self, path: &str, value: &str, mark: char) {
        let next = display_text(&self.remaining_text()[..self.word_length().max(mark.len_utf8())]);
        let same_line = !self.text[self.last_end..self.at].contains('\n');
        let number = begins_with_number(value);
        // The text up to the end of the item, as in `2700.0 kg/m3` and `2.7*1000`.
        let rest = self.remaining_text();
        let end = rest.find([',', ')', ']', '}', '(', '[', '"', ':', '\n', '\r']).unwrap_or(rest.len());
        let end = rest[..end].find("//").unwrap_or(end);
        let ends_item = !rest[end..].starts_with([':', '(', '[', '"']);
        if number && same_line && ends_item && (mark.is_alphabetic() || "*/^%\u{b0}\u{b7}".contains(mark)) {
            let at = self.last_end - value.len();
            let begin = self.at;
            self.advance(rest[..end].trim_end().len());
            let found = display_text(&self.text[at..self.at]);
            let term = |part: &str| part.trim().parse::<f64>().is_ok();
            let computed = self.text[begin..self.at].split(['*', '/', '^', '%']).skip(1).any(term);
            let expected = if computed && !mark.is_alphabetic() {
                "expected one number: files hold no arithmetic"
            } else {
                "expected a number without unit"
            };
            self.add_fault(at, path, &found, expected);
            self.skip_blank();
            if self.current_char() == Some(',') {
                self.advance(1);
            }
        } else if mark.is_alphanumeric() || "\"'([{-+._".contains(mark) {
            self.add_fault(self.last_end, path, &format!("no ',' before '{next}'"), "expected ',' here");
            if number && same_line && rest[next.len()..].trim_start().starts_with(':') {
                self.give_up();
            }
        } else {
            self.add_fault(self.at, path, &format!("'{next}'"), "expected ','");
            self.give_up();
        }
    }
}

/// Whether a word begins like a number.
fn begins_with_number(word: &str) -> bool {
    word.trim_start_matches(['+', '-', '.']).starts_with(|c: char| c.is_ascii_digit())
}

fn closing_bracket(bracket: char) -> char {
    match bracket {
        '(' => ')',
        '[' => ']',
        _ => '}',
    }
}
