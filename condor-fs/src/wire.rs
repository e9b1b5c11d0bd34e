//! The words of WIRE.md: their offsets and values.

pub mod again;

use condor_mbox::Vector;

/// The vector to which clients send their requests; the server handles it.
pub const FILES: Vector = Vector(40);
/// The vector to which the server sends the question where a client's table of open files is; the
/// client handles it.
pub const OPEN_FILES: Vector = Vector(41);

/// The reply of the server that says: the result of the request is in the slot.
pub const DONE: u32 = 1;
/// The bit of a reply that says: the request has succeeded, and the rest of the reply is the
/// returned value. The server uses it for values below this number; then the client need not read
/// the value in the slot.
pub const VALUE: u32 = 0x4000_0000;
/// The bit of a reply that says: the server refused the request, and the rest of the reply is the
/// error number. The slot is unchanged then.
pub const REFUSED: u32 = 0x8000_0000;
/// The offset that stands for "no table": the reply to [`OPEN_FILES`] of a client without a table
/// of open files.
pub const NONE: u32 = u32::MAX;
/// The session number in the first request of a client, which asks for a new session.
pub const NO_SESSION: u64 = 0;

/// The greatest number of blocks in a table of open files. There is one block for each open file.
pub const MAX_FILES: u32 = 4096;
/// The greatest length of a path, in bytes.
pub const MAX_PATH: u32 = 4095;

/// The slot of a client, which holds its request and the result: its magic number, its sizes, and
/// the byte offsets of its words.
pub mod slot {
    /// The magic number of a slot: "CFS2" in little-endian order.
    pub const MAGIC: u32 = 0x3253_4643;
    /// The size of a slot, in bytes.
    pub const BYTES: u32 = 320;
    /// The number of words of a slot that the client writes, from offset 0 on.
    pub const REQUEST_WORDS: usize = 18;
    /// The number of words of a request that every operation uses: the first cache line of the
    /// slot. Only some operations use the words behind them.
    pub const LINE_WORDS: usize = 16;
    /// The byte offset, in a slot, of the request's sequence number; 2 words.
    pub const SEQUENCE: u32 = 12;
    /// The byte offset, in a slot, of the number of the requested [`Operation`](super::Operation).
    pub const OPERATION: u32 = 20;
    /// The number of words of a slot that the server writes, from offset [`STATE`] on.
    pub const RESULT_WORDS: usize = 48;
    /// The byte offset, in a slot, of the request's [state](super::state), the first word that the
    /// server writes.
    pub const STATE: u32 = 128;
    /// The byte offset, in a slot, of the session to which the state belongs; 2 words.
    pub const STATE_SESSION: u32 = 132;
    /// The byte offset, in a slot, of the sequence number of the request to which the state
    /// belongs; 2 words.
    pub const STATE_SEQUENCE: u32 = 140;
    /// The byte offset, in a slot, of the number of runs of the server that have taken the request.
    pub const INCARNATIONS: u32 = 148;
    /// The byte offset, in a slot, of the error number with which the operation failed; this word
    /// is 0 after success.
    pub const ERRNO: u32 = 152;
    /// The byte offset, in a slot, of the value that the operation returns, such as the number of
    /// bytes read; 2 words.
    pub const VALUE: u32 = 156;
    /// The byte offset, in a slot, of the [identity](super::FileIdentity) of the file: device,
    /// inode and birth time; 8 words. While an append is staged, these words hold the end of the
    /// file instead.
    pub const EVIDENCE: u32 = 192;
    /// The byte offset, in a slot, of the [`FileStatus`](super::FileStatus) of the file or
    /// directory, or of the [`Space`](super::Space) of the filesystem, if the operation returns
    /// one.
    pub const STATUS: u32 = 224;
    /// The number of words of a slot, from offset [`STATUS`] on, for a status.
    pub const STATUS_WORDS: usize = 24;
    /// The byte offset, in a slot, of a mode that the server must restore: the last word of the
    /// [identity](super::FileIdentity). To open a file again, a server may have to change the
    /// file's mode for a moment. Meanwhile this word is the former mode plus [`MODE_CHANGED`]; at
    /// all other times it is 0.
    pub const MODE: u32 = EVIDENCE + 28;
    /// The bit that is set in the word at [`MODE`] while it holds a mode.
    pub const MODE_CHANGED: u32 = 0x8000_0000;
}

