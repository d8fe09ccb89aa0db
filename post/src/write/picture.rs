//! `POSTPRO/aggregate.svg`, `aggregate_energy.svg`, `snapshots.svg`: quick pictures of states that need no ParaView.
//!
//! Spheres as shaded circles, polyhedra by their faces, far ones first, in parallel projection, coloured by the
//! neighbours that they touch with force or by their kinetic energy. SVG written as text, since gradients make the
//! spheres.

use std::fmt::Write;

use nalgebra::Rotation3;
use rayon::prelude::*;

use crate::derive::coordination::neighbour_counts;
use crate::derive::energy::KineticEnergy;
use crate::frame::{Frame, Grain};
use crate::math::Vec3;
use crate::write::scale::{format_six_digits, round_below, unit_prefix};

/// Side of the square for the grains, pixels.
const PICTURE_SIDE: f64 = 800.0;
/// Width of the legend next to it, pixels.
const STRIP_WIDTH: f64 = 170.0;
/// Distance of texts from the border, pixels.
const PICTURE_MARGIN: f64 = 30.0;
/// Font size, pixels.
const FONT_SIZE: f64 = 20.0;
/// Height of a colour in the legend, pixels.
const COLOUR_HEIGHT: f64 = 30.0;
/// Margin between the grains and the picture's border, pixels.
const BORDER_MARGIN: f64 = 50.0;

/// Width of the edges of faces, pixels, which hides the background between adjacent faces.
const EDGE_WIDTH: f64 = 0.7;

/// Least radius of shapes with edges, pixels, as edges would cover smaller ones; below the second value edges get narrower.
const MIN_EDGED_RADIUS: f64 = 3.0;
const FULL_EDGE_RADIUS: f64 = 8.0;
/// Least radius of a grain, pixels of the file.
const MIN_GRAIN_RADIUS: f64 = 1.0;

/// Number of neighbours from which on grains share a colour.
const MAX_COUNT_CLASS: u32 = 10;
/// Number of energy classes above the lowest; each is half a decade wide.
const ENERGY_CLASSES: u32 = 10;

/// Quantity that colours the grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureColouring {
    /// Neighbours that they touch with force.
    Neighbours,
    /// Kinetic energy of translation and rotation.
    KineticEnergy,
}

/// Classes of colours, from 0, each with a label.
struct ColourScale {
    colouring: PictureColouring,
    /// Largest kinetic energy, J.
    largest: f64,
    labels: Vec<String>,
}

impl ColourScale {
    /// Returns the scale for these states together.
    fn new(colouring: PictureColouring, frames: &[&Frame]) -> Self {
        let grains = || frames.iter().flat_map(|frame| &frame.grains);
        match colouring {
            PictureColouring::Neighbours => {
                let largest_count =
                    frames.iter().flat_map(|frame| neighbour_counts(frame)).max().unwrap_or(0).min(MAX_COUNT_CLASS);
                let label = |count: u32| format!("{count}{}", if count == MAX_COUNT_CLASS { "+" } else { "" });
                ColourScale { colouring, largest: 0.0, labels: (0..=largest_count).map(label).collect() }
            }
            PictureColouring::KineticEnergy => {
                let largest = grains().map(kinetic_energy).fold(0.0, f64::max);
                let label = |class: u32| match class {
                    0 => "less".to_string(),
                    _ => {
                        let from = largest * 10f64.powf(-0.5 * f64::from(ENERGY_CLASSES + 1 - class));
                        let (factor, unit) = unit_prefix(from, "J");
                        // Three digits of 1 to 1000.
                        let value = from / factor;
                        let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
                        format!("{value:.digits$} {unit}")
                    }
                };
                let labels = if largest > 0.0 { (0..=ENERGY_CLASSES).map(label).collect() } else { vec!["0 J".into()] };
                ColourScale { colouring, largest, labels }
            }
        }
    }

    /// Class of the highest values.
    fn max_class(&self) -> u32 {
        self.labels.len() as u32 - 1
    }

    /// Class of each grain.
    fn grain_classes(&self, frame: &Frame) -> Vec<u32> {
        match self.colouring {
            PictureColouring::Neighbours => {
                neighbour_counts(frame).into_iter().map(|count| count.min(self.max_class())).collect()
            }
            PictureColouring::KineticEnergy => {
                let class = |grain: &Grain| {
                    let share = kinetic_energy(grain) / self.largest;
                    let down = (-2.0 * share.log10()).floor();
                    // NaN if no grain has energy, infinite if this one has none.
                    if down < f64::from(self.max_class()) { self.max_class() - down.max(0.0) as u32 } else { 0 }
                };
                frame.grains.iter().map(class).collect()
            }
        }
    }

