//! Shapes of general forces on a joint: functions of what it could follow, along the roll-out of a window.

use super::linear::AtWindow;
use super::signals::relative;
use super::study::{Fitted, Study};
use crate::hybrid::Hybrid;
use crate::shooting::Window;

/// Points of a curve over a signal.
const POINTS: usize = 7;
/// What an input was so many samples ago.
const INPUT_AGO: [usize; 8] = [0, 1, 2, 3, 4, 6, 8, 12];
/// Ways after a reversal over which friction builds up, shares of the range of the motion.
const WAYS: [f64; 3] = [0.01, 0.03, 0.1];
/// Waves over a turn.
const WAVES: usize = 3;

/// What a general force follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Follows {
    /// The velocity of its joint.
    Velocity,
    /// The position of its joint.
    Position,
    /// Its position and direction of motion.
    PositionAndDirection,
    /// The input on its joint.
    Input,
    /// What that input was before.
    PastInput,
    /// How the joint moved before.
    PastMotion,
    /// Where the coordinate after it is, from it: then it acts on both.
    PositionBeyond,
    /// How fast that changes.
    VelocityBeyond,
}

impl Follows {
    /// Whether it is the past.
    pub fn is_past(self) -> bool {
        matches!(self, Follows::PastInput | Follows::PastMotion)
    }

    /// Whether it is what drives the joint, now or before.
    pub fn is_of_input(self) -> bool {
        matches!(self, Follows::Input | Follows::PastInput)
    }

    /// Whether it is what is between two coordinates.
    pub fn is_between(self) -> bool {
        matches!(self, Follows::PositionBeyond | Follows::VelocityBeyond)
    }

    /// In words, of the joint called `joint`, before the one called `next`.
    pub fn words(self, joint: &str, next: &str) -> String {
        match self {
            Follows::PositionBeyond => format!("the position of `{next}` from `{joint}`"),
            Follows::VelocityBeyond => format!("the velocity of `{next}` from `{joint}`"),
            Follows::Velocity => format!("the velocity of `{joint}`"),
            Follows::Position => format!("the position of `{joint}`"),
            Follows::PositionAndDirection => {
                format!("the position of `{joint}` and the direction of its motion")
            }
            Follows::Input => format!("the input on `{joint}`"),
            Follows::PastInput => format!("what the input on `{joint}` was before"),
            Follows::PastMotion => format!("how `{joint}` moved before"),
        }
    }
}

/// General forces of one sort on one coordinate.
pub struct Shape {
    /// The coordinate.
    pub coordinate: usize,
    /// What they follow.
    pub follows: Follows,
    functions: Functions,
}

enum Functions {
    /// Piecewise linear ones of a signal, with these knots.
    Curves(Signal, Vec<f64>),
    /// 1, and cos kq and sin kq.
    Waves,
    /// Values of an input, so many samples ago.
    Earlier { input: usize },
    /// The same of what the coordinate after it has more of, on both.
    Beyond(Signal, Vec<f64>),
    /// Springs that slip where they are stretched by so much; how far they are at every sample of every recording.
    Springs(Vec<(f64, Vec<Vec<f64>>)>),
}

/// What the joint is at, or what drives it.
#[derive(Clone, Copy)]
enum Signal {
    Position,
    Velocity,
    Input(usize),
}

/// The general forces on every coordinate.
pub fn shapes(study: &Study, fitted: &Fitted) -> Vec<Shape> {
    let hybrid = &fitted.hybrid;
    let mut shapes = between_neighbours(study, hybrid);
    for (c, coordinate) in hybrid.mechanics().coordinates().iter().enumerate() {
        let mut add = |follows, functions: Functions| {
            shapes.push(Shape {
                coordinate: c,
                follows,
                functions,
            });
        };
        let smoothed = || study.smoothed.iter();
        let places = || match coordinate.angular {
            true => Functions::Waves,
            false => Functions::Curves(
                Signal::Position,
                knots(smoothed().map(|s| s.q[c].as_slice())),
            ),
        };
        add(
            Follows::Velocity,
            Functions::Curves(
                Signal::Velocity,
                knots(smoothed().map(|s| s.v[c].as_slice())),
            ),
        );
        add(Follows::Position, places());
        add(Follows::PositionAndDirection, places());
        for input in (0..hybrid.inputs()).filter(|&input| hybrid.moves(input, c)) {
            let runs = study.observations.runs.iter();
            let values = knots(runs.map(|run| run.u[input].as_slice()));
            add(
                Follows::Input,
                Functions::Curves(Signal::Input(input), values),
            );
            add(Follows::PastInput, Functions::Earlier { input });
        }
        let ends = knots(smoothed().map(|s| s.q[c].as_slice()));
        let reach = match ends[..] {
            [first, .., last] => last - first,
            _ => continue,
        };
        let springs = WAYS.map(|way| {
            let paths = smoothed().map(|s| stretched(&s.q[c], way * reach, 0.0));
            (way * reach, paths.collect())
        });
        add(Follows::PastMotion, Functions::Springs(springs.to_vec()));
    }
    shapes
}

