//! The host's side: serves one directory tree to the processors of a system.
//!
//! Most programs need only [`FileServer::serve`]; the program `condor-fs-server` does little more.

mod attributes;
mod error;
mod execute;
mod former;
mod give_up;
mod journal;
mod limit;
mod log;
mod names;
mod open_files;
mod options;
mod paths;
mod quota;
mod ranges;
mod reopen;
mod steps;
mod transfer;
mod tree;

pub use error::ServerError;
pub use options::{ProcessorSet, ServerOptions};
pub use steps::{Step, Steps};

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use condor_mbox::linux::{Claim, LinuxWindow};
use condor_mbox::{
    Backend, Call, Clock, Doorbell, Mailbox, MemoryWindow, Messenger, Processor, Region,
    SingleContext, Waiting, Windows,
};

use crate::errno::Errno;
use crate::wire::{self, Operation, RequestSlot, again, slot};
use error::Stop;
use former::{Former, Formers};
use journal::{Journal, Record};
use log::{Log, words};
use open_files::OpenFiles;
use paths::Paths;
use quota::Quota;
use tree::Tree;

/// The time for which a server that has just served waits for the next request before it sleeps.
const MORE: Duration = Duration::from_millis(100);
/// The time between two checks for the end of the service while the server has nothing to do.
const LOOK: Duration = Duration::from_millis(250);

/// A file server: it serves one directory tree of the host to the clients
/// ([`FileSystem`](crate::FileSystem)) on all processors. It locks the tree, so that a tree has one
/// server at a time.
///
/// A server may be killed at any moment, and another one started: what the next server must know is
/// in the memory of the clients and in a journal. A server has a directory of its own in the tree,
/// `.condor-fs`, which no client sees.
///
/// `S` is for tests, which it informs of every [`Step`]; leave it out otherwise.
pub struct FileServer<S: Steps = ()> {
    tree: Tree,
    options: ServerOptions,
    journal: Journal,
    open: OpenFiles,
    formers: Mutex<Formers>,
    quota: Quota,
    steps: S,
}

/// A request, and where it came from.
struct Job<'j> {
    processor: Processor,
    window: &'j LinuxWindow,
    region: Region<&'j LinuxWindow>,
    slot: u32,
    request: RequestSlot,
    paths: Paths,
    operation: Operation,
    /// Returns the place of the table of a session, if that is known.
    ask: &'j dyn Fn(u64) -> Option<u32>,
}

impl FileServer {
    /// Makes a server for the directory tree at `root`, and locks the tree. Waits up to 1 s while
    /// another server has the tree: the lock of a server that was killed lasts some milliseconds
    /// longer than the server.
    ///
    /// # Errors
    /// [`ServerError::Served`] if another server still has the tree after that time;
    /// [`ServerError::Journal`] if the journal cannot be read, or the disk has no room for it;
    /// [`ServerError::FileMode`] if the server could not open its own files with the modes of
    /// `options`; [`ServerError::System`] if the operating system refuses an operation, or if the
    /// size of a part of the tree cannot be counted for the quota.
    pub fn new(root: impl AsRef<Path>, options: ServerOptions) -> Result<Self, ServerError> {
        Self::with_steps(root, options, ())
    }
}

impl<S: Steps> FileServer<S> {
    /// Makes a server as [`new`](FileServer::new) does, which calls `steps` at every step of an
    /// operation. It is for tests, which kill the server in such a call.
    ///
    /// # Errors
    /// [`ServerError`] if [`new`](FileServer::new) would fail: in the same cases, and with the same
    /// variants.
    pub fn with_steps(
        root: impl AsRef<Path>,
        options: ServerOptions,
        steps: S,
    ) -> Result<Self, ServerError> {
        let root = root.as_ref();
        let tree = Tree::open(root)?;
        let mode = options.file_mode;
        tree.check_mode(mode)
            .map_err(|source| ServerError::FileMode {
                root: root.to_owned(),
                mode,
                source: source.into(),
            })?;
        let quota = Quota::of(&tree, options.quota_bytes).map_err(ServerError::at(root))?;
        let journal = Journal::open(&tree, root)?;
        Ok(Self {
            tree,
            options,
            journal,
            open: OpenFiles::default(),
            formers: Mutex::default(),
            quota,
            steps,
        })
    }

    /// Finishes the operation that a former server left undone, joins as the processor whose number
    /// `claim` holds, and serves clients until `stop` is set.
    ///
    /// # Errors
    /// [`ServerError::Mailbox`] if the mailbox fails; [`ServerError::Journal`] if the journal
    /// cannot be read.
    pub fn serve<const N: usize>(
        &self,
        claim: Claim<N>,
        stop: &AtomicBool,
    ) -> Result<(), ServerError> {
        let number = claim.number();
        let (windows, doorbell) = claim.into_parts();
        self.serve_at(number, &windows, doorbell, stop)
    }

