//! Dense packings of spheres up to random close packing, by minimisation of the energy of their overlaps.
//!
//! Spheres start at random positions. Their overlaps δ store the energy Σ δ²/2 of equal springs, which is minimised from
//! there (C. S. O'Hern, L. E. Silbert, A. J. Liu, S. R. Nagel, Phys. Rev. E 68, 011306, 2003) by FIRE (E. Bitzek et al.,
//! Phys. Rev. Lett. 97, 170201, 2006). Below the jamming density the energy falls to 0. Spheres have a padding, and the
//! minimisation ends as soon as overlaps are smaller than that: the spheres themselves then do not overlap at all.
//! Forces on a sphere are summed in the order of its neighbours, and sums over spheres in their order, so that results do
//! not depend on the number of threads.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::cells::SphereGrid;
use super::order::z_order;
use super::region::GrainRegion;
use crate::random::RandomStream;

/// Paddings of the radii as ratios to them, largest first: the next one is used if spheres jam with one. The first lets
/// loose packings end after a few hundred steps; the last lowers the density that can be reached by 3e-4 of it.
const PADDINGS: [f64; 5] = [1e-2, 3e-3, 1e-3, 3e-4, 1e-4];

/// Steps between two tests of whether the energy still falls.
const STALL_STEPS: usize = 500;

/// Ratio of the energies of two such tests above which the spheres are jammed: the slowest packings that still become free
/// of overlaps lose a fifth of their energy in that time.
const STALL_RATIO: f64 = 0.98;

/// Largest number of steps of one minimisation. Packings next to the jamming density take some 10^4.
const MAX_STEPS: usize = 200_000;

/// Smallest relative reduction of the radii in the search for the density at which spheres jam.
const MIN_SHRINKAGE: f64 = 1e-4;

/// Number of reductions of the radii; overlaps fall by about ten times in each.
const MAX_SHRINKAGES: usize = 40;

/// Time steps of FIRE where the stiffness of a contact is 1 and the mass of a sphere of mean radius 1: first and largest.
/// The fastest mode of a packing has a frequency of about 3, so that a step of 0.6 is stable.
const TIME_STEPS: [f64; 2] = [0.1, 0.6];

/// Parameters of FIRE as published: steps before the time step grows, its factors of growth and reduction, initial mixing of
/// force and velocity and its factor.
const FIRE_DELAY: usize = 5;
const FIRE_GROWTH: f64 = 1.1;
const FIRE_REDUCTION: f64 = 0.5;
const FIRE_MIXING: f64 = 0.1;
const FIRE_MIXING_FACTOR: f64 = 0.99;

/// Largest step of a sphere, divided by the mean radius: spheres that start one in another fly apart no faster.
const MAX_TRAVEL: f64 = 0.2;

/// Skin of the lists of neighbours, divided by the mean radius: first, smallest and largest. It grows while lists are made
/// often and shrinks while they are made rarely.
const SKINS: [f64; 3] = [0.5, 0.05, 1.0];

/// Steps between two lists of neighbours below and above which the skin grows and shrinks.
const LIST_STEPS: [usize; 2] = [10, 100];

/// Least number of spheres per task: the forces on one take about a tenth of a microsecond.
const SPHERES_PER_TASK: usize = 1024;

/// Number of random points for one start position.
const MAX_ATTEMPTS: usize = 1_000_000;

/// Region with the periods of the scene that it fills.
pub struct PackingCell<'a> {
    pub region: &'a GrainRegion,
    /// Periods along the axes of a box, m; none along an axis on which the region has walls.
    pub periods: [Option<f64>; 3],
}

/// Reason why spheres are not packed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PackingError {
    /// The spheres jam before they have their radii: the ratio of the volume of all spheres at which they fit to their full
    /// volume.
    Jammed { volume_ratio: f64 },
    /// No random point lies in the region.
    NoPoint,
}