/// Those between two coordinates that follow one another and count alike, where each may count from where it stands: the joints of bodies count from one
/// another.
fn between_neighbours(study: &Study, hybrid: &Hybrid) -> Vec<Shape> {
    let coordinates = match hybrid.links() {
        [] => hybrid.mechanics().coordinates(),
        _ => &[],
    };
    let of_pair = |(c, _): (usize, String)| {
        let beyond = |signal: Signal| {
            let from = study.smoothed.iter().map(|s| signal.beyond(&s.q, &s.v, c));
            let all: Vec<Vec<f64>> = from.collect();
            Functions::Beyond(signal, knots(all.iter().map(Vec::as_slice)))
        };
        let sorts = [
            (Follows::PositionBeyond, Signal::Position),
            (Follows::VelocityBeyond, Signal::Velocity),
        ];
        sorts.map(|(follows, signal)| Shape {
            coordinate: c,
            follows,
            functions: beyond(signal),
        })
    };
    // Of what is folded nobody knows how far it is from the next.
    let is_plain = |(c, _): &(usize, String)| !coordinates[*c].wraps && !coordinates[c + 1].wraps;
    let pairs = relative(coordinates).filter(is_plain);
    pairs.flat_map(of_pair).collect()
}

impl Signal {
    /// By how much it is more of the coordinate after `c`.
    fn beyond(self, q: &[Vec<f64>], v: &[Vec<f64>], c: usize) -> Vec<f64> {
        let of = match self {
            Signal::Velocity => v,
            _ => q,
        };
        let pairs = of[c].iter().zip(&of[c + 1]);
        pairs.map(|(one, next)| next - one).collect()
    }
}

impl Shape {
    /// How many they are.
    pub fn columns(&self) -> usize {
        match &self.functions {
            Functions::Curves(_, knots) => knots.len(),
            Functions::Beyond(_, knots) => 2 * knots.len(),
            Functions::Waves => 1 + 2 * WAVES,
            Functions::Earlier { .. } => INPUT_AGO.len(),
            Functions::Springs(springs) => springs.len(),
        }
    }

