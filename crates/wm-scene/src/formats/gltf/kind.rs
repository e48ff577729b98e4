//! The kind of splats that the extension states: colour space, kernel, projection and order.

use crate::{Remark, Splats, sh};
use serde_json::Value;
use wm_base::{color::srgb_encode, error::excerpt};

/// Brings the colours of splats to those of a [`crate::Scene`], and says what of the extension is
/// not as it states.
pub(super) fn interpret(extension: &Value, splats: &mut Splats) -> Vec<Remark> {
    let stated = |key: &str| extension.get(key).and_then(Value::as_str);
    let mut remarks = Vec::new();
    if stated("colorSpace") == Some("lin_rec709_display") {
        encode_colors(splats);
        let text = "glTF: the colours are linear light (lin_rec709_display) and become sRGB splat by splat; where splats \
                    blend, sRGB is blended";
        remarks.push(Remark::note("linear-colours", text));
    }
    for (key, known) in [
        ("kernel", &["ellipse"][..]),
        ("colorSpace", &["srgb_rec709_display", "lin_rec709_display"]),
        ("projection", &["perspective"]),
        ("sortingMethod", &["cameraDistance", "zDepth"]),
    ] {
        if let Some(other) = stated(key).filter(|value| !known.contains(value)) {
            let text = format!(
                "glTF: the {key} {} is not known, {} is taken; export the splats with it",
                excerpt(other.as_bytes()),
                known[0]
            );
            remarks.push(Remark::doubt("splat-kind", text));
        }
    }
    remarks
}

/// Replaces SH of linear light by those of the sRGB colours that they show: the nearest ones of
/// their degree over all directions.
fn encode_colors(splats: &mut Splats) {
    const AZIMUTH_COUNT: usize = 8;
    let directions = sh::QUADRATURE.into_iter().flat_map(|(z, weight)| {
        (0..AZIMUTH_COUNT).map(move |step| {
            let (sine, cosine) =
                (std::f64::consts::TAU * (step as f64 + 0.5) / AZIMUTH_COUNT as f64).sin_cos();
            let across = (1.0 - z * z).sqrt();
            ([across * cosine, across * sine, z], weight * std::f64::consts::TAU / AZIMUTH_COUNT as f64)
        })
    });
    let directions: Vec<([f64; 3], [f64; 16], f64)> =
        directions.map(|(direction, weight)| (direction, sh::basis(direction), weight)).collect();
    let stride = splats.sh_stride();
    for sh in splats.sh.chunks_exact_mut(stride) {
        let mut encoded = [0.0; 48];
        for (direction, basis, weight) in &directions {
            let shown = sh::color(sh, *direction).map(srgb_encode);
            for (k, value) in encoded[..stride].iter_mut().enumerate() {
                *value += weight * basis[k / 3] * (shown[k % 3] - 0.5);
            }
        }
        sh.iter_mut().zip(encoded).for_each(|(value, encoded)| *value = encoded as f32);
    }
}
