// Colours as seen through the air.
fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> {
    let along = evaluate_air(direction, distance);
    return srgb_encode(srgb_decode(rgb) * along.transmittance + along.airlight);
}
