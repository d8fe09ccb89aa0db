//! Loads by which the errors of a step's velocities strain its bonds in the next step.
//!
//! Bonds stop in the next step the velocities that an unfinished solution leaves them. The momentum of these velocities is a
//! load like any other, and far from small where it has a long arm: a cube that hangs from an area of a hundredth of its edge
//! loads its corners by 2 m g if they move by 1e-3 of what gravity gives in a step, and the last cube of a chain turns about
//! the first bond.
//!
//! The motion that bonds must stop is found pair by pair: bonds of two bodies move by ū at their centre and turn by φ,
//! the least squares of û_k = ū + φ × x_k with the positions x_k of the bonds from their centre. Along a tree of the strongest
//! bonds, from the walls or from any body of a free cluster, these motions add up to those of the bodies; those of a free
//! cluster are relative to its rigid motion. A pair of the tree carries momentum P and angular momentum L of all bodies
//! beyond it, as impulses
//!
//! ```text
//! f_k = P/n + (T⁻¹ L) × x_k,   T = Σ (x_k² 1 - x_k x_kᵀ)
//! ```
//!
//! on its n bonds, the least ones that do it. A bond that carries moments is a pair of its own: it stops the relative angular
//! velocity, and L is its moment. Bonds outside of the tree are weaker, and need not carry anything.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::assemble::ContactProblem;
use crate::math::{Mat3, Twist, Vec3, Wrench};
use crate::solve::ContactSolution;
use crate::state::ContactId;

/// Smallest pressure on a bond from which its limit of shear is computed, divided by its strength: where traction uses
/// up the strength, the limit would be 0.
const MIN_SHEAR_SHARE: f64 = 0.01;

/// Ratio of the determinant of T to the cube of its trace, below which bonds are in a line, to rounding: an area of
/// 1:1000 has 1e-7.
const MIN_SPREAD: f64 = 1e-12;

/// Bonds between two bodies.
struct BondedPair {
    /// Candidate and antagonist; all walls are one node, after the nodes of the bodies.
    nodes: [usize; 2],
    rows: Vec<usize>,
    /// Vectors from the centres of the two bodies to the centre of the bonds, m.
    arms: [Vec3; 2],
    /// T⁻¹, 1/m²; `None` if the bonds do not keep the bodies from turning.
    inverse_spread: Option<Mat3>,
    /// Index of the moments of its bond, if it is one that carries moments.
    moments: Option<usize>,
    /// Traction that it carries, N s.
    strength: f64,
}

impl BondedPair {
    /// Pair of the bonded `rows` of two bodies.
    fn new(contact_problem: &ContactProblem, rows: Vec<usize>) -> BondedPair {
        let ground = contact_problem.bodies.len();
        let node = |side: usize| {
            let body = contact_problem.rows[rows[0]].bodies[side].index();
            if contact_problem.bodies[body].inverse_mass > 0.0 { body } else { ground }
        };
        let nodes = [0, 1].map(node);
        let mean_arm =
            |side| rows.iter().map(|&k| contact_problem.contact_arm(k, side)).sum::<Vec3>() / rows.len() as f64;
        let strength = rows.iter().map(|&k| contact_problem.rows[k].impulse_shift.abs()).sum();
        let arms = [0, 1].map(mean_arm);
        let rolls = &contact_problem.rolling_constraints;
        let moments = rolls.binary_search_by_key(&ContactId::new(rows[0]), |roll| roll.row).ok();
        let moments = moments.filter(|&index| rolls[index].is_bond());
        let mut pair = BondedPair { nodes, rows, arms, inverse_spread: None, moments, strength };
        let bond_spread = |k: &usize| {
            let x = pair.position(contact_problem, *k);
            Mat3::identity() * x.norm_squared() - x * x.transpose()
        };
        let spread: Mat3 = pair.rows.iter().map(bond_spread).sum();
        if spread.determinant() > MIN_SPREAD * spread.trace().powi(3) {
            pair.inverse_spread = spread.try_inverse();
        }
        pair
    }

    /// Position of bond `k` from the centre of the bonds, m.
    fn position(&self, contact_problem: &ContactProblem, k: usize) -> Vec3 {
        // A wall may have no arms.
        let side = usize::from(self.nodes[0] == contact_problem.bodies.len());
        contact_problem.contact_arm(k, side) - self.arms[side]
    }

