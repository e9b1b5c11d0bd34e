//! [`PacketStream`]: a connection of GDB, and its packets.
//!
//! A packet is `$`, its bytes, `#`, and the sum of its bytes in two hexadecimal digits. Both sides acknowledge
//! packets by `+`, and ask for them again by `-`, until GDB says that this is not needed. A notification
//! begins with `%` and is not acknowledged. A byte of 3 stops the program.

use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;
use std::os::fd::OwnedFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;

/// Bytes that are read or written at once.
const CHUNK: usize = 1 << 16;
/// The time that GDB may take to accept an answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// The greatest size of a packet.
pub(super) const PACKET_BYTES: usize = 1 << 15;
const INTERRUPT: u8 = 3;
/// Bytes with which a packet or an acknowledgement begins, or an interrupt.
const BEGINNINGS: [u8; 4] = [b'$', b'+', b'-', INTERRUPT];

/// A connection to GDB, which divides the bytes that arrive into packets of GDB's remote protocol.
/// Pass it to [`Session::serve`](super::Session::serve).
#[derive(Debug)]
pub struct PacketStream {
    file: std::fs::File,
    read: Vec<u8>,
    at: usize,
    /// The last packet that was sent.
    sent: Vec<u8>,
    acknowledges: bool,
}

/// A message from GDB.
#[derive(Debug)]
pub(super) enum GdbInput {
    Packet(Vec<u8>),
    /// GDB wants the program to be stopped.
    Interrupt,
}

impl PacketStream {
    /// Makes the stream of `socket`, a connected TCP or Unix socket.
    ///
    /// # Errors
    /// [`io::Error`] if the socket cannot be set up.
    pub fn new(socket: impl Into<OwnedFd>) -> io::Result<Self> {
        let socket: OwnedFd = socket.into();
        // Packets are small, and each waits for the one before. A Unix socket has no such option.
        let tcp = TcpStream::from(socket);
        let _ = tcp.set_nodelay(true);
        let socket = OwnedFd::from(tcp);
        rustix::net::sockopt::set_socket_timeout(
            &socket,
            rustix::net::sockopt::Timeout::Send,
            Some(PATIENCE),
        )?;
        Ok(Self {
            file: socket.into(),
            read: Vec::new(),
            at: 0,
            sent: Vec::new(),
            acknowledges: true,
        })
    }

    /// Waits for the first byte, for at most `limit`. Returns true if it is a byte with which GDB begins. Returns false
    /// if no byte has come, or another one, such as the first of HTTP.
    ///
    /// # Errors
    /// [`io::Error`] if the connection fails.
    pub fn begins(&mut self, limit: Duration) -> io::Result<bool> {
        if self.at == self.read.len() && self.is_readable(limit)? {
            self.fill()?;
        }
        let first = self.read.get(self.at);
        Ok(first.is_some_and(|first| BEGINNINGS.contains(first)))
    }

    /// The next packet or interrupt; `None` if none comes until `limit`, or soon after.
    pub(super) fn hear(&mut self, limit: Duration) -> io::Result<Option<GdbInput>> {
        loop {
            if let Some(heard) = self.parse()? {
                return Ok(Some(heard));
            }
            if !self.is_readable(limit)? {
                return Ok(None);
            }
            self.fill()?;
        }
    }

    /// Sends a packet.
    pub(super) fn send(&mut self, packet: &[u8]) -> io::Result<()> {
        self.sent = framed(b'$', packet);
        self.file.write_all(&self.sent)
    }

    /// Sends a notification.
    pub(super) fn notify(&mut self, packet: &[u8]) -> io::Result<()> {
        self.file.write_all(&framed(b'%', packet))
    }

    /// Packets are not acknowledged any more.
    pub(super) const fn stop_acknowledging(&mut self) {
        self.acknowledges = false;
    }

