//! cd-pre: from a scene in RON to the files of `DATBOX/`, with sizes, positions and motion of all grains.
//!
//! `cd-pre from-outbox CASE DIR` makes the DATBOX of the next run from the results of one; `cd-pre study study.ron` makes
//! a folder with a scene for each combination of parameters.
//!
//! ```
//! let text = r#"(
//!     materials: [(name: "ROCKx", density: 2700.0)],
//!     laws: [(name: "iqsc0", kind: IQS_CLB(friction: 0.5))],
//!     contacts: [(between: ("BLUEx", "BLUEx"), law: "iqsc0")],
//!     grains: [(
//!         material: "ROCKx",
//!         colour: "BLUEx",
//!         number: 20,
//!         solid_fraction: 0.2,
//!         sizes: Uniform(min: 0.8, max: 1.2), // radii, m
//!         placement: RandomSequential(envelope: Ball()),
//!     )],
//!     compute: (dt: 1.0, steps: 10),
//! )"#;
//! let (_, population) = cd_pre::read_scene("scene.ron".as_ref(), text, &[])?;
//! assert_eq!(population.grains.len(), 20);
//! assert!(population.grains.iter().all(|grain| (0.8..=1.2).contains(&grain.radius)));
//! # Ok::<(), cd_formats::error::Faults>(())
//! ```
//!
//! This API is internal and may change with any version. The stable interface of the toolchain is its programs and their
//! files, described in the [manual](https://github.com/cd-toolchain/cd-toolchain/blob/main/docs/README.md).
//!
//! | module | |
//! |---|---|
//! | [`cli`] | command line |
//! | [`mod@datbox`], `datbox_folder` | DATBOX of a scene; its lock and its files |
//! | [`parse`] | input files in which settings replace values |
//! | [`scene`] | contents of scene.ron |
//! | [`check`] | faults of a scene |
//! | [`doubts`] | values of a scene that are probably mistakes |
//! | [`attraction`] | warning about an attraction per contact point |
//! | [`grain`] | grains and walls as bodies |
//! | [`sizes`] | radii of grains |
//! | [`shapes`] | polyhedra: hulls, solids at random, mass properties |
//! | [`particles`] | particles from files of other programs |
//! | [`placement`] | positions of grains |
//! | [`motion`], `orbits` | initial velocities, orbits of groups of grains |
//! | [`walls`] | plates and cylinders |
//! | [`population`] | all bodies of a scene, and checks of their overlaps |
//! | [`summary`] | summary of the bodies for the user |
//! | [`random`], [`rotation`], [`rounding`], [`sphere`] | mathematics |
//! | [`mod@write`], `field_surfaces` | the files of DATBOX |
//! | [`reread`] | check that cd-solve can read them |
//! | [`from_outbox`] | a DATBOX from the results of a run |
//! | [`pour`] | a run that lets grains come to rest, and the DATBOX of the next |
//! | [`study`] | scenes from a base and parameters |
//! | [`accuracy_study`] | study of the options of a scene that trade speed for accuracy |

pub mod accuracy_study;
pub mod attraction;
pub mod check;
pub mod cli;
pub mod datbox;
mod datbox_folder;
pub mod doubts;
mod field_surfaces;
pub mod from_outbox;
pub mod grain;
pub mod motion;
mod orbits;
mod overlaps;
pub mod parse;
pub mod particles;
pub mod placement;
pub mod population;
pub mod pour;
mod radial;
pub mod random;
pub mod reread;
pub mod rotation;
pub mod rounding;
pub mod scene;
pub mod shapes;
pub mod sizes;
pub mod sphere;
pub mod study;
pub mod summary;
pub mod walls;
pub mod write;

pub use cli::{command, run};
pub use datbox::{read_scene, write_datbox};
