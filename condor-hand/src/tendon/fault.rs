//! Faults of a finger that stay until somebody clears them, and the way to rest from one.
//!
//! A [`FingerMonitor`] looks at each sample. A fault that it finds is latched: it is told in every
//! sample until [`clear`](FingerMonitor::clear). Whoever commands the finger then takes its tensions
//! to their minimum with a [`SafeRamp`].

mod code;
mod finger;
mod limits;
mod ramp;
pub(crate) mod sensor;
mod usual;

pub use code::{Fault, FaultCode, FaultSet, FaultSite};
pub use finger::{FingerMonitor, Observation};
pub use limits::{
    FaultLimits, FaultLimitsError, JointFaultLimits, Range, SensorFaultLimits, Stuck,
    TendonFaultLimits, Threshold,
};
pub use ramp::{RampError, SafeRamp};
