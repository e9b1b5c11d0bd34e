//! [`OpenFiles`]: what the server has opened, and how it learns anew what clients have opened.

use std::collections::BTreeMap;
use std::ffi::CString;
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use condor_mbox::{Call, MessageTicket, Messenger, PendingReply, Processor};
use rustix::fs::OFlags;

use super::error::Stop;
use super::log::words;
use super::tree::about;
use super::{FileServer, Job, Steps};
use crate::errno::Errno;
use crate::wire::{self, FileIdentity, Span, Words as _, block, open as flag, table};

/// The number of files that are kept open; beyond it all are opened again as they are needed.
const MOST: usize = 512;

/// The open files: a cache that may be lost.
#[derive(Default)]
pub(super) struct OpenFiles {
    cache: Mutex<Cache>,
}

#[derive(Default)]
struct Cache {
    /// By processor, session and handle.
    files: BTreeMap<(Processor, u64, u64), Arc<OpenFile>>,
    /// The session of each processor, and the place of its table.
    tables: BTreeMap<Processor, (u64, u32)>,
    /// The question for it that a session has not answered yet.
    pending: BTreeMap<Processor, (u64, PendingReply)>,
}

/// A file of the tree that the server has open for a client.
pub(super) struct OpenFile {
    pub(super) file: OwnedFd,
    pub(super) flags: u32,
}

/// A block of a client's table, copied.
pub(super) struct Block {
    magic: u32,
    session: u64,
    handle: u64,
    flags: u32,
    path: Span,
    /// The operation after which the file has a silly name; its low word is 0 if there is none.
    silly: u64,
    evidence: FileIdentity,
    /// The offset of the block in the window; this word follows those that are in the window.
    at: u32,
}

wire::words!(Block: magic, session, handle, flags, path, silly, evidence, at);

impl OpenFile {
    pub(super) fn for_reading(&self) -> Result<&OwnedFd, Errno> {
        self.allowing(flag::READ)
    }

    pub(super) fn for_writing(&self) -> Result<&OwnedFd, Errno> {
        self.allowing(flag::WRITE)
    }

    fn allowing(&self, flag: u32) -> Result<&OwnedFd, Errno> {
        if self.flags & flag == 0 {
            Err(Errno::BADF)
        } else {
            Ok(&self.file)
        }
    }
}

impl OpenFiles {
    /// A panic elsewhere does not make the cache wrong: what is in it is whole.
    fn lock(&self) -> MutexGuard<'_, Cache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn keep(&self, job: &Job<'_>, handle: u64, opened: OpenFile) -> Arc<OpenFile> {
        let opened = Arc::new(opened);
        let mut cache = self.lock();
        if cache.files.len() >= MOST {
            cache.files.clear();
        }
        let key = (job.processor, job.request.session, handle);
        cache.files.insert(key, Arc::clone(&opened));
        opened
    }

    pub(super) fn forget(&self, job: &Job<'_>) {
        let key = (job.processor, job.request.session, job.request.handle);
        self.lock().files.remove(&key);
    }

    /// Returns the place of the table of the sender's session, if the sender has said it; else asks the
    /// sender, without waiting for the answer: others are served meanwhile, and the sender tries again when
    /// it has answered.
    pub(super) fn ask(&self, call: &Call<'_>, session: u64) -> Option<u32> {
        let sender = call.sender();
        let mut cache = self.lock();
        let mut kept = None;
        if let Some((of, pending)) = cache.pending.remove(&sender) {
            // If another session was asked, or in a former incarnation, it is given up with its ticket.
            let mut ticket = MessageTicket::attach(call, pending);
            if of == session {
                match ticket.poll() {
                    Ok(None) => kept = Some(ticket),
                    Ok(table) => return table,
                    Err(_) => {}
                }
            }
        }
        // If it cannot be asked now, then when it tries again.
        let ticket = kept.or_else(|| call.begin(sender, wire::OPEN_FILES, 0, Duration::ZERO).ok());
        let pending = ticket.and_then(MessageTicket::detach);
        cache
            .pending
            .extend(pending.map(|pending| (sender, (session, pending))));
        None
    }

    /// A new session of a processor begins.
    pub(super) fn forget_all(&self, processor: Processor) {
        let mut cache = self.lock();
        cache.files.retain(|(of, _, _), _| *of != processor);
        cache.tables.remove(&processor);
    }
}

impl<S: Steps> FileServer<S> {
    /// Returns the place of the client's table; asks for it if need be.
    pub(super) fn table(&self, job: &Job<'_>) -> Result<u32, Stop> {
        let known = self.open.lock().tables.get(&job.processor).copied();
        if let Some((session, table)) = known
            && session == job.request.session
        {
            return Ok(table);
        }
        let table = (job.ask)(job.request.session).ok_or(Stop::Again)?;
        let mut cache = self.open.lock();
        cache
            .tables
            .insert(job.processor, (job.request.session, table));
        Ok(table)
    }

    /// The file that the request is about, opened again if need be.
    pub(super) fn opened(&self, job: &Job<'_>) -> Result<Arc<OpenFile>, Stop> {
        let request = &job.request;
        let key = (job.processor, request.session, request.handle);
        if let Some(opened) = self.open.lock().files.get(&key) {
            return Ok(Arc::clone(opened));
        }
        let block = self.block(job)?.ok_or(Errno::BADF)?;
        let place = job.former(&block)?;
        let flags = system_flags(block.flags);
        let file = self.reopen(job, &place, flags, block.evidence)?;
        if block.flags & flag::WRITE != 0 {
            self.check_writable(job)?;
        }
        if about(&file, c"")?.0 != block.evidence {
            return Err(Errno::STALE.into());
        }
        let flags = block.flags;
        Ok(self
            .open
            .keep(job, request.handle, OpenFile { file, flags }))
    }

