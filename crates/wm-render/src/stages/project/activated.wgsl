// Splats as renders keep them: activated.
@group(0) @binding(3) var<storage, read> visibility: array<f32>;

// wxyz, of length 1.
fn quat_of(splat: u32) -> vec4<f32> {
    return vec4<f32>(number(splat, ROW_QUAT), numbers(splat, ROW_QUAT + 1u));
}

// Standard deviations.
fn scales_of(splat: u32) -> vec3<f32> {
    return numbers(splat, ROW_SCALE);
}

fn log2_opacity_of(splat: u32) -> f32 {
    let own = number(splat, ROW_OPACITY);
    if chunk.faded == 0u {
        return own;
    }
    return own + log2(max(visibility[chunk.first_splat + splat], 1e-30));
}
