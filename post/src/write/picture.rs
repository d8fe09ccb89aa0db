//! `POSTPRO/aggregate.svg`, `aggregate_energy.svg`, `snapshots.svg`: quick pictures of states that need no ParaView.
//!
//! Spheres as shaded circles, polyhedra by their faces, far ones first, in parallel projection, coloured by the
//! neighbours that they touch with force or by their kinetic energy. Plates, hollow cylinders and triangulated walls are translucent, other
//! walls grey. SVG written as text, since gradients make the spheres.

use std::fmt::Write;

use rayon::prelude::*;

use crate::frame::{Frame, Grain};
use crate::math::Vec3;
use crate::write::colours::{ColourScale, GrainQuantity};
use crate::write::scale::{format_six_digits, round_below, unit_prefix};
use crate::write::view::{
    ViewCamera, ViewWindow, WALL_COLOUR, WALL_OPACITY, drawn_walls, face_normal, light_intensity, shaded_colour,
    visible_span,
};

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

/// Longest piece of an edge of a wall, pixels of the square: pieces are painted before or after grains, by their depth.
const EDGE_PIECE: f64 = 20.0;

/// Draws the colours next to a picture, with their labels.
fn draw_legend(scale: &ColourScale, left: f64, write_line: &mut impl FnMut(String)) {
    for (line, text) in scale.title_lines().into_iter().enumerate() {
        let text = escape_xml(&text);
        write_line(format!(
            "<text x=\"{left}\" y=\"{PICTURE_MARGIN}\" dy=\"{:.1}em\">{text}</text>",
            1.2 * line as f64
        ));
    }
    for (class, label) in scale.labels.iter().enumerate() {
        let y = 2.2 * PICTURE_MARGIN + COLOUR_HEIGHT * (scale.max_class() - class) as f64;
        let [r, g, b] = scale.class_colour(class);
        write_line(format!(
            "<rect x=\"{left}\" y=\"{y}\" width=\"{COLOUR_HEIGHT}\" height=\"{COLOUR_HEIGHT}\" fill=\"rgb({r:.0},{g:.0},{b:.0})\"/>"
        ));
        write_line(format!(
            "<text x=\"{}\" y=\"{}\">{}</text>",
            left + 1.3 * COLOUR_HEIGHT,
            y + 0.75 * COLOUR_HEIGHT,
            escape_xml(label)
        ));
    }
}

/// Text with the characters replaced that XML reserves.
fn escape_xml(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

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

/// A whole sphere, a front-facing face or a piece of an edge of a wall; with single faces, touching polyhedra of any size
/// are sorted correctly.
#[derive(Debug, Clone, PartialEq)]
struct PaintedShape {
    /// Depth of the farthest corner of a face, or of the centre of a sphere; larger is farther.
    depth: f64,
    paint: ShapePaint,
    outline: ShapeOutline,
}

/// Body to which a shape belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ShapePaint {
    /// Grain, in the order of the frame.
    Grain(usize),
    OpaqueWall,
    TranslucentWall,
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
    /// Straight line between two points.
    Line([[f64; 2]; 2]),
}

impl ShapeOutline {
    /// Upper and lower limit of the shape on the picture.
    fn vertical_range(&self) -> [f64; 2] {
        match self {
            ShapeOutline::Circle { y, radius, .. } => [y - radius, y + radius],
            ShapeOutline::Face { corners, .. } => value_range(corners.iter().map(|[_, y]| *y)),
            ShapeOutline::Line(ends) => value_range(ends.iter().map(|[_, y]| *y)),
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
            ShapeOutline::Line(_) => 0.0,
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
            ShapeOutline::Line(ends) => value_range(ends.iter().map(|[x, _]| *x)),
        }
    }
}

/// Smallest and largest value.
fn value_range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)])
}