/// The states of the request in a slot.
pub mod state {
    /// The state of a request that no server has taken.
    pub const NONE: u32 = 0;
    /// The state of a request that a server has taken, so that something may have been done.
    pub const TAKEN: u32 = 1;
    /// The state of a request for which a server has recorded in the slot what the next server must
    /// know to finish it.
    pub const STAGED: u32 = 2;
    /// The state of a request whose operation has ended and whose result is in the slot.
    pub const DONE: u32 = 3;
}

/// The head of a client's table of open files: its magic number and size.
pub mod table {
    /// The magic number of a table: "CFT1" in little-endian order.
    pub const MAGIC: u32 = 0x3154_4643;
    /// The size of the head of a table, without the blocks, in bytes.
    pub const BYTES: u32 = 16;
}

/// The block of an open file in the client's memory: its magic number, its sizes, and the byte
/// offsets of its words.
pub mod block {
    /// The magic number of a block: "CFF1" in little-endian order.
    pub const MAGIC: u32 = 0x3146_4643;
    /// The size of a block, in bytes.
    pub const BYTES: u32 = 72;
    /// The size of a block, in words of four bytes.
    pub const WORDS: usize = 18;
    /// The byte offset, in a block, of the number of the client's session; 2 words.
    pub const SESSION: u32 = 4;
    /// The byte offset, in a block, of the handle: the sequence number of the operation that opened
    /// the file; 2 words. The low word is 0 if the block is free.
    pub const HANDLE: u32 = 12;
    /// The byte offset, in a block, of the [flags](super::open) with which the file was opened.
    pub const FLAGS: u32 = 20;
    /// The byte offset, in a block, of the place of the path: first the path's offset in the
    /// client's memory, then its length in bytes; 2 words.
    pub const PATH: u32 = 24;
    /// The byte offset, in a block, of the sequence number of the operation that unlinked or
    /// replaced the open file, and so gave it a unique ("silly") name; 2 words. The low word is 0
    /// if there was none.
    pub const SILLY: u32 = 32;
    /// The byte offset, in a block, of the [identity](super::FileIdentity) of the file; 8 words.
    pub const EVIDENCE: u32 = 40;
}

/// The flags of a request to open a file.
pub mod open {
    /// The flag for opening a file for reading.
    pub const READ: u32 = 1;
    /// The flag for opening a file for writing.
    pub const WRITE: u32 = 2;
    /// The flag for writing always at the end of the file; only with [`WRITE`].
    pub const APPEND: u32 = 4;
    /// The flag for creating the file if it does not exist.
    pub const CREATE: u32 = 8;
    /// The flag for truncating the file to length 0; only with [`WRITE`].
    pub const TRUNCATE: u32 = 16;
    /// The flag for failing if the file exists; only with [`CREATE`].
    pub const EXCLUSIVE: u32 = 32;
    /// The flag for opening a directory, to read its entries.
    pub const DIRECTORY: u32 = 64;
    /// The flag that says that the request has the permissions of a file that is created. Without
    /// it, the server's options decide.
    pub const MODE: u32 = 128;
    /// All flags of an open, combined.
    pub const ALL: u32 = 255;
}

/// The flags of a request to make a directory.
pub mod make_directory {
    /// The flag that says that the request has the permissions of the directory. Without it, the
    /// server's options decide.
    pub const MODE: u32 = 128;
}

/// Nanoseconds in a request to set the times of a file, with the two numbers that have another
/// meaning.
pub mod time {
    /// The greatest number of nanoseconds in a time: just below one second.
    pub const MAX_NS: u32 = 999_999_999;
    /// The number of nanoseconds that stands for the host's present time.
    pub const NOW: u32 = 0x3fff_ffff;
    /// The number of nanoseconds that says that the time stays as it is.
    pub const KEEP: u32 = 0x3fff_fffe;
}

/// The flags of a request to rename a file or directory.
pub mod rename {
    /// The flag for failing if the new name exists.
    pub const NO_REPLACE: u32 = 1;
    /// The flag for exchanging the two names, which must both exist.
    pub const EXCHANGE: u32 = 2;
}

/// The flags of a request to find data or holes in a file: one of the two.
pub mod find {
    /// The flag for finding data.
    pub const DATA: u32 = 1;
    /// The flag for finding a hole. The end of the file counts as one.
    pub const HOLE: u32 = 2;
}

