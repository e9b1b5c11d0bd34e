//! Hearing the messages to processors of a running system, as their programs do.

use core::time::Duration;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use condor_mbox::linux::Claim;
use condor_mbox::{Call, Instant, MailboxError, Messenger as _, Processor, Vector};
use condor_rt::linux::{HostBell, MappedPage};
use condor_rt::numbers::PROCESSORS;

use super::{ViewError, claim};
use crate::system::SystemDirectory;

/// The time for which a holder may not answer the request to be heard, before it is asked again.
const PATIENCE: Duration = Duration::from_millis(250);
/// The time between two looks whether hearing is to end.
const LOOK: Duration = Duration::from_millis(20);

/// A message that was heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeardMessage {
    /// The instant at which it was heard, on the clock of the system.
    pub at: Instant,
    /// The processor, service or visitor that sent it.
    pub sender: Processor,
    /// The processor to which it was sent.
    pub addressee: Processor,
    /// The vector to which it was sent.
    pub vector: Vector,
    /// The name that the addressee gave to its handler of the vector; empty if it has none.
    pub name: String,
    /// The word that it carries.
    pub data: u32,
    /// The number of messages to the addressee before this one since hearing began, heard or missed.
    pub number: u64,
    /// The number of messages that were missed between the one heard before and this one, because this host was too
    /// slow.
    pub missed: u32,
}

/// A message that was heard, or a change of what can be heard: [`Hearing::next`] returns it.
#[derive(Debug)]
pub enum HearingEvent {
    /// From now on, messages to this processor are heard.
    Began(Processor),
    /// This processor takes no messages now, for this reason; hearing begins when it does.
    Waits(Processor, MailboxError),
    /// A message was heard.
    Message(HeardMessage),
    /// Messages to this processor cannot be heard any more, for this reason.
    Ended(Processor, MailboxError),
}

/// Visitors of a running system that hear the messages to some processors: one visitor for each. The processors take
/// the messages, too, and answer them. Hearing goes on after a processor was restarted.
///
/// By the real clock, a sender that waits for its message to be taken also waits for this host: for 100 ms or half of
/// its timeout, the shorter of both, and then not again until this host has caught up. A sender that does not wait,
/// such as a servo loop, never waits for it. In simulated time nobody does. Messages that come too fast for this host
/// are missed, and counted.
pub struct Hearing {
    events: Receiver<HearingEvent>,
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Hearing {
    /// Begins to hear the messages to `addressees`, in the system in `directory`. `window_bytes` is the size of the
    /// users' region of each processor's `data`, in bytes, as for [`View::open`](super::View::open).
    ///
    /// # Errors
    /// Returns [`ViewError::Full`] if too few numbers of visitors are free; [`ViewError::Windows`] if the windows cannot
    /// be opened; [`ViewError::Clock`] if the simulated clock cannot be opened.
    pub fn begin(
        directory: &SystemDirectory,
        window_bytes: u32,
        addressees: &[Processor],
    ) -> Result<Self, ViewError> {
        let windows = directory.system(window_bytes)?;
        let page = directory.clock_page()?;
        let claims = addressees.iter().map(|_| claim(&windows));
        let claims: Vec<_> = claims.collect::<Result<_, _>>()?;
        let (told, events) = channel();
        let is_over = Arc::new(AtomicBool::new(false));
        let threads = addressees.iter().zip(claims).map(|(&addressee, claim)| {
            let (told, is_over, page) = (told.clone(), Arc::clone(&is_over), page.clone());
            thread::spawn(move || {
                if let Err(error) = hear(claim, page, addressee, &told, &is_over) {
                    // Nobody may want to know any more.
                    let _ = told.send(HearingEvent::Ended(addressee, error));
                }
            })
        });
        let threads = threads.collect();
        Ok(Self {
            events,
            is_over,
            threads,
        })
    }

    /// Returns the next event; `None` if none comes within `timeout`.
    #[must_use]
    pub fn next(&self, timeout: Duration) -> Option<HearingEvent> {
        self.events.recv_timeout(timeout).ok()
    }
}

impl Drop for Hearing {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic has been shown.
            let _ = thread.join();
        }
    }
}

/// Hears the messages to `addressee` until hearing is over.
fn hear(
    claim: Claim<PROCESSORS>,
    page: Option<MappedPage>,
    addressee: Processor,
    told: &Sender<HearingEvent>,
    is_over: &AtomicBool,
) -> Result<(), MailboxError> {
    let heard = Mutex::new(Vec::new());
    let clock = page.clone();
    let note = |call: &Call<'_>| {
        let now = clock.as_ref().map(|page| Instant::from_ns(page.now()));
        let at = now.unwrap_or_else(|| call.now());
        let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
        heard.push((at, call.sender(), call.vector(), call.data()));
        0
    };
    let mut post = HostBell::mailbox(claim, |bell| HostBell::of_guest(bell, page))?;
    post.set_listener(&note);
    post.join()?;
    let (mut known, mut number, mut has_told) = ([0; PROCESSORS], 0, false);
    while !is_over.load(Ordering::Relaxed) {
        if post.listens_to().is_none() {
            let event = match post.listen(Some(addressee), PATIENCE) {
                Ok(()) => HearingEvent::Began(addressee),
                Err(error @ (MailboxError::Layout { .. } | MailboxError::Window { .. })) => {
                    return Err(error);
                }
                Err(_) if has_told => {
                    post.serve(LOOK)?;
                    continue;
                }
                Err(error) => {
                    has_told = true;
                    HearingEvent::Waits(addressee, error)
                }
            };
            let _ = told.send(event);
            continue;
        }
        post.serve(LOOK)?;
        let batch = core::mem::take(&mut *heard.lock().unwrap_or_else(PoisonError::into_inner));
        for (at, sender, vector, data) in batch {
            let all = post.missed(sender)?;
            let before = known.get_mut(sender.index());
            let missed = before.map_or(0, |it| all.wrapping_sub(core::mem::replace(it, all)));
            number += u64::from(missed);
            let name = post.vector_statistics(addressee, vector);
            let _ = told.send(HearingEvent::Message(HeardMessage {
                at,
                sender,
                addressee,
                vector,
                name: name.map_or_else(|_| String::new(), |it| it.name().to_owned()),
                data,
                number,
                missed,
            }));
            number += 1;
        }
    }
    Ok(())
}
