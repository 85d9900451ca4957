//! The epochs of a training.

use pulp::{Simd, WithSimd};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::adam::Adam;
use super::adjoint::{CHUNK, Chunk, Learner, Member, Setting};
use super::data::{Recordings, Side};
use super::loss::FAR;
use super::{Options, Start};
use crate::Error;
use crate::learnt::LearntForce;
use crate::network::{Mlp, Real};
use crate::processor::Processor;

/// Constants are fitted beside the network after so many epochs, and after twice as many as the last time.
const FIRST_REFIT: usize = 2;
/// So many steps do the starts of what is held out make towards a new network.
const STARTS_OF_HELD_OUT: usize = 2;
/// The rate falls to this part of it.
const LAST_RATE: f64 = 0.01;
/// κ of the loss at most.
const FARTHEST: f64 = 1e100;
/// A window held out that leaves the range of mechanisms counts as if the squares at each of its samples summed up to this: a million deviations of
/// the noise, or of SI units. Left out, it would be as good as a perfect one.
const LOST: f64 = 1e12;
/// What effects take over of a network in the end may cost this share on the windows held out.
const TAKING_OVER: f64 = 0.01;
/// Less gain on the windows held out than this share counts as none.
const GAIN: f64 = 1e-3;

/// How an epoch went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Its number, from 1.
    pub epoch: usize,
    /// Typical loss a sample of the windows that were learnt from, while they were.
    pub loss: f64,
    /// The same of the windows held out, after it.
    pub held_out: f64,
    /// Windows that left the range of any mechanism.
    pub diverged: usize,
    /// Windows held out that did: each counts as one a million deviations of the noise away.
    pub held_out_diverged: usize,
    /// Adam's step; 0 in a round of the polish.
    pub rate: f64,
    /// Whether it was a round of the polish.
    #[serde(default)]
    pub polish: bool,
}

/// A network in training, computed in f32 or f64: [`train`](super::train) goes through its epochs one by one.
pub struct Session<'a, T: Real> {
    pub(super) recordings: Recordings,
    pub(super) options: &'a Options,
    pub(super) learner: Learner<T>,
    pub(super) adam: Adam<T>,
    pub(super) best: Mlp<T>,
    /// θ beside it, and what was [held back](Recordings::held_back) there.
    pub(super) best_theta: Vec<f64>,
    pub(super) best_held_back: Vec<(usize, f64)>,
    pub(super) history: Vec<Epoch>,
    chunks: Vec<Chunk<T>>,
    pub(super) gradient: Vec<T>,
}

impl<'a, T: Real> Session<'a, T> {
    pub(super) fn of(recordings: Recordings, options: &'a Options, learner: Learner<T>) -> Self {
        let n = learner.network.parameters().len();
        let steps = recordings.horizon * recordings.substeps;
        let chunks = {
            let setting = setting(&recordings);
            let windows = recordings.seen.windows.len();
            let windows = windows.max(recordings.held_out.windows.len());
            let most = options.batch.min(windows);
            (0..most.div_ceil(CHUNK))
                .map(|_| Chunk::new(&setting, &learner, most, steps))
                .collect()
        };
        Session {
            adam: Adam::new(n),
            best: learner.network.clone(),
            best_theta: recordings.theta.clone(),
            best_held_back: recordings.held_back.clone(),
            history: Vec::new(),
            gradient: vec![T::from_f64(0.0); n],
            chunks,
            recordings,
            options,
            learner,
        }
    }

    /// Number of windows that are learnt from.
    pub fn windows(&self) -> usize {
        self.recordings.seen.windows.len()
    }

    /// Number of windows held out.
    pub fn windows_held_out(&self) -> usize {
        self.recordings.held_out.windows.len()
    }

    /// The network as it is now.
    pub fn network(&self) -> &Mlp<T> {
        &self.learner.network
    }

    /// What has been so far.
    pub fn history(&self) -> &[Epoch] {
        &self.history
    }

