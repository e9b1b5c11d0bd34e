use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::plant::{
    self, AxisParameters, DriveKind, ObjectParameters, PlantModel, Pneumatic, SimObject, SimStop,
    SimSurface,
};
use condor_hand::servo::{FingerReadings, JointGains, JointTarget, PositionLaw, ServoMode};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::{Linear, Transmission};
use condor_hand::{config, kinematics::PlanarFinger};
use nalgebra::{SVector, Vector3};

use crate::Shipped;
use crate::corpus::{Between, HOSTILE};
use crate::digest::Digest;
use crate::grasping::POSTURES;

type Finger = config::Finger<4, 8>;

/// Controls a finger through all modes and gains, with sensors that fail, to a fault and back.
pub(crate) fn finger(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let finger = hand.fingers.first()?;
    ticks(digest, hand, finger, finger.planar()?)?;
    ticks(digest, hand, finger, finger.chain())
}

fn ticks(
    digest: &mut Digest,
    hand: &Shipped,
    finger: &Finger,
    mechanism: impl Dynamics<4>,
) -> Option<()> {
    let mut controller =
        FingerController::new(hand, finger, mechanism, finger.transmission().ok()?).ok()?;
    let gravity = Vector3::from(hand.gravity);
    let period_s = 1.0 / f64::from(hand.servo_hz);
    let mut between = Between::seeded(10);
    let mut sensed = FingerReadings {
        position: SVector::from([0.1, 0.6, 0.8, 0.7]),
        actuator_position: [0.0; 8],
        effort: finger.efforts_at_rest(),
        touch: 0.0,
    };
    for number in 0..800_u32 {
        for joint in 0..4 {
            change(digest, &mut controller, number, joint, &mut between);
        }
        if number % 8 == 0 && (200..320).contains(&number) {
            let share = f64::from(number - 200) / 120.0;
            let points = [0.1, 0.6, 0.8, 0.7].map(|start| SetPoint {
                position: start + 0.2 * share,
                velocity: 0.2 / 0.3,
                acceleration: 0.0,
            });
            let followed = controller.follow(&points, &[StopGuard::NONE; 4]);
            digest.answer(followed.ok());
        }
        if number == 600 {
            controller.clear();
        }
        let mut said = sensed;
        // A few lost samples are no fault yet; from 400 on a sensor is dead.
        if number % 40 == 39 || (400..500).contains(&number) {
            let hostile = HOSTILE.into_iter().cycle().nth(number as usize / 40)?;
            said.position.x = hostile;
            let [first, ..] = &mut said.effort;
            *first = hostile;
        }
        let tick = controller.tick(&said, &gravity, period_s);
        digest.numbers(&tick.output.command);
        digest.numbers(&tick.output.effort);
        digest.numbers(&tick.output.torque);
        digest.numbers(&tick.output.position);
        digest.numbers(&tick.output.velocity);
        digest.bits(u64::from(tick.output.saturated));
        for target in tick.target {
            if let Some(target) = digest.answer(target) {
                digest.number(target);
            }
        }
        if let Some(fault) = digest.answer(tick.fault) {
            // The value that a sensor measured.
            digest.reading(fault.value);
        }
        // The actuators follow, and the joints wander.
        sensed.effort = tick.output.effort;
        sensed.position += between.vector(-1e-3, 1e-3);
    }
    Some(())
}

