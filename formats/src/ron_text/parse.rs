//! Parsing by the RON library, with its errors in plain words.

use ron::error::{Error, SpannedError};
use serde::de::DeserializeOwned;

use super::syntax::{MAX_DEPTH, RonParser, TextFault, ValueNode, begins_with_number, display_text};
use crate::names::known_names;

/// RON options of our files: `field: x` is read as `field: Some(x)`.
pub(crate) fn ron_options() -> ron::Options {
    ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
}

/// Byte offset of a line and column that the library gives, and that of the next byte that is neither blank nor comment.
fn byte_offsets(text: &str, line: usize, column: usize) -> (usize, usize) {
    let before: usize = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum();
    let within: usize = text[before..].chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
    let raw = before + within;
    let mut parser = RonParser::new(text);
    parser.offset = raw;
    parser.skip_blank();
    (raw, if parser.offset < text.len() { parser.offset } else { raw })
}

/// Position of an error of the library, and the values there.
pub struct ErrorSite<'a> {
    /// Byte at which the library stopped.
    pub raw: usize,
    /// Next byte that is neither blank nor comment.
    offset: usize,
    /// Innermost value there.
    pub value: Option<&'a ValueNode>,
    /// Value whose name is there.
    pub named_value: Option<&'a ValueNode>,
}

impl<'a> ErrorSite<'a> {
    /// Site of an error in a text with these values.
    pub fn new(text: &str, nodes: &'a [ValueNode], error: &SpannedError) -> Self {
        let (raw, offset) = byte_offsets(text, error.span.start.line, error.span.start.col);
        let value =
            shortest_value(nodes, |node| node.span.start <= offset && offset < node.span.end.max(node.span.start + 1));
        let named_value = shortest_value(nodes, |node| {
            node.name.as_ref().is_some_and(|name| name.start <= offset && offset < name.end)
        });
        ErrorSite { raw, offset, value, named_value }
    }

    /// Name of the record that lacks a field, as in ` of IQS_CLB`, if it is written there.
    pub fn kind_of_record(&self, text: &str, error: &SpannedError) -> String {
        let Error::MissingStructField { outer: Some(kind), .. } = &error.code else { return String::new() };
        let is_written = self.value.is_some_and(|node| text[node.span.clone()].starts_with(&kind[..]));
        if is_written { format!(" of {kind}") } else { String::new() }
    }
}

/// Shortest of the values for which `holds`.
fn shortest_value(nodes: &[ValueNode], holds: impl Fn(&ValueNode) -> bool) -> Option<&ValueNode> {
    nodes.iter().filter(|node| holds(node)).min_by_key(|node| node.span.len())
}

/// Fault of a record without some fields.
pub fn missing_fields_fault(offset: usize, path: String, fields: &[String], kind: &str) -> TextFault {
    let (noun, quoted) = match fields {
        [one] => ("field", format!("'{one}'")),
        all => ("fields", all.iter().map(|field| format!("'{field}'")).collect::<Vec<_>>().join(", ")),
    };
    let expected = format!("expected the {noun} {}{kind}", fields.join(", "));
    TextFault { offset, path, found: format!("no {noun} {quoted}"), expected }
}

/// Describes the library's error in words.
pub fn describe_error<T: DeserializeOwned>(text: &str, nodes: &[ValueNode], error: &SpannedError) -> TextFault {
    let faulty = FaultyText { text, nodes, site: ErrorSite::new(text, nodes, error) };
    faulty
        .named_fault(error)
        .or_else(|| faulty.stray_name())
        .or_else(|| faulty.number_fault(&error.code))
        .or_else(|| faulty.bare_variant::<T>())
        .or_else(|| faulty.fault_by_probe::<T>())
        .or_else(|| faulty.surplus_values::<T>())
        .unwrap_or_else(|| faulty.fault_of_kind(&error.code))
}

/// Text with an error of the library, for the descriptions that [`describe_error`] tries in turn.
struct FaultyText<'a> {
    text: &'a str,
    nodes: &'a [ValueNode],
    site: ErrorSite<'a>,
}

/// Path of the record that holds a value.
fn holder_path(node: Option<&ValueNode>) -> String {
    node.and_then(|node| node.path.rsplit_once('.')).map_or(String::new(), |(holder, _)| holder.to_string())
}

