//! How robust the solvers of stored problems are: solves each FILE.fc3d changed in many ways.
//! `cargo run --release -p cd-solve --example fc3d_variants -- FILE.fc3d... [--tol 1e-8] [--solver NAME] [--max-time S]`
//!
//! The changes keep the problem solvable as far as it was: other friction, tangents turned in their plane, other units,
//! q + W x for random impulses x (the bodies came with other velocities), wider gaps, contacts left out, contacts said
//! twice or three times. Prints a line `name: contacts sweeps seconds residual` for what is not solved (for all with
//! `--all`), and the counts. Exit code 1 if any is not solved.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use cd_formats::fc3d::Fc3d;
use cd_solve::solve::matrix::{LocalVector, MatrixBlock, MatrixProblem, MatrixSolver, SolverLimits, solve};
use clap::Parser;

#[derive(Parser)]
struct Arguments {
    /// Problems, see cd-formats, module fc3d
    files: Vec<PathBuf>,
    /// Residual to reach, |F| / (rho |q|)
    #[arg(long, default_value_t = 1e-8)]
    tol: f64,
    #[arg(long, default_value = "auto", value_parser = by_name)]
    solver: MatrixSolver,
    /// Seconds for each
    #[arg(long, default_value_t = 4.0)]
    max_time: f64,
    /// Different random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Part of the names of the variants to solve
    #[arg(long, default_value = "")]
    only: String,
    /// Print those that are solved, too
    #[arg(long)]
    all: bool,
    /// Folder to write what is not solved to
    #[arg(long)]
    keep: Option<PathBuf>,
}

fn by_name(name: &str) -> Result<MatrixSolver, String> {
    let names = || MatrixSolver::ALL.map(|(name, _)| name).join(", ");
    MatrixSolver::ALL.iter().find(|s| s.0 == name).map(|s| s.1).ok_or_else(|| format!("expected one of {}", names()))
}

/// A problem that can be changed: dense in its list of blocks.
#[derive(Clone)]
struct Stored {
    mu: Vec<f64>,
    q: Vec<LocalVector>,
    blocks: Vec<(usize, usize, MatrixBlock)>,
}

/// A linear congruential generator (Knuth's MMIX), its upper bits: 0 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

impl Stored {
    fn len(&self) -> usize {
        self.q.len()
    }

    fn mean_q(&self) -> f64 {
        (self.q.as_flattened().iter().map(|x| x * x).sum::<f64>() / self.len() as f64).sqrt()
    }

    fn with_friction(mut self, change: impl FnMut(f64) -> f64) -> Self {
        self.mu = self.mu.into_iter().map(change).collect();
        self
    }

    /// Tangents turned by a random angle at each contact.
    fn turn_frames(mut self, random: &mut Random) -> Self {
        let turns: Vec<(f64, f64)> = self.q.iter().map(|_| (random.next() * std::f64::consts::TAU).sin_cos()).collect();
        let left = |(sin, cos): (f64, f64), v: LocalVector| [v[0], cos * v[1] + sin * v[2], cos * v[2] - sin * v[1]];
        for (q, turn) in self.q.iter_mut().zip(&turns) {
            *q = left(*turn, *q);
        }
        for (i, j, w) in &mut self.blocks {
            // L W R' by columns, then by rows.
            let columns: [LocalVector; 3] = std::array::from_fn(|k| left(turns[*i], [w[0][k], w[1][k], w[2][k]]));
            *w = std::array::from_fn(|a| left(turns[*j], [columns[0][a], columns[1][a], columns[2][a]]));
        }
        self
    }

    fn in_units(mut self, of_w: f64, of_q: f64) -> Self {
        self.blocks.iter_mut().flat_map(|b| b.2.as_flattened_mut()).for_each(|x| *x *= of_w);
        self.q.as_flattened_mut().iter_mut().for_each(|x| *x *= of_q);
        self
    }

