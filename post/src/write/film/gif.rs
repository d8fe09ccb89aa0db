//! Animated GIF (GIF89a), with one palette for all pictures; pictures after the first have only the pixels that change.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use cd_formats::error::{Fault, Faults};
use gif::{DisposalMethod, Encoder, Frame as GifFrame, Repeat};

use crate::write::colours::{ColourScale, MAX_CLASSES};
use crate::write::raster::{EDGE_SHADE, RgbImage};
use crate::write::view::SHADOW_BRIGHTNESS;

/// Index of pixels that keep the colour of the picture before.
const UNCHANGED: u8 = 0;
/// Number of greys, from black to white.
const GREY_COUNT: usize = 34;
/// Largest number of colours of a GIF.
const MAX_COLOURS: usize = 256;
/// Number of levels of each component in the table of nearest colours.
const LEVELS: usize = 32;

/// Units of time of a GIF in a second.
const UNITS_PER_SECOND: f64 = 100.0;
/// Time for which the last picture stays, s, before the film repeats.
const LAST_SECONDS: f64 = 1.0;

/// Darkest shade of a class, as a share of its colour: [`EDGE_SHADE`] of a surface without light, [`SHADOW_BRIGHTNESS`],
/// rounded to 1/4.
const DARKEST_SHADE: f64 = 0.25;

const _: () = assert!((DARKEST_SHADE - EDGE_SHADE * SHADOW_BRIGHTNESS).abs() < 0.01);

/// Colours of a film, with the nearest of them to each colour.
pub struct FilmPalette {
    colours: Vec<[u8; 3]>,
    /// Index of the nearest colour, by the levels of red, green and blue.
    nearest: Vec<u8>,
}

impl FilmPalette {
    /// Returns shades of all classes, and greys.
    pub fn new(scale: &ColourScale) -> FilmPalette {
        let mut colours: Vec<[f64; 3]> = vec![[255.0; 3]]; // of unchanged pixels, never shown
        colours.extend((0..GREY_COUNT).map(|k| [255.0 * k as f64 / (GREY_COUNT - 1) as f64; 3]));
        let classes = scale.max_class().min(MAX_CLASSES - 1) + 1;
        // Three fifths of the shades of a class are darker: from the shade of an edge without light to the colour. The others
        // lead from the colour to white, for the brightest spots of balls and for pixels that are covered in part.
        let shades = (MAX_COLOURS - colours.len()) / classes;
        let (dark, light) = (3 * shades / 5, shades - 3 * shades / 5);
        for colour in (0..classes).map(|class| scale.class_colour(class)) {
            colours.extend((0..dark).map(|k| {
                let share = DARKEST_SHADE + (1.0 - DARKEST_SHADE) * k as f64 / (dark - 1) as f64;
                colour.map(|c| share * c)
            }));
            colours.extend((1..=light).map(|k| {
                let share = k as f64 / (light + 1) as f64;
                colour.map(|c| c + share * (255.0 - c))
            }));
        }
        let colours: Vec<[u8; 3]> = colours.into_iter().map(|colour| colour.map(|c| c.round() as u8)).collect();
        let middle = |level: usize| (level * 255 + (LEVELS - 1) / 2) / (LEVELS - 1);
        let nearest = (0..LEVELS * LEVELS * LEVELS).map(|k| {
            let wanted = [k / (LEVELS * LEVELS), k / LEVELS % LEVELS, k % LEVELS].map(|level| middle(level) as i32);
            let distance =
                |colour: &[u8; 3]| -> i32 { colour.iter().zip(wanted).map(|(c, w)| (i32::from(*c) - w).pow(2)).sum() };
            (1..colours.len()).min_by_key(|&k| distance(&colours[k])).unwrap_or(1) as u8
        });
        FilmPalette { nearest: nearest.collect(), colours }
    }

    /// Index of the nearest colour of each pixel.
    pub fn indices(&self, image: &RgbImage) -> Vec<u8> {
        let level = |c: u8| (usize::from(c) * (LEVELS - 1) + 127) / 255;
        let index = |[r, g, b]: &[u8; 3]| self.nearest[(level(*r) * LEVELS + level(*g)) * LEVELS + level(*b)];
        image.pixels.iter().map(index).collect()
    }

