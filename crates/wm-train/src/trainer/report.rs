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
    /// Steps that were lost with a device.
    pub lost: u32,
    /// The times of its parts.
    pub times: StepTimes,
}

/// Wall time of the parts of a step, seconds. GPU work is asynchronous and waited for when images
/// are read, so most of its time shows up in the next forward pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Forward passes.
    pub forward: f64,
    /// Loss terms.
    pub loss: f64,
    /// Backward passes.
    pub backward: f64,
    /// Renders of single loss terms.
    pub own: f64,
    /// Optimiser.
    pub optimizer: f64,
    /// Densification.
    pub densify: f64,
}

impl StepTimes {
    /// Returns the sum of all parts.
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
