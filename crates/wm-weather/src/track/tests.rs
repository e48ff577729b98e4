use super::*;
use proptest::prelude::*;

const PARAM: Param = Param {
    name: "mor",
    kind: ParamKind::Number,
    default: ParamValue::Number(1.0),
    range: (0.0, 1e9),
    unit: "m",
    meaning: "",
};
const COLOR: Param = Param { name: "airlight", kind: ParamKind::ColorOrAuto, ..PARAM };
const WORD: Param = Param { name: "model", kind: ParamKind::Word(&["clear", "overcast"]), ..PARAM };

fn number(track: &Track, time: f64) -> f64 {
    let ParamValue::Number(number) = track.at(time) else { panic!("no number: {:?}", track.at(time)) };
    number
}

#[test]
fn keys_hold_run_and_hold() {
    let track = Track::parse(&PARAM, "1:100, 3:200, 4:50").unwrap();
    for (time, want) in [(-5.0, 100.0), (1.0, 100.0), (2.0, 150.0), (3.0, 200.0), (3.5, 125.0), (9.0, 50.0)] {
        assert_eq!(number(&track, time), want);
    }
}

#[test]
fn the_easing_is_that_of_the_way_to_the_next_key() {
    let track = Track::parse(&PARAM, "0:0:ease-in,4:100:hold,8:20:ease-out,12:0:smooth,16:64:hold").unwrap();
    for (time, want) in [
        (2.0, 25.0),
        (4.0, 100.0),
        (7.999, 100.0),
        (8.0, 20.0),
        (10.0, 5.0),
        (12.0, 0.0),
        (13.0, 10.0),
        (99.0, 64.0),
    ] {
        assert_eq!(number(&track, time), want, "at {time}");
    }
}

#[test]
fn bad_keys_are_named() {
    for (text, want) in [
        ("0:1,0:2", "has a keyframe at time 0 after one at 0: times must rise"),
        ("0:1,5", "has the keyframe `5`: must be time:value or time:value:easing, as in 0:2000,5:60"),
        ("x:1", "has a keyframe at `x`: must be a number of seconds"),
        ("0:1,1:-2", "is -2: must be a number from 0 to 1000000000 m"),
        (
            "0:1:smoth,1:2",
            "has the easing `smoth`, did you mean `smooth`?; the easings are linear, hold, smooth, ease-in, ease-out",
        ),
        ("0:1:,1:2", "has the easing ``; the easings are linear, hold, smooth, ease-in, ease-out"),
        (
            "0:1:hold:hold",
            "has the easing `hold:hold`; the easings are linear, hold, smooth, ease-in, ease-out",
        ),
    ] {
        assert_eq!(Track::parse(&PARAM, text).unwrap_err(), want);
    }
    let smooth = Track::parse(&WORD, "0:clear:smooth,1:overcast").unwrap_err();
    assert_eq!(smooth, "at time 0 has the easing smooth: words hold");
}

/// Half the light between white and black is 188 of 255 when encoded, where half the encoded number
/// is 128.
#[test]
fn colours_mix_in_linear_light() {
    let track = Track::parse(&COLOR, "0:#ffffff,2:#000000").unwrap();
    let ParamValue::Color(grey) = track.at(1.0) else { panic!("a colour") };
    for channel in grey {
        assert!((channel - 0.735_356_983_052_449_5).abs() < 1e-7, "{channel}");
    }
    // At its keys a colour is as it was written, and one that does not change stays so.
    let track = Track::parse(&COLOR, "0:#0a3780,1:#0a40ff,2:#000000").unwrap();
    let color = |text: &str| COLOR.parse(text).unwrap();
    assert_eq!(
        (track.at(-1.0), track.at(0.0), track.at(1.0)),
        (color("#0a3780"), color("#0a3780"), color("#0a40ff"))
    );
    let ParamValue::Color([red, ..]) = track.at(0.3) else { panic!("a colour") };
    assert_eq!(red, 10.0 / 255.0);
}

#[test]
fn words_hold() {
    for text in ["0:clear,2:overcast", "0:clear:hold,2:overcast:hold"] {
        let track = Track::parse(&WORD, text).unwrap();
        for (time, want) in [(-1.0, "clear"), (1.999, "clear"), (2.0, "overcast"), (5.0, "overcast")] {
            assert_eq!(track.at(time), ParamValue::Word(want));
        }
    }
    assert_eq!(Track::parse(&WORD, "overcast").unwrap(), Track::constant(ParamValue::Word("overcast")));
}

#[test]
fn integrals_by_hand() {
    let track = Track::parse(&PARAM, "1:10:ease-in,4:40:hold,6:8,8:0").unwrap();
    for ((from, to), want) in [
        ((-3.0, 1.0), 40.0),
        ((1.0, 4.0), 60.0), // 3 s of 10, and 30 over s^2 for 3 s
        ((4.0, 6.0), 80.0),
        ((6.0, 8.0), 8.0),
        ((8.0, 1e6), 0.0),
        ((7.0, 5.0), -46.0),
    ] {
        assert!(
            (track.integral(from, to) - want).abs() < 1e-12,
            "{from} to {to}: {}",
            track.integral(from, to)
        );
    }
    assert_eq!((track.most(), track.least()), (40.0, 0.0));
    assert_eq!(track.breaks().collect::<Vec<_>>(), [1.0, 4.0, 6.0, 8.0]);
}

