//! Colours of grains by a quantity: classes with round bounds, and the colours of the classes.

use clap::builder::PossibleValue;

use crate::derive::coordination::neighbour_counts;
use crate::derive::energy::KineticEnergy;
use crate::derive::fragments::{find_fragments, fragment_numbers};
use crate::derive::stress::{grain_stresses, pressure};
use crate::frame::{Frame, Grain};
use crate::write::scale::{digits_needed, format_digits, unit_prefix};

/// Viridis at 0, 1/4, 1/2, 3/4, 1 (Smith & van der Walt 2015), a little lighter at its dark end.
const VIRIDIS_COLOURS: [[f64; 3]; 5] =
    [[90.0, 40.0, 120.0], [70.0, 92.0, 150.0], [40.0, 145.0, 140.0], [100.0, 200.0, 95.0], [250.0, 225.0, 50.0]];

/// Largest number of classes: with the shades of each they fit the 256 colours of a GIF.
pub const MAX_CLASSES: usize = 13;
/// Number of neighbours from which on grains share a colour.
const MAX_NEIGHBOUR_CLASS: usize = 10;
/// Number of classes of the kinetic energy above the lowest; two make a power of ten.
const ENERGY_CLASSES: usize = 10;

/// Red, green and blue, 0 to 255, of a share from 0 to 1.
pub fn ramp_colour(share: f64) -> [f64; 3] {
    let position = share.clamp(0.0, 1.0) * (VIRIDIS_COLOURS.len() - 1) as f64;
    let low = (position as usize).min(VIRIDIS_COLOURS.len() - 2);
    let part = position - low as f64;
    std::array::from_fn(|k| (1.0 - part) * VIRIDIS_COLOURS[low][k] + part * VIRIDIS_COLOURS[low + 1][k])
}

/// Quantity that colours the grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GrainQuantity {
    Neighbours,
    KineticEnergy,
    Speed,
    Spin,
    Pressure,
    Radius,
    Fragment,
    Colour,
    Material,
}

impl clap::ValueEnum for GrainQuantity {
    fn value_variants<'a>() -> &'a [GrainQuantity] {
        use GrainQuantity::*;
        &[Neighbours, KineticEnergy, Speed, Spin, Pressure, Radius, Fragment, Colour, Material]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let flag = match self {
            GrainQuantity::KineticEnergy => "kinetic-energy",
            other => other.name(),
        };
        Some(PossibleValue::new(flag).help(self.meaning()))
    }
}

/// Spread of the values of the grains of one or more states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueSpread {
    /// Smallest and largest value.
    pub least: f64,
    pub largest: f64,
    /// Range without the lowest and highest hundredth of the grains of any state.
    pub low: f64,
    pub high: f64,
}

impl ValueSpread {
    /// Returns the spread of finite values; of none the empty spread, from infinity to negative infinity.
    pub fn from_values(mut values: Vec<f64>) -> ValueSpread {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        let quantile = |share: f64, empty: f64| {
            values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied().unwrap_or(empty)
        };
        let (up, down) = (f64::INFINITY, f64::NEG_INFINITY);
        ValueSpread {
            least: quantile(0.0, up),
            largest: quantile(1.0, down),
            low: quantile(0.01, up),
            high: quantile(0.99, down),
        }
    }

    /// Spread that contains both.
    pub fn union(self, other: ValueSpread) -> ValueSpread {
        ValueSpread {
            least: self.least.min(other.least),
            largest: self.largest.max(other.largest),
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

impl GrainQuantity {
    /// Name in legends.
    pub fn name(self) -> &'static str {
        match self {
            GrainQuantity::Neighbours => "neighbours",
            GrainQuantity::KineticEnergy => "kinetic energy",
            GrainQuantity::Speed => "speed",
            GrainQuantity::Spin => "spin",
            GrainQuantity::Pressure => "pressure",
            GrainQuantity::Radius => "radius",
            GrainQuantity::Fragment => "fragment",
            GrainQuantity::Colour => "colour",
            GrainQuantity::Material => "material",
        }
    }

    /// Definition, for the help of the command line.
    fn meaning(self) -> &'static str {
        match self {
            GrainQuantity::Neighbours => "Bodies that the grain touches with force",
            GrainQuantity::KineticEnergy => "Kinetic energy of translation and rotation, two classes a power of ten",
            GrainQuantity::Speed => "Speed of the centre of mass",
            GrainQuantity::Spin => "Magnitude of the angular velocity",
            GrainQuantity::Pressure => "Pressure of the contacts on the grain, > 0 compression",
            GrainQuantity::Radius => "Radius of the sphere of equal volume",
            GrainQuantity::Fragment => "Number of the fragment, 0 the largest remnant",
            GrainQuantity::Colour => "Contact colour of the scene",
            GrainQuantity::Material => "Material",
        }
    }

    /// Whether its classes are ranges of values, and not counts or names.
    pub fn is_continuous(self) -> bool {
        self.unit() != "1"
    }

    fn unit(self) -> &'static str {
        match self {
            GrainQuantity::KineticEnergy => "J",
            GrainQuantity::Speed => "m/s",
            GrainQuantity::Spin => "rad/s",
            GrainQuantity::Pressure => "Pa",
            GrainQuantity::Radius => "m",
            _ => "1",
        }
    }

