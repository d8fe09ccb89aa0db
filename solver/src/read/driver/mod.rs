//! Reads the options of a run from a script of LMGC90, without running Python, for `--lmgc90`: `tokens` splits the script
//! into lines, `walk` finds the calls in their order, `values` evaluates arguments, `commands` states what calls mean, and
//! this file makes options of them.

mod commands;
mod tokens;
mod values;
mod walk;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use cd_formats::atomic;
use cd_formats::compute::{Compute, ComputeFlags};
use cd_formats::dof::Dof;
use cd_formats::error::{Fault, Faults};

pub use commands::table_rows;
use commands::{CommandMeaning, DriverSetting, find_command};
use tokens::script_tokens;
use values::{Evaluation, ScriptValue, UnknownValue};
use walk::{LoopEnd, ScriptCall, walk};

/// Ratio of the tolerance of cd-solve to that of LMGC90's norms `Quad ` and `QM/16`: with 1.666e-4, the value of
/// LMGC90's examples, `tol` is 1e-3. The norm is 0.003 to 0.03 of the residual in masonry and 0.2 to 1.5 of it in
/// granular matter; with 50 sweeps between two checks it is met in 85 % to 100 % of the steps, see
/// docs/reference/lmgc90.md.
const QUAD_TOL_FACTOR: f64 = 6.0;

/// Ratio of the tolerance of cd-solve to that of the norm `Maxm `, which is 3 to 20 times `Quad ` in the same scenes.
const MAXM_TOL_FACTOR: f64 = 1.0;

/// Largest tolerance that is set.
const MAX_TOL: f64 = 0.5;

/// Options of a script.
#[derive(Debug, Default)]
pub struct DriverSettings {
    pub options: ComputeFlags,
    /// Gravity, m/s².
    pub gravity: Option<[f64; 3]>,
    /// Lines of text about the values that were taken and the calls that were not.
    pub notes: Vec<String>,
}

/// Largest number of steps that are counted one by one, far above those of any run.
const MAX_COUNTED_STEPS: u64 = 100_000_000;

/// Reads a script for the folder `case`. `given`: options of the command line, which need no value in the script and
/// override it.
///
/// Rejected are calls that change the mechanics without a counterpart, and scripts whose time step, number of steps,
/// theta, tolerance, periods or gravity cannot be computed and are not given.
pub fn read_driver(path: &Path, case: &Path, given: &ComputeFlags) -> Result<DriverSettings, Faults> {
    let bytes = atomic::read_bytes(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let tokens = script_tokens(text.trim_start_matches('\u{feff}')).map_err(|unclosed| {
        Fault::new(path, Some(unclosed.line), unclosed.kind.name(), "is not closed", "expected a script of Python")
    })?;
    let script = walk(&tokens);
    let mut reader = DriverReader {
        path,
        case,
        pictures: None,
        given: given.given_names(),
        given_dt: given.dt,
        settings: DriverSettings::default(),
        faults: Faults::default(),
        remarks: script.remarks.into_iter().collect(),
        rejected: BTreeSet::new(),
        set_options: BTreeMap::new(),
        without_counterpart: BTreeMap::new(),
        has_stepped: false,
    };
    for rejected in script.rejected {
        let expected =
            "expected assignments and functions of one meaning, or the values as options instead of the script";
        reader.faults.push(Fault::new(path, Some(rejected.line), rejected.name, rejected.finding, expected));
    }
    reader.report_unread_files(&script.imports);
    script.calls.iter().for_each(|call| reader.read_call(call));
    reader.read_pictures();
    reader.read_steps(&script.calls);
    reader.report_missing_stages(&script.calls);
    reader.finish()
}

/// Value of an option in the script.
struct SetOption {
    /// Value as a text.
    text: String,
    line: usize,
}

/// Argument of a call.
#[derive(Clone, Copy)]
struct ScriptArgument<'a> {
    /// Position among those without a keyword.
    position: usize,
    /// Keywords that it may have.
    keywords: &'a [&'a str],
}

