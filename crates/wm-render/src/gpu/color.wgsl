// Between display-referred colours and light, as `wm_scene::color` has it.

fn srgb_decode(rgb: vec3<f32>) -> vec3<f32> {
    let line = max(rgb, vec3<f32>(0.0)) / 12.92;
    let power = pow((max(rgb, vec3<f32>(0.04045)) + 0.055) / 1.055, vec3<f32>(2.4));
    return select(power, line, rgb <= vec3<f32>(0.04045));
}

fn srgb_encode(light: vec3<f32>) -> vec3<f32> {
    let line = max(light, vec3<f32>(0.0)) * 12.92;
    let power = 1.055 * pow(max(light, vec3<f32>(0.0031308)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(power, line, light <= vec3<f32>(0.0031308));
}
