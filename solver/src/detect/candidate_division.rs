//! Division of the contacts of spheres and plates among ranks by their candidates, see [`CandidateDivision`]: its cuts, and
//! contacts that change their rank when cuts move.

use bytemuck::Pod;

use crate::ranks::communicator;
use crate::ranks::lists::{all_gather_lists, all_gather_values, exchange_known_lists, exchange_lists};
use crate::scene::Scene;
use crate::state::messages::SolvedContactMessage;
use crate::state::{CandidateDivision, DetectionCache, PairVirial, SolvedContact, State};

/// Number of groups of consecutive spheres whose pairs are counted; the cuts between the spheres of the ranks are at ends of
/// groups. Chosen: a thousandth of the pairs is a small part of those of a rank.
const COUNTED_GROUPS: usize = 1024;

/// Largest ratio of the pairs of a rank to the mean over the ranks up to which the cuts are kept. Chosen: moving them costs a
/// search for neighbours and the sending of contacts.
const MAX_UNEVENNESS: f64 = 1.1;

/// Moves the cuts between the candidates of the ranks if the ranks have uneven numbers of neighbour pairs. Returns whether cuts
/// have moved; the pairs are then still those of the earlier cuts.
pub fn rebalance_cuts(cache: &mut DetectionCache) -> bool {
    let DetectionCache { division: Some(division), neighbours, .. } = cache else { return false };
    if !division.can_move_cuts || neighbours.centres.is_empty() {
        return false;
    }
    let spheres = neighbours.centres.len();
    let group = |sphere: u32| sphere as usize * COUNTED_GROUPS / spheres;
    let mut own_counts = vec![0u64; COUNTED_GROUPS];
    neighbours.pairs.iter().for_each(|[first, _]| own_counts[group(*first)] += 1);
    let mut counts = vec![0u64; COUNTED_GROUPS];
    for list in all_gather_lists(&own_counts) {
        counts.iter_mut().zip(list).for_each(|(sum, count)| *sum += count);
    }
    let Some(cuts) = even_cuts(&counts, spheres, &division.cuts) else { return false };
    (division.cuts, division.has_moved_cuts) = (cuts, true);
    true
}

/// Cuts between groups of `spheres` with these numbers of pairs, for about equal numbers on all ranks; `None` if the earlier cuts
/// exceed the mean by no more than [`MAX_UNEVENNESS`], or the new ones are no better.
fn even_cuts(counts: &[u64], spheres: usize, earlier: &[u32]) -> Option<Vec<u32>> {
    let size = earlier.len() - 1;
    let total: u64 = counts.iter().sum();
    // First sphere of each group, and pairs before it.
    let first_sphere = |group: usize| (group * spheres).div_ceil(counts.len()) as u32;
    let sums = counts.iter().scan(0, |sum, count| {
        *sum += count;
        Some(*sum)
    });
    let before: Vec<u64> = [0].into_iter().chain(sums).collect();
    let cut = |rank: usize| match rank {
        0 => 0,
        rank if rank == size => spheres as u32,
        rank => first_sphere(before.partition_point(|&pairs| pairs * (size as u64) < total * rank as u64)),
    };
    let cuts: Vec<u32> = (0..=size).map(cut).collect();
    let largest_pair_count = |cuts: &[u32]| {
        let pairs_before = |&cut: &u32| before[(cut as usize * counts.len() / spheres.max(1)).min(counts.len())];
        cuts.windows(2).map(|run| pairs_before(&run[1]) - pairs_before(&run[0])).max().unwrap_or(0)
    };
    let mean = total as f64 / size as f64;
    (largest_pair_count(earlier) as f64 > MAX_UNEVENNESS * mean
        && largest_pair_count(&cuts) < largest_pair_count(earlier))
    .then_some(cuts)
}

/// Sends the contacts of the last step, and the virials of the output interval, to the ranks that have their candidates, if
/// cuts have moved.
pub fn migrate_contacts(scene: &Scene, state: &mut State) {
    let Some(division) = state.detection_cache.division.as_mut().filter(|division| division.has_moved_cuts) else {
        return;
    };
    division.has_moved_cuts = false;
    let division = &*division;
    let mut contacts = vec![Vec::new(); communicator().size()];
    let candidates = state.contacts.iter().map(|solved| solved.contact.candidate);
    for (solved, owner) in state.contacts.iter().zip(division.owners(scene, candidates)) {
        contacts[owner].push(SolvedContactMessage::from(solved));
    }
    state.contacts = exchange_lists(contacts).into_iter().flatten().map(SolvedContact::from).collect();
    let mut pair_virials = vec![Vec::new(); communicator().size()];
    let candidates = state.interval.pair_virials.iter().map(|pair| pair.bodies[0]);
    for (pair, owner) in state.interval.pair_virials.iter().zip(division.owners(scene, candidates)) {
        pair_virials[owner].push(pair.to_words());
    }
    let pair_virials = exchange_lists(pair_virials).into_iter().flatten();
    state.interval.pair_virials = pair_virials.map(PairVirial::from_words).collect();
}

