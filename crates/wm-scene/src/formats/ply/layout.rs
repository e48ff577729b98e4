//! The map from the properties of a file to the arrays of [`Splats`].

use super::{
    dialect::{Colors, Dialect},
    header::{Element, Endian, Header, Kind, PlyEncoding, Scalar, missing, property},
    rows::Rows,
};
use crate::splats::LabelKind;
use crate::{Group, Splats, sh};
use wm_base::error::Problem;

/// An array of [`Splats`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Array {
    Means,
    Quats,
    LogScales,
    Opacities,
    Sh,
    /// The 3D filter of Mip-Splatting.
    Filters,
    Groups,
    Names(LabelKind),
}

/// A property that is kept.
#[derive(Debug)]
pub(super) struct Column {
    /// Index among the properties of the element.
    pub(crate) property: usize,
    /// Byte offset in a binary row from which lists are left out.
    offset: usize,
    scalar: Scalar,
    pub(crate) array: Array,
    /// Index among the values that the array has for one splat.
    pub(crate) lane: usize,
}

/// The rows of the vertex element.
#[derive(Debug)]
pub(super) struct Layout {
    /// Place of the vertex element in the header.
    pub(crate) element: usize,
    pub(crate) columns: Vec<Column>,
    /// Bytes of a binary row from which lists are left out.
    pub(crate) row_size: usize,
    pub(crate) dialect: Dialect,
    /// True if positions are finer than f32: in double precision, or text.
    pub(crate) is_fine: bool,
}

impl Rows {
    /// `count` rows of zeros.
    pub(crate) fn zeroed(count: usize, layout: &Layout) -> Self {
        let filters = if layout.dialect.is_filtered { count } else { 0 };
        let residues = if layout.is_fine { count } else { 0 };
        Self {
            splats: Splats::zeroed(count, layout.dialect.sh_degree),
            filters: vec![0.0; filters],
            residues: vec![[0.0; 3]; residues],
        }
    }

    /// Makes room for `count` rows, doubling, but for no more than `promised`.
    pub(crate) fn grow(&mut self, layout: &Layout, count: u64, promised: u64) {
        if count <= self.splats.len() as u64 {
            return;
        }
        let size = promised.min(count.max(2 * self.splats.len() as u64)) as usize;
        self.splats.resize(size);
        if layout.dialect.is_filtered {
            self.filters.resize(size, 0.0);
        }
        if layout.is_fine {
            self.residues.resize(size, [0.0; 3]);
        }
    }
}

impl Layout {
    /// Finds every property that a splat needs.
    ///
    /// # Errors
    /// [`Problem`] names what is missing.
    pub(crate) fn of(header: &Header) -> Result<Self, Problem> {
        let element = header
            .elements
            .iter()
            .position(|e| e.name == "vertex")
            .ok_or_else(|| property("there is no vertex element"))?;
        let vertex = &header.elements[element];
        let dialect = Dialect::of(header, vertex)?;
        let mut wanted: Vec<(String, Array, usize)> = Vec::new();
        let mut want = |names: &[&str], array| {
            wanted.extend(names.iter().enumerate().map(|(lane, name)| ((*name).to_owned(), array, lane)));
        };
        want(&["x", "y", "z"], Array::Means);
        match dialect.colors {
            Colors::Sh => want(&["f_dc_0", "f_dc_1", "f_dc_2"], Array::Sh),
            Colors::Rgb { names, .. } => want(&names, Array::Sh),
            Colors::None => {}
        }
        if dialect.scales > 0 {
            want(&["opacity"], Array::Opacities);
        }
        want(&["scale_0", "scale_1", "scale_2"][..dialect.scales], Array::LogScales);
        if dialect.is_turned {
            want(&["rot_0", "rot_1", "rot_2", "rot_3"], Array::Quats);
        }
        if dialect.is_filtered {
            want(&["filter_3D"], Array::Filters);
        }
        // The file has all of red, then green, then blue; memory has the channels innermost.
        let read = sh::coefficients(dialect.sh_degree) - 1;
        wanted.extend((0..3 * read).map(|i| {
            let (channel, coefficient) = (i / read, i % read);
            let name = format!("f_rest_{}", channel * dialect.rest + coefficient);
            (name, Array::Sh, (coefficient + 1) * 3 + channel)
        }));
        let mut columns = Vec::with_capacity(wanted.len() + 1);
        for (name, array, lane) in wanted {
            let column = find(vertex, &name, array, lane)?;
            columns.push(column.ok_or_else(|| missing(&name))?);
        }
        columns.extend(find(vertex, "group", Array::Groups, 0)?);
        for kind in LabelKind::ALL {
            columns.extend(find(vertex, kind.name(), Array::Names(kind), 0)?);
        }
        let is_fine = header.encoding == PlyEncoding::Ascii || columns.iter().any(Column::is_fine);
        Ok(Self { element, columns, row_size: offset_of(vertex, vertex.properties.len()), dialect, is_fine })
    }

