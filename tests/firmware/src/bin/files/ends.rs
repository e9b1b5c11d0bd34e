//! [`Ends`]: two processors in one program, which take turns.

use core::cell::Cell;
use core::time::Duration;

use condor_fs::{Area, wire};
use condor_mbox::{
    Allocator, Call, Clock, CriticalSection, Doorbell, Instant, MemoryWindow as _, Messenger as _,
    Processor, Region, StaticMemory, Waiting, Windows, layout,
};
use condor_tty::TerminalVectors;
use critical_section::Mutex;
use static_cell::StaticCell;

use crate::{HAND, HOST, Mail, PROCESSORS, Told, Tty, Window, host};

/// Files that can be open.
pub(crate) const FILES: usize = 3;
/// Bytes of a file's own buffer.
const BUFFER_BYTES: u32 = 64;
/// Bytes of a terminal's ring.
pub(crate) const RING: u32 = 64;

const MAIL_WORDS: usize = layout::mail_bytes(PROCESSORS as u32) as usize / 4;

/// Returns the windows of the two processors.
fn windows() -> [Windows<Window>; PROCESSORS] {
    static MAIL: [StaticMemory<MAIL_WORDS>; PROCESSORS] =
        [const { StaticMemory::new() }; PROCESSORS];
    static HOST_DATA: StaticMemory<{ layout::BELL_BYTES as usize / 4 + 16 }> = StaticMemory::new();
    static HAND_DATA: StaticMemory<512> = StaticMemory::new();
    let [host, hand] = &MAIL;
    [
        Windows {
            mail: host.window(),
            data: HOST_DATA.window(),
        },
        Windows {
            mail: hand.window(),
            data: HAND_DATA.window(),
        },
    ]
}

/// The doorbell of one of the two: a processor that waits lets the other one work instead of sleeping, so
/// that no ring is needed.
#[derive(Clone, Copy)]
pub(crate) struct Bell(Processor);

impl Clock for Bell {
    fn now(&self) -> Instant {
        Instant::from_ns(firmware::now_ns())
    }
}

impl Doorbell for Bell {
    type Seen = ();

    fn ring(&self, _: Processor) {}

    fn prepare(&self) {}

    fn wait(&self, (): (), _: Instant, _: Option<Processor>) {
        let Some(ends) = ENDS.get() else { return };
        // Their own memory is there.
        if self.0 == HAND {
            let _ = ends.host.serve(Duration::ZERO);
            host::type_one(&ends.host, &ends.terminal);
        } else {
            let _ = ends.hand.serve(Duration::ZERO);
        }
    }
}

/// A value that is made at start-up, for the doorbells and handlers.
pub(crate) struct Once<T: 'static> {
    place: StaticCell<T>,
    value: Mutex<Cell<Option<&'static T>>>,
}

impl<T> Once<T> {
    pub(crate) const fn new() -> Self {
        Self {
            place: StaticCell::new(),
            value: Mutex::new(Cell::new(None)),
        }
    }

    pub(crate) fn get(&self) -> Option<&'static T> {
        critical_section::with(|token| self.value.borrow(token).get())
    }

    /// Keeps the first value that it gets, and returns it.
    pub(crate) fn fill(&'static self, value: T) -> Option<&'static T> {
        if let Some(value) = self.place.try_init(value) {
            critical_section::with(|token| self.value.borrow(token).set(Some(value)));
        }
        self.get()
    }
}

static ENDS: Once<Ends> = Once::new();

/// The two mailboxes, and the processor's memory.
pub(crate) struct Ends {
    pub(crate) hand: Mail,
    host: Mail,
    /// The users' part of the processor's `data`.
    pub(crate) own: Region<Window>,
    pub(crate) area: Area<FILES>,
    pub(crate) terminal: Tty,
}

/// Returns the ends, both of which have joined; makes them, once in a program.
pub(crate) fn ends() -> Result<Option<&'static Ends>, Told> {
    let [_, Windows { data, .. }] = windows();
    let own = Region::users(data)?;
    let mut allocator = Allocator::new(own.size());
    let area = Area::new(&mut allocator, 32, BUFFER_BYTES)?;
    let terminal = Tty::new(own, &mut allocator, RING, CriticalSection)?;
    let mail = |me| Mail::new(me, windows(), Bell(me), CriticalSection);

    let mut host = mail(HOST)?;
    host.set_waiting(Waiting::Sleep);
    host.set_vector(wire::FILES, &serve, "files")?;
    host.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")?;
    host.join()?;
    let mut hand = mail(HAND)?;
    hand.set_waiting(Waiting::Sleep);
    hand.set_vector(wire::OPEN_FILES, &open_files, "open files")?;
    hand.set_vector(TerminalVectors::DEFAULT.input, &receive, "terminal input")?;
    hand.set_vector(TerminalVectors::DEFAULT.room, &receive, "terminal room")?;
    hand.join()?;
    Ok(ENDS.fill(Ends {
        hand,
        host,
        own,
        area,
        terminal,
    }))
}

fn serve(call: &Call<'_>) -> u32 {
    ENDS.get()
        .map_or(wire::REFUSED, |ends| host::serve(call, &ends.own))
}

fn open_files(call: &Call<'_>) -> u32 {
    ENDS.get()
        .map_or(wire::NONE, |ends| ends.area.handler()(call))
}

fn receive(call: &Call<'_>) -> u32 {
    ENDS.get().map_or(0, |ends| ends.terminal.receive(call))
}
