//! Ranks that are processes of MPI.

use mpi::datatype::PartitionMut;
use mpi::request;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, CommunicatorCollectives, Destination, Root, Source};

use super::{Communicator, RankMessage};

/// Largest number of bytes of a call: MPI counts in signed integers of 32 bits.
const MAX_CALL_BYTES: usize = 1 << 30;

/// Communicator of all processes of an MPI program, `MPI_COMM_WORLD`.
#[derive(Debug)]
pub struct MpiCommunicator {
    rank: usize,
    size: usize,
}

impl MpiCommunicator {
    /// The communicator, once MPI is initialised.
    pub fn new() -> Self {
        let world = SimpleCommunicator::world();
        MpiCommunicator { rank: world.rank() as usize, size: world.size() as usize }
    }

    /// Replaces the bytes, of the same length on all ranks, by the bytes of the rank `root`.
    fn broadcast_from(root: usize, bytes: &mut [u8]) {
        let world = SimpleCommunicator::world();
        let root = world.process_at_rank(root as i32);
        bytes.chunks_mut(MAX_CALL_BYTES).for_each(|chunk| root.broadcast_into(chunk));
    }
}

impl Communicator for MpiCommunicator {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn send_receive(&self, outgoing: &[RankMessage], incoming: &mut [RankMessage]) {
        let world = SimpleCommunicator::world();
        request::multiple_scope(outgoing.len() + incoming.len(), |scope, requests| {
            for RankMessage { rank, bytes } in incoming {
                for chunk in bytes.chunks_mut(MAX_CALL_BYTES) {
                    requests.add(world.process_at_rank(*rank as i32).immediate_receive_into(scope, chunk));
                }
            }
            for RankMessage { rank, bytes } in outgoing {
                for chunk in bytes.chunks(MAX_CALL_BYTES) {
                    requests.add(world.process_at_rank(*rank as i32).immediate_send(scope, chunk));
                }
            }
            requests.wait_all(&mut Vec::new());
        });
    }

    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        let mut all = vec![0u8; lengths.iter().sum()];
        if all.is_empty() {
            return all;
        }
        // The address of an empty list may be that of `MPI_IN_PLACE`.
        let own = if own.is_empty() { &[0u8][..0] } else { own };
        let starts: Vec<usize> = lengths
            .iter()
            .scan(0, |end, length| {
                *end += length;
                Some(*end - length)
            })
            .collect();
        if all.len() <= MAX_CALL_BYTES {
            let counts: Vec<i32> = lengths.iter().map(|&length| length as i32).collect();
            let displacements: Vec<i32> = starts.iter().map(|&start| start as i32).collect();
            let mut parts = PartitionMut::new(&mut all[..], counts, displacements);
            SimpleCommunicator::world().all_gather_varcount_into(own, &mut parts);
        } else {
            all[starts[self.rank]..][..own.len()].copy_from_slice(own);
            for (rank, (&start, &length)) in starts.iter().zip(lengths).enumerate() {
                Self::broadcast_from(rank, &mut all[start..start + length]);
            }
        }
        all
    }

    fn abort(&self, code: i32) -> ! {
        SimpleCommunicator::world().abort(code)
    }
}
