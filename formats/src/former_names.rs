//! Names of earlier versions in `scene.ron`, `changes.ron` and `--set`, which are read as their current names.
//!
//! The two tables below are the only list of these names. [`ValueLocations`] finds values under their current names,
//! [`crate::ron_text::from_ron`] parses a text with the current names, and [`warnings`] reports the former ones.

use std::ops::Range;
use std::path::Path;

use crate::error::{Fault, Faults};
use crate::places::{self, ValueLocations};
use crate::ron_text::{self, TextFault};

/// Field or value that has another name than in earlier versions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FormerName {
    /// Path of the value that has the field, or of the field that has the value; `N` is any position in a list.
    pub holder: &'static str,
    pub former: &'static str,
    pub current: &'static str,
}

const fn renamed(holder: &'static str, former: &'static str, current: &'static str) -> FormerName {
    FormerName { holder, former, current }
}

/// Former names of fields. Holders have current names.
pub const FORMER_FIELDS: [FormerName; 11] = [
    renamed("grains.N", "place", "placement"),
    renamed("grains.N", "standing", "grain_orientation"),
    renamed("grains.N.shape", "scaled", "scale"),
    renamed("grains.N.shape", "contact", "contact_shape"),
    renamed("grains.N.shape.contact_shape", "most", "max_pieces"),
    renamed("grains.N.shape.contact_shape", "vertices", "max_vertices"),
    renamed("grains.N.placement.envelope", "scaled", "scale"),
    renamed("walls.N", "rotation", "angular_velocity"),
    renamed("bodies.N", "keep", "select"),
    renamed("bodies.N", "stop", "remove_motion"),
    renamed("bodies.N", "turn", "rotate"),
];

/// Former names of values. Holders have current names.
pub const FORMER_VALUES: [FormerName; 3] = [
    renamed("grains.N.shape.contact_shape", "Whole", "Surface"),
    renamed("bodies.N.remove_motion", "Drift", "Translation"),
    renamed("bodies.N.remove_motion", "Motion", "All"),
];

/// Whether a path, with 0-based positions in lists, is one of the holder's.
fn matches_holder(holder: &str, path: &str) -> bool {
    let is_position = |key: &str| !key.is_empty() && key.bytes().all(|byte| byte.is_ascii_digit());
    let (keys, patterns) = (path.split('.'), holder.split('.'));
    path.matches('.').count() == holder.matches('.').count()
        && keys.zip(patterns).all(|(key, pattern)| key == pattern || pattern == "N" && is_position(key))
}

fn current_name(table: &'static [FormerName], holder: &str, name: &str) -> Option<&'static FormerName> {
    table.iter().find(|row| row.former == name && matches_holder(row.holder, holder))
}

/// Row of a former name of a field; `holder` is the path of the value that has the field.
pub fn former_field(holder: &str, name: &str) -> Option<&'static FormerName> {
    current_name(&FORMER_FIELDS, holder, name)
}

/// Row of a former name of a value; `path` is that of the value.
pub fn former_value(path: &str, name: &str) -> Option<&'static FormerName> {
    current_name(&FORMER_VALUES, path, name)
}

/// Former name in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormerNameUse {
    pub name: &'static FormerName,
    /// Bytes of the name.
    pub span: Range<usize>,
}

/// Text with current names in place of former ones.
pub(crate) struct CurrentText {
    pub text: String,
    uses: Vec<FormerNameUse>,
}

impl CurrentText {
    /// Replaces the former names of a text.
    ///
    /// Errors: a field under both of its names.
    pub fn new(text: &str) -> Result<CurrentText, Vec<TextFault>> {
        let places = ValueLocations::from_text(text);
        let conflicts = places.conflicts();
        if !conflicts.is_empty() {
            let fault = |(at, path, name): &(usize, String, &FormerName)| TextFault {
                at: *at,
                path: path.clone(),
                found: format!("'{}' and its former name '{}' are both there", name.current, name.former),
                expected: format!("expected {} only", name.current),
            };
            return Err(conflicts.iter().map(fault).collect());
        }
        let uses = places.former_names().to_vec();
        let mut current = text.to_string();
        uses.iter().rev().for_each(|one| current.replace_range(one.span.clone(), one.name.current));
        Ok(CurrentText { text: current, uses })
    }

    /// Returns the byte of the original text for a byte of this one.
    pub fn original_byte(&self, at: usize) -> usize {
        let (mut start, mut removed) = (0, 0);
        for one in &self.uses {
            // Begin and end of the current name in this text.
            let begin = one.span.start + start - removed;
            let end = begin + one.name.current.len();
            if at < end {
                return if at < begin { at + removed - start } else { one.span.start };
            }
            (start, removed) = (start + one.name.current.len(), removed + one.span.len());
        }
        at + removed - start
    }
}

/// Text of the file `path` with current names in place of former ones. Errors: a field under both of its names.
pub fn with_current_names(path: &Path, text: &str) -> Result<String, Faults> {
    let faults = |mistakes| ron_text::located_faults(path, text, "text", mistakes);
    CurrentText::new(text).map(|current| current.text).map_err(faults)
}

/// Warnings about the former names in the text of a file and in `settings`: one for each name, at its first position.
///
/// ```
/// # use cd_formats::former_names::warnings;
/// let text = "(grains: [(place: List(positions: [])), (place: List(positions: []))])";
/// let found = warnings("scene.ron".as_ref(), text, &["walls.1.rotation=Constant(1)".to_string()]).to_string();
/// assert_eq!(found.lines().next(), Some("scene.ron:1:12: place: renamed, 2 times in this file; write placement"));
/// assert!(found.ends_with("rotation: renamed; write angular_velocity"), "{found}");
/// ```
pub fn warnings(file: &Path, text: &str, settings: &[String]) -> Faults {
    let mut faults = Faults::default();
    let uses = ValueLocations::from_text(text).former_names().to_vec();
    for (k, one) in uses.iter().enumerate() {
        let is_same =
            |other: &&FormerNameUse| (other.name.former, other.name.current) == (one.name.former, one.name.current);
        if uses[..k].iter().any(|other| is_same(&other)) {
            continue;
        }
        let found = match uses.iter().filter(is_same).count() {
            1 => "renamed".to_string(),
            count => format!("renamed, {count} times in this file"),
        };
        let (line, column) = ron_text::line_and_column(text, one.span.start);
        let expected = format!("write {}", one.name.current);
        let fault = Fault::new(file, Some(line), one.name.former, found, expected);
        faults.push(Fault { column: Some(column), ..fault });
    }
    for setting in settings {
        for name in places::former_names_of_setting(setting) {
            let found = format!("{}: renamed", name.former);
            faults.push(places::setting_fault(setting, found, format!("write {}", name.current)));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holders_match_their_paths_only() {
        assert_eq!(former_field("grains.12", "place").map(|name| name.current), Some("placement"));
        for (holder, name) in [("grains", "place"), ("grains.0.shape", "place"), ("bodies.0", "place"), ("", "place")] {
            assert_eq!(former_field(holder, name), None, "{holder}.{name}");
        }
        assert_eq!(former_value("bodies.0.remove_motion", "Motion").map(|name| name.current), Some("All"));
    }

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
            assert_eq!(current.original_byte(at), text.find(word).unwrap(), "{word}");
        }
        assert_eq!(current.original_byte(current.text.find("Translation").unwrap()), text.find("Drift").unwrap());
        assert_eq!(current.original_byte(current.text.len()), text.len());
    }
}
