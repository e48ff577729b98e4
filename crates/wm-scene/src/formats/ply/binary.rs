//! Binary bodies, both byte orders.

use super::{
    header::Endian,
    header::{Element, Header, Kind},
    layout::Layout,
    rows::Rows,
};
use wm_base::{
    error::{FormatError, Problem, excerpt},
    source::Source,
};

/// Rows that arrays begin with where nothing confirms their number.
const FIRST_ROWS: u64 = 1 << 10;

/// Bytes of rows that are repacked at once where they have lists.
const REPACKED_BYTES: usize = 1 << 20;

/// Reads the splats that follow the header.
///
/// # Errors
/// If the file ends too early or a list has a negative length.
pub(super) fn read(
    source: &mut Source,
    header: &Header,
    layout: &Layout,
    endian: Endian,
) -> Result<Rows, FormatError> {
    let (before, vertex) = (&header.elements[..layout.element], &header.elements[layout.element]);
    let promised = vertex.count;
    check_length(source, &header.elements[..=layout.element], promised)?;
    for element in before {
        let missing = skip(source, element, endian)?;
        if missing > 0 {
            return Err(source.whole(Problem::Truncated { promised, missing }));
        }
    }

    // The count is believed only where the length of the file has confirmed it.
    let known = if source.remaining().is_some() { promised } else { promised.min(FIRST_ROWS) };
    let mut read = Rows::zeroed(known as usize, layout);
    let mut repacked = Vec::new();
    let mut done = 0;
    while done < promised {
        let row_size = layout.row_size;
        let rows = if vertex.has_lists() {
            repacked.clear();
            let rows = (promised - done).min((REPACKED_BYTES / row_size) as u64).max(1);
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
        read.grow(layout, done + rows, promised);
        let size = rows as usize * row_size;
        let bytes = if vertex.has_lists() { &repacked[..] } else { &source.bytes()[..size] };
        let put = layout.scatter(endian, bytes, done as usize, &mut read);
        put.map_err(|problem| source.whole(problem))?;
        if !vertex.has_lists() {
            source.consume(size);
        }
        done += rows;
    }
    Ok(read)
}

/// Refuses a file, if its length is known, that is shorter than the rows of elements.
pub(super) fn check_length(source: &Source, elements: &[Element], promised: u64) -> Result<(), FormatError> {
    let needed: u128 = elements.iter().map(fewest_bytes).sum();
    match source.remaining().map(u128::from).filter(|there| needed > *there) {
        Some(there) => Err(source.whole(Problem::Truncated { promised, missing: needed - there })),
        None => Ok(()),
    }
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
                let length = count.read(source.bytes(), endian);
                if length < 0.0 {
                    let name = excerpt(element.name.as_bytes());
                    let what = format!("a list of the element {name} has a negative length");
                    return Err(source.at_byte(at, Problem::Value(format!("{what}; export the file again"))));
                };
                source.consume(count.size());
                if source.skip(length as u128 * item.size() as u128)? > 0 {
                    return Ok(false);
                }
            }
        }
    }
    Ok(true)
}
