//! The contact problem of general bodies laid out for sweeping: sixteen pairs of bodies at once, the contacts of
//! a pair one after the other, while the velocities of its bodies stay at hand.
//!
//! Bodies are cut into ranges, and pairs into colours that share no moving body, as in [`crate::solve::batches`].

use std::array;
use std::marker::PhantomData;

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use crate::assemble::{Full, Record, System};
use crate::math::Vec3;
use crate::math::lanes::{Arithmetic, Lanes, Number, Width};
use crate::solve::batches::{BATCH, Cones, NONE, Sums, Units, onto_cones, put};
use crate::solve::full::local::{Axes, Side, axes, block, of_lever};
use crate::solve::local::{dot, triple};
use crate::solve::nlgs::Reactions;
use crate::solve::rolling::Rolls;

/// A range holds at least this many bodies: fewer would wait for each other more than they work.
const RANGE: usize = 512;

/// Colours kept apart; what finds none of them free is swept one pair at a time.
const COLOURS: usize = 64;

/// Contacts of a pair that are solved in one go; further ones form another batch.
const POINTS: usize = 4;

/// Points of sixteen pairs of which a task fills at least so many.
const FILLED: usize = 32;

/// Numbers of a body.
pub type Line<T> = [T; 8];

/// Numbers of the pairs of a batch.
pub type Column<T> = [T; BATCH];

/// Sixteen pairs of bodies.
#[derive(Debug, Clone)]
pub struct Batch {
    /// Lines of candidate and antagonist, counted in the range (in all lines for pairs between ranges).
    pub bodies: [[u32; BATCH]; 2],
    /// First and last + 1 of its points.
    pub points: [usize; 2],
    /// Whether some of its bodies are pushed along some of the fixed axes alone.
    pub held: bool,
    /// Whether the friction of some of its contacts has a lever.
    pub levers: bool,
}

/// Friction levers n×d of the contacts of a point along its two tangents, m.
pub type Levers<T> = [Column<T>; 2];

/// One contact of each pair of a batch: what is constant of it. Unused places are pushed by nothing and stay at rest.
pub trait Contacts: Clone + Send + Sync {
    type T: Number;
    /// What sweeps change of it.
    type Impulses: Clone + Default + Send + Sync;

    /// Puts rows of the system into their places, to start from their impulses.
    fn filled(from: &Fill, rows: &Places) -> (Self, Self::Impulses);

    /// Friction levers of the rows in these places.
    fn levers(&self, from: &Fill, rows: &Places) -> Levers<Self::T>;

    /// r̂ of all places, world frame, N s.
    fn impulses(&self, from: &Back, rows: &Places, values: &Self::Impulses) -> [Column<f64>; 3];
}

/// Rows of the system, or [`NONE`].
pub type Places = [u32; BATCH];

/// Places that rows have, and these.
fn used(rows: &Places) -> impl Iterator<Item = (usize, usize)> + '_ {
    rows.iter().enumerate().filter(|(_, row)| **row != NONE).map(|(lane, &row)| (lane, row as usize))
}

/// What the batches are filled from.
pub struct Fill<'a> {
    system: &'a System,
    full: &'a Full,
    /// r̂ and moments at the start.
    reactions: &'a Reactions,
    /// The velocities that they lead to.
    records: &'a [Record],
    units: Units,
    width: Width,
}

/// Where the impulses of the batches go.
pub struct Back<'a> {
    system: &'a System,
    units: Units,
    width: Width,
}

impl Fill<'_> {
    /// û that row `k` starts from without what sweeps change of the velocities, m/s.
    ///
    /// Lines of single precision hold these changes alone, as in [`Body::CHANGES`](crate::solve::batches::Body::CHANGES).
    fn shift<T: Number>(&self, k: usize) -> Vec3 {
        if T::SINGLE { self.system.velocity(k, self.records) } else { self.system.rows[k].shift }
    }
}

/// With friction: three unknowns.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Point<T> {
    /// The normal and the axes of the local block, world frame.
    pub axes: [[Column<T>; 3]; 3],
    /// From the centres of candidate and antagonist, m.
    pub arms: [[Column<T>; 3]; 2],
    /// û = u + shift, along the axes, m/s.
    pub shift: [Column<T>; 3],
    pub inverse_nn: Column<T>,
    pub c: [Column<T>; 2],
    pub s: [Column<T>; 2],
    pub inverse_s: [Column<T>; 2],
    pub friction: Column<T>,
    /// A third of the trace of W, 1/kg.
    pub weight: Column<T>,
}

