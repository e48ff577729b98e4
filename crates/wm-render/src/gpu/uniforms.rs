//! Small structures for the GPU, laid out as WGSL does; a test holds them against the WGSL.

use super::source::TILE_SIDE;
use crate::hooks::SkySplats;
use crate::renderer::Job;
use crate::stages::project::ProjectCamera;
use wm_scene::Rasterization;

/// Bytes from one structure to the next: the largest alignment that an adapter may ask for.
pub const SLOT: u64 = 256;

/// The words of a WGSL structure, with the names and places of its fields.
#[derive(Clone, Debug, Default)]
pub struct Uniform {
    /// Its words.
    pub words: Vec<u32>,
    /// Name and byte offset of each field.
    pub fields: Vec<(&'static str, u32)>,
}

impl Uniform {
    fn whole(mut self, name: &'static str, value: u32) -> Self {
        self.fields.push((name, 4 * self.words.len() as u32));
        self.words.push(value);
        self
    }

    fn real(self, name: &'static str, value: f32) -> Self {
        self.whole(name, value.to_bits())
    }

    /// A vector of two or three numbers: they begin at multiples of 8 and 16 bytes.
    fn vector<const N: usize>(mut self, name: &'static str, values: [f32; N]) -> Self {
        let align = if N == 2 { 2 } else { 4 };
        self.words.resize(self.words.len().next_multiple_of(align), 0);
        self.fields.push((name, 4 * self.words.len() as u32));
        self.words.extend(values.map(f32::to_bits));
        self
    }
}

/// What the GPU has room for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capacity {
    /// Splats in view.
    pub visible: u32,
    /// Entries of tile lists.
    pub entries: u32,
}

impl Capacity {
    /// Most of both that arrays of `most_binding` bytes hold: records take 64 bytes, entries 4.
    fn limit(most_binding: u64) -> Self {
        let of = |bytes: u64| u32::try_from(most_binding / bytes).unwrap_or(u32::MAX);
        Self { visible: of(64), entries: of(4) }
    }

    /// A first guess for `total` splats: half of them in view, two tiles each.
    pub fn start(&mut self, total: usize, most_binding: u64) {
        let (total, limit) = (u32::try_from(total).unwrap_or(u32::MAX), Self::limit(most_binding));
        self.visible = self.visible.max((total / 2).max(4096).min(limit.visible));
        self.entries = self.entries.max(total.max(65_536).min(limit.entries));
    }

    /// Grows to what a frame needed, and a quarter more where that fits; whether it had to. Entries are counted of the
    /// splats that had room, so both may have to grow one after the other.
    pub fn grow(&mut self, visible: u32, entries: u32, most_binding: u64) -> bool {
        let (before, limit) = (*self, Self::limit(most_binding));
        let more = |has: u32, needs: u32, limit: u32| {
            if needs > has { needs.saturating_add(needs / 4).min(limit.max(needs)) } else { has }
        };
        self.visible = more(self.visible, visible, limit.visible);
        self.entries = more(self.entries, entries, limit.entries);
        *self != before
    }
}

/// `View` of `common.wgsl`; `blocks` are those of all sets, `drops` what falls.
#[must_use]
pub fn view(job: &Job<'_>, blocks: u32, drops: u32, capacity: Capacity) -> Uniform {
    let camera = ProjectCamera::new(job.camera);
    let [rotation_x, rotation_y, rotation_z] = camera.rotation;
    let (columns, rows) = tiles(job);
    Uniform::default()
        .vector("rotation_x", rotation_x)
        .real("near", camera.near)
        .vector("rotation_y", rotation_y)
        .whole("antialiased", u32::from(job.config.rasterization == Rasterization::Antialiased))
        .vector("rotation_z", rotation_z)
        .whole("sky_left_out", u32::from(job.hooks.sky_splats() == SkySplats::LeftOut))
        .vector("center", camera.center)
        .whole("tile_columns", columns)
        .vector("focal", camera.focal)
        .vector("principal", camera.principal)
        .vector("size", camera.size)
        .vector("low", camera.low)
        .vector("high", camera.high)
        .whole("width", job.camera.width)
        .whole("height", job.camera.height)
        .whole("tiles", columns * rows)
        .whole("blocks", blocks)
        .whole("visible_capacity", capacity.visible)
        .whole("entry_capacity", capacity.entries)
        .whole("drops", drops)
}

/// Columns and rows of tiles.
#[must_use]
pub fn tiles(job: &Job<'_>) -> (u32, u32) {
    (job.camera.width.div_ceil(TILE_SIDE), job.camera.height.div_ceil(TILE_SIDE))
}

/// `Chunk` of `geometry.wgsl`.
#[must_use]
pub fn chunk(first_block: u32, blocks: u32, first_splat: u32, sh_rows: u32, faded: bool) -> Uniform {
    Uniform::default()
        .whole("first_block", first_block)
        .whole("blocks", blocks)
        .whole("first_splat", first_splat)
        .whole("sh_rows", sh_rows)
        .whole("faded", u32::from(faded))
}

/// `Pass` of `sort.wgsl`.
#[must_use]
pub fn sort_pass(shift: u32, of_entries: bool, numbered: bool) -> Uniform {
    Uniform::default()
        .whole("shift", shift)
        .whole("of_entries", u32::from(of_entries))
        .whole("numbered", u32::from(numbered))
}

/// `Task` of `intersect.wgsl`.
#[must_use]
pub fn intersect_task(emits: bool) -> Uniform {
    Uniform::default().whole("emits", u32::from(emits))
}

#[cfg(test)]
mod tests;
