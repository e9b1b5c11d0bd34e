//! [`Server`]: the host's end of condor-fs, as its WIRE.md describes it, over a [`Disk`].
//!
//! It knows nothing of open files: for each request it asks the processor for its table.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_fs::wire::{
    DONE, Evidence, FILES, NO_SESSION, NONE, OPEN_FILES, Operation, REFUSED, Request, Span, block,
    halves, open as flag, rename, slot, state, table, whole,
};
use condor_fs::{Errno, Status};
use condor_mbox::{AccessError, Call, MemoryWindow as _, Messenger, Place, Region, StaticWindow};
use critical_section::Mutex;

use crate::disk::{Disk, Kind};
use crate::listing::Listing;
use crate::text::Text;

/// The most bytes that one request may move.
const MOST: usize = 64;
/// What a client answers within.
const PATIENCE: Duration = Duration::from_secs(1);

/// What may be shared with the handler of a mailbox.
pub(crate) struct Server<'s> {
    disk: &'s Mutex<RefCell<Disk>>,
    /// The users' part of the client's `data`.
    theirs: Region<StaticWindow<'s>>,
    session: AtomicU32,
    /// What the next request is refused with; 0 if it is not.
    refusal: AtomicU32,
    /// What the next request ends with; 0 if it is carried out.
    failure: AtomicU32,
    /// What the next request, which is carried out, says of itself, and one; 0 for the truth.
    lie: AtomicU32,
    /// How many requests have come.
    pub(crate) requests: AtomicU32,
}

/// What goes into the slot.
#[derive(Default)]
struct Answer {
    value: u64,
    evidence: Evidence,
    status: Status,
}

/// The block of an open file.
struct Block {
    at: u32,
    handle: u64,
    flags: u32,
    path: Span,
    silly: bool,
    evidence: Evidence,
}

impl<'s> Server<'s> {
    pub(crate) const fn new(
        disk: &'s Mutex<RefCell<Disk>>,
        theirs: Region<StaticWindow<'s>>,
    ) -> Self {
        Self {
            disk,
            theirs,
            session: AtomicU32::new(0),
            refusal: AtomicU32::new(0),
            failure: AtomicU32::new(0),
            lie: AtomicU32::new(0),
            requests: AtomicU32::new(0),
        }
    }

    /// Refuses the next request.
    pub(crate) fn refuse(&self, errno: Errno) {
        self.refusal.store(errno.0.into(), Relaxed);
    }

    /// Lets the next request fail.
    pub(crate) fn fail(&self, errno: Errno) {
        self.failure.store(errno.0.into(), Relaxed);
    }

    /// Lets the next request say that it has moved so many bytes.
    pub(crate) fn lie(&self, value: u32) {
        self.lie.store(value.saturating_add(1), Relaxed);
    }

    /// What a mailbox does for [`FILES`].
    pub(crate) fn serve(&self, call: &Call<'_>) -> u32 {
        self.requests
            .store(self.requests.load(Relaxed).wrapping_add(1), Relaxed);
        let refusal = self.refusal.load(Relaxed);
        if refusal != 0 || call.vector() != FILES {
            self.refusal.store(0, Relaxed);
            return REFUSED | refusal;
        }
        // A window that is gone answers nobody.
        self.answer(call)
            .unwrap_or(REFUSED | u32::from(Errno::FAULT.0))
    }

