//! Heights and slopes of the surface of an aggregate, heap or bed.

use vtkio::model::{Attributes, PolyDataPiece};

use crate::commands::state::file::{StateFile, text_file};
use crate::derive::energy::self_gravity_constant;
use crate::derive::fragments::Fragment;
use crate::derive::free_surface::FreeSurface;
use crate::derive::surface::{DirectionGrid, SurfaceFacet, aggregate_surface, rms_noise, slope_quantiles};
use crate::frame::Frame;
use crate::math::Vec3;
use crate::write::display::{flat_components, scalar_attribute, vector_attribute, vertex_numbers};
use crate::write::figure::{Curve, Figure, FigureAxis};
use crate::write::map::{self, MapSheet};
use crate::write::series::{Column, csv_table, csv_text};
use crate::write::vtp::vtp_text;

/// Columns of surface.csv of a heap or bed.
pub const SURFACE_COLUMNS: [Column; 6] = [
    ("x", "m", ""),
    ("y", "m", ""),
    ("z", "m", ""),
    ("height", "m", "height above the lowest point of the grains"),
    ("slope", "°", "angle between the normal and the direction against gravity"),
    ("slope_error", "°", "standard error of the slope due to single grains"),
];

/// Columns of slopes.csv.
pub const SLOPE_COLUMNS: [Column; 2] =
    [("share_below", "1", "share of the surface"), ("slope", "°", "slope below which this share of the surface is")];

/// Number of shares of the surface with listed slopes: every twentieth.
const SLOPE_SHARE_COUNT: usize = 20;

/// Height, gravity and slope of the largest remnant by direction.
pub fn surface_files(frame: &Frame, largest: &Fragment, slope_reach: f64) -> Vec<StateFile> {
    let grid = DirectionGrid::STANDARD;
    let constant = self_gravity_constant(frame).unwrap_or(0.0);
    let facets = aggregate_surface(frame, &largest.grains, &largest.sums, constant, grid, slope_reach);
    let header =
        ["latitude", "longitude", "x", "y", "z", "height", "g_x", "g_y", "g_z", "slope", "area", "slope_error"];
    let row = |f: &SurfaceFacet| {
        let mut row = vec![f.latitude.to_degrees(), f.longitude.to_degrees()];
        row.extend(frame.origin.written_position(f.x).iter());
        row.push(f.height);
        row.extend(f.gravity.iter());
        row.extend([f.slope.to_degrees(), f.area, f.error.to_degrees()]);
        row
    };
    let heights: Vec<f64> = facets.iter().map(|f| f.height).collect();
    let slopes: Vec<f64> = facets.iter().map(|f| f.slope.to_degrees()).collect();
    let sheet = MapSheet::from_directions(grid);
    let x: Vec<Vec3> = facets.iter().map(|f| frame.origin.written_position(f.x)).collect();
    let gravity: Vec<Vec3> = facets.iter().map(|f| f.gravity).collect();
    let counts = [grid.longitudes, grid.latitudes];
    let noise = noise_text(rms_noise(&facets));
    let mut files =
        slope_files(&format!("Slopes against gravity and rotation{noise}"), &slope_quantiles(&facets, &slope_shares()));
    files.extend([
        text_file("surface.csv", csv_text(&header, facets.iter().map(row))),
        // From east to west the sphere closes; at the poles it is left open.
        ("surface.vtp", surface_vtp(counts, [true, false], &x, &heights, &slopes, Some(&gravity))),
        text_file(
            "surface_height.svg",
            map::map_svg("Height above the centre of mass", "height", "m", &heights, &sheet),
        ),
        text_file(
            "surface_slope.svg",
            map::map_svg(&format!("Slope against gravity and rotation{noise}"), "slope", "°", &slopes, &sheet),
        ),
    ]);
    files
}

