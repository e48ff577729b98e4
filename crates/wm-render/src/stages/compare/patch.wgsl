// A patch of the grid, a workgroup each, and its differences.

struct Patch {
    // Of the grid: the first column and row, and those behind the last.
    low: vec2<u32>,
    high: vec2<u32>,
}

fn patch_of(index: u32) -> Patch {
    let low = geometry.side * vec2<u32>(index % geometry.patch_columns, index / geometry.patch_columns);
    return Patch(low, min(low + geometry.side, vec2<u32>(geometry.columns, geometry.rows)));
}

// The pixel in a place of a patch, counted row by row.
fn pixel_in(region: Patch, i: u32) -> u32 {
    let columns = region.high.x - region.low.x;
    return pixel_of(region.low.x + i % columns, region.low.y + i / columns);
}

fn pixels_in(region: Patch) -> u32 {
    return (region.high.x - region.low.x) * (region.high.y - region.low.y);
}

// The difference of a pair off the means, over deviations `over`; 0 up to the margin.
fn difference(off: vec2<f32>, over: vec2<f32>) -> f32 {
    let by = off / over;
    return select(0.0, by.x - by.y, abs(by.x - by.y) > geometry.margin);
}
