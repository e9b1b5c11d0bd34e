//! [`Formers`]: the last request of each client, for messages that say what the next one changes.

use condor_mbox::Processor;

use crate::wire::{RequestSlot, again};

/// The last request of each processor, by its number. It may be lost: a client then sends its slot.
#[derive(Default)]
pub(super) struct Formers(Vec<Option<Former>>);

/// A request that was answered with success.
#[derive(Clone)]
pub(super) struct Former {
    slot: u32,
    request: RequestSlot,
    /// The value of the answer.
    value: u32,
}

impl Former {
    /// Nothing if `request`, which was answered with `value`, is none that can be asked for again.
    pub(super) fn new(slot: u32, request: RequestSlot, value: Option<u32>) -> Option<Self> {
        let value = value.filter(|_| again::is_possible(&request))?;
        Some(Self {
            slot,
            request,
            value,
        })
    }

    /// The request that a message with these bits beside the offset of `slot` means.
    pub(super) fn next(&self, slot: u32, bits: u32) -> Option<RequestSlot> {
        if self.slot == slot {
            again::next(&self.request, self.value, bits)
        } else {
            None
        }
    }
}

impl Formers {
    /// That of `processor`.
    pub(super) fn of(&mut self, processor: Processor) -> &mut Option<Former> {
        let index = processor.index();
        if index >= self.0.len() {
            self.0.resize(index + 1, None);
        }
        &mut self.0[index]
    }
}
