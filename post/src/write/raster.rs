//! Pictures of pixels: a canvas on which the nearest of balls, faces and lines is visible at each pixel, and text.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width};

use crate::math::Vec3;
use crate::write::view::{face_normal, light_intensity, shaded_colour, visible_span};

/// Cells of the canvas along the side of a pixel; a pixel is their mean, which smooths edges.
const CELLS_PER_PIXEL: usize = 2;

/// Shade of the rim of a ball and of the edges of a face, and their width, pixels.
pub const EDGE_SHADE: f64 = 0.55;
const EDGE_WIDTH: f64 = 0.9;
/// Least radius of balls and faces with edges, pixels, as edges would cover smaller ones.
const MIN_EDGED_RADIUS: f64 = 4.0;

/// Depth offset of a line in front of the surface on which it lies, pixels: more than the rounding of depths.
const LINE_DEPTH_OFFSET: f32 = 0.75;

/// Colour of texts and lines.
pub const INK: [u8; 3] = [60, 60, 60];

/// Picture in red, green and blue.
#[derive(Debug, Clone, PartialEq)]
pub struct RgbImage {
    pub width: usize,
    pub height: usize,
    /// Pixels row by row from above.
    pub pixels: Vec<[u8; 3]>,
}

impl RgbImage {
    /// White picture.
    pub fn new(width: usize, height: usize) -> RgbImage {
        RgbImage { width, height, pixels: vec![[255; 3]; width * height] }
    }

    /// Fills a rectangle; parts outside of the picture are left out.
    pub fn fill_rect(&mut self, [left, top]: [usize; 2], [width, height]: [usize; 2], colour: [u8; 3]) {
        let (left, right) = (left.min(self.width), (left + width).min(self.width));
        for row in top.min(self.height)..(top + height).min(self.height) {
            self.pixels[row * self.width + left..row * self.width + right].fill(colour);
        }
    }

    /// Mixes a rectangle with a share of white.
    pub fn lighten_rect(&mut self, [left, top]: [usize; 2], [width, height]: [usize; 2], share: f64) {
        let (left, right) = (left.min(self.width), (left + width).min(self.width));
        for row in top.min(self.height)..(top + height).min(self.height) {
            for pixel in &mut self.pixels[row * self.width + left..row * self.width + right] {
                *pixel = pixel.map(|c| (f64::from(c) + share * (255.0 - f64::from(c))).round() as u8);
            }
        }
    }

    /// Writes a line of text with its upper left corner at a pixel; characters that the font lacks become `?`.
    pub fn write_text(&mut self, [left, top]: [usize; 2], text: &str, font: TextFont) {
        for (k, letter) in text.chars().enumerate() {
            let glyph = font.glyph(letter);
            for (y, row) in glyph.rows().enumerate() {
                for (x, coverage) in row.iter().enumerate() {
                    let (x, y) = (left + k * font.letter_width() + x, top + y);
                    if x < self.width && y < self.height {
                        let pixel = &mut self.pixels[y * self.width + x];
                        let share = f64::from(*coverage) / 255.0;
                        *pixel = [0, 1, 2]
                            .map(|c| ((1.0 - share) * f64::from(pixel[c]) + share * f64::from(INK[c])).round() as u8);
                    }
                }
            }
        }
    }
}

/// Font of a height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextFont(RasterHeight);

impl TextFont {
    /// Font for a picture of this height, pixels.
    pub fn for_height(height: usize) -> TextFont {
        TextFont(match height {
            0..450 => RasterHeight::Size16,
            450..750 => RasterHeight::Size20,
            750..1050 => RasterHeight::Size24,
            _ => RasterHeight::Size32,
        })
    }

    /// Width of a letter, pixels; all have the same.
    pub fn letter_width(self) -> usize {
        get_raster_width(FontWeight::Regular, self.0)
    }

    /// Height of a line, pixels.
    pub fn line_height(self) -> usize {
        self.0.val()
    }

    fn glyph(self, letter: char) -> RasterizedChar {
        let raster = |letter: char| get_raster(letter, FontWeight::Regular, self.0);
        raster(letter).or_else(|| raster('?')).expect("the font has Latin letters")
    }
}

/// Canvas on which the nearest shape is visible. Positions are in pixels, y down; a depth is in pixels, too, larger is
/// farther.
pub struct DepthCanvas {
    /// Size, cells.
    width: usize,
    height: usize,
    colours: Vec<[f32; 3]>,
    depths: Vec<f32>,
}

/// Position on the canvas with its depth, pixels.
pub type CanvasPoint = [f64; 3];

