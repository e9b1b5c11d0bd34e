//! [`ProcessBus`]: the bus of a process, if it has one.

use condor_dev::linux::LinuxBus;
use condor_dev::{Bus, MmioError};

use crate::silent::Silent;

/// The bus of a [`Process`](super::Process); clones are the same one.
#[derive(Clone, Debug)]
pub enum ProcessBus {
    /// A file that all processes map.
    Mapped(LinuxBus),
    /// None.
    Silent(Silent),
}

macro_rules! by_whichever_there_is {
    ($($method:ident($($value:ident: $kind:ty)?) -> $result:ty;)*) => {
        $(
            #[inline]
            fn $method(&self, address: usize $(, $value: $kind)?) -> Result<$result, MmioError> {
                match self {
                    Self::Mapped(bus) => bus.$method(address $(, $value)?),
                    Self::Silent(bus) => bus.$method(address $(, $value)?),
                }
            }
        )*
    };
}

impl Bus for ProcessBus {
    type Error = MmioError;

    by_whichever_there_is! {
        read8() -> u8;
        read16() -> u16;
        read32() -> u32;
        write8(value: u8) -> ();
        write16(value: u16) -> ();
        write32(value: u32) -> ();
    }
}
