use super::PlantError;
use super::error::{finite, not_negative, ordered};
use super::noise::Noise;
use crate::math::{clamp, round};

/// An analogue-to-digital converter and the sensor before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// Resolution, 1..=32.
    pub bits: u32,
    /// What the lowest and the highest count mean, in the unit of the sensor.
    pub range: (f64, f64),
    /// The standard deviation of the noise before conversion, in the unit of the sensor.
    pub noise: f64,
}

/// What is wrong with a channel, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// Of the bank, from 0.
    pub channel: usize,
    /// From this time on, s.
    pub from_s: f64,
    /// Until before this time, s; infinite for ever.
    pub until_s: f64,
    /// What is wrong.
    pub kind: FaultKind,
}

/// What can be wrong with a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FaultKind {
    /// It repeats what it last read before.
    Stuck,
    /// This is added before conversion, in the unit of the sensor.
    Offset(f64),
    /// With this probability a reading is lost, and is the lowest of the range.
    Dropout(f64),
    /// It reads what is no number.
    NotANumber,
}

/// C converters, their noise, and the script of their faults.
#[derive(Clone, Copy, Debug)]
pub struct SensorBank<'a, const C: usize> {
    converters: [Converter; C],
    script: &'a [Fault],
    noise: Noise,
    last: [f64; C],
}

impl Converter {
    fn check(&self) -> Result<(), PlantError> {
        if !(1..=32).contains(&self.bits) {
            return Err(PlantError::Bits { bits: self.bits });
        }
        ordered("the range of a converter", self.range)?;
        not_negative("the noise of a sensor", self.noise)
    }

    /// The difference of two neighbouring counts, in the unit of the sensor.
    #[must_use]
    pub fn resolution(&self) -> f64 {
        (self.range.1 - self.range.0) / self.full()
    }

    /// The count of a value; the nearest end of the range for what is beyond it, and 0 for what is
    /// no number.
    #[must_use]
    pub fn counts(&self, value: f64) -> u32 {
        let share = (value - self.range.0) / (self.range.1 - self.range.0);
        let full = self.full();
        #[allow(clippy::cast_sign_loss, reason = "it is clamped to 0 and above")]
        let counts = round(clamp(share * full, 0.0, full)) as u32;
        counts
    }

    /// The value that a count means, in the unit of the sensor.
    #[must_use]
    pub fn value(&self, counts: u32) -> f64 {
        self.range.0 + f64::from(counts) * self.resolution()
    }

    fn full(&self) -> f64 {
        f64::from(u32::MAX >> 32_u32.saturating_sub(self.bits).min(31))
    }
}

impl<'a, const C: usize> SensorBank<'a, C> {
    /// A bank whose noise follows from `seed`.
    ///
    /// # Errors
    ///
    /// The first parameter that makes no sense, and a fault of a channel that there is not.
    pub fn new(
        converters: [Converter; C],
        script: &'a [Fault],
        seed: u64,
    ) -> Result<Self, PlantError> {
        converters.iter().try_for_each(Converter::check)?;
        for fault in script {
            fault.check(C)?;
        }
        Ok(Self {
            converters,
            script,
            noise: Noise::new(seed),
            last: converters.map(|converter| converter.range.0),
        })
    }

    /// What the channels read at the time `now_s` of what is.
    pub fn read(&mut self, now_s: f64, values: &[f64; C]) -> [f64; C] {
        let mut readings = *values;
        let channels = self.converters.iter().zip(&mut self.last);
        for (channel, (reading, (converter, last))) in readings.iter_mut().zip(channels).enumerate()
        {
            // Every channel draws at every reading: a fault of one leaves the others as they were.
            let noise = self.noise.normal() * converter.noise;
            let chance = self.noise.uniform();
            let mut value = *reading + noise;
            let (mut stuck, mut lost, mut not_a_number) = (false, false, false);
            let faults = self.script.iter();
            for fault in faults.filter(|fault| fault.channel == channel && fault.is_on(now_s)) {
                match fault.kind {
                    FaultKind::Stuck => stuck = true,
                    FaultKind::Offset(offset) => value += offset,
                    FaultKind::Dropout(probability) => lost |= chance < probability,
                    FaultKind::NotANumber => not_a_number = true,
                }
            }
            if !stuck {
                *last = converter.value(converter.counts(value));
            }
            *reading = if not_a_number {
                f64::NAN
            } else if lost {
                converter.range.0
            } else {
                *last
            };
        }
        readings
    }
}

impl Fault {
    fn is_on(&self, now_s: f64) -> bool {
        self.from_s <= now_s && now_s < self.until_s
    }

    fn check(&self, channels: usize) -> Result<(), PlantError> {
        if self.channel >= channels {
            let channel = self.channel;
            return Err(PlantError::NoChannel { channel, channels });
        }
        finite("the time when a fault begins, s", self.from_s)?;
        match self.kind {
            FaultKind::Offset(offset) => finite("the offset of a sensor", offset),
            FaultKind::Dropout(probability) => {
                not_negative("the probability of a dropout", probability)
            }
            FaultKind::Stuck | FaultKind::NotANumber => Ok(()),
        }
    }
}
