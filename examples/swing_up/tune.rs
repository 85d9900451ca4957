//! The gains of the swing-up by the cross-entropy method, on the learnt model as an environment.
//!
//! Gains are drawn from a normal distribution, each draw runs two episodes from different starts, and mean and deviation of the best ones are the
//! next distribution; the best of all stays among them.

use std::error::Error;

use pinode_nn::environment::{Environment, ModelEnvironment};
use pinode_nn::model::Model;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::pilot::{Gains, Pilot};
use super::plant::{Plant, State, settings};
use super::upright_on_rail;

const GENERATIONS: usize = 3;
const DRAWS: usize = 16;
const BEST: usize = 4;
/// The distribution does not get narrower than this share of the first.
const NARROWEST: f64 = 0.1;
/// Episodes that each draw is judged by.
const STARTS: u64 = 2;
/// Length of an episode, samples.
const STEPS: usize = 350;
/// The model's cart keeps so far from the ends of the rail, m.
const MARGIN: f64 = 0.06;
/// What a step is worth after the cart has left the rail.
const LOST: f64 = -2.0;

/// Sets the gains of `pilot`.
pub fn tune(
    model: &Model,
    plant: &mut Plant,
    pilot: &mut Pilot<'_>,
    interval: f64,
    seed: u64,
) -> Result<(), Box<dyn Error>> {
    let action = std::slice::from_ref(pilot.action);
    let settings = settings(action, interval, Some(STEPS));
    let mut environment =
        ModelEnvironment::new(model, settings, upright_on_rail(pilot.ends, Some(MARGIN)))?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut mean = Gains::GUESS.map(|(_, guess, _)| guess);
    let mut deviation = Gains::GUESS.map(|(_, _, spread)| spread);
    let mut best: Vec<(f64, [f64; 5])> = Vec::new();
    for generation in 1..=GENERATIONS {
        // The best of all is kept, and the mean is tried.
        best.truncate(1);
        for draw in 0..DRAWS {
            let mut gains = mean;
            if draw > 0 {
                for (gain, deviation) in gains.iter_mut().zip(deviation) {
                    let away: f64 = random.sample(StandardNormal);
                    *gain = (*gain + deviation * away).max(0.0);
                }
            }
            pilot.gains = Gains::of(&gains);
            let mut worth = 0.0;
            for start in 0..STARTS {
                worth += episode(&mut environment, plant, pilot, start)? / STARTS as f64;
            }
            best.push((worth, gains));
        }
        best.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        println!(
            "generation {generation}: worth {:.3} a step at best, {:.3} in the middle",
            best[0].0,
            best[DRAWS / 2].0
        );
        pilot.gains = Gains::of(&best[0].1);
        best.truncate(BEST);
        for (i, (_, _, first)) in Gains::GUESS.into_iter().enumerate() {
            let over = |f: &dyn Fn(f64) -> f64| {
                best.iter().map(|(_, gains)| f(gains[i])).sum::<f64>() / best.len() as f64
            };
            let middle = over(&|x| x);
            mean[i] = middle;
            deviation[i] = over(&|x| (x - middle).powi(2))
                .sqrt()
                .max(NARROWEST * first);
        }
    }
    Ok(())
}

/// What an episode is worth a step.
fn episode(
    environment: &mut impl Environment,
    plant: &mut Plant,
    pilot: &mut Pilot<'_>,
    start: u64,
) -> Result<f64, Box<dyn Error>> {
    pilot.begin();
    let mut state = environment.reset(Some(start))?;
    let mut worth = 0.0;
    for k in 0..STEPS {
        let force = pilot.command(plant, &State::from_row_slice(&state))?;
        let step = environment.step(&[force])?;
        worth += step.reward;
        if step.terminated {
            worth += LOST * (STEPS - 1 - k) as f64;
            break;
        }
        state = step.observation;
    }
    Ok(worth / STEPS as f64)
}
