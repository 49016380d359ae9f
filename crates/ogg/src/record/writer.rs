//! The MCAP file itself: channels, chunks, metadata and attachments.
//!
//! No clock and no thread here; the writing thread says when to flush.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::{Seek, Write};

use mcap::records::MessageHeader;
use mcap::{Attachment, McapError, WriteOptions, Writer};

use super::encode::{Encoded, Schema};
use super::schema::cdr_string;

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Zstandard: the smaller file.
    #[default]
    Zstd,
    /// LZ4: the faster writer.
    Lz4,
    /// None.
    Off,
}

#[derive(Debug, Clone, Copy)]
struct Channel {
    id: u16,
    next_sequence: u32,
}

/// An open recording.
pub(super) struct McapFile<W: Write + Seek> {
    writer: Writer<W>,
    channels: HashMap<String, Channel>,
    messages: u64,
}

/// A chunk is closed at this size even between flushes, which bounds what one damaged chunk can take with it.
const CHUNK_BYTES: u64 = 1 << 20;

impl<W: Write + Seek> McapFile<W> {
    pub(super) fn new(disk: W, compression: Compression) -> Result<Self, McapError> {
        let compression = match compression {
            Compression::Zstd => Some(mcap::Compression::Zstd),
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Off => None,
        };
        let writer = WriteOptions::new()
            .compression(compression)
            // Compression threads would compete with the control loop and inference for cores.
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .library(concat!("ogg/", env!("CARGO_PKG_VERSION")))
            .create(disk)?;
        Ok(Self { writer, channels: HashMap::new(), messages: 0 })
    }

    pub(super) fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), McapError> {
        self.writer.write_metadata(&mcap::records::Metadata { name: name.to_owned(), metadata })
    }

    pub(super) fn attach(&mut self, time_ns: u64, name: &str, kind: &str, data: &[u8]) -> Result<(), McapError> {
        self.writer.attach(&Attachment {
            log_time: time_ns,
            create_time: time_ns,
            name: name.to_owned(),
            media_type: kind.to_owned(),
            data: Cow::Borrowed(data),
        })
    }

    /// The robot's URDF on `/robot_description`.
    pub(super) fn robot_description(&mut self, time_ns: u64, urdf: &str) -> Result<(), McapError> {
        let schema = Schema {
            name: "std_msgs/msg/String".to_owned(),
            encoding: "ros2msg".to_owned(),
            data: b"string data\n".to_vec(),
        };
        let channel = self.add_channel("/robot_description", &schema, "cdr")?;
        self.message(channel, time_ns, &cdr_string(urdf))
    }

    pub(super) fn write(&mut self, time_ns: u64, message: &Encoded) -> Result<(), McapError> {
        let channel = match self.channels.get_mut(&message.topic) {
            Some(channel) => {
                channel.next_sequence = channel.next_sequence.wrapping_add(1);
                *channel
            }
            None => self.add_channel(&message.topic, &(message.schema)(), "protobuf")?,
        };
        self.message(channel, time_ns, &message.bytes)
    }

    fn add_channel(&mut self, topic: &str, schema: &Schema, encoding: &str) -> Result<Channel, McapError> {
        let schema_id = self.writer.add_schema(&schema.name, &schema.encoding, &schema.data)?;
        let id = self.writer.add_channel(schema_id, topic, encoding, &BTreeMap::new())?;
        let channel = Channel { id, next_sequence: 0 };
        self.channels.insert(topic.to_owned(), channel);
        Ok(channel)
    }

    fn message(&mut self, channel: Channel, time_ns: u64, bytes: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.next_sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.writer.write_to_known_channel(&header, bytes)?;
        self.messages += 1;
        Ok(())
    }

    pub(super) fn messages(&self) -> u64 {
        self.messages
    }

    /// Ends the chunk: everything so far can be read even if nothing follows.
    pub(super) fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()
    }

    /// Writes summary and footer.
    pub(super) fn finish(mut self) -> Result<u64, McapError> {
        self.writer.finish()?;
        self.writer.into_inner().flush()?;
        Ok(self.messages)
    }
}
