//! Requests to the supervisor: [`Supervisor`], by which a program restarts the program of a
//! processor, or loads another one.
//!
//! The supervisor carries a request out only if the system's description allows it to the
//! processor that asks. It answers a [`SupervisorRequest`] at once with a [`SupervisorResponse`], through a block of an
//! [`Exchange`]; the program asks for the outcome later.

use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{Allocator, Exchange, PeerState, Processor, Region};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::machine::{Machine, MailboxOf};
use crate::numbers::{REQUESTS, SUPERVISOR};
use crate::text::ShortText;

/// The time that the supervisor may take to answer.
const ANSWER: Duration = Duration::from_secs(5);

/// The greatest length of the words of a request, and of the text of a response, in bytes.
const WORDS: usize = 368;
const TEXT: usize = 240;

/// The values of [`SupervisorRequest::operation`], one for each operation of the supervisor that a
/// program can ask for.
pub mod operation {
    /// Restarts the program of a processor. The request has one word: the name or number of the
    /// processor.
    pub const RESTART: u32 = 1;
    /// Ends the program of a processor, if it runs, and starts another one there. The words of the
    /// request are the name or number of the processor, the program, and its arguments.
    pub const LOAD: u32 = 2;
    /// Asks for the outcome of an earlier request, whose number is in the request's field `number`.
    /// The request has no words.
    pub const OUTCOME: u32 = 3;
    /// Asks for the name of a processor, whose number is in the request's field `number`. The
    /// request has no words. Any processor may ask.
    pub const NAME: u32 = 4;
}

/// The values of [`SupervisorResponse::state`], which say what has become of a request.
pub mod state {
    /// The supervisor has accepted the request and is carrying it out.
    pub const PENDING: u32 = 1;
    /// The request has been carried out. If it asked for a [name](super::operation::NAME), the text
    /// of the response is that name.
    pub const DONE: u32 = 2;
    /// The request was refused, or has failed; the text of the response says why.
    pub const REFUSED: u32 = 3;
    /// The supervisor knows no request, or no processor, with the number in the request.
    pub const UNKNOWN: u32 = 4;
}

/// A request from a program to the supervisor, as it lies in shared memory. [`Supervisor`] makes
/// and sends it.
#[derive(Clone, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct SupervisorRequest {
    /// The operation to carry out: a constant of [`operation`].
    pub operation: u32,
    /// The number of the request whose outcome is asked for, or of the processor whose name is asked
    /// for; otherwise 0.
    pub number: u32,
    /// The length of the words, in bytes.
    pub len: u32,
    /// Always 0.
    pub zero: u32,
    /// The words in UTF-8, each with a zero byte at its end.
    pub words: [u8; WORDS],
}

impl SupervisorRequest {
    /// Makes a request for `operation`, one of the constants of [`operation`], with `number` and
    /// `words`. Returns `None` if the words, each with a zero byte at its end, take more than 368
    /// bytes, or if a word contains a zero byte.
    #[must_use]
    pub fn new<'w>(
        operation: u32,
        number: u32,
        words: impl IntoIterator<Item = &'w str>,
    ) -> Option<Self> {
        let (mut bytes, mut len) = ([0; WORDS], 0);
        for word in words {
            let end = word.len().checked_add(len)?;
            // With the zero byte at its end.
            if end >= WORDS || word.bytes().any(|byte| byte == 0) {
                return None;
            }
            bytes.get_mut(len..end)?.copy_from_slice(word.as_bytes());
            len = end + 1;
        }
        Some(Self {
            operation,
            number,
            len: len as u32,
            zero: 0,
            words: bytes,
        })
    }

    /// Iterates over the words of the request. Returns `None` if the request is invalid: its words
    /// are not UTF-8, its length is greater than the room for words, or its last word does not end
    /// with a zero byte.
    #[must_use]
    pub fn words(&self) -> Option<impl Iterator<Item = &str>> {
        let bytes = self.words.get(..self.len as usize)?;
        let text = core::str::from_utf8(bytes).ok()?;
        let ends = text.is_empty() || text.ends_with('\0');
        ends.then(|| text.split_terminator('\0'))
    }
}

/// The supervisor's answer to a [`SupervisorRequest`], as it lies in shared memory.
#[derive(Clone, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct SupervisorResponse {
    /// The state of the request: a constant of [`state`].
    pub state: u32,
    /// The number of the request.
    pub number: u32,
    /// The length of the text, in bytes.
    pub len: u32,
    /// Always 0.
    pub zero: u32,
    /// The reason in UTF-8 if the request was refused, or the name that was asked for.
    pub text: [u8; TEXT],
}

