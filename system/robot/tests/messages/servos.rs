//! Tests of servos that are asked by message.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::fault::{FaultCode, FaultPlace};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::{FingerReadings, JointTarget, ServoMode, ServoRefusal, TargetQuantity};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::Linear;
use condor_mbox::exchange::ExchangeError;
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    Allocator, Call, CriticalSection, MailboxError, MemoryWindow, Messenger, Offset, Processor,
    Region, SingleContext, Vector,
};
use condor_robot::message::{
    HandIdentity, HandLoop, OrderPart, SERVO, ServoClient, ServoLayout, ServoObject, ServoRequest,
    ServoRequestPacket, ServoResponse, ServoResponsePacket,
};
use condor_robot::packet::{self, ClientError};
use nalgebra::{Vector3, Vector4};
use proptest::prelude::*;

const MASTER: Processor = Processor(0);
const REMOTE: Processor = Processor(1);
const SECOND: Duration = Duration::from_secs(1);
const PERIOD_S: f64 = 1.0 / 400.0;
const DATA_BYTES: u32 = 8192;

type Servos = HandLoop<'static, PlanarFinger, Linear<4, 8>, SimWindow, 2, 4, 8>;
type Client<'m> = ServoClient<'m, SimMailbox<'static, 2>, SimWindow, 2, 4>;

fn hand() -> Hand<4, 4, 8> {
    let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
    let mut hand = Hand::from_toml(text, "hands/utah-mit.toml").unwrap();
    // The sensors of these tests stay where they are.
    hand.faults.frozen_rad = 10.0;
    hand
}

fn sensed() -> FingerReadings<4, 8> {
    FingerReadings {
        position: Vector4::new(0.1, 0.6, 0.8, 0.7),
        actuator_position: [0.0; 8],
        effort: [4.0; 8],
        touch: 0.0,
    }
}

/// A system of a master and two fingers, whose sensors say what was commanded.
struct Rig {
    system: SimSystem<2>,
    layout: ServoLayout<2, 4>,
    fingers: Arc<Mutex<(Servos, [FingerReadings<4, 8>; 2])>>,
    /// In virtual time: whether the loop runs while the master waits.
    ticking: Arc<AtomicBool>,
    master: SimMailbox<'static, 2>,
}

fn tick(fingers: &Mutex<(Servos, [FingerReadings<4, 8>; 2])>) {
    let (servos, sensed) = &mut *fingers.lock().unwrap();
    for (finger, sensed) in sensed.iter_mut().enumerate() {
        let gravity = Vector3::new(0.0, 0.0, -9.81);
        let tick = servos.tick(finger, sensed, &gravity, PERIOD_S).unwrap();
        sensed.effort = tick.output.effort;
    }
}

