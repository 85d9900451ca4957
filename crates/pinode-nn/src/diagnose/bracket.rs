//! Where fits over one number that no fit moves explain most.

use std::f64::consts::LN_2;
use std::mem::replace;

/// It is looked for by steps of a factor of two, so many at most, and so many fits after that.
const DOUBLINGS: usize = 5;
const CLOSER: usize = 8;
/// The likelihood is a parabola of the number's logarithm over ranges no farther apart than that.
const PARABOLIC: f64 = 0.52;
/// A fit that the parabola promises so many nats is made …
const WORTH_A_FIT: f64 = 3.0;
/// … no closer than this part of a side to the middle, and where the parabola does not say, half-way there.
const APART: f64 = 0.1;
const HALF_WAY: f64 = 0.5;

/// A fit between two others, one with less of the number and one with more.
pub struct Bracket<T> {
    middle: T,
    /// The logarithms of theirs over that of the middle one.
    beside: [(f64, T); 2],
}

impl<T> Bracket<T> {
    /// A fit beside those `apart` from it, below and above.
    pub fn around(middle: T, apart: [f64; 2], fit: impl Fn(&T, f64) -> T) -> Self {
        let beside = apart.map(|x| (x, fit(&middle, x)));
        Bracket { middle, beside }
    }

    /// The best fit. `fit` makes one whose number has that logarithm over another fit's, and `gain` says by how many nats one is better than another, −∞ for one
    /// that does not count. None are made closer together than `closest` says for the best so far.
    pub fn best(
        mut self,
        fit: impl Fn(&T, f64) -> T,
        gain: impl Fn(&T, &T) -> f64,
        closest: impl Fn(&T) -> f64,
    ) -> T {
        for step in 0..DOUBLINGS {
            let (side, gained) = better(self.gains(&gain));
            let least = if step == 0 { WORTH_A_FIT } else { 0.0 };
            if gained.is_nan() || gained <= least {
                break;
            }
            let apart = LN_2.copysign(self.beside[side].0);
            let next = fit(&self.beside[side].1, apart);
            self.move_to(side, (apart, next));
        }
        for _ in 0..CLOSER {
            let at = match self.next(self.gains(&gain)) {
                Some(at) if at.abs() >= closest(&self.middle) => at,
                _ => break,
            };
            let (side, other) = (usize::from(at > 0.0), fit(&self.middle, at));
            let is_better = gain(&other, &self.middle) > 0.0;
            let outer = replace(&mut self.beside[side], (at, other));
            if is_better {
                self.move_to(side, (outer.0 - at, outer.1));
            }
        }
        let (side, gained) = better(self.gains(&gain));
        let [below, above] = self.beside;
        match (gained > 0.0, side) {
            (false, _) => self.middle,
            (true, 0) => below.1,
            (true, _) => above.1,
        }
    }

    fn gains(&self, gain: impl Fn(&T, &T) -> f64) -> [f64; 2] {
        [0, 1].map(|side| gain(&self.beside[side].1, &self.middle))
    }

    /// Makes the fit on this side the middle one, with another beyond it.
    fn move_to(&mut self, side: usize, beyond: (f64, T)) {
        let (at, better) = replace(&mut self.beside[side], beyond);
        let middle = replace(&mut self.middle, better);
        self.beside[1 - side] = (-at, middle);
    }

    /// Where the next fit is made: at the top of the parabola through the three, which gain so much over the middle one, where that promises enough, and in the middle of a
    /// side that is wider than parabolas are. Nowhere where the middle one is not the best.
    fn next(&self, gains: [f64; 2]) -> Option<f64> {
        if gains.iter().any(|gained| *gained > 0.0) {
            return None;
        }
        let sides = [self.beside[0].0, self.beside[1].0];
        let wider = sides[usize::from(sides[1] > -sides[0])];
        let (top, promised) = parabola(sides, gains);
        let side = sides[usize::from(top > 0.0)];
        if promised > WORTH_A_FIT {
            return Some(top.abs().max(APART * side.abs()).copysign(top));
        }
        (wider.abs() > PARABOLIC).then_some(HALF_WAY * wider)
    }
}

/// The side that gains more, and how much.
fn better(gains: [f64; 2]) -> (usize, f64) {
    let side = usize::from(gains[1] > gains[0] || gains[0].is_nan());
    (side, gains[side])
}

/// Where the parabola through 0 at 0 and `gains` at `sides` has its top, and how high that is. No numbers where it has none.
fn parabola(sides: [f64; 2], gains: [f64; 2]) -> (f64, f64) {
    let slopes = [gains[0] / sides[0], gains[1] / sides[1]];
    let bend = (slopes[1] - slopes[0]) / (sides[1] - sides[0]);
    let slope = slopes[0] - bend * sides[0];
    let top = match bend < 0.0 {
        true => -slope / (2.0 * bend),
        false => f64::NAN,
    };
    (top, 0.5 * slope * top)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// The best x = ln w by values l(x) from 0 on, and how many were asked for.
    fn best(l: impl Fn(f64) -> f64, closest: f64) -> (f64, usize) {
        let asked = Cell::new(0);
        let fit = |from: &f64, apart: f64| {
            asked.set(asked.get() + 1);
            from + apart
        };
        let gain = |a: &f64, b: &f64| l(*a) - l(*b);
        let bracket = Bracket::around(0.0, [-0.51, 0.41], fit);
        (bracket.best(fit, gain, |_| closest), asked.get())
    }

    #[test]
    fn a_parabola_s_top_is_found_from_afar_and_nothing_more_asked_there() {
        let (x, asked) = best(|x| -200.0 * (x - 2.3).powi(2), 0.007);
        assert!((x - 2.3).abs() < 0.007, "{x}");
        assert!(asked <= 9, "{asked}");
        let (x, asked) = best(|x| -200.0 * (x + 0.2).powi(2), 0.007);
        assert!((x + 0.2).abs() < 1e-9 && asked <= 4, "{x}, {asked}");
        // However close it is.
        let (x, asked) = best(|x| -1e5 * (x - 0.03).powi(2), 0.007);
        assert!((x - 0.03).abs() < 0.007 && asked <= 6, "{x}, {asked}");
    }

    #[test]
    fn what_gains_nothing_is_asked_twice() {
        assert_eq!(best(|x| -2.0 * x * x, 0.007), (0.0, 2));
        assert_eq!(best(|_| 0.0, 0.007), (0.0, 2));
    }

    /// l is no parabola: a bend of another size on either side, and none where a law ends.
    #[test]
    fn the_top_of_what_is_no_parabola_lies_within_what_is_worth_a_fit() {
        let l = |x: f64| match x - 1.1 {
            d if d > 0.9 => f64::NEG_INFINITY,
            d if d > 0.0 => -30.0 * d.powi(2),
            d => -400.0 * d.abs().powf(1.5),
        };
        let (x, asked) = best(l, 0.007);
        assert!(-l(x) < WORTH_A_FIT && asked <= 15, "{x}: {}, {asked}", l(x));
        // It goes on rising.
        let (x, asked) = best(|x| 10.0 * x, 0.007);
        assert!(x > 3.0 && asked == 7, "{x}, {asked}");
    }

    #[test]
    fn none_are_closer_than_is_said() {
        let l = |x: f64| -1e5 * (x - 0.05).powi(2);
        assert_eq!(best(l, 0.09), (0.0, 2));
        assert!((best(l, 0.007).0 - 0.05).abs() < 0.007);
    }
}
