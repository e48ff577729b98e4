//! WADS, the Winter Adverse Driving dataSet (Kurup and Bos 2021): SemanticKITTI with classes of
//! snow.
//!
//! As [`super::semantic_kitti`], but flakes in the air are `active-snow` (110). Its class of lying
//! snow (111) is not used: a point on snow has the class of what the snow lies on.

use super::semantic_kitti::SemanticKitti;

pub(super) const LAYOUT: SemanticKitti = SemanticKitti {
    name: "wads",
    about: "WADS: SemanticKITTI with flakes in the air as a class of their own (110); no cameras, no radars",
    snowflake: 110,
};