impl Rig {
    /// The servos and their mailbox, which has not been asked to serve.
    fn parts(system: SimSystem<2>) -> (Self, SimMailbox<'static, 2>) {
        let hand = hand();
        let [_, windows] = system.windows(REMOTE);
        let ram = Region::users(windows.data).unwrap();
        let layout = ServoLayout::new(&mut Allocator::new(ram.size()), 2).unwrap();
        let names = [&hand.fingers[0].name, &hand.fingers[1].name];
        let identity = HandIdentity::new(
            &hand.name,
            names.map(condor_hand::config::Name::as_str),
            hand.servo_hz,
        );
        let controllers = [0, 1].map(|finger| {
            let finger = &hand.fingers[finger];
            let (planar, actuators) = (finger.planar().unwrap(), finger.transmission().unwrap());
            Some(FingerController::new(&hand, finger, planar, actuators).unwrap())
        });
        let object = Box::leak(Box::new(ServoObject::new()));
        let (handler, servos) = object
            .split(identity, &ram, layout, CriticalSection, controllers)
            .unwrap();
        let mut remote = system.mailbox(REMOTE).unwrap();
        let handler = Box::leak(Box::new(move |call: &Call<'_>| handler.answer(call)));
        remote.set_vector(SERVO, handler, "servos").unwrap();
        remote.join().unwrap();
        let master = system.mailbox(MASTER).unwrap();
        let rig = Self {
            system,
            layout,
            fingers: Arc::new(Mutex::new((servos, [sensed(), sensed()]))),
            ticking: Arc::new(AtomicBool::new(true)),
            master,
        };
        (rig, remote)
    }

    fn in_virtual_time() -> Self {
        let (mut rig, remote) = Self::parts(SimSystem::in_virtual_time(DATA_BYTES));
        let (fingers, ticking) = (Arc::clone(&rig.fingers), Arc::clone(&rig.ticking));
        rig.system.while_waiting(REMOTE, move || {
            remote.serve(Duration::ZERO).unwrap();
            if ticking.load(Ordering::Relaxed) {
                tick(&fingers);
            }
        });
        rig.master.join().unwrap();
        rig
    }

    fn ram(&self) -> Region<SimWindow> {
        let [_, windows] = self.system.windows(MASTER);
        Region::users(windows.data).unwrap()
    }

    fn client(&self) -> Client<'_> {
        ServoClient::new(&self.master, REMOTE, &self.ram(), self.layout).unwrap()
    }

    /// A request that no client sends, and what comes back.
    fn raw(&self, request: ServoRequest) -> ServoResponse<4> {
        let blocks = self.layout.blocks();
        let mut exchange = blocks.client(&self.master, &self.ram()).unwrap();
        packet::ask(&mut exchange, REMOTE, SERVO, &request, SECOND).unwrap()
    }

    fn modes(&self, finger: usize) -> [ServoMode; 4] {
        let servos = &self.fingers.lock().unwrap().0;
        core::array::from_fn(|joint| servos.controller(finger).unwrap().mode(joint).unwrap())
    }

    fn ticks(&self, count: usize) {
        for _ in 0..count {
            tick(&self.fingers);
        }
    }
}

#[test]
fn a_processor_says_which_servos_it_has() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    for (number, finger) in hand().fingers.iter().take(2).enumerate() {
        let hello = client.hello(number as u32, SECOND).unwrap();
        assert_eq!(
            (hello.hand, hello.finger),
            (hand().name, finger.name.clone())
        );
        assert_eq!((hello.served, hello.joints, hello.servo_hz), (0b11, 4, 400));
    }
    let refused = client.hello(2, SECOND).unwrap_err();
    let (finger, served) = (2, 0b11);
    assert_eq!(
        refused,
        ClientError::Refused(ServoRefusal::NoFinger { finger, served })
    );
}

#[test]
fn servos_are_enabled_and_disabled() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    client
        .enable(1, Some(2), ServoMode::Torque, SECOND)
        .unwrap();
    assert_eq!(rig.modes(1)[2], ServoMode::Torque);
    client.enable(1, None, ServoMode::Position, SECOND).unwrap();
    assert_eq!(rig.modes(1), [ServoMode::Position; 4]);
    assert_eq!(rig.modes(0), [ServoMode::Off; 4]);
    client.disable(1, Some(0), SECOND).unwrap();
    let status = client.status(1, SECOND).unwrap();
    let position = ServoMode::Position;
    assert_eq!(
        status.modes.as_slice(),
        [ServoMode::Off, position, position, position]
    );
    assert_eq!((status.fault, status.is_resting), (None, false));
    let before = status.ticks;
    rig.ticks(10);
    assert!(client.status(1, SECOND).unwrap().ticks.wrapping_sub(before) >= 10);
    assert_eq!(
        client.enable(1, Some(4), ServoMode::Torque, SECOND),
        Err(ClientError::Refused(ServoRefusal::NoJoint {
            joint: 4,
            joints: 4
        }))
    );
}

