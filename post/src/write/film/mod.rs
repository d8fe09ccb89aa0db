//! `POSTPRO/movie.gif`, `movie.mp4`: a state after the other, seen from one position, with one scale of colours.
//!
//! A GIF plays in every browser, in mail and in office programs, and needs no other program here. Its 256 colours are
//! enough: each class of the scale has 17 shades or more. An MP4 needs ffmpeg.

use crate::frame::Frame;
use crate::math::Vec3;
use crate::write::colours::ColourScale;
use crate::write::raster::{CanvasPoint, DepthCanvas, INK, RgbImage, TextFont};
use crate::write::scale::{format_digits, round_below, unit_prefix};
use crate::write::view::{ViewCamera, ViewWindow, WALL_COLOUR, WALL_OPACITY, drawn_walls};

pub mod gif;
pub mod mp4;

/// Margin between grains and border, as a share of the height.
const BORDER_SHARE: f64 = 1.0 / 16.0;
/// Least radius of a grain, pixels.
const MIN_GRAIN_RADIUS: f64 = 0.75;

/// Settings that all pictures of a film share.
#[derive(Debug, Clone)]
pub struct FilmSettings {
    pub camera: ViewCamera,
    pub window: ViewWindow,
    pub scale: ColourScale,
    /// Height, pixels; the states fill a square of this side, the scale of colours is to the right of it.
    pub height: usize,
    /// Digits of the time after the decimal point.
    pub time_decimals: usize,
}

impl FilmSettings {
    fn font(&self) -> TextFont {
        TextFont::for_height(self.height)
    }

    /// Width of a picture, pixels: an even number, as films require.
    pub fn width(&self) -> usize {
        let font = self.font();
        let titles = self.scale.title_lines().into_iter().map(|line| line.chars().count());
        let labels = self.scale.labels.iter().map(|label| label.chars().count() + 3);
        let letters = titles.chain(labels).max().unwrap_or(0) + 2;
        (self.height + letters * font.letter_width()).next_multiple_of(2)
    }

    fn pixels_per_metre(&self) -> f64 {
        (0.5 - BORDER_SHARE) * self.height as f64 / self.window.half_side()
    }

    /// Position of a point in the picture.
    fn canvas_point(&self, x: &Vec3) -> CanvasPoint {
        let (at, scale, middle) = (self.camera.rotation * x, self.pixels_per_metre(), 0.5 * self.height as f64);
        let [across, up] = self.window.middle;
        [middle + scale * (at.x - across), middle - scale * (at.z - up), scale * at.y]
    }

    /// Picture of a state.
    pub fn picture(&self, frame: &Frame) -> RgbImage {
        let mut image = RgbImage::new(self.width(), self.height);
        let mut canvas = DepthCanvas::new(self.height, self.height);
        if self.window.half_side() > 0.0 {
            self.draw_grains(frame, &mut canvas);
            self.draw_walls(frame, &mut canvas);
        }
        canvas.copy_to(&mut image);
        self.write_texts(frame, &mut image);
        self.draw_legend(&mut image);
        image
    }

    fn draw_grains(&self, frame: &Frame, canvas: &mut DepthCanvas) {
        let scale = self.pixels_per_metre();
        for (grain, class) in frame.grains.iter().zip(self.scale.grain_classes(frame)) {
            let colour = self.scale.class_colour(class);
            if scale * grain.bounding_radius() < MIN_GRAIN_RADIUS {
                canvas.draw_ball(self.canvas_point(&grain.x), MIN_GRAIN_RADIUS, colour);
                continue;
            }
            for (centre, radius) in grain.balls() {
                canvas.draw_ball(self.canvas_point(&centre), scale * radius, colour);
            }
            let vertices: Vec<CanvasPoint> = grain.vertices().map(|x| self.canvas_point(&x)).collect();
            for face in grain.solid.iter().flat_map(|solid| &solid.faces) {
                let corners: Vec<CanvasPoint> = face.iter().map(|&k| vertices[k as usize]).collect();
                canvas.draw_solid_face(&corners, colour);
            }
        }
    }

    /// Draws the walls, the translucent ones last.
    fn draw_walls(&self, frame: &Frame, canvas: &mut DepthCanvas) {
        let mut walls = drawn_walls(frame);
        walls.sort_by_key(|wall| wall.is_translucent);
        for wall in walls {
            let vertices: Vec<CanvasPoint> = wall.vertices.iter().map(|x| self.canvas_point(x)).collect();
            for (centre, radius) in &wall.balls {
                canvas.draw_ball(self.canvas_point(centre), self.pixels_per_metre() * radius, WALL_COLOUR);
            }
            for face in &wall.faces {
                let corners: Vec<CanvasPoint> = face.iter().map(|&k| vertices[k as usize]).collect();
                if wall.is_translucent {
                    canvas.draw_translucent_face(&corners, WALL_COLOUR, WALL_OPACITY);
                } else {
                    canvas.draw_solid_face(&corners, WALL_COLOUR);
                }
            }
            if wall.is_translucent {
                for edge in &wall.edges {
                    canvas.draw_line(edge.map(|k| vertices[k as usize]), WALL_COLOUR.map(|c| 0.6 * c), 0.6);
                }
            }
        }
    }

