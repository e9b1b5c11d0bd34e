use nalgebra::SVector;

use super::sensor::{Joint, Latch, Run, Tendon};
use super::usual::{Places, Usual, threshold};
use super::{Fault, FaultCode, FaultLimits, FaultLimitsError, FaultSet, FaultSite};
use crate::math::{Real, is_finite};
use crate::tendon::{Pair, Pairs};

/// The state of a finger in one tick, as its monitor checks it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<T: Real, const N: usize> {
    /// The desired tensions, N.
    pub desired_tensions: Pairs<T, N>,
    /// The measured tensions, N.
    pub tensions: Pairs<T, N>,
    /// The desired positions, rad; `None` for joints whose position is not controlled.
    pub desired_positions: [Option<T>; N],
    /// The measured positions, rad.
    pub positions: SVector<T, N>,
    /// A bit for each joint whose reading is implausible:
    /// [`ServoOutput::lost`](crate::servo::ServoOutput::lost).
    pub lost: u32,
    /// The time since the last tick, s.
    pub period_s: T,
    /// The time since the last set-point came, s.
    pub set_point_age_s: T,
}

/// Monitors the tendons, the joints and the timing of one finger.
///
/// A failed check becomes a fault after as many samples in a row as its limit says. A tension or
/// position that is not finite does not count for the other checks of its site; those continue with
/// the next sample. A time that is not finite counts as too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<T: Real, const N: usize> {
    limits: FaultLimits<T, N>,
    usual: AllUsual<T, N>,
    state: FingerState<T, N>,
}

/// The bounds within which a tick passes all checks.
#[derive(Clone, Copy, Debug)]
struct AllUsual<T, const N: usize> {
    tendons: [Usual<T, 2>; N],
    joints: Usual<T, N>,
    period_s: T,
    set_point_age_s: T,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct FingerState<T, const N: usize> {
    tendons: [Pair<(Tendon, FaultSet)>; N],
    joints: [(Joint, FaultSet); N],
    tendon_places: [Places<T, 2>; N],
    joint_places: Places<T, N>,
    /// No check has failed in the last tick: nothing is being counted.
    quiet: bool,
    period: Run,
    set_point: Run,
    finger: FaultSet,
    first: Option<Fault>,
}

impl<T: Real, const N: usize> FingerState<T, N> {
    fn new() -> Self {
        Self {
            tendons: [Pair::both((Tendon::default(), FaultSet::default())); N],
            joints: [(Joint::default(), FaultSet::default()); N],
            tendon_places: [Places::never(); N],
            joint_places: Places::never(),
            quiet: true,
            period: Run::default(),
            set_point: Run::default(),
            finger: FaultSet::default(),
            first: None,
        }
    }

    /// Judges one site and keeps the first fault of all.
    fn judge(
        first: &mut Option<Fault>,
        site: FaultSite,
        latched: &mut FaultSet,
        check: impl FnOnce(&mut Latch<'_>),
    ) {
        let mut latch = Latch {
            latched,
            first: None,
        };
        check(&mut latch);
        if let (None, Some((code, value))) = (*first, latch.first) {
            *first = Some(Fault { code, site, value });
        }
    }
}

impl<T: Real, const N: usize> FingerMonitor<T, N> {
    /// Makes a monitor without faults.
    ///
    /// # Errors
    /// [`FaultLimitsError`] for the first limit that is wrong.
    pub fn new(limits: FaultLimits<T, N>) -> Result<Self, FaultLimitsError> {
        limits.check()?;
        Ok(Self {
            usual: AllUsual {
                tendons: limits.tendons.each_ref().map(Usual::of_tendons),
                joints: Usual::of_joints(&limits.joints),
                period_s: threshold(&limits.period_s),
                set_point_age_s: threshold(&limits.set_point_age_s),
            },
            limits,
            state: FingerState::new(),
        })
    }

    /// Checks a tick; returns the first fault since the last [`clear`](Self::clear).
    pub fn update(&mut self, observation: &Observation<T, N>) -> Option<Fault> {
        self.judge(
            (&observation.desired_tensions, &observation.tensions),
            (&observation.desired_positions, &observation.positions),
            observation.lost,
            observation.period_s,
            observation.set_point_age_s,
        )
    }

    /// The same of an observation in its parts: desired and measured tensions, desired and measured
    /// positions and which of these cannot be, the time since the last tick and the age of the
    /// set-points.
    #[inline(always)]
    pub(crate) fn judge(
        &mut self,
        tensions: (&Pairs<T, N>, &Pairs<T, N>),
        positions: (&[Option<T>; N], &SVector<T, N>),
        lost: u32,
        period_s: T,
        age_s: T,
    ) -> Option<Fault> {
        if lost != 0 || !self.passes(tensions, positions, period_s, age_s) {
            self.examine(tensions, positions, lost, period_s, age_s);
        }
        self.state.first
    }