    /// Writes the binary rows `rows`, lists left out, into `out` from row `first` on.
    ///
    /// # Errors
    /// [`Problem`] names a label that is none.
    pub(crate) fn scatter(
        &self,
        endian: Endian,
        rows: &[u8],
        first: usize,
        out: &mut Rows,
    ) -> Result<(), Problem> {
        // Every column runs over the rows once: as many at a time as stay in the first cache.
        let step = (PART_BYTES / self.row_size).max(1);
        let mut numbers = Vec::new();
        for (part, rows) in rows.chunks(step * self.row_size).enumerate() {
            let first = first + part * step;
            let count = rows.len() / self.row_size;
            for column in &self.columns {
                if !column.array.is_numbers() {
                    numbers.clear();
                    numbers.resize(count, 0.0);
                    column.gather(endian, rows, self.row_size, &mut numbers, 1);
                    for (at, number) in numbers.iter().enumerate() {
                        put(&mut out.splats, column.array, first + at, *number)?;
                    }
                } else {
                    let (values, stride) = values(out, column.array);
                    let values = &mut values[first * stride..(first + count) * stride];
                    column.gather(endian, rows, self.row_size, values, stride);
                    if column.is_fine() {
                        let residues = out.residues[first..first + count].as_flattened_mut();
                        column.gather_residues(endian, rows, self.row_size, residues);
                    }
                }
            }
        }
        Ok(())
    }
}

impl Array {
    /// Returns true if it holds what a file holds: numbers that are kept as they are.
    pub(crate) fn is_numbers(self) -> bool {
        !matches!(self, Self::Groups | Self::Names(_))
    }
}

/// Writes the group or the label that a number in a file stands for.
///
/// # Errors
/// [`Problem`] if it is no label.
pub(super) fn put(splats: &mut Splats, array: Array, index: usize, number: f32) -> Result<(), Problem> {
    let Array::Names(kind) = array else {
        splats.groups[index] = group_of(number);
        return Ok(());
    };
    let name = name_of(number).ok_or_else(|| {
        let reason = format!(
            "the {} of splat {index} is {number}: it must be a whole number up to 65535, 0 or below 0 for none; correct it or \
             rename the property",
            kind.name()
        );
        Problem::Value(reason)
    })?;
    let count = splats.len();
    let names = splats.names_mut(kind);
    if names.len() < count {
        names.resize(count, 0);
    }
    names[index] = name;
    Ok(())
}

/// The label of a number in a file; below 0 is none, as many programs write it.
fn name_of(number: f32) -> Option<u16> {
    let is_name = number.fract() == 0.0 && number <= f32::from(u16::MAX);
    is_name.then_some(number.max(0.0) as u16)
}

/// Bytes of rows that are scattered at a time.
const PART_BYTES: usize = 16 << 10;

