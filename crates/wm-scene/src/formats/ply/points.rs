//! PLY files of points: x y z and, if present, red green blue of each vertex.

use super::header::{Element, Endian, Header, Kind, PlyEncoding, Property, Scalar};
use crate::{Remark, SparsePoints};
use std::path::Path;
use wm_base::{FormatError, Problem, error::number, source::Source};

/// Colour of points that have none.
const DEFAULT_COLOR: [u8; 3] = [128; 3];

/// Reads the points of a PLY, binary of either byte order or ASCII, and remarks on them. Other
/// properties are stepped over. Points that are not finite are left out.
///
/// The range of colours is told by their type and the highest of them: up to 255 or 65535 for whole
/// numbers, and also 1 for floats.
///
/// # Errors
/// [`FormatError`] if the file is missing, cut off, or not a PLY with points.
pub fn read_points(path: &Path) -> Result<(SparsePoints, Vec<Remark>), FormatError> {
    read_points_from(&mut Source::open(path)?)
}

fn read_points_from(source: &mut Source) -> Result<(SparsePoints, Vec<Remark>), FormatError> {
    if !source.fill(3)? || source.bytes().get(..3) != Some(b"ply") {
        let problem = "no PLY: it does not begin with \"ply\"; give the file of the points";
        return Err(source.whole(Problem::Value(problem.into())));
    }
    let header = Header::parse(source)?;
    let vertex = header.elements.first().filter(|element| element.name == "vertex" && !element.has_lists());
    let Some(vertex) = vertex else {
        let problem = "the first element is not vertex, or it has lists; export the points again";
        return Err(source.whole(Problem::Value(problem.into())));
    };
    let columns = columns(vertex).map_err(|problem| source.whole(problem))?;
    let mut points = SparsePoints::default();
    let mut colors: Vec<[f32; 3]> = Vec::new();
    let mut absurd = 0u64;
    let mut row = [0.0; 6];
    for done in 0..vertex.count {
        let is_there = match header.encoding {
            PlyEncoding::Ascii => text_row(source, vertex, &columns, &mut row)?,
            PlyEncoding::BinaryLittleEndian => {
                binary_row(source, vertex, &columns, Endian::Little, &mut row)?
            }
            PlyEncoding::BinaryBigEndian => binary_row(source, vertex, &columns, Endian::Big, &mut row)?,
        };
        if !is_there {
            let what = format!("point {} of {}", done + 1, vertex.count);
            return Err(source.whole(Problem::CaptureTruncated { what }));
        }
        let [x, y, z, color @ ..] = row;
        if [x, y, z].iter().all(|v| v.is_finite()) {
            points.push([x, y, z], DEFAULT_COLOR, f32::NAN, 0);
            if columns.color != ColorType::None {
                colors.push(color.map(|v| v as f32));
            }
        } else {
            absurd += 1;
        }
    }
    let mut remarks = Vec::new();
    if absurd > 0 {
        let text = format!("{absurd} points of {} are not finite and are left out", source.path().display());
        remarks.push(Remark::doubt("absurd-points", text));
    }
    if columns.color == ColorType::None && !points.is_empty() {
        let text = format!("the points of {} have no colours: splats begin grey", source.path().display());
        remarks.push(Remark::note("no-colours", text));
    }
    let full = full_scale(columns.color, &colors);
    for (out, color) in points.colors.iter_mut().zip(&colors) {
        // NaN is no colour.
        *out = color.map(|v| if v.is_nan() { DEFAULT_COLOR[0] } else { (v * (255.0 / full)).round() as u8 });
    }
    Ok((points, remarks))
}

/// The type of the properties of colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ColorType {
    None,
    /// 8 bits.
    Bytes,
    /// Whole numbers of more bits.
    Counts,
    /// Floats.
    Floats,
}

