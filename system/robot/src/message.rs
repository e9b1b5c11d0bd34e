//! Servos as objects that answer messages.
//!
//! Any processor can enable, disable, query and restart any servo (memo, sections 3.5 and 4.2). A
//! servo processor owns a [`ServoObject`]. Its [`ServoHandler`] answers messages in the background;
//! its [`HandLoop`] controls the fingers in the servo loop. The loop never serves and never waits.
//! The handler stores a request as a *state* in private memory of the object, and the loop takes it
//! over at the beginning of a tick. If a state changes twice between two ticks, only the last
//! change takes effect; restarts are counted all the same. The loop also stores its results there,
//! so a query costs it nothing. While nothing changes, a tick reads one word for each finger, and
//! the set-points.
//!
//! The set-points of the master, 50 times a second, are not messages: a [`SetPoints`] publishes
//! them in the window of the servo processor, and the loop polls them there. With them come the motion
//! of each joint and what stops it, which the loop checks in every tick. A [`GraspLayout`] is
//! for orders to a [`DistributedGrasp`](condor_hand::grasp::distributed::DistributedGrasp) and its reports.
//!
//! # The protocol
//!
//! In the users' region of the servo processor's `data` there is a block for each processor of the system: a
//! [`ServoRequest`] and a [`ServoResponse`], each in a [`Packet`]. The sender sends a message to [`SERVO`] with the
//! offset of its block. The reply is 1 when the response has been written, and 0 for an offset that is not that of the
//! sender's block.
//!
//! The numbers of an order are checked once, in the copy that the handler makes, by the loop when it processes
//! the order: only the servo knows, for example, whether a position is within its limits, or whether the finger
//! rests after a fault. [`ServoRequest::Outcome`] asks for the result. An order that was refused is not tried again.

mod client;
mod finger_request;
mod grasp;
mod handler;
mod layout;
mod memory;
mod object;
mod servo_loop;
mod status;

pub use client::ServoClient;
pub use finger_request::FingerRequest;
pub use grasp::{GraspEnd, GraspLayout};
pub use handler::{HandIdentity, ServoHandler};
pub use layout::{ServoLayout, SetPoints};
pub use object::{ServoEnds, ServoObject};
pub use servo_loop::HandLoop;
pub use status::ServoStatus;

use condor_hand::config::Name;
use condor_hand::servo::{JointTarget, ServoMode, ServoRefusal};
use condor_mbox::Vector;
use condor_mbox::exchange::Blocks;
use serde::{Deserialize, Serialize};

use crate::packet::Packet;

/// The vector of the messages that carry requests to the servos of a processor. Register the
/// [`ServoHandler`] of the servo processor at this vector.
pub const SERVO: Vector = Vector(32);
/// The version of this protocol of servos. A client refuses a servo processor with another version.
pub const VERSION: u32 = 9;

/// A request to the servos of a processor. Fingers, joints and actuators are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ServoRequest {
    /// Asks for the names of the hand and of a finger, and for the properties of the servos.
    Hello {
        /// The finger of the hand.
        finger: u32,
    },
    /// Asks for the state of a finger.
    Status {
        /// The finger of the hand.
        finger: u32,
    },
    /// Sets another mode, in which a joint keeps its present position, torque or efforts; the mode `Off` disables it.
    Mode {
        /// The finger of the hand.
        finger: u32,
        /// The joint; `None` for all joints of the finger.
        joint: Option<u32>,
        /// The mode in which the joint is to be.
        mode: ServoMode,
    },
    /// Sets a target, and its mode.
    Target {
        /// The finger of the hand.
        finger: u32,
        /// The joint; `None` for all joints of the finger.
        joint: Option<u32>,
        /// The target that the joint is to have, in the units of its mode.
        target: JointTarget,
    },
    /// Sets the effort of an actuator, and the mode of the joint to which it belongs.
    Effort {
        /// The finger of the hand.
        finger: u32,
        /// The joint to which the actuator belongs.
        joint: u32,
        /// The number of the actuator in its finger.
        actuator: u32,
        /// The effort, N or N m.
        effort: f64,
    },
    /// Clears the latched faults of a finger.
    Restart {
        /// The finger of the hand.
        finger: u32,
    },
    /// Asks for the result of an order: a request that the servo loop carries out.
    Outcome {
        /// The finger of the order.
        finger: u32,
        /// The part of the finger that the order changes.
        part: OrderPart,
        /// The number of the order.
        order: u32,
    },
}

