use super::feather::FeatherTable;
use crate::logs::mini::{MiniColumn, feather};
use proptest::prelude::*;

fn columns() -> Vec<(&'static str, MiniColumn)> {
    vec![
        ("name", MiniColumn::Text(["a", "", "Zürich"].map(str::to_owned).into())),
        ("x", MiniColumn::F16(vec![0.5, -94.0, 1.0 / 3.0])),
        ("t", MiniColumn::I64(vec![i64::MIN, -1, 315_966_265_259_836_000])),
        ("w", MiniColumn::U16(vec![1, 65_535, 2048])),
        ("q", MiniColumn::F64(vec![0.1, f64::INFINITY, -0.0])),
    ]
}

#[test]
fn tables_are_read_plain_and_packed() {
    for is_packed in [false, true] {
        let bytes = feather(&columns(), is_packed).unwrap();
        let mut table = FeatherTable::read(&bytes, &["q", "t", "name", "w", "x", "not there"]).unwrap();
        assert_eq!(table.texts("name").unwrap(), ["a", "", "Zürich"]);
        assert_eq!(table.ints("t").unwrap(), [i64::MIN, -1, 315_966_265_259_836_000]);
        assert_eq!(table.floats("w").unwrap(), [1.0, 65_535.0, 2048.0]);
        assert_eq!(table.floats("q").unwrap(), [0.1, f64::INFINITY, -0.0]);
        assert_eq!(table.floats("x").unwrap()[..2], [0.5, -94.0]);
        assert_eq!(table.ints("not there"), Err("there is no column \"not there\" of a type that is read".into()));
        assert!(FeatherTable::read(&bytes, &["x"]).unwrap().texts("x").is_err());
    }
}

#[test]
fn cut_files_are_errors() {
    let bytes = feather(&columns(), true).unwrap();
    for end in 0..bytes.len() {
        assert!(FeatherTable::read(&bytes[..end], &["q"]).is_err(), "{end}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_files_are_errors_or_tables(
        is_packed: bool,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = feather(&columns(), is_packed).unwrap();
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
    let mut ranges: Vec<f64> = x.iter().zip(&y).zip(&z).map(|((x, y), z)| (x * x + y * y + z * z).sqrt()).collect();
    ranges.sort_by(f64::total_cmp);
    let at = |share: f64| (10.0 * ranges[(share * (ranges.len() - 1) as f64) as usize]).round() / 10.0;
    assert_eq!((ranges.len(), lasers.len()), (99_229, 64));
    // As NumPy has them, of the lower of two ranks.
    assert_eq!([at(0.01), at(0.5), at(0.9), at(0.99)], [4.6, 16.9, 36.1, 94.4]);
    assert!(matches!(FeatherTable::read(&bytes, &[]), Ok(table) if table == FeatherTable::default()));
}
