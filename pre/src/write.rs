//! The bodies of a scene in the types of DATBOX, and the text of every file.

use cd_formats::bodies::{Bodies, Body, Contactor, ShapeRecord};
use cd_formats::bulk_behav::{BulkBehav, Material};
use cd_formats::compute::Compute;
use cd_formats::dof::{BodyDof, Dof};
use cd_formats::drv_dof::{DrivenComponent, DrivenKind, DrvDof};
use cd_formats::hollow_radius::RadiusControl;
use cd_formats::tact_behav::{TactBehav, VisibilityRow, VisibilitySide};
use cd_formats::vloc_rloc::VlocRloc;
use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::grain::{Grain, Population};
use crate::scene::{Law, Scene, SceneWall, TimeFunction};
use crate::shapes::union::ClumpBall;
use crate::shapes::{OrientedClump, OrientedPolyhedron, OrientedRoundSolid, OrientedShape};
use crate::sphere::sphere_volume;
use crate::walls::{FunctionTables, WallBody};

/// Least number of grains per task: their records take some tens of microseconds.
const GRAINS_PER_TASK: usize = 256;

/// Name of the file of options in DATBOX.
pub const COMPUTE_FILE: &str = "COMPUTE.RON";

/// Name within DATBOX and text of every file, for a (checked) scene.
pub fn datbox_files(scene: &Scene, population: &Population) -> Vec<(String, String)> {
    let (drv_dof, tables) = drv_dof(scene, population);
    let mut bodies = bodies_file(scene, population);
    let mesh_files = bodies.name_mesh_files();
    let mut files: Vec<(String, String)> = [
        ("BODIES.DAT", bodies.to_text()),
        ("BULK_BEHAV.DAT", bulk_behav(scene).to_text()),
        ("TACT_BEHAV.DAT", tact_behav(scene, population).to_text() + &no_law_comments(scene)),
        ("DRV_DOF.DAT", drv_dof.to_text()),
        ("DOF.INI", dof_file(population).to_text()),
        ("Vloc_Rloc.INI", VlocRloc::default().to_text()),
        (COMPUTE_FILE, run_options(scene, population).to_text()),
    ]
    .map(|(name, text)| (name.to_string(), text))
    .into();
    files.extend(tables.table_files());
    files.extend(mesh_files);
    files
}

/// Options of the run, with the controls of the radii of walls.
fn run_options(scene: &Scene, population: &Population) -> Compute {
    let mut options = scene.compute.clone();
    let walls = population.walls.iter().zip(population.grains.len() + 1..);
    options.radii.extend(walls.filter_map(|(wall, body)| Some(RadiusControl { body, control: wall.servos.radius? })));
    options
}

/// Bodies in their principal axes (the fixed ones for spheres, else those in DOF.INI), with inertia at density 1 and the
/// centre of mass as position.
pub fn bodies_file(scene: &Scene, population: &Population) -> Bodies {
    let record_of_grain = |grain: &Grain| {
        let group = &scene.grains[grain.group];
        let radius = grain.radius;
        let (inertia, shapes) = match &grain.shape {
            OrientedShape::Sphere => {
                ([0.4 * sphere_volume(radius) * radius * radius; 3], vec![ShapeRecord::Sphere { radius }])
            }
            OrientedShape::Polyhedron(polyhedron) => (polyhedron.moments(), polyhedron_shapes(polyhedron)),
            OrientedShape::Clump(clump) => (clump.moments(), clump_shapes(clump)),
            OrientedShape::RoundSolid(OrientedRoundSolid { shape, .. }) => {
                let inertia = shape.mass_properties().inertia;
                ([0, 1, 2].map(|k| inertia[k][k]), vec![shape.to_record()])
            }
        };
        Body {
            line: 0,
            material: group.material.clone(),
            equivalent_radius: radius,
            inertia: Some(inertia),
            position: grain.position.into(),
            contactors: shapes.into_iter().map(|shape| new_contactor(&group.colour, shape)).collect(),
        }
    };
    let grains = population.grains.par_iter().with_min_len(GRAINS_PER_TASK).map(record_of_grain);
    Bodies(grains.chain(population.walls.par_iter().map(WallBody::record)).collect())
}

/// Contactors of a polyhedron, one for each convex piece.
fn polyhedron_shapes(polyhedron: &OrientedPolyhedron) -> Vec<ShapeRecord> {
    let triangles = polyhedron.solid.pieces.iter().map(|piece| piece.triangles().to_vec());
    let shape = |(vertices, triangles)| ShapeRecord::Polyhedron { vertices, triangles };
    polyhedron.vertices().into_iter().zip(triangles).map(shape).collect()
}

