//! [`Arguments`]: what the system description tells the robot.

use condor_rt::{Machine, ShortText};

use crate::failure::Failure;

/// The numbers of the robot's arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Arguments {
    pub(super) rate_hz: u32,
    pub(super) watchdog_ms: u32,
    pub(super) ramp_ms: u32,
    pub(super) camera_hz: u32,
    /// The deviation of what the camera measures, µm.
    pub(super) camera_um: u32,
    pub(super) seed: u32,
}

impl Default for Arguments {
    fn default() -> Self {
        Self {
            rate_hz: 2000,
            watchdog_ms: 25,
            ramp_ms: 250,
            camera_hz: 50,
            camera_um: 0,
            seed: 1,
        }
    }
}

impl Arguments {
    pub(super) fn of<M: Machine>(machine: &M) -> Result<Self, Failure> {
        let mut arguments = Self::default();
        let mut index = 0;
        while let Some(argument) = machine.argument(index) {
            arguments.take(argument).ok_or_else(|| Failure::Argument {
                argument: ShortText::of(&argument),
                known: "rate=HZ, watchdog_ms=MS, ramp_ms=MS, camera_hz=HZ, camera_um=UM, seed=N above 0",
            })?;
            index += 1;
        }
        Ok(arguments)
    }

    fn take(&mut self, argument: &str) -> Option<()> {
        let (name, number) = argument.split_once('=')?;
        let place = match name {
            "rate" => &mut self.rate_hz,
            "watchdog_ms" => &mut self.watchdog_ms,
            "ramp_ms" => &mut self.ramp_ms,
            "camera_hz" => &mut self.camera_hz,
            "camera_um" => &mut self.camera_um,
            "seed" => &mut self.seed,
            _ => return None,
        };
        *place = number.parse().ok().filter(|&number| number > 0)?;
        Some(())
    }

    /// Returns the number of ticks in `ms` milliseconds, at least one.
    pub(super) fn ticks(&self, ms: u32) -> u32 {
        let ticks = u64::from(ms) * u64::from(self.rate_hz) / 1000;
        u32::try_from(ticks).unwrap_or(u32::MAX).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_names_and_numbers() {
        let mut arguments = Arguments::default();
        assert_eq!(arguments.take("rate=400"), Some(()));
        assert_eq!(arguments.take("ramp_ms=5"), Some(()));
        assert_eq!(
            (arguments.rate_hz, arguments.watchdog_ms, arguments.ramp_ms),
            (400, 25, 5)
        );
        for wrong in ["rate", "rate=", "rate=0", "rate=-1", "speed=1", "rate=1e3"] {
            assert_eq!(arguments.take(wrong), None, "{wrong}");
        }
        assert_eq!(arguments.ticks(25), 10);
        assert_eq!(arguments.ticks(1), 1);
    }
}