    /// Colour of an index.
    #[cfg(test)]
    fn colour(&self, index: u8) -> [u8; 3] {
        self.colours[usize::from(index)]
    }
}

/// Writer of a GIF into memory.
pub struct GifFilm {
    /// File of the film, for messages.
    path: PathBuf,
    encoder: Encoder<Vec<u8>>,
    width: usize,
    /// Indices of the picture before.
    before: Option<Vec<u8>>,
    frames_per_second: f64,
    /// Number of pictures written so far.
    written: usize,
    /// Number of pictures of the film.
    count: usize,
}

impl GifFilm {
    /// Starts a film of `count` pictures that repeats without end.
    ///
    /// * `path`: file of the film, for messages.
    /// * `palette`: colours of the pictures.
    pub fn new(
        path: &Path,
        [width, height]: [usize; 2],
        palette: &FilmPalette,
        frames_per_second: f64,
        count: usize,
    ) -> Result<GifFilm, Faults> {
        let mut bytes = palette.colours.concat();
        bytes.resize(3 * MAX_COLOURS, 255);
        let started = Encoder::new(Vec::new(), width as u16, height as u16, &bytes).and_then(|mut encoder| {
            encoder.set_repeat(Repeat::Infinite)?;
            Ok(encoder)
        });
        let encoder = started.map_err(|error| encoding_fault(path, &error))?;
        Ok(GifFilm { path: path.to_path_buf(), encoder, width, before: None, frames_per_second, written: 0, count })
    }

    /// Appends a picture by its indices.
    pub fn append(&mut self, indices: Vec<u8>) -> Result<(), Faults> {
        let [left, top, width, height] = match &self.before {
            Some(before) => changed_rectangle(before, &indices, self.width),
            None => [0, 0, self.width, indices.len() / self.width],
        };
        let mut buffer = Vec::with_capacity(width * height);
        for row in top..top + height {
            for k in row * self.width + left..row * self.width + left + width {
                let is_unchanged = self.before.as_ref().is_some_and(|before| before[k] == indices[k]);
                buffer.push(if is_unchanged { UNCHANGED } else { indices[k] });
            }
        }
        // Times add up to the frame rate, though each is a whole number of hundredths of a second.
        let end = |pictures: usize| (UNITS_PER_SECOND * pictures as f64 / self.frames_per_second).round();
        let mut delay = end(self.written + 1) - end(self.written);
        self.written += 1;
        if self.written == self.count {
            delay += LAST_SECONDS * UNITS_PER_SECOND;
        }
        let frame = GifFrame {
            delay: delay.min(f64::from(u16::MAX)) as u16,
            dispose: DisposalMethod::Keep,
            transparent: Some(UNCHANGED),
            left: left as u16,
            top: top as u16,
            width: width as u16,
            height: height as u16,
            buffer: Cow::Owned(buffer),
            ..GifFrame::default()
        };
        self.before = Some(indices);
        self.encoder.write_frame(&frame).map_err(|error| encoding_fault(&self.path, &error))
    }

    /// Returns the bytes of the file.
    pub fn finish(self) -> Result<Vec<u8>, Faults> {
        self.encoder.into_inner().map_err(|error| encoding_fault(&self.path, &error))
    }
}

/// Fault of pictures that the library does not encode.
fn encoding_fault(path: &Path, error: &gif::EncodingError) -> Faults {
    Fault::new(path, None, "film", error.to_string(), "choose a name that ends in .mp4, or a smaller --size").into()
}

