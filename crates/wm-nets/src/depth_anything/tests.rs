use super::*;
use crate::testing::{
    self, Files, Named, gap, index, noise, on_threads, pth, safetensors, said, with_header,
};
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

/// The side of the photos of `fixtures/make_depth_anything.py`, px.
const PHOTO_SIDE_PX: usize = 84;
const VERSIONS: [(Version, &str); 2] = [(Version::V1, "v1"), (Version::V2, "v2")];
const PHOTOS: [&str; 2] = ["wide", "tall"];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/depth_anything").join(name)
}

fn npy(name: &str) -> (Vec<usize>, Vec<f32>) {
    testing::npy(&fixture(name))
}

/// A photo, 0-1, and its width.
fn photo(name: &str) -> (Vec<f32>, usize) {
    let (levels, width) = testing::picture(&fixture(&format!("{name}.png")));
    (levels.iter().map(|level| f32::from(*level) / 255.0).collect(), width)
}

static NETWORKS: LazyLock<[DepthAnything; 2]> = LazyLock::new(|| {
    let file = |name: &str| fixture(&format!("{name}/model.safetensors"));
    VERSIONS.map(|(version, name)| DepthAnything::read(&[file(name)], version).unwrap())
});

fn tensors_of_v2() -> Vec<Named> {
    testing::tensors(&fixture("v2/model.safetensors"))
}

/// A folder with the V2 fixture's config.json.
fn folder() -> Files {
    let files = Files::new();
    files.put("config.json", fs::read(fixture("v2/config.json")).unwrap());
    files
}

/// Levels are exact; what follows are a product, a difference and a quotient in f32.
#[test]
fn photos_are_resized_and_normalised_as_by_the_reference() {
    for name in PHOTOS {
        let ((rgb, width), (shape, expected)) = (photo(name), npy(&format!("{name}.pixels.npy")));
        let height = rgb.len() / 3 / width;
        let to = photo::size(width, height, PHOTO_SIDE_PX).unwrap();
        assert_eq!(shape, [3, to.1, to.0], "{name}");
        let image = photo::normalized(&rgb, width, height, to);
        let planes: Vec<f32> =
            (0..3).flat_map(|lane| image.values.iter().skip(lane).step_by(3).copied()).collect();
        let (largest, _) = gap(&planes, &expected);
        println!("{name}: off by {largest:.1e}, where a level is 1.7e-2");
        assert!(largest < 1e-6, "{name}: {largest}");
    }
}

/// From the photo's file to the disparity. A value goes through about 100 sums one after the other,
/// of up to 588 products in f32; those err by 2^-24 sqrt(588) = 1.4e-6 of their size each, and
/// together by sqrt(100) times that, 1.4e-5 of the range, if nothing is amplified. GELU by tanh,
/// the nearest thing to it, is off by 1e-4.
#[test]
fn disparity_is_that_of_the_reference() {
    for ((_, version), network) in VERSIONS.iter().zip(&*NETWORKS) {
        for name in PHOTOS {
            let (rgb, width) = photo(name);
            let (found, file) = (network.predict(&rgb, width).unwrap(), format!("{version}/{name}.npy"));
            let (shape, expected) = npy(&file);
            assert_eq!(shape, [found.height, found.width], "{file}");
            let (largest, range) = gap(&found.values, &expected);
            println!("{file}: off by {largest:.1e} in a range of {range:.1}: {:.1e}", largest / range);
            assert!(range > 10.0 && largest < 1.4e-5 * range, "{file}: {largest} of {range}");
        }
    }
}

#[test]
fn threads_do_not_change_the_result() {
    let (rgb, width) = photo("wide");
    let on = |threads| on_threads(threads, || NETWORKS[1].predict(&rgb, width)).unwrap();
    let one = on(1);
    for threads in [2, 3, 7] {
        assert!(on(threads) == one, "{threads} threads");
    }
}

