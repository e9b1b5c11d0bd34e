//! [`Walk`]: the records of a file that may be damaged.
//!
//! No length in a file is believed before the file is known to have so many bytes.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

use mcap::MAGIC;
use mcap::records::op;

/// The bytes of the opcode and the length of a record.
pub(super) const HEAD: u64 = 9;
/// The longest record, and the longest content of a chunk, in bytes: what is read is held in memory.
pub(super) const MOST: u64 = 256 << 20;
/// The bytes of a chunk before its content, if it is not compressed.
pub(super) const OF_CHUNK: u64 = CHUNK_FIXED as u64 + 4 + 8;
/// The bytes of a chunk before its compression.
const CHUNK_FIXED: usize = 28;
/// The first opcode of those that belong to applications.
pub(super) const OF_APPLICATIONS: u8 = 0x80;
/// The bytes that are searched at a time.
const WINDOW: u64 = 1 << 20;

/// Something that is in a file.
pub(super) enum Step {
    /// A record that is as long as its kind says, and not a chunk.
    Record { opcode: u8, body: Vec<u8> },
    /// The records of a chunk, of which each is whole.
    Chunk { content: Vec<u8> },
    /// Bytes that are no record, or a chunk that is not as it was written.
    Damaged { bytes: u64 },
    /// A chunk that is compressed in a way of which nothing is known here.
    Unknown { compression: String },
}

/// The records of a part of a file, one after the other. Behind a place that is damaged it goes on with the next
/// chunk whose checksum is right. A chunk is read, or is part of what is damaged.
pub(super) struct Walk<'f> {
    file: &'f File,
    at: u64,
    end: u64,
    /// Whether a message index comes next, if it is whole: after a chunk and after another index.
    expects_index: bool,
}

/// The reason why a chunk has no content.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum ChunkError {
    /// The record lacks fields of a chunk, or is too long.
    Invalid,
    /// The content of the chunk is not as it was written.
    Damaged,
    /// Nothing is known here of its compression.
    Unknown(String),
}

impl<'f> Walk<'f> {
    /// Walks through the bytes from `at` to `end`, which the file has.
    pub(super) const fn new(file: &'f File, at: u64, end: u64) -> Self {
        Self {
            file,
            at,
            end,
            expects_index: false,
        }
    }

    /// Returns what comes next; `None` at the end.
    pub(super) fn next(&mut self) -> io::Result<Option<Step>> {
        if self.at >= self.end {
            return Ok(None);
        }
        let Some((opcode, body)) = self.record(self.at)? else {
            return self.skip().map(Some);
        };
        let bytes = HEAD + body.len() as u64;
        if opcode == op::MESSAGE && self.is_other(&body) {
            self.at += bytes;
            return Ok(Some(Step::Damaged { bytes }));
        }
        let step = match opcode {
            op::CHUNK => match content(&body) {
                Ok(content) => Step::Chunk { content },
                Err(ChunkError::Invalid) => return self.skip().map(Some),
                Err(ChunkError::Damaged) => Step::Damaged { bytes },
                Err(ChunkError::Unknown(compression)) => Step::Unknown { compression },
            },
            opcode => {
                // The opcode of a chunk may be damaged.
                if has_checksum(&body) && content(&body).is_ok() {
                    self.at += bytes;
                    return Ok(Some(Step::Damaged { bytes }));
                }
                // A length may be damaged: then the record has swallowed what follows it.
                let end = self.at + bytes;
                let unknown = surplus(opcode, &body).map_or(0, <[u8]>::len) as u64;
                if self.sure_chunk(end - unknown, end)?.is_some() {
                    return self.skip().map(Some);
                }
                Step::Record { opcode, body }
            }
        };
        self.expects_index = matches!(opcode, op::CHUNK | op::MESSAGE_INDEX);
        self.at += bytes;
        Ok(Some(step))
    }

    /// Returns true if a message, which is not in a chunk, is another record whose opcode is damaged: the header, with
    /// which a file begins, or a message index.
    fn is_other(&self, body: &[u8]) -> bool {
        let is_index = || surplus(op::MESSAGE_INDEX, body).is_some_and(<[u8]>::is_empty);
        self.at == MAGIC.len() as u64 || self.expects_index && is_index()
    }

    /// Reads the record at a place; `None` if there is none that is whole.
    fn record(&self, at: u64) -> io::Result<Option<(u8, Vec<u8>)>> {
        let left = self.end.saturating_sub(at);
        if left < HEAD {
            return Ok(None);
        }
        let Some((opcode, length)) = head(&part(self.file, at, HEAD)?) else {
            return Ok(None);
        };
        if length > (left - HEAD).min(MOST) {
            return Ok(None);
        }
        let body = part(self.file, at + HEAD, length)?;
        Ok(fits(opcode, &body).then_some((opcode, body)))
    }

