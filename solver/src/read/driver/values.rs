//! Values of Python expressions that can be computed without running Python, and helpers that split lists of tokens. `walk`
//! calls them for conditions, assignments and arguments.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Deref;
use std::rc::Rc;

use super::tokens::{Lexeme, ScriptToken};

/// List or dictionary, which all names of the same object share, as in Python.
#[derive(Debug, Clone)]
pub struct ScriptObject<T>(Rc<SharedContent<T>>);

#[derive(Debug)]
struct SharedContent<T> {
    content: T,
    extent: Extent,
    /// Whether the content has become unknown.
    is_forgotten: Cell<bool>,
}

/// Extent of a value: lists in lists may be the same object, so that few statements make many values.
#[derive(Debug, Clone, Copy, Default)]
struct Extent {
    /// Lists and dictionaries inside of each other.
    levels: usize,
    /// Values in all of them, each as often as it occurs.
    values: usize,
}

impl Extent {
    /// Extent of a list or dictionary of these values.
    fn list_extent<'a>(values: impl Iterator<Item = &'a ScriptValue>) -> Self {
        let add = |sum: Extent, inner: Extent| Extent {
            levels: sum.levels.max(inner.levels + 1),
            values: sum.values.saturating_add(inner.values),
        };
        values.map(ScriptValue::extent).fold(Extent { levels: 1, values: 1 }, add)
    }
}

impl<T> ScriptObject<T> {
    /// Object that has no name yet; an error for one of too many levels, each of which takes stack.
    fn new(content: T, extent: Extent) -> Result<Self, UnknownValue> {
        if extent.levels > MAX_EXPRESSION_DEPTH {
            return Err("lists of many levels".into());
        }
        Ok(Self(Rc::new(SharedContent { content, extent, is_forgotten: Cell::new(false) })))
    }

    /// Whether another name or object holds it too.
    pub fn is_shared(&self) -> bool {
        Rc::strong_count(&self.0) > 1
    }
}

impl<T> Deref for ScriptObject<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0.content
    }
}

impl<T: PartialEq> PartialEq for ScriptObject<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

/// Value of an expression.
#[derive(Debug, Clone, PartialEq)]
pub enum ScriptValue {
    None,
    Bool(bool),
    Int(i64),
    Real(f64),
    Text(String),
    /// List or tuple.
    List(ScriptObject<Vec<ScriptValue>>),
    /// Dictionary with texts as keys.
    Map(ScriptObject<BTreeMap<String, ScriptValue>>),
    /// Sequence of this many items, whose values are not kept: `range`, `arange`, `linspace`, or `enumerate` and the like of
    /// another sequence.
    Range(u64),
}

impl ScriptValue {
    /// List of these items.
    pub fn list(items: Vec<ScriptValue>) -> Evaluation {
        let extent = Extent::list_extent(items.iter());
        ScriptObject::new(items, extent).map(ScriptValue::List)
    }

    /// Dictionary of these items.
    pub fn map(items: BTreeMap<String, ScriptValue>) -> Evaluation {
        let extent = Extent::list_extent(items.values());
        ScriptObject::new(items, extent).map(ScriptValue::Map)
    }

    /// A text, unless it is long: sums of texts double their length.
    fn text(text: String) -> Evaluation {
        if text.len() > MAX_TEXT_BYTES { Err("a long text".into()) } else { Ok(ScriptValue::Text(text)) }
    }

    fn extent(&self) -> Extent {
        match self {
            ScriptValue::List(list) => list.0.extent,
            ScriptValue::Map(map) => map.0.extent,
            _ => Extent { levels: 0, values: 1 },
        }
    }

    /// Makes the content of a list or dictionary unknown by all its names, with those inside.
    pub fn forget(&self) {
        let is_forgotten = match self {
            ScriptValue::List(list) => &list.0.is_forgotten,
            ScriptValue::Map(map) => &map.0.is_forgotten,
            _ => return,
        };
        if !is_forgotten.replace(true) {
            self.forget_items();
        }
    }

    /// Makes the content of lists and dictionaries inside of this one unknown.
    pub fn forget_items(&self) {
        match self {
            ScriptValue::List(list) => list.iter().for_each(ScriptValue::forget),
            ScriptValue::Map(map) => map.values().for_each(ScriptValue::forget),
            _ => {}
        }
    }