    /// The epoch with the least loss on the windows held out; 0 before the first.
    pub fn best_epoch(&self) -> usize {
        let better = |best: (usize, f64), e: &Epoch| match e.held_out < best.1 * (1.0 - GAIN) {
            true => (e.epoch, e.held_out),
            false => best,
        };
        self.history.iter().fold((0, f64::INFINITY), better).0
    }

    /// What comes next: an epoch of Adam; a round of the polish, when these are over or enough of them have brought nothing; or nothing, when these are,
    /// too, or the last has brought nothing.
    fn next(&self) -> Option<Next> {
        let done = self.history.len();
        let rounds = self.history.iter().filter(|epoch| epoch.polish).count();
        let (best, options) = (self.best_epoch(), self.options);
        if rounds == 0 && done < options.epochs && done - best < options.patience.max(1) {
            Some(Next::Epoch)
        } else if rounds < options.polish && (rounds == 0 || best == done) {
            Some(Next::Polish)
        } else {
            None
        }
    }

    /// The next epoch of the training, [`epoch`](Self::epoch) or a round of the polish; `None` after the last.
    ///
    /// # Errors
    /// As [`epoch`](Self::epoch).
    pub fn advance(&mut self) -> Result<Option<Epoch>, Error> {
        Ok(match self.next() {
            Some(Next::Epoch) => Some(self.epoch()?),
            Some(Next::Polish) => Some(self.polish()?),
            None => None,
        })
    }