/// Removes the contacts of other ranks from a state that has all, and divides its contacts from now on.
pub fn divide_contacts(scene: &Scene, state: &mut State) {
    let division = CandidateDivision::of_equal_runs(scene.spheres.len());
    let rank = communicator().rank();
    let candidates = state.contacts.iter().map(|solved| solved.contact.candidate);
    let contacts = state.contacts.iter().zip(division.owners(scene, candidates)).filter(|(_, owner)| *owner == rank);
    let contacts = contacts.map(|(solved, _)| *solved).collect();
    let candidates = state.interval.pair_virials.iter().map(|pair| pair.bodies[0]);
    let pair_virials = state.interval.pair_virials.iter().zip(division.owners(scene, candidates));
    let pair_virials = pair_virials.filter(|(_, owner)| *owner == rank).map(|(pair, _)| *pair).collect();
    (state.contacts, state.interval.pair_virials) = (contacts, pair_virials);
    state.detection_cache.division = Some(division);
}

/// Returns the contacts of all ranks and their virials of the output interval on rank 0, which receives them rank by rank;
/// empty lists on the others.
pub fn gather_contacts_to_first(state: &State) -> (Vec<SolvedContact>, Vec<PairVirial>) {
    let message = |solved: &SolvedContact| SolvedContactMessage::from(solved);
    let (mut contacts, mut pair_virials) = (Vec::new(), Vec::new());
    for from in 0..communicator().size() {
        let list = list_for_first(from, || state.contacts.iter().map(message).collect());
        contacts.extend(list.into_iter().map(SolvedContact::from));
        let list = list_for_first(from, || state.interval.pair_virials.iter().map(|pair| pair.to_words()).collect());
        pair_virials.extend(list.into_iter().map(PairVirial::from_words));
    }
    (contacts, pair_virials)
}

/// Returns the list of the rank `from` on rank 0, an empty list on the others.
fn list_for_first<T: Pod>(from: usize, list: impl FnOnce() -> Vec<T>) -> Vec<T> {
    let (rank, size) = (communicator().rank(), communicator().size());
    let own = if rank == from { list() } else { Vec::new() };
    let counts = all_gather_values(own.len() as u64);
    let mut outgoing = vec![Vec::new(); size];
    outgoing[0] = own;
    let count = |other: usize| if rank == 0 && other == from { counts[other] as usize } else { 0 };
    let mut lists = exchange_known_lists(outgoing, &(0..size).map(count).collect::<Vec<_>>());
    if rank == 0 { lists.swap_remove(from) } else { Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranks::threads::run_as_ranks;

    #[test]
    fn cuts_divide_the_pairs_evenly() {
        // The first of a thousand spheres are candidates of most pairs.
        let counts: Vec<u64> = (0..100).map(|group| 100 - group).collect();
        for size in [2, 3, 7] {
            let equal: Vec<u32> = (0..=size).map(|rank| rank * 1000 / size).collect();
            let cuts = even_cuts(&counts, 1000, &equal).unwrap();
            assert!(cuts[0] == 0 && cuts[size as usize] == 1000 && cuts.windows(2).all(|run| run[0] <= run[1]));
            let pairs = |run: &[u32]| counts[run[0] as usize / 10..run[1] as usize / 10].iter().sum::<u64>();
            let largest = cuts.windows(2).map(pairs).max().unwrap();
            // A group more than the mean of 5050 pairs.
            assert!(largest <= 5050 / u64::from(size) + 100, "{size}: {largest}");
            assert_eq!(even_cuts(&counts, 1000, &cuts), None);
        }
        assert_eq!(even_cuts(&[0; 8], 3, &[0, 1, 3]), None);
    }

    #[test]
    fn rank_0_gets_the_list_of_a_rank() {
        let found = run_as_ranks(3, |communicator| {
            [0, 1, 2].map(|from| list_for_first(from, || vec![communicator.rank() as u32; from + 1]))
        });
        assert_eq!(found, [[vec![0], vec![1, 1], vec![2, 2, 2]], [vec![], vec![], vec![]], [vec![], vec![], vec![]]]);
    }
}
