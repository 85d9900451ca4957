//! The root of a function in a bracket.

/// Narrows the bracket [0, `end`], where f changes from f(0) ≥ 0 to f(end) < 0, to a `width`, and returns its right end: there f < 0.
///
/// ITP, which takes the steps of regula falsi where they serve and never more than one step more than bisection (Oliveira and
/// Takahashi, "An enhancement of the bisection method average performance preserving minmax optimality", 2020). `f` is called last
/// at the end that is returned.
pub(super) fn last_bracket<E>(
    mut f: impl FnMut(f64) -> Result<f64, E>,
    (f_start, end, f_end): (f64, f64, f64),
    width: f64,
) -> Result<f64, E> {
    let (mut a, mut b) = (0.0, end);
    // At 0 the function may be 0, or below by rounding: the change is then at once or later.
    let (mut f_a, mut f_b) = (f_start.max(f64::MIN_POSITIVE), f_end);
    let most = ((b - a) / width).log2().ceil().max(0.0) + 1.0;
    let kappa = 0.2 / (b - a);
    let mut last_is_end = true;
    let mut step = 0.0;
    while b - a > width {
        let middle = 0.5 * (a + b);
        // As far from the middle as bisection could still make good.
        let slack = 0.5 * width * f64::exp2(most - step) - 0.5 * (b - a);
        let falsi = (f_b * a - f_a * b) / (f_b - f_a);
        let towards = (middle - falsi).signum();
        let push = kappa * (b - a) * (b - a);
        let pushed = if push <= (middle - falsi).abs() {
            falsi + towards * push
        } else {
            middle
        };
        let trial = if (pushed - middle).abs() <= slack {
            pushed
        } else {
            middle - towards * slack
        };
        let trial = if trial > a && trial < b {
            trial
        } else {
            middle
        };
        if trial <= a || trial >= b {
            break;
        }
        let value = f(trial)?;
        last_is_end = value < 0.0;
        if last_is_end {
            (b, f_b) = (trial, value);
        } else {
            (a, f_a) = (trial, value.max(f64::MIN_POSITIVE));
        }
        step += 1.0;
    }
    if !last_is_end || step == 0.0 {
        f(b)?;
    }
    Ok(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;

    fn find(f: impl Fn(f64) -> f64) -> (f64, usize) {
        let mut calls = 0;
        let Ok(root) = last_bracket(
            |x| {
                calls += 1;
                Ok::<f64, Infallible>(f(x))
            },
            (f(0.0), 1.0, f(1.0)),
            1e-15,
        );
        (root, calls)
    }

    #[test]
    fn roots_are_found_to_rounding_from_the_side_behind_them() {
        let (root, calls) = find(|x| 0.3 - x - x * x);
        let exact = 0.5 * (2.2_f64.sqrt() - 1.0);
        assert!(root >= exact - 1e-15 && root - exact < 3e-15, "{root}");
        assert!(calls < 15, "{calls} calls");
    }

    #[test]
    fn no_function_takes_more_calls_than_bisection_and_two() {
        for at in [1e-9, 0.1, 0.7, 1.0 - 1e-9] {
            let (root, calls) = find(|x| {
                if x < at {
                    1e-12
                } else {
                    -1e6 * (x - at + 1e-3)
                }
            });
            assert!((root - at).abs() < 3e-15, "{root}");
            assert!(calls <= 53, "{calls} calls");
        }
    }

    #[test]
    fn a_root_at_the_start_is_one() {
        let (root, _) = find(|x| -x);
        assert!(root <= 1e-15);
    }
}
