//! Parsing of a RON text that continues behind values that do not fit their types, so that all of them are reported together.

use std::ops::Range;

use ron::error::{Error, SpannedError};
use serde::de::DeserializeOwned;

use super::parse::{ErrorSite, UNKNOWN_NAME, describe_error, missing_fields_fault, ron_options};
use super::syntax::{RonParser, TextFault, ValueNode, syntax_faults};
use crate::names::nearest_name;

/// Number of faults after which reading stops: more are not read.
const MAX_FAULTS: usize = 20;

/// Length of a text, bytes, beyond which the first fault alone is found: each further one needs up to a dozen readings.
const MAX_TEXT_LENGTH: usize = 1 << 16;

/// Values one of which fits most types, in place of one that does not fit.
const STAND_INS: [&str; 10] =
    ["0", "None", "\"\"", "true", "[]", "(0, 0, 0)", "(0, 0)", "(\"\", \"\")", "(None, None, None)", "()"];

/// Number of kinds of an enum that are tried.
const MAX_KINDS: usize = 4;

/// Blanks behind a stand-in: an error at the next token is then not one at its end.
const PADDING: &str = " ";

/// Parses a value. Errors: all mistakes of the text, with their positions.
pub fn parse_ron<T: DeserializeOwned>(text: &str) -> Result<T, Vec<TextFault>> {
    // Only the library decides which texts are accepted.
    ron_options().from_str(text).map_err(|error| {
        let mistakes = syntax_faults(text);
        if mistakes.is_empty() { type_faults::<T>(text, error) } else { mistakes }
    })
}

/// Returns the fault of `error`, the library's error for the syntactically right `text`, and the faults behind it.
///
/// The library stops at the first value that does not fit. Here, that value is replaced by one that fits, as far as one is
/// found, and the text is read again. A field that is missing only because its name is misspelt is not reported.
pub fn type_faults<T: DeserializeOwned>(text: &str, error: SpannedError) -> Vec<TextFault> {
    let mut draft = DraftText { text: text.to_string(), origins: (0..=text.len()).collect() };
    let mut found = FoundFaults::default();
    let mut next = Some(error);
    // Byte of the last fault, which the library reports in the order of the text.
    let mut last_at = None;
    while let Some(error) = next.take() {
        let nodes = RonParser::parse(&draft.text).0;
        let site = ErrorSite::new(&draft.text, &nodes, &error);
        if let (Error::MissingStructField { field, .. }, Some(record)) = (&error.code, site.value) {
            found.add_missing_field(MissingFields {
                offset: draft.origins[record.span.start],
                path: record.path.clone(),
                fields: vec![field.to_string()],
                kind: site.kind_of_record(&draft.text, &error),
            });
            if found.missing_field_count() >= MAX_FAULTS || text.len() > MAX_TEXT_LENGTH {
                break;
            }
            next = draft.with_field::<T>(record, field);
            continue;
        }
        let mut fault = describe_error::<T>(&draft.text, &nodes, &error);
        let draft_at = fault.offset;
        fault.offset = draft.origins[fault.offset.min(draft.text.len())];
        // An error in front of the last stand-in is due to it.
        if last_at.replace(fault.offset).is_some_and(|last| fault.offset <= last) {
            break;
        }
        found.add_fault(fault, &error.code);
        if found.faults.len() + found.missing.len() >= MAX_FAULTS || text.len() > MAX_TEXT_LENGTH {
            break;
        }
        next = match &error.code {
            Error::NoSuchStructField { .. } | Error::DuplicateStructField { .. } => {
                site.named_value.and_then(|node| draft.without_field::<T>(node))
            }
            Error::ExceededRecursionLimit => None,
            code => draft.with_stand_in::<T>(&nodes, draft_at, code),
        };
    }
    found.into_faults()
}

/// Faults of a text so far.
#[derive(Default)]
struct FoundFaults {
    faults: Vec<TextFault>,
    missing: Vec<MissingFields>,
    misspelt: Vec<MisspeltField>,
}

impl FoundFaults {
    /// Adds the one field of `lacking`, unless a misspelt field stands for it.
    fn add_missing_field(&mut self, lacking: MissingFields) {
        let is_misspelt = |one: &MisspeltField| one.holder == lacking.path && one.stands_for(&lacking.fields[0]);
        if self.misspelt.iter().any(is_misspelt) {
            return;
        }
        match self.missing.iter_mut().find(|record| record.path == lacking.path) {
            Some(record) => record.fields.extend(lacking.fields),
            None => self.missing.push(lacking),
        }
    }

