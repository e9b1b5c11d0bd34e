//! Measures the depth of a hart's stack by painting, and compares it with the sum of what its levels take
//! alone.

use std::time::Duration;

use condor_host::error::AnyError;
use condor_mbox::Call;
use drills::alone::Alone;
use drills::stack::{Depths, NAME, NESTED};

/// An instruction takes 2³ ns.
const SHIFT: u8 = 3;
const PATIENCE: Duration = Duration::from_secs(300);

/// Plays it, and prints what came out: the arguments are the monitor and the image.
///
/// # Errors
/// Returns an error if an argument is missing, if the stack is deeper than its levels, or if the levels did
/// not nest.
pub(crate) fn run(arguments: &[String]) -> Result<(), AnyError> {
    let [monitor, image] = arguments else {
        return Err("usage: drills stack MONITOR IMAGE".into());
    };
    let hart = Alone::new(1, image.as_ref(), &["stack"])?;
    hart.play(monitor.as_ref(), SHIFT, PATIENCE)?;
    let depths = drills::published::<Depths, _>(&hart.region(0)?, NAME)?;
    let depths = depths.ok_or("the hart has published nothing")?;
    print(&depths);
    Ok(check(&depths)?)
}

fn print(depths: &Depths) {
    let line = |what: &str, bytes: u32| println!("{what:<58} {bytes:>7}");
    println!("{:<58} {:>7}", "each alone", "bytes");
    line("background, with interrupts masked", depths.background);
    for (nested, bytes) in depths.mailbox.into_iter().enumerate() {
        let what = match nested {
            0 => "mailbox interrupt, 1 handler".into(),
            _ => format!("the same, {} handlers, nested", nested + 1),
        };
        line(&what, bytes);
    }
    line("loop of 100 Hz", depths.slow);
    line("loop of 400 Hz", depths.fast);
    println!("\n{:<58} {:>7}", "together", "bytes");
    line(
        "background + mailbox interrupt + both loops",
        depths.bound(),
    );
    line("measured", depths.deepest);
    let more = (Call::MAX_DEPTH as usize).saturating_sub(NESTED);
    line(
        &format!(
            "the sum with {} handlers, the most that a mailbox nests",
            Call::MAX_DEPTH
        ),
        most(depths, more),
    );
    line("there is", depths.stack);
    println!(
        "\n{} times the loop of 400 Hz ran above that of 100 Hz, above the innermost handler",
        depths.at_once
    );
}

fn most(depths: &Depths, more: usize) -> u32 {
    let more = u32::try_from(more).unwrap_or(u32::MAX);
    let nested = depths.nested().saturating_mul(more);
    depths.bound().saturating_add(nested)
}

/// Checks that the stack is at most as deep as its levels together, all of which took part.
fn check(depths: &Depths) -> Result<(), String> {
    let (deepest, bound) = (depths.deepest, depths.bound());
    if deepest > bound {
        return Err(format!(
            "the stack was {deepest} bytes deep, its levels are {bound}"
        ));
    }
    let levels = [depths.mailbox_bound(), depths.slow, depths.fast];
    if levels.contains(&0) {
        return Err(format!("a level did not run: {levels:?}"));
    }
    let single = levels.into_iter().max().unwrap_or(0);
    let one = depths.background.saturating_add(single);
    if deepest <= one || depths.at_once == 0 {
        return Err(format!(
            "the levels did not nest: the stack was {deepest} bytes deep, and one level makes it {one}"
        ));
    }
    if depths.skipped > 0 {
        return Err(format!("{} releases were skipped", depths.skipped));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Depths = Depths {
        stack: 524_288,
        background: 1000,
        mailbox: [500, 900, 1300, 1700, 2100, 2500],
        slow: 700,
        fast: 600,
        deepest: 4600,
        at_once: 3,
        skipped: 0,
    };

    #[test]
    fn the_sum_has_each_level_once() {
        assert_eq!(GOOD.bound(), 4800);
        assert_eq!(GOOD.nested(), 400);
        assert_eq!(most(&GOOD, 2), 5600);
    }

    #[test]
    fn a_stack_is_as_deep_as_all_levels_and_deeper_than_one() {
        assert!(check(&GOOD).is_ok());
        for wrong in [
            Depths {
                deepest: 4801,
                ..GOOD
            },
            Depths {
                deepest: 3500,
                ..GOOD
            },
            Depths { at_once: 0, ..GOOD },
            Depths { skipped: 1, ..GOOD },
            Depths { fast: 0, ..GOOD },
        ] {
            assert!(check(&wrong).is_err(), "{wrong:?}");
        }
    }
}
