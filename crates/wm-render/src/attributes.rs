//! Numbers that each splat has in one pass alone: weather changes them from frame to frame without
//! a rebuild of the set.
//!
//! [`Attribute`] lists the columns, once for both back ends: a block holds one array a column, and
//! WGSL gets the number of columns and their places from here ([`crate::gpu`]). A new column is a
//! variant of [`Attribute`], its neutral value, and the stage that reads it. Sets without
//! attributes pay nothing.

use crate::sizes::{CLUSTER, GROUP};

/// A number that each splat has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attribute {
    /// A factor on the opacity, 0-1.
    Visibility,
    /// A factor on the red light, 0 or more; see the contract of [`crate::stages::shade`].
    GainRed,
    /// Factor of the splat's green light, 0 or more.
    GainGreen,
    /// Factor of the splat's blue light, 0 or more.
    GainBlue,
    /// The share of a colour's dependence on the direction that is taken away, 0-1; see the
    /// contract of [`crate::stages::shade`].
    Fade,
}

impl Attribute {
    /// Every attribute, in the order of the columns.
    pub(crate) const ALL: [Self; 5] =
        [Self::Visibility, Self::GainRed, Self::GainGreen, Self::GainBlue, Self::Fade];
    /// The factors on the light, by channel.
    pub const GAINS: [Self; 3] = [Self::GainRed, Self::GainGreen, Self::GainBlue];
    /// The number of columns.
    pub(crate) const COUNT: usize = Self::ALL.len();

    /// The value that changes nothing.
    pub(crate) const fn neutral(self) -> f32 {
        match self {
            Self::Visibility | Self::GainRed | Self::GainGreen | Self::GainBlue => 1.0,
            Self::Fade => 0.0,
        }
    }

    /// The name of the column's number in WGSL.
    #[cfg(feature = "gpu")]
    pub(crate) const fn wgsl_name(self) -> &'static str {
        match self {
            Self::Visibility => "ATTRIBUTE_VISIBILITY",
            Self::GainRed => "ATTRIBUTE_GAIN_RED",
            Self::GainGreen => "ATTRIBUTE_GAIN_GREEN",
            Self::GainBlue => "ATTRIBUTE_GAIN_BLUE",
            Self::Fade => "ATTRIBUTE_FADE",
        }
    }
}

/// The attributes of the splats of one set.
pub trait SplatAttributes: Sync {
    /// Writes the attributes of splat `indices[i]` (index in the loaded splats) to row `i` of the
    /// columns that it changes, all but those of light; the others are neutral already. There are
    /// at most [`AttributeBlock::MAX_SPLATS`] indices.
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock);

    /// Returns true if [`Self::fill`] changes [`Attribute::Visibility`]; else it need not be
    /// called.
    fn changes_visibility(&self) -> bool {
        true
    }

    /// Writes [`Attribute::GAINS`] and [`Attribute::Fade`] in the same way, if
    /// [`Self::changes_light`]. Called for splats in view only.
    fn fill_light(&self, _indices: &[u32], _block: &mut AttributeBlock) {}

    /// Returns true if it changes [`Attribute::GAINS`] or [`Attribute::Fade`]; else they are not
    /// read.
    fn changes_light(&self) -> bool {
        false
    }

    /// A number that stands for all that the columns hold: two passes with equal numbers have equal
    /// columns, and a GPU uploads them once. `None` where they change from frame to frame.
    fn revision(&self) -> Option<Revision> {
        None
    }
}

/// A hash of the columns of [`SplatAttributes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Revision(u64);

impl Default for Revision {
    /// Makes the revision of an empty list.
    fn default() -> Self {
        Self(0x9e37_79b9_7f4a_7c15)
    }
}

impl Revision {
    /// The hash of words, in order: of numbers their bits.
    #[must_use]
    pub fn of(words: impl IntoIterator<Item = u32>) -> Self {
        words.into_iter().fold(Self::default(), |hash, word| hash.with(word.into()))
    }

    /// The hash of this and another one.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        self.with(other.0)
    }

    /// Mixes a word in by a product with the golden ratio, whose high bits come down.
    fn with(self, word: u64) -> Self {
        let mixed = (self.0 ^ word).wrapping_mul(Self::default().0);
        Self(mixed ^ mixed >> 32)
    }
}

/// The attributes of up to 256 splats, one array a column.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct AttributeBlock {
    columns: [[[f32; GROUP]; CLUSTER / GROUP]; Attribute::COUNT],
}

impl Default for AttributeBlock {
    fn default() -> Self {
        Self { columns: Attribute::ALL.map(|attribute| [[attribute.neutral(); GROUP]; CLUSTER / GROUP]) }
    }
}

impl AttributeBlock {
    /// Most splats of a block.
    pub const MAX_SPLATS: usize = CLUSTER;

    /// One column, a number per splat.
    #[inline]
    #[must_use]
    pub fn column(&self, attribute: Attribute) -> &[f32] {
        self.columns[attribute as usize].as_flattened()
    }

    /// One column, to be written.
    #[inline]
    pub fn column_mut(&mut self, attribute: Attribute) -> &mut [f32] {
        self.columns[attribute as usize].as_flattened_mut()
    }

    /// The columns of [`Attribute::GAINS`], to be written.
    #[inline]
    pub fn gains_mut(&mut self) -> [&mut [f32]; 3] {
        // In the order of `Attribute::ALL`.
        let [_, red, green, blue, _] = &mut self.columns;
        [red, green, blue].map(|column| column.as_flattened_mut())
    }

    /// One column of sixteen splats.
    #[inline(always)]
    pub(crate) fn group(&self, group: usize, attribute: Attribute) -> &[f32; GROUP] {
        &self.columns[attribute as usize][group]
    }

    /// Reads the attributes of these splats.
    #[cfg(any(test, feature = "gpu"))]
    #[inline]
    pub(crate) fn read(&mut self, attributes: &dyn SplatAttributes, indices: &[u32]) {
        self.read_visibility(attributes, indices);
        self.read_light(attributes, indices);
    }

    /// Reads the visibility alone; the columns of light are not changed.
    #[inline]
    pub(crate) fn read_visibility(&mut self, attributes: &dyn SplatAttributes, indices: &[u32]) {
        self.column_mut(Attribute::Visibility).fill(Attribute::Visibility.neutral());
        attributes.fill(indices, self);
    }

    /// Reads the columns of light alone.
    #[inline]
    pub(crate) fn read_light(&mut self, attributes: &dyn SplatAttributes, indices: &[u32]) {
        for column in Attribute::GAINS.into_iter().chain([Attribute::Fade]) {
            self.column_mut(column)[..indices.len()].fill(column.neutral());
        }
        attributes.fill_light(indices, self);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Odd;

    impl SplatAttributes for Odd {
        fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
            for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
                *factor = (index % 2) as f32;
            }
        }
    }

    #[test]
    fn a_block_is_neutral_where_nothing_is_written() {
        let mut block = AttributeBlock::default();
        block.read(&Odd, &[3; 256]);
        block.read(&Odd, &[0, 1, 4]);
        let column = block.column(Attribute::Visibility);
        assert_eq!(column[..4], [0.0, 1.0, 0.0, Attribute::Visibility.neutral()]);
        assert_eq!(block.group(0, Attribute::Visibility)[..], column[..GROUP]);
    }
}
