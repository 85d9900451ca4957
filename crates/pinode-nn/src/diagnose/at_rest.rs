//! What the part that is held out cannot bear out: a name for what moves a coordinate that hardly moves there.

use super::candidate::Candidate;
use super::comparison::Lack;
use super::search::Search;
use super::study::Study;
use crate::effect::ActsOn;
use crate::shooting::Window;

/// A signal that is so small a part in the windows held out of what it is in the others hardly moves there.
const HARDLY: f64 = 0.25;
/// What is behind by so many standard errors in the windows held out is contradicted by them.
const CONTRADICTED: f64 = -2.0;

/// A name that explains what the seen windows lack, and that those held out, in which its signal hardly moves, neither bear out nor contradict.
pub struct Unborne {
    /// The name.
    pub candidate: Candidate,
    /// Whether it follows an input.
    pub of_input: bool,
    /// How clearly it explains the seen windows, standard errors.
    pub z: f64,
    /// Root mean square of the input, or of the speed of the coordinate, that it follows, in the seen windows and in those held out.
    pub moves: [f64; 2],
}

/// The one of the last step's candidates that explains most, where that is so.
pub fn unborne(study: &Study, search: &Search) -> Option<Unborne> {
    let contenders = &search.steps.last()?.contenders;
    let mut explaining = contenders.iter().filter(|c| {
        let (compared, held_out) = (&c.comparison, c.comparison.outside.z);
        c.is_sensible && held_out > CONTRADICTED && compared.lacks() == Some(Lack::GainHeldOut)
    });
    explaining.find_map(|c| {
        let [candidate] = c.added[..] else {
            return None;
        };
        let of = |windows: &[Window]| root_mean_square(study, search, &candidate, windows);
        let moves = [of(&study.windows.fit), of(&study.windows.held_out)];
        (moves[1] < HARDLY * moves[0]).then_some(Unborne {
            candidate,
            of_input: is_of_input(&candidate),
            z: c.comparison.inside.z,
            moves,
        })
    })
}

fn is_of_input(candidate: &Candidate) -> bool {
    candidate.kind.acts_on() == ActsOn::Input
}

fn root_mean_square(
    study: &Study,
    search: &Search,
    candidate: &Candidate,
    windows: &[Window],
) -> f64 {
    let c = search
        .model
        .hybrid
        .coordinate_of(candidate.kind, candidate.target);
    let signal = |run: usize| match is_of_input(candidate) {
        true => &study.observations.runs[run].u[candidate.target],
        false => &study.smoothed[run].v[c],
    };
    let values = windows.iter().flat_map(|w| {
        let own = signal(w.run).iter();
        own.skip(w.first).take(w.count)
    });
    let (sum, n) = values.fold((0.0, 0_usize), |(sum, n), x| (sum + x * x, n + 1));
    (sum / n.max(1) as f64).sqrt()
}
