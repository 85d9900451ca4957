//! Orientations between messages.
//!
//! q and −q are one orientation, and what measures it may go from one to the other at any message. On lines between them its parts would pass through 0, where
//! they are none: a quaternion is read between messages as a whole.

use super::series::Series;

/// A quaternion whose parts stand in the same messages.
pub(super) struct Turn {
    /// Its parts, as indices of signals.
    pub signals: [usize; 4],
    /// By which a part is multiplied for the number in its column to become it.
    pub scales: [f64; 4],
}

impl Turn {
    /// The numbers in its columns at `time`, given the series of its parts; none at a message, and before the first and after the last.
    pub(super) fn between(&self, series: [&Series; 4], time: i64) -> Option<[f64; 4]> {
        let (before, share, _) = series[0].around(time)?;
        let at = |message: usize| -> Option<[f64; 4]> {
            let mut parts = [0.0; 4];
            for (part, series) in parts.iter_mut().zip(series) {
                *part = *series.numbers.get(message)?;
            }
            Some(parts)
        };
        Some(between(at(before)?, at(before + 1)?, &self.scales, share))
    }
}

/// On the line from a to the nearer of b and −b, and from there out to the length that lies between theirs: what is no unit quaternion stays none, to be found
/// by its length.
fn between(a: [f64; 4], b: [f64; 4], scales: &[f64; 4], share: f64) -> [f64; 4] {
    let dot = |x: &[f64; 4], y: &[f64; 4]| -> f64 {
        let parts = x.iter().zip(y).zip(scales);
        parts.map(|((x, y), scale)| x * y * scale * scale).sum()
    };
    let length = |x: &[f64; 4]| dot(x, x).sqrt();
    let sign = if dot(&a, &b) < 0.0 { -1.0 } else { 1.0 };
    let chord: [f64; 4] = std::array::from_fn(|i| a[i] + share * (sign * b[i] - a[i]));
    let out = (length(&a) + share * (length(&b) - length(&a))) / length(&chord);
    // Readings of all zeros are none, and lie on lines.
    let out = if out.is_finite() { out } else { 1.0 };
    chord.map(|x| out * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orientation_between_two_is_one_whatever_their_signs() {
        // A turn about z: by 1 rad, then by 2.
        let turned = |angle: f64| [(0.5 * angle).cos(), 0.0, 0.0, (0.5 * angle).sin()];
        let (a, b) = (turned(1.0), turned(2.0));
        for sign in [1.0, -1.0] {
            let middle = between(a, b.map(|x| sign * x), &[1.0; 4], 0.5);
            for (found, expected) in middle.iter().zip(turned(1.5)) {
                assert!((found - expected).abs() < 1e-12, "{middle:?}");
            }
        }
        // In columns of thousandths, one with the other sign.
        let scales = [1e-3, 1e-3, 1e-3, -1e-3];
        let column = |x: [f64; 4]| std::array::from_fn(|i| x[i] / scales[i]);
        let middle = between(column(a), column(b).map(|x: f64| -x), &scales, 0.5);
        for (found, expected) in middle.iter().zip(column(turned(1.5))) {
            assert!((found - expected).abs() < 1e-9, "{middle:?}");
        }
    }

    #[test]
    fn what_is_no_unit_quaternion_does_not_become_one() {
        let twice = between([2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], &[1.0; 4], 0.5);
        let length = twice.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((length - 2.0).abs() < 1e-12, "{twice:?}");
        assert_eq!(between([0.0; 4], [0.0; 4], &[1.0; 4], 0.3), [0.0; 4]);
    }
}