    /// Draws the colours next to a picture, with their labels.
    fn draw_legend(&self, left: f64, write_line: &mut impl FnMut(String)) {
        let max_class = self.max_class();
        let title = match self.colouring {
            PictureColouring::Neighbours => "neighbours",
            PictureColouring::KineticEnergy => "kinetic energy",
        };
        write_line(format!("<text x=\"{left}\" y=\"{PICTURE_MARGIN}\">{title}</text>"));
        if self.colouring == PictureColouring::KineticEnergy {
            write_line(format!("<text x=\"{left}\" y=\"{PICTURE_MARGIN}\" dy=\"1.2em\">from</text>"));
        }
        for (class, label) in (0..).zip(&self.labels) {
            let y = 2.2 * PICTURE_MARGIN + COLOUR_HEIGHT * f64::from(max_class - class);
            let [r, g, b] = class_colour(class, max_class);
            write_line(format!(
                "<rect x=\"{left}\" y=\"{y}\" width=\"{COLOUR_HEIGHT}\" height=\"{COLOUR_HEIGHT}\" fill=\"rgb({r:.0},{g:.0},{b:.0})\"/>"
            ));
            write_line(format!(
                "<text x=\"{}\" y=\"{}\">{label}</text>",
                left + 1.3 * COLOUR_HEIGHT,
                y + 0.75 * COLOUR_HEIGHT
            ));
        }
    }
}

/// Kinetic energy of translation and rotation, J.
fn kinetic_energy(grain: &Grain) -> f64 {
    KineticEnergy::of_grain(grain).total()
}

/// Viridis at 0, 1/4, 1/2, 3/4, 1 (Smith & van der Walt 2015), a little lighter at its dark end.
pub(crate) const VIRIDIS_COLOURS: [[f64; 3]; 5] =
    [[90.0, 40.0, 120.0], [70.0, 92.0, 150.0], [40.0, 145.0, 140.0], [100.0, 200.0, 95.0], [250.0, 225.0, 50.0]];

/// Direction towards the light: left, above and before the picture (x right, y away, z up); length 1.
const LIGHT_DIRECTION: [f64; 3] = [-0.48, -0.64, 0.6];

/// Grain on the picture.
#[derive(Debug, Clone, PartialEq)]
struct GrainDisc {
    /// Centre of its bounding circle, pixels of the square; y points down.
    x: f64,
    y: f64,
    /// Radius of its bounding circle, pixels of the square.
    radius: f64,
    /// Painted shapes.
    shapes: Vec<PaintedShape>,
}

/// A whole sphere, or a front-facing face; with single faces, touching polyhedra of any size are sorted correctly.
#[derive(Debug, Clone, PartialEq)]
struct PaintedShape {
    /// Depth of the farthest corner of a face, or of the centre of a sphere; larger is farther.
    depth: f64,
    /// Grain that is painted, in the order of the frame.
    grain: usize,
    outline: ShapeOutline,
}

/// Outline of a shape, pixels.
#[derive(Debug, Clone, PartialEq)]
enum ShapeOutline {
    Circle {
        x: f64,
        y: f64,
        radius: f64,
    },
    /// Convex face.
    Face {
        corners: Vec<[f64; 2]>,
        /// Intensity of the light on the face, 0 to 1.
        light: f64,
    },
}

impl ShapeOutline {
    /// Upper and lower limit of the shape on the picture.
    fn vertical_range(&self) -> [f64; 2] {
        match self {
            ShapeOutline::Circle { y, radius, .. } => [y - radius, y + radius],
            ShapeOutline::Face { corners, .. } => value_range(corners.iter().map(|[_, y]| *y)),
        }
    }

    /// Radius, pixels; for a face half of the longer side of the rectangle around it.
    fn radius(&self) -> f64 {
        match self {
            ShapeOutline::Circle { radius, .. } => *radius,
            ShapeOutline::Face { corners, .. } => {
                let [x, y] = [0, 1].map(|axis| value_range(corners.iter().map(|corner| corner[axis])));
                0.5 * (x[1] - x[0]).max(y[1] - y[0])
            }
        }
    }