    fn answer(&self, call: &Call<'_>) -> Result<u32, AccessError> {
        let at = |offset: u32| call.data().wrapping_add(offset);
        let words: [u32; slot::REQUEST_WORDS] = self.words(call.data())?;
        let Some(request) = Request::from_words(&words) else {
            return Ok(REFUSED | u32::from(Errno::FAULT.0));
        };
        let [session, session_high] = halves(request.session);
        let [sequence, sequence_high] = halves(request.sequence);
        let of = [session, session_high, sequence, sequence_high];
        if self.theirs.word(at(slot::STATE))? == state::DONE
            && self.words::<4>(at(slot::STATE_SESSION))? == of
        {
            return Ok(DONE);
        }
        let table = call
            .send_with_reply(call.sender(), OPEN_FILES, 0, PATIENCE)
            .unwrap_or(NONE);
        if table == NONE {
            return Ok(REFUSED | u32::from(Errno::AGAIN.0));
        }
        let failure = self.failure.load(Relaxed);
        self.failure.store(0, Relaxed);
        let outcome = if failure == 0 {
            critical_section::with(|token| {
                // The section is never nested.
                let mut disk = self.disk.borrow(token).try_borrow_mut();
                let disk = disk.as_deref_mut().map_err(|_| Errno::BUSY);
                self.execute(disk?, &request, table)
            })
        } else {
            Err(Errno(failure as u16))
        };
        let errno = outcome.as_ref().err().map_or(0, |errno| errno.0);
        let mut answer = outcome.unwrap_or_default();
        if let Some(lie) = self.lie.load(Relaxed).checked_sub(1) {
            self.lie.store(0, Relaxed);
            answer.value = lie.into();
        }
        self.theirs.set_word(at(slot::ERRNO), errno.into())?;
        self.put(at(slot::VALUE), &halves(answer.value))?;
        self.put(at(slot::EVIDENCE), &answer.evidence.to_words())?;
        self.put(at(slot::STATUS), &answer.status.to_words())?;
        self.put(at(slot::STATE_SESSION), &of)?;
        self.theirs.set_word(at(slot::STATE), state::DONE)?;
        Ok(DONE)
    }

    fn execute(&self, disk: &mut Disk, request: &Request, table: u32) -> Result<Answer, Errno> {
        let operation = Operation::from_word(request.operation).ok_or(Errno::NOSYS)?;
        if operation == Operation::Session {
            return self.begin_session(request);
        }
        if request.session != u64::from(self.session.load(Relaxed)) {
            return Err(Errno::STALE);
        }
        match operation {
            Operation::Session | Operation::Open => self.open(disk, request, table),
            Operation::Close => self.close(disk, request, table),
            Operation::Read | Operation::FileStatus | Operation::Sync => {
                self.look(disk, operation, request, table)
            }
            Operation::Write | Operation::Append | Operation::Truncate => {
                self.change(disk, operation, request, table)
            }
            Operation::ReadDirectory => self.list(disk, request, table),
            Operation::PathStatus => {
                let path = self.path(request.path)?;
                let index = disk.find(path.bytes())?;
                Ok(answer_about(disk, index)?)
            }
            Operation::MakeDirectory => {
                let path = self.path(request.path)?;
                disk.make(path.bytes(), Kind::Directory)?;
                Ok(Answer::default())
            }
            Operation::RemoveDirectory => {
                let path = self.path(request.path)?;
                let index = disk.find(path.bytes())?;
                if disk.node(index)?.kind != Kind::Directory {
                    return Err(Errno::NOTDIR);
                }
                if disk.entry(path.bytes(), 0).is_some() {
                    return Err(Errno::NOTEMPTY);
                }
                disk.remove(index, false)?;
                Ok(Answer::default())
            }
            Operation::Unlink => {
                let path = self.path(request.path)?;
                let index = disk.find(path.bytes())?;
                self.unlink(disk, index, request, table)?;
                Ok(Answer::default())
            }
            Operation::Rename => self.rename(disk, request, table),
        }
    }

    fn begin_session(&self, request: &Request) -> Result<Answer, Errno> {
        if request.session != NO_SESSION {
            return Err(Errno::INVAL);
        }
        let session = self.session.load(Relaxed).wrapping_add(1);
        self.session.store(session, Relaxed);
        Ok(Answer {
            value: session.into(),
            ..Answer::default()
        })
    }

    fn open(&self, disk: &mut Disk, request: &Request, table: u32) -> Result<Answer, Errno> {
        let block = self.block(table, request.file)?;
        if block.handle != 0 || block.path != request.path || block.flags != request.flags {
            return Err(Errno::INVAL);
        }
        if request.flags & !flag::ALL != 0 {
            return Err(Errno::INVAL);
        }
        let path = self.path(request.path)?;
        if path.bytes() == b"." && request.flags == flag::READ | flag::DIRECTORY {
            return Ok(Answer::default());
        }
        let index = disk.open(path.bytes(), request.flags)?;
        answer_about(disk, index)
    }