/// r̂ of a point along its axes, now and of the sweep before, N s, and the multiplier of its sliding.
#[derive(Debug, Clone, Default)]
#[repr(align(64))]
pub struct Impulses<T> {
    pub r: [Column<T>; 3],
    pub previous: [Column<T>; 3],
    pub multiplier: Column<T>,
}

/// Without friction: one unknown. A unit of it turns the bodies by the angular impulses `arms`, and so changes their
/// angular velocities by `answers`.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Normal<T> {
    /// World frame.
    pub normal: [Column<T>; 3],
    /// Arm of candidate and antagonist times the normal, m.
    pub arms: [[Column<T>; 3]; 2],
    /// Inverse inertia times that, 1/(kg m).
    pub answers: [[Column<T>; 3]; 2],
    /// û = u + shift, along the normal, m/s.
    pub shift: Column<T>,
    pub inverse_nn: Column<T>,
    /// W_nn, 1/kg.
    pub weight: Column<T>,
}

/// r̂ of a point along its normal, now and of the sweep before, N s.
#[derive(Debug, Clone, Default)]
#[repr(align(64))]
pub struct Push<T> {
    pub r: Column<T>,
    pub previous: Column<T>,
}

/// Batches that are swept in this order, with their impulses.
pub struct Batches<C: Contacts> {
    pub batches: Vec<Batch>,
    pub points: Vec<C>,
    pub impulses: Vec<C::Impulses>,
    /// By point; empty where no contact of the scene has moments.
    pub rolls: Vec<Rolls<C::T>>,
    /// By point; empty where no friction of a batch has a lever.
    pub levers: Vec<Levers<C::T>>,
    /// Rows of the system, or [`NONE`], by point.
    rows: Vec<Places>,
}

/// A range of bodies with the pairs inside it.
pub struct Range<C: Contacts> {
    /// Number of lines: the moving bodies, those that do not move, and one for unused places.
    pub lines: usize,
    pub inside: Batches<C>,
    /// Sums of the last sweep.
    pub sums: Sums<C::T>,
}

/// Lines of the touched bodies, range by range: v, 1/m, w and an unused place; inverse inertia xx, xy, xz, yy, yz, zz, and
/// two unused places. Of bodies that are [held](Full::held) the three hold 1 for x, y and z along which these are pushed, else 0.
/// In single precision v and w are what sweeps change of them, in [`Units`].
pub struct Problem<C: Contacts> {
    pub units: Units,
    pub lines: Vec<Line<C::T>>,
    pub previous: Vec<Line<C::T>>,
    pub inertia: Vec<Line<C::T>>,
    pub ranges: Vec<Range<C>>,
    pub between: Batches<C>,
}

/// Contacts of two bodies: rows that follow each other, at most [`POINTS`].
struct Pair {
    bodies: [u32; 2],
    rows: Vec<u32>,
    lines: [u32; 2],
}