    /// Value of each grain, in the unit of the quantity.
    pub fn grain_values(self, frame: &Frame) -> Vec<f64> {
        let numbers = |value: &dyn Fn(&Grain) -> f64| frame.grains.iter().map(value).collect();
        match self {
            GrainQuantity::Neighbours => neighbour_counts(frame).into_iter().map(f64::from).collect(),
            GrainQuantity::KineticEnergy => numbers(&|grain| KineticEnergy::of_grain(grain).total()),
            GrainQuantity::Speed => numbers(&|grain| grain.v.norm()),
            GrainQuantity::Spin => numbers(&|grain| grain.w.norm()),
            GrainQuantity::Pressure => grain_stresses(frame).iter().map(pressure).collect(),
            GrainQuantity::Radius => numbers(&|grain| grain.radius),
            GrainQuantity::Fragment => {
                fragment_numbers(&find_fragments(frame), frame.grains.len()).into_iter().map(f64::from).collect()
            }
            GrainQuantity::Colour => numbers(&|grain| f64::from(grain.colour)),
            GrainQuantity::Material => numbers(&|grain| f64::from(grain.material)),
        }
    }
}

/// Classes of values from 0, each with a colour and a label.
#[derive(Debug, Clone, PartialEq)]
pub struct ColourScale {
    pub quantity: GrainQuantity,
    /// Least value of each class but the first, rising.
    bounds: Vec<f64>,
    /// Label of each class.
    pub labels: Vec<String>,
    /// Unit of the labels; empty for numbers without unit and for labels with their own.
    pub unit: String,
}

impl ColourScale {
    /// Returns the scale for states with this spread of values; `frame`: one of them, for the names of colours and
    /// materials; `range`: limits of the colours instead of those of the values.
    pub fn new(
        quantity: GrainQuantity,
        spread: ValueSpread,
        range: Option<[f64; 2]>,
        frame: Option<&Frame>,
    ) -> ColourScale {
        let unit = String::new();
        let count_scale = |largest: f64, max_class: usize| {
            let classes = if largest.is_finite() { (largest as usize).min(max_class) } else { 0 };
            let label = |class: usize| format!("{class}{}", if class == max_class { "+" } else { "" });
            let bounds = (1..=classes).map(|class| class as f64).collect();
            ColourScale { quantity, bounds, labels: (0..=classes).map(label).collect(), unit: String::new() }
        };
        let name_scale = |names: Vec<String>| {
            let mut scale = count_scale(names.len().saturating_sub(1) as f64, MAX_CLASSES - 1);
            for (label, name) in scale.labels.iter_mut().zip(names.iter().take(MAX_CLASSES)) {
                *label = if label.ends_with('+') && names.len() > MAX_CLASSES { "others".into() } else { name.clone() };
            }
            scale
        };
        let meta = frame.map(|frame| &frame.meta);
        match quantity {
            GrainQuantity::Neighbours => count_scale(spread.largest, MAX_NEIGHBOUR_CLASS),
            GrainQuantity::Fragment => count_scale(spread.largest, MAX_CLASSES - 1),
            GrainQuantity::Colour => name_scale(meta.map(|meta| meta.colours.clone()).unwrap_or_default()),
            GrainQuantity::Material => {
                let names = |meta: &cd_formats::snapshot::SnapshotMeta| {
                    meta.materials.iter().map(|material| material.name.clone()).collect()
                };
                name_scale(meta.map(names).unwrap_or_default())
            }
            GrainQuantity::KineticEnergy => {
                let largest = range.map_or(spread.largest, |[_, high]| high);
                if !(largest > 0.0 && largest.is_finite()) {
                    return ColourScale { quantity, bounds: Vec::new(), labels: vec!["0 J".into()], unit };
                }
                let bounds = half_decades(largest, range.map_or(0.0, |[low, _]| low));
                let label = |bound: &f64| {
                    let (factor, unit) = unit_prefix(*bound, "J");
                    format!("{} {unit}", format_digits(bound / factor, 3))
                };
                let labels = std::iter::once("less".to_string()).chain(bounds.iter().map(label)).collect();
                ColourScale { quantity, bounds, labels, unit }
            }
            _ => ColourScale::linear(quantity, spread, range),
        }
    }