impl std::fmt::Display for PackingError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            PackingError::Jammed { volume_ratio } => write!(f, "the spheres jam at {volume_ratio:.4} of their volume"),
            PackingError::NoPoint => write!(f, "no random point lies in the region: it is too thin"),
        }
    }
}

impl std::error::Error for PackingError {}

/// Centres of spheres of `radii`, m, without overlap and completely in the cell.
///
/// Errors: spheres that jam, a region that is too thin.
pub fn pack_spheres(
    cell: &PackingCell,
    radii: &[f64],
    random: &mut RandomStream,
) -> Result<Vec<Vector3<f64>>, PackingError> {
    let halves = cell.region.half_extents();
    let start = |_| {
        let mut trials = (0..MAX_ATTEMPTS).map(|_| random.point_in_cube().component_mul(&halves));
        trials.find(|point| cell.region.contains_ball(point, 0.0)).ok_or(PackingError::NoPoint)
    };
    let mut centres = (0..radii.len()).map(start).collect::<Result<Vec<_>, _>>()?;
    // Spheres that are near in space are near in memory.
    let order = z_order(cell.region, &centres);
    centres = order.into_iter().map(|k| centres[k]).collect();
    let mut packing = MovingSpheres::new(cell, radii, centres);
    for padding in PADDINGS {
        if packing.relax(1.0, padding) {
            packing.move_into_cell();
            return Ok(packing.centres);
        }
    }
    let last_padding = PADDINGS[PADDINGS.len() - 1];
    let (mut scale, mut overlap) = (1.0, packing.mean_overlap(1.0, last_padding));
    for _ in 0..MAX_SHRINKAGES {
        scale *= 1.0 - overlap.clamp(MIN_SHRINKAGE, 0.5);
        if packing.relax(scale, last_padding) {
            break;
        }
        overlap = packing.mean_overlap(scale, last_padding);
    }
    Err(PackingError::Jammed { volume_ratio: scale.powi(3) })
}

/// Force on a sphere, and its contributions to sums over all spheres.
#[derive(Clone, Copy, Default)]
struct SphereLoad {
    /// Force, in metres of overlap.
    force: Vector3<f64>,
    /// Energy, m^2; half of that of each contact of two spheres.
    energy: f64,
    /// Largest overlap, divided by the sum of the padded radii, or by the padded radius at a wall.
    deepest: f64,
    /// Sum of these ratios, and number of contacts.
    sum: f64,
    contacts: u32,
}

/// Spheres that move to positions without overlap.
struct MovingSpheres<'a> {
    cell: &'a PackingCell<'a>,
    radii: &'a [f64],
    mean_radius: f64,
    /// Masses: the squares of the radii, as the number of contacts of a sphere, divided by that of the mean radius.
    masses: Vec<f64>,
    centres: Vec<Vector3<f64>>,
    neighbours: NeighbourLists,
    /// m
    skin: f64,
}

/// Spheres near each sphere, by increasing index.
#[derive(Default)]
struct NeighbourLists {
    /// First entry of each sphere in `entries`, and the end of the last.
    starts: Vec<usize>,
    entries: Vec<u32>,
    /// Whether a wall is near.
    near_walls: Vec<bool>,
    /// Centres for which the lists were made, m.
    centres: Vec<Vector3<f64>>,
}

impl<'a> MovingSpheres<'a> {
    fn new(cell: &'a PackingCell, radii: &'a [f64], centres: Vec<Vector3<f64>>) -> Self {
        let mean_radius = radii.iter().sum::<f64>() / radii.len() as f64;
        let masses = radii.iter().map(|radius| (radius / mean_radius).powi(2)).collect();
        let skin = SKINS[0] * mean_radius;
        MovingSpheres { cell, radii, mean_radius, masses, centres, neighbours: NeighbourLists::default(), skin }
    }