impl<'a> ScriptArgument<'a> {
    const fn new(position: usize, keywords: &'a [&'a str]) -> Self {
        ScriptArgument { position, keywords }
    }

    /// Value of the argument in a call; `None` if the call does not have it.
    fn value(&self, call: &ScriptCall) -> Option<Evaluation> {
        let keyword_argument = || call.keywords.iter().find(|(name, _)| self.keywords.contains(&name.as_str()));
        call.positional.get(self.position).or_else(|| keyword_argument().map(|(_, value)| value)).cloned()
    }

    /// Number that the argument states, or the reason why there is none.
    fn stated_number(&self, call: &ScriptCall) -> Result<f64, UnknownValue> {
        if let Some(line) = call.condition {
            return Err(format!("depends on the condition in line {line}").into());
        }
        match self.value(call) {
            None => Err(format!("has no argument {}", self.keywords.join(" or ")).into()),
            Some(Err(why)) => Err(format!("its value is not known: {why}").into()),
            Some(Ok(value)) => value.number().ok_or_else(|| "its value is no number".into()),
        }
    }
}

/// Reader of a script: sets options from its calls, and collects faults and notes.
struct DriverReader<'a> {
    path: &'a Path,
    /// Folder of the case.
    case: &'a Path,
    /// First call that writes pictures.
    pictures: Option<&'a ScriptCall>,
    /// Names of the options on the command line.
    given: Vec<&'static str>,
    given_dt: Option<f64>,
    settings: DriverSettings,
    faults: Faults,
    /// Remarks, each with its line of the script.
    remarks: BTreeSet<(usize, String)>,
    /// Lines, names and findings of the calls that are rejected.
    rejected: BTreeSet<(usize, String, String)>,
    /// Options that the script sets, by their names.
    set_options: BTreeMap<&'static str, SetOption>,
    /// Calls without counterpart, by the reason: names and lines.
    without_counterpart: BTreeMap<&'static str, Vec<(String, usize)>>,
    /// Whether a call that makes a step has been read.
    has_stepped: bool,
}

impl<'a> DriverReader<'a> {
    /// Reports imported modules that are files next to the script.
    fn report_unread_files(&mut self, imports: &[(usize, String)]) {
        for (line, module) in imports {
            let file = format!("{}.py", module.replace('.', "/"));
            if cd_formats::atomic::path_exists(&self.path.with_file_name(&file)) {
                self.remark(*line, format!("{file} is not read: its definitions are unknown"));
            }
        }
    }

    fn read_call(&mut self, call: &'a ScriptCall) {
        let Some(command) = find_command(&call.name) else {
            self.remark(call.line, format!("{}: is no known command, and is ignored", call.name));
            return;
        };
        match command.meaning {
            CommandMeaning::Implied => {}
            CommandMeaning::NotNeeded => {
                let known = self.without_counterpart.entry(command.counterpart).or_default();
                if known.iter().all(|(name, _)| *name != call.name) {
                    known.push((call.name.clone(), call.line));
                }
            }
            CommandMeaning::Rejected => self.reject(call, "is not supported", command.counterpart),
            CommandMeaning::Sets(setting) => self.read_setting(call, setting),
        }
    }

