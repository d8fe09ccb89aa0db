//! Self-gravity of the point masses of a table: accelerations, and what they cost.
//!
//!     cargo run --release -p cd-solve --example gravity -- IN.csv --error 1e-3 -o OUT.csv
//!
//! Reads x, y, z, m from the first columns, below a header line if there is one, with G = 1; writes ax, ay, az and prints
//! `bodies seconds_per_evaluation us_per_body`, the median of the repetitions with the tree's building. From the second on
//! bodies are sorted from the order that they have, as in a run.

use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use cd_solve::gravity::{Gravity, LEAST_ERROR, Method};
use cd_solve::math::{Vec3, morton};
use clap::Parser;

#[derive(Parser)]
struct Arguments {
    /// Table of x, y, z, m[, ...], with or without a header line.
    input: PathBuf,
    /// RMS relative error asked for.
    #[arg(long, default_value_t = 1e-3)]
    error: f64,
    /// fmm, direct, or auto: the cheaper of these, which may be far more exact than is asked for.
    #[arg(long, default_value = "fmm")]
    method: Method,
    /// Order of the expansions, instead of that of the error.
    #[arg(long)]
    order: Option<usize>,
    /// Opening theta, instead of that of the error.
    #[arg(long)]
    opening: Option<f64>,
    /// Most bodies in a leaf.
    #[arg(long)]
    leaf: Option<usize>,
    /// Threads; 0 takes all processors.
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Evaluations timed.
    #[arg(long, default_value_t = 1)]
    repeat: usize,
    /// Table of ax, ay, az.
    #[arg(short, long)]
    output: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("gravity: {message}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let named = |e: &dyn std::fmt::Display| format!("{}: {e}", arguments.input.display());
    let text = std::fs::read_to_string(&arguments.input).map_err(|e| named(&e))?;
    if arguments.method != Method::Direct && (arguments.error.is_nan() || arguments.error < LEAST_ERROR) {
        return Err(format!("--error {}; expected {LEAST_ERROR:e} or more, or --method direct", arguments.error));
    }
    let (mut positions, mut masses) = (Vec::new(), Vec::new());
    for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: Result<Vec<f64>, _> = line.split(',').take(4).map(|word| word.trim().parse()).collect();
        match numbers.as_deref() {
            // Names of columns.
            Err(_) if k == 0 => {}
            Ok(&[x, y, z, m]) if [x, y, z, m].iter().all(|x| x.is_finite()) => {
                positions.push(Vec3::new(x, y, z));
                masses.push(m);
            }
            _ => return Err(format!("{}:{}: {line}; expected x,y,z,m", arguments.input.display(), k + 1)),
        }
    }
    let mut gravity = Gravity::new(arguments.method, arguments.error);
    gravity.order = arguments.order;
    gravity.opening = arguments.opening;
    gravity.leaf = arguments.leaf;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build().map_err(|e| e.to_string())?;
    let mut seconds = Vec::new();
    let mut field = Default::default();
    let mut order = Vec::new();
    for _ in 0..arguments.repeat.max(1) {
        let start = Instant::now();
        field = pool.install(|| gravity.attraction(&positions, &masses, 1.0, &order));
        seconds.push(start.elapsed().as_secs_f64());
        // As in a run: the next time bodies are sorted from the order of this.
        if order.is_empty() {
            order = morton::order(&positions, &[]);
        }
    }
    seconds.sort_by(f64::total_cmp);
    let median = seconds[seconds.len() / 2];
    println!("{} {median:e} {:.4}", positions.len(), median * 1e6 / positions.len().max(1) as f64);

    let mut table = String::from("ax,ay,az\n");
    for a in &field.acceleration {
        let _ = writeln!(table, "{:e},{:e},{:e}", a.x, a.y, a.z);
    }
    std::fs::write(&arguments.output, table).map_err(|e| format!("{}: {e}", arguments.output.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_masses_attract_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
        let direct = ["--method".as_ref(), "direct".as_ref()];
        let words =
            ["gravity".as_ref(), input.as_os_str(), "-o".as_ref(), output.as_os_str()].into_iter().chain(direct);
        let arguments = Arguments::parse_from(words);
        std::fs::write(&input, "x,y,z,m\n0,0,0,1\n2,0,0,4\n").unwrap();
        run(&arguments).unwrap();
        let text = std::fs::read_to_string(&output).unwrap();
        let a: Vec<f64> = text.lines().skip(1).flat_map(|row| row.split(',')).map(|x| x.parse().unwrap()).collect();
        assert_eq!(a, [1.0, 0.0, 0.0, -0.25, 0.0, 0.0], "{text}"); // 4/2^2 and 1/2^2
        std::fs::write(&input, "x,y,z,m\n0,0,0\n").unwrap();
        assert!(run(&arguments).unwrap_err().ends_with("in.csv:2: 0,0,0; expected x,y,z,m"));
    }
}
