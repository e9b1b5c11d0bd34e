//! Lock-free queues of one process, placed in the mapping: one queue a direction, both polled.

#![allow(
    clippy::unnecessary_wraps,
    reason = "other contestants can fail to open"
)]

use std::hint::spin_loop;

use crossbeam_queue::ArrayQueue;

use super::arena;
use super::contestant::{Ends, Setup};
use crate::Result;

/// Elements that a queue can hold: as many as a ring of condor-mbox has slots.
const CAPACITY: usize = 8;

/// Opens two ring buffers of rtrb.
pub(super) fn open_rtrb<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    Ok(pair(setup, || rtrb::RingBuffer::<u32>::new(CAPACITY)))
}

/// Opens two single-producer queues of heapless.
pub(super) fn open_heapless<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    // One element of the array stays empty.
    type Queue = heapless::spsc::Queue<u32, { CAPACITY + 1 }>;
    Ok(pair(setup, || Box::leak(Box::new(Queue::new())).split()))
}

/// Opens two array queues of crossbeam.
pub(super) fn open_crossbeam<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    Ok(pair(setup, || {
        let queue: &'static _ = Box::leak(Box::new(ArrayQueue::<u32>::new(CAPACITY)));
        (queue, queue)
    }))
}

/// The end of a queue that takes elements in.
trait Push {
    /// Whether there was room.
    fn push(&mut self, value: u32) -> bool;
}

/// The end of a queue that gives elements out.
trait Pop {
    /// The oldest element, if there is one.
    fn pop(&mut self) -> Option<u32>;
}

impl Push for rtrb::Producer<u32> {
    #[inline]
    fn push(&mut self, value: u32) -> bool {
        rtrb::Producer::push(self, value).is_ok()
    }
}

impl Pop for rtrb::Consumer<u32> {
    #[inline]
    fn pop(&mut self) -> Option<u32> {
        rtrb::Consumer::pop(self).ok()
    }
}

impl Push for heapless::spsc::Producer<'static, u32> {
    #[inline]
    fn push(&mut self, value: u32) -> bool {
        self.enqueue(value).is_ok()
    }
}

impl Pop for heapless::spsc::Consumer<'static, u32> {
    #[inline]
    fn pop(&mut self) -> Option<u32> {
        self.dequeue()
    }
}

impl Push for &'static ArrayQueue<u32> {
    #[inline]
    fn push(&mut self, value: u32) -> bool {
        ArrayQueue::push(self, value).is_ok()
    }
}

impl Pop for &'static ArrayQueue<u32> {
    #[inline]
    fn pop(&mut self) -> Option<u32> {
        ArrayQueue::pop(self)
    }
}

fn pair<'m, I: Push + 'static, O: Pop + 'static>(
    setup: &Setup<'m>,
    mut queue: impl FnMut() -> (I, O),
) -> Ends<'m> {
    // SAFETY: contestants are built by a single thread, nothing else is in this place, the
    // handles are leaked at once so that they free nothing, and are used by the contestant alone,
    // which the mapping outlives.
    let queues = unsafe { arena::within(setup.place, || (queue(), queue())) };
    // The handles themselves are private memory: they remember what they saw of the queue.
    let ((ask, asked), (answer, answered)) = Box::leak(Box::new(queues));
    let client = move |value| {
        send(ask, value);
        Ok(receive(answered))
    };
    let server = move |count| {
        for _ in 0..count {
            send(answer, receive(asked));
        }
        Ok(())
    };
    Ends::new(|| Ok(client), || Ok(server))
}

#[inline]
fn send(to: &mut impl Push, value: u32) {
    while !to.push(value) {
        spin_loop();
    }
}

#[inline]
fn receive(from: &mut impl Pop) -> u32 {
    loop {
        if let Some(value) = from.pop() {
            return value;
        }
        spin_loop();
    }
}
