//! Probabilities by the bootstrap over windows.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Number of bootstraps.
pub const DRAWS: usize = 400;

/// In what share of bootstraps over windows each contender has the best score. Each is given by its score per window and the
/// penalty for its constants. One that diverges in a drawn window cannot win that draw.
pub fn wins(contenders: &[(&[f64], f64)], seed: u64) -> Vec<f64> {
    let windows = contenders.first().map_or(0, |c| c.0.len());
    if windows == 0 {
        return vec![0.0; contenders.len()];
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut won = vec![0_usize; contenders.len()];
    let mut drawn = vec![0_usize; windows];
    for _ in 0..DRAWS {
        drawn
            .iter_mut()
            .for_each(|k| *k = rng.random_range(0..windows));
        let score = |(scores, penalty): &(&[f64], f64)| {
            drawn.iter().map(|&k| scores[k]).sum::<f64>() - penalty
        };
        let best = contenders
            .iter()
            .enumerate()
            .map(|(i, c)| (i, score(c)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((i, score)) = best
            && score.is_finite()
        {
            won[i] += 1;
        }
    }
    won.into_iter().map(|w| w as f64 / DRAWS as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_contenders_share_and_a_clear_one_takes_all() {
        let a: Vec<f64> = (0..50).map(|k| (k as f64).sin()).collect();
        let b: Vec<f64> = (0..50).map(|k| (k as f64 + 3.3).sin()).collect();
        let shares = wins(&[(&a, 0.0), (&b, 0.0)], 1);
        assert!(shares[0] > 0.2 && shares[1] > 0.2, "{shares:?}");
        let better: Vec<f64> = a.iter().map(|x| x + 3.0).collect();
        assert_eq!(wins(&[(&a, 0.0), (&better, 0.0)], 1), vec![0.0, 1.0]);
        assert_eq!(
            wins(&[(&a, 0.0), (&b, 0.0)], 7),
            wins(&[(&a, 0.0), (&b, 0.0)], 7)
        );
    }
}
