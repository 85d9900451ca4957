//! How far the members of an ensemble are apart: a band about the roll-out of their mean force.
//!
//! Networks that were trained from different beginnings agree where the data tell the force and differ where they do not (Lakshminarayanan et al. 2017).
//! The spread of their roll-outs from one state is a sign of what is not known, and no more: they share data, model and training, and what is wrong
//! with these is wrong with all. How much more that is a [`band`](crate::band) says.

/// Standard deviations of the states over the members, one row a sample; as many samples as all members have. Each of `members` is a row of
/// states a sample. Fewer than two members are not apart.
///
/// ```
/// use pinode_nn::spread::spread;
///
/// let members = [vec![vec![1.0, 0.0]], vec![vec![3.0, 0.0]]];
/// assert_eq!(spread(&members), [[2.0_f64.sqrt(), 0.0]]);
/// ```
pub fn spread(members: &[Vec<Vec<f64>>]) -> Vec<Vec<f64>> {
    if members.len() < 2 {
        return Vec::new();
    }
    let n = members.len() as f64;
    let samples = members.iter().map(Vec::len).min().unwrap_or(0);
    let of_sample = |k: usize| -> Vec<f64> {
        let states = || members.iter().filter_map(|member| member.get(k));
        let entries = states().map(Vec::len).min().unwrap_or(0);
        let of_entry = |i: usize| {
            let values = || states().filter_map(|state| state.get(i));
            let mean = values().sum::<f64>() / n;
            let squares: f64 = values().map(|x| (x - mean).powi(2)).sum();
            (squares / (n - 1.0)).sqrt()
        };
        (0..entries).map(of_entry).collect()
    };
    (0..samples).map(of_sample).collect()
}

/// Sums of squares of deviations over samples, one an entry of the state.
#[derive(Debug, Clone, Default)]
pub(crate) struct Squares {
    samples: usize,
    sums: Vec<f64>,
}

impl Squares {
    /// Takes one sample.
    pub fn take(&mut self, deviations: &[f64]) {
        self.samples += 1;
        self.sums.resize(self.sums.len().max(deviations.len()), 0.0);
        for (sum, x) in self.sums.iter_mut().zip(deviations) {
            *sum += x * x;
        }
    }

    /// Adds those of other samples.
    pub fn add(&mut self, other: &Squares) {
        self.samples += other.samples;
        self.sums.resize(self.sums.len().max(other.sums.len()), 0.0);
        for (sum, x) in self.sums.iter_mut().zip(&other.sums) {
            *sum += x;
        }
    }

    /// The root of the mean square of an entry; none without a sample.
    pub fn root_mean(&self, entry: usize) -> Option<f64> {
        let sum = self.sums.get(entry)?;
        Some((sum / self.samples as f64).sqrt())
    }
}
