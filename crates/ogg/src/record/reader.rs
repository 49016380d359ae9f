//! Reading a recording back.
//!
//! Reads from the front and needs no index, so a file whose writer was killed gives everything up to its last whole chunk. A chunk counts only if its
//! checksum is right and none is missing before it, and no length in the file is trusted above a limit.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

use foxglove::messages::JointStates;
use mcap::parse_record;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;

use super::Error;
use super::encode::{KEYPOINTS_TOPIC, joint_topic, state_name};
use super::sample::{JointStream, JointValue, KeypointState, SpacePoint};
use super::schema::KeypointsMessage;

/// Longest record or chunk that is read; the writer's chunks hold about 1 MiB and one picture.
const MAX_RECORD_BYTES: usize = 256 << 20;

/// Joint values of one time.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRecord {
    /// Nanoseconds since 1970.
    pub time_ns: u64,
    /// Joints in the order of the message.
    pub joints: Vec<JointValue>,
}

/// Keypoints of one time.
#[derive(Debug, Clone, PartialEq)]
pub struct KeypointRecord {
    /// Nanoseconds since 1970.
    pub time_ns: u64,
    /// Frame of the coordinates.
    pub frame: String,
    /// Keypoints in the order of the message.
    pub points: Vec<SpacePoint>,
}

/// A topic of the recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Name.
    pub name: String,
    /// Name of its schema.
    pub schema: String,
    /// Encoding of its messages.
    pub encoding: String,
    /// Number of messages.
    pub messages: u64,
}

/// What a recording holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Facts that were known at the start.
    pub facts: BTreeMap<String, String>,
    /// Topics in order of name.
    pub topics: Vec<Topic>,
    /// Attachments: name and bytes.
    pub attachments: BTreeMap<String, Vec<u8>>,
    /// `/joint_states`.
    pub joint_states: Vec<JointRecord>,
    /// `/setpoints`.
    pub setpoints: Vec<JointRecord>,
    /// `/targets`.
    pub targets: Vec<JointRecord>,
    /// `/human/keypoints`.
    pub keypoints: Vec<KeypointRecord>,
    /// First and last time of a message, nanoseconds since 1970.
    pub time_range_ns: Option<(u64, u64)>,
    /// Why reading stopped before the end of the file; `None` for a whole recording.
    pub cut: Option<String>,
}

impl Recording {
    /// Time from the first message to the last.
    pub fn duration(&self) -> Duration {
        self.time_range_ns.map_or(Duration::ZERO, |(first, last)| Duration::from_nanos(last - first))
    }
}

/// Reads a recording.
///
/// # Errors
///
/// [`Error::Read`] if the file cannot be read, [`Error::NotMcap`] if it does not start like an MCAP file. A recording that is cut short
/// or damaged further on is no error: see [`Recording::cut`].
pub fn open(path: &Path) -> Result<Recording, Error> {
    let read = |source| Error::Read { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(read)?;
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = LinearReader::new_with_options(options);
    let mut contents = Contents::default();
    let mut offset = 0_u64;
    while let Some(event) = reader.next_event() {
        let result = match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let got = file.read(reader.insert(wanted)).map_err(read)?;
                reader.notify_read(got);
                offset += got as u64;
                Ok(())
            }
            Ok(LinearReadEvent::Record { data, opcode }) => contents.take(opcode, data),
            Err(error) => Err(error.to_string()),
        };
        match result {
            Ok(()) => {}
            Err(error) if !contents.started => {
                return Err(Error::NotMcap { path: path.to_owned(), message: error });
            }
            Err(error) => {
                contents.recording.cut = Some(format!("before byte {offset}: {error}"));
                break;
            }
        }
    }
    if !contents.started {
        return Err(Error::NotMcap { path: path.to_owned(), message: "an empty file".to_owned() });
    }
    Ok(contents.finish())
}

#[derive(Default)]
struct Contents {
    recording: Recording,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Topic>,
    started: bool,
    /// Each channel numbers its messages from 0 without a gap, as this project's writer does.
    counted: bool,
}

