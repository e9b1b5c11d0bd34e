//! [`TerminalReader`]: the host's half of a terminal's ring in shared memory.

use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Processor, Region, StoreOrder};

use crate::layout::{
    BLOCK_BYTES, MAGIC, VERSION, host as words, is_capacity, is_offset, mode, processor,
};
use crate::sync::{Ordering, fence};

/// The host's reader of one terminal's output. It works in any kind of memory window and does not
/// allocate. On Linux, `TerminalHost` (feature `linux`) also sends input.
///
/// The position up to which the host has read is in shared memory, not in this value. If a host
/// dies in any way, the next one continues where that host stopped; it gets again the bytes that
/// were read but not [acknowledged](Self::acknowledge). Only one host at a time reads a terminal; a
/// host that attaches displaces the host that was attached before.
///
/// ```
/// use condor_mbox::{CriticalSection, MemoryWindow, Allocator, Processor, Region, StaticMemory};
/// use condor_tty::{TerminalReader, Terminal};
///
/// static MEMORY: StaticMemory<512> = StaticMemory::new();
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let ram = Region::users(MEMORY.window())?;
/// let mut allocator = Allocator::new(ram.size());
/// let terminal = Terminal::<_, _, 64>::new(ram, &mut allocator, 256, CriticalSection)?;
/// terminal.accept(b'a')?; // which is echoed
///
/// let mut reader = TerminalReader::attach(ram, terminal.offset(), Processor(1))?;
/// let mut bytes = [0; 64];
/// let fetched = reader.fetch(&mut bytes)?;
/// assert_eq!((&bytes[..fetched.len], fetched.skipped), (&b"a"[..], 0));
/// reader.acknowledge(fetched.len)?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct TerminalReader<W> {
    pub(crate) region: Region<W>,
    offset: u32,
    capacity: u32,
    incarnation: u32,
    /// The word by which this host is marked as attached.
    attached: u32,
    /// The position up to which output has been acknowledged, as in shared memory.
    tail: u32,
    overwritten: u32,
    /// The number of the record that is that of `tail`.
    record: usize,
    /// The position where the last fetch began, after the overwritten bytes that it found; `end` is where it
    /// ended.
    begin: u32,
    end: u32,
    skipped: u32,
}

/// The result of [`TerminalReader::fetch`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FetchedOutput {
    /// The number of bytes that were copied.
    pub len: usize,
    /// The number of bytes directly before the copied ones that are missing, because they were
    /// overwritten unread.
    pub skipped: u32,
}

/// The counts and modes of a terminal, as its host sees them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TerminalStatus {
    /// The number of bytes for which there was no room, counted by the processor; wraps.
    pub lost: u32,
    /// The number of bytes that were overwritten before a host had acknowledged them; wraps.
    pub overwritten: u32,
    /// The number of bytes in the ring that have not been acknowledged.
    pub unread: u32,
    /// The number of invalid values of the host's position that the processor has ignored; wraps.
    pub ignored: u32,
    /// The number of characters from hosts that the terminal has taken since its program made it;
    /// wraps.
    pub typed: u32,
    /// Whether the terminal edits lines on the processor before the program gets them.
    pub cooked: bool,
    /// Whether a person has stopped the output.
    pub stopped: bool,
    /// Whether a character has been refused, and the program has read nothing since.
    pub full: bool,
    /// The character that interrupts; `None` if there is none.
    pub interrupt: Option<u8>,
}

/// The reason why a host cannot attach to a terminal or read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TerminalReaderError {
    /// The terminal's memory cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// There is no terminal there, or one of another version of the layout.
    #[error(
        "there is no terminal of version {VERSION} and magic {MAGIC:#x} at offset {offset:#x}: found version \
         {version} and magic {magic:#x}"
    )]
    NoTerminal {
        /// The offset at which it should be in the users' region, in bytes.
        offset: u32,
        /// The word that was found instead of the magic number.
        magic: u32,
        /// The word that was found instead of the version.
        version: u32,
    },
    /// The processor is initialising the terminal: try again.
    #[error("the terminal at offset {offset:#x} is not ready: its program is about to make it")]
    NotReady {
        /// The offset of the terminal in the users' region, in bytes.
        offset: u32,
    },
    /// The processor has made the terminal anew: attach again.
    #[error(
        "the terminal at offset {offset:#x} was made again, as incarnation {incarnation}: attach to it again"
    )]
    Restarted {
        /// The offset of the terminal in the users' region, in bytes.
        offset: u32,
        /// The number of the terminal's present incarnation, the time since a program made it.
        incarnation: u32,
    },
    /// Another host has attached.
    #[error(
        "another host has attached to the terminal at offset {offset:#x} (its word there is {attached:#x}): attach again to take it back"
    )]
    Displaced {
        /// The offset of the terminal in the users' region, in bytes.
        offset: u32,
        /// The word that the other host has written: its number plus 1 in the lowest 8 bits, and
        /// above them a count of attachments.
        attached: u32,
    },
    /// One of the processor's words has a value that no terminal writes.
    #[error("the terminal at offset {offset:#x} has invalid memory: word {word} is {value:#x}")]
    Broken {
        /// The offset of the terminal in the users' region, in bytes.
        offset: u32,
        /// The offset of the word in the terminal's block, in bytes.
        word: u32,
        /// The value of the word.
        value: u32,
    },
}

