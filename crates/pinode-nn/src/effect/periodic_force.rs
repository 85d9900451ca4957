//! Force that repeats along the way: Q = A sin(2π q/λ + φ).
//!
//! A in N or N·m, of either sign, period λ in m or rad, phase φ in rad: the cogging of a motor, the teeth of a belt, an eccentric pulley. Periodic in the
//! position, not in time.

use std::f64::consts::TAU;

use lagrange::Scalar;

use super::{Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity, Scales};

struct Periodic;

impl ForceLaw for Periodic {
    fn force<D: Scalar>(&self, q: D, _v: D, p: &[D], _smoothing: D) -> D {
        p[0] * (q / p[1] * TAU + p[2]).sin()
    }

    /// A ≥ 0 and 0 ≤ φ < 2π.
    fn normalise(&self, p: &mut [f64]) {
        if let [amplitude, _, phase] = p {
            let turned = if *amplitude < 0.0 { 0.5 * TAU } else { 0.0 };
            *amplitude = amplitude.abs();
            *phase = (*phase + turned).rem_euclid(TAU);
        }
    }

    /// It repeats within the range of the motion.
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        p[1] < 2.0 * scales.reach / FEWEST_PERIODS
    }
}

/// A screen tries so many numbers of periods in the range of the motion, from one and a half on, three quarters apart: over the whole
/// range a force falls out of step with the nearest one by less than half a turn, from where a fit finds to it.
const PERIODS: usize = 42;
/// Where a wheel turns more often than those can tell, what repeats with its turns repeats a whole number of times in each: up to so many, as teeth and
/// magnets do.
const IN_A_TURN: usize = 36;
/// What repeats more seldom in the range of the motion is a bent spring.
const FEWEST_PERIODS: f64 = 1.4;

/// The kind `periodic_force`.
pub static KIND: Kind = Kind {
    name: "periodic_force",
    family: Family::Conservative,
    summary: "force that repeats along the way",
    parameters: &[
        ParameterSpec::new(
            "amplitude",
            Quantity::Force,
            (f64::NEG_INFINITY, f64::INFINITY),
            0.0,
        ),
        ParameterSpec::new("period", Quantity::Displacement, (1e-6, f64::INFINITY), 0.1),
        ParameterSpec::new("phase", Quantity::Angle, (-1e3, 1e3), 0.0),
    ],
    action: Action::Joint(&OnCoordinate(Periodic)),
    contains: &[],
    probes: |scales, _| {
        let d = scales.small_force();
        let range = 2.0 * scales.reach;
        let tried = |k: usize| 1.5 + 0.75 * k as f64;
        let turns = range / TAU;
        let whole = (1..=IN_A_TURN).map(|n| n as f64);
        let whole = whole.filter(|n| turns > 2.0 && n * turns > tried(PERIODS));
        let periods = (0..PERIODS).map(|k| range / tried(k));
        periods
            .chain(whole.map(|n| TAU / n))
            .flat_map(|period| {
                [0.0, 0.25].map(|turn| {
                    // The phase is that in the middle of the motion.
                    let phase = (turn - scales.centre / period).rem_euclid(1.0) * TAU;
                    Probe {
                        neutral: vec![0.0, period, phase],
                        perturbed: vec![d, period, phase],
                    }
                })
            })
            .collect()
    },
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::JointForce;

    /// In all four quarters of the phase, and turns further on.
    #[test]
    fn the_force_is_the_same_by_a_positive_amplitude_and_a_phase_within_a_turn() {
        let law = OnCoordinate(Periodic);
        for phase in [-9.0, -0.3, 0.0, 1.2, 3.0, 4.9, 40.0] {
            for amplitude in [-0.4, 0.4] {
                let given = [amplitude, 0.07, phase];
                let mut written = given;
                law.normalise(&mut written);
                assert!(
                    written[0] == 0.4 && (0.0..TAU).contains(&written[2]),
                    "{written:?}"
                );
                for q in [-0.31, 0.0, 0.013, 0.2] {
                    let [a, b] = [given, written].map(|p| law.force(q, 0.0, &p, 0.01));
                    assert!((a - b).abs() < 1e-13, "{given:?}, {q}: {a} and {b}");
                }
            }
        }
    }

    /// Nine turns: a force that repeats seven times in each repeats 63 times.
    #[test]
    fn what_repeats_with_the_turns_of_a_wheel_is_asked_for_however_often_it_turns() {
        let wheel = |turns: f64| Scales {
            reach: 0.5 * TAU * turns,
            ..Scales::example()
        };
        let phases = |scales: &Scales, n: f64| {
            let probes = (KIND.probes)(scales, &[]);
            let asked = probes
                .iter()
                .filter(|p| (p.neutral[1] * n - TAU).abs() < 1e-12);
            asked.count()
        };
        // Three a turn are 27, which are asked for already.
        for n in [3.0, 7.0, 36.0] {
            assert_eq!(phases(&wheel(9.0), n), 2, "{n}");
        }
        assert_eq!(phases(&wheel(1.5), 36.0), 0, "it hardly turns");
    }
}
