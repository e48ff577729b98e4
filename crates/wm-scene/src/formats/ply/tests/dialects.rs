//! Dialects of other trainings, and what is said about them.

use super::*;
use crate::Severity;

/// The properties of a splat without those that dialects have in another form.
const START: &str = "x y z opacity rot_0 rot_1 rot_2 rot_3";

/// A text file of float properties, or of those whose type is written before a colon, and rows of
/// numbers.
fn file(names: &str, rows: &[&str]) -> Vec<u8> {
    let property = |name: &str| {
        let (kind, name) = name.split_once(':').unwrap_or(("float", name));
        format!("property {kind} {name}\n")
    };
    let lines: String = names.split_whitespace().map(property).collect();
    let count = rows.len();
    let body: String = rows.iter().map(|row| format!("{row}\n")).collect();
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{lines}end_header\n{body}").into_bytes()
}

fn read(names: &str, rows: &[&str]) -> Scene {
    read_bytes(&file(names, rows)).unwrap()
}

/// Weights and names of the remarks of a scene.
fn codes(scene: &Scene) -> Vec<(Severity, &'static str)> {
    scene.remarks.iter().map(|remark| (remark.severity, remark.code)).collect()
}

use Severity::{Doubt, Note};

#[test]
fn two_scales_are_flat_and_one_is_a_ball() {
    let flat =
        read(&format!("{START} f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1"), &["1 2 3 0.5 1 0 0 0 0 0 0 -2 -3"]);
    assert_eq!(flat.splats.log_scales, [[-2.0, -3.0, f32::NEG_INFINITY]]);
    assert_eq!((codes(&flat), flat.check_finite()), (vec![(Note, "flat")], Ok(())));
    let ball = read("x y z opacity f_dc_0 f_dc_1 f_dc_2 scale_0", &["1 2 3 0.5 0 0 0 -2"]);
    assert_eq!((ball.splats.log_scales[0], ball.splats.quats[0]), ([-2.0; 3], [1.0, 0.0, 0.0, 0.0]));
}