/// As `convert_depth_anything_to_hf.py` of transformers renames them.
fn original(tensors: &[Named]) -> Vec<Named> {
    let mut pairs = vec![
        ("backbone.embeddings.cls_token".to_owned(), "pretrained.cls_token".to_owned()),
        ("backbone.embeddings.mask_token".into(), "pretrained.mask_token".into()),
        ("backbone.embeddings.position_embeddings".into(), "pretrained.pos_embed".into()),
    ];
    let mut both = |theirs: String, own: String| {
        for part in ["weight", "bias"] {
            pairs.push((format!("{theirs}.{part}"), format!("{own}.{part}")));
        }
    };
    both("backbone.embeddings.patch_embeddings.projection".into(), "pretrained.patch_embed.proj".into());
    both("backbone.layernorm".into(), "pretrained.norm".into());
    for i in 0..12 {
        let (theirs, own) = (format!("backbone.encoder.layer.{i}"), format!("pretrained.blocks.{i}"));
        for part in ["norm1", "norm2", "mlp.fc1", "mlp.fc2"] {
            both(format!("{theirs}.{part}"), format!("{own}.{part}"));
        }
        both(format!("{theirs}.attention.output.dense"), format!("{own}.attn.proj"));
    }
    for i in 0..4 {
        let theirs = format!("neck.reassemble_stage.layers.{i}");
        both(format!("{theirs}.projection"), format!("depth_head.projects.{i}"));
        both(format!("{theirs}.resize"), format!("depth_head.resize_layers.{i}"));
        both(format!("neck.convs.{i}"), format!("depth_head.scratch.layer{}_rn", i + 1));
        let (theirs, own) =
            (format!("neck.fusion_stage.layers.{i}"), format!("depth_head.scratch.refinenet{}", 4 - i));
        both(format!("{theirs}.projection"), format!("{own}.out_conv"));
        for (unit, convolution) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
            let theirs = format!("{theirs}.residual_layer{unit}.convolution{convolution}");
            both(theirs, format!("{own}.resConfUnit{unit}.conv{convolution}"));
        }
    }
    both("head.conv1".into(), "depth_head.scratch.output_conv1".into());
    both("head.conv2".into(), "depth_head.scratch.output_conv2.0".into());
    both("head.conv3".into(), "depth_head.scratch.output_conv2.2".into());
    for i in 0..12 {
        for k in [1, 2] {
            let theirs = format!("backbone.encoder.layer.{i}.layer_scale{k}.lambda1");
            pairs.push((theirs, format!("pretrained.blocks.{i}.ls{k}.gamma")));
        }
    }
    let of = |name: &str| tensors.iter().find(|tensor| tensor.0 == name);
    let rename = |theirs: &str, own: &str| of(theirs).map(|t| (own.to_owned(), t.1.clone(), t.2.clone()));
    let mut named: Vec<Named> = pairs.iter().filter_map(|(theirs, own)| rename(theirs, own)).collect();
    for i in 0..12 {
        for part in ["weight", "bias"] {
            let name = |which| format!("backbone.encoder.layer.{i}.attention.attention.{which}.{part}");
            let three = ["query", "key", "value"].map(|which| of(&name(which)).unwrap());
            let mut shape = three[0].1.clone();
            shape[0] *= 3;
            let values = three.iter().flat_map(|tensor| tensor.2.clone()).collect();
            named.push((format!("pretrained.blocks.{i}.attn.qkv.{part}"), shape, values));
        }
    }
    // Of three each became one.
    assert_eq!(named.len() + 12 * 4, tensors.len());
    named
}

#[test]
fn the_authors_names_and_pytorchs_format_give_the_same() {
    let (files, tensors) = (folder(), tensors_of_v2());
    let (rgb, width) = photo("tall");
    let expected = NETWORKS[1].predict(&rgb, width).unwrap();
    for (name, content) in [
        ("a.pth", pth(&tensors)),
        ("b.pth", pth(&original(&tensors))),
        ("c", safetensors(&original(&tensors))),
    ] {
        let network = DepthAnything::read(&[files.put(name, content)], Version::V2).unwrap();
        assert_eq!(network.size(), None);
        assert!(network.predict(&rgb, width).unwrap() == expected, "{name}");
    }
}

