//! WADS, the Winter Adverse Driving dataSet (Kurup and Bos 2021): SemanticKITTI with classes of
//! snow.
//!
//! As [`super::semantic_kitti`], but flakes in the air are `active-snow` (110). Its class of lying
//! snow (111) is not used: a point on snow has the class of what the snow lies on.

use super::Layout;
use super::kitti::{self, KittiNeed};
use super::semantic_kitti::{self, with_classes};

pub(super) const LAYOUT: Layout = Layout {
    name: "wads",
    about: "WADS: SemanticKITTI with flakes in the air as a class of their own (110); no cameras, no radars",
    check: |set| kitti::check("wads", KittiNeed::Lidar, set),
    block: |block| with_classes(block, 110),
    ..semantic_kitti::LAYOUT
};
