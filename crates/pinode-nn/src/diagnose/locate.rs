//! Where the model disagrees: the force that is needed and not modelled, and what it depends on.
//!
//! r = M(q) v̇ + C(q, v) v + G(q) − Q_model with q, v, v̇ from local cubics through the measurements. This explains and orders; it
//! does not decide: its noise is too high for that.

use super::accelerations::{Seen, missing, modelled, states};
use super::audit::Masked;
use super::curves::ResidualForce;
use super::signals::Signals;
use super::smooth::Smoothed;
use super::study::{Fitted, Study};
use super::verdict::Disagreement;

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
        let seen = Seen::of(&run.t, half_width);
        let lag = ((change / seen.interval) as usize).max(1);
        let read = states((hybrid, theta), smooth);
        let modelled = modelled((hybrid, theta), run, smooth);
        let mut reversal = vec![run.t[0]; nv];
        for k in 0..run.t.len().saturating_sub(1) {
            for (c, since) in reversal.iter_mut().enumerate() {
                if k > 0 && smooth.v[c][k] * smooth.v[c][k - 1] < 0.0 {
                    *since = run.t[k];
                }
            }
            if k % seen.stride != 0 || !seen.reaches(k, run.t.len()) {
                continue;
            }
            if masked.touches(r, run.t[k] - half_width, run.t[k] + half_width) {
                continue;
            }
            let model = seen.averaged(&modelled, k);
            if !model.iter().all(|a| a.is_finite()) {
                continue;
            }
            hybrid.mass_matrix_into(&read(k)[..nv], theta, &mut memory, &mut mass);
            // M (v̇ − v̇_model) is the missing force.
            let missing = missing(smooth, k, &model);
            for i in 0..nv {
                let mut force = 0.0;
                let mut variance = 0.0;
                for j in 0..nv {
                    force += mass[(i, j)] * missing[j];
                    let noise = study.observations.channels[j].noise * seen.noise;
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
