//! The bench of the naming, on short logs.

use std::path::{Path, PathBuf};

use cartpole::config::NoiseLevel;
use cartpole::score::{Case, Error, Kinds, Line, Named, Rig, Set, Truth, run, tables};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn case(set: Set, seed: u64) -> Case {
    Case {
        rig: Rig::Cartpole,
        set,
        kinds: Kinds::Basic,
        noise: NoiseLevel::Low,
        seed,
        duration: Some(12),
        rate: None,
    }
}

fn line(case: &Case, threads: usize) -> Line {
    let dir = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    let mut line = pool.install(|| run(case, &models(), dir.path(), true).unwrap());
    assert_eq!(line.threads, threads);
    assert!(line.seconds > 0.0);
    // What may differ from run to run.
    (line.seconds, line.threads, line.peak_mb) = (0.0, 0, None);
    line
}

#[test]
fn the_line_of_a_log_is_the_same_for_any_number_of_threads_and_is_read_back() {
    // The first of the basic ones: viscous friction of the slider.
    let case = case(Set::One, 1001);
    let one = line(&case, 1);
    assert_eq!(one, line(&case, 2));
    assert_eq!(one.id, "cartpole/one/low/1001/basic/12s");
    assert_eq!(one.hidden.len(), 1);
    assert!(one.first_is_right(), "{one:?}");
    let errors = one.free_run.unwrap();
    assert!(
        errors.truth.is_some() && errors.after < errors.before,
        "{errors:?}"
    );

    let text = serde_json::to_string(&one).unwrap();
    assert!(!text.contains('\n'));
    assert_eq!(serde_json::from_str::<Line>(&text).unwrap(), one);
    assert!(tables(&[one]).contains("| cartpole | one | low | 1 | 1.000 ("));
}

#[test]
fn an_effect_that_is_taken_out_of_the_library_is_not_named() {
    let removed = line(&case(Set::Removed, 1001), 2);
    let kind = removed.hidden[0].kind.as_str();
    assert!(!kind.is_empty());
    assert!(removed.named.iter().all(|named| named.kind != kind));
    assert!(removed.error.is_none());
}

#[test]
fn every_set_prepares_its_logs() {
    // Logs too short for a diagnosis: the line says so, and has the truth.
    for (set, hidden) in [
        (Set::One, 1),
        (Set::Small, 1),
        (Set::Limit, 1),
        (Set::Nothing, 0),
        (Set::Pairs, 2),
        (Set::Triples, 3),
        (Set::Removed, 1),
        (Set::Dirty, 1),
        (Set::Uneven, 1),
        (Set::Forms, 1),
        (Set::WrongBase, 1),
        (Set::Suspects, 4),
    ] {
        for seed in 0..3 {
            let short = Case {
                duration: Some(2),
                kinds: Kinds::All,
                ..case(set, seed)
            };
            let line = line(&short, 1);
            assert_eq!(line.hidden.len(), hidden, "{line:?}");
            assert_eq!(line.verdict, "error");
            assert!(tables(std::slice::from_ref(&line)).contains("Diagnoses that failed"));
            let small = line.size < 1.0;
            assert_eq!(small, matches!(set, Set::Small | Set::Limit));
        }
    }
}

#[test]
fn a_set_that_a_rig_has_not_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let arm = Case {
        rig: Rig::Arm,
        ..case(Set::Dirty, 1)
    };
    let error = run(&arm, &models(), dir.path(), false).unwrap_err();
    assert!(matches!(error, Error::NoSuchSet { .. }));
    assert!(error.to_string().contains("`arm` has no set `dirty`"));
}

#[test]
fn the_cartpole_logs_at_the_rate_that_is_asked_for_and_other_rigs_say_that_they_cannot() {
    let fast = Case {
        duration: Some(2),
        rate: Some(250),
        ..case(Set::One, 1001)
    };
    let dir = tempfile::tempdir().unwrap();
    let line = run(&fast, &models(), dir.path(), false).unwrap();
    assert_eq!(line.id, "cartpole/one/low/1001/basic/2s/250Hz");
    assert!(tables(std::slice::from_ref(&line)).contains("| cartpole | one | low, 250 Hz | 1 |"));
    let rows = std::fs::read_to_string(dir.path().join("log.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 2 * 250);

    let furuta = Case {
        rig: Rig::Furuta,
        ..fast
    };
    let error = run(&furuta, &models(), dir.path(), false).unwrap_err();
    assert!(matches!(error, Error::OneRate { rig: "furuta" }));
}

/// The one that is named, and what is hidden; without a `duration` the log has the usual one.
fn named(rig: Rig, seed: u64, duration: Option<u32>) -> (Truth, Named) {
    let usual = Case {
        rig,
        kinds: Kinds::All,
        noise: NoiseLevel::Realistic,
        duration,
        ..case(Set::One, seed)
    };
    let line = line(&usual, 1);
    let ([truth], [named]) = (&line.hidden[..], &line.named[..]) else {
        panic!("{line:?}")
    };
    (truth.clone(), named.clone())
}

/// The motor of Furuta's pendulum reaches a sixteenth of what it is told: the model as given is so far off that no linearisation about its fit
/// knows the limit.
#[test]
fn an_input_that_is_cut_off_to_a_sixteenth_is_found() {
    let (truth, named) = named(Rig::Furuta, 93532, None);
    assert_eq!(truth.kind, "input_saturation");
    assert_eq!(named.kind, truth.kind, "{named:?}");
    let error = named.parameters["limit"].0 / truth.parameters["limit"] - 1.0;
    assert!(error.abs() < 1e-3, "{named:?}");
}

/// Dahl's friction, which it contains, explains nearly as much of half a log: which of the two it is, is not told for certain.
#[test]
fn friction_that_is_larger_before_it_slips_is_not_surely_dahls() {
    let (truth, named) = named(Rig::Cartpole, 93010, Some(30));
    assert_eq!(truth.kind, "lugre_friction");
    let mut alike = named.indistinguishable_from.iter().map(|name| &name.kind);
    assert!(
        named.kind == truth.kind || alike.any(|kind| *kind == truth.kind),
        "{named:?}"
    );
}
