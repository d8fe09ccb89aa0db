//! Parser of the syntax of RON that continues after mistakes: finds the values of a text with their positions, and all
//! mistakes. Which types the values must have is known to the RON library alone.

use std::ops::Range;

/// Fault at a byte of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextFault {
    /// Byte of the fault in the text.
    pub offset: usize,
    /// Path of the value that it belongs to, as `grains.0.number`; empty for the whole text.
    pub path: String,
    pub found: String,
    /// Expectation that begins with `expected`, or a question, `did you mean ...?`.
    pub expected: String,
}

impl std::fmt::Display for TextFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; {}", self.found, self.expected)
    }
}

impl std::error::Error for TextFault {}

/// Line and column of a byte, 1-based, columns in characters.
pub fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..offset.min(text.len())];
    let begin = before.rfind('\n').map_or(0, |end| end + 1);
    (1 + before.matches('\n').count(), 1 + before[begin..].chars().count())
}

/// All faults of the syntax of a text.
pub fn syntax_faults(text: &str) -> Vec<TextFault> {
    RonParser::parse(text).1
}

/// Value of a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ValueNode {
    pub path: String,
    /// Name of its field, if it has one.
    pub name: Option<Range<usize>>,
    pub span: Range<usize>,
}

/// Largest number of characters of a value that a message shows.
const MAX_SHOWN_CHARS: usize = 40;

/// Value as messages show it: in one line, and cut off if it is long.
pub fn display_text(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= MAX_SHOWN_CHARS {
        line
    } else {
        format!("{}...", line.chars().take(MAX_SHOWN_CHARS).collect::<String>())
    }
}

/// Number of mistakes after which parsing stops: more than anybody reads, and the time for a text full of mistakes is bounded.
const MAX_MISTAKES: usize = 500;

/// Number of characters behind a value in which the end of its item is looked for.
const MAX_ITEM_CHARS: usize = 1000;

/// Nesting depth beyond which the library rejects a text.
pub const MAX_DEPTH: usize = 128;

/// Parser that continues after mistakes.
pub struct RonParser<'a> {
    text: &'a str,
    /// Next byte.
    pub offset: usize,
    /// Byte after the last token.
    last_end: usize,
    /// Open brackets, with the byte of each.
    open: Vec<(char, usize)>,
    /// Brackets with the bytes of their opening and closing.
    brackets: Vec<(char, usize, usize)>,
    nodes: Vec<ValueNode>,
    mistakes: Vec<TextFault>,
    /// Whether parsing has stopped after a mistake from which it cannot recover.
    aborted: bool,
}

impl<'a> RonParser<'a> {
    /// Parser at the start of a text.
    pub fn new(text: &'a str) -> Self {
        RonParser {
            text,
            offset: 0,
            last_end: 0,
            open: vec![],
            brackets: vec![],
            nodes: vec![],
            mistakes: vec![],
            aborted: false,
        }
    }

