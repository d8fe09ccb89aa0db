//! Means over a region: solid fraction, mean motion with its gradient, and stress, in one step.

use std::f64::consts::PI;

use cd_formats::geometry::convex_region::ConvexRegion;
use cd_formats::probe::RegionMeans;
use cd_formats::region::SpaceRegion;

use crate::math::{Mat3, Vec3, to_world};
use crate::scene::{BodyId, Scene};
use crate::state::State;
use crate::step::StepStart;

/// Least RMS distance of centres from their mean along an axis, over the mean radius, with which the velocity has a gradient
/// along that axis. Grains in one layer have 0, and in two layers that touch 1.
const MIN_SPREAD: f64 = 0.5;

/// Region of a probe, with its images in a periodic scene.
pub struct ProbeRegion {
    shape: ConvexRegion,
    /// Sums of whole periods that shift positions in the cell into the region, m.
    shifts: Vec<Vec3>,
}

/// Part of a grain that is inside.
struct GrainPart {
    /// Centre of the grain, m.
    x: Vec3,
    /// Velocity of the centre, m/s.
    v: Vec3,
    /// Mass of the part, kg.
    mass: f64,
}

/// Linear velocity field.
struct MeanField {
    centre: Vec3,
    velocity: Vec3,
    gradient: Mat3,
}

impl ProbeRegion {
    /// Region of a probe of these bodies; `None` for one that cd-solve rejects when it reads the scene.
    pub fn new(scene: &Scene, region: &SpaceRegion, bodies: &[BodyId]) -> Option<Self> {
        Some(ProbeRegion { shape: region.convex_region()?, shifts: scene.region_images(region, bodies)? })
    }

    /// Columns of the means over the grains among `bodies`, which are in the run: positions and velocities at the end of the
    /// step, contacts where they were detected.
    pub fn means(&self, scene: &Scene, state: &State, start: &StepStart, bodies: &[BodyId]) -> Vec<f64> {
        let volume = self.shape.volume();
        let (mut grains, mut solid_volume, mut shares, mut diameters) = (0.0, 0.0, 0.0, 0.0);
        let mut parts: Vec<GrainPart> = Vec::new();
        let mut is_grain = vec![false; scene.bodies.len()];
        for body in bodies.iter().filter(|body| !scene.walls[body.index()]) {
            let (i, rigid_body) = (body.index(), &scene.bodies[body.index()]);
            is_grain[i] = true;
            let in_cell = state.x[i] + shift_to_cell(scene, &state.x[i]);
            for shift in &self.shifts {
                let x = in_cell + shift;
                let share = self.shape.share_of_ball(&x, rigid_body.radius);
                grains += f64::from(u8::from(self.shape.contains(&x)));
                if share > 0.0 {
                    shares += share;
                    diameters += share * 2.0 * rigid_body.radius;
                    solid_volume += share * 4.0 / 3.0 * PI * rigid_body.radius.powi(3);
                    parts.push(GrainPart { x, v: state.v[i], mass: share * rigid_body.mass });
                }
            }
        }
        let mass = parts.iter().map(|part| part.mass).fold(0.0, |sum, mass| sum + mass);
        let diameter = diameters / shares;
        let field = MeanField::from_parts(&parts, mass, 0.5 * diameter);
        let fluctuation = |part: &GrainPart| {
            let v = part.v - field.velocity - field.gradient * (part.x - field.centre);
            v * v.transpose() * part.mass
        };
        let fluctuations = parts.iter().map(fluctuation).sum::<Mat3>();
        RegionMeans {
            grains,
            nu: solid_volume / volume,
            density: mass / volume,
            diameter,
            velocity: field.velocity.into(),
            temperature: fluctuations.trace() / (3.0 * mass),
            stress: components(&(self.contact_moment(scene, state, start, &is_grain) / volume)),
            kinetic: components(&(fluctuations / volume)),
            gradient: [0, 1, 2].map(|row| [0, 1, 2].map(|column| field.gradient[(row, column)])),
        }
        .columns()
    }

    /// Sum of f ⊗ l over the contacts of grains, N m: f is the force on the candidate, l the branch from the centre of the
    /// antagonist to that of the candidate, from or to the point of contact for a body that is no grain. Each contact counts
    /// by the share of its branch inside. Source: Love (1892), Weber (1966); shares: Babic (1997).
    fn contact_moment(&self, scene: &Scene, state: &State, start: &StepStart, is_grain: &[bool]) -> Mat3 {
        let mut moment = Mat3::zeros();
        for solved in &state.contacts {
            let contact = &solved.contact;
            let [i, j] = [contact.candidate, contact.antagonist].map(BodyId::index);
            if !(is_grain[i] || is_grain[j]) {
                continue;
            }
            let to = if is_grain[i] { start.x[i] } else { contact.point };
            let from = if is_grain[j] { start.x[j] + contact.image } else { contact.point };
            let in_cell = shift_to_cell(scene, &to);
            let share_inside = |shift: &Vec3| {
                let shift = in_cell + shift;
                self.shape.share_of_segment(&(from + shift), &(to + shift))
            };
            let share: f64 = self.shifts.iter().map(share_inside).sum();
            if share > 0.0 {
                let force = to_world(&contact.frame(), &solved.impulse) / state.h;
                moment += force * (to - from).transpose() * share;
            }
        }
        moment
    }
}

/// Sum of whole periods that shifts a position into the cell about the origin, m.
fn shift_to_cell(scene: &Scene, x: &Vec3) -> Vec3 {
    scene.periodic_cell().nearest_shift(&-x)
}

impl MeanField {
    /// Field v + L (x - centre) of least squares, weighted by mass; `mass` is the sum (kg), `radius` the mean radius of the
    /// grains (m). L is 0 along axes along which the centres have no spread. Not a number without parts.
    fn from_parts(parts: &[GrainPart], mass: f64, radius: f64) -> MeanField {
        let centre = parts.iter().map(|part| part.x * part.mass).sum::<Vec3>() / mass;
        let velocity = parts.iter().map(|part| part.v * part.mass).sum::<Vec3>() / mass;
        if parts.is_empty() {
            return MeanField { centre, velocity, gradient: Mat3::repeat(f64::NAN) };
        }
        let (mut spread, mut correlation) = (Mat3::zeros(), Mat3::zeros());
        for part in parts {
            let arm = part.x - centre;
            spread += arm * arm.transpose() * part.mass;
            correlation += (part.v - velocity) * arm.transpose() * part.mass;
        }
        let eigen = (spread / mass).symmetric_eigen();
        let mut inverse = Mat3::zeros();
        for (square, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *square > (MIN_SPREAD * radius).powi(2) {
                inverse += axis * axis.transpose() / *square;
            }
        }
        MeanField { centre, velocity, gradient: correlation / mass * inverse }
    }
}

/// Components xx, yy, zz, xy, xz, yz of the symmetric part.
fn components(tensor: &Mat3) -> [f64; 6] {
    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(|(i, j)| 0.5 * (tensor[(i, j)] + tensor[(j, i)]))
}