    /// Velocity of the candidate relative to the antagonist at the centre of the bonds.
    fn motion(&self, contact_problem: &ContactProblem, solution: &ContactSolution) -> Twist {
        let (mut v, mut turning_sum) = (Vec3::zeros(), Vec3::zeros());
        for &k in &self.rows {
            let u = contact_problem.shifted_velocity(k, &solution.solver_bodies);
            v += u / self.rows.len() as f64;
            turning_sum += self.position(contact_problem, k).cross(&u);
        }
        if let Some(index) = self.moments {
            let [a, b] = contact_problem.rows[self.rows[0]].bodies.map(|body| solution.solver_bodies[body.index()].w);
            return Twist { v, w: a - b + contact_problem.rolling_constraints[index].shift };
        }
        Twist { v, w: self.inverse_spread.map_or(Vec3::zeros(), |inverse| inverse * turning_sum) }
    }

    /// Largest impulse with which a bond carries the impulse `load` about the centre of the bonds, divided by its
    /// limit.
    fn load_share(&self, contact_problem: &ContactProblem, solution: &ContactSolution, load: Wrench) -> f64 {
        let count = self.rows.len() as f64;
        let turn = self.inverse_spread.map_or(Vec3::zeros(), |inverse| inverse * load.torque);
        // A face shares the traction among its corners in many ways.
        let pressure = |k: &usize| contact_problem.rows[*k].normal.dot(&solution.impulses[*k]);
        let pressure = self.rows.iter().map(pressure).sum::<f64>() / count;
        let share = |&k: &usize| {
            let row = &contact_problem.rows[k];
            let impulse = load.force / count + turn.cross(&self.position(contact_problem, k));
            let normal_impulse = row.normal.dot(&impulse);
            let strength = row.impulse_shift.abs();
            let shear = row.friction * pressure.max(MIN_SHEAR_SHARE * strength);
            (normal_impulse.abs() / strength).max((impulse - row.normal * normal_impulse).norm() / shear)
        };
        let moment_share = self.moments.map_or(0.0, |index| {
            let (row, roll) = (&contact_problem.rows[self.rows[0]], &contact_problem.rolling_constraints[index]);
            let moment = load.torque / roll.radius;
            let along = row.normal.dot(&moment);
            let pressure = pressure.max(MIN_SHEAR_SHARE * row.impulse_shift.abs());
            let bending = (moment - row.normal * along).norm() / roll.rolling;
            bending.max(along.abs() / roll.spinning) / pressure
        });
        self.rows.iter().map(share).fold(moment_share, f64::max)
    }
}

/// Pairs of bodies with bonds in the `bonded_rows`, the strongest first, without those with a bond in the `broken_rows` (sorted).
fn bonded_pairs(contact_problem: &ContactProblem, bonded_rows: &[usize], broken_rows: &[usize]) -> Vec<BondedPair> {
    let unbroken_pair = |rows: &[usize]| {
        let is_unbroken = rows.iter().all(|k| broken_rows.binary_search(k).is_err());
        is_unbroken.then(|| BondedPair::new(contact_problem, rows.to_vec()))
    };
    let same_bodies = |a: &usize, b: &usize| contact_problem.rows[*a].bodies == contact_problem.rows[*b].bodies;
    let mut pairs: Vec<BondedPair> = bonded_rows.chunk_by(same_bodies).filter_map(unbroken_pair).collect();
    pairs.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    pairs
}

/// Branch that carries another one in a tree of bonds, by the bonds of a pair.
#[derive(Clone, Copy)]
struct Carrier {
    /// Index in the tree.
    branch: usize,
    /// Index in the list of pairs.
    pair: usize,
}

/// Body of a tree of bonds.
struct Branch {
    body: usize,
    /// Branch that carries it; `None` for the root.
    carrier: Option<Carrier>,
    /// Position from the root, m.
    position: Vec3,
    /// Motion that the bonds must stop.
    motion: Twist,
}

