//! Exchange with another program at the start of each step: the state is written, forces are read.
//!
//! All numbers are little-endian. First the eight bytes `CDSTEPS1` and the number N of bodies (u64) are written. For each
//! step `3 + 13 N` numbers (f64) are written: step, time (s) and length of the step (s), then for all bodies, in the order
//! of BODIES.DAT, the positions (m), the quaternions (w, x, y, z), the velocities (m/s) and the angular velocities
//! (rad/s, fixed axes). The answer has `6 N` numbers (f64): force (N) and torque (N m) on each body, in fixed axes, the
//! force at the centre of mass.

use std::io::{ErrorKind, Read, Write};

use cd_formats::error::{Fault, Faults};

use crate::math::Vec3;
use crate::scene::{BodyId, Scene};
use crate::state::{BodyLoad, State};

const MAGIC: &[u8; 8] = b"CDSTEPS1";

/// Numbers at the start of a step: step, time and length of the step.
const STEP_NUMBERS: usize = 3;

/// Numbers of a body at the start of a step: position, quaternion, velocity and angular velocity.
const BODY_NUMBERS: usize = 3 + 4 + 3 + 3;

/// Numbers of a body in the answer: force and torque.
const LOAD_NUMBERS: usize = 6;

/// Exchange over a pair of streams.
pub struct StepExchange<R, W> {
    input: R,
    output: W,
}

/// End of an exchange before the last step.
#[derive(Debug)]
pub enum ExchangeEnd {
    /// The other program has closed its side.
    Closed,
    /// The answer was rejected, or a stream has failed.
    Rejected(Faults),
}

impl std::fmt::Display for ExchangeEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ExchangeEnd::Closed => write!(f, "the other program has closed its side"),
            ExchangeEnd::Rejected(faults) => write!(f, "{faults}"),
        }
    }
}

impl std::error::Error for ExchangeEnd {}

impl<R: Read, W: Write> StepExchange<R, W> {
    /// Begins an exchange for `bodies` bodies. Errors: standard output cannot be written.
    pub fn open(input: R, mut output: W, bodies: usize) -> Result<Self, ExchangeEnd> {
        let mut header = MAGIC.to_vec();
        header.extend((bodies as u64).to_le_bytes());
        output.write_all(&header).map_err(|error| stream_end("standard output", "written", &error))?;
        Ok(StepExchange { input, output })
    }

    /// Writes the state, and reads the forces of the next step into it. Errors: the other program has closed its side, a stream
    /// has failed, or a number of the answer is not finite.
    pub fn read_loads(&mut self, scene: &Scene, state: &mut State) -> Result<(), ExchangeEnd> {
        let bodies = state.x.len();
        let mut numbers = Vec::with_capacity(STEP_NUMBERS + BODY_NUMBERS * bodies);
        numbers.extend([state.step as f64, state.time, scene.options.dt]);
        numbers.extend(state.x.iter().flat_map(|x| [x.x, x.y, x.z]));
        numbers.extend(state.q.iter().flat_map(|q| [q.w, q.i, q.j, q.k]));
        numbers.extend(state.v.iter().chain(&state.w).flat_map(|v| [v.x, v.y, v.z]));
        let message: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let sent = self.output.write_all(&message).and_then(|()| self.output.flush());
        sent.map_err(|error| stream_end("standard output", "written", &error))?;
        let mut answer = vec![0; 8 * LOAD_NUMBERS * bodies];
        self.input.read_exact(&mut answer).map_err(|error| stream_end("standard input", "read", &error))?;
        let number = |bytes: &[u8]| bytes.try_into().map_or(f64::NAN, f64::from_le_bytes);
        let numbers: Vec<f64> = answer.chunks_exact(8).map(number).collect();
        let mut faults = Faults::default();
        state.loads.clear();
        for (body, load) in numbers.chunks_exact(LOAD_NUMBERS).enumerate() {
            if !load.iter().all(|x| x.is_finite()) {
                let expected = "expected six finite numbers: force (N) and torque (N m)";
                let object = format!("step {}, body {}", state.step + 1, body + 1);
                faults.push(Fault::new("standard input".as_ref(), None, object, format!("{load:?}"), expected));
            } else if load.iter().any(|&x| x != 0.0) {
                let vector = |first: usize| Vec3::new(load[first], load[first + 1], load[first + 2]);
                state.loads.push(BodyLoad { body: BodyId::new(body), force: vector(0), torque: vector(3) });
            }
        }
        faults.into_result(()).map_err(ExchangeEnd::Rejected)
    }
}

/// End of an exchange by an error while `stream` was being `written` or `read`.
fn stream_end(stream: &str, action: &str, error: &std::io::Error) -> ExchangeEnd {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe => ExchangeEnd::Closed,
        _ => ExchangeEnd::Rejected(Fault::from_io(stream.as_ref(), action, error).into()),
    }
}
