//! Several files in one text: each after a line `=== NAME`. So a program that damages bytes can damage one of the arrays of an
//! archive, whose checksums would else reject all damage, or any file of a folder.

/// Start of the line before a file.
const MARK: &[u8] = b"=== ";

/// Files of a text by their names. Bytes before the first mark, and names that are not UTF-8 or would leave a folder, are
/// left out.
pub fn files_of_bundle(bytes: &[u8]) -> Vec<(&str, &[u8])> {
    let mut starts: Vec<usize> = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(MARK)).collect();
    starts.retain(|&at| at == 0 || bytes[at - 1] == b'\n');
    let ends = starts.iter().skip(1).map(|next| next - 1).chain([bytes.len()]);
    let files = starts.iter().zip(ends).filter_map(|(&start, end)| {
        let file = bytes.get(start + MARK.len()..end)?;
        let line_end = file.iter().position(|&byte| byte == b'\n')?;
        let name = std::str::from_utf8(&file[..line_end]).ok()?;
        let is_name =
            !name.is_empty() && name.len() < 100 && !name.starts_with('.') && !name.contains(['/', '\\', '\0']);
        is_name.then_some((name, &file[line_end + 1..]))
    });
    files.collect()
}

/// Text with these files.
pub fn bundle(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (name, file) in files {
        bytes.extend([MARK, name.as_bytes(), b"\n", file, b"\n"].concat());
    }
    bytes.pop();
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back() {
        let files = [("a", &b"one\n\n=two="[..]), ("b.npy", b""), ("c", b"\n== \n")];
        let bytes = bundle(&files.map(|(name, file)| (name.to_string(), file.to_vec())));
        assert_eq!(files_of_bundle(&bytes), files);
        assert!(files_of_bundle(b"=== ../x\n1\n=== /y\n2").is_empty());
    }
}
