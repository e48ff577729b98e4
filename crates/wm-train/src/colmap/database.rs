//! The points that each two photos share, with the names of the photos, from the database of a run.
//!
//! It is an SQLite file (<https://sqlite.org/fileformat2.html>), of which two tables are read:
//! `images`, and `two_view_geometries` with a row for each pair of photos. Only their pages are
//! read: features make it large. What cannot be understood gives nothing.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// COLMAP numbers a pair of photos a < b as a times this, plus b.
const PAIR_BASE: i64 = 2_147_483_647;

/// The points that photos share.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SharedPoints {
    /// The photos by their numbers.
    pub(crate) names: BTreeMap<i64, String>,
    /// Two photos, and the number of points that they share once wrong matches are left out.
    pub(crate) pairs: Vec<(i64, i64, u32)>,
}

impl SharedPoints {
    /// Reads a database; `None` if it cannot be read.
    pub(crate) fn read(path: &Path) -> Option<Self> {
        let mut database = Database::open(path)?;
        let names = database.table("images")?.into_iter();
        let names = names.filter_map(|(id, row)| match row.into_iter().nth(1)? {
            Column::Text(name) => Some((id, name)),
            _ => None,
        });
        let pairs = database.table("two_view_geometries")?.into_iter();
        let pairs = pairs.filter_map(|(pair, row)| match row.get(1)? {
            Column::Number(points) => {
                Some((pair / PAIR_BASE, pair % PAIR_BASE, u32::try_from(*points).ok()?))
            }
            _ => None,
        });
        Some(Self { names: names.collect(), pairs: pairs.collect() })
    }

    /// Returns the photos that share the most points with the photo `name`, the best first, without
    /// those that share none.
    pub(crate) fn of(&self, name: &str) -> Vec<(String, u32)> {
        let Some((id, _)) = self.names.iter().find(|(_, found)| *found == name) else { return Vec::new() };
        let others = self.pairs.iter().filter_map(|(a, b, points)| match (a == id, b == id) {
            (true, _) => Some((b, *points)),
            (_, true) => Some((a, *points)),
            _ => None,
        });
        let named = others.filter(|(_, points)| *points > 0);
        let mut named: Vec<(String, u32)> =
            named.filter_map(|(other, points)| Some((self.names.get(other)?.clone(), points))).collect();
        named.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        named
    }

    /// Returns the two photos that share the most points, and how many.
    pub(crate) fn best(&self) -> Option<(&str, &str, u32)> {
        let (a, b, points) = self.pairs.iter().max_by_key(|(_, _, points)| *points)?;
        Some((self.names.get(a)?, self.names.get(b)?, *points))
    }
}

/// A value of a row.
#[derive(Clone, Debug, PartialEq)]
enum Column {
    Number(i64),
    Text(String),
    /// Null, a float or bytes, which are not needed.
    Other,
}

/// A row by its number: the columns that are in its first page.
type Row = (i64, Vec<Column>);

struct Database {
    file: File,
    page_size: usize,
    /// Bytes of a page without what is reserved at its end.
    usable: usize,
    pages: u64,
}

impl Database {
    fn open(path: &Path) -> Option<Self> {
        let mut file = File::open(path).ok()?;
        let mut header = [0; 100];
        file.read_exact(&mut header).ok()?;
        if !header.starts_with(b"SQLite format 3\0") {
            return None;
        }
        let page_size = match u16::from_be_bytes([header[16], header[17]]) {
            1 => 65536,
            size => usize::from(size),
        };
        let usable = page_size.checked_sub(usize::from(header[20])).filter(|usable| *usable >= 480)?;
        let pages = file.metadata().ok()?.len() / page_size as u64;
        Some(Self { file, page_size, usable, pages })
    }

    /// Reads the rows of a table.
    fn table(&mut self, name: &str) -> Option<Vec<Row>> {
        // The table of tables: type, name, table, first page, text.
        let tables = self.rows(1)?;
        let is_it = |row: &&Row| {
            row.1.first() == Some(&Column::Text("table".into()))
                && row.1.get(1) == Some(&Column::Text(name.into()))
        };
        match tables.iter().find(is_it)?.1.get(3)? {
            Column::Number(page) => self.rows(u64::try_from(*page).ok()?),
            _ => None,
        }
    }

