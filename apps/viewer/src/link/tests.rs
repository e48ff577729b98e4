//! Links are what they were made of, and hostile ones do nothing.

use super::*;
use crate::testing::{catalog, state};
use proptest::prelude::*;
use proptest::sample::select;
use proptest::strategy::ValueTree;
use serde_json::{Value, json};
use wm_base::random::RandomSequence;
use wm_weather::param::ParamKind;
use wm_weather::presets::PRESETS;
use wm_weather::{EFFECTS, Weather};

/// A number whose decimals are of every length.
fn number(within: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    prop_oneof![within.clone(), within.prop_map(|v| (v * 8.0).round() / 8.0), Just(-0.0), Just(1e-300)]
}

/// Weathers as pages have them: of a preset or of a few effects, with whole numbers, keyframes and
/// texts.
fn weathers() -> impl Strategy<Value = Value> {
    let preset = (0..PRESETS.len())
        .prop_map(|index| crate::state::weather_to_json(&Weather::preset(PRESETS[index].0).unwrap()));
    let params: Vec<(&str, &str, f64, f64)> = EFFECTS
        .iter()
        .flat_map(|effect| effect.params.iter().map(move |param| (effect.name, param)))
        .filter(|(_, param)| param.kind == ParamKind::Number)
        .map(|(effect, param)| {
            let (least, greatest) = param.range;
            (effect, param.name, least.max(-1e6), greatest.min(1e6))
        })
        .collect();
    let set = (0..params.len(), 0.0..1.0_f64, any::<bool>());
    let effects = proptest::collection::vec(set, 0..6).prop_map(move |sets| {
        let mut weather = json!({});
        for (index, share, has_keys) in sets {
            let (effect, param, least, greatest) = params[index];
            let value = least + share * (greatest - least);
            let value = if value.fract() == 0.0 { json!(value as i64) } else { json!(value) };
            let keyed = json!({ "keys": [[0, value, "smooth"], [share + 0.1, value]] });
            weather[effect][param] = if has_keys { keyed } else { value };
        }
        weather
    });
    (prop_oneof![preset, effects], proptest::option::of("\\PC{0,12}|<script>\"'\n\t</script>")).prop_map(
        |(mut weather, name)| {
            weather.as_object_mut().unwrap().extend(name.map(|name| ("name".into(), json!(name))));
            weather
        },
    )
}

fn poses() -> impl Strategy<Value = Pose> {
    let eye = [number(-1e5..1e5), number(-1e5..1e5), number(-1e5..1e5)];
    let rotation = [0.1..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0_f64];
    (eye, rotation, 1.0..170.0_f64).prop_map(|(eye, rotation, fov)| Pose { eye, rotation, fov })
}

fn paths() -> impl Strategy<Value = Vec<PoseKey>> {
    proptest::collection::vec((0.01..9.0_f64, poses()), 0..9).prop_map(|keys| {
        let mut time = 0.0;
        let key = |(after, Pose { eye, rotation, fov })| {
            time += after;
            PoseKey { time, eye, rotation, fov }
        };
        keys.into_iter().map(key).collect()
    })
}

fn lidars() -> impl Strategy<Value = Option<crate::state::LidarState>> {
    let at = proptest::option::of([number(-1e5..1e5), number(-1e5..1e5), number(-1e5..1e5)]);
    let some = (at, any::<bool>(), 0..5_usize).prop_map(|(at, is_one, returns)| {
        let at = at.map(|[x, y, z]| json!({ "eye": [x, y, z], "target": [x + 3.0, y + 0.1, z] }));
        let returns = crate::lidar::return_names()[returns];
        let sub_rays = if is_one { 1 } else { 7 };
        let lidar = json!({ "model": "vlp-16", "at": at, "sub_rays": sub_rays, "returns": returns });
        serde_json::from_value(lidar).unwrap()
    });
    proptest::option::of(some)
}

fn states() -> impl Strategy<Value = ViewState> {
    let times = number(-1e6..1e6);
    let divider = proptest::option::of(0.0..=1.0_f64);
    (weathers(), poses(), paths(), times, 0..4_usize, divider, lidars(), any::<bool>()).prop_map(
        |(weather, camera, path, time, output, divider, lidar, follows)| {
            let follow = if follows && !path.is_empty() { Follow::Path } else { Follow::Camera };
            let output = ViewOutput::ALL[output].0;
            ViewState { weather, camera, path, follow, time, output, divider, lidar, ..state() }
        },
    )
}