    /// Left and right limit of the shape at a height.
    fn horizontal_range(&self, height: f64) -> [f64; 2] {
        match self {
            ShapeOutline::Circle { x, y, radius } => {
                let half = (radius * radius - (height - y).powi(2)).max(0.0).sqrt();
                [x - half, x + half]
            }
            ShapeOutline::Face { corners, .. } => {
                let next = corners.iter().cycle().skip(1);
                let edge_crossing = |([ax, ay], [bx, by]): (&[f64; 2], &[f64; 2])| {
                    let share = ((height - ay) / (by - ay)).clamp(0.0, 1.0);
                    ((ay - height) * (by - height) <= 0.0).then(|| if ay == by { *ax } else { ax + share * (bx - ax) })
                };
                value_range(corners.iter().zip(next).filter_map(edge_crossing))
            }
        }
    }
}

/// Smallest and largest value.
fn value_range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)])
}

/// Text of the SVG file of one state.
///
/// Seen from the front, a little from the right and from above; z points up. The scale is set by most of the grains.
/// Outliers are omitted and counted in a line of text: up to one grain in twenty, or more if together they have less than
/// a third of the mass. No grain is smaller than a pixel.
pub fn svg(frame: &Frame, colouring: PictureColouring) -> String {
    let [text] = svgs(frame, [colouring]);
    text
}

/// Texts as [`svg`] returns them, by each of the quantities.
pub fn svgs<const N: usize>(frame: &Frame, colourings: [PictureColouring; N]) -> [String; N] {
    let window = ViewWindow::around_grains(frame);
    let visible = VisibleState::new(frame, &window, 1.0);
    colourings.map(|colouring| {
        let mut text = svg_head(PICTURE_SIDE + STRIP_WIDTH, PICTURE_SIDE);
        let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
        let scale = ColourScale::new(colouring, &[frame]);
        draw_state(frame, &window, &visible, &scale, 0, &mut write_line);
        scale.draw_legend(PICTURE_SIDE + 20.0, &mut write_line);
        write_line("</svg>".into());
        text
    })
}

/// Text of the SVG file of several states side by side, on one scale: above by kinetic energy, below by neighbours, each row
/// with one scale of colours.
pub fn snapshots_svg(frames: &[&Frame]) -> String {
    const STATE_SIDE: f64 = 0.5 * PICTURE_SIDE;
    let total_width = STATE_SIDE * frames.len() as f64;
    let mut text = svg_head(total_width + STRIP_WIDTH, 2.0 * STATE_SIDE);
    let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
    let windows: Vec<ViewWindow> = frames.par_iter().map(|frame| ViewWindow::around_grains(frame)).collect();
    // NaN of states without grains is not the largest.
    let half = windows.iter().map(|window| window.half).fold(f64::NAN, f64::max);
    let windows: Vec<ViewWindow> = windows.into_iter().map(|window| ViewWindow { half, ..window }).collect();
    let visible: Vec<VisibleState> = frames
        .par_iter()
        .zip(&windows)
        .map(|(frame, window)| VisibleState::new(frame, window, PICTURE_SIDE / STATE_SIDE))
        .collect();
    for (row, colouring) in [PictureColouring::KineticEnergy, PictureColouring::Neighbours].into_iter().enumerate() {
        let scale = ColourScale::new(colouring, frames);
        let top = STATE_SIDE * row as f64;
        for (column, frame) in frames.iter().enumerate() {
            write_line(format!(
                "<svg x=\"{}\" y=\"{top}\" width=\"{STATE_SIDE}\" height=\"{STATE_SIDE}\" viewBox=\"0 0 {PICTURE_SIDE} {PICTURE_SIDE}\" font-size=\"{}\">",
                STATE_SIDE * column as f64,
                0.9 * FONT_SIZE * PICTURE_SIDE / STATE_SIDE
            ));
            draw_state(frame, &windows[column], &visible[column], &scale, row * frames.len() + column, &mut write_line);
            write_line("</svg>".into());
        }
        write_line(format!("<g transform=\"translate(0 {top})\">"));
        scale.draw_legend(total_width + 10.0, &mut write_line);
        write_line("</g>".into());
    }
    write_line("</svg>".into());
    text
}

/// Begin of an SVG file with a white background.
fn svg_head(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"{FONT_SIZE}\" fill=\"#3c3c3c\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    )
}

