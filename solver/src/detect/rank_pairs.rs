//! Division of the narrow phase among the ranks of a run, in scenes of polyhedra.
//!
//! A rank computes the contacts of a contiguous range of the listed pairs. All ranks gather these contacts, and the cached
//! features, which break ties between directions in later steps. A separating axis stays with the rank that has found it: it affects only
//! time.

use std::ops::Range;

use crate::geometry::CachedFeature;
use crate::ranks::{all_gather_unsized, as_bytes, communicator, from_bytes, part_range};
use crate::scene::Scene;
use crate::state::Contact;
use crate::state::messages::ContactMessage;

/// Smallest number of pairs that are divided among ranks. Chosen: at 0.6 to 1 µs a pair they take some 0.2 ms, and their
/// contacts have some 0.1 MB.
const MIN_DIVIDED_PAIRS: usize = 256;

/// Pairs of this rank among `count`, in a scene whose pairs take longer than the exchange of their contacts; `None` if
/// every rank computes all pairs.
pub fn own_pairs(scene: &Scene, count: usize) -> Option<Range<usize>> {
    let (rank, size) = (communicator().rank(), communicator().size());
    let is_divided = size > 1 && count >= MIN_DIVIDED_PAIRS && scene.has_polyhedra();
    is_divided.then(|| part_range(count, rank, size))
}

/// Returns the contacts of all pairs by rank, on every rank, and sets the cached features of the pairs of other ranks.
///
/// * `contacts`: contacts of the pairs of this rank, see [`own_pairs`], in the order of the pairs.
/// * `memories`: cached features of all pairs, of which this rank has set its own.
pub fn gather_contacts<'a>(
    contacts: impl Iterator<Item = &'a Contact>,
    memories: &mut [CachedFeature],
) -> Vec<Vec<Contact>> {
    let communicator = communicator();
    let (count, size) = (memories.len(), communicator.size());
    let own_memories = &memories[part_range(count, communicator.rank(), size)];
    let words: Vec<[u64; 2]> = own_memories.iter().map(CachedFeature::to_words).collect();
    let messages: Vec<ContactMessage> = contacts.map(ContactMessage::from).collect();
    let all = all_gather_unsized(communicator, &[as_bytes(&words), as_bytes(&messages)].concat());
    let mut contacts_of = |(rank, bytes): (usize, &Vec<u8>)| {
        let pairs = part_range(count, rank, size);
        let (words, messages) = bytes.split_at(size_of::<[u64; 2]>() * pairs.len());
        for (memory, words) in memories[pairs].iter_mut().zip(from_bytes(words)) {
            *memory = CachedFeature::from_words(words);
        }
        from_bytes::<ContactMessage>(messages).into_iter().map(Contact::from).collect()
    };
    all.iter().enumerate().map(&mut contacts_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::ranks::threads::run_as_ranks;
    use crate::scene::{BodyId, LawId};

    /// Seven pairs, of which the pair `k` has `k` contacts.
    #[test]
    fn all_ranks_have_the_contacts_and_features_of_one() {
        let contact = |pair: u32, k: u32| Contact {
            candidate: BodyId(pair),
            antagonist: BodyId(k),
            part_numbers: [pair as u16, k as u16].into(),
            features: [u32::MAX - pair, k].into(),
            point: Vec3::new(f64::from(pair), -0.0, f64::MIN_POSITIVE),
            image: Vec3::new(1.0, 2.0, 3.0),
            normal: Vec3::z(),
            gap: -f64::from(k),
            area: 0.25,
            law: LawId(255),
        };
        let contacts_of = |pairs: Range<usize>| -> Vec<Contact> {
            pairs.flat_map(|pair| (0..pair as u32).map(move |k| contact(pair as u32, k))).collect()
        };
        let feature = |pair: usize| CachedFeature::from_words([3 << 32 | pair as u64, (pair as u64) << 32 | 9]);
        let expected = (contacts_of(0..7), (0..7).map(feature).collect::<Vec<_>>());
        for size in [1, 2, 3, 8] {
            let found = run_as_ranks(size, |communicator| {
                let own = part_range(7, communicator.rank(), size);
                let mut memories = vec![CachedFeature::default(); 7];
                own.clone().for_each(|pair| memories[pair] = feature(pair));
                (gather_contacts(contacts_of(own).iter(), &mut memories).concat(), memories)
            });
            assert!(found.iter().all(|found| *found == expected), "{size}");
        }
    }
}
