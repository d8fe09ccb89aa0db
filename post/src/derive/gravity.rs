//! Energy of many attracting points, by a tree, for `energy`; and the virial of the attraction between two sets of points.
//!
//! Groups of points that are far from each other attract by their masses and the quadrupoles about their centres of mass
//! (Barnes & Hut 1986; Hernquist 1987), group by group (Dehnen 2002). The result is an energy, for which a part in 10^4 is
//! enough; `--direct-gravity` sums every pair.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::math::{Mat3, Vec3};

/// Opening: groups act as such from distances of more than the sum of their reaches divided by this value. With it and
/// [`REACH_STRETCH`] the energy of 12000 to 20000 points in a ball, a disc, a stream and on a line is off by 4e-5 to 8e-5.
const OPENING_ANGLE: f64 = 0.6;
/// Extension of a group's reach beyond its radius, as a share of the radius, per square of |Q| / m r^2, which is 2/3 of a
/// line, 3/8 of a disc and 0 of a ball. A ball has no moments beyond the quadrupole and a line has the largest: without the
/// extension, at an opening of 0.5, these were off by 4e-5 and 2.3e-3.
const REACH_STRETCH: f64 = 2.5;
/// Largest number of points in a leaf.
const LEAF_SIZE: usize = 16;
/// Number of points from which on the parts of a sum are separate tasks.
const PARALLEL_POINTS: usize = 4096;

/// sum_i m_i d_i . sum_j m_j (x_j - x_i) / |x_j - x_i|^3, kg^2/m: the virial of the attraction that `members` feel of
/// `others`, divided by G.
///
/// `members`: positions d_i from `centre`, m, and masses, kg; `others`: positions x_j and masses. Sums every pair, in an
/// order that does not depend on the number of threads.
pub fn attraction_between(members: &[(Vec3, f64)], centre: &Vec3, others: &[(Vec3, f64)]) -> f64 {
    let virial = |(d, mass): &(Vec3, f64)| {
        let attraction = |(x, m): &(Vec3, f64)| {
            let to = x - centre - d;
            to * (m / to.norm().powi(3).max(f64::MIN_POSITIVE))
        };
        mass * d.dot(&others.iter().map(attraction).sum::<Vec3>())
    };
    let sums: Vec<f64> = members.par_iter().map(virial).collect();
    sums.iter().sum()
}

/// Node of the tree: a range of the sorted points, and its moments.
struct TreeNode {
    /// Range of the sorted points.
    points: Range<usize>,
    /// Indices of the two halves; none of a leaf.
    halves: Option<[usize; 2]>,
    /// Index into [`GravityTree::leaves`], of a leaf.
    leaf: usize,
    /// Mass of its points, kg.
    mass: f64,
    /// Centre of mass, m.
    centre: Vec3,
    /// Largest distance of the node's points from the centre, m, extended for flat or long nodes.
    reach: f64,
    /// sum m (3 d (x) d - d.d) over its points, d from the centre, kg m^2.
    quadrupole: Mat3,
}

/// Attracting points in a tree.
pub struct GravityTree {
    /// Position, m, and mass, kg, in the order of the tree.
    points: Vec<(Vec3, f64)>,
    nodes: Vec<TreeNode>,
    /// The points of the leaves again, for vectors.
    leaves: Vec<LeafPoints>,
    /// Widest vectors of the processor.
    arch: Arch,
}

/// Points of a leaf by coordinates, m, and masses, kg; unused ones have no mass.
#[derive(Clone, Copy, Default)]
struct LeafPoints {
    x: [f64; LEAF_SIZE],
    y: [f64; LEAF_SIZE],
    z: [f64; LEAF_SIZE],
    mass: [f64; LEAF_SIZE],
}

impl GravityTree {
    /// `points`: position in m and mass in kg of each.
    pub fn new(points: &[(Vec3, f64)]) -> GravityTree {
        let mut tree = GravityTree { points: Vec::new(), nodes: Vec::new(), leaves: Vec::new(), arch: Arch::new() };
        if !points.is_empty() {
            let mut order: Vec<usize> = (0..points.len()).collect();
            tree.divide_node(points, &mut order, 0);
            tree.points = order.iter().map(|&i| points[i]).collect();
            tree.pack_leaves();
        }
        tree
    }

