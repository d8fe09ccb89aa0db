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

use cd_solve::gravity::{GravitySolver, HIGHEST_ORDER, LOWEST_ORDER, MIN_FMM_ERROR, SummationMethod};
use cd_solve::math::{Vec3, morton};
use clap::Parser;

#[derive(Parser)]
struct Arguments {
    /// Table of x, y, z, m[, ...], with or without a header line.
    input: PathBuf,
    /// Largest RMS relative error.
    #[arg(long, default_value_t = 1e-3)]
    error: f64,
    /// fmm, direct, or auto: the cheaper of these, which may be far more exact than required.
    #[arg(long, default_value = "fmm")]
    method: SummationMethod,
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

/// More are a slip of the keyboard.
const MOST_THREADS: usize = 1024;

fn run(arguments: &Arguments) -> Result<(), String> {
    let named = |e: &dyn std::fmt::Display| format!("{}: {e}", arguments.input.display());
    let text = std::fs::read_to_string(&arguments.input).map_err(|e| named(&e))?;
    if arguments.method != SummationMethod::Direct && (arguments.error.is_nan() || arguments.error < MIN_FMM_ERROR) {
        return Err(format!("--error {}; expected {MIN_FMM_ERROR:e} or more, or --method direct", arguments.error));
    }
    let range = |holds: bool, what: String, expected: &str| {
        if holds { Ok(()) } else { Err(format!("{what}; expected {expected}")) }
    };
    let Arguments { error, order, opening, leaf, threads, repeat, .. } = arguments;
    range(*error < 1.0, format!("--error {error}"), "less than 1")?;
    let orders = order.is_none_or(|order| (LOWEST_ORDER..=HIGHEST_ORDER).contains(&order));
    let order = order.unwrap_or_default();
    range(orders, format!("--order {order}"), &format!("{LOWEST_ORDER} to {HIGHEST_ORDER}"))?;
    let opens = opening.is_none_or(|opening| opening > 0.0 && opening < 1.0);
    range(opens, format!("--opening {}", opening.unwrap_or_default()), "more than 0 and less than 1")?;
    range(*leaf != Some(0), "--leaf 0".into(), "1 or more")?;
    range(*repeat > 0, "--repeat 0".into(), "1 or more")?;
    range(*threads <= MOST_THREADS, format!("--threads {threads}"), &format!("at most {MOST_THREADS}"))?;
    let (mut positions, mut masses) = (Vec::new(), Vec::new());
    for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let numbers: Result<Vec<f64>, _> = line.split(',').take(4).map(|word| word.trim().parse()).collect();
        match numbers.as_deref() {
            Err(_) if k == 0 && !line.split(',').any(|word| word.trim().parse::<f64>().is_ok()) => {} // names of columns
            Ok(&[x, y, z, m]) if [x, y, z, m].iter().all(|x| x.is_finite()) => {
                positions.push(Vec3::new(x, y, z));
                masses.push(m);
            }
            _ => return Err(format!("{}:{}: {line}; expected x,y,z,m", arguments.input.display(), k + 1)),
        }
    }
    if positions.is_empty() {
        return Err(format!("{}: no bodies; expected rows of x,y,z,m", arguments.input.display()));
    }
    let mut gravity = GravitySolver::new(arguments.method, arguments.error);
    gravity.order = arguments.order;
    gravity.opening = arguments.opening;
    gravity.leaf = arguments.leaf;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build().map_err(|e| e.to_string())?;
    let mut seconds = Vec::new();
    let mut field = Default::default();
    let mut order = Vec::new();
    for _ in 0..arguments.repeat {
        let start = Instant::now();
        field = pool.install(|| gravity.acceleration_field(&positions, &masses, 1.0, &order));
        seconds.push(start.elapsed().as_secs_f64());
        // As in a run: the next time bodies are sorted from the order of this.
        if order.is_empty() {
            order = morton::morton_order(&positions, &[]);
        }
    }
    if let Some(k) = field.acceleration.iter().position(|a| !a.iter().all(|x| x.is_finite())) {
        let found = format!("body {}: its acceleration is too large for a number", k + 1);
        return Err(format!("{}: {found}; expected smaller masses or larger distances", arguments.input.display()));
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

    #[test]
    fn what_makes_no_sense_is_rejected_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = (folder.path().join("in.csv"), folder.path().join("out.csv"));
        let refused = |table: &str, flag: &str| {
            std::fs::write(&input, table).unwrap();
            let words = ["gravity".as_ref(), input.as_os_str(), flag.as_ref(), "-o".as_ref(), output.as_os_str()];
            let message = run(&Arguments::parse_from(words)).unwrap_err();
            assert!(!output.exists());
            message
        };
        let two = "x,y,z,m\n0,0,0,1\n2,0,0,4\n";
        for (flag, expected) in [
            ("--order=9", "2 to 8"),
            ("--opening=nan", "more than 0 and less than 1"),
            ("--leaf=0", "1 or more"),
            ("--repeat=0", "1 or more"),
            ("--error=2", "less than 1"),
            ("--threads=100000", "at most 1024"),
        ] {
            let message = refused(two, flag);
            assert!(message.ends_with(&format!("; expected {expected}")), "{message}");
        }
        assert!(refused("x,y,z,m\n", "--leaf=8").ends_with("no bodies; expected rows of x,y,z,m"));
        // A slip in the first row is no header.
        assert!(refused("0,0,o,1\n2,0,0,4\n", "--leaf=8").ends_with("in.csv:1: 0,0,o,1; expected x,y,z,m"));
        let message = refused("0,0,0,1e300\n1e-10,0,0,1e300\n", "--method=direct");
        assert!(message.contains("too large for a number"), "{message}");
    }
}