/// Visible parts of a state on a square of [`PICTURE_SIDE`] pixels.
struct VisibleState {
    /// Far shapes first.
    shapes: Vec<PaintedShape>,
    /// Number of grains outside the picture.
    outside_count: usize,
    /// Pixels of the square per pixel of the file.
    pixel_scale: f64,
}

impl VisibleState {
    fn new(frame: &Frame, window: &ViewWindow, pixel_scale: f64) -> VisibleState {
        let discs = project_grains(frame, window, MIN_GRAIN_RADIUS * pixel_scale);
        let (inside, outside): (Vec<GrainDisc>, Vec<GrainDisc>) = discs.into_iter().partition(|disc| {
            let is_inside = |c: f64| c > -disc.radius && c < PICTURE_SIDE + disc.radius;
            is_inside(disc.x) && is_inside(disc.y)
        });
        let shapes = visible_shapes(inside.into_iter().flat_map(|disc| disc.shapes).collect());
        VisibleState { shapes, outside_count: outside.len(), pixel_scale }
    }
}

/// Draws one state on a square of [`PICTURE_SIDE`] pixels; `number` distinguishes it from others of the same file.
fn draw_state(
    frame: &Frame,
    window: &ViewWindow,
    visible: &VisibleState,
    scale: &ColourScale,
    number: usize,
    write_line: &mut impl FnMut(String),
) {
    let max_class = scale.max_class();
    let VisibleState { shapes, outside_count, pixel_scale } = visible;
    let classes = scale.grain_classes(frame);
    let pixels_per_metre = window.pixels_per_metre();
    let edge = EDGE_WIDTH * pixel_scale;
    write_line("<defs>".into());
    for class in 0..=max_class {
        write_line(gradient_svg(number, class, max_class));
    }
    write_line(format!(
        "<clipPath id=\"frame{number}\"><rect width=\"{PICTURE_SIDE}\" height=\"{PICTURE_SIDE}\"/></clipPath>\n</defs>"
    ));
    write_line(format!(
        "<g clip-path=\"url(#frame{number})\" stroke=\"black\" stroke-opacity=\"0.35\" stroke-width=\"{edge}\" \
         stroke-linejoin=\"round\">"
    ));
    for PaintedShape { grain, outline, .. } in shapes {
        let class = classes[*grain];
        let share = (outline.radius() / pixel_scale - MIN_EDGED_RADIUS) / (FULL_EDGE_RADIUS - MIN_EDGED_RADIUS);
        let stroke = match share {
            share if share >= 1.0 => String::new(),
            share if share > 0.0 => format!(" stroke-width=\"{:.2}\"", share * edge),
            _ => " stroke=\"none\"".into(),
        };
        write_line(match outline {
            ShapeOutline::Circle { x, y, radius } => {
                format!(
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.2}\" fill=\"url(#c{number}-{class})\"{stroke}/>"
                )
            }
            ShapeOutline::Face { corners, light } => {
                let [r, g, b] = shaded_colour(class_colour(class, max_class), *light);
                let corners: Vec<String> = corners.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
                format!("<polygon points=\"{}\" fill=\"rgb({r:.0},{g:.0},{b:.0})\"{stroke}/>", corners.join(" "))
            }
        });
    }
    write_line("</g>".into());
    // Scale bar.
    if pixels_per_metre.is_finite() {
        let length = round_below(PICTURE_SIDE / 5.0 / pixels_per_metre);
        let (factor, unit) = unit_prefix(length, "m");
        let (left, bottom) = (PICTURE_MARGIN, PICTURE_SIDE - PICTURE_MARGIN);
        write_line(format!(
            "<path d=\"M{left} {bottom}h{:.2}\" stroke=\"black\" stroke-width=\"4\"/>",
            length * pixels_per_metre
        ));
        write_line(format!("<text x=\"{left}\" y=\"{}\">{:.0} {unit}</text>", bottom - 10.0, length / factor));
    }
    let top = 1.2 * PICTURE_MARGIN;
    write_line(format!(
        "<text x=\"{PICTURE_MARGIN}\" y=\"{top}\">t = {} s, grains: {}</text>",
        format_six_digits(frame.meta.time),
        frame.grains.len()
    ));
    if *outside_count > 0 {
        write_line(format!(
            "<text x=\"{PICTURE_MARGIN}\" y=\"{top}\" dy=\"1.2em\">{outside_count} of them outside the picture</text>"
        ));
    }
}

