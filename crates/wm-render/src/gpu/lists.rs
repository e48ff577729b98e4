//! Splats to tile lists: what a frame and a step of training have in common.

use super::buffers::Room;
use super::recorder::{Recorder, Stage};
use super::source::{ENTRY_SORT, VISIBLE_SORT};
use super::uniforms::{self, Uniform};
use crate::hooks::WgslSource;
use crate::plan::Shading;
use crate::stages::intersect::gpu::{intersect, ranges};
use crate::stages::prefix_sum::gpu::{SPINE_ENTRIES, SPINE_VISIBLE, spine};
use crate::stages::project::gpu::{Piece, cull, project};
use crate::stages::sort::gpu::{Pairs, passes, sort};

/// Bits of a depth.
const DEPTH_BITS: u32 = 32;
// Slots of the structures; the first is `View`.
const DEPTH_PASSES: usize = 1;
const TILE_PASSES: usize = 5;
const COUNT_TASK: usize = 9;
const WRITE_TASK: usize = 10;
/// The first slot after them, which is that of the first piece of splats.
pub(crate) const FIRST_PIECE_SLOT: usize = 11;

/// The kind of the entries of tile lists.
#[derive(Clone, Copy)]
pub(crate) enum Entries<'a> {
    /// Records.
    Records,
    /// Pairs of splat and tile, by number, splat by splat; here the record of each is kept.
    Pairs(&'a wgpu::Buffer),
}

/// The structures of the slots before [`FIRST_PIECE_SLOT`].
pub(crate) fn uniforms(view: Uniform, entries: Entries<'_>) -> Vec<Uniform> {
    let are_pairs = matches!(entries, Entries::Pairs(_));
    let pass = |of_entries: bool| {
        let numbered = !of_entries || are_pairs;
        (0..4).map(move |i| uniforms::sort_pass(8 * i, of_entries, numbered && i == 0))
    };
    let mut all = vec![view];
    all.extend(pass(false));
    all.extend(pass(true));
    all.extend([false, true].map(uniforms::intersect_task));
    all
}

/// Splats to records, through the air.
pub(crate) fn front(
    recorder: &mut Recorder<'_>,
    room: &Room,
    pieces: &[Piece<'_>],
    shading: Shading,
    air: Option<(&WgslSource, &wgpu::Buffer)>,
) {
    recorder.begin(Stage::Project);
    for piece in pieces {
        cull(recorder, piece, &room.lists.blocks);
    }
    spine(recorder, SPINE_VISIBLE, &room.lists, &room.lists.blocks);
    for piece in pieces {
        project(recorder, piece, room, shading, air);
    }
}

/// Records to the lists of `tiles` tiles: tiles and what they list, sorted. The order by depth
/// stays in `room`, see [`order`].
pub(crate) fn lists<'r>(
    recorder: &mut Recorder<'_>,
    room: &'r Room,
    tiles: u32,
    entries: Entries<'r>,
) -> Pairs<'r> {
    let lists = &room.lists;
    recorder.begin(Stage::Sort);
    let slots = DEPTH_PASSES..DEPTH_PASSES + passes(DEPTH_BITS) as usize;
    let (_, order) = sort(recorder, lists, &lists.depth_pairs, VISIBLE_SORT, slots);
    recorder.begin(Stage::Intersect);
    let entries = match entries {
        Entries::Records => &lists.entry_pairs[0][1],
        Entries::Pairs(names) => names,
    };
    intersect(recorder, COUNT_TASK, room, order, entries);
    spine(recorder, SPINE_ENTRIES, lists, &lists.sums);
    intersect(recorder, WRITE_TASK, room, order, entries);
    let slots = TILE_PASSES..TILE_PASSES + passes(u32::BITS - tiles.leading_zeros()) as usize;
    let sorted = sort(recorder, lists, &lists.entry_pairs, ENTRY_SORT, slots);
    ranges(recorder, tiles, lists, sorted.0);
    sorted
}

/// Returns the buffer in which [`lists`] leaves the records in the order of their depth.
pub(crate) fn order(room: &Room) -> &wgpu::Buffer {
    &room.lists.depth_pairs[passes(DEPTH_BITS) as usize % 2][1]
}

/// Returns the buffer in which [`lists`] leaves the entries of `tiles` tiles.
pub(crate) fn listed(room: &Room, tiles: u32) -> &wgpu::Buffer {
    &room.lists.entry_pairs[passes(u32::BITS - tiles.leading_zeros()) as usize % 2][1]
}
