//! Latched faults of a finger, and the way to rest after one.
//!
//! A [`FingerMonitor`] checks each sample. A fault is latched: every later sample reports it until
//! [`clear`](FingerMonitor::clear). The caller then brings the finger's efforts to rest by a
//! [`SafeRamp`].

mod code;
mod encoder;
mod finger;
mod limits;
mod observation;
mod ramp;
pub(crate) mod sensor;

pub use crate::fault_code::FaultCode;
pub use code::{Fault, FaultPlace, FaultQuantity};
pub use finger::FingerMonitor;
pub use limits::{
    ActuatorFaultLimits, EncoderFaultLimits, FaultLimits, FaultRange, JointFaultLimits, Plausible,
    SensorFaultLimits, Stuck, Threshold,
};
pub use observation::Observation;
pub use ramp::SafeRamp;
