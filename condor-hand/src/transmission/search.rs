//! The search for efforts where limits and co-contraction leave a choice.
//!
//! The efforts f for the torques t are those that minimise
//!
//! ```text
//! Σ (f - bias)²,  where  P f = t  and  low <= f <= high
//! ```
//!
//! with the arms P of the actuators at the joints. If no efforts within the limits give the torques, each torque is
//! limited to what its joint can have by itself. The efforts then are those with the least
//! `Σ ((P f - t)_j / |P_j|)²`, where `|P_j|` is the length of the row of joint j: the torques are the nearest, and
//! joints that share actuators share what is missing. They are off from the nearest by less than a millionth of the
//! efforts.
//!
//! For each torque there is a multiplier y, and `f = clamp(bias + Pᵀ y, low, high)`. The multipliers maximise a
//! concave function, whose pieces are quadratic: Newton's method, with an exact search along each step, ends after
//! few steps (L. Qi, J. Sun, A nonsmooth version of Newton's method, Mathematical Programming 58, 1993). Where no
//! efforts give the torques, y grows without bounds. A second search for the nearest torques then subtracts a little of
//! y² from the function, so that it has a greatest value.

use super::EffortLimits;
use crate::math::{abs, clamp, is_finite, max, min, sqrt};

/// A search for the multipliers that maximise their function less `weight y² / 2`. The efforts of that maximum are those
/// with the least `Σ (f - bias)² + Σ ((P f - t)_j / |P_j|)² / weight`.
#[derive(Clone, Copy)]
struct Accuracy {
    weight: f64,
    /// The search has ended when what is missing is less than `reached` times the greatest effort.
    reached: f64,
    /// The search gives up when a multiplier is more than `far` times the greatest effort: no efforts give the torques.
    far: f64,
    /// The most steps of Newton's method.
    steps: u32,
}

/// The search for torques that the actuators can give.
const EXACT: Accuracy = Accuracy {
    weight: 1e-13,
    reached: 1e-12,
    far: 1e6,
    steps: 20,
};

/// The search for the nearest torques, if they cannot give them.
const NEAREST: Accuracy = Accuracy {
    weight: 1e-6,
    reached: 1e-8,
    far: f64::INFINITY,
    steps: 40,
};

/// A joint is saturated if more than this part of the greatest effort is missing.
const MISSING: f64 = 1e-9;

/// The same after a search for the nearest torques, with its accuracy.
const MISSING_NEAREST: f64 = 1e-5;

/// The arms of actuators at N joints, made ready for [`choose`](Arms::choose).
#[derive(Clone, Copy, Debug)]
pub(super) struct Arms<'a, const N: usize> {
    /// A column for each actuator. Each row is divided by its length.
    pub(super) columns: &'a [[f64; N]],
    /// The limits of the actuators.
    pub(super) limits: &'a [EffortLimits],
    pub(super) rows: &'a Rows<N>,
}

/// The joints' side of the arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rows<const N: usize> {
    /// One over the lengths of the rows, 1/m.
    per_length: [f64; N],
    /// The inverse of the product of the scaled arms with their transpose.
    inverse: [[f64; N]; N],
}

/// The effort of an actuator while it is searched.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Actuated {
    /// The effort that the multipliers ask for, without regard to limits.
    open: f64,
    /// Its change in a whole step of Newton's method.
    rate: f64,
    /// The effort within the limits, N or N m.
    pub(super) effort: f64,
}

impl Actuated {
    /// The effort of an actuator of which nothing is asked but its limits.
    #[inline(always)]
    pub(super) fn preferred(limits: EffortLimits) -> Self {
        Self {
            effort: limits.clamp(limits.bias),
            ..Self::default()
        }
    }
}

/// The result of [`Arms::choose`], beside the efforts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Choice {
    /// A bit for each joint whose torque is not the one that was asked for.
    pub(super) saturated: u32,
    /// The steps of Newton's method.
    pub(super) steps: u32,
}