impl<W: MemoryWindow> TerminalReader<W> {
    /// Attaches a host to a terminal of a processor. `region` is the processor's [`Region::users`],
    /// `offset` the place of the terminal in it in bytes, and `me` the host's own number.
    ///
    /// From then on writers with [`Policy::Block`](crate::Policy::Block) wait for the host, and the
    /// processor's messages go to `me`. If no host has read the terminal yet, reading begins with
    /// the oldest byte that is still there.
    ///
    /// # Errors
    /// [`TerminalReaderError::NoTerminal`] if there is none of this layout, [`TerminalReaderError::NotReady`] if it
    /// is being initialised, [`TerminalReaderError::Restarted`] if it was made anew meanwhile,
    /// [`TerminalReaderError::Broken`] if a word is invalid, [`TerminalReaderError::Access`] if the memory cannot
    /// be accessed.
    pub fn attach(
        region: Region<W>,
        offset: u32,
        me: Processor,
    ) -> Result<Self, TerminalReaderError> {
        let mut this = Self {
            region,
            offset,
            capacity: 0,
            incarnation: 0,
            attached: 0,
            tail: 0,
            overwritten: 0,
            record: 0,
            begin: 0,
            end: 0,
            skipped: 0,
        };
        this.look()?;
        this.take_over(me)?;
        Ok(this)
    }

    /// Checks that there is a terminal, and notes what does not change in its incarnation.
    fn look(&mut self) -> Result<(), TerminalReaderError> {
        let offset = self.offset;
        if !is_offset(offset) {
            let (magic, version) = (0, 0);
            return Err(TerminalReaderError::NoTerminal {
                offset,
                magic,
                version,
            });
        }
        // Acquire: pairs with the Release store that ends `Output::format`; the block is in order.
        let incarnation = self.load(processor::INCARNATION, LoadOrder::Acquire)?;
        let magic = self.load(processor::MAGIC, LoadOrder::Relaxed)?;
        let version = self.load(processor::VERSION, LoadOrder::Relaxed)?;
        if incarnation == 0 && (magic == 0 || magic == MAGIC) {
            return Err(TerminalReaderError::NotReady { offset });
        }
        if magic != MAGIC || version != VERSION {
            return Err(TerminalReaderError::NoTerminal {
                offset,
                magic,
                version,
            });
        }
        let capacity = self.load(processor::CAPACITY, LoadOrder::Relaxed)?;
        if !is_capacity(capacity) {
            return Err(self.broken(processor::CAPACITY, capacity));
        }
        self.region
            .check(offset, (BLOCK_BYTES + capacity) as usize)?;
        self.incarnation = incarnation;
        self.capacity = capacity;
        Ok(())
    }

    /// Goes on where the host before stopped.
    fn take_over(&mut self, me: Processor) -> Result<(), AccessError> {
        let before = self.load(words::ATTACHED, LoadOrder::Relaxed)?;
        let number = u32::from(me.0).wrapping_add(1) & 0xff;
        self.attached = (before | 0xff).wrapping_add(1) | number;
        if self.load(words::INCARNATION, LoadOrder::Acquire)? == self.incarnation {
            // Acquire: pairs with the Release store in `commit`; its record is there.
            self.tail = self.load(words::TAIL, LoadOrder::Acquire)?;
            for (record, at) in words::RECORDS.into_iter().enumerate() {
                if self.load(at, LoadOrder::Relaxed)? == self.tail {
                    self.record = record;
                    self.overwritten = self.load(at.wrapping_add(4), LoadOrder::Relaxed)?;
                }
            }
        } else {
            // The record that is not of the present tail never has its key: it may be half written.
            for (at, key) in words::RECORDS.into_iter().zip([u32::MAX, 0]) {
                self.store(at, key, StoreOrder::Relaxed)?;
                self.store(at.wrapping_add(4), 0, StoreOrder::Relaxed)?;
            }
            self.store(words::TAIL, 0, StoreOrder::Relaxed)?;
            self.record = 1;
        }
        self.begin = self.tail;
        self.end = self.tail;
        self.store(words::ATTACHED, self.attached, StoreOrder::Relaxed)?;
        // Release: pairs with the Acquire loads in `Output`; the words above are about this incarnation.
        self.store(words::INCARNATION, self.incarnation, StoreOrder::Release)
    }