/// Text of the SVG file of one state.
///
/// Seen from the front, a little from the right and from above; z points up. The scale is set by most of the grains, and
/// by walls and landers near them. Outliers are omitted and counted in a line of text: up to one grain in twenty, or more
/// if together they have less than a third of the mass. No grain is smaller than a pixel.
pub fn svg(frame: &Frame, quantity: GrainQuantity) -> String {
    let [text] = svgs(frame, [quantity]);
    text
}

/// Texts as [`svg`] returns them, by each of the quantities.
pub fn svgs<const N: usize>(frame: &Frame, quantities: [GrainQuantity; N]) -> [String; N] {
    let window = ViewWindow::around_bodies(frame, &ViewCamera::default());
    let visible = VisibleState::new(frame, &window, 1.0);
    quantities.map(|quantity| {
        let mut text = svg_head(PICTURE_SIDE + STRIP_WIDTH, PICTURE_SIDE);
        let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
        let scale = ColourScale::from_frames(quantity, &[frame]);
        draw_state(frame, &window, &visible, &scale, 0, &mut write_line);
        draw_legend(&scale, PICTURE_SIDE + 20.0, &mut write_line);
        write_line("</svg>".into());
        text
    })
}

/// Text of the SVG file of several states side by side, on one scale: above by kinetic energy, below by neighbours, each row
/// with one scale of colours. With walls or periods all states are seen from one position.
pub fn snapshots_svg(frames: &[&Frame]) -> String {
    const STATE_SIDE: f64 = 0.5 * PICTURE_SIDE;
    let total_width = STATE_SIDE * frames.len() as f64;
    let mut text = svg_head(total_width + STRIP_WIDTH, 2.0 * STATE_SIDE);
    let mut write_line = |line: String| writeln!(text, "{line}").expect("writing to a string");
    let camera = ViewCamera::default();
    let windows: Vec<ViewWindow> = frames.par_iter().map(|frame| ViewWindow::around_bodies(frame, &camera)).collect();
    let windows = match frames.iter().any(|frame| !frame.walls.is_empty() || frame.cell().is_periodic()) {
        true => {
            vec![windows.iter().fold(ViewWindow::EMPTY, |all, window| all.union(window)); frames.len()]
        }
        false => {
            // NaN of states without grains is not the largest.
            let half = windows.iter().map(ViewWindow::half_side).fold(f64::NAN, f64::max);
            windows.into_iter().map(|window| ViewWindow { halves: [half; 2], ..window }).collect()
        }
    };
    let visible: Vec<VisibleState> = frames
        .par_iter()
        .zip(&windows)
        .map(|(frame, window)| VisibleState::new(frame, window, PICTURE_SIDE / STATE_SIDE))
        .collect();
    for (row, quantity) in [GrainQuantity::KineticEnergy, GrainQuantity::Neighbours].into_iter().enumerate() {
        let scale = ColourScale::from_frames(quantity, frames);
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
        draw_legend(&scale, total_width + 10.0, &mut write_line);
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
        let grains = inside.into_iter().flat_map(|disc| disc.shapes);
        let shapes = visible_shapes(grains.chain(project_walls(frame, window)).collect());
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
    let pixels_per_metre = pixels_per_metre(window);
    let edge = EDGE_WIDTH * pixel_scale;
    write_line("<defs>".into());
    for class in 0..=max_class {
        write_line(gradient_svg(&format!("c{number}-{class}"), scale.class_colour(class)));
    }
    if shapes.iter().any(|shape| shape.paint == ShapePaint::OpaqueWall) {
        write_line(gradient_svg(&format!("w{number}"), WALL_COLOUR));
    }
    write_line(format!(
        "<clipPath id=\"frame{number}\"><rect width=\"{PICTURE_SIDE}\" height=\"{PICTURE_SIDE}\"/></clipPath>\n</defs>"
    ));
    write_line(format!(
        "<g clip-path=\"url(#frame{number})\" stroke=\"black\" stroke-opacity=\"0.35\" stroke-width=\"{edge}\" \
         stroke-linejoin=\"round\">"
    ));
    for PaintedShape { paint, outline, .. } in shapes {
        let share = (outline.radius() / pixel_scale - MIN_EDGED_RADIUS) / (FULL_EDGE_RADIUS - MIN_EDGED_RADIUS);
        let stroke = match share {
            _ if *paint == ShapePaint::TranslucentWall => format!(" fill-opacity=\"{WALL_OPACITY}\" stroke=\"none\""),
            share if share >= 1.0 => String::new(),
            share if share > 0.0 => format!(" stroke-width=\"{:.2}\"", share * edge),
            _ => " stroke=\"none\"".into(),
        };
        let colour = match paint {
            ShapePaint::Grain(grain) => scale.class_colour(classes[*grain]),
            ShapePaint::OpaqueWall | ShapePaint::TranslucentWall => WALL_COLOUR,
        };
        write_line(match outline {
            ShapeOutline::Circle { x, y, radius } => {
                let gradient = match paint {
                    ShapePaint::Grain(grain) => format!("c{number}-{}", classes[*grain]),
                    _ => format!("w{number}"),
                };
                format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.2}\" fill=\"url(#{gradient})\"{stroke}/>")
            }
            ShapeOutline::Face { corners, light } => {
                let [r, g, b] = shaded_colour(colour, *light);
                let corners: Vec<String> = corners.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
                format!("<polygon points=\"{}\" fill=\"rgb({r:.0},{g:.0},{b:.0})\"{stroke}/>", corners.join(" "))
            }
            ShapeOutline::Line([[ax, ay], [bx, by]]) => {
                format!("<path d=\"M{ax:.1} {ay:.1}L{bx:.1} {by:.1}\" stroke-width=\"{:.2}\"/>", 1.5 * edge)
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
    // A light ground keeps the text readable before walls, and before grains that have left the others.
    if !frame.walls.is_empty() || *outside_count > 0 {
        let height = top + 12.0 + if *outside_count > 0 { 1.2 * FONT_SIZE * pixel_scale } else { 0.0 };
        write_line(format!(
            "<rect width=\"{PICTURE_SIDE}\" height=\"{height}\" fill=\"white\" fill-opacity=\"0.75\"/>"
        ));
    }
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

/// Pixels of the square per metre.
fn pixels_per_metre(window: &ViewWindow) -> f64 {
    (PICTURE_SIDE / 2.0 - BORDER_MARGIN) / window.half_side()
}

/// Projections of the grains on `window`, with radii of at least `min_radius` pixels.
fn project_grains(frame: &Frame, window: &ViewWindow, min_radius: f64) -> Vec<GrainDisc> {
    let view = ViewCamera::default().rotation;
    let positions_in_view: Vec<Vec3> = frame.grains.iter().map(|g| view * g.x).collect();
    let pixels_per_metre = pixels_per_metre(window);
    let to_pixels = |at: &Vec3| square_position(window, at);
    let disc = |(k, (at, grain)): (usize, (&Vec3, &Grain))| {
        let [x, y] = to_pixels(at);
        let radius = (pixels_per_metre * grain.bounding_radius()).max(min_radius);
        let (paint, mut shapes) = (ShapePaint::Grain(k), Vec::new());
        if pixels_per_metre * grain.bounding_radius() <= min_radius {
            shapes.push(PaintedShape { depth: at.y, paint, outline: ShapeOutline::Circle { x, y, radius } });
            return GrainDisc { x, y, radius, shapes };
        }
        if let Some(solid) = &grain.solid {
            let turn = |v: &Vec3| view * (grain.rotation * v);
            for face in &solid.faces {
                let corners: Vec<Vec3> = face.iter().map(|&k| turn(&solid.vertices[k as usize])).collect();
                let normal = face_normal(&corners);
                if normal.y < 0.0 {
                    let depth = at.y + corners.iter().map(|c| c.y).fold(f64::NEG_INFINITY, f64::max);
                    let light = light_intensity(&normal);
                    let corners = corners.iter().map(|c| to_pixels(&(at + c))).collect();
                    shapes.push(PaintedShape { depth, paint, outline: ShapeOutline::Face { corners, light } });
                }
            }
        }
        for (centre, radius) in grain.balls() {
            let centre = at + view * (centre - grain.x);
            let ([x, y], radius) = (to_pixels(&centre), pixels_per_metre * radius);
            shapes.push(PaintedShape { depth: centre.y, paint, outline: ShapeOutline::Circle { x, y, radius } });
        }
        GrainDisc { x, y, radius, shapes }
    };
    positions_in_view.iter().zip(&frame.grains).enumerate().map(disc).collect()
}

/// Position on the square of a point in the rotated axes, pixels; y points down.
fn square_position(window: &ViewWindow, point: &Vec3) -> [f64; 2] {
    let (pixels_per_metre, [x, z]) = (pixels_per_metre(window), window.middle);
    [PICTURE_SIDE / 2.0 + pixels_per_metre * (point.x - x), PICTURE_SIDE / 2.0 - pixels_per_metre * (point.z - z)]
}

/// Shapes of the walls within the square.
fn project_walls(frame: &Frame, window: &ViewWindow) -> Vec<PaintedShape> {
    let (view, mut shapes) = (ViewCamera::default().rotation, Vec::new());
    if !window.half_side().is_finite() {
        return shapes;
    }
    for wall in drawn_walls(frame) {
        let paint = if wall.is_translucent { ShapePaint::TranslucentWall } else { ShapePaint::OpaqueWall };
        for (centre, radius) in wall.balls {
            let centre = view * centre;
            let ([x, y], radius) = (square_position(window, &centre), pixels_per_metre(window) * radius);
            shapes.push(PaintedShape { depth: centre.y, paint, outline: ShapeOutline::Circle { x, y, radius } });
        }
        let vertices: Vec<Vec3> = wall.vertices.iter().map(|x| view * x).collect();
        for face in &wall.faces {
            let corners: Vec<Vec3> = face.iter().map(|&k| vertices[k as usize]).collect();
            let normal = face_normal(&corners);
            if normal.y < 0.0 {
                let depth = corners.iter().map(|c| c.y).fold(f64::NEG_INFINITY, f64::max);
                let light = light_intensity(&normal);
                let corners = corners.iter().map(|corner| square_position(window, corner)).collect();
                shapes.push(PaintedShape { depth, paint, outline: ShapeOutline::Face { corners, light } });
            }
        }
        for [a, b] in wall.edges.iter().filter(|_| wall.is_translucent).map(|edge| edge.map(|k| vertices[k as usize])) {
            let Some((from, to)) = visible_span([a, b].map(|end| square_position(window, &end)), [PICTURE_SIDE; 2])
            else {
                continue;
            };
            let length = (view_length(window, &(b - a)) * (to - from)).max(1.0);
            let pieces = (length / EDGE_PIECE).ceil() as usize;
            let point = |k: usize| a + (b - a) * (from + (to - from) * k as f64 / pieces as f64);
            for ends in (0..pieces).map(|k| [point(k), point(k + 1)]) {
                let depth = ends[0].y.max(ends[1].y);
                let line = ShapeOutline::Line(ends.map(|end| square_position(window, &end)));
                shapes.push(PaintedShape { depth, paint, outline: line });
            }
        }
    }
    let is_inside = |shape: &PaintedShape| {
        let [top, bottom] = shape.outline.vertical_range();
        bottom > 0.0 && top < PICTURE_SIDE
    };
    shapes.retain(is_inside);
    shapes
}

/// Length of a vector of the rotated axes on the square, pixels.
fn view_length(window: &ViewWindow, vector: &Vec3) -> f64 {
    pixels_per_metre(window) * vector.x.hypot(vector.z)
}

/// Visible shapes, far ones first. The shapes are painted over each other on a grid of half a pixel, and those with a
/// remaining cell are kept, and translucent ones. A file then contains only the surface, for any number of grains.
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
    let is_opaque = |shape: &PaintedShape| shape.paint != ShapePaint::TranslucentWall;
    for (owner, shape) in (0..).zip(&shapes).filter(|(_, shape)| is_opaque(shape)) {
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
    shapes.retain(|shape| is_visible.next().is_some_and(|is_visible| is_visible) || !is_opaque(shape));
    shapes
}

/// Gradient for light from the upper left: the colour is lighter there and darker at the far rim.
fn gradient_svg(name: &str, base: [f64; 3]) -> String {
    let mix = |towards: f64, share: f64| {
        let [r, g, b] = base.map(|c| (1.0 - share) * c + share * towards);
        format!("rgb({r:.0},{g:.0},{b:.0})")
    };
    format!(
        "<radialGradient id=\"{name}\" cx=\"0.38\" cy=\"0.34\" r=\"0.72\"><stop offset=\"0\" stop-color=\"{}\"/>\
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

    fn around_bodies(frame: &Frame) -> ViewWindow {
        ViewWindow::around_bodies(frame, &ViewCamera::default())
    }

    #[test]
    fn what_is_hidden_is_left_out_and_what_peeps_out_is_not() {
        let circle = |x: f64, radius: f64, depth: f64| PaintedShape {
            depth,
            paint: ShapePaint::Grain(0),
            outline: ShapeOutline::Circle { x, y: 400.0, radius },
        };
        let (front, hidden, peeping) = (circle(400.0, 100.0, 0.0), circle(410.0, 50.0, 1.0), circle(480.0, 40.0, 2.0));
        assert_eq!(visible_shapes(vec![hidden.clone(), front.clone(), peeping.clone()]), [peeping.clone(), front]);
        // A square that reaches as far hides them as well; a dot before it is seen, however small.
        let corners = vec![[300.0, 300.0], [530.0, 300.0], [530.0, 500.0], [300.0, 500.0]];
        let square = PaintedShape {
            depth: 0.5,
            paint: ShapePaint::Grain(0),
            outline: ShapeOutline::Face { corners, light: 1.0 },
        };
        let dot = circle(310.0, 0.01, 0.1);
        assert_eq!(visible_shapes(vec![dot.clone(), peeping, square.clone(), hidden]), [square, dot]);
    }

    #[test]
    fn of_a_cube_three_faces_are_seen_and_the_upper_is_the_brightest() {
        let mut scene = Scene::default();
        scene.cube([0.0; 3], 1.0);
        let window = around_bodies(&scene.frame());
        let discs = project_grains(&scene.frame(), &window, MIN_GRAIN_RADIUS);
        assert!((discs[0].radius / pixels_per_metre(&window) - 3f64.sqrt()).abs() < 1e-14);
        let height_and_light = |shape: &PaintedShape| match &shape.outline {
            ShapeOutline::Face { corners, light } => (corners.iter().map(|[_, y]| y).sum::<f64>() / 4.0, *light),
            other => panic!("of a cube: {other:?}"),
        };
        let faces: Vec<(f64, f64)> = discs[0].shapes.iter().map(height_and_light).collect();
        let brightest = faces.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!(faces.len() == 3 && faces.iter().all(|face| face.0 >= brightest.0), "{faces:?}");
        assert_eq!(svg(&scene.frame(), GrainQuantity::Neighbours).matches("<polygon").count(), 3);
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
        // 64 J, 16 J, 7.9 mJ and 0.
        let scale = ColourScale::from_frames(GrainQuantity::KineticEnergy, &[&frame]);
        assert_eq!(scale.grain_classes(&frame), [10, 9, 2, 0]);
        let text = svg(&frame, GrainQuantity::KineticEnergy);
        assert!(text.contains("kinetic energy") && text.contains(">30 J<"));
        // With several states the fastest sets the scale, and ids differ.
        let mut slower = scene.frame();
        slower.grains.iter_mut().for_each(|grain| grain.v *= 0.11);
        let scale = ColourScale::from_frames(GrainQuantity::KineticEnergy, &[&frame, &slower]);
        assert_eq!(scale.grain_classes(&slower), [6, 5, 0, 0]);
        let text = snapshots_svg(&[&frame, &slower]);
        assert_eq!((text.matches("id=\"c3-0\"").count(), text.matches("</svg>").count()), (1, 5));
    }

    #[test]
    fn walls_are_drawn_and_hide_no_grain() {
        let mut scene = Scene::default();
        for k in 0..4 {
            scene.grain([2.0 * f64::from(k % 2), 2.0 * f64::from(k / 2), 1.0], 1.0);
        }
        let bare = svg(&scene.frame(), GrainQuantity::Neighbours);
        scene.plate([1.0, 1.0, -0.1], [3.0, 3.0, 0.1]);
        scene.plate([1.0, -2.1, 1.0], [3.0, 0.1, 1.0]); // before the grains
        let text = svg(&scene.frame(), GrainQuantity::Neighbours);
        assert_eq!(text.matches("<circle").count(), bare.matches("<circle").count());
        assert_eq!(text.matches("<polygon").count(), 6, "three faces of each plate are towards the viewer");
        // A driven ball is opaque: what it hides is left out.
        let ball = scene.grain([1.0, -9.0, 4.5], 3.0);
        scene.snapshot.bodies.body_driven[ball] = cd_formats::snapshot::DRIVEN_ALL;
        let text = svg(&scene.frame(), GrainQuantity::Neighbours);
        assert_eq!(text.matches("url(#w0)").count(), 1);
    }

    #[test]
    fn the_scale_bar_is_to_scale() {
        // A sphere of 1 m fills the picture except for the margin.
        let mut scene = Scene::default();
        scene.grain([0.0, 0.0, 0.0], 1.0);
        let window = around_bodies(&scene.frame());
        let (discs, scale) = (project_grains(&scene.frame(), &window, MIN_GRAIN_RADIUS), pixels_per_metre(&window));
        assert!((discs[0].radius - (PICTURE_SIDE / 2.0 - BORDER_MARGIN)).abs() < 1e-9);
        let text = svg(&scene.frame(), GrainQuantity::Neighbours);
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
        assert!(svg(&scene.frame(), GrainQuantity::KineticEnergy).contains("1 of them outside the picture"));
        assert!(pixels_per_metre(&around_bodies(&scene.frame())) > 20.0);
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
        assert!(svg(&scene.frame(), GrainQuantity::Neighbours).contains("20 of them outside the picture"));
        assert!(pixels_per_metre(&around_bodies(&scene.frame())) > 20.0);
    }

    #[test]
    fn small_grains_are_dots_without_edges() {
        // Two of 1 m, 2 km apart, are less than a pixel of 3 m: dots of that size, in the small pictures of twice as many
        // pixels of their own. Of a cube nothing but a dot is left.
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.cube([2000.0, 0.0, 0.0], 0.9);
        let frame = scene.frame();
        let dots = |text: &str, size: &str| text.matches(&format!("r=\"{size}\"")).count();
        let text = svg(&frame, GrainQuantity::Neighbours);
        assert_eq!((dots(&text, "1.00"), text.matches("stroke=\"none\"").count()), (2, 2), "{text}");
        assert_eq!(dots(&snapshots_svg(&[&frame]), "2.00"), 4);
        // Edges of what is larger get wider with it.
        let edge = |distance: f64| {
            let mut scene = Scene::default();
            scene.grain([0.0; 3], 1.0);
            scene.grain([0.0, 0.0, distance], 1.0);
            let text = svg(&scene.frame(), GrainQuantity::Neighbours);
            let circle = text.lines().find(|line| line.starts_with("<circle")).unwrap().to_string();
            circle.split("stroke-width=\"").nth(1).map(|rest| rest.split('"').next().unwrap().parse::<f64>().unwrap())
        };
        assert_eq!(edge(20.0), None); // that of all
        assert!(edge(120.0) > edge(200.0) && edge(200.0) > Some(0.0));
    }

    #[test]
    fn nothing_is_drawn_of_nothing() {
        let text = svg(&Scene::default().frame(), GrainQuantity::KineticEnergy);
        assert!(text.contains("grains: 0") && !text.contains("NaN"));
    }
}
