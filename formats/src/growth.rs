//! Sinks and sources of a run: bodies that leave, and bodies that enter.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::geometry::convex_region::ConvexRegion;
use crate::names::is_file_name;
use crate::probe::BodySelection;
use crate::report::FaultReport;

/// Part of space from which free bodies leave the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sink {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    pub region: SpaceRegion,
}

/// Region of a sink, in which a body leaves the run when its centre of mass is inside, or of a probe, for means over it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum SpaceRegion {
    /// Farther than `radius` (m) from `centre` (m).
    Beyond { centre: [f64; 3], radius: f64 },
    /// Half space on the side of the plane through `point` (m) from which `normal` points away.
    Below { point: [f64; 3], normal: [f64; 3] },
    /// Nearer than `radius` (m) to `centre` (m).
    Ball { centre: [f64; 3], radius: f64 },
    /// Between two opposite corners (m), along the fixed axes.
    Box { lower: [f64; 3], upper: [f64; 3] },
    /// Within `radius` (m) of the segment from `start` to `end` (m), and between the planes through its ends.
    Cylinder { start: [f64; 3], end: [f64; 3], radius: f64 },
}

/// Bodies that enter the run one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Bodies that enter, in the order of their numbers.
    pub bodies: BodySelection,
    /// Time of the first, s.
    #[serde(default)]
    pub from: f64,
    /// Number of bodies per second.
    pub rate: f64,
}

impl SpaceRegion {
    /// Whether the region has the position `x` (m).
    pub fn contains(&self, x: &[f64; 3]) -> bool {
        let offset_from = |origin: &[f64; 3]| difference(x, origin);
        match self {
            SpaceRegion::Beyond { centre, radius } => square(&offset_from(centre)) > radius * radius,
            SpaceRegion::Below { point, normal } => dot(&offset_from(point), normal) < 0.0,
            SpaceRegion::Ball { centre, radius } => square(&offset_from(centre)) < radius * radius,
            SpaceRegion::Box { lower, upper } => (0..3).all(|k| lower[k] < x[k] && x[k] < upper[k]),
            SpaceRegion::Cylinder { start, end, radius } => {
                let (axis, arm) = (difference(end, start), offset_from(start));
                let (length_squared, along) = (square(&axis), dot(&arm, &axis));
                let off_axis: [f64; 3] = std::array::from_fn(|k| arm[k] - axis[k] * (along / length_squared));
                0.0 < along && along < length_squared && square(&off_axis) < radius * radius
            }
        }
    }

    /// The same region with a volume, for means; `None` if the volume is infinite.
    pub fn convex_region(&self) -> Option<ConvexRegion> {
        match self {
            SpaceRegion::Beyond { .. } | SpaceRegion::Below { .. } => None,
            SpaceRegion::Ball { centre, radius } => {
                Some(ConvexRegion::Ball { centre: (*centre).into(), radius: *radius })
            }
            SpaceRegion::Box { lower, upper } => {
                let [lower, upper] = [lower, upper].map(|corner| Vector3::from(*corner));
                Some(ConvexRegion::Box { centre: 0.5 * (lower + upper), half: 0.5 * (upper - lower) })
            }
            SpaceRegion::Cylinder { start, end, radius } => {
                let [start, end] = [start, end].map(|end| Vector3::from(*end));
                let (centre, axis) = (0.5 * (start + end), end - start);
                let length = axis.norm();
                Some(ConvexRegion::Cylinder { centre, axis: axis / length, radius: *radius, half: 0.5 * length })
            }
        }
    }

