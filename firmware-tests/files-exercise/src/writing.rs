//! Output that finds no room.

use core::fmt;
use core::sync::atomic::Ordering::Relaxed;

use checks::Checks;
use condor_mbox::Messenger;
use condor_tty::{ConsoleError, Policy};
use embedded_io::{Write as _, WriteReady as _};

use crate::pair::{PATIENCE, Pair, RING, SHORT};
use crate::trouble::Trouble;

const LONG: &[u8; 100] = b"\
    A finger has three joints, and four tendons that pull them: what one lets go of, the others take up.";
const LATE: ConsoleError = ConsoleError::TimedOut { lost: 0 };

/// Each policy, with a host that looks and with one that does not.
#[inline(never)]
pub(crate) fn writing(checks: &mut Checks<'_>, pair: &Pair<'_>) -> Result<(), Trouble> {
    let (terminal, viewer) = (pair.terminal, pair.viewer);
    let mut console = terminal.console(pair.hand);
    let ring = RING as usize;
    let rest = LONG.len() - ring;
    // The ring is empty, and so is what was lost.
    let lost = |since: u32| terminal.lost().wrapping_sub(since);

    checks.group("a policy that blocks");
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    let (before, told) = (terminal.lost(), pair.told.load(Relaxed));
    checks.same("a writer waits for room", console.write_all(LONG), Ok(()));
    checks.same("and for the host", console.flush(), Ok(()));
    checks.same("all is shown", viewer.look(pair.host).bytes(), &LONG[..]);
    checks.that("the host was told", pair.told.load(Relaxed) != told);
    checks.same("there is room", console.write_ready(), Ok(true));
    pair.attentive.set(false);
    terminal.set_policy(Policy::Block { timeout: SHORT })?;
    let late = ConsoleError::TimedOut { lost: rest };
    checks.same(
        "what the host does not look at is given up",
        console.write_all(LONG),
        Err(late),
    );
    checks.same("a write loses nothing", console.write(b"x"), Err(LATE));
    checks.same("what is there stays there", console.flush(), Err(LATE));
    checks.same("there is no room", console.write_ready(), Ok(false));
    checks.that(
        "formatted text is no error",
        fmt::Write::write_fmt(&mut console, format_args!("{ring}")).is_ok(),
    );
    checks.same("but counted", lost(before), rest as u32 + 2);
    pair.attentive.set(true);
    let shown = viewer.look(pair.host);
    checks.same(
        "what had room is shown",
        Some(shown.bytes()),
        LONG.get(..ring),
    );

    checks.group("a poster");
    let messenger: &dyn Messenger = pair.hand;
    let mut poster = terminal.poster(messenger);
    let before = terminal.lost();
    checks.same(
        "it writes what there is room for",
        poster.post(LONG),
        Ok(ring),
    );
    checks.same(
        "and takes all",
        embedded_io::Write::write(&mut poster, LONG),
        Ok(LONG.len()),
    );
    checks.same(
        "either way",
        embedded_io::Write::write_all(&mut poster, b"end"),
        Ok(()),
    );
    checks.same("it does not wait", poster.flush(), Ok(()));
    checks.that(
        "nor fail",
        fmt::Write::write_fmt(&mut poster, format_args!("{ring}")).is_ok(),
    );
    let formatted = embedded_io::Write::write_fmt(&mut poster, format_args!("!"));
    checks.that("in any way", formatted.is_ok());
    checks.same(
        "it counts",
        lost(before),
        (rest + LONG.len() + 3 + 2 + 1) as u32,
    );
    let shown = viewer.look(pair.host);
    checks.same(
        "what had room is shown",
        Some(shown.bytes()),
        LONG.get(..ring),
    );

    checks.group("a policy that overwrites");
    terminal.set_policy(Policy::DropOld)?;
    checks.same("it is chosen", terminal.policy(), Policy::DropOld);
    let before = terminal.lost();
    checks.same("all is written", console.write_all(LONG), Ok(()));
    checks.same("nothing is lost here", lost(before), 0);
    let shown = viewer.look(pair.host);
    checks.same(
        "the last of it is shown",
        Some(shown.bytes()),
        LONG.get(rest..),
    );
    checks.same(
        "the host counts the rest",
        viewer.skipped.get(),
        rest as u32,
    );
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    Ok(())
}
