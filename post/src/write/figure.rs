//! Curves in a plot with axes and a legend, as SVG text.
//!
//! The SVG files name a font family and leave the letters to the viewer: no font is needed to
//! write them, and so the room for labels is by estimate.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::element::DynElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::write::scale::{digits, prefixed, rounded, superscript};

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
    /// How many curves had this colour before: what they are told apart by is the kind of dashes or dots.
    again: usize,
}

/// Length of a dash and of the gap behind it, of curves that take a colour again.
const DASHES: [(u32, u32); 4] = [(8, 8), (2, 5), (14, 4), (3, 14)];
/// Forms of a dot, one after the other of curves that take a colour again.
const FORMS: usize = 4;
const SIZE: (u32, u32) = (800, 450);
/// Least width of what is beside the legend, and of a letter of the title: the picture gets wider where they ask for it.
const LEAST: i32 = 400;
const TITLE_LETTER: i32 = 10;
/// Of the strip beside the plot, at least; it grows with the names.
const LEGEND_WIDTH: i32 = 150;
/// Size of letters, and width of one, at most.
const LETTERS: i32 = 16;
const LETTER: i32 = 8;
/// Rows of a column of the legend, at most, from where on, and how far they are apart at most.
const ROWS: usize = 26;
const FIRST_ROW: i32 = 60;
const ROW: i32 = 24;
/// Radius of a dot with a name, and about that of others.
const NAMED: i32 = 5;
const DOT: i32 = 3;
/// From the middle of a dot to its name.
const NEAR: i32 = NAMED + 3;
/// Where a name may stand about its dot: steps to the right and down.
const AROUND: [(i32, i32); 8] = [(1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1)];
/// Marks of an axis, at most.
const MARKS: usize = 7;
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
    /// The text of the SVG file. Letters of names that XML does not know, such as an escape, are blanks.
    pub fn svg(&self) -> String {
        let mut text = String::new();
        let plot =
            (SIZE.0 as i32 - self.legend_width()).max(LEAST).max(TITLE_LETTER * self.title.chars().count() as i32);
        {
            let size = ((plot + self.legend_width()) as u32, SIZE.1);
            let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&root).expect("drawing into memory");
            root.present().expect("drawing into memory");
        }
        let unknown = |letter: char| match letter {
            '\t' | '\n' | '\r' => false,
            '\u{fffe}' | '\u{ffff}' => true,
            letter => letter < ' ',
        };
        text.replace(unknown, " ")
    }

    /// What is to be told of a figure with more curves than there are colours with dashes or forms of dots.
    pub fn alike(&self) -> Option<String> {
        let count = |marks: Marks| self.curves.iter().filter(|curve| curve.marks == marks).count();
        let coloured = count(Marks::Line) + count(Marks::Dots);
        let most = COLOURS.len() * if count(Marks::Dots) > 0 { FORMS } else { 1 + DASHES.len() };
        (coloured > most)
            .then(|| format!("{coloured} curves in one figure: no more than {most} are drawn unlike each other"))
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
        let (left, right) = root.split_horizontally(root.dim_in_pixel().0 as i32 - self.legend_width());
        let all = || curves.iter().flatten();
        let ticks = |axis: &Axis, values: &mut dyn Iterator<Item = f64>| {
            Ticks(range(values, axis.logarithmic), axis.logarithmic)
        };
        let (x_ticks, y_ticks) = (ticks(&self.x, &mut all().map(|p| p.0)), ticks(&self.y, &mut all().map(|p| p.1)));
        let (x_offset, y_offset) = (x_ticks.offset(), y_ticks.offset());
        let mut chart = ChartBuilder::on(&left)
            .caption(&self.title, font(20))
            .margin(12)
            .x_label_area_size(52)
            .y_label_area_size(82)
            .build_cartesian_2d(x_ticks.clone(), y_ticks.clone())?;
        let label = |axis: &Axis, unit: &str, offset: f64| {
            let less = match offset {
                0.0 => String::new(),
                _ => format!(" {} {}", if offset < 0.0 { "+" } else { "−" }, rounded(offset.abs(), 17)),
            };
            match unit {
                "1" => axis.quantity.clone() + &less,
                unit => format!("{}{less} ({unit})", axis.quantity),
            }
        };
        chart
            .configure_mesh()
            .x_desc(label(&self.x, &x_unit, x_offset))
            .y_desc(label(&self.y, &y_unit, y_offset))
            .axis_desc_style(font(18))
            .label_style(font(LETTERS))
            .axis_style(INK)
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(TRANSPARENT)
            .x_labels(MARKS)
            .y_labels(MARKS)
            .x_label_formatter(&|x| x_ticks.label(*x, x_offset))
            .y_label_formatter(&|y| y_ticks.label(*y, y_offset))
            .draw()?;
        for (k, (curve, points)) in self.curves.iter().zip(&curves).enumerate() {
            if curve.marks == Marks::Named {
                continue;
            }
            let Style { colour, width, again } = self.style(k);
            let size = 2 + width as i32 / 2;
            let dot = |point: &(f64, f64)| mark(*point, size, colour, again);
            if curve.marks == Marks::Dots {
                chart.draw_series(points.iter().filter(|(_, y)| !y.is_nan()).map(dot))?;
                continue;
            }
            // A value that is not defined parts the line.
            for part in points.split(|(_, y)| y.is_nan()).filter(|part| !part.is_empty()) {
                let (way, stroke) = (part.iter().copied(), colour.stroke_width(width));
                match dashes(again) {
                    Some((dash, gap)) => drop(chart.draw_series(DashedLineSeries::new(way, dash, gap, stroke))?),
                    None => drop(chart.draw_series(LineSeries::new(way, stroke))?),
                }
                if curve.marks == Marks::Line && (part.len() == 1 || points.len() <= MARKED) {
                    chart.draw_series(part.iter().map(dot))?;
                }
            }
        }
        // Over the lines: the dots that have names, and these.
        let seen = |named: bool| {
            let curves =
                self.curves.iter().zip(&curves).filter(move |(curve, _)| (curve.marks == Marks::Named) == named);
            let points = curves.flat_map(|(curve, points)| points.iter().map(|point| (curve.name.as_str(), *point)));
            points.filter(|(_, (_, y))| !y.is_nan())
        };
        let about = |point: (f64, f64), half: i32| Rectangle::about(chart.backend_coord(&point), half);
        let others = self.curves.iter().zip(&curves).filter(|(c, _)| !matches!(c.marks, Marks::Named | Marks::Dots));
        let pieces = others.flat_map(|(_, points)| points.windows(2)).filter(|ends| ends.iter().all(|p| !p.1.is_nan()));
        let (across, down) = chart.plotting_area().get_pixel_range();
        let mut room = Room {
            plot: Rectangle { left: across.start, upper: down.start, right: across.end, lower: down.end },
            names: seen(true).map(|(_, point)| about(point, NAMED)).collect(),
            dots: seen(false).map(|(_, point)| about(point, DOT)).collect(),
            lines: pieces.flat_map(|ends| along([ends[0], ends[1]].map(|point| chart.backend_coord(&point)))).collect(),
        };
        let mut name = |(name, point): (&str, (f64, f64))| {
            let place = chart.backend_coord(&point);
            let (side, around) = room.beside(place, name.chars().count() as i32);
            room.names.push(around);
            let corners = [(around.left, around.upper), (around.right, around.lower)];
            let corners = corners.map(|(x, y)| (x - place.0, y - place.1));
            let ground = plotters::element::Rectangle::new(corners, WHITE.mix(0.8).filled());
            // Letters may be narrower than their room: they begin or end at the dot.
            let anchor = [HPos::Right, HPos::Center, HPos::Left][(1 + side) as usize];
            let style = font(LETTERS).pos(Pos::new(anchor, VPos::Top));
            EmptyElement::at(point) + ground + Text::new(name.to_string(), (side * NEAR, corners[0].1), style)
        };
        let names: Vec<_> = seen(true).map(&mut name).collect();
        chart.draw_series(names)?;
        chart.draw_series(seen(true).map(|(_, point)| Circle::new(point, NAMED, INK.filled())))?;
        self.legend(&right)
    }

    /// What stands in the legend: the curve's number and name.
    fn listed(&self) -> Vec<(usize, String)> {
        let listed = self.curves.iter().enumerate().filter(|(_, curve)| curve.marks != Marks::Named);
        let all = || self.curves.iter().flat_map(|curve| &curve.points);
        let (x_least, y_least) = (least(&self.x, all().map(|p| p.0)), least(&self.y, all().map(|p| p.1)));
        let name = |(k, curve): (usize, &Curve)| {
            let seen = |axis: &Axis, value: f64, least: f64| !drawn(axis, value, 1.0, least).is_nan();
            let valued = curve.points.iter().any(|(x, y)| seen(&self.x, *x, x_least) && seen(&self.y, *y, y_least));
            (k, if valued { curve.name.clone() } else { format!("{} (no value)", curve.name) })
        };
        listed.map(name).collect()
    }

    fn legend_width(&self) -> i32 {
        let listed = self.listed();
        let longest = listed.iter().map(|(_, name)| name.chars().count() as i32).max().unwrap_or(0);
        ((36 + LETTER * longest) * listed.len().div_ceil(ROWS) as i32).max(LEGEND_WIDTH)
    }

    /// The curves that are drawn first are wider, and where two are equal both are seen.
    fn style(&self, k: usize) -> Style {
        let coloured = |c: &&Curve| matches!(c.marks, Marks::Line | Marks::Dots);
        let before = self.curves[..k].iter().filter(coloured).count();
        let after = self.curves[k + 1..].iter().filter(|c| c.marks == Marks::Line).count();
        let of = |number: usize, width| Style {
            colour: COLOURS[number % COLOURS.len()],
            width,
            again: number / COLOURS.len(),
        };
        // Of many curves wide ones would hide what the others do.
        let lines = self.curves.iter().filter(|c| c.marks == Marks::Line).count();
        let widest = if lines < 4 { 6 } else { 3 };
        match self.curves[k].marks {
            Marks::Expected => Style { colour: GREY, width: 1, again: 0 },
            Marks::Named => Style { colour: INK, width: 1, again: 0 },
            Marks::Fit => of(before.saturating_sub(1), 1),
            Marks::Line | Marks::Dots => of(before, (2 + 2 * after as u32).min(widest)),
        }
    }

    /// Names the curves beside the plot, where no data can be under it.
    fn legend(&self, area: &Area) -> Drawn {
        let listed = self.listed();
        let columns = listed.len().div_ceil(ROWS).max(1);
        let rows = listed.len().div_ceil(columns).max(1);
        let wide = self.legend_width() / columns as i32;
        let high = ((SIZE.1 as i32 - FIRST_ROW) / rows as i32).min(ROW);
        for (place, (k, name)) in listed.iter().enumerate() {
            let (left, y) = (wide * (place / rows) as i32, FIRST_ROW + high * (place % rows) as i32);
            let (Style { colour, again, .. }, marks) = (self.style(*k), self.curves[*k].marks);
            let width = if marks == Marks::Line { 3 } else { 1 };
            let stroke = |from: i32, to: i32| {
                area.draw(&PathElement::new([(left + from, y), (left + to, y)], colour.stroke_width(width)))
            };
            match (marks, dashes(again)) {
                (Marks::Named, _) => {}
                (Marks::Dots, _) => area.draw(&mark((left + 10, y), 4, colour, again))?,
                (_, None) => stroke(0, 20)?,
                (_, Some((dash, gap))) => {
                    // Half as long, so that two are seen.
                    let (dash, gap) = (dash as i32, (gap as i32 / 2).max(3));
                    (0..20).step_by((dash + gap) as usize).try_for_each(|from| stroke(from, (from + dash).min(20)))?;
                }
            }
            area.draw(&Text::new(name.as_str(), (left + 28, y - 8), font(LETTERS)))?;
        }
        if listed.is_empty() && self.curves.is_empty() {
            area.draw(&Text::new("no value", (28, FIRST_ROW - 8), font(LETTERS)))?;
        }
        Ok(())
    }
}

