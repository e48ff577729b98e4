// The sums of all patches, by one workgroup.

@group(0) @binding(4) var<storage, read> of_patches: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> totals: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn patch_totals(@builtin(local_invocation_index) local: u32) {
    var own = vec4<f32>(0.0);
    for (var i = local; i < geometry.patch_count; i += WORKGROUP) {
        own += of_patches[3u * i];
    }
    let all = summed(local, own);
    if local == 0u {
        totals[0] = all;
    }
}