impl DepthCanvas {
    /// White canvas of a size in pixels.
    pub fn new(width: usize, height: usize) -> DepthCanvas {
        let (width, height) = (CELLS_PER_PIXEL * width, CELLS_PER_PIXEL * height);
        let cells = width * height;
        DepthCanvas { width, height, colours: vec![[255.0; 3]; cells], depths: vec![f32::INFINITY; cells] }
    }

    /// Cells along one axis whose middles are between two positions, and the middle of each, pixels.
    fn cells_between(count: usize, from: f64, to: f64) -> impl Iterator<Item = (usize, f64)> {
        let scale = CELLS_PER_PIXEL as f64;
        let cell = |c: f64| c.clamp(0.0, count as f64) as usize;
        let range = cell((scale * from - 0.5).ceil())..cell((scale * to - 0.5).floor() + 1.0);
        range.map(move |k| (k, (k as f64 + 0.5) / scale))
    }

    /// Draws a ball.
    pub fn draw_ball(&mut self, [x, y, depth]: CanvasPoint, radius: f64, colour: [f64; 3]) {
        let square = radius * radius;
        // Cells farther from the middle belong to the rim.
        let rim = if radius < MIN_EDGED_RADIUS { square } else { (radius - EDGE_WIDTH).powi(2) };
        for (row, cell_y) in DepthCanvas::cells_between(self.height, y - radius, y + radius) {
            let dy = cell_y - y;
            for (column, cell_x) in DepthCanvas::cells_between(self.width, x - radius, x + radius) {
                let dx = cell_x - x;
                let distance = dx * dx + dy * dy;
                if distance > square {
                    continue;
                }
                let bulge = (square - distance).sqrt();
                let (cell, near) = (row * self.width + column, (depth - bulge) as f32);
                if near < self.depths[cell] {
                    let normal = Vec3::new(dx, -bulge, -dy) / radius;
                    let shade = if distance > rim { EDGE_SHADE } else { 1.0 };
                    let shaded = shaded_colour(colour, light_intensity(&normal)).map(|c| shade * c);
                    self.colours[cell] = shaded.map(|c| c as f32);
                    self.depths[cell] = near;
                }
            }
        }
    }

