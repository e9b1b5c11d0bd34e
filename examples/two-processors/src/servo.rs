//! The servo: holds the joint where it was told to, with a motor driver and an angle sensor on I2C.

use core::f32::consts::TAU;
use core::sync::atomic::{AtomicI32, Ordering::Relaxed};
use core::time::Duration;

use condor_dev::drivers::{As5600, Pca9685};
use condor_dev::sim::{I2c, SimJoint};
use condor_dev::{I2cBus, Location, NoInterrupts, OpenMode, Switch, device_switch};
use condor_rt::{Buffering, Machine, OpenOptions, Param, Program, ProgramError, Rate};
use condor_rt::{Setup, Var, Write as _};

use crate::panel::{Panel, Ports};
use crate::{MOVE, WHERE};

const HZ: u32 = 400;
const LONGEST_PERIOD_NS: u64 = 5_000_000;
const DAMPING_NM_S: f32 = 0.1;

device_switch! {
    struct Boards {
        motor: Pca9685 = [Location::i2c(0x40)],
        sensor: As5600 = [Location::i2c(As5600::ADDRESS)],
    }
}

/// The program of the servo: it holds a joint at the angle that the master sent last.
pub struct Servo;

impl Program for Servo {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        // With a real joint, `I2cBus::new` has the I2C controller of the board instead.
        let joint = SimJoint::default();
        let i2c = I2cBus::new(I2c(&joint));
        let boards = Switch::<_, _, _, 2>::new(i2c, NoInterrupts, Boards::new());
        boards.start();
        let ports =
            Switch::<_, _, _, 1>::new(machine.bus(), machine.interrupt_controller(), Ports::new());
        ports.start();
        let motor = boards.open_typed(Boards::motor, 0, OpenMode::WRITE)?;
        let sensor = boards.open_typed(Boards::sensor, 0, OpenMode::READ)?;

        let position = Var::new("joint.position", "rad");
        let stiffness = Param::new("joint.stiffness", "N m/rad", 2.0_f32, 0.0..=20.0);
        let (target, place) = (AtomicI32::new(0), AtomicI32::new(0));
        let (mut last, mut last_due_ns) = (0.0, 0);
        Setup::new(machine)?
            .console()?
            .files()?
            .on(MOVE, "move", &|call| {
                target.store(call.data() as i32, Relaxed);
                place.load(Relaxed) as u32
            })
            .on(WHERE, "where", &|_| place.load(Relaxed) as u32)
            .interrupts(&ports)
            .watch(&position)
            .tune(&stiffness)
            // The joint needs the servo: it may be slower or faster, and never rests.
            .rates(200.0..=1000.0)
            .servo("servo", Rate::hz(HZ), &mut |tick| {
                let due_ns = tick.due.as_ns();
                let period_ns = due_ns.saturating_sub(last_due_ns).min(LONGEST_PERIOD_NS);
                let period = period_ns as f32 * 1e-9;
                joint.advance(period);
                let Ok(step) = sensor.angle(sensor.registers) else {
                    return;
                };
                let angle = (f32::from(step) / f32::from(As5600::TURN) - 0.5) * TAU;
                let error = target.load(Relaxed) as f32 / 1000.0 - angle;
                let speed = (angle - last) / period;
                let torque = stiffness.get() * error - DAMPING_NM_S * speed;
                let duty = (torque / SimJoint::STALL_NM * f32::from(Pca9685::CYCLE)) as i16;
                let duties = [duty.max(0) as u16, duty.min(0).unsigned_abs()];
                let _ = motor.set_duties(motor.registers, 0, &duties);
                position.set(angle);
                place.store((angle * 1000.0) as i32, Relaxed);
                (last, last_due_ns) = (angle, due_ns);
            })
            .rates(0.0..=20.0)
            .servo("report", Rate::hz(1), &mut |tick| {
                tick.print(format_args!("joint at {} mrad\r\n", place.load(Relaxed)));
            })
            .background(|background| {
                let files = background.files()?;
                let mut stdio = background.stdio().with_files(&files);
                let panel = Panel::open(&mut stdio, &ports)?;
                let options = OpenOptions::new().append().create();
                let log = stdio.open_file("servo.log", options, Buffering::Line)?;
                let mut logged = 0;
                while !background.is_stopping() {
                    background.serve(Duration::from_millis(20))?;
                    while let Some(angle) = panel.angle(&mut stdio, place.load(Relaxed)) {
                        target.store(angle, Relaxed);
                    }
                    let (at, angle) = (place.load(Relaxed), target.load(Relaxed));
                    if core::mem::replace(&mut logged, angle) != angle {
                        let noted = writeln!(stdio.stream(log)?, "from {at} to {angle} mrad");
                        let shared = background.log(format_args!("from {at} to {angle} mrad"));
                        if let Err(error) = noted.map_err(ProgramError::from).and(shared) {
                            background.print(format_args!("{error}\r\n"));
                        }
                    }
                }
                Ok(stdio.close(log)?)
            })
    }
}