#[test]
fn a_value_without_keys_has_integrals_too() {
    let track = Track::constant(ParamValue::Number(3.0));
    assert_eq!((track.integral(-2.0, 5.0), track.most(), track.least()), (21.0, 3.0, 3.0));
    assert_eq!(track.breaks().count(), 0);
    let endless = Track::constant(ParamValue::Number(f64::INFINITY));
    assert_eq!((endless.integral(2.0, 2.0), endless.integral(2.0, 3.0)), (0.0, f64::INFINITY));
    let auto = Track::constant(ParamValue::Auto);
    assert!(auto.integral(0.0, 1.0).is_nan() && auto.most().is_nan() && auto.least().is_nan());
}

/// Tracks of one to six keys at uneven times, with any easings.
fn tracks() -> impl Strategy<Value = Track> {
    prop::collection::vec((0.05..3.0f64, 0.0..100.0f64, 0..Easing::ALL.len()), 1..6).prop_map(|parts| {
        let mut time = -2.0;
        let keys = parts.into_iter().map(|(gap, value, easing)| {
            time += gap;
            Keyframe { time, value: ParamValue::Number(value), easing: Easing::ALL[easing] }
        });
        Track::keyframes(&PARAM, keys.collect()).unwrap()
    })
}

/// The integral over one stretch without a break inside, by the rule of Simpson in three parts:
/// exact for polynomials to the third degree, which all easings are. The ends are a ten-millionth
/// inside, since a value may jump there: of 18 s and values below 100 that leaves 4e-4.
fn simpson(track: &Track, from: f64, to: f64) -> f64 {
    let inset = 1e-7 * (to - from);
    let (from, to) = (from + inset, to - inset);
    let third = (to - from) / 3.0;
    let part = |i: u32| {
        let a = from + f64::from(i) * third;
        third / 6.0 * (number(track, a) + 4.0 * number(track, a + third / 2.0) + number(track, a + third))
    };
    (0..3).map(part).sum()
}

proptest! {
    /// Whatever the easing: never beyond the two keys that are around.
    #[test]
    fn values_stay_between_their_keys(track in tracks(), time in -4.0..20.0f64) {
        let value = number(&track, time);
        prop_assert!(value >= track.least() && value <= track.most());
        let keys = track.keys();
        let i = keys.partition_point(|key| key.time <= time);
        let (a, b) = (keys[i.saturating_sub(1)].number(), keys[i.min(keys.len() - 1)].number());
        prop_assert!(value >= a.min(b) && value <= a.max(b));
    }

    /// Against sums over slices of 2 ms, each at its middle. A slice errs by its width cubed over
    /// 24 times the second derivative, at most 6 * 100 / 0.05^2 within 3 s; and one slice a key by
    /// the jump there, 100.
    #[test]
    fn integrals_are_fine_sums(track in tracks(), from in -4.0..20.0f64, length in 0.0..3.0f64) {
        let slices = 1500;
        let width = length / f64::from(slices);
        let sum: f64 = (0..slices).map(|i| width * number(&track, from + (f64::from(i) + 0.5) * width)).sum();
        let allowed = length * width * width / 24.0 * 6.0 * 100.0 / 0.05 / 0.05 + 6.0 * width * 100.0 + 1e-9;
        let exact = track.integral(from, from + length);
        prop_assert!((exact - sum).abs() <= allowed, "{exact} for {sum}");
    }

    /// Against a rule that is exact between breaks.
    #[test]
    fn integrals_are_exact_between_breaks(track in tracks(), from in -4.0..8.0f64, length in 0.0..12.0f64) {
        let to = from + length;
        let mut ends = vec![from];
        ends.extend(track.breaks().filter(|time| *time > from && *time < to));
        ends.push(to);
        let sum: f64 = ends.windows(2).map(|pair| simpson(&track, pair[0], pair[1])).sum();
        let exact = track.integral(from, to);
        prop_assert!((exact - sum).abs() < 4e-4, "{exact} for {sum}");
    }

    /// Parts add up to the whole, in whatever steps; the way back takes all away again.
    #[test]
    fn integrals_add_up(track in tracks(), to in 0.0..30.0f64, mut stops in prop::collection::vec(0.0..30.0f64, 0..5)) {
        let whole = track.integral(0.0, to);
        stops.push(to);
        let mut at = 0.0;
        let mut sum = 0.0;
        for stop in stops {
            sum += track.integral(at, stop);
            at = stop;
        }
        // Sums of six numbers below 100 * 32, each rounded to 2^-53 a few times.
        prop_assert!((sum - whole).abs() < 1e-10, "{sum} for {whole}");
        prop_assert_eq!(track.integral(to, 0.0), -whole);
    }
}
