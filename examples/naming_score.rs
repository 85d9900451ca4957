//! How often the diagnosis names what is hidden: `cargo run --release -p cartpole --example naming_score -- [LOGS] [NOTHING] [SEED] [all]`
//! diagnoses LOGS rig logs with a drawn effect and NOTHING logs without one (60 s each), a line a log, from SEED on. With `all` the rig takes
//! the effects that it draws from in turn, every kind on every target.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use cartpole::config::Config;
use cartpole::rig::{self, Hidden};
use pinode_nn::diagnose::diagnose;
use pinode_nn::log::Log;
use pinode_nn::model::Model;

fn main() -> Result<(), Box<dyn Error>> {
    let (words, numbers): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|a| a == "all");
    let all = !words.is_empty();
    let mut numbers = numbers.iter().map(|a| a.parse::<u64>());
    let logs = numbers.next().transpose()?.unwrap_or(50);
    let nothing = numbers.next().transpose()?.unwrap_or(10);
    let first = numbers.next().transpose()?.unwrap_or(1000);
    let models = Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../models/cartpole"
    ));
    let config = Config::read(&models.join("rig.toml"))?;
    let dir = tempfile::tempdir()?;

    let (mut first_right, mut exact, mut false_names, mut seconds) = (0, 0, 0, 0.0);
    for k in 0..logs + nothing {
        let seed = first + k;
        let hidden = match (k < logs, all) {
            (true, false) => rig::draw(&config, seed),
            (true, true) => rig::draw_of(&config, k as usize % rig::CASES_ALL, seed),
            (false, _) => Hidden::Nothing,
        };
        let log = dir.path().join("log.csv");
        rig::run(&config, &hidden, seed)?.write_csv(&log)?;
        let model = Model::load(&rig::known_model(
            &hidden,
            models,
            &dir.path().join("user"),
        )?)?;
        let log = Log::read(&log, &model)?;

        let start = Instant::now();
        let found = diagnose(&model, &[log], &[], &dir.path().join("out"), 0, &|_| {})?.diagnosis;
        let time = start.elapsed().as_secs_f64();
        seconds += time;

        // Names that the data cannot tell from the found one count as right when they are said.
        let target = hidden.target().map_or("", |t| t.name());
        let is_it = |kind: &str, on: &str| kind == hidden.kind() && on == target;
        let right = found.effects.first().is_some_and(|e| {
            let others = &e.indistinguishable_from;
            is_it(&e.kind, &e.target) || others.iter().any(|o| is_it(&o.kind, &o.target))
        });
        if k < logs {
            first_right += usize::from(right);
            exact += usize::from(right && found.effects.len() == 1);
        } else {
            false_names += usize::from(!found.effects.is_empty());
        }
        let names: Vec<String> = found
            .effects
            .iter()
            .map(|e| {
                let others = e.indistinguishable_from.iter().map(|o| o.kind.as_str());
                let tie: String = others.map(|o| format!(" ≡ {o}")).collect();
                format!("{} on {} ({:.2}){tie}", e.kind, e.target, e.confidence)
            })
            .collect();
        let mark = if right || (k >= logs && names.is_empty()) {
            "  "
        } else {
            "x "
        };
        println!(
            "{mark}{seed} {} {target} {:?} -> {}; gap {:.1} -> {:.1}; {time:.1} s",
            hidden.kind(),
            hidden.parameters(),
            if names.is_empty() {
                "nothing".to_owned()
            } else {
                names.join(", ")
            },
            found.gap.before,
            found.gap.after
        );
    }
    println!(
        "first name right {first_right} of {logs}, exact set {exact}; false names on {false_names} of {nothing} logs with nothing \
         hidden; {:.1} s a log",
        seconds / (logs + nothing).max(1) as f64
    );
    Ok(())
}
