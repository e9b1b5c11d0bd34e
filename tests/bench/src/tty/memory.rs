//! Blocks into memory.

use std::hint::black_box;
use std::io;

use condor_tty::linux::{Piece, Sink};

use super::station::{RING, Station};
use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::measure::quantile;
use crate::shuffle::Shuffle;

/// The ways that are compared.
pub(super) const WAYS: [&str; 4] = [
    "memcpy into a ring of the same size",
    "  the same once more (control)",
    "condor-tty: the processor writes it, and tells the host",
    "  and the host moves it on into memory of its own",
];

/// Times that each is done in a round.
const BLOCKS: usize = 300;

/// Memory of the host's.
struct Memory {
    bytes: Vec<u8>,
    next: usize,
}

impl Memory {
    fn new() -> Self {
        Self {
            bytes: vec![0; RING as usize],
            next: 0,
        }
    }

    fn put(&mut self, block: &[u8]) {
        // The sizes of blocks divide that of the ring, pieces of the host's need not.
        if self.next + block.len() > self.bytes.len() {
            self.next = 0;
        }
        self.bytes[self.next..self.next + block.len()].copy_from_slice(block);
        self.next += block.len();
    }
}

impl Sink for Memory {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        self.put(piece.bytes);
        Ok(piece.bytes.len())
    }
}

/// Plays a round; returns the nanoseconds of a block by each of the ways.
pub(super) fn play(size: usize, seed: u64) -> Result<[f64; 4]> {
    let calibration = Calibration::begin();
    // One each, so that every ring has been left alone for equally long.
    let mut peers = [Memory::new(), Memory::new()];
    let mut station = Station::new(Memory::new())?;
    let mut samples: [Vec<f64>; 4] = [const { Vec::new() }; 4];
    let mut block: Vec<u8> = (0..size).map(|at| at as u8).collect();
    let mut order = Shuffle(seed);
    let mut ways = [0, 1, 2];
    for number in 0..BLOCKS {
        block[0] = number as u8;
        order.shuffle(&mut ways);
        for way in ways {
            let begin = ticks();
            if let Some(peer) = peers.get_mut(way) {
                peer.put(black_box(&block));
                black_box(&mut peer.bytes);
                samples[way].push(ticks().wrapping_sub(begin) as f64);
                continue;
            }
            station.write(black_box(&block))?;
            samples[2].push(ticks().wrapping_sub(begin) as f64);
            let moved = station.serve()?;
            samples[3].push(ticks().wrapping_sub(begin) as f64);
            let sink = &station.sink;
            let last = &sink.bytes[sink.next - size..sink.next];
            if moved != size || last != block {
                return Err(format!("{moved} bytes of {size} arrived").into());
            }
        }
    }
    let ns = calibration.ns_per_tick();
    Ok(samples.each_mut().map(|ticks| quantile(ticks, 0.5) * ns))
}