    fn read_setting(&mut self, call: &'a ScriptCall, setting: DriverSetting) {
        self.has_stepped |= matches!(setting, DriverSetting::Steps | DriverSetting::WholeStep);
        match setting {
            DriverSetting::TimeStep => {
                let value = self.read_number(call, ScriptArgument::new(0, &["dt"]), "dt");
                self.set_option(call, "dt", value, |options, x| options.dt = Some(x));
            }
            DriverSetting::Theta => {
                let value = self.read_number(call, ScriptArgument::new(0, &["theta"]), "theta");
                self.set_option(call, "theta", value, |options, x| options.theta = Some(x));
            }
            DriverSetting::Steps => {} // by the loop
            DriverSetting::Solver => self.read_solver(call),
            DriverSetting::WholeStep => {
                self.read_solver(call);
                self.read_output(call, 6);
                self.set_option(call, "text", Some(true), |options, text| options.text = Some(text));
            }
            DriverSetting::Start => {
                self.check_dimension(call);
                let dt = self.read_number(call, ScriptArgument::new(1, &["dt"]), "dt");
                self.set_option(call, "dt", dt, |options, x| options.dt = Some(x));
                let theta = self.read_number(call, ScriptArgument::new(2, &["theta"]), "theta");
                self.set_option(call, "theta", theta, |options, x| options.theta = Some(x));
                self.check_record(call, ScriptArgument::new(7, &["restart"]));
            }
            DriverSetting::SolverCheck => self.read_tolerance(call, [0, 1, 2]),
            DriverSetting::TextOutput | DriverSetting::Output => {
                self.read_output(call, 0);
                let text = (setting == DriverSetting::TextOutput).then_some(true);
                self.set_option(call, "text", text, |options, text| options.text = Some(text));
            }
            DriverSetting::Pictures => self.pictures = self.pictures.or(Some(call)),
            DriverSetting::Periods => {
                let x = self.read_period(call, ScriptArgument::new(0, &["xperiod"]), "xperiode");
                self.set_option(call, "xperiode", x, |options, x| options.xperiode = Some(x));
                let y = self.read_period(call, ScriptArgument::new(1, &["yperiod"]), "yperiode");
                self.set_option(call, "yperiode", y, |options, y| options.yperiode = Some(y));
            }
            DriverSetting::PeriodX => {
                let value = self.read_number(call, ScriptArgument::new(0, &["xperiod"]), "xperiode");
                self.set_option(call, "xperiode", value, |options, x| options.xperiode = Some(x));
            }
            DriverSetting::PeriodY => {
                let value = self.read_number(call, ScriptArgument::new(0, &["yperiod"]), "yperiode");
                self.set_option(call, "yperiode", value, |options, y| options.yperiode = Some(y));
            }
            DriverSetting::Gravity => self.read_gravity(call),
            DriverSetting::Dimension => self.check_dimension(call),
            DriverSetting::Record => self.check_record(call, ScriptArgument::new(0, &["record", "num"])),
            DriverSetting::Detection => {
                let period = ScriptArgument::new(0, &["freq_detec", "freq"]).value(call);
                let steps = period.and_then(Result::ok).and_then(|steps| steps.number());
                if let Some(steps) = steps.filter(|steps| *steps != 1.0) {
                    let remark = format!("{}: contacts are searched in each step, not every {steps}", call.name);
                    self.remark(call.line, remark);
                }
            }
        }
    }

    /// Rejects other than three dimensions.
    fn check_dimension(&mut self, call: &ScriptCall) {
        let value = ScriptArgument::new(0, &["dim", "idim"]).value(call);
        if let Some(Ok(value)) = value.filter(|value| *value != Ok(ScriptValue::Int(3))) {
            let found = format!("{} dimensions", value.number().map_or("other".into(), |x| x.to_string()));
            self.reject(call, &found, "expected a script for three");
        }
    }

    /// Rejects a start from another record than the files of DATBOX, which is record 0.
    fn check_record(&mut self, call: &ScriptCall, argument: ScriptArgument) {
        let value = argument.value(call);
        if !matches!(value, None | Some(Ok(ScriptValue::Int(0) | ScriptValue::None))) {
            self.reject(
                call,
                "does not start from DATBOX",
                "expected record 0; to start from record k, copy OUTBOX/DOF.OUT.k to DATBOX/DOF.INI and \
                 OUTBOX/Vloc_Rloc.OUT.k to DATBOX/Vloc_Rloc.INI",
            );
        }
    }

    fn read_solver(&mut self, call: &ScriptCall) {
        self.read_tolerance(call, [1, 2, 3]);
        let sweeps_in_block = ScriptArgument::new(4, &["gsit1", "nb_iter_check", "gs_it1"]);
        let block = self.read_optional_count(call, sweeps_in_block, "check_every");
        self.set_option(call, "check_every", block, |options, n| options.check_every = Some(n));
        let block_count = ScriptArgument::new(5, &["gsit2", "nb_block_iter", "gs_it2"]);
        let blocks = self.read_optional_count(call, block_count, "max_sweeps");
        let max_sweeps = block.zip(blocks).map(|(sweeps, checks)| sweeps.saturating_mul(checks));
        self.set_option(call, "max_sweeps", max_sweeps, |options, n| options.max_sweeps = Some(n));
    }

    /// Takes the interval of the output from the argument at a position.
    fn read_output(&mut self, call: &ScriptCall, position: usize) {
        let keywords = ["nsteps", "freq", "Nstep_writeDof", "nstep", "f_write"];
        let value = self.read_optional_count(call, ScriptArgument::new(position, &keywords), "output_every");
        self.set_option(call, "output_every", value, |options, n| options.output_every = Some(n));
    }

