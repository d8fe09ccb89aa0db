//! The contact problem of one step: one row a contact, one record a body.
//!
//! No Delassus matrix is stored: the sweeps keep the velocities V = V_free + M⁻¹ H r of the bodies,
//! and a row reads and changes those of its two. A law's shift c is put into the records once, so
//! that the solver works on r̂ = r - c n alone (see [`crate::laws`]).

use std::ops::Range;

use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::integrate::Configuration;
use crate::laws::{Approach, Law, Rolling, Shift, TOUCHING};
use crate::math::{Quat, Vec3, rotate, to_local, to_world};
use crate::scene::{Body, Scene, Shape};
use crate::state::{Bonding, Contact, SolvedContact, State, Status, UNKNOWN};

/// What a sweep reads and writes of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    /// m/s
    pub v: Vec3,
    /// 1/kg, 0 for a body whose motion is imposed.
    pub inverse_mass: f64,
    /// rad/s
    pub w: Vec3,
    /// 1/(kg m^2)
    pub inverse_inertia: f64,
    /// m; 0 for a plate, whose turning is in the shift of its rows.
    pub radius: f64,
}

/// One contact of spheres or of a sphere and a plate, as the sweeps see it. Their W is diagonal:
/// w_n along n, w_t in the tangent plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Row {
    /// Records of candidate and antagonist.
    pub bodies: [u32; 2],
    pub normal: Vec3,
    /// Distance from each centre to the contact point, over the radius of its sphere.
    pub arm: f64,
    /// û = u + shift, world frame, m/s: the law's shifts and the motion of a plate.
    pub shift: Vec3,
    /// W_nn and W_tt = W_ss, 1/kg.
    pub w_n: f64,
    pub w_t: f64,
    pub friction: f64,
    /// c = r_n - r̂_n, N s.
    pub impulse_shift: f64,
    /// Whether the law acts in this step.
    pub acts: bool,
    /// Whether it acts, and the two bodies' free velocities can close the gap within the step, or the row pulls.
    pub can_close: bool,
    /// r̂ to start from, world frame, N s: that of the last step, else what the attraction alone makes.
    pub start: Vec3,
    /// u at the step's start along n, t, s, m/s.
    pub u_before: Vec3,
    /// Gap at which the contact is bonded, m.
    pub bond: Option<f64>,
}

/// Resistance of a row's contact to rolling and spinning, see [`crate::laws::Rolling`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roll {
    /// Index into the rows.
    pub row: u32,
    /// 1/(1/R_a + 1/R_b), m.
    pub radius: f64,
    pub rolling: f64,
    pub spinning: f64,
    /// 1/(1/I_a + 1/I_b), kg m^2.
    pub inverse_w: f64,
    /// Relative angular velocity that a plate adds, rad/s.
    pub shift: Vec3,
    /// Moment to start from, world frame, N m s.
    pub start: Vec3,
}

#[derive(Debug, Clone)]
pub struct System {
    pub rows: Vec<Row>,
    /// What the rows and records do not hold where bodies are not all spheres and plates.
    pub full: Option<Full>,
    /// In the order of the rows; empty in most scenes.
    pub rolls: Vec<Roll>,
    /// All bodies in the order of space, neighbours near each other.
    pub order: Vec<u32>,
    /// Velocities if every r̂ were 0.
    pub records: Vec<Record>,
}

/// Rows whose W is a full block: lever arms of any direction, inertia that is not isotropic. `arm` of the rows and
/// `inverse_inertia` and `radius` of the records are not used then; `w_n` is W_nn and `w_t` the mean of W_tt and W_ss.
#[derive(Debug, Clone)]
pub struct Full {
    /// By row: from the centres of candidate and antagonist to the contact point, m.
    pub arms: Vec<[Vec3; 2]>,
    /// By body: inverse inertia about the centre of mass in the contact configuration, world frame, 1/(kg m²); 0 for a
    /// body whose motion is imposed.
    pub inverse_inertia: Vec<Matrix3<f64>>,
}