    fn parse(&mut self) -> io::Result<Option<GdbInput>> {
        while let Some(rest) = self.read.get(self.at..)
            && let Some(first) = rest.first()
        {
            match first {
                b'$' => {
                    let end = rest.iter().position(|byte| *byte == b'#');
                    let whole = end.and_then(|end| Some((end, rest.get(end + 1..end + 3)?)));
                    let Some((end, sum)) = whole else {
                        return Ok(None);
                    };
                    let packet = rest.get(1..end).unwrap_or_default().to_vec();
                    let is_right = hex(sum) == Some(u64::from(checksum(&packet)));
                    self.at += end + 3;
                    if self.acknowledges {
                        self.file.write_all(if is_right { b"+" } else { b"-" })?;
                    }
                    if is_right {
                        return Ok(Some(GdbInput::Packet(packet)));
                    }
                }
                // Without acknowledgements GDB says it, too, when an answer takes longer than it expects.
                b'-' if self.acknowledges => {
                    self.at += 1;
                    self.file.write_all(&self.sent)?;
                }
                &INTERRUPT => {
                    self.at += 1;
                    return Ok(Some(GdbInput::Interrupt));
                }
                // An acknowledgement, or nothing that means anything.
                _ => self.at += 1,
            }
        }
        Ok(None)
    }

    /// Waits for bytes until `limit`.
    fn is_readable(&self, limit: Duration) -> io::Result<bool> {
        let limit = Timespec::try_from(limit).unwrap_or_default();
        let mut polled = [PollFd::new(&self.file, PollFlags::IN)];
        match rustix::event::poll(&mut polled, Some(&limit)) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads the bytes that have come, and puts them behind those that do not yet make a whole packet.
    fn fill(&mut self) -> io::Result<()> {
        self.read.drain(..self.at);
        self.at = 0;
        let before = self.read.len();
        if before > 2 * PACKET_BYTES {
            let text = "a packet is larger than any that GDB was told to send";
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        self.read.resize(before + CHUNK, 0);
        let read = loop {
            match self
                .file
                .read(self.read.get_mut(before..).unwrap_or_default())
            {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => break other,
            }
        };
        self.read
            .truncate(before + read.as_ref().map_or(0, |read| *read));
        match read? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            _ => Ok(()),
        }
    }
}

fn checksum(packet: &[u8]) -> u8 {
    packet.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

fn framed(first: u8, packet: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(packet.len() + 4);
    bytes.push(first);
    bytes.extend_from_slice(packet);
    bytes.extend_from_slice(format!("#{:02x}", checksum(packet)).as_bytes());
    bytes
}

/// The number of hexadecimal digits, of at most 64 bits.
pub(super) fn hex(digits: &[u8]) -> Option<u64> {
    let is_number = !digits.is_empty() && digits.iter().all(u8::is_ascii_hexdigit);
    let text = core::str::from_utf8(digits).ok()?;
    is_number.then(|| u64::from_str_radix(text, 16).ok())?
}

/// The bytes of pairs of hexadecimal digits.
pub(super) fn unhex(digits: &[u8]) -> Option<Vec<u8>> {
    let (pairs, rest) = digits.as_chunks::<2>();
    let bytes = pairs.iter().map(|pair| hex(pair).map(|byte| byte as u8));
    rest.is_empty().then(|| bytes.collect())?
}

/// Bytes as pairs of hexadecimal digits.
pub(super) fn hexed(bytes: &[u8]) -> Vec<u8> {
    const DIGITS: [u8; 16] = *b"0123456789abcdef";
    let digit = |half: u8| DIGITS.get(usize::from(half)).copied().unwrap_or(b'0');
    let pairs = bytes
        .iter()
        .map(|byte| [digit(byte >> 4), digit(byte & 15)]);
    pairs.flatten().collect()
}

/// Bytes that GDB has escaped.
pub(super) fn unescaped(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.iter().copied();
    let mut plain = Vec::with_capacity(bytes.len());
    while let Some(byte) = bytes.next() {
        plain.push(match byte {
            b'}' => bytes.next().unwrap_or(0) ^ 0x20,
            byte => byte,
        });
    }
    plain
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bytes_come_back_as_they_went(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            prop_assert_eq!(unhex(&hexed(&bytes)), Some(bytes.clone()));
            let escaped = bytes.iter().flat_map(|&byte| match byte {
                b'#' | b'$' | b'}' | b'*' => vec![b'}', byte ^ 0x20],
                byte => vec![byte],
            });
            prop_assert_eq!(unescaped(&escaped.collect::<Vec<u8>>()), bytes);
        }
    }

    #[test]
    fn numbers_are_hexadecimal_digits_alone() {
        assert_eq!(hex(b"80001F"), Some(0x80_001f));
        for wrong in [b"".as_slice(), b"+1", b"g", b"10000000000000000"] {
            assert_eq!(hex(wrong), None);
        }
        assert_eq!(unhex(b"123"), None);
    }
}
