//! A quantity on a grid, as SVG, coloured by value. On the sphere of directions longitude is to the right and latitude up;
//! seen from above one horizontal axis is to the right and the other up.

use std::fmt::Write;

use crate::derive::free_surface::FreeSurface;
use crate::derive::surface::DirectionGrid;
use crate::write::colours::ramp_colour;
use crate::write::scale::{digits_needed, format_digits, round_below, unit_prefix};

/// Length of the longer edge of a map seen from above, pixels.
const MAP_SIDE: f64 = 640.0;
/// Space around the map for title, labels and colour bar, pixels.
const LEFT_MARGIN: f64 = 70.0;
const TOP_MARGIN: f64 = 50.0;
const RIGHT_MARGIN: f64 = 120.0;
const BOTTOM_MARGIN: f64 = 60.0;
/// Number of steps of the colour bar.
const COLOUR_STEPS: usize = 60;
/// Smallest ratio of the range of the colour bar to the distance of its marks. This distance is rounded down to 1, 2 or 5 times
/// a power of ten, so that the ratio is at most 2.5 times as large and the bar has 2 to 7 marks.
const MIN_BAR_STEPS: f64 = 2.5;
/// Least height of the colour bar, which fits seven numbers, pixels.
const MIN_BAR_HEIGHT: f64 = 120.0;
/// Approximate width of a letter of the title, pixels.
const TITLE_LETTER: f64 = 10.0;

/// Sheet on which a map shows its values: cells row by row, from below.
pub struct MapSheet {
    /// Number of cells to the right and up.
    counts: [usize; 2],
    /// Width and height of a cell, pixels.
    cell: [f64; 2],
    /// Titles of the axes, to the right and up.
    labels: [String; 2],
    /// Positions of the ticks as shares of the width or height, and their labels.
    ticks: [Vec<(f64, String)>; 2],
}

impl MapSheet {
    /// Sheet for directions: longitude to the right, latitude up.
    pub fn from_directions(grid: DirectionGrid) -> MapSheet {
        let degree_marks = |step: usize, half: i32| {
            let degrees = (-half..=half).step_by(step);
            degrees.map(|d| (f64::from(d + half) / f64::from(2 * half), d.to_string())).collect()
        };
        MapSheet {
            counts: [grid.longitudes, grid.latitudes],
            cell: [10.0; 2],
            labels: ["longitude (°)".into(), "latitude (°)".into()],
            ticks: [degree_marks(60, 180), degree_marks(30, 90)],
        }
    }

    /// Sheet for a surface seen from above, with lengths along both axes.
    pub fn from_above(surface: &FreeSurface) -> MapSheet {
        let FreeSurface { counts, from, widths, .. } = surface;
        let spans = [0, 1].map(|k| widths[k] * counts[k] as f64);
        let longest = spans[0].max(spans[1]);
        let largest = [0, 1].map(|k| from[k].abs().max((from[k] + spans[k]).abs()));
        let (factor, unit) = unit_prefix(largest[0].max(largest[1]), "m");
        let step = round_below(longest / 5.0);
        let ticks = |k: usize| {
            let ends = [from[k], from[k] + spans[k]].map(|end| end / step);
            // + 0.0 turns -0 into 0.
            let tick =
                |i: i64| ((i as f64 * step - from[k]) / spans[k], format_digits(i as f64 * step / factor + 0.0, 6));
            (ends[0].ceil() as i64..=ends[1].floor() as i64).map(tick).collect()
        };
        MapSheet {
            counts: *counts,
            cell: [0, 1].map(|k| MAP_SIDE * widths[k] / longest),
            labels: surface.axis_names().map(|name| format!("{name} ({unit})")),
            ticks: [ticks(0), ticks(1)],
        }
    }
}