impl Full {
    /// W of row `k`, world frame, 1/kg.
    pub fn block(&self, k: usize, row: &Row, records: &[Record]) -> Matrix3<f64> {
        let side = |side: usize| {
            let (body, arm) = (row.bodies[side] as usize, self.arms[k][side].cross_matrix());
            Matrix3::identity() * records[body].inverse_mass + arm.transpose() * self.inverse_inertia[body] * arm
        };
        side(0) + side(1)
    }
}

/// Velocity of the candidate against the antagonist at the contact point, world frame, m/s.
pub fn relative_velocity(contact: &Contact, x: &[Vec3], v: &[Vec3], w: &[Vec3]) -> Vec3 {
    let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
    let [at_a, at_b] = arms(contact, x);
    v[a] + w[a].cross(&at_a) - (v[b] + w[b].cross(&at_b))
}

/// From the centres of the candidate and of the antagonist's image to the contact point, m.
pub fn arms(contact: &Contact, x: &[Vec3]) -> [Vec3; 2] {
    [contact.point - x[contact.candidate as usize], contact.point - (x[contact.antagonist as usize] + contact.image)]
}

/// The rows of all contacts, in their order.
pub fn contact_problem(
    scene: &Scene,
    state: &State,
    q_c: &Configuration,
    contacts: &[Contact],
    v_free: &[Vec3],
    w_free: &[Vec3],
) -> System {
    let mut full = full(scene, q_c);
    let records: Vec<Record> = scene
        .bodies
        .iter()
        .zip(v_free.iter().zip(w_free))
        .map(|(body, (v, w))| match body.shape {
            Shape::Sphere { radius } => Record {
                v: *v,
                inverse_mass: body.inverse_mass(),
                w: *w,
                inverse_inertia: body.inverse_inertia(),
                radius,
            },
            // A plate's motion at the contact point is in the row's shift.
            _ if full.is_some() => {
                Record { v: *v, inverse_mass: body.inverse_mass(), w: *w, inverse_inertia: 0.0, radius: 0.0 }
            }
            Shape::Plane { .. } | Shape::Parts => {
                Record { v: Vec3::zeros(), inverse_mass: 0.0, w: Vec3::zeros(), inverse_inertia: 0.0, radius: 0.0 }
            }
        })
        .collect();

    let mut history = history(&state.contacts, contacts);
    let setting = Setting { scene, state, q_c, v_free, w_free, records: &records, full: full.is_some() };
    setting.renamed(contacts, &mut history);
    let of_contact =
        |(contact, old): (&Contact, &Option<u32>)| setting.row(contact, old.map(|k| &state.contacts[k as usize]));
    let mut rows: Vec<Row> = contacts.par_iter().zip(&history).with_min_len(256).map(of_contact).collect();
    let rolls = if state.laws.iter().any(|law| law.rolling.is_some()) {
        let listed = (0..).zip(contacts).zip(&history).filter(|((k, _), _): &((usize, _), _)| rows[*k].acts);
        listed
            .filter_map(|((k, contact), old)| setting.roll(k, contact, old.map(|k| &state.contacts[k as usize])))
            .collect()
    } else {
        Vec::new()
    };
    if let Some(full) = &mut full {
        full.arms = contacts.iter().map(|contact| arms(contact, &q_c.x)).collect();
    }
    if let Some(full) = &full {
        for (k, row) in rows.iter_mut().enumerate() {
            let w = full.block(k, row, &records);
            row.w_n = row.normal.dot(&(w * row.normal));
            row.w_t = 0.5 * (w.trace() - row.w_n);
        }
    }
    let mut system = System { rows, rolls, full, records, order: q_c.order.clone() };
    for (k, old) in history.iter().enumerate() {
        let Row { impulse_shift, normal, .. } = system.rows[k];
        if impulse_shift != 0.0 {
            system.apply(k, &(normal * impulse_shift));
            if old.is_none() {
                system.rows[k].start = normal * system.rows[k].balance();
            }
        }
    }
    system
}

/// Contacts that one task looks at.
const CHUNK: usize = 1024;

