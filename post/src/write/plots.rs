//! `POSTPRO/*.svg`: the main columns of the series against time.
//!
//! The SVG files name a font family and leave the letters to the viewer: no font is needed to
//! write them, and so the room for labels is by estimate.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use crate::derive::Row;
use crate::write::scale::{prefixed, significant, superscript};

/// One plot: columns of [`Row`] that share a unit.
pub struct Plot {
    /// Name of the file in `POSTPRO/`.
    pub file: &'static str,
    pub title: &'static str,
    /// What the vertical axis shows.
    pub quantity: &'static str,
    /// Logarithmic in powers of ten; values under 1e-14 of the largest, round-off, are left out.
    pub logarithmic: bool,
    /// Name of a column, and what the legend calls it.
    pub curves: &'static [(&'static str, &'static str)],
}

pub const PLOTS: [Plot; 5] = [
    Plot {
        file: "energy.svg",
        title: "Kinetic energy per grain",
        quantity: "energy",
        logarithmic: true,
        curves: &[("Ec_mean", "all"), ("Ec_rot_mean", "rotation"), ("Ec_rigid_mean", "rigid motion")],
    },
    Plot {
        file: "coordination.svg",
        title: "Contacts per grain",
        quantity: "Z",
        logarithmic: false,
        curves: &[("Z", "all grains"), ("Z_no_rattlers", "no rattlers")],
    },
    Plot {
        file: "solid_fraction.svg",
        title: "Solid fraction of the smallest enclosing ball",
        quantity: "ν",
        logarithmic: false,
        curves: &[("nu", "ν")],
    },
    Plot {
        file: "pressure.svg",
        title: "Mean pressure",
        quantity: "pressure",
        logarithmic: false,
        curves: &[("pressure", "contacts"), ("pressure_virial", "virial of the loads")],
    },
    Plot {
        file: "semi_axes.svg",
        title: "Semi-axes of the ellipsoid of equal inertia",
        quantity: "length",
        logarithmic: false,
        curves: &[("a", "a"), ("b", "b"), ("c", "c")],
    },
];

const SIZE: (u32, u32) = (800, 450);
const LEGEND_WIDTH: i32 = 150;
/// Okabe & Ito (2008): told apart by colour-blind eyes too.
const COLOURS: [RGBColor; 3] = [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115)];
/// Of lines, the last drawn first: earlier curves are wider, and where two are equal both are seen.
const WIDTHS: [u32; COLOURS.len()] = [2, 4, 6];
const INK: RGBColor = RGBColor(60, 60, 60);
/// More points than this are drawn as a line without marks.
const MARKED: usize = 30;
/// Share of the largest value below which a logarithmic axis shows nothing but round-off.
const ROUNDING: f64 = 1e-14;

/// The text of the SVG file.
pub fn svg(plot: &Plot, rows: &[Row]) -> String {
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
        draw(&root, plot, rows).expect("drawing into memory");
        root.present().expect("drawing into memory");
    }
    text
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// What is drawn: values in the unit of the axis, NaN where nothing is; on a logarithmic axis
/// exponents of ten, so that from here on both kinds are the same.
struct Scaled {
    times: Vec<f64>,
    time_unit: String,
    curves: Vec<Vec<f64>>,
    unit: String,
}

fn scaled(plot: &Plot, rows: &[Row]) -> Scaled {
    let column = |name: &str| Row::COLUMNS.iter().position(|(known, _, _)| *known == name).expect("a column");
    let unit = Row::COLUMNS[column(plot.curves[0].0)].1;
    let curve = |index: usize| -> Vec<f64> { rows.iter().map(|row| row.numbers()[index]).collect() };
    let mut curves: Vec<Vec<f64>> = plot.curves.iter().map(|(name, _)| curve(column(name))).collect();
    let largest = largest(curves.iter().flatten());
    let (factor, unit) = if plot.logarithmic { (1.0, unit.to_string()) } else { prefixed(largest, unit) };
    for value in curves.iter_mut().flatten() {
        *value = match plot.logarithmic {
            _ if !value.is_finite() => f64::NAN,
            true if *value <= ROUNDING * largest => f64::NAN,
            true => value.log10(),
            false => *value / factor,
        };
    }
    let mut times: Vec<f64> = rows.iter().map(|row| row.time).collect();
    let (factor, time_unit) = prefixed(self::largest(times.iter()), "s");
    times.iter_mut().for_each(|time| *time /= factor);
    Scaled { times, time_unit, curves, unit }
}

fn largest<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
    values.filter(|v| v.is_finite()).fold(0.0, |a, b| a.max(b.abs()))
}

