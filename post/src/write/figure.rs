//! Curves in a plot with axes and a legend, as SVG text.
//!
//! The SVG files name a font family and leave the letters to the viewer: no font is needed to
//! write them, and so the room for labels is by estimate.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use crate::write::scale::{prefixed, significant, superscript};

/// What an axis shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    pub quantity: String,
    /// "1" for a number without unit.
    pub unit: String,
    /// In powers of ten; values under 1e-14 of the largest, round-off, are left out.
    pub logarithmic: bool,
}

impl Axis {
    pub fn linear(quantity: &str, unit: &str) -> Axis {
        Axis { quantity: quantity.into(), unit: unit.into(), logarithmic: false }
    }

    pub fn logarithmic(quantity: &str, unit: &str) -> Axis {
        Axis { logarithmic: true, ..Axis::linear(quantity, unit) }
    }
}

/// One entry of the legend.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    pub name: String,
    /// In the units of the axes; a y that is not finite parts the line.
    pub points: Vec<(f64, f64)>,
    pub marks: Marks,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marks {
    /// A line, with dots if they are few.
    Line,
    /// Dots alone.
    Dots,
    /// A thin grey line: what is expected.
    Expected,
    /// A thin line in the colour of the curve before it, to which it is fitted.
    Fit,
    /// Dots with the name beside them, not in the legend.
    Named,
}

impl Curve {
    pub fn line(name: &str, points: Vec<(f64, f64)>) -> Curve {
        Curve { name: name.into(), points, marks: Marks::Line }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub curves: Vec<Curve>,
}

/// How a curve is drawn.
struct Style {
    colour: RGBColor,
    width: u32,
    /// Dashed, or open dots: a curve had this colour before.
    again: bool,
}

/// Length of a dash and of the gap behind it.
const DASH: u32 = 8;
const SIZE: (u32, u32) = (800, 450);
/// Of the strip beside the plot, at least; it grows with the names.
const LEGEND_WIDTH: i32 = 150;
/// Of a letter in the legend, at most.
const LETTER: i32 = 7;
/// Okabe & Ito (2008): told apart by colour-blind eyes too.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];
const INK: RGBColor = RGBColor(60, 60, 60);
const GREY: RGBColor = RGBColor(150, 150, 150);
/// More points than this are drawn as a line without marks.
const MARKED: usize = 30;
/// Share of the largest value below which a logarithmic axis shows nothing but round-off.
const ROUNDING: f64 = 1e-14;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

impl Figure {
    /// The text of the SVG file.
    pub fn svg(&self) -> String {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw(&root).expect("drawing into memory");
            root.present().expect("drawing into memory");
        }
        text
    }

