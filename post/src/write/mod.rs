//! What is written: one file kind a module. Every file appears whole or not at all.
//!
//! | module | files |
//! |---|---|
//! | [`series`] | `POSTPRO/series.csv` |
//! | [`plots`] | `POSTPRO/*.svg`, the main columns against time |
//! | [`picture`] | `POSTPRO/aggregate.svg`, the last state |
//! | [`display`] | `DISPLAY/*.vtp` and `*.pvd` |

pub mod display;
pub mod series;
