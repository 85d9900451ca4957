//! First steps.

use super::engine::Point;
use super::equations::Inner;
use super::stiffness::{BOUNDARY, TIGHTER};
use crate::Differentiable;

/// What a start suggests.
#[derive(Debug, Clone, Copy)]
pub(super) struct FirstStep {
    /// What accuracy allows a method of the order asked for, s.
    pub accurate: f64,
    /// The same for order 1 at the tolerance of the implicit method of an automatic choice, s.
    pub first_order: f64,
    /// An estimate of ρ, 1/s; 0 where it was not asked for or there is none.
    pub radius: f64,
}

impl FirstStep {
    /// The longest step that is accurate and, by the estimate of ρ, stable.
    pub fn explicit(&self) -> f64 {
        self.accurate.min(BOUNDARY / self.radius)
    }
}

/// First steps from a point without a past for a method of order `order` and at most `span` seconds: Hairer, Nørsett and Wanner,
/// "Solving Ordinary Differential Equations I", II.4. One evaluation, at the end of a short step of Euler's method.
///
/// The difference δ of the rates at its two ends points to what changes fast. With `estimate`, one more evaluation along δ, as far as
/// that step was long, gives ρ ≈ ‖F(y + δ) − F(y)‖/‖δ‖: on a smooth solution of a stiff equation, where nothing else shows that it is
/// stiff, the first step else would be too long by orders of magnitude.
pub(super) fn first_step<S: Differentiable>(
    inner: &mut Inner<'_, S>,
    at: &Point<'_>,
    order: f64,
    span: f64,
    estimate: bool,
) -> FirstStep {
    let (d0, d1) = (inner.norm(at.y, at.y), inner.norm(at.rate, at.y));
    let h0 = if d0 < 1e-5 || d1 < 1e-5 {
        1e-6 * span
    } else {
        (0.01 * d0 / d1).min(span)
    };
    let ahead: Vec<f64> = at.y.iter().zip(at.rate).map(|(y, r)| y + h0 * r).collect();
    let mut change = vec![0.0; ahead.len()];
    inner.rate(at.time + h0, &ahead, &mut change);
    // What a trial says is no error.
    let refused = inner.refusal.take().is_some();
    for (change, rate) in change.iter_mut().zip(at.rate) {
        *change -= rate;
    }
    let size = inner.norm(&change, at.y);
    let largest = d1.max(size / h0);
    let mut radius = 0.0;
    if estimate && !refused && size > 0.0 && d1 > 0.0 {
        let along = h0 * d1 / size;
        let mut further = ahead;
        for (y, change) in further.iter_mut().zip(&change) {
            *y += along * change;
        }
        let mut difference = vec![0.0; further.len()];
        inner.rate(at.time + h0, &further, &mut difference);
        if inner.refusal.take().is_none() {
            for ((d, change), rate) in difference.iter_mut().zip(&change).zip(at.rate) {
                *d -= rate + change;
            }
            radius = inner.norm(&difference, at.y) / (h0 * d1);
        }
    }
    let of_order = |order: f64, largest: f64| {
        if largest <= 1e-15 {
            (1e-3 * h0).max(1e-6 * span)
        } else {
            (0.01 / largest).powf(1.0 / (order + 1.0))
        }
    };
    let limit = (100.0 * h0).min(span);
    FirstStep {
        accurate: of_order(order, largest).min(limit),
        first_order: of_order(1.0, largest / TIGHTER).min(limit),
        radius,
    }
}

/// The first step of backward differences after an explicit step of `h` over which the rate changed by `change`, in the norm of the
/// error test: where half the tolerance is met by 0.315 h² ÿ, their error at order 1 (Shampine and Reichelt 1997).
pub(super) fn after_explicit(h: f64, change: f64) -> f64 {
    let second = change / (h * TIGHTER);
    (0.5 / (0.315 * second)).sqrt().clamp(1e-3 * h, 10.0 * h)
}
