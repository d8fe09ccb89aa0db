//! Order of the calls in a script: its statements are followed without running Python. [`walk`] takes the lines of `tokens`
//! and finds the calls whose meaning `commands` states; `values` evaluates their arguments.
//!
//! Both branches of a condition without a known value are followed, and what they call is marked. Bodies of loops are
//! followed once. Functions of the script are followed where they are called.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;

use super::commands::{CommandMeaning, find_command};
use super::tokens::{BLOCK_KEYWORDS, Lexeme, LogicalLine, ScriptToken, ScriptTokens};
use super::values::{
    Evaluation, ScriptValue, Variables, after_bracket, dotted_name, evaluate, evaluate_operation, nested_count,
    outside_brackets, split_at,
};

/// Call of a command of LMGC90.
#[derive(Debug, Clone, PartialEq)]
pub struct ScriptCall {
    pub name: String,
    pub line: usize,
    pub positional: Vec<Evaluation>,
    pub keywords: Vec<(String, Evaluation)>,
    /// Line of the condition on which the call depends, if the condition has no known value.
    pub condition: Option<usize>,
    /// Loops around the call, the outermost first.
    pub loops: Vec<ScriptLoop>,
}

/// Loop with its line and end.
#[derive(Debug, Clone, PartialEq)]
pub struct ScriptLoop {
    pub line: usize,
    pub end: LoopEnd,
}

/// End of a loop.
#[derive(Debug, Clone, PartialEq)]
pub enum LoopEnd {
    /// After this many iterations.
    Count(u64),
    /// When the time of LMGC90 reaches `limit` (s), or exceeds it if `inclusive`.
    Time { limit: f64, inclusive: bool },
    /// Not known, for the part of the expression that is given.
    Unknown(String),
}

/// Calls and remarks of a script.
#[derive(Debug, Default)]
pub struct ScriptCalls {
    pub calls: Vec<ScriptCall>,
    /// Lines with remarks on parts that were not followed.
    pub remarks: Vec<(usize, String)>,
    /// Lines and names of imported modules that are not LMGC90's.
    pub imports: Vec<(usize, String)>,
    /// Uses in the order of their lines.
    pub rejected: BTreeSet<RejectedUse>,
}

/// Use of a name that changes values or functions in a way that is not followed.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RejectedUse {
    pub line: usize,
    pub name: String,
    /// Fault of the use, for the message after the name.
    pub finding: &'static str,
}

/// Name with which LMGC90 reports its time.
const TIME_COMMAND: &str = "TimeEvolution_GetTime";

/// Functions of LMGC90's module `chipy.computation`, which make several calls of `chipy`.
const COMPUTATION_FUNCTIONS: [&str; 5] =
    ["initialize", "one_step", "finalize", "initialize_non_linear", "one_step_non_linear"];

/// Functions that leave lists and dictionaries as they are, and return neither of them.
const PURE_FUNCTIONS: [&str; 12] =
    ["len", "int", "float", "str", "bool", "print", "range", "sum", "abs", "repr", "isinstance", "type"];

/// Methods that leave lists and dictionaries as they are.
const PURE_METHODS: [&str; 7] = ["get", "keys", "values", "items", "index", "count", "copy"];

/// Names by which a script changes variables and functions that its statements do not name.
const INDIRECT_NAMES: [&str; 7] = ["vars", "globals", "locals", "setattr", "delattr", "__setitem__", "__dict__"];

/// Functions that run code which is not read.
const CODE_RUNNERS: [&str; 4] = ["exec", "execfile", "runpy.run_path", "runpy.run_module"];

/// Functions that leave a module of LMGC90 that is passed to them as it is.
const MODULE_READERS: [&str; 7] = ["print", "hasattr", "help", "dir", "id", "type", "isinstance"];

/// Modules whose functions and constants are known by their names.
const KNOWN_MODULES: [&str; 5] = ["math", "numpy", "tqdm", "pylmgc90", "chipy"];

/// Value of a name that is a function or class of the script.
const DEFINITION_VALUE: &str = "a function or class of the script";

/// Functions that end a script.
const EXIT_FUNCTIONS: [&str; 4] = ["exit", "quit", "sys.exit", "os._exit"];

/// Deepest nesting of calls and blocks that is followed. Each level takes stack, and functions may call themselves.
const MAX_NESTING: usize = 32;

/// Largest cost of following a script, in bytes of statements that are followed or searched: some hundred times the cost of
/// a long script of LMGC90. Functions that call each other repeat statements without end.
const MAX_COST: usize = 2_000_000;

/// Cost of a variable that is copied and of a loop around a call, in bytes of a statement that take about as long.
const COPY_COST: usize = 8;

/// Largest number of iterations of a `while` loop, above the steps of any run: they are counted one at a time.
const MAX_COUNTED_ITERATIONS: f64 = 3e7;

/// Iterations that are counted for a cost of 1.
const ITERATIONS_PER_COST: u64 = 32;

/// Statement, with the block below it.
#[derive(Debug)]
struct ScriptStatement<'t> {
    tokens: &'t [Lexeme<'t>],
    body: Vec<ScriptStatement<'t>>,
}

impl<'t> ScriptStatement<'t> {
    /// Cost of following the statement without its body.
    fn cost(&self) -> usize {
        self.tokens.iter().map(|lexeme| 1 + lexeme.token.text().len()).sum()
    }

    fn line(&self) -> usize {
        self.tokens[0].line
    }

    fn keyword(&self) -> &'t str {
        self.tokens[0].token.name()
    }
}

/// Follows the statements of a script, and returns its calls and remarks.
pub fn walk(script: &ScriptTokens) -> ScriptCalls {
    let statements = read_block(&mut script.lines().peekable(), 0, 0);
    let mut walker = ScriptWalker::default();
    walker.find_functions(&statements);
    let mut assigned = BTreeSet::new();
    assigned_names(&statements, &mut assigned);
    walker.redefined.extend(assigned.into_iter().filter(|name| walker.functions.contains_key(name)));
    walker.find_shared_objects(&statements);
    walker.follow(&statements);
    walker.report_uncalled();
    if walker.cost.get() > MAX_COST {
        walker.found.remarks.push((1, "the functions repeat too many statements: the rest is not read".into()));
    }
    walker.found
}

/// Reads the statements of a block that is indented by at least `indent`.
fn read_block<'t, L>(lines: &mut Peekable<L>, indent: usize, depth: usize) -> Vec<ScriptStatement<'t>>
where
    L: Iterator<Item = LogicalLine<'t>>,
{
    let mut block = Vec::new();
    while let Some(line) = lines.next_if(|line| line.indent >= indent) {
        let own_indent = line.indent;
        let mut statement = split_header(line.tokens);
        let deeper = lines.peek().is_some_and(|next| next.indent > own_indent);
        if deeper && depth < MAX_NESTING {
            statement.body.extend(read_block(lines, own_indent + 1, depth + 1));
        }
        block.push(statement);
    }
    block
}

/// Separates a statement on the line of its header, as in `if x: y = 1`.
fn split_header<'t>(tokens: &'t [Lexeme<'t>]) -> ScriptStatement<'t> {
    if !BLOCK_KEYWORDS.contains(&tokens[0].token.name()) {
        return ScriptStatement { tokens, body: Vec::new() };
    }
    let header = split_at(tokens, ":").first().map_or(0, |header| header.len());
    let rest = tokens.get(header + 1..).unwrap_or_default();
    let body = if rest.is_empty() { Vec::new() } else { vec![ScriptStatement { tokens: rest, body: Vec::new() }] };
    ScriptStatement { tokens: &tokens[..header.max(1)], body }
}

/// State of following a script: its variables, functions, loops and conditions, and the calls that were found.
#[derive(Default)]
struct ScriptWalker<'a> {
    found: ScriptCalls,
    variables: Variables,
    /// Functions of the script by name.
    functions: BTreeMap<String, &'a ScriptStatement<'a>>,
    /// Classes of the script by name.
    classes: BTreeMap<String, &'a ScriptStatement<'a>>,
    called_functions: BTreeSet<String>,
    /// Functions and classes with a decorator, which may call or change them.
    decorated: BTreeSet<String>,
    /// Values of the parameters of a function that has been defined, by its name; `None` for those without default.
    defaults: BTreeMap<String, Vec<Option<Evaluation>>>,
    /// Names of objects that the script passes on or copies, or whose methods it calls: their attributes may change.
    shared_objects: BTreeSet<String>,
    /// Functions with more than one definition.
    redefined: BTreeSet<String>,
    /// Variables that a function declares as global or nonlocal, and attributes that a function sets.
    globals: BTreeSet<String>,
    /// Names by which the script knows the module `chipy`.
    chipy_names: BTreeSet<String>,
    /// Names by which it knows the module `chipy.computation`.
    computation_names: BTreeSet<String>,
    /// Commands by the names without prefix that the script gives them.
    command_aliases: BTreeMap<String, String>,
    /// Whether all names of `chipy` are imported without prefix.
    all_names_imported: bool,
    /// Line of the condition without a known value on which the statement depends.
    condition: Option<usize>,
    /// Line of a condition under which a `continue` or `return` skips the rest of the loop or function.
    skip_condition: Option<usize>,
    /// Whether the rest of the block is not reached.
    is_block_ended: bool,
    /// Whether the rest of the script is not reached.
    is_script_ended: bool,
    /// Loops around the statement, the outermost first.
    loops: Vec<ScriptLoop>,
    /// Number of blocks around the statement, with those of the calls that lead to it.
    depth: usize,
    /// Cost of the statements that have been followed or searched, at most [`MAX_COST`] and the last addition.
    cost: Cell<usize>,
}