    /// Serves as [`serve`](Self::serve) does, but with another doorbell than that of a claim.
    ///
    /// * `number`: the number of the server's processor, which the caller must hold.
    /// * `windows`: the windows of all processors; the index is the processor's number.
    ///
    /// # Errors
    /// [`ServerError::Mailbox`] if the mailbox fails; [`ServerError::Journal`] if the journal
    /// cannot be read.
    pub fn serve_at<D: Doorbell, const N: usize>(
        &self,
        number: Processor,
        windows: &[Windows<LinuxWindow>; N],
        doorbell: D,
        stop: &AtomicBool,
    ) -> Result<(), ServerError> {
        self.recover(windows)?;
        let handler = |call: &Call<'_>| self.answer(call, windows);
        let mut mailbox: Mailbox<'_, (LinuxWindow, D, SingleContext), N> =
            Mailbox::new(number, windows.clone(), doorbell, SingleContext::new())?;
        mailbox.set_waiting(self.options.waiting);
        mailbox.set_vector(wire::FILES, &handler, "files")?;
        mailbox.join()?;
        let sleeps = self.options.waiting != Waiting::Spin;
        let mut served = 0;
        while !stop.load(Ordering::Relaxed) {
            served = match served {
                0 if sleeps => sleep(&mut mailbox)?,
                // Requests often follow each other.
                _ => mailbox.serve(MORE)?,
            };
        }
        Ok(())
    }

    /// Finishes the operation during which the former server of this tree ended, if its client
    /// still wants it. `windows` are those of all processors; the index is the processor's number.
    ///
    /// A program that calls [`answer`](Self::answer) calls this once before its mailbox joins;
    /// [`serve`](Self::serve) does so itself.
    ///
    /// # Errors
    /// [`ServerError::Journal`] if the journal cannot be read.
    pub fn recover<const N: usize>(
        &self,
        windows: &[Windows<LinuxWindow>; N],
    ) -> Result<(), ServerError> {
        if let Some(record) = self.journal.read()? {
            self.finish(&record, windows);
            self.journal.end();
        }
        Ok(())
    }

    fn finish(&self, record: &Record, windows: &[Windows<LinuxWindow>]) {
        let Some(Windows { data, .. }) = windows.get(record.processor.index()) else {
            return;
        };
        let Ok(region) = Region::users(data) else {
            return;
        };
        let wanted = read_request(&region, record.slot).is_ok_and(|request| {
            request.session == record.session && request.sequence == record.sequence
        });
        if wanted {
            self.serve_slot(record.processor, data, record.slot, &|_| Some(record.table));
        }
    }

    /// Answers one message to the vector [`wire::FILES`], and returns the word of the reply. Call
    /// it in the handler of that vector, in a program that has its own mailbox and does not call
    /// [`serve`](Self::serve). Only one call may run at a time.
    ///
    /// `windows` are those of all processors; the index is the processor's number.
    pub fn answer<const N: usize>(
        &self,
        call: &Call<'_>,
        windows: &[Windows<LinuxWindow>; N],
    ) -> u32 {
        let sender = call.sender();
        let Some(Windows { data, .. }) = windows.get(sender.index()) else {
            return refused(Errno::FAULT);
        };
        let ask = |session| self.open.ask(call, session);
        self.serve_slot(sender, data, call.data(), &ask)
    }

    /// Serves the slot at an offset, to which the bits of [`again`] may have been added.
    fn serve_slot(
        &self,
        processor: Processor,
        window: &LinuxWindow,
        message: u32,
        ask: &dyn Fn(u64) -> Option<u32>,
    ) -> u32 {
        let (slot, bits) = (message & !again::BITS, message & again::BITS);
        if self.options.refused.contains(processor) {
            return refused(Errno::ACCES);
        }
        let Ok(region) = Region::users(window) else {
            return refused(Errno::FAULT);
        };
        // After a panic there is none of this processor.
        let mut formers = self.formers.lock().unwrap_or_else(PoisonError::into_inner);
        let former = formers.of(processor);
        let found = match (bits, former.take()) {
            (0, _) => read_request(&region, slot),
            _ if !again::is_message(bits) => Err(Errno::FAULT),
            (_, former) => former
                .and_then(|former| former.next(slot, bits))
                .ok_or(Errno::AGAIN),
        };
        let request = match found {
            Ok(request) => request,
            Err(errno) => return refused(errno),
        };
        let Some(operation) = Operation::from_word(request.operation) else {
            return refused(Errno::NOSYS);
        };
        let paths = Paths::copy(&region, &request, operation);
        // The paths belong to this request if it is still there; from here on neither can change.
        if !paths.is_empty() && read_request(&region, slot) != Ok(request) {
            return refused(Errno::AGAIN);
        }
        let job = Job {
            processor,
            window,
            region,
            slot,
            request,
            paths,
            operation,
            ask,
        };
        let reply = match self.run(&job) {
            Ok(reply) => reply,
            Err(Stop::Again) => refused(Errno::AGAIN),
            Err(Stop::Errno(errno)) => refused(errno),
        };
        *former = Former::new(slot, request, wire::value_of(reply));
        reply
    }

