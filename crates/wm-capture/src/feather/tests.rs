use super::flatbuffer::FlatTable;
use super::{FeatherColumn, FeatherTable, feather, feather_packed};
use half::f16;
use proptest::prelude::*;

fn columns() -> Vec<FeatherColumn> {
    vec![
        FeatherColumn::new("name", ["a", "", "Zürich"]),
        FeatherColumn::new("x", [0.5, -94.0, 1.0 / 3.0].map(f16::from_f64)),
        FeatherColumn::new("t", [i64::MIN, -1, 315_966_265_259_836_000]),
        FeatherColumn::new("w", [1u16, 65_535, 2048]),
        FeatherColumn::new("q", [0.1, f64::INFINITY, -0.0]),
    ]
}

fn bytes(columns: &[FeatherColumn], is_packed: bool) -> Vec<u8> {
    if is_packed { feather_packed(columns) } else { feather(columns) }.unwrap()
}

#[test]
fn tables_are_read_plain_and_packed() {
    for is_packed in [false, true] {
        let bytes = bytes(&columns(), is_packed);
        let mut table = FeatherTable::read(&bytes, &["q", "t", "name", "w", "x", "not there"]).unwrap();
        assert_eq!(table.texts("name").unwrap(), ["a", "", "Zürich"]);
        assert_eq!(table.ints("t").unwrap(), [i64::MIN, -1, 315_966_265_259_836_000]);
        assert_eq!(table.floats("w").unwrap(), [1.0, 65_535.0, 2048.0]);
        assert_eq!(table.floats("q").unwrap(), [0.1, f64::INFINITY, -0.0]);
        assert_eq!(table.floats("x").unwrap()[..2], [0.5, -94.0]);
        assert_eq!(
            table.ints("not there"),
            Err("there is no column \"not there\" of a type that is read".into())
        );
        assert!(FeatherTable::read(&bytes, &["x"]).unwrap().texts("x").is_err());
    }
}

/// Written by pyarrow 26.0.1: `write_feather` of a table of such types, `compression="lz4"`.
#[test]
fn a_file_of_pyarrow_is_read() {
    let names = ["name", "x", "t", "seen"];
    let mut table = FeatherTable::read(include_bytes!("pyarrow.feather"), &names).unwrap();
    assert_eq!(table.texts("name").unwrap(), ["a", "Zürich", ""]);
    assert_eq!(table.floats("x").unwrap(), [0.5, -94.0, 2.0]);
    assert_eq!(table.ints("t").unwrap(), [-1, 2, 315_966_265_259_836_000]);
    assert_eq!(table.ints("seen").unwrap(), [1, 0, 1]);
}