#[test]
fn targets_beyond_what_a_joint_has_come_back_with_its_limits() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    let limits = hand().fingers[0].joints[1].limits;
    let point = SetPoint::rest(0.7);
    for target in [
        JointTarget::Position(point),
        JointTarget::Torque(0.01),
        JointTarget::Grasp(-0.01),
        JointTarget::Impedance {
            position: 0.7,
            stiffness: 0.05,
            damping: 0.0,
        },
        JointTarget::Effort,
        JointTarget::Off,
    ] {
        client.set_target(0, 1, &target, SECOND).unwrap();
        assert_eq!(rig.modes(0)[1], target.mode());
    }
    client
        .set_target(0, 1, &JointTarget::Position(point), SECOND)
        .unwrap();
    let position = 9.5;
    let refused = client.set_target(
        0,
        1,
        &JointTarget::Position(SetPoint::rest(position)),
        SECOND,
    );
    assert_eq!(
        refused,
        Err(ClientError::Refused(ServoRefusal::Target {
            joint: 1,
            quantity: TargetQuantity::Position,
            value: position,
            low: limits.low,
            high: limits.high
        }))
    );
    let refused = client.set_target(0, 1, &JointTarget::Torque(1e3), SECOND);
    assert!(
        matches!(refused, Err(ClientError::Refused(ServoRefusal::Target { value, quantity: TargetQuantity::Torque, .. })) if value > 999.0),
        "{refused:?}"
    );
    let refused = client.set_target(0, 1, &JointTarget::Torque(f64::NAN), SECOND);
    assert!(
        matches!(refused, Err(ClientError::Refused(ServoRefusal::Target { value, .. })) if value.is_nan()),
        "{refused:?}"
    );
    assert_eq!(rig.modes(0)[1], ServoMode::Position);
}

#[test]
fn an_order_is_not_done_before_the_next_tick() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    rig.ticking.store(false, Ordering::Relaxed);
    let short = Duration::from_millis(2);
    let not_done = client.enable(0, Some(2), ServoMode::Torque, short);
    assert!(
        matches!(not_done, Err(ClientError::NotDone { to: REMOTE, timeout, .. }) if timeout == short),
        "{not_done:?}"
    );
    assert_eq!(rig.modes(0), [ServoMode::Off; 4]);
    rig.ticks(1);
    assert_eq!(rig.modes(0)[2], ServoMode::Torque);
}

#[test]
fn a_fault_is_told_and_cleared_and_does_not_come_back_to_life() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    client.enable(0, None, ServoMode::Torque, SECOND).unwrap();
    rig.fingers.lock().unwrap().1[0].position[3] = f64::NAN;
    rig.ticks(50);
    let status = client.status(0, SECOND).unwrap();
    let fault = status.fault.unwrap();
    assert_eq!(fault.code, FaultCode::NotFinite);
    assert_eq!(fault.place, FaultPlace::Joint(3));
    assert!(status.is_resting);
    assert_eq!(status.modes.as_slice(), [ServoMode::Off; 4]);
    assert_eq!(client.status(1, SECOND).unwrap().fault, None);

    let refused = client.enable(0, None, ServoMode::Torque, SECOND);
    assert_eq!(refused, Err(ClientError::Refused(ServoRefusal::AfterFault)));
    rig.fingers.lock().unwrap().1[0].position[3] = 0.7;
    // Two restarts between two ticks are one clearing, and count twice.
    rig.ticking.store(false, Ordering::Relaxed);
    for _ in 0..2 {
        let restart = rig.raw(ServoRequest::Restart { finger: 0 });
        assert!(matches!(restart, ServoResponse::Ordered(_)), "{restart:?}");
    }
    rig.ticks(1);
    rig.ticking.store(true, Ordering::Relaxed);
    assert_eq!(client.status(0, SECOND).unwrap().restarts, 2);
    client.restart(0, SECOND).unwrap();
    rig.ticks(400);
    let status = client.status(0, SECOND).unwrap();
    assert_eq!((status.fault, status.is_resting), (None, false));
    assert_eq!(status.restarts, 3);
    // What was refused is not done later.
    assert_eq!(status.modes.as_slice(), [ServoMode::Off; 4]);
    client.enable(0, None, ServoMode::Torque, SECOND).unwrap();
}