/// The flags of a request to take or release room on the disk for a range of a file.
pub mod allocate {
    /// The flag for keeping the size of the file.
    pub const KEEP_SIZE: u32 = 1;
    /// The flag for releasing the room of the range, which then reads as zeros; only with
    /// [`KEEP_SIZE`].
    pub const PUNCH_HOLE: u32 = 2;
    /// The flag for making the range read as zeros without releasing its room.
    pub const ZERO: u32 = 4;
}

/// An operation that a client can request. The number of each variant is the word at
/// [`slot::OPERATION`]. The section "Operations" of WIRE.md lists the arguments and results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[allow(missing_docs)] // The table of WIRE.md.
pub enum Operation {
    Session = 1,
    Open = 2,
    Close = 3,
    Read = 4,
    Write = 5,
    Append = 6,
    Truncate = 7,
    Sync = 8,
    FileStatus = 9,
    PathStatus = 10,
    ReadDirectory = 11,
    MakeDirectory = 12,
    RemoveDirectory = 13,
    Unlink = 14,
    Rename = 15,
    FileMode = 16,
    PathMode = 17,
    FileTimes = 18,
    PathTimes = 19,
    Space = 20,
    Find = 21,
    Allocate = 22,
}

impl Operation {
    /// All operations in the order of their numbers, which begin with 1.
    pub const ALL: [Self; 22] = [
        Self::Session,
        Self::Open,
        Self::Close,
        Self::Read,
        Self::Write,
        Self::Append,
        Self::Truncate,
        Self::Sync,
        Self::FileStatus,
        Self::PathStatus,
        Self::ReadDirectory,
        Self::MakeDirectory,
        Self::RemoveDirectory,
        Self::Unlink,
        Self::Rename,
        Self::FileMode,
        Self::PathMode,
        Self::FileTimes,
        Self::PathTimes,
        Self::Space,
        Self::Find,
        Self::Allocate,
    ];

    /// Returns the operation with the number `word`; `None` if no operation has this number.
    #[must_use]
    pub fn from_word(word: u32) -> Option<Self> {
        Self::ALL.get(word.wrapping_sub(1) as usize).copied()
    }

    /// Returns true if the operation uses the words of the request behind its first
    /// [`LINE_WORDS`](slot::LINE_WORDS).
    #[must_use]
    pub const fn has_second_line(self) -> bool {
        matches!(
            self,
            Self::Rename | Self::FileTimes | Self::PathTimes | Self::Allocate
        )
    }
}

/// A request, as a client writes it into its slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RequestSlot {
    /// The number of the client's session, which is the result of the client's first request.
    pub session: u64,
    /// The sequence number of the operation in its session: see [`following`].
    pub sequence: u64,
    /// The number of an [`Operation`].
    pub operation: u32,
    /// The flags of the operation, if it has some: those of [`open`], [`make_directory`],
    /// [`rename`], [`find`] or [`allocate`].
    pub flags: u32,
    /// The handle of an open file: the sequence number of the operation that opened it.
    pub handle: u64,
    /// The index of the open file's block in the client's table of open files.
    pub file: u32,
    /// The place of the operation's path in the client's memory.
    pub path: Span,
    /// A position in a file, in bytes from its beginning; some operations use it for a size, a
    /// mode, or times.
    pub position: u64,
    /// The place of the buffer for data in the client's memory.
    pub buffer: Span,
    /// The place of the second path of an operation that has two, such as a rename.
    pub second_path: Span,
}

/// A range of bytes in the client's memory: in the users' region of its `data`, the part that is
/// for programs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// The offset in bytes from the beginning of the users' region.
    pub offset: u32,
    /// The length in bytes.
    pub len: u32,
}

/// Returns the word of the reply to a request that has succeeded with `value`. It contains the
/// value if `value` is below [`VALUE`]; otherwise it is [`DONE`], and the client reads the value in
/// the slot.
#[must_use]
pub const fn with_value(value: u64) -> u32 {
    if value < VALUE as u64 {
        VALUE | value as u32
    } else {
        DONE
    }
}

/// Returns the value that the word `reply` contains; `None` if the value is in the slot, or if the
/// server refused the request.
#[must_use]
pub const fn value_of(reply: u32) -> Option<u32> {
    match reply ^ VALUE {
        value @ 0..VALUE => Some(value),
        _ => None,
    }
}

/// Splits `number` into two words: first the low word, then the high word.
#[must_use]
pub const fn halves(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}

/// Joins two words into the number with the low word `low` and the high word `high`.
#[must_use]
pub const fn whole(low: u32, high: u32) -> u64 {
    low as u64 | (high as u64) << 32
}

