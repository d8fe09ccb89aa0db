//! Walls as plates.

use cd_formats::drv_dof::Evolution as Written;
use nalgebra::{Matrix3, Vector3};

use crate::place::rotation;
use crate::scene::{Evolution, Wall};
use crate::{round_point, round8};

/// A rectangular plate; numbers have the digits of the files.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// Which wall of the scene it belongs to, 0-based.
    pub wall: usize,
    pub material: String,
    pub colour: String,
    /// m
    pub centre: Vector3<f64>,
    /// First and second axis and normal as rows: orthonormal, right-handed.
    pub axes: Matrix3<f64>,
    /// Along the three axes, m.
    pub half_lengths: Vector3<f64>,
    /// Along the fixed axes, m/s; about the plate's own axes, rad/s.
    pub motion: [Evolution; 6],
    /// Along the fixed axes, N; in place of a velocity.
    pub force: [Option<Evolution>; 3],
}

impl Plate {
    /// How deep a sphere reaches into the plate, m; negative when apart. A centre within the plate
    /// counts as at its surface.
    pub fn overlap(&self, centre: &Vector3<f64>, radius: f64) -> f64 {
        let local = self.axes * (centre - self.centre);
        let outside = (local.abs() - self.half_lengths).sup(&Vector3::zeros());
        radius - outside.norm()
    }
}

/// The plates of the scene's (checked) walls, in order.
pub fn plates(walls: &[Wall]) -> Vec<Plate> {
    walls.iter().enumerate().flat_map(|(k, wall)| of_wall(k, wall)).collect()
}

fn of_wall(number: usize, wall: &Wall) -> Vec<Plate> {
    match wall {
        Wall::Plate { material, colour, centre, normal, first_axis, half_lengths, velocity, force, rotation } => {
            let [a, b, c] = velocity.clone();
            let [d, e, f] = rotation.clone();
            vec![Plate {
                wall: number,
                material: material.clone(),
                colour: colour.clone(),
                centre: round_point(&(*centre).into()),
                axes: plate_axes(&(*normal).into(), first_axis.map(Vector3::from)),
                half_lengths: round_point(&(*half_lengths).into()),
                motion: [a, b, c, d, e, f],
                force: *force.clone(),
            }]
        }
        Wall::Box { material, colour, centre, lengths, orientation, half_thickness, lid, velocity } => {
            let turn = rotation(orientation);
            let halves = 0.5 * Vector3::from(*lengths);
            // Floor, four sides, lid: the direction in which each lies from the room.
            let mut sides = vec![(2, -1.0), (0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)];
            sides.extend(lid.then_some((2, 1.0)));
            let plate = |(axis, sign): (usize, f64)| {
                let unit = |k: usize| Vector3::from_fn(|row, _| if row == k { 1.0 } else { 0.0 });
                let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
                // The normal points into the room; turning it turns the second axis too.
                let local = [unit(first), -sign * unit(second), -sign * unit(axis)];
                let rows = local.map(|axis| (turn * axis).add_scalar(0.0).transpose()); // no negative zeros
                // Plates overlap along the edges of the room, so that no grain slips through there.
                let reach = |k: usize| halves[k] + 2.0 * half_thickness;
                let [a, b, c] = velocity.clone();
                let offset = sign * (halves[axis] + half_thickness) * unit(axis);
                Plate {
                    wall: number,
                    material: material.clone(),
                    colour: colour.clone(),
                    centre: round_point(&(Vector3::from(*centre) + turn * offset)),
                    axes: Matrix3::from_rows(&rows),
                    half_lengths: round_point(&Vector3::new(reach(first), reach(second), *half_thickness)),
                    motion: [a, b, c, Evolution::default(), Evolution::default(), Evolution::default()],
                    force: [None, None, None],
                }
            };
            sides.into_iter().map(plate).collect()
        }
    }
}

/// Right-handed axes whose third is `normal`; the first is `first` made square to it, else any.
fn plate_axes(normal: &Vector3<f64>, first: Option<Vector3<f64>>) -> Matrix3<f64> {
    let n = normal.normalize();
    // Without a wish: the fixed axis that is the most square to the normal.
    let first = first.unwrap_or_else(|| Vector3::from_fn(|k, _| if k == n.iamin() { 1.0 } else { 0.0 }));
    let t = (first - n * n.dot(&first)).normalize();
    Matrix3::from_rows(&[t.transpose(), n.cross(&t).transpose(), n.transpose()])
}

