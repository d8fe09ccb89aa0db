//! Command scripts of LMGC90: options that are taken from them, lines that say so, and scripts that are rejected.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use cd_formats::compute::{ComputeFlags, FaceFriction};
use cd_solve::read::driver::{read_driver, table_rows};

use crate::case::{Case, Figures};

const SCRIPT: &str = "\
from pylmgc90 import chipy
chipy.checkDirectories()
dim = 3
dt = 1.e-3
nb_steps = 20
tol, relax = 1.666e-4, 1.0
norm = 'QM/16'
solver_type = 'Stored_Delassus_Loops         '
chipy.PRPRx_UseCpCundallDetection(200)
chipy.SetDimension(dim, 0)
chipy.TimeEvolution_SetTimeStep(dt)
chipy.Integrator_InitTheta(0.5)
chipy.ReadDatbox(deformable=False)
chipy.ComputeMass()
for k in range(0, nb_steps):
    chipy.IncrementStep()
    chipy.ComputeFext()
    chipy.ComputeFreeVelocity()
    chipy.SelectProxTactors()
    chipy.RecupRloc(5.e-2)
    chipy.ExSolver(solver_type, norm, tol, relax, 50, 500)
    chipy.StockRloc()
    chipy.ComputeDof()
    chipy.UpdateStep()
    chipy.WriteOut(10)
chipy.Finalize()
";

/// A ball that falls on a floor, in a folder without COMPUTE.RON.
fn falling() -> Case {
    let mut case = Case::new();
    case.law("IQS_CLB", &[0.3]);
    case.floor();
    case.sphere(0.5, [0.0, 0.0, 0.5001]);
    case.gravity = [0.0, 0.0, -9.81];
    case.write();
    fs::remove_file(case.path().join("DATBOX/COMPUTE.RON")).unwrap();
    case
}

fn write_script(case: &Case, text: &str) -> PathBuf {
    let path = case.path().join("command.py");
    fs::write(&path, text).unwrap();
    path
}

