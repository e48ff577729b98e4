//! Reports of steps: losses, splats, times.

/// The report of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    /// The sum of the terms with their weights.
    pub loss: f64,
    /// Each term's name and value before weighting.
    pub terms: Vec<(&'static str, f64)>,
    /// Splats in view.
    pub visible: usize,
    /// Steps that were lost with a device: the training goes on without it after those that are
    /// left.
    pub lost: u32,
    /// The times of its parts.
    pub times: StepTimes,
}

/// Wall time of the parts of a step, seconds. A GPU is told what to do and waited for where
/// pictures are read: most of its time for a step is in the forward passes that follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Rendering.
    pub forward: f64,
    /// Comparing.
    pub loss: f64,
    /// Deriving.
    pub backward: f64,
    /// Renders of single terms.
    pub own: f64,
    /// Moving.
    pub optimizer: f64,
    /// Splats that come and go.
    pub densify: f64,
}

impl StepTimes {
    /// The sum of it all.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.forward + self.loss + self.backward + self.own + self.optimizer + self.densify
    }

    /// Adds another step's.
    pub fn add(&mut self, other: &Self) {
        self.forward += other.forward;
        self.loss += other.loss;
        self.backward += other.backward;
        self.own += other.own;
        self.optimizer += other.optimizer;
        self.densify += other.densify;
    }
}