/// Changes a joint as a user does before a tick.
fn change<M: Dynamics<4>, T: Transmission<4, 8>>(
    digest: &mut Digest,
    controller: &mut FingerController<M, T, 4, 8>,
    number: u32,
    joint: usize,
    between: &mut Between,
) {
    let mode = match number {
        10 | 120 => Some(ServoMode::Torque),
        30 => Some(ServoMode::Effort),
        50 | 650 => Some(ServoMode::Position),
        150 => Some(ServoMode::Grasp),
        172 => Some(ServoMode::Impedance),
        180 => Some(ServoMode::Position),
        700 => Some(ServoMode::Off),
        _ => None,
    };
    if let Some(mode) = mode {
        let changed = controller.set_mode(joint, mode);
        digest.answer(changed.ok());
    }
    let target = match number {
        20 | 130 => Some(JointTarget::Torque(between.one(-0.3, 0.3))),
        60 | 100 => Some(JointTarget::Position(SetPoint::rest(between.one(0.1, 0.4)))),
        160 => Some(JointTarget::Grasp(between.one(-0.3, 0.3))),
        170 => Some(JointTarget::Grasp(f64::NAN)),
        175 => Some(JointTarget::Impedance {
            position: between.one(0.1, 0.4),
            stiffness: between.one(0.0, 0.1),
            damping: between.one(0.0, 0.003),
        }),
        _ => None,
    };
    if let Some(target) = target {
        let changed = controller.set_target(joint, target);
        digest.answer(changed.ok());
    }
    if number == 40 {
        for actuator in [2 * joint, 2 * joint + 1] {
            let changed = controller.set_effort(actuator, between.one(4.0, 60.0));
            digest.answer(changed.ok());
        }
    }
    if (number == 80 || number == 690)
        && let Some(&gains) = controller.gains(joint)
    {
        let law = PositionLaw::Pd {
            kp: between.one(0.5, 3.0),
            kv: 0.03,
            ki: 1.0,
            integral_nm: 0.1,
        };
        let changed = controller.set_gains(joint, &JointGains { law, ..gains });
        digest.answer(changed.ok());
    }
}

const FINGERS: usize = 4;
const LOOPS: u32 = 120;

type Simulated = plant::SimHand<PlanarFinger, Actuators, FINGERS, 4, 8>;
type Actuators = Linear<4, 8>;

/// Controls four fingers on a table that close about a ball, by what converters read of them.
pub(crate) fn hand(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let mut simulated = simulated(hand)?;
    let mut fingers = hand.fingers.iter();
    let [first, second, third, fourth] = [(); FINGERS].map(|()| controller(hand, fingers.next()));
    let mut controllers = [first?, second?, third?, fourth?];
    let gravity = Vector3::from(hand.gravity);
    let period_s = 1.0 / f64::from(hand.servo_hz);
    let mut commands = [[4.0; 8]; FINGERS];
    for number in 0..LOOPS {
        let parts = controllers.iter_mut().zip(&hand.fingers);
        let parts = parts.zip(simulated.fingers());
        for (command, ((controller, described), finger)) in commands.iter_mut().zip(parts) {
            let sensed = sense(digest, described, finger);
            if number % 8 == 0 {
                let closing = 0.002 * f64::from(number / 8);
                let points = finger_points(closing);
                let followed = controller.follow(&points, &[StopGuard::NONE; 4]);
                digest.answer(followed.ok());
            }
            let tick = controller.tick(&sensed, &gravity, period_s);
            digest.bits(u64::from(tick.fault.is_some()));
            *command = tick.output.command;
            digest.numbers(&*command);
        }
        simulated.step(&commands).ok()?;
        observe(digest, &simulated);
    }
    Some(())
}

/// Returns the set-points of all joints.
fn finger_points(closing: f64) -> [SetPoint; 4] {
    [0.0, 0.85 + closing, 0.8 + closing, 0.55].map(SetPoint::rest)
}

fn controller(
    hand: &Shipped,
    finger: Option<&Finger>,
) -> Option<FingerController<PlanarFinger, Actuators, 4, 8>> {
    let finger = finger?;
    let mut controller =
        FingerController::new(hand, finger, finger.planar()?, finger.transmission().ok()?).ok()?;
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).ok()?;
    }
    Some(controller)
}

