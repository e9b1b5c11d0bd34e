//! The objects of the robot's programs, found by the object tables of their processors: for the master,
//! and for any other program that maps the windows.
//!
//! Each function looks into the users' region of a processor's `data`, and finds nothing while the
//! program there has not begun, or is another one. A program that is started anew, perhaps with
//! another text, may have its objects elsewhere; look again after a call to it has failed.

use condor_mbox::exchange::Blocks;
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use condor_rt::PROCESSORS;
use condor_rt::objects::{self, ObjectKind, SharedObject};

use crate::desired::{DesiredPositions, WANTED_NAME};
use crate::grasp::{self, Joints};
use crate::guards::{self, Felt, Stops};
use crate::message::{GraspLayout, ServoLayout};
use crate::motions::MotionsBlocks;
use crate::plant::{self, TrueState};
use crate::servo::{self, Tracking};
use crate::table::{self, Palm};
use crate::tracking::{FOLLOWED_NAME, TrackingReport};
use crate::{FINGERS, JOINTS};

/// The name, in the master's object table, of the blocks by which clients send requests to its queue of motions.
pub const MOTIONS_NAME: &str = "motions";

/// Finds the set-points of a servo processor and the blocks for requests to it. `region` is the users' region of that
/// processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn servos<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<ServoLayout<FINGERS, JOINTS>>, AccessError> {
    let object = objects::find(region, "servos", ObjectKind::Other)?;
    object
        .map(|object| ServoLayout::new(&mut from(region, &object)?, PROCESSORS as u8))
        .transpose()
}

/// Makes a function for each object: what it finds, its name, the name of the object, its type, and how its offset
/// makes it.
macro_rules! finders {
    ($($(#[$about:meta])* $finder:ident: $name:expr, $type:ty, $at:expr;)*) => {$(
        $(#[$about])*
        /// `region` is the users' region of that processor's `data`. Returns `None` while no such program runs there.
        ///
        /// # Errors
        /// Returns [`AccessError`] if the memory cannot be accessed.
        pub fn $finder<W: MemoryWindow>(region: &Region<W>) -> Result<Option<$type>, AccessError> {
            let object = objects::find(region, $name, ObjectKind::Other)?;
            Ok(object.map(|object| $at(object.offset)))
        }
    )*};
}

finders! {
    /// Finds the measured positions and velocities of joints that a servo processor publishes.
    joints: grasp::JOINTS_NAME, Published<Joints>, Published::at;
    /// Finds the greatest recent torques and efforts of joints that a servo processor publishes.
    felt: guards::FELT_NAME, Published<Felt>, Published::at;
    /// Finds the list of joints stopped by a guard that a servo processor publishes.
    stops: guards::STOPS_NAME, Published<Stops>, Published::at;
    /// Finds the tracking errors of joints that a servo processor publishes.
    tracking: servo::TRACKING_NAME, Published<Tracking>, Published::at;
    /// Finds the memory by which a servo processor takes orders for a grasp and reports on them.
    grasp: grasp::NAME, GraspLayout, GraspLayout::at;
    /// Finds the blocks by which requests are sent to the table, in the memory of its processor.
    table: table::NAME, table::TableBlocks, blocks;
    /// Finds the [`Palm`] that the table's processor publishes: the state of the table and the positions of its axes,
    /// which carry the palm.
    palm: table::PALM_NAME, Published<Palm>, Published::at;
    /// Finds the blocks by which requests are sent to the simulated robot, in the memory of its processor.
    plant: plant::NAME, plant::PlantBlocks, blocks;
    /// Finds the blocks by which requests are sent to the master's queue of motions, in the memory of its processor.
    motions: MOTIONS_NAME, MotionsBlocks, blocks;
    /// Finds the set-points of all joints that the master publishes.
    wanted: WANTED_NAME, Published<DesiredPositions>, Published::at;
    /// Finds the report on the tracking errors of past motions that the master publishes.
    followed: FOLLOWED_NAME, Published<TrackingReport>, Published::at;
    /// Finds the true state of the simulated robot that its processor publishes.
    truth: plant::TRUTH_NAME, Published<TrueState>, Published::at;
    /// Finds the measured place of the ball that the camera of the simulated robot publishes.
    object: plant::OBJECT_NAME, Published<plant::CameraObject>, Published::at;
}

/// Returns the blocks, one for each processor, that begin at an offset.
const fn blocks<Q, R>(offset: u32) -> Blocks<Q, R> {
    Blocks::at(offset, PROCESSORS as u8)
}

/// Returns an allocator of the memory from an object on.
fn from<W: MemoryWindow>(
    region: &Region<W>,
    object: &SharedObject,
) -> Result<Allocator, AccessError> {
    let mut allocator = Allocator::new(region.size());
    allocator.bytes(object.offset as usize)?;
    Ok(allocator)
}
