//! Code that the tests of the three programs share. The programs are called as their binaries call them; files on disk are
//! the only link between them.
//!
//! | module | |
//! |---|---|
//! | [`case`] | a case in a temporary folder, and the programs on it |
//! | [`columns`] | a file of results as named columns of numbers |
//! | [`draws`] | random choices |
//! | [`fuzzing`] | readers and damaged files |
//! | [`golden`] | the expected files of `tests/golden`: stages, tolerances, changes |
//! | [`pages`] | pages of the documentation as text |
//! | [`vtp`] | arrays of a ParaView file |
//! | [`process`] | the programs as processes |
//! | [`torture`] | the programs killed, without disk, without folder |

pub mod case;
pub mod columns;
pub mod draws;
pub mod fuzzing;
pub mod golden;
pub mod pages;
pub mod process;
pub mod torture;
pub mod vtp;