/// Text of the SVG file; `values` by cell of the sheet in `unit`. Cells without a finite value stay white.
pub fn map_svg(title: &str, quantity: &str, unit: &str, values: &[f64], sheet: &MapSheet) -> String {
    let [map_width, map_height] = [0, 1].map(|k| sheet.cell[k] * sheet.counts[k] as f64);
    let [cell_x, cell_y] = sheet.cell;
    let finite_values = || values.iter().copied().filter(|v| v.is_finite());
    let (low, top) = finite_values().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, top), v| (low.min(v), top.max(v)));
    // Values that are equal within round-off are one value, in the middle.
    let magnitude = low.abs().max(top.abs());
    let margin = if magnitude > 0.0 { 0.1 * magnitude } else { 0.5 };
    let (low, top) = if top - low > 1e-9 * magnitude { (low, top) } else { (low - margin, low + margin) };
    let (factor, unit) = if low.is_finite() { unit_prefix(low.abs().max(top.abs()), unit) } else { (1.0, unit.into()) };
    // On a narrow strip the title and the bar need more width than the map.
    let title_width = TITLE_LETTER * title.chars().count() as f64 + 40.0;
    let (width, bar_height) =
        ((LEFT_MARGIN + map_width + RIGHT_MARGIN).max(title_width), map_height.max(MIN_BAR_HEIGHT));
    let height = (TOP_MARGIN + map_height + BOTTOM_MARGIN).max(TOP_MARGIN + bar_height + 20.0);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"14\" fill=\"#3c3c3c\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
    let middle = (LEFT_MARGIN + map_width / 2.0).clamp(title_width / 2.0, width - title_width / 2.0);
    write_line(format!("<text x=\"{middle}\" y=\"20\" font-size=\"20\" text-anchor=\"middle\">{title}</text>"));
    write_line("<g shape-rendering=\"crispEdges\">".into());
    for (k, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        let (row, column) = (k / sheet.counts[0], k % sheet.counts[0]);
        let (x, y) = (LEFT_MARGIN + cell_x * column as f64, TOP_MARGIN + map_height - cell_y * (row + 1) as f64);
        let fill = colour_ramp((value - low) / (top - low));
        write_line(format!("<rect x=\"{x}\" y=\"{y}\" width=\"{cell_x}\" height=\"{cell_y}\" fill=\"{fill}\"/>"));
    }
    let bar = LEFT_MARGIN + map_width + 20.0;
    for step in 0..COLOUR_STEPS {
        let y = TOP_MARGIN + bar_height * (1.0 - (step + 1) as f64 / COLOUR_STEPS as f64);
        let fill = colour_ramp((step as f64 + 0.5) / COLOUR_STEPS as f64);
        write_line(format!(
            "<rect x=\"{bar}\" y=\"{y:.2}\" width=\"18\" height=\"{:.2}\" fill=\"{fill}\"/>",
            bar_height / COLOUR_STEPS as f64 + 0.5
        ));
    }
    write_line("</g>".into());
    write_line(format!(
        "<rect x=\"{LEFT_MARGIN}\" y=\"{TOP_MARGIN}\" width=\"{map_width}\" height=\"{map_height}\" fill=\"none\" stroke=\"#3c3c3c\"/>"
    ));
    for (share, label) in &sheet.ticks[0] {
        let x = LEFT_MARGIN + map_width * share;
        write_line(format!("<path d=\"M{x} {}v6\" stroke=\"#3c3c3c\"/>", TOP_MARGIN + map_height));
        write_line(format!(
            "<text x=\"{x}\" y=\"{}\" text-anchor=\"middle\" font-size=\"13\">{label}</text>",
            TOP_MARGIN + map_height + 21.0
        ));
    }
    for (share, label) in &sheet.ticks[1] {
        let y = TOP_MARGIN + map_height * (1.0 - share);
        write_line(format!("<path d=\"M{LEFT_MARGIN} {y}h-6\" stroke=\"#3c3c3c\"/>"));
        let (x, below) = (LEFT_MARGIN - 10.0, y + 5.0);
        write_line(format!("<text x=\"{x}\" y=\"{below}\" text-anchor=\"end\" font-size=\"13\">{label}</text>"));
    }
    // Without a known value the bar has no numbers.
    let step = if low.is_finite() { round_below((top - low) / MIN_BAR_STEPS) } else { 1.0 };
    let marks: Vec<i64> =
        if low.is_finite() { ((low / step).ceil() as i64..=(top / step).floor() as i64).collect() } else { Vec::new() };
    for value in marks.into_iter().map(|k| k as f64 * step) {
        let y = TOP_MARGIN + bar_height * (1.0 - (value - low) / (top - low));
        let label = format_digits(value / factor, digits_needed(low.abs().max(top.abs()), step).max(3));
        write_line(format!("<path d=\"M{} {y:.2}h5\" stroke=\"#3c3c3c\"/>", bar + 18.0));
        write_line(format!("<text x=\"{}\" y=\"{}\" font-size=\"13\">{label}</text>", bar + 24.0, y + 5.0));
    }
    let label = if unit == "1" { quantity.to_string() } else { format!("{quantity} ({unit})") };
    write_line(format!("<text x=\"{bar}\" y=\"{}\">{label}</text>", TOP_MARGIN - 12.0));
    write_line(format!(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        LEFT_MARGIN + map_width / 2.0,
        TOP_MARGIN + map_height + 46.0,
        sheet.labels[0]
    ));
    let middle = TOP_MARGIN + map_height / 2.0;
    write_line(format!(
        "<text x=\"20\" y=\"{middle}\" text-anchor=\"middle\" transform=\"rotate(-90 20 {middle})\">{}</text>",
        sheet.labels[1]
    ));
    write_line("</svg>".into());
    text
}

