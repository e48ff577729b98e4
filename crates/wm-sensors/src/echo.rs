//! Echoes of one pulse: added up, detected and put in the order of a sensor's returns.

use crate::model::LidarModel;
use std::str::FromStr;
use wm_base::random::RandomStream;

/// The source of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum EchoClass {
    /// A surface of the scene, or snow that lies on it.
    Surface = 0,
    /// A drop of rain, or a hailstone.
    Drop = 1,
    /// A snowflake.
    Flake = 2,
    /// Air: fog, haze or smog.
    Air = 3,
    /// A surface that a wet one mirrors: it is not where the point is.
    Ghost = 4,
}

impl EchoClass {
    /// Every class, in the order of their numbers.
    pub const ALL: [Self; 5] = [Self::Surface, Self::Drop, Self::Flake, Self::Air, Self::Ghost];

    /// The name in files and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Drop => "drop",
            Self::Flake => "flake",
            Self::Air => "air",
            Self::Ghost => "ghost",
        }
    }
}

/// The returns of a pulse that become points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReturnMode {
    /// The strongest.
    #[default]
    Strongest,
    /// The first.
    First,
    /// The last.
    Last,
    /// The strongest and the last, once if they are the same.
    Dual,
    /// All that are detected.
    All,
}

impl ReturnMode {
    /// Every mode, with its name in options and files.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Strongest, "strongest"),
        (Self::First, "first"),
        (Self::Last, "last"),
        (Self::Dual, "dual"),
        (Self::All, "all"),
    ];
}

impl FromStr for ReturnMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(mode, _)| *mode)
            .ok_or_else(|| format!("`{text}`: use strongest, first, last, dual or all"))
    }
}

/// The place of a point among the returns of its pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ReturnRank {
    /// The strongest of all.
    Strongest = 1,
    /// The first, and not the strongest.
    First = 2,
    /// The last, and not the strongest.
    Last = 3,
    /// None of these.
    Other = 4,
}

/// Light that comes back at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Echo {
    /// Distance from the sensor, m.
    pub(crate) range: f64,
    /// Power, 1/m^2: `share rho cos(theta) T^2 xi / range^2`.
    pub(crate) power: f64,
    /// The source.
    pub(crate) class: EchoClass,
    /// The label of the surface, 0 for none.
    pub(crate) label: u16,
}

/// An echo that was detected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DetectedEcho {
    pub(crate) echo: Echo,
    /// Range with noise, m.
    pub(crate) measured: f64,
    pub(crate) rank: ReturnRank,
}

/// Standard deviation of the receiver's noise, as a share of the least power that is detected.
const RECEIVER_NOISE: f64 = 0.2;
/// Power below which noise never makes an echo, as a share of the least power: 4.5 standard
/// deviations.
pub(crate) const MIN_ECHO_POWER: f64 = 0.1;
/// Range noise of an echo of a power of 1/2 of the least one, m (Goodin et al. 2019; Kilic et al.
/// 2021).
const RANGE_NOISE_M: f64 = 0.09;
/// Echoes per pulse with random numbers of their own.
const ECHOES_PER_PULSE: u64 = 64;

/// Adds up echoes that lie within `bin` m of the first of them: power adds, ranges are the mean by
/// power, and the class is that of the strongest class, with the label of the strongest echo of it.
/// Both are sorted by range.
pub(crate) fn merge(echoes: &mut [Echo], bin: f64, merged: &mut Vec<Echo>) {
    merged.clear();
    // By range; equal ones by class, power and label, so that no order of theirs shows.
    echoes.sort_by(|a, b| {
        let by_power = a.class.cmp(&b.class).then(a.power.total_cmp(&b.power));
        a.range.total_cmp(&b.range).then(by_power).then(a.label.cmp(&b.label))
    });
    // A little less, so that bins of air stay apart.
    let reach = bin * (1.0 - 1e-6);
    let mut first = 0;
    while first < echoes.len() {
        let count = echoes[first..].partition_point(|echo| echo.range - echoes[first].range < reach);
        let group = &echoes[first..first + count];
        let power: f64 = group.iter().map(|echo| echo.power).sum();
        let range = group.iter().map(|echo| echo.power * echo.range).sum::<f64>() / power;
        let of = |class: EchoClass| -> f64 {
            group.iter().filter(|echo| echo.class == class).map(|echo| echo.power).sum()
        };
        let strongest = |a: EchoClass, b: EchoClass| if of(b) > of(a) { b } else { a };
        let class = EchoClass::ALL.into_iter().reduce(strongest).unwrap_or(EchoClass::Surface);
        if power > 0.0 {
            let own = group.iter().filter(|echo| echo.class == class);
            let label = own.max_by(|a, b| a.power.total_cmp(&b.power)).map_or(0, |echo| echo.label);
            merged.push(Echo { range, power, class, label });
        }
        first += count;
    }
}