    /// Takes the interval of pictures as the interval of the output, if no call sets it.
    fn read_pictures(&mut self) {
        if let Some(call) = self.pictures.filter(|_| !self.set_options.contains_key("output_every")) {
            self.read_output(call, 0);
        }
    }

    /// Sets `tol` from norm, tolerance and relaxation, the arguments at these positions. A norm whose text cannot be computed
    /// is a fault, unless `tol` is given on the command line; one with another name is read as `Quad `, with a remark.
    fn read_tolerance(&mut self, call: &ScriptCall, [norm, tolerance, relaxation]: [usize; 3]) {
        let norm = match ScriptArgument::new(norm, &["norm", "checktype", "check_type"]).value(call) {
            // LMGC90 pads texts with blanks.
            Some(Ok(ScriptValue::Text(norm))) => format!("'{norm:<5}'"),
            Some(Err(_)) if self.given.contains(&"tol") => return,
            Some(Err(why)) => {
                let expected = "expected 'Quad ', 'QM/16' or 'Maxm ', or the option --tol";
                return self.reject(call, &format!("its norm is not known: {why}"), expected);
            }
            _ => "(not given)".into(),
        };
        let factor = if norm == "'Maxm '" { MAXM_TOL_FACTOR } else { QUAD_TOL_FACTOR };
        if !["'Quad '", "'QM/16'", "'Maxm '"].contains(&norm.as_str()) {
            let remark = format!("{}: norm {norm} is none of 'Quad ', 'QM/16', 'Maxm ': read as 'Quad '", call.name);
            self.remark(call.line, remark);
        }
        let value = self.read_number(call, ScriptArgument::new(tolerance, &["conv", "tol", "tolerance"]), "tol");
        let value = value.map(|x| (factor * x).min(MAX_TOL));
        // Without the digits of the product's rounding.
        let value = value.map(|x| format!("{x:.6e}").parse().unwrap_or(x));
        self.set_option(call, "tol", value, |options, x| options.tol = Some(x));
        let relaxation = ScriptArgument::new(relaxation, &["relax", "relaxation"]);
        let relaxed = relaxation.value(call).and_then(Result::ok).and_then(|x| x.number());
        if let Some(x) = relaxed.filter(|&x| x != 1.0) {
            self.remark(
                call.line,
                format!(
                    "{}: relaxation {x} has no counterpart; the motion can depend on it where friction leaves it open, \
                     see docs/explanation/limits.md",
                    call.name
                ),
            );
        }
    }

    fn read_gravity(&mut self, call: &ScriptCall) {
        let found = match ScriptArgument::new(0, &["gravity"]).value(call) {
            Some(Ok(ScriptValue::List(list))) if list.len() == 3 => {
                let numbers: Vec<f64> = list.iter().filter_map(ScriptValue::number).collect();
                <[f64; 3]>::try_from(numbers).map_err(|_| "has other values than numbers".to_string())
            }
            Some(Err(why)) => Err(format!("its value is not known: {why}")),
            _ => Err("has no three numbers".to_string()),
        };
        let expected = "expected three numbers (m/s²), or the gravity in BULK_BEHAV.DAT and no call";
        match (found, call.condition) {
            (Ok(_), None) if self.has_stepped => {
                self.reject(call, "sets the gravity after a step", "expected events `SetGravity`")
            }
            (Ok(gravity), None) if self.settings.gravity.is_none_or(|before| before == gravity) => {
                self.settings.gravity = Some(gravity);
                let [x, y, z] = gravity;
                self.remark(call.line, format!("{}: gravity = ({x}, {y}, {z}) m/s²", call.name));
            }
            (Ok(_), None) => {
                self.reject(call, "sets another gravity than a call before it", "expected events `SetGravity`")
            }
            (_, Some(line)) => self.reject(call, &format!("depends on the condition in line {line}"), expected),
            (Err(found), _) => self.reject(call, &found, expected),
        }
    }

