//! A simulated joint, in the place of a real one: what its motor driver and its angle sensor see.

use core::f32::consts::TAU;

use condor_dev::drivers::{As5600, Pca9685};
use condor_dev::sim::{As5600Model, Board, Pca9685Model};

const STALL_NM: f32 = 2.0;
const FRICTION_NM_S: f32 = 0.05;
const INERTIA_KG_M2: f32 = 0.01;

/// Angle in rad, and speed in rad/s.
#[derive(Default)]
pub struct Joint(f32, f32);

impl Joint {
    /// Turns for some seconds, as the two outputs of the motor driver say: one for each direction.
    pub fn turn(&mut self, time: f32, motor: &Board<Pca9685Model>, sensor: &Board<As5600Model>) {
        if let (Some(motor), Some(mut sensor)) = (motor.model(), sensor.model()) {
            let duty = |output| f32::from(motor.duty(output).unwrap_or(0));
            let torque = STALL_NM * (duty(0) - duty(1)) / f32::from(Pca9685::CYCLE);
            self.1 += time * (torque - FRICTION_NM_S * self.1) / INERTIA_KG_M2;
            self.0 += time * self.1;
            // Zero is in the middle of what the sensor shows.
            let step = 0.5 + self.0 / TAU;
            sensor.angle = (step * f32::from(As5600::TURN)) as u16;
        }
    }
}