    /// Goes to the next chunk whose checksum is right, or to the end.
    fn skip(&mut self) -> io::Result<Step> {
        let begin = self.at;
        self.at = self.sure_chunk(begin + 1, self.end)?.unwrap_or(self.end);
        Ok(Step::Damaged {
            bytes: self.at - begin,
        })
    }

    /// Returns the first place from `at` on and before `end` where a chunk begins whose checksum is right.
    fn sure_chunk(&self, mut at: u64, end: u64) -> io::Result<Option<u64>> {
        while at < end {
            let window = part(self.file, at, (end - at).min(WINDOW))?;
            for place in memchr::memchr_iter(op::CHUNK, &window) {
                let place = at + place as u64;
                if self.is_sure_chunk(place)? {
                    return Ok(Some(place));
                }
            }
            at += window.len() as u64;
        }
        Ok(None)
    }

    /// Returns true if there is a chunk with a checksum, which is right.
    fn is_sure_chunk(&self, at: u64) -> io::Result<bool> {
        let left = self.end.saturating_sub(at);
        let begin = part(self.file, at, left.min(HEAD + CHUNK_FIXED as u64 + 4))?;
        // Few places have a length that can be true: no others are read.
        let can_be = head(&begin).is_some_and(|(_, length)| length <= left - HEAD)
            && begin.get(HEAD as usize..).is_some_and(|body| {
                let compression = body.get(CHUNK_FIXED..).and_then(|it| it.first_chunk());
                // No name of a compression is long.
                has_checksum(body) && compression.is_some_and(|it| u32::from_le_bytes(*it) <= 16)
            });
        if !can_be {
            return Ok(false);
        }
        let found = self.record(at)?;
        Ok(found.is_some_and(|(opcode, body)| opcode == op::CHUNK && content(&body).is_ok()))
    }
}

/// Returns true if a chunk with this body has a checksum, which may be wrong.
fn has_checksum(body: &[u8]) -> bool {
    let checksum = body.get(CHUNK_FIXED - 4..CHUNK_FIXED);
    checksum.is_some_and(|it| it != [0; 4])
}

/// Splits the head of a record; `None` if there is no such opcode.
fn head(bytes: &[u8]) -> Option<(u8, u64)> {
    let (opcode, rest) = bytes.split_first()?;
    let length = u64::from_le_bytes(*rest.first_chunk()?);
    matches!(opcode, op::HEADER..=op::DATA_END | OF_APPLICATIONS..).then_some((*opcode, length))
}

/// Iterates over the records of a chunk: opcodes and bodies. It ends where one is not whole.
pub(super) fn records(mut content: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    core::iter::from_fn(move || {
        let (opcode, length) = head(content)?;
        let rest = content.get(HEAD as usize..)?;
        let (body, rest) = rest.split_at_checked(usize::try_from(length).ok()?)?;
        content = rest;
        Some((opcode, body))
    })
}

/// Reads the content of a chunk, whose records are all whole then.
pub(super) fn content(chunk: &[u8]) -> Result<Vec<u8>, ChunkError> {
    let (fixed, rest) = chunk
        .split_first_chunk::<CHUNK_FIXED>()
        .ok_or(ChunkError::Invalid)?;
    let [.., a, b, c, d] = *fixed;
    let checksum = u32::from_le_bytes([a, b, c, d]);
    let size = fixed.get(16..).and_then(|it| it.first_chunk());
    let size = size.map_or(0, |it| u64::from_le_bytes(*it));
    let parts = || {
        let (compression, rest) = counted(rest, 4)?;
        let (packed, rest) = counted(rest, 8)?;
        (rest.is_empty() && size <= MOST)
            .then_some((core::str::from_utf8(compression).ok()?, packed))
    };
    let (compression, packed) = parts().ok_or(ChunkError::Invalid)?;
    let content = unpacked(compression, packed, size)?;
    let is_right = checksum == 0 || crc32fast::hash(&content) == checksum;
    let of_records = || records(&content).map(|(_, body)| HEAD + body.len() as u64);
    let are_whole = || {
        of_records().sum::<u64>() == content.len() as u64
            && records(&content).all(|(opcode, body)| fits(opcode, body))
    };
    if content.len() as u64 == size && is_right && are_whole() {
        Ok(content)
    } else {
        Err(ChunkError::Damaged)
    }
}