/// Returns the number that stands for full brightness.
fn full_scale(kind: ColorType, colors: &[[f32; 3]]) -> f32 {
    let highest = colors.iter().flatten().copied().filter(|v| v.is_finite()).fold(0.0f32, f32::max);
    match (kind, highest) {
        // Shares of bright surfaces may be somewhat above 1.
        (ColorType::Floats, ..=2.0) => 1.0,
        (ColorType::None | ColorType::Bytes, _) | (_, ..=255.0) => 255.0,
        // Beyond 16 bits the brightest point is white.
        _ => highest.max(65535.0),
    }
}

struct Columns {
    /// For each property, its place among x y z red green blue.
    lanes: Vec<Option<usize>>,
    color: ColorType,
}

fn columns(vertex: &Element) -> Result<Columns, Problem> {
    let lane = |name: &str| match name {
        "x" => Some(0),
        "y" => Some(1),
        "z" => Some(2),
        "red" | "r" | "diffuse_red" => Some(3),
        "green" | "g" | "diffuse_green" => Some(4),
        "blue" | "b" | "diffuse_blue" => Some(5),
        _ => None,
    };
    let lanes: Vec<Option<usize>> = vertex.properties.iter().map(|p| lane(&p.name)).collect();
    let has = |lane| lanes.contains(&Some(lane));
    if let Some(missing) = (0..3).find(|lane| !has(*lane)) {
        let name = ["x", "y", "z"][missing];
        return Err(Problem::Value(format!(
            "the vertex element has no property {name}; export the points again"
        )));
    }
    let kind_of = |property: &Property| match property.kind {
        Kind::Scalar(Scalar::F32 | Scalar::F64) => ColorType::Floats,
        Kind::Scalar(Scalar::U8 | Scalar::I8) => ColorType::Bytes,
        _ => ColorType::Counts,
    };
    let red = vertex.properties.iter().zip(&lanes).find(|(_, lane)| **lane == Some(3));
    let color = match red {
        Some((property, _)) if has(4) && has(5) => kind_of(property),
        _ => ColorType::None,
    };
    Ok(Columns { lanes, color })
}

/// Reads a row of text; `false` at the end of the file.
fn text_row(
    source: &mut Source,
    vertex: &Element,
    columns: &Columns,
    row: &mut [f64; 6],
) -> Result<bool, FormatError> {
    loop {
        let mut count = 0;
        while let Some(word) = source.word()? {
            if let Some(Some(lane)) = columns.lanes.get(count) {
                match number(word, &vertex.properties[count].name) {
                    Ok(value) => row[*lane] = value,
                    Err(_) if source.is_cut() => return Ok(false),
                    Err(problem) => return Err(source.in_line(problem)),
                }
            }
            count += 1;
        }
        if count >= vertex.properties.len() && count > 0 {
            return Ok(true);
        }
        if source.is_cut() {
            return Ok(false);
        }
        if count > 0 {
            let problem = "there are too few values for a point; correct the line or export the file again";
            return Err(source.at_line(Problem::Value(problem.into())));
        }
    }
}