impl ServoRequest {
    /// Returns the finger of the request.
    const fn finger(&self) -> u32 {
        match *self {
            Self::Hello { finger }
            | Self::Status { finger }
            | Self::Mode { finger, .. }
            | Self::Target { finger, .. }
            | Self::Effort { finger, .. }
            | Self::Restart { finger }
            | Self::Outcome { finger, .. } => finger,
        }
    }
}

/// The part of a finger that an order changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum OrderPart {
    /// The mode or the target of a joint; `None` for all joints.
    Drive(Option<u32>),
    /// The latched faults.
    Faults,
}

/// The response of servos to a [`ServoRequest`]. A finger has at most `N` joints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ServoResponse<const N: usize> {
    /// The names of the hand and the finger.
    Hello(Hello),
    /// The state of the finger.
    Status(ServoStatus<N>),
    /// The loop has an order of this number.
    Ordered(u32),
    /// The loop has carried out the order.
    Done,
    /// The loop has not processed the order yet.
    Pending,
    /// A later order of another sender replaced the order.
    Superseded,
    /// Another request was being answered, and this one was ignored: ask again.
    Busy,
    /// The request is refused.
    Refused(ServoRefusal),
}

/// The names of a hand and a finger, and the properties of the servos, with which a servo processor answers
/// [`ServoClient::hello`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// The name of the hand.
    pub hand: Name,
    /// The name of the finger.
    pub finger: Name,
    /// The fingers of the hand that the processor serves: bit *i* stands for finger *i*.
    pub served: u32,
    /// The number of joints of the finger.
    pub joints: u32,
    /// Servo ticks in a second, Hz.
    pub servo_hz: u32,
}

/// The blocks in the `data` of a servo processor through which other processors ask its servos, one for each processor.
pub type ServoBlocks<const N: usize> = Blocks<ServoRequestPacket, ServoResponsePacket<N>>;
/// A request in a block.
pub type ServoRequestPacket = Packet<ServoRequest, VERSION, 56>;
/// A response in a block.
pub type ServoResponsePacket<const N: usize> = Packet<ServoResponse<N>, VERSION, 184>;

#[cfg(test)]
mod tests {
    use condor_hand::Requirement;
    use condor_hand::fault::{Fault, FaultCode, FaultPlace, FaultQuantity};
    use condor_hand::servo::TargetQuantity;
    use condor_hand::trajectory::SetPoint;

    use super::*;

    const MOST: u32 = u32::MAX;

    fn longest_status() -> ServoStatus<32> {
        ServoStatus {
            modes: [ServoMode::Impedance; 32].into_iter().collect(),
            saturated: MOST,
            fault: Some(Fault {
                place: FaultPlace::Actuator(usize::MAX),
                quantity: FaultQuantity::Time,
                code: FaultCode::Jump,
                value: 1.0,
                allowed: Requirement::Within(0.0, 1.0),
            }),
            is_resting: true,
            restarts: MOST,
            settled: MOST,
            refused_set_points: MOST,
            ticks: MOST,
        }
    }

    #[test]
    fn the_longest_messages_fit_into_their_packets() {
        let joint = Some(MOST);
        let target = JointTarget::Position(SetPoint::rest(1.0));
        for request in [
            ServoRequest::Target {
                finger: MOST,
                joint,
                target,
            },
            ServoRequest::Outcome {
                finger: MOST,
                part: OrderPart::Drive(joint),
                order: MOST,
            },
        ] {
            let packet = ServoRequestPacket::new(&request).unwrap();
            assert_eq!(packet.value(), Ok(request));
        }
        let name: Name = "n".repeat(64).as_str().try_into().unwrap();
        let refusal = ServoRefusal::Target {
            joint: MOST,
            quantity: TargetQuantity::Acceleration,
            value: 1.0,
            low: 1.0,
            high: 1.0,
        };
        for response in [
            ServoResponse::Hello(Hello {
                hand: name.clone(),
                finger: name,
                served: MOST,
                joints: MOST,
                servo_hz: MOST,
            }),
            ServoResponse::Status(longest_status()),
            ServoResponse::Refused(refusal),
        ] {
            let packet = ServoResponsePacket::<32>::new(&response).unwrap();
            assert_eq!(packet.value(), Ok(response));
        }
        let report = memory::Report::<32>::new(&longest_status()).unwrap();
        assert_eq!(report.value(), Ok(longest_status()));
        let drive = memory::JointDrive::Target(target);
        let order = memory::JointOrder {
            number: MOST,
            drive,
        };
        assert!(memory::Order::new(&order).unwrap().value().is_ok());
        let outcome = memory::JointOutcome {
            number: MOST,
            refusal: Some(refusal),
        };
        assert!(memory::Outcome::new(&outcome).unwrap().value().is_ok());
    }
}