impl<'a> ScriptWalker<'a> {
    /// Adds a cost before it arises; returns whether it is within [`MAX_COST`].
    fn add_cost(&self, cost: usize) -> bool {
        if self.cost.get() <= MAX_COST {
            self.cost.set(self.cost.get().saturating_add(cost));
        }
        self.cost.get() <= MAX_COST
    }

    /// Copy of the variables, to restore them.
    fn saved_variables(&self) -> Variables {
        self.add_cost(COPY_COST * self.variables.len());
        self.variables.clone()
    }

    fn reject(&mut self, line: usize, name: impl Into<String>, finding: &'static str) {
        self.found.rejected.insert(RejectedUse { line, name: name.into(), finding });
    }

    /// Records the functions, classes and global variables of a block, and names that change variables indirectly.
    fn find_functions(&mut self, block: &'a [ScriptStatement<'a>]) {
        let mut has_decorator = false;
        for statement in block {
            for lexeme in statement.tokens.iter().filter(|lexeme| INDIRECT_NAMES.contains(&lexeme.token.name())) {
                let finding = "changes or reads variables by other means than their names";
                self.reject(lexeme.line, lexeme.token.name(), finding);
            }
            let name = statement.tokens.get(1).map_or("", |lexeme| lexeme.token.name()).to_string();
            match statement.keyword() {
                "def" => {
                    self.variables.insert(name.clone(), Err(DEFINITION_VALUE.into()));
                    if has_decorator {
                        self.decorated.insert(name.clone());
                    }
                    if self.functions.insert(name.clone(), statement).is_some() {
                        self.redefined.insert(name);
                    }
                    self.find_functions(&statement.body);
                }
                "global" | "nonlocal" => {
                    self.globals.extend(statement.tokens[1..].iter().map(|lexeme| lexeme.token.name().to_string()));
                }
                "class" => {
                    self.variables.insert(name.clone(), Err(DEFINITION_VALUE.into()));
                    if has_decorator {
                        self.decorated.insert(name.clone());
                    }
                    self.classes.insert(name, statement);
                }
                _ => self.find_functions(&statement.body),
            }
            has_decorator = statement.tokens[0].token.is("@");
        }
    }

    /// Records the names of objects that may change by other names, and attributes that functions set.
    fn find_shared_objects(&mut self, block: &[ScriptStatement]) {
        for ScriptStatement { tokens, body } in block {
            let mut index = 0;
            while index < tokens.len() {
                let (start, (name, end)) = (index, dotted_name(tokens, index));
                index = end;
                let follows_word =
                    |words: &[&str]| start > 0 && words.contains(&tokens[start - 1].token.source().as_ref());
                let precedes_symbol = |symbol: &str| tokens.get(end).is_some_and(|lexeme| lexeme.token.is(symbol));
                let is_target = precedes_symbol("=") || start == 0 && precedes_symbol(":");
                if name.is_empty()
                    || is_target
                    || follows_word(&[".", "class", "def", "import", "as", "from", "global"])
                {
                    continue;
                }
                let used = match name.rsplit_once('.') {
                    _ if !precedes_symbol("(") => &name,
                    Some((object, _)) => object,
                    None if self.functions.contains_key(&name) || self.classes.contains_key(&name) => continue,
                    None => &name,
                };
                self.shared_objects.insert(used.to_string());
            }
            if tokens[0].token.name() == "def" {
                let mut assigned = BTreeSet::new();
                assigned_names(body, &mut assigned);
                self.globals.extend(assigned.into_iter().filter(|name| name.contains('.')));
            }
            self.find_shared_objects(body);
        }
    }

    /// Follows the statements of a block in their order.
    fn follow(&mut self, block: &'a [ScriptStatement<'a>]) {
        self.depth += 1;
        // Value of the last condition of a chain of `if` and `elif`: whether a branch was taken, unless it is not known.
        let mut branch_taken = Some(true);
        for statement in block {
            let is_unreached = self.depth > MAX_NESTING || self.is_block_ended || self.is_script_ended;
            if is_unreached || !self.add_cost(statement.cost()) {
                break;
            }
            let line = statement.line();
            self.condition = self.condition.or(self.skip_condition);
            match statement.keyword() {
                "def" => self.define(statement),
                "class" if self.is_constant_class(statement) => self.set_class_attributes(statement),
                "class" => self.report_unread(statement, "class"),
                keyword @ ("if" | "elif" | "else") => {
                    if keyword == "if" {
                        branch_taken = Some(false);
                    }
                    if branch_taken == Some(true) {
                        continue;
                    }
                    let outer = self.condition;
                    if branch_taken.is_none() {
                        self.condition = outer.or(Some(line));
                    }
                    self.find_calls(&statement.tokens[1..]);
                    self.condition = outer;
                    let condition = if keyword == "else" {
                        Some(true)
                    } else {
                        self.value(&statement.tokens[1..]).ok().map(|value| value.is_true())
                    };
                    match (branch_taken, condition) {
                        (_, Some(false)) => {}
                        (Some(false), Some(true)) => {
                            self.follow(&statement.body);
                            branch_taken = Some(true);
                        }
                        _ => {
                            self.follow_conditional(&statement.body, line);
                            branch_taken = None;
                        }
                    }
                }
                "except" => self.follow_conditional(&statement.body, line),
                "for" | "while" | "async" => {
                    branch_taken = Some(false); // an `else` after a loop is followed
                    self.follow_loop(statement);
                }
                "try" | "with" | "finally" => {
                    branch_taken = Some(false);
                    self.find_calls(&statement.tokens[1..]);
                    self.forget_objects(&statement.tokens[1..]);
                    for (index, _) in statement.tokens.iter().enumerate().filter(|(_, word)| word.token.name() == "as")
                    {
                        let names = statement.tokens[index + 1..].split(|lexeme| lexeme.token.is(",")).next();
                        let names = target_names(names.unwrap_or_default());
                        names.iter().for_each(|name| self.make_unknown(name, "which a context sets"));
                    }
                    self.follow(&statement.body);
                }
                "del" => {
                    statement.tokens[1..].iter().for_each(|lexeme| self.make_unknown(lexeme.token.name(), "deleted"))
                }
                "import" | "from" => self.import(statement.tokens),
                "continue" | "return" => {
                    self.find_calls(&statement.tokens[1..]);
                    // The caller may change the returned value under another name.
                    self.forget_objects(&statement.tokens[1..]);
                    match self.condition {
                        Some(line) => self.skip_condition = self.skip_condition.or(Some(line)),
                        None => self.is_block_ended = true,
                    }
                }
                _ => {
                    self.assign(statement.tokens);
                    self.note_exit(statement);
                }
            }
        }
        self.depth -= 1;
    }

    /// Computes the default arguments of a function, as Python does where the function is defined.
    fn define(&mut self, function: &ScriptStatement) {
        let mut defaults = Vec::new();
        for parameter in parameters(function) {
            let default = split_at(parameter, "=").get(1).copied();
            default.into_iter().for_each(|default| self.find_calls(default));
            defaults.push(default.map(|default| self.value(default)));
        }
        self.defaults.insert(function.tokens.get(1).map_or("", |lexeme| lexeme.token.name()).to_string(), defaults);
    }

    /// Whether a class has no base but `object`, no decorator, and nothing but assignments to single names, texts and `pass`.
    fn is_constant_class(&self, class: &ScriptStatement) -> bool {
        let header: String = class.tokens.iter().skip(2).map(|lexeme| lexeme.token.source()).collect();
        let name = class.tokens.get(1).map_or("", |lexeme| lexeme.token.name());
        let is_constant = |statement: &ScriptStatement| match statement.tokens {
            [only] => matches!(only.token, ScriptToken::Text(_)) || only.token.name() == "pass",
            tokens => class_attribute(tokens).is_some(),
        };
        ["", "()", "(object)"].contains(&header.as_str())
            && !self.decorated.contains(name)
            && class.body.iter().all(is_constant)
    }

    /// Sets the attributes of a class of constants; those that come first are names in the values of later ones.
    fn set_class_attributes(&mut self, class: &ScriptStatement) {
        let outer = self.saved_variables();
        let mut attributes = Vec::new();
        for statement in &class.body {
            let Some((name, value)) = class_attribute(statement.tokens) else { continue };
            self.find_calls(value);
            let value = self.value(value);
            self.variables.insert(name.to_string(), value.clone());
            attributes.push((format!("{}.{name}", class.tokens[1].token.name()), value, statement.line()));
        }
        self.variables = outer;
        for (name, value, line) in attributes {
            self.set_variable(&name, value, line);
        }
    }

    /// Ends the script at an exit that is in no condition and no loop; others are for errors.
    fn note_exit(&mut self, statement: &ScriptStatement) {
        let (name, end) = dotted_name(statement.tokens, 0);
        let called = statement.tokens.get(end).is_some_and(|lexeme| lexeme.token.is("("));
        if called && EXIT_FUNCTIONS.contains(&name.as_str()) && self.condition.is_none() && self.loops.is_empty() {
            self.found.remarks.push((statement.line(), format!("{name}: the rest of the script is not read")));
            self.is_script_ended = true;
        }
    }

    /// Follows the body of a loop or function, whose `continue` or `return` ends there.
    fn follow_loop_or_function_body(&mut self, block: &'a [ScriptStatement<'a>]) {
        let (condition, skipped) = (self.condition, self.skip_condition.take());
        self.follow(block);
        (self.condition, self.skip_condition, self.is_block_ended) = (condition, skipped, false);
    }

    /// Follows a block whose condition, in `line`, has no known value.
    fn follow_conditional(&mut self, block: &'a [ScriptStatement], line: usize) {
        let outer = self.condition.replace(self.condition.unwrap_or(line));
        self.follow(block);
        self.condition = outer;
    }

    /// Follows the body of a loop once; variables that it changes are not known in it.
    fn follow_loop(&mut self, statement: &'a ScriptStatement<'a>) {
        let (line, tokens) = (statement.line(), &statement.tokens[1..]);
        self.find_calls(tokens);
        let position = tokens.iter().position(|lexeme| lexeme.token.name() == "in");
        let unknown_end = |why: String| LoopEnd::Unknown(why);
        let iterable = position.map(|position| self.value(&tokens[position + 1..]));
        if let Some(Ok(list)) = &iterable {
            list.forget_items();
        }
        if self.loops.is_empty() {
            self.find_changes(statement);
        }
        let changing = format!("which changes in the loop of line {line}");
        let end = match (statement.keyword(), position) {
            ("for", Some(position)) => {
                for name in target_names(&tokens[..position]) {
                    self.make_unknown(&name, &changing);
                }
                match iterable {
                    Some(Ok(ScriptValue::Range(count))) => LoopEnd::Count(count),
                    Some(Ok(ScriptValue::List(list))) => LoopEnd::Count(list.len() as u64),
                    Some(Err(why)) => unknown_end(why.0),
                    _ => unknown_end("no range".into()),
                }
            }
            ("while", _) => {
                self.time_limit(tokens).or_else(|| self.counted_loop(tokens, &statement.body)).unwrap_or_else(|| {
                    unknown_end(tokens.iter().map(|lexeme| lexeme.token.source()).collect::<Vec<_>>().join(" "))
                })
            }
            _ => unknown_end("an asynchronous loop".into()),
        };
        // The condition of a `break` or `return` is not followed from step to step.
        let end = break_line(&statement.body).map_or(end, |(word, line)| unknown_end(format!("{word} in line {line}")));
        self.add_cost(block_cost(&statement.body) + COPY_COST * self.globals.len());
        let mut changed = BTreeSet::new();
        assigned_names(&statement.body, &mut changed);
        changed.iter().for_each(|name| self.make_unknown(name, &changing));
        self.loops.push(ScriptLoop { line, end });
        self.follow_loop_or_function_body(&statement.body);
        self.loops.pop();
    }

    /// Follows the body of a loop for the lists and dictionaries that it changes; all else is restored. The first
    /// iteration may read values that the body changes later.
    fn find_changes(&mut self, statement: &'a ScriptStatement<'a>) {
        let (variables, imported) = (self.saved_variables(), self.command_aliases.clone());
        let (calls, remarks) = (self.found.calls.len(), self.found.remarks.len());
        self.loops.push(ScriptLoop { line: statement.line(), end: LoopEnd::Count(1) });
        self.follow_loop_or_function_body(&statement.body);
        self.loops.pop();
        self.found.calls.truncate(calls);
        self.found.remarks.truncate(remarks);
        (self.variables, self.command_aliases) = (variables, imported);
    }

    /// End of a loop with the condition that LMGC90's time is before a value.
    fn time_limit(&self, mut tokens: &[Lexeme]) -> Option<LoopEnd> {
        let mut negated = false;
        loop {
            let first = &tokens.first()?.token;
            if first.is("(") && after_bracket(tokens, 0) == tokens.len() {
                tokens = &tokens[1..tokens.len() - 1];
            } else if first.name() == "not" && !depends_on_values(tokens) {
                (tokens, negated) = (&tokens[1..], !negated);
            } else {
                break;
            }
        }
        const SIGNS: [&str; 4] = ["<", "<=", ">", ">="];
        let position = tokens.iter().position(|lexeme| SIGNS.iter().any(|sign| lexeme.token.is(sign)))?;
        let (left, right) = (&tokens[..position], &tokens[position + 1..]);
        let is_time = |side: &[Lexeme]| {
            let Some((name, end)) = side.first().map(|_| dotted_name(side, 0)) else { return false };
            let is_call = matches!(&side[end..], [open, close] if open.token.is("(") && close.token.is(")"));
            is_call && self.command(&name).as_deref() == Some(TIME_COMMAND)
        };
        let time_first = is_time(left);
        if !time_first && !is_time(right) {
            return None;
        }
        let sign = tokens[position].token.text();
        // The condition `time < limit` or `time <= limit` in its four forms.
        let is_before = (sign.starts_with('<') == time_first) != negated;
        let inclusive = sign.ends_with('=') != negated;
        let limit = evaluate(if time_first { right } else { left }, &self.variables).ok()?.number()?;
        is_before.then_some(LoopEnd::Time { limit, inclusive })
    }

    /// Number of iterations of a loop whose condition compares a variable with a value, and whose body adds to the variable
    /// once in each iteration, as in `while k < 20: ...; k += 1`.
    fn counted_loop(&self, tokens: &[Lexeme], body: &[ScriptStatement]) -> Option<LoopEnd> {
        const SIGNS: [&str; 5] = ["<", "<=", ">", ">=", "!="];
        let position = tokens.iter().position(|lexeme| SIGNS.iter().any(|sign| lexeme.token.is(sign)))?;
        let (left, right) = (&tokens[..position], &tokens[position + 1..]);
        let mut changed = Vec::new();
        all_assigned_names(body, &mut changed);
        changed.extend(self.globals.iter().cloned());
        let changed_names: BTreeSet<&String> = changed.iter().collect();
        let is_fixed = |tokens: &[Lexeme]| {
            let names = (0..tokens.len()).filter(|&index| !tokens[index].token.name().is_empty());
            names.map(|index| dotted_name(tokens, index).0).all(|name| !changed_names.contains(&name))
        };
        let number = |tokens: &[Lexeme]| evaluate(tokens, &self.variables).ok()?.number();
        let counter_first = !is_fixed(left);
        let (counter, limit) = if counter_first { (left, right) } else { (right, left) };
        let (name, end) = counter.first().map(|_| dotted_name(counter, 0))?;
        if counter.len() != end || name.is_empty() || !is_fixed(limit) {
            return None;
        }
        let [once] = changed.iter().filter(|other| **other == name).collect::<Vec<_>>()[..] else { return None };
        let step = body.iter().find_map(|statement| {
            let added = added_term(statement.tokens, once)?;
            is_fixed(added.expression).then(|| number(added.expression)).flatten().map(|term| added.sign * term)
        })?;
        let (mut value, limit) = (number(counter)?, number(limit)?);
        let sign = tokens[position].token.text();
        let is_true_for = |value: f64| {
            let (a, b) = if counter_first { (value, limit) } else { (limit, value) };
            match sign {
                "<" => a < b,
                "<=" => a <= b,
                ">" => a > b,
                ">=" => a >= b,
                _ => a != b,
            }
        };
        // Without the roundings of each step; a loop of far more iterations, as `while k != 20` from 0.5, does not end.
        let expected_count = (limit - value) / step;
        if is_true_for(value) && !(0.0..MAX_COUNTED_ITERATIONS).contains(&expected_count) {
            return None;
        }
        let mut count = 0;
        // Added step by step, with the roundings of Python.
        while is_true_for(value) {
            (count, value) = (count + 1, value + step);
            if count as f64 > 1.001 * expected_count + 2.0
                || !self.add_cost(usize::from(count % ITERATIONS_PER_COST == 0))
            {
                return None;
            }
        }
        Some(LoopEnd::Count(count))
    }

    /// Records the names by which `chipy`, its modules and its commands are imported.
    fn import(&mut self, tokens: &[Lexeme]) {
        let position = tokens.iter().position(|lexeme| lexeme.token.name() == "import").unwrap_or(0);
        let from = (position > 1).then(|| dotted_name(tokens, 1).0);
        let mut names = &tokens[position + 1..];
        if names.first().is_some_and(|lexeme| lexeme.token.is("(")) {
            names = &names[1..names.len().max(2) - 1];
        }
        for part in split_at(names, ",").into_iter().filter(|part| !part.is_empty()) {
            let (name, end) = dotted_name(part, 0);
            let name = if part[0].token.is("*") { "*".to_string() } else { name };
            let alias = part.get(end).filter(|lexeme| lexeme.token.name() == "as").and(part.get(end + 1));
            let alias = alias.map_or(name.clone(), |lexeme| lexeme.token.name().to_string());
            let full_name = from.as_ref().map_or(name.clone(), |module| format!("{module}.{name}"));
            self.add_alias(&full_name, &alias);
            let module = from.as_ref().unwrap_or(&name);
            let is_known = KNOWN_MODULES.contains(&module.split('.').next().unwrap_or_default());
            if name == "*" && !is_known {
                let names: Vec<String> = self.variables.keys().cloned().collect();
                names.iter().for_each(|name| self.make_unknown(name, "which a module may set"));
            } else if !is_known {
                self.make_unknown(&alias, "which is imported");
            }
            if !module.contains("chipy") && !module.contains("pylmgc90") {
                self.found.imports.push((tokens[0].line, module.clone()));
            }
        }
    }

    /// Gives an object of LMGC90, as `pylmgc90.chipy.SetDimension`, another name.
    fn add_alias(&mut self, full_name: &str, alias: &str) {
        let parts: Vec<&str> = full_name.split('.').filter(|part| !["lmgc90", "macro"].contains(part)).collect();
        let Some(chipy) = parts.iter().position(|part| *part == "chipy") else {
            if ["pylmgc90", "pylmgc90.*"].contains(&full_name) {
                let module = if alias == "*" { "chipy".to_string() } else { format!("{alias}.chipy") };
                self.add_alias("pylmgc90.chipy", &module);
            }
            return;
        };
        match parts[chipy + 1..] {
            [] => {
                self.chipy_names.insert(alias.to_string());
                self.computation_names.insert(format!("{alias}.computation"));
                for part in ["lmgc90", "macro"] {
                    self.chipy_names.insert(format!("{alias}.{part}"));
                }
            }
            ["*"] => {
                self.all_names_imported = true;
                self.computation_names.insert("computation".to_string());
            }
            ["computation"] => drop(self.computation_names.insert(alias.to_string())),
            ["computation", "*"] => {
                let full_alias = |name: &str| (name.to_string(), format!("computation.{name}"));
                self.command_aliases.extend(COMPUTATION_FUNCTIONS.map(full_alias));
            }
            [.., name] => {
                let module = if parts[chipy + 1] == "computation" { "computation." } else { "" };
                self.command_aliases.insert(alias.to_string(), format!("{module}{name}"));
            }
        }
    }

    /// Records another name for the module or a command, as in `step = chipy.IncrementStep`.
    fn add_assigned_alias(&mut self, target: &[Lexeme], value: &[Lexeme]) {
        let [name] = target else { return };
        let name = name.token.name().to_string();
        self.command_aliases.remove(&name);
        if name.is_empty() || value.first().is_none_or(|lexeme| lexeme.token.name().is_empty()) {
            return;
        }
        let (full_name, end) = dotted_name(value, 0);
        if end != value.len() {
            return;
        }
        if self.chipy_names.contains(&full_name) {
            self.add_alias("pylmgc90.chipy", &name);
        } else if self.computation_names.contains(&full_name) {
            self.computation_names.insert(name);
        } else if let Some(command) = self.command(&full_name) {
            self.command_aliases.insert(name, command);
        }
    }

    /// Follows an assignment, or the calls of any other statement.
    fn assign(&mut self, tokens: &[Lexeme]) {
        self.find_calls(tokens);
        if tokens.iter().any(|lexeme| lexeme.token.name() == "yield") {
            self.forget_objects(tokens);
        }
        let parts = split_at(tokens, "=");
        let augmented = tokens.iter().position(|lexeme| lexeme.token.assigns() && !lexeme.token.is("="));
        if let Some(position) = augmented.filter(|&position| position > 0) {
            let (name, _) = dotted_name(tokens, 0);
            let (target, added) = (&tokens[..position], &tokens[position + 1..]);
            let operator = tokens[position].token.text().trim_end_matches('=');
            let value = self.value(target).and_then(|before| evaluate_operation(operator, before, self.value(added)?));
            // A list is extended in place.
            if value.is_err() {
                self.forget_objects(tokens);
                self.make_unknown(&name, "which changes in part");
            }
            self.set_target(target, value);
        } else if let Some((&value, targets)) = parts.split_last().filter(|(_, targets)| !targets.is_empty()) {
            for target in targets {
                self.check_command(target, value);
                self.add_assigned_alias(target, value);
            }
            let value_tokens = value;
            let value = self.value(value_tokens);
            for target in targets {
                // `dt: float = 1e-3`
                let target = split_at(target, ":").first().copied().unwrap_or(target);
                let names = split_at(target, ",");
                match &value {
                    Ok(ScriptValue::List(list)) if names.len() > 1 && names.len() == list.len() => {
                        let pairs = names.into_iter().zip(list.iter());
                        pairs.for_each(|(name, item)| self.set_target(name, Ok(item.clone())));
                    }
                    value if names.len() == 1 => self.set_target(target, value.clone()),
                    _ => {
                        self.forget_objects(value_tokens);
                        names.into_iter().for_each(|name| self.set_target(name, Err("a part of a value".into())));
                    }
                }
            }
        }
    }

    fn set_target(&mut self, target: &[Lexeme], value: Evaluation) {
        let Some(first) = target.iter().position(|lexeme| !lexeme.token.name().is_empty()) else { return };
        let (name, end) = dotted_name(target, first);
        let changed_in_part = target.get(end).is_some_and(|lexeme| lexeme.token.is("["));
        let value = if changed_in_part { self.with_item(&name, &target[end..], value) } else { value };
        self.set_variable(&name, value, target[first].line);
    }

    /// Dictionary `name` with the item in brackets set; an error for other values, which change in part.
    fn with_item(&self, name: &str, brackets: &[Lexeme], item: Evaluation) -> Evaluation {
        let key = brackets.get(1..brackets.len().saturating_sub(1)).map(|key| evaluate(key, &self.variables));
        match (self.variables.get(name), key, item) {
            (Some(Ok(known @ ScriptValue::Map(map))), Some(Ok(ScriptValue::Text(key))), Ok(item))
                if !map.is_shared() && !known.is_forgotten() =>
            {
                self.add_cost(COPY_COST * map.len());
                let mut map = BTreeMap::clone(map);
                map.insert(key, item);
                ScriptValue::map(map)
            }
            (before, _, item) => {
                before.into_iter().flatten().chain(&item.ok()).for_each(ScriptValue::forget);
                Err("which changes in part".into())
            }
        }
    }

    /// Value of an expression; lists and dictionaries in one that is not known may have other names after it.
    fn value(&self, tokens: &[Lexeme]) -> Evaluation {
        self.add_cost(nested_count(tokens));
        let value = evaluate(tokens, &self.variables);
        if value.is_err() {
            self.forget_objects(tokens);
        }
        value
    }

    /// Makes lists and dictionaries unknown that code which is not followed may change through this expression.
    fn forget_objects(&self, tokens: &[Lexeme]) {
        // Calls of what calls return read the same tokens again.
        if !self.add_cost(tokens.len()) {
            return;
        }
        let mut index = 0;
        while index < tokens.len() {
            let (start, (name, after_name)) = (index, dotted_name(tokens, index));
            index = if name.is_empty() { index + 1 } else { after_name };
            let called = tokens.get(index).is_some_and(|lexeme| lexeme.token.is("("));
            if name.is_empty() || start > 0 && tokens[start - 1].token.is(".") {
                continue;
            }
            // Functions of the script are followed.
            if called && (PURE_FUNCTIONS.contains(&name.as_str()) || self.functions.contains_key(&name)) {
                index = after_bracket(tokens, index);
                continue;
            }
            let mut end = index;
            while tokens.get(end).is_some_and(|lexeme| lexeme.token.is("[")) {
                end = after_bracket(tokens, end);
            }
            let prefixes = name.match_indices('.').map(|(point, _)| &name[..point]).chain([name.as_str()]);
            for known in prefixes.filter_map(|prefix| self.variables.get(prefix)).flatten() {
                match evaluate(&tokens[start..end], &self.variables) {
                    Ok(item) => item.forget(),
                    Err(_) if end > index || is_pure_method(&name) => known.forget_items(),
                    Err(_) => known.forget(),
                }
            }
        }
    }

    /// Makes a variable unknown, and the list or dictionary that it is by its other names too.
    fn make_unknown(&mut self, name: &str, why: &str) {
        if let Some(Ok(before)) = self.variables.insert(name.to_string(), Err(why.into())) {
            before.forget();
        }
    }

    /// Rejects an assignment of another value to a command of LMGC90.
    fn check_command(&mut self, target: &[Lexeme], value: &[Lexeme]) {
        let [first, ..] = target else { return };
        let (name, end) = dotted_name(target, 0);
        let command = self.command(&name).filter(|command| end == target.len() && find_command(command).is_some());
        let same = value.first().is_some_and(|_| self.command(&dotted_name(value, 0).0) == command);
        if command.is_some() && !same {
            self.reject(first.line, name, "is a command of LMGC90 with another value");
        }
    }

    fn set_variable(&mut self, name: &str, value: Evaluation, line: usize) {
        let mut objects = name.match_indices('.').map(|(point, _)| &name[..point]);
        if let Some(object) = objects.find(|object| self.shared_objects.contains(*object)) {
            let why = format!("an attribute of {object}, which the script also passes on, copies or calls methods of");
            self.make_unknown(name, &why);
            value.iter().for_each(ScriptValue::forget);
            return;
        }
        if let (Ok(value), true) = (&value, self.condition.is_some() || self.globals.contains(name)) {
            value.forget();
        }
        let value = match (value, self.condition) {
            _ if self.globals.contains(name) => Err("which a function sets as a global variable".into()),
            (_, Some(condition)) => Err(format!("which depends on the condition in line {condition}").into()),
            (Ok(value), None) => Ok(value),
            (Err(why), None) => Err(format!("set in line {line} from {why}").into()),
        };
        self.variables.insert(name.to_string(), value);
    }

    /// Name of the command of LMGC90 that a name in the script means, if it means one.
    fn command(&self, name: &str) -> Option<String> {
        if let Some(command) = self.command_aliases.get(name) {
            return Some(command.clone());
        }
        match name.rsplit_once('.') {
            Some((module, command)) if self.computation_names.contains(module) => {
                Some(format!("computation.{command}"))
            }
            Some((module, command)) => self.chipy_names.contains(module).then(|| command.to_string()),
            None => (self.all_names_imported
                && has_command_form(name)
                && !self.functions.contains_key(name)
                && !self.classes.contains_key(name))
            .then(|| name.to_string()),
        }
    }

    /// Records the calls in a statement, arguments before the call that they belong to.
    fn find_calls(&mut self, tokens: &[Lexeme]) {
        let has_word = |word: &str| tokens.iter().any(|lexeme| lexeme.token.name() == word);
        let Some(line) = tokens.first().map(|lexeme| lexeme.line) else { return };
        for pair in tokens.windows(2).filter(|pair| pair[1].token.is(":=")) {
            self.forget_objects(tokens);
            self.make_unknown(pair[0].token.name(), "which is set in an expression");
        }
        let (outer_condition, outer_loop_count) = (self.condition, self.loops.len());
        let unknown_loop = |what: &str| ScriptLoop { line, end: LoopEnd::Unknown(what.into()) };
        if has_word("lambda") {
            self.forget_objects(tokens);
            self.loops.push(unknown_loop("a lambda"));
            self.condition = self.condition.or(Some(line));
        }
        // Not the `for` of a statement.
        if tokens.iter().skip(1).any(|lexeme| lexeme.token.name() == "for") {
            self.forget_objects(tokens);
            self.loops.push(unknown_loop("a comprehension"));
            for (start, _) in tokens.iter().enumerate().filter(|(_, lexeme)| lexeme.token.name() == "for") {
                let names = tokens[start + 1..].split(|lexeme| lexeme.token.name() == "in").next();
                let names = target_names(names.unwrap_or_default());
                names.iter().for_each(|name| self.make_unknown(name, "which changes in a comprehension"));
            }
        }
        self.check_values(tokens);
        self.find_nested_calls(tokens, 0);
        self.condition = outer_condition;
        self.loops.truncate(outer_loop_count);
    }

    /// Records the calls in a part of a statement that is inside of `depth` calls.
    fn find_nested_calls(&mut self, tokens: &[Lexeme], depth: usize) {
        let outer = self.condition;
        if depends_on_values(tokens) {
            self.condition = outer.or(Some(tokens[0].line));
        }
        let is_read = depth < MAX_NESTING && self.add_cost(tokens.len());
        let mut index = if is_read { 0 } else { tokens.len() };
        while index < tokens.len() {
            let of_object = index > 0 && tokens[index - 1].token.is(".");
            if tokens[index].token.name().is_empty() {
                let is_closing_bracket = |lexeme: &Lexeme| lexeme.token.is(")") || lexeme.token.is("]");
                if tokens[index].token.is("(") && index > 0 && is_closing_bracket(&tokens[index - 1]) {
                    self.forget_objects(&tokens[..after_bracket(tokens, index)]);
                }
                if tokens[index].token.opens_bracket() {
                    let close = after_bracket(tokens, index);
                    self.find_nested_calls(&tokens[index + 1..(close - 1).max(index + 1)], depth + 1);
                    index = close;
                } else {
                    index += 1;
                }
                continue;
            }
            let (name, end) = dotted_name(tokens, index);
            if !tokens.get(end).is_some_and(|lexeme| lexeme.token.is("(")) {
                index = end;
                continue;
            }
            let close = after_bracket(tokens, end);
            let inside = &tokens[end + 1..(close - 1).max(end + 1)];
            self.find_nested_calls(inside, depth + 1);
            if !of_object {
                self.record_call(&name, tokens[index].line, inside);
            } else if !is_pure_method(&format!(".{name}")) {
                // A method of a part changes the whole.
                self.forget_objects(&tokens[..index - 1]);
                self.forget_objects(inside);
            }
            index = close;
        }
        self.condition = outer;
    }

    /// Rejects functions with commands, commands and the module `chipy` that a statement uses as values: their calls by
    /// other code are not followed.
    fn check_values(&mut self, tokens: &[Lexeme]) {
        // `step = chipy.IncrementStep` is another name.
        let parts = split_at(tokens, "=");
        let is_alias = parts.split_last().is_some_and(|(value, targets)| {
            let is_name = !value.is_empty() && dotted_name(value, 0).1 == value.len();
            is_name && !targets.is_empty() && targets.iter().all(|target| target.len() == 1)
        });
        let mut index = 0;
        while index < tokens.len() {
            let (start, (name, end)) = (index, dotted_name(tokens, index));
            index = end;
            if name.is_empty() || start > 0 && tokens[start - 1].token.is(".") {
                continue;
            }
            let precedes_symbol = |symbol: &str| tokens.get(end).is_some_and(|lexeme| lexeme.token.is(symbol));
            let is_command = |name: &str| self.command(name).is_some_and(|command| is_effective(&command)) && !is_alias;
            let finding = if name.match_indices('.').any(|(point, _)| is_command(&name[..point])) {
                "is an attribute of a command of LMGC90: its effect is unknown"
            } else if precedes_symbol("(") || precedes_symbol("=") {
                continue;
            } else if self.definition(&name).is_some_and(|definition| self.has_effect(&definition.body)) {
                "has commands of LMGC90 and is passed on: how often it is called is not known"
            } else if is_command(&name) {
                "is a command of LMGC90 that is passed on: how often it is called is not known"
            } else if self.chipy_names.contains(&name) && !is_alias && !is_argument_of(tokens, start, &MODULE_READERS) {
                "is LMGC90's module, which is passed on: what is called of it is not known"
            } else {
                continue;
            };
            self.reject(tokens[start].line, name, finding);
        }
    }

    /// Function or class of the script that a name means, if it means one.
    fn definition(&self, name: &str) -> Option<&'a ScriptStatement<'a>> {
        let is_definition =
            self.variables.get(name).is_some_and(|value| value.as_ref().is_err_and(|why| why.0 == DEFINITION_VALUE));
        self.functions.get(name).or_else(|| self.classes.get(name)).copied().filter(|_| is_definition)
    }

    /// Whether a block calls commands of LMGC90 with an effect on a run, itself or by functions of the script; `false` beyond
    /// [`MAX_COST`], where the script is not followed further.
    fn has_effect(&self, block: &[ScriptStatement]) -> bool {
        let (mut names, mut blocks, mut next) = (BTreeSet::new(), vec![block], 0);
        let mut followed = BTreeSet::new();
        while let Some(&block) = blocks.get(next) {
            next += 1;
            if !self.add_cost(block_cost(block)) {
                return false;
            }
            self.commands_in(block, &mut names);
            let mut called = BTreeSet::new();
            called_names(block, &mut called);
            let functions = called.iter().filter_map(|name| self.functions.get_key_value(name));
            blocks.extend(
                functions.filter(|(name, _)| followed.insert(name.as_str())).map(|(_, function)| &function.body[..]),
            );
        }
        names.iter().any(|command| is_effective(command))
    }

    /// Records a call of a command of LMGC90, or follows one of a function of the script. `arguments`: its arguments.
    fn record_call(&mut self, name: &str, line: usize, arguments: &[Lexeme]) {
        if PURE_FUNCTIONS.contains(&name) && !self.functions.contains_key(name) {
            return;
        }
        if CODE_RUNNERS.contains(&name) {
            self.reject(line, name, "runs code that is not read");
        }
        let root = name.split('.').next().unwrap_or_default();
        if self.classes.get(root).is_some_and(|class| self.has_effect(&class.body)) {
            self.reject(line, name, "is a class with commands of LMGC90, which is not read");
        }
        let (mut positional, mut keywords) = (Vec::new(), Vec::new());
        for part in split_at(arguments, ",") {
            let keyword = part.get(1).is_some_and(|lexeme| lexeme.token.is("="));
            let unpacked_lexemes =
                |symbol: &str| part.first().filter(|lexeme| lexeme.token.is(symbol)).map(|_| &part[1..]);
            if let Some(map) = unpacked_lexemes("**") {
                if let Ok(ScriptValue::Map(map)) = self.value(map) {
                    keywords.extend(map.iter().map(|(name, value)| (name.clone(), Ok(value.clone()))));
                }
                continue;
            }
            if let Some(list) = unpacked_lexemes("*") {
                match self.value(list) {
                    Ok(ScriptValue::List(list)) => positional.extend(list.iter().cloned().map(Ok)),
                    value => positional.push(value.and(Err("an unpacked value".into()))),
                }
                continue;
            }
            match part.first().map(|lexeme| lexeme.token.name()) {
                Some(name) if keyword => keywords.push((name.to_string(), self.value(&part[2..]))),
                Some(_) => positional.push(self.value(part)),
                None => {}
            }
        }
        if let Some(&function) = self.functions.get(name).filter(|_| !self.command_aliases.contains_key(name)) {
            self.follow_function(name, function, positional, keywords);
        } else if let Some(command) = self.command(name) {
            self.add_cost(COPY_COST * self.loops.len());
            let (condition, loops) = (self.condition, self.loops.clone());
            self.found.calls.push(ScriptCall { name: command, line, positional, keywords, condition, loops });
        } else {
            let object = name.rsplit_once('.').and_then(|(object, _)| self.variables.get(object));
            match object {
                Some(Ok(object)) if !is_pure_method(name) => object.forget(),
                _ => {}
            }
            // These count their items, or copy them into a new object.
            if !["enumerate", "tqdm", "dict", "list", "tuple", "min", "max"].contains(&name) {
                self.forget_objects(arguments);
            }
        }
    }

    /// Follows a function of the script with these arguments.
    fn follow_function(
        &mut self,
        name: &str,
        function: &'a ScriptStatement,
        positional: Vec<Evaluation>,
        mut keywords: Vec<(String, Evaluation)>,
    ) {
        self.called_functions.insert(name.to_string());
        if self.decorated.contains(name) && self.has_effect(&function.body) {
            let finding = "is a function with a decorator: how often it is called is not known";
            self.reject(function.line(), name, finding);
        }
        if self.redefined.contains(name) {
            self.reject(function.line(), name, "is a function with more than one meaning");
        }
        if self.depth >= MAX_NESTING || self.cost.get() > MAX_COST {
            return;
        }
        let outer = self.saved_variables();
        let defaults = self.defaults.get(name).cloned().unwrap_or_default();
        let mut positional = positional.into_iter();
        for (k, parameter) in parameters(function).into_iter().enumerate() {
            let name = parameter[0].token.name();
            // A star or a slash alone separates parameters.
            if name.is_empty() && parameter.len() == 1 {
                continue;
            }
            let given = keywords.iter().position(|(keyword, _)| keyword == name).map(|k| keywords.swap_remove(k).1);
            let default = defaults.get(k).cloned().flatten();
            // `*args` and `**kwargs` take any others.
            if let [star, others, ..] = parameter
                && name.is_empty()
            {
                if star.token.is("*") {
                    positional.by_ref().flatten().for_each(|value| value.forget());
                } else {
                    keywords.drain(..).flat_map(|(_, value)| value).for_each(|value| value.forget());
                }
                self.variables.insert(others.token.name().to_string(), Err("other arguments".into()));
                continue;
            }
            let value = positional.next().or(given).or(default).unwrap_or(Err("an argument".into()));
            self.variables.insert(name.to_string(), value);
        }
        self.follow_loop_or_function_body(&function.body);
        self.variables = outer;
    }

    /// Adds remarks on functions with commands of LMGC90 that are not called in the script.
    fn report_uncalled(&mut self) {
        let uncalled = self.functions.iter().filter(|(name, _)| !self.called_functions.contains(*name));
        let uncalled: Vec<_> = uncalled.map(|(name, &function)| (name.clone(), function)).collect();
        for (name, function) in uncalled {
            self.report_unread(function, &format!("function {name}, which the script does not call,"));
        }
    }

    /// Adds a remark on a class or function that is not followed, with the commands of LMGC90 that it calls.
    fn report_unread(&mut self, statement: &ScriptStatement, description: &str) {
        let mut names = BTreeSet::new();
        self.commands_in(&statement.body, &mut names);
        if !names.is_empty() {
            let names: Vec<String> = names.into_iter().collect();
            self.found
                .remarks
                .push((statement.line(), format!("the {description} is not read; it calls {}", names.join(", "))));
        }
    }

    /// Commands of LMGC90 that a block calls.
    fn commands_in(&self, block: &[ScriptStatement], names: &mut BTreeSet<String>) {
        for statement in block {
            for index in 0..statement.tokens.len() {
                let starts = index == 0 || !statement.tokens[index - 1].token.is(".");
                if starts && !statement.tokens[index].token.name().is_empty() {
                    let (name, end) = dotted_name(statement.tokens, index);
                    let called = statement.tokens.get(end).is_some_and(|lexeme| lexeme.token.is("("));
                    names.extend(self.command(&name).filter(|_| called));
                }
            }
            self.commands_in(&statement.body, names);
        }
    }
}