    /// Whether the content of this list or dictionary has become unknown.
    pub fn is_forgotten(&self) -> bool {
        match self {
            ScriptValue::List(list) => list.0.is_forgotten.get(),
            ScriptValue::Map(map) => map.0.is_forgotten.get(),
            _ => false,
        }
    }

    /// Number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            ScriptValue::Int(x) => Some(*x as f64),
            ScriptValue::Real(x) => Some(*x),
            _ => None,
        }
    }

    /// Whether Python takes the value as true.
    pub fn is_true(&self) -> bool {
        match self {
            ScriptValue::None => false,
            ScriptValue::Bool(x) => *x,
            ScriptValue::Int(_) | ScriptValue::Real(_) => self.number() != Some(0.0),
            ScriptValue::Text(text) => !text.is_empty(),
            ScriptValue::List(list) => !list.is_empty(),
            ScriptValue::Map(map) => !map.is_empty(),
            ScriptValue::Range(count) => *count > 0,
        }
    }
}

/// Value that is not known: the part of the expression that is not, or the reason, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownValue(pub String);

impl std::fmt::Display for UnknownValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for UnknownValue {}

impl From<String> for UnknownValue {
    /// Shortens long words: a value that is not known from another one has its words in its own.
    fn from(mut words: String) -> UnknownValue {
        if words.len() > MAX_REASON_BYTES {
            let end = (0..=MAX_REASON_BYTES).rev().find(|&byte| words.is_char_boundary(byte)).unwrap_or_default();
            words.truncate(end);
            words += "...";
        }
        UnknownValue(words)
    }
}

impl From<&str> for UnknownValue {
    fn from(words: &str) -> UnknownValue {
        words.to_string().into()
    }
}

/// Value, or the part of the expression that is not known.
pub type Evaluation = Result<ScriptValue, UnknownValue>;

/// Values of the variables, by their names; values of attributes by names as `self.dt`.
pub type Variables = BTreeMap<String, Evaluation>;

/// Deepest nesting of brackets, signs, lists and dictionaries that is read: each level takes stack.
const MAX_EXPRESSION_DEPTH: usize = 100;

/// Length of a text beyond which its value is not known, more than that of a path.
const MAX_TEXT_BYTES: usize = 1000;

/// Length of the words why a value is not known: the chain of some assignments.
const MAX_REASON_BYTES: usize = 300;

/// Largest number of values in lists that are compared or copied.
const MAX_COPIED_VALUES: usize = 1000;

/// Value of an expression.
pub fn evaluate(tokens: &[Lexeme], variables: &Variables) -> Evaluation {
    let mut parser = ExpressionParser { tokens, next: 0, variables, depth: 0 };
    let value = parser.tuple()?;
    match parser.peek() {
        None => Ok(value),
        Some(token) => Err(format!("'{}'", token.source()).into()),
    }
}

/// Value of `left operator right`.
pub fn evaluate_operation(operator: &str, left: ScriptValue, right: ScriptValue) -> Evaluation {
    match operator {
        "+" | "-" | "*" | "/" | "//" | "%" | "**" => apply_operator(operator, left, right),
        _ => Err(format!("'{operator}'").into()),
    }
}

/// Number of open brackets after a token, of `depth` before it.
fn depth_after(depth: usize, token: ScriptToken) -> usize {
    (depth + usize::from(token.opens_bracket())).saturating_sub(usize::from(token.closes_bracket()))
}

/// Number of tokens that [`evaluate`] reads again: those inside of brackets, once for each level that it reads.
pub fn nested_count(tokens: &[Lexeme]) -> usize {
    let (mut count, mut depth) = (0, 0usize);
    for lexeme in tokens {
        depth = depth_after(depth, lexeme.token);
        count += depth.min(MAX_EXPRESSION_DEPTH);
    }
    count
}

/// Index after the bracket that closes the one at index `open`.
pub fn after_bracket(tokens: &[Lexeme], open: usize) -> usize {
    let mut depth = 0usize;
    for (index, lexeme) in tokens.iter().enumerate().skip(open) {
        depth = depth_after(depth, lexeme.token);
        if depth == 0 {
            return index + 1;
        }
    }
    tokens.len()
}

