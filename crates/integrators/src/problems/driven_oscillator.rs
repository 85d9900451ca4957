use super::Problem;
use super::formula::{Formula, system_of_formula};
use crate::{Flat, Mechanical, PhaseSpace};

use std::convert::Infallible;

/// q̈ = −ω² q − 2 δ q̇ + a cos Ω t, x = [q, v], released at rest at 1: the problem with a rate that depends on time, and with a force that
/// depends on v. Its constants are ω, δ and a.
///
/// q(t) = A cos Ωt + B sin Ωt + e^{−δt} (C cos ω_d t + S sin ω_d t) with ω_d² = ω² − δ², A = a (ω² − Ω²)/D, B = 2 a δ Ω/D,
/// D = (ω² − Ω²)² + (2 δ Ω)², C = 1 − A and S = (δ C − B Ω)/ω_d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrivenOscillator {
    /// ω, rad/s.
    pub frequency: f64,
    /// δ < ω, 1/s.
    pub damping: f64,
    /// a, m/s².
    pub drive: f64,
    /// Ω, rad/s, not ω where δ = 0.
    pub drive_frequency: f64,
}

impl DrivenOscillator {
    fn acceleration_of(&self, t: f64, q: &[f64], v: &[f64]) -> f64 {
        let restoring = self.frequency.powi(2) * q[0] + 2.0 * self.damping * v[0];
        self.drive * (self.drive_frequency * t).cos() - restoring
    }
}

impl Formula<2, 3> for DrivenOscillator {
    fn rate(&self, t: f64, x: &[f64]) -> [f64; 2] {
        let (q, v) = x.split_at(1);
        [v[0], self.acceleration_of(t, q, v)]
    }
    fn by_state(&self, _t: f64, _x: &[f64]) -> [[f64; 2]; 2] {
        [[0.0, 1.0], [-self.frequency.powi(2), -2.0 * self.damping]]
    }
    fn by_constants(&self, t: f64, x: &[f64]) -> [[f64; 3]; 2] {
        let by_frequency = -2.0 * self.frequency * x[0];
        let by_drive = (self.drive_frequency * t).cos();
        [[0.0; 3], [by_frequency, -2.0 * x[1], by_drive]]
    }
}

system_of_formula!(DrivenOscillator, 2, 3, PhaseSpace<Flat> = PhaseSpace { positions: Flat::new(1) });

impl Mechanical for DrivenOscillator {
    type Positions = Flat;

    fn positions(&self) -> &Flat {
        const POSITIONS: Flat = Flat::new(1);
        &POSITIONS
    }

    fn acceleration(
        &self,
        t: f64,
        (q, v): (&[f64], &[f64]),
        _u: &(),
        _memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        out.fill(self.acceleration_of(t, q, v));
        Ok(())
    }

    fn momentum(
        &self,
        (_q, v): (&[f64], &[f64]),
        _memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        out.copy_from_slice(v);
        Ok(())
    }

    fn velocity(&self, _q: &[f64], _memory: &mut (), _out: &mut [f64]) -> Result<(), Infallible> {
        Ok(())
    }

    fn position_force(
        &self,
        t: f64,
        state: (&[f64], &[f64]),
        u: &(),
        memory: &mut (),
        out: &mut [f64],
    ) -> Result<(), Infallible> {
        self.acceleration(t, state, u, memory, out)
    }

    fn not_separable(&self) -> Option<String> {
        (self.damping != 0.0).then(|| "the damping force depends on v".into())
    }
}

impl Problem for DrivenOscillator {
    fn name(&self) -> &'static str {
        "driven oscillator"
    }
    fn initial(&self) -> Vec<f64> {
        vec![1.0, 0.0]
    }
    fn span(&self) -> f64 {
        1.27 * std::f64::consts::TAU / self.frequency
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        let (w, delta, drive) = (self.frequency, self.damping, self.drive_frequency);
        let free = (w * w - delta * delta).sqrt();
        let detuning = w * w - drive * drive;
        let scale = self.drive / (detuning.powi(2) + (2.0 * delta * drive).powi(2));
        let (a, b) = (scale * detuning, scale * 2.0 * delta * drive);
        let c = 1.0 - a;
        let s = (delta * c - b * drive) / free;
        let (sin_drive, cos_drive) = (drive * t).sin_cos();
        let (sin, cos) = (free * t).sin_cos();
        let decay = (-delta * t).exp();
        let position = a * cos_drive + b * sin_drive + decay * (c * cos + s * sin);
        let velocity = drive * (b * cos_drive - a * sin_drive)
            + decay * ((free * s - delta * c) * cos - (free * c + delta * s) * sin);
        Some(vec![position, velocity])
    }
}