    /// Requirement that the numbers do not meet.
    pub(crate) fn invalid_value(&self) -> Option<&'static str> {
        let are_finite = |vectors: &[&[f64; 3]]| vectors.iter().all(|v| v.iter().all(|x| x.is_finite()));
        let is_positive = |x: f64| x.is_finite() && x > 0.0;
        match self {
            SpaceRegion::Beyond { centre, radius } | SpaceRegion::Ball { centre, radius } => {
                (!(are_finite(&[centre]) && is_positive(*radius))).then_some("a finite centre and a radius > 0 m")
            }
            SpaceRegion::Below { point, normal } => {
                let is_valid = are_finite(&[point, normal]) && is_positive(square(normal));
                (!is_valid).then_some("a finite point and a normal other than 0")
            }
            SpaceRegion::Box { lower, upper } => {
                let is_valid = are_finite(&[lower, upper]) && (0..3).all(|k| lower[k] < upper[k]);
                (!is_valid).then_some("finite corners, each coordinate of lower less than that of upper")
            }
            SpaceRegion::Cylinder { start, end, radius } => {
                let is_valid =
                    are_finite(&[start, end]) && is_positive(square(&difference(end, start))) && is_positive(*radius);
                (!is_valid).then_some("two finite ends that differ, and a radius > 0 m")
            }
        }
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

/// Reports the values of sinks and sources that no run could use; `at` is the prefix of their paths.
pub fn check_growth(sinks: &[Sink], sources: &[Source], at: &str, report: &mut FaultReport) {
    let mut known: Vec<&str> = Vec::new();
    let names = sinks.iter().map(|sink| &sink.name).enumerate().map(|(k, name)| (format!("{at}sinks.{k}.name"), name));
    let of_sources = sources.iter().map(|source| &source.name).enumerate();
    for (path, name) in names.chain(of_sources.map(|(k, name)| (format!("{at}sources.{k}.name"), name))) {
        let is_valid = is_file_name(name) && !known.contains(&name.as_str());
        report.require(is_valid, &path, format!("'{name}'"), "a name of its own, of letters, digits, - and _");
        known.push(name);
    }
    for (k, sink) in sinks.iter().enumerate() {
        if let Some(expected) = sink.region.invalid_value() {
            let path = format!("{at}sinks.{k}.region");
            let found = report.shown_text_or(&path, || format!("{:?}", sink.region));
            report.add_fault(&path, found, expected);
        }
    }
    for (k, Source { from, rate, .. }) in sources.iter().enumerate() {
        let path = format!("{at}sources.{k}");
        report.require_number(from.is_finite(), &format!("{path}.from"), *from, "a finite time (s)");
        let is_valid = rate.is_finite() && *rate > 0.0;
        report.require_number(is_valid, &format!("{path}.rate"), *rate, "a finite number > 0 of bodies per second");
    }
}

fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn square(v: &[f64; 3]) -> f64 {
    dot(v, v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_open_sets() {
        let origin = [0.0; 3];
        let beyond = SpaceRegion::Beyond { centre: [1.0, 0.0, 0.0], radius: 2.0 };
        assert_eq!([-1.0, -1.5, 3.0, 3.5].map(|x| beyond.contains(&[x, 0.0, 0.0])), [false, true, false, true]);
        let ball = SpaceRegion::Ball { centre: origin, radius: 2.0 };
        assert_eq!([0.0, 1.5, 2.0, 2.5].map(|x| ball.contains(&[x, 0.0, 0.0])), [true, true, false, false]);
        let below = SpaceRegion::Below { point: [0.0, 0.0, 1.0], normal: [0.0, 0.0, 3.0] };
        assert_eq!([0.5, 1.0, 1.5].map(|z| below.contains(&[9.0, 9.0, z])), [true, false, false]);
        let cuboid = SpaceRegion::Box { lower: origin, upper: [1.0, 2.0, 3.0] };
        assert!(cuboid.contains(&[0.5, 1.5, 2.5]) && !cuboid.contains(&[0.5, 1.5, 3.0]));
        let cylinder = SpaceRegion::Cylinder { start: origin, end: [0.0, 4.0, 0.0], radius: 1.0 };
        let at = |x: f64, y: f64| cylinder.contains(&[x, y, 0.0]);
        assert!(at(0.5, 1.0) && at(-0.9, 3.9) && !at(1.0, 1.0) && !at(0.5, 4.0) && !at(0.5, 0.0));
    }

    #[test]
    fn bodies_enter_at_equal_intervals() {
        let source = Source { name: "rain".into(), bodies: BodySelection::Free, from: 3.0, rate: 4.0 };
        assert_eq!([0, 1, 6].map(|k| source.entry_time(k)), [3.0, 3.25, 4.5]);
    }
}