    /// Does a job whose result is not in its slot yet, and returns the reply; fails only if the slot
    /// cannot have a result.
    fn run(&self, job: &Job<'_>) -> Result<u32, Stop> {
        let log = Log::of(job);
        let Some(incarnations) = log.take()? else {
            return Ok(wire::DONE); // Its former server died before it replied.
        };
        let attempt = if self.is_given_up(incarnations) {
            self.give_up(job, &log, incarnations)
        } else {
            self.reached(job, Step::Taken);
            self.execute(job, &log)
        };
        let outcome = match attempt {
            Err(Stop::Again) => {
                self.journal.end();
                log.give_back(incarnations)?;
                return Err(Stop::Again);
            }
            Ok(outcome) => Ok(outcome),
            Err(Stop::Errno(errno)) => Err(errno),
        };
        if !self.is_given_up(incarnations) {
            self.reached(job, Step::Acted);
        }
        let recorded = log.record(&outcome);
        self.reached(job, Step::Recorded);
        if self.is_given_up(incarnations) {
            self.clear_away(job);
        }
        self.journal.end();
        recorded?;
        Ok(outcome.map_or(wire::DONE, |outcome| wire::with_value(outcome.value)))
    }

    fn reached(&self, job: &Job<'_>, step: Step) {
        self.steps.reached(job.operation, step);
    }
}

/// Sleeps until somebody rings, for `LOOK` at most, and serves what there is then: a mailbox that
/// waits also looks around now and then, a hundred times a second.
fn sleep<B: Backend, const N: usize>(
    mailbox: &mut Mailbox<'_, B, N>,
) -> Result<usize, condor_mbox::MailboxError> {
    mailbox.ring_always(true)?;
    let doorbell = mailbox.doorbell();
    // A request that this service does not see rings the doorbell.
    let seen = doorbell.prepare();
    let mut served = mailbox.serve(Duration::ZERO)?;
    if served == 0 {
        doorbell.wait(seen, doorbell.now().after(LOOK), None);
        served = mailbox.serve(Duration::ZERO)?;
    }
    mailbox.ring_always(false)?;
    Ok(served)
}

fn read_request(region: &Region<&LinuxWindow>, at: u32) -> Result<RequestSlot, Errno> {
    let fault = |_| Errno::FAULT;
    if !at.is_multiple_of(64) || at.checked_add(slot::BYTES).is_none() {
        return Err(Errno::FAULT);
    }
    // Acquire: the client's Release store of the magic comes after the rest.
    if region.word(at).map_err(fault)? != slot::MAGIC {
        return Err(Errno::FAULT);
    }
    let mut bytes = [[0; 4]; slot::REQUEST_WORDS];
    let (line, behind) = bytes.split_at_mut(slot::LINE_WORDS);
    region.read(at, line.as_flattened_mut()).map_err(fault)?;
    let number = line[slot::OPERATION as usize / 4];
    let operation = Operation::from_word(u32::from_le_bytes(number));
    // The second line stays with the client, unless it is needed.
    if operation.is_some_and(Operation::has_second_line) {
        let at = at + 4 * slot::LINE_WORDS as u32;
        region.read(at, behind.as_flattened_mut()).map_err(fault)?;
    }
    // Pairs with the fence in the client's `write`: the words that are read below are at least as new as
    // these.
    fence(Ordering::Acquire);
    let request = RequestSlot::from_words(&bytes.map(u32::from_le_bytes)).ok_or(Errno::FAULT)?;
    // A client that changed it meanwhile first took away the magic, then changed the sequence.
    let magic = region.word(at).map_err(fault)?;
    let sequence: [u32; 2] = words(region, at + slot::SEQUENCE)?;
    if magic != slot::MAGIC || sequence != wire::halves(request.sequence) {
        return Err(Errno::AGAIN);
    }
    Ok(request)
}

const fn refused(errno: Errno) -> u32 {
    wire::REFUSED | errno.0 as u32
}
