// The pictures of a step of training, from the sums that blending kept.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> training: Training;
@group(0) @binding(2) var<storage, read> rgb: array<f32>;
@group(0) @binding(3) var<storage, read> alpha: array<f32>;
@group(0) @binding(4) var<storage, read> depths: array<f32>;
@group(0) @binding(5) var<storage, read> normal: array<f32>;
@group(0) @binding(6) var<storage, read_write> finished_rgb: array<f32>;
@group(0) @binding(7) var<storage, read_write> finished_depths: array<f32>;
@group(0) @binding(8) var<storage, read_write> finished_normal: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn finish(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = group_index(workgroup) * WORKGROUP + local;
    if at >= view.width * view.height {
        return;
    }
    let covered = alpha[at] >= FRAME_MIN_ALPHA;
    if COLOR {
        for (var k = 0u; k < 3u; k++) {
            finished_rgb[3u * at + k] = rgb[3u * at + k] + (1.0 - alpha[at]) * training.background[k];
        }
    }
    if DEPTH {
        finished_depths[at] = select(0.0, depths[at] / max(alpha[at], FRAME_MIN_ALPHA), covered);
    }
    if NORMAL {
        let sum = vec3<f32>(normal[3u * at], normal[3u * at + 1u], normal[3u * at + 2u]);
        let squared = dot(sum, sum);
        let scale = select(0.0, inverseSqrt(max(squared, 1e-20)), covered && squared > 1e-20);
        for (var k = 0u; k < 3u; k++) {
            finished_normal[3u * at + k] = sum[k] * scale;
        }
    }
}