/// Undoes a compression; what is longer than `size` is cut behind the first byte that is too much.
fn unpacked(compression: &str, mut packed: &[u8], size: u64) -> Result<Vec<u8>, ChunkError> {
    let mut content = Vec::new();
    let limit = |content: &Vec<u8>| (size + 1).saturating_sub(content.len() as u64);
    match compression {
        "" => content.extend_from_slice(packed),
        "lz4" => {
            let decoder = lz4_flex::frame::FrameDecoder::new(packed);
            let read = decoder.take(limit(&content)).read_to_end(&mut content);
            read.map_err(|_| ChunkError::Damaged)?;
        }
        "zstd" => {
            while !packed.is_empty() && limit(&content) > 0 {
                let decoder = ruzstd::decoding::StreamingDecoder::new(&mut packed);
                let decoder = decoder.map_err(|_| ChunkError::Damaged)?;
                let read = decoder.take(limit(&content)).read_to_end(&mut content);
                read.map_err(|_| ChunkError::Damaged)?;
            }
        }
        other => return Err(ChunkError::Unknown(other.into())),
    }
    Ok(content)
}

/// Splits bytes with their count, of so many bytes, before them.
fn counted(from: &[u8], of_count: usize) -> Option<(&[u8], &[u8])> {
    let (count, rest) = from.split_at_checked(of_count)?;
    let mut bytes = [0; 8];
    bytes.get_mut(..of_count)?.copy_from_slice(count);
    rest.split_at_checked(usize::try_from(u64::from_le_bytes(bytes)).ok()?)
}

/// A field of a record.
#[derive(Clone, Copy)]
enum Part {
    /// So many bytes.
    Fixed(usize),
    /// Bytes with their count, in 32 bits, before them.
    Text,
    /// Pairs of texts, with the number of all bytes before them.
    Texts,
    /// Bytes with their count, in 64 bits, before them.
    Long,
    /// The content of the record: all bytes that are left.
    Data,
    /// Fields that are not known here: all bytes that are left.
    Rest,
}

/// Returns true if a record has the fields of its kind, with lengths that it has room for: only then the crate
/// `mcap` takes no more memory for them than the record has.
pub(super) fn fits(opcode: u8, body: &[u8]) -> bool {
    surplus(opcode, body).is_some()
}

/// Returns what a record has behind the fields that are known of its kind; `None` if it does not have these fields.
fn surplus(opcode: u8, body: &[u8]) -> Option<&[u8]> {
    use Part::{Data, Fixed, Long, Rest, Text, Texts};
    let parts: &[Part] = match opcode {
        op::HEADER => &[Text, Text, Rest],
        op::FOOTER => &[Fixed(20)],
        op::SCHEMA => &[Fixed(2), Text, Text, Text, Rest],
        op::CHANNEL => &[Fixed(4), Text, Text, Texts, Rest],
        op::MESSAGE => &[Fixed(22), Data],
        op::CHUNK => &[Fixed(CHUNK_FIXED), Text, Long, Rest],
        op::MESSAGE_INDEX => &[Fixed(2), Text, Rest],
        op::CHUNK_INDEX => &[Fixed(32), Text, Fixed(8), Text, Fixed(16), Rest],
        op::ATTACHMENT => &[Fixed(16), Text, Text, Long, Fixed(4), Rest],
        op::ATTACHMENT_INDEX => &[Fixed(40), Text, Text, Rest],
        op::STATISTICS => &[Fixed(42), Text, Rest],
        op::METADATA => &[Text, Texts, Rest],
        op::METADATA_INDEX => &[Fixed(16), Text, Rest],
        op::SUMMARY_OFFSET => &[Fixed(17), Rest],
        op::DATA_END => &[Fixed(4)],
        _ => &[Rest],
    };
    let mut left = body;
    for part in parts {
        left = match part {
            Fixed(bytes) => left.get(*bytes..)?,
            Text => counted(left, 4)?.1,
            Texts => counted(left, 4).filter(|(texts, _)| are_texts(texts))?.1,
            Long => counted(left, 8)?.1,
            Data => &[],
            Rest => return Some(left),
        };
    }
    left.is_empty().then_some(left)
}

fn are_texts(mut bytes: &[u8]) -> bool {
    while !bytes.is_empty() {
        match counted(bytes, 4).and_then(|(_, rest)| counted(rest, 4)) {
            Some((_, rest)) => bytes = rest,
            None => return false,
        }
    }
    true
}

/// Reads a part of a file.
///
/// # Errors
/// [`UnexpectedEof`](io::ErrorKind::UnexpectedEof) if the file does not have it; no more memory is taken than it has.
pub(super) fn part(mut file: &File, offset: u64, length: u64) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < length {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(bytes)
}