/// Contactors of a clump, one for each ball.
fn clump_shapes(clump: &OrientedClump) -> Vec<ShapeRecord> {
    let shape = |ball: ClumpBall| ShapeRecord::OffsetSphere { radius: ball.radius, offset: ball.centre.into() };
    clump.balls().map(shape).collect()
}

/// Contactor without a frame of its own.
fn new_contactor(colour: &str, shape: ShapeRecord) -> Contactor {
    Contactor { colour: colour.to_string(), shape, local_frame: None }
}

/// Contents of BULK_BEHAV.DAT.
pub fn bulk_behav(scene: &Scene) -> BulkBehav {
    let material = |m: &crate::scene::Material| Material { name: m.name.clone(), density: m.density };
    BulkBehav { gravity: scene.gravity, materials: scene.materials.iter().map(material).collect() }
}

/// Comments of TACT_BEHAV.DAT for the pairs of colours without a law.
fn no_law_comments(scene: &Scene) -> String {
    let pairs_without_law = scene.contacts.iter().filter(|contact| contact.law.is_none());
    pairs_without_law.map(|contact| TactBehav::no_law_comment(&contact.between.0, &contact.between.1)).collect()
}

/// Contactors of grains, and of walls, in the order in which LMGC90 has the candidate before the antagonist, whatever their
/// order in the scene.
const GRAIN_CONTACTORS: [&str; 4] = ["SPHER", "CAPSx", "POLYR", "CYLND"];
const WALL_CONTACTORS: [&str; 4] = ["PLANx", "CYLND", "DNLYC", "MESHx"];

/// Contactors of one kind and colour of the grains or walls of a scene.
#[derive(Clone, Copy)]
struct ContactorGroup<'a> {
    contactor: &'static str,
    colour: &'a str,
    is_of_walls: bool,
}

impl<'a> ContactorGroup<'a> {
    /// Groups of a colour in a scene.
    fn groups_of_colour(scene: &Scene, colour: &'a str) -> Vec<ContactorGroup<'a>> {
        let has_grains = |contactor: &str| {
            scene.grains.iter().any(|grains| grains.colour == colour && grains.contactor() == contactor)
        };
        let grains = GRAIN_CONTACTORS.into_iter().filter(|contactor| has_grains(contactor));
        let has_walls =
            |contactor: &str| scene.walls.iter().any(|wall| wall.colour() == colour && wall.contactor() == contactor);
        let walls = WALL_CONTACTORS.into_iter().filter(|contactor| has_walls(contactor));
        let group = |is_of_walls| move |contactor| ContactorGroup { contactor, colour, is_of_walls };
        grains.map(group(false)).chain(walls.map(group(true))).collect()
    }

    /// Position in the order of candidates; the same for all walls.
    fn candidate_order(self) -> usize {
        let position_of_grains = || GRAIN_CONTACTORS.iter().position(|known| *known == self.contactor);
        if self.is_of_walls { GRAIN_CONTACTORS.len() } else { position_of_grains().unwrap_or(0) }
    }

    /// Walls of the group with their indices in the scene.
    fn walls(self, scene: &Scene) -> Vec<(usize, &SceneWall)> {
        let is_of_group = |wall: &SceneWall| wall.colour() == self.colour && wall.contactor() == self.contactor;
        (0..).zip(&scene.walls).filter(|(_, wall)| is_of_group(wall)).collect()
    }

    /// Whether a wall of this group can touch one of the other.
    fn can_touch_wall_of(self, other: ContactorGroup, scene: &Scene) -> bool {
        let others = other.walls(scene);
        let can_touch_other =
            |(j, one): &(usize, &SceneWall)| others.iter().any(|(k, other)| j != k && one.can_touch(other));
        self.walls(scene).iter().any(can_touch_other)
    }

    fn to_side(self) -> VisibilitySide {
        VisibilitySide {
            body: "RBDY3".to_string(),
            contactor: self.contactor.to_string(),
            colour: self.colour.to_string(),
        }
    }
}

/// Candidate and antagonist of two groups in the order of LMGC90; `None` if they never touch, or if the same row follows from
/// the groups in the other order.
fn candidate_and_antagonist<'a>(
    scene: &Scene,
    first: ContactorGroup<'a>,
    second: ContactorGroup<'a>,
) -> Option<[ContactorGroup<'a>; 2]> {
    // Within one colour each two contactors occur in both orders.
    let occurs_reversed = first.colour == second.colour;
    let is_in_order = if first.is_of_walls && second.is_of_walls {
        if !first.can_touch_wall_of(second, scene) {
            return None;
        }
        // LMGC90 has a cylinder before a plate.
        first.contactor != "PLANx"
    } else {
        first.candidate_order() <= second.candidate_order()
    };
    if is_in_order { Some([first, second]) } else { (!occurs_reversed).then_some([second, first]) }
}