impl SupervisorResponse {
    /// Makes a response to the request `number`. `state` is one of the constants of [`state`], and
    /// `text` is the reason or the name; its first 240 bytes are kept.
    #[must_use]
    pub fn new(state: u32, number: u32, text: &str) -> Self {
        let cut = ShortText::<TEXT>::of(text);
        let mut bytes = [0; TEXT];
        let kept = cut.as_str().as_bytes();
        for (to, from) in bytes.iter_mut().zip(kept) {
            *to = *from;
        }
        Self {
            state,
            number,
            len: kept.len() as u32,
            zero: 0,
            text: bytes,
        }
    }

    /// Returns the text of the response; empty if its bytes are not UTF-8, or if its length is
    /// greater than the room for it.
    #[must_use]
    pub fn text(&self) -> &str {
        let bytes = self.text.get(..self.len as usize);
        bytes
            .and_then(|bytes| core::str::from_utf8(bytes).ok())
            .unwrap_or_default()
    }
}

/// A client that sends requests to the supervisor: to restart and load programs of processors, and
/// to look up their names. [`Background::supervisor`] returns it.
///
/// [`Background::supervisor`]: crate::Background::supervisor
pub struct Supervisor<'b, M: Machine> {
    mailbox: &'b MailboxOf<'b, M>,
    exchange: Exchange<'b, MailboxOf<'b, M>, M::Window, SupervisorRequest, SupervisorResponse>,
    reason: ShortText<TEXT>,
}

/// The number of a request that the supervisor has accepted. Pass it to [`Supervisor::outcome`] to
/// find out whether the request has been carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorTicket(u32);

/// The reason why the supervisor has not carried out a request, or why it could not be asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SupervisorError {
    /// No supervisor runs: `condor` did not bring the system up.
    #[error("there is no supervisor: only a system that `condor up` has brought up has one")]
    Absent,
    /// The words do not fit into a request, or one of them contains a zero byte.
    #[error("the names and arguments are too long for a request, which has room for {WORDS} bytes")]
    TooLong,
    /// The supervisor refused the request, or could not carry it out;
    /// [`reason`](Supervisor::reason) says why.
    #[error("the supervisor refused the request; `Supervisor::reason` says why")]
    Refused,
    /// The supervisor does not know the request: a later request, or one of an earlier incarnation of this
    /// program, has taken its place, or the answer has an unknown state.
    #[error(
        "the supervisor does not know the request any more, which may have been carried out: a later one took its place, \
         or this program was restarted (state {state} in the answer); make the request again"
    )]
    Unknown {
        /// The state in the answer.
        state: u32,
    },
    /// The supervisor did not answer, or the block of the request could not be accessed.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
}

impl<'b, M: Machine> Supervisor<'b, M> {
    /// The size of the block in shared memory, in bytes.
    pub(crate) const BYTES: usize =
        Exchange::<'b, MailboxOf<'b, M>, M::Window, SupervisorRequest, SupervisorResponse>::BYTES;

    pub(crate) fn new(
        mailbox: &'b MailboxOf<'b, M>,
        own: Region<M::Window>,
        mut allocator: Allocator,
    ) -> Result<Self, crate::ProgramError> {
        let exchange = Exchange::new(mailbox, own, &mut allocator)?;
        Ok(Self {
            mailbox,
            exchange,
            reason: ShortText::of(""),
        })
    }

    /// Returns the reason that the supervisor stated when it refused a request last, or could not
    /// carry it out; empty before the first such request.
    #[must_use]
    pub fn reason(&self) -> &str {
        self.reason.as_str()
    }

    /// Asks the supervisor to end the program of `processor`, if it runs, and to start it again
    /// with the same arguments. `processor` is a name or a number. Serves messages until the
    /// supervisor has accepted the request; [`outcome`](Self::outcome) then says when it has been
    /// carried out.
    ///
    /// # Errors
    /// [`SupervisorError::Absent`] if no supervisor runs; [`SupervisorError::Refused`] if the system description does
    /// not allow it; [`SupervisorError::TooLong`] if the name is too long; [`SupervisorError::Unknown`] if the answer
    /// has a state that this version does not know; [`SupervisorError::Exchange`] if there is no answer.
    pub fn restart(&mut self, processor: &str) -> Result<SupervisorTicket, SupervisorError> {
        self.order(operation::RESTART, [processor].into_iter())
    }