impl<C: Contacts> Problem<C> {
    /// The problem of the rows `active` (sorted), starting from `reactions` and from the velocities that they lead to.
    pub fn new(
        system: &System,
        full: &Full,
        active: &[u32],
        reactions: &Reactions,
        records: &[Record],
        width: Width,
    ) -> Self {
        let units = if C::T::SINGLE { Units::of(system, active, reactions, records) } else { Units::SI };
        let fill = Fill { system, full, reactions, records, units, width };
        let mut pairs = pairs(system, active);
        // Which range each moving body is in; bodies in the order of space.
        let mut range_of = vec![NONE; records.len()];
        for pair in &pairs {
            for body in pair.bodies {
                if records[body as usize].inverse_mass > 0.0 {
                    range_of[body as usize] = 0;
                }
            }
        }
        let moving: Vec<u32> = system.order.iter().copied().filter(|&body| range_of[body as usize] == 0).collect();
        let count = 1 << (moving.len() / RANGE).max(1).ilog2(); // a power of two, so that halves can be halved again
        let mut place = vec![NONE; records.len()];
        let mut members = vec![Vec::new(); count];
        for (k, &body) in moving.iter().enumerate() {
            let range = k * count / moving.len();
            range_of[body as usize] = range as u32;
            place[body as usize] = members[range].len() as u32;
            members[range].push(body);
        }
        // Pairs by range, those between ranges last; a body that does not move has a line of its own in every pair.
        let mut groups: Vec<Vec<u32>> = vec![Vec::new(); count + 1];
        let mut sizes: Vec<u32> = members.iter().map(|range| range.len() as u32).collect();
        let mut fixed = vec![Vec::new(); count];
        for (k, pair) in pairs.iter_mut().enumerate() {
            let ranges = pair.bodies.map(|body| range_of[body as usize]);
            let group = match ranges {
                [NONE, NONE] => continue,
                [a, NONE] | [NONE, a] => a,
                [a, b] if a == b => a,
                _ => count as u32,
            };
            groups[group as usize].push(k as u32);
            for side in 0..2 {
                pair.lines[side] = place[pair.bodies[side] as usize];
                if ranges[side] == NONE {
                    pair.lines[side] = sizes[group as usize];
                    sizes[group as usize] += 1;
                    fixed[group as usize].push(pair.bodies[side]);
                }
            }
        }
        let mut starts = vec![0];
        let (mut lines, mut inertia) = (Vec::new(), Vec::new());
        for range in 0..count {
            for &body in members[range].iter().chain(&fixed[range]) {
                let &Record { v, inverse_mass, w, .. } = &records[body as usize];
                let (v, w) = if C::T::SINGLE { (Vec3::zeros(), Vec3::zeros()) } else { (v, w) };
                let (pushed, mass) = (full.pushed(body as usize), fill.units.mass());
                let line = [v.x, v.y, v.z, inverse_mass * mass, w.x, w.y, w.z, pushed.x];
                lines.push(line.map(C::T::of));
                let m = full.inverse_inertia[body as usize] * mass;
                let line = [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)], pushed.y, pushed.z];
                inertia.push(line.map(C::T::of));
            }
            lines.push([C::T::ZERO; 8]);
            inertia.push([C::T::ZERO; 8]);
            starts.push(lines.len() as u32);
        }
        // Pairs between ranges count in all lines.
        for &k in &groups[count] {
            let pair = &mut pairs[k as usize];
            for side in 0..2 {
                pair.lines[side] += starts[range_of[pair.bodies[side] as usize] as usize];
            }
        }
        let mut masks = vec![0u64; lines.len()];
        let mut layout = |group: &[u32], unused: u32| {
            let mut batches = Batches::new();
            for (size, mut members) in colours(group, &pairs, &mut masks) {
                members.sort_by_key(|&k| std::cmp::Reverse(pairs[k as usize].rows.len()));
                for chunk in members.chunks(size) {
                    batches.push(full, &pairs, chunk, unused);
                }
            }
            batches.fill(&fill);
            batches
        };
        let ranges = (0..count)
            .map(|range| {
                let lines = (starts[range + 1] - starts[range]) as usize;
                Range { lines, inside: layout(&groups[range], lines as u32 - 1), sums: Sums::default() }
            })
            .collect();
        let between = layout(&groups[count], lines.len() as u32 - 1);
        Problem { units: fill.units, previous: lines.clone(), lines, inertia, ranges, between }
    }

    /// Puts the impulses and moments of the rows swept, which are of this system, into `reactions`.
    pub fn read_back(&self, width: Width, system: &System, reactions: &mut Reactions) {
        let Reactions { impulses, moments } = reactions;
        let back = Back { system, units: self.units, width };
        for batches in self.ranges.iter().map(|range| &range.inside).chain([&self.between]) {
            batches.rolls.iter().for_each(|rolls| rolls.read_back(moments));
            for ((point, values), rows) in batches.points.iter().zip(&batches.impulses).zip(&batches.rows) {
                let r = point.impulses(&back, rows, values);
                for (lane, row) in used(rows) {
                    impulses[row] = r.map(|column| column[lane]).into();
                }
            }
        }
    }
}

fn pairs(system: &System, active: &[u32]) -> Vec<Pair> {
    let mut pairs: Vec<Pair> = Vec::new();
    for &k in active {
        let bodies = system.rows[k as usize].bodies;
        match pairs.last_mut() {
            Some(last) if last.bodies == bodies && last.rows.len() < POINTS => last.rows.push(k),
            _ => pairs.push(Pair { bodies, rows: vec![k], lines: [NONE; 2] }),
        }
    }
    pairs
}

