//! The rows of a table in an SQLite file, read as they are stored: as much of the format as rosbag2 needs, no C library.
//!
//! Source: <https://www.sqlite.org/fileformat2.html>. Rows come in the order of their numbers, that of writing. A file that is cut gives
//! the pages that are there.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt as _;

use super::container::RECORD_BYTES_MAX;

/// How such files begin.
pub(crate) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Trees of pages are no deeper; each level holds some hundred times as many as the one above.
const DEPTH_MAX: usize = 16;

/// Where the bytes of the file are.
pub(crate) enum Storage {
    File(File),
    Memory(Vec<u8>),
}

impl Storage {
    fn bytes(&self) -> u64 {
        match self {
            Self::File(file) => file.metadata().map_or(0, |metadata| metadata.len()),
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    fn read(&self, at: u64, buffer: &mut [u8]) -> Option<()> {
        match self {
            Self::File(file) => file.read_exact_at(buffer, at).ok(),
            Self::Memory(bytes) => {
                let from = usize::try_from(at).ok()?;
                buffer.copy_from_slice(bytes.get(from..from.checked_add(buffer.len())?)?);
                Some(())
            }
        }
    }
}

/// A file of tables.
pub(crate) struct Tables {
    storage: Storage,
    page_bytes: usize,
    /// Of a page, without what is reserved at its end.
    usable: usize,
    /// Of the file as it is, whatever its head says.
    pages: u64,
}

/// A table: the names of its columns, and its first page.
pub(crate) struct Table {
    pub(crate) columns: Vec<String>,
    pub(crate) root: u32,
}

/// A value of a row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value<'a> {
    Nothing,
    Integer(i64),
    /// Text or bytes.
    Bytes(&'a [u8]),
}

impl Value<'_> {
    pub(crate) fn integer(&self) -> Option<i64> {
        if let Self::Integer(value) = self { Some(*value) } else { None }
    }

    pub(crate) fn text(&self) -> Option<&str> {
        if let Self::Bytes(bytes) = self { core::str::from_utf8(bytes).ok() } else { None }
    }
}

/// What a step through a table comes to.
pub(crate) enum Step {
    /// A row: its number, and its record.
    Row(i64, Vec<u8>),
    /// A page, or a row in it, can't be read.
    Damage(String),
    End,
}

impl Tables {
    /// None: it is no such file, or ends within its first page.
    pub(crate) fn new(storage: Storage) -> Option<Self> {
        let mut head = [0; 100];
        storage.read(0, &mut head)?;
        let size = match u16::from_be_bytes([head[16], head[17]]) {
            1 => 65_536,
            size => usize::from(size),
        };
        let is_one = head.starts_with(MAGIC) && size.is_power_of_two() && size >= 512;
        let pages = storage.bytes().checked_div(size as u64)?;
        let usable = size.checked_sub(usize::from(head[20])).filter(|usable| *usable >= 480)?;
        is_one.then_some(Self { storage, page_bytes: size, usable, pages })
    }

    /// The tables by name, and what of them can't be read.
    pub(crate) fn tables(&self) -> (BTreeMap<String, Table>, Vec<String>) {
        let mut tables = BTreeMap::new();
        let mut damages = Vec::new();
        let mut rows = Rows::new(1);
        loop {
            match rows.next(self) {
                Step::Row(_, record) => {
                    let values = values(&record);
                    let text = |at: usize| values.get(at).and_then(Value::text).unwrap_or_default();
                    let root = values.get(3).and_then(Value::integer).and_then(|root| u32::try_from(root).ok());
                    if let ("table", Some(root)) = (text(0), root) {
                        tables.insert(text(1).to_owned(), Table { columns: columns(text(4)), root });
                    }
                }
                Step::Damage(what) => damages.push(what),
                Step::End => return (tables, damages),
            }
        }
    }

    fn page(&self, number: u32) -> Option<Vec<u8>> {
        let at = u64::from(number.checked_sub(1)?) * self.page_bytes as u64;
        let mut page = vec![0; self.page_bytes];
        self.storage.read(at, &mut page)?;
        Some(page)
    }

