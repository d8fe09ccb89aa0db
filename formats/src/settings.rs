//! Settings of a command line, `PATH=VALUE`, which replace values of a RON text. A path consists of field names and
//! positions in lists, counted from 1.

use std::path::Path;

use crate::error::{Fault, Faults, RecordFault};
use crate::former_names::{FormerNameUse, former_field};
use crate::ron_text;
use crate::value_locations::{MAX_DEPTH, ValueLocation, ValueLocations};

/// Returns a RON text with other values: each of `settings` is `PATH=VALUE`, as in `grains.1.number=2000`. A field that was
/// left out is inserted. Lines keep their numbers.
///
/// Errors: settings that are not such pairs, and paths that do not exist.
pub fn apply_settings(text: &str, settings: &[String]) -> Result<String, Faults> {
    let mut text = text.to_string();
    let mut faults = Faults::default();
    for setting in settings {
        match apply_setting(&text, setting) {
            Ok(changed) => text = changed,
            Err(fault) => faults.push(setting_fault(setting, fault.found, fault.expected)),
        }
    }
    faults.into_result(text)
}

/// Rejects settings of a command line of which one would replace the whole value of an earlier one.
pub fn check_paths_once(settings: &[String]) -> Result<(), Faults> {
    let setting_keys = |setting: &String| path_keys(setting.split_once('=')?.0.trim());
    let mut faults = Faults::default();
    for (k, setting) in settings.iter().enumerate() {
        let keys = setting_keys(setting);
        if let Some(other) = settings[..k].iter().find(|before| keys.is_some() && setting_keys(before) == keys) {
            faults.push(setting_fault(setting, format!("sets the value of --set {other} again"), "expected it once"));
        }
    }
    faults.into_result(())
}

/// Fault of a setting.
pub fn setting_fault(setting: &str, found: impl Into<String>, expected: impl Into<String>) -> Fault {
    Fault::new(Path::new("options"), None, format!("--set {setting}"), found, expected)
}

/// Last of `settings` that sets the value at `path`, if any.
pub fn setting_of_path<'a>(settings: &'a [String], path: &str) -> Option<&'a str> {
    let sets_path = |setting: &&String| {
        let keys = setting.split_once('=').and_then(|(set_path, _)| path_keys(set_path.trim()));
        let rest = keys.and_then(|keys| path.strip_prefix(&keys.join(".")));
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    settings.iter().rfind(sets_path).map(String::as_str)
}

/// Last of `settings` that sets the value at a line and column of `text`, 1-based, if any.
pub fn setting_at<'a>(settings: &'a [String], text: &str, line: usize, column: usize) -> Option<&'a str> {
    if settings.is_empty() {
        return None;
    }
    let line_start: usize = text.split_inclusive('\n').take(line - 1).map(str::len).sum();
    let bytes_in_line: usize = text[line_start..].chars().take(column - 1).map(char::len_utf8).sum();
    // RON reports some missing values where the blank before them begins.
    let byte = text.len() - text[line_start + bytes_in_line..].trim_start().len();
    setting_of_path(settings, ValueLocations::from_text(text).path_at(byte)?.as_str())
}

/// Current names and 0-based positions of a path in which positions in lists count from 1; none if a position is 0.
fn path_keys(path: &str) -> Option<Vec<String>> {
    Some(path_with_current_names(path)?.0)
}

/// [`path_keys`], and the former names in the path, with their bytes there.
fn path_with_current_names(path: &str) -> Option<(Vec<String>, Vec<FormerNameUse>)> {
    let (mut keys, mut former): (Vec<String>, _) = (Vec::new(), Vec::new());
    let (mut start, mut holder) = (0, String::new());
    for key in path.split('.') {
        let current = match (key.parse::<usize>(), former_field(&holder, key)) {
            (Ok(index), _) => index.checked_sub(1)?.to_string(),
            (Err(_), Some(name)) => {
                former.push(FormerNameUse { name, span: start..start + key.len() });
                name.current.to_string()
            }
            (Err(_), None) => key.to_string(),
        };
        holder += if keys.is_empty() { "" } else { "." };
        holder += &current;
        keys.push(current);
        start += key.len() + 1;
    }
    Some((keys, former))
}

/// Former names in the path and in the value of a setting, with their bytes in the setting.
pub fn former_names_of_setting(setting: &str) -> Vec<FormerNameUse> {
    let Some((path, value)) = setting.split_once('=') else { return Vec::new() };
    let Some((keys, path_uses)) = path_with_current_names(path.trim()) else { return Vec::new() };
    let (locations, _) = ValueLocations::from_value(value, &keys.join("."));
    let shifted_use = |one: &FormerNameUse, bytes: usize| {
        let span = one.span.start + bytes..one.span.end + bytes;
        FormerNameUse { name: one.name, span }
    };
    let path_start = path.len() - path.trim_start().len();
    let value_start = path.len() + 1;
    let path_uses = path_uses.iter().map(|one| shifted_use(one, path_start));
    path_uses.chain(locations.former_names().iter().map(|one| shifted_use(one, value_start))).collect()
}

/// Replaces or inserts the value of a setting.
fn apply_setting(text: &str, setting: &str) -> Result<String, RecordFault> {
    let (path, value) = path_and_value(setting)?;
    let Some(keys) = path_keys(path) else {
        return Err(RecordFault::new("0", "expected positions in lists counted from 1"));
    };
    let locations = ValueLocations::from_text(text);
    if let Some(location) = locations.value(&keys.join(".")) {
        return Ok(format!("{}{value}{}", &text[..location.span.start], &text[location.span.end..]));
    }
    insert_field(text, &locations, path, &keys, &value)
}