/// For each contact the index of the one with its key in the list of the last step; both lists are in the order of their
/// keys.
fn history(before: &[SolvedContact], contacts: &[Contact]) -> Vec<Option<u32>> {
    let of_some = |contacts: &[Contact]| {
        let first = contacts[0].key();
        let mut k = before.partition_point(|old| old.contact.key() < first);
        contacts
            .iter()
            .map(move |contact| {
                let key = contact.key();
                while before.get(k).is_some_and(|old| old.contact.key() < key) {
                    k += 1;
                }
                before.get(k).filter(|old| old.contact.key() == key).map(|_| k as u32)
            })
            .collect::<Vec<_>>()
    };
    contacts.par_chunks(CHUNK).map(of_some).collect::<Vec<_>>().concat()
}

/// Two contactors by their bodies and ranks.
type Contactors = (u32, u32, (u16, u16));

fn contactors(contact: &Contact) -> Contactors {
    (contact.candidate, contact.antagonist, contact.ranks)
}

/// Where the contacts of two contactors are in a list in the order of the keys.
fn of_pair<T>(list: &[T], pair: Contactors, contact: impl Fn(&T) -> &Contact) -> Range<usize> {
    let from = list.partition_point(|item| contactors(contact(item)) < pair);
    from..from + list[from..].iter().take_while(|item| contactors(contact(item)) == pair).count()
}

/// What the rows are made from.
struct Setting<'a> {
    scene: &'a Scene,
    state: &'a State,
    q_c: &'a Configuration,
    v_free: &'a [Vec3],
    w_free: &'a [Vec3],
    records: &'a [Record],
    full: bool,
}

