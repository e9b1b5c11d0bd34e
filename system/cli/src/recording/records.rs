//! [`Walk`]: the records of a file that may be damaged.
//!
//! No length in a file is believed before the file is known to have so many bytes.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};

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

/// Something that is in a file.
pub(super) enum Step {
    /// A record that is as long as its kind says, and not a chunk.
    Record { opcode: u8, body: Vec<u8> },
    /// The records of a chunk, of which each is whole.
    Chunk { content: Vec<u8> },
    /// A chunk that is not as it was written; or bytes that are no record, and all that follow them.
    Damaged { bytes: u64 },
    /// A chunk that is compressed in a way of which nothing is known here.
    Unknown { compression: String },
}

/// The records of a part of a file, one after the other. It ends behind bytes that are no record: where the next
/// one begins is not known then.
pub(super) struct Walk<'f> {
    file: &'f File,
    at: u64,
    end: u64,
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
        Self { file, at, end }
    }

    /// Returns what comes next; `None` at the end.
    pub(super) fn next(&mut self) -> io::Result<Option<Step>> {
        let left = self.end.saturating_sub(self.at);
        if left == 0 {
            return Ok(None);
        }
        let record = self.record(left)?;
        let bytes = record
            .as_ref()
            .map_or(left, |(_, body)| HEAD + body.len() as u64);
        self.at += bytes;
        Ok(Some(match record {
            Some((op::CHUNK, body)) => match content(&body) {
                Ok(content) => Step::Chunk { content },
                Err(ChunkError::Invalid | ChunkError::Damaged) => Step::Damaged { bytes },
                Err(ChunkError::Unknown(compression)) => Step::Unknown { compression },
            },
            // The opcode of a chunk may be damaged.
            Some((_, body)) if has_checksum(&body) && content(&body).is_ok() => {
                Step::Damaged { bytes }
            }
            Some((opcode, body)) => Step::Record { opcode, body },
            None => Step::Damaged { bytes },
        }))
    }

    /// Reads the next record, if the `left` bytes begin with one that is whole.
    fn record(&self, left: u64) -> io::Result<Option<(u8, Vec<u8>)>> {
        if left < HEAD {
            return Ok(None);
        }
        let Some((opcode, length)) = head(&part(self.file, self.at, HEAD)?) else {
            return Ok(None);
        };
        if length > (left - HEAD).min(MOST) {
            return Ok(None);
        }
        let body = part(self.file, self.at + HEAD, length)?;
        Ok(fits(opcode, &body).then_some((opcode, body)))
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
    /// All bytes that are left: the content of the record, or fields that are not known here.
    Rest,
}

/// Returns true if a record has the fields of its kind, with lengths that it has room for: only then the crate
/// `mcap` takes no more memory for them than the record has.
pub(super) fn fits(opcode: u8, body: &[u8]) -> bool {
    use Part::{Fixed, Long, Rest, Text, Texts};
    let parts: &[Part] = match opcode {
        op::HEADER => &[Text, Text, Rest],
        op::FOOTER => &[Fixed(20)],
        op::SCHEMA => &[Fixed(2), Text, Text, Text, Rest],
        op::CHANNEL => &[Fixed(4), Text, Text, Texts, Rest],
        op::MESSAGE => &[Fixed(22), Rest],
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
    let left = parts.iter().try_fold(body, |left, part| match part {
        Fixed(bytes) => left.get(*bytes..),
        Text => Some(counted(left, 4)?.1),
        Texts => Some(counted(left, 4).filter(|(texts, _)| are_texts(texts))?.1),
        Long => Some(counted(left, 8)?.1),
        Rest => Some(Default::default()),
    });
    left.is_some_and(<[u8]>::is_empty)
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
