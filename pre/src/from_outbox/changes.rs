//! Contents of the file of changes (`cd-pre from-outbox --changes`): the types, each field with its unit.

use std::path::PathBuf;

use cd_formats::compute::Compute;
use serde::Deserialize;

use crate::scene::{ColourPairLaw, Grains, Law, Material, Rotation, SceneWall, deserialize_walls};

/// Changes against the run that is continued; by default none.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Changes {
    /// Bodies selected from each run; left out, all of the case.
    pub bodies: Vec<Selection>,
    /// Further bodies, as in a scene.
    pub grains: Vec<Grains>,
    /// Further walls, as in a scene.
    #[serde(deserialize_with = "deserialize_walls")]
    pub walls: Vec<SceneWall>,
    /// Seed of the random numbers for `grains`.
    pub seed: u64,
    /// New materials, and new densities of existing ones.
    pub materials: Vec<Material>,
    /// New laws, and replacements of existing ones under their names.
    pub laws: Vec<Law>,
    /// Laws between two colours, which replace previous ones.
    pub contacts: Vec<ColourPairLaw>,
    /// Whether step and time continue; otherwise both start at 0.
    pub keep_time: bool,
    /// Options of the run; left out, those of the first case but for `steps`, `end_time` and `events`.
    pub compute: Option<Compute>,
}

/// Bodies selected from one run, and changes of their position and motion.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Selection {
    /// Folder of the case, seen from the file of changes; left out, the case of the command line.
    pub case: Option<PathBuf>,
    /// Step of the snapshot; left out, the last.
    pub snapshot: Option<u64>,
    /// Free bodies that are selected.
    pub select: BodyFilter,
    /// Whether bodies with imposed motion are selected, too.
    pub walls: bool,
    /// Bodies with imposed motion for which the opposite of `walls` holds.
    pub walls_except: Vec<WallSelector>,
    /// New colour of the free bodies.
    pub colour: Option<String>,
    /// Motion that is removed first.
    pub remove_motion: MotionRemoval,
    /// Rotates the free bodies and their motion about their centre of mass.
    pub rotate: Rotation,
    /// New centre of mass of the free bodies, m.
    pub centre: Option<[f64; 3]>,
    /// Velocity that is added to the free bodies, m/s.
    pub velocity: [f64; 3],
    /// Rigid rotation about their centre of mass, added to the free bodies, rad/s, fixed axes.
    pub spin: [f64; 3],
}

impl Default for Selection {
    fn default() -> Self {
        Selection {
            case: None,
            snapshot: None,
            select: BodyFilter::All,
            walls: true,
            walls_except: Vec::new(),
            colour: None,
            remove_motion: MotionRemoval::Nothing,
            rotate: Rotation::default(),
            centre: None,
            velocity: [0.0; 3],
            spin: [0.0; 3],
        }
    }
}

/// Bodies with imposed motion, of one run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub enum WallSelector {
    /// The n-th body with imposed motion, from 1: of a scene's walls, plates and cylinders in order.
    Wall(usize),
    /// The body of this number, from 1, among all.
    Body(usize),
    /// Bodies with a contactor of this colour.
    Colour(String),
}

impl Selection {
    /// Whether the bodies keep their positions and their motion.
    pub fn keeps_motion(&self) -> bool {
        self.remove_motion == MotionRemoval::Nothing
            && self.rotate.angle == 0.0
            && self.centre.is_none()
            && [self.velocity, self.spin] == [[0.0; 3]; 2]
    }
}

/// Filter of the free bodies of a run.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub enum BodyFilter {
    All,
    /// Bodies whose sphere of equal volume lies below this height along z, m.
    Below(f64),
    /// The largest remnant: the heaviest fragment (touching bodies) with at least a tenth of the members of the most numerous
    /// group.
    Largest,
}

/// Motion of the free bodies that is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum MotionRemoval {
    Nothing,
    /// The velocity of their centre of mass.
    Translation,
    /// The velocity of their centre of mass, and the rigid rotation with their angular momentum.
    RigidMotion,
    /// All motion.
    All,
}
