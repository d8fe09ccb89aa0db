//! Writers of the output files: one kind of file per module. Every file is written whole or not at all.
//!
//! | module | files |
//! |---|---|
//! | [`series`] | `POSTPRO/series.csv` |
//! | [`plots`] | `POSTPRO/*.svg`, the main columns against time |
//! | [`figure`] | none: curves in a plot, as SVG |
//! | [`picture`] | `POSTPRO/aggregate.svg`, `aggregate_energy.svg`, the last state; `snapshots.svg`, four |
//! | [`display`], [`vtp`] | `DISPLAY/*.vtp` and `*.pvd`, and the format of the former |
//! | [`pieces`] | `DISPLAY/*.pvtp`, and their pieces |
//! | [`fields`] | none: field data of these files |
//! | [`vtkhdf`], [`hdf5`] | `DISPLAY/*.vtkhdf`, and the format that it is based on |
//! | [`map`] | `POSTPRO/state-NNNNNN/surface_*.svg` |
//! | [`film`], [`raster`] | `POSTPRO/movie.gif`, `.mp4`; none: states as pixels |
//! | [`view`], [`colours`] | none: camera, window and walls of pictures; colours of grains |
//! | [`scale`] | none: units and round numbers for the eye |

pub mod colours;
pub mod display;
pub mod fields;
pub mod figure;
pub mod film;
pub mod hdf5;
pub mod map;
pub mod picture;
pub mod pieces;
pub mod plots;
pub mod raster;
pub mod scale;
pub mod series;
pub mod view;
pub mod vtkhdf;
pub mod vtp;
