//! The PLY header: elements, properties and the metadata in its comments.

use crate::{Metadata, Rasterization};
use glam::DVec3;
use wm_base::{
    error::{FormatError, Problem, excerpt, one_line},
    source::Source,
};

/// Longest header, bytes: what it declares is kept in memory.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// The content of a header.
#[derive(Debug)]
pub(super) struct Header {
    pub(crate) encoding: PlyEncoding,
    pub(crate) elements: Vec<Element>,
    pub(crate) metadata: Metadata,
}

/// A table of the file.
#[derive(Debug)]
pub(super) struct Element {
    pub(crate) name: String,
    /// Rows that the header promises; not to be believed.
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

/// A column of a table.
#[derive(Debug)]
pub(super) struct Property {
    pub(crate) name: String,
    pub(crate) kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

/// The number types of PLY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_keyword(word: &[u8]) -> Result<Self, Problem> {
        Ok(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return Err(Problem::Header(format!("\"{}\" is not a number type of PLY", excerpt(word)))),
        })
    }

    /// Bytes of one number.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Reads the number at the beginning of `bytes`.
    pub(crate) fn read(self, bytes: &[u8], endian: Endian) -> f64 {
        let mut wide = [0; 8];
        let size = self.size().min(bytes.len());
        wide[..size].copy_from_slice(&bytes[..size]);
        if endian == Endian::Big {
            wide[..size].reverse();
        }
        let [a, b, c, d, ..] = wide;
        match self {
            Self::I8 => f64::from(a.cast_signed()),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(wide),
        }
    }
}

impl Kind {
    /// Fewest bytes: that of a list with no items.
    fn min_size(self) -> usize {
        match self {
            Self::Scalar(scalar) => scalar.size(),
            Self::List { count, .. } => count.size(),
        }
    }
}

impl Element {
    /// Fewest bytes of a binary row; all rows have it if there is no list.
    pub(crate) fn min_size(&self) -> usize {
        self.properties.iter().map(|p| p.kind.min_size()).sum()
    }

    /// Returns true if a row can have any length.
    pub(crate) fn has_lists(&self) -> bool {
        self.properties.iter().any(|p| matches!(p.kind, Kind::List { .. }))
    }
}

impl Header {
    /// Reads up to and with the `end_header` line.
    ///
    /// # Errors
    /// With the line, if it is no header that can be understood.
    pub(crate) fn parse(source: &mut Source) -> Result<Self, FormatError> {
        let mut encoding = None;
        let mut elements = Vec::new();
        let mut metadata = Metadata::default();
        loop {
            if source.offset() > MAX_HEADER_BYTES {
                return Err(source.whole(Problem::HeaderTooLong(MAX_HEADER_BYTES)));
            }
            let Some(line) = source.line()? else { return Err(source.whole(Problem::HeaderTruncated)) };
            match parse_line(line, &mut encoding, &mut elements, &mut metadata) {
                Ok(Step::Next) => {}
                Ok(Step::End) => break,
                Err(problem) => {
                    // Half a keyword at the end of the file is a cut, not a mistake.
                    return Err(if source.is_cut() {
                        source.whole(Problem::HeaderTruncated)
                    } else {
                        source.at_line(problem)
                    });
                }
            }
        }
        let Some(encoding) = encoding else {
            return Err(source.whole(Problem::Header("the header has no format line".into())));
        };
        Ok(Self { encoding, elements, metadata })
    }
}

enum Step {
    Next,
    End,
}

fn parse_line(
    line: &[u8],
    encoding: &mut Option<PlyEncoding>,
    elements: &mut Vec<Element>,
    metadata: &mut Metadata,
) -> Result<Step, Problem> {
    if let Some(entry) = line.strip_prefix(b"comment wm.") {
        if let Some(read) = parse_entry(entry)? {
            *metadata = read.or(std::mem::take(metadata));
        }
        return Ok(Step::Next);
    }
    if let Some(comment) = line.strip_prefix(b"comment ") {
        // The facts that this program wrote win.
        *metadata = std::mem::take(metadata).or(stated(comment));
    }
    let words: Vec<&[u8]> =
        line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).take(6).collect();
    match words[..] {
        [] | [b"ply"] | [b"comment" | b"obj_info", ..] => {}
        [b"end_header"] => return Ok(Step::End),
        [b"format", keyword, version] => {
            if version != b"1.0" {
                let version = excerpt(version);
                return Err(Problem::Header(format!("PLY version \"{version}\" is not read, 1.0 is")));
            }
            let found = PlyEncoding::ALL.into_iter().find(|e| e.keyword().as_bytes() == keyword);
            *encoding = Some(found.ok_or_else(|| {
                Problem::Header(format!("\"{}\" is not an encoding of PLY", excerpt(keyword)))
            })?);
        }
        [b"element", name, count] => {
            let count =
                std::str::from_utf8(count).ok().and_then(|text| text.parse().ok()).ok_or_else(|| {
                    Problem::Header(format!("\"{}\" is not a number of elements", excerpt(count)))
                })?;
            elements.push(Element { name: text_of(name), count, properties: Vec::new() });
        }
        [b"property", ref rest @ ..] => {
            let Some(element) = elements.last_mut() else {
                return Err(Problem::Header("a property stands before the first element".into()));
            };
            element.properties.push(parse_property(line, rest)?);
        }
        _ => return Err(unknown(line)),
    }
    Ok(Step::Next)
}

