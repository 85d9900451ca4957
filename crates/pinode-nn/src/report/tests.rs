use std::collections::BTreeMap;

use super::*;
use crate::diagnose::curves::{FreeRun, FreeRunCoordinate, Profile, ResidualForce};
use crate::diagnose::sketch::{Sketch, SketchedJoint};
use crate::diagnose::verdict::*;

fn evidence() -> Evidence {
    Evidence {
        z_fit: 14.2,
        z_held_out: 8.1,
        gain_fit: 2.31,
        gain_held_out: 2.28,
        relief: 0.4,
    }
}

/// A force on the slider that falls with the cube of its velocity.
pub(super) fn unexplained(follows: Option<&str>) -> Unexplained {
    let at: Vec<f64> = (0..24).map(|k| 0.1 * (f64::from(k) - 11.5)).collect();
    Unexplained {
        coordinate: "slider".into(),
        follows: follows.map(str::to_owned),
        rms: 0.3,
        unit: "N".into(),
        depends_on: vec![SharedSignal {
            signal: "velocity of slider".into(),
            unit: "m/s".into(),
            share: 0.7,
        }],
        together_with: None,
        odd_share: Some(0.9),
        memory: Memory::default(),
        curve: ForceCurve {
            signal: "velocity of slider".into(),
            unit: "m/s".into(),
            force: at.iter().map(|v| -v.powi(3)).collect(),
            std: vec![0.01; at.len()],
            at,
        },
        nearest: Vec::new(),
        learnt: None,
        sentences: vec!["On `slider` a force of 0.300 N is unexplained.".into()],
    }
}

fn name(kind: &str, target: &str) -> Name {
    Name {
        kind: kind.into(),
        target: target.into(),
    }
}

fn screened(kind: &str, target: &str, gain: f64) -> ScreenedName {
    ScreenedName {
        kind: kind.into(),
        target: target.into(),
        gain,
        t2: 90.0 * gain,
    }
}