    /// The block of the file that the request is about, if it is open.
    pub(super) fn block(&self, job: &Job<'_>) -> Result<Option<Block>, Stop> {
        let blocks = self.blocks(job)?;
        let index = job.request.file;
        let Some(at) = blocks.at(index) else {
            return Ok(None);
        };
        let block = Block::read(job, at)?;
        Ok(block.filter(|block| block.handle == job.request.handle))
    }

    /// All blocks in which the client has something open.
    pub(super) fn open_blocks(&self, job: &Job<'_>) -> Result<Vec<Block>, Stop> {
        let blocks = self.blocks(job)?;
        let mut open = Vec::new();
        for at in (0..blocks.count).filter_map(|index| blocks.at(index)) {
            open.extend(Block::read(job, at)?);
        }
        Ok(open)
    }

    fn blocks(&self, job: &Job<'_>) -> Result<Blocks, Stop> {
        let at = self.table(job)?;
        if at == wire::NONE {
            return Ok(Blocks::NONE);
        }
        let [magic, count, first, stride] = words(&job.region, at)?;
        if magic != table::MAGIC || count > wire::MAX_FILES || stride < block::BYTES {
            return Err(Errno::FAULT.into());
        }
        Ok(Blocks {
            count,
            first,
            stride,
        })
    }

    /// Lets the files that have this evidence and are open keep their inode under the unique name of
    /// this operation; whether there are any.
    pub(super) fn mark_silly(&self, job: &Job<'_>, evidence: FileIdentity) -> Result<bool, Stop> {
        let sequence = job.request.sequence;
        let mut any = false;
        for block in self.open_blocks(job)? {
            if block.evidence == evidence && (block.has_path() || block.silly == sequence) {
                let [low, high] = wire::halves(sequence);
                // The low word last: a next incarnation sees all of it, or none.
                job.region.set_word(block.at + block::SILLY + 4, high)?;
                job.region.set_word(block.at + block::SILLY, low)?;
                any = true;
            }
        }
        Ok(any)
    }

    /// Whether the client has a file open that has this evidence, by a name that clients see.
    pub(super) fn is_open(&self, job: &Job<'_>, evidence: FileIdentity) -> Result<bool, Stop> {
        let blocks = self.open_blocks(job)?;
        Ok(blocks
            .iter()
            .any(|block| block.evidence == evidence && block.has_path()))
    }

    /// Whether the client has a file open that has the unique name of this operation.
    pub(super) fn is_set_aside(&self, job: &Job<'_>) -> Result<bool, Stop> {
        let blocks = self.open_blocks(job)?;
        Ok(blocks
            .iter()
            .any(|block| block.silly == job.request.sequence))
    }

    /// The last end of a file that has a silly name removes it.
    pub(super) fn close(&self, job: &Job<'_>) -> Result<(), Stop> {
        self.open.forget(job);
        let Some(block) = self.block(job)? else {
            return Ok(()); // Closed already.
        };
        if block.has_path() {
            return Ok(());
        }
        let blocks = self.open_blocks(job)?;
        let others = blocks
            .iter()
            .any(|other| other.at != block.at && other.silly == block.silly);
        if !others {
            // The file may have been closed before.
            let _ = self.discard(&block.unique_name(job.processor));
        }
        Ok(())
    }
}

/// A table, checked.
struct Blocks {
    count: u32,
    first: u32,
    stride: u32,
}

impl Blocks {
    const NONE: Self = Self {
        count: 0,
        first: 0,
        stride: 0,
    };

    fn at(&self, index: u32) -> Option<u32> {
        if index >= self.count {
            return None;
        }
        self.first.checked_add(index.checked_mul(self.stride)?)
    }
}

impl Block {
    pub(super) const fn path(&self) -> Span {
        self.path
    }

    /// The name under which the file is kept.
    pub(super) fn unique_name(&self, processor: Processor) -> CString {
        unique_name(processor, self.session, self.silly)
    }

    /// Whether the file has the path with which it was opened, and no silly name.
    pub(super) const fn has_path(&self) -> bool {
        self.silly as u32 == 0
    }

    /// The block at `at`, if something is open in it.
    fn read(job: &Job<'_>, at: u32) -> Result<Option<Self>, Errno> {
        let words: [u32; block::WORDS] = words(&job.region, at)?;
        let block = Self {
            at,
            ..Self::of(&words)
        };
        let is_open = block.magic == block::MAGIC && block.handle as u32 != 0;
        Ok((is_open && block.session == job.request.session).then_some(block))
    }
}

/// Returns the flags of an open file that remain in force after the open.
pub(super) fn system_flags(flags: u32) -> OFlags {
    let access = match (flags & flag::READ != 0, flags & flag::WRITE != 0) {
        (true, true) => OFlags::RDWR,
        (false, true) => OFlags::WRONLY,
        _ => OFlags::RDONLY,
    };
    let mut system = access;
    system.set(OFlags::APPEND, flags & flag::APPEND != 0);
    system.set(OFlags::DIRECTORY, flags & flag::DIRECTORY != 0);
    system
}

/// The name X of WIRE.md.
pub(super) fn unique_name(processor: Processor, session: u64, sequence: u64) -> CString {
    let name = format!("{:02x}-{session:016x}-{sequence:016x}", processor.0);
    CString::new(name).unwrap_or_default() // The name has no zero byte.
}