/// Exit code, stdout and stderr of a run with the script, with CASE for the case's folder.
fn ran(case: &Case, text: &str, flags: &[&str]) -> (i32, String, String) {
    let script = write_script(case, text);
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-solve"));
    let output = command.arg(case.path()).arg("--lmgc90").arg(script).args(flags).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap().replace(case.path().to_str().unwrap(), "CASE");
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// Options of a script, with these options on the command line, or the lines of its faults.
fn options(text: &str, given: &ComputeFlags) -> Result<ComputeFlags, String> {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("command.py");
    fs::write(&script, text).unwrap();
    let read = read_driver(&script, folder.path(), given).map(|settings| settings.options);
    read.map_err(|faults| faults.to_string().replace(&format!("{}:", script.display()), ""))
}

fn rejected(text: &str) -> String {
    options(text, &ComputeFlags::default()).unwrap_err()
}

#[test]
fn a_run_says_what_it_takes_from_a_script() {
    let case = falling();
    let (code, output, errors) = ran(&case, SCRIPT, &["--threads", "1"]);
    assert_eq!((code, errors.as_str()), (0, ""));
    let expected = "\
cd-solve: CASE/command.py:11: TimeEvolution_SetTimeStep: dt = 0.001
cd-solve: CASE/command.py:12: Integrator_InitTheta: theta = 0.5
cd-solve: CASE/command.py:15: loop of IncrementStep: steps = 20
cd-solve: CASE/command.py:21: ExSolver: check_every = 50
cd-solve: CASE/command.py:21: ExSolver: max_sweeps = 25000
cd-solve: CASE/command.py:21: ExSolver: tol = 0.0009996
cd-solve: CASE/command.py:25: WriteOut: output_every = 10
cd-solve: CASE/command.py:25: WriteOut: text = true
cd-solve: CASE/command.py: without counterpart: PRPRx_UseCpCundallDetection (line 9): one exact detection for convex bodies, without settings
";
    assert!(output.starts_with(expected), "{output}");
    let last = case.last();
    assert_eq!((last.meta.step, last.meta.h, last.meta.parameters.tol), (20, 1e-3, 9.996e-4));
    assert!(case.path().join("OUTBOX/DOF.OUT.20").exists() || case.path().join("OUTBOX/DOF.OUT.2").exists());
}

#[test]
fn a_resumed_run_repeats_the_options_of_its_script() {
    let (whole, parts) = (falling(), falling());
    assert_eq!(ran(&whole, SCRIPT, &["--threads", "1"]).0, 0);
    // An option of the command line wins over the script.
    let (code, output, _) = ran(&parts, SCRIPT, &["--threads", "1", "--steps", "10", "--output-every", "5"]);
    assert!(code == 0 && output.contains("WriteOut: output_every = 10 is overridden by --output-every"), "{output}");
    assert_eq!(parts.last().meta.step, 10);
    let script = parts.path().join("command.py");
    let (code, _, errors) = ran(&parts, SCRIPT, &["--resume", "--threads", "1"]);
    assert_eq!((code, errors.as_str()), (0, ""));
    let [a, b] = [&whole, &parts].map(|case| fs::read(case.path().join("OUTBOX/snapshot-000020.npz")).unwrap());
    assert_eq!(a, b);
    // Without the script its options differ, and each is reported.
    let mut command = Command::new(env!("CARGO_BIN_EXE_cd-solve"));
    let output = command.arg(parts.path()).args(["--resume", "--steps", "30", "--dt", "2e-3"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("max_sweeps was Some(25000) in the run so far") || said.contains("max_sweeps was 25000"),
        "{said}"
    );
    assert!(script.exists());
}

#[test]
fn scripts_of_both_forms_mean_the_same() {
    let given = ComputeFlags::default();
    let prefixed = options(SCRIPT, &given).unwrap();
    let star = SCRIPT.replace("from pylmgc90 import chipy\n", "from pylmgc90.chipy import *\n").replace("chipy.", "");
    let star = star.replace("pylmgc90import", "pylmgc90.chipy import").replace("pylmgc90import *", "");
    let star = star.replace("from pylmgc90.import *", "from pylmgc90.chipy import *");
    assert_eq!(format!("{:?}", options(&star, &given).unwrap()), format!("{prefixed:?}"));
    let flat = SCRIPT
        .replace("import chipy", "import chipy as lm")
        .replace("chipy.", "lm.")
        .replace("lm.IncrementStep()", "lm.TimeEvolution_IncrementStep(); lm.RBDY3_IncrementStep()")
        .replace(
            "lm.ExSolver(solver_type, norm, tol, relax, 50, 500)",
            "lm.nlgs_3D_ExSolver(solver_type, norm, conv=tol, relax=relax, gsit1=50, gsit2=500)",
        )
        .replace("lm.WriteOut(10)", "lm.TimeEvolution_WriteOutDof(10)");
    assert_eq!(format!("{:?}", options(&flat, &given).unwrap()), format!("{prefixed:?}"));
    let in_time = SCRIPT.replace("for k in range(0, nb_steps):", "while chipy.TimeEvolution_GetTime() < nb_steps*dt:");
    let read = options(&in_time, &given).unwrap();
    assert_eq!((read.steps, read.end_time), (None, Some(0.02)));
    // Steps of 0.25 s at 0, 0.25, ..., 1 s; ten of 0.1 s add up to less than 1 s, those of 0.25 s to 1 s.
    for (sign, dt, end) in [("<", "0.25", 1.0), ("<=", "0.25", 1.25), ("<=", "0.3", 1.0), ("<", "0.1", 1.1)] {
        let text = SCRIPT.replace("1.e-3", dt);
        let text =
            text.replace("for k in range(0, nb_steps):", &format!("while chipy.TimeEvolution_GetTime() {sign} 1.:"));
        assert_eq!(options(&text, &given).unwrap().end_time, Some(end), "{sign} {dt}");
    }
    let maxm = options(&SCRIPT.replace("QM/16", "Maxm "), &given).unwrap();
    assert_eq!(maxm.tol, Some(1.666e-4));
}

/// Forms in which LMGC90's users write the same run; each has a time step of 1e-3 s, theta 0.5, 20 steps, the norm `Quad `
/// with 1e-4, 10 blocks of 50 sweeps and output every 10 steps.
#[test]
fn forms_of_scripts_mean_the_same() {
    let setup = "c.SetDimension(3); c.TimeEvolution_SetTimeStep(1e-3); c.Integrator_InitTheta(0.5); c.ReadDatbox()\n";
    let step = "c.IncrementStep(); c.ExSolver('SDL', 'Quad ', 1e-4, 1., 50, 10); c.WriteOut(10)";
    let looped = |import: &str, before: &str, head: &str, after: &str| {
        format!("{import}\n{setup}{before}\n{head}\n    {step}\n    {after}\n")
    };
    let c = "from pylmgc90 import chipy as c";
    let plain = looped(c, "", "for k in range(20):", "pass");
    let expected = format!("{:?}", options(&plain, &ComputeFlags::default()).unwrap());
    let computation = |import: &str, name: &str| {
        format!(
            "{import}\n{name}.initialize(3, 1e-3, 0.5, logmes=True)\nfor k in range(20):\n  \
             {name}.one_step('SDL', 'Quad ', 1e-4, 1.0, 50, 10, 10, 0)\n{name}.finalize()\n"
        )
    };
    let without = |import: &str| plain.replace(c, import).replace("c.", "");
    let scripts = [
        // Counters and times of loops.
        looped(c, "k = 0", "while k < 20:", "k += 1"),
        looped(c, "k = 20", "while 0 < k:", "k = k - 1"),
        looped(c, "dt = 1e-3; t = 0.", "while t < 0.02 - dt/2:", "t += dt"),
        looped(c, "k, n = 1, 20", "while k <= n:", "k += 1; x = 0"),
        looped(c, "from tqdm import tqdm", "for k in tqdm(range(20), desc='steps'):", "pass"),
        looped(c, "", "for k, t in enumerate(np.linspace(0., 0.02, 20)):", "pass"),
        looped(c, "", "for t in np.arange(0., 0.02, 1e-3):", "pass"),
        looped(c, "p = dict(n=20 if True else 5)\np['m'] = 3", "for k in range(p['n']):", "pass"),
        looped(c, "a = {'n': [5, 20]}", "for k in range(a['n'][-1]):", "pass"),
        looped(c, "", "for k in range(20):", "if k % 5: continue\n    c.WriteDisplayFiles(1)"),
        looped(c, "", "for k in range(20):", "pass") + "import sys\nsys.exit(0)\nc.TimeEvolution_SetTimeStep(7.)\n",
        // Names of the module and its commands.
        plain.replace(c, "import pylmgc90.chipy as c"),
        plain.replace(c, "import pylmgc90").replace("c.", "pylmgc90.chipy."),
        plain.replace(c, "import pylmgc90.chipy").replace("c.", "pylmgc90.chipy."),
        plain.replace(c, "import pylmgc90\nc = pylmgc90.chipy"),
        plain.replace(c, "from pylmgc90.chipy import lmgc90 as c"),
        without("from pylmgc90.chipy import *"),
        without(
            "from pylmgc90.chipy import (SetDimension, ReadDatbox, IncrementStep, ExSolver, WriteOut,\n  Integrator_InitTheta, TimeEvolution_SetTimeStep)",
        ),
        plain.replace(c, &format!("{c}\nadvance = c.IncrementStep")).replace("    c.IncrementStep()", "    advance()"),
        plain
            .replace("c.ExSolver('SDL', 'Quad ', 1e-4, 1., 50, 10)", "c.ExSolver(*args)")
            .replace(c, &format!("{c}\nargs = ('SDL', 'Quad', 1e-4, 1., 50, 10)")),
        // The module that makes several calls.
        computation("from pylmgc90.chipy import computation", "computation"),
        computation("import pylmgc90.chipy.computation as run", "run"),
        computation("from pylmgc90 import chipy", "chipy.computation"),
        computation("from pylmgc90.chipy.computation import *", "x").replace("x.", ""),
        computation(c, "c.computation")
            .replace("'SDL', 'Quad ', 1e-4, 1.0, 50, 10, 10, 0", "f_write=10, f_display=1, **p")
            .replace(
                c,
                &format!(
                    "{c}\np = {{'stype': 'SDL', 'norm': 'Quad ', 'tol': 1e-4, 'relax': 1., 'gs_it1': 50, 'gs_it2': 10}}"
                ),
            ),
    ];
    for script in scripts {
        let read = options(&script, &ComputeFlags::default()).map(|options| format!("{options:?}"));
        assert_eq!(read.as_deref(), Ok(expected.as_str()), "{script}");
    }
}

/// A relaxation is reported; the steps of the run are those without it.
#[test]
fn a_relaxation_is_reported() {
    let case = falling();
    let (code, out, _) = ran(&case, &SCRIPT.replace("relax = 1.666e-4, 1.0", "relax = 1.666e-4, 1./4."), &[]);
    let line = "relaxation 0.25 has no counterpart; the motion can depend on it where friction leaves it open, see \
                docs/explanation/limits.md";
    assert!(code == 0 && out.contains(line), "{out}");
    let relaxed = case.last();
    let (_, out, _) = ran(&case, SCRIPT, &["--force"]);
    assert!(!out.contains("relaxation"), "{out}");
    assert_eq!(relaxed.x(1), case.last().x(1));
}

/// Default arguments have the values that they had where the function was defined; parameters behind a star are given by
/// their names; classes of constants have attributes.
#[test]
fn functions_and_classes_have_the_values_of_python() {
    let head = "from pylmgc90 import chipy as c\nimport numpy as np\n";
    let read = |text: &str| options(&format!("{head}{text}"), &ComputeFlags::default());
    let solve = "c.IncrementStep(); c.ExSolver('SDL', 'Quad ', tol, 1., 50, 10)";
    let by_default = format!(
        "tol = 1e-4\nc.TimeEvolution_SetTimeStep(np.float64(1e-3))\ndef run(n, *, tol=tol, m=2):\n  \
         for k in range(n*m): {solve}\ntol = 1e-8\nrun(5, m=3)\n"
    );
    let found = read(&by_default).unwrap();
    assert_eq!((found.dt, found.steps, found.tol), (Some(1e-3), Some(15), Some(6e-4)));
    let class = |class: &str, more: &str| {
        format!("{class}\n{more}\nc.TimeEvolution_SetTimeStep(p.dt)\nfor k in range(p.n): c.IncrementStep()\n")
    };
    let plain = "class p:\n  'parameters'\n  dt: float = 1e-3\n  t = 20*dt\n  n = int(round(t/dt))\n";
    for (text, dt) in [(class(plain, ""), 1e-3), (class(plain, "p.dt = 2e-3"), 2e-3)] {
        let found = read(&text).unwrap();
        assert_eq!((found.dt, found.steps), (Some(dt), Some(20)), "{text}");
    }
    // Attributes that may change by another name, in a function or by a method.
    let object = "p = Parameters()\np.dt = 1e-3; p.n = 20\n";
    for (before, more) in [
        (plain, "q = p; q.dt = 2e-3"),
        (plain, "f(p)"),
        (plain, "def f(): p.dt = 2e-3; p.n = 3\nf()"),
        (object, "q = p; q.dt = 2e-3"),
        (object, "p.update()"),
        (&plain.replace("class p", "class p(Base)"), ""),
        (&plain.replace("class p", "@change\nclass p"), ""),
    ] {
        let found = read(&class(before, more)).unwrap_err();
        assert!(found.contains("TimeEvolution_SetTimeStep: its value is not known: p.dt"), "{before}{more}\n{found}");
    }
}

/// The tolerance depends on the norm, which must therefore be known.
#[test]
fn a_norm_that_is_not_known_is_rejected() {
    let text = SCRIPT.replace("norm = 'QM/16'", "norm = f'{kind}'");
    let expected = "21: ExSolver: its norm is not known: norm, set in line 7 from 'f-string'; expected 'Quad ', 'QM/16' or \
                    'Maxm ', or the option --tol";
    assert_eq!(rejected(&text).trim_end(), expected);
    let given = ComputeFlags { tol: Some(1e-3), ..ComputeFlags::default() };
    assert_eq!(options(&text, &given).unwrap().tol, None);
}

/// Loops of unknown length, and steps that a condition may skip, need an option.
#[test]
fn steps_that_are_not_counted_are_rejected() {
    let head = "from pylmgc90 import chipy as c\nc.TimeEvolution_SetTimeStep(1e-3)\n";
    let loops = [
        ("k = 0\nwhile k < 20:\n  c.IncrementStep()\n", "its length is not known"),
        ("k = 0\nwhile k < n:\n  c.IncrementStep()\n  k += 1\n", "its length is not known"),
        ("k = 0\nwhile k < 20:\n  c.IncrementStep()\n  if f(): k += 1\n", "its length is not known"),
        ("k = 0\nwhile k < 20:\n  c.IncrementStep()\n  k += 1\n  k *= 2\n", "its length is not known"),
        ("k = 0.5\nwhile k != 20:\n  c.IncrementStep()\n  k += 1\n", "its length is not known"),
        ("for k in range(20):\n  if f(k): continue\n  c.IncrementStep()\n", "depends on the condition in line 4"),
        ("def s():\n  if f(): return\n  c.IncrementStep()\ns()\n", "depends on the condition in line 4"),
    ];
    for (text, why) in loops {
        let found = rejected(&format!("{head}{text}"));
        assert!(
            found.contains(why) && found.contains("expected the option --steps N or --end-time S"),
            "{text}{found}"
        );
    }
}

#[test]
fn periods_and_gravity_are_taken() {
    let more = "chipy.SetPeriodicCondition(yperiod=25., xperiod=5*5)\nchipy.bulk_behav_SetGravity([0., 0., -1.62])\n";
    let text = SCRIPT.replace("chipy.ComputeMass()\n", more);
    let read = options(&text, &ComputeFlags::default()).unwrap();
    assert_eq!((read.xperiode, read.yperiode), (Some(25.0), Some(25.0)));
    let case = falling();
    let (code, output, _) = ran(&case, &text.replace("xperiod=5*5", "xperiod=None"), &["--theta=1.0"]);
    assert!(code == 0 && output.contains("bulk_behav_SetGravity: gravity = (0, 0, -1.62) m/s²"), "{output}");
    let fallen = case.written()[0].meta.parameters.uniform_gravity;
    assert_eq!(fallen, [0.0, 0.0, -1.62]);
}

#[test]
fn calls_that_change_the_mechanics_are_rejected() {
    let with = |line: &str| SCRIPT.replace("chipy.ComputeMass()", line);
    let lines = [
        ("chipy.SetDimension(2)", "14: SetDimension: 2 dimensions; expected a script for three"),
        ("chipy.ReadIni(3)", "14: ReadIni: does not start from DATBOX; expected record 0"),
        ("chipy.RBDY3_SetInvisible(3)", "14: RBDY3_SetInvisible: is not supported; expected a DATBOX without"),
        ("if x: chipy.FatalDamping()", "14: FatalDamping: is not supported; expected the option `quench`"),
        ("chipy.RBDY3_PutBodyVector('Fext_', 1, f)", "14: RBDY3_PutBodyVector: is not supported; expected forces"),
        ("chipy.Integrator_InitGear()", "14: Integrator_InitGear: is not supported"),
        ("chipy.tact_behav_SetParam(1, 1, 0.)", "14: tact_behav_SetParam: is not supported"),
        ("chipy.bulk_behav_SetGravity([0., g, 0.])", "14: bulk_behav_SetGravity: its value is not known: g"),
    ];
    for (line, expected) in lines {
        let found = rejected(&with(line));
        assert!(found.starts_with(expected) && !found.trim_end().contains('\n'), "{found}");
    }
    // All faults at once, and a line about each call without meaning here.
    let found = rejected(&with("chipy.RBDY3_SetInvisible(3); chipy.FatalDamping()"));
    assert_eq!(found.lines().count(), 2, "{found}");
    let case = falling();
    let (code, output, _) = ran(&case, &with("chipy.RBDY3_Fly(3)"), &[]);
    assert!(code == 0 && output.contains("command.py:14: RBDY3_Fly: is no known command, and is ignored"), "{output}");
    let (code, _, errors) = ran(&case, &with("chipy.RBDY3_Fly((3)"), &["--force"]);
    assert_eq!(
        (code, errors.as_str()),
        (2, "cd-solve: CASE/command.py:14: bracket: is not closed; expected a script of Python\n")
    );
}

#[test]
fn values_that_a_script_does_not_state_are_options() {
    let text = SCRIPT.replace("dt = 1.e-3", "dt = float(input())").replace("nb_steps = 20", "nb_steps = len(files)");
    let found = rejected(&text);
    let expected = "\
11: TimeEvolution_SetTimeStep: its value is not known: dt, set in line 4 from the call of input; expected a number, or the option --dt
15: loop: its length is not known: nb_steps, set in line 5 from files; expected the option --steps N or --end-time S";
    assert_eq!(found.trim_end(), expected);
    let given = ComputeFlags { dt: Some(1e-3), end_time: Some(0.1), ..ComputeFlags::default() };
    let read = options(&text, &given).unwrap();
    assert_eq!((read.dt, read.steps, read.theta), (None, None, Some(0.5)));
    let twice = SCRIPT.replace("chipy.ComputeMass()", "chipy.TimeEvolution_SetTimeStep(2*dt)");
    assert!(
        rejected(&twice).starts_with("14: TimeEvolution_SetTimeStep: dt is 0.002, and 0.001 in line 11; expected one")
    );
    let none = rejected("import numpy\n");
    assert!(none.contains("steps: no call of IncrementStep is found") && none.contains("dt: no call of"), "{none}");
    let soft = SCRIPT.replace("    chipy.WriteOut(10)", "    if k % 7 == 0: chipy.WriteOut()");
    assert_eq!(options(&soft, &ComputeFlags::default()).unwrap().output_every, None);
}

/// Stages that are computed although the script does not call them, and periods of the search, are named.
#[test]
fn missing_stages_are_named() {
    let case = falling();
    let (code, complete, _) = ran(&case, SCRIPT, &["--steps", "1"]);
    assert!(code == 0 && !complete.contains("all the same") && !complete.contains("searched in each"), "{complete}");
    let text = SCRIPT.replace("    chipy.ComputeFext()\n", "").replace("SelectProxTactors()", "SelectProxTactors(10)");
    let (code, output, _) = ran(&case, &text, &["--steps", "1", "--force"]);
    let line = "command.py:16: no call of ComputeFext is found: gravity and other forces act in each step all the same";
    assert!(code == 0 && output.contains(line), "{output}");
    assert!(output.contains("SelectProxTactors: contacts are searched in each step, not every 10"), "{output}");
}

/// Values that change by another name, in a function or by a method are rejected, never those before the change.
#[test]
fn values_that_change_indirectly_are_rejected() {
    let head = "from pylmgc90 import chipy as c\nc.TimeEvolution_SetTimeStep(1e-3)\n";
    let steps = "for k in range(n):\n  c.IncrementStep()\n";
    let looped = |before: &str| format!("{head}{before}\n{steps}");
    let part = "which changes in part; expected the option --steps N or --end-time S";
    let scripts = [
        // A function changes its argument, or a dictionary outside of it.
        (looped("p = {'n': 4}\ndef f(q):\n  q['n'] = 8\nf(p); n = p['n']"), part),
        (looped("p = {'n': 4}\ndef f(): p['n'] = 8\nf(); n = p['n']"), part),
        (looped("p = {'n': 4}\nread(p); n = p['n']"), part),
        (looped("p = {'n': 4}\ndef f(): return p\nq = f(); q['n'] = 8; n = p['n']"), part),
        // Other names.
        (looped("p = {'s': {'n': 4}}\ns = p['s']; s['n'] = 8; n = p['s']['n']"), part),
        (looped("p = [4]\nq = p; q[0] = 8; n = p[0]"), part),
        (looped("p = [{'n': 4}]\nfor q in p: q['n'] = 8\nn = p[0]['n']"), part),
        // A first iteration reads what it changes later.
        (
            format!(
                "{head}p = {{'n': 4}}\nq = p\nfor l in range(3):\n  for k in range(p['n']): c.IncrementStep()\n  \
                 q['n'] = 8\n"
            ),
            part,
        ),
        // Methods.
        (looped("l = [3]\nl.clear(); l.append(5); n = l[0]"), part),
        (looped("p = {'l': [3]}\np['l'].append(5); n = len(p['l'])"), part),
        (looped("p = {'n': 4}\nq = p\ndel q['n']; n = p['n']"), part),
        (looped("p = {'n': 4}\np.clear(); p['m'] = 1; n = p['n']"), "from p[...]; expected the option"),
        // Functions that set a counter, calls of unknown number, and more than one meaning of a name.
        (
            format!(
                "{head}k = 0\ndef f():\n  global k\n  k += 2\nwhile k < 10:\n  c.IncrementStep()\n  k += 1\n  f()\n"
            ),
            "its length is not known: k < 10",
        ),
        (format!("{head}x = [c.IncrementStep() for k in range(6)]\n"), "its length is not known: a comprehension"),
        (format!("{head}f = lambda: c.IncrementStep()\n"), "its length is not known: a lambda"),
        (
            format!("{head}def f(): c.IncrementStep()\nf = lambda: None\nf()\nc.IncrementStep()\n"),
            "3: f: is a function with more than one meaning; expected",
        ),
        (looped("n = 4; c.IncrementStep = print"), "3: c.IncrementStep: is a command of LMGC90 with another value"),
        (looped("n = 4; vars()['n'] = 6"), "3: vars: changes or reads variables by other means than their names"),
    ];
    for (script, why) in scripts {
        let found = rejected(&script);
        assert!(found.contains(why), "{script}{found}");
    }
    // Read by functions and changed by one name, they are known.
    let known = [
        "p = {'n': 4}\nprint(p); p['n'] = 8; n = p['n']",
        "p = {'n': 8}\ndef f(q): return q['n'] + 1\nx = f(p); n = p['n']",
        "p = {'s': {'n': 8}}\ns = p['s']; n = s['n']; m = f(s['n'])",
        "p = {'n': 4}\nt = []\nfor k in range(3): t.append(p['n'])\np['n'] += 4; n = p['n']",
    ];
    for before in known {
        let read = options(&looped(before), &ComputeFlags::default()).map(|options| options.steps);
        assert_eq!(read, Ok(Some(8)), "{before}");
    }
}

#[test]
fn the_page_lists_all_commands() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/lmgc90.md");
    let page = fs::read_to_string(page).unwrap();
    for row in table_rows() {
        assert!(page.contains(&row), "docs/reference/lmgc90.md does not have the row\n{row}");
    }
}

/// A semicircular arch of so many blocks, 0.5 m thick and 2 m in inner radius, between two fixed ones.
fn arch(blocks: usize) -> Case {
    let mut case = Case::new();
    case.law_between("POLYR", "POLYR", "IQS_CLB", &[0.6]);
    case.gravity = [0.0, 0.0, -9.81];
    case.materials[0].density = 2000.0;
    let triangles: Vec<[u32; 3]> = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    let angle = std::f64::consts::PI / blocks as f64;
    for k in 0..blocks + 2 {
        // The first and the last block are below the springings.
        let angles = [k as f64 - 1.0, k as f64].map(|at| at * angle);
        let corner = |n: usize| {
            let (t, r, y) = (angles[n / 2 % 2], [2.0, 2.5][n % 2], [-0.5, 0.5][n / 4]);
            [r * t.cos(), y, r * t.sin()].map(|c| format!("{c:.7e}").parse().unwrap())
        };
        let vertices: Vec<[f64; 3]> = (0..8).map(corner).collect();
        let block = case.polyhedron(&vertices, &triangles, [0.0; 3]);
        if k == 0 || k == blocks + 1 {
            case.drive(block, [0.0; 6].map(cd_formats::drv_dof::Evolution::constant));
        }
    }
    // In the fixed axes of BODIES.DAT, as LMGC90's folders without axes.
    case.dof.clear();
    case
}

/// In a folder without COMPUTE.RON an arch comes to rest, as it does in LMGC90; at the tolerance of other folders it creeps.
#[test]
fn an_arch_rests_with_the_defaults_of_folders_of_lmgc90() {
    let case = arch(9);
    let speed = |flags: &[&str]| {
        let flags = [&["--dt=1e-3", "--steps=150", "--threads=1", "--force"], flags].concat();
        assert_eq!(case.solve(&flags), 0);
        case.last().bodies.body_v.iter().map(|v| v.iter().map(|c| c * c).sum::<f64>().sqrt()).fold(0.0, f64::max)
    };
    case.write();
    let compute = case.path().join("DATBOX/COMPUTE.RON");
    fs::write(&compute, "()").unwrap();
    let creeping = speed(&[]);
    fs::remove_file(compute).unwrap();
    let resting = speed(&[]);
    // 1e-9 m/s is 3 cm in a year; the tolerance alone allows 1e-2 of g dt.
    assert!(resting < 1e-9 && creeping > 1e-6, "{resting:e} m/s, {creeping:e} m/s");
    assert!((0..11).all(|body| case.last().x(body).norm() < 3.0));
}

/// In a folder without COMPUTE.RON friction acts at the corners of faces, as in LMGC90, unless a flag sets the other; the
/// note about it is printed where there are faces.
#[test]
fn friction_of_faces_is_that_of_lmgc90_in_its_folders() {
    let case = arch(3);
    case.write();
    let compute = case.path().join("DATBOX/COMPUTE.RON");
    let chosen = |case: &Case, flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cd-solve"));
        command.arg(case.path()).args(["--dt=1e-3", "--steps=1", "--threads=1", "--force"]).args(flags);
        let output = command.output().unwrap();
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        assert!(output.status.success(), "{text}");
        let is_reported = text.contains("face_friction = corners (--face-friction uniform: as a uniform pressure)");
        assert_eq!(text.contains("face_friction"), is_reported, "{text}");
        (case.last().meta.parameters.face_friction, is_reported)
    };
    assert_eq!(chosen(&case, &[]), (Some(FaceFriction::Uniform), false));
    fs::remove_file(compute).unwrap();
    assert_eq!(chosen(&case, &[]), (Some(FaceFriction::Corners), true));
    assert_eq!(chosen(&case, &["--accuracy=fine"]), (Some(FaceFriction::Corners), true));
    assert_eq!(chosen(&case, &["--face-friction=uniform"]), (Some(FaceFriction::Uniform), false));
    assert_eq!(chosen(&falling(), &[]), (None, false));
}