/// A slider whose Coulomb friction the model did not have.
pub(super) fn diagnosis(slider: &str) -> Diagnosis {
    let gap = |name: &str, unit: &str, before, after, noise| CoordinateGap {
        name: format!("q.{name}"),
        unit: unit.into(),
        before,
        after,
        expected: 1.02,
        noise_floor: 1.0,
        noise,
    };
    let place = |coordinate: &str, share, unit: &str| Disagreement {
        coordinate: coordinate.into(),
        share,
        rms: 0.41 * share,
        unit: unit.into(),
        r#where: format!("follows the velocity of {slider} (83 % of its variance)"),
        when: vec![[12.1, 14.0], [30.0, 31.5]],
    };
    Diagnosis {
        verdict: Verdict::EffectsFound,
        disagreement: vec![place(slider, 0.97, "N"), place("pole", 0.03, "N·m")],
        effects: vec![NamedEffect {
            beside_fixed: false,
            kind: "coulomb_friction".into(),
            target: slider.into(),
            confidence: 0.98,
            parameters: BTreeMap::from([(
                "force".into(),
                ParameterValue {
                    value: 0.3124,
                    std: Some(0.0104),
                    unit: "N".into(),
                },
            )]),
            alternatives: vec![Alternative {
                kind: "stribeck_friction".into(),
                target: slider.into(),
                confidence: 0.02,
            }],
            indistinguishable_from: vec![name("asymmetric_coulomb_friction", slider)],
            experiments: Vec::new(),
            evidence: evidence(),
        }],
        gap: Gap {
            horizon_s: 0.6,
            windows: 24,
            coordinates: vec![
                gap(slider, "m", 16.1, 1.12, 1e-3),
                gap("pole", "rad", 7.4, 1.04, 2e-3),
            ],
            before: 12.3,
            after: 1.1,
            expected: 1.02,
            noise_floor: 1.0,
            horizons: [(0.1, 2.13, 1.07), (0.6, 12.3, 1.1), (2.0, 47.9, 1.31)]
                .map(|(horizon_s, before, after)| Horizon {
                    horizon_s,
                    windows: 24,
                    diverged: usize::from(horizon_s > 1.0),
                    before,
                    after,
                    expected: 1.0 + 0.03 * horizon_s,
                })
                .to_vec(),
            regions: vec![Region {
                coordinate: slider.into(),
                signal: format!("velocity of {slider}"),
                unit: "m/s".into(),
                ranges: vec![[-0.413, -0.057], [0.061, 0.397]],
                force_share: 0.913,
                time_share: 0.835,
                inside: RegionErrors {
                    before: 17.7,
                    after: 1.13,
                    samples: 5010,
                },
                outside: RegionErrors {
                    before: 9.41,
                    after: 1.09,
                    samples: 990,
                },
            }],
        },
        residuals: vec![Residual {
            name: "q.slider".into(),
            before: 12.0,
            after: 1.05,
            strays: [0.4, 0.0],
        }],
        data_faults: vec![DataFault {
            kind: "outliers".into(),
            column: "q.pole".into(),
            when: (0..9).map(|k| [f64::from(k), f64::from(k)]).collect(),
            detail: "9 of 3000 samples stand alone; they are left out of all fits".into(),
        }],
        excitation: Excitation {
            sentences: vec!["`slider` moves from -0.2 to 0.2 m.".into()],
            alike: vec![Alike {
                target: slider.into(),
                kinds: ["linear_spring".into(), "cubic_spring".into()],
                correlation: 0.967,
            }],
            ..Excitation::default()
        },
        unexplained: None,
        advice: vec![format!(
            "Drive {slider} slowly both ways, with equal inputs."
        )],
        constants: vec![FittedConstant {
            name: "mass of cart".into(),
            given: 0.466,
            fitted: 0.4689,
            std: Some(0.0021),
            tolerance: 0.00233,
        }],
        numerics: Numerics::default(),
        change: None,
        search: vec![
            SearchStep {
                screened: vec![
                    screened("coulomb_friction", slider, 2.4),
                    screened("stribeck_friction", slider, 2.39),
                    screened("input_delay", "motor", 0.4),
                ],
                refined: vec![
                    RefinedName {
                        names: vec![name("coulomb_friction", slider)],
                        evidence: evidence(),
                        wins: 0.98,
                        accepted: true,
                        numerical: false,
                    },
                    RefinedName {
                        names: vec![
                            name("quadratic_drag", slider),
                            name("viscous_friction", "pole"),
                        ],
                        evidence: evidence(),
                        wins: 0.0,
                        accepted: false,
                        numerical: true,
                    },
                    RefinedName {
                        names: vec![name("stribeck_friction", slider)],
                        evidence: evidence(),
                        wins: 0.02,
                        accepted: false,
                        numerical: false,
                    },
                    RefinedName {
                        names: vec![name("input_delay", "motor")],
                        evidence: Evidence {
                            z_held_out: 0.317,
                            gain_held_out: 0.0042,
                            ..evidence()
                        },
                        wins: 0.0,
                        accepted: false,
                        numerical: false,
                    },
                ],
            },
            SearchStep {
                screened: vec![screened("input_delay", "motor", 0.002)],
                refined: vec![],
            },
        ],
        provenance: Provenance {
            version: "0.1.0".into(),
            model: "models/cartpole/cartpole.toml".into(),
            logs: vec![LogProvenance {
                path: "logs/run1.csv".into(),
                sha256: "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08".into(),
                held_out: false,
            }],
            seed: 7,
            windows: [72, 24],
            window_s: 0.6,
            substeps: 2,
        },
    }
}

