//! Faults of a RON file with line and column of their values.

use std::path::Path;

use crate::error::{Fault, Faults};
use crate::names::{known_names, number_text};
use crate::ron_text::display_text;
use crate::settings::{setting_fault, setting_of_path};
use crate::value_locations::ValueLocations;

/// Faults of one file, each with the path of its value, e.g. `grains.0.sizes`.
pub struct FaultReport<'a> {
    file: &'a Path,
    locations: ValueLocations<'a>,
    settings: &'a [String],
    pub faults: Faults,
    /// Values that are allowed but probably a mistake.
    pub warnings: Faults,
}

/// Bound of the magnitude of all numbers of input: a product of seven such numbers is still within the range of f64. The sun has
/// a mass of 2e30 kg.
pub const MAX_MAGNITUDE: f64 = 1e40;

/// Whether a number that is written as `text`, in digits, is larger than all of f64.
pub fn is_beyond_range(text: &str, x: f64) -> bool {
    x.is_infinite() && text.contains(|letter: char| letter.is_ascii_digit())
}

/// Whether a number that is written as `text` is 0 only because it is smaller than all of f64.
pub fn is_rounded_to_zero(text: &str, x: f64) -> bool {
    let mantissa = text.split(['e', 'E']).next().unwrap_or_default();
    x == 0.0 && mantissa.contains(|letter: char| ('1'..='9').contains(&letter))
}

impl<'a> FaultReport<'a> {
    /// Empty report on a file with this text.
    pub fn new(file: &'a Path, text: &'a str) -> Self {
        FaultReport::with_settings(file, text, &[])
    }

    /// Report on a text in which [`crate::settings::apply_settings`] has replaced values: faults of these name the setting.
    pub fn with_settings(file: &'a Path, text: &'a str, settings: &'a [String]) -> Self {
        FaultReport {
            file,
            locations: ValueLocations::from_text(text),
            settings,
            faults: Faults::default(),
            warnings: Faults::default(),
        }
    }

    /// Adds a fault of the value at `path`: `found` describes the value, `expected` the one that is expected.
    pub fn add_fault(&mut self, path: &str, found: impl Into<String>, expected: impl Into<String>) {
        self.faults.push(self.fault_at(path, found.into(), format!("expected {}", expected.into())));
    }

    /// Adds a fault like [`FaultReport::add_fault`], with the whole phrase about the expected value, such as a question.
    pub fn add_fault_with_phrase(&mut self, path: &str, found: impl Into<String>, expected: impl Into<String>) {
        self.faults.push(self.fault_at(path, found.into(), expected.into()));
    }

    /// Text of the value at `path`; empty if there is none.
    pub fn text(&self, path: &str) -> &'a str {
        self.locations.text(path).unwrap_or_default()
    }

    /// Adds a warning about the value at `path`, with a question or advice.
    pub fn add_warning(&mut self, path: &str, found: impl Into<String>, question: &str) {
        self.warnings.push(self.fault_at(path, found.into(), question.to_string()));
    }

    /// Fault of the value at `path`, with the whole phrase about the expected value.
    pub fn fault_at(&self, path: &str, found: String, expected: String) -> Fault {
        match setting_of_path(self.settings, path) {
            Some(setting) => setting_fault(setting, found, expected),
            None => {
                let (line, column) = self.locations.position(path).unzip();
                Fault { column, ..Fault::new(self.file, line, self.locations.path_in_words(path), found, expected) }
            }
        }
    }

    /// Adds a fault of a name at `path` that is not in `candidates`, with the nearest known name.
    pub fn add_unknown_name(&mut self, path: &str, found: impl Into<String>, name: &str, candidates: &[&str]) {
        self.faults.push(self.fault_at(path, found.into(), known_names(name, candidates)));
    }

    /// [`FaultReport::text`] in one line, cut off if it is long.
    pub fn shown_text(&self, path: &str) -> String {
        display_text(self.text(path))
    }

    /// [`FaultReport::shown_text`], or `other` if there is no value at `path`.
    pub fn shown_text_or(&self, path: &str, other: impl FnOnce() -> String) -> String {
        if self.text(path).is_empty() { other() } else { self.shown_text(path) }
    }

    /// Number `x` at `path` as it is written there; if the text there is another one, [`number_text`].
    pub fn number_text(&self, path: &str, x: f64) -> String {
        let text = self.text(path);
        let text = text.strip_prefix("Some(").and_then(|inner| inner.strip_suffix(')')).unwrap_or(text).trim();
        let is_same = |written: f64| written == x || written.is_nan() && x.is_nan();
        if text.parse().is_ok_and(is_same) { display_text(text) } else { number_text(x) }
    }

    /// Adds a fault of the number `x` at `path` unless `holds`. A number beyond the range of f64 is shown as it
    /// is written.
    pub fn require_number(&mut self, holds: bool, path: &str, x: f64, expected: &str) {
        let found = self.number_text(path, x);
        let range = match (is_beyond_range(&found, x), is_rounded_to_zero(&found, x)) {
            (true, _) => ", below 1.8e308 in magnitude",
            (_, true) => ", at least 1e-307 in magnitude",
            _ => "",
        };
        self.require(holds, path, found, &format!("{expected}{range}"));
    }

    /// Adds a fault like [`FaultReport::add_fault`], unless `holds`.
    pub fn require(&mut self, holds: bool, path: &str, found: impl Into<String>, expected: &str) {
        if !holds {
            self.add_fault(path, found, expected);
        }
    }
}
