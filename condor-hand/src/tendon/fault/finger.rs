use nalgebra::SVector;

use super::sensor::{Joint, Latch, Run, Tendon};
use super::{Channel, Fault, FaultCode, FaultSet, FingerLimits, LimitsError};
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
/// tension or position that is not finite tells nothing about the other checks of its channel;
/// those go on after it. A time that is not finite is too long.
#[derive(Clone, Copy, Debug)]
pub struct FingerMonitor<T: Real, const N: usize> {
    limits: FingerLimits<T, N>,
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

    /// Judges one channel and keeps the first fault of all.
    #[inline(always)]
    fn judge(
        first: &mut Option<Fault>,
        channel: Channel,
        latched: &mut FaultSet,
        check: impl FnOnce(&mut Latch<'_>),
    ) {
        let mut latch = Latch {
            latched,
            first: None,
        };
        check(&mut latch);
        if let (None, Some((code, value))) = (*first, latch.first) {
            *first = Some(Fault {
                code,
                channel,
                value,
            });
        }
    }
}

impl<T: Real, const N: usize> FingerMonitor<T, N> {
    /// A monitor without faults.
    ///
    /// # Errors
    /// The first limit by which nothing can be judged.
    pub fn new(limits: FingerLimits<T, N>) -> Result<Self, LimitsError> {
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
            let channels = Channel::tendons(joint);
            let (tendon, latched) = &mut state.flexor;
            State::<T, N>::judge(first, channels.flexor, latched, |latch| {
                tendon.update(&limits.flexor, desired.flexor, measured.flexor, latch);
            });
            let (tendon, latched) = &mut state.extensor;
            State::<T, N>::judge(first, channels.extensor, latched, |latch| {
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
            State::<T, N>::judge(first, Channel::Joint(joint), latched, |latch| {
                state.update(limits, desired, measured, latch);
            });
        }
        State::<T, N>::judge(first, Channel::Finger, finger, |latch| {
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

    /// The codes that are latched at a channel; none at one that the finger does not have.
    #[must_use]
    pub fn at(&self, channel: Channel) -> FaultSet {
        let state = &self.state;
        let found = match channel {
            Channel::Flexor(joint) => state.tendons.get(joint).map(|pair| pair.flexor.1),
            Channel::Extensor(joint) => state.tendons.get(joint).map(|pair| pair.extensor.1),
            Channel::Joint(joint) => state.joints.get(joint).map(|joint| joint.1),
            Channel::Finger => Some(state.finger),
        };
        found.unwrap_or_default()
    }

    /// All that is latched, channel by channel.
    pub fn faults(&self) -> impl Iterator<Item = (Channel, FaultCode)> {
        let joints = (0..N).flat_map(|joint| {
            let Pair { flexor, extensor } = Channel::tendons(joint);
            [flexor, extensor, Channel::Joint(joint)]
        });
        joints
            .chain([Channel::Finger])
            .flat_map(|channel| self.at(channel).iter().map(move |code| (channel, code)))
    }

    /// Forgets all faults, and all samples.
    pub fn clear(&mut self) {
        self.state = State::new();
    }
}