/// By the image processor of the reference.
#[test]
fn sizes_for_the_network() {
    for ((width, height), expected) in [
        ((640, 480), (686, 518)),
        ((518, 518), (518, 518)),
        ((1920, 1080), (924, 518)),
        ((300, 400), (392, 518)),
        // Half a patch, to the even number of patches.
        ((525, 518), (532, 518)),
        ((539, 518), (532, 518)),
        ((8000, 2000), (2072, 518)),
        ((56, 14), (518, 126)),
    ] {
        assert_eq!(photo::size(width, height, 518), Ok(expected), "{width}x{height}");
    }
}

#[test]
fn photos_that_are_refused() {
    let of = |width: usize, height: usize| {
        let error = NETWORKS[0].predict(&vec![0.5; 3 * width * height], width).unwrap_err();
        let line = error.to_string();
        assert!(line.contains(&format!("{width}x{height} px is too")), "{line}");
        error
    };
    assert!(matches!(of(0, 0), DisparityError::Small { .. }));
    assert!(matches!(of(1, 1), DisparityError::Small { .. }));
    assert!(matches!(of(13, 20), DisparityError::Small { .. }));
    assert!(matches!(of(57, 14), DisparityError::Long { .. }));
    assert!(matches!(of(100, 401), DisparityError::Long { .. }));
    // Not refused: what is not in 0-1.
    let mut rgb: Vec<f32> = (0..3 * 20 * 16).map(|i| noise(0, i) as f32 * 5.0).collect();
    rgb[7] = f32::NAN;
    rgb[8] = f32::INFINITY;
    let clamped: Vec<f32> = rgb.iter().map(|v| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) }).collect();
    assert!(NETWORKS[0].predict(&rgb, 20) == NETWORKS[0].predict(&clamped, 20));
    assert!(NETWORKS[0].predict(&rgb, 20).unwrap().values.iter().all(|v| *v >= 0.0));
}

/// Refuses what `change` makes of the V2 fixture's tensors.
fn refused(change: impl FnOnce(&mut Vec<Named>)) -> String {
    let (files, mut tensors) = (folder(), tensors_of_v2());
    change(&mut tensors);
    said(DepthAnything::read(&[files.put("x.safetensors", safetensors(&tensors))], Version::V2))
}

