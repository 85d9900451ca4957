//! What a session counts, and what it leaves out.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use super::session::Session;
use super::{Options, Training};
use crate::log::{Channels, Log};
use crate::model::Model;

const SLEDGE: &str = include_str!("../../tests/data/known_sledge.toml");

fn sledge() -> Model {
    Model::parse("sledge.toml".as_ref(), SLEDGE.to_owned()).unwrap()
}

/// A log of 2 kg under a push that goes to and fro, without noise.
fn log(name: &str, interval: f64, duration: f64, model: &Model) -> Log {
    let mut text = "t,q.x,u.push\n".to_owned();
    for k in 0..(duration / interval) as usize {
        let t = interval * k as f64;
        // x = sin t: 2 ẍ = −2 sin t, held from sample to sample.
        text += &format!("{t},{},{}\n", t.sin(), -2.0 * (t + 0.5 * interval).sin());
    }
    let channels = Channels {
        coordinates: model.mechanics.coordinates(),
        velocities: &[false],
        inputs: &["push"],
        columns: &model.columns,
    };
    Log::parse(Path::new(name), text.as_bytes(), &channels).unwrap()
}

fn options() -> Options {
    Options {
        units: vec![8],
        single: false,
        ..Options::new(vec![0])
    }
}

/// Windows held out that diverged were left out of the loss: a network that lost them all had none.
#[test]
fn windows_held_out_that_diverge_count_as_far_away() {
    let model = sledge();
    let logs = [log("log.csv", 0.02, 40.0, &model)];
    let training = Training {
        model: &model,
        logs: &logs,
        held_out: &[],
    };
    let options = options();
    let mut session = Session::<f64>::new(&training, &options).unwrap();
    let (near, none) = session.held_out().unwrap();
    assert_eq!(none, 0);
    session.learner.outputs[0].scale = 1e12;
    let (far, all) = session.held_out().unwrap();
    assert_eq!(all, session.windows_held_out());
    assert!(
        (far / 1e12 - 1.0).abs() < 1e-6 && near < 1e6,
        "{far} {near}"
    );
}
