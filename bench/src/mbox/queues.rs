//! Lock-free queues of one process, placed in the mapping: one queue a direction, both polled.

#![allow(
    clippy::unnecessary_wraps,
    reason = "other contestants can fail to open"
)]

use std::hint::spin_loop;

use crossbeam_queue::ArrayQueue;

use super::arena;
use super::contestant::{Client, Contestant, Server, Setup};
use crate::Result;

/// Elements that a queue can hold: as many as a ring of condor-mbox has slots.
const CAPACITY: usize = 8;

/// Opens two ring buffers of rtrb.
pub(super) fn open_rtrb<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(pair(setup, || rtrb::RingBuffer::<u32>::new(CAPACITY)))
}

/// Opens two single-producer queues of heapless.
pub(super) fn open_heapless<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    // One element of the array stays empty.
    type Queue = heapless::spsc::Queue<u32, { CAPACITY + 1 }>;
    Ok(pair(setup, || Box::leak(Box::new(Queue::new())).split()))
}

/// Opens two array queues of crossbeam.
pub(super) fn open_crossbeam<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
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

/// Both ends of the queue for requests and of the queue for answers.
struct Pair<I: 'static, O: 'static> {
    requests: &'static mut (I, O),
    answers: &'static mut (I, O),
}

fn pair<'m, I: Push + 'static, O: Pop + 'static>(
    setup: &Setup<'m>,
    mut queue: impl FnMut() -> (I, O),
) -> Box<dyn Contestant + 'm> {
    // SAFETY: contestants are built by a single thread, nothing else is in this place, the
    // handles are leaked at once so that they free nothing, and are used by the contestant alone,
    // which the mapping outlives.
    let queues = unsafe { arena::within(setup.place, || (queue(), queue())) };
    // The handles themselves are private memory: they remember what they saw of the queue.
    let (requests, answers) = Box::leak(Box::new(queues));
    Box::new(Pair { requests, answers })
}

impl<I: Push, O: Pop> Contestant for Pair<I, O> {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        let Self { requests, answers } = *self;
        Ok(Box::new(End {
            push: &mut requests.0,
            pop: &mut answers.1,
        }))
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        let Self { requests, answers } = *self;
        Ok(Box::new(End {
            push: &mut answers.0,
            pop: &mut requests.1,
        }))
    }
}

/// What one process has of the two queues.
struct End<I: 'static, O: 'static> {
    push: &'static mut I,
    pop: &'static mut O,
}

impl<I: Push, O: Pop> End<I, O> {
    #[inline]
    fn send(&mut self, value: u32) {
        while !self.push.push(value) {
            spin_loop();
        }
    }

    #[inline]
    fn receive(&mut self) -> u32 {
        loop {
            if let Some(value) = self.pop.pop() {
                return value;
            }
            spin_loop();
        }
    }
}

impl<I: Push, O: Pop> Client for End<I, O> {
    #[inline]
    fn call(&mut self, value: u32) -> Result<u32> {
        self.send(value);
        Ok(self.receive())
    }
}

impl<I: Push, O: Pop> Server for End<I, O> {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            let value = self.receive();
            self.send(value);
        }
        Ok(())
    }
}
