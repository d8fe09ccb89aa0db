//! The contact problem laid out for sweeping: bodies in the order of space, one cache line each;
//! contacts in batches of eight that share no moving body.
//!
//! Bodies are cut into ranges by their number alone; the contacts inside a range touch only its
//! bodies, those between ranges come after all others. So ranges can be swept side by side and the
//! result does not depend on how many threads there are.

use crate::assemble::{Row, System};
use crate::math::lanes::Line;
use crate::math::{Vec3, group};

/// Contacts in a batch.
pub const BATCH: usize = 8;

/// A range holds at least this many bodies: fewer would wait for each other more than they work.
const RANGE: usize = 2048;

/// Colours kept apart; what finds none of them free is swept one contact at a time.
const COLOURS: usize = 64;

/// What is constant of eight contacts. Unused places have no normal and no friction, and stay at rest.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct Batch {
    pub n: [[f64; BATCH]; 3],
    pub shift: [[f64; BATCH]; 3],
    /// 1/w_n and 1/w_t, kg.
    pub inverse_w: [[f64; BATCH]; 2],
    pub friction: [f64; BATCH],
    /// m
    pub levers: [[f64; BATCH]; 2],
    /// Lines of candidate and antagonist, counted in the range (in all lines for contacts between ranges).
    pub bodies: [[u32; BATCH]; 2],
    /// Row of the system, or [`NONE`].
    pub rows: [u32; BATCH],
}

pub const NONE: u32 = u32::MAX;

/// r̂ of eight contacts, and of the sweep before, N s. World vectors; where nothing has friction the
/// first component is r̂_n and the others are not used.
#[derive(Debug, Clone, Default)]
#[repr(align(64))]
pub struct Impulses {
    pub r: [[f64; BATCH]; 3],
    pub previous: [[f64; BATCH]; 3],
}

/// Batches that are swept in this order, with their impulses.
#[derive(Debug, Clone, Default)]
pub struct Batches {
    pub batches: Vec<Batch>,
    pub impulses: Vec<Impulses>,
}

/// Sums over the contacts of a sweep, by place in the batch so that no width changes their order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sums {
    pub uphill: [f64; BATCH],
    pub change2: [f64; BATCH],
}

impl Sums {
    pub fn add(&mut self, other: &Sums) {
        for lane in 0..BATCH {
            self.uphill[lane] += other.uphill[lane];
            self.change2[lane] += other.change2[lane];
        }
    }

    /// Whether the last change points against the momentum: sum of w_n (y - r).(r - r_before) > 0.
    pub fn is_uphill(&self) -> bool {
        self.uphill.iter().sum::<f64>() > 0.0
    }

    /// Norm of all r - y, N s.
    pub fn change(&self) -> f64 {
        self.change2.iter().sum::<f64>().sqrt()
    }
}

/// A range of bodies with the contacts inside it.
#[derive(Debug, Clone)]
pub struct Range {
    /// Number of lines: the moving bodies, then those that do not move, then one for unused places.
    pub lines: usize,
    pub moving: usize,
    pub inside: Batches,
    /// Sums of the last sweep.
    pub sums: Sums,
}

/// Velocity, 1/mass, angular velocity, 1/inertia of every touched body, range by range.
pub struct Problem {
    pub lines: Vec<Line>,
    pub previous: Vec<Line>,
    pub ranges: Vec<Range>,
    pub between: Batches,
    pub frictional: bool,
}

