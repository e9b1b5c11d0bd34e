//! [`McapReader`]: reads a file from its beginning to its end.

use embedded_io::{Read, ReadExactError};

use crate::pairs::{NamePairs, bytes, text};
use crate::record::{HEAD_BYTES, MAGIC, MessageHead, opcode};

/// A reader of an MCAP file, which returns one record after the other.
///
/// ```
/// use condor_mcap::{McapReader, McapRecord, McapWriter};
///
/// let mut file = [0; 256];
/// let mut writer = McapWriter::new(&mut file[..], "", "my-robot")?;
/// writer.metadata("robot", &[("name", "hand")])?;
/// writer.end()?;
///
/// let (mut reader, mut buffer) = (McapReader::new(&file[..])?, [0; 64]);
/// while let Some(record) = reader.next(&mut buffer)? {
///     if let McapRecord::Metadata { name, pairs } = record {
///         assert_eq!((name, pairs.get("name")), ("robot", Some("hand")));
///     }
/// }
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct McapReader<R> {
    from: R,
    part: FilePosition,
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FilePosition {
    Data,
    /// After the data: the rest of the file repeats or describes the data.
    Summary,
    End,
}

/// A record that [`McapReader::next`] returns: the header, names with values, a schema, a channel
/// or a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum McapRecord<'b> {
    /// The first record of a file.
    Header {
        /// The convention that its messages follow; may be empty.
        profile: &'b str,
        /// The library that wrote the file.
        library: &'b str,
    },
    /// Names with values that belong to the whole file.
    Metadata {
        /// The subject of the names and values.
        name: &'b str,
        /// The names and values.
        pairs: NamePairs<'b>,
    },
    /// The description of the messages of a type.
    Schema {
        /// The number by which channels name the schema.
        number: u16,
        /// The name of the type.
        name: &'b str,
        /// The language of the description.
        encoding: &'b str,
        /// The description.
        data: &'b [u8],
    },
    /// A topic.
    Channel {
        /// The number by which messages name the channel.
        number: u16,
        /// The number of the schema of its messages; 0 for none.
        schema: u16,
        /// The name of the topic.
        topic: &'b str,
        /// The encoding of its messages, such as `cdr`.
        encoding: &'b str,
        /// Names with values that belong to the channel.
        metadata: NamePairs<'b>,
    },
    /// A message with its data.
    Message(MessageHead, &'b [u8]),
}

/// The reason why an MCAP file, or its next record, cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum McapError<E> {
    /// The source returned this error.
    #[error(transparent)]
    Io(E),
    /// The file does not begin as MCAP files do.
    #[error("it is not an MCAP file: it begins with {found:02x?}")]
    Magic {
        /// The first bytes.
        found: [u8; 8],
    },
    /// The file ends before its last record.
    #[error("the file ends in the middle of a record")]
    BrokenOff,
    /// A record is longer than the buffer.
    #[error("a record of kind {opcode:#04x} has {bytes} bytes, but the buffer has room for {room}")]
    Room {
        /// The kind of the record.
        opcode: u8,
        /// The number of bytes of its body.
        bytes: u64,
        /// The length of the buffer.
        room: usize,
    },
    /// The body of a record is not that of its kind.
    #[error("a record of kind {opcode:#04x} with {bytes} bytes is invalid")]
    Invalid {
        /// The kind of the record.
        opcode: u8,
        /// The number of bytes of its body.
        bytes: u64,
    },
    /// The file has messages in chunks, which this reader does not take apart.
    #[error(
        "its messages are in chunks, which this reader does not support; write the file without chunks"
    )]
    Chunk,
}

impl<E> From<ReadExactError<E>> for McapError<E> {
    fn from(error: ReadExactError<E>) -> Self {
        match error {
            ReadExactError::UnexpectedEof => Self::BrokenOff,
            ReadExactError::Other(error) => Self::Io(error),
        }
    }
}

impl<R: Read> McapReader<R> {
    /// Begins to read the MCAP file in `from`, and checks its first 8 bytes.
    ///
    /// # Errors
    /// [`McapError::Magic`] if the file does not begin as MCAP files do; [`McapError::BrokenOff`] if the file is
    /// shorter than these bytes; [`McapError::Io`] with the error of `from` if reading fails.
    pub fn new(mut from: R) -> Result<Self, McapError<R::Error>> {
        let mut found = [0; 8];
        from.read_exact(&mut found)?;
        if found != MAGIC {
            return Err(McapError::Magic { found });
        }
        let part = FilePosition::Data;
        Ok(Self { from, part })
    }

