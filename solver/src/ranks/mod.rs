//! Processes (ranks) that compute one scene together.
//!
//! Every rank holds the whole scene and state and makes the same decisions; heavy lists are divided, and each rank gets the
//! parts of the others. All else is computed on every rank, with equal results, since these depend on no number of
//! threads.
//! Numbers are exchanged, never rounded or added anew, so that the bytes of a run do not depend on the number of ranks.
//!
//! Like the pool of threads, the ranks of a computation are a property of the thread that makes it: [`current`]. One thread of
//! a process at a time communicates, the one that runs the solver.
//!
//! | module | contents |
//! |---|---|
//! | `launch` | start as one of several processes, and its end |
//! | `mpi_ranks` | ranks of MPI, in a build with the feature `mpi` |
//! | [`threads`] | ranks that are threads of one process, for tests |

pub(crate) mod launch;
#[cfg(feature = "mpi")]
mod mpi_ranks;
pub mod threads;

use std::cell::Cell;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::{NoUninit, Pod};

/// Bytes for another rank, or from it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RankMessage {
    /// The other rank.
    pub rank: usize,
    pub bytes: Vec<u8>,
}

/// Communication between the ranks. All ranks call the same functions in the same order.
pub trait Ranks: Sync {
    /// Number of this rank, from 0.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn size(&self) -> usize;

    /// Sends `outgoing`, and fills `incoming`, whose lengths are those of the messages that the other ranks send.
    fn exchange(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]);

    /// Replaces each number by its sum over all ranks.
    fn sum(&self, numbers: &mut [i64]);

    /// Returns the bytes of all ranks, one after the other; `lengths` has the number of bytes of each rank.
    fn gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8>;

    /// Replaces the bytes, of the same length on all ranks, by those of rank 0.
    fn broadcast(&self, bytes: &mut [u8]);

    /// Waits until all ranks have called it.
    fn barrier(&self);

    /// Ends all ranks with this exit code.
    fn abort(&self, code: i32) -> !;
}

/// The only rank.
#[derive(Debug, Clone, Copy)]
pub struct Alone;

impl Ranks for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn exchange(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
        debug_assert!(outgoing.is_empty() && incoming.is_empty());
    }

    fn sum(&self, _: &mut [i64]) {}

    fn gather(&self, own: &[u8], _: &[usize]) -> Vec<u8> {
        own.to_vec()
    }

    fn broadcast(&self, _: &mut [u8]) {}

    fn barrier(&self) {}

    fn abort(&self, code: i32) -> ! {
        std::process::exit(code)
    }
}

thread_local! {
    static CURRENT: Cell<&'static dyn Ranks> = const { Cell::new(&Alone) };
}

/// Ranks of the computation that this thread makes; [`Alone`] unless [`set_current`] has set others.
pub fn current() -> &'static dyn Ranks {
    CURRENT.get()
}

/// Sets the ranks of the computations that this thread makes.
pub fn set_current(ranks: &'static dyn Ranks) {
    CURRENT.set(ranks);
}

/// Calls `work` with this rank [`Alone`], and returns its result: for work that not all ranks do.
pub fn compute_alone<T>(work: impl FnOnce() -> T) -> T {
    let ranks = CURRENT.replace(&Alone);
    let result = work();
    CURRENT.set(ranks);
    result
}

/// Range of the part `part` if `count` items are divided into `parts` of almost equal size.
///
/// ```
/// # use cd_solve::ranks::part_range;
/// assert_eq!([0, 1, 2].map(|part| part_range(8, part, 3)), [0..2, 2..5, 5..8]);
/// ```
pub fn part_range(count: usize, part: usize, parts: usize) -> Range<usize> {
    part * count / parts..(part + 1) * count / parts
}

/// Gathers bytes whose number only their rank knows: returns those of each rank. Not counted in [`traffic`].
pub fn gather_unequal(ranks: &dyn Ranks, own: &[u8]) -> Vec<Vec<u8>> {
    let lengths = ranks.gather(&(own.len() as u64).to_le_bytes(), &vec![8; ranks.size()]);
    let length = |bytes: &[u8]| bytes.try_into().map_or(0, u64::from_le_bytes) as usize;
    let lengths: Vec<usize> = lengths.chunks_exact(8).map(length).collect();
    let all = ranks.gather(own, &lengths);
    let mut rest = &all[..];
    let mut next = |length: usize| {
        let (first, later) = rest.split_at(length);
        rest = later;
        first.to_vec()
    };
    lengths.into_iter().map(&mut next).collect()
}

/// Returns a list of `count` items, on all ranks: each rank computes those of a range by `compute`. A list of fewer
/// than `min_count` items, which take less time than their exchange, is computed by every rank.
pub fn divided_list<T: Pod>(count: usize, min_count: usize, compute: impl FnOnce(Range<usize>) -> Vec<T>) -> Vec<T> {
    let ranks = current();
    if ranks.size() == 1 || count < min_count {
        return compute(0..count);
    }
    let own = compute(part_range(count, ranks.rank(), ranks.size()));
    let lengths: Vec<usize> =
        (0..ranks.size()).map(|rank| size_of::<T>() * part_range(count, rank, ranks.size()).len()).collect();
    from_bytes(&gather_counted(ranks, as_bytes(&own), &lengths))
}

/// [`Ranks::gather`], counted in [`traffic`].
pub fn gather_counted(ranks: &dyn Ranks, own: &[u8], lengths: &[usize]) -> Vec<u8> {
    GATHERS.fetch_add(1, Ordering::Relaxed);
    GATHERED_BYTES.fetch_add(own.len() as u64, Ordering::Relaxed);
    ranks.gather(own, lengths)
}