/// Largest impulse by which the velocity errors load one of the `bonded_rows` in the next step, divided by its
/// strength. The `broken_rows` carry nothing; both are sorted.
pub fn largest_error_load(
    contact_problem: &ContactProblem,
    solution: &ContactSolution,
    bonded_rows: &[usize],
    broken_rows: &[usize],
) -> f64 {
    let pairs = bonded_pairs(contact_problem, bonded_rows, broken_rows);
    if pairs.is_empty() {
        return 0.0;
    }
    let ground = contact_problem.bodies.len();
    let mut pairs_of = vec![Vec::new(); ground + 1];
    for (p, pair) in pairs.iter().enumerate() {
        pair.nodes.iter().for_each(|&node| pairs_of[node].push(p));
    }
    let mut largest = 0.0f64;
    let mut is_reached = vec![false; ground + 1];
    // Walls come first: bodies that are not reached from them are free.
    for root in std::iter::once(ground).chain(0..ground) {
        if is_reached[root] || pairs_of[root].is_empty() {
            continue;
        }
        is_reached[root] = true;
        let origin = Branch { body: root, carrier: None, position: Vec3::zeros(), motion: Twist::default() };
        let mut tree = vec![origin];
        let from_root = pairs_of[root].iter().map(|&p| Reverse((p, 0)));
        // Pairs by which the tree may grow, the strongest first, each with the index of the branch from which it does.
        let mut next: BinaryHeap<Reverse<(usize, usize)>> = from_root.collect();
        while let Some(Reverse((p, k))) = next.pop() {
            let (pair, carrier) = (&pairs[p], &tree[k]);
            let side = usize::from(pair.nodes[0] == carrier.body);
            let body = pair.nodes[side];
            if std::mem::replace(&mut is_reached[body], true) {
                continue;
            }
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let relative = pair.motion(contact_problem, solution);
            let w = carrier.motion.w + relative.w * sign;
            let carrier_arm = if carrier.body == ground { Vec3::zeros() } else { pair.arms[1 - side] };
            let arm = pair.arms[side];
            let velocity_at_bonds = carrier.motion.velocity_at(&carrier_arm) + relative.v * sign;
            let motion = Twist { v: velocity_at_bonds - w.cross(&arm), w };
            let position = carrier.position + carrier_arm - arm;
            next.extend(pairs_of[body].iter().map(|&p| Reverse((p, tree.len()))));
            tree.push(Branch { body, carrier: Some(Carrier { branch: k, pair: p }), position, motion });
        }
        if root != ground {
            subtract_rigid_motion(contact_problem, &mut tree);
        }
        largest = largest.max(tree_load(contact_problem, solution, &pairs, &tree, root == ground));
    }
    largest
}

/// Makes the motions of a free cluster relative to the motion of a rigid body that has their momentum and angular momentum.
fn subtract_rigid_motion(contact_problem: &ContactProblem, tree: &mut [Branch]) {
    let mass = |branch: &Branch| 1.0 / contact_problem.bodies[branch.body].inverse_mass;
    let total_mass: f64 = tree.iter().map(mass).sum();
    let centre = tree.iter().map(|branch| branch.position * mass(branch)).sum::<Vec3>() / total_mass;
    let mean_velocity = tree.iter().map(|branch| branch.motion.v * mass(branch)).sum::<Vec3>() / total_mass;
    let (mut inertia, mut angular_momentum) = (Mat3::zeros(), Vec3::zeros());
    for branch in tree.iter() {
        let (x, own_inertia) = (branch.position - centre, inertia_of(contact_problem, branch.body));
        inertia += own_inertia + (Mat3::identity() * x.norm_squared() - x * x.transpose()) * mass(branch);
        angular_momentum += own_inertia * branch.motion.w + x.cross(&branch.motion.v) * mass(branch);
    }
    let mean_spin = inertia.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * angular_momentum);
    for branch in tree {
        branch.motion.v -= mean_velocity + mean_spin.cross(&(branch.position - centre));
        branch.motion.w -= mean_spin;
    }
}

/// Largest load share of the pairs of a tree. `on_walls`: whether the first node stands for the walls.
fn tree_load(
    contact_problem: &ContactProblem,
    solution: &ContactSolution,
    pairs: &[BondedPair],
    tree: &[Branch],
    on_walls: bool,
) -> f64 {
    // Impulse that stops each body and those that it carries, about the root.
    let mut carried = vec![Wrench::default(); tree.len()];
    let mut largest = 0.0f64;
    for k in (usize::from(on_walls)..tree.len()).rev() {
        let Branch { body, carrier, position, motion } = &tree[k];
        let momentum = motion.v / contact_problem.bodies[*body].inverse_mass;
        carried[k].force += momentum;
        carried[k].torque += position.cross(&momentum) + inertia_of(contact_problem, *body) * motion.w;
        let Some(Carrier { branch: carrier_branch, pair }) = *carrier else { continue };
        let (pair, load) = (&pairs[pair], carried[k]);
        let centre = position + pair.arms[usize::from(pair.nodes[1] == *body)];
        largest = largest.max(pair.load_share(contact_problem, solution, load.moved_by(&centre)));
        carried[carrier_branch].force += load.force;
        carried[carrier_branch].torque += load.torque;
    }
    largest
}

/// Inertia about the centre of mass, world frame, kg m²; 0 if some rotation is imposed.
fn inertia_of(contact_problem: &ContactProblem, body: usize) -> Mat3 {
    let inverse = match &contact_problem.block_data {
        Some(block_data) => block_data.inverse_inertia[body],
        None => Mat3::identity() * contact_problem.bodies[body].inverse_inertia,
    };
    inverse.try_inverse().unwrap_or_default()
}
