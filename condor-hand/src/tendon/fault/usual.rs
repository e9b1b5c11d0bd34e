use super::sensor::SensorMotion;
use super::{JointFaultLimits, SensorFaultLimits, TendonFaultLimits, Threshold};
use crate::math::{Real, abs, max, min, real};
use crate::tendon::Pair;

/// The bounds of L sensors within which a sample passes all checks that are switched on.
///
/// Nearly every sample does, and a few comparisons of lanes side by side say so. A sample that is not
/// finite never passes. Of one that does not pass, the checks one by one say why.
#[derive(Clone, Copy, Debug)]
pub(super) struct Usual<T, const L: usize> {
    low: [T; L],
    high: [T; L],
    far: [T; L],
    band: [T; L],
    travel: [T; L],
}

/// The lanes of what [`SensorMotion`] says of one sensor each.
#[derive(Clone, Copy, Debug)]
pub(super) struct SensorLanes<T, const L: usize> {
    there: [T; L],
    wanted: [T; L],
}

/// The bounds of one sensor.
#[derive(Clone, Copy)]
struct Bounds<T> {
    low: T,
    high: T,
    far: T,
    band: T,
    travel: T,
}

/// The largest number: what is above it is not finite.
fn largest<T: Real>() -> T {
    // The same number is finite in either type.
    T::max_value().unwrap_or_else(|| real(f64::from(f32::MAX)))
}

/// The threshold of a check, or one that all finite numbers keep if it is switched off.
pub(super) fn threshold<T: Real>(threshold: &Threshold<T>) -> T {
    if threshold.samples == 0 {
        largest()
    } else {
        threshold.value
    }
}

impl<T: Real> Bounds<T> {
    fn of(sensor: &SensorFaultLimits<T>) -> Self {
        let (low, high) = match sensor.range.samples {
            0 => (-largest::<T>(), largest()),
            _ => (sensor.range.low, sensor.range.high),
        };
        let travel = match sensor.stuck.samples {
            0 => largest(),
            _ => sensor.stuck.travel,
        };
        Self {
            low,
            high,
            far: threshold(&sensor.tracking),
            band: sensor.stuck.band,
            travel,
        }
    }

    fn within(self, low: T, high: T) -> Self {
        Self {
            low: max(self.low, low),
            high: min(self.high, high),
            ..self
        }
    }

    fn of_tendon(tendon: &TendonFaultLimits<T>) -> Self {
        let slack = match tendon.slack.samples {
            0 => -largest::<T>(),
            _ => tendon.slack.value,
        };
        Self::of(&tendon.sensor).within(slack, threshold(&tendon.over_tension))
    }

    fn of_joint(joint: &JointFaultLimits<T>) -> Self {
        let bounds = Self::of(&joint.sensor);
        match joint.limit.samples {
            0 => bounds,
            _ => bounds.within(joint.limit.low, joint.limit.high),
        }
    }
}

impl<T: Real> Usual<T, 2> {
    /// Returns the bounds of the two tendons of a joint.
    pub(super) fn of_tendons(limits: &Pair<TendonFaultLimits<T>>) -> Self {
        let pair = [&limits.flexor, &limits.extensor];
        Self::new(pair.map(Bounds::of_tendon))
    }
}

impl<T: Real, const L: usize> Usual<T, L> {
    /// Returns the bounds of `L` joints.
    pub(super) fn of_joints(limits: &[JointFaultLimits<T>; L]) -> Self {
        Self::new(limits.each_ref().map(Bounds::of_joint))
    }

    fn new(bounds: [Bounds<T>; L]) -> Self {
        Self {
            low: bounds.map(|bounds| bounds.low),
            high: bounds.map(|bounds| bounds.high),
            far: bounds.map(|bounds| bounds.far),
            band: bounds.map(|bounds| bounds.band),
            travel: bounds.map(|bounds| bounds.travel),
        }
    }

    /// Whether all sensors pass; then, and only then, `places` follows those that have moved.
    ///
    /// The checks one by one would do nothing more with a sample that has passed here, so they may
    /// still be made.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "lanes have no branches")]
    pub(super) fn pass(
        &self,
        places: &mut SensorLanes<T, L>,
        desired: &[T; L],
        measured: &[T; L],
    ) -> bool {
        let mut moved = *places;
        let mut pass = true;
        for lane in 0..L {
            let (wanted, measured) = (desired[lane], measured[lane]);
            pass &= measured >= self.low[lane];
            pass &= measured <= self.high[lane];
            pass &= abs(wanted - measured) <= self.far[lane];
            let stays = abs(measured - places.there[lane]) <= self.band[lane];
            pass &= !stays | (abs(wanted - places.wanted[lane]) <= self.travel[lane]);
            moved.there[lane] = if stays { places.there[lane] } else { measured };
            moved.wanted[lane] = if stays { places.wanted[lane] } else { wanted };
        }
        if pass {
            *places = moved;
        }
        pass
    }
}

impl<T: Real, const L: usize> SensorLanes<T, L> {
    pub(super) fn never() -> Self {
        let SensorMotion { there, wanted } = SensorMotion::never();
        Self {
            there: [there; L],
            wanted: [wanted; L],
        }
    }

    /// That of one sensor.
    pub(super) fn of(&self, lane: usize) -> SensorMotion<T> {
        match (self.there.get(lane), self.wanted.get(lane)) {
            (Some(&there), Some(&wanted)) => SensorMotion { there, wanted },
            _ => SensorMotion::never(),
        }
    }

    pub(super) fn set(&mut self, lane: usize, moved: SensorMotion<T>) {
        if let (Some(there), Some(wanted)) = (self.there.get_mut(lane), self.wanted.get_mut(lane)) {
            (*there, *wanted) = (moved.there, moved.wanted);
        }
    }

    /// Forgets one sensor.
    #[inline(always)]
    pub(super) fn forget(&mut self, lane: usize) {
        self.set(lane, SensorMotion::never());
    }
}