/// Least value up to which the grains have `share` of the mass.
fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let target = share * values.iter().map(|(_, mass)| mass).sum::<f64>();
    let mut below = 0.0;
    let quantile = values.iter().find(|(_, mass)| {
        below += mass;
        below >= target
    });
    quantile.or(values.last()).map_or(f64::NAN, |(value, _)| *value)
}

/// Direction from which states are seen: rotation of the axes of the world.
fn view_rotation() -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vec3::x_axis(), 0.35) * Rotation3::from_axis_angle(&Vec3::z_axis(), -0.5)
}

/// Part of a state that a square picture shows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ViewWindow {
    /// Middle of the picture, to the right and upwards in the rotated axes, m.
    middle: [f64; 2],
    /// Half of its side less the border, m; NaN without grains.
    half: f64,
}

impl ViewWindow {
    /// Window around most of the grains.
    fn around_grains(frame: &Frame) -> ViewWindow {
        let view = view_rotation();
        let positions_in_view: Vec<Vec3> = frame.grains.iter().map(|g| view * g.x).collect();
        if positions_in_view.is_empty() {
            return ViewWindow { middle: [0.0; 2], half: f64::NAN };
        }
        let quantile = |values: &mut Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values[((values.len() - 1) as f64 * share).round() as usize]
        };
        let with_mass =
            |values: &mut dyn Iterator<Item = f64>| values.zip(frame.grains.iter().map(|g| g.mass)).collect();
        let middle = |axis: usize| weighted_quantile(with_mass(&mut positions_in_view.iter().map(|x| x[axis])), 0.5);
        let (x, z) = (middle(0), middle(2));
        // Distance of each grain from the middle; all grains count if the farthest is no outlier. Two thirds of the
        // mass of a line are within two thirds of its half length, those of a ball within a larger part of its radius. So
        // three times this distance contains every connected aggregate.
        let mut reach: Vec<f64> = positions_in_view
            .iter()
            .zip(&frame.grains)
            .map(|(at, g)| (at.x - x).abs().max((at.z - z).abs()) + g.bounding_radius())
            .collect();
        let aggregate_reach = 3.0 * weighted_quantile(with_mass(&mut reach.iter().copied()), 2.0 / 3.0);
        let max_reach = quantile(&mut reach, 1.0).min(1.5 * quantile(&mut reach, 0.95)).min(aggregate_reach);
        let half = reach.iter().copied().filter(|reach| *reach <= max_reach).fold(0.0, f64::max);
        ViewWindow { middle: [x, z], half }
    }

    /// Pixels of the square per metre.
    fn pixels_per_metre(&self) -> f64 {
        (PICTURE_SIDE / 2.0 - BORDER_MARGIN) / self.half
    }
}

/// Projections of the grains on `window`, with radii of at least `min_radius` pixels.
fn project_grains(frame: &Frame, window: &ViewWindow, min_radius: f64) -> Vec<GrainDisc> {
    let view = view_rotation();
    let positions_in_view: Vec<Vec3> = frame.grains.iter().map(|g| view * g.x).collect();
    let (pixels_per_metre, [x, z]) = (window.pixels_per_metre(), window.middle);
    let to_pixels = |at: &Vec3| {
        [PICTURE_SIDE / 2.0 + pixels_per_metre * (at.x - x), PICTURE_SIDE / 2.0 - pixels_per_metre * (at.z - z)]
    };
    let disc = |(k, (at, grain)): (usize, (&Vec3, &Grain))| {
        let [x, y] = to_pixels(at);
        let radius = (pixels_per_metre * grain.bounding_radius()).max(min_radius);
        let mut shapes = Vec::new();
        if pixels_per_metre * grain.bounding_radius() <= min_radius {
            shapes.push(PaintedShape { depth: at.y, grain: k, outline: ShapeOutline::Circle { x, y, radius } });
            return GrainDisc { x, y, radius, shapes };
        }
        if let Some(solid) = &grain.solid {
            let turn = |v: &Vec3| view * (grain.rotation * v);
            for face in &solid.faces {
                let corners: Vec<Vec3> = face.iter().map(|&k| turn(&solid.vertices[k as usize])).collect();
                let normal = face_normal(&corners);
                if normal.y < 0.0 {
                    let depth = at.y + corners.iter().map(|c| c.y).fold(f64::NEG_INFINITY, f64::max);
                    let light = normal.dot(&Vec3::from(LIGHT_DIRECTION)).max(0.0);
                    let corners = corners.iter().map(|c| to_pixels(&(at + c))).collect();
                    shapes.push(PaintedShape { depth, grain: k, outline: ShapeOutline::Face { corners, light } });
                }
            }
        }
        for (centre, radius) in grain.balls() {
            let centre = at + view * (centre - grain.x);
            let ([x, y], radius) = (to_pixels(&centre), pixels_per_metre * radius);
            shapes.push(PaintedShape { depth: centre.y, grain: k, outline: ShapeOutline::Circle { x, y, radius } });
        }
        GrainDisc { x, y, radius, shapes }
    };
    positions_in_view.iter().zip(&frame.grains).enumerate().map(disc).collect()
}

