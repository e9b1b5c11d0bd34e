//! [`DesiredPositions`]: the set-points of the trajectories, which the master publishes for all processors.

use core::mem::offset_of;

use condor_vars::{CellField, CellStruct, ValueKind};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS};

/// The name of the published [`DesiredPositions`] in the master's object table. The number is the version of the
/// layout.
pub const WANTED_NAME: &str = "wanted-2";

/// The desired positions and velocities of all joints, which the master publishes in every tick of its trajectories.
/// The servos follow them.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct DesiredPositions {
    /// The number of ticks of the trajectories so far.
    pub ticks: u64,
    /// A bit for each finger that does not follow: its set-points are where it is.
    pub loose: u64,
    /// The motion that runs, 0 for none: the number of its request, with its session in the upper half.
    pub motion: u64,
    /// The desired positions of the joints at the next tick, rad.
    pub position: [[f64; JOINTS]; FINGERS],
    /// The desired velocities of the joints at the next tick, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
}

impl CellStruct for DesiredPositions {
    const FIELDS: &'static [CellField] = &[
        CellField::new(
            "ticks",
            "",
            ValueKind::U64,
            offset_of!(DesiredPositions, ticks),
        ),
        CellField::new(
            "loose",
            "",
            ValueKind::U64,
            offset_of!(DesiredPositions, loose),
        )
        .about("A bit for each finger that does not follow."),
        CellField::new(
            "motion",
            "",
            ValueKind::U64,
            offset_of!(DesiredPositions, motion),
        )
        .about("The request of the motion that runs; 0 for none."),
        CellField::new(
            "position",
            "rad",
            ValueKind::F64,
            offset_of!(DesiredPositions, position),
        )
        .repeated(FINGERS * JOINTS)
        .about("Targets of the joints at the next tick."),
        CellField::new(
            "velocity",
            "rad/s",
            ValueKind::F64,
            offset_of!(DesiredPositions, velocity),
        )
        .repeated(FINGERS * JOINTS),
    ];
}