    /// The record of a row, and its number, that begins at a place of a page; the pages that it goes on in are counted.
    fn row(&self, page: &[u8], at: usize, read: &mut u64) -> Option<(i64, Vec<u8>)> {
        let mut rest = page.get(at..self.usable)?;
        let (length, number) = (varint(&mut rest)?, varint(&mut rest)? as i64);
        let length = usize::try_from(length).ok().filter(|length| *length as u64 <= RECORD_BYTES_MAX)?;
        // What a leaf may hold of a row, and what it holds of one that is longer.
        let (most, least) = (self.usable - 35, (self.usable - 12) * 32 / 255 - 23);
        if length <= most {
            return Some((number, rest.get(..length)?.to_vec()));
        }
        let wanted = least + (length - least) % (self.usable - 4);
        let local = if wanted <= most { wanted } else { least };
        let mut record = rest.get(..local)?.to_vec();
        let mut next = u32::from_be_bytes(rest.get(local..local + 4)?.try_into().ok()?);
        while record.len() < length {
            let page = self.page(next)?;
            *read += 1;
            if *read > self.pages {
                return None;
            }
            next = u32::from_be_bytes(page.get(..4)?.try_into().ok()?);
            let part = (length - record.len()).min(self.usable - 4);
            record.extend_from_slice(page.get(4..4 + part)?);
        }
        Some((number, record))
    }
}

/// The rows of a table, one after the other.
pub(crate) struct Rows {
    /// The pages from the root to where the walk is, and what of each is done.
    path: Vec<(Page, usize)>,
    root: Option<u32>,
    /// Pages that have been read, each of which belongs to one place only: more than there are go in a circle.
    read: u64,
}

struct Page {
    bytes: Vec<u8>,
    is_leaf: bool,
    /// Where the numbers of its cells stand.
    cells_at: usize,
    cells: usize,
    /// The last child of a page that is no leaf.
    last: u32,
}

impl Rows {
    pub(crate) fn new(root: u32) -> Self {
        Self { path: Vec::new(), root: Some(root), read: 0 }
    }

    pub(crate) fn next(&mut self, tables: &Tables) -> Step {
        if let Some(root) = self.root.take()
            && let Err(what) = self.enter(tables, root)
        {
            return Step::Damage(what);
        }
        loop {
            let Some((page, done)) = self.path.last_mut() else { return Step::End };
            let cell = *done;
            *done += 1;
            if cell > page.cells || (page.is_leaf && cell == page.cells) {
                self.path.pop();
                continue;
            }
            let at = page.bytes.get(page.cells_at + 2 * cell..).and_then(|rest| rest.first_chunk());
            let at = at.map_or(0, |at| usize::from(u16::from_be_bytes(*at)));
            if page.is_leaf {
                return match tables.row(&page.bytes, at, &mut self.read) {
                    Some((number, record)) => Step::Row(number, record),
                    None => Step::Damage("a row can't be read".to_owned()),
                };
            }
            let child = if cell == page.cells {
                Some(page.last)
            } else {
                page.bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|child| u32::from_be_bytes(*child))
            };
            let entered =
                child.ok_or_else(|| "a page has no children".to_owned()).and_then(|child| self.enter(tables, child));
            if let Err(what) = entered {
                return Step::Damage(what);
            }
        }
    }

    fn enter(&mut self, tables: &Tables, number: u32) -> Result<(), String> {
        let bytes = tables.page(number).ok_or_else(|| format!("page {number} is missing"))?;
        self.read += 1;
        if self.path.len() >= DEPTH_MAX || self.read > tables.pages {
            self.path.clear();
            return Err("its pages go in a circle".to_owned());
        }
        // The first page begins behind the head of the file.
        let at = if number == 1 { 100 } else { 0 };
        let byte = |at: usize| bytes.get(at).copied().unwrap_or(0);
        let is_leaf = match byte(at) {
            0x0d => true,
            0x05 => false,
            kind => return Err(format!("page {number} is of kind {kind}, none of a table")),
        };
        let last = u32::from_be_bytes([byte(at + 8), byte(at + 9), byte(at + 10), byte(at + 11)]);
        let cells_at = at + if is_leaf { 8 } else { 12 };
        let room = (tables.usable - cells_at) / 2;
        let cells = usize::from(u16::from_be_bytes([byte(at + 3), byte(at + 4)])).min(room);
        self.path.push((Page { bytes, is_leaf, cells_at, cells, last }, 0));
        Ok(())
    }
}

/// The values of a record, as far as they go.
pub(crate) fn values(record: &[u8]) -> Vec<Value<'_>> {
    let mut kinds = record;
    let Some(length) = varint(&mut kinds).and_then(|length| usize::try_from(length).ok()) else { return Vec::new() };
    let head = record.len() - kinds.len();
    let (Some(mut kinds), Some(mut body)) = (record.get(head..length), record.get(length..)) else { return Vec::new() };
    let mut values = Vec::new();
    while let Some(kind) = varint(&mut kinds) {
        let bytes = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind,
            5 => 6,
            6 | 7 => 8,
            12.. => (kind - 12) / 2,
            _ => return values,
        };
        let Some((value, rest)) = usize::try_from(bytes).ok().and_then(|bytes| body.split_at_checked(bytes)) else {
            return values;
        };
        body = rest;
        values.push(match kind {
            8 => Value::Integer(0),
            9 => Value::Integer(1),
            1..=6 => {
                let sign = value.first().map_or(0, |first| if *first >= 0x80 { -1 } else { 0 });
                Value::Integer(value.iter().fold(sign, |sum, byte| (sum << 8) | i64::from(*byte)))
            }
            12.. => Value::Bytes(value),
            _ => Value::Nothing,
        });
    }
    values
}

