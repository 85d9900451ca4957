//! A calibrated band about the roll-outs of an ensemble: what is measured is within it 95 times of a hundred.
//!
//! The members of an ensemble share data, model and training, and what is wrong with these is wrong with all: they are apart by less than they are wrong.
//! How much less, free runs over recordings tell that no member has learnt from. With s the standard deviation of the members at a sample, t the time
//! since the run began and e what is simulated less what is measured,
//!
//! |e| ≤ √((k s)² + f² + (g t)²)
//!
//! in 95 of 100 samples: k says by how much the members are too close together, f holds the noise of the sensor and g what the state at the beginning and
//! what is common to all members add with time. The three come from the likelihood of normal errors e of that variance, and are scaled together so that
//! 95 % of the |e| at hand are within. Few windows know that badly: with n that share no sample the band is wider by what a prediction from n normal
//! numbers is, √(1 + 1/n) t/z, the quantiles of Student's distribution with n degrees of freedom and of the normal one. It holds for recordings like those
//! that it was found from, for states at the beginning as well known as there, and as far as it was tried: [`Band::horizon`].

use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

use crate::Error;
use crate::evaluate::{Channel, Deviation, Options, deviations};
use crate::free_run::Initial;
use crate::log::{Log, Run};
use crate::model::Model;
use crate::past::known_from;

/// The share of samples that a band holds.
pub const COVERAGE: f64 = 0.95;
/// If more than this share of the windows diverge, no band holds [`COVERAGE`] of them.
const MOST_DIVERGED: f64 = 0.05;
/// Iterations of the likelihood's maximum, and the relative spread of its simplex that ends them.
const ITERATIONS: u64 = 400;
const SETTLED: f64 = 1e-9;
/// A part of the variance is taken for at least this one of the squared errors.
const LEAST_PART: f64 = 1e-12;

/// Half-widths of the signals of a model with an ensemble.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Length of the free runs that it was found from, s.
    pub horizon: f64,
    /// So many of them share no sample.
    pub windows: usize,
    /// One a signal that was measured.
    pub signals: Vec<Width>,
}

/// The half-width of one signal: √((k s)² + f² + (g t)²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Width {
    /// Index of the coordinate.
    pub coordinate: usize,
    /// Whether it is its velocity.
    pub velocity: bool,
    /// k: times the members' standard deviation.
    pub spread: f64,
    /// f, in the signal's unit.
    pub floor: f64,
    /// g, in that unit a second.
    pub growth: f64,
}

impl Width {
    /// The half-width where the members have the standard deviation `spread`, `since` seconds after the run began.
    ///
    /// ```
    /// use pinode_nn::band::Width;
    ///
    /// let width = Width { coordinate: 0, velocity: false, spread: 2.0, floor: 3.0, growth: 10.0 };
    /// assert_eq!(width.half(2.0, 0.0), 5.0);
    /// assert_eq!(width.half(0.0, 0.4), 5.0);
    /// ```
    pub fn half(&self, spread: f64, since: f64) -> f64 {
        (self.spread * spread)
            .hypot(self.floor)
            .hypot(self.growth * since)
    }
}

impl Band {
    pub(crate) fn of(&self, channel: Channel) -> Option<&Width> {
        let Channel {
            coordinate,
            velocity,
        } = channel;
        let is_it = |w: &&Width| w.coordinate == coordinate && w.velocity == velocity;
        self.signals.iter().find(is_it)
    }
}

/// The band of a model with an ensemble, from free runs over logs that no member has learnt from. That of the model itself, if it has one, is not looked
/// at. With [`Initial::Past`] none begins where too little is measured before it.
///
/// # Errors
/// [`Error::NoEnsemble`]; [`Error::NoWindow`] when no recording is long enough; [`Error::Unfittable`] when more than one window of twenty diverges, or
/// a member of the ensemble does in it; [`Error::NoBand`]; [`Error::Floating`] and [`Error::OtherModel`] as
/// [`evaluate`](crate::evaluate::evaluate).
pub fn calibrate(model: &Model, logs: &[Log], options: &Options) -> Result<Band, Error> {
    calibrate_from(model, logs, options, |run| match options.initial {
        Initial::Past => known_from(run),
        Initial::Measured | Initial::Estimated => 0,
    })
}

