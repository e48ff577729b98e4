// Splats and packets of rays, as the programs of this stage share them. Names in capitals that
// `gpu::source` does not have are written before this text by `gpu.rs`.

struct RayRecord {
    mean: vec3<f32>,
    log2_opacity: f32,
    // Rows of `M`, times sqrt(log2(e) / 2); the first is along the normal.
    row_0: vec3<f32>,
    // Distance from the mean beyond which alpha is below 1/255.
    reach: f32,
    row_1: vec3<f32>,
    // The splat.
    index: u32,
    row_2: vec3<f32>,
    // The value that the caller gave it.
    value: f32,
}

// Packets of one group that are traced together.
struct RayTask {
    // The middle of the group's origins, and the greatest distance of one from it.
    center: vec3<f32>,
    radius: f32,
    // All packets of the group; those that are traced, and the end of these.
    packets: u32,
    first: u32,
    end: u32,
    // The highest level of the group's tree, and its first cone among those of all levels.
    top: u32,
    top_at: u32,
    records: u32,
    // 0 to count, 1 to write.
    emits: u32,
}

@group(0) @binding(0) var<uniform> task: RayTask;