/// Returns the sequence number that follows `sequence`. No number is used twice: at a million
/// operations a second, the numbers last for half a million years.
///
/// The low word is never zero, so it alone shows whether there is a sequence number. Whoever stores
/// a sequence number stores the low word last, so half of a number is never taken for another one.
#[must_use]
pub const fn following(sequence: u64) -> u64 {
    let next = sequence.wrapping_add(1);
    if next as u32 == 0 { next | 1 } else { next }
}

/// A structure that is stored in shared memory as whole words.
pub(crate) trait Words: Sized {
    /// Passes its words to `put`, in order.
    fn put(&self, put: &mut impl FnMut(u32));

    /// Makes it of words that `next` returns, in order.
    fn take(next: &mut impl FnMut() -> u32) -> Self;

    /// Returns the words, and zeros behind them.
    fn to_array<const N: usize>(&self) -> [u32; N] {
        let mut words = [0; N];
        let mut places = words.iter_mut();
        self.put(&mut |word| {
            if let Some(place) = places.next() {
                *place = word;
            }
        });
        words
    }

    /// Makes it of its words.
    fn of(words: &[u32]) -> Self {
        let mut words = words.iter().copied();
        Self::take(&mut || words.next().unwrap_or(0))
    }
}

impl Words for u32 {
    fn put(&self, put: &mut impl FnMut(u32)) {
        put(*self);
    }

    fn take(next: &mut impl FnMut() -> u32) -> Self {
        next()
    }
}

impl Words for u64 {
    fn put(&self, put: &mut impl FnMut(u32)) {
        halves(*self).into_iter().for_each(put);
    }

    fn take(next: &mut impl FnMut() -> u32) -> Self {
        let low = next();
        whole(low, next())
    }
}

/// Implements [`Words`] for a struct, with its fields in this order.
macro_rules! words {
    ($type:ident: $($field:ident),+) => {
        impl $crate::wire::Words for $type {
            fn put(&self, put: &mut impl FnMut(u32)) {
                $($crate::wire::Words::put(&self.$field, put);)+
            }

            fn take(next: &mut impl FnMut() -> u32) -> Self {
                Self {
                    $($field: $crate::wire::Words::take(next)),+
                }
            }
        }
    };
}
#[cfg(feature = "linux")]
pub(crate) use words;

words!(Span: offset, len);
words!(RequestSlot: session, sequence, operation, flags, file, handle, path, position, buffer, second_path);
words!(FileIdentity: device, inode, born_s, born_ns);
words!(
    FileStatus: size, modified_s, modified_ns, mode, links, device, inode, accessed_s, accessed_ns,
    changed_s, changed_ns, blocks, owner, group
);
words!(Space: block_bytes, blocks, free, available, files, free_files, name_bytes);

impl RequestSlot {
    /// Returns the words that a client writes to its slot: the magic number, and then the fields in
    /// order.
    #[must_use]
    pub fn to_words(&self) -> [u32; slot::REQUEST_WORDS] {
        let mut words = [slot::MAGIC; slot::REQUEST_WORDS];
        let [_, rest @ ..] = &mut words;
        *rest = self.to_array();
        words
    }

    /// Makes a request from the words of a slot; returns `None` if they do not begin with the magic
    /// number.
    #[must_use]
    pub fn from_words(words: &[u32; slot::REQUEST_WORDS]) -> Option<Self> {
        let [magic, rest @ ..] = words;
        (*magic == slot::MAGIC).then(|| Self::of(rest))
    }

    /// Returns the request with `times` in it, for an operation that sets the times of a file. They
    /// are stored in the fields `second_path`, `position` and `buffer`.
    #[must_use]
    pub fn with_times(self, times: Times) -> Self {
        let (accessed, modified) = (times.accessed.to_wire(), times.modified.to_wire());
        let span = |seconds| {
            let [offset, len] = halves(seconds);
            Span { offset, len }
        };
        Self {
            second_path: span(accessed.0),
            position: whole(accessed.1, modified.1),
            buffer: span(modified.0),
            ..self
        }
    }

    /// Returns the request with `bytes` in it as the length of a range, for
    /// [`Operation::Allocate`]. The length is stored in the field `second_path`.
    #[must_use]
    pub fn with_range_len(self, bytes: u64) -> Self {
        let [offset, len] = halves(bytes);
        Self {
            second_path: Span { offset, len },
            ..self
        }
    }

