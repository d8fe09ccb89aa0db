//! Collective operations of a step whose contacts are divided among ranks, see
//! [`CandidateDivision`](crate::state::CandidateDivision): all ranks call them, each with its own part of the contacts.
//!
//! Totals are added in the order of one rank: chunks of the whole list, each in the order of its contacts. If a chunk has
//! contacts of several ranks, each of them adds its own to the totals and sends these to the next rank.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::conflict::{can_be_in_conflict, conflict_among_rows, nearest_rows};
use super::totals::{ContactTotals, ITEMS_PER_TASK, Overlap, deeper_overlap};
use crate::assemble::{ConstraintMessage, ContactConstraint, ContactProblem, stored_problem};
use crate::ranks::lists::{all_gather_lists, all_gather_values, whole_chunks};
use crate::ranks::{RankMessage, as_bytes, communicator, from_bytes, send_receive_counted};
use crate::scene::BodyId;
use crate::solve::{self, ContactSolution, SolveRequest};
use crate::state::messages::ContactMessage;
use crate::state::{Contact, ContactId, PairVirial, SolvedContact};

/// Solves the contact problem of which each rank has a part of the rows; a problem that needs another solver than sweeps is
/// gathered and solved by each rank. Returns the solution with the impulses of the rows of this rank.
pub fn solve_divided_problem(
    contact_problem: &mut ContactProblem,
    contacts: &[Contact],
    request: SolveRequest,
) -> ContactSolution {
    if let Some(solution) = solve::solve_in_parts(contact_problem, request) {
        return solution;
    }
    let (whole, first) = whole_problem(contact_problem);
    let messages: Vec<ContactMessage> = contacts.iter().map(ContactMessage::from).collect();
    let contacts: Vec<Contact> = all_gather_lists(&messages).into_iter().flatten().map(Contact::from).collect();
    let solution = solve::solve_contact_problem(&whole, request, |problem| stored_problem(problem, &contacts));
    let impulses = solution.impulses[first..first + contact_problem.rows.len()].to_vec();
    ContactSolution { impulses, ..solution }
}

/// Returns the contact problem with the rows of all ranks, and the index of the first row of this rank in it.
fn whole_problem(contact_problem: &ContactProblem) -> (ContactProblem, usize) {
    let messages: Vec<ConstraintMessage> =
        contact_problem.rows.iter().map(|row| ConstraintMessage::new(row, 0)).collect();
    let lists = all_gather_lists(&messages);
    let first = lists[..communicator().rank()].iter().map(Vec::len).sum();
    let rows = lists.into_iter().flatten().map(ContactConstraint::from).collect();
    let whole = ContactProblem::of_rows(rows, contact_problem.bodies.clone());
    (ContactProblem { order: contact_problem.order.clone(), ..whole }, first)
}

/// Searches for a conflict as [`conflicting_bodies`](super::conflict::conflicting_bodies) does, in a problem of which each rank has
/// a part of the rows. Returns on every rank the bodies of the contact with the largest part in it; `None` if there is none.
///
/// `worst`: bodies of the contact with the largest residual; `tol`: tolerance of the residual. Gathers the bodies of the rows
/// that can be in conflict, then the rows nearest to `worst`.
pub fn conflicting_bodies_of_ranks(
    contact_problem: &ContactProblem,
    worst: [BodyId; 2],
    tol: f64,
) -> Option<[BodyId; 2]> {
    let own_rows: Vec<usize> =
        (0..contact_problem.rows.len()).filter(|&k| can_be_in_conflict(contact_problem, k)).collect();
    let own_pairs: Vec<[u32; 2]> =
        own_rows.iter().map(|&k| contact_problem.rows[k].bodies.map(|body| body.0)).collect();
    let lists = all_gather_lists(&own_pairs);
    let first: usize = lists[..communicator().rank()].iter().map(Vec::len).sum();
    let pairs = lists.into_iter().flatten().enumerate().map(|(k, pair)| (k, pair.map(BodyId)));
    let nearest = nearest_rows(pairs, &contact_problem.bodies, worst);
    let own_row = |(position, &k): (u32, &usize)| {
        let row = own_rows.get(k.checked_sub(first)?)?;
        Some(ConstraintMessage::new(&contact_problem.rows[*row], position))
    };
    let own: Vec<ConstraintMessage> = (0..).zip(&nearest).filter_map(own_row).collect();
    let mut rows: Vec<ConstraintMessage> = all_gather_lists(&own).into_iter().flatten().collect();
    rows.sort_unstable_by_key(|message| message.index);
    let rows: Vec<ContactConstraint> = rows.into_iter().map(ContactConstraint::from).collect();
    let positions: Vec<usize> = (0..rows.len()).collect();
    conflict_among_rows(ContactProblem::of_rows(rows, contact_problem.bodies.clone()), &positions, tol)
}

