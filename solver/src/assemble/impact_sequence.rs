//! Impacts of touching spheres one after the other, as waves pass them on, instead of Newton's law at one instant.
//!
//! In each round the contacts of a cluster that close get the impulses that stop them, times 1 + e, all together; the
//! velocities that follow may close others. These are the generalized reflections of B. Smith, D.M. Kaufman, E. Vouga, R.
//! Tamstorf, E. Grinspun, Reflections on simultaneous impact, ACM Trans. Graph. 31 (2012) 106, with restitution in each
//! round: they conserve momentum, do not depend on the order of the contacts, and with e = 1 conserve energy. Along a chain
//! of n equal balls the last one leaves with ((1 + e)/2)^(n - 1) of the speed.
//!
//! The velocities at the end are the ones at which the contacts must part; the contact problem finds the impulses together
//! with friction and forces.

use std::cell::Cell;

use cd_formats::compute::ImpactOrder;
use cd_formats::groups::DisjointSets;

use super::context::AssemblyContext;
use super::kinematics::{contact_arms, velocity_at_arms};
use crate::laws::{ContactLaw, GapForecast};
use crate::math::Vec3;
use crate::state::Contact;

/// Approach velocity, divided by the largest one of the cluster at the start, up to which contacts do not close: the energy
/// that it leaves is far below that of the tolerance of the contact problem.
const MIN_APPROACH: f64 = 1e-8;
/// Largest number of rounds of a cluster. A chain of n balls needs n rounds with e = 1, and with e = 0, as velocities spread
/// like heat, some 4 n².
const MAX_ROUNDS: usize = 10_000;
/// Largest number of sweeps in which the impulses of one round are found: only contacts that close at the same time and
/// share a body need more than one.
const MAX_ROUND_SWEEPS: usize = 1000;
/// Change of the impulses in a sweep, divided by the largest one, up to which they are found: their rounding.
const MAX_ROUND_CHANGE: f64 = 1e-15;

thread_local! {
    /// Number of contacts of the largest cluster whose impacts have not ended, since [`take_unended_impacts`].
    static UNENDED_IMPACTS: Cell<usize> = const { Cell::new(0) };
}

/// Number of contacts of the largest cluster whose impacts have not ended in the contact problems of this thread since the
/// last call; 0 if all have.
pub fn take_unended_impacts() -> usize {
    UNENDED_IMPACTS.take()
}

/// Contact that may take part in impacts.
struct ImpactContact<'a> {
    /// Index in the list of contacts.
    index: usize,
    bodies: [usize; 2],
    inverse_masses: [f64; 2],
    normal: Vec3,
    /// Normal velocity at the step's start, m/s, negative when closing.
    u_n: f64,
    /// Whether it closes faster than by the forces of a step and the errors of the last solution.
    strikes: bool,
    law: &'a ContactLaw,
}

