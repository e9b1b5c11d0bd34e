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

/// Finds the measured positions and velocities of joints that a servo processor publishes. `region` is the users'
/// region of that processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn joints<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<Joints>>, AccessError> {
    published(region, grasp::JOINTS_NAME)
}

/// Finds the greatest recent torques and tensions of joints that a servo processor publishes. `region` is the users'
/// region of that processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn felt<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Felt>>, AccessError> {
    published(region, guards::FELT_NAME)
}

/// Finds the list of joints stopped by a guard that a servo processor publishes. `region` is the users' region of that
/// processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn stops<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Stops>>, AccessError> {
    published(region, guards::STOPS_NAME)
}

/// Finds the tracking errors of joints that a servo processor publishes. `region` is the users' region of that
/// processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn tracking<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<Tracking>>, AccessError> {
    published(region, servo::TRACKING_NAME)
}

/// Finds the memory by which a servo processor takes orders for a grasp and reports on them. `region` is the users'
/// region of that processor's `data`. Returns `None` while no such program runs there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn grasp<W: MemoryWindow>(region: &Region<W>) -> Result<Option<GraspLayout>, AccessError> {
    let object = objects::find(region, grasp::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| GraspLayout::at(object.offset)))
}

/// Finds the blocks by which requests are sent to the table. `region` is the users' region of the `data` of the table's
/// processor. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn table<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<table::TableBlocks>, AccessError> {
    let object = objects::find(region, table::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Finds the [`Palm`] that the table's processor publishes: the state of the table and the positions of its axes, which
/// carry the palm. `region` is the users' region of that processor's `data`. Returns `None` while the table's program
/// does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn palm<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Palm>>, AccessError> {
    published(region, table::PALM_NAME)
}

/// Finds the blocks by which requests are sent to the simulated robot. `region` is the users' region of the `data` of
/// the robot's processor. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn plant<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<plant::PlantBlocks>, AccessError> {
    let object = objects::find(region, plant::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Finds the blocks by which requests are sent to the master's queue of motions. `region` is the users' region of the
/// master's `data`. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn motions<W: MemoryWindow>(region: &Region<W>) -> Result<Option<MotionsBlocks>, AccessError> {
    let object = objects::find(region, MOTIONS_NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Finds the set-points of all joints that the master publishes. `region` is the users' region of the master's `data`.
/// Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn wanted<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<DesiredPositions>>, AccessError> {
    published(region, WANTED_NAME)
}

/// Finds the report on the tracking errors of past motions that the master publishes. `region` is the users' region of
/// the master's `data`. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn followed<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<TrackingReport>>, AccessError> {
    published(region, FOLLOWED_NAME)
}

/// Finds the true state of the simulated robot that its processor publishes. `region` is the users' region of that
/// processor's `data`. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn truth<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<TrueState>>, AccessError> {
    published(region, plant::TRUTH_NAME)
}

/// Finds the measured place of the ball that the camera of the simulated robot publishes. `region` is the users' region
/// of the `data` of the robot's processor. Returns `None` while its program does not run there.
///
/// # Errors
/// Returns [`AccessError`] if the memory cannot be accessed.
pub fn object<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<plant::CameraObject>>, AccessError> {
    published(region, plant::OBJECT_NAME)
}

fn published<W: MemoryWindow, T>(
    region: &Region<W>,
    name: &str,
) -> Result<Option<Published<T>>, AccessError> {
    let object = objects::find(region, name, ObjectKind::Other)?;
    Ok(object.map(|object| Published::at(object.offset)))
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
