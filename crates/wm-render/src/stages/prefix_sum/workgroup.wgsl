// Prefix sums over a workgroup of 256 threads: sixteen runs of sixteen.

const SCAN_RUN: u32 = 16u;
var<workgroup> scan_values: array<u32, WORKGROUP>;
var<workgroup> scan_runs: array<u32, SCAN_RUN>;

// The sum of `value` over the threads before this one, and over all. Every thread must come here.
fn scan(local: u32, value: u32) -> vec2<u32> {
    scan_values[local] = value;
    workgroupBarrier();
    if local < SCAN_RUN {
        var sum = 0u;
        for (var k = 0u; k < SCAN_RUN; k++) {
            sum += scan_values[local * SCAN_RUN + k];
        }
        scan_runs[local] = sum;
    }
    workgroupBarrier();
    let run = local / SCAN_RUN;
    var before = 0u;
    var total = 0u;
    for (var k = 0u; k < SCAN_RUN; k++) {
        if k == run {
            before = total;
        }
        total += scan_runs[k];
    }
    for (var k = run * SCAN_RUN; k < local; k++) {
        before += scan_values[k];
    }
    // The next call may write at once.
    workgroupBarrier();
    return vec2<u32>(before, total);
}
