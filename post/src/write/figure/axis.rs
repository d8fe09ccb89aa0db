//! Axes of a figure: scaling, range and ticks.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use crate::write::scale::{digits_needed, format_digits, to_superscript, unit_prefix};

/// Quantity, unit and scaling of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct FigureAxis {
    pub quantity: String,
    /// Unit; "1" for a number without unit.
    pub unit: String,
    /// Whether the axis is in powers of ten; values under 1e-14 of the largest, round-off, are left out.
    pub logarithmic: bool,
}

impl FigureAxis {
    /// Axis with equal intervals.
    pub fn linear(quantity: &str, unit: &str) -> FigureAxis {
        FigureAxis { quantity: quantity.into(), unit: unit.into(), logarithmic: false }
    }

    /// Axis in powers of ten.
    pub fn logarithmic(quantity: &str, unit: &str) -> FigureAxis {
        FigureAxis { logarithmic: true, ..FigureAxis::linear(quantity, unit) }
    }
}

/// Largest number of marks on an axis.
pub const MAX_AXIS_MARKS: usize = 7;

/// Share of the largest value below which values on a logarithmic axis are round-off.
const RELATIVE_ROUNDING: f64 = 1e-14;

/// Factor from SI units to the unit of the axis that suits these values, and the name of that unit.
pub fn axis_scaling(axis: &FigureAxis, values: impl Iterator<Item = f64>) -> (f64, String) {
    if axis.logarithmic { (1.0, axis.unit.clone()) } else { unit_prefix(largest_magnitude(values), &axis.unit) }
}

/// Largest value that is too small to be shown on a logarithmic axis; negative infinity on a linear one.
pub fn smallest_shown(axis: &FigureAxis, values: impl Iterator<Item = f64>) -> f64 {
    if axis.logarithmic { RELATIVE_ROUNDING * largest_magnitude(values) } else { f64::NEG_INFINITY }
}

/// Value in the unit of the axis, or its exponent of ten; NaN if it is not shown.
pub fn axis_value(axis: &FigureAxis, value: f64, factor: f64, smallest: f64) -> f64 {
    match axis.logarithmic {
        _ if !value.is_finite() || value <= smallest => f64::NAN,
        true => value.log10(),
        false => value / factor,
    }
}

fn largest_magnitude(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|v| v.is_finite()).fold(0.0, |a, b| a.max(b.abs()))
}

/// Range around the finite values, never empty.
pub fn axis_range(values: impl Iterator<Item = f64>, logarithmic: bool) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    if logarithmic {
        // Extends to a mark, so that each end has one: whole powers, or intermediate marks if there are few decades.
        let (low, high) = (low - 0.05, high + 0.05);
        let powers = low.floor()..high.ceil();
        if !is_few_decades(&powers) {
            return powers;
        }
        let marks: Vec<f64> = marked_exponents(&powers).collect();
        let below = marks.iter().rev().find(|mark| **mark <= low);
        let above = marks.iter().find(|mark| **mark >= high);
        return *below.unwrap_or(&powers.start)..*above.unwrap_or(&powers.end);
    }
    // Values that are equal within round-off are one value.
    // Computed by halves: the whole range may overflow.
    let half = 0.5 * high - 0.5 * low;
    let margin = match low.abs().max(high.abs()) {
        0.0 => 1.0,
        magnitude if half <= 0.5e-9 * magnitude => 0.1 * magnitude,
        _ => 0.08 * half,
    };
    (low - margin).max(f64::MIN)..(high + margin).min(f64::MAX)
}

/// Whether the range has so few powers of ten that twice and five times them are marked, too.
fn is_few_decades(exponents: &std::ops::Range<f64>) -> bool {
    exponents.end - exponents.start < 2.5
}

