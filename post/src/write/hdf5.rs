//! HDF5 files, written in one pass with bounded memory: groups with attributes, and arrays that grow along their first axis.
//!
//! The format is that of the *HDF5 File Format Specification*, version 3.0, in its part that HDF5 1.8 and later read:
//! superblock and object headers of version 2, links in the header of their group, layouts of version 3, chunks in a
//! B-tree of version 1. Numbers are little-endian, addresses have 8 bytes.

use cd_formats::atomic::GrowingFile;
use cd_formats::error::Faults;

/// Size of a chunk: one is buffered for each array, and a reader of a part of an array reads whole ones. HDF5 caches 1 MiB.
const CHUNK_BYTES: usize = 1 << 18;

/// Children of a node of a B-tree of chunks: twice HDF5's default number K of such a node.
const MAX_CHILDREN: usize = 64;

/// Address of an object that does not exist.
const UNDEFINED: u64 = u64::MAX;

/// Size of the superblock, the first bytes of a file.
pub const SUPERBLOCK_BYTES: usize = 48;

/// Types of messages in an object header.
mod message {
    pub const DATASPACE: u8 = 1;
    pub const LINK_INFO: u8 = 2;
    pub const DATATYPE: u8 = 3;
    pub const FILL_VALUE: u8 = 5;
    pub const LINK: u8 = 6;
    pub const LAYOUT: u8 = 8;
    pub const GROUP_INFO: u8 = 10;
    pub const ATTRIBUTE: u8 = 12;
}

/// Type of the numbers of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArrayType {
    F64,
    I64,
    /// Unsigned integer with this number of bytes.
    Unsigned(u8),
}

impl ArrayType {
    fn byte_count(self) -> usize {
        match self {
            ArrayType::F64 | ArrayType::I64 => 8,
            ArrayType::Unsigned(bytes) => bytes.into(),
        }
    }

    /// Datatype message: class with version 1, flags, size, positions and numbers of bits.
    fn to_message(self) -> Vec<u8> {
        let size = self.byte_count() as u8;
        let head = |class: u8, flags: [u8; 2]| [class, flags[0], flags[1], 0, size, 0, 0, 0, 0, 0, 8 * size, 0];
        match self {
            // Implied first bit of the mantissa, sign in bit 63; exponent at 52 of 11 bits, mantissa at 0 of 52, bias 1023.
            ArrayType::F64 => [&head(0x11, [0x20, 63])[..], &[52, 11, 0, 52, 0xff, 0x03, 0, 0]].concat(),
            ArrayType::I64 => head(0x10, [8, 0]).to_vec(),
            ArrayType::Unsigned(_) => head(0x10, [0, 0]).to_vec(),
        }
    }
}

/// Value of an attribute.
#[derive(Debug, Clone)]
pub enum AttributeValue {
    /// ASCII, of fixed length.
    Text(String),
    Integer(i64),
    Integers(Vec<i64>),
}

impl AttributeValue {
    /// Attribute message of version 3.
    fn to_message(&self, name: &str) -> Vec<u8> {
        let text_type = |length: usize| [&[0x13, 1, 0, 0][..], &(length as u32).to_le_bytes()].concat();
        let number_type = ArrayType::I64.to_message();
        let (datatype, dataspace, data) = match self {
            AttributeValue::Text(text) => (text_type(text.len()), dataspace(None), text.as_bytes().to_vec()),
            AttributeValue::Integer(value) => (number_type, dataspace(None), value.to_le_bytes().to_vec()),
            AttributeValue::Integers(values) => (
                number_type,
                dataspace(Some(&[values.len() as u64])),
                values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            ),
        };
        let mut message = vec![3, 0];
        for size in [name.len() + 1, datatype.len(), dataspace.len()] {
            message.extend((size as u16).to_le_bytes());
        }
        message.push(0); // ASCII
        message.extend([name.as_bytes(), &[0], &datatype, &dataspace, &data].concat());
        message
    }
}

/// Dataspace message of version 2; without a shape, the message of one value.
fn dataspace(shape: Option<&[u64]>) -> Vec<u8> {
    let sizes = shape.unwrap_or_default();
    let mut message = vec![2, sizes.len() as u8, 0, u8::from(shape.is_some())];
    message.extend(sizes.iter().flat_map(|size| size.to_le_bytes()));
    message
}