#[test]
fn every_type_is_read_as_it_was_written() {
    for rows in [0, 1, 1000] {
        let numbers = || (0..rows).map(|row: i64| row.wrapping_mul(0x1234_5678_9abc_def1));
        let texts: Vec<String> =
            numbers().map(|v| "Größe µm 雪".repeat((v % 3).unsigned_abs() as usize)).collect();
        macro_rules! column {
            ($number:ty) => {
                FeatherColumn::new(stringify!($number), numbers().map(|v| v as $number))
            };
        }
        let columns = [
            column!(i8),
            column!(i16),
            column!(i32),
            column!(i64),
            column!(u8),
            column!(u16),
            column!(u32),
            column!(u64),
            FeatherColumn::new("f16", numbers().map(|v| f16::from_f64(v as f64 * 1e-15))),
            column!(f32),
            column!(f64),
            FeatherColumn::new("bool", numbers().map(|v| v % 3 == 0)),
            FeatherColumn::new("Größe 雪", texts.iter().map(String::as_str)),
        ];
        let names =
            ["i8", "i16", "i32", "i64", "u8", "u16", "u32", "u64", "f16", "f32", "f64", "bool", "Größe 雪"];
        let bytes = feather(&columns).unwrap();
        assert_eq!(bytes, feather(&columns).unwrap());
        let mut table = FeatherTable::read(&bytes, &names).unwrap();
        assert_eq!(table.texts("Größe 雪").unwrap(), texts);
        let mut ints = |name: &str, of: &dyn Fn(i64) -> i64| {
            assert_eq!(
                table.ints(name).unwrap(),
                numbers().map(of).collect::<Vec<_>>(),
                "{name}, {rows} rows"
            );
        };
        ints("i8", &|v| (v as i8).into());
        ints("i16", &|v| (v as i16).into());
        ints("i32", &|v| (v as i32).into());
        ints("i64", &|v| v);
        ints("u8", &|v| (v as u8).into());
        ints("u16", &|v| (v as u16).into());
        ints("u32", &|v| (v as u32).into());
        ints("u64", &|v| i64::try_from(v as u64).unwrap_or(i64::MAX));
        ints("bool", &|v| (v % 3 == 0).into());
        let mut floats = |name: &str, of: &dyn Fn(i64) -> f64| {
            assert_eq!(
                table.floats(name).unwrap(),
                numbers().map(of).collect::<Vec<_>>(),
                "{name}, {rows} rows"
            );
        };
        floats("f16", &|v| f16::from_f64(v as f64 * 1e-15).into());
        floats("f32", &|v| (v as f32).into());
        floats("f64", &|v| v as f64);
    }
}

