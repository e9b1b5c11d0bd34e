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
/// m s'' = P area - viscous s' - coulomb tanh(s' / fade) - tension
/// tension = max(0, k e + d e')   of the stretch e = s - excursion of the joints, 0 where e <= 0
/// ```
///
/// The second equation is the first law for a chamber that fills through a linear resistance and
/// changes its volume without heat. Without an [`Elastic`] tendon the piston moves with the joints:
/// `tension = max(0, P area - viscous s' - coulomb tanh(s' / fade))`, and the mass of the piston
/// belongs to the armature of the joints.
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
    /// The elasticity of the tendon; `None` if it does not stretch.
    pub elastic: Option<Elastic>,
}

/// The elasticity of the tendon of a [`Pneumatic`] actuator: it stretches, and can become slack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastic {
    /// The stiffness, N/m.
    pub stiffness: f64,
    /// The damping, N s/m.
    pub damping: f64,
    /// The mass of the sliding parts, kg.
    pub piston_kg: f64,
}

/// The state of valve, chamber and piston.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Air {
    valve: f64,
    valve_rate: f64,
    pressure: f64,
    piston: f64,
    piston_rate: f64,
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
        positive("the speed where Coulomb friction fades, m/s", self.fade)?;
        if let Some(elastic) = &self.elastic {
            positive("the stiffness of a tendon, N/m", elastic.stiffness)?;
            not_negative("the damping of a tendon, N s/m", elastic.damping)?;
            positive("the mass of a piston, kg", elastic.piston_kg)?;
        }
        Ok(())
    }

    pub(super) fn at(&self, tension: f64, excursion: f64) -> Air {
        let pressure = tension / self.area_m2;
        let stretch = self
            .elastic
            .map_or(0.0, |elastic| tension / elastic.stiffness);
        Air {
            valve: pressure,
            valve_rate: 0.0,
            pressure,
            piston: excursion + stretch,
            piston_rate: 0.0,
        }
    }

    pub(super) fn update(
        &self,
        air: &mut Air,
        command: f64,
        excursion: f64,
        rate: f64,
        dt: f64,
    ) -> f64 {
        let tension = match &self.elastic {
            None => {
                air.piston = excursion;
                air.piston_rate = rate;
                let friction = coulomb(self.coulomb_n, self.fade, rate).torque;
                max(
                    air.pressure * self.area_m2 - self.viscous * rate + friction,
                    0.0,
                )
            }
            Some(elastic) => {
                let tension = elastic.tension(air.piston - excursion, air.piston_rate - rate);
                let mut friction = coulomb(self.coulomb_n, self.fade, air.piston_rate);
                friction.torque -= self.viscous * air.piston_rate;
                friction.slope += self.viscous;
                air.piston_rate += dt * (air.pressure * self.area_m2 + friction.torque - tension)
                    / (elastic.piston_kg + dt * friction.slope);
                air.piston += dt * air.piston_rate;
                tension
            }
        };
        self.fill(air, command, dt);
        tension
    }

    fn fill(&self, air: &mut Air, command: f64, dt: f64) {
        let corner = TAU * self.valve_hz;
        let error = command / self.area_m2 - air.valve;
        air.valve_rate = (air.valve_rate + dt * corner * corner * error)
            / (1.0 + 2.0 * dt * self.valve_damping * corner);
        air.valve += dt * air.valve_rate;

        let growth = self.area_m2 * air.piston_rate / self.volume_m3;
        let lost = self.fill_s * self.heat_ratio * (air.pressure + self.atmosphere_pa) * growth;
        air.pressure += (1.0 - exp(-dt / self.fill_s)) * (air.valve - lost - air.pressure);
        // There is nothing emptier than empty.
        air.pressure = clamp(air.pressure, -self.atmosphere_pa, f64::MAX);
    }
}

impl Elastic {
    fn tension(&self, stretch: f64, rate: f64) -> f64 {
        if stretch > 0.0 {
            max(self.stiffness * stretch + self.damping * rate, 0.0)
        } else {
            0.0
        }
    }
}
