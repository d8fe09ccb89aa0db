//! `cd-post movie`: a film of a run, seen from one position, with one scale of colours for all states.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use rayon::prelude::*;

use crate::frame::Frame;
use crate::options::ThreadCount;
use crate::shapes::ShapeCache;
use crate::snapshots::{is_evenly_chosen, progress_bar, select_snapshots};
use crate::write::colours::{ColourScale, GrainQuantity, ValueSpread};
use crate::write::film::gif::{FilmPalette, GifFilm};
use crate::write::film::mp4::Mp4Film;
use crate::write::film::{FilmSettings, time_decimals};
use crate::write::raster::RgbImage;
use crate::write::view::{ViewCamera, ViewWindow};

/// Largest number of pictures a second: browsers show shorter times of a GIF more slowly.
const MAX_RATE: i64 = 50;
/// Smallest and largest height of a film, pixels.
const MIN_HEIGHT: i64 = 160;
const MAX_HEIGHT: i64 = 2160;

/// Options of a film.
#[derive(Debug, Clone, clap::Args)]
pub struct MovieOptions {
    /// Case folder
    #[arg(default_value = ".")]
    pub dir: PathBuf,
    /// File: NAME.gif, which plays everywhere, or NAME.mp4, for which ffmpeg must be installed; default: movie.gif in
    /// DIR/POSTPRO
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Quantity that colours the grains
    #[arg(long, value_enum, default_value_t = GrainQuantity::Neighbours, value_name = "QUANTITY")]
    pub colour: GrainQuantity,
    /// Values at which the colours begin and end, in SI units; default: the range of the grains, without the lowest and the
    /// highest hundredth of each state; of kinetic-energy, powers of ten below the largest
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = parse_range)]
    pub range: Option<[f64; 2]>,
    /// Use every Nth snapshot, counted from the first, and the last
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Largest number of pictures, for which snapshots are chosen evenly
    #[arg(long, default_value_t = 300, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub max_frames: u32,
    /// Pictures per second
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_RATE))]
    pub fps: u32,
    /// Height, pixels; the scale of colours makes the picture wider
    #[arg(long, default_value_t = 600, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(MIN_HEIGHT..=MAX_HEIGHT))]
    pub size: u32,
    /// Position of the viewer, degrees: azimuth from the front (-y) towards +x, elevation above the horizontal;
    /// default: 28.6,20.1
    #[arg(long, value_name = "AZIMUTH,ELEVATION", allow_hyphen_values = true, value_parser = parse_angles)]
    pub view: Option<[f64; 2]>,
    #[command(flatten)]
    pub threads: ThreadCount,
}

/// Reads two finite numbers, separated by a comma.
fn parse_pair(text: &str) -> Option<[f64; 2]> {
    let (first, second) = text.split_once(',')?;
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    Some([number(first)?, number(second)?])
}

/// Value of a flag that is not read: the expected value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FlagValueError(&'static str);

impl std::fmt::Display for FlagValueError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "expected {}", self.0)
    }
}

impl std::error::Error for FlagValueError {}

/// Reads two ascending numbers. Errors: other text.
fn parse_range(text: &str) -> Result<[f64; 2], FlagValueError> {
    let range = parse_pair(text).filter(|[low, high]| low < high);
    range.ok_or(FlagValueError("two numbers LOW,HIGH, the second above the first"))
}

/// Reads two angles. Errors: other text.
fn parse_angles(text: &str) -> Result<[f64; 2], FlagValueError> {
    let angles = parse_pair(text).filter(|[_, elevation]| elevation.abs() <= 90.0);
    angles.ok_or(FlagValueError("two numbers AZIMUTH,ELEVATION in degrees, the second from -90 to 90"))
}

/// Format of the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FilmFormat {
    Gif,
    Mp4,
}

impl FilmFormat {
    /// Returns the format that the ending of a name stands for.
    fn from_path(path: &Path) -> Result<FilmFormat, Faults> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            "gif" => Ok(FilmFormat::Gif),
            "mp4" => Ok(FilmFormat::Mp4),
            _ => {
                let found = format!("{} has no known ending", path.display());
                Err(Fault::new(
                    "options".as_ref(),
                    None,
                    "--output",
                    found,
                    "expected a name that ends in .gif or .mp4",
                )
                .into())
            }
        }
    }
}

/// Properties of a state that the settings of the film depend on.
struct StateLimits {
    time: f64,
    window: ViewWindow,
    spread: ValueSpread,
}

