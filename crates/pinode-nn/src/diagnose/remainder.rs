//! Whether what a fitted model leaves follows from anything: any law at all of the present or of the past, known to the library or not.
//!
//! Sensor noise and short pushes from outside follow from nothing; a law that is missing follows from where the joint is, how it moves, what
//! drives it, or what all this was a moment ago. A general force on a joint, f = Σ c_k φ_k with c in N or N·m and φ without a unit, is a column
//! for each φ_k in the linearisation of the windows. With S and g the information and score of a window, n its free constants and c its
//! columns, and N = S_nn⁻¹ S_nc of all windows, the tolerances in S_nn, what the free constants cannot imitate is
//!
//! e = g_c − Nᵀ g_n,  D = S_cc − Nᵀ S_nc − S_cn N + Nᵀ S_nn N,  c = (Σ D)⁻¹ Σ e.
//!
//! The coefficients c of a window are those of four fifths of the windows, it not among them, and count by what they explain of it:
//! c·e − ½ cᵀ D c nats.
//!
//! φ is taken along the fitted roll-out, not along what was measured: a signal that shares its noise with the residuals explains them always.

use lagrange::Coordinate;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::linear::{AtWindow, Linearisation};
use super::score::{paired, samples_per_window};
use super::shapes::{Follows, Shape, shapes};
use super::study::{Fitted, Study};

/// The windows are set aside in so many parts, one after the other.
const FOLDS: usize = 5;
/// Share of a column's information that is added to it: columns that look alike share what they explain.
const RIDGE: f64 = 1e-3;
/// A column of which the free constants leave less than this share counts as one that they span.
const SPANNED: f64 = 1e-8;
/// A law is there when it explains so many nats a sample of what it was not fitted to, and so many standard errors.
const SIGNIFICANT: (f64, f64) = (0.05, 4.0);
/// From so much on it is worth a search, where nothing was found before and where something was.
const HINT: [(f64, f64); 2] = [(0.02, 1.0), (0.05, 2.0)];
/// A law of the present is one of the past as well: it is taken for the past's only where that explains so many times what the present does. The same of one on a
/// coordinate and one between two.
const OF_PAST: f64 = 1.3;
/// What the input explains is the input's where it is so many times what the motion explains, which follows the input.
const OF_INPUT: f64 = 1.3;

/// A general force that explains what is left.
#[derive(Debug, Clone, PartialEq)]
pub struct Remainder {
    /// The coordinate it acts on.
    pub coordinate: usize,
    /// What it follows.
    pub follows: Follows,
    /// What it explains of windows it was not fitted to, nats.
    pub gain: f64,
    /// The same a sample.
    pub gain_per_sample: f64,
    /// The same over its standard error.
    pub z: f64,
    /// What the best law of where a joint is and how it moves or moved explains, nats.
    pub by_motion: f64,
}

impl Remainder {
    /// What it follows, in words.
    pub fn words(&self, coordinates: &[Coordinate]) -> String {
        let name = |c: usize| coordinates.get(c).map_or("", |c| c.name.as_str());
        let own = self.coordinate;
        self.follows.words(name(own), name(own + 1))
    }

    /// Whether it is there beyond doubt.
    pub fn is_significant(&self) -> bool {
        self.exceeds(SIGNIFICANT)
    }

    /// Whether it is worth a search, which counts by itself what it finds, the `first` one or one beside what was found.
    pub fn is_hint(&self, first: bool) -> bool {
        self.exceeds(HINT[usize::from(!first)])
    }

    fn exceeds(&self, (gain_per_sample, z): (f64, f64)) -> bool {
        self.gain_per_sample > gain_per_sample && self.z > z
    }

    /// Whether friction of any sort may be what is missing: that knows of the input only by what it moves.
    pub fn may_be_friction(&self) -> bool {
        !self.follows.is_of_input() || self.gain < OF_INPUT * self.by_motion
    }
}

/// The general force that explains most of what `fitted` leaves in the seen windows; one that is there beyond doubt before all
/// others. `None` where not even a hint is.
pub fn remainder(study: &Study, fitted: &Fitted) -> Option<Remainder> {
    let groups = shapes(study, fitted);
    let samples = samples_per_window(&fitted.inside);
    let mut explained: Vec<Remainder> = efficient(study, fitted, &groups)
        .into_iter()
        .zip(&groups)
        .map(|(windows, shape)| {
            let gains = gains(&windows);
            let found = paired(&gains, &vec![0.0; gains.len()]);
            Remainder {
                coordinate: shape.coordinate,
                follows: shape.follows,
                gain: found.gain,
                gain_per_sample: found.gain / (found.windows.max(1) as f64 * samples),
                z: found.z,
                by_motion: 0.0,
            }
        })
        .collect();
    let by_motion = explained.iter().filter(|r| !r.follows.is_of_input());
    let by_motion = by_motion.map(|r| r.gain).fold(0.0, f64::max);
    // What is there beyond doubt hides what is not, and a hint what is none.
    let counts: [fn(&Remainder) -> bool; 3] = [
        Remainder::is_significant,
        |left| left.is_hint(false),
        |left| left.is_hint(true),
    ];
    let counts = counts
        .into_iter()
        .find(|counts| explained.iter().any(counts))?;
    explained.retain(counts);
    // A force between two coordinates does what one on either of them does.
    let alone = explained.iter().filter(|r| !r.follows.is_between());
    let alone = alone.map(|r| r.gain).fold(0.0, f64::max);
    explained.retain(|r| !r.follows.is_between() || r.gain > OF_PAST * alone);
    let best_of = |past: bool| {
        let some = explained.iter().filter(|r| r.follows.is_past() == past);
        some.max_by(|a, b| a.gain.total_cmp(&b.gain))
    };
    let found = match (best_of(false), best_of(true)) {
        (Some(present), Some(past)) if past.gain < OF_PAST * present.gain => present,
        (present, past) => past.or(present)?,
    };
    Some(Remainder {
        by_motion,
        ..found.clone()
    })
}

