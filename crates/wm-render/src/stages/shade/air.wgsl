// The weather's air: its own text defines `seen_through`, and its parameters stand here.
@group(0) @binding(8) var<storage, read> air: array<f32>;

fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> {
    return seen_through(direction, distance, rgb);
}
