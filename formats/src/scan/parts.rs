//! Reading and writing of long files in parallel, in parts of whole records. Short files start no threads.

use std::io::Read;
use std::path::Path;

use rayon::prelude::*;

use super::{AcceptedDeviations, AsciiText, LineScanner, TextPart};
use crate::atomic;
use crate::error::Faults;

/// Smallest size of a part of a text, bytes, which then ends with its record: enough to hide the cost of a task.
const PART_SIZE: usize = 1 << 20;
/// Smallest size of a block of a file, bytes, of which only one is in memory: parts for many threads, and little next to
/// the records of a long file.
const BLOCK_SIZE: usize = 16 << 20;
/// Number of records of one task of writing: enough to hide its cost.
const RECORDS_PER_TASK: usize = 1024;

/// Size of a text.
#[derive(Debug, Clone, Copy, Default)]
struct TextCounts {
    lines: usize,
    records: usize,
}

impl AsciiText<'_> {
    /// The text in parts, each of which but the first begins with a line `$keyword`. The counts of the text are added to
    /// `counts_before`, those of the text before it.
    fn parts(&self, keyword: &str, counts_before: &mut TextCounts) -> Vec<TextPart<'_>> {
        let begin = format!("\n${keyword}");
        let mut texts = Vec::new();
        let mut rest: &str = &self.0;
        // Cut where a line begins: behind its end of line.
        while let Some(at) = rest.get(PART_SIZE..).and_then(|behind| behind.find(&begin)) {
            let (part, behind) = rest.split_at(PART_SIZE + at + 1);
            texts.push(part);
            rest = behind;
        }
        texts.push(rest);
        // Only the last part may end within a line, and nothing follows its counts.
        let count = |text: &&str| {
            let begins_record = |line: &str| usize::from(line.get(1..6) == Some(keyword));
            text.lines().fold(TextCounts::default(), |TextCounts { lines, records }, line| TextCounts {
                lines: lines + 1,
                records: records + begins_record(line),
            })
        };
        let counts: Vec<TextCounts> = match &texts[..] {
            [text] => vec![count(text)],
            several => several.par_iter().map(count).collect(),
        };
        let part = |(text, own): (_, TextCounts)| {
            let part = TextPart { text, lines_before: counts_before.lines, records_before: counts_before.records };
            *counts_before =
                TextCounts { lines: counts_before.lines + own.lines, records: counts_before.records + own.records };
            part
        };
        texts.into_iter().zip(counts).map(part).collect()
    }
}

/// Reads the records that begin with a line `$keyword`; returns the values of `read` for each part, in order, and the notices
/// about the form of the file.
///
/// `read` gets a scanner at the start of a part and the number of records before it. A text with a fault is read again as
/// one part, so that one scanner finds its faults.
///
/// Errors: all faults of the text.
pub fn read_records<T: Send>(
    path: &Path,
    text: &AsciiText,
    keyword: &str,
    read: impl Fn(&mut LineScanner, usize) -> T + Sync,
) -> Result<(Vec<T>, Vec<String>), Faults> {
    if text.0.len() > PART_SIZE
        && let Some(values) = read_parts(path, &text.parts(keyword, &mut TextCounts::default()), &read)
    {
        return Ok(joined_parts(path, values));
    }
    let scan = &mut LineScanner::new(path, text);
    let value = read(scan, 0);
    scan.finish_with_notices(vec![value])
}

/// Reads the records of a file like [`read_records`], with a block of its text in memory at a time. A file with a fault is
/// read again as one text.
///
/// Errors: the file cannot be read, or all faults of its text.
pub fn read_file_records<T: Send>(
    path: &Path,
    keyword: &str,
    read: impl Fn(&mut LineScanner, usize) -> T + Sync,
) -> Result<(Vec<T>, Vec<String>), Faults> {
    match read_blocks(path, keyword, BLOCK_SIZE, &read) {
        Some(values) => Ok(joined_parts(path, values)),
        None => read_records(path, &AsciiText::read_file(path)?, keyword, read),
    }
}

/// Values of the parts of a file, read in blocks of `block_size` bytes or more, each of which ends with a record; `None` if
/// the file cannot be read or has a fault.
fn read_blocks<T: Send>(
    path: &Path,
    keyword: &str,
    block_size: usize,
    read: &(impl Fn(&mut LineScanner, usize) -> T + Sync),
) -> Option<Vec<(T, AcceptedDeviations)>> {
    let begin = format!("\n${keyword}");
    let mut file = atomic::open_to_read(path).ok()?;
    let (mut block, mut before, mut values) = (Vec::new(), TextCounts::default(), Vec::new());
    loop {
        let is_last = (&mut file).take(block_size as u64).read_to_end(&mut block).ok()? < block_size;
        let last_record = || block.windows(begin.len()).rposition(|bytes| bytes == begin.as_bytes());
        let end = if is_last { block.len() } else { last_record().map_or(0, |at| at + 1) };
        if block[..end].contains(&0) {
            return None;
        }
        if end > 0 {
            let text = AsciiText::new(&block[..end]);
            values.extend(read_parts(path, &text.parts(keyword, &mut before), read)?);
        }
        if is_last {
            return (!values.is_empty()).then_some(values);
        }
        block.drain(..end);
    }
}

/// Values of parts of a text with the deviations of each; `None` if one has a fault.
fn read_parts<T: Send>(
    path: &Path,
    parts: &[TextPart],
    read: &(impl Fn(&mut LineScanner, usize) -> T + Sync),
) -> Option<Vec<(T, AcceptedDeviations)>> {
    let read_part = |part: &TextPart| {
        let scan = &mut LineScanner::from_part(path, *part);
        let value = read(scan, part.records_before);
        (!scan.has_faults()).then(|| (value, std::mem::take(&mut scan.forms)))
    };
    match parts {
        [part] => Some(vec![read_part(part)?]),
        several => several.par_iter().map(read_part).collect(),
    }
}