    fn close(&self, disk: &mut Disk, request: &Request, table: u32) -> Result<Answer, Errno> {
        let block = self.open_block(request, table)?;
        let others = self.holders(table, &block.evidence)?.saturating_sub(1);
        if block.silly
            && others == 0
            && let Some(index) = disk.find_inode(&block.evidence)
        {
            disk.forget(index);
        }
        Ok(Answer::default())
    }

    fn look(
        &self,
        disk: &mut Disk,
        operation: Operation,
        request: &Request,
        table: u32,
    ) -> Result<Answer, Errno> {
        let (block, index) = self.open_node(disk, request, table)?;
        let mut answer = answer_about(disk, index)?;
        if operation == Operation::Read {
            if block.flags & flag::READ == 0 {
                return Err(Errno::BADF);
            }
            let bytes = disk.node(index)?.read(request.position, request.buffer.len);
            fault(self.theirs.write(request.buffer.offset, bytes))?;
            answer.value = bytes.len() as u64;
        }
        Ok(answer)
    }

    fn change(
        &self,
        disk: &mut Disk,
        operation: Operation,
        request: &Request,
        table: u32,
    ) -> Result<Answer, Errno> {
        let (block, index) = self.open_node(disk, request, table)?;
        if block.flags & flag::WRITE == 0 {
            return Err(Errno::BADF);
        }
        let node = disk.node(index)?;
        let mut answer = Answer::default();
        if operation == Operation::Truncate {
            node.truncate(request.position)?;
            return Ok(answer);
        }
        let mut bytes = [0; MOST];
        let bytes = bytes
            .get_mut(..request.buffer.len as usize)
            .ok_or(Errno::FBIG)?;
        fault(self.theirs.read(request.buffer.offset, bytes))?;
        let position = if operation == Operation::Append {
            node.status().size
        } else {
            request.position
        };
        answer.value = node.write(position, bytes)? as u64;
        Ok(answer)
    }

    fn list(&self, disk: &mut Disk, request: &Request, table: u32) -> Result<Answer, Errno> {
        let block = self.open_block(request, table)?;
        if block.flags & flag::DIRECTORY == 0 {
            return Err(Errno::NOTDIR);
        }
        let path = self.path(block.path)?;
        let mut listing = Listing::new(&self.theirs, request.buffer);
        let mut cookie = request.position;
        // The two that each directory has come first, and then the places of the disk.
        loop {
            let (next, name, kind) = match cookie {
                0 => (1, &b"."[..], Kind::Directory),
                1 => (2, &b".."[..], Kind::Directory),
                _ => {
                    let from = usize::try_from(cookie - 2).map_err(|_| Errno::INVAL)?;
                    let Some((index, name, kind)) = disk.entry(path.bytes(), from) else {
                        break;
                    };
                    ((index as u64).saturating_add(3), name, kind)
                }
            };
            if !fault(listing.put(next, kind.bits(), name))? {
                if listing.bytes() == 0 {
                    return Err(Errno::INVAL);
                }
                break;
            }
            cookie = next;
        }
        Ok(Answer {
            value: listing.bytes().into(),
            ..Answer::default()
        })
    }

    fn rename(&self, disk: &mut Disk, request: &Request, table: u32) -> Result<Answer, Errno> {
        let (from, to) = (self.path(request.path)?, self.path(request.second_path)?);
        let index = disk.find(from.bytes())?;
        if let Ok(target) = disk.find(to.bytes()) {
            if request.flags & rename::NO_REPLACE != 0 {
                return Err(Errno::EXIST);
            }
            self.unlink(disk, target, request, table)?;
        }
        disk.rename(index, to.bytes())?;
        Ok(Answer::default())
    }

    /// Takes a file's name away; what the client has open stays, and it is told so.
    fn unlink(
        &self,
        disk: &mut Disk,
        index: usize,
        request: &Request,
        table: u32,
    ) -> Result<(), Errno> {
        let node = disk.node(index)?;
        if node.kind == Kind::Directory {
            return Err(Errno::ISDIR);
        }
        let evidence = node.evidence();
        let kept = self.holders(table, &evidence)? > 0;
        for file in 0..self.blocks(table)? {
            let block = self.block(table, file)?;
            if block.handle != 0 && block.evidence == evidence {
                let at = block.at.wrapping_add(block::SILLY);
                let [low, high] = halves(request.sequence);
                fault(self.theirs.set_word(at.wrapping_add(4), high))?;
                fault(self.theirs.set_word(at, low))?;
            }
        }
        disk.remove(index, kept)
    }

