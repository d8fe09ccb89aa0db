//! Ranks that are threads of one process: the same computations as with MPI, for tests on machines without it.

use std::collections::VecDeque;
use std::sync::{Barrier, Condvar, Mutex, PoisonError};
use std::thread;

use super::{Communicator, RankMessage, set_communicator};

/// Mail from one rank to another.
#[derive(Default)]
struct Mailbox {
    messages: Mutex<VecDeque<Vec<u8>>>,
    arrived: Condvar,
}

/// Memory that the ranks share.
struct SharedMail {
    barrier: Barrier,
    /// Bytes that each rank gives to all.
    contributions: Vec<Mutex<Vec<u8>>>,
    /// Mailboxes by sender and receiver.
    mail: Vec<Vec<Mailbox>>,
}

/// Communicator of a thread that is a rank.
pub struct ThreadCommunicator {
    rank: usize,
    shared: &'static SharedMail,
}

impl Communicator for ThreadCommunicator {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.shared.contributions.len()
    }

    fn send_receive(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
        for RankMessage { rank, bytes } in outgoing {
            let Mailbox { messages, arrived } = &self.shared.mail[self.rank][*rank];
            messages.lock().unwrap_or_else(PoisonError::into_inner).push_back(bytes.clone());
            arrived.notify_one();
        }
        for RankMessage { rank, bytes } in incoming {
            let Mailbox { messages, arrived } = &self.shared.mail[*rank][self.rank];
            let mut messages = messages.lock().unwrap_or_else(PoisonError::into_inner);
            let message = loop {
                match messages.pop_front() {
                    Some(message) => break message,
                    None => messages = arrived.wait(messages).unwrap_or_else(PoisonError::into_inner),
                }
            };
            bytes.copy_from_slice(&message);
        }
    }

    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        let lock = |bytes: &'static Mutex<Vec<u8>>| bytes.lock().unwrap_or_else(PoisonError::into_inner);
        *lock(&self.shared.contributions[self.rank]) = own.to_vec();
        self.shared.barrier.wait();
        let all: Vec<Vec<u8>> = self.shared.contributions.iter().map(|bytes| lock(bytes).clone()).collect();
        self.shared.barrier.wait();
        assert!(all.iter().map(Vec::len).eq(lengths.iter().copied()));
        all.concat()
    }

    fn abort(&self, code: i32) -> ! {
        std::process::exit(code)
    }
}

/// Runs `work` on `size` ranks, each with a pool of one thread of its own; returns the results by rank.
///
/// # Panics
///
/// If the work of a rank panics, or a thread cannot be started. Meant for tests: the memory that the ranks share is not
/// freed.
pub fn run_as_ranks<T: Send>(size: usize, work: impl Fn(&'static dyn Communicator) -> T + Sync) -> Vec<T> {
    let mailboxes = || (0..size).map(|_| Mailbox::default()).collect();
    let shared: &'static SharedMail = Box::leak(Box::new(SharedMail {
        barrier: Barrier::new(size),
        contributions: (0..size).map(|_| Mutex::default()).collect(),
        mail: (0..size).map(|_| mailboxes()).collect(),
    }));
    let work = &work;
    let run_rank = |rank: usize| {
        let communicator: &'static dyn Communicator = Box::leak(Box::new(ThreadCommunicator { rank, shared }));
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .start_handler(move |_| set_communicator(communicator))
            .build();
        pool.expect("a thread").install(|| work(communicator))
    };
    thread::scope(|scope| {
        let ranks: Vec<_> = (0..size).map(|rank| scope.spawn(move || run_rank(rank))).collect();
        ranks.into_iter().map(|rank| rank.join().expect("a result of each rank")).collect()
    })
}
