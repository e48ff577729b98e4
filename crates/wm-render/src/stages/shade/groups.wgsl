// The air alone, on groups of sixteen splats as `ShadeGroup` has them: distance, direction 3,
// colour 3.
@group(0) @binding(0) var<storage, read_write> groups: array<f32>;

const GROUP_ROWS: u32 = 7u;

@compute @workgroup_size(WORKGROUP)
fn shade_groups(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let splat = group_index(workgroup) * WORKGROUP + local;
    let at = splat / GROUP * (GROUP_ROWS * GROUP) + splat % GROUP;
    if at >= arrayLength(&groups) {
        return;
    }
    let direction = vec3<f32>(groups[at + GROUP], groups[at + 2u * GROUP], groups[at + 3u * GROUP]);
    let rgb = vec3<f32>(groups[at + 4u * GROUP], groups[at + 5u * GROUP], groups[at + 6u * GROUP]);
    let seen = through_air(direction, groups[at], rgb);
    for (var k = 0u; k < 3u; k++) {
        groups[at + (4u + k) * GROUP] = seen[k];
    }
}
