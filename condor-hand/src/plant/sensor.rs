use super::noise::Noise;
use crate::config::InputChannel;
use crate::math::abs;
use crate::number::{NumberError, Requirement, check, count, finite, not_negative, positive};

/// A simulated sensor: the converter that reads it, and its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// The converter, as in a controller's configuration.
    pub adc: InputChannel,
    /// The standard deviation of the noise before conversion, in the unit of the sensor.
    pub noise: f64,
}

/// A fault of a simulated sensor, which begins and ends at set times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorFault {
    /// The channel of the bank, from 0.
    pub channel: usize,
    /// The time at which the fault begins, s.
    pub from_s: f64,
    /// The time at which it ends, s; infinite if it does not end.
    pub until_s: f64,
    /// The kind of fault.
    pub kind: SensorFaultKind,
}

/// The kind of a simulated sensor fault.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SensorFaultKind {
    /// The channel repeats its last reading from before the fault.
    Stuck,
    /// This offset is added before conversion, in the unit of the sensor.
    Offset(f64),
    /// With this probability a reading is lost, and has zero counts.
    Dropout(f64),
    /// The channel reads NaN.
    NotANumber,
}

/// A bank of C simulated sensors, or channels. It converts true values into readings with noise
/// and, according to a script, with faults.
#[derive(Clone, Copy, Debug)]
pub struct SensorBank<'a, const C: usize> {
    sensors: [Sensor; C],
    script: &'a [SensorFault],
    noise: Noise,
    last: [f64; C],
}

impl Sensor {
    fn check(&self) -> Result<(), NumberError> {
        let InputChannel {
            bits, gain, offset, ..
        } = self.adc;
        positive("the width of a converter, bits,", f64::from(bits))?;
        let most = Requirement::AtMost(32.0);
        check("the width of a converter, bits,", f64::from(bits), most)?;
        positive("the size of a converter's count", abs(gain))?;
        finite("the value of a converter at zero counts", offset)?;
        not_negative("the noise of a sensor", self.noise)
    }
}

impl<'a, const C: usize> SensorBank<'a, C> {
    /// Makes a bank of `sensors`, with the faults in `script`. The noise is determined by `seed`.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong, or for a fault of a channel that does
    /// not exist.
    pub fn new(
        sensors: [Sensor; C],
        script: &'a [SensorFault],
        seed: u64,
    ) -> Result<Self, NumberError> {
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

    /// Returns the readings of all channels at the time `now_s` (s), with noise and faults, in the
    /// unit of each sensor. `values` are the true values.
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

    fn check(&self, channels: usize) -> Result<(), NumberError> {
        let below = Requirement::Below(count(channels));
        check(
            "the number of the channel, from 0,",
            count(self.channel),
            below,
        )?;
        finite("the time when a fault begins, s", self.from_s)?;
        match self.kind {
            SensorFaultKind::Offset(offset) => finite("the offset of a sensor", offset)?,
            SensorFaultKind::Dropout(probability) => {
                not_negative("the probability of a dropout", probability)?;
            }
            SensorFaultKind::Stuck | SensorFaultKind::NotANumber => {}
        }
        Ok(())
    }
}
