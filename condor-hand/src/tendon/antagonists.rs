use super::{Pair, TensionGains, TensionServo};
use crate::NumberError;
use crate::control::bank::Elapsed;
use crate::math::{Real, clamp, is_finite};

/// The tension servos of both tendons of a joint, which answer as two [`TensionServo`]s would.
///
/// Nearly always all numbers are finite and both have a last error: then one test serves for both,
/// and the arithmetic is that of vectors of two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Antagonists<T: Real> {
    kt: [T; 2],
    ki: [T; 2],
    kd: [T; 2],
    kv: [T; 2],
    max_n: [T; 2],
    /// The integral terms, N.
    term: [T; 2],
    desired: [T; 2],
    last_error: [T; 2],
    /// Whether there is such an error.
    has_last: [bool; 2],
    /// What each is by itself, but for its state.
    each: [TensionServo<T>; 2],
}

impl<T: Real> Antagonists<T> {
    pub(crate) fn new(servos: Pair<TensionServo<T>>) -> Self {
        let each = [servos.flexor, servos.extensor];
        let none = [T::zero(); 2];
        let mut antagonists = Self {
            kt: none,
            ki: none,
            kd: none,
            kv: none,
            max_n: none,
            term: none,
            desired: none,
            last_error: none,
            has_last: [false; 2],
            each,
        };
        antagonists.take_over();
        antagonists
    }

    /// Changes the gains; what the integrals have gathered stays.
    ///
    /// # Errors
    /// The first gain that is negative or not finite; then all stay.
    pub(crate) fn set_gains(&mut self, gains: &Pair<TensionGains<T>>) -> Result<(), NumberError> {
        self.give_back();
        let mut each = self.each;
        let [flexor, extensor] = &mut each;
        flexor.set_gains(gains.flexor)?;
        extensor.set_gains(gains.extensor)?;
        self.each = each;
        self.take_over();
        Ok(())
    }

    /// Forgets the integrals and the last errors.
    pub(crate) fn reset(&mut self) {
        self.term = [T::zero(); 2];
        self.has_last = [false; 2];
    }

    /// The commands in newtons for desired and measured tensions in newtons and the rates of the
    /// tendons' lengths in m/s.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "lanes have no branches")]
    pub(crate) fn update(
        &mut self,
        desired: &Pair<T>,
        measured: &Pair<T>,
        length_rate: &Pair<T>,
        elapsed: Elapsed<T>,
    ) -> Pair<T> {
        let asked = [desired.flexor, desired.extensor];
        let measured = [measured.flexor, measured.extensor];
        let length_rate = [length_rate.flexor, length_rate.extensor];
        let zero = T::zero();
        let mut next = *self;
        let mut command = [zero; 2];
        let mut test = [zero; 2];
        for i in 0..2 {
            let (max_n, term) = (self.max_n[i], self.term[i]);
            let desired = clamp(asked[i], zero, max_n);
            let error = desired - measured[i];
            let rate = (error - self.last_error[i]) * elapsed.hz * elapsed.weight;
            let damping = self.kv[i] * length_rate[i];
            let rest = desired + self.kt[i] * error + self.kd[i] * rate - damping;
            let increment = self.ki[i] * error * elapsed.seconds;
            let moved = clamp(term + increment, -max_n, max_n);
            let output = rest + moved;
            let winds_up = ((output > max_n) & (moved > term)) | ((output < zero) & (moved < term));
            next.term[i] = if winds_up { term } else { moved };
            next.desired[i] = desired;
            next.last_error[i] = error;
            command[i] = clamp(output, zero, max_n);
            // Whatever is not finite above is so here.
            test[i] = asked[i] + increment + output;
        }
        let [a, b] = test;
        let [first, second] = self.has_last;
        if !(first && second && is_finite(a + b)) {
            return self.update_each(&asked, &measured, &length_rate, elapsed);
        }
        self.term = next.term;
        self.desired = next.desired;
        self.last_error = next.last_error;
        let [flexor, extensor] = command;
        Pair { flexor, extensor }
    }

    #[cold]
    #[inline(never)]
    fn update_each(
        &mut self,
        desired: &[T; 2],
        measured: &[T; 2],
        rate: &[T; 2],
        elapsed: Elapsed<T>,
    ) -> Pair<T> {
        self.give_back();
        let [flexor, extensor] = &mut self.each;
        let command = Pair {
            flexor: flexor.update_after(desired[0], measured[0], rate[0], elapsed),
            extensor: extensor.update_after(desired[1], measured[1], rate[1], elapsed),
        };
        self.take_over();
        command
    }

    /// Gives the states to the servos by themselves.
    fn give_back(&mut self) {
        for (i, servo) in self.each.iter_mut().enumerate() {
            servo.integrator.set(self.term[i]);
            servo.desired = self.desired[i];
            servo.last_error = self.has_last[i].then_some(self.last_error[i]);
        }
    }

    /// Takes gains and states from them.
    fn take_over(&mut self) {
        self.kt = self.each.map(|servo| servo.gains.kt);
        self.ki = self.each.map(|servo| servo.gains.ki);
        self.kd = self.each.map(|servo| servo.gains.kd);
        self.kv = self.each.map(|servo| servo.gains.kv);
        self.max_n = self.each.map(|servo| servo.max_n);
        self.term = self.each.map(|servo| servo.integrator.term());
        self.desired = self.each.map(|servo| servo.desired);
        self.has_last = self.each.map(|servo| servo.last_error.is_some());
        self.last_error = self.each.map(|servo| servo.last_error.unwrap_or(T::zero()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_side_by_side_answer_as_each_by_itself() {
        let gains = |kt, ki, kd, kv| TensionGains { kt, ki, kd, kv };
        let gains = Pair {
            flexor: gains(2.0, 30.0, 1e-3, 5.0),
            extensor: gains(1.0, 0.0, 0.0, 0.0),
        };
        let mut alone = Pair {
            flexor: TensionServo::new(gains.flexor, 100.0, 400.0).unwrap(),
            extensor: TensionServo::new(gains.extensor, 150.0, 400.0).unwrap(),
        };
        let mut both = Antagonists::new(alone);
        let awkward = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            -0.0,
            f64::MIN_POSITIVE,
        ];
        let value = |tick: usize, salt: usize| {
            if tick % 13 == salt {
                awkward[tick / 13 % 6]
            } else {
                f64::from(u8::try_from(tick * (salt + 7) % 251).unwrap()) - 40.0
            }
        };
        for tick in 0..2000 {
            if tick == 500 {
                both.reset();
                alone.flexor.reset();
                alone.extensor.reset();
            }
            if tick == 1000 {
                let other = Pair::both(gains.extensor);
                both.set_gains(&other).unwrap();
                alone.flexor.set_gains(other.flexor).unwrap();
            }
            let pair = |salt| Pair {
                flexor: value(tick, salt),
                extensor: value(tick, salt + 1),
            };
            let (desired, measured, rate) = (pair(0), pair(2), pair(4));
            let elapsed = Elapsed::new([1.0, 0.9, 3.0][tick % 3] / 400.0, 400.0);
            let together = both.update(&desired, &measured, &rate, elapsed);
            let flexor =
                alone
                    .flexor
                    .update_after(desired.flexor, measured.flexor, rate.flexor, elapsed);
            let extensor = alone.extensor.update_after(
                desired.extensor,
                measured.extensor,
                rate.extensor,
                elapsed,
            );
            assert_eq!(together.flexor.to_bits(), flexor.to_bits(), "tick {tick}");
            assert_eq!(
                together.extensor.to_bits(),
                extensor.to_bits(),
                "tick {tick}"
            );
        }
    }
}