/// Returns the readings of the converters of a finger.
fn sense(
    digest: &mut Digest,
    described: &Finger,
    finger: &plant::SimFinger<PlanarFinger, Actuators, 4, 8>,
) -> FingerReadings<4, 8> {
    let mut sensed = finger.readings();
    for (joint, position) in described.joints.iter().zip(sensed.position.iter_mut()) {
        if let Some(adc) = &joint.adc {
            *position = adc.value(adc.counts(*position));
        }
        digest.reading(*position);
    }
    for (actuator, effort) in described.actuators.iter().zip(&mut sensed.effort) {
        if let Some(adc) = &actuator.adc {
            *effort = adc.value(adc.counts(*effort));
            digest.reading(*effort);
        }
    }
    sensed
}

/// Adds the whole state.
fn observe(digest: &mut Digest, simulated: &Simulated) {
    for finger in simulated.fingers() {
        digest.numbers(finger.q());
        digest.numbers(finger.qd());
        digest.numbers(finger.efforts());
    }
    for contact in simulated.object_contacts() {
        digest.bits(u64::from(contact.is_touching) | u64::from(contact.is_sliding) << 1);
        digest.numbers(&contact.force);
    }
    if let Some(object) = simulated.object() {
        digest.numbers(&object.pose().position);
        digest.numbers(&object.orientation().coords);
        digest.numbers(object.velocity());
        digest.numbers(&object.angular_velocity());
    }
    if let Some(table) = simulated.table() {
        digest.numbers(table.position());
        digest.numbers(table.velocity());
        digest.numbers(table.acceleration());
    }
}

fn simulated(hand: &Shipped) -> Option<Simulated> {
    let model = |actuator| PlantModel {
        actuator,
        joint_stop: SimStop {
            stiffness: 5.0,
            damping: 0.05,
        },
        axis_stop: SimStop {
            stiffness: 1e4,
            damping: 100.0,
        },
        updates: 10,
        tip_radius: 0.008,
        surface: SimSurface {
            stiffness: 2e4,
            damping: 20.0,
            shear_stiffness: 2e4,
            shear_damping: 20.0,
            friction: 0.6,
        },
    };
    let actuators: [fn(f64) -> DriveKind; FINGERS] = [
        DriveKind::euler,
        DriveKind::exact,
        |_| cylinder(2e-6),
        |_| cylinder(1e-5),
    ];
    let described = hand.fingers.iter().zip(actuators).zip(POSTURES);
    let mut fingers = described.map(|((finger, actuator), posture)| {
        let model = model(actuator);
        let transmission = finger.transmission().ok()?;
        model
            .finger(finger, finger.planar()?, transmission, posture.into())
            .ok()
    });
    let [first, second, third, fourth] = [(); FINGERS].map(|()| fingers.next().flatten());
    let axis = AxisParameters {
        mass: 10.0,
        viscous: 20.0,
        max_n: 200.0,
        range: (-0.2, 0.2),
        stop: SimStop {
            stiffness: 1e4,
            damping: 100.0,
        },
    };
    let ball = SimObject::new(
        ObjectParameters::ball(0.1, 0.03),
        Vector3::new(0.07, 0.005, -0.06),
    );
    let parameters = model(DriveKind::exact).hand_parameters(hand);
    let mut simulated = Simulated::new([first?, second?, third?, fourth?], parameters)
        .ok()?
        .with_object(ball.ok()?)
        .with_table(plant::SimTable::new([axis; 3]).ok()?);
    simulated.drive_table(Vector3::new(3.0, -2.0, 500.0)).ok()?;
    Some(simulated)
}

fn cylinder(volume_m3: f64) -> DriveKind {
    DriveKind::Pneumatic(Pneumatic {
        area_m2: 2.355e-4,
        valve_hz: 60.0,
        valve_damping: 0.7,
        fill_s: 0.008,
        heat_ratio: 1.4,
        atmosphere_pa: 101_325.0,
        volume_m3,
        viscous: 5.0,
        coulomb_n: 0.3,
        fade: 0.01,
    })
}
