//! Curves in a plot with axes and a legend, as SVG text.
//!
//! The SVG files name a font family and leave the letters to the viewer. No font is needed to write them, and so the size
//! of labels is estimated.

use plotters::coord::ranged1d::BoldPoints;
use plotters::element::DynElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

mod axis;
mod labels;

pub use axis::FigureAxis;

use crate::write::scale::format_digits;
use axis::{AxisTicks, MAX_AXIS_MARKS, axis_range, axis_scaling, axis_value, smallest_shown};
use labels::{LETTER_WIDTH, LabelSpace, NAME_DISTANCE, NAMED_DOT_RADIUS, PixelRect, line_rectangles};

/// One entry of the legend.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    pub name: String,
    /// Points in the units of the axes; a y that is not finite interrupts the line.
    pub points: Vec<(f64, f64)>,
    pub marks: CurveMarks,
}

/// Marks with which a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CurveMarks {
    /// A line, with dots if they are few.
    Line,
    /// Dots alone.
    Dots,
    /// Thin grey line of expected values.
    Expected,
    /// A thin line in the colour of the curve before it, to which it is fitted.
    Fit,
    /// Dots with the name next to them, not in the legend.
    Named,
    /// Thin lines in the colour of the curve before it, whose points they are the errors of; not in the legend.
    ErrorBars,
}

impl CurveMarks {
    /// Whether the legend has an entry.
    fn is_listed(self) -> bool {
        !matches!(self, CurveMarks::Named | CurveMarks::ErrorBars)
    }
}

impl Curve {
    /// Curve through points.
    pub fn line(name: &str, points: Vec<(f64, f64)>) -> Curve {
        Curve { name: name.into(), points, marks: CurveMarks::Line }
    }
}

/// Curves in two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub title: String,
    pub x: FigureAxis,
    pub y: FigureAxis,
    pub curves: Vec<Curve>,
}

/// Colour, width and repetition of a curve.
struct CurveStyle {
    colour: RGBColor,
    width: u32,
    /// Number of earlier curves with this colour; the kind of dashes or dots distinguishes them.
    repeat: usize,
}

