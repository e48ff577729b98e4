//! Rays on the GPU. The packets are the CPU's; splats find those whose cones they touch as splats
//! of a frame find tiles: counted, sorted by distance, written, sorted by packet. A workgroup
//! blends a packet, with a thread per ray.

use super::packets::{CHILDREN, PACKET};
use super::records::{CONE_TOLERANCE_SHARE, RayRecord};
use super::walk::{HITS_PER_RAY, MAX_HIT_TRANSMITTANCE};
use super::{MIN_HIT_COVERAGE, RayOutputs, STOPPED_COVERAGE};
use crate::gpu::buffers::Lists;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{Program, VISIBLE_GROUPS, WORKGROUP};
use crate::stages::prefix_sum::gpu::WORKGROUP_SUMS;
use wm_scene::Splats;

/// Words of `RayRecord`.
pub(crate) const RECORD_WORDS: usize = 16;
/// The word that names the splat.
pub(crate) const RECORD_INDEX: usize = 11;
/// Words of a ray that the GPU reads.
pub(crate) const RAY_WORDS: usize = 8;
/// Words of `Cone`.
pub(crate) const CONE_WORDS: usize = 8;
/// Words of a ray's result before its sums: coverage, distance, splat, value.
pub(crate) const HIT_WORDS: usize = 4;

impl RayOutputs {
    /// Numbers of a splat that are blended beside coverage: colours, then normals.
    pub(crate) fn features(self) -> usize {
        3 * (usize::from(self.color) + usize::from(self.normal))
    }

    /// The constants of the programs that blend them, as WGSL.
    fn switches(self) -> String {
        let (Self { color, normal, .. }, features) = (self, self.features());
        format!("const COLOR = {color};\nconst NORMAL = {normal};\nconst FEATURES = {features}u;")
    }
}

/// Counts or writes the packets that each splat touches.
pub(crate) fn touch_program() -> Program {
    Program::new("touch", &[WORKGROUP_SUMS, RECORDS, include_str!("touch.wgsl")]).with(constants())
}

/// Lists the splats that touch any.
pub(crate) fn visible_program() -> Program {
    Program::new("visible", &[WORKGROUP_SUMS, RECORDS, include_str!("visible.wgsl")]).with(constants())
}

/// Adds up the packets of 256 listed splats.
pub(crate) fn sums_program() -> Program {
    Program::new("sum_counts", &[WORKGROUP_SUMS, RECORDS, include_str!("sums.wgsl")]).with(constants())
}

/// Finds the colours and normals of the listed splats.
pub(crate) fn features_program(asked: RayOutputs) -> Program {
    Program::new("see", &[RECORDS, include_str!("features.wgsl")]).with(constants()).with(asked.switches())
}

/// Blends the lists of packets.
pub(crate) fn blend_program(asked: RayOutputs) -> Program {
    Program::new("blend", &[RECORDS, include_str!("blend.wgsl")]).with(constants()).with(asked.switches())
}

const RECORDS: &str = include_str!("records.wgsl");

/// The constants of this stage, as WGSL.
fn constants() -> String {
    let bits = CHILDREN.trailing_zeros();
    format!(
        "const PACKET = {PACKET}u;\nconst CHILDREN = {CHILDREN}u;\nconst CHILD_BITS = {bits}u;\nconst HITS = {HITS_PER_RAY}u;\n\
         const RAY_SLACK: f32 = {CONE_TOLERANCE_SHARE:e};\nconst LEAST_HIT: f32 = {MIN_HIT_COVERAGE:e};\nconst SOONEST_HIT: f32 = {MAX_HIT_TRANSMITTANCE:e};\n\
         const WHOLE: f32 = {STOPPED_COVERAGE:e};\nconst TINY: f32 = {:e};",
        f32::MIN_POSITIVE
    )
}

/// The words of `RayRecord`, with a value; `None` for a splat that no ray can meet.
pub(crate) fn record(splats: &Splats, index: usize, value: f32) -> Option<[u32; RECORD_WORDS]> {
    let RayRecord { mean, log2_opacity, rows, reach, index, .. } = RayRecord::of(splats, index)?;
    let lasts = [log2_opacity.to_bits(), reach.to_bits(), index, value.to_bits()];
    let mut words = [0; RECORD_WORDS];
    let vectors = [mean, rows[0], rows[1], rows[2]].map(|vector| vector.map(f32::to_bits));
    for ((four, vector), last) in words.as_chunks_mut::<4>().0.iter_mut().zip(vectors).zip(lasts) {
        *four = [vector[0], vector[1], vector[2], last];
    }
    Some(words)
}

