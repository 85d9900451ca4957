//! Model files: those of the repository load, and a revised one reads back as what was written.

use std::path::{Path, PathBuf};

use pinode_nn::Error;
use pinode_nn::effect::{Between, registry};
use pinode_nn::model::{EffectEntry, Model, Revision, Target, Velocity};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn load(path: &str) -> Model {
    Model::load(&models().join(path)).unwrap_or_else(|e| panic!("{e}"))
}

fn effect(kind: &str, target: Target, values: &[f64]) -> EffectEntry {
    EffectEntry {
        kind: registry::find(kind).unwrap(),
        target,
        values: values.to_vec(),
        smoothing: None,
        fixed: false,
    }
}

#[test]
fn the_cart_pole_holds_the_numbers_of_the_paper() {
    let model = load("cartpole/cartpole.toml");
    assert_eq!(model.name, "cart-pole");
    let friction = effect(
        "coulomb_friction",
        Target::Coordinate(0),
        &[0.0408 * 0.538 * 9.81],
    );
    assert_eq!(model.effects[0].target, friction.target);
    assert!((model.effects[0].values[0] - friction.values[0]).abs() < 1e-12);
    assert_eq!(
        model.effects[1],
        effect("viscous_friction", Target::Coordinate(1), &[0.002])
    );
    assert_eq!(model.sensors[0].velocity, Velocity::BackwardDifference);
    assert_eq!(
        model.sensors[1].resolution,
        Some(std::f64::consts::TAU / 4096.0)
    );
    // Table 2: all of it hangs on the slider.
    let mass = model.mechanics.mass_matrix(&[0.1, 0.7]).unwrap();
    assert!((mass[(0, 0)] - 0.538).abs() < 1e-15);
}

#[test]
fn every_model_of_the_repository_loads_without_warnings() {
    for path in [
        "double_pendulum/double_pendulum.toml",
        "double_pendulum/double_pendulum_text.toml",
        "emps/emps.toml",
        "quanser_cartpole/quanser_cartpole.toml",
        "map_single_pendulum/map_single_pendulum.toml",
        "silverbox/silverbox.toml",
        "four_bar/four_bar.toml",
        "four_bar/four_bar_text.toml",
        "slider_crank/slider_crank.toml",
        "slider_crank/slider_crank_text.toml",
    ] {
        let model = load(path);
        assert!(model.warnings.is_empty(), "{path}: {:?}", model.warnings);
    }
}

#[test]
fn the_double_pendulum_is_the_same_from_urdf_and_from_energies() {
    let urdf = load("double_pendulum/double_pendulum.toml");
    let text = load("double_pendulum/double_pendulum_text.toml");
    assert_eq!(urdf.effects, text.effects);
    let (q, v, a) = ([0.4, -1.3], [2.0, 0.7], [-3.0, 5.0]);
    let (from_urdf, from_text) = (&urdf.mechanics, &text.mechanics);
    let difference = from_urdf.inverse_dynamics(&q, &v, &a).unwrap()
        - from_text.inverse_dynamics(&q, &v, &a).unwrap();
    assert!(difference.amax() < 1e-13, "{difference}");
    let energy = from_urdf.total_energy(&q, &v).unwrap() - from_text.total_energy(&q, &v).unwrap();
    assert!(energy.abs() < 1e-13, "{energy}");
}

/// Revises the cart-pole in every way.
fn revised(model: &Model) -> Revision {
    let mut revision = Revision::of(model);
    revision.effects[0].0.values[0] = 0.1 + 0.2; // 0.30000000000000004: all digits count
    revision.effects[1].0.fixed = true;
    revision.effects[1].0.smoothing = Some(1e-9);
    revision.effects.push((
        effect("input_delay", Target::Input(0), &[1.0 / 3.0 * 0.1]),
        "Found by the diagnosis.\nConfidence 0.98".into(),
    ));
    revision.effects.push((
        effect("linear_spring", Target::Coordinate(0), &[12.0, -0.25]),
        String::new(),
    ));
    revision.parameter_values[0] = 1.0 + f64::EPSILON;
    revision.gains[0] = 0.975;
    revision.zeros[1] = -1.25e-3;
    revision
}

fn assert_holds(model: &Model, revision: &Revision) {
    let effects: Vec<_> = revision.effects.iter().map(|(e, _)| e.clone()).collect();
    assert_eq!(model.effects, effects);
    assert_eq!(model.parameter_values, revision.parameter_values);
    let gains: Vec<f64> = model.inputs.iter().map(|i| i.gain).collect();
    assert_eq!(gains, revision.gains);
    let zeros: Vec<f64> = model.sensors.iter().map(|s| s.zero).collect();
    assert_eq!(zeros, revision.zeros);
}