    /// Creates the node of `order`, which begins at `first`, and its descendants; returns its index.
    fn divide_node(&mut self, points: &[(Vec3, f64)], order: &mut [usize], first: usize) -> usize {
        let node_points = || order.iter().map(|&i| points[i]);
        let mass: f64 = node_points().map(|(_, m)| m).sum();
        let centre = node_points().map(|(x, m)| m * x).sum::<Vec3>() / mass;
        let radius: f64 = node_points().map(|(x, _)| (x - centre).norm()).fold(0.0, f64::max);
        let quadrupole = node_points()
            .map(|(x, m)| {
                let d = x - centre;
                m * (3.0 * d * d.transpose() - Mat3::from_diagonal_element(d.norm_squared()))
            })
            .sum::<Mat3>();
        let spread = mass * radius * radius;
        let stretch = if spread > 0.0 { REACH_STRETCH * (quadrupole / spread).norm_squared() } else { 0.0 };
        let reach = radius * (1.0 + stretch);
        let (low, high) = node_points().fold((centre, centre), |(low, high), (x, _)| (low.inf(&x), high.sup(&x)));
        let index = self.nodes.len();
        let range = first..first + order.len();
        self.nodes.push(TreeNode { points: range, halves: None, leaf: usize::MAX, mass, centre, reach, quadrupole });
        if order.len() > LEAF_SIZE {
            let axis = (high - low).imax();
            let middle = order.len() / 2;
            // Equal coordinates keep their order, independent of the sorting.
            order.select_nth_unstable_by(middle, |&i, &j| {
                points[i].0[axis].total_cmp(&points[j].0[axis]).then(i.cmp(&j))
            });
            let (left, right) = order.split_at_mut(middle);
            let halves = [self.divide_node(points, left, first), self.divide_node(points, right, first + middle)];
            self.nodes[index].halves = Some(halves);
        }
        index
    }

    /// Copies the points of each leaf into [`GravityTree::leaves`].
    fn pack_leaves(&mut self) {
        for node in self.nodes.iter_mut().filter(|node| node.halves.is_none()) {
            let mut leaf = LeafPoints::default();
            for (k, (x, mass)) in self.points[node.points.clone()].iter().enumerate() {
                (leaf.x[k], leaf.y[k], leaf.z[k], leaf.mass[k]) = (x.x, x.y, x.z, *mass);
            }
            node.leaf = self.leaves.len();
            self.leaves.push(leaf);
        }
    }

    /// Potential energy, J: W = - sum_{i<j} G m_i m_j / |x_i - x_j|, the same on any number of threads.
    pub fn potential_energy(&self, constant: f64) -> f64 {
        if self.nodes.is_empty() { 0.0 } else { -constant * self.pairs_within(0) }
    }

    /// sum m_i m_j / |x_i - x_j| over the pairs of a node's points, kg^2/m.
    fn pairs_within(&self, node: usize) -> f64 {
        let Some([a, b]) = self.nodes[node].halves else {
            let own = self.node_points(node);
            return (0..own.len()).map(|i| point_attraction(&own[..i], &own[i])).sum();
        };
        let (halves, between) = self.sum_both(
            node,
            || self.sum_both(node, || self.pairs_within(a), || self.pairs_within(b)),
            || self.pairs_between(a, b),
        );
        halves.0 + halves.1 + between
    }

    /// sum m_i m_j / |x_i - x_j| over the pairs of a point of one node and a point of another, kg^2/m.
    fn pairs_between(&self, a: usize, b: usize) -> f64 {
        let [first, second] = [a, b].map(|node| &self.nodes[node]);
        let to = second.centre - first.centre;
        let distance = to.norm();
        if first.reach + second.reach < OPENING_ANGLE * distance {
            let quadrupole = first.quadrupole * second.mass + second.quadrupole * first.mass;
            return first.mass * second.mass / distance + 0.5 * to.dot(&(quadrupole * to)) / distance.powi(5);
        }
        let (larger, smaller) = if first.reach >= second.reach { (a, b) } else { (b, a) };
        let (node, halves, other) = match [larger, smaller].map(|node| self.nodes[node].halves) {
            [Some(halves), _] => (larger, halves, smaller),
            [None, Some(halves)] => (smaller, halves, larger),
            [None, None] => {
                return self.arch.dispatch(LeafPair { points: self.node_points(a), leaf: &self.leaves[second.leaf] });
            }
        };
        let (left, right) =
            self.sum_both(node, || self.pairs_between(halves[0], other), || self.pairs_between(halves[1], other));
        left + right
    }

    fn node_points(&self, node: usize) -> &[(Vec3, f64)] {
        &self.points[self.nodes[node].points.clone()]
    }

    /// Returns both sums, computed in parallel if a node has many points.
    fn sum_both<A: Send, B: Send>(
        &self,
        node: usize,
        a: impl FnOnce() -> A + Send,
        b: impl FnOnce() -> B + Send,
    ) -> (A, B) {
        if self.nodes[node].points.len() > PARALLEL_POINTS { rayon::join(a, b) } else { (a(), b()) }
    }
}

/// The points of one leaf and the points of another. Their distances are most of the time of a sum; with vectors of four
/// they take a quarter.
struct LeafPair<'a> {
    points: &'a [(Vec3, f64)],
    leaf: &'a LeafPoints,
}

