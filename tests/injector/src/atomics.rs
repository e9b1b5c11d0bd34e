//! Atomics with a point before and one behind each access.

use std::sync::atomic::Ordering;

use crate::points::Access;

macro_rules! atomic {
    ($name:ident: $value:ty) => {
        #[doc = concat!("The standard library's `", stringify!($name), "`, with points around each access.")]
        #[derive(Debug)]
        pub struct $name(std::sync::atomic::$name);

        impl $name {
            /// Creates an atomic of this value.
            #[must_use]
            pub const fn new(value: $value) -> Self {
                Self(std::sync::atomic::$name::new(value))
            }

            /// Loads the value.
            pub fn load(&self, order: Ordering) -> $value {
                let _access = Access::begin();
                self.0.load(order)
            }

            /// Stores a value.
            pub fn store(&self, value: $value, order: Ordering) {
                let _access = Access::begin();
                self.0.store(value, order);
            }

            /// Stores a value, and returns the one before.
            pub fn swap(&self, value: $value, order: Ordering) -> $value {
                let _access = Access::begin();
                self.0.swap(value, order)
            }
        }
    };
}

atomic!(AtomicBool: bool);
atomic!(AtomicU8: u8);
atomic!(AtomicU32: u32);
