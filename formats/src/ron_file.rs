//! Reading of RON files under current names and those of [earlier versions](crate::former_names).

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::{Fault, Faults};
use crate::former_names::{FormerName, FormerNameUse};
use crate::ron_text::{FlagError, TextFault, line_and_column, located_faults, parse_ron};
use crate::settings::{former_names_of_setting, setting_fault};
use crate::value_locations::{NameConflict, ValueLocations};

/// Reads RON.
///
/// Fields and values may have [former names](crate::former_names). Errors: all faults of the syntax, or else of
/// values that do not fit their types and of missing fields, with line and column. `object` is the name of the text as a whole in faults.
pub fn from_ron<T: DeserializeOwned>(path: &Path, text: &str, object: &str) -> Result<T, Faults> {
    let parsed = CurrentText::new(text).and_then(|current| current.parse());
    parsed.map_err(|mistakes| located_faults(path, text, object, mistakes))
}

/// Reads the value of the option `name` from a flag. Its fields may have [former names](crate::former_names).
///
/// Errors: one line with columns, without a position in a file.
pub fn option_from_flag<T: DeserializeOwned>(name: &str, text: &str) -> Result<T, FlagError> {
    let (locations, _) = ValueLocations::from_value(text, name);
    let parsed = CurrentText::from_locations(text, &locations).and_then(|current| current.parse());
    parsed.map_err(|mistakes| FlagError::new(text, &mistakes))
}

/// Text with current names in place of former ones.
struct CurrentText {
    pub text: String,
    /// Former names that were replaced, with their bytes in the original text.
    uses: Vec<FormerNameUse>,
}

impl CurrentText {
    /// Replaces the former names of a text.
    ///
    /// Errors: a field under both of its names.
    pub fn new(text: &str) -> Result<CurrentText, Vec<TextFault>> {
        Self::from_locations(text, &ValueLocations::from_text(text))
    }

    fn from_locations(text: &str, locations: &ValueLocations) -> Result<CurrentText, Vec<TextFault>> {
        let conflicts = locations.conflicts();
        if !conflicts.is_empty() {
            let fault = |NameConflict { offset, holder, name }: &NameConflict| TextFault {
                offset: *offset,
                path: holder.clone(),
                found: format!("'{}' and its former name '{}' are both there", name.current, name.former),
                expected: format!("expected {} only", name.current),
            };
            return Err(conflicts.iter().map(fault).collect());
        }
        let uses = locations.former_names().to_vec();
        let (mut current, mut copied) = (String::with_capacity(text.len()), 0);
        for former in &uses {
            current += &text[copied..former.span.start];
            current += former.name.current;
            copied = former.span.end;
        }
        current += &text[copied..];
        Ok(CurrentText { text: current, uses })
    }

    /// Parses the text. Errors: all mistakes, at their bytes in the original text.
    fn parse<T: DeserializeOwned>(&self) -> Result<T, Vec<TextFault>> {
        parse_ron(&self.text).map_err(|mut mistakes| {
            mistakes.iter_mut().for_each(|mistake| mistake.offset = self.original_offset(mistake.offset));
            mistakes
        })
    }

    /// Position in bytes in the original text of the position `offset` in this text.
    pub fn original_offset(&self, offset: usize) -> usize {
        // Bytes of this text, and bytes of the original that they replace, up to the current use.
        let (mut inserted, mut removed) = (0, 0);
        for former in &self.uses {
            // Begin and end of the current name in this text.
            let begin = former.span.start + inserted - removed;
            let end = begin + former.name.current.len();
            if offset < end {
                return if offset < begin { offset + removed - inserted } else { former.span.start };
            }
            (inserted, removed) = (inserted + former.name.current.len(), removed + former.span.len());
        }
        offset + removed - inserted
    }
}

/// Text of the file `path` with current names in place of former ones. Errors: a field under both of its names.
pub fn with_current_names(path: &Path, text: &str) -> Result<String, Faults> {
    let faults = |mistakes| located_faults(path, text, "text", mistakes);
    CurrentText::new(text).map(|current| current.text).map_err(faults)
}

/// Value of the option `name`, in RON, with current names in place of former ones; as it is if it has a field under both of
/// its names.
///
/// ```
/// # use cd_formats::ron_file::value_with_current_names;
/// assert_eq!(value_with_current_names("adaptive", "(most:16)"), "(max_multiple:16)");
/// ```
pub fn value_with_current_names(name: &str, value: &str) -> String {
    let (locations, _) = ValueLocations::from_value(value, name);
    CurrentText::from_locations(value, &locations).map_or_else(|_| value.to_string(), |current| current.text)
}

/// Warnings about the former names in the text of a file and in `settings`: one for each name, at its first position.
///
/// ```
/// # use cd_formats::ron_file::former_name_warnings;
/// let text = "(grains: [(place: List(positions: [])), (place: List(positions: []))])";
/// let found = former_name_warnings("scene.ron".as_ref(), text, &["walls.1.rotation=Constant(1)".to_string()]).to_string();
/// assert_eq!(found.lines().next(), Some("scene.ron:1:12: place: renamed, 2 times in this file; write placement"));
/// assert!(found.ends_with("rotation: renamed; write spin"), "{found}");
/// ```
pub fn former_name_warnings(file: &Path, text: &str, settings: &[String]) -> Faults {
    let mut faults = warnings_of_uses(file, text, ValueLocations::from_text(text).former_names());
    for setting in settings {
        let uses = former_names_of_setting(setting);
        faults.0.extend(uses.iter().map(|former| setting_warning(setting, former.name)));
    }
    faults
}

/// Warnings about these former names in the text of a file: one for each name, at its first position.
pub fn warnings_of_uses(file: &Path, text: &str, uses: &[FormerNameUse]) -> Faults {
    let mut faults = Faults::default();
    for (k, former) in uses.iter().enumerate() {
        let is_same = |other: &&FormerNameUse| {
            (other.name.former, other.name.current) == (former.name.former, former.name.current)
        };
        if uses[..k].iter().any(|other| is_same(&other)) {
            continue;
        }
        let found = match uses.iter().filter(is_same).count() {
            1 => "renamed".to_string(),
            count => format!("renamed, {count} times in this file"),
        };
        let (line, column) = line_and_column(text, former.span.start);
        let expected = format!("write {}", former.name.current);
        let fault = Fault::new(file, Some(line), former.name.former, found, expected);
        faults.push(Fault { column: Some(column), ..fault });
    }
    faults
}

/// Warning about a former name in a setting.
pub fn setting_warning(setting: &str, name: &FormerName) -> Fault {
    setting_fault(setting, format!("{}: renamed", name.former), format!("write {}", name.current))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_the_current_text_lead_to_those_of_the_original() {
        let text = "(bodies: [(stop: Drift, keep: Largest, turn: (axis: (0, 0, 1), angle: x))], seed: 1)";
        let current = CurrentText::new(text).unwrap_or_else(|_| panic!("no conflict"));
        assert_eq!(
            current.text,
            "(bodies: [(remove_motion: Translation, select: Largest, rotate: (axis: (0, 0, 1), angle: x))], seed: 1)"
        );
        for word in ["bodies", "Largest", "axis", "x)", "seed", "1)"] {
            let at = current.text.find(word).unwrap();
            assert_eq!(current.original_offset(at), text.find(word).unwrap(), "{word}");
        }
        assert_eq!(current.original_offset(current.text.find("Translation").unwrap()), text.find("Drift").unwrap());
        assert_eq!(current.original_offset(current.text.len()), text.len());
    }
}