impl AssemblyContext<'_> {
    /// Normal velocities with which contacts part after impacts one after the other, m/s; `None` for contacts without
    /// an impact, alone in their cluster, or in a cluster whose impacts do not end: Newton's law applies to these.
    /// Empty if the option `impacts` does not request it, or nothing closes.
    pub(super) fn rebound_velocities(&self, contacts: &[Contact]) -> Vec<Option<f64>> {
        if self.scene.options.impacts != ImpactOrder::InOrder {
            return Vec::new();
        }
        let impacts = contacts.iter().enumerate().filter_map(|(index, contact)| self.impact_contact(index, contact));
        let impacts: Vec<ImpactContact> = impacts.collect();
        if !impacts.iter().any(|impact| impact.strikes) {
            return Vec::new();
        }
        let mut rebounds = vec![None; contacts.len()];
        for cluster in impact_clusters(&impacts, self.scene.bodies.len()) {
            match rebounds_of_cluster(&cluster) {
                Some(velocities) => {
                    cluster.iter().zip(velocities).for_each(|(impact, rebound)| rebounds[impact.index] = rebound);
                }
                None => UNENDED_IMPACTS.set(UNENDED_IMPACTS.get().max(cluster.len())),
            }
        }
        rebounds
    }

    /// Impact at a contact; `None` unless its law has restitution, and its gap is closed, or closes within the step at
    /// the velocities of its start.
    fn impact_contact(&self, index: usize, contact: &Contact) -> Option<ImpactContact<'_>> {
        let law = &self.state.laws[contact.law];
        law.restitution_at(0.0)?;
        let arms = contact_arms(contact, &self.q_c.x);
        let u_n = contact.normal.dot(&velocity_at_arms(contact, &arms, self.start));
        let closing_time = self.closing_time();
        let is_closed = || law.is_closed_gap(contact.gap, self.contact_radius(contact));
        let is_due = || {
            contact.gap < -closing_time * u_n && self.gap_forecast(contact, law, closing_time, 0.0) == GapForecast::Due
        };
        let bodies = [contact.candidate, contact.antagonist].map(|body| body.index());
        let inverse_masses = bodies.map(|body| self.solver_bodies[body].inverse_mass);
        (is_closed() || is_due()).then(|| {
            let AssemblyContext { scene, state, free, .. } = self;
            let least_approach = |body: usize| {
                let force_velocity = contact.normal.dot(&(free.v[body] - state.v[body])).abs();
                force_velocity.max(scene.options.tol() * state.v[body].norm())
            };
            let strikes = -u_n > bodies.map(least_approach).into_iter().fold(0.0, f64::max);
            ImpactContact { index, bodies, inverse_masses, normal: contact.normal, u_n, strikes, law }
        })
    }
}

/// Clusters of two or more contacts that are connected by bodies which impulses can move, one of whose contacts strikes.
fn impact_clusters<'a, 'b>(impacts: &'a [ImpactContact<'b>], body_count: usize) -> Vec<Vec<&'a ImpactContact<'b>>> {
    let mut sets = DisjointSets::new(body_count);
    for ImpactContact { bodies, inverse_masses, .. } in impacts {
        if inverse_masses.iter().all(|inverse_mass| *inverse_mass > 0.0) {
            sets.union(bodies[0], bodies[1]);
        }
    }
    let mut number_of_root = vec![usize::MAX; body_count];
    let mut clusters: Vec<Vec<&ImpactContact>> = Vec::new();
    for impact in impacts {
        let free_side = usize::from(impact.inverse_masses[0] == 0.0);
        let root = sets.find(impact.bodies[free_side]);
        if number_of_root[root] == usize::MAX {
            number_of_root[root] = clusters.len();
            clusters.push(Vec::new());
        }
        clusters[number_of_root[root]].push(impact);
    }
    clusters.retain(|cluster| cluster.len() > 1 && cluster.iter().any(|impact| impact.strikes));
    clusters
}

/// Normal velocities of the contacts of a cluster after the impacts, m/s; `None` for a contact without an impulse. Returns
/// `None` if the impacts do not end.
fn rebounds_of_cluster(cluster: &[&ImpactContact]) -> Option<Vec<Option<f64>>> {
    let mut bodies: Vec<usize> = cluster.iter().flat_map(|impact| impact.bodies).collect();
    bodies.sort_unstable();
    bodies.dedup();
    let local_bodies: Vec<[usize; 2]> =
        cluster.iter().map(|impact| impact.bodies.map(|body| bodies.partition_point(|other| *other < body))).collect();
    let largest = cluster.iter().map(|impact| -impact.u_n).fold(0.0, f64::max);
    let tolerance = MIN_APPROACH * largest;
    let mut changes = vec![Vec3::zeros(); bodies.len()];
    let mut impulses = vec![0.0; cluster.len()];
    let velocity = |k: usize, changes: &[Vec3]| {
        let [a, b] = local_bodies[k];
        cluster[k].u_n + cluster[k].normal.dot(&(changes[a] - changes[b]))
    };
    for _ in 0..MAX_ROUNDS {
        let closing_contacts: Vec<usize> = (0..cluster.len()).filter(|&k| velocity(k, &changes) < -tolerance).collect();
        if closing_contacts.is_empty() {
            // Approaches below the tolerance add up along a cluster at a wall, and all of it must part.
            let has_wall = cluster.iter().any(|impact| impact.inverse_masses.contains(&0.0));
            let least = if has_wall { tolerance * cluster.len() as f64 } else { 0.0 };
            let rebound = |k: usize| (impulses[k] > 0.0).then(|| (velocity(k, &changes) - least).max(0.0));
            return Some((0..cluster.len()).map(rebound).collect());
        }
        let restitution = shared_restitution(cluster, &local_bodies, &closing_contacts, |k| velocity(k, &changes));
        let mut stopped = changes.clone();
        let stops = stopping_impulses(cluster, &local_bodies, &closing_contacts, &mut stopped, &velocity);
        for ((&k, stop), e) in closing_contacts.iter().zip(stops).zip(restitution) {
            let impulse = (1.0 + e) * stop;
            add_impulse(cluster[k], local_bodies[k], impulse, &mut changes);
            impulses[k] += impulse;
        }
    }
    None
}