#[test]
fn weights_that_are_refused() {
    let whole = tensors_of_v2();
    // Whatever is missing is named; two are there but unused.
    let name = |index: usize| whole[index].0.clone();
    let unused = |name: &str| {
        name == "backbone.embeddings.mask_token"
            || name.starts_with("neck.fusion_stage.layers.0.residual_layer1")
    };
    for at in (0..whole.len()).step_by(7).filter(|at| !unused(&name(*at))) {
        let line = refused(|tensors| drop(tensors.remove(at)));
        let first_of_block = line.contains("a network of") || line.contains("no tensors of Depth Anything");
        assert!(first_of_block || line.contains(&format!("no tensor {}", name(at))), "{line}");
    }
    let line = refused(|tensors| {
        let at = index(tensors, "neck.convs.1.weight");
        tensors[at].1 = vec![16, 16, 9, 1];
    });
    assert!(
        line.contains("tensor neck.convs.1.weight has shape [16, 16, 9, 1], not [16, 16, 3, 3]; give "),
        "{line}"
    );
    let line = refused(|tensors| {
        let at = index(tensors, "head.conv1.weight");
        tensors[at].2[3] = f32::NAN;
    });
    assert!(line.contains("tensor head.conv1.weight holds NaN"), "{line}");
    let line = refused(|tensors| tensors.retain(|tensor| tensor.0.starts_with("head")));
    assert!(
        line.contains("no tensors of Depth Anything; give model.safetensors of depth-anything/"),
        "{line}"
    );
    let line = refused(|tensors| {
        tensors.retain(|tensor| !(3..12).any(|i| tensor.0.contains(&format!("layer.{i}."))));
    });
    assert!(line.contains("a network of 3 blocks and 6x6 positions, where "), "{line}");

    // Finite weights whose products are not.
    let (files, mut tensors) = (folder(), tensors_of_v2());
    let at = index(&tensors, "neck.convs.0.weight");
    tensors[at].2.fill(f32::MAX);
    let network = DepthAnything::read(&[files.put("x", safetensors(&tensors))], Version::V2).unwrap();
    assert_eq!(network.predict(&vec![0.5; 3 * 20 * 16], 20), Err(DisparityError::NotFinite));

    // Sides that no tensor has, of empty ones.
    for side in ["18446744073709551615", "9223372036854775808", "0"] {
        let name = "backbone.embeddings.patch_embeddings.projection.weight";
        let header = format!(r#"{{"{name}":{{"dtype":"F32","shape":[{side},0],"data_offsets":[0,0]}}}}"#);
        let line = said(DepthAnything::read(&[files.put("y", with_header(&header, b""))], Version::V2));
        assert!(line.contains(&format!("projection.weight has shape [{side}, 0]; give ")), "{line}");
    }

    // Cut off, of something else, not there.
    let bytes = fs::read(fixture("v2/model.safetensors")).unwrap();
    let line = said(DepthAnything::read(&[files.put("y", &bytes[..500_000])], Version::V2));
    assert!(line.contains("damaged or cut off"), "{line}");
    let header = r#"{"features.0.weight":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}"#;
    let line = said(DepthAnything::read(&[files.put("y", with_header(header, &[0; 4]))], Version::V2));
    assert!(line.contains("no tensors of Depth Anything"), "{line}");
    assert!(said(DepthAnything::read(&[files.path().join("no")], Version::V2)).contains("cannot be read"));
    assert!(said(DepthAnything::read(&[], Version::V2)).contains("no tensors of Depth Anything"));
}

#[test]
fn names_and_configurations_that_contradict() {
    let line = said(DepthAnything::read(&[fixture("v2/model.safetensors")], Version::V1));
    assert!(line.contains("by the config.json beside it V2, not V1; give "), "{line}");
    let (files, bytes) = (folder(), fs::read(fixture("v2/model.safetensors")).unwrap());
    let of = |name: &str| DepthAnything::read(&[files.put(name, &bytes)], Version::V2);
    let line = said(of("depth_anything_v2_Metric_vkitti_vits.safetensors"));
    assert!(line.contains("by its name a metric network"), "{line}");
    let config = fs::read_to_string(fixture("v2/config.json")).unwrap();
    let changed = |from: &str, to: &str| {
        assert!(config.contains(from), "{from}");
        files.put("config.json", config.replace(from, to));
        said(of("x"))
    };
    let line = changed(r#""depth_estimation_type": "relative""#, r#""depth_estimation_type": "metric""#);
    assert!(line.contains("by the config.json beside it a metric network"), "{line}");
    let line = changed("      9,\n", "      8,\n");
    assert!(line.contains("after blocks [3, 6, 8, 12], not [3, 6, 9, 12]"), "{line}");
    let line = changed(r#""num_attention_heads": 2"#, r#""num_attention_heads": 3"#);
    assert!(line.contains("a network of 32 channels"), "{line}");
    // Of something else, or nothing: heads have 64 channels.
    let line = changed(r#""model_type": "depth_anything""#, r#""model_type": "dpt""#);
    assert!(line.contains("a network of 32 channels"), "{line}");
    files.put("config.json", "{");
    assert!(said(of("x")).contains("a network of 32 channels"));
}

#[test]
fn published_networks() {
    let of = |channels, blocks| Architecture {
        naming: tensors::Naming::Original,
        channels,
        blocks,
        heads: 1,
        grid: 37,
        neck: [1; 4],
        fusion: 2,
        last: 1,
    };
    assert_eq!(
        [of(384, 12), of(768, 12), of(1024, 24), of(1536, 40)].map(|network| network.size()),
        [Some(ModelSize::Small), Some(ModelSize::Base), Some(ModelSize::Large), None]
    );
    let taps = |version| [12, 24].map(|blocks| of(384, blocks).taps(version));
    assert_eq!(taps(Version::V1), [[9, 10, 11, 12], [21, 22, 23, 24]]);
    assert_eq!(taps(Version::V2), [[3, 6, 9, 12], [5, 12, 18, 24]]);
    let licence = |size, version| DepthAnything::licence(size, version).to_string();
    assert_eq!(licence(ModelSize::Small, Version::V2), "Apache-2.0 (any use)");
    assert!(licence(ModelSize::Base, Version::V2).starts_with("CC-BY-NC-4.0 (no commercial use"));
    assert_eq!(DepthAnything::licence(ModelSize::Large, Version::V1), Licence::Apache2);
}
