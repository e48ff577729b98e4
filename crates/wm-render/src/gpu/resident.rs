//! Splats that learn on the GPU: they stay there with what the optimiser remembers, and only
//! pictures and a loss's derivatives by these cross over.

use super::buffers::READ_BACK;
use super::device::{Gpu, WRITTEN};
use super::differentiable::{ForwardTarget, GpuDifferentiable, Last};
use super::error::GpuError;
use super::recorder::{Recorder, Stage};
use super::stored::StoredModel;
use super::uniforms::{self, UNIFORM_SLOT_BYTES, Uniform, bytes_of};
use crate::differentiable::{ForwardConfig, Opacity, Resident, StepClock, Target, Upstream};
use crate::error::RenderError;
use crate::frame::Frame;
use crate::renderer::Stats;
use crate::stages::compare::{Compared, Comparison};
use crate::stages::optimize::gpu::{add, explore, optimize};
use crate::stages::optimize::{Changed, Learnt, LearntMut, Noise, Shapes, Step};
use std::sync::Arc;
use wm_scene::{Camera, Splats};

impl GpuDifferentiable {
    /// Checks `splats` and makes the model hold them by `change`.
    fn replace(
        &mut self,
        splats: &Splats,
        change: impl FnOnce(&mut StoredModel, &Gpu) -> Result<(), GpuError> + Send,
    ) -> Result<(), RenderError> {
        splats.check()?;
        self.gpu.check()?;
        self.forget();
        self.rows.last = None;
        let (pool, gpu) = (Arc::clone(&self.pool), Arc::clone(&self.gpu));
        Ok(pool.install(|| change(&mut self.model, &gpu))?)
    }

    /// Submits what `record` does with the pieces of the splats; `structure` is in slot 0.
    fn submit_over_pieces(
        &mut self,
        stage: Stage,
        structure: Uniform,
        config: &ForwardConfig,
        record: impl Fn(&Self, &mut Recorder<'_>),
    ) -> Result<(), RenderError> {
        let gpu = Arc::clone(&self.gpu);
        let mut structures = vec![structure];
        structures.extend(self.model.uniforms(config));
        let uniforms = self.rows.uniforms.structures(&gpu, &structures)?;
        let mut recorder = Recorder::new(&gpu, &uniforms, self.clock.as_ref());
        recorder.begin(stage);
        record(self, &mut recorder);
        recorder.submit();
        Ok(gpu.check()?)
    }
}

impl Resident for GpuDifferentiable {
    fn load(&mut self, learnt: Learnt<'_>) -> Result<(), RenderError> {
        self.replace(learnt.splats, |model, gpu| model.write_learnt(gpu, learnt))
    }

    fn count(&self) -> usize {
        self.model.len()
    }

    fn shapes(&mut self) -> Result<Shapes, RenderError> {
        self.gpu.check()?;
        let (pool, gpu) = (Arc::clone(&self.pool), Arc::clone(&self.gpu));
        Ok(pool.install(|| self.model.read_shapes(&gpu, &mut self.memory.staging))?)
    }

    fn rearrange(&mut self, changed: &Changed<'_>) -> Result<(), RenderError> {
        self.replace(changed.splats, |model, gpu| model.rearrange(gpu, changed))
    }

    fn read(&mut self, learnt: LearntMut<'_>) -> Result<(), RenderError> {
        self.gpu.check()?;
        Ok(self.model.read_learnt(&self.gpu, &mut self.memory.staging, learnt)?)
    }

    fn forward(
        &mut self,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        assert!(self.model.learns(), "splats are loaded first");
        config.check_view(self.model.sh_degree, camera, frame)?;
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.forward_on_pool(camera, config, ForwardTarget::Read(frame)))
            .map(|(stats, _)| stats)
    }