/// Array that grows along its first axis.
pub struct GrowingArray {
    number_type: ArrayType,
    /// Numbers in a row; `None` for an array of one axis.
    components: Option<u64>,
    row_count: u64,
    /// Addresses of the chunks that are written, in their order.
    chunks: Vec<u64>,
    /// Rows after them, less than a chunk.
    pending: Vec<u8>,
}

impl GrowingArray {
    /// Empty array with one axis, or with two if rows have `components`.
    pub fn new(number_type: ArrayType, components: Option<u64>) -> GrowingArray {
        GrowingArray { number_type, components, row_count: 0, chunks: Vec::new(), pending: Vec::new() }
    }

    fn row_bytes(&self) -> usize {
        self.number_type.byte_count() * self.components.unwrap_or(1) as usize
    }

    /// Rows of a chunk.
    fn chunk_rows(&self) -> usize {
        (CHUNK_BYTES / self.row_bytes()).max(1)
    }

    /// Appends whole rows, as little-endian bytes.
    pub fn append(&mut self, file: &mut GrowingFile, bytes: &[u8]) -> Result<(), Faults> {
        assert!(bytes.len().is_multiple_of(self.row_bytes()));
        self.row_count += (bytes.len() / self.row_bytes()) as u64;
        self.pending.extend_from_slice(bytes);
        let size = self.chunk_rows() * self.row_bytes();
        let full_chunk_bytes = self.pending.len() / size * size;
        for chunk in self.pending[..full_chunk_bytes].chunks(size) {
            self.chunks.push(file.append(chunk)?);
        }
        self.pending.drain(..full_chunk_bytes);
        Ok(())
    }

    /// Writes the remaining rows and the object header; returns its address. An array smaller than a chunk has no chunks.
    fn write_header(mut self, file: &mut GrowingFile) -> Result<u64, Faults> {
        let shape: Vec<u64> = std::iter::once(self.row_count).chain(self.components).collect();
        let (layout, allocation) = if self.chunks.is_empty() {
            let size = self.pending.len() as u64;
            let address = if size == 0 { UNDEFINED } else { file.append(&self.pending)? };
            (layout_message(&[3, 1], address, &size.to_le_bytes()), 2)
        } else {
            if !self.pending.is_empty() {
                self.pending.resize(self.chunk_rows() * self.row_bytes(), 0);
                self.chunks.push(file.append(&self.pending)?);
            }
            let index = self.write_chunk_index(file)?;
            let sizes = [self.chunk_rows() as u64].into_iter().chain(self.components);
            let sizes = sizes.chain([self.number_type.byte_count() as u64]);
            let sizes: Vec<u8> = sizes.flat_map(|size| (size as u32).to_le_bytes()).collect();
            (layout_message(&[3, 2, shape.len() as u8 + 1], index, &sizes), 3)
        };
        let messages = [
            (message::DATASPACE, dataspace(Some(&shape))),
            (message::DATATYPE, self.number_type.to_message()),
            // Version 3: allocated late or chunk by chunk, filled if a value is set; none is.
            (message::FILL_VALUE, vec![3, allocation | 2 << 2]),
            (message::LAYOUT, layout),
        ];
        file.append(&object_header(&messages))
    }

