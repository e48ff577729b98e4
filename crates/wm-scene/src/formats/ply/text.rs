//! ASCII bodies: one row per line.

use super::{
    header::{Element, Header, Kind},
    layout::{Array, Layout, put, residue, values},
    rows::Rows,
};
use wm_base::{
    error::{FormatError, Problem, number},
    source::Source,
};

/// Reads the splats that follow the header. Empty lines are stepped over.
///
/// # Errors
/// With the line, if it has too few or too many values or one that is no number.
pub(super) fn read(source: &mut Source, header: &Header, layout: &Layout) -> Result<Rows, FormatError> {
    let vertex = &header.elements[layout.element];
    let promised = vertex.count;
    for element in &header.elements[..layout.element] {
        let mut rows = if element.properties.is_empty() { 0 } else { element.count };
        while rows > 0 {
            match source.skip_line()? {
                None => return Err(source.whole(Problem::TruncatedText { promised, found: 0 })),
                Some(0) => {}
                Some(_) => rows -= 1,
            }
        }
    }
    let mut kept = vec![None; vertex.properties.len()];
    for (index, column) in layout.columns.iter().enumerate() {
        kept[column.property] = Some(index);
    }
    let mut numbers = vec![0.0; layout.columns.len()];
    let is_position: Vec<bool> = layout.columns.iter().map(|column| column.array == Array::Means).collect();
    let mut read = Rows::zeroed(0, layout);
    let mut done: u64 = 0;
    while done < promised {
        let Some(line) = source.line()? else {
            return Err(source.whole(Problem::TruncatedText { promised, found: done }));
        };
        if line.trim_ascii().is_empty() {
            continue;
        }
        let parsed = parse(line, vertex, &kept, &is_position, &mut numbers);
        if let Err(problem) = parsed {
            return Err(if source.is_cut() {
                source.whole(Problem::TruncatedText { promised, found: done })
            } else {
                source.at_line(problem)
            });
        }
        read.grow(layout, done + 1, promised);
        let index = done as usize;
        for (column, number) in layout.columns.iter().zip(&numbers) {
            if !column.array.is_numbers() {
                put(&mut read.splats, column.array, index, *number as f32)
                    .map_err(|problem| source.at_line(problem))?;
            } else {
                let (values, stride) = values(&mut read, column.array);
                values[index * stride + column.lane] = *number as f32;
                if column.array == Array::Means {
                    read.residues[index][column.lane] = residue(*number);
                }
            }
        }
        done += 1;
    }
    Ok(read)
}

/// Reads the values of one row that are `kept` into `numbers`, in the order of the columns; those
/// that are positions as finely as they are written, others as f32.
fn parse(
    line: &[u8],
    vertex: &Element,
    kept: &[Option<usize>],
    is_position: &[bool],
    numbers: &mut [f64],
) -> Result<(), Problem> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    for (property, kept) in vertex.properties.iter().zip(kept) {
        let word = words.next().ok_or_else(too_few)?;
        if let Some(column) = kept {
            numbers[*column] = match is_position[*column] {
                true => number(word, &property.name)?,
                false => f64::from(number::<f32>(word, &property.name)?),
            };
        } else if matches!(property.kind, Kind::List { .. }) {
            let length: usize = number(word, &property.name)?;
            if length > 0 {
                words.nth(length - 1).ok_or_else(too_few)?;
            }
        }
    }
    if words.next().is_some() {
        let count = vertex.properties.len();
        let reason = format!("there are more values than the {count} properties of a splat");
        return Err(Problem::Value(format!("{reason}; correct the line or export the file again")));
    }
    Ok(())
}

fn too_few() -> Problem {
    Problem::Value("there are too few values for a splat; correct the line or export the file again".into())
}
