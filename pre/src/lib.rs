//! `cd-pre scene.ron`: reads a scene, places its grains and walls, and writes DATBOX.
//! `cd-pre from-outbox CASE DIR`: the state of one run becomes the DATBOX of the next.
//! `cd-pre study study.ron`: a folder with a scene for each combination of parameters.
//!
//! | module | |
//! |---|---|
//! | [`cli`] | command line |
//! | [`mod@datbox`] | DATBOX of a scene |
//! | [`parse`] | input files in which settings replace values |
//! | [`scene`] | contents of scene.ron |
//! | [`check`] | faults of a scene |
//! | [`doubts`] | values of a scene that are probably mistakes |
//! | [`attraction`] | warning about an attraction per contact point |
//! | [`grain`] | grains and walls as bodies |
//! | [`sizes`] | radii of grains |
//! | [`shapes`] | polyhedra: hulls, solids at random, mass properties |
//! | [`placement`] | positions of grains |
//! | [`motion`] | initial velocities |
//! | [`walls`] | plates and cylinders |
//! | [`population`] | all bodies of a scene, and checks of their overlaps |
//! | [`summary`] | summary of the bodies for the user |
//! | [`random`], [`rotation`], [`rounding`], [`sphere`] | mathematics |
//! | [`mod@write`] | the files of DATBOX |
//! | [`reread`] | check that cd-solve can read them |
//! | [`from_outbox`] | a DATBOX from the results of a run |
//! | [`study`] | scenes from a base and parameters |

pub mod attraction;
pub mod check;
pub mod cli;
pub mod datbox;
pub mod doubts;
pub mod from_outbox;
pub mod grain;
pub mod motion;
pub mod parse;
pub mod placement;
pub mod population;
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