/// Part of the picture, from the left and from above, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rectangle {
    left: i32,
    upper: i32,
    right: i32,
    lower: i32,
}

impl Rectangle {
    fn about((x, y): (i32, i32), half: i32) -> Rectangle {
        Rectangle { left: x - half, upper: y - half, right: x + half, lower: y + half }
    }

    fn meets(&self, other: &Rectangle) -> bool {
        self.left < other.right && other.left < self.right && self.upper < other.lower && other.upper < self.lower
    }

    fn holds(&self, other: &Rectangle) -> bool {
        self.left <= other.left && other.right <= self.right && self.upper <= other.upper && other.lower <= self.lower
    }
}

/// The plot, and what is in it: names and the dots that have one, on which no name may lie, the other dots, and lines.
struct Room {
    plot: Rectangle,
    names: Vec<Rectangle>,
    dots: Vec<Rectangle>,
    lines: Vec<Rectangle>,
}

impl Room {
    /// Where a name of so many letters stands about its dot, and on which side: 1 right, -1 left, else 0. Of the places in the
    /// plot that are [`AROUND`] it, or farther away, the first that meets the fewest names, then the fewest dots, of which one
    /// counts as much as half a row of letters farther away, then the least of lines.
    fn beside(&self, (x, y): (i32, i32), letters: i32) -> (i32, Rectangle) {
        let (wide, high) = (LETTER * letters / 2, 8);
        let place = |away: i32, (across, down): (i32, i32)| {
            let (x, y) = (x + across * (wide + NEAR), y + down * (high + NEAR + high * away));
            (away as usize, across, Rectangle { left: x - wide, upper: y - high, right: x + wide, lower: y + high })
        };
        let cost = |(away, _, place): &(usize, i32, Rectangle)| {
            let met = |all: &[Rectangle]| all.iter().filter(|other| place.meets(other)).count();
            (!self.plot.holds(place), met(&self.names), met(&self.dots) + away, met(&self.lines))
        };
        let places = (0..12).flat_map(|away| AROUND.map(|direction| place(away, direction)));
        let (_, side, place) = places.min_by_key(cost).expect("there are places");
        (side, place)
    }
}

