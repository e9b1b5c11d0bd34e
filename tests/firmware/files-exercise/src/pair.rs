//! The two ends, and what one does while the other waits.

use core::cell::Cell;
use core::mem::ManuallyDrop;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_fs::{Area, wire};
use condor_mbox::{
    Allocator, Call, CriticalSection, Instant, MemoryWindow as _, Messenger as _, Region, Waiting,
};
use condor_tty::{Terminal, TerminalVectors};

use crate::bell::{Bell, Mail, Turn};
use crate::host::Host;
use crate::memory::{HAND, HOST, Memory, Window};
use crate::trouble::Trouble;
use crate::viewer::Viewer;

/// Files that can be open.
pub(crate) const FILES: usize = 3;
const PATH_BYTES: u32 = 32;
/// Bytes of a file's own buffer.
pub(crate) const BUFFER_BYTES: u32 = 64;
/// Bytes of a terminal's ring.
pub(crate) const RING: u32 = 64;
/// Characters that can be typed ahead.
pub(crate) const AHEAD: usize = 16;

/// Vectors that are not the default, for a second terminal.
pub(crate) const OTHERS: TerminalVectors = TerminalVectors {
    output: condor_mbox::Vector(20),
    input: condor_mbox::Vector(21),
    room: condor_mbox::Vector(22),
};

pub(crate) type Tty = Terminal<Window, CriticalSection, AHEAD>;
pub(crate) type Layout = Area<FILES>;

/// Everything that the checks need.
pub(crate) struct Pair<'p> {
    pub(crate) hand: &'p Mail<'p>,
    pub(crate) host: &'p Mail<'p>,
    /// Whether the host takes its turns.
    pub(crate) attentive: &'p Cell<bool>,
    /// Its file service.
    pub(crate) files: &'p Host<'static>,
    pub(crate) viewer: &'p Viewer,
    pub(crate) own: Region<Window>,
    pub(crate) area: Layout,
    pub(crate) terminal: &'p Tty,
    /// The terminal with the vectors [`OTHERS`].
    pub(crate) second: &'p Tty,
    /// The number of interrupts that were typed at the terminal.
    pub(crate) interrupts: &'p AtomicU32,
    /// The number of messages about output that have come to the host.
    pub(crate) told: &'p AtomicU32,
}

/// Makes the two ends in `memory`, and does `work` with them and with what is left of the processor's memory.
pub(crate) fn with_pair(
    memory: &'static Memory,
    now: fn() -> Instant,
    work: impl FnOnce(&Pair<'_>, &mut Allocator) -> Result<(), Trouble>,
) -> Result<(), Trouble> {
    let [_, windows] = memory.windows();
    let own = Region::users(windows.data)?;
    let mut allocator = Allocator::new(own.size());
    let area = Layout::new(&mut allocator, PATH_BYTES, BUFFER_BYTES)?;
    let table = area.handler();
    let terminal = Tty::new(own, &mut allocator, RING, CriticalSection)?;
    let second = Tty::new(own, &mut allocator, RING, CriticalSection)?.with_vectors(OTHERS);
    let (interrupts, told) = (AtomicU32::new(0), AtomicU32::new(0));
    let receive = |call: &Call<'_>| terminal.receive_and(call, || count(&interrupts));
    let receive_second = |call: &Call<'_>| second.receive(call);
    let files = Host::new(own);
    let serve = |call: &Call<'_>| files.serve(call);
    let ring = |_: &Call<'_>| {
        count(&told);
        0
    };

    let (hosts_turn, hands_turn) = (Turn::new(None), Turn::new(None));
    let bell = |other| Bell { other, now };
    // Neither is dropped: each is borrowed by what the other one does in its waits.
    let mut host = Mail::new(HOST, memory.windows(), bell(&hands_turn), CriticalSection)?;
    host.set_waiting(Waiting::Sleep);
    host.set_vector(wire::FILES, &serve, "files")?;
    host.set_vector(TerminalVectors::DEFAULT.output, &ring, "terminal output")?;
    host.set_vector(OTHERS.output, &ring, "other output")?;
    host.join()?;
    let host = ManuallyDrop::new(host);
    let mut hand = Mail::new(HAND, memory.windows(), bell(&hosts_turn), CriticalSection)?;
    hand.set_waiting(Waiting::Sleep);
    hand.set_vector(wire::OPEN_FILES, &table, "open files")?;
    for (vectors, receive) in [
        (
            TerminalVectors::DEFAULT,
            &receive as condor_mbox::Handler<'_>,
        ),
        (OTHERS, &receive_second),
    ] {
        hand.set_vector(vectors.input, receive, "terminal input")?;
        hand.set_vector(vectors.room, receive, "terminal room")?;
    }
    hand.join()?;
    let hand = ManuallyDrop::new(hand);
    let (viewer, attentive) = (Viewer::new(), Cell::new(true));
    let host_program = || {
        if attentive.get() {
            viewer.turn(&host);
        }
    };
    let hand_program = || {
        // Its own memory is there.
        let _ = hand.serve(Duration::ZERO);
    };
    hosts_turn.set(Some(&host_program));
    hands_turn.set(Some(&hand_program));
    let pair = Pair {
        hand: &hand,
        host: &host,
        attentive: &attentive,
        files: &files,
        viewer: &viewer,
        own,
        area,
        terminal: &terminal,
        second: &second,
        interrupts: &interrupts,
        told: &told,
    };
    work(&pair, &mut allocator)
}

/// Counts up. The handlers of one vector do not interrupt each other here, so no atomic addition is needed.
fn count(counter: &AtomicU32) {
    counter.store(counter.load(Relaxed).wrapping_add(1), Relaxed);
}
