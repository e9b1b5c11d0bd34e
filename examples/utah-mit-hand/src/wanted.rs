//! [`Wanted`]: the set-points of the trajectories, which the master publishes for all processors.

use core::mem::offset_of;

use condor_vars::{Described, Field, Kind};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS};

/// The name of the published [`Wanted`], with the version of its layout.
pub const WANTED_NAME: &str = "wanted-2";

/// Where the joints are to be, published in every tick of the trajectories.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Wanted {
    /// Ticks of the trajectories.
    pub ticks: u64,
    /// A bit for each finger that does not follow: its set-points are where it is.
    pub loose: u64,
    /// The motion that runs, 0 for none: the number of its request, with its session in the upper half.
    pub motion: u64,
    /// Where the joints are to be at the next tick, rad.
    pub position: [[f64; JOINTS]; FINGERS],
    /// How fast they are to be there, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
}

impl Described for Wanted {
    const FIELDS: &'static [Field] = &[
        Field::new("ticks", "", Kind::U64, offset_of!(Wanted, ticks)),
        Field::new("loose", "", Kind::U64, offset_of!(Wanted, loose))
            .about("A bit for each finger that does not follow."),
        Field::new("motion", "", Kind::U64, offset_of!(Wanted, motion))
            .about("The request of the motion that runs; 0 for none."),
        Field::new("position", "rad", Kind::F64, offset_of!(Wanted, position))
            .repeated(FINGERS * JOINTS)
            .about("Where the joints are to be at the next tick."),
        Field::new("velocity", "rad/s", Kind::F64, offset_of!(Wanted, velocity))
            .repeated(FINGERS * JOINTS),
    ];
}
