//! Division of the sweeps of the next step among ranks, for `--plan --ranks`: counts, and an estimate of the time of a sweep
//! on two networks.

use std::time::Instant;

use cd_formats::names::{count_text, short_number};

use crate::assemble::ContactConstraint;
use crate::contact_division::undivided_reason;
use crate::math::Vec3;
use crate::math::simd::SimdWidth;
use crate::scene::Scene;
use crate::solve::ContactReactions;
use crate::solve::gauss_seidel::diagonal::batches::ContactBatch;
use crate::solve::gauss_seidel::layout::{division_counts, pack_problem};
use crate::solve::gauss_seidel::packed::{BATCH_LANES, PackSource};
use crate::solve::gauss_seidel::shares::DivisionCounts;
use crate::solve::residual::{ContactGroup, GROUP_LANES};
use crate::state::{ContactId, State};
use crate::step::next_contact_problem;

/// Number of timed sweeps; one more warms the caches.
const TIMED_SWEEPS: u32 = 5;

/// A network between the ranks.
struct RankNetwork {
    name: &'static str,
    /// Latency of a message, s.
    latency: f64,
    /// Bandwidth of a rank, bytes/s.
    bandwidth: f64,
}

/// Networks of a cluster and of a few machines.
const NETWORKS: [RankNetwork; 2] = [
    RankNetwork { name: "2 µs and 10 GB/s", latency: 2e-6, bandwidth: 1e10 },
    RankNetwork { name: "30 µs and 1 GB/s", latency: 3e-5, bandwidth: 1e9 },
];

/// Lines of a plan about the division of the next step among `ranks`; `contact_bytes`: size of a contact on one process.
pub fn division_lines(scene: &Scene, state: &State, ranks: usize, contact_bytes: usize) -> Vec<(&'static str, String)> {
    let (_, problem, _) = next_contact_problem(scene, state);
    let rows = (0..problem.rows.len()).map(ContactId::new);
    let active: Vec<ContactId> = rows.filter(|k| problem.rows[k.index()].can_close).collect();
    if active.is_empty() {
        return vec![("ranks", "no contact can close in the next step: nothing is swept".into())];
    }
    let counts = division_counts(&problem, &active, ranks);
    let (mut reactions, width) = (ContactReactions::zeros(&problem), SimdWidth::detect());
    active.iter().for_each(|row| reactions.impulses[row.index()] = problem.rows[row.index()].warm_start);
    let source = PackSource {
        problem: &problem,
        active: &active,
        reactions: &reactions,
        solver_bodies: &problem.bodies,
        width,
        associated: &[],
    };
    let is_single_precision = problem.rolling_constraints.is_empty();
    let mut packed = pack_problem(&source, is_single_precision);
    packed.sweep_contacts(width, 0.0);
    let start = Instant::now();
    for _ in 0..TIMED_SWEEPS {
        packed.sweep_contacts(width, 0.0);
    }
    let seconds = start.elapsed().as_secs_f64() / f64::from(TIMED_SWEEPS);

    let moving = problem.bodies.iter().filter(|body| body.inverse_mass > 0.0).count();
    let number_bytes = if is_single_precision { size_of::<f32>() } else { size_of::<f64>() };
    // A line has the velocity of a body, and its angular velocity unless contacts turn no body, as spheres without friction.
    let turns = problem.block_data.is_some() || problem.has_friction(&active);
    let line_bytes = number_bytes * if turns { 6 } else { 3 };
    let (text, sum_bytes) = (counts_text(&counts, moving, line_bytes), 2 * BATCH_LANES * number_bytes * counts.tasks);
    let times = NETWORKS.map(|network| {
        let divided_seconds = sweep_seconds(&counts, seconds, [line_bytes, sum_bytes], &network);
        format!("{} s with {}", short_number(divided_seconds), network.name)
    });
    let threads = count_text(rayon::current_num_threads(), "thread");
    vec![
        ("ranks", text),
        (
            "",
            format!(
                "a sweep of {} s on one process with {threads} takes about {}",
                short_number(seconds),
                times.join(", ")
            ),
        ),
        (
            "contacts by rank",
            contacts_text(undivided_reason(scene, state), problem.rows.len(), ranks, &counts, contact_bytes),
        ),
    ]
}

/// Bytes of a row that a rank sweeps: as it was received, its lane in a batch, its data for the residual and its impulses.
const SWEPT_ROW_BYTES: usize = size_of::<ContactConstraint>()
    + size_of::<ContactBatch<f64>>() / BATCH_LANES
    + size_of::<ContactGroup>() / GROUP_LANES
    + 3 * size_of::<Vec3>();