/// Reads a binary row; `false` at the end of the file.
fn binary_row(
    source: &mut Source,
    vertex: &Element,
    columns: &Columns,
    endian: Endian,
    row: &mut [f64; 6],
) -> Result<bool, FormatError> {
    let size = vertex.min_size();
    if !source.fill(size)? {
        return Ok(false);
    }
    let mut bytes = &source.bytes()[..size];
    for (property, lane) in vertex.properties.iter().zip(&columns.lanes) {
        let Kind::Scalar(scalar) = property.kind else { continue };
        let (own, rest) = bytes.split_at(scalar.size());
        bytes = rest;
        if let Some(lane) = lane {
            row[*lane] = scalar.read(own, endian);
        }
    }
    source.consume(size);
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(bytes: &[u8]) -> Result<SparsePoints, FormatError> {
        let mut source = Source::new(Path::new("p.ply"), Box::new(bytes), Some(bytes.len() as u64));
        Ok(read_points_from(&mut source)?.0)
    }

    fn header(encoding: &str) -> Vec<u8> {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty double z\n\
             property float nx\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
        )
        .into_bytes()
    }

    fn binary(is_little: bool) -> Vec<u8> {
        let mut out = header(if is_little { "binary_little_endian" } else { "binary_big_endian" });
        for row in [[1.0f32, -2.0, 3.5], [4.0, 5.0, 6.0]] {
            let four = |v: f32| if is_little { v.to_le_bytes() } else { v.to_be_bytes() };
            let z = f64::from(row[2]);
            out.extend(four(row[0]));
            out.extend(four(row[1]));
            out.extend(if is_little { z.to_le_bytes() } else { z.to_be_bytes() });
            out.extend(four(9.0));
            out.extend([10, 20, 255]);
        }
        out
    }

    fn text() -> Vec<u8> {
        [&header("ascii")[..], b"1 -2 3.5 9 10 20 255\n\n4 5 6 9 10 20 255"].concat()
    }

    #[test]
    fn points_of_every_encoding() {
        for bytes in [binary(true), binary(false), text()] {
            let points = read(&bytes).unwrap();
            assert_eq!(points.positions, [[1.0, -2.0, 3.5], [4.0, 5.0, 6.0]]);
            assert_eq!(points.colors, [[10, 20, 255]; 2]);
            assert!(points.errors.iter().all(|e| e.is_nan()) && points.track_lengths == [0, 0]);
        }
    }

    #[test]
    fn files_cut_at_any_byte_are_errors() {
        for bytes in [binary(true), binary(false)] {
            for end in 0..bytes.len() {
                let error = read(&bytes[..end]).unwrap_err().to_string();
                assert!(!error.contains('\n'), "{error}");
            }
        }
        let text = text();
        // Without its last digits the last number is another one, which nothing can tell.
        for end in 0..text.len() - 2 {
            assert!(read(&text[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn colours_are_optional_and_may_be_shares() {
        let start =
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
        let plain = format!("{start}end_header\n1 2 3\n");
        assert_eq!(read(plain.as_bytes()).unwrap().colors, [DEFAULT_COLOR]);
        let shares = format!(
            "{start}property float r\nproperty float g\nproperty float b\nend_header\n1 2 3 0 .5 2\n"
        );
        assert_eq!(read(shares.as_bytes()).unwrap().colors, [[0, 128, 255]]);
        let faces = "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int i\nend_header\n";
        let error = read(faces.as_bytes()).unwrap_err().to_string();
        assert!(error.starts_with("p.ply: the first element is not vertex"), "{error}");
    }

    #[test]
    fn colours_of_every_type_are_the_same() {
        let colors = [[0, 51, 255], [102, 204, 153]];
        for (kind, full) in [
            ("uchar", 255.0),
            ("uint8", 255.0),
            ("ushort", 65535.0),
            ("uint16", 65535.0),
            ("ushort", 255.0),
            ("short", 255.0),
            ("int", 255.0),
            ("uint", 65535.0),
            ("int", 1e9),
            ("float", 1.0),
            ("float", 255.0),
            ("double", 1.0),
            ("float64", 255.0),
            ("float", 65535.0),
        ] {
            let mut text = format!(
                "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n\
                 property {kind} red\nproperty {kind} green\nproperty {kind} blue\nend_header\n"
            );
            for color in colors {
                let [r, g, b] = color.map(|v: u8| f64::from(v) / 255.0 * full);
                text += &format!("1 2 3 {r} {g} {b}\n");
            }
            assert_eq!(read(text.as_bytes()).unwrap().colors, colors, "{kind} to {full}");
        }
    }

    proptest! {
        #[test]
        fn mutated_files_never_panic(
            which in 0..3usize,
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        ) {
            let mut bytes = [binary(true), binary(false), text()][which].clone();
            for (at, byte) in edits {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            if let Ok(points) = read(&bytes) {
                prop_assert!(points.len() <= bytes.len());
            }
        }
    }
}
