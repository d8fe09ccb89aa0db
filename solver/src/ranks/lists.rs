//! Lists of which each rank has a part: agreement on flags and numbers, exchange of items, and results of chunks that do not
//! depend on the parts.
//!
//! All functions but `whole_chunks` are collective: all ranks call them. They are exact: numbers are compared, counted or
//! passed on, and floating-point numbers are never added in another order.

use bytemuck::Pod;

use super::{RankMessage, all_gather_counted, as_bytes, communicator, count_list_bytes, from_bytes};

/// Returns on every rank whether the flag of any rank is set.
pub fn any_rank(flag: bool) -> bool {
    all_gather_values(u8::from(flag)).contains(&1)
}

/// Returns the sum of the counts of all ranks on every rank.
pub fn sum_over_ranks(own: usize) -> usize {
    all_gather_values(own as u64).iter().sum::<u64>() as usize
}

/// Returns the largest number of all ranks on every rank; numbers are not NaN.
pub fn max_over_ranks(own: f64) -> f64 {
    all_gather_values(own).into_iter().fold(own, f64::max)
}

/// Returns the smallest number of all ranks on every rank; numbers are not NaN.
pub fn min_over_ranks(own: f64) -> f64 {
    all_gather_values(own).into_iter().fold(own, f64::min)
}

/// Returns the values of all ranks, by rank, on every rank.
pub fn all_gather_values<T: Pod>(own: T) -> Vec<T> {
    let communicator = communicator();
    from_bytes(&all_gather_counted(communicator, as_bytes(&[own]), &vec![size_of::<T>(); communicator.size()]))
}

/// Returns the lists of all ranks, by rank, on every rank; their lengths may differ.
pub fn all_gather_lists<T: Pod>(own: &[T]) -> Vec<Vec<T>> {
    let counts = all_gather_values(own.len() as u64);
    let lengths: Vec<usize> = counts.iter().map(|&count| count as usize * size_of::<T>()).collect();
    let all = all_gather_counted(communicator(), as_bytes(own), &lengths);
    let mut rest = &all[..];
    let mut take_list = |&length: &usize| {
        let (list, later) = rest.split_at(length);
        rest = later;
        from_bytes(list)
    };
    lengths.iter().map(&mut take_list).collect()
}

/// All-to-all exchange: sends each rank the list at its index, and returns the lists from all ranks, by rank.
pub fn exchange_lists<T: Pod>(outgoing: Vec<Vec<T>>) -> Vec<Vec<T>> {
    let communicator = communicator();
    let (rank, size) = (communicator.rank(), communicator.size());
    let counts: Vec<u64> = outgoing.iter().map(|list| list.len() as u64).collect();
    let all_counts: Vec<u64> =
        from_bytes(&all_gather_counted(communicator, as_bytes(&counts), &vec![size * size_of::<u64>(); size]));
    let counts: Vec<usize> = (0..size).map(|from| all_counts[from * size + rank] as usize).collect();
    exchange_known_lists(outgoing, &counts)
}

/// [`exchange_lists`] if the number of items from each rank is known.
pub fn exchange_known_lists<T: Pod>(mut outgoing: Vec<Vec<T>>, counts: &[usize]) -> Vec<Vec<T>> {
    let communicator = communicator();
    let rank = communicator.rank();
    let own = std::mem::take(&mut outgoing[rank]);
    let message_to = |(to, list): (usize, Vec<T>)| {
        (!list.is_empty()).then(|| RankMessage { rank: to, bytes: as_bytes(&list).to_vec() })
    };
    let outgoing: Vec<RankMessage> = outgoing.into_iter().enumerate().filter_map(message_to).collect();
    let buffer_from = |(from, &count): (usize, &usize)| {
        (from != rank && count > 0).then(|| RankMessage { rank: from, bytes: vec![0; count * size_of::<T>()] })
    };
    let mut incoming: Vec<RankMessage> = counts.iter().enumerate().filter_map(buffer_from).collect();
    count_list_bytes(outgoing.iter().map(|message| message.bytes.len()).sum());
    communicator.send_receive(&outgoing, &mut incoming);
    drop(outgoing);
    let mut lists: Vec<Vec<T>> = counts.iter().map(|_| Vec::new()).collect();
    incoming.into_iter().for_each(|message| lists[message.rank] = from_bytes(&message.bytes));
    lists[rank] = own;
    lists
}