/// Left, top, width and height of the smallest rectangle with all pixels that differ, one pixel if none does.
fn changed_rectangle(before: &[u8], after: &[u8], width: usize) -> [usize; 4] {
    let mut found = [usize::MAX, usize::MAX, 0, 0];
    for (row, (a, b)) in before.chunks(width).zip(after.chunks(width)).enumerate() {
        let differs = |(a, b): (&u8, &u8)| a != b;
        let Some(first) = a.iter().zip(b).position(differs) else { continue };
        let last = a.iter().zip(b).rposition(differs).unwrap_or(first);
        found = [found[0].min(first), found[1].min(row), found[2].max(last), row];
    }
    let [left, top, right, bottom] = found;
    if left == usize::MAX { [0, 0, 1, 1] } else { [left, top, right + 1 - left, bottom + 1 - top] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::colours::{GrainQuantity, ValueSpread};
    use crate::write::view::shaded_colour;

    fn scale() -> ColourScale {
        let spread = ValueSpread { least: 0.0, largest: 1.0, low: 0.0, high: 1.0 };
        ColourScale::new(GrainQuantity::Speed, spread, None, None)
    }

    /// Pictures of the film as a player shows them, and the time of each, s.
    fn played(bytes: &[u8], palette: &FilmPalette) -> Vec<(Vec<[u8; 3]>, f64)> {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes).unwrap();
        let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
        let mut screen = vec![[0; 3]; width * height];
        let mut pictures = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (k, index) in frame.buffer.iter().enumerate().filter(|(_, index)| Some(**index) != frame.transparent) {
                let (x, y) = (k % usize::from(frame.width), k / usize::from(frame.width));
                screen[(usize::from(frame.top) + y) * width + usize::from(frame.left) + x] = palette.colour(*index);
            }
            pictures.push((screen.clone(), f64::from(frame.delay) / 100.0));
        }
        pictures
    }

    #[test]
    fn a_film_decodes_to_its_pictures() {
        let palette = FilmPalette::new(&scale());
        assert!(palette.colours.len() <= MAX_COLOURS);
        let image = |k: usize| {
            let mut image = RgbImage::new(30, 20);
            image.fill_rect([k % 7, 3], [5 + k % 3, 4], scale().class_colour(k % 4).map(|c| c as u8));
            image
        };
        // The last two are equal.
        let images: Vec<RgbImage> = (0..9).chain([8]).map(image).collect();
        let mut film = GifFilm::new(Path::new("film.gif"), [30, 20], &palette, 30.0, images.len()).unwrap();
        for image in &images {
            film.append(palette.indices(image)).unwrap();
        }
        let played = played(&film.finish().unwrap(), &palette);
        assert_eq!(played.len(), images.len());
        for ((shown, _), image) in played.iter().zip(&images) {
            let wanted: Vec<[u8; 3]> = palette.indices(image).into_iter().map(|k| palette.colour(k)).collect();
            assert_eq!(*shown, wanted);
        }
        // 10 pictures at 30 a second, and the last stays a second more.
        let seconds: Vec<f64> = played.iter().map(|(_, seconds)| *seconds).collect();
        assert!(seconds[..9].iter().all(|s| [0.03, 0.04].contains(s)), "{seconds:?}");
        assert!((seconds.iter().sum::<f64>() - 1.33).abs() < 1e-12, "{seconds:?}");
    }

    #[test]
    fn palettes_are_close_to_the_colours_of_grains() {
        let (scale, mut largest) = (scale(), 0.0_f64);
        let palette = FilmPalette::new(&scale);
        for class in 0..=scale.max_class() {
            for light in 0..=20 {
                let colour = shaded_colour(scale.class_colour(class), f64::from(light) / 20.0).map(|c| c.round() as u8);
                let image = RgbImage { width: 1, height: 1, pixels: vec![colour] };
                let shown = palette.colour(palette.indices(&image)[0]);
                let difference = colour.iter().zip(shown).map(|(a, b)| (f64::from(*a) - f64::from(b)).abs());
                largest = largest.max(difference.fold(0.0, f64::max));
            }
        }
        // Half of the distance of shades, 0.75 / 10 of 250, and of the levels of the table, with their rounding.
        assert!(largest <= 16.0, "{largest}");
        let ends = RgbImage { width: 2, height: 1, pixels: vec![[255; 3], [0; 3]] };
        let shown: Vec<[u8; 3]> = palette.indices(&ends).into_iter().map(|k| palette.colour(k)).collect();
        assert_eq!(shown, [[255; 3], [0; 3]]);
    }

    #[test]
    fn rectangles_contain_all_changes() {
        let before = vec![1; 12];
        assert_eq!(changed_rectangle(&before, &before, 4), [0, 0, 1, 1]);
        let mut after = before.clone();
        (after[5], after[10]) = (2, 2);
        assert_eq!(changed_rectangle(&before, &after, 4), [1, 1, 2, 2]);
    }
}