/// Slots of structures: `RayTask` to count, and the same to write.
pub(crate) const COUNT_TASK: usize = 1;
/// See [`COUNT_TASK`].
pub(crate) const WRITE_TASK: usize = 2;

/// The buffers of this stage; the names are those of the WGSL.
pub(crate) struct RayBuffers<'a> {
    pub(crate) lists: &'a Lists,
    pub(crate) records: &'a wgpu::Buffer,
    pub(crate) cones: &'a wgpu::Buffer,
    pub(crate) features: &'a wgpu::Buffer,
}

impl RayBuffers<'_> {
    /// Counts the packets that each of the first `records` records touches.
    pub(crate) fn count(&self, recorder: &mut Recorder<'_>, records: u32) {
        // The order is not read yet: any buffer that is not written does.
        let over = Groups::Direct(records.div_ceil(WORKGROUP));
        self.touch(recorder, COUNT_TASK, over, &self.lists.depth_pairs[0][1], &self.lists.blocks);
    }

    /// Writes the entries of the records in an order.
    pub(crate) fn write(&self, recorder: &mut Recorder<'_>, order: &wgpu::Buffer) {
        self.touch(recorder, WRITE_TASK, self.over_visible(), order, &self.lists.sums);
    }

    fn over_visible(&self) -> Groups<'_> {
        Groups::Indirect(&self.lists.dispatches, VISIBLE_GROUPS)
    }

    fn touch(
        &self,
        recorder: &mut Recorder<'_>,
        slot: usize,
        over: Groups<'_>,
        order: &wgpu::Buffer,
        sums: &wgpu::Buffer,
    ) {
        let structures = vec![(0, recorder.uniform(slot)), (1, recorder.view())];
        let Lists { counters, counts, entry_pairs: [[packets, entries], _], .. } = self.lists;
        let buffers = [counters, self.records, self.cones, order, counts, sums, packets, entries];
        recorder.dispatch(touch_program(), over, with_buffers(structures, buffers));
    }

    /// Lists the records, among the first `records`, that touch any packet.
    pub(crate) fn list(&self, recorder: &mut Recorder<'_>, records: u32) {
        let Lists { counts, blocks, depth_pairs: [[distances, names], _], .. } = self.lists;
        let bindings = with_buffers(
            vec![(0, recorder.uniform(COUNT_TASK))],
            [self.records, counts, blocks, distances, names],
        );
        recorder.dispatch(visible_program(), Groups::Direct(records.div_ceil(WORKGROUP)), bindings);
    }

    /// Adds up the entries of the records in an order.
    pub(crate) fn sum(&self, recorder: &mut Recorder<'_>, order: &wgpu::Buffer) {
        let Lists { counters, counts, sums, .. } = self.lists;
        let structures = vec![(0, recorder.uniform(COUNT_TASK))];
        let bindings = with_buffers(structures, [counters, order, counts, sums]);
        recorder.dispatch(sums_program(), self.over_visible(), bindings);
    }

    /// Finds the features of the records whose coefficients of colour are `sh`; `slot` is that of
    /// their `ColorPiece`.
    pub(crate) fn see(
        &self,
        recorder: &mut Recorder<'_>,
        asked: RayOutputs,
        slot: usize,
        order: &wgpu::Buffer,
        sh: &wgpu::Buffer,
    ) {
        let structures = vec![(0, recorder.uniform(COUNT_TASK)), (1, recorder.uniform(slot))];
        let buffers = [&self.lists.counters, self.records, order, sh, self.features];
        recorder.dispatch(features_program(asked), self.over_visible(), with_buffers(structures, buffers));
    }

    /// Blends the lists of `packets` packets: reads offsets, entries and rays, and writes the
    /// results. The counters get the length of the longest list.
    pub(crate) fn blend(
        &self,
        recorder: &mut Recorder<'_>,
        asked: RayOutputs,
        packets: u32,
        entries: &wgpu::Buffer,
        rays: &wgpu::Buffer,
        hits: &wgpu::Buffer,
    ) {
        let Lists { offsets, counters, .. } = self.lists;
        let bindings = with_buffers(
            vec![(0, recorder.uniform(COUNT_TASK))],
            [offsets, entries, self.records, self.features, rays, hits, counters],
        );
        recorder.dispatch(blend_program(asked), Groups::Direct(packets), bindings);
    }
}
