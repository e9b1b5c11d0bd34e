//! Lets peers that allocate their queues live in the mapping that two processes share.
//!
//! A queue of rtrb or crossbeam is an allocation. While [`within`] runs, allocations come from
//! a stretch of the mapping; both processes see it at the same address, since the server is
//! forked. Nothing that was allocated there is ever freed. Allocations are counted, for the ticks that
//! must not make any.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use super::mapping::Place;

/// Where the next allocation goes, and where the stretch ends; both 0 outside of [`within`].
///
/// One thread alone runs inside of [`within`], so that `Relaxed` accesses suffice.
static NEXT: AtomicUsize = AtomicUsize::new(0);
static END: AtomicUsize = AtomicUsize::new(0);

/// Allocations so far; nothing is ordered by it, so that `Relaxed` accesses suffice.
static COUNT: AtomicUsize = AtomicUsize::new(0);

/// How often all threads have allocated; a block that grows counts once more.
pub(crate) fn count() -> usize {
    COUNT.load(Ordering::Relaxed)
}

/// The allocator of the program: the system's, except inside of [`within`].
pub(crate) struct Allocator;

// SAFETY: outside of `within` everything is passed to the system's allocator. Inside, a block
// is cut from a stretch of mapped memory that nobody else uses (the contract of `within`), is
// aligned and large enough, and is never handed out twice, since `NEXT` only grows.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        let end = END.load(Ordering::Relaxed);
        if end == 0 {
            // SAFETY: the caller's contract is that of `System`.
            return unsafe { System.alloc(layout) };
        }
        let start = NEXT
            .load(Ordering::Relaxed)
            .next_multiple_of(layout.align());
        match start.checked_add(layout.size()) {
            Some(next) if next <= end => {
                NEXT.store(next, Ordering::Relaxed);
                std::ptr::with_exposed_provenance_mut(start)
            }
            _ => std::ptr::null_mut(),
        }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: blocks of a mapping are never freed (the contract of `within`), so that this
        // one is the system's.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Calls `build` with all its allocations made in `place`.
///
/// # Safety
/// No other thread may run, `place` must be unused otherwise, and nothing that `build`
/// allocates may be freed or used after the mapping is gone.
pub(super) unsafe fn within<T>(place: Place<'_>, build: impl FnOnce() -> T) -> T {
    let bytes = place.bytes();
    NEXT.store(bytes.start.expose_provenance(), Ordering::Relaxed);
    END.store(bytes.end.addr(), Ordering::Relaxed);
    let result = build();
    END.store(0, Ordering::Relaxed);
    result
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    #[test]
    fn a_box_is_an_allocation() {
        let before = super::count();
        black_box(Box::new(black_box(1_u64)));
        assert!(super::count() > before);
    }
}