/// Pieces of the line between two places, one in five pixels.
fn along([a, b]: [(i32, i32); 2]) -> impl Iterator<Item = Rectangle> {
    let count = ((b.0 - a.0).abs().max((b.1 - a.1).abs()) / 5).max(1);
    (0..=count).map(move |k| Rectangle::about((a.0 + (b.0 - a.0) * k / count, a.1 + (b.1 - a.1) * k / count), 1))
}

fn dashes(again: usize) -> Option<(u32, u32)> {
    Some(DASHES[again.checked_sub(1)? % DASHES.len()])
}

/// A dot, full the first time that its colour is taken, then open, then of another form.
fn mark<'a, Coord: Clone + 'static>(
    at: Coord,
    size: i32,
    colour: RGBColor,
    again: usize,
) -> DynElement<'static, SVGBackend<'a>, Coord> {
    match again % FORMS {
        0 => Circle::new(at, size, colour.filled()).into_dyn(),
        1 => Circle::new(at, size, colour.stroke_width(1)).into_dyn(),
        2 => TriangleMarker::new(at, size + 1, colour.filled()).into_dyn(),
        _ => Cross::new(at, size, colour.stroke_width(1)).into_dyn(),
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
        // To a mark, so that no end is without one: whole powers, or what lies between where they are few.
        let (low, high) = (low - 0.05, high + 0.05);
        let whole = low.floor()..high.ceil();
        if !few(&whole) {
            return whole;
        }
        let marks: Vec<f64> = between(&whole).collect();
        let below = marks.iter().rev().find(|mark| **mark <= low);
        let above = marks.iter().find(|mark| **mark >= high);
        return *below.unwrap_or(&whole.start)..*above.unwrap_or(&whole.end);
    }
    // Values that are equal within round-off are one value.
    // By halves: the whole may be more than a number holds.
    let half = 0.5 * high - 0.5 * low;
    let room = match low.abs().max(high.abs()) {
        0.0 => 1.0,
        equal if half <= 0.5e-9 * equal => 0.1 * equal,
        _ => 0.08 * half,
    };
    (low - room).max(f64::MIN)..(high + room).min(f64::MAX)
}

