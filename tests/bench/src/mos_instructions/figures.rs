//! Conversion of the lines of a firmware to instructions.

use std::collections::BTreeMap;

use super::firmware::ICOUNT_SHIFT;
use crate::Result;

/// The lines that a firmware printed: a name and a whole number each.
#[derive(Debug)]
pub(crate) struct Lines(BTreeMap<String, u32>);

impl Lines {
    /// Parses the lines of a firmware.
    ///
    /// # Errors
    /// Returns an error if a line has another form.
    pub(crate) fn parse(text: &str) -> Result<Self> {
        let line = |line: &str| {
            let (name, value) = line.split_once(' ')?;
            Some((name.to_owned(), value.parse().ok()?))
        };
        let lines = text
            .lines()
            .map(|text| line(text).ok_or_else(|| format!("a firmware printed: {text}")));
        Ok(Self(lines.collect::<std::result::Result<_, _>>()?))
    }

    fn get(&self, name: &str) -> Result<f64> {
        let value = self.0.get(name);
        let value = value.ok_or_else(|| format!("a firmware did not print {name}"))?;
        Ok(f64::from(*value))
    }

    /// Returns the number of instructions that take `ticks` ticks.
    fn instructions(&self, ticks: f64) -> Result<f64> {
        let ns = ticks * 1e9 / self.get("hertz")?;
        Ok(ns / f64::from(1_u32 << ICOUNT_SHIFT))
    }
}

/// The lateness of a handler that begins with the body, from the instant for which the alarm is armed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Alarm {
    /// The mean lateness in ticks, over the instants at which the fastest loop is due alone.
    late_ticks: f64,
}

impl Alarm {
    /// Computes the lateness from the lines of the calibration.
    ///
    /// # Errors
    /// Returns an error if a line is missing.
    pub(crate) fn of(calibration: &Lines) -> Result<Self> {
        Ok(Self {
            late_ticks: calibration.get("alarm_ticks_sum")? / calibration.get("alarm_count")?,
        })
    }
}

/// Compares what the calibration counted with what is known, and says so.
///
/// # Errors
/// Returns an error if a count is off, so that nothing could be said of any firmware.
pub(crate) fn check(calibration: &Lines) -> Result<String> {
    let off = |what: &str, found: f64, known: f64| {
        format!("calibration is off: {what} is {known} instructions and was counted as {found:.3}")
    };
    // A count is off by less than a tick, which is less than a third of an instruction.
    let nops = calibration.get("nops")?;
    let counted = calibration.instructions(calibration.get("nops_ticks")?)?;
    if (counted - nops).abs() >= 0.5 {
        return Err(off("a sequence of nops", counted, nops).into());
    }
    let handler = calibration.get("handler")?;
    let passed = calibration.instructions(calibration.get("handler_ticks")?)?;
    let taken = passed - calibration.get("handler_background_instructions")?;
    let each = taken / calibration.get("handler_interrupts")?;
    if (each - handler).abs() >= 0.05 {
        return Err(off("an interrupt handler", each, handler).into());
    }
    // The interrupt waits for the end of an instruction, and a count is cut to whole ticks.
    let (least, most) = (
        calibration.get("alarm_ticks_least")?,
        calibration.get("alarm_ticks_most")?,
    );
    let spread = calibration.instructions(most - least)?;
    if spread >= 2.0 {
        return Err(format!(
            "calibration is off: an interrupt comes {least} to {most} ticks after its instant"
        )
        .into());
    }
    Ok(format!(
        "{nops} nops counted as {counted:.2}, a handler of {handler} instructions as {each:.3}"
    ))
}

/// The figures of a scheduler, in instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Figures {
    /// The instructions that a release takes from the background, without the body of the loop.
    pub(crate) per_release: f64,
    /// The instructions that a release takes from the background, with the body of the loop.
    pub(crate) with_body: f64,
    /// The instructions from the first of the timer's interrupt to the first of the body, which is left
    /// out, one loop being due.
    pub(crate) to_body: f64,
    /// The number of releases that were measured.
    pub(crate) releases: u32,
}

