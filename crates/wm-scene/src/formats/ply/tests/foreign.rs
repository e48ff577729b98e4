//! Files of other programs: any order, number type, encoding and company.

use super::*;

/// A file put together by hand: elements with properties of any type, rows of numbers and lists.
#[derive(Clone, Debug)]
struct Table {
    name: &'static str,
    properties: Vec<(String, &'static str)>,
    rows: Vec<Vec<Vec<u8>>>,
}

const TYPES: [&str; 16] = [
    "char", "uchar", "short", "ushort", "int", "uint", "float", "double", "int8", "uint8", "int16", "uint16",
    "int32", "uint32", "float32", "float64",
];

fn number(kind: &str, encoding: PlyEncoding, value: u8) -> Vec<u8> {
    let value = f64::from(value);
    let bytes = match kind {
        "char" | "int8" | "uchar" | "uint8" => vec![value as u8],
        "short" | "int16" | "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" | "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    match encoding {
        PlyEncoding::BinaryLittleEndian => bytes,
        PlyEncoding::BinaryBigEndian => bytes.into_iter().rev().collect(),
        PlyEncoding::Ascii => format!("{value} ").into_bytes(),
    }
}

fn assemble(tables: &[Table], encoding: PlyEncoding, ending: &str) -> Vec<u8> {
    let mut text = format!("ply{ending}comment \u{e9}{ending}format {} 1.0{ending}", encoding.keyword());
    for table in tables {
        text += &format!("element {} {}{ending}", table.name, table.rows.len());
        for (name, kind) in &table.properties {
            text += &format!("property {kind} {name}{ending}obj_info 1 2 3{ending}");
        }
    }
    text += &format!("end_header{ending}");
    let mut bytes = text.into_bytes();
    for table in tables {
        for row in &table.rows {
            for (cell, (_, kind)) in row.iter().zip(&table.properties) {
                if let Some(rest) = kind.strip_prefix("list ") {
                    let (count, item) = rest.split_once(' ').unwrap();
                    bytes.extend(number(count, encoding, cell.len() as u8));
                    cell.iter().for_each(|v| bytes.extend(number(item, encoding, *v)));
                } else {
                    bytes.extend(number(kind, encoding, cell[0]));
                }
            }
            if encoding == PlyEncoding::Ascii && !table.properties.is_empty() {
                bytes.extend(ending.as_bytes());
            }
        }
    }
    bytes
}

const LISTS: [&str; 3] = ["list uchar int", "list ushort double", "list int8 float"];

/// Elements that are no splats: nothing, numbers, or lists in the middle.
fn other_table(name: &'static str) -> impl Strategy<Value = Option<Table>> {
    let cells = prop::collection::vec((prop::collection::vec(0..100u8, 0..5), 0..100u8), 0..4);
    (prop::option::of(0..LISTS.len()), any::<bool>(), cells).prop_map(move |(list, some, cells)| {
        let kind = list.map_or("short", |i| LISTS[i]);
        let properties = vec![("a".into(), "double"), ("b".into(), kind), ("c".into(), "uchar")];
        let rows = cells
            .into_iter()
            .map(|(items, v)| vec![vec![v], if list.is_some() { items } else { vec![v] }, vec![v]]);
        some.then(|| Table { name, properties, rows: rows.collect() })
    })
}

/// Names of the properties of a splat in the order of
/// `[means, quats, log_scales, opacity, sh, group]`.
fn names(degree: u8) -> Vec<String> {
    let coefficients = crate::sh::coefficients(degree);
    let mut names: Vec<String> =
        ["x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "scale_2", "opacity"]
            .map(String::from)
            .to_vec();
    for k in 0..coefficients {
        for channel in 0..3 {
            names.push(match k {
                0 => format!("f_dc_{channel}"),
                _ => format!("f_rest_{}", channel * (coefficients - 1) + k - 1),
            });
        }
    }
    names.push("group".into());
    names
}

/// A splat table with its properties in any order and of any type, others among them, and the
/// splats that should be read from it.
fn splat_table() -> impl Strategy<Value = (Table, Splats)> {
    (0..=3u8, 1..6usize).prop_flat_map(|(degree, count)| {
        let names = names(degree);
        let width = names.len();
        let rows = prop::collection::vec(prop::collection::vec(0..100u8, width), count);
        let types = prop::collection::vec(prop::sample::select(&TYPES[..]), width);
        let order: Vec<usize> = (0..width + 3).collect();
        (rows, types, Just(order).prop_shuffle(), prop::option::of(0..LISTS.len())).prop_map(
            move |(rows, types, order, list)| {
                let mut properties: Vec<(String, &'static str)> = names.iter().cloned().zip(types).collect();
                properties.extend([("nx".into(), "float"), ("red".into(), "uchar")]);
                properties.push(("extra".into(), list.map_or("int", |i| LISTS[i])));
                let mut splats = Splats::with_capacity(rows.len(), degree);
                let mut cells = Vec::new();
                for row in &rows {
                    let values: Vec<f32> = row[..width - 1].iter().map(|v| f32::from(*v)).collect();
                    let group = Group::from_number(row[width - 1]).unwrap_or_default();
                    push_row(&mut splats, &values, group);
                    let mut all: Vec<Vec<u8>> = row.iter().map(|v| vec![*v]).collect();
                    all.extend([vec![1], vec![2], vec![row[0]; if list.is_some() { 3 } else { 1 }]]);
                    cells.push(order.iter().map(|i| all[*i].clone()).collect());
                }
                let properties = order.iter().map(|i| properties[*i].clone()).collect();
                (Table { name: "vertex", properties, rows: cells }, splats)
            },
        )
    })
}

proptest! {
    #[test]
    fn any_order_type_and_company_is_read(
        (vertex, splats) in splat_table(),
        before in other_table("camera"),
        after in other_table("face"),
        empty in any::<bool>(),
        encoding in prop::sample::select(&PlyEncoding::ALL[..]),
        ending in prop::sample::select(&["\n", "\r\n"][..]),
    ) {
        let nothing = Table { name: "nothing", properties: vec![], rows: vec![vec![]; 9] };
        let tables: Vec<Table> =
            [before, empty.then_some(nothing), Some(vertex), after].into_iter().flatten().collect();
        let bytes = assemble(&tables, encoding, ending);
        prop_assert_eq!(&read_bytes(&bytes).unwrap().splats, &splats);
        prop_assert_eq!(&read_pipe(&bytes).unwrap().splats, &splats);
    }
}
