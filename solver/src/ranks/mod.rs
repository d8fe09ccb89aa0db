//! Processes (ranks) that compute one scene together.
//!
//! Every rank holds the whole scene and state and makes the same decisions; heavy lists are divided, and each rank gets the
//! parts of the others. All else is computed on every rank, with equal results, since these depend on no number of
//! threads. Numbers are exchanged, never rounded or added anew, so that the bytes of a run do not depend on the number of
//! ranks.
//!
//! Like the pool of threads, the communicator of a computation is a property of the thread that makes it:
//! [`communicator`]. One thread of a process at a time communicates, the one that runs the solver.
//!
//! | module | contents |
//! |---|---|
//! | `launch` | start as one of several processes, and its end |
//! | [`lists`] | lists of which each rank has a part |
//! | `mpi_communicator` | ranks that are processes of MPI, in a build with the feature `mpi` |
//! | [`threads`] | ranks that are threads of one process, for tests |

pub(crate) mod launch;
pub mod lists;
#[cfg(feature = "mpi")]
mod mpi_communicator;
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

/// Communication between the ranks of a run, by the operations of MPI that have these names. All ranks call the same
/// functions in the same order.
pub trait Communicator: Sync {
    /// Number of this rank, from 0.
    fn rank(&self) -> usize;

    /// Number of ranks.
    fn size(&self) -> usize;

    /// Sends `outgoing`, and fills `incoming`, whose lengths are the lengths of the messages that the other ranks send.
    fn send_receive(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]);

    /// Returns the bytes of all ranks, one after the other, on every rank; `lengths` has the number of bytes of each rank.
    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8>;

    /// Ends all ranks with this exit code.
    fn abort(&self, code: i32) -> !;
}

/// Communicator of one rank.
#[derive(Debug, Clone, Copy)]
pub struct SingleRank;

impl Communicator for SingleRank {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn send_receive(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
        assert!(outgoing.is_empty() && incoming.is_empty());
    }

    fn all_gather(&self, own: &[u8], _: &[usize]) -> Vec<u8> {
        own.to_vec()
    }

    fn abort(&self, code: i32) -> ! {
        std::process::exit(code)
    }
}

thread_local! {
    static COMMUNICATOR: Cell<&'static dyn Communicator> = const { Cell::new(&SingleRank) };
}

/// Communicator of the computation that this thread makes; [`SingleRank`] unless [`set_communicator`] has set another.
pub fn communicator() -> &'static dyn Communicator {
    COMMUNICATOR.get()
}

/// Sets the communicator of the computations that this thread makes.
pub fn set_communicator(communicator: &'static dyn Communicator) {
    COMMUNICATOR.set(communicator);
}

/// Calls `work` with the communicator [`SingleRank`], and returns its result: for work that not all ranks do.
pub fn compute_alone<T>(work: impl FnOnce() -> T) -> T {
    let communicator = COMMUNICATOR.replace(&SingleRank);
    let result = work();
    COMMUNICATOR.set(communicator);
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

/// Returns the bytes of each rank, on every rank, of which only that rank knows the number. Not counted in [`traffic`].
pub fn all_gather_unsized(communicator: &dyn Communicator, own: &[u8]) -> Vec<Vec<u8>> {
    let own_length = (own.len() as u64).to_le_bytes();
    let lengths = communicator.all_gather(&own_length, &vec![own_length.len(); communicator.size()]);
    let length = |bytes: &[u8]| bytes.try_into().map_or(0, u64::from_le_bytes) as usize;
    let lengths: Vec<usize> = lengths.chunks_exact(own_length.len()).map(length).collect();
    let all = communicator.all_gather(own, &lengths);
    let mut rest = &all[..];
    let mut take_bytes = |length: usize| {
        let (first, later) = rest.split_at(length);
        rest = later;
        first.to_vec()
    };
    lengths.into_iter().map(&mut take_bytes).collect()
}

/// Returns a list of `count` items, on all ranks: each rank computes the items of a range by `compute`. A list of fewer
/// than `min_count` items, which take less time than their exchange, is computed by every rank.
pub fn divided_list<T: Pod>(count: usize, min_count: usize, compute: impl FnOnce(Range<usize>) -> Vec<T>) -> Vec<T> {
    let communicator = communicator();
    let (rank, size) = (communicator.rank(), communicator.size());
    if size == 1 || count < min_count {
        return compute(0..count);
    }
    let own = compute(part_range(count, rank, size));
    let lengths: Vec<usize> = (0..size).map(|rank| size_of::<T>() * part_range(count, rank, size).len()).collect();
    from_bytes(&all_gather_counted(communicator, as_bytes(&own), &lengths))
}

/// [`Communicator::all_gather`], counted in [`traffic`].
pub fn all_gather_counted(communicator: &dyn Communicator, own: &[u8], lengths: &[usize]) -> Vec<u8> {
    GATHERS.fetch_add(1, Ordering::Relaxed);
    GATHERED_BYTES.fetch_add(own.len() as u64, Ordering::Relaxed);
    communicator.all_gather(own, lengths)
}

/// [`Communicator::send_receive`], counted in [`traffic`].
pub fn send_receive_counted(communicator: &dyn Communicator, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
    MESSAGES.fetch_add(outgoing.len() as u64, Ordering::Relaxed);
    MESSAGE_BYTES.fetch_add(outgoing.iter().map(|message| message.bytes.len() as u64).sum(), Ordering::Relaxed);
    communicator.send_receive(outgoing, incoming);
}

/// Bytes of numbers.
pub fn as_bytes<T: NoUninit>(numbers: &[T]) -> &[u8] {
    bytemuck::cast_slice(numbers)
}

/// Numbers with these bytes, which need not be aligned.
pub fn from_bytes<T: Pod>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

// Counts of [`RankTraffic`] since the start of this process.
static MESSAGES: AtomicU64 = AtomicU64::new(0);
static MESSAGE_BYTES: AtomicU64 = AtomicU64::new(0);
static GATHERS: AtomicU64 = AtomicU64::new(0);
static GATHERED_BYTES: AtomicU64 = AtomicU64::new(0);
static DIVIDED_SWEEPS: AtomicU64 = AtomicU64::new(0);
static LIST_BYTES: AtomicU64 = AtomicU64::new(0);

/// Traffic of this process since its start, by the functions that count it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RankTraffic {
    /// Messages to single ranks, and their bytes.
    pub messages: u64,
    pub message_bytes: u64,
    /// Gathers of lists of known lengths, also for self-gravity and residual, and the bytes that this rank gave.
    pub gathers: u64,
    pub gathered_bytes: u64,
    /// Sweeps that were divided among the ranks.
    pub divided_sweeps: u64,
    /// Bytes of items of divided lists that were sent to single ranks.
    pub list_bytes: u64,
}