impl Setting<'_> {
    /// Gives contacts whose key is new those of the same contactors whose key is gone, the nearest first and each once:
    /// where corners coincide, rounding decides what meets there, and of more than four others may be chosen. Of a bonded
    /// face that is no larger than before, those that are left share the history of the nearest.
    ///
    /// Only what can act, now or before, counts: what else is listed depends on the alert distance.
    fn renamed(&self, contacts: &[Contact], found: &mut [Option<u32>]) {
        let before = &self.state.contacts;
        let carried = |k: usize| before[k].bond.is_some() || before[k].impulse != Vec3::zeros();
        let acted = |k: usize| {
            let old = &before[k].contact;
            carried(k) || old.gap <= self.state.laws[old.law as usize].range(self.radius(old))
        };
        // Two spheres have one contact, always of the same key. Of others nearly always nothing is gone, and only bonds are shared.
        let has_names = |contact: &Contact| !self.scene.bodies[contact.antagonist as usize].is_sphere();
        let mut is_gone: Vec<bool> =
            before.iter().zip(0..).map(|(old, k)| has_names(&old.contact) && carried(k)).collect();
        let stays =
            |(k, contact): (usize, &Contact)| found[k].filter(|&old| is_gone[old as usize] && self.in_reach(contact));
        let stay: Vec<u32> = contacts.par_iter().enumerate().with_min_len(256).filter_map(stays).collect();
        stay.into_iter().for_each(|old| is_gone[old as usize] = false);
        let is_concerned = |k: &usize| is_gone[*k] || before[*k].bond.is_some() && has_names(&before[*k].contact);
        let concerned: Vec<Contactors> =
            (0..before.len()).filter(is_concerned).map(|k| contactors(&before[k].contact)).collect();
        let is_new = |&k: &usize| {
            has_names(&contacts[k])
                && concerned.binary_search(&contactors(&contacts[k])).is_ok()
                && !found[k].is_some_and(|old| acted(old as usize))
                && self.in_reach(&contacts[k])
        };
        let new: Vec<usize> = (0..contacts.len()).into_par_iter().with_min_len(256).filter(is_new).collect();
        for new in new.chunk_by(|&i, &k| contactors(&contacts[i]) == contactors(&contacts[k])) {
            let pair = contactors(&contacts[new[0]]);
            let now = &contacts[of_pair(contacts, pair, |contact| contact)];
            let old = of_pair(before, pair, |old| &old.contact);
            let mut gone: Vec<usize> = old.clone().filter(|&k| is_gone[k]).collect();
            let mut left = new.to_vec();
            let ways = |old: usize| new.iter().map(move |&k| (self.moved(&before[old].contact, &contacts[k]), old, k));
            let mut ways: Vec<(f64, usize, usize)> = old.clone().filter(|&k| carried(k)).flat_map(ways).collect();
            ways.sort_by(|a, b| a.0.total_cmp(&b.0));
            for &(_, old, k) in &ways {
                if left.contains(&k) && gone.contains(&old) {
                    found[k] = Some(old as u32);
                    gone.retain(|other| *other != old);
                    left.retain(|other| *other != k);
                }
            }
            let area = before[old].iter().map(|old| old.contact.area).sum::<f64>();
            let is_same = area > 0.0 && now.iter().map(|contact| contact.area).sum::<f64>() <= area * (1.0 + TOUCHING);
            for (_, old, k) in ways.into_iter().filter(|way| is_same && before[way.1].bond.is_some()) {
                if left.contains(&k) {
                    found[k] = Some(old as u32);
                    left.retain(|other| *other != k);
                }
            }
        }
    }

    /// Whether a contact can close within the step or is within the range of its law.
    fn in_reach(&self, contact: &Contact) -> bool {
        let range = self.state.laws[contact.law as usize].range(self.radius(contact));
        contact.gap <= self.travel(contact).max(range)
    }

    /// How far the two bodies may come nearer in the step at the contact, m, past what all have in common.
    fn travel(&self, contact: &Contact) -> f64 {
        let Setting { q_c, v_free, w_free, .. } = *self;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
        let past = |v: Vec3| (v - q_c.drift).norm();
        let plate = if self.on_plate(contact) { past(self.plate(contact)) } else { 0.0 };
        let mut travel = q_c.h * (past(v_free[a]) + plate.max(past(v_free[b])));
        if self.full {
            let sides = [a, b].into_iter().zip(arms(contact, &q_c.x));
            travel += q_c.h * sides.map(|(i, arm)| w_free[i].norm() * arm.norm()).sum::<f64>();
        }
        travel
    }

    /// Velocity of a plate at the contact point, m/s.
    fn plate(&self, contact: &Contact) -> Vec3 {
        let b = contact.antagonist as usize;
        self.v_free[b] + self.w_free[b].cross(&arms(contact, &self.q_c.x)[1])
    }

    /// From where the candidate has carried a contact of the last step to this one of the same contactors, m.
    fn moved(&self, old: &Contact, contact: &Contact) -> f64 {
        let (state, a) = (self.state, contact.candidate as usize);
        let centre = state.x[a] - state.v[a] * (self.scene.options.theta * state.h); // of the last contact configuration
        let turn = rotate(&Quat::identity(), &(state.w[a] * self.since()));
        (contact.point - self.q_c.x[a] - turn * (old.point - centre)).norm()
    }

    /// Time from the last contact configuration to this, s.
    fn since(&self) -> f64 {
        let theta = self.scene.options.theta;
        theta * self.state.h + (1.0 - theta) * self.q_c.h
    }

    /// Gap of the bond that a contact of the last step hands on, m: its own to what is in its place; elsewhere the gap there,
    /// if that touches and if the old one would still be in reach.
    fn bond(&self, old: &SolvedContact, contact: &Contact, law: &Law, radius: f64) -> Option<f64> {
        let bond = old.bond?;
        let known = old.contact.key() == contact.key() || old.contact.features.0 == UNKNOWN;
        // What counts as touching tells no more apart.
        let place = || TOUCHING * self.scene.effective_radius(contact.candidate, contact.antagonist);
        if known || self.moved(&old.contact, contact) <= place() {
            return Some(bond);
        }
        let foreseen = old.contact.gap + old.velocity.x * self.since();
        law.bond(contact.gap, radius).filter(|_| foreseen <= law.range(radius))
    }

    /// The row of a contact, with what the last step had of it.
    fn row(&self, contact: &Contact, previous: Option<&SolvedContact>) -> Row {
        let Setting { state, q_c, records, full, .. } = *self;
        let h = q_c.h;
        let frame = contact.frame();
        let n = frame[0];
        let u_before = relative_velocity(contact, &q_c.x, &state.v, &q_c.w);
        let law = &state.laws[contact.law as usize];
        let radius = self.radius(contact);
        let slid_before = previous.is_some_and(|old| old.status == Status::Slide);
        let bonds_now = state.bonding == Bonding::All || (state.bonding == Bonding::New && previous.is_none());
        let bond = previous.and_then(|old| self.bond(old, contact, law, radius));
        let bond = bond.or(if bonds_now { law.bond(contact.gap, radius) } else { None });
        let shift = law.shift(&Approach { gap: contact.gap, h, u_n: n.dot(&u_before), radius, slid_before, bond });
        let acts = shift.is_some();
        let shift = shift.unwrap_or_default();

        let bodies = [contact.candidate, contact.antagonist];
        let [a, b] = bodies.map(|i| i as usize);
        let on_plate = self.on_plate(contact);
        // Arms that end in one point: on a plate in the middle of the gap, else where the radii divide the distance.
        let radii = [records[a].radius, records[b].radius];
        let arm =
            if full { 1.0 } else { 1.0 + contact.gap / if on_plate { 2.0 * radii[0] } else { radii[0] + radii[1] } };
        let plate = if on_plate { self.plate(contact) } else { Vec3::zeros() };
        let w_n = records[a].inverse_mass + records[b].inverse_mass;
        let w_t = w_n
            + (arm * radii[0]).powi(2) * records[a].inverse_inertia
            + (arm * radii[1]).powi(2) * records[b].inverse_inertia;
        let u_tangent = u_before - n * n.dot(&u_before);
        Row {
            bodies,
            normal: n,
            arm,
            shift: n * shift.normal + u_tangent * shift.tangential - plate,
            w_n,
            w_t,
            friction: shift.friction,
            impulse_shift: shift.impulse,
            acts,
            can_close: acts && (contact.gap <= self.travel(contact) || shift.impulse != 0.0),
            start: previous.map_or(Vec3::zeros(), |old| warm_start(old, contact, &shift, h / state.h)),
            u_before: to_local(&frame, &u_before),
            bond: bond.filter(|_| acts),
        }
    }

    /// Resistance to rolling and spinning at row `k`, if its law has one.
    fn roll(&self, k: usize, contact: &Contact, previous: Option<&SolvedContact>) -> Option<Roll> {
        let Rolling { rolling, spinning } = self.state.laws[contact.law as usize].rolling?;
        let [a, b] = [contact.candidate, contact.antagonist].map(|i| i as usize);
        let scale = self.q_c.h / self.state.h;
        Some(Roll {
            row: k as u32,
            radius: self.radius(contact),
            rolling,
            spinning,
            inverse_w: 1.0 / (self.records[a].inverse_inertia + self.records[b].inverse_inertia),
            shift: if self.on_plate(contact) { -self.w_free[b] } else { Vec3::zeros() },
            start: previous.map_or(Vec3::zeros(), |old| to_world(&old.contact.frame(), &old.moment) * scale),
        })
    }

    /// Radius of the contact, m: a stress acts on the area in which faces meet, where there is one.
    fn radius(&self, contact: &Contact) -> f64 {
        if contact.area > 0.0 {
            (contact.area / std::f64::consts::PI).sqrt()
        } else {
            self.scene.effective_radius(contact.candidate, contact.antagonist)
        }
    }

    /// Whether the antagonist is a plate whose motion is in the row's shift.
    fn on_plate(&self, contact: &Contact) -> bool {
        !self.full && !self.scene.bodies[contact.antagonist as usize].is_sphere()
    }
}

