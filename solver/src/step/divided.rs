//! Steps whose contacts are divided among ranks, see [`CandidateDivision`](crate::state::CandidateDivision): the parts of a
//! step that need the contacts of other ranks.
//!
//! Totals are added in the order of one rank: chunks of the whole list, each in the order of its contacts. A chunk with
//! contacts of several ranks is handed on from one to the next.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::conflict::{can_be_in_conflict, conflict_among_rows, nearest_rows};
use super::totals::{ContactTotals, ITEMS_PER_TASK, Overlap, deeper_overlap};
use crate::assemble::{ConstraintNumbers, ContactConstraint, ContactProblem, stored_problem};
use crate::math::Vec3;
use crate::ranks::lists::{rank_lists, rank_values, whole_chunks};
use crate::ranks::{RankMessage, as_bytes, communicator, from_bytes, send_receive_counted};
use crate::scene::BodyId;
use crate::solve::{self, ContactSolution, SolveRequest};
use crate::state::numbers::ContactNumbers;
use crate::state::{Contact, ContactExchange, ContactId, SolvedContact};

/// Solves the contact problem of which each rank has a part of the rows; ranks that need other solvers than sweeps solve the
/// whole problem together.
pub fn solve_divided_problem(
    contact_problem: &mut ContactProblem,
    contacts: &[Contact],
    request: SolveRequest,
) -> ContactSolution {
    if let Some(solution) = solve::solve_in_parts(contact_problem, request) {
        return solution;
    }
    let (whole, first) = whole_problem(contact_problem);
    let numbers: Vec<ContactNumbers> = contacts.iter().map(ContactNumbers::from).collect();
    let contacts: Vec<Contact> = rank_lists(&numbers).into_iter().flatten().map(Contact::from).collect();
    let solution = solve::solve_contact_problem(&whole, request, |problem| stored_problem(problem, &contacts));
    let impulses = solution.impulses[first..first + contact_problem.rows.len()].to_vec();
    ContactSolution { impulses, ..solution }
}

/// Contact problem with the rows of all ranks, and the first row of this rank.
fn whole_problem(contact_problem: &ContactProblem) -> (ContactProblem, usize) {
    let numbers: Vec<ConstraintNumbers> =
        contact_problem.rows.iter().map(|row| ConstraintNumbers::new(row, 0)).collect();
    let lists = rank_lists(&numbers);
    let first = lists[..communicator().rank()].iter().map(Vec::len).sum();
    let rows = lists.into_iter().flatten().map(ContactConstraint::from).collect();
    let whole = ContactProblem::of_rows(rows, contact_problem.bodies.clone());
    (ContactProblem { order: contact_problem.order.clone(), ..whole }, first)
}

/// [`conflicting_bodies`](super::conflict::conflicting_bodies) of a problem of which each rank has a part of the rows; `worst`:
/// bodies of the contact with the largest residual. Each rank gathers the bodies of all rows, and the rows near the worst.
pub fn conflicting_bodies_of_ranks(
    contact_problem: &ContactProblem,
    worst: [BodyId; 2],
    tol: f64,
) -> Option<[BodyId; 2]> {
    let own_rows: Vec<usize> =
        (0..contact_problem.rows.len()).filter(|&k| can_be_in_conflict(contact_problem, k)).collect();
    let own_pairs: Vec<[u32; 2]> =
        own_rows.iter().map(|&k| contact_problem.rows[k].bodies.map(|body| body.0)).collect();
    let lists = rank_lists(&own_pairs);
    let first: usize = lists[..communicator().rank()].iter().map(Vec::len).sum();
    let pairs = lists.into_iter().flatten().enumerate().map(|(k, pair)| (k, pair.map(BodyId)));
    let nearest = nearest_rows(pairs, &contact_problem.bodies, worst);
    let own_row = |(position, &k): (u32, &usize)| {
        let row = own_rows.get(k.checked_sub(first)?)?;
        Some(ConstraintNumbers::new(&contact_problem.rows[*row], position))
    };
    let own: Vec<ConstraintNumbers> = (0..).zip(&nearest).filter_map(own_row).collect();
    let mut rows: Vec<ConstraintNumbers> = rank_lists(&own).into_iter().flatten().collect();
    rows.sort_unstable_by_key(|numbers| numbers.index);
    let rows: Vec<ContactConstraint> = rows.into_iter().map(ContactConstraint::from).collect();
    let positions: Vec<usize> = (0..rows.len()).collect();
    conflict_among_rows(ContactProblem::of_rows(rows, contact_problem.bodies.clone()), &positions, tol)
}

