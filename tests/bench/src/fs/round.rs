//! A round: a fresh file, one client, one server, and every way in short turns.

use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use condor_fs::{Area, Buffer, FileSystem, OpenOptions, wire};
use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, Call, Messenger, Region, SingleContext, Waiting};

use super::chunks::CHUNK;
use super::serving::{self, CLIENT, ECHO, Mail, N, NAME, SERVER, Shared, TIMEOUT, Turn};
use super::ways::{Client, Lending, Operation, Owning, RAW, ROUND_TRIP, WAYS};
use super::{SIZES, cells, chunks, socket};
use crate::Result;
use crate::mbox::{Mapping, spinning};
use crate::process::{Child, CorePair, pin};
use crate::race::Race;

/// A round that takes longer has gone wrong.
const ROUND_LIMIT: Duration = Duration::from_secs(100);

/// Calls of a turn that are not timed, for caches that others have had meanwhile.
const WARM_UP: usize = 2;

/// The largest transfer.
const MOST: usize = SIZES[SIZES.len() - 1].0;

/// Cache lines of the mapping for raw exchanges.
const LINES: usize = 4;

/// Users' bytes of a window: two buffers of the largest transfer, and the blocks.
const WINDOW: u32 = 2 * MOST as u32 + 64 * 1024;

/// Makes the client's end of a way that moves its own memory.
fn owning<'c>(
    transfer: impl FnMut(Operation, &mut [u8]) -> Result<usize> + 'c,
) -> Box<dyn Client + 'c> {
    let data = vec![0; MOST];
    Box::new(Owning { transfer, data })
}

/// Plays a round: nanoseconds of a call, for each way in each of the [`cells`].
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
pub(super) unsafe fn play(cores: CorePair, place: &Path, number: u64) -> Result<Vec<f64>> {
    let directory = place.join(number.to_string());
    std::fs::create_dir(&directory)?;
    let path = directory.join(NAME);
    std::fs::write(&path, pattern())?;
    let file = File::options().read(true).write(true).open(path)?;
    let shared = Shared {
        system: LinuxSystem::family(WINDOW)?,
        block: laid_out()?.1,
        lines: Mapping::new(LINES)?,
    };
    let (order_end, server_orders) = UnixStream::pair()?;
    let (request_end, server_requests) = UnixStream::pair()?;
    // SAFETY: one thread only, by this function's contract.
    let server = unsafe {
        Child::fork("server", ROUND_LIMIT, || {
            pin(cores.second)?;
            serving::serve(&shared, &directory, &server_orders, &server_requests)?;
            Ok(Vec::new())
        })
    }?;
    // SAFETY: as above.
    let client = unsafe {
        Child::fork("client", ROUND_LIMIT, || {
            pin(cores.first)?;
            compete(&shared, &file, &order_end, &request_end, number)
        })
    }?;
    let figures = client.figures()?;
    server.figures()?;
    std::fs::remove_dir_all(&directory)?;
    Ok(figures)
}

/// Returns the content of the file, from its beginning on.
fn pattern() -> Vec<u8> {
    (0..MOST as u32)
        .map(|at| (at.wrapping_mul(0x9e37_79b1) >> 24) as u8)
        .collect()
}

/// Allocates the places of a client, and those of its chunks and of its buffer.
fn laid_out() -> Result<(Area<1>, u32, Allocator)> {
    let mut allocator = Allocator::new(WINDOW);
    let area = Area::<1>::new(&mut allocator, 64, MOST as u32)?;
    let block = allocator.bytes(CHUNK)?;
    Ok((area, block, allocator))
}

/// Joins a client's mailbox, which spins; returns it with the client's own region.
fn join<'v>(
    system: &LinuxSystem<N>,
    handler: &'v (dyn Fn(&Call<'_>) -> u32 + Sync),
) -> Result<(Mail<'v>, Region<LinuxWindow>)> {
    let claim = system.claim(CLIENT)?;
    let own = Region::users(claim.windows()[CLIENT.index()].data.clone())?;
    let mut mailbox = claim.mailbox_with(SingleContext::new())?;
    mailbox.set_waiting(Waiting::Spin);
    mailbox.set_vector(wire::OPEN_FILES, handler, "open files")?;
    mailbox.join()?;
    Ok((mailbox, own))
}