/// Path and value of a setting. Errors: it is no such pair, or its value is not one value in RON.
fn path_and_value(setting: &str) -> Result<(&str, String), RecordFault> {
    let pair = setting.split_once('=').map(|(path, value)| (path.trim(), value.trim().replace('\n', " ")));
    let Some((path, value)) = pair.filter(|(path, _)| !path.is_empty()) else {
        return Err(RecordFault::new("is no pair", "expected PATH=VALUE, such as grains.1.number=2000"));
    };
    if let Some(mistake) = ron_text::syntax_faults(&value).into_iter().next().filter(|_| !value.is_empty()) {
        return Err(RecordFault::new(format!("value: {}", mistake.found), mistake.expected));
    }
    let (locations, end) = ValueLocations::from_value(&value, "");
    let ends_early = locations.value("").is_none_or(|location| location.span.end < value.len());
    if end < value.len() || ends_early || value.is_empty() {
        return Err(RecordFault::new(format!("'{value}'"), "expected one value in RON"));
    }
    Ok((path, value))
}

/// Inserts a field that was left out behind the opening bracket of the innermost value of its path that the text has.
/// `path` is as in the setting, `keys` are its [`path_keys`].
fn insert_field(
    text: &str,
    locations: &ValueLocations,
    path: &str,
    keys: &[String],
    value: &str,
) -> Result<String, RecordFault> {
    let has_value = |length: &usize| locations.value(&keys[..*length].join(".")).is_some();
    let known_length = (0..keys.len().min(MAX_DEPTH)).rev().find(has_value).unwrap_or(0);
    let (holder_keys, new_keys) = keys.split_at(known_length);
    let holder_path = holder_keys.join(".");
    let is_name = |key: &String| key.starts_with(|c: char| c.is_alphabetic() || c == '_');
    let has_names = |holder: &&ValueLocation| {
        let first_item = format!("{}0", holder_keys.iter().map(|key| format!("{key}.")).collect::<String>());
        text.as_bytes()[holder.content_start.unwrap_or(1) - 1] == b'(' && locations.value(&first_item).is_none()
    };
    let content_start = locations.value(&holder_path).filter(has_names).and_then(|holder| holder.content_start);
    let Some(position) = content_start.filter(|_| new_keys.iter().all(is_name)) else {
        let shown: Vec<&str> = path.split('.').take(known_length + 1).collect();
        let found = format!("no '{}' in the file", shown.join("."));
        let shown_holder = &shown[..known_length];
        let expected = match ron_text::nearest_name(&new_keys[0], &locations.fields(&holder_path)) {
            Some(near) => format!("did you mean {}?", [shown_holder, &[near]].concat().join(".")),
            None => format!("expected {}", expected_path(shown_holder, holder_keys, locations)),
        };
        return Err(RecordFault::new(found, expected));
    };
    let (last_key, outer_keys) = new_keys.split_last().expect("a path has a last key");
    let field = outer_keys.iter().rev().fold(format!("{last_key}: {value}"), |inner, key| format!("{key}: ({inner})"));
    Ok(format!("{}{field}, {}", &text[..position], &text[position..]))
}

/// Values that a path can name below a holder, given as in the path (`shown`) and by its keys: the items of a list.
fn expected_path(shown: &[&str], keys: &[String], locations: &ValueLocations) -> String {
    let is_item = |n: &usize| locations.value(&[keys, &[n.to_string()]].concat().join(".")).is_some();
    let item = |n: usize| [shown, &[n.to_string().as_str()]].concat().join(".");
    match (0..).take_while(is_item).count() {
        0 => "the path of a value".into(),
        1 => item(1),
        count => format!("{} to {}", item(1), item(count)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set_to(text: &str, setting: &str) -> Result<String, String> {
        apply_settings(text, &[setting.to_string()]).map_err(|faults| faults.to_string())
    }

    #[test]
    fn a_long_path_is_rejected_at_once() {
        // It took minutes when the time grew with the square of its length.
        let path = vec!["a"; 200_000].join(".");
        assert!(apply_settings("(a: (b: 1))", &[format!("{path}=1")]).is_ok_and(|text| text.len() > path.len()));
        assert!(apply_settings("(a: [1])", &[format!("{path}=1")]).is_err());
    }

    #[test]
    fn values_are_those_of_the_last_setting() {
        let settings = ["list.1.b=x", "list.1=(b: 1)", "a=2", "no pair"].map(String::from);
        let of = |path| setting_of_path(&settings, path);
        assert_eq!(["list.0.b", "list.0", "a"].map(of), ["list.1=(b: 1)", "list.1=(b: 1)", "a=2"].map(Some));
        assert_eq!([of("list"), of("list.1.b"), of("ab"), of("")], [None; 4]);
        let text = "(\n  ä: 1,\n  a: x)";
        let found = [(2, 5), (3, 4), (3, 5), (3, 6)].map(|(line, column)| setting_at(&settings, text, line, column));
        assert_eq!(found, [None, Some("a=2"), Some("a=2"), Some("a=2")]);
    }

    #[test]
    fn values_are_replaced_or_inserted() {
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
    fn a_path_is_set_once() {
        let said = check_paths_once(&["a=2", "b.c=3", " a = 4"].map(String::from)).unwrap_err();
        assert_eq!(said.to_string(), "options: --set  a = 4: sets the value of --set a=2 again; expected it once");
        assert!(check_paths_once(&["b=(c: 1)", "b.c=3", "no pair", "no pair"].map(String::from)).is_ok());
    }

    #[test]
    fn paths_without_a_value_are_errors() {
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
