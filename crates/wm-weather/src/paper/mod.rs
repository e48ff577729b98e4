//! Weather as the paper has it: over finished pixels, in display-referred colour, by view z.
//!
//! | file | paper | what |
//! |---|---|---|
//! | [`fog`] | III.C | fog, haze and smog over a picture |
//! | [`fall`] | III.D | the noise scene of rain and snow: Gaussians, and their sub-clouds |
//! | [`composite`] | III.D | how renders of sub-clouds are masked and laid over the picture |
//! | [`cover`] | III.E | lying snow: Gaussians added to the scene |
//!
//! Nothing is rendered here. Whoever has a renderer draws the picture, draws each cloud of
//! [`fall::PaperFall::sub_clouds`] by itself over black, gives both to [`composite::add`], farthest
//! first, and ends with [`composite::finish`].

pub mod composite;
pub(crate) mod cover;
pub(crate) mod fall;
pub(crate) mod fog;

pub use composite::PaperStages;
pub use cover::PaperCover;
pub(crate) use fall::PaperFall;
pub(crate) use fog::PaperFog;
