// The share of light that the air lets through, in place of a colour.
fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> {
    return transmittance(direction, distance);
}
