//! A round: a fresh file, one client, one server, and every way in short turns.

use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::{Duration, Instant};

use condor_fs::{Area, Buffer, FileSystem, OpenOptions, wire};
use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, Call, MemoryWindow as _, Messenger, Region, SingleContext, Waiting};
use embedded_io::SeekFrom;

use super::serving::{self, CLIENT, ECHO, Mail, N, NAME, SERVER, Shared, TIMEOUT, Turn};
use super::{Operation, SIZES, WAYS, cells};
use crate::Result;
use crate::mbox::{Mapping, spinning};
use crate::process::{self, CorePair, Orders};
use crate::race::Race;

/// A round that takes longer has gone wrong.
const ROUND_LIMIT: Duration = Duration::from_secs(100);

/// Calls of a turn that are not timed, for caches that others have had meanwhile.
const WARM_UP: usize = 2;

/// The largest transfer.
const MOST: usize = SIZES[SIZES.len() - 1].0;

/// Cache lines of the mapping for raw exchanges.
const LINES: usize = 4;

/// Users' bytes of a window: two buffers of the largest transfer, and what else a client needs.
const WINDOW: u32 = 2 * MOST as u32 + 64 * 1024;

/// A call of the client: the operation, with so many bytes from the beginning of the file.
type Way<'c> = Box<dyn FnMut(Operation, usize) -> Result<()> + 'c>;

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
        lines: Mapping::new(LINES)?,
    };
    // SAFETY: one thread only, by this function's contract.
    let figures = unsafe {
        process::part(
            cores,
            ROUND_LIMIT,
            |orders| serving::serve(&shared, &directory, orders),
            |orders| compete(&shared, &file, orders, number),
        )
    }?;
    std::fs::remove_dir_all(&directory)?;
    Ok(figures)
}

/// Returns the content of the file, from its beginning on.
fn pattern() -> Vec<u8> {
    (0..MOST as u32)
        .map(|at| (at.wrapping_mul(0x9e37_79b1) >> 24) as u8)
        .collect()
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
fn compete(shared: &Shared, file: &File, orders: &Orders, seed: u64) -> Result<Vec<f64>> {
    let mut allocator = Allocator::new(WINDOW);
    let area = Area::<1>::new(&mut allocator, 64, MOST as u32)?;
    let handler = area.handler();
    let (mailbox, own) = join(&shared.system, &handler)?;
    let buffer = Buffer::new(&own, &mut allocator, MOST as u32)?;

    Turn::Mailbox.begin(orders, 0)?;
    let files = FileSystem::connect(&mailbox, SERVER, own.clone(), area, TIMEOUT)?;
    let mut lending = Lending {
        file: files.open(NAME, OpenOptions::new().read().write())?,
        buffer: Some(buffer),
    };
    for (size, _) in SIZES {
        lending.check(file, size)?;
    }
    serving::end(&mailbox)?;

    let native = || -> Way<'_> {
        let mut data = pattern();
        Box::new(move |operation, len| {
            let data = &mut data[..len];
            let moved = match operation {
                Operation::Read => file.read_at(data, 0)?,
                Operation::Write => file.write_at(data, 0)?,
            };
            all(moved, len)
        })
    };
    let (mut value, (mut exchange, _)) = (0_u32, spinning(shared.words()));
    let raw = move |_, _| {
        value = value.wrapping_add(1).max(1);
        exchange(value).map(drop)
    };
    let round_trip = |_, len| {
        let reply = mailbox.send_with_reply(SERVER, ECHO, len as u32, TIMEOUT)?;
        all(reply as usize, len)
    };
    let ours = |operation, len| lending.call(operation, len);
    let ways: [(Option<Turn>, Way<'_>); WAYS.len()] = [
        (None, native()),
        (None, native()),
        (Some(Turn::Raw), Box::new(raw)),
        (Some(Turn::Mailbox), Box::new(round_trip)),
        (Some(Turn::Mailbox), Box::new(ours)),
    ];
    let ways = ways.map(RefCell::new);
    let (mailbox, mut race) = (&mailbox, Race::new());
    for (operation, size, head) in cells() {
        for (name, way) in WAYS.into_iter().zip(&ways) {
            race.enter_timed(&head, name, move |calls| {
                let (turn, call) = &mut *way.borrow_mut();
                if let Some(turn) = turn {
                    turn.begin(orders, u32::try_from(calls + WARM_UP)?)?;
                }
                for _ in 0..WARM_UP {
                    call(operation, size)?;
                }
                let began = Instant::now();
                for _ in 0..calls {
                    call(operation, size)?;
                }
                let ns = began.elapsed().as_nanos() as f64;
                if *turn == Some(Turn::Mailbox) {
                    serving::end(mailbox)?;
                }
                Ok(ns)
            });
        }
    }
    let figures = race.once(seed)?;
    Turn::Quit.begin(orders, 0)?;
    Ok(figures)
}

/// Checks that a call moved all bytes.
fn all(moved: usize, len: usize) -> Result<()> {
    if moved == len {
        Ok(())
    } else {
        Err(format!("{moved} bytes of {len} were moved").into())
    }
}

/// The calls of condor-fs that do not copy.
struct Lending<'f, 's, S: Messenger> {
    file: condor_fs::File<'f, 's, S, LinuxWindow, 1>,
    buffer: Option<Buffer<LinuxWindow>>,
}

impl<S: Messenger> Lending<'_, '_, S> {
    fn memory(&self) -> Result<&Region<LinuxWindow>> {
        Ok(self
            .buffer
            .as_ref()
            .ok_or("the buffer is in doubt")?
            .memory())
    }

    fn call(&mut self, operation: Operation, len: usize) -> Result<()> {
        let buffer = self.buffer.take().ok_or("the buffer is in doubt")?;
        let file = &mut self.file;
        file.seek(SeekFrom::Start(0))?;
        let lent = match operation {
            Operation::Read => file.read_buffer(buffer, len as u32),
            Operation::Write => file.write_buffer(buffer, len as u32),
        };
        let (moved, buffer) = lent.map_err(|kept| kept.error)?;
        self.buffer = Some(buffer);
        all(moved, len)
    }

    /// Checks that reads and writes arrive; leaves the file, and the bytes of the buffer, as the file was.
    fn check(&mut self, file: &File, size: usize) -> Result<()> {
        let pattern = &pattern()[..size];
        let other: Vec<u8> = pattern.iter().map(|byte| !byte).collect();
        let mut found = vec![0; size];
        for written in [&other[..], pattern] {
            self.memory()?.write(0, written)?;
            self.call(Operation::Write, size)?;
            file.read_exact_at(&mut found, 0)?;
            if found != written {
                return Err("a write did not arrive".into());
            }
            self.memory()?.write(0, &vec![0; size])?;
            self.call(Operation::Read, size)?;
            self.memory()?.read(0, &mut found)?;
            if found != written {
                return Err("a read did not arrive".into());
            }
        }
        Ok(())
    }
}
