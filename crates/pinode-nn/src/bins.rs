//! What signals explain of a force, over quantile bins of theirs.

/// For each sample the quantile bin of a signal, of `bins`. Samples where it has one value are in one bin, that of the middle one: it does not tell
/// them apart.
pub fn binned(values: &[f64], bins: usize) -> Vec<usize> {
    let n = values.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut bin = vec![0; n];
    let mut first = 0;
    for same in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let middle = first + same.len() / 2;
        same.iter().for_each(|&k| bin[k] = middle * bins / n.max(1));
        first += same.len();
    }
    bin
}

/// Range of a signal in each of its quantile bins and the mean of what goes with it there; bins that a value of many samples leaves empty are left out.
pub fn along(signal: &[f64], of: &[f64], bins: usize) -> Vec<([f64; 2], f64)> {
    let mut all = vec![([f64::INFINITY, f64::NEG_INFINITY], 0.0, 0_usize); bins];
    for ((bin, &x), &y) in binned(signal, bins).into_iter().zip(signal).zip(of) {
        let (range, sum, n) = &mut all[bin];
        *range = [range[0].min(x), range[1].max(x)];
        *sum += y;
        *n += 1;
    }
    let used = all.into_iter().filter(|(_, _, n)| *n > 0);
    used.map(|(range, sum, n)| (range, sum / n as f64))
        .collect()
}

/// Mean of `force` in the cells of the signals' bins; cells with one sample have none. The number of cells that are used comes with it.
pub fn cell_means(force: &[f64], signals: &[&[f64]], bins: usize) -> (Vec<Option<f64>>, usize) {
    let mut cell = vec![0_usize; force.len()];
    for values in signals {
        for (cell, bin) in cell.iter_mut().zip(binned(values, bins)) {
            *cell = *cell * bins + bin;
        }
    }
    let cells = bins.pow(signals.len() as u32);
    let mut sums = vec![(0.0, 0_usize); cells];
    for (&cell, f) in cell.iter().zip(force) {
        sums[cell].0 += f;
        sums[cell].1 += 1;
    }
    let used = sums.iter().filter(|s| s.1 > 1).count();
    let mean = |&cell: &usize| {
        let (sum, n) = sums[cell];
        (n > 1).then(|| sum / n as f64)
    };
    (cell.iter().map(mean).collect(), used)
}

/// Adjusted share of the variance that bins of these signals explain together.
pub fn explained_by(force: &[f64], signals: &[&[f64]], bins: usize) -> f64 {
    let (means, cells) = cell_means(force, signals, bins);
    let there: Vec<(f64, f64)> = force
        .iter()
        .zip(&means)
        .filter_map(|(&f, mean)| Some((f, (*mean)?)))
        .collect();
    let n = there.len();
    if n <= cells + 1 {
        return 0.0;
    }
    let mean = there.iter().map(|p| p.0).sum::<f64>() / n as f64;
    let total: f64 = there.iter().map(|p| (p.0 - mean).powi(2)).sum();
    let rest: f64 = there.iter().map(|p| (p.0 - p.1).powi(2)).sum();
    let ratio = (rest / (n - cells) as f64) / (total / (n - 1) as f64).max(1e-300);
    (1.0 - ratio).max(0.0)
}

/// Numbers between −1 and 1 without an order, for tests.
#[cfg(test)]
pub(crate) fn pseudo(k: usize, salt: f64) -> f64 {
    let x = ((k as f64 + salt) * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_that_says_nothing_explains_nothing_however_many_bins_there_are() {
        let force: Vec<f64> = (0..2000).map(|k| pseudo(k, 0.1)).collect();
        let (a, b): (Vec<f64>, Vec<f64>) =
            (0..2000).map(|k| (pseudo(k, 0.5), pseudo(k, 0.7))).unzip();
        assert!(explained_by(&force, &[&a], 12) < 0.02);
        assert!(explained_by(&force, &[&a, &b], 8) < 0.04);
        let product: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a * b).collect();
        assert!(explained_by(&product, &[&a], 12) < 0.1);
        assert!(explained_by(&product, &[&a, &b], 8) > 0.8);
    }

    #[test]
    fn a_signal_with_one_value_tells_nothing_apart_and_one_with_two_tells_two() {
        let force: Vec<f64> = (0..1200).map(|k| f64::from(k / 400)).collect();
        assert_eq!(binned(&[3.0; 1200], 12), [6; 1200]);
        assert_eq!(explained_by(&force, &[&[3.0; 1200]], 12), 0.0);
        // Also one that has one of them nearly always.
        for zeros in [60, 400, 1140] {
            let two: Vec<f64> = (0..1200).map(|k| f64::from(u8::from(k >= zeros))).collect();
            assert!(explained_by(&two, &[&two], 12) > 0.99, "{zeros}");
        }
    }

    #[test]
    fn the_mean_along_a_signal_has_no_place_for_bins_without_samples() {
        let signal: Vec<f64> = (0..1200).map(|k| f64::from(k.max(900))).collect();
        let of: Vec<f64> = signal.iter().map(|x| 2.0 * x).collect();
        let along = along(&signal, &of, 12);
        assert_eq!(along.len(), 4);
        assert_eq!(along[0].0, [900.0; 2]);
        assert!(
            along
                .iter()
                .all(|(range, mean)| (mean - range[0] - range[1]).abs() < 1e-9)
        );
    }
}