    /// Reads the next record into `buffer` and returns it; returns `None` at the end of the file.
    /// Skips records of kinds that [`McapRecord`] does not have, and the summary at the end of a
    /// file.
    ///
    /// # Errors
    /// [`McapError::BrokenOff`] if the file ends before its last record, [`McapError::Room`] if the
    /// buffer is too short, [`McapError::Invalid`] if the record is not what its kind says,
    /// [`McapError::Chunk`] if messages are in chunks, [`McapError::Io`] with the error of the
    /// source if reading fails. After an error the place in the file is unknown, so that the reader
    /// cannot go on.
    pub fn next<'b>(
        &mut self,
        buffer: &'b mut [u8],
    ) -> Result<Option<McapRecord<'b>>, McapError<R::Error>> {
        while self.part != FilePosition::End {
            let mut head = [0; HEAD_BYTES];
            self.from.read_exact(&mut head)?;
            let [opcode, bytes @ ..] = head;
            let bytes = u64::from_le_bytes(bytes);
            match opcode {
                opcode::FOOTER => {
                    self.skip(bytes)?;
                    let mut magic = [0; 8];
                    self.from.read_exact(&mut magic)?;
                    if magic != MAGIC {
                        return Err(McapError::Invalid { opcode, bytes });
                    }
                    self.part = FilePosition::End;
                }
                _ if self.part == FilePosition::Summary => self.skip(bytes)?,
                opcode::DATA_END => {
                    self.skip(bytes)?;
                    self.part = FilePosition::Summary;
                }
                opcode::CHUNK => return Err(McapError::Chunk),
                opcode::HEADER
                | opcode::METADATA
                | opcode::SCHEMA
                | opcode::CHANNEL
                | opcode::MESSAGE => {
                    let room = buffer.len();
                    let body = usize::try_from(bytes).ok();
                    let body = body.and_then(|bytes| buffer.get_mut(..bytes));
                    let body = body.ok_or(McapError::Room {
                        opcode,
                        bytes,
                        room,
                    })?;
                    self.from.read_exact(body)?;
                    let record = McapRecord::of(opcode, body);
                    return match record {
                        Some(record) => Ok(Some(record)),
                        None => Err(McapError::Invalid { opcode, bytes }),
                    };
                }
                _ => self.skip(bytes)?,
            }
        }
        Ok(None)
    }

    fn skip(&mut self, mut bytes: u64) -> Result<(), McapError<R::Error>> {
        let mut piece = [0; 64];
        while bytes > 0 {
            let len = bytes.min(piece.len() as u64);
            let piece = piece.get_mut(..len as usize).unwrap_or_default();
            self.from.read_exact(piece)?;
            bytes -= len;
        }
        Ok(())
    }
}

impl<'b> McapRecord<'b> {
    /// Takes the body of a record apart; `None` if it is not that of its kind.
    fn of(opcode: u8, body: &'b [u8]) -> Option<Self> {
        Some(match opcode {
            opcode::HEADER => {
                let (profile, rest) = text(body)?;
                let (library, _) = text(rest)?;
                Self::Header { profile, library }
            }
            opcode::METADATA => {
                let (name, rest) = text(body)?;
                let (pairs, _) = NamePairs::split(rest)?;
                Self::Metadata { name, pairs }
            }
            opcode::SCHEMA => {
                let (number, rest) = body.split_first_chunk()?;
                let (name, rest) = text(rest)?;
                let (encoding, rest) = text(rest)?;
                let (data, _) = bytes(rest)?;
                Self::Schema {
                    number: u16::from_le_bytes(*number),
                    name,
                    encoding,
                    data,
                }
            }
            opcode::CHANNEL => {
                let (number, rest) = body.split_first_chunk()?;
                let (schema, rest) = rest.split_first_chunk()?;
                let (topic, rest) = text(rest)?;
                let (encoding, rest) = text(rest)?;
                let (metadata, _) = NamePairs::split(rest)?;
                Self::Channel {
                    number: u16::from_le_bytes(*number),
                    schema: u16::from_le_bytes(*schema),
                    topic,
                    encoding,
                    metadata,
                }
            }
            _ => {
                let (message, data) = MessageHead::split(body)?;
                Self::Message(message, data)
            }
        })
    }
}
