//! The second mechanism: Furuta's pendulum, whose motor is late and whose arm has drag and dry friction.
//!
//! Motors, friction and sensors are those of [`Bench::furuta`]. Hidden are an input that is 30 ms late, as at the cart-pole, Coulomb friction of the arm
//! that is twice as large one way as the other, and drag with the square of its speed.

use std::path::{Path, PathBuf};

use super::Error;
use super::experiment::{Errors, Lesson};
use super::stand::{Known, Stand, read};
use super::windows::{Measured, mean_errors};
use crate::config::NoiseLevel;
use crate::joints::{Bench, Fault, INTERVAL, Recording};

/// Rows of inputs that a window begins with.
const PAST: usize = 4;
/// Arm and motor.
const DRIVEN: usize = 0;

/// Furuta's pendulum.
pub(super) struct Rotary {
    bench: Bench,
    hidden: [Fault; 3],
    model: PathBuf,
}

impl Rotary {
    /// `models` has the folder `furuta_pendulum`.
    ///
    /// # Errors
    /// Where its files cannot be read.
    pub fn read(models: &Path) -> Result<Self, Error> {
        let fault = |kind, parameters: &[(&'static str, f64)]| Fault {
            kind,
            target: DRIVEN,
            parameters: parameters.to_vec(),
        };
        Ok(Rotary {
            bench: Bench::furuta(models)?,
            hidden: [
                fault("input_delay", &[("delay", 0.030)]),
                fault(
                    "asymmetric_coulomb_friction",
                    &[("force_positive", 0.006), ("force_negative", 0.003)],
                ),
                fault("quadratic_drag", &[("coefficient", 0.001)]),
            ],
            model: models.join("furuta_pendulum/furuta_pendulum.toml"),
        })
    }

    fn record(&self, samples: usize, seed: u64, path: &Path) -> Result<Recording, Error> {
        let duration = samples as f64 * INTERVAL;
        let recording = self
            .bench
            .run(&self.hidden, NoiseLevel::Realistic, duration, seed)?;
        recording.write_csv_with_differences(path)?;
        Ok(recording)
    }
}

impl Stand for Rotary {
    fn name(&self) -> &'static str {
        "furuta"
    }

    fn title(&self) -> &'static str {
        "Furuta's pendulum"
    }

    fn signals(&self) -> [&'static str; 4] {
        [
            "arm, rad",
            "pendulum, rad",
            "arm_dot, rad/s",
            "pendulum_dot, rad/s",
        ]
    }

    fn interval(&self) -> f64 {
        INTERVAL
    }

    fn known(&self) -> Result<Known, Error> {
        Ok(Known {
            path: self.model.clone(),
            text: read(&self.model)? + SENSORS,
            frictions: COULOMB,
            held: "",
            suspects: SUSPECTS,
        })
    }

    fn learn(&self, _: Lesson, samples: usize, seed: u64, path: &Path) -> Result<(), Error> {
        self.record(samples, seed, path).map(drop)
    }

    fn test(
        &self,
        samples: usize,
        seed: u64,
        windows: (usize, usize),
        path: &Path,
    ) -> Result<[Errors; 2], Error> {
        let recording = self.record(samples, seed, path)?;
        let differences = recording.differences();
        let column = |rows: &[Vec<f64>], c: usize| -> Vec<f64> {
            rows.iter().filter_map(|row| row.get(c)).copied().collect()
        };
        let q = [0, 1].map(|c| column(&recording.q, c));
        let v = [0, 1].map(|c| column(&differences, c));
        let measured = Measured {
            q: q.each_ref().map(Vec::as_slice),
            v: v.each_ref().map(Vec::as_slice),
            wraps: [true; 2],
            interval: INTERVAL,
        };
        let steps = windows.1;
        let errors = |start: &dyn Fn(usize) -> [Vec<f64>; 2]| {
            mean_errors(&measured, PAST, windows, |k| {
                let [q, v] = start(k);
                let (past, inputs) = (&recording.u[k - PAST..k], &recording.u[k..k + steps]);
                let run = self.bench.true_run(&self.hidden, (&q, &v), past, inputs)?;
                let pair = |row: &Vec<f64>| [row[0], row[1]];
                Ok(std::iter::once(&q).chain(&run).map(pair).collect())
            })
        };
        Ok([
            errors(&|k| [recording.q[k].clone(), differences[k].clone()])?,
            errors(&|k| {
                let (q, v) = &recording.truth[k];
                [q.clone(), v.clone()]
            })?,
        ])
    }
}

const SENSORS: &str = r#"
[sensor.arm]
position_noise = 3e-4             # rad
velocity = "backward_difference"

[sensor.pendulum]
position_noise = 3e-4             # rad
velocity = "backward_difference"
"#;

const COULOMB: &str = r#"
[[effect]]
kind  = "coulomb_friction"
joint = "arm"
force = 0.004                     # N·m

[tolerance]
mass = 0.0
gain = 0.0
zero = { arm = 0.0, pendulum = 0.0 }
"#;

const SUSPECTS: &str = r#"
[[effect]]
kind  = "input_delay"
input = "motor"
delay = 0.02                      # s

[[effect]]
kind  = "asymmetric_coulomb_friction"
joint = "arm"
force_positive = 0.004            # N·m
force_negative = 0.004

[[effect]]
kind  = "reflected_inertia"
joint = "arm"
inertia = 0.0                     # kg·m²

[tolerance]
mass = 0.0
gain = 0.0
"#;
