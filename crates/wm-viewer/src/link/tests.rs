//! Links are what they were made of, and hostile ones do nothing.

use super::*;
use crate::testing::{catalog, state};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use serde_json::{Value, json};
use std::time::Instant;
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
    #![proptest_config(ProptestConfig::with_cases(64))]

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
    let packed = |text: &str| Packer { room: MAX_INFLATED }.packed(text).unwrap();
    let with = |key: &str, value: &str| {
        let others = link.split('&').filter(|pair| !pair.starts_with(&format!("{key}=")));
        others.chain([format!("{key}={value}").as_str()]).collect::<Vec<_>>().join("&")
    };
    let bomb =
        sirocco::compress(sirocco::Format::Deflate, sirocco::deflate::Level::BEST, &vec![b'\n'; 8 << 20]);
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
        (with("w", &BASE64_URL_SAFE_NO_PAD.encode(&bomb)), "longer than the limit"),
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

/// Makes hostile fragments.
struct Attacker {
    random: RandomSequence,
    valid: Vec<String>,
    bomb: String,
}

/// Names of what [`Attacker::fragment`] makes.
const ATTACKS: [&str; 10] = [
    "random bytes",
    "random base64",
    "changed bytes",
    "cut off",
    "bombs",
    "deep nesting",
    "large numbers",
    "keys",
    "script",
    "weathers",
];

impl Attacker {
    fn new(seed: u64) -> Self {
        let mut runner = proptest::test_runner::TestRunner::deterministic();
        let one = || encode(&states().new_tree(&mut runner).unwrap().current()).unwrap();
        let valid = std::iter::repeat_with(one).take(40).collect();
        let level = sirocco::deflate::Level::BEST;
        let bomb = sirocco::compress(sirocco::Format::Deflate, level, &vec![b'#'; 8 << 20]);
        Self { random: RandomSequence::new(seed), valid, bomb: BASE64_URL_SAFE_NO_PAD.encode(bomb) }
    }

    fn below(&mut self, count: usize) -> usize {
        (self.random.uniform() * count as f64) as usize
    }