/// Results of the chunks of `chunk_length` items of a list whose parts the ranks hold one after the other, on every rank.
///
/// A rank evaluates the chunks that lie in its part. Items of other chunks are gathered, and evaluated by every rank: at most
/// two times `chunk_length` a rank.
pub fn chunk_results<T: Pod + Sync, R: Pod + Send>(
    part: &[T],
    chunk_length: usize,
    evaluate: impl Fn(&[T]) -> R + Sync,
) -> Vec<R> {
    use rayon::prelude::*;
    let counts: Vec<usize> = all_gather_values(part.len() as u64).into_iter().map(|count| count as usize).collect();
    let rank = communicator().rank();
    let start: usize = counts[..rank].iter().sum();
    let [head, whole] = whole_chunks(start, part.len(), chunk_length);
    let own: Vec<R> = part[head..head + whole].par_chunks_exact(chunk_length).map(&evaluate).collect();
    let mut results = all_gather_lists(&own).into_iter();
    let mut ends = all_gather_lists(&[&part[..head], &part[head + whole..]].concat()).into_iter();
    // `unfinished`: items of the chunk that is not complete yet.
    let (mut all, mut unfinished, mut start) = (Vec::new(), Vec::<T>::new(), 0);
    for count in counts {
        let [head, _] = whole_chunks(start, count, chunk_length);
        let (mut results, ends) = (results.next().unwrap_or_default(), ends.next().unwrap_or_default());
        let (head, tail) = ends.split_at(head);
        unfinished.extend_from_slice(head);
        if unfinished.len() == chunk_length {
            all.push(evaluate(&std::mem::take(&mut unfinished)));
        }
        all.append(&mut results);
        unfinished.extend_from_slice(tail);
        start += count;
    }
    if !unfinished.is_empty() {
        all.push(evaluate(&unfinished));
    }
    all
}

/// Number of items before the first whole chunk, and in whole chunks, of a part of `count` items from `start` on.
///
/// ```
/// # use cd_solve::ranks::lists::whole_chunks;
/// assert_eq!([whole_chunks(0, 9, 4), whole_chunks(3, 9, 4), whole_chunks(5, 2, 4)], [[0, 8], [1, 8], [2, 0]]);
/// ```
pub fn whole_chunks(start: usize, count: usize, chunk_length: usize) -> [usize; 2] {
    let head = (start.next_multiple_of(chunk_length) - start).min(count);
    [head, (count - head) / chunk_length * chunk_length]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranks::threads::run_as_ranks;

    #[test]
    fn ranks_agree_on_flags_and_numbers() {
        let found = run_as_ranks(3, |communicator| {
            let rank = communicator.rank();
            let flags = [any_rank(rank == 2), any_rank(rank > 5)];
            let own = rank as f64;
            (flags, sum_over_ranks(rank + 1), max_over_ranks(own), min_over_ranks(own))
        });
        assert!(found.iter().all(|found| *found == ([true, false], 6, 2.0, 0.0)), "{found:?}");
    }

    #[test]
    fn each_rank_gets_the_list_that_is_sent_to_it() {
        for size in 1..=4 {
            // From rank a to rank b a list of a + b items, none from the last rank to the first.
            let count = |from: usize, to: usize| if from + 1 == size && to == 0 { 0 } else { from + to };
            let found = run_as_ranks(size, |communicator| {
                let rank = communicator.rank();
                exchange_lists((0..size).map(|to| vec![[rank as u32, to as u32]; count(rank, to)]).collect())
            });
            for (to, lists) in found.into_iter().enumerate() {
                for (from, list) in lists.into_iter().enumerate() {
                    assert_eq!(list, vec![[from as u32, to as u32]; count(from, to)], "{from} to {to} of {size}");
                }
            }
        }
    }

    /// Chunks of numbers whose sum depends on the order of the terms, in parts of any length, some of them empty.
    #[test]
    fn parts_change_no_result_of_a_chunk() {
        let items: Vec<f64> = (0..50).map(|k| 1.0 / f64::from(k + 3)).collect();
        let sum = |chunk: &[f64]| chunk.iter().fold(0.0, |sum, x| sum + x);
        for ends in [[0, 0, 50], [7, 7, 9], [16, 32, 48], [8, 30, 50], [1, 2, 3], [50, 50, 50], [5, 6, 40]] {
            let found = run_as_ranks(4, |communicator| {
                let starts = [0, ends[0], ends[1], ends[2], 50];
                let rank = communicator.rank();
                chunk_results(&items[starts[rank]..starts[rank + 1]], 8, sum)
            });
            let expected: Vec<f64> = items.chunks(8).map(sum).collect();
            assert!(found.iter().all(|found| *found == expected), "{ends:?}: {found:?}");
        }
        let none = run_as_ranks(2, |_| chunk_results(&[], 8, sum));
        assert!(none.iter().all(Vec::is_empty));
    }
}