    /// Copies the bytes after the acknowledged ones into `into`, as many as have been written and
    /// as fit. A call without [`acknowledge`](Self::acknowledge) in between copies the same bytes
    /// again. If the processor has just overwritten all of the bytes, none is copied, and they
    /// count as skipped.
    ///
    /// # Errors
    /// [`TerminalReaderError::Displaced`] if another host has attached, [`TerminalReaderError::Restarted`] if the
    /// terminal was made anew, [`TerminalReaderError::Broken`] if a word is invalid,
    /// [`TerminalReaderError::Access`] if the memory cannot be accessed.
    pub fn fetch(&mut self, into: &mut [u8]) -> Result<FetchedOutput, TerminalReaderError> {
        self.check_attached()?;
        self.begin = self.tail;
        self.skipped = 0;
        self.skip_overwritten()?;
        // Acquire: pairs with the Release store in `Output::publish`; the bytes are there.
        let head = self.load(processor::HEAD, LoadOrder::Acquire)?;
        let available = head.wrapping_sub(self.begin);
        if available > u32::MAX / 2 {
            return Err(self.broken(processor::HEAD, head));
        }
        // More than the capacity if the processor has overtaken this host just now.
        let most = (available.min(self.capacity) as usize).min(into.len());
        let copied = into.get_mut(..most).unwrap_or_default();
        self.copy(copied)?;
        // Pairs with the fence in `Output::reserve`: if a byte of a later round was copied, its
        // mark is seen below.
        fence(Ordering::Acquire);
        let gone = (self.skip_overwritten()? as usize).min(copied.len());
        copied.copy_within(gone.., 0);
        let len = copied.len() - gone;
        // A new incarnation that began meanwhile has bytes of its own.
        self.check_attached()?;
        self.end = self.begin.wrapping_add(len as u32);
        Ok(FetchedOutput {
            len,
            skipped: self.skipped,
        })
    }

    /// Moves the beginning past the bytes that have been overwritten; returns their number.
    fn skip_overwritten(&mut self) -> Result<u32, AccessError> {
        // Acquire: pairs with the Release store in `Output::reserve`; the head that is seen
        // afterwards is not behind what is skipped here.
        let reserved = self.load(processor::RESERVED, LoadOrder::Acquire)?;
        let gone = reserved
            .wrapping_sub(self.begin)
            .saturating_sub(self.capacity);
        self.begin = self.begin.wrapping_add(gone);
        self.skipped = self.skipped.wrapping_add(gone);
        Ok(gone)
    }

    /// Copies the bytes from the beginning on.
    fn copy(&self, into: &mut [u8]) -> Result<(), AccessError> {
        let mut position = self.begin;
        let mut rest = into;
        while !rest.is_empty() {
            let index = position & (self.capacity - 1);
            let at = self.offset.wrapping_add(BLOCK_BYTES).wrapping_add(index);
            let until_end = self.capacity.wrapping_sub(index) as usize;
            let within = at as usize % 4;
            let len = if within == 0 {
                until_end.min(rest.len())
            } else {
                (4 - within).min(rest.len())
            };
            let Some((part, others)) = rest.split_at_mut_checked(len) else {
                return Ok(());
            };
            if within == 0 {
                self.region.read(at, part)?;
            } else {
                let word = self.region.load(at & !3, LoadOrder::Relaxed)?.to_le_bytes();
                for (place, byte) in part.iter_mut().zip(word.iter().skip(within)) {
                    *place = *byte;
                }
            }
            position = position.wrapping_add(len as u32);
            rest = others;
        }
        Ok(())
    }

