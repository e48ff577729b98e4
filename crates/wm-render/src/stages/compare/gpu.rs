//! Colours against a photo on a GPU, which keeps the photos.

use super::{ColorTerm, Compared, Comparison};
use crate::gpu::buffers::{Growing, READ_BACK, WRITTEN};
use crate::gpu::device::Gpu;
use crate::gpu::error::GpuError;
use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{Program, WORKGROUP};
use std::collections::HashMap;

/// Workgroups that add up a picture.
pub const GROUPS: u32 = 64;
/// Numbers of the sums of each.
pub const GROUP_SUMS: usize = 16;
/// Numbers of all sums.
pub(crate) const TOTALS: usize = GROUPS as usize * GROUP_SUMS;
/// Structures that a comparison has: one a channel.
pub(crate) const SLOTS: usize = 3;
/// Most bytes of photos that stay.
const KEPT_BYTES: u64 = 1 << 30;

/// Photos that were there before, and working memory.
#[derive(Default)]
pub(crate) struct Comparer {
    photos: HashMap<(usize, u32, u32), Photo>,
    /// Counts comparisons.
    clock: u64,
    kept: [Growing; 3],
}

struct Photo {
    buffer: wgpu::Buffer,
    counted: f64,
    used: u64,
}

/// Room for one comparison.
pub(crate) struct Room {
    photo: wgpu::Buffer,
    /// The sum of the mask.
    pub counted: f64,
    slopes: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// What [`compared`] reads.
    pub totals: wgpu::Buffer,
}

impl Comparer {
    /// Room for a picture of `size` in `tiles` tiles, with the photo in it.
    pub fn room(
        &mut self,
        gpu: &Gpu,
        comparison: &Comparison<'_>,
        size: (u32, u32),
        tiles: u32,
    ) -> Result<Room, GpuError> {
        let (photo, counted) = self.photo(gpu, comparison, size)?;
        let pixels = u64::from(size.0) * u64::from(size.1);
        let [slopes, sums, totals] = &mut self.kept;
        Ok(Room {
            photo,
            counted,
            slopes: slopes.fit(gpu, "slopes of similarity", 12 * pixels, WRITTEN)?,
            sums: sums.fit(gpu, "sums of similarity", 12 * u64::from(tiles), WRITTEN)?,
            totals: totals.fit(gpu, "sums of a picture", 4 * TOTALS as u64, READ_BACK)?,
        })
    }

    /// The photo on the device, and what its pixels count together.
    fn photo(
        &mut self,
        gpu: &Gpu,
        comparison: &Comparison<'_>,
        (width, height): (u32, u32),
    ) -> Result<(wgpu::Buffer, f64), GpuError> {
        self.clock += 1;
        let name = (comparison.photo, width, height);
        if let Some(photo) = self.photos.get_mut(&name) {
            photo.used = self.clock;
            return Ok((photo.buffer.clone(), photo.counted));
        }
        let bytes = 8 * u64::from(width) * u64::from(height);
        gpu.check_binding("a photo", bytes)?;
        while self.photos.values().map(|photo| photo.buffer.size()).sum::<u64>() + bytes > KEPT_BYTES {
            let Some(oldest) = self.photos.iter().min_by_key(|(_, photo)| photo.used) else { break };
            let name = *oldest.0;
            self.photos.remove(&name);
        }
        let buffer = gpu.buffer("a photo", bytes, WRITTEN)?;
        gpu.write(&buffer, 0, bytemuck::cast_slice(&packed(comparison)));
        let pixels = f64::from(width) * f64::from(height);
        let counted = comparison.mask.map_or(pixels, |mask| mask.iter().map(|share| f64::from(*share)).sum());
        self.photos.insert(name, Photo { buffer: buffer.clone(), counted, used: self.clock });
        Ok((buffer, counted))
    }
}

/// Colour and mask as 16-bit fractions, `[H, W]`.
fn packed(comparison: &Comparison<'_>) -> Vec<[u16; 4]> {
    let fraction = |value: f32| (value.clamp(0.0, 1.0) * 65_535.0).round() as u16;
    let pixels = comparison.rgb.as_chunks::<3>().0.iter().enumerate();
    let share = |at: usize| comparison.mask.map_or(1.0, |mask| mask[at]);
    pixels.map(|(at, rgb)| [rgb[0], rgb[1], rgb[2], share(at)].map(fraction)).collect()
}

impl Room {
    /// Compares `rgb`, whose structures begin at `slot`, and writes the derivative to the first numbers of `upstream`.
    pub fn record<'a>(
        &'a self,
        recorder: &mut Recorder<'a>,
        slot: usize,
        tiles: u32,
        (rgb, upstream): (&'a wgpu::Buffer, &'a wgpu::Buffer),
    ) {
        let (view, structures) =
            (recorder.view(), std::array::from_fn::<_, SLOTS, _>(|channel| recorder.uniform(slot + channel)));
        let shared = |channel: usize| {
            vec![
                (0, view.clone()),
                (1, structures[channel].clone()),
                (2, rgb.as_entire_binding()),
                (3, self.photo.as_entire_binding()),
            ]
        };
        for channel in 0..SLOTS {
            let mut bindings = shared(channel);
            bindings.extend([(4, self.slopes.as_entire_binding()), (5, self.sums.as_entire_binding())]);
            recorder.dispatch(&Program::Similarity, Groups::Direct(tiles), bindings);
            let mut bindings = shared(channel);
            bindings.extend([(4, self.slopes.as_entire_binding()), (6, upstream.as_entire_binding())]);
            recorder.dispatch(&Program::SimilarityBackward, Groups::Direct(tiles), bindings);
        }
        let mut bindings = shared(0);
        bindings.extend([
            (5, self.sums.as_entire_binding()),
            (6, upstream.as_entire_binding()),
            (7, self.totals.as_entire_binding()),
        ]);
        recorder.dispatch(&Program::ColorsBackward, Groups::Direct(GROUPS), bindings);
    }
}

/// What came of a comparison over `pixels` pixels, of which `counted` count.
pub(crate) fn compared(totals: &[f32], pixels: u32, counted: f64) -> Compared {
    let mut sums = [0.0f64; GROUP_SUMS];
    for group in totals.as_chunks::<GROUP_SUMS>().0 {
        for (sum, value) in sums.iter_mut().zip(group) {
            *sum += f64::from(*value);
        }
    }
    let mut found = Compared::default();
    found.values[ColorTerm::L1 as usize] = sums[0] / (3.0 * counted.max(1.0));
    found.values[ColorTerm::Dssim as usize] = 1.0 - sums[1] / (3.0 * f64::from(pixels));
    found.by_exposure.copy_from_slice(&sums[4..]);
    found
}

const _: () = assert!(WORKGROUP == 256, "a thread a pixel of a tile");
