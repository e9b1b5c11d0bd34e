//! A run of `MuJoCo` on the hand of the reference files, tension commands in, joints out.

use condor_hand::config::JointFriction;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::max;
use condor_hand::plant::{
    DriveKind, FingerParameters, JointParameters, SimDrive, SimFinger, SimStop,
};
use condor_hand::transmission::Linear;
use nalgebra::{SVector, Vector3};
use serde::Deserialize;

use crate::support::{FINGERS, Geometry, geometry, joints, largest_step, reference, vector};

#[derive(Deserialize)]
struct Trace {
    meta: Meta,
    tension_cmd: Vec<Vec<f64>>,
    state: Vec<State>,
}

#[derive(Deserialize)]
struct Meta {
    armature: f64,
    damping: f64,
    joint_stiffness: f64,
    springref: [f64; 4],
    q0: [f64; 16],
    rate: f64,
}

#[derive(Deserialize)]
struct State {
    q: Vec<f64>,
    qd: Vec<f64>,
    f: Vec<f64>,
}

/// The actuators of the model: 20 Hz.
const TIME_CONSTANT_S: f64 = 1.0 / (40.0 * std::f64::consts::PI);

/// The stops of the program are other than ours, and act from 2 degrees before a limit on.
const MARGIN: f64 = 2.0 * std::f64::consts::PI / 180.0;

fn finger(
    geometry: &Geometry,
    meta: &Meta,
    number: usize,
    kind: DriveKind,
) -> SimFinger<PlanarFinger, Linear<4, 8>, 4, 8> {
    let drive = SimDrive {
        low: 0.0,
        high: geometry.fmax,
        kind,
    };
    let parameters = FingerParameters {
        joints: (0..4)
            .map(|joint| JointParameters {
                friction: JointFriction {
                    armature: meta.armature,
                    viscous: meta.damping,
                    coulomb_rate: 0.01,
                    ..JointFriction::default()
                },
                stiffness: meta.joint_stiffness,
                rest: meta.springref[joint],
                range: (geometry.qmin[joint], geometry.qmax[joint]),
                stop: SimStop {
                    stiffness: 5.0,
                    damping: 0.01,
                },
            })
            .collect(),
        drives: [drive; 8].into(),
    };
    SimFinger::new(
        geometry.finger(number),
        geometry.symmetric_tendons(),
        parameters,
        joints(&meta.q0, number),
    )
    .unwrap()
}

fn command(all: &[f64], finger: usize) -> [f64; 8] {
    std::array::from_fn(|tendon| all[8 * finger + tendon])
}

fn clear_of_limits(geometry: &Geometry, q: &SVector<f64, 4>) -> bool {
    let limits = geometry.qmin.iter().zip(&geometry.qmax);
    q.iter()
        .zip(limits)
        .all(|(q, (low, high))| low + MARGIN < *q && *q < high - MARGIN)
}

/// What a run differs by from the trace, at most.
#[derive(Debug, Default)]
struct Difference {
    q: f64,
    qd: f64,
    tension: f64,
    states: usize,
}

/// Until a joint first comes near a limit.
fn replay(number: usize, kind: DriveKind, updates: u32) -> Difference {
    let geometry = geometry();
    let trace: Trace = reference("plant_trace.json");
    let gravity: Vector3<f64> = vector(geometry.gravity);
    let mut finger = finger(&geometry, &trace.meta, number, kind);
    let every = trace.tension_cmd.len() / trace.state.len();
    let mut difference = Difference::default();
    for (tick, commands) in trace.tension_cmd.iter().enumerate() {
        let commands = command(commands, number);
        finger
            .step(1.0 / trace.meta.rate, updates, &commands, &gravity)
            .unwrap();
        if tick % every != 0 {
            continue;
        }
        let state = &trace.state[tick / every];
        let q = joints(&state.q, number);
        if !clear_of_limits(&geometry, &q) {
            break;
        }
        let qd = joints(&state.qd, number);
        difference.states += 1;
        difference.q = max(difference.q, (finger.q() - q).amax());
        difference.qd = max(difference.qd, (finger.qd() - qd).amax());
        let expected = command(&state.f, number);
        let tension = largest_step(finger.efforts(), &expected);
        difference.tension = max(difference.tension, tension);
    }
    difference
}

#[test]
fn the_run_of_mujoco_is_followed_to_rounding() {
    let time_constant_s = TIME_CONSTANT_S;
    for number in 0..FINGERS {
        let difference = replay(number, DriveKind::Euler { time_constant_s }, 5);
        assert!(difference.states >= 50, "finger {number}: {difference:?}");
        assert!(difference.q < 1e-9, "finger {number}: {difference:?}");
        assert!(difference.qd < 1e-7, "finger {number}: {difference:?}");
        assert!(difference.tension < 1e-6, "finger {number}: {difference:?}");
    }
}

#[test]
fn a_finer_integration_differs_by_what_that_of_mujoco_leaves_out() {
    let time_constant_s = TIME_CONSTANT_S;
    for number in 0..FINGERS {
        let fine = replay(number, DriveKind::Exact { time_constant_s }, 25);
        assert!(fine.q < 1e-3, "finger {number}: {fine:?}");
    }
}

#[test]
fn a_finer_integration_converges_at_first_order() {
    let time_constant_s = TIME_CONSTANT_S;
    let geometry = geometry();
    let trace: Trace = reference("plant_trace.json");
    let gravity: Vector3<f64> = vector(geometry.gravity);
    let [coarse, fine, finest] = [25, 50, 400].map(|updates| {
        let kind = DriveKind::Exact { time_constant_s };
        let mut finger = finger(&geometry, &trace.meta, 1, kind);
        for commands in &trace.tension_cmd[..80] {
            let commands = command(commands, 1);
            finger.step(2.5e-3, updates, &commands, &gravity).unwrap();
        }
        *finger.q()
    });
    let ratio = (coarse - finest).norm() / (fine - finest).norm();
    // 1/25 - 1/400 to 1/50 - 1/400.
    assert!((ratio - 15.0 / 7.0).abs() < 0.2, "{ratio}");
    assert!((fine - finest).norm() < 1e-3);
}
