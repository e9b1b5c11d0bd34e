use nalgebra::SVector;

use super::sensor::{Joint, Latch, Run, Tendon};
use super::{Fault, FaultCode, FaultLimits, FaultLimitsError, FaultSet, FaultSite};
use crate::math::{Real, is_finite};
use crate::tendon::{Pair, Pairs};

/// What a finger does in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation<T: Real, const N: usize> {
    /// The tensions that were asked for, N.
    pub desired_tensions: Pairs<T, N>,
    /// The tensions of the sensors, N.
    pub tensions: Pairs<T, N>,
    /// The positions that were asked for, rad; none where a joint's position is not controlled.
    pub desired_positions: [Option<T>; N],
    /// The positions of the sensors, rad.
    pub positions: SVector<T, N>,
    /// The time since the last tick, s.
    pub period_s: T,
    /// The time since the last set-point came, s.
    pub set_point_age_s: T,
}

/// Watches the tendons, the joints and the time of one finger.
///
/// A check becomes a fault when it has failed in as many samples in a row as its limit says. A
/// tension or position that is not finite tells nothing about the other checks of its site;
/// those go on after it. A time that is not finite is too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<T: Real, const N: usize> {
    limits: FaultLimits<T, N>,
    state: State<T, N>,
}

/// All that `clear` forgets.
#[derive(Clone, Copy, Debug)]
struct State<T, const N: usize> {
    tendons: [Pair<(Tendon<T>, FaultSet)>; N],
    joints: [(Joint<T>, FaultSet); N],
    period: Run,
    set_point: Run,
    finger: FaultSet,
    first: Option<Fault>,
}

impl<T: Real, const N: usize> State<T, N> {
    fn new() -> Self {
        Self {
            tendons: [Pair::both((Tendon::default(), FaultSet::default())); N],
            joints: [(Joint::default(), FaultSet::default()); N],
            period: Run::default(),
            set_point: Run::default(),
            finger: FaultSet::default(),
            first: None,
        }
    }

    /// Judges one site and keeps the first fault of all.
    #[inline(always)]
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
    /// A monitor without faults.
    ///
    /// # Errors
    /// The first limit by which nothing can be judged.
    pub fn new(limits: FaultLimits<T, N>) -> Result<Self, FaultLimitsError> {
        limits.check()?;
        Ok(Self {
            limits,
            state: State::new(),
        })
    }

    /// Judges a tick; gives the fault that came first since the last [`clear`](Self::clear).
    pub fn update(&mut self, observation: &Observation<T, N>) -> Option<Fault> {
        let Self { limits, state } = self;
        let State {
            tendons,
            joints,
            period,
            set_point,
            finger,
            first,
        } = state;
        for (joint, (((state, limits), desired), measured)) in tendons
            .iter_mut()
            .zip(&limits.tendons)
            .zip(&observation.desired_tensions)
            .zip(&observation.tensions)
            .enumerate()
        {
            let sites = FaultSite::tendons(joint);
            let (tendon, latched) = &mut state.flexor;
            State::<T, N>::judge(first, sites.flexor, latched, |latch| {
                tendon.update(&limits.flexor, desired.flexor, measured.flexor, latch);
            });
            let (tendon, latched) = &mut state.extensor;
            State::<T, N>::judge(first, sites.extensor, latched, |latch| {
                tendon.update(&limits.extensor, desired.extensor, measured.extensor, latch);
            });
        }
        for (joint, ((((state, latched), limits), &desired), &measured)) in joints
            .iter_mut()
            .zip(&limits.joints)
            .zip(&observation.desired_positions)
            .zip(&observation.positions)
            .enumerate()
        {
            State::<T, N>::judge(first, FaultSite::Joint(joint), latched, |latch| {
                state.update(limits, desired, measured, latch);
            });
        }
        State::<T, N>::judge(first, FaultSite::Finger, finger, |latch| {
            for (code, run, limit, seconds) in [
                (
                    FaultCode::MissedDeadline,
                    period,
                    &limits.period_s,
                    observation.period_s,
                ),
                (
                    FaultCode::StaleSetPoint,
                    set_point,
                    &limits.set_point_age_s,
                    observation.set_point_age_s,
                ),
            ] {
                let late = !is_finite(seconds) || limit.is_below(seconds);
                latch.report(code, run.reaches(limit.samples, late), seconds);
            }
        });
        state.first
    }

    /// The fault that came first since the last [`clear`](Self::clear).
    #[must_use]
    pub fn first(&self) -> Option<Fault> {
        self.state.first
    }

    /// The codes that are latched at a site; none at one that the finger does not have.
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

    /// All that is latched, site by site.
    pub fn faults(&self) -> impl Iterator<Item = (FaultSite, FaultCode)> {
        let joints = (0..N).flat_map(|joint| {
            let Pair { flexor, extensor } = FaultSite::tendons(joint);
            [flexor, extensor, FaultSite::Joint(joint)]
        });
        joints
            .chain([FaultSite::Finger])
            .flat_map(|site| self.at(site).iter().map(move |code| (site, code)))
    }

    /// Forgets all faults, and all samples.
    pub fn clear(&mut self) {
        self.state = State::new();
    }
}