impl FaultyText<'_> {
    /// Text of a value, as written.
    fn source_of(&self, node: &ValueNode) -> &str {
        &self.text[node.span.clone()]
    }

    /// Text of a value for messages.
    fn text_of(&self, node: &ValueNode) -> String {
        display_text(self.source_of(node))
    }

    /// Fault of a value, or of the site if there is none.
    fn fault_at(&self, node: Option<&ValueNode>, found: String, expected: String) -> TextFault {
        let (offset, path) =
            node.map_or((self.site.offset, String::new()), |node| (node.span.start, node.path.clone()));
        TextFault { offset, path, found, expected }
    }

    /// Fault of the value at the site, of which another one is expected.
    fn wrong_value(&self, expected: &str) -> TextFault {
        let value = self.site.value;
        let found = value.map_or("no value".into(), |node| self.text_of(node));
        self.fault_at(value, found, format!("expected {expected}"))
    }

    /// Errors that the library names: unknown, missing and repeated names, and values of one kind.
    fn named_fault(&self, error: &SpannedError) -> Option<TextFault> {
        let ErrorSite { offset, value, named_value: named, .. } = self.site;
        Some(match &error.code {
            Error::NoSuchStructField { expected, found, .. } => TextFault {
                offset,
                path: holder_path(named.or(value)),
                found: format!("unknown field '{found}'"),
                expected: known_names(found, expected),
            },
            Error::DuplicateStructField { field, .. } => TextFault {
                offset,
                path: holder_path(named),
                found: format!("'{field}' occurs twice"),
                expected: "expected it once".into(),
            },
            Error::MissingStructField { field, .. } => {
                let (offset, path) = value.map_or((offset, String::new()), |node| (node.span.start, node.path.clone()));
                missing_fields_fault(offset, path, &[field.to_string()], &self.site.kind_of_record(self.text, error))
            }
            Error::NoSuchEnumVariant { expected, found, .. } => {
                self.fault_at(value, format!("unknown '{found}'"), known_names(found, expected))
            }
            Error::ExpectedBoolean => self.wrong_value("true or false"),
            Error::ExpectedArray | Error::ExpectedArrayEnd => self.wrong_value("a list in [ ]"),
            Error::ExceededRecursionLimit => {
                let expected = format!("expected at most {MAX_DEPTH} levels");
                self.fault_at(value, "brackets nested too deeply".into(), expected)
            }
            Error::ExpectedString | Error::ExpectedStringEnd => {
                let word = value.map(|node| self.text_of(node)).filter(|word| word.starts_with(char::is_alphabetic));
                let expected = word.map_or("a text in quotes".into(), |word| format!("a text in quotes, \"{word}\""));
                self.wrong_value(&expected)
            }
            Error::ExpectedDifferentLength { expected, found } => {
                let count = if *found == 1 { "one value".to_string() } else { format!("{found} values") };
                let found = format!("{count} in {}", value.map_or(String::new(), |node| self.text_of(node)));
                self.fault_at(value, found, format!("expected {}", expectation_in_words(expected)))
            }
            Error::IntegerOutOfBounds => {
                let negative = value.is_some_and(|node| self.text_of(node).starts_with('-'));
                self.wrong_value(if negative { "an integer of 0 or more" } else { "a smaller integer" })
            }
            _ => return None,
        })
    }

    /// A name where values have no names.
    fn stray_name(&self) -> Option<TextFault> {
        let ErrorSite { offset, value, named_value: named, .. } = self.site;
        let node = named.filter(|node| value.is_none_or(|value| value.span.start < node.span.start))?;
        let name = &self.text[node.name.clone().unwrap_or_default()];
        Some(TextFault {
            offset,
            path: holder_path(Some(node)),
            found: format!("'{name}:'"),
            expected: "expected a value without a name".into(),
        })
    }

    /// A number that is missing, that the library has read partly, or that other characters follow.
    fn number_fault(&self, code: &Error) -> Option<TextFault> {
        let ErrorSite { offset, value, .. } = self.site;
        match code {
            Error::ExpectedFloat | Error::FloatUnderscore => return Some(self.wrong_value("a number")),
            Error::ExpectedInteger | Error::InvalidIntegerDigit { .. } | Error::UnderscoreAtBeginning => {
                return Some(self.wrong_value("an integer"));
            }
            _ => {}
        }
        let node = value?;
        let word = self.source_of(node);
        if node.span.start < offset && word.parse::<f64>().is_ok() {
            return Some(self.wrong_value("an integer"));
        }
        if !begins_with_number(word) {
            return None;
        }
        let plain = word.replace(['d', 'D'], "e");
        match plain.parse::<f64>() {
            Ok(_) if plain != word => Some(self.wrong_value(&format!("a number, {plain}"))),
            Err(_) if word.ends_with(char::is_alphabetic) && !word.ends_with(['e', 'E']) => {
                Some(self.wrong_value("a number without unit"))
            }
            _ => None,
        }
    }

    /// A variant whose fields were left out.
    fn bare_variant<T: DeserializeOwned>(&self) -> Option<TextFault> {
        let ends_here =
            |node: &ValueNode| node.span.end == self.site.raw && self.source_of(node).starts_with(char::is_alphabetic);
        let node = shortest_value(self.nodes, ends_here).filter(|node| !self.source_of(node).contains('('))?;
        let kind = self.text_of(node);
        let fields = match probe_error::<T>(self.text, node, &format!("{kind}({UNKNOWN_NAME}: 0)")) {
            Some(Error::NoSuchStructField { expected, .. }) => format!("{kind}(...) with {}", field_list(expected)),
            _ => format!("{kind}(...) with its values"),
        };
        Some(self.fault_at(Some(node), kind, format!("expected {fields}")))
    }

    /// Fault that a second reading reveals: the value is replaced by an unknown name, and the error of the library then lists
    /// the names or fields that it expects there. Also the fault of a number whose digits are not decimal, and of no value.
    fn fault_by_probe<T: DeserializeOwned>(&self) -> Option<TextFault> {
        let ErrorSite { raw, value, .. } = self.site;
        let Some(node) = value else { return Some(self.wrong_value("another value")) };
        let probe = |other: &str| probe_error::<T>(self.text, node, other);
        match probe(UNKNOWN_NAME) {
            Some(Error::NoSuchEnumVariant { expected, .. }) if expected.contains(&"Constant") => {
                let found = self.text_of(node);
                let example = found.parse::<f64>().map_or(String::new(), |_| format!(", such as Constant({found})"));
                return Some(self.wrong_value(&format!("a function, one of {}{example}", expected.join(", "))));
            }
            Some(Error::NoSuchEnumVariant { expected, .. }) => {
                let quoted = self.source_of(node).strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
                let unquoted =
                    quoted.filter(|inside| expected.contains(&inside.split('(').next().unwrap_or_default().trim()));
                let wanted = unquoted.map_or(format!("one of {}", expected.join(", ")), |inside| {
                    match probe(&format!("{inside}({UNKNOWN_NAME}: 0)")) {
                        Some(Error::NoSuchStructField { expected, .. }) => {
                            format!("{inside}(...) without quotes, with {}", field_list(expected))
                        }
                        _ => format!("{inside} without quotes"),
                    }
                });
                return Some(self.wrong_value(&wanted));
            }
            _ => {}
        }
        if let Some(Error::NoSuchStructField { expected, .. }) = probe(&format!("{UNKNOWN_NAME}: 0")) {
            return Some(self.wrong_value(&format!("name: value, with {}", field_list(expected))));
        }
        if let Some(Error::NoSuchStructField { expected, .. }) = probe(&format!("({UNKNOWN_NAME}: 0)")) {
            return Some(self.wrong_value(&format!("( ) around {}", field_list(expected))));
        }
        let word = self.source_of(node);
        (begins_with_number(word) && node.span.start < raw && raw < node.span.end).then(|| {
            let digits =
                |prefix: &str, base| word.strip_prefix(prefix).and_then(|rest| u64::from_str_radix(rest, base).ok());
            let decimal = digits("0x", 16).or_else(|| digits("0b", 2)).or_else(|| digits("0o", 8));
            let expected = decimal.map_or("a number".into(), |decimal| format!("a decimal number, {decimal}"));
            self.wrong_value(&expected)
        })
    }

    /// Bracket around the site, and its fault if it holds too many values.
    fn surrounding_list(&self) -> Option<(&ValueNode, String)> {
        let ErrorSite { raw, value, .. } = self.site;
        let around =
            shortest_value(self.nodes, |node| node.span.start < raw && raw < node.span.end && Some(node) != value);
        around.map(|list| (list, format!("too many values in {}", self.text_of(list))))
    }

    /// A value, or the bracket around it, of which the library expects another number of values.
    fn surplus_values<T: DeserializeOwned>(&self) -> Option<TextFault> {
        let value = self.site.value.map(|node| (node, self.text_of(node)));
        value.into_iter().chain(self.surrounding_list()).find_map(|(node, found)| {
            match probe_error::<T>(self.text, node, "()") {
                Some(Error::ExpectedDifferentLength { expected, .. }) => {
                    Some(self.fault_at(Some(node), found, format!("expected {}", expectation_in_words(&expected))))
                }
                _ => None,
            }
        })
    }

    /// Fault of which only the kind of the expected value is known.
    fn fault_of_kind(&self, code: &Error) -> TextFault {
        match code {
            Error::ExpectedStructLikeEnd | Error::ExpectedOptionEnd => {
                let (around, found) = self.surrounding_list().unzip();
                self.fault_at(around, found.unwrap_or_default(), "expected one value".into())
            }
            Error::InvalidValueForType { expected, .. } => self.wrong_value(&expectation_in_words(expected)),
            Error::ExpectedStructLike
            | Error::ExpectedNamedStructLike(_)
            | Error::ExpectedDifferentStructName { .. } => self.wrong_value("values in ( )"),
            _ => self.wrong_value("another value"),
        }
    }
}

/// Name that no type has.
pub const UNKNOWN_NAME: &str = "Unknown_name";

/// Error of the library after a value is replaced by another text; `None` if there is none, or if it concerns another value.
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