/// So few powers of ten that twice and five times them are marked, too.
fn few(exponents: &std::ops::Range<f64>) -> bool {
    exponents.end - exponents.start < 2.5
}

/// The exponents of 1, 2 and 5 times powers of ten of a range, both ends included.
fn between(exponents: &std::ops::Range<f64>) -> impl Iterator<Item = f64> {
    let (from, to) = (exponents.start, exponents.end);
    let whole = from.floor() as i32..=to.ceil() as i32;
    let marks = whole.flat_map(|power| [1f64, 2.0, 5.0].map(|m| f64::from(power) + m.log10()));
    marks.filter(move |mark| (from..=to).contains(mark))
}

/// A linear axis; with `true`, of exponents, marked at whole ones.
#[derive(Clone)]
struct Ticks(std::ops::Range<f64>, bool);

impl Ticks {
    /// Between marks of a linear axis: the least of 1, 2, 5 times a power of ten that makes at most so many.
    fn step(&self, most: usize) -> f64 {
        let half = 0.5 * self.0.end - 0.5 * self.0.start;
        let decade = (half.log10() + (2.0 / (most + 1) as f64).log10()).floor() as i32;
        let steps = (decade..).flat_map(|decade| [1.0, 2.0, 5.0].map(|m| (m, decade)));
        // As written in the decimal system, not as a product.
        let mut steps = steps.map(|(m, decade)| format!("{m}e{decade}").parse().unwrap_or(f64::INFINITY));
        let few = |step: &f64| (self.0.end / step).floor() - (self.0.start / step).ceil() < most as f64;
        steps.find(few).unwrap_or(f64::INFINITY)
    }