/// The functions of time of a scene in the form of DRV_DOF.DAT, and the tables among them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tables(Vec<Vec<(f64, f64)>>);

impl Tables {
    pub fn written(&mut self, evolution: &Evolution) -> Written {
        match evolution {
            Evolution::Constant(value) => Written::constant(*value),
            &Evolution::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate } => {
                Written::Harmonic { constant, amplitude, omega, phase, ramp_start, ramp_rate }
            }
            Evolution::Table(points) => {
                let place = self.0.iter().position(|known| known == points).unwrap_or_else(|| {
                    self.0.push(points.clone());
                    self.0.len() - 1
                });
                Written::Table { name: table_name(place), points: points.iter().map(|&(t, v)| [t, v]).collect() }
            }
        }
    }

    /// Name and text of each table's file.
    pub fn files(&self) -> Vec<(String, String)> {
        let line = |&(t, v): &(f64, f64)| format!("{t:.16E} {v:.16E}\n");
        let text = |points: &Vec<(f64, f64)>| points.iter().map(line).collect();
        self.0.iter().enumerate().map(|(k, points)| (table_name(k), text(points))).collect()
    }
}

fn table_name(place: usize) -> String {
    format!("evolution-{}.dat", place + 1)
}

impl Evolution {
    /// The value at time 0.
    pub fn at_start(&self) -> f64 {
        match self {
            Evolution::Constant(value) => round8(*value),
            _ => Tables::default().written(self).at(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rotation;

    fn room(lid: bool, orientation: Rotation) -> Vec<Plate> {
        plates(&[Wall::Box {
            material: "STEEL".into(),
            colour: "WALLx".into(),
            centre: [1.0, 2.0, 3.0],
            lengths: [4.0, 6.0, 8.0],
            orientation,
            half_thickness: 0.5,
            lid,
            velocity: Default::default(),
        }])
    }

    #[test]
    fn a_box_touches_the_ball_that_fills_it() {
        assert_eq!(room(false, Rotation::default()).len(), 5);
        for angle in [0.0, 0.3] {
            let plates = room(true, Rotation { axis: [1.0, 1.0, 0.0], angle });
            assert_eq!(plates.len(), 6);
            let centre = Vector3::new(1.0, 2.0, 3.0);
            let mut gaps: Vec<f64> = plates.iter().map(|plate| -plate.overlap(&centre, 2.0)).collect();
            gaps.sort_by(f64::total_cmp);
            for (gap, expected) in gaps.iter().zip([0.0, 0.0, 1.0, 1.0, 2.0, 2.0]) {
                assert!((gap - expected).abs() < 1e-6, "{gap} {expected}"); // 8 digits
            }
            for plate in plates {
                let square = plate.axes * plate.axes.transpose();
                assert!((square - Matrix3::identity()).abs().max() < 1e-15 * 4.0);
                assert!((plate.axes.determinant() - 1.0).abs() < 1e-14); // right-handed
                assert!((plate.axes * (centre - plate.centre))[2] > 0.0); // its normal points inwards
            }
        }
    }

    #[test]
    fn axes_are_right_handed_with_the_wished_normal() {
        let normal = Vector3::new(0.0, 3.0, 4.0);
        for first in [None, Some(Vector3::new(1.0, 1.0, 0.0))] {
            let axes = plate_axes(&normal, first);
            assert!((axes.determinant() - 1.0).abs() < 1e-15 * 4.0);
            assert!((axes.row(2).transpose() - normal / 5.0).norm() < 1e-15);
        }
        assert_eq!(plate_axes(&Vector3::z(), None), Matrix3::identity());
    }

    #[test]
    fn equal_tables_share_a_file() {
        let mut tables = Tables::default();
        let table = |end| Evolution::Table(vec![(0.0, 0.0), (1.0, end)]);
        let names: Vec<String> = [1.0, 2.0, 1.0]
            .iter()
            .map(|&end| match tables.written(&table(end)) {
                Written::Table { name, .. } => name,
                Written::Harmonic { .. } => unreachable!(),
            })
            .collect();
        assert_eq!(names, ["evolution-1.dat", "evolution-2.dat", "evolution-1.dat"]);
        assert_eq!(
            tables.files()[1].1,
            "0.0000000000000000E0 0.0000000000000000E0\n1.0000000000000000E0 2.0000000000000000E0\n"
        );
    }
}