/// Pairs by colour, each with the number of pairs that a batch of it may hold.
fn colours(group: &[u32], pairs: &[Pair], masks: &mut [u64]) -> Vec<(usize, Vec<u32>)> {
    let mut colours: Vec<(usize, Vec<u32>)> = Vec::new();
    let mut single = Vec::new();
    for &k in group {
        let lines = pairs[k as usize].lines.map(|line| line as usize);
        let free = (masks[lines[0]] | masks[lines[1]]).trailing_ones() as usize;
        if free == COLOURS {
            single.push(k);
            continue;
        }
        if free == colours.len() {
            colours.push((BATCH, Vec::new()));
        }
        colours[free].1.push(k);
        lines.into_iter().for_each(|line| masks[line] |= 1 << free);
    }
    for line in group.iter().flat_map(|&k| pairs[k as usize].lines) {
        masks[line as usize] = 0;
    }
    colours.push((1, single));
    colours
}

impl<C: Contacts> Batches<C> {
    fn new() -> Self {
        Batches { batches: vec![], points: vec![], impulses: vec![], rolls: vec![], levers: vec![], rows: vec![] }
    }

    /// A batch of the pairs `members`: which row is where.
    fn push(&mut self, full: &Full, pairs: &[Pair], members: &[u32], unused: u32) {
        let first = self.rows.len();
        let mut bodies = members.iter().flat_map(|&k| pairs[k as usize].bodies);
        let held = bodies.any(|body| full.holds(body as usize));
        let most = members.iter().map(|&k| pairs[k as usize].rows.len()).max().unwrap_or(0);
        self.rows.resize(first + most, [NONE; BATCH]);
        let has_lever =
            |row: &u32| full.friction_offsets.get(*row as usize).is_some_and(|offset| *offset != Vec3::zeros());
        let levers = members.iter().any(|&k| pairs[k as usize].rows.iter().any(has_lever));
        let mut batch = Batch { bodies: [[unused; BATCH]; 2], points: [first, first + most], held, levers };
        for (lane, &k) in members.iter().enumerate() {
            let pair = &pairs[k as usize];
            for side in 0..2 {
                batch.bodies[side][lane] = pair.lines[side];
            }
            for (rows, &row) in self.rows[first..].iter_mut().zip(&pair.rows) {
                rows[lane] = row;
            }
        }
        self.batches.push(batch);
    }

    /// Puts all rows into their places.
    fn fill(&mut self, from: &Fill) {
        let count = self.rows.len();
        let points = self.rows.par_iter().with_min_len(FILLED).map(|rows| C::filled(from, rows));
        points.unzip_into_vecs(&mut self.points, &mut self.impulses);
        if self.batches.iter().any(|batch| batch.levers) {
            let points = self.points.par_iter().zip(&self.rows).with_min_len(FILLED);
            self.levers = points.map(|(point, rows)| point.levers(from, rows)).collect();
        }
        if !from.system.rolls.is_empty() {
            self.rolls = vec![Rolls::NONE; count];
            for (rolls, rows) in self.rolls.iter_mut().zip(&self.rows) {
                for (lane, row) in used(rows) {
                    rolls.put(lane, from.system, row as u32, &from.reactions.moments);
                }
            }
        }
    }
}

impl<T: Number> Contacts for Point<T> {
    type T = T;
    type Impulses = Impulses<T>;

    fn filled(from: &Fill, rows: &Places) -> (Self, Impulses<T>) {
        let seen = &Seen::new::<T>(from, rows);
        let units = from.units;
        match from.width {
            Width::One(l) => l.run(Lay { l, seen, units, number: PhantomData }),
            #[cfg(target_arch = "x86_64")]
            Width::Four(l) => l.run(Lay { l, seen, units, number: PhantomData }),
            #[cfg(target_arch = "x86_64")]
            Width::Eight(l) => l.run(Lay { l, seen, units, number: PhantomData }),
        }
    }

    fn levers(&self, from: &Fill, rows: &Places) -> Levers<T> {
        let mut levers = [[T::ZERO; BATCH]; 2];
        for (lane, k) in used(rows) {
            let lever = from.full.friction_lever(k, &from.system.rows[k].normal);
            for (axis, to) in self.axes[1..].iter().zip(&mut levers) {
                to[lane] = T::of((0..3).map(|k| axis[k][lane].wide() * lever[k]).sum());
            }
        }
        levers
    }

