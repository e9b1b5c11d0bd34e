//! [`DesiredPositions`]: the set-points of the trajectories, which the master publishes for all processors.

use condor_vars::cell_struct;
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

cell_struct!(DesiredPositions {
    "ticks": ticks, "";
    "loose": loose, "", "A bit for each finger that does not follow.";
    "motion": motion, "", "The request of the motion that runs; 0 for none.";
    "position": position, "rad", "Targets of the joints at the next tick.";
    "velocity": velocity, "rad/s";
});
