// Splats as training keeps them: stored parameters, activated where they are read, as `activate.rs`
// has it.

// 1 / length of the stored quaternion; 0 where there is none.
fn inverse_length_of(splat: u32) -> f32 {
    let q = vec4<f32>(number(splat, ROW_QUAT), numbers(splat, ROW_QUAT + 1u));
    let squared = dot(q, q);
    return select(0.0, 1.0 / sqrt(max(squared, 1e-30)), squared > 1e-30);
}

// wxyz, of length 1.
fn quat_of(splat: u32) -> vec4<f32> {
    let q = vec4<f32>(number(splat, ROW_QUAT), numbers(splat, ROW_QUAT + 1u));
    let inverse = inverse_length_of(splat);
    // None is the identity, as everywhere.
    return select(vec4<f32>(1.0, 0.0, 0.0, 0.0), q * inverse, inverse > 0.0);
}

// Training changes no light.
fn relit(splat: u32, rgb: vec3<f32>) -> vec3<f32> {
    return rgb;
}

// Standard deviations.
fn scales_of(splat: u32) -> vec3<f32> {
    return exp2(clamp(numbers(splat, ROW_SCALE) * LOG2E, vec3<f32>(-126.0), vec3<f32>(126.0)));
}

// (1 - opacity) / opacity: nothing cancels at either end.
fn odds_of(splat: u32) -> f32 {
    return exp2(clamp(number(splat, ROW_OPACITY) * -LOG2E, -126.0, 126.0));
}

fn log2_opacity_of(splat: u32) -> f32 {
    if chunk.fixed != 0u {
        return chunk.fixed_log2_opacity;
    }
    return -log2(1.0 + odds_of(splat));
}