    fn draw(&self, root: &Area) -> Drawn {
        root.fill(&WHITE)?;
        let (x_factor, x_unit) = scaling(&self.x, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.0)));
        let (y_factor, y_unit) = scaling(&self.y, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)));
        let x_least = least(&self.x, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.0)));
        let y_least = least(&self.y, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)));
        let curves: Vec<Vec<(f64, f64)>> = self
            .curves
            .iter()
            .map(|curve| {
                let scaled =
                    |&(x, y): &(f64, f64)| (drawn(&self.x, x, x_factor, x_least), drawn(&self.y, y, y_factor, y_least));
                curve.points.iter().map(scaled).filter(|(x, _)| !x.is_nan()).collect()
            })
            .collect();
        let longest = self.curves.iter().map(|curve| curve.name.chars().count() as i32).max().unwrap_or(0);
        let legend_width = (36 + LETTER * longest).clamp(LEGEND_WIDTH, SIZE.0 as i32 / 2);
        let (left, right) = root.split_horizontally(SIZE.0 as i32 - legend_width);
        let all = || curves.iter().flatten();
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, font(20))
            .margin(12)
            .x_label_area_size(48)
            .y_label_area_size(72)
            .build_cartesian_2d(
                Ticks(range(all().map(|p| p.0), self.x.logarithmic), self.x.logarithmic),
                Ticks(range(all().map(|p| p.1), self.y.logarithmic), self.y.logarithmic),
            )?;
        let label = |axis: &Axis, unit: &str| match unit {
            "1" => axis.quantity.clone(),
            unit => format!("{} ({unit})", axis.quantity),
        };
        let mark = |axis: &Axis, value: f64| if axis.logarithmic { power_of_ten(value) } else { significant(value) };
        chart
            .configure_mesh()
            .x_desc(label(&self.x, &x_unit))
            .y_desc(label(&self.y, &y_unit))
            .axis_desc_style(font(15))
            .label_style(font(13))
            .axis_style(INK)
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(TRANSPARENT)
            .x_labels(7)
            .y_labels(7)
            .x_label_formatter(&|x| mark(&self.x, *x))
            .y_label_formatter(&|y| mark(&self.y, *y))
            .draw()?;
        for (k, (curve, points)) in self.curves.iter().zip(&curves).enumerate() {
            let Style { colour, width, again } = self.style(k);
            let fill = if again { colour.stroke_width(1) } else { colour.filled() };
            let dot = |point: &(f64, f64)| Circle::new(*point, 2 + width as i32 / 2, fill);
            let defined = points.iter().filter(|(_, y)| !y.is_nan());
            if curve.marks == Marks::Named {
                // Names in turn above and below, as the dots may be near each other.
                let side = if k % 2 == 0 { -18 } else { 6 };
                let named = |point: &(f64, f64)| {
                    EmptyElement::at(*point)
                        + Circle::new((0, 0), 5, colour.filled())
                        + Text::new(curve.name.clone(), (6, side), font(13))
                };
                chart.draw_series(defined.map(named))?;
                continue;
            }
            if curve.marks == Marks::Dots {
                chart.draw_series(defined.map(dot))?;
                continue;
            }
            // A value that is not defined parts the line.
            for part in points.split(|(_, y)| y.is_nan()).filter(|part| !part.is_empty()) {
                let (way, stroke) = (part.iter().copied(), colour.stroke_width(width));
                if again {
                    chart.draw_series(DashedLineSeries::new(way, DASH, DASH, stroke))?;
                } else {
                    chart.draw_series(LineSeries::new(way, stroke))?;
                }
                if curve.marks == Marks::Line && (part.len() == 1 || points.len() <= MARKED) {
                    chart.draw_series(part.iter().map(dot))?;
                }
            }
        }
        self.legend(&right, all().all(|(_, y)| y.is_nan()))
    }

    /// The curves that are drawn first are wider, and where two are equal both are seen.
    fn style(&self, k: usize) -> Style {
        let coloured = |c: &&Curve| matches!(c.marks, Marks::Line | Marks::Dots);
        let before = self.curves[..k].iter().filter(coloured).count();
        let after = self.curves[k + 1..].iter().filter(|c| c.marks == Marks::Line).count();
        let of = |number: usize, width| Style {
            colour: COLOURS[number % COLOURS.len()],
            width,
            again: number / COLOURS.len() % 2 == 1,
        };
        match self.curves[k].marks {
            Marks::Expected => Style { colour: GREY, width: 1, again: false },
            Marks::Named => Style { colour: INK, width: 1, again: false },
            Marks::Fit => of(before.saturating_sub(1), 1),
            Marks::Line | Marks::Dots => of(before, (2 + 2 * after as u32).min(6)),
        }
    }

    /// Names the curves beside the plot, where no data can be under it.
    fn legend(&self, area: &Area, empty: bool) -> Drawn {
        let line = |k: usize| 60 + 24 * k as i32;
        let listed = self.curves.iter().enumerate().filter(|(_, curve)| curve.marks != Marks::Named);
        for (row, (k, curve)) in listed.enumerate() {
            let Style { colour, again, .. } = self.style(k);
            let stroke = |from: i32, to: i32, width: u32| {
                area.draw(&PathElement::new([(from, line(row)), (to, line(row))], colour.stroke_width(width)))
            };
            let width = if curve.marks == Marks::Line { 3 } else { 1 };
            match curve.marks {
                Marks::Named => {}
                Marks::Dots if again => area.draw(&Circle::new((10, line(row)), 4, colour.stroke_width(1)))?,
                Marks::Dots => area.draw(&Circle::new((10, line(row)), 4, colour.filled()))?,
                _ if again => {
                    stroke(0, 8, width)?;
                    stroke(12, 20, width)?;
                }
                _ => stroke(0, 20, width)?,
            }
            area.draw(&Text::new(curve.name.as_str(), (28, line(row) - 7), font(13)))?;
        }
        if empty {
            area.draw(&Text::new("no value", (28, line(self.curves.len()) - 7), font(13)))?;
        }
        Ok(())
    }
}

