//! Agreement of the ranks of a run: on its input, on its state, and on its end.

use std::fmt::Display;
use std::hash::{DefaultHasher, Hash, Hasher};

use cd_formats::error::{Fault, Faults};

use crate::activity;
use crate::ranks::{Communicator, all_gather_unsized};
use crate::scene::Scene;
use crate::state::State;

/// Returns the case that this rank has read if all ranks have read the same.
///
/// Errors: the faults of this rank; if it has none, the faults of the first rank that has some, or a fault that names the
/// first rank with other input than rank 0. Only rank 0 prints them. Faults of rank 0 alone, such as a locked folder,
/// are faults of all ranks.
pub fn agreed_case<T, E: Display + From<Faults>>(
    communicator: &dyn Communicator,
    read: Result<T, E>,
    data: impl Fn(&T) -> (&Scene, &State),
) -> Result<T, E> {
    if communicator.size() == 1 {
        return read;
    }
    // The first byte is 0 before a digest of the input, or 1 before the text of faults.
    let own_message = match &read {
        Ok(case) => {
            let (scene, state) = data(case);
            [&[0][..], &input_digest(scene, state).to_le_bytes()].concat()
        }
        Err(failure) => [&[1], failure.to_string().as_bytes()].concat(),
    };
    let messages = all_gather_unsized(communicator, &own_message);
    let case = read?;
    for (rank, message) in messages.iter().enumerate() {
        let object = format!("rank {rank}");
        if message[0] != 0 {
            let found = format!("has rejected it: {}", String::from_utf8_lossy(&message[1..]).trim_end());
            let expected = "expected a folder that all ranks can read";
            return Err(Faults::from(Fault::new("case".as_ref(), None, object, found, expected)).into());
        }
        if *message != messages[0] {
            let found = "has read other input than rank 0";
            let expected = "expected one DATBOX and OUTBOX, in a folder that all ranks share";
            return Err(Faults::from(Fault::new("case".as_ref(), None, object, found, expected)).into());
        }
    }
    Ok(case)
}

/// Difference between the states of two ranks after a step, an internal error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateMismatch {
    pub step: u64,
    /// First rank whose state differs from that of rank 0.
    pub rank: usize,
}

impl Display for StateMismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let StateMismatch { step, rank } = self;
        write!(f, "step {step}: rank {rank} has another state than rank 0; snapshots written before are valid")
    }
}

impl std::error::Error for StateMismatch {}

/// Compares the states of all ranks, and stops all if any of them was requested to stop. All ranks call it after each
/// step.
///
/// Errors: the ranks have different states.
pub fn agree_on_step(communicator: &dyn Communicator, state: &State) -> Result<(), StateMismatch> {
    if communicator.size() == 1 {
        return Ok(());
    }
    let digest = state_digest(state).to_le_bytes();
    let own_message = [&digest[..], &[u8::from(activity::is_stop_requested())]].concat();
    let gathered = communicator.all_gather(&own_message, &vec![own_message.len(); communicator.size()]);
    let messages: Vec<&[u8]> = gathered.chunks_exact(own_message.len()).collect();
    if messages.iter().any(|message| message.last() == Some(&1)) {
        activity::agree_to_stop();
    }
    let is_different = |message: &&[u8]| message[..digest.len()] != messages[0][..digest.len()];
    match messages.iter().position(is_different) {
        Some(rank) => Err(StateMismatch { step: state.step, rank }),
        None => Ok(()),
    }
}

/// Digest of the state, options, laws, ledger, masses and radii at the start of a run.
fn input_digest(scene: &Scene, state: &State) -> u64 {
    let mut hasher = DefaultHasher::new();
    state_digest(state).hash(&mut hasher);
    format!("{:?} {:?} {:?}", scene.options, state.laws, state.ledger).hash(&mut hasher);
    for body in &scene.bodies {
        [body.mass, body.radius].map(f64::to_bits).hash(&mut hasher);
    }
    hasher.finish()
}

/// Digest of the step, positions, orientations and velocities.
fn state_digest(state: &State) -> u64 {
    let vectors = [&state.x, &state.v, &state.w].into_iter().flatten().flat_map(|v| [v.x, v.y, v.z]);
    let quaternions = state.q.iter().flat_map(|q| [q.w, q.i, q.j, q.k]);
    // FNV-1a with its prime and initial value, on numbers in place of bytes. The rotation carries the exponents of numbers
    // to the low bits.
    let mix =
        |digest: u64, number: f64| (digest ^ number.to_bits()).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    vectors.chain(quaternions).fold(state.step ^ 0xcbf2_9ce4_8422_2325, mix)
}