    /// Minimises the energy at radii of `scale` times their own and `padding` until no sphere overlaps without padding, or
    /// the energy stops falling. Returns whether no two spheres overlap and none reaches out of the region.
    fn relax(&mut self, scale: f64, padding: f64) -> bool {
        let factor = scale * (1.0 + padding);
        let mut velocities = vec![Vector3::zeros(); self.radii.len()];
        let (mut time_step, mut mixing, mut downhill_steps) = (TIME_STEPS[0], FIRE_MIXING, 0);
        let (mut last_energy, mut list_step) = (f64::INFINITY, 0);
        self.list_neighbours(factor);
        for step in 0..MAX_STEPS {
            if self.has_left_lists() {
                let age = step - list_step;
                let change = if age < LIST_STEPS[0] {
                    1.3
                } else if age > LIST_STEPS[1] {
                    0.8
                } else {
                    1.0
                };
                self.skin = (change * self.skin).clamp(SKINS[1] * self.mean_radius, SKINS[2] * self.mean_radius);
                list_step = step;
                self.list_neighbours(factor);
            }
            let loads = self.loads(factor);
            let deepest = loads.iter().map(|load| load.deepest).fold(0.0, f64::max);
            if deepest <= padding / (1.0 + padding) {
                return true;
            }
            if step % STALL_STEPS == 0 {
                let energy = loads.iter().map(|load| load.energy).sum();
                if energy > STALL_RATIO * last_energy {
                    break;
                }
                last_energy = energy;
            }
            let (mut power, mut speed_square, mut force_square) = (0.0, 0.0, 0.0);
            for ((load, velocity), mass) in loads.iter().zip(&velocities).zip(&self.masses) {
                power += load.force.dot(velocity);
                speed_square += mass * velocity.norm_squared();
                force_square += load.force.norm_squared() / mass;
            }
            if power > 0.0 {
                let pull = mixing * (speed_square / force_square).sqrt();
                for ((load, velocity), mass) in loads.iter().zip(&mut velocities).zip(&self.masses) {
                    *velocity = *velocity * (1.0 - mixing) + load.force * (pull / mass);
                }
                downhill_steps += 1;
                if downhill_steps > FIRE_DELAY {
                    time_step = f64::min(FIRE_GROWTH * time_step, TIME_STEPS[1]);
                    mixing *= FIRE_MIXING_FACTOR;
                }
            } else {
                velocities.fill(Vector3::zeros());
                (downhill_steps, mixing) = (0, FIRE_MIXING);
                time_step = f64::max(FIRE_REDUCTION * time_step, 0.01 * TIME_STEPS[0]);
            }
            let longest = MAX_TRAVEL * self.mean_radius / time_step;
            for (((load, velocity), mass), centre) in
                loads.iter().zip(&mut velocities).zip(&self.masses).zip(&mut self.centres)
            {
                *velocity += load.force * (time_step / mass);
                let speed = velocity.norm();
                if speed > longest {
                    *velocity *= longest / speed;
                }
                *centre += *velocity * time_step;
            }
        }
        false
    }

    /// Mean overlap of the contacts, divided by the sum of the padded radii, with the present lists of neighbours.
    fn mean_overlap(&self, scale: f64, padding: f64) -> f64 {
        let loads = self.loads(scale * (1.0 + padding));
        let contacts: u64 = loads.iter().map(|load| u64::from(load.contacts)).sum();
        loads.iter().map(|load| load.sum).sum::<f64>() / contacts.max(1) as f64
    }

    /// Vector from the nearest image of one centre to another, m, from their difference.
    fn nearest_separation(&self, mut difference: Vector3<f64>) -> Vector3<f64> {
        for (k, period) in self.cell.periods.iter().enumerate() {
            if let Some(period) = period
                && difference[k].abs() > 0.5 * period
            {
                difference[k] -= period.copysign(difference[k]);
            }
        }
        difference
    }

    /// Whether a sphere has moved by half the skin since the lists were made.
    fn has_left_lists(&self) -> bool {
        // A hair less, for rounding.
        let longest = 0.499 * self.skin;
        self.centres.iter().zip(&self.neighbours.centres).any(|(a, b)| (a - b).norm_squared() > longest * longest)
    }

