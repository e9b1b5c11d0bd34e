//! A place in a configuration, and the checks of a value there.

use core::fmt::{self, Write};

use nalgebra::Vector3;

use crate::Requirement;
use crate::config::{
    Allowed, ControlProcessor, Hand, InputChannel, Limits, Mistake, MistakePath, MistakePlace,
    MistakeValue, Name, OutputChannel, ProcessorKind,
};
use crate::math::{abs, is_finite, max, min, sqrt};

pub(super) const POSITIVE: Requirement = Requirement::Above(0.0);
pub(super) const NOT_NEGATIVE: Requirement = Requirement::AtLeast(0.0);

/// The largest number that a hand may have, to either side: products of some such numbers are finite.
const MOST: f64 = 1e15;

/// The largest error of an entry of an orthonormal matrix: people write ten digits.
pub(super) const ORTHONORMAL: f64 = 1e-9;

/// A number: its key in a table, its value, and what it must be.
pub(in crate::config) type Rule = (&'static str, f64, Requirement);

/// Returns the least and the greatest number that `key` can have by these rules. A bound that a number must not reach
/// is moved by `margin`.
pub(in crate::config) fn range(rules: &[Rule], key: &str, margin: f64) -> [f64; 2] {
    let of_key = rules.iter().filter(|(name, ..)| *name == key);
    of_key.fold([-MOST, MOST], |[least, greatest], (.., must)| match *must {
        Requirement::Above(bound) => [max(least, bound + margin), greatest],
        Requirement::AtLeast(bound) => [max(least, bound), greatest],
        Requirement::Below(bound) => [least, min(greatest, bound - margin)],
        Requirement::AtMost(bound) => [least, min(greatest, bound)],
        Requirement::Within(low, high) => [max(least, low), min(greatest, high)],
        Requirement::Finite | Requirement::Equal(_) | Requirement::MultipleOf(_) => {
            [least, greatest]
        }
    })
}

/// The rules of the cutoff of a filter at a rate. A filter that is slower still would never move.
pub(in crate::config) fn cutoff_rules(
    key: &'static str,
    cutoff_hz: f64,
    rate_hz: u32,
) -> [Rule; 3] {
    let rate_hz = f64::from(rate_hz);
    [
        (key, cutoff_hz, POSITIVE),
        (key, cutoff_hz, Requirement::AtLeast(1e-9 * rate_hz)),
        (key, cutoff_hz, Requirement::Below(0.5 * rate_hz)),
    ]
}

/// The way to a table within its owner.
pub(super) type Table = heapless::String<39, u8>;

/// A table of a hand: its owner, such as a joint, and the way from there.
pub(super) struct At {
    way: MistakePath,
    owner: MistakePlace,
    table: Table,
}

/// Formats a text; a part that does not fit is left out.
fn text<const N: usize>(text: fmt::Arguments<'_>) -> heapless::String<N, u8> {
    let mut all = heapless::String::new();
    let _ = all.write_fmt(text);
    all
}

/// A name in a place, or the beginning of a long one: two of them and a field have room there.
fn short(name: &Name) -> &str {
    const BYTES: usize = 40;
    let ends = name
        .char_indices()
        .map(|(at, letter)| at + letter.len_utf8());
    let end = ends.take_while(|&end| end <= BYTES).last();
    name.get(..end.unwrap_or(0)).unwrap_or_default()
}

/// The way to an entry of a list.
pub(super) fn entry(list: &str, index: usize) -> Table {
    text(format_args!("{list}[{index}]"))
}

impl At {
    fn new(way: fmt::Arguments<'_>, owner: fmt::Arguments<'_>) -> Self {
        let table = Table::new();
        let (way, owner) = (text(way), text(owner));
        Self { way, owner, table }
    }

    pub(super) fn hand() -> Self {
        Self::new(format_args!(""), format_args!("the hand"))
    }

    pub(super) fn processor(index: usize, number: u8) -> Self {
        Self::new(
            format_args!("processors[{index}]."),
            format_args!("processor {number}"),
        )
    }

    pub(super) fn axis(index: usize, name: &Name) -> Self {
        Self::new(
            format_args!("table.axes[{index}]."),
            format_args!("axis `{}`", short(name)),
        )
    }

    pub(super) fn finger(index: usize, name: &Name) -> Self {
        Self::new(
            format_args!("fingers[{index}]."),
            format_args!("finger `{}`", short(name)),
        )
    }

    /// A joint of this finger.
    pub(super) fn joint(&self, index: usize, name: &Name) -> Self {
        let (way, finger) = (&self.way, &self.owner);
        Self::new(
            format_args!("{way}joints[{index}]."),
            format_args!("joint `{}` of {finger}", short(name)),
        )
    }

    /// A follower of this finger.
    pub(super) fn follower(&self, index: usize, name: &Name) -> Self {
        let (way, finger) = (&self.way, &self.owner);
        Self::new(
            format_args!("{way}followers[{index}]."),
            format_args!("follower `{}` of {finger}", short(name)),
        )
    }

    /// An actuator of this finger.
    pub(super) fn actuator(&self, index: usize, name: &Name) -> Self {
        let (way, finger) = (&self.way, &self.owner);
        Self::new(
            format_args!("{way}actuators[{index}]."),
            format_args!("actuator `{}` of {finger}", short(name)),
        )
    }

    /// A table in this one.
    pub(super) fn table(&self, name: &str) -> Self {
        Self {
            way: self.way.clone(),
            owner: self.owner.clone(),
            table: text(format_args!("{}{name}.", self.table)),
        }
    }

    /// The way to a value of this table from the top of the file.
    pub(super) fn path(&self, field: &str) -> MistakePath {
        let mut path: MistakePath = text(format_args!("{}{}{field}", self.way, self.table));
        // The mistake of a whole table.
        if path.ends_with('.') {
            path.pop();
        }
        path
    }

    /// The mistake of a value, or of the whole table if `field` is empty.
    pub(super) fn wrong(&self, field: &str, value: MistakeValue, allowed: Allowed) -> Mistake {
        let place: Table = text(format_args!("{}{field}", self.table));
        let place = match place.trim_end_matches('.') {
            "" => self.owner.clone(),
            field => text(format_args!("`{field}` of {}", self.owner)),
        };
        Mistake {
            path: self.path(field),
            place,
            quantity: "",
            value,
            allowed,
        }
    }

    /// The mistake of a value that is not a number, and the rule.
    pub(super) fn words(&self, field: &str, value: &'static str, rule: &'static str) -> Mistake {
        self.wrong(field, MistakeValue::Words(value), Allowed::Words(rule))
    }

    /// The mistake of a number that does not meet a requirement, with the reason or the remedy.
    pub(super) fn off(
        &self,
        field: &str,
        value: f64,
        must: Requirement,
        reason: &'static str,
    ) -> Mistake {
        let allowed = Allowed::Number(must, reason);
        self.wrong(field, MistakeValue::Number(value), allowed)
    }

    /// Refuses a number that is not finite or too large to compute with, and one that is not what it
    /// must be.
    pub(super) fn number(&self, field: &str, value: f64, must: Requirement) -> Result<(), Mistake> {
        let must = if !is_finite(value) {
            Requirement::Finite
        } else if abs(value) <= MOST {
            must
        } else if value > 0.0 {
            Requirement::AtMost(MOST)
        } else {
            Requirement::AtLeast(-MOST)
        };
        if must.holds(value) {
            return Ok(());
        }
        Err(self.off(field, value, must, ""))
    }

    pub(super) fn numbers<const N: usize>(
        &self,
        rows: [(&str, f64, Requirement); N],
    ) -> Result<(), Mistake> {
        rows.into_iter()
            .try_for_each(|(field, value, must)| self.number(field, value, must))
    }

    /// Refuses a list with a number that cannot be computed with, or that is not what it must be.
    pub(super) fn list(&self, field: &str, list: &[f64], must: Requirement) -> Result<(), Mistake> {
        for (index, &value) in list.iter().enumerate() {
            self.number(&entry(field, index), value, must)?;
        }
        Ok(())
    }

    /// Refuses a number that is not below another one of this table, which is its owner's `name`.
    pub(super) fn below(
        &self,
        (field, value): (&str, f64),
        (name, limit): (&'static str, f64),
    ) -> Result<(), Mistake> {
        self.number(field, value, Requirement::Finite)?;
        if value < limit {
            return Ok(());
        }
        let value = MistakeValue::Number(value);
        Err(self.wrong(field, value, Allowed::Below(name, limit)))
    }

    pub(super) fn cutoff(
        &self,
        key: &'static str,
        cutoff_hz: Option<f64>,
        rate_hz: u32,
    ) -> Result<(), Mistake> {
        cutoff_hz.map_or(Ok(()), |cutoff_hz| {
            self.numbers(cutoff_rules(key, cutoff_hz, rate_hz))
        })
    }

    pub(super) fn not_empty(&self, field: &str, is_empty: bool) -> Result<(), Mistake> {
        if is_empty {
            return Err(self.words(field, "empty", "it must have one entry or more"));
        }
        Ok(())
    }

    /// The name must have letters, and not be that of an earlier sibling.
    pub(super) fn name<'n>(
        &self,
        name: &Name,
        mut earlier: impl Iterator<Item = &'n Name>,
    ) -> Result<(), Mistake> {
        if name.trim().is_empty() {
            return Err(self.words("name", "empty", "it must have letters"));
        }
        if earlier.any(|other| other == name) {
            return Err(self.words("name", "taken already", "give each its own"));
        }
        Ok(())
    }

    pub(super) fn limits(&self, limits: &Limits) -> Result<(), Mistake> {
        let at = self.table("limits");
        at.number("high", limits.high, Requirement::Finite)?;
        at.below(("low", limits.low), ("high", limits.high))?;
        at.numbers([
            ("velocity", limits.velocity, POSITIVE),
            ("acceleration", limits.acceleration, POSITIVE),
        ])
    }

    pub(super) fn unit(&self, field: &str, axis: [f64; 3]) -> Result<(), Mistake> {
        self.list(field, &axis, Requirement::Finite)?;
        let axis = Vector3::from(axis);
        let length = sqrt(axis.dot(&axis));
        if abs(length - 1.0) <= ORTHONORMAL {
            return Ok(());
        }
        let quantity = ": its length";
        let wrong = self.off(field, length, Requirement::Equal(1.0), "");
        Err(Mistake { quantity, ..wrong })
    }

    /// The converter of a sensor must have counts for the values between two.
    pub(super) fn input(
        &self,
        key: &str,
        adc: &InputChannel,
        seen: [f64; 2],
    ) -> Result<(), Mistake> {
        let ends = [adc.value(0), adc.value(adc.full_scale())];
        let counts = seen.map(|value| adc.exact_counts(value));
        let numbers = (adc.bits, adc.gain, adc.offset, adc.full_scale());
        self.table(key).converter(numbers, (seen, counts), ends)
    }

    /// The converter of an actuator must have counts for the values between two.
    pub(super) fn output(&self, dac: &OutputChannel, made: [f64; 2]) -> Result<(), Mistake> {
        let ends = [dac.value(0), dac.value(dac.full_scale())];
        let counts = made.map(|value| dac.gain * value + dac.offset);
        let numbers = (dac.bits, dac.gain, dac.offset, dac.full_scale());
        self.table("dac").converter(numbers, (made, counts), ends)
    }

    fn converter(
        &self,
        (bits, gain, offset, full_scale): (u8, f64, f64, u32),
        (values, counts): ([f64; 2], [f64; 2]),
        [first, last]: [f64; 2],
    ) -> Result<(), Mistake> {
        self.numbers([
            ("bits", f64::from(bits), Requirement::AtLeast(1.0)),
            ("bits", f64::from(bits), Requirement::AtMost(32.0)),
            ("gain", gain, Requirement::Finite),
            ("offset", offset, Requirement::Finite),
        ])?;
        if gain == 0.0 {
            let rule = "all counts would mean the same, so give another";
            return Err(self.words("gain", "0", rule));
        }
        for (value, counts) in values.into_iter().zip(counts) {
            // Half a count is what rounding may add.
            if !(counts >= -0.5 && counts <= f64::from(full_scale) + 0.5) {
                let must = Requirement::Within(min(first, last), max(first, last));
                let reason = ", which its counts can mean; give it another gain or offset";
                let quantity = ": a value that it must convert";
                let wrong = self.off("", value, must, reason);
                return Err(Mistake { quantity, ..wrong });
            }
        }
        Ok(())
    }

    /// Returns the processor of this number, which serves this part of the hand.
    pub(super) fn served<'h, const F: usize, const J: usize, const A: usize>(
        &self,
        hand: &'h Hand<F, J, A>,
        number: u8,
        needed: ProcessorKind,
    ) -> Result<&'h ControlProcessor, Mistake> {
        let found = hand.processor(number);
        found.filter(|found| found.kind == needed).ok_or_else(|| {
            let rule = match needed {
                ProcessorKind::Table => "it must be the number of a table processor of the hand",
                _ => "it must be the number of a servo processor of the hand",
            };
            let value = MistakeValue::Number(number.into());
            self.wrong("processor", value, Allowed::Words(rule))
        })
    }
}
