//! Lexical analysis of Python: splits the text of a script into logical lines with indentation, for `walk`.

use std::borrow::Cow;

/// Keywords of statements with a block below them.
pub const BLOCK_KEYWORDS: [&str; 12] =
    ["if", "elif", "else", "for", "while", "def", "class", "try", "except", "finally", "with", "async"];

/// Token of a logical line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ScriptToken<'t> {
    Name(&'t str),
    /// Number as it is written.
    Number(&'t str),
    /// String without its quotes; escapes are not replaced.
    Text(&'t str),
    /// Operator or bracket.
    Symbol(&'t str),
    /// String `f'...'`, whose value is not known.
    FormattedText,
}

impl<'t> ScriptToken<'t> {
    /// Whether it is this operator or bracket.
    pub fn is(self, symbol: &str) -> bool {
        matches!(self, ScriptToken::Symbol(found) if found == symbol)
    }

    /// Whether it is a bracket that opens.
    pub fn opens_bracket(self) -> bool {
        matches!(self, ScriptToken::Symbol("(" | "[" | "{"))
    }

    /// Whether it is a bracket that closes.
    pub fn closes_bracket(self) -> bool {
        matches!(self, ScriptToken::Symbol(")" | "]" | "}"))
    }

    /// Whether it is `=` or an operator that assigns as well, as `+=`; not `:=`, which is a part of an expression.
    pub fn assigns(self) -> bool {
        matches!(self, ScriptToken::Symbol(symbol) if symbol.ends_with('=')
            && !["==", "!=", "<=", ">=", ":="].contains(&symbol))
    }

    /// The name, or the empty string.
    pub fn name(self) -> &'t str {
        if let ScriptToken::Name(name) = self { name } else { "" }
    }

    /// Text of the token, without quotes.
    pub fn text(self) -> &'t str {
        match self {
            ScriptToken::Name(text)
            | ScriptToken::Number(text)
            | ScriptToken::Symbol(text)
            | ScriptToken::Text(text) => text,
            ScriptToken::FormattedText => "",
        }
    }

    /// Text of the token, for messages.
    pub fn source(self) -> Cow<'t, str> {
        match self {
            ScriptToken::Name(text) | ScriptToken::Number(text) | ScriptToken::Symbol(text) => text.into(),
            ScriptToken::Text(text) => format!("'{text}'").into(),
            ScriptToken::FormattedText => "f-string".into(),
        }
    }
}

/// Token with its line, from 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lexeme<'t> {
    pub token: ScriptToken<'t>,
    pub line: usize,
}

/// Tokens of a script, by logical lines: brackets and backslashes join lines, semicolons separate them.
#[derive(Debug, Default, PartialEq)]
pub struct ScriptTokens<'t> {
    lexemes: Vec<Lexeme<'t>>,
    lines: Vec<LineEnd>,
}

/// Indentation of a logical line, and the index after its last token.
#[derive(Debug, PartialEq)]
struct LineEnd {
    indent: usize,
    end: usize,
}

/// Logical line.
#[derive(Debug, Clone, Copy)]
pub struct LogicalLine<'a> {
    /// Columns before the first token; a tab extends to the next multiple of 8. Plus 1 for statements after the first on a
    /// header's line, as `z = 2` in `if x: y = 1; z = 2`.
    pub indent: usize,
    /// Tokens of the line, at least one.
    pub tokens: &'a [Lexeme<'a>],
}

impl ScriptTokens<'_> {
    /// The logical lines in their order.
    pub fn lines(&self) -> impl Iterator<Item = LogicalLine<'_>> {
        let mut start = 0;
        self.lines.iter().map(move |&LineEnd { indent, end }| {
            let tokens = &self.lexemes[start..end];
            start = end;
            LogicalLine { indent, tokens }
        })
    }

    /// Tokens of the last line, which is not ended.
    fn begun(&self) -> &[Lexeme<'_>] {
        &self.lexemes[self.lines.last().map_or(0, |line| line.end)..]
    }

    /// Ends the last line, if it has tokens.
    fn end_line(&mut self, indent: usize) {
        if !self.begun().is_empty() {
            self.lines.push(LineEnd { indent, end: self.lexemes.len() });
        }
    }
}

/// Bracket or string that is not closed.
#[derive(Debug, PartialEq)]
pub struct UnclosedText {
    /// Line in which it opens.
    pub line: usize,
    pub kind: UnclosedKind,
}

