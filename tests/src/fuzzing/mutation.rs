//! Damage to the bytes of a file.

use std::ops::Range;

use crate::draws::Draws;

/// Numbers at the ends of ranges, and texts that are almost numbers.
const NUMBERS: [&str; 30] = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "-0",
    "0",
    "-1",
    "1",
    "2",
    "3",
    "1e-320",
    "18446744073709551615",
    "9223372036854775808",
    "4294967296",
    "4294967295",
    "2147483648",
    "99999",
    "0.5",
    "1.7976931348623157E+308",
    "*****",
    "1e999",
    "1.0-10",
    "0x10",
    "1.",
    ".5",
    "--1",
    "1e",
    "1.0D+30",
];

/// Words and signs of the formats.
const TOKENS: [&str; 40] = [
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    "\"",
    "'",
    "//",
    "/*",
    "*/",
    "#",
    "$",
    "$bdyty",
    "$$$$$$",
    "\r\n",
    "\n",
    "\t",
    "\0",
    "\u{feff}",
    "é",
    "Some(",
    "None",
    "((((((((((",
    "[[[[[[[[[[",
    "!",
    "../x",
    "evolution",
    "<",
    ">",
    "/>",
    "&lt;",
    "\\",
    "=",
    "binary",
    "vertex",
    "ascii",
    "r#\"",
];

/// Longest input that damage makes, bytes.
const MAX_LENGTH: usize = 1 << 16;

/// Damages bytes once. `others`: further files of the same kind, from which pieces are taken.
pub fn damage(bytes: &mut Vec<u8>, others: &[Vec<u8>], draws: &mut Draws) {
    let length = bytes.len() as u64;
    let at = |draws: &mut Draws| draws.below(length + 1) as usize;
    match draws.below(16) {
        0 if length > 0 => {
            let k = draws.below(length) as usize;
            bytes[k] ^= 1 << draws.below(8);
        }
        1 if length > 0 => {
            let k = draws.below(length) as usize;
            bytes[k] = draws.below(256) as u8;
        }
        2 => bytes.truncate(at(draws)),
        3..=6 => replace_number(bytes, draws),
        7 => {
            let start = at(draws);
            let end = (start + 1 + draws.below(40) as usize).min(bytes.len());
            bytes.drain(start.min(end)..end);
        }
        8 => {
            let (start, end) = (at(draws), at(draws));
            let piece = bytes[start.min(end)..(start + 200).min(end.max(start))].to_vec();
            insert(bytes, at(draws), &piece);
        }
        9 => insert(bytes, at(draws), draws.choice(&TOKENS).as_bytes()),
        10 => {
            let other = &others[draws.below(others.len() as u64) as usize];
            let start = draws.below(other.len() as u64 + 1) as usize;
            let end = (start + draws.below(400) as usize).min(other.len());
            insert(bytes, at(draws), &other[start..end]);
        }
        11 => {
            // Repeats a piece, so that lists are long and brackets deep.
            let start = at(draws);
            let end = (start + 1 + draws.below(30) as usize).min(bytes.len());
            let times = 1 + draws.below(1 + 1000 / (end - start.min(end) + 1) as u64) as usize;
            let piece = bytes[start.min(end)..end].repeat(times);
            insert(bytes, start, &piece);
        }
        12 if length >= 8 => {
            // A binary number.
            let k = draws.below(length - 7) as usize;
            let number = draws.choice(&[f64::NAN, f64::INFINITY, 1e308, -0.0, -1.0, 1e-320, 1e18, 3.0]);
            let number = if draws.below(2) == 0 { number.to_le_bytes() } else { number.to_be_bytes() };
            bytes[k..k + 8].copy_from_slice(&number);
        }
        _ => damage_lines(bytes, draws),
    }
    bytes.truncate(MAX_LENGTH);
}