/// Colour of a share from 0 to 1.
fn colour_ramp(share: f64) -> String {
    let [r, g, b] = ramp_colour(share);
    format!("rgb({r:.0},{g:.0},{b:.0})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_strip_has_space_for_title_and_numbers() {
        for counts in [[160, 2], [2, 160]] {
            let sheet = MapSheet {
                counts,
                cell: [4.0; 2],
                labels: ["x (m)".into(), "y (m)".into()],
                ticks: [vec![(0.5, "0".into())], vec![(0.5, "0".into())]],
            };
            let values: Vec<f64> = (0..320).map(f64::from).collect();
            let text = map_svg("Slope of the free surface", "slope", "°", &values, &sheet);
            let number = |line: &str, name: &str| -> f64 {
                line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
            };
            let [width, height] = ["width", "height"].map(|name| number(text.lines().next().unwrap(), name));
            let title = number(text.lines().find(|line| line.contains("Slope of")).unwrap(), "x");
            let half = 0.5 * TITLE_LETTER * 25.0;
            assert!(title - half >= 0.0 && title + half <= width, "{width} {title}");
            let bar = format!("<text x=\"{}\"", LEFT_MARGIN + 4.0 * counts[0] as f64 + 44.0);
            let places: Vec<f64> =
                text.lines().filter(|line| line.starts_with(&bar)).map(|line| number(line, "y")).collect();
            // 0, 100, 200 and 300 of 319, a letter of 13 pixels and more apart.
            assert!(places.len() == 4 && places.windows(2).all(|two| two[0] - two[1] > 16.0), "{places:?}");
            assert!(places[0] < height && places[3] > 0.0);
        }
    }

    #[test]
    fn every_known_cell_is_drawn_in_its_place() {
        let grid = &MapSheet::from_directions(DirectionGrid { latitudes: 2, longitudes: 4 });
        let text = map_svg("Slope", "slope", "1", &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, f64::NAN], grid);
        assert_eq!(text.matches("width=\"10\" height=\"10\"").count(), 7);
        // The first cell is in the south-west, in the colour of the least value.
        let first = format!(
            "<rect x=\"{LEFT_MARGIN}\" y=\"{}\" width=\"10\" height=\"10\" fill=\"{}\"/>",
            TOP_MARGIN + 10.0,
            colour_ramp(0.0)
        );
        assert!(text.contains(&first), "{text}");
        assert!(text.contains("longitude") && !text.contains("NaN"));
        // A ball, but for rounding, has one colour.
        let mut ball = [10.0; 8];
        ball[3] += 2e-15;
        let text = map_svg("Height", "height", "m", &ball, grid);
        let middle = format!("height=\"10\" fill=\"{}\"", colour_ramp(0.5));
        assert_eq!(text.matches(&middle).count(), 8, "{text}");
        assert!(text.contains(">9<") && text.contains(">11<"), "{text}");
        ball[3] = 10.004;
        assert!(map_svg("Height", "height", "m", &ball, grid).contains(">10.003<"));
        for values in [[1.0; 8], [f64::NAN; 8]] {
            assert!(!map_svg("Slope", "slope", "m", &values, grid).contains("NaN"));
        }
    }
}