impl Problem {
    /// The problem of the rows `active`, starting from `impulses` (one a row of the system) and from
    /// the velocities that they lead to.
    pub fn new(system: &System, active: &[u32], impulses: &[Vec3], records: &[crate::assemble::Record]) -> Self {
        let frictional = active.iter().any(|&k| system.rows[k as usize].friction > 0.0);
        let layout = Layout::new(system, active);
        let mut lines = vec![[0.0; 8]; layout.starts[layout.starts.len() - 1]];
        for (body, line) in layout.line_of.iter().enumerate() {
            if *line != NONE {
                lines[*line as usize] = records[body].to_line();
            }
        }
        // Rows of each range, and at the end those between ranges, in the order of the bodies in space.
        let mut groups: Vec<Vec<u32>> = vec![Vec::new(); layout.ranges() + 1];
        let mut fixed_before = vec![0; layout.ranges()];
        let places: Vec<u32> = active.iter().map(|&k| layout.place(&system.rows[k as usize])).collect();
        let (order, _) = group(&places, lines.len() + 1);
        let mut fixed_line = vec![NONE; system.rows.len()];
        for k in order.into_iter().map(|place| active[place as usize]) {
            let row = &system.rows[k as usize];
            let [a, b] = row.bodies.map(|body| layout.range_of(body));
            match (a, b) {
                (Some(a), Some(b)) if a != b => groups[layout.ranges()].push(k),
                (Some(range), _) | (None, Some(range)) => {
                    groups[range].push(k);
                    if a.is_none() || b.is_none() {
                        let line = layout.starts[range] + layout.moving[range] + fixed_before[range];
                        fixed_before[range] += 1;
                        fixed_line[k as usize] = line as u32;
                        let fixed = row.bodies[if a.is_none() { 0 } else { 1 }];
                        lines[line] = records[fixed as usize].to_line();
                    }
                }
                (None, None) => {} // two bodies whose motion is imposed: nothing to solve
            }
        }

        let line = |k: u32, side: usize, from: usize| {
            let moving = layout.line_of[system.rows[k as usize].bodies[side] as usize];
            let line = if moving != NONE { moving } else { fixed_line[k as usize] };
            line - from as u32
        };
        let mut masks = vec![0u64; lines.len()];
        let mut batches = |rows: &[u32], from: usize, unused: usize| {
            let most = rows.len() / BATCH + COLOURS;
            let mut batches = Batches { batches: Vec::with_capacity(most), impulses: Vec::with_capacity(most) };
            for chunk in colour(system, rows, &layout, &mut masks).iter().flat_map(|colour| colour.1.chunks(colour.0)) {
                batches.push(
                    system,
                    chunk,
                    impulses,
                    |k, side| line(k, side, from),
                    (unused - from) as u32,
                    frictional,
                );
            }
            batches
        };
        let ranges: Vec<Range> = (0..layout.ranges())
            .map(|r| Range {
                lines: layout.starts[r + 1] - layout.starts[r],
                moving: layout.moving[r],
                inside: batches(&groups[r], layout.starts[r], layout.starts[r + 1] - 1),
                sums: Default::default(),
            })
            .collect();
        let between = batches(&groups[layout.ranges()], 0, lines.len() - 1);
        Problem { previous: lines.clone(), lines, ranges, between, frictional }
    }

    /// Puts the impulses r̂ into `impulses`, one a row of the system.
    pub fn read_back(&self, impulses: &mut [Vec3]) {
        for batches in self.ranges.iter().map(|range| &range.inside).chain([&self.between]) {
            for (batch, values) in batches.batches.iter().zip(&batches.impulses) {
                for (lane, &row) in batch.rows.iter().enumerate().filter(|(_, row)| **row != NONE) {
                    impulses[row as usize] = if self.frictional {
                        Vec3::from_fn(|k, _| values.r[k][lane])
                    } else {
                        Vec3::from_fn(|k, _| batch.n[k][lane]) * values.r[0][lane]
                    };
                }
            }
        }
    }
}

/// Which line each moving body has.
struct Layout {
    /// By body; [`NONE`] for one that no active row touches or that does not move.
    line_of: Vec<u32>,
    /// First line of each range, and the number of lines.
    starts: Vec<usize>,
    moving: Vec<usize>,
}