fn parse_property(line: &[u8], words: &[&[u8]]) -> Result<Property, Problem> {
    match *words {
        [b"list", count, item, name] => {
            let (count, item) = (Scalar::from_keyword(count)?, Scalar::from_keyword(item)?);
            if matches!(count, Scalar::F32 | Scalar::F64) {
                return Err(Problem::Header("a list cannot have a length that is not an integer".into()));
            }
            Ok(Property { name: text_of(name), kind: Kind::List { count, item } })
        }
        [kind, name] => Ok(Property { name: text_of(name), kind: Kind::Scalar(Scalar::from_keyword(kind)?) }),
        _ => Err(unknown(line)),
    }
}

/// The facts in a comment of another training: `Vertical axis: 0 -1 0` or `Vertical Axis: z`
/// (Brush, nerfstudio), and `SplatRenderMode: mip` (Brush), its name for what is antialiased.
fn stated(comment: &[u8]) -> Metadata {
    let nothing = Metadata::default();
    let text = String::from_utf8_lossy(comment).to_ascii_lowercase();
    let Some((key, value)) = text.split_once(':') else { return nothing };
    match (key.trim(), value.trim()) {
        ("splatrendermode", "mip") => Metadata { rasterization: Some(Rasterization::Antialiased), ..nothing },
        ("vertical axis", value) => {
            let Some(up) = axis_of(value) else { return nothing };
            Metadata { up: Some(up), up_source: Some("a comment in the file".into()), ..nothing }
        }
        _ => nothing,
    }
}

/// A unit vector of three numbers, or of x, y or z with a sign.
fn axis_of(text: &str) -> Option<DVec3> {
    let (sign, letter) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    match letter.trim_start_matches('+') {
        "x" => return Some(sign * DVec3::X),
        "y" => return Some(sign * DVec3::Y),
        "z" => return Some(sign * DVec3::Z),
        _ => {}
    }
    let numbers: Vec<f64> = text
        .split([' ', ','])
        .filter(|word| !word.is_empty())
        .map(str::parse)
        .collect::<Result<_, _>>()
        .ok()?;
    DVec3::from_array(numbers.try_into().ok()?).try_normalize()
}

/// The metadata of `<key> <value>`; `None` for a key that only a newer program knows.
fn parse_entry(entry: &[u8]) -> Result<Option<Metadata>, Problem> {
    let entry = std::str::from_utf8(entry)
        .map_err(|_| Problem::Header(format!("\"{}\" is not UTF-8", excerpt(entry))))?;
    let (key, value) = entry.trim().split_once(' ').unwrap_or((entry.trim(), ""));
    match Metadata::from_entry(key, value) {
        None => Ok(None),
        Some(Ok(metadata)) => Ok(Some(metadata)),
        Some(Err(fault)) => {
            Err(Problem::Value(format!("metadata: {}; correct or remove the line", one_line(&fault))))
        }
    }
}

fn unknown(line: &[u8]) -> Problem {
    Problem::Header(format!("the header line \"{}\" is not understood", excerpt(line)))
}

fn text_of(name: &[u8]) -> String {
    String::from_utf8_lossy(name).into_owned()
}

/// Byte order of a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Endian {
    Little,
    Big,
}

pub(super) fn missing(name: &str) -> Problem {
    property(&format!("the vertex element has no property {name}"))
}

pub(super) fn property(reason: &str) -> Problem {
    Problem::Property { reason: reason.into() }
}

/// The encoding of the numbers in a PLY.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PlyEncoding {
    /// Binary, least significant byte first.
    #[default]
    BinaryLittleEndian,
    /// Binary, most significant byte first.
    BinaryBigEndian,
    /// Decimal text, one splat per line.
    Ascii,
}

impl PlyEncoding {
    /// Every encoding.
    pub(super) const ALL: [Self; 3] = [Self::BinaryLittleEndian, Self::BinaryBigEndian, Self::Ascii];

    /// The name in the header.
    pub(super) fn keyword(self) -> &'static str {
        match self {
            Self::BinaryLittleEndian => "binary_little_endian",
            Self::BinaryBigEndian => "binary_big_endian",
            Self::Ascii => "ascii",
        }
    }
}