    fn compare(
        &mut self,
        camera: &Camera,
        config: &ForwardConfig,
        comparison: &Comparison<'_>,
    ) -> Result<(Stats, Compared), RenderError> {
        assert!(self.model.learns(), "splats are loaded first");
        let pixels = camera.width as usize * camera.height as usize;
        assert_eq!(comparison.rgb.len(), 3 * pixels, "a photo of the picture's size");
        config.check_camera(self.model.sh_degree, camera)?;
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.forward_on_pool(camera, config, ForwardTarget::Compared(comparison)))
    }

    fn backward(&mut self, upstream: &Upstream<'_>, target: Target) -> Result<(), RenderError> {
        let gpu = Arc::clone(&self.gpu);
        gpu.check()?;
        let capacity = self.capacity;
        let view = self.last.as_ref().expect("a backward pass follows a forward pass");
        upstream.check(view.camera.width as usize * view.camera.height as usize, view.config.channels);
        match target {
            Target::Step => {
                let ForwardConfig { channels, opacity, .. } = view.config;
                assert!(channels.has_color() && opacity == Opacity::Stored, "a step is of everything");
                let [gradients, by_sh, blocks] = &mut self.rows.kept;
                let bytes = view.row_bytes(capacity);
                let last = Last {
                    config: view.config,
                    gradients: gradients.fit(&gpu, "gradients", bytes.0, READ_BACK)?,
                    by_sh: by_sh.fit(&gpu, "gradients of colours", bytes.1, READ_BACK)?,
                    blocks: blocks.fit(&gpu, "blocks of splats", view.room.lists.blocks.size(), WRITTEN)?,
                };
                let to = (&last.gradients, &last.by_sh);
                let mut recorder =
                    view.record_backward(&gpu, self.clock.as_ref(), &self.model, upstream, to.0, to.1);
                let size = view.room.lists.blocks.size();
                recorder.encoder().copy_buffer_to_buffer(&view.room.lists.blocks, 0, &last.blocks, 0, size);
                recorder.submit();
                self.rows.last = Some(last);
            }
            Target::Added(learn) => {
                let last = self.rows.last.as_ref().expect("it is added to the gradients of a step");
                let learn = uniforms::learn(view.config.learns(learn));
                // The structure `Learn`.
                let (slot, other) =
                    (super::lists::FIRST_PIECE_SLOT + self.model.parts.len() + 1, view.rows());
                gpu.write(&view.room.uniforms, UNIFORM_SLOT_BYTES * slot as u64, &bytes_of(&[learn]));
                let to = (other.gradients, other.by_sh);
                let mut recorder = view.record_backward(&gpu, None, &self.model, upstream, to.0, to.1);
                let learn = recorder.uniform(slot);
                for piece in self.model.pieces(&recorder, super::lists::FIRST_PIECE_SLOT) {
                    add(&mut recorder, &piece, other, last.rows(), learn.clone());
                }
                recorder.submit();
            }
        }
        Ok(gpu.check()?)
    }

    fn optimize(&mut self, step: &Step) -> Result<(), RenderError> {
        let last = self.rows.last.take().expect("it moves along the gradients of a step");
        let structure = uniforms::optimize_step(step, self.model.len());
        self.submit_over_pieces(Stage::Optimize, structure, &last.config, |this, recorder| {
            let pieces = this.model.pieces(recorder, 1);
            for (piece, remembered) in pieces.iter().zip(this.model.remembered()) {
                let step = recorder.uniform(0);
                optimize(recorder, piece, last.rows(), remembered, step);
            }
        })
    }

    fn clock(&self) -> Option<StepClock> {
        self.step_clock()
    }

    fn explore(&mut self, noise: &Noise) -> Result<(), RenderError> {
        let config = ForwardConfig::default();
        self.submit_over_pieces(Stage::Explore, uniforms::noise(noise), &config, |this, recorder| {
            for piece in this.model.pieces(recorder, 1) {
                let noise = recorder.uniform(0);
                explore(recorder, &piece, noise);
            }
        })
    }
}
