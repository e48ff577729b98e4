//! Water at one level.

/// Water at one level at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flood {
    /// Height over `ground`, m.
    pub(crate) level: f64,
    /// Height of the ground that the level counts from, over that of the site, m; `None` for that
    /// of the site.
    pub ground: Option<f64>,
    /// Secchi depth, m.
    pub(crate) secchi: f64,
    /// Colour of its own light, linear RGB, the largest 1; `None` for that of its clearness.
    pub(crate) tint: Option<[f64; 3]>,
    /// Water that the wind blows over, m.
    pub(crate) fetch: f64,
    /// Seed of its waves.
    pub(crate) seed: u64,
}

impl Flood {
    /// Height of the water over the ground of the site, m.
    pub(crate) fn height(&self) -> f64 {
        self.level + self.ground.unwrap_or(0.0)
    }
}