#[test]
fn colours_count_by_their_type_and_range() {
    let names = |kind: &str| format!("{START} scale_0 scale_1 scale_2 {kind}:red {kind}:green {kind}:blue");
    let start = "1 2 3 0.5 1 0 0 0 -2 -2 -2";
    for (kind, colors) in [
        ("uchar", "255 51 0"),
        ("ushort", "65535 13107 0"),
        ("ushort", "255 51 0"),
        ("float", "1 0.2 0"),
        ("float", "255 51 0"),
        ("double", "65535 13107 0"),
    ] {
        let scene = read(&names(kind), &[&format!("{start} {colors}")]);
        let shown = scene.splats.base_color(0);
        let far = shown.iter().zip([1.0, 0.2, 0.0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < 1e-6, "{kind} {colors}: {shown:?}");
        assert_eq!(codes(&scene), [(Note, "rgb")]);
    }
    // Beside SH they only repeat it.
    let both = read(
        &format!("{START} scale_0 scale_1 scale_2 f_dc_0 f_dc_1 f_dc_2 uchar:red"),
        &[&format!("{start} 1 2 3 255")],
    );
    assert_eq!((both.splats.sh_of(0), codes(&both)), (&[1.0, 2.0, 3.0][..], vec![]));
}

#[test]
fn the_filter_of_mip_splatting_is_baked() {
    let names = format!("{START} f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2 filter_3D");
    let (s, f): ([f64; 3], f64) = ([0.1, 0.02, 0.5], 0.05);
    let [a, b, c] = s.map(f64::ln);
    let scene = read(
        &names,
        &[&format!("1 2 3 1.5 1 0 0 0 0 0 0 {a} {b} {c} {f}"), "1 2 3 1.5 1 0 0 0 0 0 0 -1 -1 -inf 0"],
    );
    let wide = s.map(|s| (s * s + f * f).sqrt());
    let opacity = crate::splats::sigmoid(1.5) * (s[0] * s[1] * s[2]) / (wide[0] * wide[1] * wide[2]);
    assert!((scene.splats.opacity(0) - opacity).abs() < 1e-6);
    for (found, expected) in scene.splats.scales(0).iter().zip(wide) {
        assert!((found / expected - 1.0).abs() < 1e-6);
    }
    assert_eq!(
        (scene.splats.log_scales[1], scene.splats.logit_opacities[1]),
        ([-1.0, -1.0, f32::NEG_INFINITY], 1.5)
    );
    assert_eq!(codes(&scene), [(Note, "filter-3d")]);
}

#[test]
fn degree_4_is_cut_and_said() {
    let rest: Vec<String> = (0..72).map(|i| format!("f_rest_{i}")).collect();
    let values: Vec<String> = (0..72).map(|i| i.to_string()).collect();
    let names = format!("{START} scale_0 scale_1 scale_2 f_dc_0 f_dc_1 f_dc_2 {}", rest.join(" "));
    let row = format!("1 2 3 1.5 1 0 0 0 -1 -1 -1 0 0 0 {}", values.join(" "));
    let scene = read(&names, &[&row]);
    // The first coefficients of red, green and blue: 24 of each are in the file, 15 are kept.
    let sh = scene.splats.sh_of(0);
    assert_eq!((sh.len(), &sh[3..6], &sh[45..]), (48, &[0.0, 24.0, 48.0][..], &[14.0, 38.0, 62.0][..]));
    assert_eq!(codes(&scene), [(Doubt, "sh-degree")]);
}

#[test]
fn points_are_balls_by_their_distance() {
    let rows = [
        "0 0 0 255 0 0",
        "1 0 0 0 255 0",
        "2 0 0 0 0 255",
        "3 0 0 9 9 9",
        "900 0 0 9 9 9",
        "0 0 0 1 2 3",
        "nan 0 0 1 2 3",
    ];
    let scene = read("double:x y z uchar:diffuse_red uchar:diffuse_green uchar:diffuse_blue", &rows);
    assert_eq!(codes(&scene), [(Doubt, "points")]);
    assert!(scene.remarks[0].text.starts_with("7 points and no splats"), "{}", scene.remarks[0]);
    let sizes: Vec<f64> = (0..6).map(|i| scene.splats.scales(i)[0]).collect();
    assert!(sizes.iter().all(|size| *size > 0.2 && *size < 4.0), "{sizes:?}");
    assert!((scene.splats.base_color(1)[1] - 1.0).abs() < 1e-6 && scene.splats.opacity(0) > 0.9);
    assert_eq!(scene.check_finite().unwrap_err().faulty, 1);
    let lone = read("x y z", &["5 5 5"]);
    assert_eq!((lone.check_finite(), lone.splats.base_color(0)), (Ok(()), [0.5; 3]));
    let mut mesh = file("x y z", &["0 0 0", "1 0 0", "0 1 0"]);
    let faces = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let at = mesh.windows(11).position(|w| w == b"end_header\n").unwrap();
    mesh.splice(at..at + 11, faces.iter().copied());
    mesh.extend(b"3 0 1 2\n");
    let scene = read_bytes(&mesh).unwrap();
    assert!(scene.remarks[0].text.contains("of a mesh whose 1 faces are not read"), "{}", scene.remarks[0]);
    assert!(scene.remarks[0].text.contains("grey as they have no colours"));
    // Many points in one place are as large as the unit.
    let same = vec!["1 1 1"; 300];
    assert_eq!(read("x y z", &same).check_finite(), Ok(()));
}

#[test]
fn other_properties_are_told_by_what_they_may_change() {
    let usual = format!("{START} f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2");
    let row = "1 2 3 1.5 1 0 0 0 0 0 0 -1 -1 -1";
    for (more, expected) in [
        ("nx ny nz uchar:red uchar:green uchar:blue", vec![]),
        ("semantic_0 semantic_1 confidence", vec![(Note, "unused-property")]),
        ("int:cluster", vec![(Note, "unused-property")]),
        ("beta", vec![(Doubt, "unknown-property")]),
        ("trbf_center trbf_scale motion_0", vec![(Doubt, "moving")]),
        (
            "semantic_0 t shape",
            vec![(Note, "unused-property"), (Doubt, "moving"), (Doubt, "unknown-property")],
        ),
    ] {
        let values = " 1".repeat(more.split(' ').count());
        let scene = read(&format!("{usual} {more}"), &[&format!("{row}{values}")]);
        assert_eq!(codes(&scene), expected, "{more}");
    }
    let many: Vec<String> = (0..9).map(|i| format!("beta_{i}")).collect();
    let scene = read(&format!("{usual} {}", many.join(" ")), &[&format!("{row}{}", " 1".repeat(9))]);
    assert!(
        scene.remarks[0]
            .text
            .starts_with("the properties beta_0, beta_1, beta_2, beta_3 and 5 more are not understood")
    );
    let anchors = read_bytes(&file(&format!("{usual} f_offset_0 f_anchor_feat_0"), &[&format!("{row} 0 0")]));
    let error = anchors.unwrap_err().to_string();
    assert!(error.contains("it has anchors (the property f_offset_0)"), "{error}");
}

#[test]
fn comments_of_trainings_state_facts() {
    let names = format!("{START} f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2");
    let plain = String::from_utf8(file(&names, &["1 2 3 1.5 1 0 0 0 0 0 0 -1 -1 -1"])).unwrap();
    let metadata = |comment: &str| {
        let text = plain.replace("element vertex", &format!("{comment}\nelement vertex"));
        read_bytes(text.as_bytes()).unwrap().metadata
    };
    for (comment, up) in [
        ("comment Vertical axis: 0 -2 0", Some(DVec3::NEG_Y)),
        ("comment Vertical Axis: z", Some(DVec3::Z)),
        ("comment vertical axis: -y", Some(DVec3::NEG_Y)),
        ("comment Vertical axis: up", None),
        ("comment Vertical axis: 0 0 0", None),
        ("comment Vertical axis: nan 0 1", None),
        ("comment Vertical axis: z\ncomment wm.up [0, 1, 0]", Some(DVec3::Y)),
        ("comment wm.up [0, 1, 0]\ncomment Vertical axis: z", Some(DVec3::Y)),
    ] {
        assert_eq!(metadata(comment).up, up, "{comment}");
    }
    assert_eq!(
        metadata("comment SplatRenderMode: mip").rasterization,
        Some(crate::Rasterization::Antialiased)
    );
    assert_eq!(metadata("comment SplatRenderMode: default").rasterization, None);
}

#[test]
fn numbers_that_look_activated_are_doubted() {
    let names = format!("{START} f_dc_0 f_dc_1 f_dc_2 scale_0 scale_1 scale_2");
    let rows = ["1 2 3 0.9 1 0 0 0 0 0 0 0.1 0.2 0.01", "2 2 3 0.1 1 0 0 0 0 0 0 0.1 0.2 0.01"];
    assert_eq!(codes(&read(&names, &rows)), [(Doubt, "activated")]);
    let rows = ["1 2 3 0.9 1 0 0 0 0 0 0 0.1 0.2 0.01", "2 2 3 4 1 0 0 0 0 0 0 0.1 0.2 0.01"];
    assert_eq!(codes(&read(&names, &rows)), []);
}