#[test]
fn a_file_byte_by_byte() {
    let bytes = feather(&[FeatherColumn::new("n", [7u8, 8])]).unwrap();
    #[rustfmt::skip]
    let head = [
        b'A', b'R', b'R', b'O', b'W', b'1', 0, 0,
        // A message, and the bytes up to the next one, at 192.
        0xff, 0xff, 0xff, 0xff, 176, 0, 0, 0,
        // The message is 16 bytes ahead. Its vtable: 12 bytes, of a table of 24, and the places of
        // its fields.
        16, 0, 0, 0, 12, 0, 24, 0, 4, 0, 6, 0, 8, 0, 16, 0,
        // The message: way to the vtable, version 5, a schema, which is 24 bytes ahead; no body.
        12, 0, 0, 0, 4, 0, 1, 0, 24, 0, 0, 0, 0, 0, 0, 0,
        0, 0, 0, 0, 0, 0, 0, 0,
        // The schema: little endian, one column.
        8, 0, 12, 0, 4, 0, 8, 0, 8, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 1, 0, 0, 0,
    ];
    assert_eq!(bytes[..head.len()], head);
    // The second message, a record batch.
    assert_eq!(bytes[192..196], [0xff; 4]);
    let body = 192 + 8 + u32::from_le_bytes(bytes[196..200].try_into().unwrap()) as usize;
    assert_eq!(bytes[body..body + 3], [7, 8, 0]);
    // The end of the messages, and of the file.
    assert_eq!(bytes[body + 64..body + 72], [0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    let footer = (bytes.len() - 10 - (body + 72)) as u32;
    assert_eq!(bytes[bytes.len() - 10..], [&footer.to_le_bytes()[..], b"ARROW1"].concat());
}

#[test]
fn buffers_lie_at_multiples_of_64_bytes() {
    for is_packed in [false, true] {
        let bytes = bytes(&columns(), is_packed);
        let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let footer = bytes.len()
            - 10
            - u32::from_le_bytes(bytes[bytes.len() - 10..][..4].try_into().unwrap()) as usize;
        let (block, count) = FlatTable::root(&bytes, footer).unwrap().structs(3, 24).unwrap();
        assert_eq!(count, 1);
        let (place, body) = (number(block), number(block) + number(block + 8));
        let batch = FlatTable::root(&bytes, place + 8).unwrap().table(2).unwrap().unwrap();
        let (buffers, count) = batch.structs(2, 16).unwrap();
        assert_eq!(count, 11);
        for buffer in 0..count {
            assert_eq!((body + number(buffers + 16 * buffer)) % 64, 0, "buffer {buffer}");
        }
    }
}

#[test]
fn columns_of_different_lengths_are_refused() {
    let columns = [FeatherColumn::new("a", [1u8, 2]), FeatherColumn::new("b", ["c"])];
    let error = feather(&columns).unwrap_err().to_string();
    assert_eq!(error, "the column \"b\" has 1 rows and the first 2");
}

#[test]
fn cut_files_are_errors() {
    let bytes = bytes(&columns(), true);
    for end in 0..bytes.len() {
        assert!(FeatherTable::read(&bytes[..end], &["q"]).is_err(), "{end}");
    }
}

proptest! {
    #[test]
    fn tables_are_read_as_they_were_written(
        rows in prop::collection::vec((any::<i64>(), any::<u16>(), -1e300..1e300, ".{0,9}"), 0..70),
        name in ".{1,20}",
        is_packed: bool,
    ) {
        let name = format!("t{name}");
        let columns = [
            FeatherColumn::new("i", rows.iter().map(|row| row.0)),
            FeatherColumn::new("u", rows.iter().map(|row| row.1)),
            FeatherColumn::new("f", rows.iter().map(|row| row.2)),
            FeatherColumn::new(&name, rows.iter().map(|row| row.3.as_str())),
        ];
        let mut table = FeatherTable::read(&bytes(&columns, is_packed), &["i", "u", "f", &name]).unwrap();
        let (i, u) = (table.ints("i").unwrap(), table.ints("u").unwrap());
        let (f, t) = (table.floats("f").unwrap(), table.texts(&name).unwrap());
        prop_assert_eq!([i.len(), u.len(), f.len(), t.len()], [rows.len(); 4]);
        for (row, (((i, u), f), t)) in rows.iter().zip(i.into_iter().zip(u).zip(f).zip(t)) {
            prop_assert_eq!(row, &(i, u as u16, f, t));
        }
    }
}

proptest! {
    // Bytes of a file are damaged in many ways.
    #![proptest_config(ProptestConfig::with_cases(2 * ProptestConfig::default().cases))]

    #[test]
    fn damaged_files_are_errors_or_tables(
        is_packed: bool,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = bytes(&columns(), is_packed);
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(mut table) = FeatherTable::read(&bytes, &["name", "x", "t", "w", "q"])
            && let Ok(times) = table.ints("t")
        {
            prop_assert!(times.len() <= 3);
        }
    }
}

/// The real sweep of av2-api's tests, where `AV2_SWEEP` names the file: 315966265259836000.feather.
#[test]
#[ignore = "needs a file that is not part of this project"]
fn a_real_sweep_is_read() {
    let Ok(path) = std::env::var("AV2_SWEEP") else { return };
    let bytes = std::fs::read(path).unwrap();
    let mut table = FeatherTable::read(&bytes, &["x", "y", "z", "laser_number", "intensity"]).unwrap();
    let lasers: std::collections::BTreeSet<i64> = table.ints("laser_number").unwrap().into_iter().collect();
    let mut axis = |name: &str| table.floats(name).unwrap();
    let (x, y, z) = (axis("x"), axis("y"), axis("z"));
    let mut ranges: Vec<f64> =
        x.iter().zip(&y).zip(&z).map(|((x, y), z)| (x * x + y * y + z * z).sqrt()).collect();
    ranges.sort_by(f64::total_cmp);
    let at = |share: f64| (10.0 * ranges[(share * (ranges.len() - 1) as f64) as usize]).round() / 10.0;
    assert_eq!((ranges.len(), lasers.len()), (99_229, 64));
    // As NumPy has them, of the lower of two ranks.
    assert_eq!([at(0.01), at(0.5), at(0.9), at(0.99)], [4.6, 16.9, 36.1, 94.4]);
    assert!(matches!(FeatherTable::read(&bytes, &[]), Ok(table) if table == FeatherTable::default()));
}