/// Values of all parts of a file, and its notices.
fn joined_parts<T>(path: &Path, parts: Vec<(T, AcceptedDeviations)>) -> (Vec<T>, Vec<String>) {
    let mut forms = AcceptedDeviations::default();
    let values = parts.into_iter().map(|(value, part_forms)| {
        forms.append(part_forms);
        value
    });
    let values = values.collect();
    (values, forms.notices(&path.file_name().unwrap_or_default().to_string_lossy()))
}

/// Appends the text of all records, one after the other; `write` appends the text of a record, with its index.
pub fn put_records<T: Sync>(out: &mut String, records: &[T], write: impl Fn(&mut String, usize, &T) + Sync) {
    let put_task = |out: &mut String, (task, records): (usize, &[T])| {
        for (k, record) in records.iter().enumerate() {
            write(out, task * RECORDS_PER_TASK + k, record);
        }
    };
    if records.len() <= RECORDS_PER_TASK {
        return put_task(out, (0, records));
    }
    let task_text = |task: (usize, &[T])| {
        let mut out = String::new();
        put_task(&mut out, task);
        out
    };
    let texts: Vec<String> = records.par_chunks(RECORDS_PER_TASK).enumerate().map(task_text).collect();
    out.reserve(texts.iter().map(String::len).sum());
    texts.into_iter().for_each(|text| out.push_str(&text));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Records of a number each, long enough for several parts.
    fn numbers(count: usize, wrong: Option<usize>) -> AsciiText<'static> {
        let records: Vec<usize> = (0..count).collect();
        let mut text = String::new();
        put_records(&mut text, &records, |out, k, record| {
            let word = if wrong == Some(k) { "wrong".into() } else { format!("{record:12}.0") };
            *out += &format!("$numbr\n{:34}{word}\n$$$$$$\n", "");
        });
        AsciiText::new(format!("! head\n{text}").as_bytes()).into_owned()
    }

    fn read(text: &AsciiText) -> Result<(Vec<Vec<f64>>, Vec<String>), Faults> {
        read_records(Path::new("f"), text, "numbr", read_numbers)
    }

    fn read_numbers(scan: &mut LineScanner, before: usize) -> Vec<f64> {
        let mut values = Vec::new();
        while scan.peek_line().is_some() {
            scan.set_object(format!("number {}", before + values.len() + 1));
            scan.skip_to_keyword("numbr");
            scan.expect_keyword("numbr");
            let Some(line) = scan.next_line() else { break };
            values.push(scan.read_length(line, 35, "it"));
            scan.skip_record();
        }
        values
    }

    #[test]
    fn parts_hold_all_records_with_their_lines() {
        let text = numbers(100_000, None);
        let parts = text.parts("numbr", &mut TextCounts::default());
        assert!(parts.len() > 4);
        assert_eq!(parts.iter().map(|part| part.text).collect::<String>(), text.0);
        for part in &parts[1..] {
            assert!(part.text.starts_with("$numbr\n"));
            assert_eq!(part.lines_before, 1 + 3 * part.records_before);
        }
        let none = numbers(0, None);
        assert_eq!(none.parts("numbr", &mut TextCounts::default()).len(), 1);
        assert_eq!(none.whole_text().text, "! head\n");
    }

    #[test]
    fn a_text_in_parts_is_read_like_one() {
        let (values, notices) = read(&numbers(100_000, None)).unwrap();
        assert!(values.len() > 4 && notices.is_empty());
        assert!(values.iter().flatten().copied().eq((0..100_000).map(f64::from)));
    }

    #[test]
    fn a_file_in_blocks_is_read_like_its_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f");
        // A head longer than small blocks, and comments that are not ASCII.
        let head = format!("{}$numbr", "!\n".repeat(900));
        let text = numbers(2000, None).0.replace("$$$$$$\n", "  ! \u{b5}m\n$$$$$$\n").replacen("$numbr", &head, 1);
        for text in [&text, &text.replace('\n', "\r\n")] {
            std::fs::write(&path, text).unwrap();
            let whole = read(&AsciiText::read_file(&path).unwrap()).unwrap();
            for block_size in [7, 1000, 1 << 20] {
                let blocks = read_blocks(&path, "numbr", block_size, &read_numbers).unwrap();
                assert_eq!(blocks.len() > 1, block_size < 1 << 20);
                let (values, notices) = joined_parts(&path, blocks);
                assert_eq!((values.concat(), notices), (whole.0.concat(), whole.1.clone()), "{block_size}");
            }
            let (values, _) = read_file_records(&path, "numbr", read_numbers).unwrap();
            assert_eq!(values.concat(), whole.0.concat());
        }
        std::fs::write(&path, numbers(2000, Some(1500)).0.as_bytes()).unwrap();
        assert!(read_blocks(&path, "numbr", 1000, &read_numbers).is_none());
        let faults = read_file_records(&path, "numbr", read_numbers).unwrap_err().to_string();
        assert!(faults.contains("f:4503: number 1501: it is 'wrong', not a number"), "{faults}");
        assert!(read_file_records(&folder.path().join("absent"), "numbr", read_numbers).is_err());
    }

    #[test]
    fn faults_are_those_of_one_reading() {
        let faults = read(&numbers(100_000, Some(70_000))).unwrap_err().to_string();
        assert_eq!(faults.lines().count(), 1, "{faults}");
        assert!(faults.starts_with("f:210003: number 70001: it is 'wrong', not a number"), "{faults}");
    }
}