    /// q + W x, x within the cones, of `size` times what changes q by itself.
    fn move_bodies(mut self, random: &mut Random, size: f64) -> Self {
        let x: Vec<LocalVector> = self.q.iter().map(|_| std::array::from_fn(|_| random.next() - 0.5)).collect();
        let mut change = vec![[0.0; 3]; self.len()];
        for (i, j, w) in &self.blocks {
            for k in 0..3 {
                change[*i][k] += (0..3).map(|l| w[k][l] * x[*j][l]).sum::<f64>();
            }
        }
        let norm = (change.as_flattened().iter().map(|x| x * x).sum::<f64>() / self.len() as f64).sqrt();
        let scale = size * self.mean_q() / norm.max(f64::MIN_POSITIVE);
        self.q.as_flattened_mut().iter_mut().zip(change.as_flattened()).for_each(|(q, c)| *q += scale * c);
        self
    }

    /// Gaps wider by random amounts up to `size` times the mean of q.
    fn opened(mut self, random: &mut Random, size: f64) -> Self {
        let mean = self.mean_q();
        self.q.iter_mut().for_each(|q| q[0] += size * mean * random.next());
        self
    }

    /// Every number of q changed by up to `size` of itself.
    fn rounded(mut self, random: &mut Random, size: f64) -> Self {
        self.q.as_flattened_mut().iter_mut().for_each(|x| *x *= 1.0 + size * (random.next() - 0.5));
        self
    }

    /// The contacts `keep`, in that order; one may come several times.
    fn subset(&self, keep: &[usize]) -> Self {
        let mut places = vec![Vec::new(); self.len()];
        keep.iter().enumerate().for_each(|(new, &old)| places[old].push(new));
        let copies = |(i, j, w): &(usize, usize, MatrixBlock)| {
            let w = *w;
            let columns = places[*j].clone();
            places[*i].clone().into_iter().flat_map(move |i| columns.clone().into_iter().map(move |j| (i, j, w)))
        };
        Stored {
            mu: keep.iter().map(|&k| self.mu[k]).collect(),
            q: keep.iter().map(|&k| self.q[k]).collect(),
            blocks: self.blocks.iter().flat_map(copies).collect(),
        }
    }

    fn symmetric(mut self) -> Self {
        let turned = self
            .blocks
            .clone()
            .into_iter()
            .map(|(i, j, w)| (j, i, std::array::from_fn(|a| std::array::from_fn(|b| w[b][a]))));
        self.blocks.extend(turned);
        self.in_units(0.5, 1.0)
    }
}