/// Contact of a row of the whole problem; `contacts`: those of this rank.
pub fn contact_of_ranks(row: ContactId, contacts: &[SolvedContact]) -> Option<Contact> {
    let counts: Vec<usize> = rank_values(contacts.len() as u64).into_iter().map(|count| count as usize).collect();
    let first: usize = counts[..communicator().rank()].iter().sum();
    let own: Option<&SolvedContact> = row.index().checked_sub(first).and_then(|k| contacts.get(k));
    let numbers: Vec<ContactNumbers> = own.iter().map(|solved| ContactNumbers::from(&solved.contact)).collect();
    rank_lists(&numbers).into_iter().flatten().next().map(Contact::from)
}

/// Deepest overlap of all ranks, the first if there are several.
pub fn deepest_overlap_of_ranks(own: Option<Overlap>) -> Option<Overlap> {
    rank_values(OverlapNumbers::from(own)).into_iter().filter_map(Option::from).fold(None, deeper_overlap)
}

/// Totals of a part of the contacts, and their sums for pairs of bodies.
type FinishedChunk = (ContactTotals, Vec<ContactExchange>);

/// Fills the ends of the contacts of this rank. Returns the totals of the chunks of all ranks, and the sums for pairs of
/// bodies of this rank.
///
/// `finish_chunk` fills the ends of contacts, the first of which has this index on this rank, and returns these totals with
/// theirs.
pub fn finish_divided_contacts(
    contacts: &[Contact],
    ends: &mut [SolvedContact],
    finish_chunk: impl Fn(usize, &[Contact], &mut [SolvedContact], ContactTotals) -> FinishedChunk + Sync,
) -> (Vec<ContactTotals>, Vec<Vec<ContactExchange>>) {
    let (rank, size) = (communicator().rank(), communicator().size());
    let start: usize = rank_values(contacts.len() as u64)[..rank].iter().map(|&count| count as usize).sum();
    let end = start + contacts.len();
    let [head, _] = whole_chunks(start, contacts.len(), ITEMS_PER_TASK);
    let continues_chunk = !start.is_multiple_of(ITEMS_PER_TASK);
    let leaves_chunk = !end.is_multiple_of(ITEMS_PER_TASK) && rank + 1 < size;
    // Whether all contacts of this rank are in the chunk that the rank before has begun.
    let hands_on = continues_chunk && head == contacts.len() && leaves_chunk;

    let (head_ends, later_ends) = ends.split_at_mut(head);
    let later = later_ends.par_chunks_mut(ITEMS_PER_TASK).zip(contacts[head..].par_chunks(ITEMS_PER_TASK)).enumerate();
    let later = later.map(|(part, (ends, contacts))| {
        finish_chunk(head + part * ITEMS_PER_TASK, contacts, ends, ContactTotals::default())
    });
    let (mut later_totals, later_exchanges): (Vec<ContactTotals>, Vec<Vec<ContactExchange>>) = later.unzip();
    let begun = (leaves_chunk && !hands_on).then(|| later_totals.pop().unwrap_or_default());
    let before = exchange_totals(begun, continues_chunk);
    let (head_totals, head_exchanges) = finish_chunk(0, &contacts[..head], head_ends, before);
    if hands_on {
        exchange_totals(Some(head_totals), false);
    }
    let own = (continues_chunk && !hands_on).then_some(head_totals).into_iter().chain(later_totals);
    let own: Vec<TotalsNumbers> = own.map(TotalsNumbers::from).collect();
    let all = rank_lists(&own).into_iter().flatten().map(ContactTotals::from).collect();
    (all, [head_exchanges].into_iter().chain(later_exchanges).collect())
}