fn draw(root: &Area, plot: &Plot, rows: &[Row]) -> Drawn {
    root.fill(&WHITE)?;
    let Scaled { times, time_unit, curves, unit } = scaled(plot, rows);
    let (left, right) = root.split_horizontally(SIZE.0 as i32 - LEGEND_WIDTH);
    let mut chart = ChartBuilder::on(&left)
        .caption(plot.title, font(20))
        .margin(12)
        .x_label_area_size(48)
        .y_label_area_size(72)
        .build_cartesian_2d(
            range(times.iter().copied(), false),
            Ticks(range(curves.iter().flatten().copied(), plot.logarithmic), plot.logarithmic),
        )?;
    let label = if unit == "1" { plot.quantity.to_string() } else { format!("{} ({unit})", plot.quantity) };
    chart
        .configure_mesh()
        .x_desc(format!("time ({time_unit})"))
        .y_desc(label)
        .axis_desc_style(font(15))
        .label_style(font(13))
        .axis_style(INK)
        .bold_line_style(RGBColor(225, 225, 225))
        .light_line_style(TRANSPARENT)
        .x_labels(7)
        .y_labels(7)
        .x_label_formatter(&|x| significant(*x))
        .y_label_formatter(&|y| if plot.logarithmic { power_of_ten(*y) } else { significant(*y) })
        .draw()?;
    for (k, (curve, colour)) in curves.iter().zip(COLOURS).enumerate() {
        let width = WIDTHS[curves.len() - 1 - k];
        let points: Vec<(f64, f64)> = times.iter().copied().zip(curve.iter().copied()).collect();
        // A value that is not defined parts the line.
        for part in points.split(|(_, y)| y.is_nan()).filter(|part| !part.is_empty()) {
            chart.draw_series(LineSeries::new(part.iter().copied(), colour.stroke_width(width)))?;
            if part.len() == 1 || points.len() <= MARKED {
                chart
                    .draw_series(part.iter().map(|point| Circle::new(*point, 2 + width as i32 / 2, colour.filled())))?;
            }
        }
    }
    legend(&right, plot, curves.iter().flatten().all(|y| y.is_nan()))
}

fn font(size: i32) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&INK)
}

/// Names the curves beside the plot, where no data can be under it.
fn legend(area: &Area, plot: &Plot, empty: bool) -> Drawn {
    let line = |k: usize| 60 + 24 * k as i32;
    for (k, ((_, name), colour)) in plot.curves.iter().zip(COLOURS).enumerate() {
        area.draw(&PathElement::new([(0, line(k)), (20, line(k))], colour.stroke_width(3)))?;
        area.draw(&Text::new(*name, (28, line(k) - 7), font(13)))?;
    }
    if empty {
        area.draw(&Text::new("no value", (28, line(plot.curves.len()) - 7), font(13)))?;
    }
    Ok(())
}

/// A range around the values that are there, never empty.
fn range(values: impl Iterator<Item = f64>, logarithmic: bool) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    if logarithmic {
        let (low, high) = ((low - 0.05).floor(), (high + 0.05).ceil()); // whole powers, to have marks
        return low..high;
    }
    // Values that are equal within round-off are one value.
    if high - low <= 1e-9 * low.abs().max(high.abs()) {
        let room = 0.1 * low.abs();
        return if room > 0.0 { low - room..high + room } else { -1.0..1.0 };
    }
    let room = 0.04 * (high - low);
    low - room..high + room
}

/// A linear axis; with `true`, of exponents, marked at whole ones.
struct Ticks(std::ops::Range<f64>, bool);

impl Ranged for Ticks {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        plotters::coord::types::RangedCoordf64::from(self.0.clone()).map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if !self.1 {
            return plotters::coord::types::RangedCoordf64::from(self.0.clone()).key_points(hint);
        }
        let (first, last) = (self.0.start.ceil() as i64, self.0.end.floor() as i64);
        let stride = ((last - first) / hint.max_num_points().clamp(1, 9) as i64 + 1).max(1);
        (first..=last).filter(|k| k.rem_euclid(stride) == 0).map(|k| k as f64).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.clone()
    }
}

fn power_of_ten(exponent: f64) -> String {
    format!("10{}", superscript(exponent as i32))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(times: &[f64], z: impl Fn(usize) -> f64) -> Vec<Row> {
        let row = |(k, time): (usize, &f64)| Row { time: *time, Z: z(k), Ec_mean: z(k), ..Row::default() };
        times.iter().enumerate().map(row).collect()
    }

    #[test]
    fn every_plot_can_be_drawn_of_anything() {
        let cases: [Vec<Row>; 6] = [
            vec![],
            rows(&[0.0], |_| 0.0),
            rows(&[0.0, 1.0, 2.0], |_| 4.2),
            rows(&[0.0, 1.0, 2.0], |_| f64::NAN),
            rows(&[0.0, 1e-9, 3e9], |k| [1e-300, f64::NAN, 1e300][k]),
            rows(&[5.0, 5.0], |k| [-1.0, 0.0][k]),
        ];
        for rows in cases {
            for plot in &PLOTS {
                let text = svg(plot, &rows);
                assert!(text.contains(plot.title) && text.ends_with("</svg>\n"), "{text}");
                assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            }
        }
    }

    #[test]
    fn axes_carry_units_and_gaps_part_the_line() {
        let text = svg(&PLOTS[1], &rows(&[0.0, 10.0, 20.0, 30.0, 40.0], |k| if k == 2 { f64::NAN } else { k as f64 }));
        assert!(text.contains("time (s)") && text.contains("no rattlers"));
        let lines = text.matches("stroke-width=\"4\"").count();
        assert_eq!(lines, 2, "{text}"); // of Z, before and after the gap
        let energy = svg(&PLOTS[0], &rows(&[0.0, 1.0], |k| [1e-3, 10.0][k]));
        assert!(energy.contains("energy (J)") && energy.contains("10⁻²"), "{energy}");
    }

    #[test]
    fn what_is_plotted_is_a_column() {
        for plot in &PLOTS {
            let units: Vec<&str> = plot
                .curves
                .iter()
                .map(|(name, _)| Row::COLUMNS.iter().find(|(known, _, _)| known == name).unwrap().1)
                .collect();
            assert!(units.iter().all(|unit| *unit == units[0]), "{}", plot.file);
        }
    }
}
