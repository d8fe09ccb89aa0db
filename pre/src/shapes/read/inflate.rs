//! Data compressed by zlib (RFC 1950 and 1951), of which VTK's XML files are full.

/// Lengths and distances of copies: the smallest of each code, and its number of further bits.
const LENGTHS: [(u16, u8); 29] = [
    (3, 0),
    (4, 0),
    (5, 0),
    (6, 0),
    (7, 0),
    (8, 0),
    (9, 0),
    (10, 0),
    (11, 1),
    (13, 1),
    (15, 1),
    (17, 1),
    (19, 2),
    (23, 2),
    (27, 2),
    (31, 2),
    (35, 3),
    (43, 3),
    (51, 3),
    (59, 3),
    (67, 4),
    (83, 4),
    (99, 4),
    (115, 4),
    (131, 5),
    (163, 5),
    (195, 5),
    (227, 5),
    (258, 0),
];
const DISTANCES: [(u16, u8); 30] = [
    (1, 0),
    (2, 0),
    (3, 0),
    (4, 0),
    (5, 1),
    (7, 1),
    (9, 2),
    (13, 2),
    (17, 3),
    (25, 3),
    (33, 4),
    (49, 4),
    (65, 5),
    (97, 5),
    (129, 6),
    (193, 6),
    (257, 7),
    (385, 7),
    (513, 8),
    (769, 8),
    (1025, 9),
    (1537, 9),
    (2049, 10),
    (3073, 10),
    (4097, 11),
    (6145, 11),
    (8193, 12),
    (12289, 12),
    (16385, 13),
    (24577, 13),
];
/// The order in which lengths of the codes of code lengths are written.
const ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

/// Longest code, in bits.
const LONGEST: usize = 15;

/// The bytes of a zlib stream, at most `most`; `None` if it is broken, cut off, longer, or its checksum is another.
pub fn zlib(bytes: &[u8], most: usize) -> Option<Vec<u8>> {
    let [method, flags, data @ ..] = bytes else { return None };
    let sound = method & 15 == 8 && flags & 32 == 0 && (u16::from(*method) << 8 | u16::from(*flags)).is_multiple_of(31);
    let mut bits = Bits { bytes: data, at: 0, held: 0, count: 0 };
    let out = sound.then(|| inflate(&mut bits, most)).flatten()?;
    let end = bits.at - bits.count as usize / 8;
    let sum = data.get(end..end + 4)?;
    (sum == adler(&out).to_be_bytes()).then_some(out)
}

fn adler(bytes: &[u8]) -> u32 {
    let (mut a, mut b) = (1u32, 0u32);
    for byte in bytes {
        a = (a + u32::from(*byte)) % 65521;
        b = (b + a) % 65521;
    }
    b << 16 | a
}

struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    held: u32,
    count: u32,
}

impl Bits<'_> {
    fn take(&mut self, count: u32) -> Option<u32> {
        while self.count < count {
            self.held |= u32::from(*self.bytes.get(self.at)?) << self.count;
            (self.at, self.count) = (self.at + 1, self.count + 8);
        }
        let value = self.held & ((1 << count) - 1);
        (self.held, self.count) = (self.held >> count, self.count - count);
        Some(value)
    }
}

/// A Huffman code: number of codes of each length, and the symbols in their order.
struct Code {
    counts: [u16; LONGEST + 1],
    symbols: Vec<u16>,
}

impl Code {
    fn new(lengths: &[u8]) -> Code {
        let mut counts = [0; LONGEST + 1];
        lengths.iter().for_each(|length| counts[usize::from(*length)] += 1);
        counts[0] = 0;
        let mut symbols: Vec<u16> = (0..lengths.len() as u16).filter(|&s| lengths[usize::from(s)] > 0).collect();
        symbols.sort_by_key(|&s| lengths[usize::from(s)]);
        Code { counts, symbols }
    }

    fn symbol(&self, bits: &mut Bits) -> Option<usize> {
        let (mut code, mut first, mut index) = (0i32, 0i32, 0i32);
        for count in &self.counts[1..] {
            code |= bits.take(1)? as i32;
            let count = i32::from(*count);
            if code - count < first {
                return self.symbols.get((index + code - first) as usize).map(|s| usize::from(*s));
            }
            (index, first, code) = (index + count, (first + count) << 1, code << 1);
        }
        None
    }
}