/// Whether a name with dots ends in a method that leaves lists and dictionaries as they are.
fn is_pure_method(name: &str) -> bool {
    name.rsplit_once('.').is_some_and(|(_, method)| PURE_METHODS.contains(&method))
}

/// Names with dots in the targets of a loop or comprehension.
fn target_names(tokens: &[Lexeme]) -> Vec<String> {
    let starts = (0..tokens.len()).filter(|&index| index == 0 || !tokens[index - 1].token.is("."));
    starts.map(|index| dotted_name(tokens, index).0).filter(|name| !name.is_empty()).collect()
}

/// Whether a name without prefix has the form of a command: `SetDimension`, `nlgs_3D_ExSolver`, `utilities_logMes`.
fn has_command_form(name: &str) -> bool {
    let (module, rest) = name.split_once('_').unwrap_or(("", name));
    name.starts_with(char::is_uppercase)
        || ["checkDirectories", "checkInteractiveCommand", "getInteractions", "registerInterInternals"].contains(&name)
        || ["utilities", "timer"].contains(&module)
        || !module.is_empty() && rest.contains(char::is_uppercase)
}

/// Names to which a block assigns values.
fn assigned_names(block: &[ScriptStatement], names: &mut BTreeSet<String>) {
    let mut all = Vec::new();
    all_assigned_names(block, &mut all);
    names.extend(all);
}

