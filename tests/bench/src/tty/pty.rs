//! Blocks into a pty, which another process reads.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

use condor_tty::linux::Pty;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::AsFd;
use rustix::io::Errno;

use super::station::Station;
use crate::Result;
use crate::measure::quantile;
use crate::process::{Child, CorePair, pin};
use crate::shuffle::Shuffle;

/// The ways that are compared.
pub(super) const WAYS: [&str; 3] = [
    "write(2)",
    "  the same once more (control)",
    "condor-tty, from the processor's write to the pty",
];

/// Bytes of a turn.
const TURN: usize = 1 << 20;

/// Turns of each in a round.
const TURNS: usize = 7;

/// A round that takes longer has gone wrong.
const ROUND_LIMIT: Duration = Duration::from_secs(60);

/// A pty whose reader is gone for so long will never be read.
const PATIENCE: Duration = Duration::from_secs(10);

/// Plays a round; returns the nanoseconds of a block by each of the ways.
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
pub(super) unsafe fn play(size: usize, seed: u64, cores: CorePair) -> Result<[f64; 3]> {
    let peers = [Pty::open()?, Pty::open()?];
    let mut station = Station::new(Pty::open()?)?;
    let all = [&peers[0], &peers[1], &station.sink];
    let paths = all.map(|pty| pty.path().to_owned());
    // SAFETY: one thread only, by this function's contract. It ends when it is dropped.
    let _reader = unsafe {
        Child::fork("reader", ROUND_LIMIT, || {
            pin(cores.second)?;
            read_all(&paths.each_ref().map(|path| &**path))
        })
    }?;
    let deadline = Instant::now() + PATIENCE;
    for pty in all {
        while !pty.is_watched()? {
            if Instant::now() > deadline {
                return Err("nobody opens the pty".into());
            }
            std::thread::yield_now();
        }
    }

    let block: Vec<u8> = (0..size).map(|at| at as u8).collect();
    let mut samples: [Vec<f64>; 3] = [const { Vec::new() }; 3];
    let mut order = Shuffle(seed);
    let mut ways = [0, 1, 2];
    for _ in 0..TURNS {
        order.shuffle(&mut ways);
        for way in ways {
            let begin = Instant::now();
            for _ in 0..TURN / size {
                match peers.get(way) {
                    Some(pty) => write_block(pty, &block)?,
                    None => send_block(&mut station, &block)?,
                }
            }
            let ns = begin.elapsed().as_nanos() as f64;
            samples[way].push(ns / (TURN / size) as f64);
        }
    }
    Ok(samples.each_mut().map(|ns| quantile(ns, 0.5)))
}

/// Calls write(2) until all is written.
fn write_block(pty: &Pty, mut block: &[u8]) -> Result<()> {
    while !block.is_empty() {
        match rustix::io::write(pty, block) {
            Ok(count) => block = &block[count..],
            Err(Errno::AGAIN) => await_room(pty)?,
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Has the processor write a block, and the host move it until all is in the pty.
fn send_block(station: &mut Station<Pty>, block: &[u8]) -> Result<()> {
    station.write(block)?;
    let mut left = block.len();
    while left > 0 {
        match station.serve()? {
            0 => await_room(&station.sink)?,
            moved => left -= moved,
        }
    }
    Ok(())
}

fn await_room(pty: &Pty) -> Result<()> {
    let timeout = Timespec::try_from(PATIENCE)?;
    match poll(&mut [PollFd::new(pty, PollFlags::OUT)], Some(&timeout)) {
        Ok(0) => Err("nobody reads the pty".into()),
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// Runs the other process: reads whatever comes, until it is killed.
fn read_all(paths: &[&Path; 3]) -> Result<Vec<f64>> {
    let mut files = Vec::new();
    for path in paths {
        files.push(File::options().read(true).write(true).open(path)?);
    }
    let mut bytes = vec![0; 64 << 10];
    loop {
        let ready = {
            let mut polled: Vec<_> = files
                .iter()
                .map(|file| PollFd::from_borrowed_fd(file.as_fd(), PollFlags::IN))
                .collect();
            poll(&mut polled, None)?;
            polled
                .iter()
                .map(|polled| !polled.revents().is_empty())
                .collect::<Vec<_>>()
        };
        for (file, _) in files.iter_mut().zip(ready).filter(|(_, ready)| *ready) {
            if file.read(&mut bytes)? == 0 {
                return Ok(Vec::new());
            }
        }
    }
}