    /// Acknowledges the next `count` bytes of the last [`fetch`](Self::fetch), and bytes that were
    /// overwritten before them, so that the processor can reuse their room. Returns true if the
    /// processor waits for room; the caller must then send it a message to
    /// [`TerminalVectors::room`](crate::layout::TerminalVectors::room).
    ///
    /// # Errors
    /// [`TerminalReaderError::Displaced`] if another host has attached, [`TerminalReaderError::Restarted`] if the
    /// terminal was made anew, [`TerminalReaderError::Access`] if the memory cannot be accessed.
    pub fn acknowledge(&mut self, count: usize) -> Result<bool, TerminalReaderError> {
        self.check_attached()?;
        let fetched = self.end.wrapping_sub(self.begin) as usize;
        let tail = self.begin.wrapping_add(count.min(fetched) as u32);
        if tail != self.tail {
            self.commit(tail, self.overwritten.wrapping_add(self.skipped))?;
            self.begin = tail;
            self.skipped = 0;
        }
        // Pairs with the fence in `Output::set_waiting`.
        fence(Ordering::SeqCst);
        Ok(self.load(processor::WAITING, LoadOrder::Relaxed)? != 0)
    }

    /// One store publishes both the host's position and the number of bytes overwritten before it,
    /// so that the next host finds the record that belongs to the tail.
    fn commit(&mut self, tail: u32, overwritten: u32) -> Result<(), AccessError> {
        let record = 1 - self.record.min(1);
        let [first, second] = words::RECORDS;
        let at = if record == 0 { first } else { second };
        self.store(at.wrapping_add(4), overwritten, StoreOrder::Relaxed)?;
        self.store(at, tail, StoreOrder::Relaxed)?;
        // Release: pairs with the Acquire loads in `Output` and in `take_over`; the bytes have been
        // copied, and the record is there.
        self.store(words::TAIL, tail, StoreOrder::Release)?;
        self.tail = tail;
        self.record = record;
        self.overwritten = overwritten;
        Ok(())
    }

    /// Detaches this host, so that no program waits for it.
    ///
    /// # Errors
    /// [`TerminalReaderError::Displaced`] if another host has attached, [`TerminalReaderError::Restarted`] if the
    /// terminal was made anew, [`TerminalReaderError::Access`] if the memory cannot be accessed.
    pub fn detach(self) -> Result<(), TerminalReaderError> {
        self.check_attached()?;
        Ok(self.store(words::ATTACHED, self.attached & !0xff, StoreOrder::Release)?)
    }

    /// Returns the counts and modes of the terminal.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn status(&self) -> Result<TerminalStatus, AccessError> {
        let word = |word| self.load(word, LoadOrder::Relaxed);
        let behind = word(processor::RESERVED)?.wrapping_sub(self.tail);
        let mode = word(processor::MODE)?;
        let interrupt = (mode >> mode::INTERRUPT_SHIFT).to_le_bytes()[0];
        Ok(TerminalStatus {
            lost: word(processor::LOST)?,
            overwritten: self
                .overwritten
                .wrapping_add(behind.saturating_sub(self.capacity)),
            unread: behind.min(self.capacity),
            ignored: word(processor::IGNORED)?,
            typed: word(processor::TYPED)?,
            cooked: mode & mode::COOKED != 0,
            stopped: mode & mode::STOPPED != 0,
            full: mode & mode::FULL != 0,
            interrupt: (interrupt != 0).then_some(interrupt),
        })
    }

    /// Returns the offset of the terminal in its processor's [`Region::users`], in bytes.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.offset
    }

    /// Returns the incarnation of the terminal to which this host is attached: a number that changes each
    /// time a program makes the terminal anew.
    #[must_use]
    pub const fn incarnation(&self) -> u32 {
        self.incarnation
    }

    /// Returns how many bytes of output have been acknowledged or overwritten since the program
    /// made the terminal; wraps.
    #[must_use]
    pub const fn position(&self) -> u32 {
        self.tail
    }

    /// Returns the size of the terminal's ring of output, in bytes.
    #[must_use]
    pub const fn capacity(&self) -> u32 {
        self.capacity
    }

    fn check_attached(&self) -> Result<(), TerminalReaderError> {
        let offset = self.offset;
        let incarnation = self.load(processor::INCARNATION, LoadOrder::Relaxed)?;
        if incarnation != self.incarnation {
            return Err(TerminalReaderError::Restarted {
                offset,
                incarnation,
            });
        }
        let attached = self.load(words::ATTACHED, LoadOrder::Relaxed)?;
        if attached != self.attached {
            return Err(TerminalReaderError::Displaced { offset, attached });
        }
        Ok(())
    }

    const fn broken(&self, word: u32, value: u32) -> TerminalReaderError {
        TerminalReaderError::Broken {
            offset: self.offset,
            word,
            value,
        }
    }

    fn load(&self, word: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.region.load(self.offset.wrapping_add(word), order)
    }

    fn store(&self, word: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.region
            .store(self.offset.wrapping_add(word), value, order)
    }
}
