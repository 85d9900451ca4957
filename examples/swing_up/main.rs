//! Swings a pole up and holds it there with a controller that was found on a learnt model.
//!
//! ```text
//! cargo run --release -p cartpole --example swing_up
//! cargo run --release -p cartpole --example swing_up -- --seed 2 --friction strong
//! ```
//!
//! Records a log of the paper's virtual rig, trains a model on it (effects, and a network for the rest), and finds a controller on the
//! model as an environment, without the rig: a regulator about upright from the model's steps, the gains of a swing-up by the cross-entropy method. Then the
//! same controller runs on the rig as an environment, where it sees what the sensors read: a filter on the model estimates the
//! state, and the model predicts what the inputs that are still under way will make of it. Exit code 1 when the pole is not held for 5 s, or the cart strikes an end of its rail.

mod filter;
mod flight;
mod pilot;
mod plant;
mod regulator;
mod tune;

use std::error::Error;
use std::f64::consts::PI;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use cartpole::paper::{Contestant, Friction, Known, PaperRig, RigEnvironment};
use clap::{Parser, ValueEnum};
use pinode_nn::environment::{Closures, Environment, Task, Transition, Verdict, uniform};
use pinode_nn::log::Log;
use pinode_nn::model::Model;

use flight::{Flown, STEPS, fly};
use pilot::{Gains, Pilot, Pole};
use plant::Plant;
use regulator::Regulator;
use tune::tune;