/// Lengths of a dash and of the gap after it, for curves that repeat a colour.
const DASH_PATTERNS: [(u32, u32); 4] = [(8, 8), (2, 5), (14, 4), (3, 14)];
/// Number of dot shapes, used in turn by curves that repeat a colour.
const DOT_FORMS: usize = 4;
const FIGURE_SIZE: (u32, u32) = (800, 450);
/// Least width of the plot without the legend, and width of a letter of the title; the picture is widened for longer
/// titles.
const MIN_PLOT_WIDTH: i32 = 400;
const TITLE_LETTER: i32 = 10;
/// Height above the plot, which contains the title, and the title's distance from the border, pixels.
const TITLE_HEIGHT: i32 = 46;
const TITLE_TOP: i32 = 13;
/// Height of the name of the vertical axis with margins, and largest width of a letter of its marks, pixels.
const AXIS_NAME_HEIGHT: i32 = 44;
const MARK_LETTER: i32 = 9;
/// Least width of the legend; it grows with the names.
const LEGEND_WIDTH: i32 = 150;
/// Font size, in pixels.
const FONT_SIZE: i32 = 16;
/// Largest number of rows in a column of the legend, position of the first row, and largest distance of rows.
const LEGEND_ROWS: usize = 26;
const FIRST_ROW: i32 = 60;
const ROW_HEIGHT: i32 = 24;
/// Approximate radius of a dot without a name, in pixels.
const DOT_RADIUS: i32 = 3;
/// Okabe & Ito (2008): distinguishable by colour-blind readers.
const CURVE_COLOURS: [RGBColor; 7] = [
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
/// Largest number of points of a line with marks.
const MAX_MARKED_POINTS: usize = 30;

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type DrawResult = Result<(), Box<dyn std::error::Error>>;

impl Figure {
    /// Text of the SVG file. Characters of names that XML does not allow, such as an escape, are replaced by blanks.
    pub fn to_svg(&self) -> String {
        let mut text = String::new();
        let plot = (FIGURE_SIZE.0 as i32 - self.legend_width())
            .max(MIN_PLOT_WIDTH)
            .max(TITLE_LETTER * self.title.chars().count() as i32);
        {
            let size = ((plot + self.legend_width()) as u32, FIGURE_SIZE.1);
            let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&root).expect("drawing into memory");
            root.present().expect("drawing into memory");
        }
        let is_unprintable = |letter: char| match letter {
            '\t' | '\n' | '\r' => false,
            '\u{fffe}' | '\u{ffff}' => true,
            letter => letter < ' ',
        };
        text.replace(is_unprintable, " ")
    }

    /// Warning about a figure with more curves than combinations of colours with dashes or dot shapes.
    pub fn repeated_style_warning(&self) -> Option<String> {
        let count = |marks: CurveMarks| self.curves.iter().filter(|curve| curve.marks == marks).count();
        let coloured = count(CurveMarks::Line) + count(CurveMarks::Dots);
        let style_count =
            CURVE_COLOURS.len() * if count(CurveMarks::Dots) > 0 { DOT_FORMS } else { 1 + DASH_PATTERNS.len() };
        (coloured > style_count)
            .then(|| format!("{coloured} curves in one figure: only {style_count} styles can be distinguished"))
    }

    /// Points of the curves in the units of the axes, and these units. A point that the axis of x cannot show is left out.
    fn scaled_curves(&self) -> (Vec<Vec<(f64, f64)>>, [String; 2]) {
        let (x_factor, x_unit) = axis_scaling(&self.x, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.0)));
        let (y_factor, y_unit) = axis_scaling(&self.y, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)));
        let x_least = smallest_shown(&self.x, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.0)));
        let y_least = smallest_shown(&self.y, self.curves.iter().flat_map(|c| c.points.iter().map(|p| p.1)));
        let curves = self
            .curves
            .iter()
            .map(|curve| {
                let scaled_point = |&(x, y): &(f64, f64)| {
                    (axis_value(&self.x, x, x_factor, x_least), axis_value(&self.y, y, y_factor, y_least))
                };
                curve.points.iter().map(scaled_point).filter(|(x, _)| !x.is_nan()).collect()
            })
            .collect();
        (curves, [x_unit, y_unit])
    }

    fn draw(&self, root: &Area) -> DrawResult {
        root.fill(&WHITE)?;
        let (curves, [x_unit, y_unit]) = self.scaled_curves();
        let (left, right) = root.split_horizontally(root.dim_in_pixel().0 as i32 - self.legend_width());
        let all_points = || curves.iter().flatten();
        let ticks = |axis: &FigureAxis, values: &mut dyn Iterator<Item = f64>| AxisTicks {
            range: axis_range(values, axis.logarithmic),
            logarithmic: axis.logarithmic,
        };
        let (x_ticks, y_ticks) =
            (ticks(&self.x, &mut all_points().map(|p| p.0)), ticks(&self.y, &mut all_points().map(|p| p.1)));
        let (x_offset, y_offset) = (x_ticks.label_offset(), y_ticks.label_offset());
        let marks = y_ticks.key_points(BoldPoints(MAX_AXIS_MARKS));
        let longest = marks.iter().map(|mark| y_ticks.tick_label(*mark, y_offset).chars().count() as i32).max();
        let mut chart = ChartBuilder::on(&left)
            .margin(12)
            .margin_top(TITLE_HEIGHT)
            .x_label_area_size(52)
            .y_label_area_size(AXIS_NAME_HEIGHT + MARK_LETTER * longest.unwrap_or(0))
            .build_cartesian_2d(x_ticks.clone(), y_ticks.clone())?;
        chart
            .configure_mesh()
            .x_desc(axis_label(&self.x, &x_unit, x_offset))
            .y_desc(axis_label(&self.y, &y_unit, y_offset))
            .axis_desc_style(font_style(18))
            .label_style(font_style(FONT_SIZE))
            .axis_style(INK)
            .bold_line_style(RGBColor(225, 225, 225))
            .light_line_style(TRANSPARENT)
            .x_labels(MAX_AXIS_MARKS)
            .y_labels(MAX_AXIS_MARKS)
            .x_label_formatter(&|x| x_ticks.tick_label(*x, x_offset))
            .y_label_formatter(&|y| y_ticks.tick_label(*y, y_offset))
            .draw()?;
        // Centred on the plot.
        let (across, _) = chart.plotting_area().get_pixel_range();
        let style = font_style(20).pos(Pos::new(HPos::Center, VPos::Top));
        root.draw(&Text::new(self.title.as_str(), ((across.start + across.end) / 2, TITLE_TOP), style))?;
        for (k, (curve, points)) in self.curves.iter().zip(&curves).enumerate() {
            if curve.marks == CurveMarks::Named {
                continue;
            }
            let CurveStyle { colour, width, repeat } = self.curve_style(k);
            let size = 2 + width as i32 / 2;
            let dot = |point: &(f64, f64)| draw_dot(*point, size, colour, repeat);
            if curve.marks == CurveMarks::Dots {
                chart.draw_series(points.iter().filter(|(_, y)| !y.is_nan()).map(dot))?;
                continue;
            }
            // A value that is not defined parts the line.
            for part in points.split(|(_, y)| y.is_nan()).filter(|part| !part.is_empty()) {
                let (path, stroke) = (part.iter().copied(), colour.stroke_width(width));
                match dash_pattern(repeat) {
                    Some((dash, gap)) => drop(chart.draw_series(DashedLineSeries::new(path, dash, gap, stroke))?),
                    None => drop(chart.draw_series(LineSeries::new(path, stroke))?),
                }
                if curve.marks == CurveMarks::Line && (part.len() == 1 || points.len() <= MAX_MARKED_POINTS) {
                    chart.draw_series(part.iter().map(dot))?;
                }
            }
        }
        // Dots are drawn over the lines.
        let points_of = |are_named: bool| {
            let is_chosen = move |curve: &Curve| (curve.marks == CurveMarks::Named) == are_named;
            let curves = self.curves.iter().zip(&curves).filter(move |(curve, _)| is_chosen(curve));
            let points = curves.flat_map(|(curve, points)| points.iter().map(|point| (curve.name.as_str(), *point)));
            points.filter(|(_, (_, y))| !y.is_nan())
        };
        let named_points = || points_of(true);
        let square_around = |point: (f64, f64), half: i32| PixelRect::centred_at(chart.backend_coord(&point), half);
        let others =
            self.curves.iter().zip(&curves).filter(|(c, _)| !matches!(c.marks, CurveMarks::Named | CurveMarks::Dots));
        let line_pieces =
            others.flat_map(|(_, points)| points.windows(2)).filter(|ends| ends.iter().all(|p| !p.1.is_nan()));
        let (across, down) = chart.plotting_area().get_pixel_range();
        let mut label_space = LabelSpace {
            plot: PixelRect { left: across.start, upper: down.start, right: across.end, lower: down.end },
            names: named_points().map(|(_, point)| square_around(point, NAMED_DOT_RADIUS)).collect(),
            dots: points_of(false).map(|(_, point)| square_around(point, DOT_RADIUS)).collect(),
            lines: line_pieces
                .flat_map(|ends| line_rectangles([ends[0], ends[1]].map(|point| chart.backend_coord(&point))))
                .collect(),
        };
        let mut name = |(name, point): (&str, (f64, f64))| {
            let dot_position = chart.backend_coord(&point);
            let (side, name_rect) = label_space.place_name(dot_position, name.chars().count() as i32);
            label_space.names.push(name_rect);
            let corners = [(name_rect.left, name_rect.upper), (name_rect.right, name_rect.lower)];
            let corners = corners.map(|(x, y)| (x - dot_position.0, y - dot_position.1));
            let background = plotters::element::Rectangle::new(corners, WHITE.mix(0.8).filled());
            // Letters may be narrower than the estimate: they begin or end at the dot.
            let anchor = [HPos::Right, HPos::Center, HPos::Left][(1 + side) as usize];
            let style = font_style(FONT_SIZE).pos(Pos::new(anchor, VPos::Top));
            EmptyElement::at(point)
                + background
                + Text::new(name.to_string(), (side * NAME_DISTANCE, corners[0].1), style)
        };
        let names: Vec<_> = named_points().map(&mut name).collect();
        chart.draw_series(names)?;
        chart.draw_series(named_points().map(|(_, point)| Circle::new(point, NAMED_DOT_RADIUS, INK.filled())))?;
        self.draw_legend(&right)
    }

    /// Entries of the legend: number and name of each curve.
    fn legend_entries(&self) -> Vec<(usize, String)> {
        let listed = self.curves.iter().enumerate().filter(|(_, curve)| curve.marks.is_listed());
        let all_points = || self.curves.iter().flat_map(|curve| &curve.points);
        let (smallest_x, smallest_y) =
            (smallest_shown(&self.x, all_points().map(|p| p.0)), smallest_shown(&self.y, all_points().map(|p| p.1)));
        let name = |(k, curve): (usize, &Curve)| {
            let is_shown =
                |axis: &FigureAxis, value: f64, smallest: f64| !axis_value(axis, value, 1.0, smallest).is_nan();
            let valued = curve
                .points
                .iter()
                .any(|(x, y)| is_shown(&self.x, *x, smallest_x) && is_shown(&self.y, *y, smallest_y));
            (k, if valued { curve.name.clone() } else { format!("{} (no value)", curve.name) })
        };
        listed.map(name).collect()
    }

    fn legend_width(&self) -> i32 {
        let listed = self.legend_entries();
        let longest = listed.iter().map(|(_, name)| name.chars().count() as i32).max().unwrap_or(0);
        ((36 + LETTER_WIDTH * longest) * listed.len().div_ceil(LEGEND_ROWS) as i32).max(LEGEND_WIDTH)
    }

    /// Style of curve k. Curves that are drawn first are wider, so that both of two equal curves are visible.
    fn curve_style(&self, k: usize) -> CurveStyle {
        let has_colour = |c: &&Curve| matches!(c.marks, CurveMarks::Line | CurveMarks::Dots);
        let before = self.curves[..k].iter().filter(has_colour).count();
        let after = self.curves[k + 1..].iter().filter(|c| c.marks == CurveMarks::Line).count();
        let style = |number: usize, width| CurveStyle {
            colour: CURVE_COLOURS[number % CURVE_COLOURS.len()],
            width,
            repeat: number / CURVE_COLOURS.len(),
        };
        // Among many curves, wide ones would hide others.
        let lines = self.curves.iter().filter(|c| c.marks == CurveMarks::Line).count();
        let widest = if lines < 4 { 6 } else { 3 };
        match self.curves[k].marks {
            CurveMarks::Expected => CurveStyle { colour: GREY, width: 1, repeat: 0 },
            CurveMarks::Named => CurveStyle { colour: INK, width: 1, repeat: 0 },
            CurveMarks::ErrorBars if k > 0 && self.curves[k - 1].marks == CurveMarks::Named => {
                CurveStyle { colour: INK, width: 1, repeat: 0 }
            }
            CurveMarks::ErrorBars => CurveStyle { repeat: 0, ..style(before.saturating_sub(1), 1) },
            CurveMarks::Fit => style(before.saturating_sub(1), 1),
            CurveMarks::Line | CurveMarks::Dots => style(before, (2 + 2 * after as u32).min(widest)),
        }
    }

    /// Draws the names of the curves next to the plot, so that they cover no data.
    fn draw_legend(&self, area: &Area) -> DrawResult {
        let listed = self.legend_entries();
        let columns = listed.len().div_ceil(LEGEND_ROWS).max(1);
        let rows = listed.len().div_ceil(columns).max(1);
        let column_width = self.legend_width() / columns as i32;
        let row_height = ((FIGURE_SIZE.1 as i32 - FIRST_ROW) / rows as i32).min(ROW_HEIGHT);
        for (entry, (k, name)) in listed.iter().enumerate() {
            let (left, y) = (column_width * (entry / rows) as i32, FIRST_ROW + row_height * (entry % rows) as i32);
            let (CurveStyle { colour, repeat, .. }, marks) = (self.curve_style(*k), self.curves[*k].marks);
            let width = if marks == CurveMarks::Line { 3 } else { 1 };
            let stroke = |from: i32, to: i32| {
                area.draw(&PathElement::new([(left + from, y), (left + to, y)], colour.stroke_width(width)))
            };
            match (marks, dash_pattern(repeat)) {
                (CurveMarks::Named | CurveMarks::ErrorBars, _) => {}
                (CurveMarks::Dots, _) => area.draw(&draw_dot((left + 10, y), 4, colour, repeat))?,
                (_, None) => stroke(0, 20)?,
                (_, Some((dash, gap))) => {
                    // Half as long, so that two are seen.
                    let (dash, gap) = (dash as i32, (gap as i32 / 2).max(3));
                    (0..20).step_by((dash + gap) as usize).try_for_each(|from| stroke(from, (from + dash).min(20)))?;
                }
            }
            area.draw(&Text::new(name.as_str(), (left + 28, y - 8), font_style(FONT_SIZE)))?;
        }
        if listed.is_empty() && self.curves.is_empty() {
            area.draw(&Text::new("no value", (28, FIRST_ROW - 8), font_style(FONT_SIZE)))?;
        }
        Ok(())
    }
}