    /// Forces on all spheres of `factor` times their radii.
    fn loads(&self, factor: f64) -> Vec<SphereLoad> {
        (0..self.radii.len()).into_par_iter().with_min_len(SPHERES_PER_TASK).map(|k| self.load(k, factor)).collect()
    }

    /// Force on a sphere from its neighbours and the walls.
    fn load(&self, k: usize, factor: f64) -> SphereLoad {
        let mut load = SphereLoad::default();
        let (centre, radius) = (self.centres[k], factor * self.radii[k]);
        let mut add = |direction: Vector3<f64>, overlap: f64, length: f64, share: f64| {
            load.force += direction * overlap;
            load.energy += share * 0.5 * overlap * overlap;
            load.deepest = load.deepest.max(overlap / length);
            load.sum += overlap / length;
            load.contacts += 1;
        };
        let lists = &self.neighbours;
        for &other in &lists.entries[lists.starts[k]..lists.starts[k + 1]] {
            let other = other as usize;
            let reach = radius + factor * self.radii[other];
            let separation = self.nearest_separation(centre - self.centres[other]);
            let square = separation.norm_squared();
            if square < reach * reach {
                let distance = square.sqrt();
                let overlap = reach - distance;
                // Spheres at the same point part along an axis.
                let arbitrary = if k < other { Vector3::x() } else { -Vector3::x() };
                add(if distance > 0.0 { separation / distance } else { arbitrary }, overlap, reach, 0.5);
            }
        }
        if lists.near_walls[k] {
            self.for_each_wall(&centre, |distance, inward| {
                if distance < radius {
                    add(inward, radius - distance, radius, 1.0);
                }
            });
        }
        load
    }

    /// Calls `visit` with the distance of a point from each wall that is not across a period, m, negative beyond it, and
    /// the unit normal inward.
    fn for_each_wall(&self, point: &Vector3<f64>, mut visit: impl FnMut(f64, Vector3<f64>)) {
        self.cell.region.for_each_wall(point, |distance, inward| {
            if (0..3).all(|k| self.cell.periods[k].is_none() || inward[k] == 0.0) {
                visit(distance, inward);
            }
        });
    }

    /// Moves centres beyond the ends of a period to their images in the cell.
    fn move_into_cell(&mut self) {
        for centre in &mut self.centres {
            for (k, period) in self.cell.periods.iter().enumerate() {
                period.iter().for_each(|period| centre[k] -= period * (centre[k] / period).round());
            }
        }
    }

    /// Lists the neighbours of spheres of `factor` times their radii within the skin, after a move of the centres into the
    /// cell.
    fn list_neighbours(&mut self, factor: f64) {
        self.move_into_cell();
        let periods = self.cell.periods;
        let radii: Vec<f64> = self.radii.iter().map(|radius| factor * radius + 0.5 * self.skin).collect();
        let mut order: Vec<usize> = (0..radii.len()).collect();
        order.sort_unstable_by(|&a, &b| radii[b].total_cmp(&radii[a]).then(a.cmp(&b)));
        let largest = order.first().map_or(1.0, |&k| radii[k]);
        let mut cells = SphereGrid::new(largest);
        let mut numbers = vec![0; radii.len()];
        for (number, &k) in order.iter().enumerate() {
            cells.add(self.centres[k], radii[k]);
            numbers[k] = number;
        }
        // Neighbours that are no smaller, or as large and of a smaller index: each pair once.
        let larger_neighbours = |k: usize| {
            let mut found = Vec::new();
            for shift in image_shifts(&periods, &self.centres[k], radii[k] + largest) {
                cells.for_each_overlap(&(self.centres[k] + shift), radii[k], |number, _| {
                    if number < numbers[k] {
                        found.push(order[number] as u32);
                    }
                });
            }
            found
        };
        let pairs: Vec<Vec<u32>> =
            (0..radii.len()).into_par_iter().with_min_len(SPHERES_PER_TASK / 4).map(larger_neighbours).collect();
        let mut counts: Vec<usize> = pairs.iter().map(Vec::len).collect();
        pairs.iter().flatten().for_each(|&other| counts[other as usize] += 1);
        let lists = &mut self.neighbours;
        lists.starts.clear();
        lists.starts.push(0);
        for count in counts {
            lists.starts.push(lists.starts[lists.starts.len() - 1] + count);
        }
        lists.entries.clear();
        lists.entries.resize(lists.starts[radii.len()], 0);
        let mut ends = lists.starts.clone();
        let mut append = |k: usize, other: u32| {
            lists.entries[ends[k]] = other;
            ends[k] += 1;
        };
        for (k, found) in pairs.iter().enumerate() {
            for &other in found {
                append(k, other);
                append(other as usize, k as u32);
            }
        }
        for ends in lists.starts.windows(2) {
            lists.entries[ends[0]..ends[1]].sort_unstable();
        }
        lists.centres.clone_from(&self.centres);
        let near_wall = |k: usize| {
            let mut is_near = false;
            self.for_each_wall(&self.centres[k], |distance, _| is_near |= distance < radii[k]);
            is_near
        };
        let near_walls = (0..radii.len()).into_par_iter().with_min_len(SPHERES_PER_TASK / 4).map(near_wall).collect();
        self.neighbours.near_walls = near_walls;
    }
}