impl Contents {
    fn take(&mut self, opcode: u8, data: &[u8]) -> Result<(), String> {
        if opcode == op::ATTACHMENT && !attachment_fits(data) {
            return Err("an attachment whose lengths do not add up".to_owned());
        }
        match parse_record(opcode, data).map_err(|error| error.to_string())? {
            Record::Header(header) => {
                self.started = true;
                self.counted = header.library.starts_with("ogg/");
            }
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let encoding = channel.message_encoding;
                self.channels.entry(channel.id).or_insert(Topic { name: channel.topic, schema, encoding, messages: 0 });
            }
            Record::Message { header, data } => {
                let Some(topic) = self.channels.get_mut(&header.channel_id) else {
                    return Err(format!("message {} of unknown channel {}", header.sequence, header.channel_id));
                };
                // A damaged opcode looks like a record of a later version, which readers pass over.
                if self.counted && header.sequence != topic.messages as u32 {
                    return Err(format!(
                        "{}: message {} is missing, {} follows",
                        topic.name, topic.messages, header.sequence
                    ));
                }
                topic.messages += 1;
                let time_ns = header.log_time;
                let range = self.recording.time_range_ns.get_or_insert((time_ns, time_ns));
                *range = (range.0.min(time_ns), range.1.max(time_ns));
                let topic = topic.name.clone();
                self.message(&topic, time_ns, &data)?;
            }
            Record::Metadata(record) if record.name == "ogg" => self.recording.facts.extend(record.metadata),
            Record::Attachment { header, data, .. } => {
                self.recording.attachments.insert(header.name, data.into_owned());
            }
            _ => {}
        }
        Ok(())
    }

    fn message(&mut self, topic: &str, time_ns: u64, data: &[u8]) -> Result<(), String> {
        let broken = |error: prost::DecodeError| format!("{topic}: {error}");
        for stream in [JointStream::Measured, JointStream::Setpoint, JointStream::Target] {
            if topic == joint_topic(stream) {
                let message = JointStates::decode(data).map_err(broken)?;
                let joints = message
                    .joints
                    .into_iter()
                    .map(|joint| JointValue {
                        name: joint.name,
                        position: joint.position,
                        velocity: joint.velocity,
                        acceleration: joint.acceleration,
                        effort: joint.effort,
                    })
                    .collect();
                let records = match stream {
                    JointStream::Measured => &mut self.recording.joint_states,
                    JointStream::Setpoint => &mut self.recording.setpoints,
                    JointStream::Target => &mut self.recording.targets,
                };
                records.push(JointRecord { time_ns, joints });
                return Ok(());
            }
        }
        if topic == KEYPOINTS_TOPIC {
            let message = KeypointsMessage::decode(data).map_err(broken)?;
            let points = message
                .keypoints
                .into_iter()
                .map(|point| SpacePoint {
                    name: point.name,
                    position_m: [point.x, point.y, point.z],
                    covariance_m2: point.covariance.try_into().ok(),
                    state: state_from(&point.state),
                })
                .collect();
            self.recording.keypoints.push(KeypointRecord { time_ns, frame: message.frame_id, points });
        }
        Ok(())
    }

    fn finish(mut self) -> Recording {
        self.recording.topics = self.channels.into_values().collect();
        self.recording.topics.sort_by(|a, b| a.name.cmp(&b.name));
        self.recording
    }
}

/// A word this version does not know gives no position to trust.
fn state_from(name: &str) -> KeypointState {
    [KeypointState::Measured, KeypointState::Inferred]
        .into_iter()
        .find(|&state| state_name(state) == name)
        .unwrap_or(KeypointState::Lost)
}

/// Checks the lengths inside an attachment record, which its parser takes on trust.
fn attachment_fits(data: &[u8]) -> bool {
    fn skip_text(data: &[u8]) -> Option<&[u8]> {
        let (length, rest) = data.split_first_chunk::<4>()?;
        rest.get(u32::from_le_bytes(*length) as usize..)
    }
    let fields = data.get(16..).and_then(skip_text).and_then(skip_text);
    let Some((length, rest)) = fields.and_then(<[u8]>::split_first_chunk::<8>) else { return false };
    rest.len().checked_sub(4).is_some_and(|room| u64::from_le_bytes(*length) == room as u64)
}

#[cfg(test)]
mod tests;