/// A chirp that the model before runs away from, and friction against the velocity.
pub(super) fn curves(slider: &str) -> Curves {
    let run = |index: usize| {
        let start = 45.0 + index as f64;
        let t: Vec<f64> = (0..900)
            .map(|k| start - 0.3 + 0.001 * f64::from(k))
            .collect();
        let away = |t: f64, by: f64| by * (t - start).max(0.0).powi(2);
        let drawn = |by: f64| FreeRunCoordinate {
            measured: t
                .iter()
                .map(|t| 0.1 * (7.0 * t).sin() + 1e-3 * (1e5 * t).sin())
                .collect(),
            before: t
                .iter()
                .map(|&t| 0.1 * (7.0 * t).sin() + away(t, by))
                .collect(),
            after: t
                .iter()
                .map(|&t| 0.1 * (7.0 * t).sin() + away(t, 0.03 * by))
                .collect(),
            of_start: vec![0.2; t.len()],
            counts: t.iter().map(|&t| t > start).collect(),
        };
        FreeRun {
            run: 0,
            start,
            coordinates: vec![drawn(0.1 + 0.01 * index as f64), drawn(-0.2)],
            t: t.clone(),
        }
    };
    let t: Vec<f64> = (0..6000).map(|k| 0.01 * f64::from(k)).collect();
    let v: Vec<f64> = t
        .iter()
        .map(|t| 0.4 * (2.0 * t + 0.02 * t * t).cos())
        .collect();
    let force = v
        .iter()
        .zip(&t)
        .map(|(v, t)| -0.31 * (v / 0.01).tanh() + 0.1 * (12345.6 * t).sin())
        .collect();
    let profile = |signal: String| Profile {
        signal,
        unit: "m/s".into(),
        ranges: (0..12).map(|b| [f64::from(b), f64::from(b + 1)]).collect(),
        force: (0..12).map(|b| if b < 6 { 0.31 } else { -0.31 }).collect(),
    };
    Curves {
        sketch: Some(sketch(slider)),
        free_runs: (0..5).map(run).collect(),
        residuals: vec![ResidualForce {
            coordinate: slider.into(),
            unit: "N".into(),
            run: vec![0; t.len()],
            t,
            force,
            explained_by: vec![
                (format!("velocity of {slider}"), 0.83),
                ("change of input motor over 80 ms".into(), 0.21),
                ("time".into(), -0.01),
            ],
            best_signal: (format!("velocity of {slider}"), "m/s".into(), v),
            profiles: vec![
                profile(format!("velocity of {slider}")),
                profile("change of input motor over 80 ms".into()),
            ],
        }],
    }
}

/// A cart on its rail, its pole upright.
fn sketch(slider: &str) -> Sketch {
    let joint = |name: &str, rail| SketchedJoint {
        name: name.into(),
        coordinate: name.into(),
        at: [0.05, 0.0],
        rail,
    };
    Sketch {
        view: "seen from the side, gravity pulls down".into(),
        moment: (0, 17.25),
        links: vec![[[0.05, 0.0], [0.06, 0.2]]],
        joints: vec![
            joint(slider, Some([[-0.2, 0.0], [0.2, 0.0]])),
            joint("pole", None),
        ],
        masses: vec![
            ([0.05, 0.0], "cart".into(), 0.466),
            ([0.055, 0.1], slider.into(), 0.06),
        ],
        paths: vec![(0..50).map(|k| [0.004 * f64::from(k) - 0.1, 0.1]).collect()],
    }
}

const MODEL: &str =
    "name = \"cart-pole\"\n[[effect]]\nkind = \"coulomb_friction\"\nforce = 0.312\n";
const COMMAND: &str =
    "pinode diagnose models/cartpole/cartpole.toml logs/run1.csv --seed 7 --out out";

/// The report as text, and what of it is not plotly.js.
fn written(diagnosis: &Diagnosis, curves: &Curves) -> (String, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), diagnosis, curves, MODEL, COMMAND).unwrap();
    assert_eq!(path, dir.path().join("report.html"));
    let all = std::fs::read_to_string(path).unwrap();
    let own = all.replace(&figures::script(), "");
    assert!(own.len() < all.len());
    (all, own)
}

#[test]
fn the_report_says_the_verdict_and_everything_it_rests_on() {
    let (_, own) = written(&diagnosis("slider"), &curves("slider"));
    for said in [
        "Coulomb friction on `slider` is missing: 0.312 ± 0.010 N (98 % for it or asymmetric Coulomb friction on `slider`). \
         Free-run error on unseen data falls from 12.3 to 1.10 times the sensor noise; the noise and the uncertain starts alone make 1.02, and more where friction sticks.",
        "asymmetric Coulomb friction on slider",
        "follows the velocity of slider (83 % of its variance)",
        "97 % of the disagreement",
        "quadratic drag on slider and viscous friction on pole",
        "not added: its gain is numerical",
        "step 1: its gain is numerical: it goes when the integration steps are halved",
        "step 1: Coulomb friction on slider explains the windows better; it wins in 98 % of the resamplings",
        "step 1: no gain out of sample: 0.00420 nats per sample on windows held out, z 0.317",
        "linear spring and cubic spring on slider (correlation of what they move: 0.967)",
        "0.292 to 0.333 N",
        "at t = 17.2 s of recording 1",
        r"slider: \u003cb\u003eCoulomb friction\u003c/b\u003e",
        "mass of cart",
        "0.4689 ± 0.0021",
        "and 3 more",
        "Drive slider slowly both ways",
        "9f86d081884c7d65",
        "--seed 7",
        "force = 0.312",
        "median improvement",
        "largest error left",
    ] {
        assert!(own.contains(said), "{said}");
    }
    assert!(!own.contains("coulomb_friction on"));
    assert_eq!(own.matches("Plotly.newPlot").count(), 2 * 2 + 4 + 2);
}