#[test]
fn a_revised_model_reads_back_as_written_with_its_comments() {
    let model = load("cartpole/cartpole.toml");
    let revision = revised(&model);
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("new");
    let path = model.write_revision(&out, "model.toml", &revision).unwrap();
    assert_holds(&Model::load(&path).unwrap(), &revision);

    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with("# The cart-pole of Roehrl"), "{text}");
    assert!(
        text.contains("force = 0.30000000000000004               # N"),
        "{text}"
    );
    assert!(
        text.contains(
            "\n# Found by the diagnosis.\n# Confidence 0.98\n[[effect]]\nkind = \"input_delay\"\n"
        ),
        "{text}"
    );
    assert!(out.join("cartpole.urdf").exists());
    assert_eq!(
        std::fs::read_dir(&out).unwrap().count(),
        2,
        "no temporary is left"
    );

    // Again, and into the same folder under another name.
    let again = Model::load(&path).unwrap();
    let mut fewer = Revision::of(&again);
    fewer.effects.remove(0);
    let second = again.write_revision(&out, "second.toml", &fewer).unwrap();
    assert_holds(&Model::load(&second).unwrap(), &fewer);
    assert!(matches!(
        again.write_revision(&out, "model.toml", &fewer),
        Err(Error::OverwritesInput { .. })
    ));
}

#[test]
fn what_an_input_does_between_samples_is_held_unless_the_file_says_smooth() {
    let between = |path: &str| load(path).inputs[0].between;
    assert_eq!(between("cartpole/cartpole.toml"), Between::Held);
    assert_eq!(between("silverbox/silverbox.toml"), Between::Smooth);

    let text = std::fs::read_to_string(models().join("silverbox/silverbox.toml")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("model.toml");
    std::fs::write(&path, text.replace("\"smooth\"", "\"linear\"")).unwrap();
    let refused = Model::load(&path).err().unwrap().to_string();
    let cure = "`between_samples` is `linear`: it must be \"held\" or \"smooth\"";
    assert!(refused.contains(cure), "{refused}");
}

#[test]
fn a_revision_that_changes_nothing_leaves_the_text_alone() {
    for (folder, name) in [
        ("cartpole", "cartpole.toml"),
        ("double_pendulum", "double_pendulum.toml"),
        ("silverbox", "silverbox.toml"),
    ] {
        let source = models().join(folder).join(name);
        let model = Model::load(&source).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let path = model
            .write_revision(dir.path(), "model.toml", &Revision::of(&model))
            .unwrap();
        assert_eq!(
            std::fs::read_to_string(path).unwrap(),
            std::fs::read_to_string(source).unwrap()
        );
    }
}

#[test]
fn friction_of_the_urdf_moves_into_the_revised_model() {
    let model = load("double_pendulum/double_pendulum.toml");
    assert_eq!(model.effects.len(), 2);
    let mut revision = Revision::of(&model);
    revision.effects.remove(1);
    revision.effects[0].0.values[0] = 0.001;
    let dir = tempfile::tempdir().unwrap();
    let path = model
        .write_revision(dir.path(), "model.toml", &revision)
        .unwrap();
    assert_holds(&Model::load(&path).unwrap(), &revision);

    // None left at all.
    let none = Revision {
        effects: Vec::new(),
        ..Revision::of(&model)
    };
    let path = model
        .write_revision(dir.path(), "none.toml", &none)
        .unwrap();
    assert_holds(&Model::load(&path).unwrap(), &none);
}

#[test]
fn constants_and_inline_tables_are_revised_in_place() {
    let text = "# inline
effect = [ { kind = 'viscous_friction', joint = 'x', coefficient = 1 } ]
input = [ { name = 'u', joint = 'x' } ]
sensor = { x = { position_noise = 1e-3 } }
[lagrangian]
coordinates = ['x']
kinetic = '0.5*m*x_dot^2'
potential = '0'
parameters = { m = 2 }  # kg
";
    let model = Model::parse(Path::new("m.toml"), text).unwrap();
    let mut revision = Revision::of(&model);
    revision.effects[0].0.values[0] = 1.5;
    revision.effects.push((
        effect("constant_force", Target::Coordinate(0), &[-1.0]),
        "found".into(),
    ));
    revision.parameter_values[0] = 2.5;
    revision.gains[0] = 3.0;
    revision.zeros[0] = 0.25;
    let dir = tempfile::tempdir().unwrap();
    let path = model
        .write_revision(dir.path(), "model.toml", &revision)
        .unwrap();
    let again = Model::load(&path).unwrap();
    assert_holds(&again, &revision);
    assert_eq!(again.sensors[0].position_noise, Some(1e-3));
    assert!(std::fs::read_to_string(&path).unwrap().contains("# kg"));
}

#[test]
fn a_foreign_urdf_of_the_same_name_is_not_replaced() {
    let model = load("cartpole/cartpole.toml");
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("cartpole.urdf"), "mine").unwrap();
    let revision = Revision::of(&model);
    for name in ["a.toml", "b.toml"] {
        let path = model.write_revision(dir.path(), name, &revision).unwrap();
        assert_holds(&Model::load(&path).unwrap(), &revision);
    }
    let kept = std::fs::read_to_string(dir.path().join("cartpole.urdf")).unwrap();
    assert_eq!(kept, "mine");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 4);
}

