use core::f64::consts::TAU;

use super::joint::coulomb;
use crate::math::{clamp, exp, max};
use crate::number::{NumberError, not_negative, positive};

/// A model of a pneumatic actuator: a pressure valve, a cylinder with a sliding piston, and the
/// tendon that the piston draws in.
///
/// Along the retraction s of the piston, with gauge pressure P and valve output x, both Pa:
///
/// ```text
/// x'' = w² (command / area - x) - 2 zeta w x'          w = 2 pi valve_hz
/// P'  = (x - P) / fill_s - gamma (P + atmosphere) area s' / volume
/// tension = max(0, P area - viscous s' - coulomb tanh(s' / fade))
/// ```
///
/// The second equation is the first law for a chamber that fills through a linear resistance and
/// changes its volume without heat. The tendon does not stretch, so the piston moves with the joints, and its
/// mass belongs to their armature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pneumatic {
    /// The area of the piston, m².
    pub area_m2: f64,
    /// The corner frequency of the valve, Hz.
    pub valve_hz: f64,
    /// The damping ratio of the valve.
    pub valve_damping: f64,
    /// The time constant with which the chamber fills, s.
    pub fill_s: f64,
    /// The ratio of the gas's heat capacities.
    pub heat_ratio: f64,
    /// The pressure around the cylinder, Pa.
    pub atmosphere_pa: f64,
    /// The volume of the chamber, m³.
    pub volume_m3: f64,
    /// Viscous friction of piston and spool, N s/m.
    pub viscous: f64,
    /// The Coulomb friction of piston and spool, N.
    pub coulomb_n: f64,
    /// The speed below which Coulomb friction fades to nothing, m/s.
    pub fade: f64,
}

/// The state of valve and chamber.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Air {
    valve: f64,
    valve_rate: f64,
    pressure: f64,
}

impl Pneumatic {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        positive("the area of a piston, m²", self.area_m2)?;
        positive("the corner of a valve, Hz", self.valve_hz)?;
        not_negative("the damping ratio of a valve", self.valve_damping)?;
        positive("the time that fills a chamber, s", self.fill_s)?;
        not_negative("the ratio of heat capacities", self.heat_ratio)?;
        not_negative("the pressure around a cylinder, Pa", self.atmosphere_pa)?;
        positive("the volume of a chamber, m³", self.volume_m3)?;
        not_negative("the viscous friction of a piston, N s/m", self.viscous)?;
        not_negative("the Coulomb friction of a piston, N", self.coulomb_n)?;
        positive("the speed where Coulomb friction fades, m/s", self.fade)
    }

    pub(super) fn at(&self, tension: f64) -> Air {
        let pressure = tension / self.area_m2;
        Air {
            valve: pressure,
            valve_rate: 0.0,
            pressure,
        }
    }

    /// One update of `dt` seconds, in which the piston moves at `rate` (m/s); returns the tension.
    pub(super) fn update(&self, air: &mut Air, command: f64, rate: f64, dt: f64) -> f64 {
        let friction = coulomb(self.coulomb_n, self.fade, rate).torque;
        let pull = air.pressure * self.area_m2 - self.viscous * rate + friction;
        self.fill(air, command, rate, dt);
        max(pull, 0.0)
    }

    fn fill(&self, air: &mut Air, command: f64, rate: f64, dt: f64) {
        let corner = TAU * self.valve_hz;
        let error = command / self.area_m2 - air.valve;
        air.valve_rate = (air.valve_rate + dt * corner * corner * error)
            / (1.0 + 2.0 * dt * self.valve_damping * corner);
        air.valve += dt * air.valve_rate;

        let growth = self.area_m2 * rate / self.volume_m3;
        let lost = self.fill_s * self.heat_ratio * (air.pressure + self.atmosphere_pa) * growth;
        air.pressure += (1.0 - exp(-dt / self.fill_s)) * (air.valve - lost - air.pressure);
        // There is nothing emptier than empty.
        air.pressure = clamp(air.pressure, -self.atmosphere_pa, f64::MAX);
    }
}
