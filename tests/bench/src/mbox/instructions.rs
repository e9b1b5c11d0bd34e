//! The instructions of a round trip, of both ends together.
//!
//! Both mailboxes are in this thread: whenever the client reads its clock, which is when it begins to
//! wait, the server serves. The function that callgrind counts is a call with its reply, and holds what
//! this arrangement costs, too.

use std::cell::Cell;
use std::hint::black_box;
use std::time::Duration;

use condor_mbox::linux::{LinuxDoorbell, LinuxSystem, LinuxWindow};
use condor_mbox::{
    Call, Clock, Doorbell, Evidence, Instant, Mailbox, Messenger, Processor, SingleContext, Vector,
    Waiting,
};

use crate::Result;

/// The paths, as functions for callgrind: with 2 processors, and with 16.
pub(super) const MESSAGE_2: &str = "message_2";
pub(super) const MESSAGE_16: &str = "message_16";

const CLIENT: Processor = Processor(0);
const SERVER: Processor = Processor(1);
const ECHO: Vector = Vector(0);
const TIMEOUT: Duration = Duration::from_secs(5);

type End<const N: usize> = Mailbox<'static, (LinuxWindow, Led<N>, SingleContext), N>;

thread_local! {
    /// What happens when the client reads its clock.
    static SERVES: Cell<Option<&'static dyn Fn()>> = const { Cell::new(None) };
}

/// A doorbell whose clock lets the other end serve.
struct Led<const N: usize> {
    bell: LinuxDoorbell<N>,
    leads: bool,
}

impl<const N: usize> Clock for Led<N> {
    fn now(&self) -> Instant {
        if self.leads
            && let Some(serves) = SERVES.get()
        {
            serves();
        }
        Instant::from_ns(1)
    }
}

impl<const N: usize> Doorbell for Led<N> {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        self.bell.ring(processor);
    }

    fn prepare(&self) -> u32 {
        self.bell.prepare()
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<Processor>) {
        self.bell.wait(seen, until, whom);
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.bell.evidence(processor)
    }
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_message_2(client: &End<2>, value: u32) -> bool {
    matches!(client.send_with_reply(SERVER, ECHO, value, TIMEOUT), Ok(reply) if reply == value)
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_message_16(client: &End<16>, value: u32) -> bool {
    matches!(client.send_with_reply(SERVER, ECHO, value, TIMEOUT), Ok(reply) if reply == value)
}

/// Makes round trips by the function that callgrind counts, if `name` is that of one.
///
/// # Errors
/// Returns an error if the system cannot be created, or if a reply is not right.
pub(crate) fn go(name: &str, calls: usize) -> Option<Result<()>> {
    match name {
        MESSAGE_2 => Some(make(calls, condor_path_message_2)),
        MESSAGE_16 => Some(make(calls, condor_path_message_16)),
        _ => None,
    }
}

fn make<const N: usize>(calls: usize, trip: fn(&End<N>, u32) -> bool) -> Result<()> {
    let system = LinuxSystem::<N>::family(0)?;
    let server: &'static End<N> = Box::leak(Box::new(end(&system, SERVER, false)?));
    let client: &'static End<N> = Box::leak(Box::new(end(&system, CLIENT, true)?));
    for _ in 0..3 {
        server.serve(Duration::ZERO)?;
        client.serve(Duration::ZERO)?;
    }
    SERVES.set(Some(Box::leak(Box::new(|| {
        // Its memory is there.
        let _ = server.serve(Duration::ZERO);
    }))));
    for call in 0..calls {
        if !trip(client, black_box(call as u32)) {
            return Err(format!("reply {call} is not right").into());
        }
    }
    Ok(())
}

fn end<const N: usize>(system: &LinuxSystem<N>, number: Processor, leads: bool) -> Result<End<N>> {
    let (windows, bell) = system.claim(number)?.into_parts();
    let bell = Led { bell, leads };
    let mut mailbox = Mailbox::new(number, windows, bell, SingleContext::new())?;
    mailbox.set_waiting(Waiting::Spin);
    mailbox.set_vector(ECHO, black_box(&|call: &Call<'_>| call.data()), "echo")?;
    mailbox.join()?;
    Ok(mailbox)
}
