//! [`SimJoint`]: a joint with a motor driver and an angle sensor.

use core::f32::consts::TAU;

use super::{As5600Model, Model, Pca9685Model};
use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};
use crate::claim::ClaimCell;
use crate::drivers::{As5600, Pca9685};

const FRICTION_NM_S: f32 = 0.05;
const INERTIA_KG_M2: f32 = 0.01;

/// A simulated joint with a motor and an angle sensor, for programs without hardware. It is the bus
/// behind a simulated [`I2c`](super::I2c) controller, and needs no heap.
///
/// At 0x40 is a [`Pca9685`] whose outputs 0 and 1 drive the motor in the two directions. At 0x36 is
/// an [`As5600`], which measures the joint's angle; the joint begins in the middle of the turn.
///
/// ```
/// use condor_dev::drivers::{As5600, Pca9685};
/// use condor_dev::sim::{I2c, SimJoint};
/// use condor_dev::{I2cBus, OpenMode, NoInterrupts, Location, Switch, device_switch};
///
/// device_switch! {
///     struct Boards {
///         motor: Pca9685 = [Location::i2c(0x40)],
///         sensor: As5600 = [Location::i2c(As5600::ADDRESS)],
///     }
/// }
///
/// let joint = SimJoint::default();
/// let boards = Switch::<_, _, _, 2>::new(I2cBus::new(I2c(&joint)), NoInterrupts, Boards::new());
/// boards.start();
/// let motor = boards.open_typed(Boards::motor, 0, OpenMode::WRITE)?;
/// let sensor = boards.open_typed(Boards::sensor, 0, OpenMode::READ)?;
/// motor.set_duties(motor.registers, 0, &[Pca9685::CYCLE / 2, 0]).unwrap();
/// for _ in 0..10 {
///     joint.advance(0.002);
/// }
/// assert!((2049..2100).contains(&sensor.angle(sensor.registers).unwrap()));
/// # Ok::<_, condor_dev::OpenError>(())
/// ```
pub struct SimJoint(ClaimCell<JointBoards>);

#[derive(Default)]
struct JointBoards {
    motor: Pca9685Model,
    sensor: As5600Model,
    /// rad, 0 in the middle of the sensor's turn.
    angle: f32,
    /// rad/s.
    speed: f32,
}

impl Default for SimJoint {
    /// A joint that rests, with its parts as they are after power came.
    fn default() -> Self {
        let joint = Self(ClaimCell::new(JointBoards::default()));
        joint.advance(0.0);
        joint
    }
}

impl SimJoint {
    /// The torque of the motor in N m when it stands still and has its full duty.
    pub const STALL_NM: f32 = 2.0;

    /// Advances the simulation by `seconds` in one step of integration. The step must be short
    /// compared with the joint's motion: a period of a servo loop, for example. Does nothing while
    /// another context uses the bus.
    pub fn advance(&self, seconds: f32) {
        let Some(mut parts) = self.0.claim() else {
            return;
        };
        let duty = |output| f32::from(parts.motor.duty(output).unwrap_or(0));
        let torque = Self::STALL_NM * (duty(0) - duty(1)) / f32::from(Pca9685::CYCLE);
        parts.speed += seconds * (torque - FRICTION_NM_S * parts.speed) / INERTIA_KG_M2;
        parts.angle += seconds * parts.speed;
        let step = (0.5 + parts.angle / TAU) * f32::from(As5600::TURN);
        parts.sensor.angle = (step as i32).rem_euclid(As5600::TURN.into()).unsigned_abs() as u16;
    }

    fn access<R>(
        &self,
        address: usize,
        access: impl FnOnce(&mut dyn Model, usize) -> Option<R>,
    ) -> Result<R, BusAccessError> {
        let error = |kind| BusAccessError { address, kind };
        let mut parts = self.0.claim().ok_or(error(BusErrorKind::Busy))?;
        let (part, offset): (&mut dyn Model, _) = match address >> 8 {
            0x40 => (&mut parts.motor, address & 0xff),
            0x36 => (&mut parts.sensor, address & 0xff),
            _ => {
                let also = parts.motor.also_at(address);
                let offset = also.ok_or(error(BusErrorKind::OutOfRange))?;
                (&mut parts.motor, offset)
            }
        };
        access(part, offset).ok_or(error(BusErrorKind::NoAnswer))
    }
}

impl Bus for SimJoint {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        self.access(address, |model, offset| model.read(offset, width))
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        let value = value & width.mask();
        self.access(address, |model, offset| model.write(offset, width, value))
    }

    fn read_block(&self, mut address: usize, into: &mut [u8]) -> Result<(), BusAccessError> {
        into.iter_mut().try_for_each(|byte| {
            address = self.access(address, |model, offset| {
                *byte = model.read(offset, Width::Bits8)? as u8;
                Some(address - offset + model.next(offset))
            })?;
            Ok(())
        })
    }

    fn write_block(&self, mut address: usize, from: &[u8]) -> Result<(), BusAccessError> {
        from.iter().try_for_each(|&byte| {
            address = self.access(address, |model, offset| {
                model.write(offset, Width::Bits8, byte.into())?;
                Some(address - offset + model.next(offset))
            })?;
            Ok(())
        })
    }
}
