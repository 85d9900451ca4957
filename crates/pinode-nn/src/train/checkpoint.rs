//! A training that was stopped, in a file: whatever it needs to go on to the same bits.

use std::collections::HashMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::data::{Recordings, Side};
use super::session::{Epoch, Session};
use crate::Error;
use crate::disk::{sha256, write_atomically};
use crate::network::Real;

/// Where the words of a checkpoint are in the metadata of its file.
const KEY: &str = "pinode-training";
/// Where the SHA-256 of the numbers, in the order of their names, and of the words is.
const SUM: &str = "sha256";

#[derive(Serialize, Deserialize)]
struct Words {
    /// Of the model, the logs and the options.
    fingerprint: String,
    /// What was held back of known constants, now and beside the best network.
    held_back: [Vec<(usize, f64)>; 2],
    steps: u64,
    usual: f64,
    history: Vec<Epoch>,
}

/// SHA-256 of bytes, part after part.
fn sum<'a>(parts: impl Iterator<Item = &'a [u8]>) -> String {
    sha256(&parts.collect::<Vec<_>>().concat())
}

impl<T: Real> Session<'_, T> {
    /// Writes the state after an epoch, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn save(&self, path: &Path, fingerprint: &str) -> Result<(), Error> {
        let io =
            |e: Box<dyn std::error::Error + Send + Sync>| Error::io(path, std::io::Error::other(e));
        let words = Words {
            fingerprint: fingerprint.to_owned(),
            held_back: [
                self.recordings.held_back.clone(),
                self.best_held_back.clone(),
            ],
            steps: self.adam.steps,
            usual: self.adam.usual,
            history: self.history.clone(),
        };
        let of = |numbers: &[T]| {
            numbers
                .iter()
                .flat_map(|x| x.to_f64().to_le_bytes())
                .collect()
        };
        let bytes = |numbers: &[f64]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let flat = |states: &[Vec<f64>]| {
            let all = states.iter().flatten();
            all.flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()
        };
        // f64 holds every f32.
        let recordings = &self.recordings;
        let tensors: [(&str, Vec<u8>); 10] = [
            ("adam.mean", of(&self.adam.mean)),
            ("adam.square", of(&self.adam.square)),
            ("best", of(self.best.parameters())),
            ("best.theta", bytes(&self.best_theta)),
            ("network", of(self.learner.network.parameters())),
            ("starts.held_out", flat(&recordings.held_out.starts)),
            ("starts.seen", flat(&recordings.seen.starts)),
            ("theta", bytes(&recordings.theta)),
            ("trust.held_out", flat(&recordings.held_out.trust)),
            ("trust.seen", flat(&recordings.seen.trust)),
        ];
        let mut views = Vec::new();
        for (name, bytes) in &tensors {
            let view = TensorView::new(Dtype::F64, vec![bytes.len() / 8], bytes);
            views.push((*name, view.map_err(|e| io(e.into()))?));
        }
        let text = serde_json::to_string(&words).map_err(|e| io(e.into()))?;
        let numbers = tensors.iter().map(|(_, bytes)| &bytes[..]);
        let sum = sum(numbers.chain([text.as_bytes()]));
        let metadata = HashMap::from([(KEY.to_owned(), text), (SUM.to_owned(), sum)]);
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(|e| io(e.into()))?;
        write_atomically(path, &bytes)
    }

    /// Goes on from what [`save`](Self::save) has written.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Checkpoint`] when the file is none, damaged, or that of another training.
    pub(super) fn restore(&mut self, path: &Path, fingerprint: &str) -> Result<(), Error> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
        let fault = |what: String| Error::Checkpoint {
            path: path.to_owned(),
            what,
        };
        let broken = |e: safetensors::SafeTensorError| fault(format!("is damaged ({e})"));
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(broken)?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(broken)?;
        let text = metadata.metadata().as_ref().and_then(|all| all.get(KEY));
        let words: Words = text
            .and_then(|text| serde_json::from_str(text).ok())
            .ok_or_else(|| {
                fault("has no words of a training: it is damaged, or another version of the program wrote it".to_owned())
            })?;
        if words.fingerprint != fingerprint {
            return Err(fault(
                "is of another training: its model, its logs or its options are not these"
                    .to_owned(),
            ));
        }
        let mut all = tensors.tensors();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        let numbers = all.iter().map(|(_, tensor)| tensor.data());
        let found = sum(numbers.chain(text.map(String::as_bytes)));
        let written = metadata.metadata().as_ref().and_then(|all| all.get(SUM));
        if written != Some(&found) {
            return Err(fault(
                "is damaged: its numbers are not those that were written".to_owned(),
            ));
        }
        let numbers = |name: &str, expected: usize| -> Result<Vec<f64>, Error> {
            let tensor = tensors.tensor(name).map_err(broken)?;
            let (whole, _) = tensor.data().as_chunks::<8>();
            if whole.len() != expected {
                return Err(fault(format!(
                    "is damaged: `{name}` has {} numbers, not {expected}",
                    whole.len()
                )));
            }
            let numbers = whole.iter().map(|b| f64::from_le_bytes(*b));
            match numbers.clone().find(|x| !x.is_finite()) {
                None => Ok(numbers.collect()),
                Some(x) => Err(fault(format!("is damaged: a number of `{name}` is {x}"))),
            }
        };
        let n = self.adam.mean.len();
        let of = |name: &str| -> Result<Vec<T>, Error> {
            let numbers = numbers(name, n)?;
            Ok(numbers.into_iter().map(T::from_f64).collect())
        };
        let (mean, square, best, network) = (
            of("adam.mean")?,
            of("adam.square")?,
            of("best")?,
            of("network")?,
        );
        let rows = |name: &str, like: &[Vec<f64>]| -> Result<Vec<Vec<f64>>, Error> {
            let length = like.first().map_or(1, Vec::len);
            let flat = numbers(name, like.len() * length)?;
            Ok(flat.chunks_exact(length).map(<[f64]>::to_vec).collect())
        };
        let Recordings { seen, held_out, .. } = &self.recordings;
        let side = |name: &str, side: &Side| -> Result<Side, Error> {
            Ok(Side {
                windows: side.windows.clone(),
                visible: side.visible,
                starts: rows(&format!("starts.{name}"), &side.starts)?,
                trust: rows(&format!("trust.{name}"), &side.trust)?,
            })
        };
        let (seen, held_out) = (side("seen", seen)?, side("held_out", held_out)?);
        let constants = self.recordings.theta.len();
        let theta = numbers("theta", constants)?;
        self.best_theta = numbers("best.theta", constants)?;
        let [held_back, best_held_back] = words.held_back;
        (self.recordings.held_back, self.best_held_back) = (held_back, best_held_back);
        (self.adam.mean, self.adam.square) = (mean, square);
        (self.adam.steps, self.adam.usual) = (words.steps, words.usual);
        self.best.parameters_mut().copy_from_slice(&best);
        self.learner
            .network
            .parameters_mut()
            .copy_from_slice(&network);
        self.recordings.seen = seen;
        self.recordings.held_out = held_out;
        self.recordings.set_theta(theta);
        self.history = words.history;
        Ok(())
    }
}