/// Exponents of 1, 2 and 5 times powers of ten in a range, both ends included.
fn marked_exponents(exponents: &std::ops::Range<f64>) -> impl Iterator<Item = f64> {
    let (from, to) = (exponents.start, exponents.end);
    let powers = from.floor() as i32..=to.ceil() as i32;
    let marks = powers.flat_map(|power| [1f64, 2.0, 5.0].map(|m| f64::from(power) + m.log10()));
    marks.filter(move |mark| (from..=to).contains(mark))
}

/// Ticks of an axis.
#[derive(Clone)]
pub struct AxisTicks {
    /// Range of the values, or of their exponents of ten.
    pub range: std::ops::Range<f64>,
    /// Whether the axis is one of exponents, marked at whole ones.
    pub logarithmic: bool,
}

impl AxisTicks {
    /// Distance of marks on a linear axis: the least of 1, 2, 5 times a power of ten that gives at most `max_ticks`
    /// marks.
    fn tick_step(&self, max_ticks: usize) -> f64 {
        let half = 0.5 * self.range.end - 0.5 * self.range.start;
        let decade = (half.log10() + (2.0 / (max_ticks + 1) as f64).log10()).floor() as i32;
        let steps = (decade..).flat_map(|decade| [1.0, 2.0, 5.0].map(|m| (m, decade)));
        // Parsed from decimal text, not computed as a product.
        let mut steps = steps.map(|(m, decade)| format!("{m}e{decade}").parse().unwrap_or(f64::INFINITY));
        let fits = |step: &f64| (self.range.end / step).floor() - (self.range.start / step).ceil() < max_ticks as f64;
        steps.find(fits).unwrap_or(f64::INFINITY)
    }

    /// Offset subtracted from labels: if more than six digits of all are the same, the round number in the middle; else 0.
    pub fn label_offset(&self) -> f64 {
        let (low, high) = (self.range.start, self.range.end);
        if self.logarithmic || digits_needed(low.abs().max(high.abs()), self.tick_step(MAX_AXIS_MARKS)) <= 7 {
            return 0.0;
        }
        let decade = 10f64.powi((high - low).log10().ceil() as i32);
        let middle = 0.5 * low + 0.5 * high;
        // Without the rounding of a product.
        format_digits(middle, digits_needed(middle.abs(), decade)).parse().unwrap_or(0.0)
    }

    /// Text at a mark; `offset` is subtracted from the values of a linear axis.
    pub fn tick_label(&self, value: f64, offset: f64) -> String {
        if self.logarithmic {
            return if is_few_decades(&self.range) { power_digits(value) } else { power_of_ten(value) };
        }
        let step = self.tick_step(MAX_AXIS_MARKS);
        let value = ((value - offset) / step).round() * step;
        format_digits(value, digits_needed(value.abs(), step).clamp(6, 17))
    }
}

impl Ranged for AxisTicks {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        // By halves, as above.
        plotters::coord::types::RangedCoordf64::from(0.5 * self.range.start..0.5 * self.range.end)
            .map(&(0.5 * value), limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if !self.logarithmic {
            let step = self.tick_step(hint.max_num_points().max(2));
            let (first, last) = ((self.range.start / step).ceil() as i64, (self.range.end / step).floor() as i64);
            return (first..=last).map(|k| k as f64 * step).collect();
        }
        if is_few_decades(&self.range) {
            return marked_exponents(&self.range).collect();
        }
        let (first, last) = (self.range.start.ceil() as i64, self.range.end.floor() as i64);
        let stride = ((last - first) / hint.max_num_points().clamp(1, 9) as i64 + 1).max(1);
        (first..=last).filter(|k| k.rem_euclid(stride) == 0).map(|k| k as f64).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.clone()
    }
}

/// 10 to the exponent as one digit and zeros, even if it overflows.
fn power_digits(exponent: f64) -> String {
    let power = exponent.floor();
    let digit = 10f64.powf(exponent - power).round();
    if power < 300.0 { format_digits(digit * 10f64.powf(power), 1) } else { format!("{digit}e{power}") }
}

fn power_of_ten(exponent: f64) -> String {
    format!("10{}", to_superscript(exponent as i32))
}