/// D and e of every window, of each group.
fn efficient(
    study: &Study,
    fitted: &Fitted,
    groups: &[Shape],
) -> Vec<Vec<(DMatrix<f64>, DVector<f64>)>> {
    let linear = Linearisation::new(study, fitted);
    let columns: usize = groups.iter().map(Shape::columns).sum();
    let changes = |at: &AtWindow| -> Vec<Vec<f64>> {
        let forces: Vec<(usize, Vec<f64>)> = groups
            .iter()
            .flat_map(|group| group.along(study, fitted, at))
            .collect();
        let mut changes = Vec::with_capacity(columns);
        for eight in forces.chunks(lagrange::LANES) {
            let mut under = vec![Vec::new(); eight.len()];
            at.steps
                .under_given(at.states, at.inputs, eight, &mut under);
            changes.extend(under.iter().map(|states| {
                let change = linear.change(at, (&fitted.hybrid, linear.readings()), states);
                match change.iter().all(|x| x.is_finite()) {
                    true => change,
                    false => vec![0.0; change.len()],
                }
            }));
        }
        changes
    };
    let n = fitted.inside.free.len();
    let mut total = DMatrix::zeros(n + columns, n + columns);
    // Of every window what one group needs of it: the matrices of all together would fill the memory.
    let mut own: Vec<Vec<[DMatrix<f64>; 2]>> = vec![Vec::new(); groups.len()];
    let mut shared: Vec<(DMatrix<f64>, DVector<f64>)> = Vec::new();
    linear.each_window(columns, changes, |s, g| {
        let mut place = n;
        for (group, own) in groups.iter().zip(&mut own) {
            let k = group.columns();
            let block = |row: usize, rows: usize| s.view((row, place), (rows, k)).into_owned();
            own.push([block(0, n), block(place, k)]);
            place += k;
        }
        shared.push((s.view((0, 0), (n, n)).into_owned(), g));
        total += s;
    });
    let by_nuisance = linear.by_nuisance(&total);
    let mut place = 0;
    let of_group = |(group, own): (&Shape, Vec<[DMatrix<f64>; 2]>)| {
        let k = group.columns();
        let follow = by_nuisance.columns(place, k);
        let windows = own
            .into_iter()
            .zip(&shared)
            .map(|([s_nc, s_cc], (s_nn, g))| {
                let cross = follow.transpose() * s_nc;
                let alone = s_cc.diagonal();
                let mut d = s_cc - &cross - cross.transpose() + follow.transpose() * s_nn * follow;
                for (i, alone) in alone.iter().enumerate() {
                    d[(i, i)] = d[(i, i)].max(SPANNED * alone);
                }
                let e = g.rows(n + place, k) - follow.transpose() * g.rows(0, n);
                (d, e)
            });
        let windows = windows.collect();
        place += k;
        windows
    };
    groups.iter().zip(own).map(of_group).collect()
}

/// What the coefficients of the other windows explain of each, nats.
fn gains(windows: &[(DMatrix<f64>, DVector<f64>)]) -> Vec<f64> {
    let Some((first, _)) = windows.first() else {
        return Vec::new();
    };
    let k = first.nrows();
    let mut gains = vec![0.0; windows.len()];
    let fold_of = |index: usize| index * FOLDS / windows.len();
    for fold in 0..FOLDS {
        let (mut d, mut b) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for (index, (own, e)) in windows.iter().enumerate() {
            if fold_of(index) != fold {
                d += own;
                b += e;
            }
        }
        // In units of each column's information.
        let scale = DVector::from_fn(k, |i, _| d[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let unit = DMatrix::from_fn(k, k, |i, j| {
            d[(i, j)] / (scale[i] * scale[j]) + if i == j { RIDGE } else { 0.0 }
        });
        let Some(factor) = Cholesky::new(unit) else {
            continue;
        };
        let c = factor.solve(&b.component_div(&scale)).component_div(&scale);
        for (index, (own, e)) in windows.iter().enumerate() {
            if fold_of(index) == fold {
                gains[index] = c.dot(e) - 0.5 * c.dot(&(own * &c));
            }
        }
    }
    gains
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;

    /// Scores e = D c + noise of the size that D says.
    fn windows(c: [f64; 2]) -> Vec<(DMatrix<f64>, DVector<f64>)> {
        (0..80)
            .map(|w| {
                let d = DMatrix::<f64>::from_row_slice(2, 2, &[9.0, 2.0, 2.0, 4.0]);
                let noise = DVector::from_fn(2, |i, _| {
                    // A uniform number in [−√3, √3] has the variance 1.
                    let unit = 3.0_f64.sqrt() * pseudo(w, 0.4 + i as f64);
                    f64::sqrt(d[(i, i)]) * unit
                });
                let e = &d * DVector::from_row_slice(&c) + noise;
                (d, e)
            })
            .collect()
    }

    #[test]
    fn a_law_explains_windows_it_was_not_fitted_to_by_half_its_information_and_noise_by_nothing() {
        let c = [1.2, -0.8];
        let sum: f64 = gains(&windows(c)).iter().sum();
        let d = &windows(c)[0].0;
        let c = DVector::from_row_slice(&c);
        let expected = 80.0 * 0.5 * c.dot(&(d * &c));
        assert!((sum / expected - 1.0).abs() < 0.15, "{sum} for {expected}");
        let none: f64 = gains(&windows([0.0; 2])).iter().sum();
        assert!(none < 0.01 * expected, "{none}");
    }
}