/// Unit normal of a polygon whose corners are counter-clockwise seen from outside.
fn face_normal(corners: &[Vec3]) -> Vec3 {
    let first = corners[0];
    let fan = corners[1..].windows(2).map(|pair| (pair[0] - first).cross(&(pair[1] - first)));
    fan.sum::<Vec3>().normalize()
}

/// Colour of a face in the light: half in the shade, with some white in full light.
fn shaded_colour(colour: [f64; 3], light: f64) -> [f64; 3] {
    let brightness = 0.45 + 0.65 * light;
    colour.map(|c| if brightness <= 1.0 { brightness * c } else { c + (brightness - 1.0) * 3.0 * (255.0 - c) })
}

/// Visible shapes, far ones first. The shapes are painted over each other on a grid of half a pixel, and those with a
/// remaining cell are kept. A file then contains only the surface, for any number of grains.
fn visible_shapes(mut shapes: Vec<PaintedShape>) -> Vec<PaintedShape> {
    const CELLS: usize = 2 * PICTURE_SIDE as usize;
    // Number of the cell with its middle at this pixel, as a real.
    let cell_number = |c: f64| c / PICTURE_SIDE * CELLS as f64 - 0.5;
    // Cells whose centres are in the range, or the nearest cell if there is none.
    let cells = |[from, to]: [f64; 2]| {
        let cell = |c: f64| c.clamp(0.0, CELLS as f64 - 1.0) as usize;
        let (first, last) = (cell_number(from).ceil(), cell_number(to).floor());
        let middle = cell_number(0.5 * (from + to)).round();
        if first <= last { cell(first)..=cell(last) } else { cell(middle)..=cell(middle) }
    };
    shapes.sort_by(|a, b| b.depth.total_cmp(&a.depth));
    let mut owners = vec![u32::MAX; CELLS * CELLS];
    for (owner, shape) in (0..).zip(&shapes) {
        let height = shape.outline.vertical_range();
        for row in cells(height) {
            let middle = (row as f64 + 0.5) * PICTURE_SIDE / CELLS as f64;
            let span = cells(shape.outline.horizontal_range(middle.clamp(height[0], height[1])));
            owners[row * CELLS..][span].fill(owner);
        }
    }
    let mut is_visible = vec![false; shapes.len()];
    owners.into_iter().filter(|owner| *owner != u32::MAX).for_each(|owner| is_visible[owner as usize] = true);
    let mut is_visible = is_visible.into_iter();
    shapes.retain(|_| is_visible.next().is_some_and(|is_visible| is_visible));
    shapes
}

/// Red, green and blue of a class from 0 to `max_class`.
fn class_colour(class: u32, max_class: u32) -> [f64; 3] {
    let position = f64::from(class) / f64::from(max_class.max(1)) * (VIRIDIS_COLOURS.len() - 1) as f64;
    let low = (position as usize).min(VIRIDIS_COLOURS.len() - 2);
    let share = position - low as f64;
    std::array::from_fn(|k| (1.0 - share) * VIRIDIS_COLOURS[low][k] + share * VIRIDIS_COLOURS[low + 1][k])
}

