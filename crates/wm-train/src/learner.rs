//! The splats of a training and the device that holds them: the computer's memory, or a GPU on
//! which they stay.
//!
//! With a device, the population in memory falls behind and is read back ([`Learner::sync`]) when
//! it is needed: for checkpoints and at the end. Densification does not read everything back: the
//! values that decide are read, and the rest is rearranged on the device.
//!
//! The population in memory is also read back after some hundreds of steps, so that a training goes
//! on from there on the CPU if the GPU fails.

use crate::densify::{self, Population};
use crate::random::Random;
use wm_render::training::{self, Noise, Step};
use wm_render::training::{Compared, Comparison};
use wm_render::{
    Differentiable, ForwardConfig, Frame, Gradients, Learn, RenderError, Resident, StepClock, Target,
    Upstream,
};
use wm_scene::{Camera, Splats};

/// A back end, and the state of its copy of the population.
pub(crate) struct Learner {
    pub(crate) renderer: Box<dyn Differentiable>,
    /// The gradients of a population in memory: the step's, and those of terms with a render of
    /// their own.
    gradients: Gradients,
    own: Gradients,
    device: Device,
    /// The number of splats on the device, if it is ahead.
    count: Option<usize>,
}

/// The contents of the device, relative to the population in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Device {
    /// Not the population.
    Other,
    /// The population.
    Same,
    /// A newer population.
    Ahead,
}

impl Learner {
    /// Returns a learner on a back end.
    pub(crate) fn new(renderer: Box<dyn Differentiable>) -> Self {
        let (gradients, own) = (Gradients::default(), Gradients::default());
        Self { renderer, gradients, own, device: Device::Other, count: None }
    }

    /// Switches to another device after `error`, if there is one, with the population in memory.
    pub(crate) fn give_up(&mut self, error: RenderError) -> Result<(), RenderError> {
        (self.device, self.count) = (Device::Other, None);
        self.renderer.give_up(error)
    }

    /// Returns times by the clock of the device.
    pub(crate) fn clock(&mut self) -> Option<StepClock> {
        self.renderer.resident()?.clock()
    }

    /// Reads the population back; returns true if it was behind.
    pub(crate) fn sync(&mut self, population: &mut Population) -> Result<bool, RenderError> {
        let (Device::Ahead, Some(device)) = (self.device, self.renderer.resident()) else { return Ok(false) };
        // Read into a copy: the old population must stay whole if the device fails halfway.
        let mut now = Population::unsorted(Splats::zeroed(device.count(), population.splats.sh_degree));
        device.read(now.learnt_mut())?;
        *population = now;
        (self.device, self.count) = (Device::Same, None);
        Ok(true)
    }

    /// Returns the number of splats.
    pub(crate) fn count(&self, population: &Population) -> usize {
        self.count.unwrap_or(population.len())
    }

    /// Adds, moves and removes splats. With a device, `change` sees the shapes only, and the
    /// device then rearranges the rest accordingly.
    pub(crate) fn change(
        &mut self,
        population: &mut Population,
        change: impl FnOnce(&mut Population),
    ) -> Result<(), RenderError> {
        let Some(device) = resident(&mut *self.renderer, &mut self.device, population)? else {
            change(population);
            return Ok(());
        };
        let mut shapes = Population::of_shapes(device.shapes()?);
        change(&mut shapes);
        device.rearrange(&shapes.changed())?;
        (self.device, self.count) = (Device::Ahead, Some(shapes.len()));
        Ok(())
    }