#[test]
fn an_order_that_another_one_replaced_says_so() {
    let rig = Rig::in_virtual_time();
    rig.ticking.store(false, Ordering::Relaxed);
    let finger = 0;
    let order = |joint, mode| {
        let mode = ServoRequest::Mode {
            finger,
            joint,
            mode,
        };
        match rig.raw(mode) {
            ServoResponse::Ordered(number) => number,
            other => panic!("{other:?}"),
        }
    };
    let outcome = |joint, order| {
        let part = OrderPart::Drive(joint);
        rig.raw(ServoRequest::Outcome {
            finger,
            part,
            order,
        })
    };
    let first = order(Some(1), ServoMode::Torque);
    let second = order(None, ServoMode::Effort);
    assert_eq!(second, first + 1);
    for number in [first, second] {
        assert_eq!(outcome(Some(1), number), ServoResponse::Pending);
    }
    rig.ticks(1);
    assert_eq!(outcome(Some(1), first), ServoResponse::Superseded);
    assert_eq!(outcome(None, second), ServoResponse::Done);
    assert_eq!(rig.modes(0), [ServoMode::Effort; 4]);
}

#[test]
fn an_effort_is_that_of_one_actuator_of_its_joint() {
    let rig = Rig::in_virtual_time();
    let mut client = rig.client();
    client.set_effort(0, 1, (2, 12.0), SECOND).unwrap();
    client.set_effort(0, 1, (3, 9.0), SECOND).unwrap();
    assert_eq!(rig.modes(0)[1], ServoMode::Effort);
    // The change takes a tenth of a second.
    rig.ticks(50);
    let efforts = rig.fingers.lock().unwrap().1[0].effort;
    assert_eq!(efforts[..4], [4.0, 4.0, 12.0, 9.0]);
    let refused = client.set_effort(0, 1, (2, 1e3), SECOND);
    assert_eq!(
        refused,
        Err(ClientError::Refused(ServoRefusal::Effort {
            actuator: 2,
            value: 1e3,
            low: 4.0,
            high: 130.0
        }))
    );
    for (joint, actuator) in [(0, 2), (1, 9), (1, u32::MAX)] {
        let refused = client.set_effort(0, joint, (actuator, 9.0), SECOND);
        assert_eq!(
            refused,
            Err(ClientError::Refused(ServoRefusal::NoActuator {
                actuator,
                actuators: 8
            }))
        );
    }
    assert_eq!(rig.modes(0)[0], ServoMode::Off);
}

#[test]
fn the_masters_set_points_are_followed_without_messages() {
    let rig = Rig::in_virtual_time();
    let mut set_points = rig.layout.set_points(0, &rig.ram()).unwrap();
    assert!(rig.layout.set_points(2, &rig.ram()).is_err());
    let mut client = rig.client();
    client.enable(0, None, ServoMode::Position, SECOND).unwrap();
    rig.ticking.store(false, Ordering::Relaxed);
    let start = sensed().position;
    for step in 1..=20 {
        let moved = start[1] + 0.002 * f64::from(step);
        let mut points: [_; 4] = core::array::from_fn(|joint| SetPoint::rest(start[joint]));
        points[1] = SetPoint {
            position: moved,
            velocity: 0.1,
            acceleration: 0.0,
        };
        set_points.publish(&points, &[StopGuard::NONE; 4]).unwrap();
        rig.ticks(8);
    }
    let (servos, sensed) = &mut *rig.fingers.lock().unwrap();
    let tick = servos
        .tick(0, &sensed[0], &Vector3::new(0.0, 0.0, -9.81), PERIOD_S)
        .unwrap();
    assert!(
        (tick.target[1].unwrap() - start[1] - 0.04).abs() < 0.01,
        "{tick:?}"
    );
    assert!((tick.target[2].unwrap() - start[2]).abs() < 1e-6);
}