impl std::fmt::Display for UnclosedText {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "line {}: the {} is not closed", self.line, self.kind.name())
    }
}

impl std::error::Error for UnclosedText {}

/// Kind of text that has to be closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum UnclosedKind {
    Bracket,
    String,
}

impl UnclosedKind {
    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            UnclosedKind::Bracket => "bracket",
            UnclosedKind::String => "string",
        }
    }
}

/// Operators of more than one character, longer ones first.
const LONG_OPERATORS: [&str; 23] = [
    "**=", "//=", "<<=", ">>=", "...", "**", "//", "==", "!=", "<=", ">=", "+=", "-=", "*=", "/=", "%=", "&=", "|=",
    "^=", "->", ":=", "<<", ">>",
];

/// Splits a script into the tokens of its logical lines. Errors: a bracket or string that is not closed.
pub fn script_tokens(text: &str) -> Result<ScriptTokens<'_>, UnclosedText> {
    let mut scanner = TokenScanner { rest: text, line: 1 };
    let mut script = ScriptTokens::default();
    let mut indent = scanner.skip_indentation();
    // Lines of the brackets that are open.
    let mut open = Vec::new();
    while let Some(next) = scanner.rest.chars().next() {
        let line = scanner.line;
        match next {
            '#' => scanner.skip(scanner.rest.find('\n').unwrap_or(scanner.rest.len())),
            '\\' if scanner.rest[1..].trim_start_matches('\r').starts_with('\n') => {
                scanner.skip(1 + scanner.rest[1..].find('\n').map_or(0, |length| length + 1));
            }
            '\n' | ';' if open.is_empty() => {
                scanner.skip(1);
                let is_header =
                    script.begun().first().is_some_and(|first| BLOCK_KEYWORDS.contains(&first.token.name()));
                script.end_line(indent);
                // All statements on the line of a header are below it: `if x: y = 1; z = 2`.
                indent += usize::from(is_header);
                if next == '\n' {
                    indent = scanner.skip_indentation();
                }
            }
            _ if next.is_whitespace() => scanner.skip(next.len_utf8()),
            _ => {
                let token = scanner.read_token()?;
                if token.opens_bracket() {
                    open.push(line);
                } else if token.closes_bracket() {
                    open.pop();
                }
                script.lexemes.push(Lexeme { token, line });
            }
        }
    }
    if let Some(&line) = open.first() {
        return Err(UnclosedText { line, kind: UnclosedKind::Bracket });
    }
    script.end_line(indent);
    // Up to half of the memory is spare. To free little of it is not worth the copy, which needs the memory of both.
    if script.lexemes.len() < script.lexemes.capacity() / 4 * 3 {
        script.lexemes.shrink_to_fit();
    }
    Ok(script)
}

/// Rest of a script that is not split yet, and the number of its first line.
struct TokenScanner<'a> {
    rest: &'a str,
    line: usize,
}

impl<'t> TokenScanner<'t> {
    fn skip(&mut self, bytes: usize) {
        let (skipped, rest) = self.rest.split_at(bytes);
        self.line += skipped.matches('\n').count();
        self.rest = rest;
    }

    /// Skips the blanks at the start of a line; returns the column after them.
    fn skip_indentation(&mut self) -> usize {
        let blanks = self.rest.len() - self.rest.trim_start_matches([' ', '\t', '\r', '\u{c}']).len();
        let columns = self.rest[..blanks].chars().fold(0, |column, c| match c {
            '\t' => (column / 8 + 1) * 8,
            ' ' => column + 1,
            _ => 0,
        });
        self.skip(blanks);
        columns
    }

