//! Splats that come and go while they learn on the GPU: what decides about them crosses over, the
//! rest is moved there.

use super::{Part, StoredModel, USAGE, back, most_in_part, piece, shapes, skies, ungroup_shapes};
use crate::gpu::Gpu;
use crate::gpu::buffers::GrowingBuffer;
use crate::gpu::error::GpuError;
use crate::gpu::recorder::{Groups, Recorder, Stage, with_buffers};
use crate::gpu::source::WORKGROUP;
use crate::gpu::uniforms::{MomentReset, Uniform, rearrangement};
use crate::stages::optimize::gpu::REARRANGE;
use crate::stages::optimize::{Changed, DensifyStats, Origin, Shapes};
use crate::stages::project::rows::{ROW_OPACITY, ROWS};
use std::ops::Range;
use wm_scene::Splats;

/// Flag of an origin whose moments are reset; the other bits are the row.
const RESET_FLAG: u32 = 1 << 31;

impl StoredModel {
    /// Reads back what decides which splats come and go.
    ///
    /// # Panics
    /// If nothing learns here.
    pub(crate) fn read_shapes(&self, gpu: &Gpu, staging: &mut GrowingBuffer) -> Result<Shapes, GpuError> {
        let (splats, pulls) = (Splats::zeroed(self.len, 0), DensifyStats::new(self.len));
        let mut read = Shapes { splats, pulls, seen: vec![0; self.len] };
        self.read_known(gpu, staging, &mut read.pulls, &mut read.seen)?;
        for part in &self.parts {
            let mut numbers = vec![0.0f32; (part.piece.blocks * WORKGROUP * ROWS) as usize];
            back(gpu, staging, &mut [(&part.splats, &mut numbers)])?;
            let first = part.piece.first_splat as usize;
            ungroup_shapes(&numbers, first..first + part.piece.splats as usize, &mut read.splats);
        }
        Ok(read)
    }

    /// Takes splats that came of those that are here.
    ///
    /// # Panics
    /// If nothing learns here, or one comes from a splat that was not here.
    pub(crate) fn rearrange(&mut self, gpu: &Gpu, changed: &Changed<'_>) -> Result<(), GpuError> {
        let Changed { splats, pulls, seen, origins, forgets_opacities } = changed;
        assert!(self.learns(), "splats that learn on the GPU");
        assert!(origins.iter().all(|origin| (origin.row as usize) < self.len), "splats from nowhere");
        let rest = 3 * wm_scene::sh::coefficients(self.sh_degree) - 3;
        let most = most_in_part(gpu, rest, true)?;
        self.len = splats.len();
        let ranges: Vec<Range<usize>> =
            (0..self.len).step_by(most).map(|first| first..(first + most).min(self.len)).collect();
        let word = |origin: &Origin| origin.row | if origin.forgotten { RESET_FLAG } else { 0 };
        let words: Vec<u32> = origins.iter().map(word).collect();
        let sources = gpu.upload("where splats come from", bytemuck::cast_slice(&words))?;

        let (mut places, mut rests, mut moments, mut sh_moments) = (vec![], vec![], vec![], vec![]);
        for part in self.parts.drain(..) {
            places.push(part.piece.first_splat..part.piece.first_splat + part.piece.splats);
            rests.push(part.sh_rest);
            let [own, of_sh] = part.moments.expect("splats that learn have them");
            moments.push(own);
            sh_moments.push(of_sh);
        }
        // What is moved belongs to the parts alone.
        for kept in &mut self.kept {
            kept[1..].iter_mut().for_each(|kept| *kept = GrowingBuffer::default());
        }
        self.kept.resize_with(ranges.len(), Default::default);
        let moving = Moving { gpu, sources: &sources, places: &places, ranges: &ranges };
        let rest_rows = rest as u32;
        let (colors, remembered) = ("coefficients of colour", "what is remembered of splats");
        let opacities =
            if *forgets_opacities { MomentReset::Row(ROW_OPACITY, ROWS) } else { MomentReset::Splats };
        let rests = moving.array(colors, rests, rest_rows, MomentReset::Nothing)?;
        let moments = moving.array(remembered, moments, 2 * ROWS, opacities)?;
        let sh_moments = moving.array(remembered, sh_moments, 2 * rest_rows, MomentReset::Splats)?;

        let sky = skies(splats);
        let arrays = rests.into_iter().zip(moments.into_iter().zip(sh_moments));
        for ((range, kept), (sh_rest, moments)) in ranges.into_iter().zip(&mut self.kept).zip(arrays) {
            let numbers = shapes(splats, &sky, range.clone());
            self.parts.push(Part {
                splats: kept[0].write(gpu, "splats", &numbers, USAGE)?,
                sh_rest,
                moments: Some(moments.into()),
                piece: piece(range, rest),
            });
        }
        self.write_known(gpu, pulls, seen)
    }
}

/// Arrays that are moved.
struct Moving<'a> {
    gpu: &'a Gpu,
    sources: &'a wgpu::Buffer,
    /// The splats of each piece before.
    places: &'a [Range<u32>],
    /// The splats of each piece now.
    ranges: &'a [Range<usize>],
}

impl Moving<'_> {
    /// One array of each piece now out of those `before`, which go.
    fn array(
        &self,
        what: &'static str,
        before: Vec<wgpu::Buffer>,
        rows: u32,
        forgets: MomentReset,
    ) -> Result<Vec<wgpu::Buffer>, GpuError> {
        let (gpu, ranges) = (self.gpu, self.ranges);
        let room = |range: &Range<usize>| {
            let bytes = 4 * range.len().next_multiple_of(WORKGROUP as usize) as u64 * u64::from(rows);
            gpu.check_binding(what, bytes)?;
            gpu.buffer(what, bytes, USAGE)
        };
        let after = ranges.iter().map(room).collect::<Result<Vec<_>, _>>()?;
        // Of degree 0 there are none.
        if rows == 0 {
            return Ok(after);
        }
        let pairs: Vec<(usize, usize)> =
            (0..after.len()).flat_map(|now| (0..before.len()).map(move |then| (then, now))).collect();
        let structure = |then: usize, now: usize| {
            let now = ranges[now].start as u32..ranges[now].end as u32;
            rearrangement(self.places[then].clone(), now, rows, forgets)
        };
        let structures: Vec<Uniform> = pairs.iter().map(|(then, now)| structure(*then, *now)).collect();
        let uniforms = GrowingBuffer::default().structures(gpu, &structures)?;
        let mut recorder = Recorder::new(gpu, &uniforms, None);
        recorder.begin(Stage::Optimize);
        for (slot, (then, now)) in pairs.into_iter().enumerate() {
            let bindings =
                with_buffers(vec![(0, recorder.uniform(slot))], [self.sources, &before[then], &after[now]]);
            let groups = (ranges[now].len() as u32).div_ceil(WORKGROUP);
            recorder.dispatch(REARRANGE, Groups::Direct(groups), bindings);
        }
        recorder.submit();
        // Before the next array, or all of them would be there twice.
        drop(before);
        gpu.finish()?;
        Ok(after)
    }
}