/// Runs the client's process: every way has its turns, in an order that changes.
fn compete(
    shared: &Shared,
    file: &File,
    orders: &UnixStream,
    requests: &UnixStream,
    seed: u64,
) -> Result<Vec<f64>> {
    let (area, block, mut allocator) = laid_out()?;
    let handler = area.handler();
    let (mailbox, own) = join(&shared.system, &handler)?;
    let options = OpenOptions::new().read().write();
    let buffer = Buffer::new(&own, &mut allocator, MOST as u32)?;

    Turn::Mailbox.begin(orders)?;
    let files = FileSystem::connect(&mailbox, SERVER, own.clone(), area, TIMEOUT)?;
    let ours = files.open(NAME, options)?;
    serving::end(&mailbox)?;

    let native = || {
        owning(|operation, data| {
            Ok(match operation {
                Operation::Read => file.read_at(data, 0)?,
                Operation::Write => file.write_at(data, 0)?,
            })
        })
    };
    let (mut value, (mut exchange, _)) = (0_u32, spinning(shared.words()));
    let raw = owning(move |_, data| {
        value = value.wrapping_add(1).max(1);
        exchange(value)?;
        Ok(data.len())
    });
    let round_trip = owning(|_, data| {
        let len = data.len() as u32;
        Ok(mailbox.send_with_reply(SERVER, ECHO, len, TIMEOUT)? as usize)
    });
    let socket = owning(|operation, data| socket::transfer(requests, operation, data));
    let chunked =
        owning(|operation, data| chunks::transfer(&mailbox, &own, block, operation, data));
    let lending = Lending {
        file: ours,
        buffer: Some(buffer),
    };
    let clients: [(Option<Turn>, Box<dyn Client + '_>); WAYS.len()] = [
        (None, native()),
        (None, native()),
        (Some(Turn::Raw), raw),
        (Some(Turn::Mailbox), round_trip),
        (Some(Turn::Mailbox), Box::new(lending)),
        (Some(Turn::Socket), socket),
        (Some(Turn::Mailbox), chunked),
    ];
    let clients = clients.map(RefCell::new);
    let (mailbox, mut race) = (&mailbox, Race::new());
    for (operation, size, head) in cells() {
        for (name, client) in WAYS.into_iter().zip(&clients) {
            let mut is_checked = [RAW, ROUND_TRIP].contains(&name);
            race.enter_timed(&head, name, move |calls| {
                let (turn, client) = &mut *client.borrow_mut();
                if let Some(turn) = turn {
                    turn.begin_of(orders, u32::try_from(calls + WARM_UP)?)?;
                }
                if !is_checked {
                    check(&mut **client, file, size).map_err(|error| format!("{name}: {error}"))?;
                    is_checked = true;
                }
                for _ in 0..WARM_UP {
                    client.call(operation, size)?;
                }
                let began = Instant::now();
                for _ in 0..calls {
                    client.call(operation, size)?;
                }
                let ns = began.elapsed().as_nanos() as f64;
                match turn {
                    None | Some(Turn::Raw | Turn::Quit) => {}
                    Some(Turn::Mailbox) => serving::end(mailbox)?,
                    Some(Turn::Socket) => socket::end(requests)?,
                }
                Ok(ns)
            });
        }
    }
    let figures = race.once(seed)?;
    Turn::Quit.begin(orders)?;
    Ok(figures)
}

/// Checks that reads and writes arrive; leaves the file, and the bytes that the client holds, as the file
/// was.
fn check(client: &mut dyn Client, file: &File, size: usize) -> Result<()> {
    let pattern = &pattern()[..size];
    let other: Vec<u8> = pattern.iter().map(|byte| !byte).collect();
    let mut found = vec![0; size];
    for written in [&other[..], pattern] {
        client.fill(written)?;
        client.call(Operation::Write, size)?;
        file.read_exact_at(&mut found, 0)?;
        if found != written {
            return Err("a write did not arrive".into());
        }
        client.fill(&vec![0; size])?;
        client.call(Operation::Read, size)?;
        client.held(&mut found)?;
        if found != written {
            return Err("a read did not arrive".into());
        }
    }
    Ok(())
}