/// Names to which a block assigns values, one for each assignment.
fn all_assigned_names(block: &[ScriptStatement], names: &mut Vec<String>) {
    for statement in block {
        let position = if statement.keyword() == "for" {
            statement.tokens.iter().position(|lexeme| lexeme.token.name() == "in")
        } else {
            // Not the `=` of a keyword argument.
            let mut positions = outside_brackets(statement.tokens);
            let first = positions.find(|&index| statement.tokens[index].token.assigns());
            first.filter(|_| !BLOCK_KEYWORDS.contains(&statement.keyword()))
        };
        let walrus = statement.tokens.windows(2).filter(|pair| pair[1].token.is(":="));
        names.extend(walrus.map(|pair| pair[0].token.name().to_string()));
        if let Some(end) = position {
            let mut index = 0;
            while index < end {
                let (name, after) = dotted_name(statement.tokens, index);
                names.extend(Some(name).filter(|name| !name.is_empty()));
                index = if statement.tokens[index].token.name().is_empty() { index + 1 } else { after };
            }
        }
        all_assigned_names(&statement.body, names);
    }
}

/// Name and value of an assignment to one name, as `dt = 1e-3` or `dt: float = 1e-3`.
fn class_attribute<'a>(tokens: &'a [Lexeme]) -> Option<(&'a str, &'a [Lexeme<'a>])> {
    let [target, value] = split_at(tokens, "=")[..] else { return None };
    let [name, rest @ ..] = target else { return None };
    let is_name = rest.first().is_none_or(|lexeme| lexeme.token.is(":")) && !value.is_empty();
    Some((name.token.name(), value)).filter(|(name, _)| is_name && !name.is_empty())
}

/// Expression that a statement adds to a variable.
struct AddedTerm<'a> {
    /// -1 if it is subtracted.
    sign: f64,
    expression: &'a [Lexeme<'a>],
}

