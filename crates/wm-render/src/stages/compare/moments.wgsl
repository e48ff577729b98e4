// Mean and spread of rendered and believed inverse depths, merged in a fixed order without
// differences of squares (Chan et al. 1983).

struct Moments {
    count: f32,
    mean: vec2<f32>,
    // Sums of squared differences from the mean.
    squares: vec2<f32>,
}

var<workgroup> shared_moments: array<Moments, WORKGROUP>;

fn with_pair(known: Moments, pair: vec2<f32>) -> Moments {
    let count = known.count + 1.0;
    let off = pair - known.mean;
    let mean = known.mean + off / count;
    return Moments(count, mean, known.squares + off * (pair - mean));
}

fn merged(a: Moments, b: Moments) -> Moments {
    let count = a.count + b.count;
    let share = b.count / max(count, 1.0);
    let off = b.mean - a.mean;
    return Moments(count, a.mean + share * off, a.squares + b.squares + a.count * share * off * off);
}

// Those of all threads of the workgroup, for each of them.
fn gathered(local: u32, own: Moments) -> Moments {
    workgroupBarrier();
    shared_moments[local] = own;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            shared_moments[local] = merged(shared_moments[local], shared_moments[local + half]);
        }
    }
    workgroupBarrier();
    return shared_moments[0];
}

// Standard deviations.
fn deviations(known: Moments) -> vec2<f32> {
    return sqrt(known.squares / max(known.count, 1.0));
}