impl<const N: usize> Rows<N> {
    /// Divides the rows of a matrix of arms by their lengths. A joint without arms keeps its row of zeros.
    ///
    /// # Errors
    /// The number of a joint that has arms, but whose torque depends on those of the joints after it.
    pub(super) fn new(columns: &mut [[f64; N]]) -> Result<Self, usize> {
        let (mut per_length, mut product) = ([0.0; N], [[0.0; N]; N]);
        for (joint, per_length) in per_length.iter_mut().enumerate() {
            let of_joint = || columns.iter().filter_map(|column| column.get(joint));
            // Arms whose squares are too small or too large for a number still have a length.
            let longest = of_joint().fold(0.0, |longest, &arm| max(longest, abs(arm)));
            if longest == 0.0 {
                product[joint][joint] = 1.0;
                continue;
            }
            let sum = of_joint().fold(0.0, |sum, &arm| sum + (arm / longest) * (arm / longest));
            *per_length = 1.0 / (longest * sqrt(sum));
            if !is_finite(*per_length) {
                return Err(joint);
            }
        }
        for column in columns {
            for (arm, per_length) in column.iter_mut().zip(&per_length) {
                *arm *= per_length;
            }
            add_square(&mut product, column);
        }
        // From the last joint to the first: a joint that tendons of more distal joints cross needs some of its own.
        let mut reversed = [[0.0; N]; N];
        for (row, from) in reversed.iter_mut().zip(product.iter().rev()) {
            for (element, from) in row.iter_mut().zip(from.iter().rev()) {
                *element = *from;
            }
        }
        let pivots = Factors::new(reversed).pivots;
        if let Some(joint) = pivots.iter().position(|&pivot| pivot <= 1e-9) {
            return Err(N - 1 - joint);
        }
        let factors = Factors::new(product);
        let mut inverse = [[0.0; N]; N];
        for (joint, row) in inverse.iter_mut().enumerate() {
            let mut unit = [0.0; N];
            unit[joint] = 1.0;
            *row = factors.solve(&unit);
        }
        Ok(Self {
            per_length,
            inverse,
        })
    }

    /// Inverts scaled arms by least squares: the position of a joint is the sum of these parts of the positions of the
    /// actuators.
    pub(super) fn positions<const A: usize>(&self, scaled: &[[f64; N]; A]) -> [[f64; A]; N] {
        let mut parts = [[0.0; A]; N];
        let joints = self.inverse.iter().zip(&self.per_length);
        for (parts, (row, per_length)) in parts.iter_mut().zip(joints) {
            for (part, column) in parts.iter_mut().zip(scaled) {
                let sum = row.iter().zip(column).fold(0.0, |sum, (a, b)| sum + a * b);
                *part = per_length * sum;
            }
        }
        parts
    }
}

impl<'a, const N: usize> Arms<'a, N> {
    /// The column and the limits of each actuator.
    #[inline(always)]
    fn actuators(&self) -> impl Iterator<Item = (&'a [f64; N], &'a EffortLimits)> + use<'a, N> {
        self.columns.iter().zip(self.limits)
    }

    /// Chooses the efforts for the torques of the `joints` of this bit mask; the torques of all others are
    /// what they come to. `actuated` has an element for each actuator. Torques must be finite.
    pub(super) fn choose(
        &self,
        torques: &[f64; N],
        joints: u32,
        actuated: &mut [Actuated],
    ) -> Choice {
        let mut search = Search {
            arms: *self,
            wanted: core::array::from_fn(|joint| torques[joint] * self.rows.per_length[joint]),
            joints,
            multipliers: [0.0; N],
            weight: 0.0,
        };
        // A joint without arms has no torque.
        let mut still = 0;
        for (joint, (torque, per_length)) in torques.iter().zip(&self.rows.per_length).enumerate() {
            still |= u32::from(*per_length == 0.0 && *torque != 0.0) << joint;
        }
        still &= joints;
        let all = u32::MAX >> (32 - N);
        if joints & all == all && search.without_limits(actuated) {
            let (saturated, steps) = (still, 0);
            return Choice { saturated, steps };
        }
        let Choice { saturated, steps } = search.choose(actuated);
        let saturated = saturated | still;
        Choice { saturated, steps }
    }
}

/// The search for the multipliers.
struct Search<'a, const N: usize> {
    arms: Arms<'a, N>,
    /// The torques, divided by the lengths of the rows.
    wanted: [f64; N],
    joints: u32,
    multipliers: [f64; N],
    weight: f64,
}