    /// Writes the B-tree of the chunks from the leaves to the root; returns the address of the root.
    fn write_chunk_index(&self, file: &mut GrowingFile) -> Result<u64, Faults> {
        let axes = 1 + usize::from(self.components.is_some());
        // Size of a chunk, mask of filters, position of its first number: along the axes, and within a number.
        let key = |chunk: usize, size: usize| {
            let mut bytes = [(size as u32).to_le_bytes(), [0; 4]].concat();
            bytes.extend(((chunk * self.chunk_rows()) as u64).to_le_bytes());
            bytes.resize(bytes.len() + 8 * axes, 0);
            bytes
        };
        let chunk_bytes = self.chunk_rows() * self.row_bytes();
        let end = key(self.chunks.len(), 0);
        let node_bytes = 24 + MAX_CHILDREN * (end.len() + 8) + end.len();
        // First chunk and address of each child.
        let mut children: Vec<(usize, u64)> = self.chunks.iter().copied().enumerate().collect();
        for level in 0u8.. {
            let first = file.length();
            let count = children.len().div_ceil(MAX_CHILDREN);
            let address = |node: usize| if node < count { first + (node * node_bytes) as u64 } else { UNDEFINED };
            let mut nodes = Vec::with_capacity(count);
            for (node, group) in children.chunks(MAX_CHILDREN).enumerate() {
                let mut bytes = [b"TREE", &[1, level][..], &(group.len() as u16).to_le_bytes()].concat();
                bytes.extend(address(node.wrapping_sub(1)).to_le_bytes());
                bytes.extend(address(node + 1).to_le_bytes());
                for (chunk, child) in group {
                    bytes.extend(key(*chunk, chunk_bytes));
                    bytes.extend(child.to_le_bytes());
                }
                let next = children.get((node + 1) * MAX_CHILDREN);
                bytes.extend(next.map_or(end.clone(), |(chunk, _)| key(*chunk, chunk_bytes)));
                bytes.resize(node_bytes, 0);
                nodes.push((group[0].0, file.append(&bytes)?));
            }
            if count == 1 {
                return Ok(first);
            }
            children = nodes;
        }
        unreachable!("each level has fewer nodes")
    }
}

/// Layout message of version 3: address of the data or of the index between class and sizes.
fn layout_message(class: &[u8], address: u64, sizes: &[u8]) -> Vec<u8> {
    [class, &address.to_le_bytes(), sizes].concat()
}

/// Member of a group.
pub enum GroupMember {
    Group(HdfGroup),
    Array(GrowingArray),
}

/// Group with attributes and members by name.
#[derive(Default)]
pub struct HdfGroup {
    attributes: Vec<(String, AttributeValue)>,
    members: Vec<(String, GroupMember)>,
}

impl HdfGroup {
    /// The group with one attribute more.
    pub fn with_attribute(mut self, name: &str, value: AttributeValue) -> HdfGroup {
        self.attributes.push((name.into(), value));
        self
    }

    /// The group with one array more.
    pub fn with_array(mut self, name: &str, array: GrowingArray) -> HdfGroup {
        self.members.push((name.into(), GroupMember::Array(array)));
        self
    }

    /// The group with one group more in it.
    pub fn with_group(mut self, name: &str, group: HdfGroup) -> HdfGroup {
        self.members.push((name.into(), GroupMember::Group(group)));
        self
    }

    /// Writes the members, then the object header; returns its address.
    fn write_header(self, file: &mut GrowingFile) -> Result<u64, Faults> {
        let undefined = UNDEFINED.to_le_bytes();
        let mut messages = vec![
            (message::LINK_INFO, [&[0, 0], &undefined[..], &undefined[..]].concat()), // links in this header
            (message::GROUP_INFO, vec![0, 0]),
        ];
        messages.extend(self.attributes.iter().map(|(name, value)| (message::ATTRIBUTE, value.to_message(name))));
        for (name, member) in self.members {
            let address = match member {
                GroupMember::Group(group) => group.write_header(file)?,
                GroupMember::Array(array) => array.write_header(file)?,
            };
            let length = u8::try_from(name.len()).expect("names of arrays are short");
            messages.push((message::LINK, [&[1, 0, length], name.as_bytes(), &address.to_le_bytes()].concat()));
        }
        file.append(&object_header(&messages))
    }
}

/// Completes a file that began with [`SUPERBLOCK_BYTES`] and contains the chunks of the arrays below `root`.
pub fn finish_file(mut file: GrowingFile, root: HdfGroup) -> Result<(), Faults> {
    let root = root.write_header(&mut file)?;
    let mut superblock = b"\x89HDF\r\n\x1a\n\x02\x08\x08\x00".to_vec();
    for address in [0, UNDEFINED, file.length(), root] {
        superblock.extend(address.to_le_bytes());
    }
    superblock.extend(checksum(&superblock).to_le_bytes());
    file.finish(&superblock)
}

