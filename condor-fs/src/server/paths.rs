//! [`Paths`]: what a request names, copied together with it.

use std::sync::atomic::{Ordering, fence};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Region};

use super::Job;
use super::error::Stop;
use crate::wire::{MAX_PATH, Operation, RequestSlot, Span};

/// The bytes of a request's paths, with their places: what everybody may write is read once.
#[derive(Default)]
pub(super) struct Paths([Option<(Span, Vec<u8>)>; 2]);

impl Paths {
    /// Copies what `operation` needs. What cannot be copied is not here, and an error for who asks
    /// for it.
    pub(super) fn copy(
        region: &Region<&LinuxWindow>,
        request: &RequestSlot,
        operation: Operation,
    ) -> Self {
        let copy = |span: Span| {
            if !(1..=MAX_PATH).contains(&span.len) {
                return None;
            }
            let mut bytes = vec![0; span.len as usize];
            region.read(span.offset, &mut bytes).ok()?;
            Some((span, bytes))
        };
        let paths = match operation {
            Operation::Open
            | Operation::PathStatus
            | Operation::MakeDirectory
            | Operation::RemoveDirectory
            | Operation::Unlink
            | Operation::PathMode
            | Operation::PathTimes => Self([copy(request.path), None]),
            Operation::Rename => Self([copy(request.path), copy(request.second_path)]),
            _ => Self::default(),
        };
        // Later reads of the request see it no older than the paths.
        fence(Ordering::Acquire);
        paths
    }

    pub(super) const fn is_empty(&self) -> bool {
        matches!(self.0, [None, None])
    }
}

impl Job<'_> {
    /// The bytes of a path: of the request's own the copy, of another one those that are there now.
    pub(super) fn bytes_of(&self, span: Span) -> Result<Vec<u8>, Stop> {
        let mut copies = self.paths.0.iter().flatten();
        if let Some((_, bytes)) = copies.find(|(of, _)| *of == span) {
            return Ok(bytes.clone());
        }
        let mut bytes = vec![0; span.len as usize];
        self.region.read(span.offset, &mut bytes)?;
        Ok(bytes)
    }
}