#[test]
fn set_points_that_are_not_finite_are_refused_and_counted() {
    let rig = Rig::in_virtual_time();
    let mut set_points = rig.layout.set_points(1, &rig.ram()).unwrap();
    let mut client = rig.client();
    client.enable(1, None, ServoMode::Position, SECOND).unwrap();
    for _ in 0..3 {
        set_points
            .publish(&[SetPoint::rest(f64::NAN); 4], &[StopGuard::NONE; 4])
            .unwrap();
        rig.ticks(2);
    }
    let status = client.status(1, SECOND).unwrap();
    assert_eq!(status.refused_set_points, 3);
    assert_eq!(status.modes.as_slice(), [ServoMode::Position; 4]);
}

#[test]
fn a_message_with_another_offset_is_refused() {
    let rig = Rig::in_virtual_time();
    let mine = rig.layout.blocks().block(MASTER).unwrap();
    let others = rig.layout.blocks().block(REMOTE).unwrap();
    assert_eq!(rig.layout.blocks().block(Processor(2)), None);
    for offset in [0, mine - 4, mine + 1, others, DATA_BYTES, u32::MAX] {
        let reply = rig.master.send_with_reply(REMOTE, SERVO, offset, SECOND);
        assert_eq!(reply, Ok(0), "{offset:#x}");
    }
}

#[test]
fn places_that_are_not_there_are_errors() {
    let rig = Rig::in_virtual_time();
    let small = Region::users(rig.system.windows(MASTER)[1].data.clone()).unwrap();
    let small = small.part(0, 576).unwrap();
    assert!(ServoLayout::<2, 4>::new(&mut Allocator::new(small.size()), 2).is_err());
    assert!(ServoClient::new(&rig.master, REMOTE, &small, rig.layout).is_err());
    let mut object = ServoObject::<2, 4>::new();
    let hand = hand();
    let controllers = [0, 1].map(|finger| {
        let finger = &hand.fingers[finger];
        let actuators = finger.transmission().unwrap();
        Some(FingerController::new(&hand, finger, finger.chain(), actuators).unwrap())
    });
    let identity = HandIdentity::new("a", ["b", "c"], 400);
    let split = object.split(
        identity,
        &small,
        rig.layout,
        SingleContext::new(),
        controllers,
    );
    assert!(split.is_err());
}

#[test]
fn a_processor_without_servos_is_an_error_with_its_number() {
    let rig = Rig::in_virtual_time();
    let reply = rig.master.send_with_reply(REMOTE, Vector(9), 0, SECOND);
    assert!(matches!(
        reply,
        Err(MailboxError::NoHandler { to: REMOTE, .. })
    ));
    rig.system.stall(REMOTE, true);
    let stalled = rig.client().status(0, SECOND);
    assert!(
        matches!(
            stalled,
            Err(ClientError::Exchange(ExchangeError::Mailbox(
                MailboxError::Stalled { to: REMOTE, .. }
            )))
        ),
        "{stalled:?}"
    );
}

/// Requests that are often nearly right.
fn request() -> impl Strategy<Value = ServoRequest> {
    let number = || prop_oneof![4 => 0..6_u32, 1 => any::<u32>()];
    let joint = || prop::option::of(number());
    let mode = prop::sample::select(&ServoMode::ALL);
    let size = || prop_oneof![2 => -1.0..10.0, 1 => any::<f64>()];
    let target = (size(), size(), size()).prop_flat_map(|(a, b, c)| {
        prop::sample::select(vec![
            JointTarget::Off,
            JointTarget::Torque(a),
            JointTarget::Grasp(a),
            JointTarget::Effort,
            JointTarget::Position(SetPoint {
                position: a,
                velocity: b,
                acceleration: c,
            }),
            JointTarget::Impedance {
                position: a,
                stiffness: b,
                damping: c,
            },
        ])
    });
    let part = prop_oneof![Just(OrderPart::Faults), joint().prop_map(OrderPart::Drive)];
    prop_oneof![
        number().prop_map(|finger| ServoRequest::Hello { finger }),
        number().prop_map(|finger| ServoRequest::Status { finger }),
        number().prop_map(|finger| ServoRequest::Restart { finger }),
        (number(), joint(), mode).prop_map(|(finger, joint, mode)| ServoRequest::Mode {
            finger,
            joint,
            mode,
        }),
        (number(), joint(), target).prop_map(|(finger, joint, target)| ServoRequest::Target {
            finger,
            joint,
            target,
        }),
        (number(), number(), number(), size()).prop_map(|(finger, joint, actuator, effort)| {
            ServoRequest::Effort {
                finger,
                joint,
                actuator,
                effort,
            }
        }),
        (number(), part, number()).prop_map(|(finger, part, order)| ServoRequest::Outcome {
            finger,
            part,
            order,
        }),
    ]
}