/// [`Ranks::exchange`], counted in [`traffic`].
pub fn exchange_counted(ranks: &dyn Ranks, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
    MESSAGES.fetch_add(outgoing.len() as u64, Ordering::Relaxed);
    MESSAGE_BYTES.fetch_add(outgoing.iter().map(|message| message.bytes.len() as u64).sum(), Ordering::Relaxed);
    ranks.exchange(outgoing, incoming);
}

/// Bytes of numbers.
pub fn as_bytes<T: NoUninit>(numbers: &[T]) -> &[u8] {
    bytemuck::cast_slice(numbers)
}

/// Numbers with these bytes, which need not be aligned.
pub fn from_bytes<T: Pod>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

static MESSAGES: AtomicU64 = AtomicU64::new(0);
static MESSAGE_BYTES: AtomicU64 = AtomicU64::new(0);
static GATHERS: AtomicU64 = AtomicU64::new(0);
static GATHERED_BYTES: AtomicU64 = AtomicU64::new(0);
static DIVIDED_SWEEPS: AtomicU64 = AtomicU64::new(0);

/// Traffic of this process since its start, by the functions that count it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RankTraffic {
    /// Messages to single ranks, and their bytes.
    pub messages: u64,
    pub message_bytes: u64,
    /// Gathers of lists of known lengths, also those of self-gravity and residual, and the bytes that this rank gave.
    pub gathers: u64,
    pub gathered_bytes: u64,
    /// Sweeps that were divided among the ranks.
    pub divided_sweeps: u64,
}

impl RankTraffic {
    /// Traffic of each rank since its start, on every rank.
    pub fn of_all(ranks: &dyn Ranks) -> Vec<RankTraffic> {
        let RankTraffic { messages, message_bytes, gathers, gathered_bytes, divided_sweeps } = traffic();
        let own = [messages, message_bytes, gathers, gathered_bytes, divided_sweeps];
        let all = ranks.gather(as_bytes(&own), &vec![size_of_val(&own); ranks.size()]);
        let of_rank = |[messages, message_bytes, gathers, gathered_bytes, divided_sweeps]: [u64; 5]| RankTraffic {
            messages,
            message_bytes,
            gathers,
            gathered_bytes,
            divided_sweeps,
        };
        from_bytes::<[u64; 5]>(&all).into_iter().map(of_rank).collect()
    }
}

/// Returns the traffic of this process since its start.
pub fn traffic() -> RankTraffic {
    let [messages, message_bytes, gathers, gathered_bytes, divided_sweeps] =
        [&MESSAGES, &MESSAGE_BYTES, &GATHERS, &GATHERED_BYTES, &DIVIDED_SWEEPS]
            .map(|count| count.load(Ordering::Relaxed));
    RankTraffic { messages, message_bytes, gathers, gathered_bytes, divided_sweeps }
}

/// Counts a sweep that is divided among the ranks.
pub fn count_divided_sweep() {
    DIVIDED_SWEEPS.fetch_add(1, Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    use super::threads::run_as_ranks;
    use super::*;

    #[test]
    fn a_rank_alone_has_all() {
        let mut numbers = [3, -4];
        Alone.sum(&mut numbers);
        let mut bytes = [1, 2];
        Alone.broadcast(&mut bytes);
        Alone.barrier();
        Alone.exchange(&[], &mut []);
        assert_eq!((Alone.rank(), Alone.size(), numbers, bytes), (0, 1, [3, -4], [1, 2]));
        assert_eq!(Alone.gather(&[5, 6], &[2]), [5, 6]);
        assert_eq!(gather_unequal(&Alone, &[7]), [[7]]);
    }

    #[test]
    fn ranks_exchange_sum_gather_and_broadcast() {
        for size in 1..=4 {
            let found = run_as_ranks(size, |ranks| {
                let rank = ranks.rank();
                // To each other rank as many bytes as the number of the receiver.
                let others = || (0..size).filter(|&other| other != rank);
                let outgoing: Vec<RankMessage> =
                    others().map(|to| RankMessage { rank: to, bytes: vec![rank as u8; to] }).collect();
                let mut incoming: Vec<RankMessage> =
                    others().map(|from| RankMessage { rank: from, bytes: vec![0; rank] }).collect();
                ranks.exchange(&outgoing, &mut incoming);
                assert!(incoming.iter().all(|message| message.bytes == vec![message.rank as u8; rank]));
                let mut numbers = [rank as i64, -1];
                ranks.sum(&mut numbers);
                let mut bytes = [rank as u8, 9 - rank as u8];
                ranks.broadcast(&mut bytes);
                ranks.barrier();
                (numbers, bytes, gather_unequal(ranks, &vec![rank as u8; 2 * rank]))
            });
            let (n, all) = (size as i64, (0..size).map(|rank| vec![rank as u8; 2 * rank]).collect::<Vec<_>>());
            assert!(found.iter().all(|found| *found == ([n * (n - 1) / 2, -n], [0, 9], all.clone())), "{found:?}");
        }
    }

    #[test]
    fn lists_are_divided_and_put_together() {
        let squares = |range: Range<usize>| range.map(|k| (k * k) as u64).collect::<Vec<u64>>();
        for count in [0, 5, 8] {
            let found = run_as_ranks(3, |_| divided_list(count, 6, squares));
            assert!(found.iter().all(|found| *found == squares(0..count)), "{count}");
        }
        let parts = run_as_ranks(3, |ranks| {
            let made = Cell::new(0);
            divided_list(12, 6, |range| {
                made.set(range.len());
                squares(range)
            });
            (ranks.rank(), made.get())
        });
        assert_eq!(parts, [(0, 4), (1, 4), (2, 4)]);
    }
}