/// All finite numbers of a JSON value, but for those under the keys `without`.
fn numbers(value: &serde_json::Value, without: &[&str], out: &mut Vec<f64>) {
    match value {
        serde_json::Value::Number(n) => out.extend(n.as_f64()),
        serde_json::Value::Array(all) => all.iter().for_each(|v| numbers(v, without, out)),
        serde_json::Value::Object(all) => all
            .iter()
            .filter(|(key, _)| !without.contains(&key.as_str()))
            .for_each(|(_, v)| numbers(v, without, out)),
        _ => {}
    }
}

#[test]
fn the_numbers_of_the_report_are_those_of_the_document() {
    use super::words::{number, percent, short};
    let diagnosis = diagnosis("slider");
    let document = serde_json::to_value(&diagnosis).unwrap();
    let (_, own) = written(&diagnosis, &curves("slider"));
    // Only what stands on the page, not what the scripts draw.
    let text: String = own
        .split("<script")
        .map(|part| match part.split_once("</script>") {
            Some((_, rest)) => rest,
            None => part,
        })
        .collect();
    for part in ["gap", "residuals", "disagreement", "constants"] {
        // Errors of constants and counts of samples are said with others, or not.
        let mut said = Vec::new();
        numbers(
            &document[part],
            &["std", "samples", "when", "fitted"],
            &mut said,
        );
        assert!(!said.is_empty(), "{part}");
        for x in said {
            let forms = [number(x), short(x), percent(x)];
            assert!(forms.iter().any(|form| text.contains(form)), "{part}: {x}");
        }
    }
    let mut changed = diagnosis.clone();
    changed.gap.horizons[1].after = 7.77;
    changed.gap.regions[0].inside.after = 6.66;
    changed.residuals[0].after = 5.55;
    let (_, other) = written(&changed, &curves("slider"));
    for x in ["7.77", "6.66", "5.55"] {
        assert!(other.contains(x) && !text.contains(x), "{x}");
    }
}

#[test]
fn a_name_that_was_not_added_has_its_reason() {
    use super::ruled_out::{reason, ruled_out};
    let mut d = diagnosis("slider");
    // The scores' order: what stands before the accepted name has the higher score, and more constants.
    d.search[0].refined.swap(0, 2);
    assert_eq!(
        reason(&d.search[0], 0),
        "Coulomb friction on slider does as well, with fewer constants or with what was added after it"
    );
    d.search[0].refined[0].evidence.z_fit = 3.0;
    assert!(reason(&d.search[0], 0).starts_with("no gain that counts"));
    d.search[0].refined[2].accepted = false;
    d.search[0].refined[0].evidence = evidence();
    assert!(reason(&d.search[0], 0).starts_with("it was not kept"));
    // What was found in the end was not ruled out.
    assert!(ruled_out(&d).iter().all(|r| !r.name.starts_with("Coulomb")));
    assert_eq!(ruled_out(&d).len(), 3);
}

#[test]
fn the_report_needs_no_network() {
    let (all, own) = written(&diagnosis("slider"), &curves("slider"));
    for outside in [
        "src=\"", "href=\"", "url(", "@import", "http://", "https://",
    ] {
        assert!(!own.contains(outside), "{outside}");
    }
    assert!(own.contains("default-src 'none'")); // what plotly.js might load, the browser refuses
    assert_eq!(all.matches("plotly.js v").count(), 1);
}

#[test]
fn names_from_files_are_text_and_never_markup() {
    let hostile = "</script><script>alert('1')</script><img src=x onerror=\"a()\">&lt;b&gt;";
    let mut diagnosis = diagnosis(hostile);
    diagnosis.provenance.model = hostile.into();
    diagnosis.provenance.logs[0].path = hostile.into();
    diagnosis.data_faults[0].detail = hostile.into();
    diagnosis.constants[0].name = hostile.into();
    let dir = tempfile::tempdir().unwrap();
    let path = write(dir.path(), &diagnosis, &curves(hostile), hostile, hostile).unwrap();
    let own = std::fs::read_to_string(path)
        .unwrap()
        .replace(&figures::script(), "");
    assert!(!own.contains("<script>alert") && !own.contains("<img"));
    assert!(own.contains("&#60;script&#62;alert"));
    // One script a figure and the last one, and the names in it cannot end it.
    let scripts = own.matches("<script").count();
    assert_eq!(scripts, own.matches("</script>").count());
    assert_eq!(scripts, own.matches("Plotly.newPlot").count() + 1);
}