/// Object header of version 2, with its messages in one block.
fn object_header(messages: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let mut block = Vec::new();
    for (kind, data) in messages {
        let size = u16::try_from(data.len()).expect("messages are short");
        block.extend([&[*kind], &size.to_le_bytes()[..], &[0], data].concat());
    }
    let mut header = b"OHDR\x02\x02".to_vec(); // the size has four bytes
    header.extend((block.len() as u32).to_le_bytes());
    header.extend(block);
    header.extend(checksum(&header).to_le_bytes());
    header
}

/// Checksum of metadata: the hash function lookup3 of Bob Jenkins, May 2006, with initial value 0.
fn checksum(bytes: &[u8]) -> u32 {
    let start = 0xdead_beef_u32.wrapping_add(bytes.len() as u32);
    let [mut a, mut b, mut c] = [start; 3];
    let mut blocks = bytes.chunks(12).peekable();
    while let Some(block) = blocks.next() {
        let mut padded = [0; 12];
        padded[..block.len()].copy_from_slice(block);
        let word = |k: usize| u32::from_le_bytes(padded[4 * k..4 * k + 4].try_into().expect("four bytes"));
        a = a.wrapping_add(word(0));
        b = b.wrapping_add(word(1));
        c = c.wrapping_add(word(2));
        if blocks.peek().is_some() {
            for shift in [4, 6, 8, 16, 19, 4] {
                a = a.wrapping_sub(c) ^ c.rotate_left(shift);
                c = c.wrapping_add(b);
                [a, b, c] = [b, c, a];
            }
        } else {
            for shift in [14, 11, 25, 16, 4, 14, 24] {
                c = (c ^ b).wrapping_sub(b.rotate_left(shift));
                [a, b, c] = [b, c, a];
            }
        }
    }
    b // the last c
}

#[cfg(test)]
mod tests {
    use hdf5_reader::Hdf5File;

    use super::*;

    #[test]
    fn arrays_of_any_size_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        let mut file = GrowingFile::create(&path, SUPERBLOCK_BYTES).unwrap();
        // Nothing, less than a chunk, a whole one, more than a node of the tree has chunks.
        let counts = [0, 1, CHUNK_BYTES, MAX_CHILDREN * CHUNK_BYTES + 1];
        let mut group = HdfGroup::default().with_attribute("count", AttributeValue::Integer(-4));
        let byte = |k: usize| (k % 251) as u8;
        for count in counts {
            let mut array = GrowingArray::new(ArrayType::Unsigned(1), None);
            let bytes: Vec<u8> = (0..count).map(byte).collect();
            for part in bytes.chunks(100_003) {
                array.append(&mut file, part).unwrap();
            }
            group = group.with_array(&count.to_string(), array);
        }
        let mut rows = GrowingArray::new(ArrayType::F64, Some(3));
        let numbers: Vec<f64> = (0..3 * 20_000).map(f64::from).collect();
        rows.append(&mut file, &numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
        let group = group.with_array("rows", rows).with_group("empty", HdfGroup::default());
        finish_file(file, HdfGroup::default().with_group("group", group)).unwrap();

        let file = Hdf5File::open(&path).unwrap();
        let group = file.root_group().unwrap().group("group").unwrap();
        assert_eq!(group.attribute("count").unwrap().read_1d::<i64>().unwrap(), [-4]);
        for count in counts {
            let read = group.dataset(&count.to_string()).unwrap().read_raw_bytes().unwrap();
            assert!(read.len() == count && read.iter().enumerate().all(|(k, value)| *value == byte(k)), "{count}");
        }
        let rows = group.dataset("rows").unwrap();
        assert_eq!((rows.shape(), rows.chunks().is_some()), (&[20_000, 3][..], true));
        assert!(rows.read_array::<f64>().unwrap().iter().eq(&numbers));
        assert!(group.group("empty").unwrap().member_names().unwrap().0.is_empty());
    }

    #[test]
    fn checksums_are_those_of_the_published_function() {
        assert_eq!(checksum(b""), 0xdead_beef);
        assert_eq!(checksum(b"Four score and seven years ago"), 0x1777_0551);
    }
}