    fn pick<'a>(&mut self, texts: &[&'a str]) -> &'a str {
        texts[self.below(texts.len())]
    }

    fn bytes(&mut self) -> Vec<u8> {
        let most = [4, 40, 400, 4000][self.below(4)];
        let count = self.below(most);
        (0..count).map(|_| self.below(256) as u8).collect()
    }

    fn link(&mut self) -> String {
        let index = self.below(self.valid.len());
        self.valid[index].clone()
    }

    /// A valid link with another value of a key.
    fn with(&mut self, key: &str, value: &str) -> String {
        let link = self.link();
        let others = link.split('&').filter(|pair| !pair.starts_with(&format!("{key}=")));
        others.chain([format!("{key}={value}").as_str()]).collect::<Vec<_>>().join("&")
    }

    fn with_packed(&mut self, key: &str, text: &str) -> String {
        let level = sirocco::deflate::Level::BEST;
        let packed = sirocco::compress(sirocco::Format::Deflate, level, text.as_bytes());
        self.with(key, &BASE64_URL_SAFE_NO_PAD.encode(packed))
    }

    fn number(&mut self) -> String {
        let digits = "9".repeat([1, 20, 400, 60_000][self.below(4)]);
        match self.below(9) {
            0 => format!("{digits}.{digits}"),
            1 => format!("1e{digits}"),
            2 => format!("-1e-{digits}"),
            3 => format!("0.{digits}"),
            4 => f64::from_bits(self.random.bits()).to_string(),
            _ => self
                .pick(&["NaN", "inf", "-infinity", "1e308", "-0", "5e-324", "0x10", "1_0", "", "+1"])
                .into(),
        }
    }

    fn fragment(&mut self, attack: usize) -> String {
        const SCRIPT: [&str; 6] = [
            "<script>alert(1)</script>",
            "\"><img src=x onerror=alert(1)>",
            "javascript:alert(1)",
            "\u{202e}\u{0}\r\n\u{1b}[31m",
            "../../../etc/passwd",
            "%3Cscript%3E",
        ];
        let keys = ["w", "p", "l"];
        match attack {
            0 => String::from_utf8_lossy(&self.bytes()).into_owned(),
            1 => {
                let (key, bytes) = (self.pick(&keys), self.bytes());
                self.with(key, &BASE64_URL_SAFE_NO_PAD.encode(bytes))
            }
            2 => {
                let mut bytes = self.link().into_bytes();
                for _ in 0..=self.below(4) {
                    let (at, byte) = (self.below(bytes.len()), 32 + self.below(95) as u8);
                    match self.below(4) {
                        0 => bytes[at] = byte,
                        1 => bytes.insert(at, byte),
                        2 if bytes.len() > 1 => drop(bytes.remove(at)),
                        _ => {
                            let other = self.below(bytes.len());
                            bytes.swap(at, other);
                        }
                    }
                }
                String::from_utf8_lossy(&bytes).into_owned()
            }
            3 => {
                let link = self.link();
                let end = self.below(link.len());
                link[..end].to_owned()
            }
            4 => {
                let (key, bomb) = (self.pick(&keys), self.bomb.clone());
                // The last two take some 30 ms each.
                match self.below(20) {
                    0..=8 => self.with(key, &bomb),
                    9..=17 => self.with_packed(key, &"\n".repeat(MAX_INFLATED)),
                    18 => self.with_packed("w", &"[[a]]\n".repeat(MAX_INFLATED / 7)),
                    _ => {
                        let keys: String = (0..9000).map(|index| format!("k{index}.a={index}\n")).collect();
                        self.with_packed("w", &keys)
                    }
                }
            }
            5 => {
                let depth = [60, 130, 5000, 60_000][self.below(4)];
                match self.below(6) {
                    0 => self.with_packed("w", &format!("a={}{}", "[".repeat(depth), "]".repeat(depth))),
                    1 => self.with_packed("w", &format!("{}a=1", "a.".repeat(depth))),
                    2 => self.with_packed("w", &format!("[{}a]", "a.".repeat(depth))),
                    3 => self.with_packed("w", &format!("a={}1{}", "{a=".repeat(depth), "}".repeat(depth))),
                    4 => self.with_packed("p", &format!("{}{}", "[".repeat(depth), "]".repeat(depth))),
                    _ => self.with_packed("l", &format!("{}1{}", "{\"a\":".repeat(depth), "}".repeat(depth))),
                }
            }
            6 => {
                let (number, key) = (self.number(), self.pick(&["t", "d", "c", "v", "w", "p"]));
                match key {
                    "c" => {
                        let mut numbers: Vec<String> =
                            ["0", "0", "0", "1", "0", "0", "0", "50"].map(Into::into).into();
                        let at = self.below(8);
                        numbers[at] = number;
                        self.with("c", &numbers.join(","))
                    }
                    "w" => self.with_packed("w", &format!("[fog]\nmor = {number}\n[rain]\nrate = {number}")),
                    "p" => {
                        let key = format!(
                            "{{\"time\":{number},\"eye\":[{number},0,0],\"rotation\":[1,0,0,0],\"fov\":50}}"
                        );
                        self.with_packed("p", &format!("[{key}]"))
                    }
                    key => self.with(key, &number),
                }
            }
            7 => match self.below(4) {
                0 => self.link() + "&" + &String::from_utf8_lossy(&self.bytes()),
                1 => self.link() + "&" + &self.link(),
                2 => self.link() + &"&".repeat(60_000),
                _ => self.with_packed("w", &format!("{} = 1", "k".repeat(60_000))),
            },
            8 => {
                let (script, key) =
                    (self.pick(&SCRIPT), self.pick(&["v", "w", "c", "t", "o", "d", "p", "f", "l"]));
                let quoted = json!(script).to_string();
                match self.below(5) {
                    0 => self.with(key, script),
                    1 => self.with_packed("w", &format!("name = {quoted}\nabout = {quoted}")),
                    2 => self.with_packed("w", &format!("[{quoted}]\n{quoted} = {quoted}")),
                    3 => self.with_packed("w", &format!("[sky]\nmodel = {quoted}\npanorama = {quoted}")),
                    _ => self.with_packed("l", &format!("{{\"model\":{quoted},\"colors\":{quoted}}}")),
                }
            }
            _ => {
                let mut text = String::new();
                for _ in 0..=self.below(3) {
                    let effect = &EFFECTS[self.below(EFFECTS.len())];
                    let param = &effect.params[self.below(effect.params.len())];
                    let value = match self.below(5) {
                        0 => self.number(),
                        1 => self.below(300).to_string(),
                        2 => format!(
                            "{{ keys = [[0, {}], [{}, 1, \"smooth\"]] }}",
                            self.below(9),
                            self.below(9)
                        ),
                        3 => "[[], {}, 1979-05-27T07:32:00Z, nan]".into(),
                        _ => "\"auto\"".into(),
                    };
                    text += &format!("{}.{} = {value}\n", effect.name, param.name);
                }
                self.with_packed("w", &text)
            }
        }
    }
}

