//! Names of earlier versions in `scene.ron`, `changes.ron`, `--set`, COMPUTE.RON and flags, which are read as their current names.
//!
//! The two tables below are the only list of these names. [`crate::value_locations::ValueLocations`] finds values under their current
//! names, [`crate::ron_file`] parses a text with the current names and reports the former ones.

use std::ops::Range;

/// Field or value that has another name than in earlier versions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FormerName {
    /// Path of the value that has the field, or of the field that has the value; `N` is any position in a list.
    pub holder: &'static str,
    pub former: &'static str,
    pub current: &'static str,
}

const fn name_change(holder: &'static str, former: &'static str, current: &'static str) -> FormerName {
    FormerName { holder, former, current }
}

/// Former names of fields. Holders have current names.
pub const FORMER_FIELDS: [FormerName; 14] = [
    name_change("grains.N", "place", "placement"),
    name_change("grains.N", "standing", "grain_orientation"),
    name_change("grains.N.shape", "scaled", "scale"),
    name_change("grains.N.shape", "contact", "contact_shape"),
    name_change("grains.N.shape.contact_shape", "most", "max_pieces"),
    name_change("grains.N.shape.contact_shape", "vertices", "max_vertices"),
    name_change("grains.N.placement.envelope", "scaled", "scale"),
    name_change("walls.N", "rotation", "spin"),
    name_change("walls.N", "angular_velocity", "spin"),
    name_change("bodies.N", "keep", "select"),
    name_change("bodies.N", "stop", "remove_motion"),
    name_change("bodies.N", "turn", "rotate"),
    name_change("compute.adaptive", "most", "max_multiple"),
    // In COMPUTE.RON and on the command line of cd-solve.
    name_change("adaptive", "most", "max_multiple"),
];

/// Former names of values. Holders have current names.
pub const FORMER_VALUES: [FormerName; 3] = [
    name_change("grains.N.shape.contact_shape", "Whole", "Surface"),
    name_change("bodies.N.remove_motion", "Drift", "Translation"),
    name_change("bodies.N.remove_motion", "Motion", "All"),
];

/// Whether a path, with 0-based positions in lists, is one of the holder's.
fn matches_holder(holder: &str, path: &str) -> bool {
    let is_position = |key: &str| !key.is_empty() && key.bytes().all(|byte| byte.is_ascii_digit());
    let (keys, patterns) = (path.split('.'), holder.split('.'));
    path.matches('.').count() == holder.matches('.').count()
        && keys.zip(patterns).all(|(key, pattern)| key == pattern || pattern == "N" && is_position(key))
}

/// Row of a table with this former name.
fn find_row(table: &'static [FormerName], holder: &str, name: &str) -> Option<&'static FormerName> {
    table.iter().find(|row| row.former == name && matches_holder(row.holder, holder))
}

/// Row of a former name of a field; `holder` is the path of the value that has the field.
pub fn former_field(holder: &str, name: &str) -> Option<&'static FormerName> {
    find_row(&FORMER_FIELDS, holder, name)
}

/// Row of a former name of a value; `path` is the path of the value.
pub fn former_value(path: &str, name: &str) -> Option<&'static FormerName> {
    find_row(&FORMER_VALUES, path, name)
}

/// Former name in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormerNameUse {
    pub name: &'static FormerName,
    /// Bytes of the name.
    pub span: Range<usize>,
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
}
