//! What is wanted: where episodes begin, what a step is worth, and when it is over.

use rand::{Rng, RngExt};

/// One step, as it was: states (q, v) in the model's coordinates and order, in SI units.
#[derive(Debug, Clone, Copy)]
pub struct Transition<'a> {
    /// The state that the step began in, nq + nv numbers.
    pub state: &'a [f64],
    /// The inputs that were held over it, one each.
    pub action: &'a [f64],
    /// The state that it came to.
    pub next: &'a [f64],
    /// When it came there, s since the episode began.
    pub time: f64,
}

/// What a step is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// The reward.
    pub reward: f64,
    /// Whether the episode ends here, by success or failure.
    pub terminated: bool,
}

/// What is wanted of a mechanism. It judges true states, whatever is observed of them.
pub trait Task {
    /// Writes the state (q, v) that an episode begins in to `state`, which is 0 (of a pose: no rotation) before.
    fn begin(&mut self, random: &mut dyn Rng, state: &mut [f64]);

    /// Reward and end of a step.
    fn judge(&mut self, transition: &Transition<'_>) -> Verdict;
}

impl<T: Task + ?Sized> Task for Box<T> {
    fn begin(&mut self, random: &mut dyn Rng, state: &mut [f64]) {
        (**self).begin(random, state);
    }

    fn judge(&mut self, transition: &Transition<'_>) -> Verdict {
        (**self).judge(transition)
    }
}

/// A [`Task`] of two closures.
///
/// ```
/// use pinode_nn::environment::{Closures, Transition, Verdict, uniform};
///
/// // A pendulum that hangs more or less, and is to stand up: φ, φ̇ with φ = 0 upright.
/// let task = Closures::new(
///     uniform(vec![std::f64::consts::PI, 0.0], vec![0.1, 0.0]),
///     |step: &Transition<'_>| Verdict { reward: step.next[0].cos(), terminated: step.next[1].abs() > 50.0 },
/// );
/// # let _ = task;
/// ```
#[derive(Debug, Clone)]
pub struct Closures<B, J> {
    begin: B,
    judge: J,
}

impl<B, J> Closures<B, J>
where
    B: FnMut(&mut dyn Rng, &mut [f64]),
    J: FnMut(&Transition<'_>) -> Verdict,
{
    /// Of what [begins](Task::begin) and what [judges](Task::judge).
    pub fn new(begin: B, judge: J) -> Self {
        Closures { begin, judge }
    }
}

impl<B, J> Task for Closures<B, J>
where
    B: FnMut(&mut dyn Rng, &mut [f64]),
    J: FnMut(&Transition<'_>) -> Verdict,
{
    fn begin(&mut self, random: &mut dyn Rng, state: &mut [f64]) {
        (self.begin)(random, state);
    }

    fn judge(&mut self, transition: &Transition<'_>) -> Verdict {
        (self.judge)(transition)
    }
}

/// Episodes begin at `centre` (q, v), each number up to `spread` away either way, all alike likely; what the lists do not have stays 0.
/// Not for poses.
pub fn uniform(
    centre: Vec<f64>,
    spread: Vec<f64>,
) -> impl Fn(&mut dyn Rng, &mut [f64]) + Clone + Send + Sync {
    move |random, state| {
        for (i, x) in state.iter_mut().enumerate() {
            let number = |list: &[f64]| list.get(i).copied().unwrap_or_default();
            let share: f64 = random.random();
            *x = number(&centre) + (2.0 * share - 1.0) * number(&spread);
        }
    }
}