    /// Number of fields that records lack.
    fn missing_field_count(&self) -> usize {
        self.missing.iter().map(|record| record.fields.len()).sum()
    }

    /// Adds a fault, whose error of the library is `code`, unless it belongs to one that is known.
    fn add_fault(&mut self, fault: TextFault, code: &Error) {
        if let Error::NoSuchStructField { expected, found, .. } = code {
            let probable_name = nearest_name(found, expected).map(str::to_string);
            let is_same = |one: &&mut MisspeltField| {
                probable_name.is_none() && one.probable_name.is_none() && one.holder == fault.path
            };
            if let Some(known) = self.misspelt.iter_mut().find(is_same) {
                known.names.push(format!("'{found}'"));
                self.faults[known.fault].found = format!("unknown fields {}", known.names.join(", "));
                return;
            }
            let (holder, names) = (fault.path.clone(), vec![format!("'{found}'")]);
            self.misspelt.push(MisspeltField { holder, probable_name, names, fault: self.faults.len() });
        }
        // Numbers in place of all functions of a tuple are one mistake.
        let is_function = |fault: &TextFault| fault.expected.starts_with("expected a function");
        let holder = |fault: &TextFault| fault.path.rsplit_once('.').map(|(holder, _)| holder.to_string());
        let is_repeated = |last: &TextFault| is_function(last) && is_function(&fault) && holder(last) == holder(&fault);
        if !self.faults.last().is_some_and(is_repeated) {
            self.faults.push(fault);
        }
    }

    /// All faults in the order of the text.
    fn into_faults(mut self) -> Vec<TextFault> {
        let missing = self.missing.into_iter();
        let fault = |MissingFields { offset, path, fields, kind }: MissingFields| {
            missing_fields_fault(offset, path, &fields, &kind)
        };
        self.faults.extend(missing.map(fault));
        self.faults.sort_by_key(|fault| fault.offset);
        self.faults
    }
}

/// Fields that a record lacks.
struct MissingFields {
    /// Byte of the record in the text.
    offset: usize,
    path: String,
    fields: Vec<String>,
    /// Name of the record in its text, with a preposition; may be empty.
    kind: String,
}

/// Field with an unknown name, or several fields of a record whose names resemble no known one.
struct MisspeltField {
    /// Path of the record.
    holder: String,
    /// Name that was probably meant; if there is none, it may be any.
    probable_name: Option<String>,
    /// Names in quotes.
    names: Vec<String>,
    /// Position of the fault in the list.
    fault: usize,
}

impl MisspeltField {
    fn stands_for(&self, field: &str) -> bool {
        self.probable_name.as_deref().is_none_or(|probable_name| probable_name == field)
    }
}

/// Text with replaced values, and the byte of the original text for each of its bytes.
struct DraftText {
    text: String,
    origins: Vec<usize>,
}

impl DraftText {
    /// Text and origins with other bytes in a range.
    fn replaced_draft(&self, range: Range<usize>, other: &str) -> DraftText {
        let mut text = self.text.clone();
        text.replace_range(range.clone(), other);
        let mut origins = self.origins.clone();
        let origin = origins[range.start];
        origins.splice(range, std::iter::repeat_n(origin, other.len()));
        DraftText { text, origins }
    }

    /// Becomes the first of `drafts`, each with the byte after its replaced part, whose error satisfies `is_behind`; returns
    /// that error. A draft without an error ends the search.
    fn take_first<T: DeserializeOwned>(
        &mut self,
        drafts: impl Iterator<Item = (DraftText, usize)>,
        is_behind: impl Fn(&ErrorSite, &Error, usize) -> bool,
    ) -> Option<SpannedError> {
        for (draft, end) in drafts {
            let Err(error) = ron_options().from_str::<T>(&draft.text) else { return None };
            let nodes = RonParser::parse(&draft.text).0;
            if is_behind(&ErrorSite::new(&draft.text, &nodes, &error), &error.code, end) {
                *self = draft;
                return Some(error);
            }
        }
        None
    }

