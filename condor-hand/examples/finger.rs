//! A simulated finger of the shipped hand closes and opens, following a motion that is written as
//! text. The controllers between the two closures are those of a real hand: they read and write
//! counts of converters, 400 times a second, and follow set-points (the desired values of the
//! joints) from a trajectory that ticks 50 times a second.
//!
//! ```text
//! cargo run -p condor-hand --example finger
//! ```

use std::array::from_fn;

use condor_hand::config::{Hand, Wire};
use condor_hand::controller::{FingerController, FingerSensors, write_finger};
use condor_hand::math::max;
use condor_hand::plant::PlantModel;
use condor_hand::servo::ServoMode;
use condor_hand::trajectory::{Generator, Observations, motion};
use nalgebra::{Vector3, Vector4};

const HAND: &str = include_str!("../hands/utah-mit.toml");

const MOTION: &str = r#"
[[motion]]
profile = "minimum-jerk"
duration = 0.5
to = { proximal = 0.9, middle = 1.1, distal = 0.8 }

[[motion]]
profile = "trapezoid"
speed = 0.2
to = { proximal = 0.3, middle = 0.4, distal = 0.4 }
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let hand = Hand::<4, 4, 8>::from_toml(HAND, "utah-mit.toml")?;
    let index = &hand.fingers[0];
    let mechanism = index.planar().ok_or("a finger of another form")?;
    let tendons = index.transmission()?;
    let start = Vector4::new(0.0, 0.3, 0.4, 0.4);

    // The servo's processor. A joint that gets a mode holds its present position.
    let mut controller = FingerController::new(&hand, index, mechanism, tendons)?;
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position)?;
    }

    // The master's processor: a queue of motions, within the limits of the joints.
    let limits = from_fn(|joint| index.joints[joint].limits.with_jerk(1e5));
    let tick_s = 1.0 / f64::from(hand.trajectory_hz);
    let mut generator = Generator::<4, 8>::new(limits, start.into(), tick_s)?;
    let names: [_; 4] = from_fn(|joint| &index.joints[joint].name);
    for primitive in motion::load(MOTION, "motion.toml", &names)? {
        generator.enqueue(primitive)?;
    }

    // The simulated finger; on a real one the two closures below read and write converters.
    let mut finger = PlantModel::default().finger(index, mechanism, tendons, start)?;
    let gravity = Vector3::from(hand.gravity);
    let period_s = 1.0 / f64::from(hand.servo_hz);
    let sensors = FingerSensors::new(index)?;
    let mut commands = [0.0; 8]; // N
    let mut worst = 0.0_f64;

    for tick in 0..2 * hand.servo_hz {
        let sensed = sensors.read(|channel| {
            let wire = hand.wire(channel)?;
            let input = hand.input(wire)?;
            Some(input.counts(match wire {
                Wire::Position { joint, .. } => finger.q()[joint],
                Wire::Actuator { actuator, .. } => finger.efforts()[actuator],
                Wire::Encoder { .. } | Wire::Touch { .. } | Wire::Axis { .. } => return None,
            }))
        });
        // The servos hold their positions until the first set-points come.
        if tick > 0 && tick % (hand.servo_hz / hand.trajectory_hz) == 0 {
            controller.follow(&generator.tick(&Observations::none()), &generator.guards())?;
        }
        let done = controller.tick(&sensed, &gravity, period_s);
        if let Some(fault) = done.fault {
            return Err(fault.of(index).to_string().into());
        }
        write_finger(index, &done.output.command, |channel, counts| {
            let Some(wire) = hand.wire(channel) else {
                return;
            };
            if let (Wire::Actuator { actuator, .. }, Some(output)) = (wire, hand.output(wire)) {
                commands[actuator] = output.value(counts);
            }
        });
        finger.step(period_s, 5, &commands, &gravity)?;
        for joint in 0..4 {
            let target = done.target[joint].unwrap_or(sensed.position[joint]);
            worst = max(worst, (target - sensed.position[joint]).abs());
        }
    }
    println!(
        "{} reached {:.3} rad, at most {worst:.3} rad off",
        index.name,
        finger.q()[1]
    );
    assert!(generator.is_idle() && worst < 0.05);
    Ok(())
}
