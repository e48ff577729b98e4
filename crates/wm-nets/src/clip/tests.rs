use super::*;
use crate::testing::{
    self, Files, Named, gap, index, noise, npy, on_threads, pth, safetensors, said, with_header,
};
use std::path::Path;
use std::sync::LazyLock;

/// The photos of `fixtures/make_clip.py`, whose network takes squares of 84 px and gives 48
/// numbers.
const PHOTOS: [&str; 2] = ["wide", "tall"];
const PHOTO_SIDE_PX: usize = 84;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/clip").join(name)
}

/// The photos are those of Depth Anything's fixtures.
fn photo(name: &str) -> (Vec<u8>, usize) {
    testing::picture(&fixture(&format!("../depth_anything/{name}.png")))
}

static NETWORK: LazyLock<Clip> = LazyLock::new(|| Clip::read(&[fixture("model.safetensors")]).unwrap());

fn tensors() -> Vec<Named> {
    testing::tensors(&fixture("model.safetensors"))
}

/// One is cut and made smaller, one cut and made larger.
#[test]
fn the_square_in_the_middle_is_that_of_the_reference() {
    for name in PHOTOS {
        let (levels, width) = photo(name);
        let (expected, side) = testing::picture(&fixture(&format!("{name}.png")));
        assert_eq!(side, PHOTO_SIDE_PX);
        assert!(square(&levels, width, PHOTO_SIDE_PX) == expected, "{name}");
    }
}

/// From the photo's file to the embedding. Three norms a block and two more keep what goes through
/// near 1, and each of some 20 sums one after the other, of up to 588 products in f32, errs by
/// 2^-24 sqrt(588) = 1.4e-6 of its size: together by sqrt(20) times that, 6.5e-6, of a component
/// that is about 1 / sqrt(48). GELU by erf in place of the sigmoid is off by 1e-3.
#[test]
fn embeddings_are_those_of_the_reference() {
    for name in PHOTOS {
        let (levels, width) = photo(name);
        let found = NETWORK.embed(&levels, width).unwrap();
        let (shape, expected) = npy(&fixture(&format!("{name}.npy")));
        assert_eq!(shape, [NETWORK.width()]);
        let (largest, range) = gap(&found, &expected);
        println!("{name}: off by {largest:.1e} in a range of {range:.2}");
        assert!(range > 0.5 && largest < 6.5e-6 / 48f32.sqrt(), "{name}: {largest} of {range}");
        let length: f32 = found.iter().map(|v| v * v).sum();
        assert!((length - 1.0).abs() < 1e-6, "{length}");
    }
}

#[test]
fn threads_do_not_change_the_result() {
    let (levels, width) = photo("wide");
    let on = |threads| on_threads(threads, || NETWORK.embed(&levels, width)).unwrap();
    assert_eq!([on(2), on(5)], [on(1), on(1)]);
}

#[test]
fn any_picture_has_an_embedding() {
    for (width, height) in [(1, 1), (1, 300), (7, 2), (84, 84), (200, 84)] {
        let levels: Vec<u8> =
            (0..3 * width * height).map(|i| (noise(3, i as u64) * 127.0 + 128.0) as u8).collect();
        assert_eq!(NETWORK.embed(&levels, width).unwrap().len(), 48, "{width}x{height}");
    }
}

#[test]
fn published_sizes_are_known() {
    assert!(!NETWORK.is_published());
    assert_eq!(Architecture::PUBLISHED.grid * Architecture::PUBLISHED.patch, 336);
    assert_eq!(Clip::licence().to_string(), "MIT (any use)");
}

/// Refuses what `change` makes of the fixture's tensors.
fn refused(change: impl FnOnce(&mut Vec<Named>)) -> String {
    let (files, mut tensors) = (Files::new(), tensors());
    change(&mut tensors);
    said(Clip::read(&[files.put("x.safetensors", safetensors(&tensors))]))
}

#[test]
fn weights_that_are_refused() {
    // Whatever is missing is named.
    let whole = tensors();
    for at in (0..whole.len()).step_by(3) {
        let name = whole[at].0.clone();
        let line = refused(|tensors| drop(tensors.remove(at)));
        let first = line.contains("no tensors of CLIP's") || line.contains("1 blocks");
        assert!(first || line.contains(&format!("no tensor {name}")), "{name}: {line}");
    }
    let line = refused(|tensors| {
        let at = index(tensors, "vision_model.encoder.layers.1.mlp.fc2.weight");
        tensors[at].1.reverse();
    });
    assert!(
        line.contains("mlp.fc2.weight has shape [256, 128], not [128, 256]; give the weights of "),
        "{line}"
    );
    let line = refused(|tensors| {
        let at = index(tensors, "visual_projection.weight");
        tensors[at].2[5] = f32::NAN;
    });
    assert!(line.contains("tensor visual_projection.weight holds NaN"), "{line}");
    let line = refused(|tensors| {
        let at = index(tensors, "vision_model.embeddings.position_embedding.weight");
        tensors[at].1[0] = 36;
        tensors[at].2.truncate(36 * 128);
    });
    assert!(line.contains("36 positions and patches of 14x14 px, where CLIP ViT-L/14"), "{line}");
    let line = refused(|tensors| tensors.retain(|tensor| tensor.0.starts_with("visual")));
    assert!(line.contains("no tensors of CLIP's vision_model; give the weights of openai/"), "{line}");

    // Sides that no tensor has, of empty ones.
    let files = Files::new();
    for side in ["18446744073709551615", "9223372036854775808", "0"] {
        let name = "vision_model.embeddings.patch_embedding.weight";
        for shape in [format!("[0,3,{side},0]"), format!("[{side},3,0,14]")] {
            let header = format!(r#"{{"{name}":{{"dtype":"F32","shape":{shape},"data_offsets":[0,0]}}}}"#);
            let line = said(Clip::read(&[files.put("y", with_header(&header, b""))]));
            assert!(line.contains("; give the weights of ") || line.contains("damaged"), "{line}");
        }
    }

    // Finite weights whose products are not.
    let mut tensors = tensors();
    let at = index(&tensors, "visual_projection.weight");
    tensors[at].2.fill(f32::MAX);
    let network = Clip::read(&[files.put("x", safetensors(&tensors))]).unwrap();
    assert_eq!(network.embed(&[200; 3 * 20 * 16], 20), Err(NotFinite));
}

#[test]
fn pytorchs_format_and_the_texts_part_change_nothing() {
    let (files, mut tensors) = (Files::new(), tensors());
    tensors.push(("text_model.embeddings.token_embedding.weight".into(), vec![2, 3], vec![0.0; 6]));
    let (levels, width) = photo("tall");
    let network = Clip::read(&[files.put("a.bin", pth(&tensors))]).unwrap();
    assert_eq!(network.embed(&levels, width), NETWORK.embed(&levels, width));
    assert_eq!(network.identity(), NETWORK.identity());
    let at = index(&tensors, "visual_projection.weight");
    tensors[at].2[0] += 0.1;
    let other = Clip::read(&[files.put("b.bin", pth(&tensors))]).unwrap();
    assert_ne!(other.identity(), NETWORK.identity());
}
