//! Contents of the files that link cd-pre, cd-solve and cd-post. No physics.
//!
//! | module | file |
//! |---|---|
//! | [`bodies`] | `DATBOX/BODIES.DAT`: shapes, materials, reference positions |
//! | [`surface`] | closed surfaces of BODIES.DAT: faults, mass properties |
//! | [`faces`] | faces and edges of a convex surface; whether it is convex |
//! | [`mass`] | mass properties of contactors and of bodies |
//! | [`bulk_behav`] | `DATBOX/BULK_BEHAV.DAT`: densities, uniform gravity |
//! | [`law_table`] | none: the contact laws, their parameters and friction limits |
//! | [`tact_behav`] | `DATBOX/TACT_BEHAV.DAT`: contact laws, the law of each pair of colours |
//! | [`drv_dof`] | `DATBOX/DRV_DOF.DAT`: imposed velocities and forces |
//! | [`dof`] | `DATBOX/DOF.INI`, `OUTBOX/DOF.OUT.k`: positions and velocities at one instant |
//! | [`vloc_rloc`] | `DATBOX/Vloc_Rloc.INI`, `OUTBOX/Vloc_Rloc.OUT.k`: contacts at one instant |
//! | [`compute`] | `DATBOX/COMPUTE.RON`: options of a run |
//! | [`origin`] | the same: the files that DATBOX is made from |
//! | [`doubts`] | none: values that are probably mistakes of units |
//! | [`accuracy`] | the same: the values of its presets of accuracy |
//! | [`case`] | none: the folder of a case on a command line |
//! | [`groups`] | none: groups of connected items |
//! | [`places`] | any RON file: positions and replacement of its values |
//! | [`report`] | the same: its faults |
//! | [`ron_text`] | the same: reading it, with the position of each mistake |
//! | [`fc3d`] | `NAME.fc3d`: the contact problem of one step as a document |
//! | [`tell`] | none: messages to people |
//! | [`snapshot`] | `OUTBOX/snapshot-NNNNNN.npz`: the complete state for a restart, bit for bit |
//! | [`unchanged`] | the same: whether the files of DATBOX still agree with it |

pub mod accuracy;
pub mod atomic;
pub mod bodies;
pub mod bulk_behav;
pub mod case;
pub mod compute;
pub mod dof;
pub mod doubts;
pub mod drv_dof;
pub mod error;
pub mod fc3d;
pub mod field;
pub mod geometry;
pub mod groups;
pub mod law_table;
pub mod origin;
pub mod places;
pub mod report;
pub mod ron_text;
pub mod scan;
pub mod snapshot;
pub mod tact_behav;
pub mod tell;
pub mod unchanged;
pub mod vloc_rloc;

pub use geometry::{faces, mass, surface};
