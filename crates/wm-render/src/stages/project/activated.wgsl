// Splats as renders keep them: activated.
// Their attributes in this pass, `[groups][ATTRIBUTE_COLUMNS][16]`.
@group(0) @binding(3) var<storage, read> attributes: array<f32>;

fn splat_attribute(splat: u32, column: u32) -> f32 {
    let at = chunk.first_splat + splat;
    return attributes[(at / GROUP * ATTRIBUTE_COLUMNS + column) * GROUP + at % GROUP];
}

// wxyz, of length 1.
fn quat_of(splat: u32) -> vec4<f32> {
    return vec4<f32>(number(splat, ROW_QUAT), numbers(splat, ROW_QUAT + 1u));
}

// Standard deviations.
fn scales_of(splat: u32) -> vec3<f32> {
    return numbers(splat, ROW_SCALE);
}

// The colour of a splat in other light, see the contract of the shading.
fn relit(splat: u32, seen: vec3<f32>) -> vec3<f32> {
    if chunk.changes_light == 0u {
        return seen;
    }
    let even = max(vec3<f32>(0.5) + C0 * numbers(splat, ROW_DC), vec3<f32>(0.0));
    let rgb = seen + (even - seen) * splat_attribute(splat, ATTRIBUTE_FADE);
    let gain = vec3<f32>(
        splat_attribute(splat, ATTRIBUTE_GAIN_RED),
        splat_attribute(splat, ATTRIBUTE_GAIN_GREEN),
        splat_attribute(splat, ATTRIBUTE_GAIN_BLUE),
    );
    let light = srgb_decode(rgb);
    let limit = max(1.0, max(light.r, max(light.g, light.b)));
    let changed = light * gain;
    return srgb_encode(changed * (limit / max(limit, max(changed.r, max(changed.g, changed.b)))));
}

fn log2_opacity_of(splat: u32) -> f32 {
    let own = number(splat, ROW_OPACITY);
    if chunk.has_attributes == 0u {
        return own;
    }
    return own + log2(max(splat_attribute(splat, ATTRIBUTE_VISIBILITY), 1e-30));
}