/// Height and slope of a heap or bed along vertical lines.
pub fn free_surface_files(frame: &Frame, surface: &FreeSurface) -> Vec<StateFile> {
    let columns = &surface.columns;
    let heights: Vec<f64> = columns.iter().map(|c| c.height).collect();
    let slopes: Vec<f64> = columns.iter().map(|c| c.slope.to_degrees()).collect();
    let x: Vec<Vec3> = columns.iter().map(|c| frame.origin.written_position(c.x)).collect();
    let known = columns.iter().zip(&x).filter(|(c, _)| c.height.is_finite());
    let sheet = MapSheet::from_above(surface);
    let noise = noise_text(surface.noise);
    let mut files = slope_files(&format!("Slopes against gravity{noise}"), &surface.slope_quantiles(&slope_shares()));
    files.extend([
        text_file(
            "surface.csv",
            csv_table(
                &SURFACE_COLUMNS,
                known.map(|(c, x)| [x.x, x.y, x.z, c.height, c.slope.to_degrees(), c.error.to_degrees()]),
            ),
        ),
        ("surface.vtp", surface_vtp(surface.counts, [false; 2], &x, &heights, &slopes, None)),
        text_file("surface_height.svg", map::map_svg("Height of the free surface", "height", "m", &heights, &sheet)),
        text_file(
            "surface_slope.svg",
            map::map_svg(&format!("Slope of the free surface{noise}"), "slope", "°", &slopes, &sheet),
        ),
    ]);
    files
}

/// Returns the end of a title that states the standard error `noise` (rad) of slopes.
fn noise_text(noise: f64) -> String {
    if noise.is_finite() { format!("; standard error {:.2}°", noise.to_degrees()) } else { String::new() }
}

/// Shares of a surface: every twentieth.
fn slope_shares() -> Vec<f64> {
    (1..=SLOPE_SHARE_COUNT).map(|k| k as f64 / SLOPE_SHARE_COUNT as f64).collect()
}

/// Returns slopes.csv and slopes.svg; `quantiles`: the slopes (rad) below which [`slope_shares`] of the surface are.
fn slope_files(title: &str, quantiles: &[f64]) -> Vec<StateFile> {
    let quantiles: Vec<(f64, f64)> =
        slope_shares().into_iter().zip(quantiles.iter().map(|slope| slope.to_degrees())).collect();
    let figure = Figure {
        title: title.into(),
        x: FigureAxis::linear("share of the surface below this slope", "1"),
        y: FigureAxis::linear("slope", "°"),
        curves: vec![Curve::line("surface", quantiles.clone())],
    };
    vec![
        text_file("slopes.csv", csv_table(&SLOPE_COLUMNS, quantiles.into_iter().map(|(share, slope)| [share, slope]))),
        text_file("slopes.svg", figure.to_svg()),
    ]
}

/// Returns a .vtp file of the quadrilaterals between four neighbours of a grid of `columns` by `rows`, which is closed
/// along the axes where `closes` is true. Positions and heights are in m, slopes in degrees.
fn surface_vtp(
    [columns, rows]: [usize; 2],
    closes: [bool; 2],
    x: &[Vec3],
    heights: &[f64],
    slopes: &[f64],
    gravity: Option<&[Vec3]>,
) -> Vec<u8> {
    let mut point_numbers = vec![None; x.len()];
    let mut kept: Vec<usize> = Vec::new();
    // Without gravity and spin no slope is known.
    let has_slopes = slopes.iter().any(|slope| slope.is_finite());
    for k in (0..x.len()).filter(|&k| heights[k].is_finite() && (slopes[k].is_finite() || !has_slopes)) {
        point_numbers[k] = Some(kept.len() as u64);
        kept.push(k);
    }
    let corner = |row: usize, column: usize| point_numbers[row % rows * columns + column % columns];
    let [quad_columns, quad_rows] = [columns - usize::from(!closes[0]), rows - usize::from(!closes[1])];
    let quads = (0..quad_rows).flat_map(|row| (0..quad_columns).map(move |column| (row, column)));
    let quads = quads.filter_map(|(row, column)| {
        Some([corner(row, column)?, corner(row, column + 1)?, corner(row + 1, column + 1)?, corner(row + 1, column)?])
    });
    let numbers_of = |values: &[f64]| kept.iter().map(|&k| values[k]).collect::<Vec<f64>>();
    let vectors_of = |values: &[Vec3]| kept.iter().map(|&k| values[k]).collect::<Vec<Vec3>>();
    let mut point = vec![scalar_attribute("height", numbers_of(heights))];
    if has_slopes {
        point.push(scalar_attribute("slope", numbers_of(slopes)));
    }
    point.extend(gravity.map(|gravity| vector_attribute("gravity", vectors_of(gravity).into_iter())));
    let piece = PolyDataPiece {
        points: flat_components(vectors_of(x).into_iter()).into(),
        polys: vertex_numbers(quads),
        data: Attributes { point, cell: vec![] },
        ..Default::default()
    };
    vtp_text(&piece, "").into_bytes()
}