#[test]
fn a_revision_of_the_wrong_length_or_with_nan_is_refused() {
    let model = load("cartpole/cartpole.toml");
    let dir = tempfile::tempdir().unwrap();
    let mut short = Revision::of(&model);
    short.gains.clear();
    let error = model.write_revision(dir.path(), "m.toml", &short);
    assert!(matches!(error, Err(Error::Revision { what: "gains", .. })));
    let mut nan = Revision::of(&model);
    nan.zeros[0] = f64::NAN;
    assert!(model.write_revision(dir.path(), "m.toml", &nan).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn own_friction_takes_the_place_of_the_urdfs() {
    let text = "urdf = 'double_pendulum.urdf'
[[effect]]
kind = 'viscous_friction'
joint = 'elbow'
coefficient = 0.1
";
    let path = models().join("double_pendulum/own.toml");
    let model = Model::parse(&path, text).unwrap();
    let values: Vec<f64> = model.effects.iter().map(|e| e.values[0]).collect();
    assert_eq!(values, [0.0008, 0.1]);
    let warning = model.warnings[0].to_string();
    assert!(
        warning.contains("own.toml:2:1: viscous_friction of `elbow`"),
        "{warning}"
    );

    let without = format!("urdf_dynamics = false\n{text}");
    let model = Model::parse(&path, without).unwrap();
    assert_eq!(model.effects.len(), 1);
    assert!(model.warnings.is_empty());
}

/// The largest entry of a, over those of b.
fn apart(a: &nalgebra::DVector<f64>, b: &nalgebra::DVector<f64>) -> f64 {
    (a - b).amax() / (1.0 + b.amax())
}

#[test]
fn linkages_are_the_same_from_urdf_and_from_energies() {
    for (name, force) in [
        ("four_bar/four_bar", [0.4, 0.0, -0.1]),
        ("slider_crank/slider_crank", [0.4, 0.0, -3.0]),
    ] {
        let urdf = load(&format!("{name}.toml")).mechanics;
        let text = load(&format!("{name}_text.toml")).mechanics;
        let (loops, formulas) = (urdf.constraints().unwrap(), text.constraints().unwrap());
        assert_eq!(loops.names().len(), 2);
        let nominal = |m: &dyn lagrange::Mechanics| m.nominal();
        for (angle, rate) in [(0.3, 2.0), (1.7, -5.0), (-2.4, 9.0), (3.0, 0.0)] {
            let guess = [angle, -angle, 0.0];
            let project = |c: &dyn lagrange::constraint::Holonomic, p: &[f64]| {
                c.project_with(&guess, &[rate, 0.0, 0.0], &[0], p).unwrap()
            };
            let (q, v) = project(loops, &nominal(&*urdf));
            let (q_text, v_text) = project(formulas, &nominal(&*text));
            for (a, b) in q.iter().chain(&v).zip(q_text.iter().chain(&v_text)) {
                assert!((a - b).abs() < 1e-11, "{name}: {a} {b}");
            }
            let solve = |m: &dyn lagrange::Mechanics| {
                let mut a = nalgebra::DVector::from_column_slice(&force);
                let mut multipliers = nalgebra::DVector::zeros(2);
                let (p, mut work) = (m.nominal(), m.workspace());
                let constraints = m.constraints().unwrap();
                constraints
                    .multipliers_into(&q, &v, &p, &mut work, &mut a, &mut multipliers)
                    .unwrap();
                (a, multipliers)
            };
            let ((a, force_of_loop), (b, force_of_text)) = (solve(&*urdf), solve(&*text));
            assert!(apart(&a, &b) < 1e-12, "{name} at {angle}");
            assert!(
                apart(&force_of_loop, &force_of_text) < 1e-12,
                "{name} at {angle}"
            );
            let (t, u) = (urdf.total_energy(&q, &v), text.total_energy(&q, &v));
            assert!((t.unwrap() - u.unwrap()).abs() < 1e-12);
        }
    }
}

#[test]
fn a_closure_across_the_plane_is_dropped_with_a_warning_that_names_it() {
    let path = models().join("four_bar/four_bar.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let closed = text.replace("components = [\"x\", \"z\"]\n", "");
    assert_ne!(closed, text);
    let model = Model::parse(&path, closed).unwrap();
    let warnings: Vec<String> = model.warnings.iter().map(|w| w.to_string()).collect();
    assert_eq!(warnings.len(), 1);
    assert!(
        warnings[0].ends_with(
            "four_bar.toml:6:1: `pin.y` is redundant and left out: no motion of the mechanism changes it"
        ),
        "{}",
        warnings[0]
    );
    let in_force: Vec<(&str, bool)> = (model.constraints.iter())
        .map(|c| (c.name.as_str(), c.in_force))
        .collect();
    assert_eq!(
        in_force,
        [("pin.x", true), ("pin.y", false), ("pin.z", true)]
    );
    // Where the two links lie in different planes, nothing can close it.
    let crooked = text
        .replace("components = [\"x\", \"z\"]\n", "")
        .replace("[0.24, 0.0, 0.07]", "[0.24, 0.003, 0.07]");
    let error = Model::parse(&path, crooked).unwrap_err().to_string();
    assert!(
        error.contains("four_bar.toml:6:1: the constraints are not satisfied"),
        "{error}"
    );
    assert!(error.contains("`pin.y` is 3.000e-3"), "{error}");
}
