use super::Space;

/// Orientations of a body as unit quaternions (w, x, y, z); a tangent is a turn in the body's axes, rad.
///
/// ```
/// use integrators::{Rotation, Space};
///
/// let mut turned = [0.0; 4];
/// // A quarter turn about z.
/// Rotation.move_into(&[1.0, 0.0, 0.0, 0.0], &[0.0, 0.0, std::f64::consts::FRAC_PI_2], &mut turned);
/// assert!((turned[0] - 0.5_f64.sqrt()).abs() < 1e-15 && (turned[3] - 0.5_f64.sqrt()).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rotation;

/// a × b.
#[inline]
fn cross(a: &[f64], b: &[f64], out: &mut [f64]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/// a ∘ b.
fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

fn four(x: &[f64]) -> [f64; 4] {
    [x[0], x[1], x[2], x[3]]
}

/// |(x, y, z)|, without overflow.
fn length(x: &[f64]) -> f64 {
    x[0].hypot(x[1]).hypot(x[2])
}

impl Space for Rotation {
    #[inline]
    fn dim(&self) -> usize {
        4
    }
    #[inline]
    fn tangent_dim(&self) -> usize {
        3
    }
    #[inline]
    fn is_flat(&self) -> bool {
        false
    }
    fn move_into(&self, point: &[f64], motion: &[f64], out: &mut [f64]) {
        let angle = length(motion);
        // sin(θ/2)/θ, from its series where the quotient loses digits.
        let part = if angle < 1e-4 {
            0.5 - angle * angle / 48.0
        } else {
            (0.5 * angle).sin() / angle
        };
        let turn = [
            (0.5 * angle).cos(),
            part * motion[0],
            part * motion[1],
            part * motion[2],
        ];
        let moved = product(four(point), turn);
        let size = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
        for (out, x) in out.iter_mut().zip(moved) {
            *out = x / size;
        }
    }
    fn difference_into(&self, from: &[f64], to: &[f64], out: &mut [f64]) {
        let back = [from[0], -from[1], -from[2], -from[3]];
        let turn = product(back, four(to));
        let sine = length(&turn[1..]);
        // The shorter of the two ways round.
        let half = if turn[0] < 0.0 {
            -(sine.atan2(-turn[0]))
        } else {
            sine.atan2(turn[0])
        };
        let part = if sine < 1e-9 {
            2.0 * turn[0].signum()
        } else {
            2.0 * half / sine
        };
        for (out, x) in out.iter_mut().zip(&turn[1..]) {
            *out = part * x;
        }
    }
    #[inline]
    fn bracket_into(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        cross(a, b, out);
    }
    #[inline]
    fn cobracket_into(&self, a: &[f64], m: &[f64], out: &mut [f64]) {
        // m · (a × b) = (m × a) · b
        cross(m, a, out);
    }
    fn distance(&self, point: &[f64]) -> f64 {
        (point.iter().map(|x| x * x).sum::<f64>().sqrt() - 1.0).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_undoes_a_turn_of_any_size() {
        let from = {
            let mut out = [0.0; 4];
            Rotation.move_into(&[1.0, 0.0, 0.0, 0.0], &[0.3, -1.1, 0.7], &mut out);
            out
        };
        for size in [0.0, 1e-12, 1e-6, 1e-3, 0.5, 2.0, 3.1] {
            let turn = [0.6 * size, -0.8 * size, 0.0];
            let (mut to, mut back) = ([0.0; 4], [0.0; 3]);
            Rotation.move_into(&from, &turn, &mut to);
            Rotation.difference_into(&from, &to, &mut back);
            let twin = to.map(|x| -x);
            for (a, b) in back.iter().zip(&turn) {
                approx::assert_abs_diff_eq!(a, b, epsilon = 1e-14);
            }
            Rotation.difference_into(&from, &twin, &mut back);
            for (a, b) in back.iter().zip(&turn) {
                approx::assert_abs_diff_eq!(a, b, epsilon = 1e-14);
            }
        }
    }

    #[test]
    fn moving_is_a_group_action_to_second_order_of_the_bracket() {
        // exp(a) exp(b) = exp(a + b + ½ [a, b] + O(3))
        let scale = 1e-3;
        let (a, b) = (
            [0.3 * scale, 0.5 * scale, -0.2 * scale],
            [-0.7 * scale, 0.1 * scale, 0.4 * scale],
        );
        let one = [1.0, 0.0, 0.0, 0.0];
        let (mut first, mut both, mut found, mut bracket) =
            ([0.0; 4], [0.0; 4], [0.0; 3], [0.0; 3]);
        Rotation.move_into(&one, &a, &mut first);
        Rotation.move_into(&first, &b, &mut both);
        Rotation.difference_into(&one, &both, &mut found);
        Rotation.bracket_into(&a, &b, &mut bracket);
        for i in 0..3 {
            let expected = a[i] + b[i] + 0.5 * bracket[i];
            approx::assert_abs_diff_eq!(found[i], expected, epsilon = scale.powi(3));
        }
    }
}