    fn impulses(&self, from: &Back, rows: &Places, values: &Impulses<T>) -> [Column<f64>; 3] {
        let part = |axis: usize, k: usize, lane: usize| self.axes[axis][k][lane].wide() * values.r[axis][lane].wide();
        let along = |k: usize| {
            array::from_fn(|lane| (part(0, k, lane) + part(1, k, lane) + part(2, k, lane)) * from.units.impulse)
        };
        let mut r = [0, 1, 2].map(along);
        if T::SINGLE {
            let mut cones = Cones::NONE;
            for (lane, row) in used(rows) {
                cones.put(lane, &from.system.rows[row]);
            }
            onto_cones(from.width, &cones, &mut r);
        }
        r
    }
}

/// What a batch of rows is, one after the other in double precision. In unused places two bodies of the unit of mass meet without an
/// impulse, and none changes that.
struct Seen {
    normal: [Column<f64>; 3],
    sides: [Side<Column<f64>>; 2],
    /// û that sweeps start from, m/s.
    u: [Column<f64>; 3],
    /// r̂, N s.
    r: [Column<f64>; 3],
    inverse_nn: Column<f64>,
    friction: Column<f64>,
    /// Friction levers n×d, m; none where all are 0.
    levers: Option<[Column<f64>; 3]>,
}

impl Seen {
    fn new<T: Number>(from: &Fill, rows: &Places) -> Self {
        let (zero, one) = ([0.0; BATCH], [1.0; BATCH]);
        let unit = [1.0 / from.units.mass(); BATCH];
        let side = Side { arm: [zero; 3], inverse_mass: [unit; 3], inverse_inertia: [zero; 6] };
        let normal = [zero, zero, one];
        let levers = (!from.full.friction_offsets.is_empty()).then_some([zero; 3]);
        let (u, r) = ([zero; 3], [zero; 3]);
        let mut seen = Seen { normal, sides: [side; 2], u, r, inverse_nn: zero, friction: zero, levers };
        for (lane, k) in used(rows) {
            let row = &from.system.rows[k];
            put(&mut seen.normal, lane, &row.normal);
            if let Some(levers) = &mut seen.levers {
                put(levers, lane, &from.full.friction_lever(k, &row.normal));
            }
            put(&mut seen.u, lane, &from.shift::<T>(k));
            put(&mut seen.r, lane, &from.reactions.impulses[k]);
            for (side, to) in seen.sides.iter_mut().enumerate() {
                let Side { arm, inverse_mass, inverse_inertia } = Side::of(from.system, from.full, k, side);
                (0..3).for_each(|k| (to.arm[k][lane], to.inverse_mass[k][lane]) = (arm[k], inverse_mass[k]));
                (0..6).for_each(|k| to.inverse_inertia[k][lane] = inverse_inertia[k]);
            }
            (seen.inverse_nn[lane], seen.friction[lane]) = (1.0 / row.w_n, row.friction);
        }
        seen
    }
}

/// Lays a batch out on the axes of its contacts' own blocks.
struct Lay<'a, L, T> {
    l: L,
    seen: &'a Seen,
    units: Units,
    number: PhantomData<T>,
}

impl<L: Lanes, T: Number> NullaryFnOnce for Lay<'_, L, T> {
    type Output = (Point<T>, Impulses<T>);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Lay { l, seen, units, .. } = self;
        let (mut point, mut impulses) = (Point::zero(), Impulses::default());
        let (mass, one) = (l.splat(units.mass()), l.splat(1.0));
        for from in (0..BATCH).step_by(L::WIDTH) {
            let normal = triple!(k => l.load(&seen.normal[k][from..]));
            let sides = [side(l, &seen.sides[0], from), side(l, &seen.sides[1], from)];
            let mut w = block(l, sides);
            if let Some(levers) = &seen.levers {
                let of_lever = of_lever(l, &sides, normal, triple!(k => l.load(&levers[k][from..])));
                (0..6).for_each(|k| w[k] = l.add(w[k], of_lever[k]));
            }
            let Axes { axes, c, s } = axes(l, w, normal);
            let u = triple!(k => l.div(l.load(&seen.u[k][from..]), l.splat(units.velocity)));
            let r = triple!(k => l.div(l.load(&seen.r[k][from..]), l.splat(units.impulse)));
            for (k, axis) in axes.into_iter().enumerate() {
                for (to, component) in point.axes[k].iter_mut().zip(axis) {
                    lay(l, &mut to[from..], component);
                }
                lay(l, &mut point.shift[k][from..], dot(l, axis, u));
                lay(l, &mut impulses.r[k][from..], dot(l, axis, r));
            }
            for side in 0..2 {
                for k in 0..3 {
                    lay(l, &mut point.arms[side][k][from..], sides[side].arm[k]);
                }
                let s = l.mul(s[side], mass);
                lay(l, &mut point.c[side][from..], c[side]);
                lay(l, &mut point.s[side][from..], s);
                lay(l, &mut point.inverse_s[side][from..], l.div(one, s));
            }
            lay(l, &mut point.inverse_nn[from..], l.div(l.load(&seen.inverse_nn[from..]), mass));
            lay(l, &mut point.friction[from..], l.load(&seen.friction[from..]));
            let trace = l.add(w[0], l.add(w[3], w[5]));
            lay(l, &mut point.weight[from..], l.mul(l.mul(trace, l.splat(1.0 / 3.0)), mass));
        }
        impulses.previous = impulses.r;
        (point, impulses)
    }
}