    /// Scale with classes of equal width, which is 1, 2 or 5 times a power of ten.
    fn linear(quantity: GrainQuantity, spread: ValueSpread, range: Option<[f64; 2]>) -> ColourScale {
        let [low, high] = range.unwrap_or([spread.low, spread.high]);
        if !(low.is_finite() && high.is_finite()) {
            return ColourScale { quantity, bounds: vec![], labels: vec!["no value".into()], unit: String::new() };
        }
        // Below the least magnitude there is no power of ten to divide by.
        let magnitude = Some(low.abs().max(high.abs())).filter(|largest| *largest > 1e-290).unwrap_or(0.0);
        let (factor, unit) = unit_prefix(magnitude, quantity.unit());
        // Values that are equal within round-off are one class.
        let step = round_step((high - low) / (MAX_CLASSES - 2) as f64);
        let (bounds, digits) = if high - low > 1e-9 * magnitude && magnitude > 0.0 {
            let (first, last) = ((low / step).floor() as i64, (high / step).ceil() as i64);
            ((first..last).map(|k| k as f64 * step).collect(), digits_needed(magnitude, step))
        } else {
            (vec![low], 3)
        };
        let mut bounds: Vec<f64> = bounds;
        let mut labels: Vec<String> = bounds.iter().map(|bound| format_digits(bound / factor, digits)).collect();
        if spread.least < bounds[0] {
            labels.insert(0, "less".into());
        } else {
            bounds.remove(0);
        }
        let unit = if unit == "1" { String::new() } else { unit };
        ColourScale { quantity, bounds, labels, unit }
    }

    /// Returns the scale of some states together.
    pub fn from_frames(quantity: GrainQuantity, frames: &[&Frame]) -> ColourScale {
        let spreads = frames.iter().map(|frame| ValueSpread::from_values(quantity.grain_values(frame)));
        let spread = spreads.fold(ValueSpread::from_values(Vec::new()), ValueSpread::union);
        ColourScale::new(quantity, spread, None, frames.first().copied())
    }

    /// Class of the highest values.
    pub fn max_class(&self) -> usize {
        self.bounds.len()
    }

    /// Class of a value; 0 if it is not defined.
    pub fn value_class(&self, value: f64) -> usize {
        self.bounds.partition_point(|bound| *bound <= value)
    }

    /// Class of each grain.
    pub fn grain_classes(&self, frame: &Frame) -> Vec<usize> {
        self.quantity.grain_values(frame).into_iter().map(|value| self.value_class(value)).collect()
    }

    /// Colour of a class.
    pub fn class_colour(&self, class: usize) -> [f64; 3] {
        ramp_colour(class as f64 / self.max_class().max(1) as f64)
    }

    /// Lines above the colours: the quantity, and the unit and meaning of the labels.
    pub fn title_lines(&self) -> [String; 2] {
        let unit = if self.unit.is_empty() { String::new() } else { format!("({})", self.unit) };
        let from = if self.quantity.is_continuous() && self.labels.len() > 1 { "from" } else { "" };
        [self.quantity.name().into(), format!("{unit} {from}").trim().to_string()]
    }
}

/// The least of 1, 2, 5 times a power of ten that is not below `least`; 0 for 0.
fn round_step(least: f64) -> f64 {
    if !(least > 0.0 && least.is_finite()) {
        return 0.0;
    }
    let decade = least.log10().floor() as i32;
    // Parsed from decimal text, not computed as a product.
    let steps = [(1, 0), (2, 0), (5, 0), (1, 1)].map(|(m, up)| format!("{m}e{}", decade + up).parse().unwrap_or(least));
    steps.into_iter().find(|step: &f64| *step >= least * (1.0 - 1e-12)).unwrap_or(least)
}