    /// Sets the number of steps from the loops around the calls that begin a step.
    fn read_steps(&mut self, calls: &[ScriptCall]) {
        let begins_step = |call: &&ScriptCall| {
            let makes_step =
                |meaning| matches!(meaning, CommandMeaning::Sets(DriverSetting::Steps | DriverSetting::WholeStep));
            find_command(&call.name).is_some_and(|command| makes_step(command.meaning))
        };
        let steps: Vec<&ScriptCall> = calls.iter().filter(begins_step).collect();
        self.expect_set("dt", "TimeEvolution_SetTimeStep");
        if self.given.iter().any(|name| ["steps", "end_time"].contains(name)) {
            return;
        }
        let Some(&first) = steps.first() else {
            self.reject_length(None, "steps", "no call of IncrementStep is found");
            return;
        };
        let line = first.loops.last().map_or(first.line, |inner| inner.line);
        let mut total = 0u64;
        for call in &steps {
            let mut count = 1u64;
            for enclosing in &call.loops {
                match &enclosing.end {
                    LoopEnd::Count(times) => count = count.saturating_mul(*times),
                    &LoopEnd::Time { limit, inclusive }
                        if steps.len() == 1 && call.loops.len() == 1 && call.condition.is_none() =>
                    {
                        let end = self.end_of_time_loop(limit, inclusive);
                        self.set_option(call, "end_time", Some(end), |options, x| options.end_time = Some(x));
                        return;
                    }
                    LoopEnd::Time { .. } => {
                        self.reject_length(
                            Some(enclosing.line),
                            "loop",
                            "ends at a time, next to other loops of steps",
                        );
                        return;
                    }
                    LoopEnd::Unknown(why) => {
                        self.reject_length(Some(enclosing.line), "loop", &format!("its length is not known: {why}"));
                        return;
                    }
                }
            }
            if let Some(condition) = call.condition {
                let found = format!("depends on the condition in line {condition}");
                self.reject_length(Some(call.line), &call.name, &found);
                return;
            }
            total = total.saturating_add(count);
        }
        self.settings.options.steps = Some(total);
        self.remark(line, format!("loop of {}: steps = {total}", first.name));
    }

    /// Reports stages of a step that a script with a loop of its own leaves out, and that are computed in any case.
    fn report_missing_stages(&mut self, calls: &[ScriptCall]) {
        let makes_step = |call: &&ScriptCall| call.name.ends_with("IncrementStep");
        let Some(first) = calls.iter().find(makes_step) else { return };
        let stages = [
            ("ComputeFext", "gravity and other forces act"),
            ("SelectProxTactors", "contacts are searched"),
            ("ExSolver", "contacts are solved"),
        ];
        for (command, effect) in stages {
            if calls.iter().all(|call| !call.name.ends_with(command)) {
                self.remark(first.line, format!("no call of {command} is found: {effect} in each step all the same"));
            }
        }
    }

    /// `end_time` of a loop that makes steps while the time is below a limit, or at most that if `inclusive`: the limit, or
    /// the time of the last step where rounding or `inclusive` make more or fewer. Like LMGC90, the loop adds `dt` to the
    /// time in each step.
    fn end_of_time_loop(&self, limit: f64, inclusive: bool) -> f64 {
        let Some(dt) = self.given_dt.or(self.settings.options.dt).filter(|&dt| dt > 0.0) else { return limit };
        let start = Dof::read(&self.case.join("DATBOX/DOF.INI")).map_or(0.0, |dof| dof.time);
        let (mut steps, mut time) = (0, start);
        while time < limit || inclusive && time == limit {
            (steps, time) = (steps + 1, time + dt);
            if steps > MAX_COUNTED_STEPS {
                return limit;
            }
        }
        let by_limit = Compute { dt, end_time: Some(limit), ..Compute::default() }.last_step(0, (0, start));
        if by_limit == Some(steps) {
            return limit;
        }
        let end = start + steps as f64 * dt;
        // Without the digits of the product's rounding.
        format!("{end:.12e}").parse().unwrap_or(end)
    }

    /// Adds a fault of the number of steps.
    fn reject_length(&mut self, line: Option<usize>, object: &str, found: &str) {
        let expected = "expected the option --steps N or --end-time S";
        self.faults.push(Fault::new(self.path, line, object, found, expected));
    }