fn scaling(axis: &Axis, values: impl Iterator<Item = f64>) -> (f64, String) {
    if axis.logarithmic { (1.0, axis.unit.clone()) } else { prefixed(largest(values), &axis.unit) }
}

/// On a logarithmic axis, what is too small to be shown; else below everything.
fn least(axis: &Axis, values: impl Iterator<Item = f64>) -> f64 {
    if axis.logarithmic { ROUNDING * largest(values) } else { f64::NEG_INFINITY }
}

/// A value in the unit of the axis, or its exponent of ten; NaN where nothing is.
fn drawn(axis: &Axis, value: f64, factor: f64, least: f64) -> f64 {
    match axis.logarithmic {
        _ if !value.is_finite() || value <= least => f64::NAN,
        true => value.log10(),
        false => value / factor,
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.filter(|v| v.is_finite()).fold(0.0, |a, b| a.max(b.abs()))
}

fn font(size: i32) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&INK)
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

    fn figure(points: Vec<(f64, f64)>, logarithmic: bool) -> Figure {
        let y = Axis { quantity: "Z".into(), unit: "1".into(), logarithmic };
        Figure { title: "Title".into(), x: Axis::linear("time", "s"), y, curves: vec![Curve::line("all", points)] }
    }

    #[test]
    fn anything_can_be_drawn() {
        let cases: [Vec<(f64, f64)>; 6] = [
            vec![],
            vec![(0.0, 0.0)],
            vec![(0.0, 4.2), (1.0, 4.2), (2.0, 4.2)],
            vec![(0.0, f64::NAN), (f64::NAN, 1.0)],
            vec![(0.0, 1e-300), (1e-9, f64::INFINITY), (3e9, 1e300)],
            vec![(5.0, -1.0), (5.0, 0.0)],
        ];
        for points in cases {
            for logarithmic in [false, true] {
                let text = figure(points.clone(), logarithmic).svg();
                assert!(text.contains("Title") && text.ends_with("</svg>\n"), "{text}");
                assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            }
        }
    }

    #[test]
    fn a_fit_has_the_colour_of_its_dots() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        let of = |marks| Curve { marks, ..figure.curves[0].clone() };
        figure.curves = [Marks::Dots, Marks::Fit, Marks::Expected, Marks::Dots, Marks::Fit].map(of).to_vec();
        let styles: Vec<RGBColor> = (0..5).map(|k| figure.style(k).colour).collect();
        assert_eq!(styles, [COLOURS[0], COLOURS[0], GREY, COLOURS[1], COLOURS[1]]);
    }

    #[test]
    fn what_takes_a_colour_again_is_dashed() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        figure.curves = vec![figure.curves[0].clone(); COLOURS.len() + 1];
        let lines = |figure: &Figure| figure.svg().matches("<polyline").count();
        assert!(figure.style(7).again && figure.style(7).colour == figure.style(0).colour);
        // Each has its line and what stands for it in the legend; the last is in pieces.
        let dashed = lines(&figure);
        figure.curves.pop();
        assert!(dashed > lines(&figure) + 10, "{dashed} {}", lines(&figure));
        assert!(!figure.style(6).again);
    }

    #[test]
    fn a_value_that_is_not_defined_parts_the_line() {
        let y = [0.0, 1.0, f64::NAN, 3.0, 4.0];
        let text = figure((0..5).map(|k| (10.0 * k as f64, y[k])).collect(), false).svg();
        assert!(text.contains("time (s)"));
        assert_eq!(text.matches("stroke-width=\"2\"").count(), 2, "{text}");
    }
}