/// Returns on every rank the contact of `row` of the whole problem; `None` without such a row. `contacts`: those of this rank.
pub fn contact_of_ranks(row: ContactId, contacts: &[SolvedContact]) -> Option<Contact> {
    let counts: Vec<usize> = all_gather_values(contacts.len() as u64).into_iter().map(|count| count as usize).collect();
    let first: usize = counts[..communicator().rank()].iter().sum();
    let own: Option<&SolvedContact> = row.index().checked_sub(first).and_then(|k| contacts.get(k));
    let messages: Vec<ContactMessage> = own.iter().map(|solved| ContactMessage::from(&solved.contact)).collect();
    all_gather_lists(&messages).into_iter().flatten().next().map(Contact::from)
}

/// Returns on every rank the overlap of all ranks with the largest ratio to the smaller radius, the first if there are several.
pub fn deepest_overlap_of_ranks(own: Option<Overlap>) -> Option<Overlap> {
    all_gather_values(OverlapMessage::from(own)).into_iter().filter_map(Option::from).fold(None, deeper_overlap)
}

/// Totals of a part of the contacts, and the virials of their pairs of bodies.
type FinishedChunk = (ContactTotals, Vec<PairVirial>);

/// Writes the contacts of this rank at the end of the step to `solved_contacts`. Returns the totals of the chunks of all
/// ranks, and the virials of the pairs of bodies of this rank.
///
/// * `contacts`: contacts of this rank; `solved_contacts` has as many.
/// * `finish_chunk(first, contacts, solved_contacts, totals)`: writes contacts, the first of which has the index `first` on
///   this rank; returns `totals` plus their totals, and their virials.
pub fn finish_divided_contacts(
    contacts: &[Contact],
    solved_contacts: &mut [SolvedContact],
    finish_chunk: impl Fn(usize, &[Contact], &mut [SolvedContact], ContactTotals) -> FinishedChunk + Sync,
) -> (Vec<ContactTotals>, Vec<Vec<PairVirial>>) {
    let (rank, size) = (communicator().rank(), communicator().size());
    let start: usize = all_gather_values(contacts.len() as u64)[..rank].iter().map(|&count| count as usize).sum();
    let end = start + contacts.len();
    let [head, _] = whole_chunks(start, contacts.len(), ITEMS_PER_TASK);
    let begins_inside_chunk = !start.is_multiple_of(ITEMS_PER_TASK);
    let ends_inside_chunk = !end.is_multiple_of(ITEMS_PER_TASK) && rank + 1 < size;
    // Whether this rank has only a middle part of a chunk, whose totals it receives from the previous rank and sends to the next.
    let has_middle_part = begins_inside_chunk && head == contacts.len() && ends_inside_chunk;

    let (head_contacts, later_contacts) = solved_contacts.split_at_mut(head);
    let chunks = later_contacts.par_chunks_mut(ITEMS_PER_TASK).zip(contacts[head..].par_chunks(ITEMS_PER_TASK));
    let later = chunks.enumerate().map(|(chunk, (solved_contacts, contacts))| {
        finish_chunk(head + chunk * ITEMS_PER_TASK, contacts, solved_contacts, ContactTotals::default())
    });
    let (mut later_totals, later_virials): (Vec<ContactTotals>, Vec<Vec<PairVirial>>) = later.unzip();
    let unfinished = (ends_inside_chunk && !has_middle_part).then(|| later_totals.pop().unwrap_or_default());
    let totals_before = pass_totals(unfinished, begins_inside_chunk);
    let (head_totals, head_virials) = finish_chunk(0, &contacts[..head], head_contacts, totals_before);
    if has_middle_part {
        pass_totals(Some(head_totals), false);
    }
    let own = (begins_inside_chunk && !has_middle_part).then_some(head_totals).into_iter().chain(later_totals);
    let own: Vec<TotalsMessage> = own.map(TotalsMessage::from).collect();
    let all = all_gather_lists(&own).into_iter().flatten().map(ContactTotals::from).collect();
    (all, [head_virials].into_iter().chain(later_virials).collect())
}

