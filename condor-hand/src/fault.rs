//! Latched faults of a finger, and the way to rest after one.
//!
//! A [`FingerMonitor`] checks each sample. A fault is latched: every later sample reports it until
//! [`clear`](FingerMonitor::clear). The caller then brings the finger's efforts to rest by a
//! [`SafeRamp`].

mod code;
mod finger;
mod limits;
mod ramp;
pub(crate) mod sensor;

pub use crate::fault_code::FaultCode;
pub use code::{FaultSite, FingerFault};
pub use finger::{FingerMonitor, Observation};
pub use limits::{
    ActuatorFaultLimits, FaultLimits, FaultRange, JointFaultLimits, SensorFaultLimits, Stuck,
    Threshold,
};
pub use ramp::SafeRamp;
