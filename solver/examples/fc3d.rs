//! Solves a stored contact problem:
//! `cargo run --release -p cd-solve --example fc3d -- FILE.fc3d [--tol 1e-8] [--solver NAME] [--max-time S] -o SOLUTION.txt`
//!
//! Prints one line `contacts sweeps seconds residual`; the seconds are those of solving. Exit codes as of
//! cd-solve: 0 solved, 1 the tolerance was not reached, 2 input rejected.

use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use cd_formats::error::{Fault, Faults};
use cd_formats::{atomic, fc3d::Fc3d};
use cd_solve::solve::matrix::{MatrixProblem, MatrixSolver, SolverLimits, solve};
use clap::Parser;

#[derive(Parser)]
struct Arguments {
    /// Problem, see cd-formats, module fc3d
    file: PathBuf,
    /// Residual to reach, |F| / (rho |q|)
    #[arg(long, default_value_t = 1e-8, value_parser = limit, allow_negative_numbers = true)]
    tol: f64,
    /// auto, nlgs, nlgs-anderson, prox-newton, admm or interior-point
    #[arg(long, default_value = "auto", value_parser = by_name)]
    solver: MatrixSolver,
    /// Seconds after which the best so far is written; inf for no limit
    #[arg(long, default_value_t = 60.0, value_parser = limit, allow_negative_numbers = true)]
    max_time: f64,
    /// Passes over the contacts after which the best so far is written
    #[arg(long, default_value_t = 10_000_000)]
    max_sweeps: u64,
    /// Impulses to write: 3N numbers, contact by contact, along n, t1, t2
    #[arg(short)]
    output: PathBuf,
}

fn by_name(name: &str) -> Result<MatrixSolver, String> {
    let names = || MatrixSolver::ALL.map(|(name, _)| name).join(", ");
    MatrixSolver::ALL.iter().find(|s| s.0 == name).map(|s| s.1).ok_or_else(|| format!("expected one of {}", names()))
}

fn limit(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number| *number >= 0.0);
    number.ok_or_else(|| "expected a number, 0 or more".into())
}

fn run(arguments: &Arguments) -> Result<bool, Faults> {
    let path = &arguments.file;
    let Fc3d { mu, free_velocities: q, blocks, .. } = Fc3d::read(path)?;
    let problem = MatrixProblem::new(mu, q, blocks.iter().map(|b| (b.row, b.column, b.w))).map_err(|found| {
        Fault::new(
            path,
            None,
            "problem",
            found.to_string(),
            "expected finite numbers below 1e100, and frictions of 0 or more",
        )
    })?;
    let limits = SolverLimits {
        tol: arguments.tol,
        max_sweeps: arguments.max_sweeps,
        max_cost: f64::INFINITY,
        max_time: Duration::try_from_secs_f64(arguments.max_time).ok(), // more than it can hold is none
    };
    let start = Instant::now();
    let solution = solve(&problem, arguments.solver, &[], limits);
    let seconds = start.elapsed().as_secs_f64();
    let mut text = String::new();
    for [n, t1, t2] in &solution.r {
        let _ = writeln!(text, "{n:?} {t1:?} {t2:?}");
    }
    atomic::write(&arguments.output, text.as_bytes())?;
    println!("{} {} {seconds:.6} {:.3e}", problem.len(), solution.sweeps, solution.residual);
    Ok(solution.converged)
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(converged) => ExitCode::from(u8::from(!converged)),
        Err(faults) => {
            eprint!("{}", faults.format_report("fc3d"));
            ExitCode::from(2)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impulses_are_written_contact_by_contact() {
        let folder = tempfile::tempdir().unwrap();
        let (file, output) = (folder.path().join("one.fc3d"), folder.path().join("r.txt"));
        // Comes down at 2 m/s and slides at 3 m/s on W = 1: r = (2, 0, -1).
        let text = "fc3d 1\nname one\ncontacts 1\nblocks 1\nmu\n0.5\nq\n-2.0 0.0 3.0\nW\n0 0 1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0\nend\n";
        std::fs::write(&file, text).unwrap();
        let words = ["fc3d".as_ref(), file.as_os_str(), "-o".as_ref(), output.as_os_str()];
        assert!(run(&Arguments::parse_from(words)).unwrap());
        let text = std::fs::read_to_string(&output).unwrap();
        let r: Vec<f64> = text.split_whitespace().map(|number| number.parse().unwrap()).collect();
        assert!(r.len() == 3 && r.iter().zip([2.0, 0.0, -1.0]).all(|(a, b)| (a - b).abs() < 1e-7), "{text}");
        assert!(run(&Arguments::parse_from(["fc3d", "absent.fc3d", "-o", "r.txt"])).is_err());
        // Whose square is no number.
        let huge = "fc3d 1\nname one\ncontacts 1\nblocks 1\nmu\n0.5\nq\n-2.0 0.0 3.0\nW\n0 0 1e200 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0\nend\n";
        std::fs::write(&file, huge).unwrap();
        assert!(run(&Arguments::parse_from(words)).unwrap_err().to_string().ends_with("frictions of 0 or more"));
    }

    #[test]
    fn limits_that_mean_nothing_are_rejected() {
        let arguments = |limit: &str| Arguments::try_parse_from(["fc3d", "one.fc3d", "-o", "r.txt", limit]);
        let apart = Arguments::try_parse_from(["fc3d", "one.fc3d", "-o", "r.txt", "--tol", "-1"]);
        let together = ["--tol=nan", "--tol=-1", "--max-time=nan", "--max-time=-1", "--max-time=soon"].map(arguments);
        for refused in together.into_iter().chain([apart]) {
            let error = refused.err().unwrap();
            assert!(error.exit_code() == 2 && error.to_string().contains("expected a number, 0 or more"), "{error}");
        }
        assert!(arguments("--tol=0").is_ok() && arguments("--max-time=inf").is_ok());
    }
}
