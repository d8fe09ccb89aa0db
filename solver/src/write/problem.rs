//! Writes the contact problem of one step as a text document, for `--dump-problem`.

use std::path::{Path, PathBuf};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};
use cd_formats::fc3d::{Fc3d, Fc3dBlock};

use crate::assemble::StoredProblem;
use crate::scene::Scene;
use crate::state::State;

/// Rejects a step that a run from this state does not make, and contacts whose moments the document cannot represent.
pub fn check_dump_step(scene: &Scene, state: &State, step: u64) -> Result<(), Faults> {
    let mut faults = Faults::default();
    let mut fault = |found: String, expected: String| {
        faults.push(Fault::new(Path::new("options"), None, "--dump-problem", found, expected));
    };
    let (first, last) = (state.step, scene.last_step());
    if step <= first || step > last {
        fault(format!("{step}"), format!("expected a step that the run makes, after {first} and up to {last}"));
    }
    if state.laws.iter().any(crate::laws::ContactLaw::has_moments) {
        let expected = "expected laws without moments, which the format cannot hold";
        fault(format!("{step}"), expected.into());
    }
    if state.laws.iter().any(|law| law.is_regularised() || law.interface.is_some()) {
        let expected =
            "expected laws without springs, coupling and interfaces: the format holds rigid contacts with friction";
        fault(format!("{step}"), expected.into());
    }
    faults.into_result(())
}

/// Writes `CASE/problem-NNNNNN.fc3d`, the problem that leads to step NNNNNN; returns its path.
pub fn write_problem(case: &Path, step: u64, problem: StoredProblem) -> Result<PathBuf, Faults> {
    let path = case.join(format!("problem-{step:06}.fc3d"));
    let blocks = problem.blocks.into_iter().map(|(row, column, w)| Fc3dBlock { row, column, w }).collect();
    let document = Fc3d {
        comments: vec![format!(
            "cd-solve {}: step {step}; u and r of the standard problem, SI units",
            env!("CARGO_PKG_VERSION")
        )],
        name: format!("step-{step:06}"),
        mu: problem.mu,
        free_velocities: problem.q,
        blocks,
    };
    atomic::write(&path, document.to_text().as_bytes())?;
    Ok(path)
}
