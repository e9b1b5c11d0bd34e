//! [`Packet`]: a value of any type in a block of shared memory.

use core::marker::PhantomData;
use core::time::Duration;

use condor_mbox::exchange::Blocks;
use condor_mbox::{Call, Exchange, MemoryWindow, Messenger, Processor, Region, Vector};
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;
use zerocopy::little_endian::U32;
use zerocopy::{FromBytes, Immutable, IntoBytes};

mod error;

pub use error::ClientError;

/// A value of type `T` in the form in which it lies in shared memory: two words with the version of the protocol and
/// the number of bytes, and then at most `BYTES` bytes in the format of [postcard](https://postcard.jamesmunns.com).
///
/// A peer may have written anything: [`value`](Self::value) checks all of it.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Packet<T, const VERSION: u32, const BYTES: usize> {
    version: U32,
    length: U32,
    bytes: [u8; BYTES],
    of: PhantomData<fn() -> T>,
}

/// A [`Packet`] of a short request or response, as those to the table and the simulated robot are.
pub type ShortPacket<T> = Packet<T, 1, 56>;

/// The reason why a [`Packet`] has no value, or a value no packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PacketError {
    /// The packet has another version of its protocol.
    #[error(
        "the message has version {found} of its protocol, this program {wanted}; build both programs from the same \
         sources"
    )]
    Version {
        /// The version of the packet.
        found: u32,
        /// The version of this program.
        wanted: u32,
    },
    /// The bytes of the packet are none of a value.
    #[error("the message is malformed; build both programs from the same sources")]
    Malformed,
    /// The value does not fit into a packet.
    #[error("the message has more than the {most} bytes that fit into a block")]
    Length {
        /// The greatest number of bytes.
        most: usize,
    },
}

impl<T, const VERSION: u32, const BYTES: usize> Packet<T, VERSION, BYTES> {
    /// A packet without a value, with which a program answers what it cannot read. It has the version of the program.
    pub const EMPTY: Self = Self {
        version: U32::new(VERSION),
        length: U32::ZERO,
        bytes: [0; BYTES],
        of: PhantomData,
    };
}

impl<T: Serialize + DeserializeOwned, const VERSION: u32, const BYTES: usize>
    Packet<T, VERSION, BYTES>
{
    /// Makes the packet of a value.
    ///
    /// # Errors
    /// Returns [`PacketError::Length`] if the value does not fit, [`PacketError::Malformed`] if serde refuses it.
    pub fn new(value: &T) -> Result<Self, PacketError> {
        let mut packet = Self::EMPTY;
        let used = postcard::to_slice(value, &mut packet.bytes);
        let used = used.map_err(|error| match error {
            postcard::Error::SerializeBufferFull => PacketError::Length { most: BYTES },
            _ => PacketError::Malformed,
        })?;
        packet.length = (used.len() as u32).into();
        Ok(packet)
    }

    /// Makes the packet of a value, or an empty one if the value does not fit.
    pub(crate) fn of(value: &T) -> Self {
        Self::new(value).unwrap_or(Self::EMPTY)
    }

    /// Returns the value of the packet.
    ///
    /// # Errors
    /// Returns [`PacketError::Version`] if the packet has another version, [`PacketError::Malformed`] if its bytes are
    /// not those of a value.
    pub fn value(&self) -> Result<T, PacketError> {
        let found = self.version.get();
        if found != VERSION {
            let wanted = VERSION;
            return Err(PacketError::Version { found, wanted });
        }
        let bytes = usize::try_from(self.length.get()).ok();
        let bytes = bytes.and_then(|length| self.bytes.get(..length));
        match postcard::take_from_bytes(bytes.unwrap_or(&[])) {
            Ok((value, [])) => Ok(value),
            _ => Err(PacketError::Malformed),
        }
    }
}

/// Sends a request through an exchange of packets, and returns the response. Waits for at most `timeout`, and serves
/// messages meanwhile.
///
/// # Errors
/// Returns [`ClientError::Length`] if the request does not fit, [`ClientError::Exchange`] if it was not answered, and
/// [`ClientError::Version`] or [`ClientError::Protocol`] if the answer is none.
pub fn ask<M, W, Q, R, const VERSION: u32, const ASKED: usize, const TOLD: usize>(
    exchange: &mut Exchange<'_, M, W, Packet<Q, VERSION, ASKED>, Packet<R, VERSION, TOLD>>,
    to: Processor,
    vector: Vector,
    request: &Q,
    timeout: Duration,
) -> Result<R, ClientError>
where
    M: Messenger + ?Sized,
    W: MemoryWindow,
    Q: Serialize + DeserializeOwned,
    R: Serialize + DeserializeOwned,
{
    let wrong = |error| ClientError::packet(to, error);
    let request = Packet::new(request).map_err(wrong)?;
    let response = exchange.call(to, vector, &request, timeout)?;
    response.value().map_err(wrong)
}

/// Answers the request of a call with the value that `respond` makes of it, as [`Blocks::answer`] does. If the bytes are
/// not a request, the answer is an empty packet.
pub(crate) fn answer<W, Q, R, const VERSION: u32, const ASKED: usize, const TOLD: usize>(
    blocks: Blocks<Packet<Q, VERSION, ASKED>, Packet<R, VERSION, TOLD>>,
    call: &Call<'_>,
    own: &Region<W>,
    respond: impl FnOnce(Q) -> R,
) -> u32
where
    W: MemoryWindow,
    Q: Serialize + DeserializeOwned,
    R: Serialize + DeserializeOwned,
{
    blocks.answer(call, own, |request: Packet<Q, VERSION, ASKED>| {
        let request = request.value();
        request.map_or(Packet::EMPTY, |request| Packet::of(&respond(request)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::PlantRequest;
    use crate::table::TableRequest;

    type Short = Packet<(u32, bool), 7, 6>;

    #[test]
    fn a_value_comes_back_from_its_packet() {
        for value in [(0, false), (u32::MAX, true)] {
            assert_eq!(Short::new(&value).unwrap().value(), Ok(value));
        }
        let long = Packet::<u64, 7, 6>::new(&u64::MAX);
        assert_eq!(long.unwrap_err(), PacketError::Length { most: 6 });
    }

    #[test]
    fn the_longest_short_requests_fit() {
        let push = PlantRequest::PushTip {
            finger: u32::MAX,
            force: [1.0; 3],
            moment: [1.0; 3],
        };
        assert_eq!(ShortPacket::new(&push).unwrap().value(), Ok(push));
        let go = TableRequest::Move {
            to: [1.0; 3],
            speed: 1.0,
        };
        assert_eq!(ShortPacket::new(&go).unwrap().value(), Ok(go));
    }

    #[test]
    fn what_a_program_cannot_read_is_no_value() {
        let packet = Short::new(&(1, true)).unwrap();
        for (place, byte) in [(0, 8), (4, 1), (4, 3), (4, 200), (8, 255), (9, 2)] {
            let mut wrong = packet;
            wrong.as_mut_bytes()[place] = byte;
            let found = PacketError::Version {
                found: 8,
                wanted: 7,
            };
            let expected = if place == 0 {
                found
            } else {
                PacketError::Malformed
            };
            assert_eq!(wrong.value(), Err(expected), "byte {place} is {byte}");
        }
        assert_eq!(Short::EMPTY.value(), Err(PacketError::Malformed));
    }
}
