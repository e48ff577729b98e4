//! Binary bodies, both byte orders.

use super::{
    header::{Element, Header, Kind, Scalar},
    layout::{Endian, Layout},
};
use crate::{
    Group, Splats,
    error::{FormatError, Problem},
    sh,
    source::Source,
};

/// Rows that are put together at once where they have lists, and that an array grows by at least.
const ROWS: u64 = 1 << 10;

/// Reads the splats that follow the header.
///
/// # Errors
/// If the file ends too early or a list has a negative length.
pub(super) fn read(
    source: &mut Source,
    header: &Header,
    layout: &Layout,
    endian: Endian,
) -> Result<Splats, FormatError> {
    let (before, vertex) = (&header.elements[..layout.element], &header.elements[layout.element]);
    let needed: u128 = before.iter().chain([vertex]).map(fewest_bytes).sum();
    let promised = vertex.count;
    if let Some(there) = source.remaining()
        && needed > u128::from(there)
    {
        return Err(source.whole(Problem::Truncated { promised, missing: needed - u128::from(there) }));
    }
    for element in before {
        let missing = skip(source, element, endian)?;
        if missing > 0 {
            return Err(source.whole(Problem::Truncated { promised, missing }));
        }
    }

    // The count is believed only where the length of the file has confirmed it.
    let known = if source.remaining().is_some() { promised } else { promised.min(ROWS) };
    let mut splats = zeroed(known as usize, layout.sh_degree);
    let mut repacked = Vec::new();
    let mut done = 0;
    while done < promised {
        let row_size = layout.row_size;
        let rows = if vertex.has_lists() {
            repacked.clear();
            let rows = (promised - done).min(ROWS);
            for row in 0..rows {
                if !walk(source, vertex, endian, &mut repacked)? {
                    let left = u128::from(promised - done - row - 1);
                    let missing = left * vertex.min_size() as u128 + 1;
                    return Err(source.whole(Problem::Truncated { promised, missing }));
                }
            }
            rows
        } else {
            if !source.fill(row_size)? {
                let missing = u128::from(promised - done) * row_size as u128 - source.bytes().len() as u128;
                return Err(source.whole(Problem::Truncated { promised, missing }));
            }
            (promised - done).min((source.bytes().len() / row_size) as u64)
        };
        grow(&mut splats, done + rows, promised);
        let size = rows as usize * row_size;
        if vertex.has_lists() {
            layout.scatter(endian, &repacked, done as usize, &mut splats);
        } else {
            layout.scatter(endian, &source.bytes()[..size], done as usize, &mut splats);
            source.consume(size);
        }
        done += rows;
    }
    Ok(splats)
}

/// Fewest bytes that the rows of an element take.
fn fewest_bytes(element: &Element) -> u128 {
    u128::from(element.count) * element.min_size() as u128
}

/// Steps over the rows of an element; gives at least how many bytes of it are missing.
fn skip(source: &mut Source, element: &Element, endian: Endian) -> Result<u128, FormatError> {
    if !element.has_lists() {
        return source.skip(fewest_bytes(element));
    }
    let mut ignored = Vec::new();
    for row in 0..element.count {
        ignored.clear();
        if !walk(source, element, endian, &mut ignored)? {
            return Ok(u128::from(element.count - row - 1) * element.min_size() as u128 + 1);
        }
    }
    Ok(0)
}

/// Steps over one row and appends its scalars to `fixed`; `false` if the file ends before.
fn walk(
    source: &mut Source,
    element: &Element,
    endian: Endian,
    fixed: &mut Vec<u8>,
) -> Result<bool, FormatError> {
    for property in &element.properties {
        match property.kind {
            Kind::Scalar(scalar) => {
                if !source.fill(scalar.size())? {
                    return Ok(false);
                }
                fixed.extend_from_slice(&source.bytes()[..scalar.size()]);
                source.consume(scalar.size());
            }
            Kind::List { count, item } => {
                let at = source.offset();
                if !source.fill(count.size())? {
                    return Ok(false);
                }
                let Some(length) = integer(count, endian, source.bytes()) else {
                    let what = format!("a list of the element {} has a negative length", element.name);
                    return Err(source.at_byte(at, Problem::Value(format!("{what}; export the file again"))));
                };
                source.consume(count.size());
                if source.skip(u128::from(length) * item.size() as u128)? > 0 {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}

/// The length that a list begins with; `None` if it is negative.
fn integer(scalar: Scalar, endian: Endian, bytes: &[u8]) -> Option<u64> {
    let mut wide = [0; 4];
    let size = scalar.size().min(4);
    wide[..size].copy_from_slice(&bytes[..size]);
    if endian == Endian::Big {
        wide[..size].reverse();
    }
    let [a, b, ..] = wide;
    match scalar {
        Scalar::I8 => u64::try_from(i8::from_le_bytes([a])).ok(),
        Scalar::I16 => u64::try_from(i16::from_le_bytes([a, b])).ok(),
        Scalar::I32 => u64::try_from(i32::from_le_bytes(wide)).ok(),
        _ => Some(u64::from(u32::from_le_bytes(wide))),
    }
}

/// `count` splats with all values 0.
pub(super) fn zeroed(count: usize, sh_degree: u8) -> Splats {
    // `vec!` of zeros takes pages that the system has cleared already; pushing would write them twice.
    Splats {
        means: vec![[0.0; 3]; count],
        quats: vec![[0.0; 4]; count],
        log_scales: vec![[0.0; 3]; count],
        logit_opacities: vec![0.0; count],
        sh: vec![0.0; count * sh::coefficients(sh_degree) * 3],
        sh_degree,
        groups: vec![Group::default(); count],
    }
}

/// Makes room for `count` splats, doubling, but for no more than `promised`.
pub(super) fn grow(splats: &mut Splats, count: u64, promised: u64) {
    if count <= splats.len() as u64 {
        return;
    }
    let size = promised.min(count.max(2 * splats.len() as u64)) as usize;
    let sh_size = size * splats.sh_stride();
    splats.means.resize(size, [0.0; 3]);
    splats.quats.resize(size, [0.0; 4]);
    splats.log_scales.resize(size, [0.0; 3]);
    splats.logit_opacities.resize(size, 0.0);
    splats.sh.resize(sh_size, 0.0);
    splats.groups.resize(size, Group::default());
}
