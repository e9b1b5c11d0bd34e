//! [`memory`]: the RAM of the machine, as far as others see it.

use condor_mbox::{Region, StaticWindow};
use qemu_virt_host::map;

use crate::machine::RAM;

/// The beginning of the RAM that no program and no monitor lies in, which ends where the ranges of the
/// harts begin: a map says where that is. Before there is a map it is the map's page, and the pages of
/// the harts that there may be.
///
/// It begins where the RAM does, so that offsets are those of the map.
#[must_use]
pub fn memory(bytes: u32) -> Region<StaticWindow<'static>> {
    // SAFETY: the machine has RAM there, as much as the map says; everything in it that processors
    // share is accessed by words through such windows, by the host's processes, too. What lies before
    // the map, and the ranges of programs, nobody accesses through it: no offset leads there.
    Region::whole(unsafe { StaticWindow::from_raw(RAM as *mut u32, bytes) })
}

/// Bytes that are enough to find the map and the pages of harts.
pub(crate) const LEAST_BYTES: u32 = map::AT + map::PAGE * (1 + map::HARTS);