/// Indices of the tokens outside of brackets, with those of the brackets that open.
pub fn outside_brackets(tokens: &[Lexeme]) -> impl Iterator<Item = usize> {
    let mut next = 0;
    std::iter::from_fn(move || {
        let (index, token) = (next, tokens.get(next)?.token);
        next = if token.opens_bracket() { after_bracket(tokens, index) } else { index + 1 };
        Some(index)
    })
}

/// Parts of a list of tokens between the symbols `separator` outside of brackets; empty if there are no tokens.
pub fn split_at<'a, 't>(tokens: &'a [Lexeme<'t>], separator: &str) -> Vec<&'a [Lexeme<'t>]> {
    let (mut parts, mut start) = (Vec::new(), 0);
    for index in outside_brackets(tokens).filter(|&index| tokens[index].token.is(separator)) {
        parts.push(&tokens[start..index]);
        start = index + 1;
    }
    if start < tokens.len() {
        parts.push(&tokens[start..]);
    }
    parts
}

/// Name with points that begins at `index`, and the index after it.
pub fn dotted_name(tokens: &[Lexeme], index: usize) -> (String, usize) {
    let (mut name, mut end) = (tokens[index].token.name().to_string(), index + 1);
    while end + 1 < tokens.len() && tokens[end].token.is(".") && !tokens[end + 1].token.name().is_empty() {
        name.push('.');
        name.push_str(tokens[end + 1].token.name());
        end += 2;
    }
    (name, end)
}

/// Recursive descent through the grammar of expressions, with a function for each level of precedence.
struct ExpressionParser<'a> {
    tokens: &'a [Lexeme<'a>],
    /// Index of the next token.
    next: usize,
    variables: &'a Variables,
    /// Number of brackets, signs and calls around the next token.
    depth: usize,
}