#[test]
fn whatever_a_peer_writes_the_servos_stay_valid() {
    let rig = Rig::in_virtual_time();
    let refused = AtomicU32::new(0);
    let ram = rig.ram();
    let block = rig.layout.blocks().block(MASTER).unwrap();
    let word = || prop_oneof![2 => 0..6_u32, 1 => any::<u32>()];
    let points = prop::collection::vec((0..DATA_BYTES / 4, word()), 0..40);
    let errors = prop::collection::vec((0..12_u32, any::<u32>()), 0..2);
    proptest!(|(
        request in request(),
        errors in errors,
        data in points,
        own in any::<bool>(),
        offset in any::<u32>(),
    )| {
        let before = [rig.modes(0), rig.modes(1)];
        rig.ticking.store(false, Ordering::Relaxed);
        // Anybody writes anything anywhere in the data of everybody, the set-points included.
        for (place, word) in &data {
            ram.set_word(4 * place, *word).unwrap();
        }
        if own {
            let packet = ServoRequestPacket::new(&request).unwrap();
            ram.set(Offset::at(block), &packet).unwrap();
            for (place, word) in &errors {
                ram.set_word(block + 4 * place, *word).unwrap();
            }
            let reply = rig.master.send_with_reply(REMOTE, SERVO, block, SECOND);
            prop_assert_eq!(reply, Ok(1));
            let response: ServoResponsePacket<4> = ram.get(Offset::at(block + 64)).unwrap();
            let response = response.value();
            if !matches!(response, Ok(ServoResponse::Ordered(_))) {
                prop_assert!(response.is_ok() || !errors.is_empty());
                refused.fetch_add(1, Ordering::Relaxed);
                rig.ticks(1);
                // The set-points alone may have made a fault, which switches the finger off.
                for (finger, modes) in before.into_iter().enumerate() {
                    let fault = rig.fingers.lock().unwrap().0.controller(finger).unwrap().fault();
                    prop_assert!(fault.is_some() || modes == rig.modes(finger));
                }
            }
        } else {
            rig.master.send_with_reply(REMOTE, SERVO, offset, SECOND).unwrap();
        }
        rig.ticks(1);
        let sensed = rig.fingers.lock().unwrap().1;
        for effort in sensed.iter().flat_map(|sensed| sensed.effort) {
            prop_assert!((0.0..=1000.0).contains(&effort));
        }
    });
    assert!(refused.into_inner() > 20);
}

#[test]
fn threads_give_orders_while_the_loop_runs() {
    const LONG: Duration = Duration::from_secs(120);
    let (mut rig, remote) = Rig::parts(SimSystem::in_real_time(DATA_BYTES));
    rig.master.join().unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|threads| {
        let (fingers, done) = (&rig.fingers, &done);
        threads.spawn(move || {
            while !done.load(Ordering::Relaxed) {
                tick(fingers);
                std::thread::yield_now();
            }
        });
        threads.spawn(move || {
            while !done.load(Ordering::Relaxed) {
                remote.serve(Duration::from_millis(20)).unwrap();
            }
        });
        let orders = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let mut client = rig.client();
            for round in 0..50_u32 {
                let mode =
                    [ServoMode::Torque, ServoMode::Effort, ServoMode::Off][round as usize % 3];
                client.enable(round % 2, None, mode, LONG).unwrap();
                let status = client.status(round % 2, LONG).unwrap();
                assert_eq!(status.modes.as_slice(), [mode; 4]);
            }
        }));
        done.store(true, Ordering::Relaxed);
        orders.unwrap();
    });
}