/// The names of the columns of a table, from how it was made.
fn columns(sql: &str) -> Vec<String> {
    let inner = sql.split_once('(').and_then(|(_, rest)| rest.rsplit_once(')')).map_or("", |(inner, _)| inner);
    let name = |column: &str| {
        column.split_ascii_whitespace().next().map(|name| name.trim_matches(['"', '`', '\'']).to_lowercase())
    };
    inner.split(',').filter_map(name).collect()
}

/// Seven bits a byte, the highest first; the ninth byte has eight.
fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0_u64;
    for index in 0..9 {
        let (first, rest) = bytes.split_first()?;
        *bytes = rest;
        if index == 8 {
            return Some((value << 8) | u64::from(*first));
        }
        value = (value << 7) | u64::from(first & 0x7f);
        if *first < 0x80 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: usize = 512;

    /// A file of such pages, the first of which begins behind the head.
    fn file(pages: &[&[u8]]) -> Tables {
        let mut bytes = vec![0; PAGE * pages.len()];
        for (number, content) in pages.iter().enumerate() {
            let at = PAGE * number + if number == 0 { 100 } else { 0 };
            bytes[at..at + content.len()].copy_from_slice(content);
        }
        bytes[..MAGIC.len()].copy_from_slice(MAGIC);
        bytes[16..18].copy_from_slice(&(PAGE as u16).to_be_bytes());
        Tables::new(Storage::Memory(bytes)).unwrap()
    }

    /// Rows, and what is damaged, of the table at a page.
    fn walk(tables: &Tables, root: u32) -> (usize, Vec<String>) {
        let (mut rows, mut count, mut damages) = (Rows::new(root), 0, Vec::new());
        loop {
            match rows.next(tables) {
                Step::Row(..) => count += 1,
                Step::Damage(what) => damages.push(what),
                Step::End => return (count, damages),
            }
        }
    }

    #[test]
    fn pages_that_go_in_a_circle_end() {
        // Each of its 65,535 children is the page itself.
        let tables = file(&[&[0x05, 0, 0, 0xff, 0xff, 0, 0, 0, 0, 0, 0, 1], &[]]);
        let (rows, damages) = walk(&tables, 1);
        assert_eq!((rows, damages.last().map(String::as_str)), (0, Some("its pages go in a circle")));
        // Each row goes on in a page that goes on in itself.
        let mut leaf = vec![0x0d, 0, 0, 0, 200];
        leaf.resize(PAGE, 0);
        for cell in 0..200 {
            leaf[8 + 2 * cell..10 + 2 * cell].copy_from_slice(&410_u16.to_be_bytes());
        }
        // 2²⁷ bytes, the number of the row, 29 bytes that stand here, and the page where the rest is
        leaf[410..415].copy_from_slice(&[0xc0, 0x80, 0x80, 0x00, 1]);
        let wanted = (PAGE - 12) * 32 / 255 - 23;
        let local = wanted + ((1 << 27) - wanted) % (PAGE - 4);
        let local = if local <= PAGE - 35 { local } else { wanted };
        if let Some(next) = leaf.get_mut(415 + local..419 + local) {
            next.copy_from_slice(&3_u32.to_be_bytes());
        }
        let tables = file(&[&[], &leaf, &3_u32.to_be_bytes()]);
        let (rows, damages) = walk(&tables, 2);
        assert_eq!((rows, damages.len()), (0, 200));
    }

    #[test]
    fn a_page_that_is_missing_takes_no_other_with_it() {
        let leaf = [0x0d, 0, 0, 0, 1, 0, 0, 0, 0, 20, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 7, 1, 1];
        // Children 9, 8 (not there) and 2
        let root = [0x05, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 2, 0, 120, 0, 124, 0, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 8];
        let (rows, damages) = walk(&file(&[&root, &leaf]), 1);
        assert_eq!((rows, damages), (1, vec!["page 9 is missing".to_owned(), "page 8 is missing".to_owned()]));
    }

    #[test]
    fn numbers_and_records() {
        let check = |bytes: &[u8], expected: Option<u64>| assert_eq!(varint(&mut &*bytes), expected);
        check(&[0x05], Some(5));
        check(&[0x81, 0x00], Some(128));
        check(&[0xff; 9], Some(u64::MAX));
        check(&[0x80], None);
        let record = [6, 0, 1, 9, 2, 17, 0xff, 0x01, 0x00, b'h', b'i'];
        let expected =
            [Value::Nothing, Value::Integer(-1), Value::Integer(1), Value::Integer(256), Value::Bytes(b"hi")];
        assert_eq!(values(&record), expected);
        assert_eq!(values(&record[..9]).len(), 4);
        assert_eq!(values(&[0xff]), []);
        let sql =
            "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL, timestamp INTEGER, \"data\" BLOB)";
        assert_eq!(columns(sql), ["id", "topic_id", "timestamp", "data"]);
    }
}