impl<'a> ExpressionParser<'a> {
    /// The next token, which stays the next one.
    fn peek(&self) -> Option<ScriptToken<'a>> {
        self.tokens.get(self.next).map(|lexeme| lexeme.token)
    }

    /// Reads the symbol or keyword `word`, if it comes next.
    fn accept(&mut self, word: &str) -> bool {
        let found = self.peek().is_some_and(|token| token.is(word) || token.name() == word);
        self.next += usize::from(found);
        found
    }

    /// Reads the first of these symbols or keywords that comes next.
    fn accept_any(&mut self, words: &[&'static str]) -> Option<&'static str> {
        words.iter().copied().find(|word| self.accept(word))
    }

    /// Value of `a`, or of `a, b, ...` as a list.
    fn tuple(&mut self) -> Evaluation {
        let first = self.choice()?;
        if !self.peek().is_some_and(|token| token.is(",")) {
            return Ok(first);
        }
        let mut list = vec![first];
        while self.accept(",") && self.peek().is_some_and(|token| !token.is(")") && !token.is("]")) {
            list.push(self.choice()?);
        }
        ScriptValue::list(list)
    }

    /// Value of `a if condition else b`, or of its first part alone.
    fn choice(&mut self) -> Evaluation {
        let first = self.disjunction();
        if !self.accept("if") {
            return first;
        }
        let condition = self.disjunction()?.is_true();
        if !self.accept("else") {
            return Err("'if'".into());
        }
        let other = self.read_nested(Self::choice);
        if condition { first } else { other }
    }

    /// Value of `a or b`, or of `a` alone; so each level below.
    fn disjunction(&mut self) -> Evaluation {
        let mut value = self.conjunction()?;
        while self.accept("or") {
            let other = self.conjunction()?;
            value = if value.is_true() { value } else { other };
        }
        Ok(value)
    }

    fn conjunction(&mut self) -> Evaluation {
        let mut value = self.comparison()?;
        while self.accept("and") {
            let other = self.comparison()?;
            value = if value.is_true() { other } else { value };
        }
        Ok(value)
    }

    fn comparison(&mut self) -> Evaluation {
        if self.accept("not") {
            return Ok(ScriptValue::Bool(!self.read_nested(Self::comparison)?.is_true()));
        }
        let left = self.sum()?;
        let Some(operator) = self.accept_any(&["==", "!=", "<=", ">=", "<", ">", "is"]) else { return Ok(left) };
        let negated = operator == "is" && self.accept("not") || operator == "!=";
        let right = self.sum()?;
        let holds = match (operator, left.number(), right.number()) {
            ("<", Some(a), Some(b)) => a < b,
            (">", Some(a), Some(b)) => a > b,
            ("<=", Some(a), Some(b)) => a <= b,
            (">=", Some(a), Some(b)) => a >= b,
            ("==" | "!=" | "is", Some(a), Some(b)) => (a == b) != negated,
            ("==" | "!=" | "is", _, _) if left.extent().values <= MAX_COPIED_VALUES => (left == right) != negated,
            _ => return Err(format!("'{operator}'").into()),
        };
        Ok(ScriptValue::Bool(holds))
    }

    fn sum(&mut self) -> Evaluation {
        let mut value = self.product()?;
        while let Some(operator) = self.accept_any(&["+", "-"]) {
            value = apply_operator(operator, value, self.product()?)?;
        }
        Ok(value)
    }

    fn product(&mut self) -> Evaluation {
        let mut value = self.sign()?;
        while let Some(operator) = self.accept_any(&["*", "//", "/", "%"]) {
            value = apply_operator(operator, value, self.sign()?)?;
        }
        Ok(value)
    }

    fn sign(&mut self) -> Evaluation {
        match self.accept_any(&["-", "+"]) {
            Some("-") => {
                let value = self.read_nested(Self::sign)?;
                apply_operator("*", ScriptValue::Int(-1), value)
            }
            Some(_) => self.read_nested(Self::sign),
            None => self.power(),
        }
    }

    fn power(&mut self) -> Evaluation {
        let base = self.atom()?;
        if self.accept("**") {
            let exponent = self.read_nested(Self::sign)?;
            return apply_operator("**", base, exponent);
        }
        Ok(base)
    }

    /// Reads a part one level deeper; an error beyond [`MAX_EXPRESSION_DEPTH`].
    fn read_nested(&mut self, read: fn(&mut Self) -> Evaluation) -> Evaluation {
        self.depth += 1;
        let value =
            if self.depth < MAX_EXPRESSION_DEPTH { read(self) } else { Err("an expression of many levels".into()) };
        self.depth -= 1;
        value
    }

    /// Value of a number, text, name, call, bracket or dictionary.
    fn atom(&mut self) -> Evaluation {
        let Some(token) = self.peek() else { return Err("an incomplete expression".into()) };
        if !token.name().is_empty() {
            return self.named_value();
        }
        self.next += 1;
        match token {
            ScriptToken::Number(text) => parse_number(text),
            ScriptToken::Text(text) => {
                let mut text = text.to_string();
                while let Some(ScriptToken::Text(more)) = self.peek() {
                    text += more;
                    self.next += 1;
                }
                ScriptValue::text(text)
            }
            ScriptToken::Symbol(symbol) if symbol == "(" || symbol == "[" => {
                let close = if symbol == "(" { ")" } else { "]" };
                if self.accept(close) {
                    return ScriptValue::list(Vec::new());
                }
                let is_single =
                    split_at(&self.tokens[self.next..after_bracket(self.tokens, self.next - 1) - 1], ",").len() < 2;
                let value = self.read_nested(Self::tuple)?;
                if !self.accept(close) {
                    return Err(self.peek().map_or("a bracket".into(), |token| format!("'{}'", token.source()).into()));
                }
                let is_list = matches!(value, ScriptValue::List(_));
                if symbol == "[" && is_single && !is_list { ScriptValue::list(vec![value]) } else { Ok(value) }
            }
            ScriptToken::Symbol("{") => {
                let mut map = BTreeMap::new();
                while !self.accept("}") {
                    let ScriptValue::Text(key) = self.read_nested(Self::disjunction)? else {
                        return Err("a dictionary whose keys are no texts".into());
                    };
                    if !self.accept(":") {
                        return Err("a set".into());
                    }
                    map.insert(key, self.read_nested(Self::choice)?);
                    if !self.accept(",") && !self.peek().is_some_and(|token| token.is("}")) {
                        return Err("a dictionary".into());
                    }
                }
                ScriptValue::map(map)
            }
            other => Err(format!("'{}'", other.source()).into()),
        }
    }

    /// Item of `value` in the brackets `[...]` that follow it, if there are any; `name` is for messages.
    fn items(&mut self, name: &str, mut value: ScriptValue) -> Evaluation {
        let known_value = |value: ScriptValue| -> Evaluation {
            match value.is_forgotten() {
                true => Err(format!("{name}, which changes in part").into()),
                false => Ok(value),
            }
        };
        value = known_value(value)?;
        while self.accept("[") {
            let key = self.read_nested(Self::disjunction)?;
            let item = match (&value, &key) {
                (ScriptValue::List(list), ScriptValue::Int(k)) => {
                    let count = list.len() as i64;
                    usize::try_from(if *k < 0 { k.saturating_add(count) } else { *k }).ok().and_then(|k| list.get(k))
                }
                (ScriptValue::Map(map), ScriptValue::Text(key)) => map.get(key),
                _ => None,
            };
            value = item.cloned().filter(|_| self.accept("]")).ok_or_else(|| format!("{name}[...]"))?;
            value = known_value(value)?;
        }
        Ok(value)
    }

    /// Value of a variable, constant or call.
    fn named_value(&mut self) -> Evaluation {
        let (name, end) = dotted_name(self.tokens, self.next);
        let called = self.tokens.get(end).is_some_and(|lexeme| lexeme.token.is("("));
        if called {
            let close = after_bracket(self.tokens, end);
            let inside = &self.tokens[end + 1..(close - 1).max(end + 1)];
            self.next = close;
            let mut argument = |part: &[Lexeme]| {
                self.depth += 1;
                let mut inner =
                    ExpressionParser { tokens: part, next: 0, variables: self.variables, depth: self.depth };
                let value = inner.read_nested(ExpressionParser::choice);
                self.depth -= 1;
                if inner.next < part.len() { value.and(Err(format!("the call of {name}").into())) } else { value }
            };
            // Settings of a progress bar, or the first number of `enumerate`.
            let is_setting = |part: &&[Lexeme]| part.get(1).is_some_and(|lexeme| lexeme.token.is("="));
            let counts_items = ["tqdm", "trange", "enumerate"].contains(&name.rsplit('.').next().unwrap_or(&name));
            let parts = split_at(inside, ",").into_iter().filter(|part| !(counts_items && is_setting(part)));
            if name == "dict" {
                let pair = |part: &[Lexeme]| match part {
                    [key, equal, value @ ..] if equal.token.is("=") => {
                        Ok((key.token.name().to_string(), argument(value)?))
                    }
                    _ => Err("the call of dict".into()),
                };
                return parts.map(pair).collect::<Result<_, _>>().and_then(ScriptValue::map);
            }
            let arguments = parts.map(&mut argument).collect::<Result<Vec<_>, _>>()?;
            // A name with another value is no function that is known.
            let is_redefined = name.split('.').next().is_some_and(|root| self.variables.contains_key(root));
            let value = call_function(&name, &arguments).filter(|_| !is_redefined);
            return value.unwrap_or_else(|| Err(format!("the call of {name}").into()));
        }
        self.next = end;
        let known = self.variables.get(&name);
        if self.peek().is_some_and(|token| token.is("[")) && !matches!(known, Some(Ok(_))) {
            return Err(format!("{name}[...]").into());
        }
        match (known, name.as_str()) {
            (Some(Ok(value)), _) => {
                let value = value.clone();
                self.items(&name, value)
            }
            (Some(Err(why)), _) if why.0.is_empty() => Err(name.into()),
            (Some(Err(why)), _) => Err(format!("{name}, {why}").into()),
            (None, "True" | "False") => Ok(ScriptValue::Bool(name == "True")),
            (None, "None") => Ok(ScriptValue::None),
            (None, "__name__") => Ok(ScriptValue::Text("__main__".into())),
            (None, "pi" | "math.pi" | "np.pi" | "numpy.pi") => Ok(ScriptValue::Real(std::f64::consts::PI)),
            (None, _) => Err(name.into()),
        }
    }
}

/// Value of a number of Python; the letter L of old integers is ignored.
fn parse_number(text: &str) -> Evaluation {
    let digits = text.trim_end_matches(['l', 'L']).replace('_', "");
    let integer = match digits.get(..2) {
        Some("0x" | "0X") => i64::from_str_radix(&digits[2..], 16).ok(),
        _ => digits.parse().ok(),
    };
    let real = || digits.parse::<f64>().ok().filter(|x| x.is_finite() && digits.starts_with(|c: char| c != 'i'));
    integer.map(ScriptValue::Int).or_else(|| real().map(ScriptValue::Real)).ok_or_else(|| format!("'{text}'").into())
}

/// Result of an arithmetic operator, as in Python 3.
fn apply_operator(operator: &str, left: ScriptValue, right: ScriptValue) -> Evaluation {
    let unknown_result = || Err(format!("the result of '{operator}'").into());
    if let (ScriptValue::Int(a), ScriptValue::Int(b)) = (&left, &right) {
        let (a, b) = (*a, *b);
        let integer = match operator {
            "+" => a.checked_add(b),
            "-" => a.checked_sub(b),
            "*" => a.checked_mul(b),
            "//" => a.checked_div_euclid(b).filter(|_| b > 0),
            "%" => a.checked_rem_euclid(b).filter(|_| b > 0),
            "**" => u32::try_from(b).ok().and_then(|b| a.checked_pow(b)),
            _ => None,
        };
        if let Some(integer) = integer {
            return Ok(ScriptValue::Int(integer));
        }
    }
    match (left, right) {
        (ScriptValue::Text(a), ScriptValue::Text(b)) if operator == "+" => ScriptValue::text(a + &b),
        (left, right) => {
            let (Some(a), Some(b)) = (left.number(), right.number()) else { return unknown_result() };
            let value = match operator {
                "+" => a + b,
                "-" => a - b,
                "*" => a * b,
                "/" => a / b,
                "//" => floor_division(a, b).0,
                "%" => floor_division(a, b).1,
                _ => libm::pow(a, b),
            };
            if value.is_finite() { Ok(ScriptValue::Real(value)) } else { unknown_result() }
        }
    }
}

/// Results of Python's `a // b` and `a % b` of floats: from the exact remainder, with the sign of `b`. So
/// 1.0 // 0.1 is 9, since 0.1 is a little more than a tenth.
fn floor_division(a: f64, b: f64) -> (f64, f64) {
    let mut remainder = a % b;
    let mut quotient = (a - remainder) / b;
    if remainder != 0.0 && (remainder < 0.0) != (b < 0.0) {
        remainder += b;
        quotient -= 1.0;
    }
    (quotient.round_ties_even(), remainder)
}

/// Result of a function of Python, math or numpy; none if it is not one of those that are known.
fn call_function(name: &str, arguments: &[ScriptValue]) -> Option<Evaluation> {
    let (module, function) = name.rsplit_once('.').unwrap_or(("", name));
    if !["", "math", "np", "numpy", "tqdm", "tqdm.auto"].contains(&module) {
        return None;
    }
    let x = || arguments.first()?.number();
    let integer = |x: f64| (x.abs() < 9e15).then_some(ScriptValue::Int(x as i64));
    let value = match (function, arguments) {
        ("int", [ScriptValue::Text(text)]) => {
            parse_number(text.trim()).ok().filter(|value| matches!(value, ScriptValue::Int(_)))
        }
        ("float", [ScriptValue::Text(text)]) => parse_number(text.trim()).ok()?.number().map(ScriptValue::Real),
        ("int", []) => Some(ScriptValue::Int(0)),
        ("float", []) => Some(ScriptValue::Real(0.0)),
        ("int" | "int64" | "int_", [_]) => integer(x()?.trunc()),
        ("round", [_]) => integer(x()?.round_ties_even()),
        ("ceil", [_]) => integer(x()?.ceil()),
        ("floor", [_]) => integer(x()?.floor()),
        ("float" | "float64" | "double", [_]) => Some(ScriptValue::Real(x()?)),
        ("abs" | "fabs", [ScriptValue::Int(x)]) => x.checked_abs().map(ScriptValue::Int),
        ("abs" | "fabs", [_]) => Some(ScriptValue::Real(x()?.abs())),
        ("sqrt", [_]) => Some(ScriptValue::Real(x()?.sqrt())).filter(|_| x() >= Some(0.0)),
        ("exp" | "log" | "sin" | "cos" | "tan" | "log10", [_]) => {
            let apply = match function {
                "exp" => libm::exp,
                "log" => libm::log,
                "sin" => libm::sin,
                "cos" => libm::cos,
                "tan" => libm::tan,
                _ => libm::log10,
            };
            Some(ScriptValue::Real(apply(x()?))).filter(|value| value.number().is_some_and(f64::is_finite))
        }
        ("array" | "list" | "tuple", [ScriptValue::List(list)]) if list.len() > MAX_COPIED_VALUES => {
            Some(ScriptValue::Range(list.len() as u64))
        }
        ("array" | "list" | "tuple", [ScriptValue::List(list)]) => return Some(ScriptValue::list(list.to_vec())),
        ("list", [ScriptValue::Range(count)]) => Some(ScriptValue::Range(*count)),
        ("len", [ScriptValue::List(list)]) => i64::try_from(list.len()).ok().map(ScriptValue::Int),
        ("bool", [value]) => Some(ScriptValue::Bool(value.is_true())),
        ("min" | "max", [_, _, ..]) => {
            let sign = if function == "min" { 1.0 } else { -1.0 };
            let numbers: Option<Vec<f64>> = arguments.iter().map(ScriptValue::number).collect();
            let order = |a: &(f64, &ScriptValue), b: &(f64, &ScriptValue)| (sign * a.0).total_cmp(&(sign * b.0));
            numbers?.into_iter().zip(arguments).min_by(order).map(|(_, value)| value.clone())
        }
        // Progress bars and the like have as many items as their argument.
        ("tqdm" | "enumerate" | "reversed" | "sorted", [ScriptValue::Range(count), ..]) => {
            Some(ScriptValue::Range(*count))
        }
        ("tqdm" | "enumerate" | "reversed", [ScriptValue::List(list), ..]) => {
            Some(ScriptValue::Range(list.len() as u64))
        }
        ("linspace", [_, _]) => Some(ScriptValue::Range(50)),
        ("linspace", [_, _, ScriptValue::Int(count)]) => u64::try_from(*count).ok().map(ScriptValue::Range),
        ("range" | "xrange" | "arange" | "trange", _) => range_value(arguments).or_else(|| real_range(arguments)),
        _ => None,
    };
    value.map(Ok)
}

/// Range of integers with the arguments of Python's `range`.
fn range_value(arguments: &[ScriptValue]) -> Option<ScriptValue> {
    let integer = |value: &ScriptValue| if let ScriptValue::Int(x) = value { Some(i128::from(*x)) } else { None };
    let integers: Vec<i128> = arguments.iter().map(integer).collect::<Option<_>>()?;
    let (start, stop, step) = match integers[..] {
        [stop] => (0, stop, 1),
        [start, stop] => (start, stop, 1),
        [start, stop, step] if step != 0 => (start, stop, step),
        _ => return None,
    };
    let length = if step > 0 { stop - start } else { start - stop };
    let count = (length + step.abs() - 1) / step.abs();
    u64::try_from(count.max(0)).ok().map(ScriptValue::Range)
}

/// Range with the arguments of numpy's `arange`, of which at least one is no integer.
fn real_range(arguments: &[ScriptValue]) -> Option<ScriptValue> {
    let numbers: Vec<f64> = arguments.iter().map(ScriptValue::number).collect::<Option<_>>()?;
    let (start, stop, step) = match numbers[..] {
        [stop] => (0.0, stop, 1.0),
        [start, stop] => (start, stop, 1.0),
        [start, stop, step] => (start, stop, step),
        _ => return None,
    };
    let count = ((stop - start) / step).ceil();
    (count.is_finite() && count < 9e15).then_some(ScriptValue::Range(count.max(0.0) as u64))
}

#[cfg(test)]
mod tests {
    use super::super::tokens::script_tokens;
    use super::*;

    fn value(text: &str) -> Evaluation {
        let variables =
            [("t", Ok(ScriptValue::Real(2.0))), ("n", Ok(ScriptValue::Int(4))), ("u", Err("set in line 3".into()))];
        let variables = variables.into_iter().map(|(name, value)| (name.to_string(), value)).collect();
        let script = script_tokens(text).unwrap();
        evaluate(script.lines().next().unwrap().tokens, &variables)
    }

    #[test]
    fn expressions_have_the_values_of_python() {
        let real = |text: &str, expected: f64| assert_eq!(value(text), Ok(ScriptValue::Real(expected)), "{text}");
        let int = |text: &str, expected: i64| assert_eq!(value(text), Ok(ScriptValue::Int(expected)), "{text}");
        real("1.e-3", 1e-3);
        real("0.1666e-3*10/ t", 0.1666e-3 * 10.0 / 2.0);
        real("-t**2", -4.0);
        real("1/n", 0.25);
        real("2*np.pi/t", std::f64::consts::PI);
        real("math.sqrt(16.)", 4.0);
        real("7 // 2.", 3.0);
        real("0.06//1e-3", 59.0);
        real("1.0//0.1", 9.0);
        real("7.5%0.1", 0.09999999999999959);
        real("-7.5//2.", -4.0);
        real("-7.5%2.", 0.5);
        real("7.5%-2.", -0.5);
        int("1_000", 1000);
        int("int(1.0/1e-3) + 1", 1001);
        int("7//2*2 - -7 % 4", 6 - 1);
        int("2**3**2", 512);
        int("round(2.5)", 2);
        int("max(3, n, 1)", 4);
        int("int('12')", 12);
        real("np.float64(1e-3)", 1e-3);
        real("numpy.double(n)", 4.0);
        int("np.int64(4.7)", 4);
        real("float() + int()", 0.0);
        for (text, count) in [("range(1, n+1)", 4), ("xrange(10)", 10), ("range(0,10,3)", 4), ("range(5,0,-2)", 3)] {
            assert_eq!(value(text), Ok(ScriptValue::Range(count)), "{text}");
        }
        assert_eq!(value("'Quad' ' '"), Ok(ScriptValue::Text("Quad ".into())));
        assert_eq!(
            value("[0., 0, -t]"),
            ScriptValue::list(vec![ScriptValue::Real(0.0), ScriptValue::Int(0), ScriptValue::Real(-2.0)])
        );
        assert_eq!(value("[t]"), ScriptValue::list(vec![ScriptValue::Real(2.0)]));
        assert_eq!(value("(t)"), Ok(ScriptValue::Real(2.0)));
        assert_eq!(value("1, t"), ScriptValue::list(vec![ScriptValue::Int(1), ScriptValue::Real(2.0)]));
        assert_eq!(value("not n == 4 or t >= 2 and n != 3"), Ok(ScriptValue::Bool(true)));
        assert_eq!(value("__name__ == '__main__'"), Ok(ScriptValue::Bool(true)));
        assert_eq!(value("None is not None"), Ok(ScriptValue::Bool(false)));
    }

    #[test]
    fn the_part_without_a_value_is_named() {
        let why = |text: &str| value(text).unwrap_err().0;
        assert_eq!(why("1.0 / dt"), "dt");
        assert_eq!(why("u + 1"), "u, set in line 3");
        assert_eq!(why("len(sys.argv)"), "sys.argv");
        assert_eq!(why("float(input())"), "the call of input");
        assert_eq!(why("x[3]"), "x[...]");
        assert_eq!(why("1 if input() else 2"), "the call of input");
        // Its results are rounded to fewer digits, by rules that depend on numpy's version.
        assert_eq!(why("np.float32(0.1)"), "the call of np.float32");
        assert_eq!(why("1/0"), "the result of '/'");
        assert_eq!(why("10.0**1000"), "the result of '**'");
        assert_eq!(why("lambda: 1"), "lambda");
        assert_eq!(why("{1: 2}"), "a dictionary whose keys are no texts");
        let deep = "(".repeat(500) + "1" + &")".repeat(500);
        assert_eq!(why(&deep), "an expression of many levels");
        assert_eq!(why(&("-".repeat(500) + "1")), "an expression of many levels");
        assert!(value(&("int(".repeat(500) + "1" + &")".repeat(500))).is_err());
        for text in [")", "(", "[,]", "1 +", "a.b(", "f(,)", "int(1 2)", "range(1,2,0)", "min()", "2**99999999999"] {
            let variables = Variables::new();
            for line in script_tokens(text).unwrap_or_default().lines() {
                let _ = evaluate(line.tokens, &variables);
            }
        }
    }
}
