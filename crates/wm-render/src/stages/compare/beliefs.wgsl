// What is believed of each pixel; packed by `packed_beliefs`.

// `[H, W, 3]`: inverse depth; the normal as fractions; its last number and coverage.
@group(0) @binding(5) var<storage, read> beliefs: array<u32>;

fn believed_inverse_depth(at: u32) -> f32 {
    return bitcast<f32>(beliefs[3u * at]);
}