/// The flat values of an array and how many it has for one splat.
///
/// # Panics
/// For groups and labels, which are no numbers.
pub(super) fn values(rows: &mut Rows, array: Array) -> (&mut [f32], usize) {
    let Rows { splats, filters, .. } = rows;
    let stride = splats.sh_stride();
    match array {
        Array::Means => (splats.means.as_flattened_mut(), 3),
        Array::Quats => (splats.quats.as_flattened_mut(), 4),
        Array::LogScales => (splats.log_scales.as_flattened_mut(), 3),
        Array::Opacities => (&mut splats.logit_opacities, 1),
        Array::Sh => (&mut splats.sh, stride),
        Array::Filters => (filters, 1),
        Array::Groups | Array::Names(_) => panic!("groups and labels are no numbers"),
    }
}

/// The group of a number in a file; a number that no group has is the scene.
fn group_of(number: f32) -> Group {
    let small = number as u8;
    if f32::from(small) == number { Group::from_number(small).unwrap_or_default() } else { Group::default() }
}

/// The rounding error of a number in f32; 0 where it is not finite.
pub(super) fn residue(number: f64) -> f32 {
    let left = number - f64::from(number as f32);
    if left.is_finite() { left as f32 } else { 0.0 }
}

impl Column {
    /// Returns true if it has positions in double precision.
    fn is_fine(&self) -> bool {
        self.array == Array::Means && self.scalar == Scalar::F64
    }

    /// Writes what f32 leaves of this property, which is in double precision, of every row.
    fn gather_residues(&self, endian: Endian, rows: &[u8], row_size: usize, out: &mut [f32]) {
        match endian {
            Endian::Little => self.each(rows, row_size, out, 3, |b| residue(f64::from_le_bytes(b))),
            Endian::Big => self.each(rows, row_size, out, 3, |b| residue(f64::from_be_bytes(b))),
        }
    }

    /// Writes this property of every row to `out[row * stride + lane]`.
    fn gather(&self, endian: Endian, rows: &[u8], row_size: usize, out: &mut [f32], stride: usize) {
        macro_rules! gather {
            ($number:ty) => {
                match endian {
                    Endian::Little => {
                        self.each(rows, row_size, out, stride, |b| <$number>::from_le_bytes(b) as f32)
                    }
                    Endian::Big => {
                        self.each(rows, row_size, out, stride, |b| <$number>::from_be_bytes(b) as f32)
                    }
                }
            };
        }
        match self.scalar {
            Scalar::I8 => gather!(i8),
            Scalar::U8 => gather!(u8),
            Scalar::I16 => gather!(i16),
            Scalar::U16 => gather!(u16),
            Scalar::I32 => gather!(i32),
            Scalar::U32 => gather!(u32),
            Scalar::F32 => gather!(f32),
            Scalar::F64 => gather!(f64),
        }
    }

    /// The inner loop, compiled once for each number type and byte order.
    fn each<const N: usize>(
        &self,
        rows: &[u8],
        row_size: usize,
        out: &mut [f32],
        stride: usize,
        number: impl Fn([u8; N]) -> f32,
    ) {
        let inputs = rows[self.offset..].chunks(row_size);
        let outputs = out[self.lane..].chunks_mut(stride);
        for (input, output) in inputs.zip(outputs) {
            if let Some(bytes) = input.first_chunk() {
                output[0] = number(*bytes);
            }
        }
    }
}

/// The scalar property called `name`.
fn find(element: &Element, name: &str, array: Array, lane: usize) -> Result<Option<Column>, Problem> {
    let mut found = element.properties.iter().enumerate().filter(|(_, p)| p.name == name);
    let Some((index, first)) = found.next() else { return Ok(None) };
    if found.next().is_some() {
        return Err(property(&format!("the property {name} is declared twice")));
    }
    let Kind::Scalar(scalar) = first.kind else {
        return Err(property(&format!("the property {name} is a list, not one number per splat")));
    };
    Ok(Some(Column { property: index, offset: offset_of(element, index), scalar, array, lane }))
}

/// The byte of property `index` in a row from which lists are left out.
fn offset_of(element: &Element, index: usize) -> usize {
    let scalars = element.properties[..index].iter().filter_map(|p| match p.kind {
        Kind::Scalar(scalar) => Some(scalar.size()),
        Kind::List { .. } => None,
    });
    scalars.sum()
}