/// The problem changed in every way, by name.
fn variants(problem: &Stored, seed: u64) -> Vec<(String, Stored)> {
    let mut random = Random(seed);
    let n = problem.len();
    let all: Vec<usize> = (0..n).collect();
    let mut list = vec![("as it is".to_string(), problem.clone())];
    let mut add = |name: String, stored: Stored| {
        if stored.len() > 0 {
            list.push((name, stored));
        }
    };
    for factor in [0.0, 0.3, 0.6, 1.5, 3.0, 10.0] {
        add(format!("friction x {factor}"), problem.clone().with_friction(|mu| factor * mu));
    }
    add("friction 0 to 1".into(), problem.clone().with_friction(|_| random.next()));
    add("tangents turned".into(), problem.clone().turn_frames(&mut random));
    add("units 1e6 and 1e-3".into(), problem.clone().in_units(1e6, 1e-3));
    add("units 1e-9 and 1e4".into(), problem.clone().in_units(1e-9, 1e4));
    for size in [1e-6, 1e-3, 0.1, 1.0, 10.0] {
        add(format!("moved by {size}"), problem.clone().move_bodies(&mut random, size));
    }
    for size in [1e-3, 0.1, 1.0] {
        add(format!("gaps wider by {size}"), problem.clone().opened(&mut random, size));
    }
    for share in [0.03, 0.1, 0.3, 0.6] {
        for _ in 0..2 {
            let keep: Vec<usize> = all.iter().copied().filter(|_| random.next() > share).collect();
            add(format!("without {share}: {} contacts", keep.len()), problem.subset(&keep));
        }
    }
    let twice = |share: f64, random: &mut Random| -> Vec<usize> {
        all.iter().copied().chain(all.iter().copied().filter(|_| random.next() < share)).collect()
    };
    add("some twice".into(), problem.subset(&twice(0.2, &mut random)));
    add("all twice".into(), problem.subset(&twice(2.0, &mut random)));
    let thrice: Vec<usize> = (0..n.min(200)).flat_map(|k| [k; 3]).collect();
    add("all thrice".into(), problem.subset(&thrice));
    let backwards: Vec<usize> = all.iter().rev().copied().collect();
    add("backwards".into(), problem.subset(&backwards));
    add("symmetric".into(), problem.clone().symmetric());
    let keep: Vec<usize> = all.iter().copied().filter(|_| random.next() > 0.2).collect();
    let mixed =
        problem.subset(&keep).with_friction(|mu| 2.0 * mu).move_bodies(&mut random, 0.3).turn_frames(&mut random);
    add("fewer, rougher, moved".into(), mixed);
    add("q rounded to 1e-9".into(), problem.clone().rounded(&mut random, 1e-9));
    list
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (mut count, mut unsolved, mut seconds, mut slowest) = (0, 0, 0.0, 0.0f64);
    for path in &arguments.files {
        let Fc3d { name, mu, free_velocities: q, blocks, .. } = match Fc3d::read(path) {
            Ok(document) => document,
            Err(faults) => {
                eprint!("{}", faults.format_report("fc3d_variants"));
                return ExitCode::from(2);
            }
        };
        let stored = Stored { mu, q, blocks: blocks.iter().map(|b| (b.row, b.column, b.w)).collect() };
        for (variant, Stored { mu, q, blocks }) in variants(&stored, arguments.seed) {
            let full = format!("{name}, {variant}");
            if !full.contains(&arguments.only) {
                continue;
            }
            let problem = match MatrixProblem::new(mu.clone(), q.clone(), blocks.clone()) {
                Ok(problem) => problem,
                Err(found) => {
                    eprintln!("fc3d_variants: {}: {found}; expected finite numbers", path.display());
                    return ExitCode::from(2);
                }
            };
            let limits = SolverLimits {
                tol: arguments.tol,
                max_sweeps: u64::MAX,
                max_cost: f64::INFINITY,
                max_time: Duration::try_from_secs_f64(arguments.max_time).ok(),
            };
            let start = Instant::now();
            let solution = solve(&problem, arguments.solver, &[], limits);
            let time = start.elapsed().as_secs_f64();
            count += 1;
            seconds += time;
            slowest = slowest.max(time);
            unsolved += usize::from(!solution.converged);
            if arguments.all || !solution.converged {
                println!("{full}: {} {} {time:.4} {:.3e}", problem.len(), solution.sweeps, solution.residual);
            }
            if let (Some(folder), false) = (&arguments.keep, solution.converged) {
                let blocks = blocks.into_iter().map(|(row, column, w)| cd_formats::fc3d::Fc3dBlock { row, column, w });
                let document = Fc3d {
                    name: name.clone(),
                    mu,
                    free_velocities: q,
                    blocks: blocks.collect(),
                    comments: vec![full.clone()],
                };
                let file = folder.join(format!("{}.fc3d", full.replace([',', ' ', ':'], "_")));
                if let Err(faults) = cd_formats::atomic::write(&file, document.to_text().as_bytes()) {
                    eprint!("{}", faults.format_report("fc3d_variants"));
                }
            }
        }
    }
    println!("{count} problems, {unsolved} not solved, {seconds:.1} s in all, {slowest:.2} s the slowest");
    ExitCode::from(u8::from(unsolved > 0))
}