/// Gradient for light from the upper left: the colour is lighter there and darker at the far rim.
fn gradient_svg(number: usize, class: u32, max_class: u32) -> String {
    let base = class_colour(class, max_class);
    let mix = |towards: f64, share: f64| {
        let [r, g, b] = base.map(|c| (1.0 - share) * c + share * towards);
        format!("rgb({r:.0},{g:.0},{b:.0})")
    };
    format!(
        "<radialGradient id=\"c{number}-{class}\" cx=\"0.38\" cy=\"0.34\" r=\"0.72\"><stop offset=\"0\" stop-color=\"{}\"/>\
         <stop offset=\"0.5\" stop-color=\"{}\"/><stop offset=\"1\" stop-color=\"{}\"/></radialGradient>",
        mix(255.0, 0.6),
        mix(0.0, 0.0),
        mix(0.0, 0.55)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;

    #[test]
    fn what_is_hidden_is_left_out_and_what_peeps_out_is_not() {
        let circle = |x: f64, radius: f64, depth: f64| PaintedShape {
            depth,
            grain: 0,
            outline: ShapeOutline::Circle { x, y: 400.0, radius },
        };
        let (front, hidden, peeping) = (circle(400.0, 100.0, 0.0), circle(410.0, 50.0, 1.0), circle(480.0, 40.0, 2.0));
        assert_eq!(visible_shapes(vec![hidden.clone(), front.clone(), peeping.clone()]), [peeping.clone(), front]);
        // A square that reaches as far hides them as well; a dot before it is seen, however small.
        let corners = vec![[300.0, 300.0], [530.0, 300.0], [530.0, 500.0], [300.0, 500.0]];
        let square = PaintedShape { depth: 0.5, grain: 0, outline: ShapeOutline::Face { corners, light: 1.0 } };
        let dot = circle(310.0, 0.01, 0.1);
        assert_eq!(visible_shapes(vec![dot.clone(), peeping, square.clone(), hidden]), [square, dot]);
    }

    #[test]
    fn of_a_cube_three_faces_are_seen_and_the_upper_is_the_brightest() {
        let mut scene = Scene::default();
        scene.cube([0.0; 3], 1.0);
        let window = ViewWindow::around_grains(&scene.frame());
        let discs = project_grains(&scene.frame(), &window, MIN_GRAIN_RADIUS);
        assert!((discs[0].radius / window.pixels_per_metre() - 3f64.sqrt()).abs() < 1e-14);
        let height_and_light = |shape: &PaintedShape| match &shape.outline {
            ShapeOutline::Face { corners, light } => (corners.iter().map(|[_, y]| y).sum::<f64>() / 4.0, *light),
            ShapeOutline::Circle { .. } => panic!("of a cube: {shape:?}"),
        };
        let faces: Vec<(f64, f64)> = discs[0].shapes.iter().map(height_and_light).collect();
        let brightest = faces.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!(faces.len() == 3 && faces.iter().all(|face| face.0 >= brightest.0), "{faces:?}");
        assert_eq!(svg(&scene.frame(), PictureColouring::Neighbours).matches("<polygon").count(), 3);
    }

    #[test]
    fn energies_are_coloured_by_halves_of_powers_of_ten() {
        let mut scene = Scene::default();
        for (k, v) in [8.0, 8.0 / 2.0, 8.0 / 90.0, 0.0].into_iter().enumerate() {
            let grain = scene.grain([3.0 * k as f64, 0.0, 0.0], 1.0);
            scene.snapshot.bodies.body_mass[grain] = 2.0;
            scene.snapshot.bodies.body_v[grain] = [v, 0.0, 0.0];
        }
        let frame = scene.frame();
        let scale = ColourScale::new(PictureColouring::KineticEnergy, &[&frame]);
        // A quarter is in the second class from above, 1/8100 in the eighth.
        assert_eq!(scale.grain_classes(&frame), [10, 9, 3, 0]);
        assert_eq!(scale.labels.last().unwrap(), "20.2 J");
        let text = svg(&frame, PictureColouring::KineticEnergy);
        assert!(text.contains("kinetic energy") && text.contains("20.2 J"));
        // With several states the fastest sets the scale, and ids differ.
        let mut slower = scene.frame();
        slower.grains.iter_mut().for_each(|grain| grain.v *= 0.11);
        let scale = ColourScale::new(PictureColouring::KineticEnergy, &[&frame, &slower]);
        assert_eq!(scale.grain_classes(&slower), [7, 5, 0, 0]);
        let text = snapshots_svg(&[&frame, &slower]);
        assert_eq!((text.matches("id=\"c3-0\"").count(), text.matches("</svg>").count()), (1, 5));
        let at_rest = ColourScale::new(PictureColouring::KineticEnergy, &[&Scene::default().frame()]);
        assert_eq!((at_rest.max_class(), at_rest.labels.len()), (0, 1));
    }

    #[test]
    fn the_scale_bar_is_to_scale() {
        // A sphere of 1 m fills the picture except for the margin.
        let mut scene = Scene::default();
        scene.grain([0.0, 0.0, 0.0], 1.0);
        let window = ViewWindow::around_grains(&scene.frame());
        let (discs, scale) = (project_grains(&scene.frame(), &window, MIN_GRAIN_RADIUS), window.pixels_per_metre());
        assert!((discs[0].radius - (PICTURE_SIDE / 2.0 - BORDER_MARGIN)).abs() < 1e-9);
        let text = svg(&scene.frame(), PictureColouring::Neighbours);
        let bar = text.split("<path d=\"M30 770h").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
        assert_eq!(bar, format!("{:.2}", 0.2 * scale)); // 160 pixels are 0.46 m
        assert!(text.contains(">200 mm<"));
    }

    #[test]
    fn several_states_have_one_scale() {
        let [mut narrow, mut wide] = [Scene::default(), Scene::default()];
        narrow.grain([0.0; 3], 1.0);
        wide.grain([0.0; 3], 5.0);
        let text = snapshots_svg(&[&narrow.frame(), &Scene::default().frame(), &wide.frame()]);
        let bars: Vec<&str> =
            text.split("<path d=\"M30 770h").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
        assert!(bars.len() == 6 && bars.iter().all(|bar| *bar == bars[0]), "{bars:?}");
    }

    #[test]
    fn a_lost_grain_does_not_shrink_the_others() {
        let mut scene = Scene::default();
        for k in 0..100 {
            scene.grain([(k % 10) as f64, (k / 10) as f64, 0.0], 0.5);
        }
        scene.grain([1e9, 0.0, 0.0], 0.5);
        assert!(svg(&scene.frame(), PictureColouring::KineticEnergy).contains("1 of them outside the picture"));
        assert!(ViewWindow::around_grains(&scene.frame()).pixels_per_metre() > 20.0);
    }

    #[test]
    fn many_grains_far_away_leave_the_rest_in_the_picture() {
        // A fifth of the mass has left.
        let mut scene = Scene::default();
        for k in 0..80 {
            scene.grain([(k % 10) as f64, 0.0, (k / 10) as f64], 0.5);
        }
        for k in 0..20 {
            scene.grain([1e5 * (k as f64 - 9.5), 0.0, 2e5], 0.5);
        }
        assert!(svg(&scene.frame(), PictureColouring::Neighbours).contains("20 of them outside the picture"));
        assert!(ViewWindow::around_grains(&scene.frame()).pixels_per_metre() > 20.0);
    }

    #[test]
    fn small_grains_are_dots_without_edges() {
        // Two of 1 m, 1 km apart, are less than a pixel of 3 m: dots of that size, in the small pictures of twice as many
        // pixels of their own. Of a cube nothing but a dot is left.
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.cube([1000.0, 0.0, 0.0], 0.9);
        let frame = scene.frame();
        let dots = |text: &str, size: &str| text.matches(&format!("r=\"{size}\"")).count();
        let text = svg(&frame, PictureColouring::Neighbours);
        assert_eq!((dots(&text, "1.00"), text.matches("stroke=\"none\"").count()), (2, 2), "{text}");
        assert_eq!(dots(&snapshots_svg(&[&frame]), "2.00"), 4);
        // Edges of what is larger get wider with it.
        let edge = |distance: f64| {
            let mut scene = Scene::default();
            scene.grain([0.0; 3], 1.0);
            scene.grain([0.0, 0.0, distance], 1.0);
            let text = svg(&scene.frame(), PictureColouring::Neighbours);
            let circle = text.lines().find(|line| line.starts_with("<circle")).unwrap().to_string();
            circle.split("stroke-width=\"").nth(1).map(|rest| rest.split('"').next().unwrap().parse::<f64>().unwrap())
        };
        assert_eq!(edge(10.0), None); // that of all
        assert!(edge(60.0) > edge(100.0) && edge(100.0) > Some(0.0));
    }

    #[test]
    fn nothing_is_drawn_of_nothing() {
        let text = svg(&Scene::default().frame(), PictureColouring::KineticEnergy);
        assert!(text.contains("grains: 0") && !text.contains("NaN"));
    }
}
