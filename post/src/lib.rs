//! cd-post: from the snapshots of cd-solve to tables, plots and pictures.
//!
//! ```
//! use cd_formats::snapshot::{BodyArrays, SHAPE_SPHERE, Snapshot};
//! use cd_post::derive::fragments::find_fragments;
//! use cd_post::frame::Frame;
//!
//! // Three spheres of 1 kg and radius 1 m, two of which touch and move at 3 m/s.
//! let bodies = BodyArrays {
//!     body_id: vec![1, 2, 3],
//!     body_x: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [9.0, 0.0, 0.0]],
//!     body_q: vec![[1.0, 0.0, 0.0, 0.0]; 3],
//!     body_v: vec![[0.0, 0.0, 3.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]],
//!     body_w: vec![[0.0; 3]; 3],
//!     body_w_world: vec![[0.0; 3]; 3],
//!     body_mass: vec![1.0; 3],
//!     body_inertia: vec![[0.4; 3]; 3],
//!     body_radius: vec![1.0; 3],
//!     body_half_lengths: vec![[1.0; 3]; 3],
//!     body_shape: vec![SHAPE_SPHERE; 3],
//!     body_driven: vec![0; 3],
//!     body_colour: vec![0; 3],
//!     body_material: vec![0; 3],
//! };
//! let frame = Frame::with_solids(Snapshot { bodies, ..Snapshot::default() }, Vec::new(), Vec::new());
//! let fragments = find_fragments(&frame);
//! assert_eq!(fragments.len(), 2);
//! assert_eq!(fragments[0].sums.velocity().z, 3.0);
//! ```
//!
//! This API is internal and may change with any version. The stable interface of the toolchain is its programs and their
//! files, described in the [manual](https://github.com/cd-toolchain/cd-toolchain/blob/main/docs/README.md).
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
//! | [`axes`] | axes of written positions and velocities |
//! | [`tables`] | tables of runs |
//! | [`math`] | vectors, fitted lines, medians |
//! | [`mod@derive`] | observables of a frame |
//! | [`mod@write`] | figures, pictures and ParaView files |

pub mod axes;
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