#[test]
fn what_was_not_measured_or_diverged_is_left_out() {
    let (_, own) = written(&diagnosis("slider"), &Curves::default());
    assert_eq!(own.matches("Plotly.newPlot").count(), 1); // the horizons
    assert!(own.contains("There is no picture"));

    let mut curves = curves("slider");
    for run in &mut curves.free_runs {
        run.coordinates[0].before.clear();
        run.coordinates[1].after[800] = f64::NAN;
    }
    curves.residuals[0].force.fill(f64::NAN);
    curves.residuals[0].explained_by.clear();
    curves.residuals[0].profiles[0].force.fill(f64::NAN);
    curves.residuals[0].profiles.truncate(1);
    curves.sketch = None;
    let mut diagnosis = diagnosis("slider");
    diagnosis.gap.before = f64::INFINITY;
    diagnosis.gap.coordinates[0].before = f64::INFINITY;
    diagnosis.gap.horizons[2].before = f64::INFINITY;
    diagnosis.constants[0].given = 0.0;
    diagnosis.effects[0].parameters.clear();
    let (_, own) = written(&diagnosis, &curves);
    assert!(own.contains("Free runs on unseen data diverged; now their error is 1.10"));
    assert!(own.contains("error diverges before"));
    assert!(!own.contains("NaN") && !own.contains("inf "));
    assert_eq!(own.matches("Plotly.newPlot").count(), 4);
}

/// What moves over this range.
fn excited(range: [f64; 2]) -> CoordinateExcitation {
    CoordinateExcitation {
        name: "slider".into(),
        unit: "m".into(),
        range,
        speed: 0.1,
        reversals: 5,
        mean_frequency: 1.0,
    }
}