fn inflate(bits: &mut Bits, most: usize) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    loop {
        let last = bits.take(1)? == 1;
        match bits.take(2)? {
            0 => stored(bits, &mut out)?,
            1 => {
                let mut lengths = [8; 288];
                lengths[144..256].fill(9);
                lengths[256..280].fill(7);
                copies(bits, &Code::new(&lengths), &Code::new(&[5; 30]), &mut out, most)?;
            }
            2 => {
                let (literals, distances) = codes(bits)?;
                copies(bits, &literals, &distances, &mut out, most)?;
            }
            _ => return None,
        }
        if out.len() > most {
            return None;
        }
        if last {
            return Some(out);
        }
    }
}

fn stored(bits: &mut Bits, out: &mut Vec<u8>) -> Option<()> {
    bits.take(bits.count % 8)?;
    let (length, inverse) = (bits.take(16)?, bits.take(16)?);
    if length != !inverse & 0xffff {
        return None;
    }
    for _ in 0..length {
        out.push(bits.take(8)? as u8);
    }
    Some(())
}

fn codes(bits: &mut Bits) -> Option<(Code, Code)> {
    let (literals, distances) = (bits.take(5)? as usize + 257, bits.take(5)? as usize + 1);
    let mut lengths = [0; 19];
    for k in &ORDER[..bits.take(4)? as usize + 4] {
        lengths[*k] = bits.take(3)? as u8;
    }
    let of_lengths = Code::new(&lengths);
    let mut lengths: Vec<u8> = Vec::new();
    while lengths.len() < literals + distances {
        let (length, times) = match of_lengths.symbol(bits)? {
            16 => (*lengths.last()?, 3 + bits.take(2)?),
            17 => (0, 3 + bits.take(3)?),
            18 => (0, 11 + bits.take(7)?),
            length => (length as u8, 1),
        };
        lengths.extend(std::iter::repeat_n(length, times as usize));
    }
    let (of_literals, of_distances) = lengths.get(..literals + distances)?.split_at(literals);
    Some((Code::new(of_literals), Code::new(of_distances)))
}

fn copies(bits: &mut Bits, literals: &Code, distances: &Code, out: &mut Vec<u8>, most: usize) -> Option<()> {
    while out.len() <= most {
        match literals.symbol(bits)? {
            256 => return Some(()),
            literal if literal < 256 => out.push(literal as u8),
            copy => {
                let &(length, more) = LENGTHS.get(copy - 257)?;
                let length = usize::from(length) + bits.take(u32::from(more))? as usize;
                let &(distance, more) = DISTANCES.get(distances.symbol(bits)?)?;
                let distance = usize::from(distance) + bits.take(u32::from(more))? as usize;
                let begin = out.len().checked_sub(distance)?;
                (begin..begin + length).for_each(|k| out.push(out[k]));
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Streams by Python's zlib: stored, fixed codes, dynamic codes.
    #[test]
    fn streams_of_all_kinds_of_blocks() {
        let stored = [120, 1, 1, 3, 0, 252, 255, 97, 98, 99, 2, 77, 1, 39];
        assert_eq!(zlib(&stored, 9).unwrap(), b"abc");
        let fixed = [120, 156, 75, 76, 74, 78, 4, 35, 0, 17, 61, 3, 115];
        let of_fixed = zlib(&fixed, 20);
        assert_eq!(of_fixed.as_deref(), Some(b"abcabcabc".as_slice()), "{of_fixed:?}");
        assert_eq!(zlib(&fixed, 8), None);
        assert_eq!(zlib(&fixed[..12], 20), None);
        let dynamic: [u8; 127] = [
            120, 218, 237, 206, 129, 13, 3, 33, 8, 64, 209, 217, 16, 161, 42, 136, 167, 28, 186, 255, 38, 189, 38, 93,
            162, 73, 255, 0, 47, 31, 0, 18, 102, 46, 77, 199, 138, 196, 205, 28, 88, 23, 188, 44, 168, 7, 219, 169,
            139, 70, 210, 35, 91, 142, 130, 229, 89, 118, 207, 46, 232, 74, 49, 42, 198, 37, 156, 98, 154, 20, 66, 216,
            113, 251, 122, 242, 59, 54, 32, 21, 177, 249, 136, 114, 5, 214, 17, 164, 142, 226, 185, 239, 50, 179, 193,
            23, 76, 131, 86, 61, 198, 209, 41, 236, 5, 75, 25, 220, 218, 35, 174, 161, 173, 112, 198, 4, 159, 254, 131,
            191, 55, 248, 6, 225, 212, 177, 63,
        ];
        let numbers: Vec<u8> = (0..600u32).map(|k| (k * k / 7 % 23 + 65) as u8).collect();
        assert_eq!(zlib(&dynamic, 600), Some(numbers));
        let mut torn = fixed;
        torn[4] ^= 1;
        assert_eq!(zlib(&torn, 20), None);
    }
}
