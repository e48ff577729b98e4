//! Drops that fall from eaves, one by one: each is a function of its eave and its number.

use crate::physics::GRAVITY;
use wm_base::random::{RandomSequence, mix};

/// Diameters of drops that let go of an edge.
const DRIP_DIAMETERS_M: [f64; 2] = [4.2e-3, 5.4e-3];
/// Volume of a usual drop from an edge.
const USUAL_DRIP_VOLUME_M3: f64 = 5.88e-8;
/// Most drops per second of a piece of an eave, as from 5 m of roof in 85 mm/h: what is more is
/// left out.
const MAX_DRIPS: f64 = 200.0;
/// Part of the seeds of drips.
const DRIP_SEED: u64 = 0x4541_5645;

/// A drop that has let go of an eave.
#[derive(Clone, Debug)]
pub(crate) struct Drip {
    /// Time since it let go, s; below 0 it will.
    pub(crate) age: f64,
    /// Place along the piece of the eave, -0.5 to 0.5, and across it.
    pub(crate) place: [f64; 2],
    /// Diameter, m.
    pub(crate) diameter: f64,
    /// More random numbers of its own.
    pub(crate) draws: RandomSequence,
}

/// Calls `take` with the drops of eave `number` that let go between two times, s, with their ages
/// at `time`, where `flux` m^3/s fall.
pub(crate) fn each(number: u64, flux: f64, span: [f64; 2], time: f64, mut take: impl FnMut(Drip)) {
    let [from, to] = span;
    let share = flux / USUAL_DRIP_VOLUME_M3 / MAX_DRIPS;
    if share <= 0.0 {
        return;
    }
    let [first, last] = [from, to].map(|at| (at * MAX_DRIPS).floor() as i64);
    for slot in first..=last {
        let mut draws = RandomSequence::new(mix(mix(DRIP_SEED ^ number) ^ slot as u64));
        if draws.uniform() >= share {
            continue;
        }
        let let_go = (slot as f64 + draws.uniform()) / MAX_DRIPS;
        let place = [draws.uniform() - 0.5, draws.uniform() - 0.5];
        let diameter = DRIP_DIAMETERS_M[0] + (DRIP_DIAMETERS_M[1] - DRIP_DIAMETERS_M[0]) * draws.uniform();
        take(Drip { age: time - let_go, place, diameter, draws });
    }
}

/// A fall from rest in still air to a terminal speed, m/s, with drag by the square of the speed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fall {
    /// m/s.
    pub(crate) terminal: f64,
}

impl Fall {
    /// The depth fallen after some seconds, m.
    pub(crate) fn depth(self, age: f64) -> f64 {
        let long = self.terminal / GRAVITY;
        self.terminal * long * (age.max(0.0) / long).cosh().ln()
    }

    /// The time to fall so deep, s.
    pub(crate) fn time(self, depth: f64) -> f64 {
        let long = self.terminal / GRAVITY;
        long * (depth / (self.terminal * long)).exp().acosh()
    }

    /// The speed after some seconds, m/s.
    pub(crate) fn speed(self, age: f64) -> f64 {
        self.terminal * (age.max(0.0) * GRAVITY / self.terminal).tanh()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 5 m of roof shed 14 mL/s a metre in rain of 10 mm/h.
    #[test]
    fn as_much_water_falls_as_runs_off() {
        let flux = 0.1 * 5.0 * 10.0 * 1e-3 / 3600.0;
        let mut sum = 0.0;
        for number in 0..20 {
            each(number, flux, [3.0, 13.0], 13.0, |drip| {
                assert!((-0.02..10.02).contains(&drip.age));
                sum += std::f64::consts::PI / 6.0 * drip.diameter.powi(3);
            });
        }
        assert!((sum / (20.0 * 10.0 * flux) - 1.0).abs() < 0.05, "{}", sum / (200.0 * flux));
        each(0, 0.0, [0.0, 1.0], 1.0, |_| unreachable!());
    }

    #[test]
    fn a_drop_is_the_same_from_whichever_time_it_is_looked_at() {
        let of = |from: f64, time: f64| {
            let mut found = Vec::new();
            each(7, 1e-6, [from, time], time, |drip| found.push((time - drip.age, drip.place)));
            found.retain(|(let_go, _)| (5.0..6.0).contains(let_go));
            found
        };
        let (long, short) = (of(4.0, 7.0), of(4.5, 6.5));
        assert!(long.len() > 5 && long.len() == short.len());
        for (a, b) in long.iter().zip(&short) {
            assert!((a.0 - b.0).abs() < 1e-9 && a.1 == b.1);
        }
    }

    #[test]
    fn falls_begin_free_and_end_at_the_terminal_speed() {
        let fall = Fall { terminal: 9.1 };
        assert!((fall.depth(0.1) / (0.5 * GRAVITY * 0.01) - 1.0).abs() < 0.01);
        assert!((fall.depth(fall.time(4.0)) - 4.0).abs() < 1e-9);
        assert!((fall.speed(0.2) - 1.92).abs() < 0.05 && fall.speed(9.0) < 9.1001);
    }
}