impl<const N: usize> Search<'_, N> {
    /// The efforts as if there were no limits. Returns true if they are within the limits.
    #[inline(always)]
    fn without_limits(&mut self, actuated: &mut [Actuated]) -> bool {
        let mut rest = self.wanted;
        for (column, limits) in self.arms.actuators() {
            subtract(&mut rest, column, limits.bias);
        }
        let multipliers = self.arms.rows.inverse.map(|row| dot(&row, &rest));
        let mut is_within = true;
        for ((column, limits), one) in self.arms.actuators().zip(actuated) {
            one.effort = limits.bias + dot(column, &multipliers);
            is_within &= one.effort >= limits.low && one.effort <= limits.high;
        }
        self.multipliers = multipliers;
        is_within
    }

    /// The efforts within the limits.
    fn choose(&mut self, actuated: &mut [Actuated]) -> Choice {
        let mut saturated = self.limit();
        // Torques that are not possible may have been too large for numbers.
        if saturated != 0 {
            self.multipliers = [0.0; N];
        }
        let begin = self.multipliers;
        let size = norm(&self.wanted);
        let mut steps = self.run(&EXACT, size, actuated);
        let (mut rest, mut largest) = self.missing(size, actuated);
        let mut least = MISSING * (1.0 + largest);
        if norm(&rest) > least {
            self.multipliers = begin;
            steps += self.run(&NEAREST, size, actuated);
            (rest, largest) = self.missing(size, actuated);
            // At least one joint lacks something.
            least = min(MISSING_NEAREST * (1.0 + largest), 0.5 * norm(&rest));
        }
        for (joint, rest) in rest.iter().enumerate() {
            saturated |= u32::from(abs(*rest) > least) << joint;
        }
        Choice { saturated, steps }
    }

    /// Limits each torque to what its joint can have by itself. Returns a bit for each that was beyond that.
    fn limit(&mut self) -> u32 {
        let (mut low, mut high) = ([0.0; N], [0.0; N]);
        for (column, limits) in self.arms.actuators() {
            for ((arm, low), high) in column.iter().zip(&mut low).zip(&mut high) {
                let ends = (arm * limits.low, arm * limits.high);
                *low += min(ends.0, ends.1);
                *high += max(ends.0, ends.1);
            }
        }
        let mut beyond = 0;
        for joint in 0..N {
            let asked = self.wanted[joint];
            let wanted = clamp(asked, low[joint], high[joint]);
            let is_beyond = abs(asked - wanted) > MISSING * (1.0 + abs(wanted));
            beyond |= u32::from(is_beyond) << joint;
            self.wanted[joint] = if self.is_asked(joint) { wanted } else { 0.0 };
        }
        beyond & self.joints
    }

    /// Searches from the present multipliers on, and returns the number of steps. `size` is the greatest torque.
    fn run(&mut self, accuracy: &Accuracy, size: f64, actuated: &mut [Actuated]) -> u32 {
        self.weight = accuracy.weight;
        for step in 0..accuracy.steps {
            let rest = self.rest(actuated);
            let largest = greatest(size, actuated);
            let is_far = norm(&self.multipliers) > accuracy.far * largest;
            if norm(&rest) <= accuracy.reached * largest || is_far {
                return step;
            }
            self.step(&rest, actuated);
        }
        accuracy.steps
    }

    /// The torques that are missing, and the greatest effort or torque.
    fn missing(&mut self, size: f64, actuated: &mut [Actuated]) -> ([f64; N], f64) {
        self.weight = 0.0;
        let rest = self.rest(actuated);
        (rest, greatest(size, actuated))
    }

    /// Sets the efforts of the present multipliers, and returns the slopes of the function: what is missing of the
    /// torques, less the weighted multipliers.
    #[inline(always)]
    fn rest(&self, actuated: &mut [Actuated]) -> [f64; N] {
        let mut rest = self.wanted;
        for ((column, limits), one) in self.arms.actuators().zip(actuated) {
            one.open = limits.bias + dot(column, &self.multipliers);
            one.effort = limits.clamp(one.open);
            subtract(&mut rest, column, one.effort);
        }
        for (joint, rest) in rest.iter_mut().enumerate() {
            *rest = if self.is_asked(joint) {
                *rest - self.weight * self.multipliers[joint]
            } else {
                0.0
            };
        }
        rest
    }

    /// Takes one step.
    #[inline(always)]
    fn step(&mut self, rest: &[f64; N], actuated: &mut [Actuated]) {
        let mut hessian = [[0.0; N]; N];
        for ((column, limits), one) in self.arms.actuators().zip(&*actuated) {
            // An actuator at a limit can change its effort one way.
            let free = if one.open > limits.low && one.open < limits.high {
                true
            } else if one.open == limits.low {
                limits.low < limits.high && dot(column, rest) > 0.0
            } else {
                one.open == limits.high && dot(column, rest) < 0.0
            };
            if free {
                add_square(&mut hessian, column);
            }
        }
        for (joint, row) in hessian.iter_mut().enumerate() {
            for (other, element) in row.iter_mut().enumerate() {
                if !(self.is_asked(joint) && self.is_asked(other)) {
                    *element = 0.0;
                }
            }
            row[joint] += self.weight;
        }
        let direction = Factors::new(hessian).solve(rest);
        for (column, one) in self.arms.columns.iter().zip(&mut *actuated) {
            one.rate = dot(column, &direction);
        }
        let line = Line {
            limits: self.arms.limits,
            actuated,
            slope: dot(&self.wanted, &direction) - self.weight * dot(&self.multipliers, &direction),
            change: self.weight * dot(&direction, &direction),
        };
        let part = line.part(dot(rest, &direction));
        for (multiplier, step) in self.multipliers.iter_mut().zip(&direction) {
            *multiplier += part * step;
        }
    }

    fn is_asked(&self, joint: usize) -> bool {
        self.joints >> joint & 1 == 1
    }
}