/// Repeats a piece at its place until there are `length` bytes: a line, a few bytes, a word of the formats or a number.
pub fn lengthen(bytes: &mut Vec<u8>, length: usize, draws: &mut Draws) {
    let at = draws.below(bytes.len() as u64 + 1) as usize;
    let (at, piece) = match draws.below(4) {
        0 => {
            let start = bytes[..at].iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
            let end =
                bytes[at..].iter().position(|&byte| byte == b'\n').map_or(bytes.len(), |newline| at + newline + 1);
            (start, bytes[start..end].to_vec())
        }
        1 => (at, bytes[at..(at + 1 + draws.below(40) as usize).min(bytes.len())].to_vec()),
        2 => (at, draws.choice(&TOKENS).as_bytes().to_vec()),
        _ => (at, format!("{}{}", draws.choice(&NUMBERS), draws.choice(&[" ", ",", "\n", ", "])).into_bytes()),
    };
    let piece = if piece.is_empty() { b" ".to_vec() } else { piece };
    let times = length.saturating_sub(bytes.len()) / piece.len();
    insert(bytes, at, &piece.repeat(times));
}

fn insert(bytes: &mut Vec<u8>, at: usize, piece: &[u8]) {
    bytes.splice(at..at, piece.iter().copied());
}

/// Deletes, repeats or swaps lines.
fn damage_lines(bytes: &mut Vec<u8>, draws: &mut Draws) {
    let mut lines: Vec<&[u8]> = bytes.split(|&byte| byte == b'\n').collect();
    let (a, b) = (draws.below(lines.len() as u64) as usize, draws.below(lines.len() as u64) as usize);
    match draws.below(3) {
        0 => drop(lines.remove(a)),
        1 => lines.insert(b, lines[a]),
        _ => lines.swap(a, b),
    }
    *bytes = lines.join(&b'\n');
}

/// Replaces a number in decimals by another, with the same width in half of the cases, as columns need.
fn replace_number(bytes: &mut Vec<u8>, draws: &mut Draws) {
    let numbers = numbers_in(bytes);
    if numbers.is_empty() {
        return;
    }
    let range = numbers[draws.below(numbers.len() as u64) as usize].clone();
    let number = draws.choice(&NUMBERS);
    let width = if draws.below(2) == 0 { range.len() } else { 0 };
    bytes.splice(range, format!("{number:>width$}").into_bytes());
}

/// Decimal numbers in bytes.
fn numbers_in(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let is_start = bytes[at].is_ascii_digit()
            || (b"+-.".contains(&bytes[at]) && bytes.get(at + 1).is_some_and(u8::is_ascii_digit));
        if !is_start {
            at += 1;
            continue;
        }
        let start = at;
        at += 1;
        let continues = |at: usize| match bytes.get(at) {
            Some(b'0'..=b'9' | b'.') => true,
            Some(b'e' | b'E' | b'd' | b'D') => {
                bytes.get(at + 1).is_some_and(|next| next.is_ascii_digit() || b"+-".contains(next))
            }
            Some(b'+' | b'-') => b"eEdD".contains(&bytes[at - 1]),
            _ => false,
        };
        while continues(at) {
            at += 1;
        }
        found.push(start..at);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found() {
        let text = b"a: -1.5e-3, [2.D+01 x7] .5-1";
        let found: Vec<&str> =
            numbers_in(text).into_iter().map(|range| std::str::from_utf8(&text[range]).unwrap()).collect();
        assert_eq!(found, ["-1.5e-3", "2.D+01", "7", ".5", "-1"]);
    }

    #[test]
    fn lengthened_bytes_have_the_length_and_begin_and_end_as_before() {
        let start = b"first\nsecond 2\nthird".to_vec();
        for number in 0..200 {
            let mut bytes = start.clone();
            lengthen(&mut bytes, 10_000, &mut Draws::new(3, number));
            // The piece is at most 41 bytes.
            assert!((10_000 - 41..=10_000).contains(&bytes.len()), "{}", bytes.len());
            let same = bytes.iter().zip(&start).take_while(|(a, b)| a == b).count();
            let same_end = bytes.iter().rev().zip(start.iter().rev()).take_while(|(a, b)| a == b).count();
            assert!(same + same_end >= start.len());
        }
    }

    #[test]
    fn damage_depends_on_the_draws_alone() {
        let start = b"$bdyty\n RBDY3      1\n".to_vec();
        let damaged = |number: u64| {
            let (mut bytes, mut draws) = (start.clone(), Draws::new(1, number));
            (0..20).for_each(|_| damage(&mut bytes, std::slice::from_ref(&start), &mut draws));
            bytes
        };
        assert!((0..2000).all(|number| damaged(number) == damaged(number)));
        assert!((0..2000).filter(|&number| damaged(number) != start).count() > 1990);
    }
}
