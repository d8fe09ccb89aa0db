//! Contents of the files that link cd-pre, cd-solve and cd-post. No physics.
//!
//! | module | file |
//! |---|---|
//! | [`bodies`] | `DATBOX/BODIES.DAT`: shapes, materials, reference positions |
//! | [`surface`] | the closed surfaces in it: faults, mass properties |
//! | [`faces`] | the faces and edges of a convex one; whether it is one |
//! | [`mass`] | the mass properties of its contactors, one by one and together |
//! | [`bulk_behav`] | `DATBOX/BULK_BEHAV.DAT`: densities, uniform gravity |
//! | [`tact_behav`] | `DATBOX/TACT_BEHAV.DAT`: contact laws, which pair of colours follows which |
//! | [`drv_dof`] | `DATBOX/DRV_DOF.DAT`: imposed velocities and forces |
//! | [`dof`] | `DATBOX/DOF.INI`, `OUTBOX/DOF.OUT.k`: positions and velocities at one instant |
//! | [`vloc_rloc`] | `DATBOX/Vloc_Rloc.INI`, `OUTBOX/Vloc_Rloc.OUT.k`: contacts at one instant |
//! | [`compute`] | `DATBOX/COMPUTE.RON`: options of a run |
//! | [`origin`] | the same: which files DATBOX is made from |
//! | [`doubts`] | none: values that are probably mistakes of units |
//! | [`accuracy`] | the same: what its presets of accuracy mean |
//! | [`case`] | none: the folder of a case on a command line |
//! | [`groups`] | none: what hangs together
//! | [`places`] | any RON file: where its values stand, and others in their place |
//! | [`report`] | the same: its faults |
//! | [`ron_text`] | the same: reading it, with the place of each mistake |
//! | [`fc3d`] | `NAME.fc3d`: the contact problem of one step as a document |
//! | [`tell`] | none: messages to people |
//! | [`snapshot`] | `OUTBOX/snapshot-NNNNNN.npz`: all that a restart needs, bit for bit |
//! | [`unchanged`] | the same: whether the files of DATBOX are still those that it was computed from |

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
pub mod faces;
pub mod fc3d;
pub mod field;
pub mod groups;
pub mod mass;
pub mod origin;
pub mod places;
pub mod report;
pub mod ron_text;
pub mod scan;
pub mod snapshot;
pub mod surface;
pub mod tact_behav;
pub mod tell;
pub mod unchanged;
pub mod vloc_rloc;