/// The outcome of one kind of attack.
#[derive(Clone, Copy, Default)]
struct AttackOutcome {
    /// Numbers of attacks that are no link, no view, and views.
    counts: [usize; 3],
    /// Time of all and longest time of one, s.
    seconds: f64,
    longest: f64,
}

/// Opens hostile links; returns the outcome of each of [`ATTACKS`].
fn attack(count: usize, seed: u64) -> Vec<AttackOutcome> {
    let (mut attacker, catalog, base) = (Attacker::new(seed), catalog(), state());
    let mut outcomes = vec![AttackOutcome::default(); ATTACKS.len()];
    for index in 0..count {
        let attack = index % ATTACKS.len();
        let text = attacker.fragment(attack);
        let start: String = text.chars().take(300).collect();
        let started = Instant::now();
        let opened = open(&text, &catalog, &base);
        let took = started.elapsed().as_secs_f64();
        let decoded = decode(&text, &base);
        let of = &mut outcomes[attack];
        (of.seconds, of.longest) = (of.seconds + took, of.longest.max(took));
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
        of.counts[outcome] += 1;
        if let Err(error) = opened {
            let is_line = error.starts_with("link: ") && !error.contains(char::is_control);
            assert!(is_line && error.chars().count() < 500, "{start}: {error}");
        }
    }
    outcomes
}

#[test]
fn hostile_links_are_refused_or_are_views() {
    let outcomes = attack(2000, 1);
    print(&outcomes);
    let total: usize = outcomes.iter().map(|of| of.counts.iter().sum::<usize>()).sum();
    let [refused, invalid, views] =
        [0, 1, 2].map(|kind| outcomes.iter().map(|of| of.counts[kind]).sum::<usize>());
    // All three happen.
    assert!(total == 2000 && refused > 500 && invalid > 50 && views > 50, "{refused} {invalid} {views}");
}

/// `cargo test --release -p wm-viewer -- --ignored --nocapture hundred_thousand` prints what came
/// of them.
#[test]
#[ignore = "takes minutes without optimisation"]
fn a_hundred_thousand_hostile_links() {
    print(&attack(100_000, 2));
}

fn print(outcomes: &[AttackOutcome]) {
    for (name, AttackOutcome { counts: [refused, invalid, views], seconds, longest }) in
        ATTACKS.iter().zip(outcomes)
    {
        println!(
            "{name}: {refused} are no link, {invalid} no view, {views} views; {seconds:.1} s, at most {:.1} ms",
            1e3 * longest
        );
    }
}