    /// Reads the rows below a page of a table's tree.
    fn rows(&mut self, root: u64) -> Option<Vec<Row>> {
        let (mut rows, mut left, mut met) = (Vec::new(), vec![root], 0);
        while let Some(number) = left.pop() {
            // A damaged tree may have circles.
            met += 1;
            if met > self.pages {
                return None;
            }
            let page = self.page(number)?;
            let start = if number == 1 { 100 } else { 0 };
            let kind = *page.get(start)?;
            let cells = usize::from(u16::from_be_bytes([*page.get(start + 3)?, *page.get(start + 4)?]));
            let pointers = start + if kind == INTERIOR_PAGE { 12 } else { 8 };
            for cell in 0..cells {
                let at = page.get(pointers + 2 * cell..pointers + 2 * cell + 2)?;
                let cell = page.get(usize::from(u16::from_be_bytes([at[0], at[1]]))..)?;
                match kind {
                    INTERIOR_PAGE => left.push(u64::from(u32::from_be_bytes(*cell.first_chunk()?))),
                    LEAF_PAGE => rows.push(self.row(cell)?),
                    _ => return None,
                }
            }
            if kind == INTERIOR_PAGE {
                left.push(u64::from(u32::from_be_bytes(*page.get(start + 8..)?.first_chunk()?)));
            }
        }
        Some(rows)
    }

    fn page(&mut self, number: u64) -> Option<Vec<u8>> {
        if !(1..=self.pages).contains(&number) {
            return None;
        }
        let mut page = vec![0; self.page_size];
        self.file.seek(SeekFrom::Start((number - 1) * self.page_size as u64)).ok()?;
        self.file.read_exact(&mut page).ok()?;
        page.truncate(self.usable);
        Some(page)
    }

    /// Reads the row of a cell: of what goes on in other pages, nothing.
    fn row(&self, cell: &[u8]) -> Option<Row> {
        let mut rest = cell;
        let length = usize::try_from(number(&mut rest)?).ok()?;
        let id = number(&mut rest)?;
        let most = self.usable - 35;
        let local = if length <= most {
            length
        } else {
            let least = (self.usable - 12) * 32 / 255 - 23;
            let share = least + (length - least) % (self.usable - 4);
            if share <= most { share } else { least }
        };
        let record = rest.get(..local)?;
        let mut types = record;
        let header = usize::try_from(number(&mut types)?).ok()?;
        let mut types = record.get(record.len() - types.len()..header)?;
        let mut values = record.get(header..)?;
        let mut columns = Vec::new();
        while !types.is_empty() {
            let kind = number(&mut types)?;
            let size = match kind {
                0 | 8 | 9 => 0,
                1..=4 => kind as usize,
                5 => 6,
                6 | 7 => 8,
                12.. => ((kind - 12) / 2) as usize,
                _ => return None,
            };
            let Some((value, after)) = values.split_at_checked(size) else { break };
            values = after;
            columns.push(match kind {
                // The sign is that of the first byte.
                1..=6 => Column::Number(
                    value
                        .iter()
                        .skip(1)
                        .fold(i64::from(value[0] as i8), |sum, byte| (sum << 8) | i64::from(*byte)),
                ),
                8 => Column::Number(0),
                9 => Column::Number(1),
                13.. if kind % 2 == 1 => Column::Text(String::from_utf8_lossy(value).into_owned()),
                _ => Column::Other,
            });
        }
        Some((id, columns))
    }
}

/// The kinds of pages of a table's tree.
const INTERIOR_PAGE: u8 = 5;
const LEAF_PAGE: u8 = 13;

/// Takes a number of variable length: seven bits a byte, the highest first, and eight of a ninth.
fn number(rest: &mut &[u8]) -> Option<i64> {
    let mut value: i64 = 0;
    for place in 0..9 {
        let (byte, after) = rest.split_first()?;
        *rest = after;
        if place == 8 {
            return Some((value << 8) | i64::from(*byte));
        }
        value = (value << 7) | i64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn fixture() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/colmap.db")
    }

    #[test]
    fn names_and_shared_points_are_read() {
        let shared = SharedPoints::read(&fixture()).unwrap();
        assert_eq!((shared.names.len(), shared.pairs.len()), (40, 38 + 39));
        assert_eq!(shared.names[&17], "folder of photos/017.jpg");
        let named = |photo: u32, points| (format!("folder of photos/{photo:03}.jpg"), points);
        assert_eq!(
            shared.of("folder of photos/008.jpg"),
            [named(10, 126), named(9, 119), named(7, 105), named(6, 98)]
        );
        assert_eq!(shared.of("folder of photos/040.jpg"), [named(39, 5)]);
        assert_eq!(shared.of("nowhere.jpg"), []);
        let best = shared.best().unwrap();
        assert_eq!(best, ("folder of photos/037.jpg", "folder of photos/038.jpg", 525));
    }

    #[test]
    fn damaged_databases_give_nothing_or_less() {
        let folder = tempfile::tempdir().unwrap();
        let (path, whole) = (folder.path().join("a.db"), fs::read(fixture()).unwrap());
        let read = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            SharedPoints::read(&path)
        };
        assert_eq!(read(b""), None);
        assert_eq!(read(b"SQLite format 3"), None);
        for length in (0..whole.len()).step_by(997) {
            read(&whole[..length]);
        }
        for at in (0..whole.len()).step_by(13) {
            let mut changed = whole.clone();
            changed[at] ^= 0xff;
            read(&changed);
        }
    }
}