/// Coefficients of restitution of contacts that close together: those that share a body which impulses can move have the
/// smallest of theirs, so that they give no energy.
fn shared_restitution(
    cluster: &[&ImpactContact],
    local_bodies: &[[usize; 2]],
    closing_contacts: &[usize],
    velocity: impl Fn(usize) -> f64,
) -> Vec<f64> {
    let coefficient = |&k: &usize| cluster[k].law.restitution_at(velocity(k)).unwrap_or(0.0);
    let mut restitution: Vec<f64> = closing_contacts.iter().map(coefficient).collect();
    loop {
        let mut has_changed = false;
        for (i, &k) in closing_contacts.iter().enumerate() {
            for (j, &other) in closing_contacts.iter().enumerate() {
                let shares_body = local_bodies[k]
                    .iter()
                    .zip(cluster[k].inverse_masses)
                    .any(|(body, inverse_mass)| inverse_mass > 0.0 && local_bodies[other].contains(body));
                if shares_body && restitution[j] < restitution[i] {
                    (restitution[i], has_changed) = (restitution[j], true);
                }
            }
        }
        if !has_changed {
            return restitution;
        }
    }
}

/// Impulses λ >= 0 that stop the closing contacts, u + W λ >= 0, with one of the two 0 for each, N s, by Gauss-Seidel sweeps
/// on the changes of the velocities of the bodies.
fn stopping_impulses(
    cluster: &[&ImpactContact],
    local_bodies: &[[usize; 2]],
    closing_contacts: &[usize],
    changes: &mut [Vec3],
    velocity: &impl Fn(usize, &[Vec3]) -> f64,
) -> Vec<f64> {
    let mut impulses = vec![0.0; closing_contacts.len()];
    for _ in 0..MAX_ROUND_SWEEPS {
        let mut largest_change: f64 = 0.0;
        for (impulse, &k) in impulses.iter_mut().zip(closing_contacts) {
            let [a, b] = cluster[k].inverse_masses;
            let next = (*impulse - velocity(k, changes) / (a + b)).max(0.0);
            let change = next - *impulse;
            add_impulse(cluster[k], local_bodies[k], change, changes);
            *impulse = next;
            largest_change = largest_change.max(change.abs());
        }
        let largest = impulses.iter().fold(0.0, |largest: f64, impulse| largest.max(*impulse));
        if largest_change <= MAX_ROUND_CHANGE * largest {
            break;
        }
    }
    impulses
}

/// Adds the change of velocity by a normal impulse, N s, to those of the two bodies.
fn add_impulse(impact: &ImpactContact, [a, b]: [usize; 2], impulse: f64, changes: &mut [Vec3]) {
    changes[a] += impact.normal * (impulse * impact.inverse_masses[0]);
    changes[b] -= impact.normal * (impulse * impact.inverse_masses[1]);
}
