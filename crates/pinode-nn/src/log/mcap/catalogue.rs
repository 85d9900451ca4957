//! What an MCAP file holds: topics, and the numbers in their messages, which are the columns.

use std::collections::HashMap;

use lagrange::Problem;

use super::messages::{Channel, for_each};
use super::value::Step;
use crate::entries::{q_names, v_names};
use crate::log::{Channels, ColumnMap, Mapping};
use crate::naming::quoted;

/// Messages of each topic that are looked into: not all have the same fields.
const LOOKED_INTO: usize = 100;
/// Columns beyond these are not offered.
const MOST_COLUMNS: usize = 20_000;

/// A topic, with all who send on it.
#[derive(Default)]
pub(super) struct Topic {
    pub name: String,
    joint_states: bool,
    looked_into: usize,
    /// Why some of its messages are not read.
    pub unread: Option<String>,
}

/// A number, or an id, in the messages of a topic.
pub(super) struct Column {
    pub topic: usize,
    /// `<topic>.<field>.<subfield>[<element>]`.
    pub name: String,
    pub path: Vec<Step>,
    /// Whether there was anything but NaN.
    told: bool,
}

impl Column {
    /// The name within the message.
    fn local(&self, topics: &[Topic]) -> &str {
        let topic = topics.get(self.topic).map_or("", |topic| &topic.name);
        let rest = self.name.strip_prefix(topic).unwrap_or("");
        rest.strip_prefix('.').unwrap_or(rest)
    }
}

#[derive(Default)]
pub(super) struct Catalogue {
    pub topics: Vec<Topic>,
    pub columns: Vec<Column>,
    indices: HashMap<String, usize>,
    pub overfull: bool,
}

impl Catalogue {
    /// Looks into the first messages of every topic. Texts are columns only where `run` asks for them.
    pub(super) fn of(bytes: &[u8], run: &Mapping) -> Result<Self, String> {
        let mut catalogue = Catalogue::default();
        let mut names: HashMap<String, usize> = HashMap::new();
        for_each(bytes, |channel, _, data| {
            let topic = *names.entry(channel.topic.clone()).or_insert_with(|| {
                catalogue.topics.push(Topic {
                    name: channel.topic.clone(),
                    ..Topic::default()
                });
                catalogue.topics.len() - 1
            });
            catalogue.look_into(topic, channel, data, run);
        })?;
        Ok(catalogue)
    }

    fn look_into(&mut self, index: usize, channel: &Channel, data: &[u8], run: &Mapping) {
        let Some(topic) = self.topics.get_mut(index) else {
            return;
        };
        if let "sensor_msgs/msg/JointState" | "sensor_msgs/JointState" = channel.kind.as_str() {
            topic.joint_states = true;
        }
        if let Some(why) = channel.unread() {
            topic.unread.get_or_insert_with(|| why.to_owned());
            return;
        }
        if topic.looked_into == LOOKED_INTO {
            return;
        }
        topic.looked_into += 1;
        let message = match channel.decode(data) {
            Ok(message) => message,
            Err(why) => {
                topic.unread.get_or_insert(why);
                return;
            }
        };
        let run_local = format!("{}.run", topic.name);
        // Times, which every row has.
        let stamp = format!("{}.header.stamp.", topic.name);
        message.leaves(&topic.name, &mut |name, path, value| {
            let wanted = value.number().is_some() || name == run.column || name == run_local;
            if !wanted || name.starts_with(&stamp) {
                return;
            }
            let told = !value.number().is_some_and(f64::is_nan);
            if let Some(known) = self.indices.get(name) {
                if let Some(column) = self.columns.get_mut(*known) {
                    column.told |= told;
                }
                return;
            }
            if self.columns.len() == MOST_COLUMNS {
                self.overfull = true;
                return;
            }
            self.indices.insert(name.to_owned(), self.columns.len());
            self.columns.push(Column {
                topic: index,
                name: name.to_owned(),
                path: path.to_vec(),
                told,
            });
        });
    }

    /// The map of `channels`, and with it the signals that are found by what they are called, or as states of joints.
    pub(super) fn map(&self, channels: &Channels) -> Result<ColumnMap, Vec<Problem>> {
        let mut map = channels.columns.clone();
        let mut problems = Vec::new();
        // With the joint that a state of joints would have it under: what stands behind the prefix.
        let named = |signal: String| {
            let joint = signal.get(2..).unwrap_or_default().to_owned();
            (signal, joint)
        };
        let wanted = channels.coordinates.iter().zip(channels.velocities);
        let wanted = wanted.flat_map(|(c, &wanted)| std::iter::repeat_n(wanted, c.nv()));
        let velocities = v_names(channels.coordinates).into_iter().zip(wanted);
        let signals = (q_names(channels.coordinates).into_iter())
            .chain(velocities.filter_map(|(signal, wanted)| wanted.then_some(signal)))
            .chain(channels.inputs.iter().map(|name| format!("u.{name}")))
            .chain(["run".to_owned()])
            .map(named);
        let mut by_local: HashMap<&str, Vec<&Column>> = HashMap::new();
        for column in &self.columns {
            by_local
                .entry(column.local(&self.topics))
                .or_default()
                .push(column);
        }
        for (signal, joint) in signals {
            if map.mappings.iter().any(|mapping| mapping.signal == signal) {
                continue;
            }
            let column = match by_local.get(signal.as_str()).map_or(&[][..], Vec::as_slice) {
                [] => self.joint_state(&signal, &joint),
                [only] => Some(only.name.clone()),
                [first, second, ..] => {
                    problems.push(Problem::general(format!(
                        "{} could be {} or {}: say which by [log.columns] in the model",
                        quoted(&signal),
                        quoted(&first.name),
                        quoted(&second.name)
                    )));
                    None
                }
            };
            map.mappings
                .extend(column.map(|column| Mapping::new(signal, column)));
        }
        if problems.is_empty() {
            Ok(map)
        } else {
            Err(problems)
        }
    }

    /// The column of a signal among the states of joints, where these have one topic.
    fn joint_state(&self, signal: &str, joint: &str) -> Option<String> {
        let mut topics = self.topics.iter().filter(|topic| topic.joint_states);
        let (Some(topic), None) = (topics.next(), topics.next()) else {
            return None;
        };
        let field = match signal.split_once('.')?.0 {
            "q" => "position",
            "v" => "velocity",
            _ => return None,
        };
        let name = format!("{}.{field}[{joint}]", topic.name);
        let column = self.columns.get(*self.indices.get(&name)?)?;
        // Drivers that measure no velocity send NaN.
        (field == "position" || column.told).then_some(name)
    }

    /// Which topics are not read, and why; none if all are.
    pub(super) fn unread(&self) -> Option<Problem> {
        let unread: Vec<String> = self
            .topics
            .iter()
            .filter_map(|topic| {
                Some(format!(
                    "{} ({})",
                    quoted(&topic.name),
                    topic.unread.as_ref()?
                ))
            })
            .collect();
        let first: Vec<&str> = unread.iter().take(20).map(String::as_str).collect();
        let more = match unread.len().saturating_sub(20) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        (!unread.is_empty()).then(|| {
            Problem::general(format!(
                "topics not read: {}{more}; messages are read in JSON, and in CDR with definitions of ROS 2 (`ros2msg`)",
                first.join(", ")
            ))
        })
    }
}
