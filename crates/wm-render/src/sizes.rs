//! Numbers of splats and pixels that are worked on together.

/// Splats in a [`ShadeGroup`](crate::hooks::ShadeGroup).
pub const GROUP: usize = 16;

/// Groups in a cluster.
pub(crate) const GROUPS_PER_CLUSTER: usize = 16;
/// Splats that are culled and shaded together: neighbours in space.
pub(crate) const CLUSTER: usize = GROUPS_PER_CLUSTER * GROUP;

/// Side of a patch of pixels, the unit of pixel effects.
pub const PATCH: usize = 16;
/// Pixels of a patch.
pub const PATCH_PIXELS: usize = PATCH * PATCH;
