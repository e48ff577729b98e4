use super::*;
use crate::effects::fog;
use proptest::prelude::*;

fn fog_at(weather: &Weather, time: f64) -> fog::AirParams {
    let instant = weather.at(time);
    let (_, values) = instant.effects().find(|(effect, _)| effect.name == "fog").unwrap();
    fog::AirParams::of(values)
}

#[test]
fn a_whole_file_is_read() {
    let text = r##"
name = "Test"
about = "A test"
fidelity = "paper"

[fog]
mor = { keys = [[0, 2000], [5.0, 60]] }
airlight = "#808080"
tint = [0.5, 0.6, 0.7]
scale_height = inf

[haze]
"##;
    let weather = Weather::parse(text, "test.toml").unwrap();
    assert_eq!((weather.name.as_str(), weather.about.as_str()), ("Test", "A test"));
    assert_eq!(weather.fidelity, Fidelity::Paper);
    let names: Vec<_> = weather.effects().map(|(effect, _)| effect.name).collect();
    assert_eq!(names, ["fog", "haze"]);
    let fog = fog_at(&weather, 2.5);
    assert_eq!(fog.mor, 1030.0);
    assert_eq!(fog.tint, Some([0.5, 0.6, 0.7]));
    assert_eq!(fog.airlight, Some([128.0 / 255.0; 3]));
    assert!(fog.scale_height.is_infinite());
}

