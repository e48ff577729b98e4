// What is rendered of a pixel's geometry and what is believed of it; mirrors
// `gpu::uniforms::geometry`.

struct Geometry {
    // Weights over how many values they are a mean of.
    depth: f32,
    normal: f32,
    coverage: f32,
    patches: f32,
    smooth_depth: f32,
    // How far believed inverse depths are off.
    sigma: f32,
    // Share of local differences of patches, and the largest that is none.
    local: f32,
    margin: f32,
    // Of the grid.
    columns: u32,
    rows: u32,
    // Of a patch, in pixels of the grid, and how many there are in a row and in all.
    side: u32,
    patch_columns: u32,
    patch_count: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> geometry: Geometry;
@group(0) @binding(2) var<storage, read> alpha: array<f32>;
@group(0) @binding(3) var<storage, read> depths: array<f32>;

// 1 / depth where it counts, else -1.
fn inverse_depth(at: u32) -> f32 {
    let depth = depths[at];
    return select(-1.0, 1.0 / max(depth, 1e-30), alpha[at] >= COVERED && depth > 0.0);
}
