use super::PlantError;
use super::error::{finite, not_negative, positive};
use super::noise::Noise;
use crate::config::Input;
use crate::math::abs;

/// A sensor, and the converter behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// The converter, as a controller's configuration has it.
    pub adc: Input,
    /// The standard deviation of the noise before conversion, in the unit of the sensor.
    pub noise: f64,
}

/// What is wrong with a channel, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorFault {
    /// Of the bank, from 0.
    pub channel: usize,
    /// From this time on, s.
    pub from_s: f64,
    /// Until before this time, s; infinite for ever.
    pub until_s: f64,
    /// What is wrong.
    pub kind: SensorFaultKind,
}

/// What can be wrong with a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SensorFaultKind {
    /// It repeats what it last read before.
    Stuck,
    /// This is added before conversion, in the unit of the sensor.
    Offset(f64),
    /// With this probability a reading is lost, and is that of zero counts.
    Dropout(f64),
    /// It reads what is no number.
    NotANumber,
}

/// C sensors, their noise, and the script of their faults.
#[derive(Clone, Copy, Debug)]
pub struct SensorBank<'a, const C: usize> {
    sensors: [Sensor; C],
    script: &'a [SensorFault],
    noise: Noise,
    last: [f64; C],
}

impl Sensor {
    fn check(&self) -> Result<(), PlantError> {
        let Input {
            bits, gain, offset, ..
        } = self.adc;
        if !(1..=32).contains(&bits) {
            return Err(PlantError::Bits { bits });
        }
        positive("the size of a converter's count", abs(gain))?;
        finite("the value of a converter at zero counts", offset)?;
        not_negative("the noise of a sensor", self.noise)
    }
}

impl<'a, const C: usize> SensorBank<'a, C> {
    /// A bank whose noise follows from `seed`.
    ///
    /// # Errors
    ///
    /// The first parameter that makes no sense, and a fault of a channel that there is not.
    pub fn new(
        sensors: [Sensor; C],
        script: &'a [SensorFault],
        seed: u64,
    ) -> Result<Self, PlantError> {
        sensors.iter().try_for_each(Sensor::check)?;
        for fault in script {
            fault.check(C)?;
        }
        Ok(Self {
            sensors,
            script,
            noise: Noise::new(seed),
            last: sensors.map(|sensor| sensor.adc.value(0)),
        })
    }

    /// What the channels read at the time `now_s` of what is.
    pub fn read(&mut self, now_s: f64, values: &[f64; C]) -> [f64; C] {
        let mut readings = *values;
        let channels = self.sensors.iter().zip(&mut self.last);
        for (channel, (reading, (sensor, last))) in readings.iter_mut().zip(channels).enumerate() {
            // Every channel draws at every reading: a fault of one leaves the others as they were.
            let noise = self.noise.normal() * sensor.noise;
            let chance = self.noise.uniform();
            let mut value = *reading + noise;
            let (mut stuck, mut lost, mut not_a_number) = (false, false, false);
            let faults = self.script.iter();
            for fault in faults.filter(|fault| fault.channel == channel && fault.is_on(now_s)) {
                match fault.kind {
                    SensorFaultKind::Stuck => stuck = true,
                    SensorFaultKind::Offset(offset) => value += offset,
                    SensorFaultKind::Dropout(probability) => lost |= chance < probability,
                    SensorFaultKind::NotANumber => not_a_number = true,
                }
            }
            if !stuck {
                *last = sensor.adc.value(sensor.adc.counts(value));
            }
            *reading = if not_a_number {
                f64::NAN
            } else if lost {
                sensor.adc.value(0)
            } else {
                *last
            };
        }
        readings
    }
}

impl SensorFault {
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
            SensorFaultKind::Offset(offset) => finite("the offset of a sensor", offset),
            SensorFaultKind::Dropout(probability) => {
                not_negative("the probability of a dropout", probability)
            }
            SensorFaultKind::Stuck | SensorFaultKind::NotANumber => Ok(()),
        }
    }
}