/// The bodies' part of [`Full`], where a scene needs it.
fn full(scene: &Scene, q_c: &Configuration) -> Option<Full> {
    let of = |(body, q): (&Body, &Quat)| {
        if body.driven {
            return Matrix3::zeros();
        }
        let axes = q.to_rotation_matrix();
        axes * Matrix3::from_diagonal(&Vec3::from(body.inertia.map(|j| 1.0 / j))) * axes.transpose()
    };
    let full = || Full { arms: Vec::new(), inverse_inertia: scene.bodies.iter().zip(&q_c.q).map(of).collect() };
    scene.is_general().then(full)
}

/// r̂ of the last step for the same contact, scaled to the new step length, its tangential part
/// laid into the new tangent plane, if there is friction.
fn warm_start(old: &SolvedContact, contact: &Contact, shift: &Shift, scale: f64) -> Vec3 {
    let [n_old, t_old, s_old] = old.contact.frame();
    let n = contact.normal;
    debug_assert!((n_old.norm() - 1.0).abs() < 1e-3);
    let normal = n * (old.impulse.x * scale - shift.impulse).max(0.0);
    if shift.friction == 0.0 {
        return normal;
    }
    let tangential = t_old * old.impulse.y + s_old * old.impulse.z;
    normal + (tangential - n * n.dot(&tangential)) * scale
}