    /// Draws a flat polygon, convex or not, with an opacity from 0 to 1; below 1 it does not hide what is drawn later.
    pub fn draw_face(&mut self, corners: &[CanvasPoint], colour: [f64; 3], opacity: f64) {
        let normal = face_normal(&corners.iter().map(|corner| Vec3::from(*corner)).collect::<Vec<_>>());
        // A face that is seen from its edge has no area.
        if normal.z.abs() <= 1e-9 || normal.z.is_nan() {
            return;
        }
        let [first_x, first_y, first_depth] = corners[0];
        let (across, down) = (-normal.x / normal.z, -normal.y / normal.z);
        let (top, bottom) =
            corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c[1]), high.max(c[1])));
        let mut crossings: Vec<f64> = Vec::new();
        for (row, y) in DepthCanvas::cells_between(self.height, top, bottom) {
            crossings.clear();
            for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                if (a[1] <= y) != (b[1] <= y) {
                    crossings.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                }
            }
            crossings.sort_by(f64::total_cmp);
            for span in crossings.chunks_exact(2) {
                for (column, x) in DepthCanvas::cells_between(self.width, span[0], span[1]) {
                    let depth = (first_depth + across * (x - first_x) + down * (y - first_y)) as f32;
                    let cell = row * self.width + column;
                    if depth < self.depths[cell] {
                        self.blend(cell, colour, opacity);
                        if opacity >= 1.0 {
                            self.depths[cell] = depth;
                        }
                    }
                }
            }
        }
    }

    /// Draws a line a pixel wide, with an opacity from 0 to 1.
    pub fn draw_line(&mut self, ends: [CanvasPoint; 2], colour: [f64; 3], opacity: f64) {
        let border = [self.width, self.height].map(|cells| cells as f64 / CELLS_PER_PIXEL as f64);
        let Some((from, to)) = visible_span(ends, border) else { return };
        let [a, b] = ends;
        let length = (0..2).map(|axis| (b[axis] - a[axis]).abs()).fold(0.0, f64::max);
        let steps = (CELLS_PER_PIXEL as f64 * length * (to - from)).ceil().max(1.0) as usize;
        // The line is two cells wide: a flat one has the cells below, too, a steep one those to the right.
        let next = if (b[0] - a[0]).abs() > (b[1] - a[1]).abs() { [0, 1] } else { [1, 0] };
        for k in 0..=steps {
            let share = from + (to - from) * k as f64 / steps as f64;
            let point: [f64; 3] = std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]));
            let cell = [0, 1].map(|axis| (CELLS_PER_PIXEL as f64 * point[axis]).floor());
            for side in 0..CELLS_PER_PIXEL {
                let [x, y] = [0, 1].map(|axis| cell[axis] + (side * next[axis]) as f64);
                // False of numbers that are not finite, too.
                if !((0.0..self.width as f64).contains(&x) && (0.0..self.height as f64).contains(&y)) {
                    continue;
                }
                let cell = y as usize * self.width + x as usize;
                if point[2] as f32 - LINE_DEPTH_OFFSET < self.depths[cell] {
                    self.blend(cell, colour, opacity);
                }
            }
        }
    }

    /// Draws a translucent face that is seen from outside.
    pub fn draw_translucent_face(&mut self, corners: &[CanvasPoint], colour: [f64; 3], opacity: f64) {
        if view_normal(corners).y < 0.0 {
            self.draw_face(corners, colour, opacity);
        }
    }

    /// Draws an opaque face that is seen from outside, in the light, with its edges.
    pub fn draw_solid_face(&mut self, corners: &[CanvasPoint], colour: [f64; 3]) {
        let normal = view_normal(corners);
        if normal.y >= 0.0 || normal.y.is_nan() {
            return;
        }
        let shaded = shaded_colour(colour, light_intensity(&normal));
        self.draw_face(corners, shaded, 1.0);
        let reach = |axis: usize| {
            let along = corners.iter().map(|corner| corner[axis]);
            along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
        };
        if reach(0).max(reach(1)) >= 2.0 * MIN_EDGED_RADIUS {
            for (a, b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
                self.draw_line([*a, *b], shaded.map(|c| EDGE_SHADE * c), 0.6);
            }
        }
    }

    fn blend(&mut self, cell: usize, colour: [f64; 3], opacity: f64) {
        let under = &mut self.colours[cell];
        for (below, above) in under.iter_mut().zip(colour) {
            *below += opacity as f32 * (above as f32 - *below);
        }
    }

    /// Copies the canvas into the upper left corner of a picture.
    pub fn copy_to(&self, image: &mut RgbImage) {
        const CELLS: f32 = (CELLS_PER_PIXEL * CELLS_PER_PIXEL) as f32;
        for y in 0..(self.height / CELLS_PER_PIXEL).min(image.height) {
            for x in 0..(self.width / CELLS_PER_PIXEL).min(image.width) {
                let mut sum = [0.0_f32; 3];
                for row in 0..CELLS_PER_PIXEL {
                    let first = (CELLS_PER_PIXEL * y + row) * self.width + CELLS_PER_PIXEL * x;
                    for colour in &self.colours[first..first + CELLS_PER_PIXEL] {
                        sum.iter_mut().zip(colour).for_each(|(sum, c)| *sum += c);
                    }
                }
                image.pixels[y * image.width + x] = sum.map(|c| (c / CELLS).round().clamp(0.0, 255.0) as u8);
            }
        }
    }
}