    /// What marks are told without: where more than six digits of all are the same, the round number in the middle; else 0.
    fn offset(&self) -> f64 {
        let (low, high) = (self.0.start, self.0.end);
        if self.1 || digits(low.abs().max(high.abs()), self.step(MARKS)) <= 7 {
            return 0.0;
        }
        let decade = 10f64.powi((high - low).log10().ceil() as i32);
        let middle = 0.5 * low + 0.5 * high;
        // Without the rounding of a product.
        rounded(middle, digits(middle.abs(), decade)).parse().unwrap_or(0.0)
    }

    fn label(&self, value: f64, offset: f64) -> String {
        if self.1 {
            return if few(&self.0) { number(value) } else { power_of_ten(value) };
        }
        let step = self.step(MARKS);
        let value = ((value - offset) / step).round() * step;
        rounded(value, digits(value.abs(), step).clamp(6, 17))
    }
}

impl Ranged for Ticks {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        // By halves, as above.
        plotters::coord::types::RangedCoordf64::from(0.5 * self.0.start..0.5 * self.0.end).map(&(0.5 * value), limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if !self.1 {
            let step = self.step(hint.max_num_points().max(2));
            let (first, last) = ((self.0.start / step).ceil() as i64, (self.0.end / step).floor() as i64);
            return (first..=last).map(|k| k as f64 * step).collect();
        }
        if few(&self.0) {
            return between(&self.0).collect();
        }
        let (first, last) = (self.0.start.ceil() as i64, self.0.end.floor() as i64);
        let stride = ((last - first) / hint.max_num_points().clamp(1, 9) as i64 + 1).max(1);
        (first..=last).filter(|k| k.rem_euclid(stride) == 0).map(|k| k as f64).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.0.clone()
    }
}