/// Term that a statement adds to the variable `name`: `k += 1`, `k -= 1`, `k = k + 1`.
fn added_term<'a>(tokens: &'a [Lexeme], name: &str) -> Option<AddedTerm<'a>> {
    let (target, end) = dotted_name(tokens, 0);
    let rest = tokens.get(end..).filter(|_| target == name)?;
    let operator = rest.first()?.token;
    let sign = |token: ScriptToken| if token.is("+") { Some(1.0) } else { token.is("-").then_some(-1.0) };
    if operator.is("+=") {
        return Some(AddedTerm { sign: 1.0, expression: &rest[1..] });
    }
    if operator.is("-=") {
        return Some(AddedTerm { sign: -1.0, expression: &rest[1..] });
    }
    let value = rest.get(1..).filter(|_| operator.is("="))?;
    let (again, end) = dotted_name(value.get(..1).and(Some(value))?, 0);
    let added = value.get(end + 1..).filter(|_| again == name)?;
    // One term only: `k = k - 1 + 2` has another sign.
    let one_term = added.iter().all(|lexeme| sign(lexeme.token).is_none());
    let sign = sign(value[end].token)?;
    one_term.then_some(AddedTerm { sign, expression: added })
}

/// Keyword and line of the first `break` or `return` that ends the loop with this body.
fn break_line(body: &[ScriptStatement]) -> Option<(&'static str, usize)> {
    body.iter().find_map(|statement| match statement.keyword() {
        "break" => Some(("break", statement.line())),
        "return" => Some(("return", statement.line())),
        "def" | "class" => None,
        // A `break` in it ends the inner loop alone.
        "for" | "while" | "async" => break_line(&statement.body).filter(|(word, _)| *word == "return"),
        _ => break_line(&statement.body),
    })
}

