//! Parsing by the RON library, with its errors in plain words.

use ron::error::{Error, SpannedError};
use serde::de::DeserializeOwned;

use super::recovery::type_faults;
use super::syntax::{MAX_DEPTH, RonParser, TextFault, ValueNode, begins_with_number, display_text, syntax_faults};
use crate::names::known_names;

/// RON options of our files: `field: x` is read as `field: Some(x)`.
pub(crate) fn ron_options() -> ron::Options {
    ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
}

/// Parses a value. Errors: all mistakes of the text, with their positions.
pub fn parse_ron<T: DeserializeOwned>(text: &str) -> Result<T, Vec<TextFault>> {
    // Only the library decides which texts are accepted.
    ron_options().from_str(text).map_err(|error| {
        let mistakes = syntax_faults(text);
        if mistakes.is_empty() { type_faults::<T>(text, error) } else { mistakes }
    })
}

/// Byte of a position of the library, and the next byte that is neither blank nor comment.
fn byte_offsets(text: &str, line: usize, column: usize) -> (usize, usize) {
    let before: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
    let within: usize = text[before..].chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
    let raw = before + within;
    let mut parser = RonParser::new(text);
    parser.at = raw;
    parser.skip_blank();
    (raw, if parser.at < text.len() { parser.at } else { raw })
}

/// Position of an error of the library, and the values there.
pub struct ErrorSite<'a> {
    /// Byte at which the library stopped.
    pub raw: usize,
    /// Next byte that is neither blank nor comment.
    at: usize,
    /// Innermost value there.
    pub value: Option<&'a ValueNode>,
    /// Value whose name is there.
    pub named: Option<&'a ValueNode>,
}

impl<'a> ErrorSite<'a> {
    /// Site of an error in a text with these values.
    pub fn new(text: &str, nodes: &'a [ValueNode], error: &SpannedError) -> Self {
        let (raw, at) = byte_offsets(text, error.span.start.line, error.span.start.col);
        let value = innermost(nodes, |node| node.span.start <= at && at < node.span.end.max(node.span.start + 1));
        let named = innermost(nodes, |node| node.name.as_ref().is_some_and(|name| name.start <= at && at < name.end));
        ErrorSite { raw, at, value, named }
    }

    /// Name of the record that lacks a field, as in ` of IQS_CLB`, if it is written there.
    pub fn kind_of_record(&self, text: &str, error: &SpannedError) -> String {
        let Error::MissingStructField { outer: Some(kind), .. } = &error.code else { return String::new() };
        let is_written = self.value.is_some_and(|node| text[node.span.clone()].starts_with(&kind[..]));
        if is_written { format!(" of {kind}") } else { String::new() }
    }
}

/// Shortest of the values for which `holds`.
fn innermost(nodes: &[ValueNode], holds: impl Fn(&ValueNode) -> bool) -> Option<&ValueNode> {
    nodes.iter().filter(|node| holds(node)).min_by_key(|node| node.span.len())
}

/// Fault of a record without some fields.
pub fn missing_fields_fault(at: usize, path: String, fields: &[String], kind: &str) -> TextFault {
    let (noun, quoted) = match fields {
        [one] => ("field", format!("'{one}'")),
        all => ("fields", all.iter().map(|field| format!("'{field}'")).collect::<Vec<_>>().join(", ")),
    };
    let expected = format!("expected the {noun} {}{kind}", fields.join(", "));
    TextFault { at, path, found: format!("no {noun} {quoted}"), expected }
}

/// Describes the library's error in words.
pub fn describe_error<T: DeserializeOwned>(text: &str, nodes: &[ValueNode], error: &SpannedError) -> TextFault {
    let site = ErrorSite::new(text, nodes, error);
    let ErrorSite { raw, at, value, named } = site;
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
            let found = format!("'{field}' occurs twice");
            return TextFault { at, path: holder(named), found, expected: "expected it once".into() };
        }
        Error::MissingStructField { field, .. } => {
            let (at, path) = value.map_or((at, String::new()), |node| (node.span.start, node.path.clone()));
            return missing_fields_fault(at, path, &[field.to_string()], &site.kind_of_record(text, error));
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
    let bare =
        innermost(nodes, |node| node.span.end == raw && text[node.span.clone()].starts_with(char::is_alphabetic));
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
    // Digits that are no decimal number.
    if begins_with_number(&text[node.span.clone()]) && node.span.start < raw && raw < node.span.end {
        let word = &text[node.span.clone()];
        let digits =
            |prefix: &str, base| word.strip_prefix(prefix).and_then(|rest| u64::from_str_radix(rest, base).ok());
        let decimal = digits("0x", 16).or_else(|| digits("0b", 2)).or_else(|| digits("0o", 8));
        return wrong(&decimal.map_or("a number".into(), |decimal| format!("a decimal number, {decimal}")));
    }
    // Too many values in the enclosing bracket.
    let around = innermost(nodes, |node| node.span.start < raw && raw < node.span.end && Some(node) != value);
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
pub const UNKNOWN_NAME: &str = "Unknown_name";

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