#[inline(always)]
fn side<L: Lanes>(l: L, side: &Side<Column<f64>>, from: usize) -> Side<L::V> {
    let Side { arm, inverse_mass, inverse_inertia: [xx, xy, xz, yy, yz, zz] } = side;
    Side {
        arm: triple!(k => l.load(&arm[k][from..])),
        inverse_mass: triple!(k => l.load(&inverse_mass[k][from..])),
        inverse_inertia: [
            l.load(&xx[from..]),
            l.load(&xy[from..]),
            l.load(&xz[from..]),
            l.load(&yy[from..]),
            l.load(&yz[from..]),
            l.load(&zz[from..]),
        ],
    }
}

/// Puts as many numbers as there are lanes into the places from the first of `to` on.
#[inline(always)]
fn lay<L: Lanes, T: Number>(l: L, to: &mut [T], v: L::V) {
    let mut wide = [0.0; BATCH];
    l.store(&mut wide, v);
    for (to, x) in to.iter_mut().zip(&wide[..L::WIDTH]) {
        *to = T::of(*x);
    }
}

impl<T: Number> Point<T> {
    fn zero() -> Self {
        let zero = [T::ZERO; BATCH];
        Point {
            axes: [[zero; 3]; 3],
            arms: [[zero; 3]; 2],
            shift: [zero; 3],
            inverse_nn: zero,
            c: [zero; 2],
            s: [zero; 2],
            inverse_s: [zero; 2],
            friction: zero,
            weight: zero,
        }
    }
}

impl<T: Number> Contacts for Normal<T> {
    type T = T;
    type Impulses = Push<T>;

    fn filled(from: &Fill, rows: &Places) -> (Self, Push<T>) {
        let zero = [T::ZERO; BATCH];
        let mut point = Normal {
            normal: [zero; 3],
            arms: [[zero; 3]; 2],
            answers: [[zero; 3]; 2],
            shift: zero,
            inverse_nn: zero,
            weight: zero,
        };
        let mut values = Push::default();
        let Fill { system, full, reactions, units, .. } = from;
        for (lane, k) in used(rows) {
            let row = &system.rows[k];
            let (n, mass) = (row.normal, units.mass());
            put(&mut point.normal, lane, &n);
            for side in 0..2 {
                let arm = full.arms[k][side].cross(&n);
                put(&mut point.arms[side], lane, &arm);
                let answer = full.inverse_inertia[row.bodies[side] as usize] * arm * mass;
                put(&mut point.answers[side], lane, &answer);
            }
            point.shift[lane] = T::of(n.dot(&from.shift::<T>(k)) / units.velocity);
            values.r[lane] = T::of(n.dot(&reactions.impulses[k]) / units.impulse);
            values.previous[lane] = values.r[lane];
            (point.inverse_nn[lane], point.weight[lane]) = (T::of(1.0 / row.w_n / mass), T::of(row.w_n * mass));
        }
        (point, values)
    }

    fn levers(&self, _: &Fill, _: &Places) -> Levers<T> {
        [[T::ZERO; BATCH]; 2] // without friction
    }

    fn impulses(&self, from: &Back, rows: &Places, values: &Push<T>) -> [Column<f64>; 3] {
        let mut r = [[0.0; BATCH]; 3];
        for (lane, row) in used(rows) {
            let size = values.r[lane].wide() * from.units.impulse;
            put(&mut r, lane, &(from.system.rows[row].normal * size));
        }
        r
    }
}