    /// Returns the length of the range that [`with_range_len`](Self::with_range_len) stored, in
    /// bytes.
    #[must_use]
    pub const fn range_len(&self) -> u64 {
        whole(self.second_path.offset, self.second_path.len)
    }

    /// Returns the times that [`with_times`](Self::with_times) stored; `None` if one of them has
    /// more than 999 999 999 nanoseconds.
    #[must_use]
    pub fn times(&self) -> Option<Times> {
        let [accessed_ns, modified_ns] = halves(self.position);
        let time = |span: Span, ns| SetTime::from_wire(whole(span.offset, span.len), ns);
        Some(Times {
            accessed: time(self.second_path, accessed_ns)?,
            modified: time(self.buffer, modified_ns)?,
        })
    }
}

/// New values for the times of a file, as [`FileSystem::set_times`](crate::FileSystem::set_times)
/// sets them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Times {
    /// The new time of the last access.
    pub accessed: SetTime,
    /// The new time of the last modification.
    pub modified: SetTime,
}

/// A new value for one of the times of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SetTime {
    /// The time stays as it is.
    #[default]
    Keep,
    /// The host's present time.
    Now,
    /// This time.
    At {
        /// Seconds since 1970; a time before 1970 is a two's complement, as in [`FileStatus`].
        s: u64,
        /// Nanoseconds within that second, below 10⁹.
        ns: u32,
    },
}

impl SetTime {
    const fn to_wire(self) -> (u64, u32) {
        match self {
            Self::Keep => (0, time::KEEP),
            Self::Now => (0, time::NOW),
            Self::At { s, ns } => (s, ns),
        }
    }

    const fn from_wire(s: u64, ns: u32) -> Option<Self> {
        match ns {
            time::KEEP => Some(Self::Keep),
            time::NOW => Some(Self::Now),
            0..=time::MAX_NS => Some(Self::At { s, ns }),
            _ => None,
        }
    }
}

/// The numbers that identify a file of the host. If another file takes its place later, the
/// identity differs: that file was born at another time, even if the host uses the number of the
/// inode again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FileIdentity {
    /// The number of the device that holds the filesystem.
    pub device: u64,
    /// The number of the inode.
    pub inode: u64,
    /// The time at which the file was created, in seconds since 1970.
    pub born_s: u64,
    /// The nanoseconds within that second.
    pub born_ns: u32,
}

impl FileIdentity {
    /// Returns the words by which a slot, or the block of an open file, holds the identity.
    #[must_use]
    pub fn to_words(self) -> [u32; 8] {
        self.to_array()
    }

    /// Makes an identity from the words of a slot or block.
    #[must_use]
    pub fn from_words(words: &[u32; 8]) -> Self {
        Self::of(words)
    }
}

/// The status of a file or directory, as `stat` of Unix tells it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FileStatus {
    /// The length in bytes.
    pub size: u64,
    /// The time of the last modification, in seconds since 1970.
    pub modified_s: u64,
    /// The nanoseconds of the time of the last modification.
    pub modified_ns: u32,
    /// Type and permissions, as `st_mode` of Linux.
    pub mode: u32,
    /// The number of the file's names (hard links).
    pub links: u32,
    /// The number of the device that holds the filesystem.
    pub device: u64,
    /// The number of the inode.
    pub inode: u64,
    /// The time of the last access, in seconds since 1970.
    pub accessed_s: u64,
    /// The nanoseconds of the time of the last access.
    pub accessed_ns: u32,
    /// The time of the last change of the inode, in seconds since 1970.
    pub changed_s: u64,
    /// The nanoseconds of the time of the last change of the inode.
    pub changed_ns: u32,
    /// The room that the file takes on the disk, in blocks of 512 bytes.
    pub blocks: u64,
    /// The number of the user of the host that owns the file.
    pub owner: u32,
    /// The number of the group of the host to which the file belongs.
    pub group: u32,
}

impl FileStatus {
    /// Returns true if this is the status of a directory.
    #[must_use]
    pub const fn is_directory(&self) -> bool {
        self.mode & 0o170_000 == 0o040_000
    }

    /// Returns true if this is the status of a regular file.
    #[must_use]
    pub const fn is_file(&self) -> bool {
        self.mode & 0o170_000 == 0o100_000
    }

    /// Returns the words by which a slot holds the status.
    #[must_use]
    pub fn to_words(self) -> [u32; slot::STATUS_WORDS] {
        self.to_array()
    }

    /// Makes a status from the words of a slot.
    #[must_use]
    pub fn from_words(words: &[u32; slot::STATUS_WORDS]) -> Self {
        Self::of(words)
    }
}