/// Shifts, m, to those images of a point of the cell that are within `reach`, m, of the cell: none first.
fn image_shifts(periods: &[Option<f64>; 3], point: &Vector3<f64>, reach: f64) -> Vec<Vector3<f64>> {
    let mut shifts = vec![Vector3::zeros()];
    for (k, period) in periods.iter().enumerate() {
        let Some(period) = period.filter(|period| point[k].abs() > 0.5 * period - reach) else { continue };
        let image = |shift: &Vector3<f64>| {
            let mut shift = *shift;
            shift[k] -= period.copysign(point[k]);
            shift
        };
        let images: Vec<Vector3<f64>> = shifts.iter().map(image).collect();
        shifts.extend(images);
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::StreamPurpose;
    use crate::sphere::sphere_volume;

    /// Cube in which spheres of `radii` have the solid fraction `nu`, periodic along all axes.
    struct PeriodicCube {
        region: GrainRegion,
        periods: [Option<f64>; 3],
    }

    impl PeriodicCube {
        fn new(radii: &[f64], nu: f64) -> PeriodicCube {
            let volume: f64 = radii.iter().copied().map(sphere_volume).sum();
            let length = (volume / nu).cbrt();
            PeriodicCube { region: GrainRegion::Box([0.5 * length; 3]), periods: [Some(length); 3] }
        }

        fn pack(&self, radii: &[f64], seed: u64) -> Result<Vec<Vector3<f64>>, PackingError> {
            let mut random = RandomStream::new(seed, 0, StreamPurpose::Positions);
            pack_spheres(&PackingCell { region: &self.region, periods: self.periods }, radii, &mut random)
        }

        /// Separations of all pairs of spheres, m, and their distances less the sums of the radii.
        fn gaps(&self, radii: &[f64], centres: &[Vector3<f64>]) -> Vec<(Vector3<f64>, f64)> {
            let length = self.periods[0].unwrap();
            let pair = |a: usize, b: usize| {
                let separation = (centres[a] - centres[b]).map(|x| x - length * (x / length).round());
                (separation, separation.norm() - radii[a] - radii[b])
            };
            (0..radii.len()).flat_map(|a| (0..a).map(move |b| (a, b))).map(|(a, b)| pair(a, b)).collect()
        }
    }

    /// Solid fraction at which spheres jam that are to have the higher one `nu`.
    fn jamming_fraction(radii: &[f64], nu: f64) -> f64 {
        match PeriodicCube::new(radii, nu).pack(radii, 1) {
            Err(PackingError::Jammed { volume_ratio }) => nu * volume_ratio,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn equal_spheres_jam_at_random_close_packing_and_unequal_ones_above() {
        let number = 200;
        let equal = jamming_fraction(&vec![1.0; number], 0.67);
        // O'Hern et al. (2003): 0.639 for many spheres, with a scatter of 0.006 for 200; crystals reach 0.74.
        assert!((0.625..0.65).contains(&equal), "{equal}");
        let bidisperse: Vec<f64> = (0..number).map(|k| if k % 2 == 0 { 1.0 } else { 1.4 }).collect();
        let bidisperse = jamming_fraction(&bidisperse, 0.68);
        // N(>r) ~ r^-2.5 between 1 and 5, at equally spaced quantiles.
        let quantile = |k: usize| (1.0 - (k as f64 + 0.5) / number as f64 * (1.0 - 5f64.powf(-2.5))).powf(-0.4);
        let power_law = jamming_fraction(&(0..number).map(quantile).collect::<Vec<_>>(), 0.73);
        assert!(equal < bidisperse + 0.005 && bidisperse < power_law - 0.01, "{equal} {bidisperse} {power_law}");
    }

    #[test]
    fn dense_spheres_do_not_overlap_and_their_contacts_favour_no_direction() {
        let radii = vec![1.0; 300];
        let cube = PeriodicCube::new(&radii, 0.61);
        let centres = cube.pack(&radii, 2).unwrap();
        let gaps = cube.gaps(&radii, &centres);
        let smallest = gaps.iter().map(|gap| gap.1).fold(f64::INFINITY, f64::min);
        // Rounding of coordinates of about 10.
        assert!(smallest > -1e-14, "{smallest}");
        // Neighbours within a twentieth of a radius.
        let normals: Vec<Vector3<f64>> = gaps.iter().filter(|gap| gap.1 < 0.05).map(|gap| gap.0.normalize()).collect();
        assert!(normals.len() > 450, "{}", normals.len());
        // The variance of the square of a component of a random direction is 4/45; five standard errors.
        let bound = 5.0 * (4.0 / 45.0 / normals.len() as f64).sqrt();
        for axis in 0..3 {
            let share = normals.iter().map(|normal| normal[axis].powi(2)).sum::<f64>() / normals.len() as f64;
            assert!((share - 1.0 / 3.0).abs() < bound, "axis {axis}: {share}");
        }
    }

    #[test]
    fn spheres_do_not_overlap_whatever_their_sizes() {
        // Radii from 1 to 6, the largest rare.
        let radii: Vec<f64> = (0..400).map(|k| if k % 100 == 0 { 6.0 } else { 1.0 + (k % 7) as f64 * 0.2 }).collect();
        let cube = PeriodicCube::new(&radii, 0.5);
        let centres = cube.pack(&radii, 3).unwrap();
        let smallest = cube.gaps(&radii, &centres).iter().map(|gap| gap.1).fold(f64::INFINITY, f64::min);
        assert!(smallest > -1e-13, "{smallest}"); // rounding of coordinates of about 10
    }

    #[test]
    fn the_number_of_threads_changes_no_bit_and_the_seed_does() {
        let radii = vec![1.0; 2 * SPHERES_PER_TASK + 50];
        let cube = PeriodicCube::new(&radii, 0.25);
        let packed = |threads: usize, seed: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| cube.pack(&radii, seed)).unwrap()
        };
        let alone = packed(1, 1);
        assert_eq!(packed(3, 1), alone);
        assert_ne!(packed(3, 2), alone);
    }

    #[test]
    fn images_are_those_near_the_cell() {
        let periods = [Some(10.0), None, Some(10.0)];
        assert_eq!(image_shifts(&periods, &Vector3::new(1.0, 9.0, -1.0), 2.0), [Vector3::zeros()]);
        let shifts = image_shifts(&periods, &Vector3::new(4.0, 9.0, -4.0), 2.0);
        let expected = [[0.0, 0.0, 0.0], [-10.0, 0.0, 0.0], [0.0, 0.0, 10.0], [-10.0, 0.0, 10.0]];
        assert_eq!(shifts, expected.map(Vector3::from));
    }
}