impl System {
    /// From the centre of the candidate (side 0) or antagonist (1) of row `k` to the contact point, m; 0 for a plate
    /// whose motion is in the row's shift.
    pub fn arm(&self, k: usize, side: usize) -> Vec3 {
        match &self.full {
            Some(full) => full.arms[k][side],
            None => {
                let row = &self.rows[k];
                row.normal * ([-row.arm, row.arm][side] * self.records[row.bodies[side] as usize].radius)
            }
        }
    }

    /// Change of the angular velocity of `body` by an angular impulse, world frame.
    pub fn spin(&self, body: u32, angular_impulse: &Vec3) -> Vec3 {
        match &self.full {
            Some(full) => full.inverse_inertia[body as usize] * angular_impulse,
            None => angular_impulse * self.records[body as usize].inverse_inertia,
        }
    }

    /// û of row `k` at the records' velocities, world frame, m/s.
    pub fn velocity(&self, k: usize, records: &[Record]) -> Vec3 {
        let row = &self.rows[k];
        if self.full.is_none() {
            return row.velocity(records);
        }
        let at = |side: usize| {
            let record = &records[row.bodies[side] as usize];
            record.v + record.w.cross(&self.arm(k, side))
        };
        at(0) - at(1) + row.shift
    }

    /// Gives the two bodies of row `k` the impulse `r` on the candidate and -r on the antagonist, N s.
    pub fn apply(&mut self, k: usize, r: &Vec3) {
        if self.full.is_none() {
            return self.rows[k].apply(&mut self.records, r);
        }
        for (side, r) in [(0, *r), (1, -r)] {
            let body = self.rows[k].bodies[side];
            let turn = self.spin(body, &self.arm(k, side).cross(&r));
            let record = &mut self.records[body as usize];
            record.v += r * record.inverse_mass;
            record.w += turn;
        }
    }
}

impl Row {
    /// r̂_n that keeps the row's own attraction from moving anything, as far as its shift leaves the contact closed, N s; 0
    /// without an attraction. It is the solution of a contact that nothing else loads.
    pub fn balance(&self) -> f64 {
        let attraction = -self.impulse_shift;
        (attraction - self.shift.dot(&self.normal) / self.w_n).clamp(0.0, attraction)
    }

    /// û at the records' velocities, world frame, m/s.
    pub fn velocity(&self, records: &[Record]) -> Vec3 {
        let [a, b] = self.bodies.map(|i| &records[i as usize]);
        a.v - b.v + self.normal.cross(&(a.w * a.radius + b.w * b.radius)) * self.arm + self.shift
    }

    /// Gives the two bodies the impulse `r` on the candidate and -r on the antagonist, N s.
    pub fn apply(&self, records: &mut [Record], r: &Vec3) {
        let turn = r.cross(&self.normal) * self.arm; // moment over the radius, the same for both sides
        let a = &mut records[self.bodies[0] as usize];
        a.v += r * a.inverse_mass;
        a.w += turn * (a.radius * a.inverse_inertia);
        let b = &mut records[self.bodies[1] as usize];
        b.v -= r * b.inverse_mass;
        b.w += turn * (b.radius * b.inverse_inertia);
    }
}