/// Sends the totals of an unfinished chunk to the next rank, if there are any. Returns those that the previous rank has sent if
/// `receives`, else zeros.
fn pass_totals(unfinished: Option<ContactTotals>, receives: bool) -> ContactTotals {
    let rank = communicator().rank();
    let message = |totals| RankMessage { rank: rank + 1, bytes: as_bytes(&[TotalsMessage::from(totals)]).to_vec() };
    let outgoing: Vec<RankMessage> = unfinished.map(message).into_iter().collect();
    let mut incoming = Vec::new();
    if receives {
        incoming.push(RankMessage { rank: rank - 1, bytes: vec![0; size_of::<TotalsMessage>()] });
    }
    send_receive_counted(communicator(), &outgoing, &mut incoming);
    let received = incoming.first().and_then(|message| from_bytes::<TotalsMessage>(&message.bytes).pop());
    received.map_or(ContactTotals::default(), ContactTotals::from)
}

/// [`Overlap`] in fields of fixed size, as ranks send it to each other.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct OverlapMessage {
    bodies: [u32; 2],
    depth: f64,
    /// Ratio of the depth to the smaller radius.
    share: f64,
    /// 1 for an overlap, 0 for none.
    exists: u64,
}

impl From<Option<Overlap>> for OverlapMessage {
    fn from(overlap: Option<Overlap>) -> Self {
        overlap.map_or(OverlapMessage::zeroed(), |Overlap { bodies, depth, share }| OverlapMessage {
            bodies: bodies.map(|body| body.0),
            depth,
            share,
            exists: 1,
        })
    }
}

impl From<OverlapMessage> for Option<Overlap> {
    fn from(OverlapMessage { bodies, depth, share, exists }: OverlapMessage) -> Self {
        (exists > 0).then(|| Overlap { bodies: bodies.map(BodyId), depth, share })
    }
}

/// [`ContactTotals`] in fields of fixed size, as ranks send them to each other.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct TotalsMessage {
    contacts_active: u64,
    overlap: OverlapMessage,
    inert_overlap: OverlapMessage,
    penetration_largest: f64,
    penetration_sum: f64,
    penetration_added: f64,
    contact_work: f64,
    friction_work: f64,
    virial: f64,
    normal_moments: [f64; 3],
    outside_work: f64,
    driven_impulse: [f64; 3],
    angular_momentum_change: [f64; 3],
}

impl From<ContactTotals> for TotalsMessage {
    fn from(totals: ContactTotals) -> Self {
        TotalsMessage {
            contacts_active: totals.contacts_active as u64,
            overlap: totals.overlap.into(),
            inert_overlap: totals.inert_overlap.into(),
            penetration_largest: totals.penetration_largest,
            penetration_sum: totals.penetration_sum,
            penetration_added: totals.penetration_added,
            contact_work: totals.contact_work,
            friction_work: totals.friction_work,
            virial: totals.virial,
            normal_moments: totals.normal_moments.into(),
            outside_work: totals.outside_work,
            driven_impulse: totals.driven_impulse.into(),
            angular_momentum_change: totals.angular_momentum_change.into(),
        }
    }
}

impl From<TotalsMessage> for ContactTotals {
    fn from(message: TotalsMessage) -> Self {
        ContactTotals {
            contacts_active: message.contacts_active as usize,
            overlap: message.overlap.into(),
            inert_overlap: message.inert_overlap.into(),
            penetration_largest: message.penetration_largest,
            penetration_sum: message.penetration_sum,
            penetration_added: message.penetration_added,
            contact_work: message.contact_work,
            friction_work: message.friction_work,
            virial: message.virial,
            normal_moments: message.normal_moments.into(),
            outside_work: message.outside_work,
            driven_impulse: message.driven_impulse.into(),
            angular_momentum_change: message.angular_momentum_change.into(),
        }
    }
}