/// Contents of TACT_BEHAV.DAT.
pub fn tact_behav(scene: &Scene, population: &Population) -> TactBehav {
    let mut visibility = Vec::new();
    for contact in &scene.contacts {
        let Some(law) = &contact.law else { continue };
        let range =
            scene.laws.iter().find(|known| known.name == *law).map_or(0.0, |known| known.kind.attraction_range());
        let alert = contact.alert.unwrap_or_else(|| default_alert(population).max(range));
        let [first_groups, second_groups] =
            [&contact.between.0, &contact.between.1].map(|colour| ContactorGroup::groups_of_colour(scene, colour));
        for &first in &first_groups {
            for &second in &second_groups {
                let Some(sides) = candidate_and_antagonist(scene, first, second) else { continue };
                let [candidate, antagonist] = sides.map(ContactorGroup::to_side);
                let row = VisibilityRow { line: 0, candidate, law: law.clone(), antagonist, alert };
                // Cylinders may be grains and walls of one colour.
                if !visibility.contains(&row) {
                    visibility.push(row);
                }
            }
        }
    }
    TactBehav { laws: scene.laws.iter().map(Law::to_record).collect(), visibility }
}

/// Default alert distance of these grains, m; see [`alert_of_radii`].
pub fn default_alert(population: &Population) -> f64 {
    alert_of_radii(population.grains.iter().map(|grain| grain.radius).collect())
}

/// A tenth of the mean of the radii, at most of three times their median, m: a few large grains do not widen the distance
/// at which small ones are listed. cd-solve also finds contacts of bodies farther apart that collide within a step.
pub fn alert_of_radii(mut radii: Vec<f64>) -> f64 {
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    let middle = radii.len() / 2;
    let median = if radii.is_empty() { 0.0 } else { *radii.select_nth_unstable_by(middle, f64::total_cmp).1 };
    0.1 * mean.min(3.0 * median)
}

/// Imposed components of every wall and every driven grain, and the tables of their files.
pub fn drv_dof(scene: &Scene, population: &Population) -> (DrvDof, FunctionTables) {
    let mut tables = FunctionTables::default();
    let mut driven = Vec::new();
    let mut drive = |body: usize, component: usize, kind: DrivenKind, evolution: &TimeFunction| {
        let evolution = tables.add_function(evolution);
        driven.push(DrivenComponent { line: 0, body, component, kind, evolution });
    };
    for (body, grain) in population.grains.iter().enumerate() {
        for (component, velocity) in scene.grains[grain.group].imposed_components().into_iter().enumerate() {
            velocity.iter().for_each(|velocity| drive(body, component, DrivenKind::Velocity, velocity));
        }
    }
    for (k, wall) in population.walls.iter().enumerate() {
        let (body, servos) = (population.grains.len() + k, &wall.servos);
        for (component, velocity) in wall.motion.iter().enumerate() {
            let (kind, evolution) = match (&servos.pressure, &servos.strain_rate, &wall.loads[component]) {
                (Some((axis, pressure)), ..) if *axis == component => (DrivenKind::Pressure, pressure),
                (_, Some((axis, rate)), _) if *axis == component => (DrivenKind::StrainRate, rate),
                (.., Some(load)) => (DrivenKind::Force, load),
                (.., None) => (DrivenKind::Velocity, velocity),
            };
            drive(body, component, kind, evolution);
        }
        for (component, coordinate) in servos.pivot.iter().flatten().enumerate() {
            drive(body, component, DrivenKind::Pivot, &TimeFunction::Constant(*coordinate));
        }
        for (component, velocity) in servos.surface.iter().enumerate() {
            velocity.iter().for_each(|velocity| drive(body, component, DrivenKind::SurfaceVelocity, velocity));
        }
    }
    (DrvDof(driven), tables)
}

/// Initial velocities and axes; displacements are 0.
pub fn dof_file(population: &Population) -> Dof {
    let grain = |grain: &Grain| {
        let axes = grain.axes();
        let (v, w) = (grain.velocity, axes * grain.spin);
        ([v.x, v.y, v.z, w.x, w.y, w.z], matrix_rows(&axes))
    };
    let wall = |wall: &WallBody| {
        let velocity = [0, 1, 2, 3, 4, 5].map(|k| wall.motion[k].initial_value());
        (velocity, matrix_rows(wall.body_axes()))
    };
    let states = population.grains.par_iter().with_min_len(GRAINS_PER_TASK).map(grain);
    let states = states.chain(population.walls.par_iter().map(wall));
    let body = |(body, (velocity, axes))| BodyDof { line: 0, body, displacement: [0.0; 6], velocity, axes };
    Dof { step: 0, time: 0.0, bodies: states.enumerate().map(body).collect() }
}

/// Rows of a matrix as arrays.
fn matrix_rows(axes: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|k| axes.row(k).transpose().into())
}
