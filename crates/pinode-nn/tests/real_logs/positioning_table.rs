//! Errors of models of the positioning table EMPS, as its publishers measure them.
//!
//! Inverse dynamics: e = u − [M v̇ + friction](q, v, v̇) along the measured motion, ‖e‖/‖u‖. Position, velocity and acceleration are those
//! of cubics over ±5 ms, and e and u are means over 10 ms: published are a zero-phase low-pass at 100 Hz and a decimation by ten.
//! Closed loop: the controller of the rig drives the model instead of the table, ‖q − q_measured‖/‖q_measured‖.

use integrators::System;
use nalgebra::DMatrix;
use pinode_nn::effect::Signal;
use pinode_nn::hybrid::{DrivenInputs, Hybrid, HybridMotion};
use pinode_nn::log::Run;
use pinode_nn::model::Model;

/// Half the stretch of a cubic, samples.
const HALF: usize = 5;
/// Samples of a mean.
const MEAN: usize = 10;
/// Gains of the cascade: from a position error to a velocity, 1/s; from a velocity error to a voltage, V/(m/s).
const CONTROLLER: (f64, f64) = (160.18, 243.45);
/// Largest voltage, V, and force per volt, N.
const DRIVE: (f64, f64) = (10.0, 35.15);
/// Dry friction as it is: its sign spread over 0.1 mm/s instead of 3 mm/s, which only roll-outs need.
const SHARP: f64 = 1.0 / 30.0;
/// Steps of the closed loop within a sample.
const STEPS: usize = 10;

/// ‖e‖/‖u‖ of the inverse dynamics, in percent, from time `from` on, s.
pub fn force_error(model: &Model, run: &Run, from: f64) -> f64 {
    let hybrid = Hybrid::of(model).with_smoothing_scale(SHARP);
    let theta = hybrid.theta();
    let inputs = hybrid.drive(&run.t, &run.u, 1, &theta, &[]);
    let motion = HybridMotion::new(&hybrid, &theta, &[], &inputs);
    let mut memory = motion.memory();
    let mut mass = DMatrix::zeros(1, 1);
    hybrid.mass_matrix_into(&[0.0], &theta, &mut hybrid.memory(&[]), &mut mass);
    let y = &run.q[0];
    let interval = (run.t[y.len() - 1] - run.t[0]) / (y.len() - 1) as f64;
    let first = run.t.partition_point(|t| *t < from).max(HALF);
    let mut rate = [0.0; 2];
    let each: Vec<(f64, f64)> = (first..y.len() - HALF)
        .map(|k| {
            let (q, v, a) = cubic(&y[k - HALF..=k + HALF], interval);
            motion
                .rate(run.t[k], &[q, v], &k, &mut memory, &mut rate)
                .unwrap();
            (mass[(0, 0)] * (a - rate[1]), inputs.forces[0].value[k])
        })
        .collect();
    let (mut error, mut force) = (0.0, 0.0);
    for group in each.chunks_exact(MEAN) {
        error += group.iter().map(|(e, _)| e).sum::<f64>().powi(2);
        force += group.iter().map(|(_, u)| u).sum::<f64>().powi(2);
    }
    100.0 * (error / force).sqrt()
}

/// Value, slope and curvature in the middle of the cubic that fits best.
fn cubic(y: &[f64], interval: f64) -> (f64, f64, f64) {
    let place = |k: usize| k as f64 - HALF as f64;
    let moment = |power: i32| (0..y.len()).map(|k| place(k).powi(power)).sum::<f64>();
    let [n, s2, s4, s6] = [0, 2, 4, 6].map(moment);
    let weighted = |weight: &dyn Fn(f64) -> f64| {
        let terms = y.iter().enumerate().map(|(k, y)| weight(place(k)) * y);
        terms.sum::<f64>()
    };
    let (even, odd) = (n * s4 - s2 * s2, s2 * s6 - s4 * s4);
    let value = weighted(&|x| s4 - s2 * x * x) / even;
    let slope = weighted(&|x| s6 * x - s4 * x.powi(3)) / odd;
    let curvature = 2.0 * weighted(&|x| n * x * x - s2) / even;
    (value, slope / interval, curvature / interval.powi(2))
}

/// ‖q − q_measured‖/‖q_measured‖ of the closed loop along `reference`, in percent, from time `from` on, s.
pub fn position_error(model: &Model, run: &Run, reference: &[f64], from: f64) -> f64 {
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    let mut inputs: DrivenInputs =
        hybrid.drive(&run.t[..2], &[run.u[0][..2].to_vec()], 1, &theta, &[]);
    let gain = model.inputs[0].gain;
    let (mut q, mut v) = (run.q[0][0], 0.0);
    let mut rate = [0.0; 2];
    let (mut error, mut size) = (0.0, 0.0);
    for (k, wanted) in reference.iter().enumerate().take(run.t.len() - 1) {
        if run.t[k] >= from {
            error += (q - run.q[0][k]).powi(2);
            size += run.q[0][k].powi(2);
        }
        let voltage = CONTROLLER.1 * (CONTROLLER.0 * (wanted - q) - v);
        let force = gain * DRIVE.1 * voltage.clamp(-DRIVE.0, DRIVE.0);
        inputs.forces = vec![Signal {
            value: vec![force],
            by_parameter: Vec::new(),
        }];
        let motion = HybridMotion::new(&hybrid, &theta, &[], &inputs);
        let mut memory = motion.memory();
        let step = (run.t[k + 1] - run.t[k]) / STEPS as f64;
        for _ in 0..STEPS {
            motion
                .rate(run.t[k], &[q, v], &0, &mut memory, &mut rate)
                .unwrap();
            v += step * rate[1];
            q += step * v;
        }
    }
    100.0 * (error / size).sqrt()
}