/// Dashes of a curve that repeats a colour for the `repeat`th time; None for a full line.
fn dash_pattern(repeat: usize) -> Option<(u32, u32)> {
    Some(DASH_PATTERNS[repeat.checked_sub(1)? % DASH_PATTERNS.len()])
}

/// Draws a dot: full for the first curve of its colour, then open, then of another form.
fn draw_dot<'a, Coord: Clone + 'static>(
    position: Coord,
    size: i32,
    colour: RGBColor,
    repeat: usize,
) -> DynElement<'static, SVGBackend<'a>, Coord> {
    match repeat % DOT_FORMS {
        0 => Circle::new(position, size, colour.filled()).into_dyn(),
        1 => Circle::new(position, size, colour.stroke_width(1)).into_dyn(),
        2 => TriangleMarker::new(position, size + 1, colour.filled()).into_dyn(),
        _ => Cross::new(position, size, colour.stroke_width(1)).into_dyn(),
    }
}

fn font_style(size: i32) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&INK)
}

/// Label of an axis with its unit, and the offset that its numbers leave out.
fn axis_label(axis: &FigureAxis, unit: &str, offset: f64) -> String {
    let less = match offset {
        0.0 => String::new(),
        _ => format!(" {} {}", if offset < 0.0 { "+" } else { "−" }, format_digits(offset.abs(), 17)),
    };
    match unit {
        "1" => axis.quantity.clone() + &less,
        unit => format!("{}{less} ({unit})", axis.quantity),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(points: Vec<(f64, f64)>, logarithmic: bool) -> Figure {
        let y = FigureAxis { quantity: "Z".into(), unit: "1".into(), logarithmic };
        Figure {
            title: "Title".into(),
            x: FigureAxis::linear("time", "s"),
            y,
            curves: vec![Curve::line("all", points)],
        }
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
                let text = figure(points.clone(), logarithmic).to_svg();
                assert!(text.contains("Title") && text.ends_with("</svg>\n"), "{text}");
                assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            }
        }
    }

    #[test]
    fn titles_are_centred_on_the_plot() {
        let number = |line: &str, name: &str| -> f64 {
            line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        for values in [[1.0, 2.0], [200.0, 200.001]] {
            let text = figure(vec![(0.0, values[0]), (1.0, values[1])], false).to_svg();
            let lines: Vec<&str> = text.lines().collect();
            let title = lines.iter().position(|line| *line == "Title").unwrap() - 1;
            let axis = lines.iter().position(|line| *line == "time (s)").unwrap() - 1;
            // Plotters centres the name of the axis on the plot, to a pixel.
            assert!((number(lines[title], "x") - number(lines[axis], "x")).abs() <= 1.0, "{text}");
            assert!(lines[title].contains("text-anchor=\"middle\""));
        }
    }

    #[test]
    fn a_fit_has_the_colour_of_its_dots() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        let of = |marks| Curve { marks, ..figure.curves[0].clone() };
        figure.curves = [CurveMarks::Dots, CurveMarks::Fit, CurveMarks::Expected, CurveMarks::Dots, CurveMarks::Fit]
            .map(of)
            .to_vec();
        let styles: Vec<RGBColor> = (0..5).map(|k| figure.curve_style(k).colour).collect();
        assert_eq!(styles, [CURVE_COLOURS[0], CURVE_COLOURS[0], GREY, CURVE_COLOURS[1], CURVE_COLOURS[1]]);
    }

    #[test]
    fn what_takes_a_colour_again_is_dashed() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        figure.curves = vec![figure.curves[0].clone(); CURVE_COLOURS.len() + 1];
        let lines = |figure: &Figure| figure.to_svg().matches("<polyline").count();
        assert!(figure.curve_style(7).repeat == 1 && figure.curve_style(7).colour == figure.curve_style(0).colour);
        // Each has its line and what stands for it in the legend; the last is in pieces.
        let dashed = lines(&figure);
        figure.curves.pop();
        assert!(dashed > lines(&figure) + 10, "{dashed} {}", lines(&figure));
        assert_eq!(figure.curve_style(6).repeat, 0);
    }

    /// Texts of a figure that are aligned vertically like labels of marks, from below.
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
    fn marks_distinguish_values_that_differ_little() {
        let of = |values: [f64; 2]| {
            let text = figure(values.iter().enumerate().map(|(k, y)| (k as f64, *y)).collect(), false).to_svg();
            (marks(&text, "text-anchor=\"end\""), text)
        };
        let (labels, _) = of([200.0, 200.001]);
        assert!(labels.contains(&"200.0004".to_string()) && labels.contains(&"200".to_string()), "{labels:?}");
        let (labels, text) = of([200.0, 200.00001]);
        assert!(labels.contains(&"0".to_string()) && labels.contains(&"4e-6".to_string()), "{labels:?}");
        assert!(text.contains("Z − 200\n"), "{text}");
        // A mark at zero, and a value that overflows.
        let (labels, _) = of([-0.3, 0.1]);
        assert_eq!(labels, ["-0.3", "-0.2", "-0.1", "0", "0.1"]);
        let (labels, _) = of([-1e308, 1e308]);
        assert!(labels.len() > 2 && labels.contains(&"5e307".to_string()), "{labels:?}");
    }

    #[test]
    fn logarithmic_axes_are_marked_at_least_twice_and_at_their_ends() {
        let of = |values: [f64; 2]| {
            let text = figure(values.iter().enumerate().map(|(k, y)| (k as f64, *y)).collect(), true).to_svg();
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
        let text = figure.to_svg();
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
        assert!(
            named.iter().all(|(x, y)| x + 16.0 * f64::from(LETTER_WIDTH) <= width && *y < 445.0),
            "{width} {named:?}"
        );
        // All styles differ, and none is wide.
        let styles: Vec<CurveStyle> = (0..28).map(|k| figure.curve_style(k)).collect();
        let alike =
            |a: &CurveStyle, b: &CurveStyle| a.colour == b.colour && dash_pattern(a.repeat) == dash_pattern(b.repeat);
        assert!((0..28).all(|k| (0..k).all(|j| !alike(&styles[j], &styles[k])) && styles[k].width <= 3));
    }

    #[test]
    fn more_curves_than_styles_are_reported() {
        let mut figure = figure(vec![(0.0, 1.0)], false);
        figure.curves = vec![figure.curves[0].clone(); 35];
        assert_eq!(figure.repeated_style_warning(), None);
        figure.curves.push(figure.curves[0].clone());
        let message = figure.repeated_style_warning().unwrap();
        assert!(message.starts_with("36 curves") && message.contains(" 35 "), "{message}");
        figure.curves = vec![Curve { marks: CurveMarks::Dots, ..figure.curves[0].clone() }; 29];
        assert!(figure.repeated_style_warning().unwrap().contains(" 28 "));
    }

    #[test]
    fn names_of_dots_that_are_near_each_other_do_not_touch() {
        let mut figure = figure(Vec::new(), false);
        let names = ["LMGC90", "narrow_phase", "adaptive", "gravity_refresh", "draft"];
        let dot = |(k, name): (usize, &&str)| Curve {
            marks: CurveMarks::Named,
            ..Curve::line(name, vec![(1.0 + 0.01 * k as f64, 1.0 + 0.01 * (k % 2) as f64)])
        };
        let last = Curve { marks: CurveMarks::Named, ..Curve::line("at the right end", vec![(3.0, 5.0)]) };
        figure.curves = names.iter().enumerate().map(dot).chain([last]).collect();
        let text = figure.to_svg();
        let lines: Vec<&str> = text.lines().collect();
        let place = |line: &str, name: &str| -> i32 {
            line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let grounds = lines.iter().filter(|line| line.contains("opacity=\"0.8\""));
        let boxes: Vec<PixelRect> = grounds
            .map(|line| {
                let (left, upper) = (place(line, "x"), place(line, "y"));
                PixelRect { left, upper, right: left + place(line, "width"), lower: upper + place(line, "height") }
            })
            .collect();
        assert_eq!(boxes.len(), 6, "{text}");
        assert!((0..6).all(|k| (0..k).all(|j| !boxes[j].intersects(&boxes[k]))), "{boxes:?}");
        let plot = FIGURE_SIZE.0 as i32 - figure.legend_width();
        assert!(boxes.iter().all(|name| name.right <= plot), "{boxes:?}");
    }

    #[test]
    fn a_name_hides_few_dots_and_less_of_lines() {
        let plot = PixelRect { left: 0, upper: 0, right: 400, lower: 200 };
        let mut label_space = LabelSpace { plot, names: Vec::new(), dots: Vec::new(), lines: Vec::new() };
        let side = |label_space: &LabelSpace| label_space.place_name((200, 100), 5).0;
        assert_eq!(side(&label_space), 1);
        label_space.lines = line_rectangles([(200, 100), (300, 100)]).collect();
        assert_eq!(side(&label_space), -1);
        label_space.dots = vec![PixelRect::centred_at((180, 100), DOT_RADIUS)];
        let (side, place) = label_space.place_name((200, 100), 5);
        assert!(side == 0 && place.lower < 100, "{place:?}");
        // At the left end only what is right of the dot is in the plot.
        assert_eq!(label_space.place_name((5, 100), 5).0, 1);
    }

    #[test]
    fn a_curve_of_round_off_alone_has_no_value() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], true);
        figure.curves.push(Curve::line("rotation", vec![(0.0, 1e-15), (1.0, 1.9e-14)]));
        assert_eq!(figure.legend_entries(), [(0, "all".into()), (1, "rotation (no value)".into())]);
        figure.curves[1].points[0].1 = 2.1e-14;
        assert_eq!(figure.legend_entries()[1].1, "rotation");
    }

    #[test]
    fn what_xml_does_not_know_is_blank() {
        let mut figure = figure(vec![(0.0, 1.0), (1.0, 2.0)], false);
        (figure.title, figure.curves[0].name) = ("Error \u{1b}[1m\u{ffff}".into(), "a\u{0}b".into());
        let text = figure.to_svg();
        assert!(text.contains("Error  [1m ") && text.contains("a b"), "{text}");
    }

    #[test]
    fn a_value_that_is_not_defined_parts_the_line() {
        let y = [0.0, 1.0, f64::NAN, 3.0, 4.0];
        let text = figure((0..5).map(|k| (10.0 * k as f64, y[k])).collect(), false).to_svg();
        assert!(text.contains("time (s)"));
        assert_eq!(text.matches("stroke-width=\"2\"").count(), 2, "{text}");
    }
}
