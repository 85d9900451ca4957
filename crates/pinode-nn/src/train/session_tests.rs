//! What a session counts, and what it leaves out.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use super::session::{Epoch, Session};
use super::{Options, Training, train, unlearnt, worse_than_none};
use crate::learnt::Quantity;
use crate::log::{Channels, Log};
use crate::model::Model;
use crate::network::Real;

pub(super) const SLEDGE: &str = include_str!("../../tests/data/known_sledge.toml");

pub(super) fn sledge() -> Model {
    Model::parse("sledge.toml".as_ref(), SLEDGE.to_owned()).unwrap()
}

/// A log of 2 kg under a push that goes to and fro, without noise.
fn log(name: &str, interval: f64, duration: f64, model: &Model) -> Log {
    // x = sin t: 2 ẍ = −2 sin t.
    let motion: Motion<'_> = (&|t| t.sin(), &|t| -2.0 * t.sin());
    log_of(name, interval, duration, model, motion)
}

/// What is read of x, m, and the push, N, at a time, s.
pub(super) type Motion<'a> = (&'a dyn Fn(f64) -> f64, &'a dyn Fn(f64) -> f64);

/// A log of such a motion; the push is held from sample to sample.
pub(super) fn log_of(
    name: &str,
    interval: f64,
    duration: f64,
    model: &Model,
    (read, push): Motion<'_>,
) -> Log {
    let mut text = "t,q.x,u.push\n".to_owned();
    for k in 0..(duration / interval) as usize {
        let t = interval * k as f64;
        text += &format!("{t},{},{}\n", read(t), push(t + 0.5 * interval));
    }
    let channels = Channels {
        coordinates: model.mechanics.coordinates(),
        velocities: &[false],
        inputs: &["push"],
        columns: &model.columns,
    };
    Log::parse(Path::new(name), text.as_bytes(), &channels).unwrap()
}

