//! The numbers of records, and [`MessageHead`].

/// The bytes with which a file begins and ends.
pub(crate) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// The kinds of records: <https://mcap.dev/spec>.
pub(crate) mod opcode {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const METADATA: u8 = 0x0c;
    pub(crate) const DATA_END: u8 = 0x0f;
}

/// The head of a message in an MCAP file: its channel, its number in the channel, and its time. The
/// data of the message follows the head.
///
/// In the file, the time of publication of the message is the same as its log time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageHead {
    /// The number of the channel to which the message belongs.
    pub channel: u16,
    /// The number of the message in its channel.
    pub sequence: u32,
    /// The time of the message, in nanoseconds since an instant that the recording chooses.
    pub log_time_ns: u64,
}

impl MessageHead {
    /// The number of bytes that the record of a message has before the data.
    pub const HEAD_BYTES: usize = HEAD_BYTES + FIXED_BYTES;

    /// Returns the bytes that the record of this message has before the data. `data_bytes` is the
    /// number of bytes of the data.
    #[must_use]
    pub fn head(&self, data_bytes: usize) -> [u8; Self::HEAD_BYTES] {
        let mut head = [0; Self::HEAD_BYTES];
        let bytes = head_of(opcode::MESSAGE, FIXED_BYTES.saturating_add(data_bytes));
        let time = self.log_time_ns.to_le_bytes();
        let parts: [&[u8]; 5] = [
            &bytes,
            &self.channel.to_le_bytes(),
            &self.sequence.to_le_bytes(),
            &time,
            &time,
        ];
        let bytes = parts.into_iter().flatten();
        for (to, from) in head.iter_mut().zip(bytes) {
            *to = *from;
        }
        head
    }

    /// Splits the body of a record; `None` if it is too short.
    pub(crate) fn split(body: &[u8]) -> Option<(Self, &[u8])> {
        let (channel, rest) = body.split_first_chunk()?;
        let (sequence, rest) = rest.split_first_chunk()?;
        let (log_time, rest) = rest.split_first_chunk()?;
        let (_publish_time, data) = rest.split_first_chunk::<8>()?;
        let message = Self {
            channel: u16::from_le_bytes(*channel),
            sequence: u32::from_le_bytes(*sequence),
            log_time_ns: u64::from_le_bytes(*log_time),
        };
        Some((message, data))
    }
}

/// Opcode and length.
pub(crate) const HEAD_BYTES: usize = 1 + 8;
/// Channel, sequence number and two times.
const FIXED_BYTES: usize = 2 + 4 + 8 + 8;

/// Returns the head of a record whose body has `bytes` bytes.
pub(crate) fn head_of(opcode: u8, bytes: usize) -> [u8; HEAD_BYTES] {
    let mut head = [opcode; HEAD_BYTES];
    let length = (bytes as u64).to_le_bytes();
    for (to, from) in head.iter_mut().skip(1).zip(length) {
        *to = from;
    }
    head
}