/// The same from windows of which none begins before the `earliest` sample of its recording.
pub(crate) fn calibrate_from(
    model: &Model,
    logs: &[Log],
    options: &Options,
    earliest: impl Fn(&Run) -> usize,
) -> Result<Band, Error> {
    let found = deviations(model, logs, options, earliest)?;
    let windows = found.arrived + found.diverged;
    if found.diverged as f64 > MOST_DIVERGED * windows as f64 {
        return Err(Error::Unfittable {
            diverged: found.diverged,
            windows,
        });
    }
    let width = |(channel, list): &(Channel, Vec<Deviation>)| {
        let parts = parts(list, found.apart);
        if parts.iter().any(|part| !part.is_finite()) {
            return Err(Error::NoBand {
                signal: channel.name(model),
            });
        }
        let [spread, floor, growth] = parts.map(rounded);
        Ok(Width {
            coordinate: channel.coordinate,
            velocity: channel.velocity,
            spread,
            floor,
            growth,
        })
    };
    Ok(Band {
        horizon: options.horizon,
        windows: found.apart,
        signals: found
            .of_channels
            .iter()
            .map(width)
            .collect::<Result<_, _>>()?,
    })
}

/// k, f and g of a signal, from its samples in windows of which so many share no sample; no numbers where the squares of errors are beyond their range.
fn parts(samples: &[Deviation], windows: usize) -> [f64; 3] {
    let n = samples.len() as f64;
    let mean = |of: fn(&Deviation) -> f64| samples.iter().map(of).sum::<f64>() / n;
    let errors = mean(|d| d.error.powi(2));
    let scales = [mean(|d| d.spread.powi(2)), 1.0, mean(|d| d.since.powi(2))];
    if errors == 0.0 || !errors.is_finite() {
        return [errors; 3];
    }
    let likelihood = Likelihood {
        samples,
        errors,
        scales,
    };
    let third = (1.0_f64 / 3.0).ln();
    let corner = |moved: usize| {
        let entry = |k: usize| if k == moved { third - 1.5 } else { third };
        (0..3).map(entry).collect::<Vec<f64>>()
    };
    let simplex: Vec<Vec<f64>> = (0..4).map(corner).collect();
    let first = simplex[3].clone();
    // What it cannot improve on is what it begins with.
    let best = NelderMead::new(simplex)
        .with_sd_tolerance(SETTLED)
        .and_then(|solver| {
            Executor::new(Objective(&likelihood), solver)
                .configure(|state| state.max_iters(ITERATIONS))
                .run()
        })
        .ok()
        .and_then(|mut result| result.state.take_best_param());
    let variances = likelihood.variances(&best.unwrap_or(first));
    let far = |d: &Deviation| d.error.abs() / variance(&variances, d).sqrt();
    let mut ratios: Vec<f64> = samples.iter().map(far).collect();
    ratios.sort_by(f64::total_cmp);
    let rank = ((COVERAGE * n).ceil() as usize).clamp(1, ratios.len());
    let scale = wider(windows) * ratios.get(rank - 1).copied().unwrap_or(0.0);
    variances.map(|part| scale * part.sqrt())
}

/// How much wider a band from so many windows is: √(1 + 1/n) t/z.
fn wider(windows: usize) -> f64 {
    let n = windows.max(1) as f64;
    let upper = 0.5 + 0.5 * COVERAGE;
    // One degree of freedom or more is what the distribution asks for.
    let t = StudentsT::new(0.0, 1.0, n).map(|student| student.inverse_cdf(upper));
    let z = Normal::standard().inverse_cdf(upper);
    t.map_or(1.0, |t| (1.0 + 1.0 / n).sqrt() * t / z)
}

/// The variance k² s² + f² + g² t² of an error.
fn variance([spread, floor, growth]: &[f64; 3], d: &Deviation) -> f64 {
    spread * d.spread.powi(2) + floor + growth * d.since.powi(2)
}

/// Normal errors whose variance has three parts, each told by the logarithm of its share of the mean square of the errors.
struct Likelihood<'a> {
    samples: &'a [Deviation],
    /// Mean square of the errors.
    errors: f64,
    /// Mean squares of what the parts go with.
    scales: [f64; 3],
}

impl Likelihood<'_> {
    /// k², f² and g².
    fn variances(&self, shares: &[f64]) -> [f64; 3] {
        let part = |k: usize| match self.scales[k] > 0.0 {
            true => self.errors * shares.get(k).map_or(0.0, |x| x.exp()) / self.scales[k],
            false => 0.0,
        };
        let mut variances = [part(0), part(1), part(2)];
        variances[1] = variances[1].max(LEAST_PART * self.errors);
        variances
    }

    /// Twice the negative logarithm of the likelihood a sample.
    fn cost(&self, shares: &[f64]) -> f64 {
        let variances = self.variances(shares);
        let of = |d: &Deviation| {
            let v = variance(&variances, d);
            v.ln() + d.error.powi(2) / v
        };
        self.samples.iter().map(of).sum::<f64>() / self.samples.len() as f64
    }
}

struct Objective<'a>(&'a Likelihood<'a>);

impl CostFunction for Objective<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, shares: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        Ok(self.0.cost(shares))
    }
}

