//! Messages that describe a request by its difference from the client's former one, so that the
//! server need not read the slot. The bits of this module are added to the slot's offset, which is a
//! multiple of 64.

use super::{Operation, RequestSlot, following};

/// The bits of a message to the server that are not part of the offset of the slot. They are not 0
/// if the server need not read the slot, because the request differs little from the client's
/// former one.
pub const BITS: u32 = 63;
/// The bit of a message that says: the position is that of the former request.
pub const SAME: u32 = 1;
/// The bit of a message that says: the position is behind the bytes that the former request has
/// moved.
pub const ONWARDS: u32 = 2;
/// By how many bits the low bits of the sequence number are shifted.
const SEQUENCE_SHIFT: u32 = 2;

/// Returns true if `request` reads, writes or appends data: only such a request can be described by
/// the bits of a message.
#[must_use]
pub fn is_possible(request: &RequestSlot) -> bool {
    matches!(
        Operation::from_word(request.operation),
        Some(Operation::Read | Operation::Write | Operation::Append)
    )
}

/// Returns true if `bits` of a message describe a request: they have either [`SAME`] or
/// [`ONWARDS`].
#[must_use]
pub const fn is_message(bits: u32) -> bool {
    matches!(bits & (SAME | ONWARDS), SAME | ONWARDS)
}

/// Returns the bits of a message that describe `request` by its difference from `former`, the
/// client's request before it, whose answer was `value`. Returns 0 if bits cannot describe it, so
/// that the server must read the slot.
#[must_use]
pub fn bits(former: &RequestSlot, value: u64, request: &RequestSlot) -> u32 {
    let how = if request.position == former.position {
        SAME
    } else {
        ONWARDS
    };
    let bits = how | (request.sequence as u32) << SEQUENCE_SHIFT & BITS;
    match u32::try_from(value).map(|value| next(former, value, bits)) {
        Ok(Some(next)) if next == *request && is_possible(request) => bits,
        _ => 0,
    }
}

/// Returns the request that `bits` of a message describe, where `former` is the client's request
/// before it, whose answer was `value`. Returns `None` if the bits belong to another sequence
/// number, or describe no request.
#[must_use]
pub fn next(former: &RequestSlot, value: u32, bits: u32) -> Option<RequestSlot> {
    let sequence = following(former.sequence);
    if bits >> SEQUENCE_SHIFT != sequence as u32 & BITS >> SEQUENCE_SHIFT {
        return None;
    }
    let position = match bits & (SAME | ONWARDS) {
        SAME => former.position,
        ONWARDS => former.position.checked_add(value.into())?,
        _ => return None,
    };
    Some(RequestSlot {
        sequence,
        position,
        ..*former
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_that_follows_is_said_by_few_bits() {
        let former = RequestSlot {
            sequence: u64::from(u32::MAX),
            operation: Operation::Read as u32,
            position: 8,
            ..RequestSlot::default()
        };
        let at = |position| RequestSlot {
            sequence: following(former.sequence),
            position,
            ..former
        };
        for (request, value) in [(at(8), 5), (at(13), 5), (at(8), 0)] {
            let bits = bits(&former, value.into(), &request);
            assert!(bits != 0 && bits & !BITS == 0);
            assert_eq!(next(&former, value, bits), Some(request));
            assert_eq!(next(&request, value, bits), None, "it is not done twice");
        }
        let other = RequestSlot { file: 1, ..at(8) };
        let sync = Operation::Sync as u32;
        let [no_data, no_data_again] = [former, at(8)].map(|request| RequestSlot {
            operation: sync,
            ..request
        });
        for (former, value, request) in [
            (former, 5, at(12)),
            (former, 5, other),
            (former, 1 << 32, at(8)),
            (no_data, 0, no_data_again),
        ] {
            assert_eq!(bits(&former, value, &request), 0);
        }
    }
}