/// Normal of a face in the axes of the view: x to the right, y away and z up.
fn view_normal(corners: &[CanvasPoint]) -> Vec3 {
    face_normal(&corners.iter().map(|[x, y, depth]| Vec3::new(*x, *depth, -y)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(draw: impl Fn(&mut DepthCanvas)) -> RgbImage {
        let mut canvas = DepthCanvas::new(40, 40);
        draw(&mut canvas);
        let mut image = RgbImage::new(40, 40);
        canvas.copy_to(&mut image);
        image
    }

    fn pixel(image: &RgbImage, x: usize, y: usize) -> [u8; 3] {
        image.pixels[y * image.width + x]
    }

    const RED: [f64; 3] = [200.0, 0.0, 0.0];
    const BLUE: [f64; 3] = [0.0, 0.0, 200.0];

    #[test]
    fn a_disc_covers_its_area() {
        let drawn = image(|canvas| canvas.draw_ball([20.0, 20.0, 0.0], 12.0, RED));
        let covered: f64 = drawn.pixels.iter().filter(|[_, green, _]| *green < 128).count() as f64;
        // Pixels on the rim, 2 pi r, are in or out: half of their scatter, and a pixel of the rim is a fifth of a per cent.
        assert!((covered / (std::f64::consts::PI * 144.0) - 1.0).abs() < 0.03, "{covered}");
        // Lighter towards the light from the upper left.
        assert!(pixel(&drawn, 15, 15)[0] > pixel(&drawn, 25, 25)[0]);
    }

    #[test]
    fn the_nearest_is_visible_in_any_order() {
        let near = |canvas: &mut DepthCanvas| canvas.draw_ball([20.0, 20.0, 0.0], 8.0, RED);
        let far = |canvas: &mut DepthCanvas| canvas.draw_ball([24.0, 20.0, 30.0], 8.0, BLUE);
        let square = [[4.0, 4.0, 14.0], [4.0, 36.0, 14.0], [36.0, 36.0, 14.0], [36.0, 4.0, 14.0]];
        let face = |canvas: &mut DepthCanvas| canvas.draw_face(&square, [0.0, 200.0, 0.0], 1.0);
        let first = image(|canvas| {
            near(canvas);
            far(canvas);
            face(canvas);
        });
        assert_eq!(
            first,
            image(|canvas| {
                face(canvas);
                far(canvas);
                near(canvas);
            })
        );
        assert!(pixel(&first, 20, 20)[0] > 100 && pixel(&first, 20, 20)[2] < 100);
        // The far ball reaches from 22 to 38: the face, 14 away, hides it.
        assert_eq!(pixel(&first, 30, 20), [0, 200, 0]);
        // A translucent one leaves it visible.
        let glass = image(|canvas| {
            far(canvas);
            canvas.draw_face(&square, [0.0; 3], 0.5);
        });
        let bare = image(far);
        let half = |c: u8| (0.5 * f64::from(c)).round() as u8;
        assert_eq!(pixel(&glass, 24, 20), pixel(&bare, 24, 20).map(half));
    }

    #[test]
    fn faces_are_filled_between_their_edges() {
        // An L of three squares of side 10, not convex, tilted in depth.
        let corners = [[5.0, 5.0], [5.0, 25.0], [25.0, 25.0], [25.0, 15.0], [15.0, 15.0], [15.0, 5.0]];
        let drawn = image(|canvas| canvas.draw_face(&corners.map(|[x, y]| [x, y, 0.3 * x + 0.1 * y]), RED, 1.0));
        assert_eq!(drawn.pixels.iter().filter(|pixel| **pixel == [200, 0, 0]).count(), 300);
        assert_eq!((pixel(&drawn, 20, 10), pixel(&drawn, 10, 10)), ([255; 3], [200, 0, 0]));
        // Faces that are seen from behind or from their edge are not drawn.
        let white = RgbImage::new(40, 40);
        let away = [[5.0, 5.0, 0.0], [25.0, 5.0, 0.0], [25.0, 25.0, 0.0]];
        let edge_on = [[5.0, 5.0, 0.0], [25.0, 5.0, 0.0], [25.0, 5.0, 10.0]];
        let towards = [away[2], away[1], away[0]];
        assert_eq!(image(|canvas| canvas.draw_solid_face(&away, RED)), white);
        assert_eq!(image(|canvas| canvas.draw_solid_face(&edge_on, RED)), white);
        assert_ne!(image(|canvas| canvas.draw_solid_face(&towards, RED)), white);
    }

    #[test]
    fn shapes_beyond_the_border_are_cut_off() {
        let far = 1e12;
        let drawn = image(|canvas| {
            canvas.draw_face(&[[-far, -far, 0.0], [-far, far, 0.0], [far, far, 0.0], [far, -far, 0.0]], RED, 1.0);
            canvas.draw_line([[-far, 20.0, -5.0], [far, 20.0, -5.0]], [0.0; 3], 1.0);
            canvas.draw_ball([-1e9, 0.0, 0.0], 3.0, BLUE);
            canvas.draw_line([[f64::NAN, 0.0, 0.0], [1.0, 1.0, 0.0]], BLUE, 1.0);
        });
        let black = drawn.pixels.iter().filter(|pixel| **pixel == [0; 3]).count();
        let red = drawn.pixels.iter().filter(|pixel| **pixel == [200, 0, 0]).count();
        assert_eq!((black, red), (40, 1560));
    }

    #[test]
    fn texts_have_all_letters_of_legends() {
        let font = TextFont::for_height(600);
        for letter in "t = -0123456789.e+ µm/s (Pa) °".chars() {
            assert_ne!(font.glyph(letter).pixels(), font.glyph('?').pixels(), "{letter}");
        }
        let mut image = RgbImage::new(60, 30);
        image.write_text([0, 0], "ij", font);
        let dark = |from: usize, to: usize| {
            image.pixels.iter().enumerate().filter(|(k, p)| (from..to).contains(&(k % 60)) && p[0] < 128).count()
        };
        let width = font.letter_width();
        assert!(dark(0, width) > 5 && dark(width, 2 * width) > 5 && dark(2 * width, 60) == 0);
        image.write_text([58, 28], "cut off at the border", font);
    }
}