/// The capacity of the filesystem that holds the server's tree, in blocks and inodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Space {
    /// The number of bytes of a block.
    pub block_bytes: u64,
    /// The number of blocks.
    pub blocks: u64,
    /// The number of blocks that are free.
    pub free: u64,
    /// The number of free blocks that the server may still use; a quota of the server can make it
    /// smaller.
    pub available: u64,
    /// The number of inodes.
    pub files: u64,
    /// The number of inodes that are free.
    pub free_files: u64,
    /// The greatest length of a name, in bytes.
    pub name_bytes: u32,
}

impl Space {
    /// Returns the words by which a slot holds the capacity.
    #[must_use]
    pub fn to_words(self) -> [u32; slot::STATUS_WORDS] {
        self.to_array()
    }

    /// Makes a capacity from the words of a slot.
    #[must_use]
    pub fn from_words(words: &[u32; slot::STATUS_WORDS]) -> Self {
        Self::of(words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back() {
        let words = core::array::from_fn(|n| if n == 0 { slot::MAGIC } else { 7 * n as u32 });
        let request = RequestSlot::from_words(&words).expect("it has the magic");
        assert_eq!(request.to_words(), words);
        assert_eq!(request.sequence, whole(7 * 3, 7 * 4));
        assert_eq!(request.handle, whole(7 * 8, 7 * 9));
        assert_eq!(request.position, whole(7 * 12, 7 * 13));
        let span = |offset, len| Span { offset, len };
        assert_eq!(request.buffer, span(7 * 14, 7 * 15));
        assert_eq!(request.second_path, span(7 * 16, 7 * 17));
        assert_eq!(request.operation, words[slot::OPERATION as usize / 4]);
        let mut bad = words;
        bad[0] ^= 1;
        assert_eq!(RequestSlot::from_words(&bad), None);
        let words = [1, 2, 3, 4, 5, 6, 7, 0];
        assert_eq!(FileIdentity::from_words(&words).to_words(), words);
        // The words behind those of a status or space are reserved.
        let words = core::array::from_fn(|n| if n < 21 { 3 * n as u32 } else { 0 });
        assert_eq!(FileStatus::from_words(&words).to_words(), words);
        let words = core::array::from_fn(|n| if n < 13 { 5 * n as u32 } else { 0 });
        assert_eq!(Space::from_words(&words).to_words(), words);
    }

    #[test]
    fn times_come_back() {
        let times = Times {
            accessed: SetTime::At {
                s: 5 << 32 | 7,
                ns: 999_999_999,
            },
            modified: SetTime::Now,
        };
        assert_eq!(
            RequestSlot::default().with_times(times).times(),
            Some(times)
        );
        let kept = RequestSlot::default().with_times(Times::default());
        assert_eq!(kept.times(), Some(Times::default()));
        let bad = RequestSlot {
            position: whole(1_000_000_000, 0),
            ..kept
        };
        assert_eq!(bad.times(), None);
    }

    #[test]
    fn a_sequence_is_never_followed_by_one_of_before() {
        assert_eq!(following(0), 1);
        let last = u64::from(u32::MAX);
        assert_eq!(following(last - 1), last);
        assert_eq!(following(last), last + 2);
        for sequence in [1, last, last + 2, whole(u32::MAX, 7), u64::MAX - 1] {
            let next = following(sequence);
            assert!(next > sequence && next as u32 != 0, "{next:#x}");
        }
    }

    #[test]
    fn a_value_comes_with_the_reply_if_it_has_room() {
        for value in [0, 4096, VALUE - 1] {
            let reply = with_value(value.into());
            assert_eq!(reply & REFUSED, 0);
            assert_eq!(value_of(reply), Some(value));
        }
        assert_eq!(with_value(VALUE.into()), DONE);
        assert_eq!(with_value(u64::MAX), DONE);
        for reply in [DONE, 0, 2, REFUSED | 0xb, REFUSED | VALUE | 0x7, u32::MAX] {
            assert_eq!(value_of(reply), None, "{reply:#x}");
        }
    }

    #[test]
    fn operations_have_the_numbers_of_their_table() {
        for (number, operation) in (1..).zip(Operation::ALL) {
            assert_eq!(operation as u32, number);
            assert_eq!(Operation::from_word(number), Some(operation));
        }
        assert_eq!(Operation::from_word(0), None);
        assert_eq!(Operation::from_word(23), None);
    }
}
