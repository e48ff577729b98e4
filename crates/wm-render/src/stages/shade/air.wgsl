// The weather's air: its own text defines `evaluate_air`, and its parameters are here.
@group(0) @binding(8) var<storage, read> air: array<f32>;

// What arrives of light L at the far end of a ray is L * transmittance + airlight, in linear light.
struct AirOnRay {
    transmittance: vec3<f32>,
    airlight: vec3<f32>,
}

// The share of light that the air lets through over `distance` along a unit direction.
fn transmittance(direction: vec3<f32>, distance: f32) -> vec3<f32> {
    return evaluate_air(direction, distance).transmittance;
}

// The light that the air adds over `distance` along a unit direction, linear RGB.
fn airlight(direction: vec3<f32>, distance: f32) -> vec3<f32> {
    return evaluate_air(direction, distance).airlight;
}
