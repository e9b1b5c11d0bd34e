//! [`Recorder`]: what a servo loop is given goes into a ring of bytes in the window.

use core::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::{MemoryWindow, Region};
use zerocopy::IntoBytes;

use super::{Fnv, Inputs, ServoOutputs, TickEnd, TickInputs, channel};
use crate::JOINTS;
use crate::grasp::Joints;
use crate::message::FingerRequest;

/// The state of a ring of [`BYTES`](Self::BYTES), between the loop, which fills it, and the
/// background, which empties it.
///
/// The two counts wrap; where in the ring they are is their remainder.
#[derive(Debug, Default)]
pub(crate) struct Ring {
    /// Bytes of whole ticks that were put in.
    put: AtomicU32,
    /// Bytes that were taken out.
    taken: AtomicU32,
    /// Whole ticks that were put in.
    ticks: AtomicU32,
    state: AtomicU32,
}

/// The state of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(crate) enum TapeState {
    Running = 0,
    /// All ticks that were asked for are in the ring.
    Complete = 1,
    /// There was no room for a tick, or the background no longer takes ticks out.
    Lost = 2,
}

impl Ring {
    /// More than half a second of any hand's ticks.
    pub(crate) const BYTES: u32 = 128 * 1024;

    pub(crate) fn state(&self) -> TapeState {
        // Acquire: pairs with `set_state`, so that the last tick is seen.
        match self.state.load(Ordering::Acquire) {
            0 => TapeState::Running,
            1 => TapeState::Complete,
            _ => TapeState::Lost,
        }
    }

    pub(crate) fn set_state(&self, state: TapeState) {
        // Release: after all that was put in.
        self.state.store(state as u32, Ordering::Release);
    }

    /// The whole ticks that were put in.
    pub(crate) fn ticks(&self) -> u32 {
        // Relaxed: a number to tell.
        self.ticks.load(Ordering::Relaxed)
    }

    /// The count of the bytes that were taken out, and how many there are.
    pub(crate) fn filled(&self) -> (u32, u32) {
        // Relaxed: only the background changes it. Acquire: pairs with `Recorder::end`.
        let taken = self.taken.load(Ordering::Relaxed);
        let put = self.put.load(Ordering::Acquire);
        (taken, put.wrapping_sub(taken))
    }

    /// Tells the loop that this many bytes have been taken out.
    pub(crate) fn take(&self, bytes: u32) {
        // Relaxed: only the background changes it. Release: after they were read.
        let taken = self.taken.load(Ordering::Relaxed);
        self.taken
            .store(taken.wrapping_add(bytes), Ordering::Release);
    }
}

/// The end of a [`Ring`] in the servo loop.
pub(crate) struct Recorder<'r, W> {
    region: Region<W>,
    /// The place where the ring begins.
    offset: u32,
    ring: &'r Ring,
    /// Bytes that were put in, those of this tick included.
    put: u32,
    has_room: bool,
    /// Ticks that are still to be recorded.
    left: u32,
    hash: Fnv,
    acceleration: [u64; 3],
}

impl<'r, W: MemoryWindow> Recorder<'r, W> {
    /// Records so many ticks; the ring is at `offset`.
    pub(crate) fn new(region: Region<W>, offset: u32, ring: &'r Ring, ticks: u32) -> Self {
        Self {
            region,
            offset,
            ring,
            put: 0,
            has_room: true,
            left: ticks,
            hash: Fnv::new(),
            acceleration: [0; 3],
        }
    }

    /// Records what the controllers are given in a tick, except requests that came by message.
    pub(crate) fn begin(&mut self, inputs: &Inputs, given: &TickInputs, needs_others: bool) {
        if !self.is_running() {
            return;
        }
        self.record(channel::TICK, given.period_s.as_bytes(), inputs.as_bytes());
        let acceleration = given.acceleration.map(f64::to_bits);
        if acceleration != self.acceleration {
            self.acceleration = acceleration;
            self.record(channel::PALM, acceleration.as_bytes(), &[]);
        }
        if let Some((number, order)) = &given.grasp.order {
            self.record(channel::ORDER, number.as_bytes(), order.as_bytes());
        }
        let is_heard = needs_others || given.grasp.order.is_some();
        if let Some(others) = given.grasp.others.as_ref().filter(|_| is_heard) {
            self.record(channel::OTHERS, Joints::new(others, 0, 0).as_bytes(), &[]);
        }
    }

    /// Records a request to a finger of the hand.
    pub(crate) fn request(&mut self, finger: usize, request: &FingerRequest<JOINTS>) {
        if !self.is_running() {
            return;
        }
        let mut words = [0; FingerRequest::<JOINTS>::WORDS];
        // There is room for the longest one.
        let len = request.put(&mut words).unwrap_or(0);
        let words = words.get(..len).unwrap_or(&[]);
        let head = [finger as u32, words.len() as u32];
        self.record(channel::ASKED, head.as_bytes(), words.as_bytes());
    }

    /// Ends the tick with the output.
    pub(crate) fn end(&mut self, output: &ServoOutputs) {
        if !self.is_running() {
            return;
        }
        self.hash.add(output.as_bytes());
        let done = TickEnd {
            counts: output.counts,
            hash: self.hash.value(),
        };
        self.record(channel::DONE, done.as_bytes(), &[]);
        if !self.has_room {
            self.left = 0;
            self.ring.set_state(TapeState::Lost);
            return;
        }
        // Relaxed: only the loop changes it. Release: after all bytes of the tick.
        let ticks = self.ring.ticks.load(Ordering::Relaxed);
        self.ring
            .ticks
            .store(ticks.wrapping_add(1), Ordering::Relaxed);
        self.ring.put.store(self.put, Ordering::Release);
        self.left -= 1;
        if self.left == 0 {
            self.ring.set_state(TapeState::Complete);
        }
    }

    fn is_running(&self) -> bool {
        self.left > 0 && self.ring.state() == TapeState::Running
    }

    /// Puts a message in: a word with its channel and, above 16 bits, its length in words; then its
    /// words.
    fn record(&mut self, channel: u16, first: &[u8], second: &[u8]) {
        let words = (first.len() + second.len()) / 4;
        let head = u32::from(channel) | (words as u32) << 16;
        for part in [head.as_bytes(), first, second] {
            self.put(part);
        }
    }

    /// Puts whole words in, if there is room for them.
    fn put(&mut self, bytes: &[u8]) {
        // Acquire: pairs with `Ring::take`.
        let taken = self.ring.taken.load(Ordering::Acquire);
        let len = bytes.len() as u32;
        let filled = self.put.wrapping_sub(taken);
        self.has_room &= filled.saturating_add(len) <= Ring::BYTES;
        if !self.has_room {
            return;
        }
        let at = self.put % Ring::BYTES;
        let (before, after) = bytes
            .split_at_checked((Ring::BYTES - at) as usize)
            .unwrap_or((bytes, &[]));
        let written = self.region.write(self.offset.wrapping_add(at), before);
        let wrapped = self.region.write(self.offset, after);
        // Memory of the processor's own, laid out before.
        self.has_room = written.is_ok() && wrapped.is_ok();
        self.put = self.put.wrapping_add(len);
    }
}
