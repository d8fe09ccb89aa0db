//! Potential of many attracting points, by a tree.
//!
//! Points that are far from where the potential is asked for act together, by the mass and the
//! quadrupole about their centre of mass (Barnes & Hut 1986; Hernquist 1987). What is asked for is an
//! energy, not a motion: a part in 10^4 is enough, and `--direct-gravity` sums every pair.

use rayon::prelude::*;

use crate::frame::{Mat3, Vec3};

/// A group acts together from distances of more than its radius over this. Of a ball of 3000 points the energy
/// was off by 1.03e-4 with 0.5, and the error falls with the cube of this.
const OPENING: f64 = 0.4;
/// Points that are not divided further.
const LEAF: usize = 16;

struct Node {
    /// First and one past the last of the sorted points.
    points: (usize, usize),
    /// Indices of the two halves; none of a leaf.
    halves: Option<[usize; 2]>,
    mass: f64,
    centre: Vec3,
    /// Largest distance of its points from the centre, m.
    radius: f64,
    /// sum m (3 d (x) d - d.d) over its points, d from the centre, kg m^2.
    quadrupole: Mat3,
}

/// Attracting points in a tree.
pub struct Tree {
    /// Position, m, and mass, kg, in the order of the tree.
    points: Vec<(Vec3, f64)>,
    /// Where each point stood before.
    order: Vec<usize>,
    nodes: Vec<Node>,
}

impl Tree {
    /// `points`: position in m and mass in kg of each.
    pub fn new(points: &[(Vec3, f64)]) -> Tree {
        let mut tree = Tree { points: points.to_vec(), order: (0..points.len()).collect(), nodes: Vec::new() };
        if !points.is_empty() {
            let mut order = std::mem::take(&mut tree.order);
            tree.divide(points, &mut order, 0);
            tree.points = order.iter().map(|&i| points[i]).collect();
            tree.order = order;
        }
        tree
    }

    /// Makes the node of `order`, which begins at `first`, and those below it; returns its index.
    fn divide(&mut self, points: &[(Vec3, f64)], order: &mut [usize], first: usize) -> usize {
        let own = || order.iter().map(|&i| points[i]);
        let mass: f64 = own().map(|(_, m)| m).sum();
        let centre = own().map(|(x, m)| m * x).sum::<Vec3>() / mass;
        let radius = own().map(|(x, _)| (x - centre).norm()).fold(0.0, f64::max);
        let quadrupole = own()
            .map(|(x, m)| {
                let d = x - centre;
                m * (3.0 * d * d.transpose() - Mat3::from_diagonal_element(d.norm_squared()))
            })
            .sum();
        let (low, high) = own().fold((centre, centre), |(low, high), (x, _)| (low.inf(&x), high.sup(&x)));
        let index = self.nodes.len();
        let points_of = (first, first + order.len());
        self.nodes.push(Node { points: points_of, halves: None, mass, centre, radius, quadrupole });
        if order.len() > LEAF {
            let axis = (high - low).imax();
            let middle = order.len() / 2;
            // Equal coordinates keep their order, whatever the sorting does.
            order.select_nth_unstable_by(middle, |&i, &j| {
                points[i].0[axis].total_cmp(&points[j].0[axis]).then(i.cmp(&j))
            });
            let (left, right) = order.split_at_mut(middle);
            let halves = [self.divide(points, left, first), self.divide(points, right, first + middle)];
            self.nodes[index].halves = Some(halves);
        }
        index
    }

    /// sum_j m_j / |x_j - x| over all points but one at x itself, kg/m.
    pub fn inverse_distances(&self, x: Vec3) -> f64 {
        let mut sum = 0.0;
        let mut waiting: Vec<usize> = (0..self.nodes.len().min(1)).collect();
        while let Some(index) = waiting.pop() {
            let node = &self.nodes[index];
            let to = x - node.centre;
            let distance = to.norm();
            if node.radius < OPENING * distance {
                sum += node.mass / distance + 0.5 * to.dot(&(node.quadrupole * to)) / distance.powi(5);
            } else if let Some(halves) = node.halves {
                waiting.extend(halves);
            } else {
                let own = &self.points[node.points.0..node.points.1];
                sum += own.iter().filter(|(y, _)| *y != x).map(|(y, m)| m / (y - x).norm()).sum::<f64>();
            }
        }
        sum
    }

    /// Potential energy, J: W = - sum_{i<j} G m_i m_j / |x_i - x_j|, the same on any number of threads.
    pub fn energy(&self, constant: f64) -> f64 {
        let of = |&(x, m): &(Vec3, f64)| m * self.inverse_distances(x);
        let terms: Vec<f64> = self.points.par_iter().map(of).collect();
        -0.5 * constant * terms.iter().sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::derive::energy::direct;

    /// Points in a ball by a sequence of low discrepancy, unequal masses.
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
            let (tree, pairs) = (Tree::new(&points).energy(2.0), direct(&points, 2.0));
            assert!((tree - pairs).abs() <= 1e-4 * pairs.abs(), "{count}: {tree} {pairs}");
        }
    }

    #[test]
    fn two_clumps_far_apart_attract_as_points() {
        let mut points = ball(100);
        let mass: f64 = points.iter().map(|(_, m)| m).sum();
        let alone = Tree::new(&points).energy(1.0);
        points.extend(ball(100).into_iter().map(|(x, m)| (x + Vec3::new(1e3, 0.0, 0.0), m)));
        let mutual = Tree::new(&points).energy(1.0) - 2.0 * alone;
        // Their quadrupoles give (1 / 1e3)^2; the tree is off by less than 1e-4 of the energy of the clumps, 1e3 times as much.
        assert!((mutual / (-mass * mass / 1e3) - 1.0).abs() < 0.1, "{mutual}");
    }
}