/// Parameters of a function, with their default values.
fn parameters<'a>(function: &'a ScriptStatement) -> Vec<&'a [Lexeme<'a>]> {
    let open = function.tokens.iter().position(|lexeme| lexeme.token.is("(")).unwrap_or(0);
    let close = after_bracket(function.tokens, open);
    let parameters = split_at(&function.tokens[open + 1..(close - 1).max(open + 1)], ",");
    parameters.into_iter().filter(|parameter| !parameter.is_empty()).collect()
}

/// Whether a command has an effect on a run.
fn is_effective(command: &str) -> bool {
    find_command(command)
        .is_some_and(|command| matches!(command.meaning, CommandMeaning::Sets(_) | CommandMeaning::Rejected))
}

/// Whether parts of an expression are evaluated or not by the values of others, outside of brackets.
fn depends_on_values(tokens: &[Lexeme]) -> bool {
    outside_brackets(tokens).any(|index| ["if", "and", "or"].contains(&tokens[index].token.name()))
}

/// Whether the name at `index` is an argument, and first in its bracket, of one of these functions.
fn is_argument_of(tokens: &[Lexeme], index: usize, functions: &[&str]) -> bool {
    index > 1 && tokens[index - 1].token.is("(") && functions.contains(&tokens[index - 2].token.name())
}