    /// Whether nothing is wrong in a tick after one in which nothing was.
    #[inline(always)]
    fn passes(
        &mut self,
        tensions: (&Pairs<T, N>, &Pairs<T, N>),
        (desired, measured): (&[Option<T>; N], &SVector<T, N>),
        period_s: T,
        age_s: T,
    ) -> bool {
        let Self { usual, state, .. } = self;
        let mut pass = state.quiet
            && is_finite(period_s)
            && period_s > T::zero()
            && period_s <= usual.period_s
            && is_finite(age_s)
            && age_s <= usual.set_point_age_s;
        for (((usual, places), desired), measured) in usual
            .tendons
            .iter()
            .zip(&mut state.tendon_places)
            .zip(tensions.0)
            .zip(tensions.1)
        {
            let desired = [desired.flexor, desired.extensor];
            let measured = [measured.flexor, measured.extensor];
            pass &= usual.pass(places, &desired, &measured);
        }
        let [measured] = measured.data.0;
        let mut wanted = measured;
        for (wanted, &desired) in wanted.iter_mut().zip(desired) {
            *wanted = desired.unwrap_or(*wanted);
        }
        pass &= usual
            .joints
            .pass(&mut state.joint_places, &wanted, &measured);
        // What has no set-point is not compared with where it was.
        for (lane, desired) in desired.iter().enumerate() {
            if pass && desired.is_none() {
                state.joint_places.forget(lane);
            }
        }
        pass
    }

    /// Makes the checks one by one.
    #[cold]
    #[inline(never)]
    fn examine(
        &mut self,
        (desired_tensions, tensions): (&Pairs<T, N>, &Pairs<T, N>),
        (desired_positions, positions): (&[Option<T>; N], &SVector<T, N>),
        lost: u32,
        period_s: T,
        age_s: T,
    ) {
        let Self { limits, state, .. } = self;
        let FingerState {
            tendons,
            joints,
            tendon_places,
            joint_places,
            quiet,
            period,
            set_point,
            finger,
            first,
        } = state;
        let sites = tendons.iter_mut().zip(tendon_places).zip(&limits.tendons);
        for (joint, (((state, places), limits), (desired, measured))) in
            sites.zip(desired_tensions.iter().zip(tensions)).enumerate()
        {
            let sites = FaultSite::tendons(joint);
            let (tendon, latched) = &mut state.flexor;
            let mut moved = places.of(0);
            FingerState::<T, N>::judge(first, sites.flexor, latched, |latch| {
                let (desired, measured) = (desired.flexor, measured.flexor);
                tendon.update(&limits.flexor, &mut moved, desired, measured, latch);
            });
            places.set(0, moved);
            let (tendon, latched) = &mut state.extensor;
            let mut moved = places.of(1);
            FingerState::<T, N>::judge(first, sites.extensor, latched, |latch| {
                let (desired, measured) = (desired.extensor, measured.extensor);
                tendon.update(&limits.extensor, &mut moved, desired, measured, latch);
            });
            places.set(1, moved);
        }
        for (joint, (((state, latched), limits), (&desired, &measured))) in joints
            .iter_mut()
            .zip(&limits.joints)
            .zip(desired_positions.iter().zip(positions))
            .enumerate()
        {
            let mut moved = joint_places.of(joint);
            FingerState::<T, N>::judge(first, FaultSite::Joint(joint), latched, |latch| {
                let sample = (measured, lost & 1 << joint == 0);
                state.update(limits, &mut moved, desired, sample, latch);
            });
            joint_places.set(joint, moved);
        }
        FingerState::<T, N>::judge(first, FaultSite::Finger, finger, |latch| {
            let (longest, oldest) = (&limits.period_s, &limits.set_point_age_s);
            let is_late = period.misses(longest.samples, period_s, longest.value);
            latch.report(FaultCode::MissedDeadline, is_late, period_s);
            let is_old = !is_finite(age_s) || oldest.is_below(age_s);
            let is_stale = set_point.reaches(oldest.samples, is_old);
            latch.report(FaultCode::StaleSetPoint, is_stale, age_s);
        });
        *quiet = period.is_over()
            && set_point.is_over()
            && tendons
                .iter()
                .all(|pair| pair.flexor.0.is_quiet() && pair.extensor.0.is_quiet())
            && joints.iter().all(|(joint, _)| joint.is_quiet());
    }

    /// Returns the first fault since the last [`clear`](Self::clear).
    #[must_use]
    pub fn first(&self) -> Option<Fault> {
        self.state.first
    }

    /// Returns the codes that are latched at a site; none for a site that the finger does not have.
    #[must_use]
    pub fn at(&self, site: FaultSite) -> FaultSet {
        let state = &self.state;
        let found = match site {
            FaultSite::Flexor(joint) => state.tendons.get(joint).map(|pair| pair.flexor.1),
            FaultSite::Extensor(joint) => state.tendons.get(joint).map(|pair| pair.extensor.1),
            FaultSite::Joint(joint) => state.joints.get(joint).map(|joint| joint.1),
            FaultSite::Finger => Some(state.finger),
        };
        found.unwrap_or_default()
    }

    /// Iterates over all latched faults, site by site.
    pub fn faults(&self) -> impl Iterator<Item = (FaultSite, FaultCode)> {
        let joints = (0..N).flat_map(|joint| {
            let Pair { flexor, extensor } = FaultSite::tendons(joint);
            [flexor, extensor, FaultSite::Joint(joint)]
        });
        joints
            .chain([FaultSite::Finger])
            .flat_map(|site| self.at(site).iter().map(move |code| (site, code)))
    }

    /// Clears all faults, and forgets all samples.
    pub fn clear(&mut self) {
        self.state = FingerState::new();
    }
}