#[test]
fn every_verdict_is_a_sentence() {
    let mut d = diagnosis("slider");
    let found = std::mem::take(&mut d.effects);

    d.verdict = Verdict::NothingMissing;
    d.gap.before = 1.02;
    d.gap.after = 1.02;
    assert_eq!(
        verdict_in_words(&d),
        "Nothing is missing: the model explains the data. Free-run error on unseen data is 1.02 times the sensor noise; the noise and the uncertain starts alone make 1.02."
    );
    // Of a log that does not leave the noise of its sensors nothing is said.
    let noise = d.gap.coordinates[0].noise;
    d.excitation.coordinates = vec![excited([0.0, 9.0 * noise])];
    assert!(verdict_in_words(&d).starts_with("The log hardly moves"));
    d.excitation.coordinates = vec![excited([0.0, 11.0 * noise])];
    assert!(verdict_in_words(&d).starts_with("Nothing is missing"));
    // Nor of a gap that was not measured.
    let measured = d.gap.clone();
    (d.gap.windows, d.gap.before, d.gap.after) = (0, f64::NAN, f64::NAN);
    assert!(verdict_in_words(&d).ends_with("no gap is measured."));
    assert!(serde_json::to_value(&d.gap).unwrap()["after"].is_null());
    d.gap = measured;
    d.constants[0].fitted = 0.49;
    d.constants[0].tolerance = 0.005;
    assert!(verdict_in_words(&d).starts_with(
        "Nothing is missing: the model explains the data when the mass of cart is 0.4900 ± 0.0021."
    ));
    // Far, within a wide tolerance, is worth a word too.
    for (fitted, far) in [(0.49, false), (0.36, true)] {
        d.constants[0].fitted = fitted;
        d.constants[0].tolerance = 0.2;
        assert_eq!(verdict_in_words(&d).contains(" when the mass"), far);
    }
    let mut beside = d.clone();
    (beside.verdict, beside.effects) = (Verdict::EffectsFound, found.clone());
    let mut left = unexplained(None);
    left.learnt = Some(Learnt {
        weights: "network.safetensors".into(),
        coordinates: vec!["slider".into(), "pole".into()],
        shares_with: Vec::new(),
        without: 9.0,
        with: 1.2,
        law: None,
        more_laws: Vec::new(),
    });
    beside.unexplained = Some(left);
    assert!(verdict_in_words(&beside).contains(
        "That is not all: a network has learnt something on `slider` and `pole` that no effect in the library explains."
    ));
    d.gap.after = f64::NAN;
    d.verdict = Verdict::Unexplained;
    assert_eq!(
        verdict_in_words(&d),
        "Something is missing on `slider` that no effect in the library explains."
    );
    d.effects = found.clone();
    assert!(verdict_in_words(&d).contains("That is not all: something is left on `slider`"));
    d.effects.truncate(1);
    d.effects[0].confidence = 0.4;
    let said = verdict_in_words(&d);
    for part in [
        "that no effect in the library explains; what was added",
        "40 %",
    ] {
        assert!(said.contains(part), "{said}");
    }
    d.effects = found.clone();
    d.verdict = Verdict::DataFault;
    assert_eq!(
        verdict_in_words(&d),
        "The data are at fault, not the model: outliers in `q.pole`. Without what is faulty the model explains the data."
    );
    let faults = d.data_faults.clone();
    d.data_faults[0].kind = "convention".into();
    assert_eq!(
        verdict_in_words(&d),
        "The log counts otherwise than the model in `q.pole`. Read as it is meant, the model explains it."
    );
    d.verdict = Verdict::EffectsFound;
    let said = verdict_in_words(&d);
    let first = "The log counts otherwise than the model in `q.pole`: it was read as it is meant. Coulomb friction";
    assert!(said.starts_with(first), "{said}");
    d.data_faults = faults;
    d.effects[0].beside_fixed = true;
    assert!(
        verdict_in_words(&d)
            .starts_with("Coulomb friction on `slider` (beside what is `fixed`) is missing: 0.312")
    );
    if let Some(force) = d.effects[0].parameters.get_mut("force") {
        force.value = -0.1;
    }
    let said = verdict_in_words(&d);
    let less = "Coulomb friction on `slider` is less than is `fixed`: ";
    assert!(said.starts_with(less), "{said}");
    d.effects[0].beside_fixed = false;
    d.effects[0].kind = "added_mass".into();
    let force = d.effects[0].parameters.remove("force").unwrap();
    d.effects[0].parameters.insert("mass".into(), force);
    let said = verdict_in_words(&d);
    assert!(
        said.starts_with("`slider` has less mass than the model has: "),
        "{said}"
    );
    let place = d.effects[0].parameters.remove("mass").unwrap();
    d.effects[0].kind = "centre_of_mass".into();
    d.effects[0].parameters.insert("place".into(), place);
    let said = verdict_in_words(&d);
    assert!(
        said.starts_with("The centre of mass of `slider` is -0.100 ± 0.010"),
        "{said}"
    );
    d.effects = found.clone();
    d.effects.extend(found);
    assert!(verdict_in_words(&d).starts_with(
        "2 effects are missing: Coulomb friction on `slider`, 0.312 ± 0.010 N (98 % for it or asymmetric Coulomb friction on `slider`); Coulomb"
    ));
    d.change = Some(Change {
        name: "force of coulomb_friction on `slider`".into(),
        statistic: 2.9,
        run: 0,
        t: 30.0,
        before: 0.4,
        after: 0.2,
    });
    assert!(verdict_in_words(&d).contains(
        "That is not all: the force of coulomb_friction on `slider` changes over the log."
    ));
    d.change = None;
    d.unexplained = Some(unexplained(Some("the input on `slider`")));
    let said = verdict_in_words(&d);
    assert!(said.contains("That is not all: what is left follows the input on `slider`."));
    // Where no law is seen, nothing is said of one.
    d.unexplained = Some(unexplained(None));
    assert!(!verdict_in_words(&d).contains("That is not all"));
    // What nobody can believe is no headline.
    d.effects.iter_mut().for_each(|e| e.confidence = 0.01);
    d.verdict = Verdict::Unexplained;
    assert!(verdict_in_words(&d).starts_with(
        "Something is missing on `slider` that no effect in the library explains; what was added stands in for part of it at best"
    ));
    written(&d, &curves("slider"));
}

#[test]
fn an_earlier_report_is_replaced_whole_or_kept() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("report.html");
    std::fs::write(&path, "earlier").unwrap();
    let (d, c) = (diagnosis("slider"), curves("slider"));
    write(dir.path(), &d, &c, MODEL, COMMAND).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("<!DOCTYPE html>") && text.trim_end().ends_with("</html>"));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1); // no temporary left

    let nowhere = dir.path().join("missing");
    let error = write(&nowhere, &d, &c, MODEL, COMMAND).unwrap_err();
    assert!(error.to_string().contains("missing"), "{error}");
}
