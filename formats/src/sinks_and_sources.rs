//! Sinks and sources of a run: bodies that leave, and bodies that enter.

use serde::{Deserialize, Serialize};

use crate::names::is_file_name;
use crate::probe::BodySelection;
use crate::region::SpaceRegion;
use crate::report::FaultReport;

/// Part of space from which free bodies leave the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sink {
    /// Unique name, of letters, digits, `-` and `_`.
    pub name: String,
    pub region: SpaceRegion,
}

/// Bodies that enter the run one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Unique name, of letters, digits, `-` and `_`.
    pub name: String,
    pub bodies: BodySelection,
    /// Order in which the bodies enter. `None` in COMPUTE.RON is [`EntryOrder::Numbers`]; in a scene it is a random order
    /// of the scene's seed, see [`set_random_orders`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<EntryOrder>,
    /// Time of the first, s.
    #[serde(default)]
    pub from: f64,
    /// Number of bodies per second.
    pub rate: f64,
}

/// Order in which the bodies of a source enter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum EntryOrder {
    /// By rising numbers.
    Numbers,
    /// Random order, which depends on this seed and on the numbers of the bodies alone.
    Random(u64),
}

/// Gives sources without an order a random one with this seed. cd-pre numbers grains along a Z-curve: by their numbers they
/// would enter through one part of their region after the other.
pub fn set_random_orders(sources: &mut [Source], seed: u64) {
    for source in sources {
        source.order.get_or_insert(EntryOrder::Random(seed));
    }
}

impl Source {
    /// Time at which body `k` of the source, from 0, enters, s.
    pub fn entry_time(&self, k: usize) -> f64 {
        self.from + k as f64 / self.rate
    }
}

/// Selections of the sources, with the paths of their values in COMPUTE.RON.
pub fn source_bodies(sources: &[Source]) -> impl Iterator<Item = (String, &BodySelection)> {
    sources.iter().enumerate().map(|(k, source)| (format!("sources.{k}.bodies"), &source.bodies))
}

/// Reports the values of sinks and sources that no run could use; `prefix` begins their paths.
pub fn check_sinks_and_sources(sinks: &[Sink], sources: &[Source], prefix: &str, report: &mut FaultReport) {
    let mut known: Vec<&str> = Vec::new();
    let names =
        sinks.iter().map(|sink| &sink.name).enumerate().map(|(k, name)| (format!("{prefix}sinks.{k}.name"), name));
    let of_sources = sources.iter().map(|source| &source.name).enumerate();
    for (path, name) in names.chain(of_sources.map(|(k, name)| (format!("{prefix}sources.{k}.name"), name))) {
        let is_valid = is_file_name(name) && !known.contains(&name.as_str());
        report.require(is_valid, &path, format!("'{name}'"), "a name of its own, of letters, digits, - and _");
        known.push(name);
    }
    for (k, sink) in sinks.iter().enumerate() {
        if let Some(expected) = sink.region.invalid_value() {
            let path = format!("{prefix}sinks.{k}.region");
            let found = report.shown_text_or(&path, || format!("{:?}", sink.region));
            report.add_fault(&path, found, expected);
        }
    }
    for (k, Source { from, rate, .. }) in sources.iter().enumerate() {
        let path = format!("{prefix}sources.{k}");
        report.require_number(from.is_finite(), &format!("{path}.from"), *from, "a finite time (s)");
        let is_valid = rate.is_finite() && *rate > 0.0;
        report.require_number(is_valid, &format!("{path}.rate"), *rate, "a finite number > 0 of bodies per second");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_enter_at_equal_intervals() {
        let source = Source { name: "rain".into(), bodies: BodySelection::Free, order: None, from: 3.0, rate: 4.0 };
        assert_eq!([0, 1, 6].map(|k| source.entry_time(k)), [3.0, 3.25, 4.5]);
    }
}