    /// Learns from all windows once, in an order of this epoch's.
    ///
    /// # Errors
    /// [`Error::Mechanics`] of a state in the range of mechanisms, [`Error::Unfittable`] when most windows leave it.
    pub fn epoch(&mut self) -> Result<Epoch, Error> {
        let number = self.history.len() + 1;
        let fitted = self.options.start == Start::Fitted;
        if fitted && self.options.physics && is_refit(number) {
            self.hand_over(number as u64)?;
            let force = self.force(&self.learner.network)?;
            self.recordings.fit_beside(force);
        }
        let mut order: Vec<usize> = (0..self.recordings.seen.windows.len()).collect();
        if fitted {
            if number == 1 {
                self.look_at_all(&order)?;
            }
            self.see_as_far();
            if number == 1 {
                // No step of the starts has been made.
                self.recordings.seen.trust_all();
            }
        }
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed);
        rng.set_stream(number as u64);
        order.shuffle(&mut rng);
        let batches = order.len().div_ceil(self.options.batch);
        let (mut loss, mut diverged) = (0.0, 0);
        for (k, batch) in order.chunks(self.options.batch).enumerate() {
            let progress =
                ((number - 1) * batches + k) as f64 / (self.options.epochs as f64 * batches as f64);
            let (sum, lost) = self.step(batch, self.rate(progress))?;
            loss += sum;
            diverged += lost;
        }
        let rate = self.rate(number as f64 / self.options.epochs as f64);
        self.end_epoch(loss, diverged, Some(rate))
    }

    /// What an epoch of Adam's with this last rate, or a round of the polish, says whose windows count `loss` together, so many left out; keeps its
    /// weights if they are the best.
    pub(super) fn end_epoch(
        &mut self,
        loss: f64,
        diverged: usize,
        rate: Option<f64>,
    ) -> Result<Epoch, Error> {
        let windows = self.windows();
        if 2 * diverged > windows {
            return Err(Error::Unfittable { diverged, windows });
        }
        let loss = self.typical(loss, windows - diverged);
        let (held_out, held_out_diverged) = self.held_out()?;
        let epoch = Epoch {
            epoch: self.history.len() + 1,
            loss,
            held_out,
            diverged,
            held_out_diverged,
            rate: rate.unwrap_or(0.0),
            polish: rate.is_none(),
        };
        self.history.push(epoch);
        if self.best_epoch() == epoch.epoch {
            self.best = self.learner.network.clone();
            self.best_theta.clone_from(&self.recordings.theta);
            self.best_held_back.clone_from(&self.recordings.held_back);
        }
        Ok(epoch)
    }

    /// Takes the best network so far, and the constants beside it.
    pub(super) fn return_to_best(&mut self) {
        self.learner.network = self.best.clone();
        self.recordings.set_theta(self.best_theta.clone());
    }

    /// Lets the effects take over what they can explain of the network's force; whether there was anything.
    fn hand_over(&mut self, seed: u64) -> Result<bool, Error> {
        let force = self.force(&self.learner.network)?;
        let (recordings, learner) = (&mut self.recordings, &mut self.learner);
        Ok(recordings.take_over(&force, learner, seed))
    }

    /// Lets the effects take over what they could explain of the best network's force, unless that costs more than [`TAKING_OVER`] on the windows
    /// held out; the share of it that they still could explain.
    ///
    /// # Errors
    /// [`Error::Mechanics`] of a state in the range of mechanisms.
    pub(super) fn settle(&mut self) -> Result<Option<f64>, Error> {
        if !self.options.physics || self.options.start != Start::Fitted {
            return Ok(None);
        }
        self.return_to_best();
        let share = |session: &Self| -> Result<Option<f64>, Error> {
            let force = session.force(&session.learner.network)?;
            let overlap = session.recordings.overlap(&force);
            Ok(overlap.map(|overlap| overlap.share))
        };
        if !self.hand_over(0)? {
            return share(self);
        }
        let after = self.held_out()?.0;
        let best = self.best_epoch();
        let mut history = self.history.iter();
        let before = history.find(|epoch| epoch.epoch == best);
        match before.is_some_and(|epoch| after > (1.0 + TAKING_OVER) * epoch.held_out) {
            true => self.return_to_best(),
            false => {
                self.best = self.learner.network.clone();
                self.best_theta.clone_from(&self.recordings.theta);
            }
        }
        share(self)
    }

    /// What is far is so beside the others: while all are, none is.
    pub(super) fn see_as_far(&mut self) {
        let typical = self.recordings.seen.median_distance();
        self.recordings.loss.far = Some(typical.clamp(FAR, FARTHEST));
    }

    /// How far all windows that are learnt from are from their measurements.
    fn look_at_all(&mut self, all: &[usize]) -> Result<(), Error> {
        for batch in all.chunks(self.options.batch) {
            let used = self.in_chunks(Part::Seen, batch, Chunk::roll)?;
            let Recordings { seen, loss, .. } = &mut self.recordings;
            seen.look(loss, batch, &self.chunks[..used]);
        }
        Ok(())
    }

    /// η along a cosine, or the same for ever.
    fn rate(&self, progress: f64) -> f64 {
        let fallen = match self.options.decays {
            true => 0.5 * (1.0 + (std::f64::consts::PI * progress.min(1.0)).cos()),
            false => 1.0,
        };
        self.options.rate * (LAST_RATE + (1.0 - LAST_RATE) * fallen)
    }

    /// The typical loss a sample of so many windows that count `loss` together.
    fn typical(&self, loss: f64, windows: usize) -> f64 {
        self.recordings.loss.typical(loss / self.terms(windows))
    }

    /// How many samples the loss of so many windows is summed over.
    pub(super) fn terms(&self, windows: usize) -> f64 {
        let recordings = &self.recordings;
        (windows * (recordings.horizon + 1 - recordings.loss.first)).max(1) as f64
    }

    /// One step of Adam for a batch of windows, by their numbers below [`windows`](Self::windows), at most [`Options::batch`] of them; their summed
    /// loss, and how many left the range of mechanisms.
    ///
    /// # Errors
    /// [`Error::Mechanics`] of a state in the range of mechanisms; [`Error::Training`] when a number is too large, or there are too many or none.
    pub fn step(&mut self, batch: &[usize], rate: f64) -> Result<(f64, usize), Error> {
        let windows = self.windows();
        if batch.is_empty() || batch.len() > self.options.batch {
            let (found, most) = (batch.len(), self.options.batch);
            let fault = format!("a batch of {found} windows is none of 1 to {most}");
            return Err(Error::Training(fault));
        }
        if let Some(index) = batch.iter().find(|&&index| index >= windows) {
            let fault = format!("there is no window {index}: there are {windows}");
            return Err(Error::Training(fault));
        }
        let fitted = self.options.start == Start::Fitted;
        let (loss, diverged) = if fitted {
            let sums = self.sum_up::<true>(batch)?;
            self.move_starts(batch);
            sums
        } else {
            self.sum_up::<false>(batch)?
        };
        let mut scale = 1.0 / self.terms(batch.len());
        if fitted {
            scale *= self.adam.clipping(scale, &self.gradient);
        }
        let parameters = self.learner.network.parameters_mut();
        self.adam.step(rate, scale, &self.gradient, parameters);
        Ok((loss, diverged))
    }

    /// The summed loss of a batch and its gradient, and how many windows left the range of mechanisms; with `STARTS` also what the steps of the starts
    /// need, in the chunks.
    pub(super) fn sum_up<const STARTS: bool>(
        &mut self,
        batch: &[usize],
    ) -> Result<(f64, usize), Error> {
        let used = self.in_chunks(Part::Seen, batch, forth_and_back::<T, STARTS>)?;
        let (mut loss, mut diverged) = (0.0, 0);
        for (k, chunk) in self.chunks[..used].iter().enumerate() {
            loss += chunk.loss;
            diverged += chunk.diverged;
            match k {
                0 => self.gradient.copy_from_slice(&chunk.gradient),
                _ => Processor::here().run(Sum(&mut self.gradient, &chunk.gradient)),
            }
        }
        Ok((loss, diverged))
    }

    /// A step of the starts of a batch, after [`sum_up`](Self::sum_up).
    pub(super) fn move_starts(&mut self, batch: &[usize]) {
        let Recordings { seen, loss, .. } = &mut self.recordings;
        let used = batch.len().div_ceil(CHUNK);
        seen.improve(loss, batch, &mut self.chunks[..used]);
    }

    /// The chunk of a window of the batch that was summed up last, by its number there, and its number in the chunk.
    pub(super) fn chunk_of(&mut self, k: usize) -> (&mut Chunk<T>, usize) {
        (&mut self.chunks[k / CHUNK], k % CHUNK)
    }

    /// The typical loss a sample of the windows that are learnt from, and how many diverge, which are left out.
    ///
    /// # Errors
    /// [`Error::Mechanics`] of a state in the range of mechanisms.
    pub(super) fn seen(&mut self) -> Result<(f64, usize), Error> {
        let all: Vec<usize> = (0..self.windows()).collect();
        let (mut loss, mut diverged) = (0.0, 0);
        for batch in all.chunks(self.options.batch) {
            let used = self.in_chunks(Part::Seen, batch, Chunk::roll)?;
            for chunk in &self.chunks[..used] {
                loss += chunk.loss;
                diverged += chunk.diverged;
            }
        }
        Ok((self.typical(loss, all.len() - diverged), diverged))
    }

    /// The typical loss a sample of the windows held out, and how many diverge: they are far away. Their starts are fitted to this network first.
    ///
    /// # Errors
    /// [`Error::Mechanics`] of a state in the range of mechanisms.
    pub fn held_out(&mut self) -> Result<(f64, usize), Error> {
        let rounds = match self.options.start {
            Start::Fitted => STARTS_OF_HELD_OUT,
            Start::Measured { .. } => 0,
        };
        let all: Vec<usize> = (0..self.recordings.held_out.windows.len()).collect();
        // The same measure for all epochs.
        if let Some(far) = &mut self.recordings.loss.far {
            *far = FAR;
        }
        let (mut loss, mut diverged) = (0.0, 0);
        for round in 0..=rounds {
            (loss, diverged) = (0.0, 0);
            for batch in all.chunks(self.options.batch) {
                let work = match round == rounds {
                    true => Chunk::roll,
                    false => forth_and_back::<T, true>,
                };
                let used = self.in_chunks(Part::HeldOut, batch, work)?;
                for chunk in &self.chunks[..used] {
                    loss += chunk.loss;
                    diverged += chunk.diverged;
                }
                if round < rounds {
                    let Recordings { held_out, loss, .. } = &mut self.recordings;
                    held_out.improve(loss, batch, &mut self.chunks[..used]);
                }
            }
        }
        loss += diverged as f64 * self.lost();
        Ok((self.typical(loss, all.len()), diverged))
    }

    /// What a window counts that leaves the range of mechanisms.
    pub(super) fn lost(&self) -> f64 {
        let samples = self.terms(1);
        self.recordings.loss.of_window(samples * LOST, samples).0
    }

    /// The same of a network that gives no force.
    pub(super) fn held_out_without_network(&mut self) -> Result<f64, Error> {
        let own = self.learner.network.clone();
        let starts = self.recordings.held_out.clone();
        let last = own.shape().layers().last();
        let range = last.map_or(0..0, |layer| layer.weights..layer.biases + layer.outputs);
        self.learner.network.parameters_mut()[range].fill(T::from_f64(0.0));
        let found = self.held_out();
        self.learner.network = own;
        self.recordings.held_out = starts;
        Ok(found?.0)
    }

    /// Does a work on every chunk of a batch, in threads; their number.
    fn in_chunks(&mut self, part: Part, batch: &[usize], work: Work<T>) -> Result<usize, Error> {
        let (learner, recordings) = (&self.learner, &self.recordings);
        let setting = setting(recordings);
        let side = match part {
            Part::Seen => &recordings.seen,
            Part::HeldOut => &recordings.held_out,
        };
        let used = batch.len().div_ceil(CHUNK);
        self.chunks[..used]
            .par_iter_mut()
            .zip(batch.par_chunks(CHUNK))
            .try_for_each(|(chunk, batch)| {
                let members = members(recordings, side, batch);
                work(chunk, &setting, learner, &members[..batch.len()])
            })
            .map_err(Error::Mechanics)?;
        Ok(used)
    }

    /// The network as a force.
    pub(super) fn force(&self, network: &Mlp<T>) -> Result<LearntForce, Error> {
        LearntForce::new(
            network.convert(),
            self.learner.features.clone(),
            self.learner.outputs.clone(),
            self.options.alone,
        )
        .map_err(|e| Error::io("the network".as_ref(), std::io::Error::other(e)))
    }
}

