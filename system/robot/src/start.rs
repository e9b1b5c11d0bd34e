//! The start of all programs of the robot: the configuration, and the boards.

use core::time::Duration;

use condor_fs::OpenOptions;
use condor_hand::ImageError;
use condor_hand::config::{Channel, Mistake};
use condor_mbox::Clock;
use condor_mos::Rate;
use condor_rt::{Background, Machine, ProgramError, Setup, ShortText};
use condor_tty::TerminalSettings;

use crate::boards::{self, Boards};
use crate::failure::Failure;
use crate::file;
use crate::{IMAGE, RobotDescription};

/// Bytes of a compiled configuration, at most.
pub(crate) const IMAGE_BYTES: usize = 16 * 1024;
/// The time for which a program waits for its boards.
const BOARDS_TIMEOUT: Duration = Duration::from_secs(10);
/// The time for which the background serves before it looks around.
const NAP: Duration = Duration::from_millis(20);

/// The first incarnation of a program: reads the configuration, and makes what follows from it alone.
pub(crate) fn configured<'h, M: Machine, R>(
    machine: &M,
    place: &'h mut Option<RobotDescription>,
    make: impl FnOnce(&Background<'_, M>, &'h RobotDescription) -> Result<R, ProgramError>,
) -> Result<R, ProgramError> {
    // A result that is returned through all functions of a background is on the stack many times.
    let mut result = None;
    Setup::new(machine)?
        // Input at the terminal is for the next incarnation.
        .console_with(&TerminalSettings::OUTPUT)?
        .files()?
        .background(|background| {
            let hand = place.insert(configuration(background)?);
            result = Some(make(background, hand)?);
            Ok(())
        })?;
    result.ok_or(ProgramError::Missing {
        what: "configuration",
    })
}

/// The description, from the file service.
pub(crate) fn configuration<M: Machine>(
    background: &Background<'_, M>,
) -> Result<RobotDescription, ProgramError> {
    let failed = |error| Failure::File { name: IMAGE, error };
    let files = background.files()?;
    let mut image = [0; IMAGE_BYTES];
    let len = file::read(&files, IMAGE, OpenOptions::new().read(), &mut image).map_err(failed)?;
    let broken = |error: ImageError<Mistake>| Failure::Image {
        name: IMAGE,
        error: ShortText::of(&error),
    };
    let hand = RobotDescription::from_image(image.get(..len).unwrap_or(&[])).map_err(broken)?;
    Ok(hand)
}

/// The channels of this processor, on boards that may still be about to be plugged in.
pub(crate) fn wires<'s, M: Machine, B: Boards>(
    background: &Background<'_, M>,
    panel: &'s B::Panel<M::Bus, M::Controller>,
    hand: &RobotDescription,
) -> Result<B::Wires<'s, M::Bus>, ProgramError> {
    B::check(hand).map_err(Failure::from)?;
    let (number, clock) = (
        background.machine().number().0,
        background.machine().doorbell(),
    );
    let deadline = clock.now().after(BOARDS_TIMEOUT);
    loop {
        match B::open(panel, hand, number, |channel| at_rest(hand, channel)) {
            Ok(wires) => return Ok(wires),
            Err(error) if background.is_stopping() || clock.now() >= deadline => {
                return Err(Failure::from(error).into());
            }
            Err(_) => background.serve(NAP)?,
        }
    }
}

/// The counts of an output while nothing is controlled: of an actuator at rest, and of no force.
fn at_rest(hand: &RobotDescription, channel: Channel) -> u32 {
    let wire = hand.wire(channel);
    let output = wire.and_then(|wire| Some((hand.output(wire)?, boards::at_rest(hand, wire))));
    output.map_or(0, |(output, effort)| output.counts(effort))
}

/// A rate of the configuration, which are above 0.
pub(crate) fn rate(hz: u32) -> Rate {
    Rate::new(hz, 1).unwrap_or(Rate::hz(1))
}

/// The background: serves messages and calls `look`, in turn, until the program is to end.
pub(crate) fn attend<M: Machine>(
    background: &Background<'_, M>,
    mut look: impl FnMut() -> Result<(), ProgramError>,
) -> Result<(), ProgramError> {
    while !background.is_stopping() {
        background.serve(NAP)?;
        look()?;
    }
    Ok(())
}