/// Sends the totals of a chunk that this rank has begun to the next rank, if there is one, and returns those of the rank
/// before, if `receives`.
fn exchange_totals(begun: Option<ContactTotals>, receives: bool) -> ContactTotals {
    let rank = communicator().rank();
    let message = |totals| RankMessage { rank: rank + 1, bytes: as_bytes(&[TotalsNumbers::from(totals)]).to_vec() };
    let outgoing: Vec<RankMessage> = begun.map(message).into_iter().collect();
    let mut incoming = Vec::new();
    if receives {
        incoming.push(RankMessage { rank: rank - 1, bytes: vec![0; size_of::<TotalsNumbers>()] });
    }
    send_receive_counted(communicator(), &outgoing, &mut incoming);
    let numbers = incoming.first().and_then(|message| from_bytes::<TotalsNumbers>(&message.bytes).pop());
    numbers.map_or(ContactTotals::default(), ContactTotals::from)
}

/// [`Overlap`] as ranks exchange it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct OverlapNumbers {
    bodies: [u32; 2],
    depth: f64,
    share: f64,
    /// 1 for an overlap, 0 for none.
    exists: u64,
}

impl From<Option<Overlap>> for OverlapNumbers {
    fn from(overlap: Option<Overlap>) -> Self {
        overlap.map_or(OverlapNumbers::zeroed(), |Overlap { bodies, depth, share }| OverlapNumbers {
            bodies: bodies.map(|body| body.0),
            depth,
            share,
            exists: 1,
        })
    }
}

impl From<OverlapNumbers> for Option<Overlap> {
    fn from(OverlapNumbers { bodies, depth, share, exists }: OverlapNumbers) -> Self {
        (exists > 0).then(|| Overlap { bodies: bodies.map(BodyId), depth, share })
    }
}

/// [`ContactTotals`] as ranks exchange them.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct TotalsNumbers {
    contacts_active: u64,
    overlaps: [OverlapNumbers; 2],
    /// Largest penetration, sums of penetrations, works and virial.
    scalars: [f64; 7],
    /// Momentum and angular momentum.
    vectors: [[f64; 3]; 2],
}

impl From<ContactTotals> for TotalsNumbers {
    fn from(totals: ContactTotals) -> Self {
        TotalsNumbers {
            contacts_active: totals.contacts_active as u64,
            overlaps: [totals.overlap.into(), totals.inert_overlap.into()],
            scalars: [
                totals.penetration_largest,
                totals.penetration_sum,
                totals.penetration_added,
                totals.contact_work,
                totals.friction_work,
                totals.virial,
                totals.outside_work,
            ],
            vectors: [totals.momentum.into(), totals.angular_momentum.into()],
        }
    }
}

impl From<TotalsNumbers> for ContactTotals {
    fn from(TotalsNumbers { contacts_active, overlaps, scalars, vectors }: TotalsNumbers) -> Self {
        let [
            penetration_largest,
            penetration_sum,
            penetration_added,
            contact_work,
            friction_work,
            virial,
            outside_work,
        ] = scalars;
        let [momentum, angular_momentum] = vectors.map(Vec3::from);
        let [overlap, inert_overlap] = overlaps.map(Into::into);
        ContactTotals {
            contacts_active: contacts_active as usize,
            overlap,
            inert_overlap,
            penetration_largest,
            penetration_sum,
            penetration_added,
            contact_work,
            friction_work,
            virial,
            outside_work,
            momentum,
            angular_momentum,
        }
    }
}