    /// What a request about an open file is about.
    fn open_node(
        &self,
        disk: &Disk,
        request: &Request,
        table: u32,
    ) -> Result<(Block, usize), Errno> {
        let block = self.open_block(request, table)?;
        let index = disk.find_inode(&block.evidence).ok_or(Errno::STALE)?;
        if !block.silly && disk.find(self.path(block.path)?.bytes()) != Ok(index) {
            return Err(Errno::STALE);
        }
        Ok((block, index))
    }

    fn open_block(&self, request: &Request, table: u32) -> Result<Block, Errno> {
        let block = self.block(table, request.file)?;
        if request.handle == 0 || block.handle != request.handle {
            return Err(Errno::BADF);
        }
        Ok(block)
    }

    /// How many open files are this one.
    fn holders(&self, table: u32, evidence: &Evidence) -> Result<u32, Errno> {
        let mut holders = 0;
        for file in 0..self.blocks(table)? {
            let block = self.block(table, file)?;
            holders += u32::from(block.handle != 0 && block.evidence == *evidence);
        }
        Ok(holders)
    }

    fn blocks(&self, table: u32) -> Result<u32, Errno> {
        let [magic, blocks, ..]: [u32; table::BYTES as usize / 4] = fault(self.words(table))?;
        if magic != table::MAGIC || blocks > condor_fs::wire::MAX_FILES {
            return Err(Errno::FAULT);
        }
        Ok(blocks)
    }

    fn block(&self, table: u32, file: u32) -> Result<Block, Errno> {
        let [_, _, first, stride]: [u32; table::BYTES as usize / 4] = fault(self.words(table))?;
        if file >= self.blocks(table)? {
            return Err(Errno::FAULT);
        }
        let at = first.wrapping_add(file.wrapping_mul(stride));
        let words: [u32; block::WORDS] = fault(self.words(at))?;
        let [
            magic,
            session,
            session_high,
            handle,
            handle_high,
            flags,
            offset,
            len,
            silly,
            _silly_high,
            evidence @ ..,
        ] = words;
        let free = magic == 0;
        if !free && magic != block::MAGIC {
            return Err(Errno::FAULT);
        }
        let ours = whole(session, session_high) == u64::from(self.session.load(Relaxed));
        Ok(Block {
            at,
            handle: if ours && handle != 0 {
                whole(handle, handle_high)
            } else {
                0
            },
            flags,
            path: Span { offset, len },
            silly: silly != 0,
            evidence: Evidence::from_words(&evidence),
        })
    }

    fn path(&self, span: Span) -> Result<Text<32>, Errno> {
        let mut bytes = [0; 32];
        let bytes = bytes.get_mut(..span.len as usize);
        let bytes = bytes.ok_or(Errno::NAMETOOLONG)?;
        fault(self.theirs.read(span.offset, bytes))?;
        let mut path = Text::new();
        path.push(bytes);
        Ok(path)
    }

    fn words<const K: usize>(&self, at: u32) -> Result<[u32; K], AccessError> {
        let mut words = [0; K];
        for (word, at) in words.iter_mut().zip((at..).step_by(4)) {
            *word = u32::from_le_bytes(self.theirs.get(Place::at(at))?);
        }
        Ok(words)
    }

    fn put(&self, at: u32, words: &[u32]) -> Result<(), AccessError> {
        for (word, at) in words.iter().zip((at..).step_by(4)) {
            self.theirs.set_word(at, *word)?;
        }
        Ok(())
    }
}

fn answer_about(disk: &mut Disk, index: usize) -> Result<Answer, Errno> {
    let node = disk.node(index)?;
    Ok(Answer {
        value: 0,
        evidence: node.evidence(),
        status: node.status(),
    })
}

/// A place outside of the window is the client's mistake.
fn fault<T>(access: Result<T, AccessError>) -> Result<T, Errno> {
    access.map_err(|_| Errno::FAULT)
}
