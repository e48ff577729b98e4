// The haze of the photos that are learnt from, as `even_air.rs` has it; extinction 0 is clear air.

// Derivatives of `srgb_decode`.
fn decode_slopes(rgb: vec3<f32>) -> vec3<f32> {
    let power = (2.4 / 1.055) * pow((max(rgb, vec3<f32>(0.04045)) + 0.055) / 1.055, vec3<f32>(1.4));
    return select(power, vec3<f32>(1.0 / 12.92), rgb <= vec3<f32>(0.04045));
}

// Displayed colours through it are `c * factor + summand`.
struct PhotoAir {
    factor: vec3<f32>,
    summand: vec3<f32>,
}

fn photo_air(distance: f32) -> PhotoAir {
    if view.extinction <= 0.0 || distance >= FAR_AWAY {
        return PhotoAir(vec3<f32>(1.0), vec3<f32>(0.0));
    }
    let kept = exp2(max(-view.extinction * distance, -126.0));
    let grey = srgb_encode(vec3<f32>(GREY));
    let seen = srgb_encode(vec3<f32>(GREY * kept) + (1.0 - kept) * view.airlight);
    let factor = kept * decode_slopes(grey) / decode_slopes(seen);
    return PhotoAir(factor, seen - factor * grey);
}
