//! Logs that count each in its own way: one of three in degrees, or recorded with a plug turned round.

use super::DataFault;
use super::meant::{Meant, Otherwise, meant};
use super::reading::{Reading, read_log};
use super::told::{For, Whose};
use crate::log::Log;
use crate::model::Model;

/// How each of some logs is meant.
pub struct Each<'a> {
    model: &'a Model,
    logs: &'a [Log],
    what_for: For,
    /// How most of those count that tell it.
    pub usual: Option<Otherwise>,
    meant: Vec<Meant>,
}

impl<'a> Each<'a> {
    /// Each log is asked by itself; those that do not tell, together. Where these do not either they count as is usual: as most do, or as `elsewhere`.
    pub fn of(
        model: &'a Model,
        logs: &'a [Log],
        what_for: For,
        elsewhere: Option<Otherwise>,
        report: &dyn Fn(&str),
    ) -> Self {
        let alone = logs.chunks(1).map(|log| meant(model, log, report));
        let mut meant_each: Vec<Meant> = alone.collect();
        let tells = |meant: &Meant| !matches!(meant, Meant::Unclear);
        let silent = logs
            .iter()
            .zip(&meant_each)
            .filter(|(_, meant)| !tells(meant));
        let silent: Vec<Log> = silent.map(|(log, _)| log.clone()).collect();
        if silent.len() > 1 {
            let together = meant(model, &silent, report);
            let own = meant_each.iter_mut().filter(|meant| !tells(meant));
            own.for_each(|meant| *meant = together.clone());
        }
        let usual = match meant_each.iter().any(tells) {
            true => usual(&meant_each),
            false => elsewhere,
        };
        Each {
            model,
            logs,
            what_for,
            usual,
            meant: meant_each,
        }
    }

    /// How a log is to be read.
    fn of_log<'s>(&'s self, meant: &'s Meant) -> Option<&'s Otherwise> {
        match meant {
            Meant::Otherwise(own) if !agrees(meant, readings(self.usual.as_ref())) => Some(own),
            Meant::AsTheyAre => None,
            Meant::Otherwise(_) | Meant::Unclear => self.usual.as_ref(),
        }
    }

    /// The logs, read as they are meant; none where they are so as they are.
    pub fn read(&self) -> Option<Vec<Log>> {
        let found: Vec<_> = self.meant.iter().map(|meant| self.of_log(meant)).collect();
        found.iter().any(Option::is_some).then(|| {
            let logs = self.logs.iter().zip(found);
            logs.map(|(log, found)| read_log(readings(found), log))
                .collect()
        })
    }

    /// What is said of them, a way to count after the other, where a model is to read logs `as_meant`.
    pub fn faults(&self, as_meant: Option<&Otherwise>) -> Vec<DataFault> {
        let mut ways: Vec<(Option<&Otherwise>, Vec<&Log>)> = Vec::new();
        for (log, meant) in self.logs.iter().zip(&self.meant) {
            let found = self.of_log(meant);
            match ways
                .iter_mut()
                .find(|(way, _)| readings(*way) == readings(found))
            {
                Some((_, logs)) => logs.push(log),
                None => ways.push((found, vec![log])),
            }
        }
        let of_way = |(found, logs): (Option<&Otherwise>, Vec<&'a Log>)| {
            let is_usual = readings(found) == readings(self.usual.as_ref());
            // What most do is said of all: the rest is told apart from that.
            let logs = match is_usual {
                true => self.logs.iter().collect(),
                false => logs,
            };
            let whose = Whose {
                logs,
                of: self.logs.len(),
                what_for: self.what_for,
            };
            let is_expected =
                self.what_for == For::HeldOut && readings(found) == readings(as_meant);
            match (found, as_meant) {
                (Some(found), _) if !is_expected => found.faults(self.model, &whose),
                (None, Some(as_meant)) => whose.count_as_the_model(as_meant, self.model),
                _ => Vec::new(),
            }
        };
        ways.into_iter().flat_map(of_way).collect()
    }
}

/// How logs are read otherwise; in no way where they are read as they are.
pub fn readings(found: Option<&Otherwise>) -> &[Reading] {
    found.map_or(&[], |found| &found.readings)
}

/// Whether a log may as well be read so.
fn agrees(meant: &Meant, so: &[Reading]) -> bool {
    match meant {
        Meant::AsTheyAre => so.is_empty(),
        Meant::Otherwise(own) => own.readings == so || own.others.iter().any(|o| o == so),
        Meant::Unclear => false,
    }
}

/// What most of those that tell agree on; as they are, and what an earlier one says, where as many do.
fn usual(all: &[Meant]) -> Option<Otherwise> {
    let votes = |so: &[Reading]| all.iter().filter(|meant| agrees(meant, so)).count();
    let (mut best, mut most) = (None, votes(&[]));
    for meant in all {
        if let Meant::Otherwise(own) = meant
            && votes(&own.readings) > most
        {
            most = votes(&own.readings);
            best = Some(own);
        }
    }
    best.cloned()
}
