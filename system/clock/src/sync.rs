//! The atomics of the page, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` they are loom's, and a thread can end before any access to them, as if its
//! program had been killed there; otherwise they are `core`'s.

#[cfg(not(condor_loom))]
pub use core::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

#[cfg(condor_loom)]
pub use mortal::{AtomicU32, AtomicU64, Killed, Ordering, fence, kill_before, step};

/// Atomics of threads that can be killed.
#[cfg(condor_loom)]
mod mortal {
    use core::cell::Cell;
    use loom::sync::atomic;

    pub use loom::sync::atomic::Ordering;

    /// The payload with which a thread unwinds that [`kill_before`] has killed in a test.
    #[derive(Debug)]
    pub struct Killed;

    loom::thread_local! {
        /// How many accesses the thread still makes; 0 if it lives on.
        static LEFT: Cell<u32> = Cell::new(0);
    }

    /// Kills the calling thread at a later access, as if its program had been killed: before its access number
    /// `access`, where the next one is number 1. With 0 the thread is not killed.
    pub fn kill_before(access: u32) {
        LEFT.with(|left| left.set(access));
    }

    /// Counts an access of the calling thread to an atomic. Kills the thread if this is the access
    /// that was chosen by [`kill_before`].
    pub fn step() {
        let left = LEFT.with(|left| left.replace(left.get().saturating_sub(1)));
        if left == 1 {
            std::panic::resume_unwind(Box::new(Killed));
        }
    }

    /// Executes a fence of the order `order`. It counts as an access, before which the calling
    /// thread can be killed.
    pub fn fence(order: Ordering) {
        step();
        atomic::fence(order);
    }

    macro_rules! mortal {
        ($name:ident, $value:ty) => {
            /// An atomic at whose accesses a thread can be killed. Threads that cannot be killed
            /// use its field instead.
            #[derive(Debug)]
            pub struct $name(pub atomic::$name);

            impl $name {
                pub(crate) fn new(value: $value) -> Self {
                    Self(atomic::$name::new(value))
                }

                pub(crate) fn load(&self, order: Ordering) -> $value {
                    step();
                    self.0.load(order)
                }

                pub(crate) fn store(&self, value: $value, order: Ordering) {
                    step();
                    self.0.store(value, order);
                }
            }
        };
    }

    mortal!(AtomicU32, u32);
    mortal!(AtomicU64, u64);

    impl AtomicU32 {
        pub(crate) fn swap(&self, value: u32, order: Ordering) -> u32 {
            step();
            self.0.swap(value, order)
        }

        pub(crate) fn fetch_add(&self, value: u32, order: Ordering) -> u32 {
            step();
            self.0.fetch_add(value, order)
        }

        pub(crate) fn fetch_or(&self, value: u32, order: Ordering) -> u32 {
            step();
            self.0.fetch_or(value, order)
        }

        pub(crate) fn fetch_and(&self, value: u32, order: Ordering) -> u32 {
            step();
            self.0.fetch_and(value, order)
        }

        pub(crate) fn compare_exchange(
            &self,
            seen: u32,
            value: u32,
            success: Ordering,
            failure: Ordering,
        ) -> Result<u32, u32> {
            step();
            self.0.compare_exchange(seen, value, success, failure)
        }
    }
}
