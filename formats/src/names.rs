//! Names in messages: suggestions for unknown ones, counts with their nouns, and paths of values in words.

/// Question with the known name nearest to an unknown one, if it is near enough: `did you mean output_every?`.
pub fn nearest_name<'a>(name: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let plain_form = |name: &str| name.to_lowercase().replace(['-', '_'], "");
    let plain_name = plain_form(name);
    // Names that are this much longer than all known ones are not compared letter by letter.
    let longest = candidates.iter().map(|other| other.len()).max()?;
    if plain_name.len() > 4 * longest {
        return None;
    }
    let distance = |other: &str| strsim::damerau_levenshtein(&plain_name, &plain_form(other));
    let best = candidates.iter().copied().min_by_key(|other| distance(other))?;
    // A third of the letters may differ; with more, unrelated short names would match.
    let letters = plain_name.chars().count().max(plain_form(best).chars().count());
    (distance(best) <= letters / 3 || plain_form(best).starts_with(&plain_name) && plain_name.len() >= 3)
        .then_some(best)
}

/// Suggestion for an unknown name: the nearest known name, or all.
pub fn known_names(name: &str, candidates: &[&str]) -> String {
    match (nearest_name(name, candidates), candidates) {
        (Some(near), _) => format!("did you mean {near}?"),
        (None, []) => "expected none".into(),
        (None, [one]) => format!("expected {one}"),
        (None, all) => format!("expected one of {}", all.join(", ")),
    }
}

/// Count with its noun: `1 body`, `2 bodies`.
pub fn count_text(count: usize, noun: &str) -> String {
    let plural = match (count, noun) {
        (1, _) => noun.to_string(),
        (_, "body") => "bodies".into(),
        (_, "polyhedron") => "polyhedra".into(),
        (_, "vertex") => "vertices".into(),
        (_, "weight or colour") => "weights or colours".into(),
        _ => format!("{noun}s"),
    };
    format!("{count} {plural}")
}

/// Number as messages print it: with all of its digits, and with an exponent below 1e-4 and from 1e6 on.
///
/// ```
/// use cd_formats::names::number_text;
/// assert_eq!([0.0, -0.25, 2700.0, 1e300, 2.5e-5].map(number_text), ["0", "-0.25", "2700", "1e300", "2.5e-5"]);
/// ```
pub fn number_text(x: f64) -> String {
    let size = x.abs();
    if size == 0.0 || !size.is_finite() || (1e-4..1e6).contains(&size) { x.to_string() } else { format!("{x:e}") }
}

/// Vector as messages and scenes write it, with the numbers of [`number_text`]: `(0, 0, -9.81)`.
pub fn vector_text(vector: &[f64]) -> String {
    format!("({})", vector.iter().copied().map(number_text).collect::<Vec<_>>().join(", "))
}

/// [`number_text`] with at most ten significant digits, without the rounding errors of sums: `0.819` for
/// 0.8190000000000001.
pub fn rounded_number(x: f64) -> String {
    number_text(format!("{x:.9e}").parse().unwrap_or(x))
}

/// [`number_text`] with at most six significant digits, for computed lengths.
pub fn six_digits(x: f64) -> String {
    number_text(format!("{x:.5e}").parse().unwrap_or(x))
}

/// Number with three significant digits; with an exponent below 1e-3 and from 1e4 on.
pub fn short_number(x: f64) -> String {
    match x.abs() {
        size if (1e-3..1e4).contains(&size) => format!("{:.*}", (2.0 - libm::log10(size).floor()).max(0.0) as usize, x),
        0.0 => "0".into(),
        _ => format!("{x:.2e}"),
    }
}

/// Ratio with one decimal, and with an exponent from 1e6 on: `2.5`, `1.00e302`.
pub fn ratio_text(ratio: f64) -> String {
    if ratio < 1e6 { format!("{ratio:.1}") } else { short_number(ratio) }
}

/// Converts a path to words: `grains.0.sizes` is `grains 1, sizes`; `materials.2` is `material 3`.
pub(crate) fn path_in_words(path: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    for key in path.split('.') {
        match (key.parse::<usize>(), words.last_mut()) {
            // Components of items, as in `--set`.
            (Ok(index), Some(item)) if item.ends_with(|last: char| last.is_ascii_digit()) => {
                *item += &format!(".{}", index + 1);
            }
            (Ok(index), Some(list)) => {
                let one = match list.as_str() {
                    "grains" => "grains",
                    "bodies" => "body",
                    list => list.trim_end_matches('s'),
                };
                *list = format!("{one} {}", index + 1);
            }
            (Ok(index), None) => words.push(format!("item {}", index + 1)),
            _ => words.push(key.to_string()),
        }
    }
    words.join(", ")
}

/// Whether a text can be part of the name of a file on any system: letters, digits, `-` and `_`, at most 60.
pub fn is_file_name(text: &str) -> bool {
    (1..=60).contains(&text.len()) && text.bytes().all(|c| c.is_ascii_alphanumeric() || c == b'-' || c == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_read_as_words() {
        assert_eq!(path_in_words("grains.0.sizes"), "grains 1, sizes");
        assert_eq!(path_in_words("materials.2.name"), "material 3, name");
        assert_eq!(path_in_words("compute.dt"), "compute, dt");
        assert_eq!(path_in_words("bodies.1.spin"), "body 2, spin");
        assert_eq!(path_in_words("0.action"), "item 1, action");
        assert_eq!(path_in_words("grains.0.placement.positions.1.2"), "grains 1, placement, position 2.3");
    }
}
