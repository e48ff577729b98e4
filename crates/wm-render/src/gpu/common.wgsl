// What all stages share. Names in capitals are constants of the Rust code, written before this text
// by `gpu::source`; `View` mirrors `gpu::uniforms::view`.

struct View {
    // Rows of the rotation from world to view.
    rotation_x: vec3<f32>,
    near: f32,
    rotation_y: vec3<f32>,
    // 1 where splats smaller than a pixel fade.
    antialiased: u32,
    rotation_z: vec3<f32>,
    // 1 where the scene's own sky is not drawn.
    sky_left_out: u32,
    center: vec3<f32>,
    tile_columns: u32,
    focal: vec2<f32>,
    principal: vec2<f32>,
    size: vec2<f32>,
    low: vec2<f32>,
    high: vec2<f32>,
    width: u32,
    height: u32,
    tiles: u32,
    // Blocks of 256 splats in all sets.
    blocks: u32,
    visible_capacity: u32,
    entry_capacity: u32,
    // Falling particles.
    drops: u32,
    // The haze of the photos that are learnt from: its light, linear, and its extinction a scene
    // unit times log2(e).
    airlight: vec3<f32>,
    extinction: f32,
    // A normal and a height above the camera: splats below are not drawn. A normal of 0 draws all.
    cut: vec4<f32>,
    // Normal of the surface that splits the blend, and 1 where there is one; 2 where depths of
    // records stand for their splats.
    split_normal: vec3<f32>,
    split: u32,
}

// A projected and shaded splat: the numbers of the CPU's `Record` in its order, 64 bytes.
struct Record {
    // x, y, ux, vx
    a: vec4<f32>,
    // vy, log2_opacity, red, green
    b: vec4<f32>,
    // blue, depth, normal x and y
    c: vec4<f32>,
    // normal z, slope_y, slope_x, index (bits)
    d: vec4<f32>,
}

// How much there is of what the GPU counts itself.
struct Counters {
    // Splats in view and entries of tile lists, as far as there is room.
    visible: u32,
    entries: u32,
    // The same without that limit: what the next frame needs room for.
    visible_needed: u32,
    entries_needed: u32,
    // Records that tiles walked, all tiles together.
    walked: atomic<u32>,
}

// Number of a workgroup in a dispatch whose rows are DISPATCH_ROW wide.
fn group_index(workgroup: vec3<u32>) -> u32 {
    return workgroup.y * DISPATCH_ROW + workgroup.x;
}
