//! The channels of a recording.

use condor_hand::grasp::distributed::GraspOrder;
use static_assertions::const_assert_eq;

use super::{INPUTS, OUTPUTS};
use crate::{FINGERS, JOINTS};

pub(super) const TICK: u16 = 1;
pub(super) const PALM: u16 = 2;
pub(super) const ORDER: u16 = 3;
pub(super) const OTHERS: u16 = 4;
pub(super) const ASKED: u16 = 5;
pub(super) const DONE: u16 = 6;
pub(super) const END: u16 = 7;

/// The bytes before each message: little-endian CDR.
pub(super) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// The channels, from number 1 on: topic, type of its messages, and their fields, which have the places in CDR
/// that the structs here have in memory.
pub(super) const ALL: [(&str, &str, &str); 7] = [
    (
        "/servo/tick",
        "condor/msg/Tick",
        "float64 period_s # since the last tick, s\n\
         uint16[84] counts # of each finger: positions of joints, efforts, force at the tip, positions of actuators\n\
         uint64[2] missing # a bit for each input that could not be read\n",
    ),
    (
        "/servo/palm",
        "condor/msg/Palm",
        "float64[3] acceleration # m/s^2\n",
    ),
    (
        "/servo/order",
        "condor/msg/Order",
        "uint64 number\n\
         uint64 fingers # a bit for each that holds\n\
         float64[36] stiffness # N/m, N/rad, N m/m, N m/rad\n\
         float64[36] damping # the same, times s\n\
         float64[3] center # m\n\
         float64[3] force # N\n\
         float64[3] moment # N m\n\
         float64[15] tips # of each finger: x, y, z, m\n\
         float64 squeeze_n # N\n\
         float64 posture_stiffness # N m/rad\n\
         float64 posture_damping # N m s/rad\n\
         float64 friction\n\
         float64 ramp_s # s\n",
    ),
    (
        "/servo/others",
        "condor/msg/Joints",
        "float64[16] position # rad\n\
         float64[16] velocity # rad/s\n\
         uint64[4] order # of each finger: the order in force\n\
         uint64 served # a bit for each finger\n\
         uint64 due_ns # ns\n\
         uint64 ticks\n",
    ),
    (
        "/servo/asked",
        "condor/msg/Asked",
        "uint32 finger\nuint32[] words\n",
    ),
    (
        "/servo/done",
        "condor/msg/Done",
        "uint16[32] counts # of each finger: its actuators\n\
         uint64 hash # FNV-1a of all outputs so far\n",
    ),
    ("/servo/end", "condor/msg/End", "uint32 ticks\n"),
];

const_assert_eq!(INPUTS, 84);
const_assert_eq!(OUTPUTS, 32);
const_assert_eq!(FINGERS * JOINTS, 16);
const_assert_eq!(size_of::<GraspOrder>(), 816);
