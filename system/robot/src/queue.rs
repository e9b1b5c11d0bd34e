//! A queue of motions for several clients, in which no request runs twice. [`motions`](crate::motions)
//! serves it by message.
//!
//! A client opens a session, and assigns each request a [`RequestIdentity`]: the session and a number that
//! counts up. If a message is lost, the client sends the same request again until it gets an answer. The queue
//! records the state of each request in a [`Ledger`], whose rows outlive the program, so the same identity
//! always has the same outcome:
//!
//! ```text
//! offered ─┬─ Refused
//!          └─ Accepted ─┬─ Started ─┬─ Done, Stopped
//!                       │           ├─ Aborted
//!                       │           └─ BrokenOff   the program ended meanwhile
//!                       ├─ Refused                 it was not possible when its turn came
//!                       ├─ Aborted
//!                       └─ Lost                    the program ended before its turn came
//! ```
//!
//! A request begins only after the row that says so was written, and an answer is sent only after its row was
//! written. So a program that ends at any instant leaves a ledger from which the next one can tell every client
//! the true state of its requests. It does not go on with motions of its former incarnation.
//!
//! A session belongs to the incarnation of the processor that opened it, its [`SessionOwner`]. When that
//! incarnation has ended, the program [closes](MotionQueue::close) the session: its requests in the queue go
//! on, and it can add no more. Other clients can still ask for the outcomes.
//!
//! Only the session that is in control can enqueue motions; all others can look. A session takes control if no
//! other has it. It can also [take control](MotionQueue::take_control) from another session, which the program
//! can announce.
//!
//! ```
//! use condor_robot::queue::{
//!     LedgerRow, MotionQueue, QueueAnswer, RefusalReason, RequestIdentity, RequestState, SessionOwner,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A ledger in memory; that of a program is a file, or memory that outlives it.
//! let mut rows = vec![LedgerRow::default(); MotionQueue::<&str, 2>::ROWS];
//! let mut write = |row: usize, bytes: &LedgerRow| {
//!     rows[row] = *bytes;
//!     Ok::<_, std::io::Error>(())
//! };
//! let mut queue = MotionQueue::<&str, 2>::restore(&[], 1, &mut write)?;
//! let arm = SessionOwner { processor: 3, incarnation: 1 };
//! let session = queue.open(arm, &mut write)?.expect("a place for a session");
//! queue.take_control(session, false);
//! let wave = RequestIdentity { session, number: 1 };
//! queue.offer(wave, &mut write, || Ok("wave"))?;
//! queue.offer(wave, &mut write, || Ok("wave"))?; // sent again: nothing changes
//! assert_eq!(queue.start(&mut write)?, Some((wave, "wave")));
//! queue.end(RequestState::Done, RefusalReason::None, &mut write)?;
//! assert_eq!(queue.answer(wave), QueueAnswer::Known(RequestState::Done, RefusalReason::None));
//!
//! // The next incarnation of the program knows it still.
//! let bytes = rows.concat();
//! let mut queue = MotionQueue::<&str, 2>::restore(&bytes, 1, |_, _| Ok::<_, std::io::Error>(()))?;
//! assert_eq!(queue.answer(wave), QueueAnswer::Known(RequestState::Done, RefusalReason::None));
//! # Ok(())
//! # }
//! ```

mod ledger;
mod requests;

pub use ledger::{
    Ledger, LedgerRow, ROW_BYTES, RefusalReason, RequestIdentity, RequestState, SessionOwner,
};
pub use requests::{InControl, MotionQueue, OWN, QueueAnswer, RestoreError};
