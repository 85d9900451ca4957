//! The band about a simulation of an ensemble: its members, each rolled out from the same state.

use std::fmt::Write;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::output::Output;
use super::stepping::{Effort, Stepping};
use crate::Error;
use crate::disk::Staged;
use crate::entries::{q_names, v_names};
use crate::log::Run;
use crate::model::Model;
use crate::report::words::{number, with_unit};
use crate::spread::{Squares, spread};

/// Members of an ensemble beside the roll-out of their mean force.
pub(super) struct Band {
    members: Vec<Model>,
    /// Where the deviations go, and their rows so far.
    file: Option<(PathBuf, String)>,
    /// Names and units of q and v.
    columns: Vec<(String, String)>,
    squares: Squares,
    largest: Vec<f64>,
    diverged: usize,
}

impl Band {
    /// Of the members of `model`; none where it has no ensemble.
    ///
    /// # Errors
    /// [`Error::NoEnsemble`] when a file is asked for and there is no ensemble.
    pub fn of(
        model: &Model,
        file: Option<&PathBuf>,
        with_run: bool,
    ) -> Result<Option<Self>, Error> {
        if !model.has_ensemble() {
            return match file {
                None => Ok(None),
                Some(_) => Err(Error::NoEnsemble {
                    path: model.path.clone(),
                }),
            };
        }
        let coordinates = model.mechanics.coordinates();
        let units = |count: fn(&lagrange::Coordinate) -> usize, per: &'static str| {
            let each = coordinates.iter();
            each.flat_map(move |c| vec![format!("{}{per}", c.unit()); count(c)])
        };
        let names = q_names(coordinates).into_iter().chain(v_names(coordinates));
        let columns = names.zip(units(|c| c.nq(), "").chain(units(|c| c.nv(), "/s")));
        let columns: Vec<(String, String)> = columns.collect();
        let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
        let run = if with_run { ",run" } else { "" };
        let header = format!("t,{}{run}\n", names.join(","));
        Ok(Some(Band {
            members: model.members(),
            file: file.map(|path| (path.clone(), header)),
            squares: Squares::default(),
            largest: vec![0.0; columns.len()],
            columns,
            diverged: 0,
        }))
    }

    /// Rolls the members out over a recording; those that do not get to its end are left out, and that is said.
    pub fn roll(
        &mut self,
        method: Stepping,
        (run, with_run): (&Run, bool),
        initial: &[f64],
        fineness: (f64, f64),
        output: &Output,
    ) {
        let mut rolled = Vec::new();
        for (k, member) in self.members.iter().enumerate() {
            match method.simulate(member, run, initial, fineness, &mut Effort::default()) {
                Ok(states) => rolled.push(states),
                Err(error) => {
                    self.diverged += 1;
                    output.note(&format!(
                        "warning: member {} of the ensemble is left out of the band: {error}",
                        k + 1
                    ));
                }
            }
        }
        for (deviations, t) in spread(&rolled).iter().zip(&run.t) {
            self.squares.take(deviations);
            for (largest, x) in self.largest.iter_mut().zip(deviations) {
                *largest = largest.max(*x);
            }
            if let Some((_, text)) = &mut self.file {
                // Writing to a String cannot fail.
                let _ = write!(text, "{t}");
                for x in deviations {
                    let _ = write!(text, ",{x}");
                }
                if with_run {
                    let _ = write!(text, ",{}", run.id);
                }
                text.push('\n');
            }
        }
    }

    /// Writes the file beside its place, where one is asked for.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn stage(&self) -> Result<Option<Staged>, Error> {
        let staged = self.file.as_ref();
        staged
            .map(|(path, text)| Staged::write(path, text.as_bytes()))
            .transpose()
    }

    /// (name, unit, root mean square, largest) of every column; none where fewer than two members got to the end.
    fn sizes(&self) -> impl Iterator<Item = (&str, &str, f64, f64)> {
        let columns = self.columns.iter().zip(&self.largest).enumerate();
        columns.filter_map(|(k, ((name, unit), largest))| {
            let rms = self.squares.root_mean(k)?;
            Some((name.as_str(), unit.as_str(), rms, *largest))
        })
    }

    /// For programs.
    pub fn document(&self) -> Value {
        let sizes = self.sizes().map(|(name, unit, rms, largest)| {
            json!({ "name": name, "unit": unit, "rms": rms, "largest": largest })
        });
        json!({
            "members": self.members.len(),
            "left_out": self.diverged,
            "standard_deviations": sizes.collect::<Vec<_>>(),
            "file": self.file.as_ref().map(|(path, _)| path.display().to_string()),
        })
    }

    /// For people.
    pub fn words(&self) -> String {
        let mut out = format!(
            "standard deviations over the {} members of the ensemble, root mean square and largest:\n",
            self.members.len()
        );
        for (name, unit, rms, largest) in self.sizes() {
            let [rms, largest] = [rms, largest].map(|x| with_unit(number(x), unit));
            let _ = writeln!(out, "  {name}: {rms}, {largest}");
        }
        if let Some((path, _)) = &self.file {
            let _ = writeln!(out, "written to {}", path.display());
        }
        out
    }
}