    /// Asks the supervisor to end the program of `processor`, if it runs, and to start `program`
    /// there with `arguments`. `processor` is a name or a number. `program` is written as in the
    /// system description: the path of a file, or `self` for the running binary, whose first
    /// argument then names one of its programs.
    ///
    /// # Errors
    /// [`SupervisorError::Absent`] if no supervisor runs; [`SupervisorError::Refused`] if the system description does
    /// not allow it; [`SupervisorError::TooLong`] if the words do not fit into a request, or one of them contains a
    /// zero byte; [`SupervisorError::Unknown`] if the answer has a state that this version does not know;
    /// [`SupervisorError::Exchange`] if there is no answer.
    pub fn load<'w>(
        &mut self,
        processor: &'w str,
        program: &'w str,
        arguments: impl Iterator<Item = &'w str>,
    ) -> Result<SupervisorTicket, SupervisorError> {
        let words = [processor, program].into_iter().chain(arguments);
        self.order(operation::LOAD, words)
    }

    fn order<'w>(
        &mut self,
        operation: u32,
        words: impl Iterator<Item = &'w str>,
    ) -> Result<SupervisorTicket, SupervisorError> {
        let request =
            SupervisorRequest::new(operation, 0, words).ok_or(SupervisorError::TooLong)?;
        let response = self.ask(&request)?;
        self.judge(&response)
            .map(|_| SupervisorTicket(response.number))
    }

    /// Asks for the outcome of the request with the ticket `order`. Returns true if the request has
    /// been carried out, so that the new program has joined, and false while it is being carried
    /// out.
    ///
    /// # Errors
    /// [`SupervisorError::Absent`] if no supervisor runs; [`SupervisorError::Refused`] if the request was
    /// refused or has failed; [`SupervisorError::Unknown`] if a later request has taken its place;
    /// [`SupervisorError::Exchange`] if there is no answer.
    pub fn outcome(&mut self, order: SupervisorTicket) -> Result<bool, SupervisorError> {
        let request = SupervisorRequest::new(operation::OUTCOME, order.0, []);
        let response = self.ask(&request.ok_or(SupervisorError::TooLong)?)?;
        self.judge(&response)
    }

    /// Asks for the name that the system description has for `processor`; returns `None` if it has no such processor.
    ///
    /// # Errors
    /// [`SupervisorError::Absent`] if no supervisor runs; [`SupervisorError::Exchange`] if there is
    /// no answer.
    pub fn name(&mut self, processor: Processor) -> Result<Option<ShortText<32>>, SupervisorError> {
        let request = SupervisorRequest::new(operation::NAME, processor.0.into(), []);
        let response = self.ask(&request.ok_or(SupervisorError::TooLong)?)?;
        Ok((response.state == state::DONE).then(|| ShortText::of(response.text())))
    }

    fn judge(&mut self, response: &SupervisorResponse) -> Result<bool, SupervisorError> {
        match response.state {
            state::PENDING => Ok(false),
            state::DONE => Ok(true),
            state::REFUSED => {
                self.reason = ShortText::of(response.text());
                Err(SupervisorError::Refused)
            }
            state => Err(SupervisorError::Unknown { state }),
        }
    }

    fn ask(&mut self, request: &SupervisorRequest) -> Result<SupervisorResponse, SupervisorError> {
        let peer = self.mailbox.peer_state(SUPERVISOR);
        match peer.map_err(ExchangeError::from)? {
            PeerState::Up { .. } => {}
            _ => return Err(SupervisorError::Absent),
        }
        Ok(self.exchange.call(SUPERVISOR, REQUESTS, request, ANSWER)?)
    }
}

#[cfg(test)]
mod tests {
    use std::string::String;
    use std::vec::Vec;

    use super::*;

    fn words(request: &SupervisorRequest) -> Option<Vec<&str>> {
        request.words().map(Iterator::collect)
    }

    #[test]
    fn words_are_those_that_were_given_and_no_longer_than_the_block() {
        let request =
            SupervisorRequest::new(operation::LOAD, 7, ["servo-a", "", "rate=2000"]).unwrap();
        assert_eq!(words(&request).unwrap(), ["servo-a", "", "rate=2000"]);
        let longest: String = core::iter::repeat_n('x', WORDS - 1).collect();
        let request = SupervisorRequest::new(operation::RESTART, 0, [longest.as_str()]).unwrap();
        assert_eq!(words(&request).unwrap(), [longest.as_str()]);
        assert_eq!(
            SupervisorRequest::new(operation::LOAD, 0, [longest.as_str(), ""]),
            None
        );
        assert_eq!(
            SupervisorRequest::new(operation::RESTART, 0, ["a\0b"]),
            None
        );
    }

    #[test]
    fn hostile_words_are_none() {
        let mut request = SupervisorRequest::new(operation::RESTART, 0, ["a"]).unwrap();
        for (len, bytes) in [
            (u32::MAX, b"a\0"),
            (WORDS as u32 + 1, b"a\0"),
            (1, b"a\0"),
            (2, b"\xff\0"),
        ] {
            request.len = len;
            request.words[..2].copy_from_slice(bytes);
            assert_eq!(words(&request), None, "{len} {bytes:?}");
        }
        let mut response = SupervisorResponse::new(state::REFUSED, 1, "no");
        assert_eq!(response.text(), "no");
        response.len = u32::MAX;
        assert_eq!(response.text(), "");
        let long: String = core::iter::repeat_n('ö', TEXT).collect();
        assert_eq!(
            SupervisorResponse::new(state::REFUSED, 1, &long)
                .text()
                .len(),
            TEXT
        );
    }
}
