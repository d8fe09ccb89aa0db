//! Step loops: states and forces exchanged on standard output and input.

use std::io::{Read, Write};
use std::process::{Child, Command, Stdio};

use crate::case::{Case, Figures, near};

/// Two balls without neighbours, the second at another place.
fn flying() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 10.0]);
    case.sphere(0.5, [5.0, 0.0, 10.0]);
    case.launch(2, [1.0, 2.0, 3.0], [0.0; 3]);
    case.options.steps = Some(50);
    case.write();
    case
}

fn start(case: &Case) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-solve"));
    let command = command.arg(case.path()).args(["--step-loop", "--threads", "1"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Numbers of the next frame; none if cd-solve has ended.
fn frame(child: &mut Child, numbers: usize) -> Option<Vec<f64>> {
    let mut bytes = vec![0; 8 * numbers];
    child.stdout.as_mut().unwrap().read_exact(&mut bytes).ok()?;
    Some(bytes.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap())).collect())
}

fn answer(child: &mut Child, numbers: &[f64]) {
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    child.stdin.as_mut().unwrap().write_all(&bytes).unwrap();
}

/// The header of an exchange; returns the number of bodies.
fn header(child: &mut Child) -> usize {
    let mut bytes = [0; 16];
    child.stdout.as_mut().unwrap().read_exact(&mut bytes).unwrap();
    assert_eq!(&bytes[..8], b"CDSTEPS1");
    u64::from_le_bytes(bytes[8..].try_into().unwrap()) as usize
}

/// A drag of -c v on the second ball gives (1 - c h / m) v in each step, a force on a wall nothing.
#[test]
fn forces_act_in_the_next_step() {
    let case = flying();
    let (drag, dt, mut steps) = (0.2, 1e-3, 0);
    let mut child = start(&case);
    let bodies = header(&mut child);
    assert_eq!(bodies, 3);
    while let Some(numbers) = frame(&mut child, 3 + 13 * bodies) {
        assert_eq!((numbers[0], numbers[2]), (steps as f64, dt));
        assert!((numbers[1] - steps as f64 * dt).abs() < 1e-15); // some roundings
        // After three numbers, three times three of positions and four of quaternions.
        let v = &numbers[3 + 21 + 6..][..3];
        let load = [[1.0; 6], [0.0; 6], [-drag * v[0], -drag * v[1], -drag * v[2], 0.0, 0.0, 0.01]];
        answer(&mut child, load.as_flattened());
        steps += 1;
    }
    assert!(child.wait().unwrap().success() && steps == 50);
    let (first, last) = (&case.written()[0], case.last());
    let kept = (1.0 - drag * dt / first.mass(2)).powi(50);
    near(last.v(2), first.v(2) * kept, 1e-14); // 50 roundings of 3 m/s
    let spin = 0.01 * 50.0 * dt / first.bodies.body_inertia[2][0];
    near(last.w(2), [0.0, 0.0, spin], 1e-14);
    near(last.v(1), [0.0; 3], 0.0);
    near(last.v(0), [0.0; 3], 0.0);
}

/// Without an answer the run ends with a snapshot of its last step, from which it continues.
#[test]
fn a_closed_pipe_ends_the_run_after_whole_files() {
    let case = flying();
    let mut child = start(&case);
    let bodies = header(&mut child);
    for _ in 0..7 {
        frame(&mut child, 3 + 13 * bodies).unwrap();
        answer(&mut child, &[0.0; 18]);
    }
    // Half of an answer.
    answer(&mut child, &[0.0; 9]);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(4));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("stopped after step 7,") && said.contains("--resume continues"), "{said}");
    assert_eq!(case.last().meta.step, 7);
    assert_eq!(case.solve(&["--resume"]), 0);
    assert_eq!(case.last().meta.step, 50);
}