/// 10 to the exponent in one digit and zeros, though it be more than a number holds.
fn number(exponent: f64) -> String {
    let power = exponent.floor();
    let digit = 10f64.powf(exponent - power).round();
    if power < 300.0 { rounded(digit * 10f64.powf(power), 1) } else { format!("{digit}e{power}") }
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
            vec![(5.0, -1.0), (f64::MAX, f64::MAX), (5.0, 0.0)],
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
        assert!(figure.style(7).again == 1 && figure.style(7).colour == figure.style(0).colour);
        // Each has its line and what stands for it in the legend; the last is in pieces.
        let dashed = lines(&figure);
        figure.curves.pop();
        assert!(dashed > lines(&figure) + 10, "{dashed} {}", lines(&figure));
        assert_eq!(figure.style(6).again, 0);
    }

    /// The texts of a figure that stand one above the other at the same place of the picture as marks do, from below.
    fn marks(text: &str, anchor: &str) -> Vec<String> {
        let mut lines = text.lines().peekable();
        let mut found = Vec::new();
        while let Some(line) = lines.next() {
            if line.starts_with("<text") && line.contains(anchor) {
                found.extend(lines.peek().map(|text| text.to_string()));
            }
        }
        found
    }

    #[test]
    fn marks_tell_values_apart_that_differ_little() {
        let of = |values: [f64; 2]| {
            let text = figure(values.iter().enumerate().map(|(k, y)| (k as f64, *y)).collect(), false).svg();
            (marks(&text, "text-anchor=\"end\""), text)
        };
        let (labels, _) = of([200.0, 200.001]);
        assert!(labels.contains(&"200.0004".to_string()) && labels.contains(&"200".to_string()), "{labels:?}");
        let (labels, text) = of([200.0, 200.00001]);
        assert!(labels.contains(&"0".to_string()) && labels.contains(&"4e-6".to_string()), "{labels:?}");
        assert!(text.contains("Z − 200\n"), "{text}");
        // A mark at zero, and what is more than a number holds.
        let (labels, _) = of([-0.3, 0.1]);
        assert_eq!(labels, ["-0.3", "-0.2", "-0.1", "0", "0.1"]);
        let (labels, _) = of([-1e308, 1e308]);
        assert!(labels.len() > 2 && labels.contains(&"5e307".to_string()), "{labels:?}");
    }

    #[test]
    fn logarithmic_axes_are_marked_at_least_twice_and_at_their_ends() {
        let of = |values: [f64; 2]| {
            let text = figure(values.iter().enumerate().map(|(k, y)| (k as f64, *y)).collect(), true).svg();
            marks(&text, "text-anchor=\"end\"")
        };
        assert_eq!(of([0.003, 0.014]), ["0.002", "0.005", "0.01", "0.02"]);
        assert_eq!(of([3.0, 3.0]), ["2", "5"]);
        assert_eq!(of([0.03, 60.0]), ["10⁻²", "10⁻¹", "10⁰", "10¹", "10²"]);
    }

    #[test]
    fn a_legend_of_many_stays_in_the_picture() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        let line = figure.curves[0].clone();
        figure.curves = (0..60).map(|k| Curve { name: format!("run {k} of sixty"), ..line.clone() }).collect();
        figure.curves.push(Curve::line("last", vec![(0.0, f64::NAN)]));
        let text = figure.svg();
        let place = |line: &str, name: &str| -> f64 {
            line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let width = place(text.lines().next().unwrap(), "width");
        let lines: Vec<&str> = text.lines().collect();
        let named: Vec<(f64, f64)> = lines
            .windows(2)
            .filter(|pair| pair[1].contains("of sixty") || pair[1].contains("last (no value)"))
            .map(|pair| (place(pair[0], "x"), place(pair[0], "y")))
            .collect();
        assert_eq!(named.len(), 61);
        assert!(named.iter().all(|(x, y)| x + 16.0 * f64::from(LETTER) <= width && *y < 445.0), "{width} {named:?}");
        // No two are drawn alike, nor is any wide.
        let styles: Vec<Style> = (0..28).map(|k| figure.style(k)).collect();
        let alike = |a: &Style, b: &Style| a.colour == b.colour && dashes(a.again) == dashes(b.again);
        assert!((0..28).all(|k| (0..k).all(|j| !alike(&styles[j], &styles[k])) && styles[k].width <= 3));
    }

    #[test]
    fn more_curves_than_styles_are_told() {
        let mut figure = figure(vec![(0.0, 1.0)], false);
        figure.curves = vec![figure.curves[0].clone(); 35];
        assert_eq!(figure.alike(), None);
        figure.curves.push(figure.curves[0].clone());
        let told = figure.alike().unwrap();
        assert!(told.starts_with("36 curves") && told.contains(" 35 "), "{told}");
        figure.curves = vec![Curve { marks: Marks::Dots, ..figure.curves[0].clone() }; 29];
        assert!(figure.alike().unwrap().contains(" 28 "));
    }

    #[test]
    fn names_of_dots_that_are_near_each_other_do_not_touch() {
        let mut figure = figure(Vec::new(), false);
        let names = ["LMGC90", "narrow_phase", "adaptive", "gravity_refresh", "draft"];
        let dot = |(k, name): (usize, &&str)| Curve {
            marks: Marks::Named,
            ..Curve::line(name, vec![(1.0 + 0.01 * k as f64, 1.0 + 0.01 * (k % 2) as f64)])
        };
        let last = Curve { marks: Marks::Named, ..Curve::line("at the right end", vec![(3.0, 5.0)]) };
        figure.curves = names.iter().enumerate().map(dot).chain([last]).collect();
        let text = figure.svg();
        let lines: Vec<&str> = text.lines().collect();
        let place = |line: &str, name: &str| -> i32 {
            line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let grounds = lines.iter().filter(|line| line.contains("opacity=\"0.8\""));
        let boxes: Vec<Rectangle> = grounds
            .map(|line| {
                let (left, upper) = (place(line, "x"), place(line, "y"));
                Rectangle { left, upper, right: left + place(line, "width"), lower: upper + place(line, "height") }
            })
            .collect();
        assert_eq!(boxes.len(), 6, "{text}");
        assert!((0..6).all(|k| (0..k).all(|j| !boxes[j].meets(&boxes[k]))), "{boxes:?}");
        let plot = SIZE.0 as i32 - figure.legend_width();
        assert!(boxes.iter().all(|name| name.right <= plot), "{boxes:?}");
    }

    #[test]
    fn a_name_hides_few_dots_and_less_of_lines() {
        let plot = Rectangle { left: 0, upper: 0, right: 400, lower: 200 };
        let mut room = Room { plot, names: Vec::new(), dots: Vec::new(), lines: Vec::new() };
        let side = |room: &Room| room.beside((200, 100), 5).0;
        assert_eq!(side(&room), 1);
        room.lines = along([(200, 100), (300, 100)]).collect();
        assert_eq!(side(&room), -1);
        room.dots = vec![Rectangle::about((180, 100), DOT)];
        let (side, place) = room.beside((200, 100), 5);
        assert!(side == 0 && place.lower < 100, "{place:?}");
        // At the left end only what is right of the dot is in the plot.
        assert_eq!(room.beside((5, 100), 5).0, 1);
    }

    #[test]
    fn a_curve_of_round_off_alone_has_no_value() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], true);
        figure.curves.push(Curve::line("rotation", vec![(0.0, 1e-15), (1.0, 1.9e-14)]));
        assert_eq!(figure.listed(), [(0, "all".into()), (1, "rotation (no value)".into())]);
        figure.curves[1].points[0].1 = 2.1e-14;
        assert_eq!(figure.listed()[1].1, "rotation");
    }

    #[test]
    fn what_xml_does_not_know_is_blank() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        (figure.title, figure.curves[0].name) = ("Error \u{1b}[1m\u{ffff}".into(), "a\u{0}b".into());
        let text = figure.svg();
        assert!(text.contains("Error  [1m ") && text.contains("a b"), "{text}");
    }

    #[test]
    fn a_value_that_is_not_defined_parts_the_line() {
        let y = [0.0, 1.0, f64::NAN, 3.0, 4.0];
        let text = figure((0..5).map(|k| (10.0 * k as f64, y[k])).collect(), false).svg();
        assert!(text.contains("time (s)"));
        assert_eq!(text.matches("stroke-width=\"2\"").count(), 2, "{text}");
    }
}