    /// Writes time and number of grains above, and draws the scale of lengths below.
    fn write_texts(&self, frame: &Frame, image: &mut RgbImage) {
        let (font, line) = (self.font(), self.font().line_height());
        let margin = line / 2;
        // A light ground keeps the texts readable in front of walls.
        let texts =
            [format!("t = {:.*} s", self.time_decimals, frame.meta.time), format!("grains: {}", frame.grains.len())];
        let letters = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0);
        image.lighten_rect([0, 0], [(letters + 2) * font.letter_width(), 3 * line], 0.75);
        for (k, text) in texts.iter().enumerate() {
            image.write_text([margin, margin + k * (line + line / 4)], text, font);
        }
        let scale = self.pixels_per_metre();
        if scale.is_finite() && scale > 0.0 {
            let length = round_below(0.2 * self.height as f64 / scale);
            let (factor, unit) = unit_prefix(length, "m");
            let bottom = self.height - margin - line / 5;
            image.fill_rect([margin, bottom], [(length * scale).round() as usize, line / 5], INK);
            image.write_text(
                [margin, bottom - line - line / 4],
                &format!("{} {unit}", format_digits(length / factor, 3)),
                font,
            );
        }
    }

    /// Draws the colours with their labels at the right.
    fn draw_legend(&self, image: &mut RgbImage) {
        let (font, line) = (self.font(), self.font().line_height());
        let left = self.height + font.letter_width();
        for (k, text) in self.scale.title_lines().iter().enumerate() {
            image.write_text([left, line / 2 + k * (line + line / 4)], text, font);
        }
        let top = line / 2 + 3 * (line + line / 4);
        let class_height = ((self.height - top - line) / self.scale.labels.len()).min(2 * line).max(1);
        for (class, label) in self.scale.labels.iter().enumerate() {
            let y = top + (self.scale.max_class() - class) * class_height;
            let colour = self.scale.class_colour(class).map(|c| c.round() as u8);
            image.fill_rect([left, y], [2 * font.letter_width(), class_height], colour);
            image.write_text(
                [left + 3 * font.letter_width(), y + (class_height.saturating_sub(line)) / 2],
                label,
                font,
            );
        }
    }
}

/// Digits after the decimal point with which the times of a film, s, differ and are right to a hundredth of an interval.
pub fn time_decimals(times: &[f64]) -> usize {
    const MAX_DECIMALS: usize = 9;
    let interval = times.windows(2).map(|two| two[1] - two[0]).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let is_exact = |decimals: &usize| {
        let unit = 10f64.powi(*decimals as i32);
        times.iter().all(|time| (time - (time * unit).round() / unit).abs() <= 0.01 * interval)
    };
    (0..MAX_DECIMALS).find(is_exact).unwrap_or(MAX_DECIMALS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Scene;
    use crate::write::colours::GrainQuantity;

    #[test]
    fn times_have_the_digits_that_they_need() {
        assert_eq!(time_decimals(&[0.0, 0.05, 0.1]), 2);
        assert_eq!(time_decimals(&[0.0, 3600.0, 7200.0]), 0);
        assert_eq!(time_decimals(&[0.0, 1e-4, 2e-4]), 4);
        assert_eq!(time_decimals(&[1.0 / 3.0]), 0);
        assert_eq!(time_decimals(&[0.0, 1e-12]), 9);
    }

    fn settings(scene: &Scene) -> FilmSettings {
        let frame = scene.frame();
        let camera = ViewCamera::from_angles(0.0, 0.0);
        FilmSettings {
            camera,
            window: ViewWindow::around_bodies(&frame, &camera),
            scale: ColourScale::from_frames(GrainQuantity::Neighbours, &[&frame]),
            height: 320,
            time_decimals: 1,
        }
    }

    /// Columns and rows from the first to the last pixel of the square for which `holds`.
    fn extent(image: &RgbImage, holds: impl Fn([u8; 3]) -> bool) -> [usize; 4] {
        let mut found = [usize::MAX, usize::MAX, 0, 0];
        for (k, pixel) in image.pixels.iter().enumerate().filter(|(k, _)| k % image.width < image.height) {
            let (x, y) = (k % image.width, k / image.width);
            if (60..260).contains(&y) && holds(*pixel) {
                found = [found[0].min(x), found[1].min(y), found[2].max(x), found[3].max(y)];
            }
        }
        found
    }

    #[test]
    fn grains_have_their_size_and_position() {
        // Balls of 1 m, 4 m apart: 10 m on 280 pixels.
        let mut scene = Scene::default();
        for x in [-4.0, 0.0, 4.0] {
            scene.grain([x, 0.0, 0.0], 1.0);
        }
        let image = settings(&scene).picture(&scene.frame());
        assert_eq!((image.height, image.width % 2), (320, 0));
        let [left, top, right, bottom] = extent(&image, |pixel| pixel != [255; 3]);
        // To a pixel, of which a ball's rim covers a part.
        let near = |a: usize, b: usize| a.abs_diff(b) <= 1;
        assert!(
            near(left, 20) && near(right, 299) && near(top, 132) && near(bottom, 187),
            "{left} {top} {right} {bottom}"
        );
    }

    #[test]
    fn walls_and_polyhedra_are_drawn() {
        let mut scene = Scene::default();
        scene.grain([0.0; 3], 1.0);
        scene.cube([2.5, 0.0, 0.0], 1.0);
        let without = settings(&scene).picture(&scene.frame());
        scene.plate([0.0, 5.0, -1.1], [4.0, 0.1, 0.1]);
        let with = settings(&scene).picture(&scene.frame());
        assert_ne!(without, with);
        let (mut driven, grain) = (Scene::default(), [0.0; 3]);
        driven.grain(grain, 1.0);
        driven.snapshot.bodies.body_driven[0] = cd_formats::snapshot::DRIVEN_ALL;
        let image = settings(&driven).picture(&driven.frame());
        // Without grains the walls are the picture, in grey.
        let [left, _, right, _] = extent(&image, |pixel| pixel != [255; 3]);
        assert!(right - left > 250, "{left} {right}");
        let nothing = settings(&Scene::default()).picture(&Scene::default().frame());
        assert_eq!(extent(&nothing, |pixel| pixel != [255; 3])[2], 0);
    }
}