    /// Values of a text and all mistakes in it.
    pub fn parse(text: &'a str) -> (Vec<ValueNode>, Vec<TextFault>) {
        let mut parser = RonParser::new(text);
        parser.skip_blank();
        while parser.remaining_text().starts_with("#!") {
            let end = parser.remaining_text().find(']').map_or(parser.remaining_text().len(), |end| end + 1);
            parser.advance(end);
            parser.skip_blank();
        }
        if parser.at_end() && !parser.aborted && parser.mistakes.is_empty() {
            parser.add_fault(0, "", "no value", "expected one");
        } else {
            let start = parser.offset;
            parser.skip_value("", None);
            parser.skip_blank();
            if !parser.aborted && !parser.at_end() && parser.mistakes.is_empty() {
                let rest = display_text(parser.remaining_text().lines().next().unwrap_or(""));
                match parser.current_char() {
                    Some(':' | '=') => {
                        let word = &text[start..parser.last_end];
                        parser.add_fault(start, "", &format!("'{word}' outside of ( )"), "expected '(' before it");
                    }
                    Some(close @ (')' | ']' | '}')) => {
                        parser.add_fault(
                            parser.offset,
                            "",
                            &format!("'{close}' closes nothing"),
                            "expected nothing more",
                        );
                    }
                    Some(next) if next.is_alphabetic() && begins_with_number(&text[start..parser.last_end]) => {
                        let found = display_text(&text[start..]);
                        parser.add_fault(start, "", &found, "expected a number without unit");
                    }
                    _ => parser.add_fault(
                        parser.offset,
                        "",
                        &format!("'{rest}' behind the end"),
                        "expected nothing more",
                    ),
                }
            }
        }
        if let Some((bracket, offset)) = parser.suspect_bracket() {
            let close = closing_bracket(bracket);
            parser.mistakes.retain(|mistake| mistake.offset < offset);
            let (found, expected) =
                (format!("'{bracket}' without '{close}'"), format!("expected '{close}' in this line"));
            parser.mistakes.push(TextFault { offset, path: String::new(), found, expected });
        }
        let RonParser { nodes, mut mistakes, .. } = parser;
        mistakes.sort_by_key(|mistake| mistake.offset);
        mistakes.dedup();
        (nodes, mistakes)
    }

    /// First bracket that seems to lack its end, after a mistake in brackets: one that its line leaves open, while the
    /// next line is not indented more.
    fn suspect_bracket(&self) -> Option<(char, usize)> {
        if !self.aborted || !self.mistakes.iter().any(|mistake| mistake.found.contains("is open")) {
            return None;
        }
        let open = self.open.iter().map(|&(bracket, offset)| (bracket, offset, self.text.len()));
        let mut brackets: Vec<_> = self.brackets.iter().copied().chain(open).collect();
        brackets.sort_unstable_by_key(|bracket| bracket.1);
        let line_ends: Vec<usize> = self.text.match_indices('\n').map(|(end, _)| end).collect();
        let seems_open = |&(_, offset, end): &(char, usize, usize)| {
            let line_number = line_ends.partition_point(|line_end| *line_end < offset);
            let line_start = if line_number == 0 { 0 } else { line_ends[line_number - 1] + 1 };
            let Some(line_end) = line_ends.get(line_number).filter(|line_end| **line_end < end) else {
                return false;
            };
            let line = &self.text[line_start..*line_end];
            // The text behind the line up to the closing bracket, which is part of it if it is the first character.
            let behind = &self.text[line_end + 1..];
            let behind = &behind[..(end - line_end - 1).max(1).min(behind.len())];
            let indent = |line: &str| line.len() - line.trim_start().len();
            let next_line = behind.lines().find(|line| !line.trim().is_empty());
            let is_not_deeper =
                |next: &str| indent(next) <= indent(line) && !next.trim_start().starts_with([')', ']', '}']);
            offset > line_start + indent(line) && next_line.is_some_and(is_not_deeper)
        };
        brackets.into_iter().find(seems_open).map(|(bracket, offset, _)| (bracket, offset))
    }