/// What comes next in a training.
enum Next {
    Epoch,
    Polish,
}

/// The windows that are learnt from, or those held out.
#[derive(Clone, Copy)]
enum Part {
    Seen,
    HeldOut,
}

/// What is done with the windows of a chunk.
type Work<T> =
    fn(&mut Chunk<T>, &Setting<'_>, &Learner<T>, &[Member<'_>]) -> Result<(), lagrange::Error>;

/// The loss and its gradients; with `STARTS` what the steps of the starts need, too.
fn forth_and_back<T: Real, const STARTS: bool>(
    chunk: &mut Chunk<T>,
    setting: &Setting<'_>,
    learner: &Learner<T>,
    members: &[Member<'_>],
) -> Result<(), lagrange::Error> {
    chunk.forward(setting, learner, members)?;
    if STARTS {
        chunk.curve(setting, learner, members);
    }
    chunk.backward(setting, learner, members);
    Ok(())
}

/// Adds the second to the first.
struct Sum<'a, T>(&'a mut [T], &'a [T]);

impl<T: Real> WithSimd for Sum<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let (to, rest_to) = T::split_mut::<S>(self.0);
        let (from, rest_from) = T::split::<S>(self.1);
        for (to, from) in to.iter_mut().zip(from) {
            *to = T::add(s, *to, *from);
        }
        for (to, from) in rest_to.iter_mut().zip(rest_from) {
            *to = T::from_f64(to.to_f64() + from.to_f64());
        }
    }
}

fn setting(recordings: &Recordings) -> Setting<'_> {
    Setting {
        hybrid: &recordings.hybrid,
        theta: &recordings.theta,
        free: &[],
        loss: &recordings.loss,
        samples: recordings.horizon,
    }
}

/// The windows of one chunk; the first of them again and again in the places that are not needed.
fn members<'a>(recordings: &'a Recordings, side: &'a Side, batch: &[usize]) -> [Member<'a>; CHUNK] {
    std::array::from_fn(|k| recordings.member(side, *batch.get(k).unwrap_or(&batch[0])))
}

/// 2, 4, 8, …
fn is_refit(epoch: usize) -> bool {
    epoch > FIRST_REFIT && (epoch - 1).is_power_of_two()
}