/// With four digits, rounded up in the last: what a file shows is what it means.
fn rounded(x: f64) -> f64 {
    if x == 0.0 {
        return 0.0;
    }
    let digit = 10.0_f64.powi(x.log10().floor() as i32 - 3);
    let text = format!("{:.3e}", (x / digit).ceil() * digit);
    text.parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    /// Errors of k s, f and g t, each independent, in windows of twenty samples.
    fn samples(seed: u64, windows: usize, [k, f, g]: [f64; 3]) -> Vec<Deviation> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut list = Vec::new();
        for _ in 0..windows {
            let apart = 0.02 * (1.0 + normal(&mut rng).abs());
            for sample in 1..=20 {
                let since = 0.03 * f64::from(sample);
                let spread = apart * since;
                let mut part = |size: f64| size * normal(&mut rng);
                let error = part(k * spread) + part(f) + part(g * since);
                list.push(Deviation {
                    since,
                    spread,
                    error,
                });
            }
        }
        list
    }

    fn coverage([spread, floor, growth]: [f64; 3], samples: &[Deviation]) -> f64 {
        let width = Width {
            coordinate: 0,
            velocity: false,
            spread,
            floor,
            growth,
        };
        let within = |d: &&Deviation| d.error.abs() <= width.half(d.spread, d.since);
        samples.iter().filter(within).count() as f64 / samples.len() as f64
    }

    #[test]
    fn a_band_holds_what_it_says_on_samples_it_has_not_seen_early_and_late() {
        for truth in [[3.0, 1e-3, 0.0], [1.0, 4e-3, 0.01], [0.0, 2e-3, 0.03]] {
            let found = parts(&samples(1, 400, truth), 400);
            let fresh = samples(2, 2000, truth);
            let (early, late): (Vec<Deviation>, Vec<Deviation>) =
                fresh.iter().partition(|d| d.since < 0.3);
            for (when, part) in [("all", &fresh), ("early", &early), ("late", &late)] {
                let share = coverage(found, part);
                assert!(
                    (share - COVERAGE).abs() < 0.012,
                    "{when} {share} by {found:?} of {truth:?}"
                );
            }
        }
    }

    #[test]
    fn the_members_factor_is_found_beside_noise_and_growth() {
        let truth = [3.0, 5e-3, 0.08];
        let found = parts(&samples(3, 3000, truth), 3000);
        // 1.96 standard deviations hold 95 %.
        for (found, truth) in found.iter().zip(truth) {
            assert!(
                (found / (1.96 * truth) - 1.0).abs() < 0.1,
                "{found} {truth}"
            );
        }
    }

    /// Quantiles of Student's distribution from tables: 2.228 for 10, 12.706 for 1.
    #[test]
    fn few_windows_make_a_wider_band() {
        for (windows, t) in [(1, 12.706), (10, 2.228), (1000, 1.962)] {
            let n = f64::from(windows);
            let expected = (1.0 + 1.0 / n).sqrt() * t / 1.95996;
            assert!((wider(windows as usize) / expected - 1.0).abs() < 1e-3);
        }
        // Of bands from ten windows each, the mean holds what it says: with too little in some and more in others.
        let truth = [2.0, 1e-3, 1e-2];
        let fresh = samples(6, 500, truth);
        let of = |seed: u64| coverage(parts(&samples(100 + seed, 10, truth), 10), &fresh);
        let mean = (0..40).map(of).sum::<f64>() / 40.0;
        assert!((COVERAGE..0.985).contains(&mean), "{mean}");
    }

    #[test]
    fn members_that_agree_and_errors_of_nothing_have_bands_too() {
        let agreeing = samples(5, 200, [0.0, 1e-3, 0.0]);
        let agreeing: Vec<Deviation> = agreeing
            .iter()
            .map(|d| Deviation { spread: 0.0, ..*d })
            .collect();
        let [spread, floor, _] = parts(&agreeing, 200);
        assert_eq!(spread, 0.0);
        assert!((floor / 1.96e-3 - 1.0).abs() < 0.1, "{floor}");
        let none: Vec<Deviation> = agreeing
            .iter()
            .map(|d| Deviation { error: 0.0, ..*d })
            .collect();
        assert_eq!(parts(&none, 200), [0.0; 3]);
    }

    #[test]
    fn errors_beyond_the_range_of_numbers_have_no_band() {
        let mut all = samples(7, 20, [1.0, 1e-3, 0.0]);
        all[3].error = 1e200;
        assert!(parts(&all, 20).iter().all(|part| !part.is_finite()));
    }

    #[test]
    fn numbers_are_rounded_up_to_four_digits() {
        let found = [0.123_41, 1234.0, 1.000_01e-5, 0.0].map(rounded);
        assert_eq!(found, [0.1235, 1234.0, 1.001e-5, 0.0]);
    }
}
