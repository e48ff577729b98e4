use super::*;
use crate::testing::{Files, Named, noise, on_threads, pth, safetensors};
use std::sync::LazyLock;

/// Weights that neither kill nor blow up what goes through: stream 3 i of [`noise`] times
/// `sqrt(6 / (in k k))` for the weights of convolution i, stream 3 i + 1 times 0.1 for its biases,
/// stream 3 i + 2 in 0-1 for its head.
fn made_up() -> Vec<Named> {
    let stream = |stream: usize, tensor: (String, Vec<usize>), value: &dyn Fn(f64) -> f64| {
        let (name, shape) = tensor;
        let count = shape.iter().product::<usize>() as u64;
        let values = (0..count).map(|index| value(noise(stream as u64, index)) as f32).collect();
        (name, shape, values)
    };
    let layer = |i: usize, layer: &Layer| {
        let scale = (6.0 / (layer.channels.0 * layer.kernel * layer.kernel) as f64).sqrt();
        [
            stream(3 * i, layer.weight(), &|v| v * scale),
            stream(3 * i + 1, layer.bias(), &|v| 0.1 * v),
            stream(3 * i + 2, layer.head(i), &|v| 0.5 + 0.5 * v),
        ]
    };
    LAYERS.iter().enumerate().flat_map(|(i, of)| layer(i, of)).collect()
}

static WEIGHTS: LazyLock<Vec<Named>> = LazyLock::new(made_up);
static NETWORK: LazyLock<Lpips> = LazyLock::new(|| {
    let files = Files::new();
    Lpips::read(&[files.put("x.safetensors", safetensors(&WEIGHTS))]).unwrap()
});

/// Noise of 8x8 px blocks (stream s) and of values (s + 1), and a share of stream 200:
/// 0.5 + 0.25 (block + value) + share.
fn picture_with(share: f64, stream: u64, size: (usize, usize)) -> Vec<f32> {
    let (width, height) = size;
    let of = |i: usize| {
        let (lane, column, row) = (i % 3, i / 3 % width, i / 3 / width);
        let block = (row / 8 * width.div_ceil(8) + column / 8) * 3 + lane;
        let exact = 0.5 + 0.25 * noise(stream, block as u64) + 0.25 * noise(stream + 1, i as u64);
        (exact + share * noise(200, i as u64)).clamp(0.0, 1.0) as f32
    };
    (0..3 * width * height).map(of).collect()
}

fn picture(stream: u64, size: (usize, usize)) -> Vec<f32> {
    picture_with(0.0, stream, size)
}

fn noisy(stream: u64, size: (usize, usize)) -> Vec<f32> {
    picture_with(0.02, stream, size)
}

/// The package lpips 0.1.4 with torchvision's AlexNet, in f64, `normalize=True`, gives these
/// distances for the made-up weights and pictures: picture(100) against picture(110), noisy(100)
/// and plain 0.5.
const PUBLISHED: [((usize, usize), [f64; 3]); 3] = [
    ((31, 31), [0.869_379_993_503, 0.003_363_154_980_04, 1.357_570_380_53]),
    ((64, 48), [0.898_378_658_649, 0.002_883_871_364_36, 1.330_830_306]),
    ((97, 53), [0.887_862_878_519, 0.003_311_065_656_66, 1.295_084_797_05]),
];

/// A feature is a sum of at most 3456 products in f32, off by about sqrt(3456) 2^-24 of its size,
/// and what five layers add is independent: sqrt(5) times that, 8e-6 of the features' length. With
/// weights up to 1 the distance d of a layer is the square of a length, so off by 2 sqrt(d) 8e-6,
/// and the sum of five such roots is at most sqrt(5 d).
fn tolerance(distance: f64) -> f64 {
    2.0 * 8e-6 * (5.0 * distance).sqrt()
}

#[test]
fn distances_are_those_of_the_published_program() {
    for (size, expected) in PUBLISHED {
        let x = picture(100, size);
        let others = [picture(110, size), noisy(100, size), vec![0.5; x.len()]];
        for (y, expected) in others.iter().zip(expected) {
            let found = NETWORK.distance(&x, y, None, size.0);
            println!("{size:?}: {found:.12} for {expected:.12}, off by {:.1e}", (found - expected).abs());
            assert!((found - expected).abs() < tolerance(expected), "{size:?}: {found} for {expected}");
        }
    }
}