/// Contacts on a rank and their memory, of `contacts` contacts of `contact_bytes` on one process.
fn contacts_text(
    undivided_reason: Option<&str>,
    contacts: usize,
    ranks: usize,
    counts: &DivisionCounts,
    contact_bytes: usize,
) -> String {
    let megabytes = |bytes: usize| short_number(bytes as f64 / 1e6);
    let whole = megabytes(contacts * contact_bytes);
    if let Some(reason) = undivided_reason {
        return format!("all {contacts} on each rank, because of {reason}: about {whole} MB");
    }
    let (listed, swept) = (contacts.div_ceil(ranks), counts.work.iter().copied().max().unwrap_or(0) as usize);
    let bytes = listed * contact_bytes.saturating_sub(SWEPT_ROW_BYTES) + swept * SWEPT_ROW_BYTES;
    format!(
        "divided: about {listed} of {contacts} on a rank, which sweeps at most {swept}: about {} MB instead of {whole} MB",
        megabytes(bytes)
    )
}

/// Counts as text; `moving_count`: number of moving bodies, `line_bytes`: size of the data of a body in a message.
fn counts_text(counts: &DivisionCounts, moving_count: usize, line_bytes: usize) -> String {
    let DivisionCounts { blocks, colours, work, messages, lines, neighbours, ghosts, border_bodies, .. } = counts;
    let largest_count = |counts: &[u64]| counts.iter().copied().max().unwrap_or(0);
    let working = work.iter().filter(|&&work| work > 0).count();
    format!(
        "{} for {}, in {}; {} at borders, {:.1} %; a rank has at most {:.2} of the mean work and {}, and sends at most {} in a sweep, {:.2} kB, to {}",
        count_text(working, "rank"),
        count_text(*blocks, "block"),
        count_text(*colours, "colour"),
        count_text(*border_bodies as usize, "body"),
        100.0 * *border_bodies as f64 / moving_count.max(1) as f64,
        largest_count(work) as f64 * working as f64 / work.iter().sum::<u64>().max(1) as f64,
        count_text(largest_count(ghosts) as usize, "ghost"),
        count_text(largest_count(messages) as usize, "message"),
        1e-3 * (largest_count(lines) as usize * line_bytes) as f64,
        count_text(largest_count(neighbours) as usize, "neighbour"),
    )
}

/// Upper estimate of the time of a sweep, s: the largest work, messages and lines of a rank, one exchange after the
/// other, and the gather of all sums, of `sum_bytes`. `seconds`: time on one process.
fn sweep_seconds(
    counts: &DivisionCounts,
    seconds: f64,
    [line_bytes, sum_bytes]: [usize; 2],
    network: &RankNetwork,
) -> f64 {
    let &RankNetwork { latency, bandwidth, .. } = network;
    let largest_count = |counts: &[u64]| counts.iter().copied().max().unwrap_or(0) as f64;
    let working = counts.work.iter().filter(|&&work| work > 0).count();
    if working <= 1 {
        return seconds;
    }
    let work_seconds = seconds * largest_count(&counts.work) / counts.whole_work.max(1) as f64;
    let exchanges =
        largest_count(&counts.messages) * latency + largest_count(&counts.lines) * line_bytes as f64 / bandwidth;
    let gather_messages = f64::from(working.next_power_of_two().trailing_zeros());
    work_seconds + exchanges + gather_messages * latency + sum_bytes as f64 / bandwidth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_is_its_work_and_its_messages() {
        let counts = DivisionCounts {
            whole_work: 100,
            work: vec![60, 50],
            messages: vec![3, 3],
            lines: vec![10, 20],
            ..DivisionCounts::default()
        };
        // 0.6 of 1 s, 3 messages and one step of the gather of 1 ms, 20 lines of 24 bytes and 40 bytes at 1 kB/s.
        let slow = RankNetwork { name: "slow", latency: 1e-3, bandwidth: 1e3 };
        let found = sweep_seconds(&counts, 1.0, [24, 40], &slow);
        assert!((found - (0.6 + 4e-3 + 0.52)).abs() < 1e-12, "{found}");
        let alone = DivisionCounts { whole_work: 7, work: vec![7, 0], ..DivisionCounts::default() };
        assert_eq!(sweep_seconds(&alone, 2.0, [24, 40], &slow), 2.0);
    }

    #[test]
    fn ranks_have_their_part_of_the_contacts_and_the_rows_that_they_sweep() {
        let counts = DivisionCounts { work: vec![300_000, 400_000], ..DivisionCounts::default() };
        let bytes = SWEPT_ROW_BYTES + 1000;
        let divided = contacts_text(None, 1_000_000, 4, &counts, bytes);
        assert!(
            divided.starts_with("divided: about 250000 of 1000000 on a rank, which sweeps at most 400000"),
            "{divided}"
        );
        let expected = 0.25 * 1000.0 + 0.4 * SWEPT_ROW_BYTES as f64; // MB
        assert!(divided.contains(&format!("about {} MB instead of", short_number(expected))), "{divided}");
        let whole = contacts_text(Some("probes"), 2000, 4, &counts, 1000);
        assert_eq!(whole, "all 2000 on each rank, because of probes: about 2.00 MB");
    }
}
