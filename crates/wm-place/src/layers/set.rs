//! Layers by name, and sets of them.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};
use std::str::FromStr;

macro_rules! names {
    ($($(#[$doc:meta])* $layer:ident $set:ident $name:literal = $row:expr;)+) => {
        /// A layer of a picture.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum PictureLayer {
            $($(#[$doc])* $layer,)+
        }

        impl PictureLayer {
            const ALL: &[Self] = &[$(Self::$layer),+];

            /// Returns the name, as in `--also`.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$layer => $name),+ }
            }
        }

        impl Layers {
            $($(#[$doc])* pub const $set: Self = Self::one(PictureLayer::$layer);)+
        }
    };
}

layers!(names);

impl PictureLayer {
    /// Returns all layers.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        Self::ALL.iter().copied()
    }

    /// Returns the layer of a name among some; the error lists their names.
    pub(crate) fn find(text: &str, among: impl Iterator<Item = Self> + Clone) -> Result<Self, String> {
        among.clone().find(|layer| layer.name() == text).ok_or_else(|| {
            let names: Vec<&str> = among.map(Self::name).collect();
            let (last, most) = names.split_last().expect("there are layers");
            format!("`{text}` is not a picture output: use {} or {last}", most.join(", "))
        })
    }
}

impl fmt::Display for PictureLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PictureLayer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.contains('.') {
            return Err(format!("`{text}`: a layer in memory has no format; leave out the extension"));
        }
        Self::find(text, PictureLayer::all())
    }
}

/// A set of layers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Layers(u32);

impl Layers {
    /// No layer.
    pub const NONE: Self = Self(0);
    /// The steps between the clear picture and the last of the paper's rain and snow:
    /// [`Picture::stages`](crate::Picture::stages).
    pub const PAPER_STAGES: Self = Self(1 << 31);

    const fn one(layer: PictureLayer) -> Self {
        Self(1 << layer as u32)
    }

    /// Returns true if all layers of `other` are in the set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the layers of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the set without those of another.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the layers of the set.
    pub fn iter(self) -> impl Iterator<Item = PictureLayer> {
        PictureLayer::all().filter(move |layer| self.contains((*layer).into()))
    }
}

impl Default for Layers {
    /// The colour alone.
    fn default() -> Self {
        Self::COLOR
    }
}

impl From<PictureLayer> for Layers {
    fn from(layer: PictureLayer) -> Self {
        Self::one(layer)
    }
}

impl BitOr for Layers {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        self.with(other)
    }
}

impl BitOrAssign for Layers {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl FromIterator<PictureLayer> for Layers {
    /// These layers alone, without the colour if it is not among them.
    fn from_iter<T: IntoIterator<Item = PictureLayer>>(layers: T) -> Self {
        layers.into_iter().fold(Self::NONE, |set, layer| set | layer.into())
    }
}

impl fmt::Debug for Layers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stages = self.contains(Self::PAPER_STAGES).then_some("paper-stages");
        f.debug_set().entries(self.iter().map(PictureLayer::name).chain(stages)).finish()
    }
}
