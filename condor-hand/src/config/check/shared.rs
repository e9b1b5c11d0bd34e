//! Rules that joints and axes share.

use nalgebra::Vector3;

use super::place::{Examiner, POSITIVE, Root, join};
use crate::Requirement;
use crate::config::{
    ControlProcessor, InputChannel, Limits, Mistake, OutputChannel, Problem, ProcessorKind,
};
use crate::math::{abs, sqrt};

/// The largest error of an entry of an orthonormal matrix: people write ten digits.
pub(super) const ORTHONORMAL: f64 = 1e-9;

/// The processor that a joint or an axis names, of the kind that serves it.
impl<'a, const F: usize, const J: usize> Examiner<'a, F, J> {
    pub(super) fn processor(
        &mut self,
        root: Root,
        number: u8,
        needed: ProcessorKind,
    ) -> Result<&'a ControlProcessor, Mistake> {
        let problem = match self.hand.processor(number) {
            Some(processor) if processor.kind == needed => return Ok(processor),
            Some(processor) => Problem::WrongKind {
                number,
                kind: processor.kind,
                needed,
            },
            None => Problem::NoProcessor { number },
        };
        Err(self.wrong(root, "processor", problem))
    }

    pub(super) fn limits(&mut self, root: Root, limits: &Limits) -> Result<(), Mistake> {
        let high = ("high", limits.high);
        self.below(root, "limits", ("low", limits.low), high)?;
        let rows = [
            ("velocity", limits.velocity, POSITIVE),
            ("acceleration", limits.acceleration, POSITIVE),
        ];
        self.numbers(root, "limits", rows)
    }

    pub(super) fn unit(&mut self, root: Root, field: &str, axis: [f64; 3]) -> Result<(), Mistake> {
        self.list(root, field, &axis)?;
        let axis = Vector3::from(axis);
        let length = sqrt(axis.dot(&axis));
        if abs(length - 1.0) <= ORTHONORMAL {
            return Ok(());
        }
        Err(self.wrong(root, field, Problem::NotUnit { length }))
    }

    /// Each converter must have counts for the values between two.
    pub(super) fn converters(
        &mut self,
        root: Root,
        table: &str,
        (adc, seen): (&InputChannel, [f64; 2]),
        dac: Option<(&OutputChannel, [f64; 2])>,
    ) -> Result<(), Mistake> {
        let seen = seen.map(|value| (value, adc.exact_counts(value)));
        let numbers = (adc.bits, adc.gain, adc.offset, adc.full_scale());
        self.converter(root, &join(table, "adc"), numbers, seen)?;
        let Some((dac, made)) = dac else {
            return Ok(());
        };
        let made = made.map(|value| (value, dac.gain * value + dac.offset));
        let numbers = (dac.bits, dac.gain, dac.offset, dac.full_scale());
        self.converter(root, &join(table, "dac"), numbers, made)
    }

    fn converter(
        &mut self,
        root: Root,
        table: &str,
        (bits, gain, offset, full_scale): (u8, f64, f64, u32),
        values: [(f64, f64); 2],
    ) -> Result<(), Mistake> {
        let rows = [
            ("bits", f64::from(bits), Requirement::AtLeast(1.0)),
            ("bits", f64::from(bits), Requirement::AtMost(32.0)),
            ("gain", gain, Requirement::Finite),
            ("offset", offset, Requirement::Finite),
        ];
        self.numbers(root, table, rows)?;
        if gain == 0.0 {
            let problem = Problem::Is("is 0: all counts would mean the same");
            return Err(self.wrong(root, &join(table, "gain"), problem));
        }
        for (value, counts) in values {
            // Half a count is what rounding may add.
            if !(counts >= -0.5 && counts <= f64::from(full_scale) + 0.5) {
                let problem = Problem::BeyondConverter {
                    value,
                    counts,
                    full_scale,
                };
                return Err(self.wrong(root, table, problem));
            }
        }
        Ok(())
    }
}