    /// Adds a fault if an option has no value.
    fn expect_set(&mut self, option: &'static str, command: &str) {
        let known = self.set_options.contains_key(option) || self.given.contains(&option);
        if !known
            && self.faults.0.iter().all(|fault| ![command, "computation.initialize"].contains(&fault.object.as_str()))
        {
            let expected = format!("expected the option --{option}");
            self.faults.push(Fault::new(self.path, None, option, format!("no call of {command} is found"), expected));
        }
    }

    /// Period that an argument states; `None` if there is no such argument or it is Python's `None`.
    fn read_period(&mut self, call: &ScriptCall, argument: ScriptArgument, option: &'static str) -> Option<f64> {
        if matches!(argument.value(call), None | Some(Ok(ScriptValue::None))) {
            None
        } else {
            self.read_number(call, argument, option)
        }
    }

    /// Number that an argument states; otherwise a fault, unless the option is given on the command line.
    fn read_number(&mut self, call: &ScriptCall, argument: ScriptArgument, option: &'static str) -> Option<f64> {
        match argument.stated_number(call) {
            Ok(value) => Some(value),
            Err(found) => {
                if !self.given.contains(&option) {
                    let expected = format!("expected a number, or the option --{}", option.replace('_', "-"));
                    self.reject(call, &found.0, &expected);
                }
                None
            }
        }
    }

    /// Positive integer that an argument states; otherwise a remark, and the option keeps its default.
    fn read_optional_count(
        &mut self,
        call: &ScriptCall,
        argument: ScriptArgument,
        option: &'static str,
    ) -> Option<u64> {
        let found = match argument.stated_number(call) {
            Ok(value) if value >= 1.0 && value.fract() == 0.0 && value < 1e15 => return Some(value as u64),
            Ok(value) => format!("{value}"),
            Err(_)
                if argument.position == 0
                    && call.positional.is_empty()
                    && call.keywords.is_empty()
                    && call.condition.is_none() =>
            {
                return Some(1);
            }
            Err(found) => found.0,
        };
        if !self.given.contains(&option) {
            let flag = option.replace('_', "-");
            self.remark(call.line, format!("{}: {option} is not taken: {found}; --{flag} N sets it", call.name));
        }
        None
    }

    /// Sets an option. A second value that differs is a fault, unless the option is given on the command line.
    fn set_option<T: std::fmt::Display>(
        &mut self,
        call: &ScriptCall,
        option: &'static str,
        value: Option<T>,
        set: impl FnOnce(&mut ComputeFlags, T),
    ) {
        let Some(value) = value else { return };
        let (text, flag) = (value.to_string(), option.replace('_', "-"));
        if let Some(SetOption { text: before, line }) = self.set_options.get(option) {
            if *before != text && !self.given.contains(&option) {
                let found = format!("{option} is {text}, and {before} in line {line}");
                self.reject(call, &found, &format!("expected one value, or the option --{flag}"));
            }
            return;
        }
        if self.given.contains(&option) {
            self.remark(call.line, format!("{}: {option} = {text} is overridden by --{flag}", call.name));
        } else {
            self.remark(call.line, format!("{}: {option} = {text}", call.name));
            set(&mut self.settings.options, value);
        }
        self.set_options.insert(option, SetOption { text, line: call.line });
    }

    fn remark(&mut self, line: usize, text: String) {
        self.remarks.insert((line, text));
    }

    fn reject(&mut self, call: &ScriptCall, found: &str, expected: &str) {
        if self.rejected.insert((call.line, call.name.clone(), found.to_string())) {
            self.faults.push(Fault::new(self.path, Some(call.line), call.name.as_str(), found, expected));
        }
    }

    fn finish(mut self) -> Result<DriverSettings, Faults> {
        let file = self.path.display();
        let mut notes: Vec<String> = self.remarks.iter().map(|(line, text)| format!("{file}:{line}: {text}")).collect();
        for (reason, calls) in &self.without_counterpart {
            let calls: Vec<String> = calls.iter().map(|(name, line)| format!("{name} (line {line})")).collect();
            notes.push(format!("{file}: without counterpart: {}: {reason}", calls.join(", ")));
        }
        if !self.set_options.contains_key("theta") && !self.given.contains(&"theta") {
            notes
                .push(format!("{file}: no call of Integrator_InitTheta is found: theta is that of COMPUTE.RON or 0.5"));
        }
        self.settings.notes = notes;
        self.faults.into_result(self.settings)
    }
}