/// Rising values 1 and 3 times powers of ten, the highest not above `largest`, none below `least`.
fn half_decades(largest: f64, least: f64) -> Vec<f64> {
    let decade = largest.log10().floor() as i32;
    let marks = (decade - ENERGY_CLASSES as i32..=decade + 1).flat_map(|decade| [1, 3].map(|m| (m, decade)));
    let values = marks.map(|(m, decade)| format!("{m}e{decade}").parse().unwrap_or(0.0));
    let shown: Vec<f64> = values.filter(|value| *value <= largest && *value > 0.0 && *value >= least).collect();
    shown[shown.len().saturating_sub(ENERGY_CLASSES)..].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    fn spread(low: f64, high: f64) -> ValueSpread {
        ValueSpread { least: low, largest: high, low, high }
    }

    #[test]
    fn bounds_of_classes_are_round() {
        let scale = ColourScale::new(GrainQuantity::Speed, spread(0.0, 0.0213), None, None);
        assert_eq!(scale.labels, ["0", "2", "4", "6", "8", "10", "12", "14", "16", "18", "20"]);
        assert_eq!((scale.unit.as_str(), scale.max_class()), ("mm/s", 10));
        assert_eq!([-1.0, 0.0, 0.0019, 0.002, 0.0213, 9.0].map(|v| scale.value_class(v)), [0, 0, 0, 1, 10, 10]);
        // Limits of the user, with values below them.
        let scale = ColourScale::new(GrainQuantity::Pressure, spread(-50.0, 900.0), Some([100.0, 600.0]), None);
        assert_eq!(scale.labels.first().map(String::as_str), Some("less"));
        assert_eq!(scale.labels[1..], ["100", "150", "200", "250", "300", "350", "400", "450", "500", "550"]);
        assert_eq!([99.0, 100.0, 1e6].map(|v| scale.value_class(v)), [0, 1, 10]);
    }

    #[test]
    fn every_scale_has_a_label_for_each_of_few_classes() {
        let spreads = [
            spread(0.0, 0.0),
            spread(5.0, 5.0),
            spread(1e-300, 1e300),
            spread(-1e300, 1e300),
            spread(1e-320, 2e-320),
            spread(7.0, 7.0 + 1e-14),
            spread(-3.0, -1.0),
            ValueSpread::from_values(vec![f64::NAN]),
        ];
        let frame = Scene::default().frame();
        for quantity in <GrainQuantity as clap::ValueEnum>::value_variants() {
            for spread in spreads {
                let scale = ColourScale::new(*quantity, spread, None, Some(&frame));
                assert_eq!(scale.labels.len(), scale.max_class() + 1, "{scale:?}");
                assert!(scale.max_class() < MAX_CLASSES, "{scale:?}");
                assert!(scale.bounds.windows(2).all(|two| two[0] < two[1]), "{scale:?}");
                assert!(!format!("{scale:?}").contains("NaN"), "{scale:?}");
            }
        }
    }

    #[test]
    fn energies_have_two_classes_a_power_of_ten() {
        let scale = ColourScale::new(GrainQuantity::KineticEnergy, spread(0.0, 64.0), None, None);
        assert_eq!(scale.labels[..3], ["less", "1 mJ", "3 mJ"]);
        assert_eq!(scale.labels[8..], ["3 J", "10 J", "30 J"]);
        assert_eq!([64.0, 16.0, 0.0079, 0.0, f64::NAN].map(|v| scale.value_class(v)), [10, 9, 2, 0, 0]);
        let at_rest = ColourScale::new(GrainQuantity::KineticEnergy, spread(0.0, 0.0), None, None);
        assert_eq!(at_rest.labels, ["0 J"]);
    }

    #[test]
    fn outliers_do_not_set_the_colours() {
        let mut values = vec![1.0; 1000];
        values[7] = 1e9;
        let spread = ValueSpread::from_values(values);
        assert_eq!((spread.low, spread.high, spread.largest), (1.0, 1.0, 1e9));
        let both = spread.union(ValueSpread::from_values(vec![0.0; 3]));
        assert_eq!((both.least, both.low, both.high), (0.0, 0.0, 1.0));
    }
}
