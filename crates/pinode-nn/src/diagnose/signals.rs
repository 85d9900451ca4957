//! What a missing force could depend on.

use super::audit::median;
use super::curves::Profile;
use super::experiment::short;
use super::smooth::Smoothed;
use crate::bins::{along, explained_by};
use crate::shooting::ObservedRun;

/// Number of quantile bins of the correlation ratio.
const BINS: usize = 12;
/// A force of whose variance no signal explains this share is tied to none.
pub const TIED: f64 = 0.05;
/// Position and direction of motion together are worth a word when they explain so much more than the best signal alone.
const WORTH_A_WORD: f64 = 0.1;
/// Signals along which the mean force is drawn.
const PROFILES: usize = 8;

/// What a missing force could depend on, at the looked-at samples.
pub struct Signals {
    pub names: Vec<(String, String)>,
    pub values: Vec<Vec<f64>>,
    /// The first of each pair of coordinates of which one may act on the other.
    pairs: Vec<usize>,
    /// How many coordinates there are.
    coordinates: usize,
}

/// Coordinates that follow one another and count alike, by the first one, with what the second is to it: a spring between two bodies follows that, where each
/// counts from where it stands.
pub fn relative(
    coordinates: &[lagrange::Coordinate],
) -> impl Iterator<Item = (usize, String)> + '_ {
    let pairs = coordinates.windows(2).enumerate();
    pairs.filter_map(|(c, pair)| match pair {
        [one, other] if one.unit() == other.unit() => {
            Some((c, format!("{} from {}", other.name, one.name)))
        }
        _ => None,
    })
}

impl Signals {
    /// `changes` is over what time the change of an input is asked, s.
    pub fn new(coordinates: &[lagrange::Coordinate], inputs: &[String], change: f64) -> Self {
        let mut names = Vec::new();
        for c in coordinates {
            let unit = c.unit();
            names.push((format!("position of {}", c.name), unit.to_owned()));
            names.push((format!("velocity of {}", c.name), format!("{unit}/s")));
            names.push((format!("acceleration of {}", c.name), format!("{unit}/s²")));
            names.push((format!("time since {} reversed", c.name), "s".to_owned()));
        }
        let pairs: Vec<usize> = relative(coordinates)
            .map(|(c, of_pair)| {
                let unit = coordinates[c].unit();
                names.push((format!("position of {of_pair}"), unit.to_owned()));
                names.push((format!("velocity of {of_pair}"), format!("{unit}/s")));
                c
            })
            .collect();
        for input in inputs {
            names.push((format!("input {input}"), String::new()));
            let ms = short(1e3 * change);
            names.push((
                format!("change of input {input} over {ms} ms"),
                String::new(),
            ));
        }
        names.push(("time".to_owned(), "s".to_owned()));
        Signals {
            values: vec![Vec::new(); names.len()],
            names,
            pairs,
            coordinates: coordinates.len(),
        }
    }

    pub fn push(
        &mut self,
        run: &ObservedRun,
        smooth: &Smoothed,
        k: usize,
        lag: usize,
        reversal: &[f64],
    ) {
        let mut all = Vec::with_capacity(self.names.len());
        for (c, since) in reversal.iter().enumerate() {
            all.extend([
                smooth.q[c][k],
                smooth.v[c][k],
                smooth.a[c][k],
                run.t[k] - since,
            ]);
        }
        for &c in &self.pairs {
            all.extend([&smooth.q, &smooth.v].map(|columns| columns[c + 1][k] - columns[c][k]));
        }
        for u in &run.u {
            all.extend([u[k], u[k] - u[k.saturating_sub(lag)]]);
        }
        all.push(run.t[k]);
        for (column, value) in self.values.iter_mut().zip(all) {
            column.push(value);
        }
    }

    /// Adjusted correlation ratio η² = 1 − [RSS/(n − B)] / [TSS/(n − 1)] of each signal over B quantile bins, largest first. The
    /// acceleration shares its noise with the force and is left out for its own coordinate.
    pub fn explain(&self, coordinate: usize, force: &[f64]) -> Vec<(usize, f64)> {
        let clipped = clipped(force);
        if clipped.len() < 4 * BINS {
            return vec![(0, 0.0)];
        }
        let mut shares: Vec<(usize, f64)> = (0..self.names.len())
            .filter(|&s| s != 4 * coordinate + 2)
            .map(|s| (s, explained_by(&clipped, &[&self.values[s]], BINS)))
            .collect();
        // What follows two coordinates has to explain more than what follows one.
        let first = 4 * self.coordinates;
        let relative = first..first + 2 * self.pairs.len();
        let merit = |&(s, share): &(usize, f64)| match relative.contains(&s) {
            true => share - TIED,
            false => share,
        };
        shares.sort_by(|a, b| merit(b).total_cmp(&merit(a)));
        shares
    }

