//! What all programs of the hand begin and end with.

use core::fmt::Write;
use core::time::Duration;

use condor_fs::{Area, FileSystem, OpenOptions};
use condor_hand::config::{Channel, ImageError, Wire};
use condor_mbox::{Call, Clock, MemoryWindow, Messenger, Places, Region, Windows};
use condor_mos::{LoopId, Loops, Overrun, Rate};
use condor_rt::directory::{Directory, Kind};
use condor_rt::loops::LoopReports;
use condor_rt::{Error, Machine, MailboxOf, ServoLoop, Text, numbers};
use condor_tty::{Terminal, Vectors};

use crate::boards::{Panel, Wires};
use crate::failure::Failure;
use crate::{IMAGE, UtahMit, boards};

/// Characters that can be typed ahead.
const TYPED: usize = 128;
/// Bytes of a terminal's ring.
const SHOWN_BYTES: u32 = 8192;
/// The longest path that is read, and the buffer for what is in the file, in bytes.
const PATH_BYTES: u32 = 64;
const BUFFER_BYTES: u32 = 4096;
/// Bytes of a compiled configuration, at most.
const IMAGE_BYTES: usize = 16 * 1024;
/// How long the file service may take, with restarts of it.
pub(crate) const FILES_TIMEOUT: Duration = Duration::from_secs(30);
/// How long a program waits for its boards.
const BOARDS_TIMEOUT: Duration = Duration::from_secs(10);
/// How long the background serves before it looks around.
const NAP: Duration = Duration::from_millis(20);
/// How often it shows the counts of the loops.
const REPORT_NS: u64 = 50_000_000;

pub(crate) type Console<M> = Terminal<<M as Machine>::Window, <M as Machine>::Exclusion, TYPED>;

/// What a program has before it has a mailbox; it can have `FILES` files open.
pub(crate) struct Ground<M: Machine, const FILES: usize> {
    /// The users' region of its own `data`.
    pub(crate) own: Region<M::Window>,
    pub(crate) places: Places,
    pub(crate) directory: Directory<M::Window>,
    pub(crate) terminal: Console<M>,
    pub(crate) area: Area<FILES>,
}

impl<M: Machine, const FILES: usize> Ground<M, FILES> {
    pub(crate) fn new(machine: &M) -> Result<Self, Error> {
        let own = users(machine, machine.number().0)?;
        let mut places = Places::new(own.size());
        let mut directory = Directory::new(own.clone(), &mut places)?;
        let terminal = Terminal::new(own.clone(), &mut places, SHOWN_BYTES, machine.exclusion())?;
        directory.enter("console", Kind::Terminal, terminal.offset(), SHOWN_BYTES)?;
        let area = Area::new(&mut places, PATH_BYTES, BUFFER_BYTES)?;
        Ok(Self {
            own,
            places,
            directory,
            terminal,
            area,
        })
    }
}

/// The users' region of a processor's `data`.
pub(crate) fn users<M: Machine>(machine: &M, number: u8) -> Result<Region<M::Window>, Error> {
    let mut windows = machine.windows().into_iter();
    let Some(Windows { data, .. }) = windows.nth(number.into()) else {
        return Err(Failure::NoProcessor { processor: number }.into());
    };
    Ok(Region::users(data)?)
}

/// A mailbox that has not joined, with the vectors that every program has.
pub(crate) fn mailbox<'v, M: Machine>(
    machine: &M,
    typed: &'v (dyn Fn(&Call<'_>) -> u32 + Sync),
    open_files: &'v (dyn Fn(&Call<'_>) -> u32 + Sync),
) -> Result<MailboxOf<'v, M>, Error> {
    let mut mailbox = machine.mailbox()?;
    mailbox.set_vector(Vectors::DEFAULT.input, typed, "terminal input")?;
    mailbox.set_vector(Vectors::DEFAULT.room, typed, "terminal room")?;
    mailbox.set_vector(condor_fs::wire::OPEN_FILES, open_files, "open files")?;
    Ok(mailbox)
}