    fn remaining_text(&self) -> &'a str {
        &self.text[self.offset..]
    }

    fn current_char(&self) -> Option<char> {
        self.remaining_text().chars().next()
    }

    fn at_end(&self) -> bool {
        self.offset >= self.text.len()
    }

    /// Skips the bytes of a token.
    fn advance(&mut self, bytes: usize) {
        self.offset = (self.offset + bytes).min(self.text.len());
        self.last_end = self.offset;
    }

    fn add_fault(&mut self, offset: usize, path: &str, found: &str, expected: &str) {
        if !self.aborted {
            let [found, expected] = [found, expected].map(str::to_string);
            self.mistakes.push(TextFault { offset, path: path.into(), found, expected });
            if self.mistakes.len() >= MAX_MISTAKES {
                self.give_up();
            }
        }
    }

    /// Stops parsing.
    fn give_up(&mut self) {
        self.aborted = true;
        self.offset = self.text.len();
    }

    /// Skips white space and comments.
    pub fn skip_blank(&mut self) {
        loop {
            let rest = self.remaining_text();
            let blank = |c: char| c.is_ascii_whitespace() || "\u{b}\u{85}\u{200e}\u{200f}\u{2028}\u{2029}".contains(c);
            if let Some(blank) = rest.chars().next().filter(|c| blank(*c)) {
                self.offset += blank.len_utf8();
            } else if rest.starts_with("//") {
                self.offset += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("/*") {
                self.skip_comment();
            } else if rest.starts_with('#') && !rest.starts_with("#!") {
                self.add_fault(self.offset, "", "'#' begins no comment", "expected // before it, or /* */ around it");
                self.offset += rest.find('\n').unwrap_or(rest.len());
            } else {
                return;
            }
        }
    }

    /// Skips a comment in `/* */`, which may contain others.
    fn skip_comment(&mut self) {
        let start = self.offset;
        let mut depth = 0;
        loop {
            let rest = self.remaining_text();
            if rest.starts_with("/*") {
                (depth, self.offset) = (depth + 1, self.offset + 2);
            } else if rest.starts_with("*/") {
                (depth, self.offset) = (depth - 1, self.offset + 2);
            } else if let Some(next) = self.current_char() {
                self.offset += next.len_utf8();
            } else {
                self.add_fault(start, "", "a comment without end", "expected */ behind it");
                return self.give_up();
            }
            if depth == 0 {
                return;
            }
        }
    }

    /// Length of a word: a name or a number.
    fn word_length(&self) -> usize {
        let rest = self.remaining_text();
        let raw = if rest.starts_with("r#") && !rest.starts_with("r#\"") { 2 } else { 0 };
        let part = |c: char| c.is_alphanumeric() || "_.+-".contains(c);
        raw + rest[raw..].find(|c| !part(c)).unwrap_or(rest.len() - raw)
    }

    /// Reads and skips a field's name before a colon, or before another mark in place of a colon.
    fn read_field_name(&mut self, path: &str) -> Option<Range<usize>> {
        let start = self.offset;
        // State to which the parser returns if there is no name.
        let (last_end, mistake_count, aborted) = (self.last_end, self.mistakes.len(), self.aborted);
        let is_quoted = self.current_char() == Some('"');
        let name = if is_quoted {
            self.skip_string(path);
            // The closing quote may be missing.
            let quote = usize::from(self.text[..self.offset].ends_with('"'));
            start + 1..(self.offset - quote).max(start + 1)
        } else {
            let length = self.word_length();
            if length == 0 || !self.remaining_text().starts_with(|c: char| c.is_alphabetic() || c == '_') {
                return None;
            }
            self.advance(length);
            start..self.offset
        };
        let end = self.offset;
        self.skip_blank();
        let word = &self.text[name.clone()];
        match self.current_char() {
            Some(':') if !self.remaining_text().starts_with("::") => {
                if !is_quoted && word.contains(['-', '.', '+']) && !word.starts_with("r#") {
                    let plain = word.replace(['-', '.', '+'], "_");
                    self.add_fault(start, path, &format!("the name '{word}'"), &format!("did you mean {plain}?"));
                }
                if is_quoted {
                    let found = format!("the name \"{word}\" in quotes");
                    self.add_fault(start, path, &found, &format!("expected {word}: without quotes"));
                }
                self.advance(1);
                return Some(name);
            }
            Some('=') if !is_quoted => {
                self.add_fault(self.offset, path, &format!("'=' behind {word}"), &format!("expected {word}: value"));
                self.advance(1);
                return Some(name);
            }
            // A name and a value on one line, as `number 50`.
            Some(next) if !is_quoted && !self.aborted => {
                let is_same_line = !self.text[end..self.offset].contains('\n') && self.offset > end;
                let begins_value = next.is_alphanumeric() || "\"[-+.".contains(next);
                if is_same_line && begins_value {
                    self.add_fault(end, path, &format!("no ':' behind '{word}'"), &format!("expected {word}: value"));
                    return Some(name);
                }
            }
            _ => {}
        }
        (self.offset, self.last_end, self.aborted) = (start, last_end, aborted);
        self.mistakes.truncate(mistake_count);
        None
    }

    /// Skips a text in quotes.
    fn skip_string(&mut self, path: &str) {
        let start = self.offset;
        self.advance(1);
        loop {
            match self.current_char() {
                Some('"') => return self.advance(1),
                Some('\\') => {
                    let next = self.remaining_text().chars().nth(1).map_or(0, char::len_utf8);
                    self.advance(1 + next);
                }
                // Strings of our files have one line: the closing quote is missing.
                None | Some('\n') => {
                    let found = format!("no '\"' behind {}", display_text(&self.text[start..self.offset]));
                    self.add_fault(start, path, &found, "expected '\"' at the end of the text");
                    return self.give_up();
                }
                Some(other) => self.advance(other.len_utf8()),
            }
        }
    }

    /// Skips `r"..."` or `r#"..."#`, if there is one.
    fn skip_raw_string(&mut self) -> bool {
        let rest = self.remaining_text();
        let marks = rest.strip_prefix('r').map_or(0, |rest| rest.bytes().take_while(|&b| b == b'#').count());
        if !rest.starts_with('r') || !rest[1 + marks..].starts_with('"') {
            return false;
        }
        let end = format!("\"{}", "#".repeat(marks));
        let body = &rest[marks + 2..];
        match body.find(&end) {
            Some(length) => self.advance(marks + 2 + length + end.len()),
            None => {
                self.add_fault(self.offset, "", "no end of the text in quotes", &format!("expected {end}"));
                self.give_up();
            }
        }
        true
    }

    /// Skips the value at `path`.
    fn skip_value(&mut self, path: &str, name: Option<Range<usize>>) {
        self.skip_blank();
        let start = self.offset;
        match self.current_char() {
            Some('"') => self.skip_string(path),
            Some('r') if self.skip_raw_string() => {}
            Some('\'') => self.skip_character(path),
            Some(bracket @ ('(' | '[' | '{')) => self.skip_items(path, bracket),
            _ => {
                let length = self.word_length();
                if length == 0 {
                    return self.report_missing_value(path);
                }
                self.advance(length);
                let head = self.offset;
                self.skip_blank();
                match self.current_char() {
                    Some('(') => self.skip_items(path, '('),
                    _ => self.last_end = head,
                }
            }
        }
        self.nodes.push(ValueNode { path: path.into(), name, span: start..self.last_end });
    }

    /// Reports that a value is missing, with the text at its position.
    fn report_missing_value(&mut self, path: &str) {
        match self.current_char() {
            None if self.open.is_empty() => self.add_fault(self.last_end, path, "the text ends", "expected a value"),
            None => {}
            Some(mark @ (',' | ')' | ']' | '}' | ';' | ':' | '=')) => {
                self.add_fault(self.offset, path, &format!("'{mark}'"), "expected a value before it");
                if mark == ':' || mark == '=' {
                    self.advance(1);
                }
            }
            Some(mark) => {
                let found = if mark.is_ascii_graphic() {
                    format!("'{mark}'")
                } else {
                    format!(
                        "the character U+{:04X}{}",
                        u32::from(mark),
                        if mark.is_control() { String::new() } else { format!(" '{mark}'") }
                    )
                };
                let quotes = "\u{201c}\u{201d}\u{201e}\u{ab}\u{bb}`".contains(mark);
                self.add_fault(
                    self.offset,
                    path,
                    &found,
                    if quotes { "expected plain quotes \"" } else { "expected a value" },
                );
                self.give_up();
            }
        }
    }

    /// Skips `'x'`; a longer text in such quotes is a mistake.
    fn skip_character(&mut self, path: &str) {
        let start = self.offset;
        let rest = &self.remaining_text()[1..];
        match rest.find(['\'', '\n']).filter(|end| rest[*end..].starts_with('\'')) {
            Some(end) => {
                let inside = &rest[..end];
                if inside.chars().count() != 1 && !inside.starts_with('\\') {
                    self.add_fault(start, path, &format!("'{inside}'"), &unquoted_expectation(inside));
                }
                self.advance(end + 2);
            }
            None => {
                self.add_fault(start, path, "'", "expected a value; texts are in \" \"");
                self.give_up();
            }
        }
    }

    /// Skips a bracket, its contents and its closing bracket.
    fn skip_items(&mut self, path: &str, bracket: char) {
        let start = self.offset;
        let text = self.text;
        let position = || {
            let (line, column) = line_and_column(text, start);
            format!("{line}:{column}")
        };
        let closing = closing_bracket(bracket);
        if bracket == '{' {
            self.add_fault(start, path, "'{'", "expected '(' around fields, '[' around lists");
        }
        self.open.push((bracket, start));
        self.advance(1);
        if self.open.len() > MAX_DEPTH {
            // The library reports this.
            self.mistakes.clear();
            self.give_up();
        }
        // Number of items so far, and number of those with a name.
        let (mut count, mut names) = (0, 0);
        loop {
            self.skip_blank();
            match self.current_char() {
                None => {
                    self.add_fault(
                        start,
                        path,
                        &format!("'{bracket}' without '{closing}'"),
                        &format!("expected '{closing}' before the end of the text"),
                    );
                    self.aborted = true;
                    return;
                }
                Some(close @ (')' | ']' | '}')) if close == closing || bracket == '{' => {
                    self.brackets.push((bracket, start, self.offset));
                    self.open.pop();
                    return self.advance(1);
                }
                Some(close @ (')' | ']' | '}')) => {
                    let found = format!("'{close}', while '{bracket}' of {} is open", position());
                    self.add_fault(self.offset, path, &found, &format!("expected '{closing}' before it"));
                    return self.give_up();
                }
                Some(',') => {
                    self.add_fault(self.offset, path, "','", "expected a value before it");
                    self.advance(1);
                    continue;
                }
                Some(_) => {}
            }
            let item = self.offset;
            let name = self.read_field_name(path);
            let word = name.as_ref().map_or("", |name| &self.text[name.clone()]);
            if name.is_some() && bracket == '[' {
                let found = format!("'{word}:' in a list, while '[' of {} is open", position());
                self.add_fault(
                    item,
                    path,
                    &found,
                    if count == 0 { "expected '(' before it" } else { "expected ']' before it" },
                );
                return self.give_up();
            }
            if name.is_some() && count > names && names == 0 {
                let found = format!("'{word}:', while '(' of {} is open", position());
                self.add_fault(item, path, &found, "expected ')' before it");
                return self.give_up();
            }
            let key = if name.is_some() { word.to_string() } else { (count - names).to_string() };
            let item_path = if path.is_empty() { key } else { format!("{path}.{key}") };
            (count, names) = (count + 1, names + usize::from(name.is_some()));
            let has_name = name.is_some();
            let lacks_name = !has_name && names > 0 && bracket == '(';
            let mistakes_before = self.mistakes.len();
            self.skip_blank();
            let value_start = self.offset;
            self.skip_value(&item_path, name);
            let value = &self.text[value_start..self.last_end.max(value_start)];
            if lacks_name && self.mistakes.len() == mistakes_before && !self.aborted {
                self.report_missing_name(item, path, value);
            }
            self.skip_blank();
            match self.current_char() {
                Some(',') => self.advance(1),
                Some(';') => {
                    self.add_fault(self.offset, &item_path, "';'", "expected ','");
                    self.advance(1);
                }
                Some(')' | ']' | '}') | None => {}
                Some(':' | '=') if has_name => {
                    self.add_fault(
                        value_start,
                        &item_path,
                        &format!("a second name, '{value}'"),
                        "expected '(' before it",
                    );
                    return self.give_up();
                }
                Some(mark) => self.report_missing_comma(&item_path, value, mark),
            }
        }
    }

    /// Reports a value without a name among values with names, once for each bracket; `item` is the byte of the value, `path`
    /// that of the bracket.
    fn report_missing_name(&mut self, item: usize, path: &str, value: &str) {
        let before = &self.text[..item];
        let digit = |c: char| c.is_ascii_digit();
        if before.ends_with(',') && before[..item - 1].ends_with(digit) && value.starts_with(digit) {
            let number = before.rfind(|c: char| !(digit(c) || c == ',' || c == '-')).map_or(0, |offset| offset + 1);
            let found = self.text[number..item + value.len()].to_string();
            let with_point = found.replace(',', ".");
            let expected = match with_point.matches('.').count() {
                1 => format!("expected a decimal point, {with_point}"),
                _ => format!("expected digits without separators, {}", found.replace(',', "")),
            };
            self.add_fault(number, path, &found, &expected);
        } else if !self.mistakes.iter().any(|mistake| mistake.path == path && mistake.found.ends_with("without a name"))
        {
            self.add_fault(item, path, &format!("{} without a name", display_text(value)), "expected name: value");
        }
    }

    /// Reports the text that follows a value instead of a comma; `mark` is its first character.
    fn report_missing_comma(&mut self, path: &str, value: &str, mark: char) {
        let next_length = self.word_length().max(mark.len_utf8());
        let next = display_text(&self.remaining_text()[..next_length]);
        let is_same_line = !self.text[self.last_end..self.offset].contains('\n');
        let is_number = begins_with_number(value);
        // The text up to the end of the item, as in `2700.0 kg/m3` and `2.7*1000`. It is short: long texts are not searched
        // again for each of many mistakes.
        let rest = self.remaining_text();
        let length = rest.char_indices().nth(MAX_ITEM_CHARS).map_or(rest.len(), |(offset, _)| offset);
        let rest = &rest[..length.max(next_length)];
        let end = rest.find([',', ')', ']', '}', '(', '[', '"', ':', '\n', '\r']).unwrap_or(rest.len());
        let end = rest[..end].find("//").unwrap_or(end);
        let ends_item = !rest[end..].starts_with([':', '(', '[', '"']);
        if is_number && is_same_line && ends_item && (mark.is_alphabetic() || "*/^%\u{b0}\u{b7}".contains(mark)) {
            let offset = self.last_end - value.len();
            let begin = self.offset;
            self.advance(rest[..end].trim_end().len());
            let found = display_text(&self.text[offset..self.offset]);
            let is_term = |part: &str| part.trim().parse::<f64>().is_ok();
            let is_arithmetic = self.text[begin..self.offset].split(['*', '/', '^', '%']).skip(1).any(is_term);
            let expected = if is_arithmetic && !mark.is_alphabetic() {
                "expected one number: arithmetic is not supported"
            } else {
                "expected a number without unit"
            };
            self.add_fault(offset, path, &found, expected);
            self.skip_blank();
            if self.current_char() == Some(',') {
                self.advance(1);
            }
        } else if mark.is_alphanumeric() || "\"'([{-+._".contains(mark) {
            self.add_fault(self.last_end, path, &format!("no ',' before '{next}'"), "expected ',' here");
            if is_number && is_same_line && rest[next_length..].trim_start().starts_with(':') {
                self.give_up();
            }
        } else {
            self.add_fault(self.offset, path, &format!("'{next}'"), "expected ','");
            self.give_up();
        }
    }
}

/// Whether a word begins like a number.
pub fn begins_with_number(word: &str) -> bool {
    word.trim_start_matches(['+', '-', '.']).starts_with(|c: char| c.is_ascii_digit())
}

fn closing_bracket(bracket: char) -> char {
    match bracket {
        '(' => ')',
        '[' => ']',
        _ => '}',
    }
}

/// Expectation for a text in single quotes: the numbers in it without quotes, or the text in double quotes.
fn unquoted_expectation(content: &str) -> String {
    let numbers = content.trim().trim_start_matches('(').trim_end_matches(')');
    match (numbers.split(',').all(|part| part.trim().parse::<f64>().is_ok()), numbers.contains(',')) {
        (true, true) => format!("expected ({numbers}), or \"{content}\" for a text"),
        (true, false) => format!("expected {numbers}, or \"{content}\" for a text"),
        (false, _) => format!("expected \"{content}\""),
    }
}
