//! Atomics of [`crate::sync`] with a point before and one behind each access.

use portable_atomic::Ordering;

use super::hook::Access;

macro_rules! interrupted {
    ($name:ident: $value:ty) => {
        pub(crate) struct $name(portable_atomic::$name);

        impl $name {
            pub(crate) const fn new(value: $value) -> Self {
                Self(portable_atomic::$name::new(value))
            }

            pub(crate) fn swap(&self, value: $value, order: Ordering) -> $value {
                let _access = Access::begin();
                self.0.swap(value, order)
            }
        }
    };
}

interrupted!(AtomicBool: bool);
interrupted!(AtomicU8: u8);

impl AtomicU8 {
    pub(crate) fn load(&self, order: Ordering) -> u8 {
        let _access = Access::begin();
        self.0.load(order)
    }
}
