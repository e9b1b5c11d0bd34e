use condor_hand::fault::Fault;
use condor_hand::servo::ServoMode;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// The state of a finger of at most `N` joints, as the servo loop last reported it to clients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ServoStatus<const N: usize> {
    /// The present mode of each joint that the finger has.
    pub modes: Vec<ServoMode, N>,
    /// A bit for each joint whose actuators cannot give the torque that it needs.
    pub saturated: u32,
    /// The first fault since the last restart; `None` if there was none.
    pub fault: Option<Fault>,
    /// True after a fault, while the efforts of the finger go to rest or stay there.
    pub is_resting: bool,
    /// The number of restarts.
    pub restarts: u32,
    /// The number of the last order that the loop has processed.
    pub settled: u32,
    /// The number of times that set-points of the master were refused, because a number in them was
    /// not finite.
    pub refused_set_points: u32,
    /// The number of ticks of the loop; wraps.
    pub ticks: u32,
}
