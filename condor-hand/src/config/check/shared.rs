//! Rules that joints and axes share.

use nalgebra::Vector3;

use super::place::{Examiner, POSITIVE, Root, join, owner};
use crate::Requirement;
use crate::config::{ControlProcessor, Input, Limits, Mistake, Output, ProcessorKind};
use crate::math::{abs, sqrt};

/// How far an entry of an orthonormal matrix may be off: people write ten digits.
pub(super) const ORTHONORMAL: f64 = 1e-9;

/// The processor that a joint or an axis names, of the kind that serves it.
pub(super) fn processor<'a, const F: usize, const J: usize>(
    examiner: &mut Examiner<'a, F, J>,
    root: Root,
    number: u8,
    needed: ProcessorKind,
) -> Result<&'a ControlProcessor, Mistake> {
    let hand = examiner.hand;
    match hand.processor(number) {
        Some(processor) if processor.kind == needed => Ok(processor),
        Some(processor) => {
            examiner.wrong(root, "processor");
            Err(Mistake::WrongKind {
                owner: owner(hand, root),
                number,
                kind: processor.kind,
                needed,
            })
        }
        None => {
            examiner.wrong(root, "processor");
            let owner = owner(hand, root);
            Err(Mistake::NoProcessor { owner, number })
        }
    }
}

pub(super) fn limits<const F: usize, const J: usize>(
    examiner: &mut Examiner<'_, F, J>,
    root: Root,
    limits: &Limits,
) -> Result<(), Mistake> {
    examiner.below(root, "limits", ("low", limits.low), ("high", limits.high))?;
    let rows = [
        ("velocity", limits.velocity, POSITIVE),
        ("acceleration", limits.acceleration, POSITIVE),
    ];
    examiner.numbers(root, "limits", rows)
}

pub(super) fn unit<const F: usize, const J: usize>(
    examiner: &mut Examiner<'_, F, J>,
    root: Root,
    field: &str,
    axis: [f64; 3],
) -> Result<(), Mistake> {
    let axis = Vector3::from(axis);
    let length = sqrt(axis.dot(&axis));
    if abs(length - 1.0) <= ORTHONORMAL {
        return Ok(());
    }
    let place = examiner.wrong(root, field);
    Err(Mistake::NotUnit { place, length })
}

/// Each converter must have counts for the values between two.
pub(super) fn converters<const F: usize, const J: usize>(
    examiner: &mut Examiner<'_, F, J>,
    root: Root,
    table: &str,
    (adc, seen): (&Input, [f64; 2]),
    dac: Option<(&Output, [f64; 2])>,
) -> Result<(), Mistake> {
    let seen = seen.map(|value| (value, adc.exact_counts(value)));
    converter(
        examiner,
        root,
        &join(table, "adc"),
        (adc.bits, adc.gain, adc.full_scale()),
        seen,
    )?;
    let Some((dac, made)) = dac else {
        return Ok(());
    };
    let made = made.map(|value| (value, dac.gain * value + dac.offset));
    converter(
        examiner,
        root,
        &join(table, "dac"),
        (dac.bits, dac.gain, dac.full_scale()),
        made,
    )
}

fn converter<const F: usize, const J: usize>(
    examiner: &mut Examiner<'_, F, J>,
    root: Root,
    table: &str,
    (bits, gain, full_scale): (u8, f64, u32),
    values: [(f64, f64); 2],
) -> Result<(), Mistake> {
    let rows = [
        ("bits", f64::from(bits), Requirement::AtLeast(1.0)),
        ("bits", f64::from(bits), Requirement::AtMost(32.0)),
    ];
    examiner.numbers(root, table, rows)?;
    if gain == 0.0 {
        let place = examiner.wrong(root, &join(table, "gain"));
        return Err(Mistake::ZeroGain { place });
    }
    for (value, counts) in values {
        // Half a count is what rounding may add.
        if !(counts >= -0.5 && counts <= f64::from(full_scale) + 0.5) {
            let place = examiner.wrong(root, table);
            return Err(Mistake::BeyondConverter {
                place,
                value,
                counts,
                full_scale,
            });
        }
    }
    Ok(())
}