/// Detects echoes of pulse `pulse`: `P / P_min + n / 5 > 1` with a normal number `n`. Ranges get
/// their noise.
pub(crate) fn detect(
    merged: &[Echo],
    model: &LidarModel,
    random: &RandomStream,
    pulse: u64,
    detected: &mut Vec<DetectedEcho>,
) {
    detected.clear();
    let least = model.least_power();
    let [nearest, farthest] = model.range;
    for (index, echo) in merged.iter().enumerate() {
        let signal = echo.power / least;
        if signal < MIN_ECHO_POWER || !(nearest..=farthest).contains(&echo.range) {
            continue;
        }
        let [threshold, range, _] =
            random.normal3(pulse * ECHOES_PER_PULSE + (index as u64).min(ECHOES_PER_PULSE - 1));
        if signal + RECEIVER_NOISE * threshold <= 1.0 {
            continue;
        }
        let spread = model.range_noise.max(RANGE_NOISE_M / (2.0 * signal).sqrt());
        let measured = (echo.range + spread * range).clamp(nearest, farthest);
        detected.push(DetectedEcho { echo: *echo, measured, rank: ReturnRank::Other });
    }
}

/// Ranks what was detected, and keeps what a mode returns, in the order of ranges.
pub(crate) fn choose(mode: ReturnMode, detected: &mut Vec<DetectedEcho>) {
    let Some(last) = detected.len().checked_sub(1) else { return };
    let stronger = |best: usize, index: usize| {
        if detected[index].echo.power > detected[best].echo.power { index } else { best }
    };
    let strongest = (0..=last).fold(0, stronger);
    detected[0].rank = ReturnRank::First;
    detected[last].rank = ReturnRank::Last;
    detected[strongest].rank = ReturnRank::Strongest;
    match mode {
        ReturnMode::All => {}
        ReturnMode::First => detected.truncate(1),
        ReturnMode::Last => *detected = vec![detected[last]],
        ReturnMode::Strongest => *detected = vec![detected[strongest]],
        ReturnMode::Dual if strongest == last => *detected = vec![detected[strongest]],
        ReturnMode::Dual => *detected = vec![detected[strongest], detected[last]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn echo(range: f64, power: f64, class: EchoClass) -> Echo {
        Echo { range, power, class, label: 0 }
    }

    #[test]
    fn echoes_within_half_a_pulse_are_one() {
        let mut echoes = vec![
            echo(10.6, 1.0, EchoClass::Surface),
            echo(10.0, 3.0, EchoClass::Drop),
            echo(10.2, 0.5, EchoClass::Surface),
            echo(10.76, 2.0, EchoClass::Air),
        ];
        let mut merged = Vec::new();
        merge(&mut echoes, 0.75, &mut merged);
        assert_eq!(merged.len(), 2);
        assert_eq!((merged[0].power, merged[0].class), (4.5, EchoClass::Drop));
        assert!((merged[0].range - (10.6 + 30.0 + 5.1) / 4.5).abs() < 1e-12);
        assert_eq!(merged[1], echo(10.76, 2.0, EchoClass::Air));
    }

    #[test]
    fn modes_return_what_they_say() {
        let all = || -> Vec<DetectedEcho> {
            [(3.0, 2.0), (5.0, 9.0), (8.0, 1.0)]
                .map(|(range, power)| DetectedEcho {
                    echo: echo(range, power, EchoClass::Surface),
                    measured: range,
                    rank: ReturnRank::Other,
                })
                .to_vec()
        };
        for (mode, ranges) in [
            (ReturnMode::Strongest, vec![5.0]),
            (ReturnMode::First, vec![3.0]),
            (ReturnMode::Last, vec![8.0]),
            (ReturnMode::Dual, vec![5.0, 8.0]),
            (ReturnMode::All, vec![3.0, 5.0, 8.0]),
        ] {
            let mut detected = all();
            choose(mode, &mut detected);
            assert_eq!(detected.iter().map(|one| one.measured).collect::<Vec<_>>(), ranges);
        }
        choose(ReturnMode::Dual, &mut Vec::new());
    }

    #[test]
    fn half_of_the_echoes_at_the_threshold_are_detected() {
        let model = LidarModel::find("hdl-64e").unwrap();
        let random = RandomStream::new(3, 1u64, 0);
        let mut detected = Vec::new();
        for (signal, share) in [(1.0, 0.5), (1.2, 0.841), (0.8, 0.159)] {
            let merged = [echo(30.0, signal * model.least_power(), EchoClass::Surface)];
            let seen = |pulse: &u64| {
                detect(&merged, &model, &random, *pulse, &mut detected);
                !detected.is_empty()
            };
            let count = (0..20_000).filter(seen).count() as f64;
            // Standard error 0.0035.
            assert!((count / 20_000.0 - share).abs() < 0.014, "{signal}: {count}");
        }
    }
}