    /// The ratio for q and sign v of a coordinate together: half of the bins for either direction of motion, about.
    pub fn by_position_and_direction(&self, coordinate: usize, force: &[f64]) -> f64 {
        if force.len() < 4 * BINS {
            return 0.0;
        }
        let (q, v) = (
            &self.values[4 * coordinate],
            &self.values[4 * coordinate + 1],
        );
        let lowest = q.iter().copied().fold(f64::INFINITY, f64::min);
        // One number in the order of both: positions of motion backward lie below all of those forward.
        let both: Vec<f64> = q
            .iter()
            .zip(v)
            .map(|(q, v)| match *v < 0.0 {
                true => lowest - q - f64::MIN_POSITIVE,
                false => q - lowest,
            })
            .collect();
        explained_by(&clipped(force), &[&both], BINS)
    }

    /// The mean force along the signals that explain most of it, and along the position for either direction of motion.
    pub fn profiles(
        &self,
        coordinate: usize,
        explained: &[(usize, f64)],
        force: &[f64],
    ) -> Vec<Profile> {
        let velocity = &self.values[4 * coordinate + 1];
        let profile = |s: usize, way: &str, keep: &dyn Fn(f64) -> bool| {
            let taken = (0..force.len()).filter(|&i| keep(velocity[i]));
            let taken = taken.map(|i| (self.values[s][i], force[i]));
            let (values, force): (Vec<f64>, Vec<f64>) = taken.unzip();
            let enough = values.len() >= 4 * BINS;
            let (ranges, force) = along(&values, &force, BINS).into_iter().unzip();
            enough.then(|| Profile {
                signal: format!("{}{way}", self.names[s].0),
                unit: self.names[s].1.clone(),
                ranges,
                force,
            })
        };
        let single = explained.iter().take(PROFILES);
        single
            .filter_map(|e| profile(e.0, "", &|_| true))
            .chain(profile(4 * coordinate, ", moving up", &|v| v > 0.0))
            .chain(profile(4 * coordinate, ", moving down", &|v| v < 0.0))
            .collect()
    }

    pub fn words(&self, (best, share): (usize, f64), together: f64, force: &[f64]) -> String {
        let n = force.len().max(1) as f64;
        let mean = force.iter().sum::<f64>() / n;
        let rms = (force.iter().map(|f| f * f).sum::<f64>() / n).sqrt();
        if share < TIED && together < TIED + WORTH_A_WORD {
            return if mean.abs() > 0.5 * rms {
                "everywhere alike: a constant".to_owned()
            } else {
                "not tied to any one signal".to_owned()
            };
        }
        let also = match together > share + WORTH_A_WORD {
            true => format!(
                "; its own position and direction of motion together explain {:.0} %",
                100.0 * together
            ),
            false => String::new(),
        };
        format!(
            "follows the {} ({:.0} % of its variance){also}",
            self.names[best].0,
            100.0 * share
        )
    }
}

/// The force without its extremes: those further than four standard deviations, by the median deviation, from the median.
pub fn clipped(force: &[f64]) -> Vec<f64> {
    let mut sorted = force.to_vec();
    let middle = median(&mut sorted);
    let mut away: Vec<f64> = force.iter().map(|f| (f - middle).abs()).collect();
    let limit = 4.0 * 1.4826 * median(&mut away);
    force
        .iter()
        .map(|f| f.clamp(middle - limit, middle + limit))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::panic)]

    use super::*;

    #[test]
    fn a_force_that_changes_with_position_and_direction_is_explained_by_both_together() {
        let angles = (0..3000).map(|k| 0.037 * f64::from(k));
        let (q, v): (Vec<f64>, Vec<f64>) = angles.map(|a| (a.sin(), a.cos())).unzip();
        let signals = Signals {
            names: ["position of x", "velocity of x", "acceleration of x"]
                .map(|name| (name.to_owned(), String::new()))
                .to_vec(),
            values: vec![q.clone(), v.clone(), vec![0.0; q.len()]],
            pairs: Vec::new(),
            coordinates: 1,
        };
        let force: Vec<f64> = q.iter().zip(&v).map(|(q, v)| q * v.signum()).collect();
        let best = signals.explain(0, &force)[0];
        let together = signals.by_position_and_direction(0, &force);
        assert!(best.1 < 0.2 && together > 0.9, "{best:?} {together}");
        let words = signals.words(best, together, &force);
        assert!(words.contains("position and direction"), "{words}");
        let profiles = signals.profiles(0, &[best], &force);
        let [_, up, down] = profiles.as_slice() else {
            panic!("{profiles:?}")
        };
        assert!(up.force[0] < -0.9 && up.force[11] > 0.9, "{up:?}");
        assert!(down.force[0] > 0.9 && down.force[11] < -0.9, "{down:?}");
    }
}