proptest! {
    #[test]
    fn a_link_opens_its_state_bit_by_bit(state in states()) {
        let catalog = catalog();
        let view = View::new(state, &catalog, None).map_err(TestCaseError::fail)?;
        let link = encode(&view.state).map_err(TestCaseError::fail)?;
        prop_assert!(link.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.,=&".contains(&byte)), "{link}");
        let base = ViewState { size: [33, 21], quality: 7, ..crate::testing::state() };
        let opened = open(&link, &catalog, &base).map_err(TestCaseError::fail)?;
        let expected = ViewState { size: base.size, quality: base.quality, ..view.state.clone() };
        // As texts, in which -0 is another number than 0.
        let text = |state: &ViewState| serde_json::to_string(state).unwrap();
        prop_assert_eq!(text(&opened.state), text(&expected));
        prop_assert_eq!(&opened.camera_file, &view.camera_file);
        prop_assert_eq!(&opened.weather, &view.weather);
        prop_assert_eq!(encode(&opened.state).unwrap(), link);
    }
}

#[test]
fn links_stay_the_same() {
    let mut state = ViewState { weather: json!({ "fog": { "mor": 80 } }), time: 1.5, ..state() };
    state.camera.fov = 50.0;
    let weather = "w=i07LT4_lys0vUrBVsDDgAgA";
    assert_eq!(encode(&state).unwrap(), format!("v=1&{weather}&c=0,0,0,1,0,0,0,50&t=1.5"));
    (state.output, state.divider) = (ViewOutput::Depth, Some(0.5));
    let link = encode(&state).unwrap();
    assert!(link.ends_with("&t=1.5&o=depth&d=0.5"), "{link}");
    // A browser gives it with its mark, and whoever wrote it by hand in any order.
    assert_eq!(decode(&format!("#{link}"), &state), Ok(state.clone()));
    let mut parts: Vec<&str> = link.split('&').collect();
    parts.reverse();
    assert_eq!(decode(&parts.join("&"), &state), Ok(state));
}

#[test]
fn what_is_no_link_is_told_in_a_line() {
    let link = encode(&state()).unwrap();
    let with = |key: &str, value: &str| with(&link, key, value);
    for (text, expected) in [
        (String::new(), "it has no version"),
        ("fog".into(), "it has no version"),
        (with("v", "2") + "&new=1", "its version is 2, and this page is older"),
        (with("v", "0"), "the version must be 1"),
        (with("v", "x"), "the version must be 1"),
        (link.clone() + "&<script>alert(1)</script>=1", "unknown key `<script>"),
        (link.clone() + "&\n\u{1b}=1", r"unknown key `\u{1b}`"),
        (link.clone() + "&t=1", "the key `t` is there twice"),
        ("v=1&t=0".into(), "the key `w` is missing"),
        (with("t", "1,2"), "t is `1,2`: must be a number"),
        (with("t", "1e999"), "must be a number"),
        (with("d", "nan"), "d is `nan`"),
        (with("d", "2"), "divider: must be a share"),
        (with("c", "1,2,3"), "must be 8 numbers between commas"),
        (with("c", "0,0,0,1,0,0,0,50,1"), "must be 8 numbers between commas"),
        (with("c", "0,0,0,1,0,0,0,180"), "fov is 180"),
        (with("c", "0,0,0,0,0,0,0,50"), "keyframe 1"),
        (with("o", "rain"), "o is `rain`: must be rgb"),
        (with("f", "camera"), "f is `camera`: must be path"),
        (with("f", "path"), "there are no keyframes"),
        (with("w", "!"), "link: w: "),
        (with("w", "AAAA"), "link: w: "),
        (with("w", &packed(&"\n".repeat(8 << 20))), "longer than the limit"),
        (with("w", &packed("fog = [")), "link: w: "),
        (with("w", &packed("[fog]\nmoor = 3")), "did you mean `mor`"),
        (with("w", &packed("[sky]\npanorama = \"/etc/passwd\"")), "sky.panorama"),
        (with("p", &packed("[{\"time\":0}]")), "link: p: missing field"),
        (with("p", &packed(&"[".repeat(9999))), "link: p: "),
        (with("l", &packed("{\"model\":\"/etc/passwd\"}")), "lidar: "),
        (with("l", &packed("{\"modell\":\"vlp-16\"}")), "unknown field `modell`"),
        ("x".repeat(MAX_FRAGMENT + 1), "bytes are too many"),
    ] {
        let error = open(&text, &catalog(), &state()).unwrap_err();
        let start: String = text.chars().take(100).collect();
        assert!(error.starts_with("link: ") && error.contains(expected), "{start}: {error}");
        assert!(!error.contains(char::is_control) && error.len() < 700, "{start}: {error}");
    }
    // Two parts that are short enough alone.
    let half = format!("#{}\n", "x".repeat(MAX_INFLATED / 2 - 1));
    let both = link + "&p=" + &packed(&format!("[]{}", " ".repeat(MAX_INFLATED / 2)));
    let both = both.replace(&packed(&toml::to_string(&state().weather).unwrap()), &packed(&half));
    assert!(open(&both, &catalog(), &state()).unwrap_err().contains("longer than the limit"));
}

#[test]
fn what_is_too_long_for_a_link_is_told() {
    let mut state = state();
    state.weather = json!({ "about": "x".repeat(MAX_INFLATED) });
    assert!(encode(&state).unwrap_err().contains("too long for a link"));
    // Noise does not become shorter.
    let mut random = RandomSequence::new(1);
    let noise: String = (0..MAX_FRAGMENT).map(|_| char::from(33 + (90.0 * random.uniform()) as u8)).collect();
    state.weather = json!({ "about": noise });
    assert!(encode(&state).unwrap_err().contains("too long for a link"));
}

/// Returns a link with another value of a key.
fn with(link: &str, key: &str, value: &str) -> String {
    let others = link.split('&').filter(|pair| !pair.starts_with(&format!("{key}=")));
    others.chain([format!("{key}={value}").as_str()]).collect::<Vec<_>>().join("&")
}

/// Packs a text of any length.
fn packed(text: &str) -> String {
    Packer { room: usize::MAX }.packed(text).unwrap()
}

/// Numbers that are too long, too large, none at all, or any.
fn odd_numbers() -> BoxedStrategy<String> {
    let digits = select(vec![1, 20, 400, 60_000]).prop_map(|count| "9".repeat(count));
    let odd = ["NaN", "inf", "-infinity", "1e308", "-0", "5e-324", "0x10", "1_0", "", "+1"];
    prop_oneof![
        (digits, select(vec!["D.D", "1eD", "-1e-D", "0.D"]))
            .prop_map(|(digits, form)| form.replace('D', &digits)),
        any::<u64>().prop_map(|bits| f64::from_bits(bits).to_string()),
        select(odd.to_vec()).prop_map(str::to_owned),
    ]
    .boxed()
}

/// Lines of weather files, many of them out of range or of another type.
fn odd_weathers() -> impl Strategy<Value = String> {
    let params: Vec<String> = EFFECTS
        .iter()
        .flat_map(|effect| effect.params.iter().map(move |param| format!("{}.{}", effect.name, param.name)))
        .collect();
    let value = prop_oneof![
        odd_numbers(),
        (0..300_u32).prop_map(|value| value.to_string()),
        (0..9_u32, 0..9_u32).prop_map(|(a, b)| format!("{{ keys = [[0, {a}], [{b}, 1, \"smooth\"]] }}")),
        Just("[[], {}, 1979-05-27T07:32:00Z, nan]".into()),
        Just("\"auto\"".into()),
    ];
    let line = (select(params), value).prop_map(|(param, value)| format!("{param} = {value}\n"));
    proptest::collection::vec(line, 1..4).prop_map(|lines| lines.concat())
}

/// Texts where a link has numbers, a weather, keyframes or a lidar.
fn hostile_texts() -> impl Strategy<Value = String> {
    let forms = [
        "N",
        "N,0,0,1,0,0,0,50",
        "0,0,0,1,0,N,0,50",
        "[fog]\nmor = N\n[rain]\nrate = N",
        r#"[{"time":N,"eye":[N,0,0],"rotation":[1,0,0,0],"fov":50}]"#,
    ];
    let numbers =
        (odd_numbers(), select(forms.to_vec())).prop_map(|(number, form)| form.replace('N', &number));
    let nests = [
        ["a=", "[", "", "]"],
        ["", "a.", "a=1", ""],
        ["[", "a.", "a]", ""],
        ["a=", "{a=", "1", "}"],
        ["", "[", "", "]"],
        ["", "{\"a\":", "1", "}"],
    ];
    let nested = (select(vec![60, 130, 5000, 60_000]), select(nests.to_vec())).prop_map(
        |(depth, [head, open, middle, close])| {
            format!("{head}{}{middle}{}", open.repeat(depth), close.repeat(depth))
        },
    );
    let scripts = [
        "<script>alert(1)</script>",
        "\"><img src=x onerror=alert(1)>",
        "javascript:alert(1)",
        "\u{202e}\u{0}\r\n\u{1b}[31m",
        "../../../etc/passwd",
        "%3Cscript%3E",
    ];
    let places =
        ["name = S\nabout = S", "[S]\nS = S", "[sky]\nmodel = S\npanorama = S", r#"{"model":S,"colors":S}"#];
    let script = (select(scripts.to_vec()), proptest::option::of(select(places.to_vec()))).prop_map(
        |(script, place)| match place {
            Some(place) => place.replace('S', &json!(script).to_string()),
            None => script.to_owned(),
        },
    );
    let keys: String = (0..9000).map(|index| format!("k{index}.a={index}\n")).collect();
    let long = vec![
        "\n".repeat(MAX_INFLATED),
        "[[a]]\n".repeat(MAX_INFLATED / 7),
        keys,
        format!("{} = 1", "k".repeat(60_000)),
    ];
    prop_oneof![20 => numbers, 20 => nested, 20 => script, 1 => select(long)]
}

/// Fragments that nobody would write who means well.
fn hostile_fragments() -> impl Strategy<Value = String> {
    let link = states().prop_map(|state| encode(&state).unwrap()).boxed();
    let bytes = prop_oneof![0..4_usize, 0..400_usize, 0..4000_usize]
        .prop_flat_map(|count| proptest::collection::vec(any::<u8>(), count))
        .boxed();
    let bomb = packed(&"#".repeat(8 << 20));
    let value = prop_oneof![
        8 => hostile_texts().prop_map(|text| packed(&text)),
        3 => hostile_texts(),
        1 => bytes.clone().prop_map(|bytes| BASE64_URL_SAFE_NO_PAD.encode(bytes)),
        1 => Just(bomb),
    ];
    let key = prop_oneof![4 => Just("w"), 2 => Just("p"), 2 => Just("l"), 3 => select(KEYS.to_vec())];
    let changed = (link.clone(), proptest::collection::vec((any::<usize>(), 32..127_u8, 0..4_u8), 1..6))
        .prop_map(|(link, changes)| {
            let mut bytes = link.into_bytes();
            for (at, byte, way) in changes {
                let (at, other) = (at % bytes.len(), usize::from(byte) % bytes.len());
                match way {
                    0 => bytes[at] = byte,
                    1 => bytes.insert(at, byte),
                    2 if bytes.len() > 1 => drop(bytes.remove(at)),
                    _ => bytes.swap(at, other),
                }
            }
            String::from_utf8(bytes).unwrap()
        });
    let more = prop_oneof![
        bytes.prop_map(|bytes| String::from_utf8_lossy(&bytes).into_owned()),
        link.clone(),
        Just("&".repeat(60_000)),
    ]
    .boxed();
    prop_oneof![
        6 => (link.clone(), key, value).prop_map(|(link, key, value)| with(&link, key, &value)),
        3 => (link.clone(), odd_weathers()).prop_map(|(link, text)| with(&link, "w", &packed(&text))),
        1 => changed,
        1 => (link.clone(), any::<usize>()).prop_map(|(link, end)| link[..end % link.len()].to_owned()),
        1 => (link, more.clone()).prop_map(|(link, more)| link + "&" + &more),
        1 => more,
    ]
}

#[test]
fn hostile_links_are_refused_or_are_views() {
    let (catalog, base, fragments) = (catalog(), state(), hostile_fragments());
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    // Numbers of those that are no link, no view, and views.
    let mut counts = [0; 3];
    for _ in 0..2000 {
        let text = fragments.new_tree(&mut runner).unwrap().current();
        let start: String = text.chars().take(300).collect();
        let (decoded, opened) = (decode(&text, &base), open(&text, &catalog, &base));
        let outcome = match (&decoded, &opened) {
            (Err(error), Err(same)) => {
                assert_eq!(error, same, "{start}");
                0
            }
            (Ok(_), Err(_)) => 1,
            (Ok(state), Ok(view)) => {
                // A view like every other: by its checks, of the screen's size, and a link again.
                assert_eq!(
                    (&view.state, state.size, state.quality),
                    (state, base.size, base.quality),
                    "{start}"
                );
                let json = serde_json::to_value(state).unwrap();
                View::new(base.patched(json).unwrap(), &catalog, None).unwrap();
                if let Ok(link) = encode(state) {
                    assert_eq!(decode(&link, &base).as_ref(), Ok(state), "{start}");
                }
                2
            }
            (Err(_), Ok(_)) => unreachable!("{start}"),
        };
        counts[outcome] += 1;
        if let Err(error) = opened {
            let is_line = error.starts_with("link: ") && !error.contains(char::is_control);
            assert!(is_line && error.chars().count() < 500, "{start}: {error}");
        }
    }
    // All three happen.
    assert!(counts[0] > 500 && counts[1] > 50 && counts[2] > 50, "{counts:?}");
}
