//! [`memory`]: the RAM of the machine, as far as others see it.

use condor_mbox::{Region, StaticWindow};
use qemu_virt_host::map;

use crate::machine::RAM;

/// Returns the first `bytes` bytes of the machine's RAM, which it shares with the host. The offsets in a
/// [`Map`](qemu_virt_host::Map) are offsets in this region.
///
/// `bytes` must not exceed the offset `programs.offset` of the map, where the memory for programs begins. If there may
/// be no valid map yet, `bytes` must not exceed the end of the [`Control`](qemu_virt_host::Control) pages, which follow
/// the page of the map. Do not access the memory before the map: it belongs to the monitor.
#[must_use]
pub fn memory(bytes: u32) -> Region<StaticWindow<'static>> {
    // SAFETY: the machine has RAM there, as much as the map says; everything in it that processors
    // share is accessed by words through such windows, by the host's processes, too. What lies before
    // the map, and the ranges of programs, nobody accesses through it: no offset leads there.
    Region::whole(unsafe { StaticWindow::from_raw(RAM as *mut u32, bytes) })
}

/// Bytes that are enough to find the map and the pages of harts.
pub(crate) const LEAST_BYTES: u32 = map::AT + map::PAGE * (1 + map::HARTS);
