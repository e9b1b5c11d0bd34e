//! A serial arm of seven direct drives, without tendons: another robot from the parts of the hand.
//!
//! The numbers of the arm are made up, of the size of an arm that works beside people. The arm is
//! simulated with the forward dynamics of its chain and moved by computed torque with the inverse
//! dynamics of the same chain, once as it is and once with a load in its hand that the controller
//! does not know. The program fails where an error is larger than its bound.
//!
//! ```text
//! cargo run -p condor-hand --example arm
//! ```

use std::process::ExitCode;

use condor_hand::Pose;
use condor_hand::dynamics::{DriveDynamics, Dynamics};
use condor_hand::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion};
use condor_hand::math::{clamp, max};
use nalgebra::{Matrix3, SVector, Vector3};

const JOINTS: usize = 7;
type Joints = SVector<f64, JOINTS>;

const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
/// Rates of the controller and of the simulation, Hz.
const CONTROL_HZ: u32 = 400;
const STEPS_PER_TICK: u32 = 10;
/// The motion, and how long the arm then stands, s.
const MOVE_S: f64 = 1.5;
const REST_S: f64 = 0.5;
/// The errors that the controller corrects decay as with this natural frequency, rad/s, and
/// critical damping.
const STIFFNESS: f64 = 2.0 * std::f64::consts::PI * 4.0;

/// The part of the load that the controller does not know, kg, and the errors that it may cause in motion and
/// at rest, degrees.
const TRIALS: [(f64, f64, f64); 2] = [(0.0, 0.05, 0.001), (0.2, 3.0, 2.0)];

/// The set-point of the joints at one time of a motion.
struct Setpoint {
    position: Joints,
    velocity: Joints,
    acceleration: Joints,
}

fn main() -> ExitCode {
    let start = Joints::from([0.0, 0.3, 0.0, -1.2, 0.0, 0.8, 0.0]);
    let end = Joints::from([1.0, -0.4, 0.5, -0.3, 0.9, -0.2, 1.5]);
    let mut passed = true;
    for (load_kg, moving_deg, at_rest_deg) in TRIALS {
        let Some((moving, at_rest)) = run(load_kg, &start, &end) else {
            eprintln!("the mass matrix is not positive definite");
            return ExitCode::FAILURE;
        };
        let (moving, at_rest) = (moving.to_degrees(), at_rest.to_degrees());
        println!(
            "with {load_kg} kg that it does not know: at most {moving:.4} degrees off in motion \
             (bound {moving_deg}), {at_rest:.4} at rest (bound {at_rest_deg})"
        );
        passed &= moving <= moving_deg && at_rest <= at_rest_deg;
    }
    if passed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// The largest errors of any joint in one motion, and at rest after it, rad.
fn run(load_kg: f64, start: &Joints, end: &Joints) -> Option<(f64, f64)> {
    let known = arm(0.0);
    let real = arm(load_kg);
    let drive = drive();
    let tick = 1.0 / f64::from(CONTROL_HZ);
    let step = tick / f64::from(STEPS_PER_TICK);

    let (mut q, mut qd) = (*start, Joints::zeros());
    let (mut moving, mut at_rest) = (0.0, 0.0);
    let mut time = 0.0;
    while time < MOVE_S + REST_S {
        let wanted = minimum_jerk(start, end, MOVE_S, time);
        let error = (wanted.position - q).amax();
        if time < MOVE_S {
            moving = max(moving, error);
        } else {
            // The error that is left at the end counts.
            at_rest = error;
        }

        let torque = computed_torque(&known, &drive, &wanted, &q, &qd);
        for _ in 0..STEPS_PER_TICK {
            let moving = torque - drive.torque(&qd);
            qd += real.forward_dynamics(&q, &qd, &moving, &GRAVITY, &drive.armature)? * step;
            q += qd * step;
        }
        time += tick;
    }
    Some((moving, at_rest))
}

/// The torques with which every joint corrects its error as if it were alone.
fn computed_torque(
    arm: &Chain<JOINTS>,
    drive: &DriveDynamics<JOINTS>,
    wanted: &Setpoint,
    q: &Joints,
    qd: &Joints,
) -> Joints {
    let acceleration = wanted.acceleration
        + (wanted.velocity - qd) * (2.0 * STIFFNESS)
        + (wanted.position - q) * (STIFFNESS * STIFFNESS);
    arm.inverse_dynamics(q, qd, &acceleration, &GRAVITY)
        + drive.armature.component_mul(&acceleration)
        + drive.torque(qd)
}

/// From rest to rest with the least integral of the squared jerk (Flash and Hogan 1985).
fn minimum_jerk(start: &Joints, end: &Joints, duration: f64, time: f64) -> Setpoint {
    let s = clamp(time / duration, 0.0, 1.0);
    let way = end - start;
    Setpoint {
        position: start + way * (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)),
        velocity: way * (30.0 * s * s * (1.0 - s) * (1.0 - s) / duration),
        acceleration: way * (60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (duration * duration)),
    }
}

/// Rolls and pitches in turn: shoulder, elbow and wrist, 1.1 m from the table to the tip, 11.4 kg.
fn arm(load_kg: f64) -> Chain<JOINTS> {
    // Height above the joint before, m; mass, kg; length of the link, m.
    let links = [
        (0.20, 3.0, 0.12),
        (0.12, 2.6, 0.20),
        (0.20, 1.9, 0.16),
        (0.16, 1.6, 0.18),
        (0.18, 1.1, 0.12),
        (0.12, 0.8, 0.08),
        (0.08, 0.4, 0.06),
    ];
    let bodies = std::array::from_fn(|link| {
        let (_, mass, length) = links[link];
        rod(mass, length, if link + 1 == JOINTS { load_kg } else { 0.0 })
    });
    // On a table, with its first axis upright.
    Chain::new(
        Pose::identity(),
        std::array::from_fn(|joint| {
            ChainJoint::new(
                Pose::at(0.0, 0.0, links[joint].0),
                ChainMotion::Revolute(if joint % 2 == 0 {
                    Vector3::z()
                } else {
                    Vector3::y()
                }),
            )
        }),
        bodies,
        Vector3::new(0.0, 0.0, links[JOINTS - 1].2),
    )
    .expect("the numbers above are those of an arm")
}

/// A round rod along z, 8 cm thick, with a point mass at its end.
fn rod(mass: f64, length: f64, load_kg: f64) -> ChainBody {
    let radius = 0.04;
    let along = mass * radius * radius / 2.0;
    let across = mass * (3.0 * radius * radius + length * length) / 12.0;
    let whole = mass + load_kg;
    let apart = mass * load_kg / whole * length * length / 4.0;
    let inertia = Vector3::new(across + apart, across + apart, along);
    ChainBody {
        mass: whole,
        center: Vector3::new(0.0, 0.0, length * (mass / 2.0 + load_kg) / whole),
        inertia: Matrix3::from_diagonal(&inertia),
    }
}

/// Direct drives: rotors without gears, and little friction.
fn drive() -> DriveDynamics<JOINTS> {
    DriveDynamics {
        armature: Joints::from([8.0, 8.0, 5.0, 5.0, 1.0, 1.0, 0.5]) * 1e-3,
        viscous: Joints::from([0.2, 0.2, 0.1, 0.1, 0.02, 0.02, 0.01]),
        coulomb: Joints::from([0.1, 0.1, 0.08, 0.08, 0.02, 0.02, 0.01]),
        coulomb_rate: Joints::repeat(0.05),
    }
}