/// Cost of searching a block.
fn block_cost(block: &[ScriptStatement]) -> usize {
    block.iter().map(|statement| statement.cost() + block_cost(&statement.body)).sum()
}

/// Names without prefix that a block calls.
fn called_names(block: &[ScriptStatement], names: &mut BTreeSet<String>) {
    for statement in block {
        let calls = statement.tokens.windows(2).filter(|pair| pair[1].token.is("("));
        names.extend(calls.map(|pair| pair[0].token.name().to_string()).filter(|name| !name.is_empty()));
        called_names(&statement.body, names);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tokens::script_tokens;
    use super::*;

    fn walked(text: &str) -> ScriptCalls {
        walk(&script_tokens(text).unwrap())
    }

    /// Name, line, first argument, line of the condition and ends of the loops of a call.
    type CallRow = (String, usize, Option<Evaluation>, Option<usize>, Vec<LoopEnd>);

    fn calls(text: &str) -> Vec<CallRow> {
        let row = |call: ScriptCall| {
            let ends = call.loops.into_iter().map(|around| around.end).collect();
            (call.name, call.line, call.positional.into_iter().next(), call.condition, ends)
        };
        walked(text).calls.into_iter().map(row).collect()
    }

    fn real(x: f64) -> Option<Evaluation> {
        Some(Ok(ScriptValue::Real(x)))
    }

    #[test]
    fn conditions_with_values_choose_a_branch() {
        let text = "from pylmgc90.chipy import *\nfine = False\nif fine:\n  dt = 1e-4\nelif 2 > 1: dt = 1e-3\nelse:\n  dt = 1\nSetTimeStep(dt)\n";
        assert_eq!(calls(text), [("SetTimeStep".to_string(), 8, real(1e-3), None, vec![])]);
        let text = "from pylmgc90 import chipy as lm\nimport sys\ndt = 1e-3\nif len(sys.argv) > 1:\n  dt = 1e-4\n  lm.F(2.)\nelse:\n  lm.G(3.)\nlm.SetTimeStep(dt)\nlmgc.H(dt)\n";
        let why = "dt, which depends on the condition in line 4".into();
        let expected = [
            ("F".to_string(), 6, real(2.0), Some(4), vec![]),
            ("G".to_string(), 8, real(3.0), Some(7), vec![]),
            ("SetTimeStep".to_string(), 9, Some(Err(why)), None, vec![]),
        ];
        assert_eq!(calls(text), expected);
    }

    #[test]
    fn loops_have_their_ends() {
        let head = "from pylmgc90 import chipy\nt, n = 0.5, 20\n";
        let end = |text: &str| calls(&format!("{head}{text}")).pop().unwrap().4.pop().unwrap();
        assert_eq!(end("for k in range(1, n + 1):\n  chipy.A()\n"), LoopEnd::Count(20));
        assert_eq!(end("for k in xrange(int(t/1e-3)): chipy.A()\n"), LoopEnd::Count(500));
        assert_eq!(
            end("while chipy.TimeEvolution_GetTime() < 2*t:\n  chipy.A()\n"),
            LoopEnd::Time { limit: 1.0, inclusive: false }
        );
        for (condition, inclusive) in [
            ("t > chipy.TimeEvolution_GetTime()", false),
            ("not chipy.TimeEvolution_GetTime() >= t", false),
            ("(not (t < chipy.TimeEvolution_GetTime()))", true),
            ("chipy.TimeEvolution_GetTime() <= t", true),
        ] {
            let expected = LoopEnd::Time { limit: 0.5, inclusive };
            assert_eq!(end(&format!("while {condition}:\n  chipy.A()\n")), expected, "{condition}");
        }
        for condition in ["chipy.TimeEvolution_GetTime() > t", "2*chipy.TimeEvolution_GetTime() < t"] {
            let found = end(&format!("while {condition}:\n  chipy.A()\n"));
            assert!(matches!(found, LoopEnd::Unknown(_)), "{condition} {found:?}");
        }
        assert_eq!(end("while True:\n  chipy.A()\n"), LoopEnd::Unknown("True".into()));
        assert_eq!(end("for f in files:\n  chipy.A()\n"), LoopEnd::Unknown("files".into()));
        // A value that a loop changes is not that of its first iteration.
        let text = format!("{head}for k in range(n):\n  chipy.A(t)\n  t *= 0.5\n");
        assert_eq!(calls(&text)[0].2, Some(Err("t, which changes in the loop of line 3".into())));
        let returned = "def main():\n  for k in range(n):\n    for l in range(2):\n      if stop(): return\n    chipy.A()\nmain()\n";
        assert_eq!(end(returned), LoopEnd::Unknown("return in line 6".into()));
        let broken = "for k in range(n):\n  if stop(): break\n  chipy.A()\n";
        assert_eq!(end(broken), LoopEnd::Unknown("break in line 4".into()));
        let inner = "for k in range(n):\n  for l in range(2):\n    break\n  chipy.A()\n";
        assert_eq!(end(inner), LoopEnd::Count(20));
    }

    #[test]
    fn functions_are_followed_where_they_are_called() {
        let text = "from pylmgc90 import chipy\ndef init(dt, theta=0.5, *, n=3):\n  chipy.A(dt)\n  chipy.B(theta*2, n)\ndef never():\n  chipy.C()\ndef again():\n  again()\ninit(1e-3, n=4)\nagain()\nclass Model:\n  def step(self): chipy.D()\n";
        let walk = walked(text);
        let names: Vec<_> = walk.calls.iter().map(|call| (call.name.as_str(), call.positional.clone())).collect();
        assert_eq!(
            names,
            [
                ("A", vec![Ok(ScriptValue::Real(1e-3))]),
                ("B", vec![Ok(ScriptValue::Real(1.0)), Ok(ScriptValue::Int(4))])
            ]
        );
        let remarks: Vec<_> = walk.remarks.iter().map(|(line, text)| format!("{line}: {text}")).collect();
        assert_eq!(
            remarks,
            [
                "11: the class is not read; it calls D",
                "5: the function never, which the script does not call, is not read; it calls C"
            ]
        );
    }

    #[test]
    fn names_that_are_passed_on_and_code_that_is_run_are_rejected() {
        let head = "from pylmgc90 import chipy\ndef step(k=0):\n  chipy.IncrementStep()\n";
        let rejected = |text: &str| {
            let found =
                walked(&format!("{head}{text}")).rejected.into_iter().map(|rejected| (rejected.line, rejected.name));
            found.collect::<Vec<_>>()
        };
        for text in [
            "list(map(step, range(9)))\n",
            "x = sorted(range(9), key=step)\n",
            "t = Thread(target=step)\n",
            "s = step\n",
            "def again():\n  step()\nfilter(again, range(9))\n",
            "def run(g=step): g()\n",
            "class Run:\n  def go(): step()\nRun.go()\n",
            "self.lm = chipy\n",
            "chipy.IncrementStep.__call__()\n",
        ] {
            assert_eq!(rejected(text).len(), 1, "{text}");
        }
        assert_eq!(rejected("exec('step()')\n"), [(4, "exec".to_string())]);
        assert_eq!(rejected("getattr(chipy, 'IncrementStep')()\n"), [(4, "chipy".to_string())]);
        assert_eq!(rejected("{1: chipy.IncrementStep}[1]()\n"), [(4, "chipy.IncrementStep".to_string())]);
        assert_eq!(rejected("@twice\ndef run(): step()\nrun()\n"), [(5, "run".to_string())]);
        assert_eq!(rejected("class Run:\n  def go(self): step()\nRun().go()\n"), [(6, "Run".to_string())]);
        for text in
            ["s = chipy.IncrementStep\ns()\n", "lm = chipy\n", "print(chipy, hasattr(chipy, 'A'))\n", "f(step=3)\n"]
        {
            assert!(rejected(text).is_empty(), "{text} {:?}", rejected(text));
        }
    }

    #[test]
    fn calls_in_conditional_expressions_depend_on_them() {
        let head = "from pylmgc90 import chipy\n";
        for text in [
            "chipy.A(1) if x else chipy.B(2)\n",
            "x and chipy.A(1)\n",
            "y = [x or chipy.A(1)]\n",
            "if x: pass\nelif chipy.A(1): pass\n",
        ] {
            assert!(calls(&format!("{head}{text}")).iter().all(|call| call.3.is_some()), "{text}");
        }
        assert_eq!(calls(&format!("{head}chipy.A(1 if 2 > 1 else 3)\n"))[0].3, None);
        // Names that no longer are those of functions or modules that are known.
        for text in [
            "int = round\nchipy.A(int(9.7))\n",
            "def abs(x): return 3\nchipy.A(abs(1))\n",
            "import my as np\nchipy.A(np.sqrt(4))\n",
            "dt = 1\nfrom my import *\nchipy.A(dt)\n",
            "dt = 1\nwith f() as dt: pass\nchipy.A(dt)\n",
        ] {
            let found = calls(&format!("{head}{text}")).pop().unwrap();
            assert!(found.2.as_ref().unwrap().is_err(), "{text}: {found:?}");
        }
    }

    #[test]
    fn names_without_prefix_are_commands_by_their_form() {
        let text = "from pylmgc90.chipy import *\nfrom numpy import *\nx = array([1.])\nprint(zeros(3))\nutilities_logMes('a')\nclass Box: pass\nBox()\nnlgs_3D_DiagonalResolution()\nRBDY3_PutBodyVector('Fext_', 1, [0.])\n";
        let names: Vec<_> = calls(text).into_iter().map(|call| call.0).collect();
        assert_eq!(names, ["utilities_logMes", "nlgs_3D_DiagonalResolution", "RBDY3_PutBodyVector"]);
    }

    /// Any text is read to its end, without a panic.
    #[test]
    fn damaged_scripts_are_read() {
        let text = "from pylmgc90 import chipy as c\ndt: float = 1e-3\na, b = (1, [2, 3])\na.b[3] = c.F(x=-dt, *a)\nfor k, l in range(3):\n\tif not a == (b := 2): c.G(dt)\n\telse:\n\t  b //= 2; c.H(b)[0].I(1)\ndef f(x=1, *y): return lambda z: z\nf(\n)\nwhile c.TimeEvolution_GetTime() <= dt: pass\n";
        for at in (0..text.len()).filter(|&at| text.is_char_boundary(at)) {
            for end in [at, at + 1, at + 3, text.len()] {
                let rest = text.get(end..).unwrap_or_default();
                let _ = script_tokens(&format!("{}{rest}", &text[..at])).map(|script| walk(&script));
            }
        }
        walked(&("c.F(".repeat(3_000) + &")".repeat(3_000)));
        walked(&("x = ".to_string() + &"[".repeat(3_000) + &"]".repeat(3_000)));
        let nested: String = (0..200).map(|k| " ".repeat(k) + "if x:\n").collect();
        walked(&nested);
        let doubling: String = (0..40).map(|k| format!("def f{k}():\n f{}()\n f{}()\n", k + 1, k + 1)).collect();
        walked(&(doubling + "f0()\n"));
    }

    /// Cost of following a script, at most [`MAX_COST`] and the last addition.
    fn cost_of(text: &str) -> usize {
        let script = script_tokens(text).unwrap();
        let statements = read_block(&mut script.lines().peekable(), 0, 0);
        let mut walker = ScriptWalker::default();
        walker.find_functions(&statements);
        walker.follow(&statements);
        walker.cost.get()
    }

    #[test]
    fn cost_of_repeated_statements_is_bounded() {
        let calls = " f()\n".repeat(300);
        for (kind, text) in [
            ("functions that call each other", format!("def f():\n{calls}f()\n")),
            (
                "calls inside of each other",
                format!("def f():\n f{}{}\n{calls}f()\n", "(f".repeat(300), ")".repeat(300)),
            ),
            ("functions as values", format!("def f():\n{}x = [{}]\n", " a.b()\n".repeat(2000), "f, ".repeat(20_000))),
            ("calls of results", format!("f{}\n", "()".repeat(20_000))),
            ("long loops", "k = 0\nwhile k < 20000000: k += 1\n".repeat(60)),
            (
                "variables that functions may change",
                format!(
                    "def f():\n f()\n{}{}",
                    (0..5000).map(|k| format!("v{k} = 1\n")).collect::<String>(),
                    "f()\n".repeat(5000)
                ),
            ),
        ] {
            let cost = cost_of(&text);
            // The last addition: the tokens of a statement, once for each level of brackets.
            assert!(cost > MAX_COST && cost <= MAX_COST + 100 * text.len(), "{kind}: {cost}");
        }
        // A script that is followed to its end: its statements, once each, and its function twice.
        let cost = cost_of("from pylmgc90 import chipy\ndef f(n):\n  chipy.SetDimension(n)\nf(2)\nf(3)\n");
        assert!(cost > 0 && cost < MAX_COST / 1000, "{cost}");
        let text = format!("from pylmgc90 import chipy\ndef f():\n{calls}f()\nchipy.SetDimension(3)\n");
        assert_eq!(walked(&text).remarks.len(), 1);
    }

    #[test]
    fn values_that_repeat_themselves_are_bounded() {
        let argument = |text: &str| {
            let text = format!("from pylmgc90 import chipy\n{text}chipy.A(x)\n");
            walked(&text).calls.pop().unwrap().positional.pop().unwrap()
        };
        // Each statement doubles the text, or the number of values in lists of two items.
        for doubled in [
            "x = 'abcdefgh'\n".to_string() + &"x = x + x\n".repeat(60),
            "x = y\n".to_string() + &"x = x\n".repeat(9000),
        ] {
            let why = argument(&doubled).unwrap_err();
            assert!(why.0.len() < 1000, "{}", why.0.len());
        }
        let lists = "l = [1, 2]\nm = [1, 2]\n".to_string() + &"l = [l, l]\nm = [m, m]\n".repeat(60);
        assert_eq!(argument(&format!("{lists}x = l == m\n")), Err("x, set in line 124 from '=='".into()));
        assert_eq!(argument("l = [[1, 2], 3]\nx = l == [[1, 2], 3]\n"), Ok(ScriptValue::Bool(true)));
        let nested = "x = [1]\n".to_string() + &"x = [x, 1]\n".repeat(20_000);
        assert!(argument(&nested).is_err());
        let copies = format!("l = [{}]\nx = list(l)\n", "0, ".repeat(2000));
        assert_eq!(argument(&copies), Ok(ScriptValue::Range(2000)));
    }
}
