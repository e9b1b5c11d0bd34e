//! The objects of the hand's programs, found by the object tables of their processors: for the master,
//! and for any other program that maps the windows.
//!
//! Each function looks into the users' region of a processor's `data`, and finds nothing while the
//! program there has not begun, or is another one. A program that is started anew, perhaps with
//! another text, may have its objects elsewhere; look again after a call to it has failed.

use condor_hand::message::ServoLayout;
use condor_hand::message::motions::MotionsBlocks;
use condor_mbox::exchange::Blocks;
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use condor_rt::PROCESSORS;
use condor_rt::objects::{self, ObjectKind, SharedObject};

use crate::desired::{DesiredPositions, WANTED_NAME};
use crate::grasp::{self, HandGraspLayout, Joints};
use crate::guards::{self, Felt, Stops};
use crate::plant::{self, TrueState};
use crate::servo::{self, Tracking};
use crate::table::{self, Palm};
use crate::tracking::{FOLLOWED_NAME, TrackingReport};
use crate::{FINGERS, JOINTS};

/// The name of the blocks in which the master's queue of motions is asked.
pub const MOTIONS_NAME: &str = "motions";

/// Requests and set-points of a servo processor.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn servos<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<ServoLayout<FINGERS, JOINTS>>, AccessError> {
    let object = objects::find(region, "servos", ObjectKind::Other)?;
    object
        .map(|object| ServoLayout::new(&mut from(region, &object)?, PROCESSORS as u8))
        .transpose()
}

/// Returns the measurements of the joints that a servo processor publishes.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn joints<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<Joints>>, AccessError> {
    published(region, grasp::JOINTS_NAME)
}

/// Returns what the joints that a servo processor serves felt of late.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn felt<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Felt>>, AccessError> {
    published(region, guards::FELT_NAME)
}

/// Returns which joints of a servo processor rest since a guard has stopped their motion.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn stops<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Stops>>, AccessError> {
    published(region, guards::STOPS_NAME)
}

/// Returns the tracking errors of the joints that a servo processor publishes.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn tracking<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<Tracking>>, AccessError> {
    published(region, servo::TRACKING_NAME)
}

/// Returns the place of the orders to the grasp law of a servo processor, and of its reports.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn grasp<W: MemoryWindow>(region: &Region<W>) -> Result<Option<HandGraspLayout>, AccessError> {
    let object = objects::find(region, grasp::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| HandGraspLayout::at(object.offset)))
}

/// Returns the blocks in which requests are sent to the table.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn table<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Blocks<table::TableRequest, table::TableResponse>>, AccessError> {
    let object = objects::find(region, table::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Returns the positions and the state that the table publishes.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn palm<W: MemoryWindow>(region: &Region<W>) -> Result<Option<Published<Palm>>, AccessError> {
    published(region, table::PALM_NAME)
}

/// Returns the blocks in which requests are sent to the simulated robot.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn plant<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Blocks<plant::PlantRequest, plant::PlantResponse>>, AccessError> {
    let object = objects::find(region, plant::NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Returns the blocks in which the master's queue of motions is asked.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn motions<W: MemoryWindow>(region: &Region<W>) -> Result<Option<MotionsBlocks>, AccessError> {
    let object = objects::find(region, MOTIONS_NAME, ObjectKind::Other)?;
    Ok(object.map(|object| Blocks::at(object.offset, PROCESSORS as u8)))
}

/// Returns the set-points of the joints that the master publishes.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn wanted<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<DesiredPositions>>, AccessError> {
    published(region, WANTED_NAME)
}

/// Returns how well the joints have followed each motion, as the master publishes it.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn followed<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<TrackingReport>>, AccessError> {
    published(region, FOLLOWED_NAME)
}

/// Returns the true state that the simulated robot publishes.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
pub fn truth<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<Option<Published<TrueState>>, AccessError> {
    published(region, plant::TRUTH_NAME)
}

/// Returns the object in front of the palm as it was measured last: by the camera of the simulated
/// robot.
///
/// # Errors
/// [`AccessError`] if the memory cannot be accessed.
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