impl RankTraffic {
    /// Traffic of each rank since its start, on every rank.
    pub fn gather_all(communicator: &dyn Communicator) -> Vec<RankTraffic> {
        let RankTraffic { messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes } = traffic();
        let own = [messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes];
        let all = communicator.all_gather(as_bytes(&own), &vec![size_of_val(&own); communicator.size()]);
        let from_counts = |[messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes]: [u64; 6]| {
            RankTraffic { messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes }
        };
        from_bytes::<[u64; 6]>(&all).into_iter().map(from_counts).collect()
    }
}

/// Returns the traffic of this process since its start.
pub fn traffic() -> RankTraffic {
    let [messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes] =
        [&MESSAGES, &MESSAGE_BYTES, &GATHERS, &GATHERED_BYTES, &DIVIDED_SWEEPS, &LIST_BYTES]
            .map(|count| count.load(Ordering::Relaxed));
    RankTraffic { messages, message_bytes, gathers, gathered_bytes, divided_sweeps, list_bytes }
}

/// Counts bytes of items of a divided list that are sent to single ranks.
fn count_list_bytes(bytes: usize) {
    LIST_BYTES.fetch_add(bytes as u64, Ordering::Relaxed);
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
        SingleRank.send_receive(&[], &mut []);
        assert_eq!((SingleRank.rank(), SingleRank.size()), (0, 1));
        assert_eq!(SingleRank.all_gather(&[5, 6], &[2]), [5, 6]);
        assert_eq!(all_gather_unsized(&SingleRank, &[7]), [[7]]);
    }

    #[test]
    fn ranks_send_receive_and_gather() {
        for size in 1..=4 {
            let found = run_as_ranks(size, |communicator| {
                let rank = communicator.rank();
                // To each other rank as many bytes as the number of the receiver.
                let others = || (0..size).filter(|&other| other != rank);
                let outgoing: Vec<RankMessage> =
                    others().map(|to| RankMessage { rank: to, bytes: vec![rank as u8; to] }).collect();
                let mut incoming: Vec<RankMessage> =
                    others().map(|from| RankMessage { rank: from, bytes: vec![0; rank] }).collect();
                communicator.send_receive(&outgoing, &mut incoming);
                assert!(incoming.iter().all(|message| message.bytes == vec![message.rank as u8; rank]));
                all_gather_unsized(communicator, &vec![rank as u8; 2 * rank])
            });
            let all: Vec<Vec<u8>> = (0..size).map(|rank| vec![rank as u8; 2 * rank]).collect();
            assert!(found.iter().all(|found| *found == all), "{found:?}");
        }
    }

    #[test]
    fn lists_are_divided_and_put_together() {
        let squares = |range: Range<usize>| range.map(|k| (k * k) as u64).collect::<Vec<u64>>();
        for count in [0, 5, 8] {
            let found = run_as_ranks(3, |_| divided_list(count, 6, squares));
            assert!(found.iter().all(|found| *found == squares(0..count)), "{count}");
        }
        let parts = run_as_ranks(3, |communicator| {
            let made = Cell::new(0);
            divided_list(12, 6, |range| {
                made.set(range.len());
                squares(range)
            });
            (communicator.rank(), made.get())
        });
        assert_eq!(parts, [(0, 4), (1, 4), (2, 4)]);
    }
}
