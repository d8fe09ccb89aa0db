//! The model that cd-pre, cd-solve and cd-post share: the files that link the programs, and the geometry and physics that
//! more than one of them needs.
//!
//! ```
//! use std::path::Path;
//!
//! use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
//! use cd_formats::scan::AsciiText;
//!
//! let sphere = Contactor { colour: "BLUEx".into(), shape: ShapeRecord::Sphere { radius: 0.5 }, local_frame: None };
//! let grain = Body {
//!     line: 0,
//!     material: "ROCKx".into(),
//!     equivalent_radius: 0.5,
//!     inertia: None,
//!     position: [0.0, 0.0, 2.0],
//!     contactors: vec![sphere],
//! };
//! let text = Bodies(vec![grain.clone()]).to_text();
//! let Bodies(read) = Bodies::parse(Path::new("BODIES.DAT"), &AsciiText::new(text.as_bytes()))?;
//! assert_eq!((read[0].position, &read[0].contactors), (grain.position, &grain.contactors));
//! # Ok::<(), cd_formats::error::Faults>(())
//! ```
//!
//! This API is internal and may change with any version. The stable interface of the toolchain is its programs and their
//! files, described in the [manual](https://github.com/cd-toolchain/cd-toolchain/blob/main/docs/README.md).
//!
//! A module is here if two programs must agree on it to the last bit, or if both would otherwise write it again. Steps,
//! placement and observables are in the programs.
//!
//! Files, each with a type, a reader and a writer:
//!
//! | module | file |
//! |---|---|
//! | [`bodies`] | `DATBOX/BODIES.DAT`: shapes, materials, reference positions |
//! | [`bulk_behav`] | `DATBOX/BULK_BEHAV.DAT`: densities, uniform gravity |
//! | [`tact_behav`] | `DATBOX/TACT_BEHAV.DAT`: contact laws, the law of each pair of colours |
//! | [`drv_dof`] | `DATBOX/DRV_DOF.DAT`: imposed velocities, forces and servos |
//! | [`dof`] | `DATBOX/DOF.INI`, `OUTBOX/DOF.OUT.k`: positions and velocities at one instant |
//! | [`vloc_rloc`] | `DATBOX/Vloc_Rloc.INI`, `OUTBOX/Vloc_Rloc.OUT.k`: contacts at one instant |
//! | [`sinks_and_sources`] | bodies that leave a run and enter it |
//! | [`region`] | regions of sinks and of means |
//! | [`probe`] | series of quantities followed step by step, and conditions that end a run |
//! | [`postpro`] | `DATBOX/POSTPRO.DAT`: files with rows of figures, requested as in LMGC90 |
//! | [`compute`] | `DATBOX/COMPUTE.RON`: options of a run |
//! | [`deforming_cell`] | the option `cell` of COMPUTE.RON, and the state of the cell in a run |
//! | [`accuracy`], [`presets`] | the presets of accuracy of COMPUTE.RON, and their values |
//! | [`snapshot`] | `OUTBOX/snapshot-NNNNNN.npz`: the complete state for a restart, bit for bit |
//! | [`obj`] | Wavefront OBJ: surfaces of attracting bodies and of walls, `DATBOX/NAME.obj`, `DATBOX/MESHx-k.obj` |
//! | [`fc3d`] | `NAME.fc3d`: the contact problem of one step as a document |
//!
//! Geometry and physics:
//!
//! | module | content |
//! |---|---|
//! | [`geometry`] | closed surfaces, faces and edges of a convex surface, mass properties of contactors and bodies, convex regions |
//! | [`wall_mesh`] | triangulated surfaces of walls (`MESHx`), and their contacts with balls |
//! | [`law_table`] | contact laws: names, parameters with units and limits, friction limit, memory |
//! | [`field`] | accelerations and potentials of external fields |
//! | [`orbit`] | Kepler orbits of the masses of external fields |
//! | [`polyhedron_gravity`](geometry::polyhedron_gravity) | attraction of a homogeneous polyhedron |
//!
//! Tools for files:
//!
//! | module | content |
//! |---|---|
//! | [`error`], [`report`] | faults with file, line, column, object, found and expected; those of RON files by path |
//! | [`scan`] | text in columns as Fortran reads and writes it |
//! | [`ron_text`], [`value_locations`] | RON with the position of each mistake; positions of values |
//! | [`settings`] | values of RON files that a command line replaces |
//! | [`ron_file`], [`former_names`] | RON files under current names and those of earlier versions |
//! | [`atomic`] | files that are complete or absent |
//! | [`checksums`], [`lock`] | SHA-256 checksums of the files of a folder; locks of folders |
//! | [`case`], [`command_line`] | the folder of a case on a command line; reading of command lines |
//! | [`foreign`] | folders of LMGC90 with 2D or deformable bodies |
//! | [`origin`] | the files that DATBOX is made from |
//! | [`unchanged`] | whether the files of DATBOX still agree with a snapshot |
//! | [`doubts`] | values that are probably mistakes of units |
//! | [`messages`] | messages to people |
//! | [`groups`], [`ids`], [`names`] | disjoint sets, the largest remnant of fragments; typed indices; names in messages |

pub mod accuracy;
pub mod atomic;
pub mod bodies;
pub mod bulk_behav;
pub mod case;
pub mod checksums;
pub mod command_line;
pub mod compute;
pub mod deforming_cell;
pub mod dof;
pub mod doubts;
pub mod drv_dof;
pub mod error;
pub mod fc3d;
pub mod field;
pub mod foreign;
pub mod former_names;
pub mod geometry;
pub mod groups;
pub mod hollow_radius;
pub mod ids;
pub mod law_table;
pub mod lock;
pub mod messages;
pub mod names;
pub mod orbit;
pub mod origin;
pub mod postpro;
pub mod presets;
pub mod probe;
pub mod region;
pub mod report;
pub mod ron_file;
pub mod ron_text;
pub mod scan;
pub mod settings;
pub mod sinks_and_sources;
pub mod snapshot;
pub mod tact_behav;
pub mod unchanged;
pub mod value_locations;
pub mod vloc_rloc;
mod words;

// Other modules and crates name these without their folder.
pub use geometry::{convex_pieces, faces, mass, mesh, obj, principal, rotation, surface, wall_mesh};
