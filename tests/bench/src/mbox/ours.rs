//! condor-mbox: calls with a reply to a handler that returns the data of the call.
//!
//! Every call has a deadline, an epoch, a checked vector and a handler table, like any user's; the
//! windows and doorbells are those of the Linux backend. Its memory is a family of its own, fresh
//! for every round.

use std::rc::Rc;
use std::time::Duration;

use condor_mbox::linux::{LinuxMailbox, LinuxSystem};
use condor_mbox::{Call, Messenger, Processor, SingleContext, Vector, Waiting};

use super::contestant::{Ends, Setup};
use crate::Result;

const CLIENT: Processor = Processor(0);
const SERVER: Processor = Processor(1);

const ECHO: Vector = Vector(0);

/// Deadline of every call.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Opens mailboxes that spin and belong to one thread each.
pub(super) fn open_spinning<'m>(_: &Setup<'m>) -> Result<Ends<'m>> {
    open::<2>(Waiting::Spin)
}

/// Opens mailboxes of a system of 16 that spin; the other 14 processors have not joined.
pub(super) fn open_spinning_of_16<'m>(_: &Setup<'m>) -> Result<Ends<'m>> {
    open::<16>(Waiting::Spin)
}

/// Opens mailboxes that sleep.
pub(super) fn open_blocking<'m>(_: &Setup<'m>) -> Result<Ends<'m>> {
    open::<2>(Waiting::Sleep)
}

fn open<'m, const N: usize>(waiting: Waiting) -> Result<Ends<'m>> {
    let system = Rc::new(LinuxSystem::<N>::family(0)?);
    let join = move |number| -> Result<LinuxMailbox<'static, N, SingleContext>> {
        let mut mailbox = system.claim(number)?.mailbox_with(SingleContext::new())?;
        mailbox.set_waiting(waiting);
        mailbox.set_vector(ECHO, &|call: &Call<'_>| call.data(), "echo")?;
        mailbox.join()?;
        Ok(mailbox)
    };
    let join_server = join.clone();
    Ok(Ends::new(
        move || {
            let mailbox = join(CLIENT)?;
            Ok(move |value| Ok(mailbox.send_with_reply(SERVER, ECHO, value, TIMEOUT)?))
        },
        move || {
            let mailbox = join_server(SERVER)?;
            Ok(move |count: u32| {
                let mut left = count as usize;
                while left > 0 {
                    left = left.saturating_sub(mailbox.serve(TIMEOUT)?);
                }
                Ok(())
            })
        },
    ))
}