    /// Reads the token at the start of the rest, which is neither empty nor begins with a blank.
    fn read_token(&mut self) -> Result<ScriptToken<'t>, UnclosedText> {
        let text = self.rest;
        let word_length = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
        let first = text.chars().next().unwrap_or_default();
        if text[word_length..].starts_with(['"', '\'']) && text[..word_length].chars().all(|c| "rRbBuUfF".contains(c)) {
            return self.read_string(word_length);
        }
        if first.is_ascii_digit() || first == '.' && text[1..].starts_with(|c: char| c.is_ascii_digit()) {
            let mut end = 0;
            let mut before = ' ';
            for c in text.chars() {
                let exponent_sign = matches!(before, 'e' | 'E') && !text.starts_with("0x") && "+-".contains(c);
                if !(c.is_ascii_alphanumeric() || c == '_' || c == '.' || exponent_sign) {
                    break;
                }
                (end, before) = (end + c.len_utf8(), c);
            }
            self.skip(end);
            return Ok(ScriptToken::Number(&text[..end]));
        }
        if word_length > 0 {
            self.skip(word_length);
            return Ok(ScriptToken::Name(&text[..word_length]));
        }
        let symbol = LONG_OPERATORS.into_iter().find(|operator| text.starts_with(operator));
        let length = symbol.map_or(first.len_utf8(), str::len);
        self.skip(length);
        Ok(ScriptToken::Symbol(&text[..length]))
    }

    /// Reads a string whose prefix, as the f of `f'...'`, has `prefix` bytes.
    fn read_string(&mut self, prefix: usize) -> Result<ScriptToken<'t>, UnclosedText> {
        let (line, text) = (self.line, self.rest);
        let quote = &text[prefix..=prefix];
        let triple = quote.repeat(3);
        let quotes = if text[prefix..].starts_with(&triple) { triple } else { quote.to_string() };
        let start = prefix + quotes.len();
        let mut escaped = false;
        for (length, c) in text[start..].char_indices() {
            if !escaped && text[start + length..].starts_with(&quotes) {
                self.skip(start + length + quotes.len());
                let content = &text[start..start + length];
                let formatted = text[..prefix].contains(['f', 'F']);
                return Ok(if formatted { ScriptToken::FormattedText } else { ScriptToken::Text(content) });
            }
            if c == '\n' && quotes.len() == 1 && !escaped {
                break;
            }
            escaped = c == '\\' && !escaped;
        }
        Err(UnclosedText { line, kind: UnclosedKind::String })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sources(text: &str) -> Vec<(usize, usize, Vec<String>)> {
        let script = script_tokens(text).unwrap();
        let source = |LogicalLine { indent, tokens }: LogicalLine| {
            (indent, tokens[0].line, tokens.iter().map(|lexeme| lexeme.token.source().into_owned()).collect())
        };
        script.lines().map(source).collect()
    }

    #[test]
    fn statements_on_the_line_of_a_header_are_below_it() {
        let indents = |text: &str| sources(text).into_iter().map(|(indent, ..)| indent).collect::<Vec<_>>();
        assert_eq!(indents("if x: y = 1; z = 2; u = 3\nv = 4; w = 5\n"), [0, 1, 1, 0, 0]);
    }

    #[test]
    fn lines_of_python() {
        let text = "dt = 1.e-3 # s\n\nif x:\n\tf(a,\n  .5, 'a#b')\nx=1_0; y = 2**3\nz = 1 + \\\n  2\n\"\"\"doc\nx = 3\n\"\"\"\n";
        let words = |line: &str| line.split(' ').map(str::to_string).collect::<Vec<_>>();
        assert_eq!(
            sources(text),
            [
                (0, 1, words("dt = 1.e-3")),
                (0, 3, words("if x :")),
                (8, 4, words("f ( a , .5 , 'a#b' )")),
                (0, 6, words("x = 1_0")),
                (0, 6, words("y = 2 ** 3")),
                (0, 7, words("z = 1 + 2")),
                (0, 9, vec!["'doc\nx = 3\n'".to_string()]),
            ]
        );
        assert_eq!(
            sources("a = f'{x}' # é\r\n b=0x1e+3"),
            [(0, 1, words("a = f-string")), (1, 2, words("b = 0x1e + 3"))]
        );
    }

    #[test]
    fn lines_that_do_not_end() {
        assert_eq!(script_tokens("a = 1\nf(2,\n3"), Err(UnclosedText { line: 2, kind: UnclosedKind::Bracket }));
        assert_eq!(script_tokens("a = 'b\nc'"), Err(UnclosedText { line: 1, kind: UnclosedKind::String }));
        assert_eq!(script_tokens("'''a\n"), Err(UnclosedText { line: 1, kind: UnclosedKind::String }));
        // Bytes of no meaning are symbols.
        for text in ["$", "é$\u{1}", ")", "\\", "1e", ".", "'", "\u{feff}a"] {
            let _ = script_tokens(text);
        }
    }
}