    /// Renders the splats.
    pub(crate) fn forward(
        &mut self,
        population: &Population,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<usize, RenderError> {
        let stats = match resident(&mut *self.renderer, &mut self.device, population)? {
            Some(device) => device.forward(camera, config, frame)?,
            None => self.renderer.forward(&population.splats, camera, config, frame)?,
        };
        Ok(stats.visible as usize)
    }

    /// Returns true if [`Self::compare`] can be called.
    pub(crate) fn compares(&mut self) -> bool {
        self.renderer.resident().is_some()
    }

    /// Renders the splats and computes the loss on the device.
    pub(crate) fn compare(
        &mut self,
        population: &Population,
        camera: &Camera,
        config: &ForwardConfig,
        comparison: &Comparison<'_>,
    ) -> Result<(usize, Compared), RenderError> {
        let device = resident(&mut *self.renderer, &mut self.device, population)?.expect("there is a device");
        let (stats, compared) = device.compare(camera, config, comparison)?;
        Ok((stats.visible as usize, compared))
    }

    /// Computes the gradients of the last frame for the step.
    pub(crate) fn backward(
        &mut self,
        population: &Population,
        upstream: &Upstream<'_>,
    ) -> Result<(), RenderError> {
        match self.renderer.resident() {
            Some(device) => device.backward(upstream, Target::Step),
            None => {
                let splats = &population.splats;
                self.renderer.backward(splats, upstream, Learn::ALL, &mut self.gradients)
            }
        }
    }

    /// Computes the gradients of the last frame, another render of the same view, and adds them to
    /// the step's.
    pub(crate) fn add_backward(
        &mut self,
        population: &Population,
        upstream: &Upstream<'_>,
        learn: Learn,
    ) -> Result<(), RenderError> {
        match self.renderer.resident() {
            Some(device) => device.backward(upstream, Target::Added(learn)),
            None => {
                self.renderer.backward(&population.splats, upstream, learn, &mut self.own)?;
                self.gradients.add_parameters(&self.own);
                Ok(())
            }
        }
    }

    /// Takes the optimiser step.
    pub(crate) fn optimize(
        &mut self,
        population: &mut Population,
        step: &Step,
        sums_gradients: bool,
    ) -> Result<(), RenderError> {
        if let Some(device) = self.renderer.resident() {
            self.device = Device::Ahead;
            return device.optimize(step);
        }
        let gradients = &mut self.gradients;
        population.see(&gradients.visible, step.number);
        training::add_terms(&population.splats, &step.terms, gradients);
        if sums_gradients {
            population.pulls.add(gradients, step.size.0, step.size.1);
        }
        training::hold_sky(&population.splats, gradients);
        let Population { splats, moments, .. } = population;
        training::step(self.renderer.path(), splats, moments, gradients, &step.rates, step.number);
        Ok(())
    }

    /// Adds noise to the means of nearly transparent splats.
    pub(crate) fn explore(
        &mut self,
        population: &mut Population,
        noise: &Noise,
        random: Random,
    ) -> Result<(), RenderError> {
        let Some(device) = resident(&mut *self.renderer, &mut self.device, population)? else {
            densify::explore(population, noise, random);
            return Ok(());
        };
        self.device = Device::Ahead;
        device.explore(noise)
    }
}

/// Returns the device, if there is one, with the population loaded.
fn resident<'a>(
    renderer: &'a mut dyn Differentiable,
    state: &mut Device,
    population: &Population,
) -> Result<Option<&'a mut dyn Resident>, RenderError> {
    let Some(device) = renderer.resident() else { return Ok(None) };
    if *state == Device::Other {
        device.load(population.learnt())?;
        *state = Device::Same;
    }
    Ok(Some(device))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::densify::adaptive::AdaptiveConfig;
    use crate::densify::mcmc::McmcConfig;
    use crate::densify::{DensifyStrategy, DensifyTime};
    use crate::random::Purpose;
    use wm_render::GpuDifferentiable;
    use wm_render::testing::{Backend, fallible_differentiable, random_splats, small_gpu, threads, uniform};
    use wm_scene::Group;

    /// Splats with something known of each number of theirs.
    fn population(degree: u8) -> Population {
        let mut population = Population::new(random_splats(900, degree, 5));
        let count = population.len();
        let number = |seed: u64, i: usize| uniform(seed, i as u64) as f32;
        for (pair, width) in population.moments.arrays(degree) {
            for (seed, array) in [(7, &mut pair.first), (8, &mut pair.second)] {
                array.iter_mut().enumerate().for_each(|(i, value)| *value = number(seed, i * 5 + width));
            }
        }
        let logits = population.splats.logit_opacities.iter_mut().enumerate();
        logits.for_each(|(i, logit)| *logit = 12.0 * number(9, i) - 8.0);
        population.splats.groups.iter_mut().step_by(11).for_each(|group| *group = Group::Sky);
        population.pulls.sums = (0..count).map(|i| 2e-3 * number(10, i)).collect();
        population.pulls.counts.fill(3.0);
        population.seen = (0..count).map(|i| 80 + (i % 20) as u32).collect();
        population
    }

    #[test]
    fn what_is_known_outlives_the_device() {
        let Some(_) = Backend::gpu() else { return };
        let (renderer, gpu) = fallible_differentiable(|_| {});
        let mut learner = Learner::new(Box::new(renderer));
        let known = population(1);
        let mut left = known.clone();
        learner.change(&mut left, |population| population.copy(&[3, 5])).unwrap();
        assert_eq!(learner.count(&left), known.len() + 2);
        gpu.lose();
        assert!(learner.sync(&mut left).is_err());
        assert!(left == known);
    }

    /// Bit by bit, in one piece and in many.
    #[test]
    fn splats_come_and_go_on_a_device_as_here() {
        let Some(_) = Backend::gpu() else { return };
        let at = |step, extent| {
            let random = Random::new(3, Purpose::Sample, step);
            DensifyTime { step, photos: 4, extent, random }
        };
        let chain = McmcConfig { from: 1, until: 900, every: 10, ..McmcConfig::for_steps(900, 2000) };
        let control = AdaptiveConfig::for_steps(30_000, 2000);
        type Change<'a> = (&'a str, &'a dyn Fn(&mut Population));
        let changes: [Change<'_>; 2] = [
            ("chain", &|population| chain.apply(&at(100, 5.0), population)),
            // With a reset of opacities.
            ("control", &|population| control.apply(&at(3000, 5.0), population)),
        ];
        for (degree, most_binding) in [(2, 100_000_000), (2, 300_000), (0, 90_000)] {
            let gpu = small_gpu(most_binding);
            for (name, change) in &changes {
                let mut wanted = population(degree);
                let mut found = wanted.clone();
                let renderer = GpuDifferentiable::new(gpu.clone(), threads(2)).unwrap();
                let mut learner = Learner::new(Box::new(renderer));
                // Twice: the second time of what was moved.
                for round in 0..2 {
                    let before = wanted.len();
                    change(&mut wanted);
                    assert!(round > 0 || wanted.len() > before, "{name}: {before}");
                    learner.change(&mut found, change).unwrap();
                    assert_eq!(learner.count(&found), wanted.len());
                }
                assert_ne!(found.len(), wanted.len());
                assert!(learner.sync(&mut found).unwrap());
                assert!(found == wanted, "{name}, degree {degree}, {most_binding}");
            }
        }
    }
}
