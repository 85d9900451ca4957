//! An effect of your own: write its law in one file, register it, and every diagnosis tries it wherever it makes sense.
//!
//! The log comes from a simulation of its own with a brake that no library knows. Without the effect the diagnosis has to make do with
//! what there is; with it, it names the brake, with its parameters, and the gap closes.

mod eddy_brake;
mod truth;

use std::error::Error;
use std::path::Path;

use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::Diagnosis;
use pinode_nn::effect::registry;
use pinode_nn::log::Log;
use pinode_nn::model::Model;

/// All that is known of the carriage.
const MODEL: &str = r#"
name = "carriage"

[lagrangian]
coordinates = ["x"]
kinetic     = "0.5*m*x_dot^2"
potential   = "0.5*k*x^2"
parameters  = { m = 2.0, k = 15.0 }

[[input]]
name  = "coil"
joint = "x"

[sensor.x]
velocity = "none"

[tolerance]
parameters = { m = 0.005, k = 0.01 }
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let dir = tempfile::tempdir()?;
    let at = |name: &str| dir.path().join(name);
    std::fs::write(at("carriage.toml"), MODEL)?;
    std::fs::write(at("log.csv"), truth::log(40.0))?;

    let without = diagnosed(dir.path(), "without")?;
    tell("with the library's effects alone", &without);

    registry::register(&eddy_brake::KIND)?;
    let with = diagnosed(dir.path(), "with")?;
    tell("with `eddy_brake` registered", &with);

    // The brake's largest force is c v₀/2, at v₀.
    let (force, speed) = truth::PEAK;
    let [brake] = with.effects.as_slice() else {
        return Err(format!("one effect is hidden, {} are named", with.effects.len()).into());
    };
    if brake.kind != "eddy_brake" {
        return Err(format!("the brake is called {}", brake.kind).into());
    }
    for (name, truth) in [
        ("coefficient", 2.0 * force / speed),
        ("critical_velocity", speed),
    ] {
        let found = &brake.parameters[name];
        println!(
            "{name}: {:.4} {}, in truth {truth:.4}",
            found.value, found.unit
        );
        if (found.value / truth - 1.0).abs() > 0.05 {
            return Err(format!("{name} is more than 5 % off").into());
        }
    }
    // The new model names the effect and loads again, in every program that registers it.
    Model::load(&at("with/model.toml"))?;
    Ok(())
}

fn diagnosed(dir: &Path, out: &str) -> Result<Diagnosis, Box<dyn Error>> {
    let model = Model::load(&dir.join("carriage.toml"))?;
    let log = Log::read(&dir.join("log.csv"), &model)?;
    let outcome = diagnose(&model, &[log], &[], &dir.join(out), 0, &|_| {})?;
    Ok(outcome.diagnosis)
}

fn tell(how: &str, diagnosis: &Diagnosis) {
    let names: Vec<String> = diagnosis
        .effects
        .iter()
        .map(|e| format!("{} on {} ({:.2})", e.kind, e.target, e.confidence))
        .collect();
    println!(
        "{how}: {:?}, [{}], gap {:.2} -> {:.2}",
        diagnosis.verdict,
        names.join(", "),
        diagnosis.gap.before,
        diagnosis.gap.after
    );
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_brake_is_found_once_it_is_registered() -> Result<(), Box<dyn std::error::Error>> {
        super::main()
    }
}
