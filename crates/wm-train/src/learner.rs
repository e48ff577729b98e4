//! Where the splats of a training learn: in the computer's memory, or on a device on which they stay.
//!
//! On a device the population here falls behind, and is brought up to date ([`Learner::sync`]) when something asks for
//! it: splats that come and go, checkpoints, the end.

use crate::densify::Population;
use crate::densify::mcmc::McmcConfig;
use crate::random::Random;
use wm_render::stages::compare::{Compared, Comparison};
use wm_render::stages::optimize::{Step, cpu};
use wm_render::{
    Differentiable, ForwardConfig, Frame, Gradients, Learn, RenderError, Resident, StepClock, Target,
    Upstream,
};
use wm_scene::Camera;

/// Whether pulls are added up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pulled {
    /// For who asks for them.
    Counted,
    /// No one asks.
    Ignored,
}

/// A back end, and what it knows of the population.
pub struct Learner {
    renderer: Box<dyn Differentiable>,
    /// Of a population in the computer's memory, the step's and those of terms with a render of their own.
    gradients: Gradients,
    own: Gradients,
    device: Device,
}

/// What the device has, where there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Device {
    /// Something else than the population.
    Other,
    /// The population.
    Same,
    /// The population and what was learnt since.
    Ahead,
}

impl Learner {
    /// On a back end.
    pub fn new(renderer: Box<dyn Differentiable>) -> Self {
        Self { renderer, gradients: Gradients::default(), own: Gradients::default(), device: Device::Other }
    }

    /// The back end.
    pub fn renderer(&self) -> &dyn Differentiable {
        &*self.renderer
    }

    /// Goes on with another device after `error`, if there is one: with the population as it was last known here.
    pub fn give_up(&mut self, error: RenderError) -> Result<(), RenderError> {
        self.device = Device::Other;
        self.renderer.give_up(error)
    }

    /// Times by the device's clock.
    pub fn clock(&mut self) -> Option<StepClock> {
        self.renderer.resident()?.clock()
    }

    /// Brings the population up to date; whether it was behind.
    pub fn sync(&mut self, population: &mut Population) -> Result<bool, RenderError> {
        let (Device::Ahead, Some(device)) = (self.device, self.renderer.resident()) else { return Ok(false) };
        device.read(population.learnt_mut())?;
        self.device = Device::Same;
        Ok(true)
    }

    /// Tells that the population was changed here.
    pub fn changed(&mut self) {
        self.device = Device::Other;
    }

    /// Renders what was learnt so far.
    pub fn forward(
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

    /// Whether [`Self::compare`] is there.
    pub fn compares(&mut self) -> bool {
        self.renderer.resident().is_some()
    }

    /// Renders what was learnt so far and compares its colours where they are, on a device.
    pub fn compare(
        &mut self,
        population: &Population,
        camera: &Camera,
        config: &ForwardConfig,
        comparison: &Comparison<'_>,
        frame: &mut Frame,
    ) -> Result<(usize, Compared), RenderError> {
        let device = resident(&mut *self.renderer, &mut self.device, population)?.expect("there is a device");
        let (stats, compared) = device.compare(camera, config, comparison, frame)?;
        Ok((stats.visible as usize, compared))
    }

    /// Derives the last frame for the step.
    pub fn backward(&mut self, population: &Population, upstream: &Upstream<'_>) -> Result<(), RenderError> {
        match self.renderer.resident() {
            Some(device) => device.backward(upstream, Target::Step),
            None => {
                let splats = &population.splats;
                self.renderer.backward(splats, upstream, Learn::ALL, &mut self.gradients).map(|_| ())
            }
        }
    }

    /// Derives the last frame, another of the same view, and adds it to the step.
    pub fn add_backward(
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

    /// Takes the step.
    pub fn optimize(
        &mut self,
        population: &mut Population,
        step: &Step,
        pulled: Pulled,
    ) -> Result<(), RenderError> {
        if let Some(device) = self.renderer.resident() {
            self.device = Device::Ahead;
            return device.optimize(step);
        }
        let gradients = &mut self.gradients;
        population.see(&gradients.visible, step.number);
        cpu::add_terms(&population.splats, &step.terms, gradients);
        if pulled == Pulled::Counted {
            population.pulls.add(gradients, step.size.0, step.size.1);
        }
        cpu::hold_sky(&population.splats, gradients);
        let Population { splats, moments, .. } = population;
        cpu::step(self.renderer.path(), splats, moments, gradients, &step.rates, step.number);
        Ok(())
    }

    /// Moves what is nearly transparent at random: by `rate`, the step length of means, in a scene of `extent`.
    pub fn explore(
        &mut self,
        population: &mut Population,
        chain: &McmcConfig,
        (rate, extent): (f64, f64),
        random: Random,
    ) -> Result<(), RenderError> {
        let Some(device) = resident(&mut *self.renderer, &mut self.device, population)? else {
            chain.explore(population, rate, extent, random);
            return Ok(());
        };
        self.device = Device::Ahead;
        device.explore(&chain.noise_at(rate, extent, random))
    }
}

/// The device, if there is one, with the population on it.
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
