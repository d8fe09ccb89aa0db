//! The commands of cd-post, one module each.
//!
//! | module | |
//! |---|---|
//! | [`series`] | all snapshots of a case: series, plots, ParaView files |
//! | [`state`] | one snapshot in depth |
//! | [`compare`] | one figure and table for each observable, over several runs |
//! | [`study`] | means of many runs against the number of grains |
//! | [`replicates`] | means over the seeds of a study, with their errors |
//! | [`accuracy_study`] | error against cost of runs of one scene |
//! | [`track`] | one body in a bed of grains |
//! | [`impact`] | momentum, ejecta and crater of an impact |
//! | [`report`] | a page about a run |
//! | [`movie`] | a film of a run |
//! | [`watch`] | the page of a run that continues |

pub mod accuracy_study;
pub mod compare;
pub mod impact;
pub mod movie;
pub mod replicates;
pub mod report;
pub mod series;
pub mod state;
pub mod study;
pub mod track;
pub mod watch;
