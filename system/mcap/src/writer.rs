//! [`McapWriter`]: writes a file.

use embedded_io::Write;

use crate::record::{MAGIC, MessageHead, head_of, opcode};

/// A writer of an MCAP file. Call [`end`](Self::end) after the last record.
///
/// ```
/// use condor_mcap::{McapWriter, MessageHead};
///
/// let mut file = [0; 512];
/// let mut writer = McapWriter::new(&mut file[..], "", "my-robot")?;
/// writer.schema(1, "my_robot/msg/Angle", "ros2msg", b"float64 angle # rad")?;
/// writer.channel(1, 1, "/wrist", "cdr", &[])?;
/// let message = MessageHead { channel: 1, sequence: 0, log_time_ns: 2_500_000 };
/// writer.message(&message, &[&[0, 1, 0, 0], &0.5_f64.to_le_bytes()])?;
/// let left = writer.end()?.len();
/// assert_eq!(&file[..8], b"\x89MCAP0\r\n");
/// # assert!(left > 0);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct McapWriter<W> {
    to: W,
}

impl<W: Write> McapWriter<W> {
    /// Begins an MCAP file in `to`. `profile` names the convention that its messages follow, and
    /// may be empty; `library` names the program that writes the file.
    ///
    /// # Errors
    /// Returns the error of `to` if writing fails. The file is incomplete then.
    pub fn new(mut to: W, profile: &str, library: &str) -> Result<Self, W::Error> {
        to.write_all(&MAGIC)?;
        let mut writer = Self { to };
        let texts = [profile, library].map(Part::Text);
        writer.record(opcode::HEADER, &texts)?;
        Ok(writer)
    }

    /// Writes names with values that belong to the whole file, such as versions. `name` is the
    /// subject of these pairs.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn metadata(&mut self, name: &str, pairs: &[(&str, &str)]) -> Result<(), W::Error> {
        self.record(opcode::METADATA, &[Part::Text(name), Part::Pairs(pairs)])
    }

    /// Writes a schema: the description of the messages of the type `name`. Channels refer to the
    /// schema by `number`, which must not be 0. `encoding` is the language of the description
    /// `data`, such as `ros2msg`.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn schema(
        &mut self,
        number: u16,
        name: &str,
        encoding: &str,
        data: &[u8],
    ) -> Result<(), W::Error> {
        let number = number.to_le_bytes();
        let (name, encoding) = (Part::Text(name), Part::Text(encoding));
        let parts = [Part::Raw(&number), name, encoding, Part::Bytes(data)];
        self.record(opcode::SCHEMA, &parts)
    }

    /// Writes a channel: the topic `topic`, to which messages refer by `number`. `schema` is the
    /// number of the schema of its messages, which was written before, or 0 if there is no schema.
    /// `encoding` says how the messages are encoded, such as `cdr`. `metadata` are names with
    /// values that belong to the channel.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn channel(
        &mut self,
        number: u16,
        schema: u16,
        topic: &str,
        encoding: &str,
        metadata: &[(&str, &str)],
    ) -> Result<(), W::Error> {
        let (number, schema) = (number.to_le_bytes(), schema.to_le_bytes());
        let parts = [
            Part::Raw(&number),
            Part::Raw(&schema),
            Part::Text(topic),
            Part::Text(encoding),
            Part::Pairs(metadata),
        ];
        self.record(opcode::CHANNEL, &parts)
    }

    /// Writes a message of a channel that was written before. The data of the message are the
    /// pieces of `data`, one after the other.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn message(&mut self, message: &MessageHead, data: &[&[u8]]) -> Result<(), W::Error> {
        let bytes = data.iter().map(|part| part.len()).sum();
        self.to.write_all(&message.head(bytes))?;
        data.iter().try_for_each(|part| self.to.write_all(part))
    }

    /// Writes `bytes` of messages that the caller has put together: for each message the bytes that
    /// [`MessageHead::head`] returns, then the data. A message may be written in several calls, but nothing else may be
    /// written before it is complete.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn records(&mut self, bytes: &[u8]) -> Result<(), W::Error> {
        self.to.write_all(bytes)
    }

    /// Writes the end of the file, and returns the destination, which may have to be flushed.
    ///
    /// # Errors
    /// Returns the error of the destination if writing fails.
    pub fn end(mut self) -> Result<W, W::Error> {
        // There are no checksum, summary, and offsets of one.
        self.record(opcode::DATA_END, &[Part::Raw(&[0; 4])])?;
        self.record(opcode::FOOTER, &[Part::Raw(&[0; 20])])?;
        self.to.write_all(&MAGIC)?;
        Ok(self.to)
    }

    fn record(&mut self, opcode: u8, parts: &[Part<'_>]) -> Result<(), W::Error> {
        let bytes = parts.iter().map(Part::bytes).sum();
        self.to.write_all(&head_of(opcode, bytes))?;
        parts.iter().try_for_each(|part| part.write(&mut self.to))
    }
}

/// A part of the body of a record.
enum Part<'p> {
    Raw(&'p [u8]),
    /// Bytes with their length before them.
    Bytes(&'p [u8]),
    Text(&'p str),
    Pairs(&'p [(&'p str, &'p str)]),
}

impl Part<'_> {
    fn bytes(&self) -> usize {
        match self {
            Self::Raw(bytes) => bytes.len(),
            Self::Bytes(bytes) => LENGTH + bytes.len(),
            Self::Text(text) => LENGTH + text.len(),
            Self::Pairs(pairs) => LENGTH + pairs_bytes(pairs),
        }
    }

    fn write<W: Write>(&self, to: &mut W) -> Result<(), W::Error> {
        match self {
            Self::Raw(bytes) => to.write_all(bytes),
            Self::Bytes(bytes) => {
                to.write_all(&length(bytes.len()))?;
                to.write_all(bytes)
            }
            Self::Text(text) => Self::Bytes(text.as_bytes()).write(to),
            Self::Pairs(pairs) => {
                to.write_all(&length(pairs_bytes(pairs)))?;
                let texts = pairs.iter().flat_map(|(name, value)| [name, value]);
                texts
                    .into_iter()
                    .try_for_each(|text| Self::Text(text).write(to))
            }
        }
    }
}

/// The number of bytes of a length.
const LENGTH: usize = 4;

const fn length(bytes: usize) -> [u8; LENGTH] {
    (bytes as u32).to_le_bytes()
}

fn pairs_bytes(pairs: &[(&str, &str)]) -> usize {
    let bytes = pairs
        .iter()
        .map(|(name, value)| 2 * LENGTH + name.len() + value.len());
    bytes.sum()
}