/// Writes the film of a case; returns its path and notes for the user. Errors: an ending of no known format, a range for a
/// colour without one, no snapshot, or faults of one.
///
/// Snapshots are read twice: first for the part of space and the range of values that all pictures show. One snapshot for
/// each thread is in memory.
pub fn write(options: &MovieOptions) -> Result<(PathBuf, Vec<String>), Faults> {
    let output = options.output.clone().unwrap_or_else(|| options.dir.join("POSTPRO/movie.gif"));
    let format = FilmFormat::from_path(&output)?;
    if options.range.is_some() && !options.colour.is_continuous() {
        let found = format!("is given with --colour {}, which has counts or names", options.colour.name());
        let expected = "expected kinetic-energy, speed, spin, pressure or radius, or no range";
        return Err(Fault::new("options".as_ref(), None, "--range", found, expected).into());
    }
    let selected = select_snapshots(&options.dir.join("OUTBOX"), options.every)?;
    let count = selected.len();
    // A single picture is that of the last state.
    let is_used = |k: usize| match options.max_frames as usize {
        1 => k + 1 == count,
        chosen => is_evenly_chosen(k, count, chosen),
    };
    let paths: Vec<PathBuf> =
        selected.into_iter().enumerate().filter(|(k, _)| is_used(*k)).map(|(_, (_, path))| path).collect();
    let mut notes = Vec::new();
    if paths.len() < count {
        notes.push(format!(
            "the film has {} of {count} snapshots, evenly chosen; --max-frames {count} uses all",
            paths.len()
        ));
    }

    let camera = options.view.map_or_else(ViewCamera::default, |angles| {
        let [azimuth, elevation] = angles.map(f64::to_radians);
        ViewCamera::from_angles(azimuth, elevation)
    });
    let shapes = ShapeCache::default();
    let bar = progress_bar(2 * paths.len());
    let limits: Vec<Result<StateLimits, Faults>> = paths
        .par_iter()
        .map(|path| {
            let frame = Frame::read(path, &shapes)?;
            let limits = StateLimits {
                time: frame.meta.time,
                window: ViewWindow::around_bodies(&frame, &camera),
                spread: ValueSpread::from_values(options.colour.grain_values(&frame)),
            };
            bar.inc(1);
            Ok(limits)
        })
        .collect();
    let limits: Vec<StateLimits> = limits.into_iter().collect::<Result<_, Faults>>()?;
    let last = Frame::read(paths.last().expect("the last snapshot is taken"), &shapes)?;
    let no_values = ValueSpread::from_values(Vec::new());
    let spread = limits.iter().fold(no_values, |all, state| all.union(state.spread));
    let settings = FilmSettings {
        camera,
        window: limits.iter().fold(ViewWindow::EMPTY, |all, state| all.union(&state.window)),
        scale: ColourScale::new(options.colour, spread, options.range, Some(&last)),
        height: (options.size as usize).next_multiple_of(2),
        time_decimals: time_decimals(&limits.iter().map(|state| state.time).collect::<Vec<f64>>()),
    };

    let size = [settings.width(), settings.height];
    // Pictures are made side by side and appended in their order.
    let for_each_picture = |append: &mut dyn FnMut(Vec<RgbImage>) -> Result<(), Faults>| -> Result<(), Faults> {
        for batch in paths.chunks(rayon::current_num_threads()) {
            let pictures: Result<Vec<RgbImage>, Faults> =
                batch.par_iter().map(|path| Ok(settings.picture(&Frame::read(path, &shapes)?))).collect();
            append(pictures?)?;
            bar.inc(batch.len() as u64);
        }
        Ok(())
    };
    match format {
        FilmFormat::Gif => {
            let palette = FilmPalette::new(&settings.scale);
            let mut film = GifFilm::new(&output, size, &palette, f64::from(options.fps), paths.len())?;
            for_each_picture(&mut |pictures| {
                let indices: Vec<Vec<u8>> = pictures.par_iter().map(|picture| palette.indices(picture)).collect();
                indices.into_iter().try_for_each(|indices| film.append(indices))
            })?;
            atomic::write(&output, &film.finish()?)?;
        }
        FilmFormat::Mp4 => {
            let mut film = Mp4Film::start(&output, size, options.fps)?;
            for_each_picture(&mut |pictures| pictures.iter().try_for_each(|picture| film.append(picture)))?;
            film.finish()?;
        }
    }
    bar.finish_and_clear();
    Ok((output, notes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_of_numbers_are_checked() {
        assert_eq!(parse_range("-1, 2.5"), Ok([-1.0, 2.5]));
        assert_eq!(parse_angles("-90,90"), Ok([-90.0, 90.0]));
        for text in ["", "1", "2,1", "1,1", "1,2,3", "nan,1", "0,inf"] {
            assert!(parse_range(text).is_err(), "{text}");
        }
        assert!(parse_angles("0,91").is_err() && parse_angles("0").is_err());
    }

    #[test]
    fn endings_choose_the_format() {
        assert_eq!(FilmFormat::from_path(Path::new("a.b/film.GIF")), Ok(FilmFormat::Gif));
        assert_eq!(FilmFormat::from_path(Path::new("film.mp4")), Ok(FilmFormat::Mp4));
        for name in ["film", "film.avi", ".gif"] {
            let message = FilmFormat::from_path(Path::new(name)).unwrap_err().to_string();
            assert!(message.contains("--output") && message.contains("expected"), "{message}");
        }
    }
}