impl NullaryFnOnce for LeafPair<'_> {
    type Output = f64;

    /// sum m_i m_j / |x_i - x_j|, kg^2/m, added in the order of [`point_attraction`].
    #[inline(always)]
    fn call(self) -> f64 {
        let LeafPoints { x, y, z, mass } = self.leaf;
        let mut sum = 0.0;
        for (at, m) in self.points {
            let mut terms = [0.0; LEAF_SIZE];
            for k in 0..LEAF_SIZE {
                let (dx, dy, dz) = (x[k] - at.x, y[k] - at.y, z[k] - at.z);
                let square = dx * dx + dy * dy + dz * dz;
                let term = mass[k] / square.sqrt();
                // Points at the same position do not attract each other.
                terms[k] = if square > 0.0 { term } else { 0.0 };
            }
            sum += m * terms.iter().sum::<f64>();
        }
        sum
    }
}

/// sum_j m m_j / |x_j - x| of a point; points at the same position do not attract it.
fn point_attraction(points: &[(Vec3, f64)], (x, m): &(Vec3, f64)) -> f64 {
    m * points.iter().filter(|(y, _)| y != x).map(|(y, m)| m / (y - x).norm()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::energy::direct_energy;

    /// Points in a ball from a low-discrepancy sequence, with unequal masses.
    fn ball(count: usize) -> Vec<(Vec3, f64)> {
        let halton = |mut k: usize, base: usize| {
            let (mut value, mut share) = (0.0, 1.0);
            while k > 0 {
                share /= base as f64;
                value += share * (k % base) as f64;
                k /= base;
            }
            2.0 * value - 1.0
        };
        let all = (1..).map(|k| (Vec3::new(halton(k, 2), halton(k, 3), halton(k, 5)), 1.0 + (k % 7) as f64));
        all.filter(|(x, _)| x.norm() < 1.0).take(count).collect()
    }

    #[test]
    fn energy_of_many_points_is_that_of_all_pairs() {
        for count in [0, 1, 2, 17, 3000] {
            let points = ball(count);
            let (tree, pairs) = (GravityTree::new(&points).potential_energy(2.0), direct_energy(&points, 2.0));
            assert!((tree - pairs).abs() <= 1e-4 * pairs.abs(), "{count}: {tree} {pairs}");
        }
    }

    #[test]
    fn leaves_attract_by_vectors_as_point_by_point() {
        let points = ball(40);
        for (count, others) in [(1, 1), (9, 16), (16, 9), (5, 13)] {
            let (points, other) = points[..count + others].split_at(count);
            // One of the others at the position of a point.
            let other: Vec<(Vec3, f64)> = [(points[0].0, 3.0)].into_iter().chain(other[1..].iter().copied()).collect();
            let mut leaf = LeafPoints::default();
            for (k, (x, mass)) in other.iter().enumerate() {
                (leaf.x[k], leaf.y[k], leaf.z[k], leaf.mass[k]) = (x.x, x.y, x.z, *mass);
            }
            let one_by_one: f64 = points.iter().map(|point| point_attraction(&other, point)).sum();
            assert_eq!(Arch::new().dispatch(LeafPair { points, leaf: &leaf }), one_by_one);
        }
    }

    #[test]
    fn energy_of_flat_and_long_clouds_is_that_of_all_pairs() {
        let points = ball(12_000);
        let of = |place: &dyn Fn(&Vec3) -> Vec3| points.iter().map(|(x, m)| (place(x), *m)).collect::<Vec<_>>();
        let clouds = [
            ("ball", points.clone()),
            ("disc", of(&|x| Vec3::new(x.x, x.y, 0.002 * x.z))),
            ("stream", of(&|x| Vec3::new(10.0 * x.x, x.y + 3.0 * (3.0 * x.x).sin(), 0.1 * x.z))),
            ("cigar", of(&|x| Vec3::new(100.0 * x.x, 0.3 * x.y, 0.3 * x.z))),
            ("line", (0..12_000).map(|k| (Vec3::new(f64::from(k), 0.0, 0.0), 1.0)).collect()),
        ];
        for (name, points) in clouds {
            let (tree, pairs) = (GravityTree::new(&points).potential_energy(2.0), direct_energy(&points, 2.0));
            assert!((tree / pairs - 1.0).abs() <= 1e-4, "{name}: {}", tree / pairs - 1.0);
        }
    }

    #[test]
    fn two_clumps_far_apart_attract_as_points() {
        let mut points = ball(100);
        let mass: f64 = points.iter().map(|(_, m)| m).sum();
        let alone = GravityTree::new(&points).potential_energy(1.0);
        points.extend(ball(100).into_iter().map(|(x, m)| (x + Vec3::new(1e3, 0.0, 0.0), m)));
        let mutual = GravityTree::new(&points).potential_energy(1.0) - 2.0 * alone;
        // Their quadrupoles give (1 / 1e3)^2; the tree is off by less than 1e-4 of the energy of the clumps, 1e3 times as much.
        assert!((mutual / (-mass * mass / 1e3) - 1.0).abs() < 0.1, "{mutual}");
    }
}
