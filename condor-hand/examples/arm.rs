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
use condor_hand::dynamics::{Drive, Dynamics};
use condor_hand::kinematics::{Body, Chain, Joint, Motion};
use condor_hand::math::clamp;
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

/// What the controller does not know, and the errors that it may cause, degrees.
struct Trial {
    name: &'static str,
    load_kg: f64,
    moving_deg: f64,
    at_rest_deg: f64,
}

const TRIALS: [Trial; 2] = [
    Trial {
        name: "as the controller knows it",
        load_kg: 0.0,
        moving_deg: 0.05,
        at_rest_deg: 0.001,
    },
    Trial {
        name: "with 0.2 kg in the hand that it does not know",
        load_kg: 0.2,
        moving_deg: 3.0,
        at_rest_deg: 2.0,
    },
];

/// What a motion asks of the joints at one time.
struct Setpoint {
    position: Joints,
    velocity: Joints,
    acceleration: Joints,
}

struct Errors {
    moving: Joints,
    at_rest: Joints,
}

fn main() -> ExitCode {
    let start = Joints::from([0.0, 0.3, 0.0, -1.2, 0.0, 0.8, 0.0]);
    let end = Joints::from([1.0, -0.4, 0.5, -0.3, 0.9, -0.2, 1.5]);
    let mut passed = true;
    for trial in &TRIALS {
        let Some(errors) = run(trial.load_kg, &start, &end) else {
            eprintln!(
                "the arm {}: its mass matrix is not positive definite",
                trial.name
            );
            return ExitCode::FAILURE;
        };
        passed &= report(trial, &errors);
    }
    if passed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// The largest errors of one motion, rad.
fn run(load_kg: f64, start: &Joints, end: &Joints) -> Option<Errors> {
    let known = arm(0.0);
    let real = arm(load_kg);
    let drive = drive();
    let tick = 1.0 / f64::from(CONTROL_HZ);
    let step = tick / f64::from(STEPS_PER_TICK);

    let (mut q, mut qd) = (*start, Joints::zeros());
    let mut errors = Errors {
        moving: Joints::zeros(),
        at_rest: Joints::zeros(),
    };
    let mut time = 0.0;
    while time < MOVE_S + REST_S {
        let wanted = minimum_jerk(start, end, MOVE_S, time);
        let error = (wanted.position - q).abs();
        if time < MOVE_S {
            errors.moving = errors.moving.sup(&error);
        } else {
            // What counts is what is left at the end.
            errors.at_rest = error;
        }

        let torque = computed_torque(&known, &drive, &wanted, &q, &qd);
        for _ in 0..STEPS_PER_TICK {
            let moving = torque - drive.torque(&qd);
            qd += real.forward_dynamics(&q, &qd, &moving, &GRAVITY, &drive.armature)? * step;
            q += qd * step;
        }
        time += tick;
    }
    Some(errors)
}

/// The torques with which every joint corrects its error as if it were alone.
fn computed_torque(
    arm: &Chain<f64, JOINTS>,
    drive: &Drive<f64, JOINTS>,
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

fn report(trial: &Trial, errors: &Errors) -> bool {
    println!("The arm {}:", trial.name);
    println!("joint  largest error in motion  error at rest");
    let mut passed = true;
    let rows = errors.moving.iter().zip(&errors.at_rest);
    for (joint, (moving, at_rest)) in rows.enumerate() {
        let (moving, at_rest) = (moving.to_degrees(), at_rest.to_degrees());
        let within = moving <= trial.moving_deg && at_rest <= trial.at_rest_deg;
        let verdict = if within { "" } else { "  too large" };
        println!("{joint:>5}  {moving:>19.4} deg  {at_rest:>9.4} deg{verdict}");
        passed &= within;
    }
    println!(
        "bound  {:>19.4} deg  {:>9.4} deg\n",
        trial.moving_deg, trial.at_rest_deg
    );
    passed
}

/// Rolls and pitches in turn: shoulder, elbow and wrist, 1.1 m from the table to the tip, 11.4 kg.
fn arm(load_kg: f64) -> Chain<f64, JOINTS> {
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
    let mut bodies = links.map(|(_, mass, length)| rod(mass, length));
    if let Some(hand) = bodies.last_mut() {
        *hand = with_load(hand, load_kg, links[JOINTS - 1].2);
    }
    Chain {
        // On a table, with its first axis upright.
        base: Pose::identity(),
        joints: std::array::from_fn(|joint| Joint {
            placement: Pose::at(0.0, 0.0, links[joint].0),
            motion: Motion::Revolute(if joint % 2 == 0 {
                Vector3::z()
            } else {
                Vector3::y()
            }),
        }),
        bodies,
        tip: Vector3::new(0.0, 0.0, links[JOINTS - 1].2),
    }
}

/// A round rod along z, 8 cm thick.
fn rod(mass: f64, length: f64) -> Body {
    let radius = 0.04;
    let along = mass * radius * radius / 2.0;
    let across = mass * (3.0 * radius * radius + length * length) / 12.0;
    Body {
        mass,
        center: Vector3::new(0.0, 0.0, length / 2.0),
        inertia: Matrix3::from_diagonal(&Vector3::new(across, across, along)),
    }
}

/// The body with a point mass on its z axis.
fn with_load(body: &Body, load_kg: f64, height: f64) -> Body {
    let mass = body.mass + load_kg;
    let apart = height - body.center.z;
    let across = body.mass * load_kg / mass * apart * apart;
    Body {
        mass,
        center: body.center + Vector3::new(0.0, 0.0, apart * load_kg / mass),
        inertia: body.inertia + Matrix3::from_diagonal(&Vector3::new(across, across, 0.0)),
    }
}

/// Direct drives: rotors without gears, and little friction.
fn drive() -> Drive<f64, JOINTS> {
    Drive {
        armature: Joints::from([8.0, 8.0, 5.0, 5.0, 1.0, 1.0, 0.5]) * 1e-3,
        viscous: Joints::from([0.2, 0.2, 0.1, 0.1, 0.02, 0.02, 0.01]),
        coulomb: Joints::from([0.1, 0.1, 0.08, 0.08, 0.02, 0.02, 0.01]),
        coulomb_rate: Joints::repeat(0.05),
    }
}
