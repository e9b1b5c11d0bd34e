//! [`Readings`]: which readings of positions are believed, and what stands for the others.

use super::JointSettings;
use crate::control::elapsed::Elapsed;
use crate::math::{abs, clamp, is_finite};

/// Readings differ from where a joint is by so many times what the sensor tells apart.
const NOISE: f64 = 3.0;

/// The readings of the positions of N joints.
///
/// One that is not finite, or too far from the last one and from where the rate leads, is lost. So is one that
/// stands while the joint went, and its set-point went on. A joint goes on at its rate meanwhile.
#[derive(Clone, Debug)]
pub(super) struct Readings<const N: usize> {
    /// The number of joints; the places after them are empty.
    count: usize,
    /// By which a rate changes at most, rad/s.
    change: [f64; N],
    resolution: [f64; N],
    frozen: [f64; N],
    /// The last that were believed, rad.
    last: [f64; N],
    /// The time since then, and since any number came, s; zero but for what is lost.
    away: [f64; N],
    silent: [f64; N],
    /// The last that was another, rad, the time since then, s, at which rate it had changed, rad/s, and where
    /// the joint was to be then, rad.
    there: [f64; N],
    still: [f64; N],
    going: [f64; N],
    wanted: [f64; N],
    /// A bit for each that is lost.
    pub(super) lost: u32,
}

/// A rate with which a joint went on unseen: rad/s, and for how long, s.
pub(super) type UnseenMotion = Option<(f64, f64)>;

impl<const N: usize> Readings<N> {
    pub(super) fn new(joints: &[JointSettings]) -> Self {
        let none = [0.0; N];
        let each = |number: fn(&JointSettings) -> f64| {
            core::array::from_fn(|joint| joints.get(joint).map_or(0.0, number))
        };
        Self {
            count: joints.len(),
            change: each(|joint| joint.rate_change),
            resolution: each(|joint| joint.resolution_rad),
            frozen: each(|joint| joint.frozen_rad),
            last: none,
            away: none,
            silent: none,
            there: none,
            still: none,
            going: none,
            wanted: none,
            lost: 0,
        }
    }

    /// Takes the believed readings of joints that were `seen` once, and replaces the others by the position that
    /// the joint would have. `targets` are the desired positions, NaN for joints that follow nothing. Returns the
    /// rates of joints whose sensors turn out to have stood.
    #[inline(always)]
    pub(super) fn take(
        &mut self,
        positions: &mut [f64; N],
        seen: &mut [bool; N],
        rates: &[f64; N],
        targets: &[f64; N],
        elapsed: Elapsed,
    ) -> [UnseenMotion; N] {
        let mut unseen = [None; N];
        self.lost = 0;
        for lane in 0..self.count.min(N) {
            let position = positions[lane];
            let is_number = is_finite(position);
            self.away[lane] += elapsed.seconds;
            self.silent[lane] += elapsed.seconds;
            self.still[lane] += elapsed.seconds;
            let (moved, still) = (position - self.last[lane], self.still[lane]);
            let way = rates[lane] * self.away[lane];
            let is_near = self.is_near(lane, moved, way, self.silent[lane]);
            if is_number {
                self.silent[lane] = 0.0;
            }
            let gone = position - self.there[lane];
            let stands = self.stands(lane, gone);
            let going = self.going[lane];
            let led = targets[lane] - self.wanted[lane];
            let led = if going > 0.0 { led } else { -led };
            // A reading that was off has not shown how fast the joint goes, and a joint that falls behind may stand.
            let far = abs(going) * still;
            let has_gone = far > self.frozen[lane];
            let as_led = far < 4.0 * led && 2.0 * far > led;
            let is_frozen = stands && has_gone && as_led && led > self.frozen[lane];
            // A filter that began with a position that never was would show a rate.
            let begins = is_number && !seen[lane];
            if begins || seen[lane] && is_near && !is_frozen {
                if begins || !stands {
                    self.going[lane] = if begins { 0.0 } else { gone / still };
                    self.there[lane] = position;
                    self.still[lane] = 0.0;
                    self.wanted[lane] = targets[lane];
                } else if has_gone {
                    // Otherwise it was to stop, and has.
                    let goes_on = led > self.resolution[lane];
                    self.going[lane] = if goes_on { going } else { 0.0 };
                }
                self.last[lane] = position;
                self.away[lane] = 0.0;
                seen[lane] = true;
                continue;
            }
            positions[lane] = self.last[lane];
            if seen[lane] {
                self.lost |= 1 << lane;
                if is_frozen && self.away[lane] < still {
                    // The sensor has shown no change for longer than it seemed.
                    self.away[lane] = still;
                    // As fast as it went, but no faster than it was to go.
                    let to_go = led / still;
                    let rate = clamp(going, -to_go, to_go);
                    unseen[lane] = Some((rate, still));
                }
                let rate = unseen[lane].map_or(rates[lane], |(rate, _)| rate);
                positions[lane] += rate * self.away[lane];
            }
        }
        unseen
    }

    /// Returns the position that the next tick would use, without regard to sensors that stand: the reading,
    /// or, if it is not believed, the position that the joint would have.
    pub(super) fn plausible(
        &self,
        lane: usize,
        position: f64,
        rate: f64,
        elapsed: Elapsed,
    ) -> Option<f64> {
        let (last, away) = (*self.last.get(lane)?, *self.away.get(lane)?);
        let silent = *self.silent.get(lane)? + elapsed.seconds;
        let way = rate * (away + elapsed.seconds);
        let is_near = lane < N && self.is_near(lane, position - last, way, silent);
        Some(if is_near { position } else { last + way })
    }

    /// Begins anew with the next readings.
    pub(super) fn forget(&mut self) {
        let none = [0.0; N];
        (self.away, self.silent, self.going) = (none, none, none);
        self.lost = 0;
    }

    /// Returns true if a joint can have moved this far, or be this far from its way, in this time, s. False for
    /// numbers that are not finite.
    #[inline(always)]
    fn is_near(&self, lane: usize, moved: f64, way: f64, seconds: f64) -> bool {
        let reach = self.change[lane] * seconds + NOISE * self.resolution[lane];
        abs(moved - way) <= reach || abs(moved) <= reach
    }

    /// Returns true if the sensor shows the same as before.
    #[inline(always)]
    fn stands(&self, lane: usize, gone: f64) -> bool {
        abs(gone) < 0.5 * self.resolution[lane]
    }
}
