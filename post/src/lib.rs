//! cd-post: from the snapshots of cd-solve to tables, plots and pictures.
//!
//! `read` ([`frame`]) -> `derive` ([`mod@derive`]) -> `write` ([`mod@write`]): each snapshot of `DIR/OUTBOX` becomes a
//! [`Frame`](frame::Frame), a [`Row`](derive::Row) of `POSTPRO/series.csv` and the files of `DISPLAY/`; the rows together
//! become plots, the last frame a picture.
//!
//! | module | |
//! |---|---|
//! | [`cli`] | command line |
//! | [`options`] | options of the measurement |
//! | [`commands`] | the commands, one module each |
//! | [`mod@snapshots`] | lists of snapshots |
//! | [`frame`], [`shapes`] | a snapshot, and the shapes of its polyhedra |
//! | [`tables`] | tables of runs |
//! | [`math`] | vectors, fitted lines, medians |
//! | [`mod@derive`] | observables of a frame |
//! | [`mod@write`] | figures, pictures and ParaView files |

pub mod cli;
pub mod commands;
pub mod derive;
pub mod frame;
pub mod math;
pub mod options;
pub mod shapes;
pub mod snapshots;
pub mod tables;
pub mod write;

pub use cli::{command, run};

#[cfg(test)]
#[path = "../tests/samples/mod.rs"]
mod samples;

#[cfg(test)]
impl samples::Scene {
    fn frame(&self) -> frame::Frame {
        let solid = |body| shapes::body_solid(body).expect("a cube").map(std::sync::Arc::new);
        let laws = self.snapshot.meta.laws.iter().map(|law| law.model().expect("a law of the table")).collect();
        frame::Frame::with_solids(self.snapshot.clone(), self.records().0.iter().map(solid).collect(), laws)
    }
}