impl Figures {
    /// Computes the figures from the lines of a firmware with three loops.
    ///
    /// # Errors
    /// Returns an error if a line is missing, or if the loops did not run at their rates.
    pub(crate) fn of(lines: &Lines, alarm: Alarm) -> Result<Self> {
        let passed = lines.instructions(lines.get("ticks")?)?;
        let taken = passed - lines.get("background_instructions")?;
        let releases = lines.get("releases")?;
        let seconds = lines.get("ticks")? / lines.get("hertz")?;
        let due = seconds * lines.get("releases_per_second")?;
        // The background looks when the slowest loop has run, not at the end of a second.
        if (releases - due).abs() >= 0.5 {
            return Err(format!("{releases} releases ran where {due:.2} were due").into());
        }
        let with_body = taken / releases;
        let late = lines.get("late_ticks_sum")? / lines.get("alone")?;
        Ok(Self {
            per_release: with_body - lines.get("body_instructions")?,
            with_body,
            to_body: lines.instructions(late - alarm.late_ticks)?,
            releases: lines.0["releases"],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CALIBRATION: &str = "hertz 25000000\nnops 1001\nnops_ticks 3203\nhandler 15\n\
        handler_interrupts 550\nhandler_ticks 1112320\nhandler_background_instructions 339350\n\
        alarm_count 400\nalarm_ticks_sum 12100\nalarm_ticks_least 29\nalarm_ticks_most 31\n";

    fn check_with(from: &str, to: &str) -> Result<String> {
        assert!(CALIBRATION.contains(from));
        check(&Lines::parse(&CALIBRATION.replace(from, to))?)
    }

    #[test]
    fn calibration_is_believed_when_all_is_as_known() {
        assert!(check_with("hertz", "hertz").is_ok());
    }

    #[test]
    fn calibration_is_refused_when_a_count_is_off_by_one() {
        for (from, to) in [
            ("nops_ticks 3203", "nops_ticks 3206"),
            ("nops_ticks 3203", "nops_ticks 3200"),
            ("handler 15", "handler 16"),
            ("handler_ticks 1112320", "handler_ticks 1112420"),
            ("alarm_ticks_most 31", "alarm_ticks_most 36"),
            ("alarm_ticks_least 29\n", ""),
        ] {
            assert!(check_with(from, to).is_err(), "{to}");
        }
    }

    #[test]
    fn figures_are_instructions() -> Result<()> {
        let alarm = Alarm::of(&Lines::parse(CALIBRATION)?)?;
        // 100 releases that take 40 instructions each, 9 of them in the body.
        let text = "hertz 25000000\nreleases_per_second 78125\nticks 32000\nbackground_instructions 6000\nreleases 100\n\
            body_instructions 9\nalone 10\nlate_ticks_sum 1902\n";
        let figures = Figures::of(&Lines::parse(text)?, alarm)?;
        assert!((figures.with_body - 40.0).abs() < 0.001, "{figures:?}");
        assert!((figures.per_release - 31.0).abs() < 0.001, "{figures:?}");
        // 190.2 - 30.25 ticks of 3.2 to an instruction.
        assert!((figures.to_body - 50.0).abs() < 0.1, "{figures:?}");
        Ok(())
    }

    #[test]
    fn loops_that_miss_a_release_are_refused() -> Result<()> {
        let alarm = Alarm::of(&Lines::parse(CALIBRATION)?)?;
        for (releases, right) in [(549, false), (550, true), (551, false)] {
            let text = format!(
                "hertz 25000000\nreleases_per_second 550\nticks 24999932\n\
                background_instructions 7670429\nreleases {releases}\nbody_instructions 9\n\
                alone 300\nlate_ticks_sum 151200\n"
            );
            assert_eq!(Figures::of(&Lines::parse(&text)?, alarm).is_ok(), right);
        }
        Ok(())
    }

    #[test]
    fn a_line_of_another_form_is_shown() {
        let error = Lines::parse("ticks 1\npanicked at x\n").unwrap_err();
        assert!(error.to_string().contains("panicked at x"));
    }
}
