//! The purposes for which a training draws random numbers; the generator is [`wm_base::random`].

pub(crate) use wm_base::random::RandomStream as Random;

/// The purpose of a training's random numbers. Each has a stream of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// The order of the photos.
    Order = 1,
    /// The positions of the first splats.
    Start = 2,
    /// The choice of the splats that are copied.
    Sample = 3,
    /// The noise of exploration.
    Noise = 4,
    /// The background colour.
    Background = 5,
    /// The sizes of the patches in which depths are compared.
    Patch = 6,
}

impl From<Purpose> for u64 {
    fn from(purpose: Purpose) -> Self {
        purpose as Self
    }
}