/// The configuration, from the file service, as far as the boards of the rack can serve it.
pub(crate) fn configuration<M: Machine, const FILES: usize>(
    mailbox: &MailboxOf<'_, M>,
    own: &Region<M::Window>,
    area: Area<FILES>,
) -> Result<UtahMit, Error> {
    let failed = |error| Failure::File { name: IMAGE, error };
    let files = FileSystem::connect(mailbox, numbers::FILES, own.clone(), area, FILES_TIMEOUT)
        .map_err(failed)?;
    let mut image = [0; IMAGE_BYTES];
    let mut file = files
        .open(IMAGE, OpenOptions::new().read())
        .map_err(failed)?;
    let mut len = 0;
    while let Some(rest) = image.get_mut(len..).filter(|rest| !rest.is_empty()) {
        match file.read(rest).map_err(failed)? {
            0 => break,
            read => len += read,
        }
    }
    file.close().map_err(failed)?;
    let broken = |error: ImageError| Failure::Image {
        name: IMAGE,
        error: Text::of(&error),
    };
    let hand = UtahMit::from_image(image.get(..len).unwrap_or(&[])).map_err(broken)?;
    boards::check(&hand).map_err(Failure::from)?;
    Ok(hand)
}

/// The channels of this processor, on boards that may still be about to be plugged in.
pub(crate) fn wires<'s, M: Machine>(
    machine: &M,
    mailbox: &MailboxOf<'_, M>,
    panel: &'s Panel<M::Bus>,
    hand: &UtahMit,
    number: u8,
) -> Result<Wires<'s, M::Bus>, Error> {
    let clock = machine.doorbell();
    let deadline = clock.now().after(BOARDS_TIMEOUT);
    loop {
        match Wires::new(panel, hand, number, |channel| at_rest(hand, channel)) {
            Ok(wires) => return Ok(wires),
            Err(error) if machine.is_stopping() || clock.now() >= deadline => {
                return Err(Failure::from(error).into());
            }
            Err(_) => {
                mailbox.serve(NAP)?;
            }
        }
    }
}

/// The counts of an output while nothing is controlled: of the least tension, and of no force.
fn at_rest(hand: &UtahMit, channel: Channel) -> u32 {
    let wire = hand.wire(channel);
    let newtons = match wire {
        Some(Wire::Flexor { finger, joint }) => {
            hand.joint(finger, joint).map(|joint| joint.flexor.min_n)
        }
        Some(Wire::Extensor { finger, joint }) => {
            hand.joint(finger, joint).map(|joint| joint.extensor.min_n)
        }
        _ => None,
    };
    let output = wire.and_then(|wire| hand.output(wire));
    output.map_or(0, |output| output.counts(newtons.unwrap_or(0.0)))
}

/// Runs a loop, with a background.
pub(crate) fn with_loop<M: Machine>(
    machine: &M,
    rate: Rate,
    mut body: impl FnMut() + Send,
    background: impl FnOnce(&dyn Loops<Instant = u64>) -> Result<(), Error>,
) -> Result<(), Error> {
    let servo = ServoLoop {
        rate,
        overrun: Overrun::Skip,
        body: &mut |_| body(),
    };
    machine.with_loops(&mut [servo], background)?
}

/// The background: serves messages, shows the counts of the loop, and calls `look` each time, until
/// the program is to end.
pub(crate) fn attend<M: Machine>(
    machine: &M,
    mailbox: &MailboxOf<'_, M>,
    loops: &dyn Loops<Instant = u64>,
    reports: &mut LoopReports<M::Window, 1>,
    mut look: impl FnMut() -> Result<(), Error>,
) -> Result<(), Error> {
    let clock = machine.doorbell();
    let mut shown = clock.now();
    reports.publish(0, &loops.statistics(LoopId(0))?)?;
    while !machine.is_stopping() {
        mailbox.serve(NAP)?;
        let now = clock.now();
        if now.ns_since(shown) >= REPORT_NS {
            shown = now;
            reports.publish(0, &loops.statistics(LoopId(0))?)?;
            look()?;
        }
    }
    Ok(())
}

/// Says a line on the terminal of this processor; what finds no room there is counted by it.
pub(crate) fn say<M: Machine>(
    terminal: &Console<M>,
    mailbox: &MailboxOf<'_, M>,
    line: core::fmt::Arguments<'_>,
) {
    let _ = writeln!(terminal.console(mailbox), "{line}");
}

/// What came of a program, said on its terminal if it failed.
pub(crate) fn told<M: Machine>(
    terminal: &Console<M>,
    mailbox: &MailboxOf<'_, M>,
    outcome: Result<(), Error>,
) -> Result<(), Error> {
    if let Err(failure) = &outcome {
        say::<M>(terminal, mailbox, format_args!("ended: {failure}"));
    }
    outcome
}