impl Layout {
    fn new(system: &System, active: &[u32]) -> Self {
        let mut touched = vec![false; system.records.len()];
        let mut fixed_contacts = 0;
        for &k in active {
            for body in system.rows[k as usize].bodies {
                let moves = system.records[body as usize].inverse_mass > 0.0;
                touched[body as usize] |= moves;
                fixed_contacts += usize::from(!moves);
            }
        }
        let bodies: Vec<u32> = system.order.iter().copied().filter(|&body| touched[body as usize]).collect();
        let ranges = (bodies.len() / RANGE).max(1);
        let ranges = 1 << ranges.ilog2(); // a power of two, so that halves can be halved again
        let cut = |r: usize| r * bodies.len() / ranges;
        let mut range_of = vec![0; system.records.len()];
        for r in 0..ranges {
            bodies[cut(r)..cut(r + 1)].iter().for_each(|&body| range_of[body as usize] = r);
        }
        // Every contact with a body that does not move has a line of its own for that body, so that
        // lines shared by many contacts do not exist.
        let mut fixed = vec![0; ranges];
        if fixed_contacts > 0 {
            for &k in active {
                let [a, b] = system.rows[k as usize].bodies;
                match [a, b].map(|body| touched[body as usize]) {
                    [true, false] => fixed[range_of[a as usize]] += 1,
                    [false, true] => fixed[range_of[b as usize]] += 1,
                    _ => {}
                }
            }
        }
        let mut layout = Layout { line_of: vec![NONE; system.records.len()], starts: vec![0], moving: Vec::new() };
        for r in 0..ranges {
            let start = layout.starts[r];
            let members = &bodies[cut(r)..cut(r + 1)];
            for (place, &body) in members.iter().enumerate() {
                layout.line_of[body as usize] = (start + place) as u32;
            }
            layout.moving.push(members.len());
            layout.starts.push(start + members.len() + fixed[r] + 1);
        }
        layout
    }

    fn ranges(&self) -> usize {
        self.moving.len()
    }

    fn range_of(&self, body: u32) -> Option<usize> {
        let line = self.line_of[body as usize];
        (line != NONE).then(|| self.starts.partition_point(|&start| start <= line as usize) - 1)
    }

    /// Where in space a row stands: the first line of its bodies.
    fn place(&self, row: &Row) -> u32 {
        let [a, b] = row.bodies.map(|body| self.line_of[body as usize]);
        a.min(b).min(*self.starts.last().unwrap_or(&0) as u32)
    }
}

/// Rows by colour, each with the number of rows that a batch of it may hold.
fn colour(system: &System, rows: &[u32], layout: &Layout, masks: &mut [u64]) -> Vec<(usize, Vec<u32>)> {
    let lines = |k: u32| system.rows[k as usize].bodies.map(|body| layout.line_of[body as usize]);
    let mut colours: Vec<(usize, Vec<u32>)> = Vec::new();
    let mut single = Vec::new();
    for &k in rows {
        let moving = lines(k).into_iter().filter(|line| *line != NONE);
        let taken = moving.clone().fold(0, |taken, line| taken | masks[line as usize]);
        let free = taken.trailing_ones() as usize;
        if free == COLOURS {
            single.push(k);
            continue;
        }
        if free == colours.len() {
            colours.push((BATCH, Vec::new()));
        }
        colours[free].1.push(k);
        moving.for_each(|line| masks[line as usize] |= 1 << free);
    }
    for line in rows.iter().flat_map(|&k| lines(k)).filter(|line| *line != NONE) {
        masks[line as usize] = 0;
    }
    colours.push((1, single));
    colours
}

impl Batches {
    fn push(
        &mut self,
        system: &System,
        rows: &[u32],
        impulses: &[Vec3],
        line: impl Fn(u32, usize) -> u32,
        unused: u32,
        frictional: bool,
    ) {
        let mut batch = Batch {
            n: [[0.0; BATCH]; 3],
            shift: [[0.0; BATCH]; 3],
            inverse_w: [[0.0; BATCH]; 2],
            friction: [0.0; BATCH],
            levers: [[0.0; BATCH]; 2],
            bodies: [[unused; BATCH]; 2],
            rows: [NONE; BATCH],
        };
        let mut start = Impulses::default();
        for (lane, &k) in rows.iter().enumerate() {
            let row = &system.rows[k as usize];
            let put = |columns: &mut [[f64; BATCH]; 3], v: &Vec3| (0..3).for_each(|i| columns[i][lane] = v[i]);
            put(&mut batch.n, &row.normal);
            put(&mut batch.shift, &row.shift);
            if frictional {
                put(&mut start.r, &impulses[k as usize]);
            } else {
                start.r[0][lane] = row.normal.dot(&impulses[k as usize]);
            }
            batch.inverse_w[0][lane] = 1.0 / row.w_n;
            batch.inverse_w[1][lane] = 1.0 / row.w_t;
            batch.friction[lane] = row.friction;
            for side in 0..2 {
                batch.levers[side][lane] = row.levers[side];
                batch.bodies[side][lane] = line(k, side);
            }
            batch.rows[lane] = k;
        }
        start.previous = start.r;
        self.batches.push(batch);
        self.impulses.push(start);
    }
}