/// The function of the multipliers along a step.
struct Line<'a> {
    limits: &'a [EffortLimits],
    actuated: &'a [Actuated],
    /// The part of the slope at the beginning that does not depend on efforts, and what a whole step takes from it.
    slope: f64,
    change: f64,
}

impl Line<'_> {
    /// The part of the step, at most the whole, after which the function is greatest. `begin` is the slope at the
    /// beginning.
    fn part(&self, begin: f64) -> f64 {
        let end = self.slope(1.0);
        if end >= -1e-9 * begin {
            return 1.0;
        }
        // The slope is a line between two parts of the step at which actuators reach limits.
        let (mut low, mut high) = ((0.0, begin), (1.0, end));
        for (limits, one) in self.limits.iter().zip(self.actuated) {
            for limit in [limits.low, limits.high] {
                let at = (limit - one.open) / one.rate;
                if at > low.0 && at < high.0 {
                    let slope = self.slope(at);
                    if slope > 0.0 {
                        low = (at, slope);
                    } else {
                        high = (at, slope);
                    }
                }
            }
        }
        low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1)
    }

    /// The slope after a part of the step.
    #[inline(always)]
    fn slope(&self, part: f64) -> f64 {
        let mut slope = self.slope - part * self.change;
        for (limits, one) in self.limits.iter().zip(self.actuated) {
            slope -= limits.clamp(one.open + part * one.rate) * one.rate;
        }
        slope
    }
}

/// The greatest effort, or `size`.
#[inline(always)]
fn greatest(size: f64, actuated: &[Actuated]) -> f64 {
    let efforts = actuated.iter().map(|one| abs(one.effort));
    efforts.fold(size, max)
}

/// The largest element.
#[inline(always)]
fn norm<const N: usize>(x: &[f64; N]) -> f64 {
    x.iter().fold(0.0, |most, &one| max(most, abs(one)))
}

/// The sum of the products of the elements.
#[inline(always)]
fn dot<const N: usize>(x: &[f64; N], y: &[f64; N]) -> f64 {
    x.iter().zip(y).fold(0.0, |sum, (x, y)| sum + x * y)
}

/// Subtracts a multiple of a column.
#[inline(always)]
fn subtract<const N: usize>(from: &mut [f64; N], column: &[f64; N], times: f64) {
    for (from, arm) in from.iter_mut().zip(column) {
        *from -= arm * times;
    }
}

/// Adds the product of a column with its transpose.
#[inline(always)]
fn add_square<const N: usize>(to: &mut [[f64; N]; N], column: &[f64; N]) {
    for (row, arm) in to.iter_mut().zip(column) {
        for (element, other) in row.iter_mut().zip(column) {
            *element += arm * other;
        }
    }
}

/// The factors `L D Lᵀ` of a symmetric matrix.
struct Factors<const N: usize> {
    /// Below the diagonal.
    lower: [[f64; N]; N],
    pivots: [f64; N],
}

impl<const N: usize> Factors<N> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "as the equations have it")]
    fn new(mut matrix: [[f64; N]; N]) -> Self {
        let mut pivots = [0.0; N];
        for i in 0..N {
            for j in 0..i {
                let own = matrix[i][j];
                for k in j + 1..i {
                    matrix[i][k] -= own * matrix[k][j];
                }
                let factor = own / pivots[j];
                matrix[i][i] -= own * factor;
                matrix[i][j] = factor;
            }
            // A singular matrix becomes one that is almost singular.
            pivots[i] = max(matrix[i][i], 1e-13);
        }
        Self {
            lower: matrix,
            pivots,
        }
    }

    /// The x of `matrix x = right`.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "as the equations have it")]
    fn solve(&self, right: &[f64; N]) -> [f64; N] {
        let mut x = *right;
        for i in 0..N {
            for j in 0..i {
                x[i] -= self.lower[i][j] * x[j];
            }
        }
        for i in (0..N).rev() {
            x[i] /= self.pivots[i];
            for k in i + 1..N {
                x[i] -= self.lower[k][i] * x[k];
            }
        }
        x
    }
}
