// Colours as seen through the haze of the photos that are learnt from.
fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> {
    let air = photo_air(distance);
    return rgb * air.factor + air.summand;
}
