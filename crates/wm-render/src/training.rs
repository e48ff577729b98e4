//! The device's side of training: losses of rendered pictures, and the optimiser's steps.
//!
//! A trainer describes the loss of a picture as a [`Comparison`] and a step of the optimiser as a
//! [`Step`]; [`crate::Resident`] carries both out on the device that holds the splats. The
//! contracts are those of the stages `compare` and `optimize`.

pub use crate::stages::compare::{
    C1, C2, COVERAGE_TOLERANCE, Compared, Comparison, DEVIATION_FLOOR, EDGE_CONTRAST, Exposure, GridPriors,
    MIN_COVERAGE, MIN_PATCH_PIXELS, MIN_RELATIVE_SIGMA, NO_EXPOSURE, Patches, PixelPrior, Term,
    WINDOW_RADIUS_PX, WINDOW_WEIGHTS,
};
pub use crate::stages::optimize::cpu::{add_terms, hold_sky, step};
pub use crate::stages::optimize::{
    Changed, DensifyStats, Learnt, LearntMut, Moments, Noise, Origin, Rates, Shapes, SplatTerms, Step,
};
pub use crate::stages::project::MIN_ALPHA;
