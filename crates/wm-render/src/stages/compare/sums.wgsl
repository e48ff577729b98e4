// Sums over a workgroup in a fixed order.

var<workgroup> of_threads: array<vec4<f32>, WORKGROUP>;

// That of all threads, for each of them.
fn summed(local: u32, own: vec4<f32>) -> vec4<f32> {
    workgroupBarrier();
    of_threads[local] = own;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            of_threads[local] += of_threads[local + half];
        }
    }
    workgroupBarrier();
    return of_threads[0];
}
