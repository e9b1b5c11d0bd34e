use nalgebra::SVector;

/// The desired and measured values of a finger in one tick, which a [`FingerMonitor`](super::FingerMonitor) checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<'a, const N: usize, const A: usize> {
    /// The desired efforts, N or N m.
    pub desired_efforts: &'a [f64; A],
    /// The measured efforts, N or N m.
    pub efforts: &'a [f64; A],
    /// The desired positions, rad; `None` for joints whose position is not controlled.
    pub desired_positions: &'a [Option<f64>; N],
    /// The measured positions, rad.
    pub positions: &'a SVector<f64, N>,
    /// The measured positions of the actuators, rad or m; anything for those without a sensor.
    pub actuator_positions: &'a [f64; A],
    /// The arms of the actuators at the joints: [`Linear::arms`](crate::transmission::Linear::arms).
    pub arms: &'a [[f64; N]; A],
    /// A bit for each joint whose reading is implausible:
    /// [`ServoOutput::lost`](crate::servo::ServoOutput::lost).
    pub lost: u32,
    /// The positions that the laws have used, rad: those to which the rate led for joints with an implausible reading.
    pub believed: &'a SVector<f64, N>,
    /// The rates that the laws have used, rad/s.
    pub rates: &'a SVector<f64, N>,
    /// The time since the last tick, s.
    pub period_s: f64,
    /// The time since the last set-point came, s.
    pub set_point_age_s: f64,
}