/// Swings a pole up on the paper's rig with a controller from a learnt model
#[derive(Debug, Parser)]
struct Cli {
    /// Seed of the log, of the training, of the search and of the rig's noise
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Samples of the log at 50 Hz
    #[arg(long, value_name = "N", default_value_t = 6000)]
    samples: usize,
    /// Epochs of the training
    #[arg(long, value_name = "N", default_value_t = 30)]
    epochs: usize,
    /// Friction of the rig
    #[arg(long, value_enum, default_value = "mild")]
    friction: Rough,
    /// Runs on the rig, with other noise each
    #[arg(long, value_name = "N", default_value_t = 3)]
    runs: u64,
    /// Take this model instead of training one
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Take these gains instead of looking for some, in the order in which they are printed
    #[arg(long, value_name = "G1,G2,…", value_delimiter = ',')]
    gains: Option<Vec<f64>>,
    /// Folder for the log and the learnt model
    #[arg(long, value_name = "DIR", default_value = "out/swing_up")]
    out: PathBuf,
    /// Folder of the mechanism and the rig's settings
    #[arg(long, value_name = "DIR", default_value = "models/cartpole")]
    models: PathBuf,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Rough {
    /// That of the paper's Table 2
    Mild,
    /// Strong drag, and Coulomb friction that is three times larger one way than the other
    Strong,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Whether every run holds the pole.
fn run(cli: &Cli) -> Result<bool, Box<dyn Error>> {
    let friction = match cli.friction {
        Rough::Mild => Friction::Mild,
        Rough::Strong => Friction::Strong,
    };
    let rig = PaperRig::read(&cli.models.join("paper.toml"))?.with_friction(friction);
    let begun = Instant::now();
    let model = match &cli.model {
        Some(path) => Model::load(path)?,
        None => learn(cli, &rig)?,
    };
    println!("a model after {:.0} s:", begun.elapsed().as_secs_f64());
    for effect in &model.effects {
        let on = model.target_name(effect.target);
        println!("  {} on {on}: {:.4?}", effect.kind.name, effect.values);
    }
    let gains = cli.gains.as_deref().map(gains_of).transpose()?;
    let flown = control(rig, &model, gains, cli.seed, cli.runs)?;
    Ok(flown.iter().all(Flown::is_held))
}

fn gains_of(numbers: &[f64]) -> Result<Gains, Box<dyn Error>> {
    match numbers.try_into() {
        Ok(numbers) => Ok(Gains::of(numbers)),
        Err(_) => {
            let names = Gains::GUESS.map(|(name, ..)| name).join("; ");
            Err(format!("--gains has {} numbers: give {names}", numbers.len()).into())
        }
    }
}

/// Finds a controller on `model`, but for the `gains` where they are given, and runs it on the rig.
fn control(
    rig: PaperRig,
    model: &Model,
    gains: Option<Gains>,
    seed: u64,
    runs: u64,
) -> Result<Vec<Flown>, Box<dyn Error>> {
    let rail = rig.settings.rail.ok_or("the rig has no rail to stay on")?;
    let ends = [rail.left, rail.right];
    let mut on_rig = RigEnvironment::new(rig, Some(STEPS), upright_on_rail(ends, None))?;
    let [action] = on_rig.action_space() else {
        return Err("the rig has other inputs than one".into());
    };
    let (action, interval) = (action.clone(), on_rig.interval());
    let mut plant = Plant::new(model, interval)?;
    let pole = Pole::new(model);
    let regulator = Regulator::new(&mut plant, 0.5 * (ends[0] + ends[1]))?;
    let gain = regulator.gain.as_slice();
    println!("regulator: u = -{gain:.2?} (x, phi, x_dot, phi_dot)");
    let mut pilot = Pilot {
        gains: gains.unwrap_or(Gains::of(&Gains::GUESS.map(|(_, guess, _)| guess))),
        pole: &pole,
        regulator: &regulator,
        action: &action,
        ends,
        prompt: Plant::new(&without_delay(model), interval)?,
        past: Vec::new(),
        caught: false,
    };
    if gains.is_none() {
        let begun = Instant::now();
        tune(model, &mut plant, &mut pilot, interval, seed)?;
        println!("tuned in {:.0} s", begun.elapsed().as_secs_f64());
    }
    println!("{:.2?}", pilot.gains);
    let mut all = Vec::new();
    for noise in (0..runs).map(|run| 1000 * seed + run) {
        let flown = fly(&mut on_rig, model, &mut plant, &mut pilot, noise)?;
        println!("rig, noise {noise}: {flown}");
        all.push(flown);
    }
    Ok(all)
}

/// The model with inputs that act at once.
fn without_delay(model: &Model) -> Model {
    let mut model = model.clone();
    model
        .effects
        .retain(|effect| effect.kind.name != "input_delay");
    model
}

/// Records a log of the rig and learns from it.
fn learn(cli: &Cli, rig: &PaperRig) -> Result<Model, Box<dyn Error>> {
    let known = cli.models.join("paper_known.toml");
    std::fs::create_dir_all(&cli.out)?;
    let path = cli.out.join("log.csv");
    rig.record(cli.samples, cli.seed)?.log.write_csv(&path)?;
    let log = Log::read(&path, &Model::load(&known)?)?;
    println!("a log of {} samples: {}", cli.samples, path.display());
    let known = Known::of_the_cart_pole(&known)?;
    let learnt = Contestant::Ours.learn(&known, &log, &cli.out, cli.seed, Some(cli.epochs))?;
    Ok(Model::load(&learnt)?)
}

/// From hanging at rest: worth cos φ a step, less where the cart is far out. With a `margin`, m, the cart and the pole begin some way from there, and it is
/// over where the cart comes as close as that to an end of its rail.
fn upright_on_rail([left, right]: [f64; 2], margin: Option<f64>) -> impl Task {
    let centre = 0.5 * (left + right);
    let half = 0.5 * (right - left) - margin.unwrap_or(0.0);
    let spread = margin.map_or(Vec::new(), |_| vec![0.02, 0.1]);
    Closures::new(
        uniform(vec![centre, PI], spread),
        move |step: &Transition<'_>| {
            let out = (step.next[0] - centre).abs() / half;
            Verdict {
                reward: step.next[1].cos() - 0.3 * out.powi(2),
                terminated: margin.is_some() && out >= 1.0,
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A model that was not learnt but written down, without the string, and with a delay that makes up for it.
    #[test]
    fn the_pole_goes_up_on_the_rig_and_stays_there() {
        let models = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
        let path = models.join("paper_known.toml");
        let effects = "
            effect = [
                { kind = \"input_delay\", input = \"motor\", delay = 0.032 },
                { kind = \"coulomb_friction\", joint = \"slider\", force = 0.215 },
                { kind = \"viscous_friction\", joint = \"pole\", coefficient = 0.002 },
            ]\n";
        let known = std::fs::read_to_string(&path).unwrap();
        let model = Model::parse(&path, effects.to_owned() + &known).unwrap();
        let rig = PaperRig::read(&models.join("paper.toml")).unwrap();
        let gains = Gains::of(&Gains::GUESS.map(|(_, guess, _)| guess));
        for flown in control(rig, &model, Some(gains), 1, 2).unwrap() {
            assert!(flown.is_held(), "{flown}");
            assert!(
                flown.up.is_some_and(|up| up < 5.0) && flown.rms < 0.05,
                "{flown}"
            );
        }
    }
}