    /// Blanks out a field with its comma; returns the next error.
    fn without_field<T: DeserializeOwned>(&mut self, node: &ValueNode) -> Option<SpannedError> {
        let start = node.name.as_ref()?.start;
        let rest = &self.text[node.span.end..];
        let comma = rest.len() - rest.trim_start().len();
        let end = node.span.end + if rest[comma..].starts_with(',') { comma + 1 } else { 0 };
        let blank = " ".repeat(end - start);
        let draft = (self.replaced_draft(start..end, &blank), end);
        self.take_first::<T>(std::iter::once(draft), |site, code, end| {
            site.raw >= end || matches!(code, Error::MissingStructField { .. })
        })
    }

    /// Adds the field `name` to a record; returns the next error.
    fn with_field<T: DeserializeOwned>(&mut self, record: &ValueNode, name: &str) -> Option<SpannedError> {
        let start = record.span.start + self.text[record.span.clone()].find('(')? + 1;
        let value_draft = |value: &str| {
            let text = format!("{name}: {value}, ");
            (self.replaced_draft(start..start, &text), record.span.end + text.len())
        };
        let values_of_kinds = self.kind_values::<T>(|value| value_draft(value).0);
        let drafts: Vec<_> = STAND_INS
            .iter()
            .copied()
            .map(value_draft)
            .chain(values_of_kinds.iter().map(|value| value_draft(value)))
            .collect();
        // All fields of the record were read: an error within it is one of the stand-in, or another missing field.
        self.take_first::<T>(drafts.into_iter(), |site, code, end| match code {
            Error::MissingStructField { field, .. } => {
                *field != name
                    && site.value.is_none_or(|value| value.span.start == record.span.start || value.span.end >= end)
            }
            _ => site.raw >= end,
        })
    }

    /// Values of some kinds that a field may have if it is an enum, such as `IQS_CLB(friction: 0)`; `value_draft` puts a value
    /// in its place.
    fn kind_values<T: DeserializeOwned>(&self, value_draft: impl Fn(&str) -> DraftText) -> Vec<String> {
        let probe = |value: &str| ron_options().from_str::<T>(&value_draft(value).text).err().map(|error| error.code);
        let Some(Error::NoSuchEnumVariant { expected, found, .. }) = probe(UNKNOWN_NAME) else { return Vec::new() };
        if found != UNKNOWN_NAME {
            return Vec::new();
        }
        let values = expected.iter().take(MAX_KINDS).map(|kind| match probe(&format!("{kind}({UNKNOWN_NAME}: 0)")) {
            Some(Error::NoSuchStructField { expected, found, .. }) if found == UNKNOWN_NAME => {
                let fields: Vec<String> = expected.iter().map(|field| format!("{field}: 0")).collect();
                format!("{kind}({})", fields.join(", "))
            }
            _ => kind.to_string(),
        });
        values.collect()
    }

    /// Replaces the value that begins at the byte `start`; returns the next error.
    fn with_stand_in<T: DeserializeOwned>(
        &mut self,
        nodes: &[ValueNode],
        start: usize,
        code: &Error,
    ) -> Option<SpannedError> {
        let candidates = nodes.iter().filter(|node| node.span.start == start && !node.path.is_empty());
        let node = candidates.min_by_key(|node| node.span.len())?;
        let value = &self.text[node.span.clone()];
        let value_draft =
            |text: &&str| (self.replaced_draft(node.span.clone(), &format!("{text}{PADDING}")), start + text.len());
        let drafts: Vec<_> = match code {
            Error::NoSuchEnumVariant { expected, found, .. } => {
                // The fields behind a misspelt name are read, too.
                let near = nearest_name(found, expected).filter(|_| value.starts_with(&found[..]));
                let renamed =
                    near.map(|near| (self.replaced_draft(start..start + found.len(), near), start + near.len()));
                renamed.into_iter().chain(expected.iter().map(value_draft)).collect()
            }
            _ => {
                let values_of_kinds = self.kind_values::<T>(|value| self.replaced_draft(node.span.clone(), value));
                let values_of_kinds: Vec<&str> = values_of_kinds.iter().map(String::as_str).collect();
                STAND_INS.iter().chain(&values_of_kinds).map(value_draft).collect()
            }
        };
        self.take_first::<T>(drafts.into_iter(), |site, code, end| match code {
            // A field of the stand-in itself does not count.
            Error::MissingStructField { .. } => {
                site.value.is_some_and(|value| value.span.start < start || value.span.start > end)
            }
            _ => site.raw > end,
        })
    }
}