#[test]
fn faults_have_line_and_column() {
    let effects: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).collect();
    for (text, want) in [
        ("[fog\nmor = 1", "w.toml:1:5: unclosed table, expected `]`"),
        (
            "name = \"a\"\n[fgo]\n",
            format!(
                "w.toml:2:2: there is no `fgo`, did you mean `fog`?; the effects are {}",
                effects.join(", ")
            )
            .as_str(),
        ),
        ("[fog]\nmro = 120\n", "w.toml:2:1: fog has no `mro`, did you mean `mor`?; it has mor, visual_range"),
        ("[fog]\nmor = 0.5\n", "w.toml:2:7: fog.mor is 0.5: must be a number from 1 to inf m"),
        ("[fog]\nmor = \"thick\"\n", "w.toml:2:7: fog.mor is `thick`: must be a number from 1 to inf m"),
        ("[fog]\nmor = true\n", "w.toml:2:7: fog.mor must be a number from 1 to inf m"),
        ("[fog]\nmor = nan\n", "w.toml:2:7: fog.mor must be a number from 1 to inf m"),
        ("[fog]\nairlight = [1, 2]\n", "w.toml:2:12: fog.airlight must be a colour as"),
        ("[fog]\nmor = { keys = [] }\n", "w.toml:2:7: fog.mor has no keyframes"),
        ("[fog]\nmor = { keyz = [] }\n", "w.toml:2:9: fog.mor has no `keyz`: keyframes are"),
        (
            "[fog]\nmor = { keys = [[0, 1], [0, 2]] }\n",
            "w.toml:2:7: fog.mor has a keyframe at time 0 after one at 0",
        ),
        ("[fog]\nmor = { keys = [[0, 5], [1]] }\n", "w.toml:2:25: fog.mor must be a value or { keys"),
        ("[fog]\nmor = { keys = [[0, 5, \"hold\", 1]] }\n", "w.toml:2:17: fog.mor must be a value or { keys"),
        (
            "[fog]\nmor = { keys = [[0, 5, \"smoth\"], [1, 6]] }\n",
            "w.toml:2:24: fog.mor has the easing `smoth`, did you mean `smooth`?; the easings are linear, hold,",
        ),
        (
            "[fog]\nmor = { keys = [[0, 5, \"\"\"a\n\u{9b}b\"\"\"], [1, 6]] }\n",
            "w.toml:2:24: fog.mor has the easing `a\\n\\u{9b}b`; the easings are linear, hold,",
        ),
        ("[fog]\nmor = { keys = [[0, 5, 2]] }\n", "w.toml:2:24: fog.mor has an easing that is no text"),
        (
            "[sky]\nmodel = { keys = [[0, \"clear\", \"smooth\"], [1, \"overcast\"]] }\n",
            "w.toml:2:9: sky.model at time 0 has the easing smooth: words hold",
        ),
        (
            "[fog]\nairlight = { keys = [[0, \"auto\"], [1, \"#ffffff\"]] }\n",
            "w.toml:2:12: fog.airlight at time 0 is auto",
        ),
        ("fog = 3\n", "w.toml:1:7: fog must be a table"),
        ("fidelity = \"exact\"\n", "w.toml:1:12: there is no fidelity `exact`: use physical or paper"),
        ("name = 3\n", "w.toml:1:8: name must be a text in quotes"),
    ] {
        let error = Weather::parse(text, "w.toml").unwrap_err().to_string();
        assert!(error.starts_with(want), "{text:?}: {error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn keys_may_have_easings() {
    let text = "[fog]\nmor = { keys = [[0, 400, \"ease-in\"], [4, 800, \"hold\"], [5, 100]] }\n";
    let file = Weather::parse(text, "w.toml").unwrap();
    let mut line = Weather::clear();
    line.set_text("fog.mor=0:400:ease-in,4:800:hold,5:100").unwrap();
    for (time, want) in [(2.0, 500.0), (4.5, 800.0), (5.0, 100.0)] {
        assert_eq!(fog_at(&file, time).mor, want);
        assert_eq!(fog_at(&line, time).mor, want);
    }
}

#[test]
fn overrides_act_on_top() {
    let mut weather = Weather::preset("fog").unwrap();
    weather.set_text("fog.mor=0:100,2:50").unwrap();
    weather.set_text("smog.albedo = 0.9").unwrap();
    weather.set_text("fidelity=paper").unwrap();
    assert_eq!(fog_at(&weather, 1.0).mor, 75.0);
    assert_eq!(weather.effects().count(), 3);
    weather.set_text("fog=off").unwrap();
    weather.set_text("haze=on").unwrap();
    assert_eq!(
        weather.effects().map(|(effect, _)| effect.name).collect::<Vec<_>>(),
        ["light", "haze", "smog"]
    );
    for (text, want) in [
        ("fog.mor", "--set fog.mor: must be effect.parameter=value, as in fog.mor=120"),
        ("fog.more=1", "--set fog.more=1: fog has no `more`, did you mean `mor`?;"),
        ("frogs.rate=1", "--set frogs.rate=1: there is no `frogs`"),
        ("rain.rate=-1", "--set rain.rate=-1: rain.rate is -1: must be a number from 0 to 300 mm/h"),
        ("rain.seed=x", "--set rain.seed=x: rain.seed is `x`: must be a number from 0"),
        ("fog.mor=x", "--set fog.mor=x: fog.mor is `x`: must be a number from 1 to inf m"),
        (
            "fog.mor=0:9:eas-in,1:8",
            "--set fog.mor=0:9:eas-in,1:8: fog.mor has the easing `eas-in`, did you mean",
        ),
        ("fog=maybe", "--set fog=maybe: fog is on or off; its parameters are mor,"),
    ] {
        let error = weather.set_text(text).unwrap_err().to_string();
        assert!(error.starts_with(want), "{error}");
    }
}

proptest! {
    /// Whatever the text: a weather or one line, never a panic.
    #[test]
    fn any_text_is_read_or_refused(text in "\\PC*") {
        if let Err(error) = Weather::parse(&text, "w") {
            prop_assert!(!error.to_string().contains('\n'));
        }
    }

    /// Mutations of a right file.
    #[test]
    fn mutated_files_are_read_or_refused(at in 0usize..200, byte in any::<char>(), cut in any::<bool>()) {
        let text = "name = \"x\"\n[fog]\nmor = { keys = [[0, 2000, \"smooth\"], [5, 60]] }\nairlight = \"#d5dadd\"\n[smog]\nalbedo = 0.9\n";
        let mut chars: Vec<char> = text.chars().collect();
        let at = at % chars.len();
        if cut { chars.truncate(at) } else { chars[at] = byte }
        let _ = Weather::parse(&chars.into_iter().collect::<String>(), "w");
    }

    #[test]
    fn any_override_is_taken_or_refused(text in "\\PC*") {
        let _ = Weather::clear().set_text(&text);
    }
}
