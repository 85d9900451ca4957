//! Where the model disagrees: the force that is needed and not modelled, and what it depends on.
//!
//! r = M(q) v̇ + C(q, v) v + G(q) − Q_model with q, v, v̇ from local cubics through the measurements. This explains and orders; it
//! does not decide: its noise is too high for that.

use super::audit::Masked;
use super::curves::ResidualForce;
use super::signals::Signals;
use super::smooth::Smoothed;
use super::study::{Fitted, Study};
use super::verdict::Disagreement;
use crate::hybrid::{Reading, State};
use crate::shooting::ObservedRun;

/// Over what time the change of an input is asked, s at the usual pace.
const CHANGE_S: f64 = 0.08;

/// Locates the disagreement of a fitted model, worst coordinate first; what is masked is not looked at.
pub fn locate(
    study: &Study,
    fitted: &Fitted,
    smoothed: &[Smoothed],
    half_width: f64,
    input_names: &[String],
    masked: &Masked,
) -> (Vec<Disagreement>, Vec<ResidualForce>) {
    let hybrid = &fitted.hybrid;
    let nv = hybrid.nv();
    let theta = &fitted.inside.theta;
    let readings = hybrid.readings(theta, &[]);
    let coordinates = hybrid.mechanics().coordinates();
    let mut residuals: Vec<Vec<f64>> = vec![Vec::new(); nv];
    let mut noise_square = vec![0.0; nv];
    let mut times: Vec<(usize, f64)> = Vec::new();
    let change = study.pace.long(CHANGE_S);
    let mut signals = Signals::new(coordinates, input_names, change);
    let mut memory = hybrid.memory(&[]);
    let mut mass = nalgebra::DMatrix::zeros(nv, nv);

    for (r, run) in study.observations.runs.iter().enumerate() {
        let smooth = &smoothed[r];
        let interval = (run.t.last().unwrap_or(&0.0) - run.t.first().unwrap_or(&0.0))
            / run.t.len().saturating_sub(1).max(1) as f64;
        // Samples a quarter of the kernel apart: closer ones say the same.
        let stride = ((0.5 * half_width / interval.max(1e-12)) as usize).max(1);
        let side = ((half_width / interval.max(1e-12)) as usize).max(3) as f64;
        // Deviation of a local quadratic's or cubic's second derivative over 2 side + 1 samples of unit noise.
        let curvature_noise = (720.0 / (2.0 * side + 1.0).powi(5)).sqrt() / interval.powi(2);
        let lag = ((change / interval.max(1e-12)) as usize).max(1);
        let modelled = modelled_accelerations(fitted, run, smooth, &readings);
        let kernel = kernel(side as usize);
        let mut reversal = vec![run.t[0]; nv];
        for k in 0..run.t.len().saturating_sub(1) {
            for (c, since) in reversal.iter_mut().enumerate() {
                if k > 0 && smooth.v[c][k] * smooth.v[c][k - 1] < 0.0 {
                    *since = run.t[k];
                }
            }
            if k % stride != 0 || (k as f64) < side || k as f64 + side >= run.t.len() as f64 {
                continue;
            }
            if masked.touches(r, run.t[k] - half_width, run.t[k] + half_width) {
                continue;
            }
            let state = smooth.state(k);
            let q: Vec<f64> = (0..nv)
                .map(|c| readings[c].position_of(state[c], state[nv + c]))
                .collect();
            let model = averaged(&modelled, k, &kernel);
            hybrid.mass_matrix_into(&q, theta, &mut memory, &mut mass);
            // M (measured acceleration − modelled acceleration) is the missing force.
            for i in 0..nv {
                let mut force = 0.0;
                let mut variance = 0.0;
                for j in 0..nv {
                    force += mass[(i, j)] * (smooth.a[j][k] - model[j]);
                    let noise = study.observations.channels[j].noise * curvature_noise;
                    variance += (mass[(i, j)] * noise).powi(2);
                }
                residuals[i].push(force);
                noise_square[i] += variance;
            }
            times.push((r, run.t[k]));
            signals.push(run, smooth, k, lag, &reversal);
        }
    }

    let n = times.len().max(1) as f64;
    let mut out: Vec<(f64, Disagreement, ResidualForce)> = (0..nv)
        .map(|c| {
            let force = &residuals[c];
            let square = force.iter().map(|f| f * f).sum::<f64>() / n;
            let floor = (noise_square[c] / n).max(f64::MIN_POSITIVE);
            let explained = signals.explain(c, force);
            let (best, share) = explained.first().copied().unwrap_or((0, 0.0));
            let together = signals.by_position_and_direction(c, force);
            let coordinate = &coordinates[c];
            let both = format!("position and direction of {}", coordinate.name);
            let mut explained_by: Vec<(String, f64)> = explained
                .iter()
                .map(|&(s, share)| (signals.names[s].0.clone(), share))
                .collect();
            // The best single signal stays first.
            let place = explained_by.iter().skip(1).position(|e| e.1 < together);
            explained_by.insert(
                place.map_or(explained_by.len(), |k| k + 1),
                (both, together),
            );
            let disagreement = Disagreement {
                coordinate: coordinate.name.clone(),
                share: 0.0,
                rms: square.sqrt(),
                unit: coordinate.force_unit().into(),
                r#where: signals.words((best, share), together, force),
                when: intervals(&times, force, half_width),
            };
            let residual = ResidualForce {
                coordinate: coordinate.name.clone(),
                unit: coordinate.force_unit().into(),
                run: times.iter().map(|t| t.0).collect(),
                t: times.iter().map(|t| t.1).collect(),
                force: force.clone(),
                explained_by,
                best_signal: (
                    signals.names[best].0.clone(),
                    signals.names[best].1.clone(),
                    signals.values[best].clone(),
                ),
                profiles: signals.profiles(c, &explained, force),
            };
            ((square / floor - 1.0).max(0.0), disagreement, residual)
        })
        .collect();
    let total: f64 = out.iter().map(|o| o.0).sum();
    for (excess, disagreement, _) in &mut out {
        disagreement.share = if total > 0.0 { *excess / total } else { 0.0 };
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out.into_iter().map(|(_, d, r)| (d, r)).unzip()
}

/// v̇ of the model over every sample interval of a recording: the mean of both ends, at the smoothed states and the input held.
fn modelled_accelerations(
    fitted: &Fitted,
    run: &ObservedRun,
    smooth: &Smoothed,
    readings: &[Reading],
) -> Vec<Vec<f64>> {
    let hybrid = &fitted.hybrid;
    let theta = &fitted.inside.theta;
    let nv = hybrid.nv();
    let inputs = hybrid.drive(&run.t, &run.u, 1, theta, &[]);
    let mut memory = hybrid.memory(&[]);
    let read = |sample: usize| -> Vec<f64> {
        let mut state = smooth.state(sample);
        for (c, reading) in readings.iter().enumerate() {
            state[c] = reading.position_of(state[c], state[nv + c]);
        }
        state
    };
    let path = hybrid.hidden_path(theta, &inputs, &read);
    let mut at = |sample: usize, step: usize| -> Vec<f64> {
        let state = read(sample);
        let (q, v) = state.split_at(nv);
        let h = path.at(sample);
        match hybrid.acceleration(State { q, v, h }, theta, &inputs, step, &mut memory) {
            Ok(()) => memory.acceleration.as_slice().to_vec(),
            Err(_) => (0..nv).map(|c| smooth.a[c][sample]).collect(),
        }
    };
    (0..run.t.len().saturating_sub(1))
        .map(|k| {
            let ends = at(k, k).into_iter().zip(at(k + 1, k));
            ends.map(|(a, b)| 0.5 * (a + b)).collect()
        })
        .collect()
}

/// The weights with which the second derivative of a local quadratic or cubic over the samples −m … m sees the true acceleration over
/// each of the 2m intervals; their sum is 1.
///
/// That derivative is Σ c_i y_i with c_i ∝ i² − m(m + 1)/3 and Σ c_i i² = 2; an acceleration at time s counts K(s) = Σ_{i>s} c_i (i − s).
fn kernel(m: usize) -> Vec<f64> {
    let m = m as i64;
    let middle = (m * (m + 1)) as f64 / 3.0;
    let raw = |i: i64| (i * i) as f64 - middle;
    let norm: f64 = (-m..=m).map(|i| raw(i) * (i * i) as f64).sum::<f64>() / 2.0;
    let k = |j: i64| (j..=m).map(|i| raw(i) * (i - j) as f64).sum::<f64>() / norm;
    (-m..m).map(|j| 0.5 * (k(j) + k(j + 1))).collect()
}

/// The modelled accelerations around sample `k` as the smoothing sees the true ones: it takes the same from both.
fn averaged(modelled: &[Vec<f64>], k: usize, kernel: &[f64]) -> Vec<f64> {
    let first = k - kernel.len() / 2;
    let mut sum = vec![0.0; modelled[k].len()];
    for (weight, acceleration) in kernel.iter().zip(&modelled[first..]) {
        for (sum, a) in sum.iter_mut().zip(acceleration) {
            *sum += weight * a;
        }
    }
    sum
}

/// The times around which the force is largest: the upper twentieth, joined where close, the longest ten.
fn intervals(times: &[(usize, f64)], force: &[f64], half_width: f64) -> Vec<[f64; 2]> {
    let mut sizes: Vec<f64> = force.iter().map(|f| f.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let Some(&limit) = sizes.get(sizes.len() * 19 / 20) else {
        return Vec::new();
    };
    let mut joined: Vec<(usize, [f64; 2])> = Vec::new();
    for (&(run, t), f) in times.iter().zip(force) {
        if f.abs() < limit {
            continue;
        }
        match joined.last_mut() {
            Some((r, interval)) if *r == run && t - interval[1] < 4.0 * half_width => {
                interval[1] = t;
            }
            _ => joined.push((run, [t, t])),
        }
    }
    let mut intervals: Vec<[f64; 2]> = joined
        .into_iter()
        .map(|(_, [a, b])| [a - half_width, b + half_width])
        .collect();
    intervals.sort_by(|a, b| (b[1] - b[0]).total_cmp(&(a[1] - a[0])));
    intervals.truncate(10);
    intervals.sort_by(|a, b| a[0].total_cmp(&b[0]));
    intervals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_sees_an_acceleration_as_the_local_fit_does() {
        for m in [3_usize, 5, 8] {
            // Positions under an acceleration that is constant over each interval.
            let accelerations: Vec<f64> =
                (0..2 * m).map(|j| (1.7 * j as f64).sin() + 0.3).collect();
            let (mut q, mut v) = (vec![0.4], -0.2);
            for a in &accelerations {
                q.push(q[q.len() - 1] + v + 0.5 * a);
                v += a;
            }
            // Second derivative of the quadratic fitted to them by least squares.
            let s: Vec<f64> = (0..=2 * m).map(|i| i as f64 - m as f64).collect();
            let mean = |f: &dyn Fn(usize) -> f64| (0..=2 * m).map(f).sum::<f64>() / s.len() as f64;
            let square = mean(&|i| s[i].powi(2));
            let covariance = mean(&|i| (s[i].powi(2) - square) * q[i]);
            let fitted = 2.0 * covariance / mean(&|i| (s[i].powi(2) - square).powi(2));
            let seen: f64 = kernel(m)
                .iter()
                .zip(&accelerations)
                .map(|(w, a)| w * a)
                .sum();
            assert!((seen - fitted).abs() < 1e-12, "{seen} {fitted}");
        }
    }
}
