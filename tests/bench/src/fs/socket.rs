//! A copy protocol of 9P's shape on a Unix socket: `Tread`, `Rread`, `Twrite`, `Rwrite`.
//!
//! Headers have 9P's sizes, data follow them, and one write and one read of the socket move both.

use std::io::{IoSlice, IoSliceMut, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use super::ways::Operation;
use crate::Result;

/// The most data of a message: what Linux's client of 9P asks for.
const MOST: usize = 128 << 10;

/// `size[4] type[1] tag[2] fid[4] offset[8] count[4]`
const REQUEST: usize = 23;
/// `size[4] type[1] tag[2] count[4]`, also of a reply that has no data.
const REPLY: usize = 11;

const TREAD: u8 = 116;
const TWRITE: u8 = 118;
/// A message in place of a request: the turn has ended.
const END: u8 = 0;

/// Moves all of `data` from or to the beginning of the file.
pub(super) fn transfer(
    mut stream: &UnixStream,
    operation: Operation,
    data: &mut [u8],
) -> Result<usize> {
    let mut offset = 0;
    for part in data.chunks_mut(MOST) {
        let mut reply = [0; REPLY];
        match operation {
            Operation::Read => {
                stream.write_all(&request(TREAD, offset, part.len()))?;
                let count = {
                    let mut pieces = [IoSliceMut::new(&mut reply), IoSliceMut::new(part)];
                    stream.read_vectored(&mut pieces)?
                };
                let got = count.checked_sub(REPLY).ok_or("half a header")?;
                stream.read_exact(&mut part[got..])?;
            }
            Operation::Write => {
                let header = request(TWRITE, offset, part.len());
                let sent = stream.write_vectored(&[IoSlice::new(&header), IoSlice::new(part)])?;
                stream.write_all(&part[sent.saturating_sub(REQUEST)..])?;
                stream.read_exact(&mut reply)?;
            }
        }
        if number(&reply[7..]) as usize != part.len() {
            return Err("the server moved something else".into());
        }
        offset += part.len();
    }
    Ok(offset)
}

/// Ends the server's turn.
pub(super) fn end(mut stream: &UnixStream) -> Result<()> {
    Ok(stream.write_all(&request(END, 0, 0))?)
}

/// Serves `file` until the turn ends.
pub(super) fn serve(mut stream: &UnixStream, file: impl AsFd) -> Result<()> {
    let mut message = vec![0; REPLY.max(REQUEST) + MOST];
    loop {
        let mut have = 0;
        while have < REQUEST {
            match stream.read(&mut message[have..])? {
                0 => return Err("the client has gone".into()),
                count => have += count,
            }
        }
        let kind = message[4];
        let offset = u64::from(number(&message[11..]));
        let count = number(&message[19..]) as usize;
        if count > MOST {
            return Err("a message is too long".into());
        }
        match kind {
            TREAD => {
                let data = &mut message[REPLY..REPLY + count];
                let count = rustix::io::pread(&file, data, offset)?;
                reply(&mut message, kind, count, count);
                stream.write_all(&message[..REPLY + count])?;
            }
            TWRITE => {
                stream.read_exact(&mut message[have..REQUEST + count])?;
                let data = &message[REQUEST..REQUEST + count];
                let count = rustix::io::pwrite(&file, data, offset)?;
                reply(&mut message, kind, count, 0);
                stream.write_all(&message[..REPLY])?;
            }
            END => return Ok(()),
            _ => return Err("a message that nobody sends".into()),
        }
    }
}

fn request(kind: u8, offset: usize, count: usize) -> [u8; REQUEST] {
    let data = if kind == TWRITE { count } else { 0 };
    let mut header = [0; REQUEST];
    header[..4].copy_from_slice(&((REQUEST + data) as u32).to_le_bytes());
    header[4] = kind;
    header[11..19].copy_from_slice(&(offset as u64).to_le_bytes());
    header[19..].copy_from_slice(&(count as u32).to_le_bytes());
    header
}

fn reply(message: &mut [u8], request: u8, count: usize, data: usize) {
    message[..4].copy_from_slice(&((REPLY + data) as u32).to_le_bytes());
    message[4] = request + 1;
    message[7..REPLY].copy_from_slice(&(count as u32).to_le_bytes());
}

/// Returns the number in the first four bytes of `bytes`.
fn number(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}