fn on<'a>(model: &'a Model, logs: &'a [Log]) -> Training<'a> {
    Training {
        model,
        logs,
        held_out: &[],
    }
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
    let training = on(&model, &logs);
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

/// Of a log of 50 Hz and one of 10 Hz every interval of the slow one counted as a gap: it was not used, and nobody heard of it.
#[test]
fn logs_of_different_rates_are_refused_by_their_names_and_intervals() {
    let model = sledge();
    let [fast, slow] = [("fast.csv", 0.02), ("slow.csv", 0.1)]
        .map(|(name, interval)| log(name, interval, 40.0, &model));
    let refusal = |logs: &[Log], held_out: &[Log]| {
        let training = Training {
            model: &model,
            logs,
            held_out,
        };
        let refused = Session::<f64>::new(&training, &options()).err();
        refused.map_or(String::new(), |e| e.to_string())
    };
    let both = [fast.clone(), slow.clone()];
    for words in [refusal(&both, &[]), refusal(&both[..1], &both[1..])] {
        assert!(
            words.contains("0.020000 s in run `0` of fast.csv")
                && words.contains("0.100000 s in run `0` of slow.csv"),
            "{words}"
        );
    }
    // One of them alone is all right.
    assert_eq!(refusal(&[slow], &[]), "");
}

#[test]
fn a_recording_without_a_window_is_named() {
    let model = sledge();
    let [long, mut short] = [("long.csv", 20.0), ("short.csv", 0.3)]
        .map(|(name, duration)| log(name, 0.02, duration, &model));
    short.runs[0].id = "hop".to_owned();
    let logs = [long, short];
    let training = on(&model, &logs);
    let options = options();
    let session = Session::<f64>::new(&training, &options).unwrap();
    let [warning] = session.recordings.left_out.as_slice() else {
        panic!("one recording is left out")
    };
    assert!(
        warning.contains("run `hop` of short.csv is not used"),
        "{warning}"
    );
}

#[test]
fn what_is_held_out_is_named_where_it_is_too_short() {
    let model = sledge();
    let logs = [log("log.csv", 0.02, 8.0, &model)];
    let training = on(&model, &logs);
    let refused = |horizon: f64| {
        let options = Options {
            horizon,
            ..options()
        };
        let refused = Session::<f64>::new(&training, &options).err();
        refused.map_or(String::new(), |e| e.to_string())
    };
    let words = refused(2.0);
    assert!(words.contains("fits into the last eighth"), "{words}");
    // The eighth is 1 s long: none of the windows from the beginning on lies in it, and yet one fits.
    assert_eq!(refused(0.9), "");
    let words = refused(0.0);
    assert!(words.contains("the length of a window is 0"), "{words}");
}

#[test]
fn what_is_held_out_says_little_where_it_rests() {
    let model = sledge();
    let said = |read: &dyn Fn(f64) -> f64| {
        let logs = [log_of("log.csv", 0.02, 40.0, &model, (read, &|_| 0.0))];
        let training = on(&model, &logs);
        let options = options();
        let session = Session::<f64>::new(&training, &options).unwrap();
        session.recordings.rests_in_the_end()
    };
    assert_eq!(said(&|t| (3.0 * t).sin()), None);
    let words = said(&|t| (-t / 5.0).exp() * (3.0 * t).sin()).unwrap_or_default();
    assert!(
        words.contains("hardly moves") && words.contains("--holdout"),
        "{words}"
    );
}

/// Held out once and learnt from as well it would say that a network knows what it has not seen.
#[test]
fn a_log_is_not_learnt_from_twice_and_its_errors_are_said_to_be_those_of_what_was_seen() {
    let model = sledge();
    let (own, other) = (
        log("own.csv", 0.02, 20.0, &model),
        log("other.csv", 0.02, 21.0, &model),
    );
    let (logs, same) = ([own.clone()], [own.clone()]);
    let options = Options {
        epochs: 1,
        ..options()
    };
    let trained = |held_out: &[Log]| {
        let training = Training {
            model: &model,
            logs: &logs,
            held_out,
        };
        train(&training, &options, None, &mut |_| Ok(()))
    };
    let refused = trained(&same)
        .err()
        .map_or(String::new(), |e| e.to_string());
    assert!(refused.contains("own.csv"), "{refused}");
    let dir = tempfile::tempdir().unwrap();
    let path = trained(&[]).unwrap().write(&model, dir.path()).unwrap();
    let learnt = Model::load(&path).unwrap();
    let said = learnt
        .has_learnt_from([&own, &other].into_iter())
        .unwrap_or_default();
    assert!(
        said.contains("own.csv") && !said.contains("other.csv"),
        "{said}"
    );
    assert_eq!(learnt.has_learnt_from([&other].into_iter()), None);
    assert_eq!(model.has_learnt_from([&own].into_iter()), None);
}

#[test]
fn a_network_that_leaves_far_more_than_noise_is_told_what_could_help() {
    let epoch = |epoch: usize, held_out: f64| Epoch {
        epoch,
        loss: held_out,
        held_out,
        diverged: 0,
        held_out_diverged: 0,
        rate: 1e-3,
        polish: false,
    };
    let unseen = ["v.x", "q.x"].map(str::to_owned);
    let said =
        |best: Epoch, options: &Options| unlearnt(&best, options, &unseen).unwrap_or_default();
    let options = options();
    let at_the_end = said(epoch(300, 20.4), &options);
    assert!(
        at_the_end.contains("20.4 squares of the noise") && at_the_end.contains("--epochs"),
        "{at_the_end}"
    );
    assert!(at_the_end.contains("--sees v.x q.x"), "{at_the_end}");
    assert!(!said(epoch(100, 20.4), &options).contains("--epochs"));
    assert_eq!(said(epoch(300, 1.3), &options), "");
    // The paper's loss is no multiple of the noise.
    assert_eq!(said(epoch(100, 20.4), &Options::paper(vec![0])), "");
}

#[test]
fn an_angle_that_wraps_is_seen_by_its_cosine_and_sine_alone() {
    let turns = SLEDGE.replace("coordinates", "angles = [\"x\"]\ncoordinates");
    let model = Model::parse("wheel.toml".as_ref(), turns).unwrap();
    let logs = [log("log.csv", 0.02, 20.0, &model)];
    let training = on(&model, &logs);
    let refused = |quantities: &[Quantity]| {
        let options = Options {
            quantities: quantities.to_vec(),
            ..options()
        };
        let refused = Session::<f64>::new(&training, &options).err();
        refused.map_or(String::new(), |e| e.to_string())
    };
    let words = refused(&[Quantity::Velocity(0), Quantity::Position(0)]);
    assert!(
        words.contains("let it see cos(q.x) and sin(q.x)"),
        "{words}"
    );
    assert_eq!(refused(&[Quantity::Cosine(0), Quantity::Sine(0)]), "");
}

/// It was written without a word.
#[test]
fn a_network_that_is_worse_than_none_is_warned_of() {
    let epoch = Epoch {
        epoch: 1,
        loss: 1.0,
        held_out: 236_110.0,
        diverged: 0,
        held_out_diverged: 0,
        rate: 1e-3,
        polish: false,
    };
    let words = worse_than_none(Some(&epoch), Some(3.5)).unwrap();
    let said = "held out 236110.0000 with it, 3.5000 without";
    assert!(words.contains(said), "{words}");
    assert_eq!(worse_than_none(Some(&epoch), None), None);
    assert_eq!(worse_than_none(Some(&epoch), Some(3e5)), None);
}

/// From fitted and from measured starts, in both precisions; an evaluation of what is held out as well.
#[test]
fn steps_of_training_allocate_nothing() {
    fn taken<T: Real>(training: &Training<'_>, options: &Options) -> [u64; 2] {
        let mut session = Session::<T>::new(training, options).unwrap();
        let batch: Vec<usize> = (0..options.batch).collect();
        session.step(&batch, 1e-3).unwrap();
        session.held_out().unwrap();
        let count = |work: &mut dyn FnMut()| allocation_counter::measure(work).count_total;
        let steps = count(&mut || {
            for _ in 0..5 {
                session.step(&batch, 1e-3).unwrap();
            }
        });
        let held_out = count(&mut || {
            session.held_out().unwrap();
        });
        [steps, held_out]
    }
    let model = sledge();
    let logs = [log("log.csv", 0.02, 60.0, &model)];
    let training = on(&model, &logs);
    let fitted = Options {
        batch: 100,
        ..options()
    };
    let published = Options {
        batch: 100,
        units: vec![8],
        ..Options::paper(vec![0])
    };
    // What threads hand to each other is theirs.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.unwrap().install(|| {
        for options in [&fitted, &published] {
            // The list of all windows held out.
            assert_eq!(taken::<f64>(&training, options), [0, 1]);
            assert_eq!(taken::<f32>(&training, options), [0, 1]);
        }
    });
}

/// Groups of a chunk beyond the windows of a batch kept the adjoints of the batch before: the last batch of an epoch learnt from it again.
#[test]
fn the_gradient_of_a_batch_does_not_depend_on_the_one_before() {
    let model = sledge();
    let logs = [log("log.csv", 0.02, 40.0, &model)];
    let training = on(&model, &logs);
    let options = options();
    let gradient_after = |before: Option<usize>| {
        let mut session = Session::<f64>::new(&training, &options).unwrap();
        if let Some(windows) = before {
            let batch: Vec<usize> = (0..windows).collect();
            session.sum_up::<true>(&batch).unwrap();
        }
        session.sum_up::<true>(&[40, 41, 42]).unwrap();
        session.gradient.clone()
    };
    let alone = gradient_after(None);
    assert!(alone.iter().any(|g| *g != 0.0));
    assert_eq!(gradient_after(Some(options.batch)), alone);
}
