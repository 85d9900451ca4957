//! The messages of an MCAP file, in its order, each with its topic.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

use ::mcap::read::ChannelAccumulator;
use ::mcap::records::{MessageHeader, Record, op};
use ::mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use ::mcap::{McapError, McapResult};

use super::ros2msg::Definitions;
use super::value::Value;
use super::{cdr, json};
use crate::log::guarded::guarded;

/// Chunks may be compressed to nearly nothing: what is unpacked of a file, in all and at once.
const MOST_UNPACKED: u64 = 1 << 32;
const LARGEST_CHUNK: usize = 1 << 30;

/// Who sends messages of one kind.
pub(super) struct Channel {
    pub topic: String,
    /// Name of the type of its messages, `package/msg/Type` in ROS.
    pub kind: String,
    encoding: Encoding,
}

enum Encoding {
    Json,
    Cdr(Definitions),
    /// Not read, and why.
    Other(String),
}

impl Channel {
    fn new(channel: &::mcap::Channel) -> Self {
        let schema = channel.schema.as_deref();
        let kind = schema.map_or("", |schema| &schema.name);
        let spelled = schema.map_or("", |schema| &schema.encoding);
        let encoding = match (channel.message_encoding.as_str(), schema) {
            ("json", _) => Encoding::Json,
            ("cdr", Some(schema)) if schema.encoding == "ros2msg" => {
                match Definitions::parse(kind, &String::from_utf8_lossy(&schema.data)) {
                    Ok(definitions) => Encoding::Cdr(definitions),
                    Err(fault) => Encoding::Other(format!("cdr, but {fault}")),
                }
            }
            ("cdr", _) => Encoding::Other(format!("cdr with a schema in {spelled:?}")),
            (other, _) => Encoding::Other(other.to_owned()),
        };
        Channel {
            topic: channel.topic.clone(),
            kind: kind.to_owned(),
            encoding,
        }
    }

    /// Why its messages are not read.
    pub(super) fn unread(&self) -> Option<&str> {
        match &self.encoding {
            Encoding::Other(why) => Some(why),
            _ => None,
        }
    }

    pub(super) fn decode(&self, data: &[u8]) -> Result<Value, String> {
        match &self.encoding {
            Encoding::Json => json::decode(data),
            Encoding::Cdr(definitions) => cdr::decode(definitions, data),
            Encoding::Other(why) => Err(why.clone()),
        }
    }
}

/// Calls `each` with every message, its channel and when it was logged, ns.
pub(super) fn for_each(
    bytes: &[u8],
    mut each: impl FnMut(&Channel, i64, &[u8]),
) -> Result<(), String> {
    let mut reader = LinearReader::new_with_options(
        LinearReaderOptions::default()
            .with_record_length_limit(LARGEST_CHUNK)
            .with_prevalidate_chunk_crcs(true)
            .with_validate_data_section_crc(true),
    );
    let (mut left, mut unpacked) = (bytes, 0);
    let mut known = ChannelAccumulator::default();
    let mut channels: HashMap<u16, Channel> = HashMap::new();
    while let Some(event) = next(&mut reader) {
        match event.map_err(|e| e.to_string())? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = left.split_at(wanted.min(left.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                left = later;
            }
            LinearReadEvent::Record { opcode, data } => {
                unpacked += data.len() as u64;
                if unpacked > MOST_UNPACKED {
                    return Err("it unpacks to more than 4 GiB".into());
                }
                // No other record is looked into.
                if let op::SCHEMA | op::CHANNEL | op::MESSAGE = opcode
                    && let Some((message, data)) =
                        record(&mut known, opcode, data).map_err(|e| e.to_string())?
                {
                    let id = message.channel_id;
                    let channel = match channels.entry(id) {
                        Entry::Occupied(channel) => channel.into_mut(),
                        Entry::Vacant(place) => {
                            let channel = known.get(id);
                            let channel =
                                channel.ok_or(McapError::UnknownChannel(message.sequence, id));
                            place.insert(Channel::new(&*channel.map_err(|e| e.to_string())?))
                        }
                    };
                    each(channel, message.log_time.cast_signed(), data);
                }
            }
        }
    }
    Ok(())
}

/// The next event, also where the library panics: it trusts the lengths of records within chunks that have no checksum.
fn next(reader: &mut LinearReader) -> Option<McapResult<LinearReadEvent<'_>>> {
    guarded(move || reader.next_event()).unwrap_or(Some(Err(McapError::UnexpectedEoc)))
}

/// Notes a schema or channel; else the message.
fn record<'a>(
    known: &mut ChannelAccumulator<'static>,
    opcode: u8,
    data: &'a [u8],
) -> McapResult<Option<(MessageHeader, &'a [u8])>> {
    match ::mcap::parse_record(opcode, data)? {
        Record::Schema { header, data } => known.add_schema_from_slice(header, &data)?,
        Record::Channel(channel) => known.add_channel(channel)?,
        Record::Message {
            header,
            data: Cow::Borrowed(data),
        } => return Ok(Some((header, data))),
        _ => {}
    }
    Ok(None)
}