    /// Each of them in a window, with its coordinate: from each sample to the next, in the middle between them.
    pub fn along(&self, study: &Study, fitted: &Fitted, at: &AtWindow) -> Vec<(usize, Vec<f64>)> {
        let (nv, nx) = (fitted.hybrid.nv(), fitted.hybrid.nx());
        let c = self.coordinate;
        let Window { run, first, count } = *at.window;
        let of = |entry: usize| -> Vec<f64> {
            let state = |k: usize| at.states[k * nx + entry];
            (1..count)
                .map(|k| 0.5 * (state(k - 1) + state(k)))
                .collect()
        };
        let earlier = |input: usize, ago: usize| -> Vec<f64> {
            let u = &study.observations.runs[run].u[input];
            (first..first + count - 1)
                .map(|k| u[k.saturating_sub(ago)])
                .collect()
        };
        let q = of(c);
        let map =
            |x: &[f64], f: &dyn Fn(f64) -> f64| -> Vec<f64> { x.iter().map(|&x| f(x)).collect() };
        let mut all: Vec<Vec<f64>> = match &self.functions {
            Functions::Curves(signal, knots) => {
                let signal = match signal {
                    Signal::Position => q,
                    Signal::Velocity => of(nv + c),
                    Signal::Input(input) => earlier(*input, 0),
                };
                (0..knots.len())
                    .map(|k| map(&signal, &|x| hat(knots, k, x)))
                    .collect()
            }
            Functions::Beyond(signal, knots) => {
                let ends = match signal {
                    Signal::Velocity => [of(nv + c), of(nv + c + 1)],
                    _ => [q, of(c + 1)],
                };
                let between: Vec<f64> = ends[0].iter().zip(&ends[1]).map(|(a, b)| b - a).collect();
                let curves = (0..knots.len()).map(|k| map(&between, &|x| hat(knots, k, x)));
                let on = |joint: usize| curves.clone().map(move |force| (joint, force));
                return on(c).chain(on(c + 1)).collect();
            }
            Functions::Waves => {
                let waves = (1..=WAVES).flat_map(|k| {
                    let k = k as f64;
                    [map(&q, &|x| (k * x).cos()), map(&q, &|x| (k * x).sin())]
                });
                std::iter::once(map(&q, &|_| 1.0)).chain(waves).collect()
            }
            Functions::Earlier { input } => {
                INPUT_AGO.iter().map(|&ago| earlier(*input, ago)).collect()
            }
            Functions::Springs(springs) => springs
                .iter()
                .map(|(way, paths)| stretched(&q, *way, paths[run][first]))
                .collect(),
        };
        if self.follows == Follows::PositionAndDirection {
            let v = of(nv + c);
            for force in &mut all {
                force.iter_mut().zip(&v).for_each(|(f, v)| *f *= v.signum());
            }
        }
        all.into_iter().map(|force| (c, force)).collect()
    }
}

/// Quantiles of a signal, from its least to its largest value, each once; none of what is not finite.
fn knots<'a>(signal: impl Iterator<Item = &'a [f64]>) -> Vec<f64> {
    let mut sorted: Vec<f64> = signal
        .flatten()
        .copied()
        .filter(|x| x.is_finite())
        .collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    let at = |k: usize| sorted.get(k * last / (POINTS - 1)).copied();
    let mut knots: Vec<f64> = (0..POINTS).filter_map(at).collect();
    knots.dedup();
    knots
}

/// The piecewise linear function that is 1 at the `k`th knot and 0 at the others; beyond the outer knots it is what it is there.
fn hat(knots: &[f64], k: usize, x: f64) -> f64 {
    let here = knots[k];
    let rise = match k.checked_sub(1).map(|before| knots[before]) {
        Some(before) => (x - before) / (here - before),
        None => 1.0,
    };
    let fall = match knots.get(k + 1) {
        Some(next) => (next - x) / (next - here),
        None => 1.0,
    };
    rise.min(fall).clamp(0.0, 1.0)
}

/// z/way of a spring that slips, ż = q̇ held within ± way, that starts with z = `start` · way.
fn stretched(q: &[f64], way: f64, start: f64) -> Vec<f64> {
    let mut z = start;
    let mut last = q.first().copied().unwrap_or(0.0);
    q.iter()
        .map(|&x| {
            z = (z + (x - last) / way.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0);
            last = x;
            z
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_over_a_signal_add_up_to_one_everywhere() {
        let knots = knots([[0.3, -1.0, 0.0, 2.0, 0.0, 0.7].as_slice()].into_iter());
        assert_eq!((knots[0], knots[knots.len() - 1]), (-1.0, 2.0));
        for x in [-3.0, -1.0, -0.2, 0.0, 0.1, 0.69, 1.5, 2.0, 9.0] {
            let sum: f64 = (0..knots.len()).map(|k| hat(&knots, k, x)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{x}: {sum}");
        }
        assert_eq!(hat(&[4.0], 0, -1.0), 1.0);
    }

    #[test]
    fn a_spring_that_slips_is_tight_after_its_way_and_turns_with_the_motion() {
        let q: Vec<f64> = (0..=20)
            .map(|k| 0.01 * f64::from(k))
            .chain((0..20).rev().map(|k| 0.01 * f64::from(k)))
            .collect();
        let z = stretched(&q, 0.05, 0.0);
        assert!((z[3] - 0.6).abs() < 1e-12 && z[20] == 1.0);
        assert!((z[25] - 0.0).abs() < 1e-9 && (z[40] + 1.0).abs() < 1e-12);
    }
}