#[test]
fn equal_pictures_are_at_zero_and_order_does_not_matter() {
    let size = (45, 33);
    let (x, y) = (picture(100, size), picture(110, size));
    assert_eq!(NETWORK.distance(&x, &x, None, size.0), 0.0);
    let (there, back) = (NETWORK.distance(&x, &y, None, size.0), NETWORK.distance(&y, &x, None, size.0));
    assert!(there > 0.0 && there == back, "{there} {back}");
    // Nearer pictures have the lower distance.
    let near = NETWORK.distance(&x, &noisy(100, size), None, size.0);
    assert!(near > 0.0 && near < 0.1 * there, "{near} {there}");
    // What a screen does not show does not count.
    let shown = |v: f32| [v.clamp(0.0, 1.0), v];
    let [inside, beyond]: [Vec<f32>; 2] =
        [0, 1].map(|which| y.iter().map(|v| shown(3.0 * v - 1.0)[which]).collect());
    assert_eq!(NETWORK.distance(&x, &beyond, None, size.0), NETWORK.distance(&x, &inside, None, size.0));
}

#[test]
fn what_is_masked_does_not_count() {
    let size = (64, 40);
    let (truth, mut shown) = (picture(100, size), picture(110, size));
    let count = size.0 * size.1;
    assert_eq!(NETWORK.distance(&shown, &truth, Some(&vec![0.0; count]), size.0), 0.0);
    let of_all = NETWORK.distance(&shown, &truth, None, size.0);
    let ones = NETWORK.distance(&shown, &truth, Some(&vec![1.0; count]), size.0);
    assert!((ones - of_all).abs() < 1e-6 * of_all, "{ones} {of_all}");
    // The left half: whatever stands in the right one.
    let mask: Vec<f32> = (0..count).map(|i| f32::from(u8::from(i % size.0 < 32))).collect();
    let half = NETWORK.distance(&shown, &truth, Some(&mask), size.0);
    assert!(half > 0.2 * of_all && half < 0.8 * of_all, "{half} {of_all}");
    for (i, value) in shown.iter_mut().enumerate() {
        if mask[i / 3] == 0.0 {
            *value = 0.9;
        }
    }
    assert_eq!(NETWORK.distance(&shown, &truth, Some(&mask), size.0), half);
}

#[test]
fn threads_do_not_change_the_result() {
    let size = (150, 90);
    let (x, y) = (picture(100, size), picture(110, size));
    let with = |threads| on_threads(threads, || NETWORK.distance(&x, &y, None, size.0));
    let one = with(1);
    assert_eq!([with(2), with(5)], [one; 2]);
}

#[test]
#[should_panic(expected = "31x30 px is too small")]
fn pictures_that_are_too_small() {
    let x = vec![0.5; 3 * 31 * 30];
    let _ = NETWORK.distance(&x, &x, None, 31);
}

#[test]
fn weights_in_two_files_of_either_format() {
    let files = Files::new();
    let (heads, network): (Vec<Named>, Vec<Named>) =
        WEIGHTS.iter().cloned().partition(|(name, ..)| name.starts_with("lin"));
    let size = (31, 40);
    let (x, y) = (picture(100, size), picture(110, size));
    let network = files.put("network.pth", pth(&network));
    let heads = files.put("heads.safetensors", safetensors(&heads));
    let expected = NETWORK.distance(&x, &y, None, size.0);
    for order in [[&network, &heads], [&heads, &network]] {
        let read = Lpips::read(&order.map(Clone::clone)).unwrap();
        assert_eq!(read.distance(&x, &y, None, size.0), expected);
    }
    for (file, missing) in [
        (&network, "lin0.model.1.weight of shape [1, 64, 1, 1]"),
        (&heads, "features.0.weight of shape [64, 3, 11, 11]"),
    ] {
        let line = Lpips::read(std::slice::from_ref(file)).unwrap_err().to_string();
        assert!(
            line.starts_with(&format!("{}: no tensor {missing}; LPIPS takes ", file.display())),
            "{line}"
        );
    }
}

#[test]
fn each_tensor_is_looked_for_with_its_shape() {
    let files = Files::new();
    let all = tensors();
    assert_eq!(all.len(), 15);
    for wrong in 0..all.len() {
        // Shapes alone matter here: one number less makes another shape.
        let mut some: Vec<Named> = WEIGHTS[..=wrong].to_vec();
        let (name, shape, values) = &mut some[wrong];
        assert_eq!((&*name, &*shape), (&all[wrong].0, &all[wrong].1));
        let expected = shape.clone();
        *shape = vec![values.len()];
        if *shape == expected {
            shape.insert(0, 1);
        }
        let found = shape.clone();
        let line = format!("tensor {name} has shape {found:?}, not {expected:?}; LPIPS takes ");
        let path = files.put("x", safetensors(&some));
        let error = Lpips::read(&[path]).unwrap_err().to_string();
        assert!(error.contains(&line), "{error}");
    }
}
