//! Rules of what is around the fingers: rates, processors, the table, channels.

use super::place::{Examiner, NOT_NEGATIVE, POSITIVE, Root, TAKEN};
use crate::Requirement;
use crate::config::{Axis, Channel, Mistake, Problem, ProcessorKind, Wire};
use crate::number::is_within;

impl<const F: usize, const J: usize> Examiner<'_, F, J> {
    pub(super) fn rates(&mut self) -> Result<(), Mistake> {
        let hand = self.hand;
        let trajectory_hz = hand.trajectory_hz;
        self.rate(Root::Hand, "trajectory_hz", trajectory_hz)?;
        self.rate(Root::Hand, "servo_hz", hand.servo_hz)?;
        // So many servo ticks can be between two set-points.
        let most = f64::from(u16::MAX) * f64::from(trajectory_hz);
        let servo_hz = f64::from(hand.servo_hz);
        self.number(Root::Hand, "servo_hz", servo_hz, Requirement::AtMost(most))?;
        for (index, processor) in hand.processors.iter().enumerate() {
            if let Some(rate_hz) = processor.rate_hz {
                self.rate(Root::ControlProcessor(index), "rate_hz", rate_hz)?;
            }
        }
        Ok(())
    }

    fn rate(&mut self, root: Root, field: &str, rate_hz: u32) -> Result<(), Mistake> {
        self.number(root, field, f64::from(rate_hz), POSITIVE)?;
        let trajectory_hz = self.hand.trajectory_hz;
        if rate_hz.is_multiple_of(trajectory_hz) {
            return Ok(());
        }
        let problem = Problem::Rate {
            rate_hz,
            trajectory_hz,
        };
        Err(self.wrong(root, field, problem))
    }

    pub(super) fn constants(&mut self) -> Result<(), Mistake> {
        let hand = self.hand;
        self.name(Root::Hand, &hand.name, core::iter::empty())?;
        self.number(Root::Hand, "transition_s", hand.transition_s, POSITIVE)?;
        self.list(Root::Hand, "gravity", &hand.gravity)?;
        let faults = &hand.faults;
        // The way to the least tensions takes two ticks or more, which 32 bits count.
        let servo_hz = f64::from(hand.servo_hz);
        let rows = [
            (
                "safe_s",
                faults.safe_s,
                Requirement::AtLeast(2.0 / servo_hz),
            ),
            (
                "safe_s",
                faults.safe_s,
                Requirement::AtMost(f64::from(u32::MAX) / servo_hz),
            ),
            ("stale_s", faults.stale_s, POSITIVE),
            ("tension_samples", faults.tension_samples.into(), POSITIVE),
            ("sensor_samples", faults.sensor_samples.into(), POSITIVE),
            ("lost_samples", faults.lost_samples.into(), POSITIVE),
            ("frozen_rad", faults.frozen_rad, POSITIVE),
            ("tracking_rad", faults.tracking_rad, POSITIVE),
            ("tracking_samples", faults.tracking_samples.into(), POSITIVE),
            ("overtravel_rad", faults.overtravel_rad, NOT_NEGATIVE),
            ("missed_deadlines", faults.missed_deadlines.into(), POSITIVE),
        ];
        self.numbers(Root::Hand, "faults", rows)?;
        if let Some(contact) = &hand.contact {
            let rows = [
                ("friction", contact.friction, POSITIVE),
                ("safety", contact.safety, Requirement::AtLeast(1.0)),
            ];
            self.numbers(Root::Hand, "contact", rows)?;
        }
        Ok(())
    }

    pub(super) fn processors(&mut self) -> Result<(), Mistake> {
        let hand = self.hand;
        self.not_empty(Root::Hand, "processors", hand.processors.is_empty())?;
        for (index, processor) in hand.processors.iter().enumerate() {
            let root = Root::ControlProcessor(index);
            let mut earlier = hand.processors.iter().take(index);
            if earlier.any(|other| other.number == processor.number) {
                return Err(self.wrong(root, "number", TAKEN));
            }
            let rows = [
                ("loop_us", processor.loop_us, NOT_NEGATIVE),
                ("joint_us", processor.joint_us, NOT_NEGATIVE),
                ("budget", processor.budget, POSITIVE),
                ("budget", processor.budget, Requirement::AtMost(1.0)),
            ];
            self.numbers(root, "", rows)?;
        }
        Ok(())
    }

    pub(super) fn axes(&mut self) -> Result<(), Mistake> {
        let Some(table) = &self.hand.table else {
            return Ok(());
        };
        self.not_empty(Root::Hand, "table.axes", table.axes.is_empty())?;
        for (index, entry) in table.axes.iter().enumerate() {
            let earlier = table.axes.iter().take(index).map(|axis| &axis.name);
            self.name(Root::Axis(index), &entry.name, earlier)?;
            self.axis(Root::Axis(index), entry)?;
        }
        Ok(())
    }

    fn axis(&mut self, root: Root, axis: &Axis) -> Result<(), Mistake> {
        let processor = self.processor(root, axis.processor, ProcessorKind::Table)?;
        let rate_hz = self.hand.rate_hz(processor);
        self.unit(root, "direction", axis.direction)?;
        self.limits(root, &axis.limits)?;
        let (low, high) = (axis.limits.low, axis.limits.high);
        if !is_within(axis.home, low, high) {
            let rows = [
                ("home", axis.home, Requirement::AtLeast(low)),
                ("home", axis.home, Requirement::AtMost(high)),
            ];
            self.numbers(root, "", rows)?;
        }
        let rows = [
            ("mass_kg", axis.mass_kg, POSITIVE),
            ("viscous", axis.viscous, NOT_NEGATIVE),
            ("max_n", axis.max_n, POSITIVE),
            ("servo.kp", axis.servo.kp, NOT_NEGATIVE),
            ("servo.kv", axis.servo.kv, NOT_NEGATIVE),
            ("servo.ki", axis.servo.ki, NOT_NEGATIVE),
            ("servo.integral_max", axis.servo.integral_max, NOT_NEGATIVE),
        ];
        self.numbers(root, "", rows)?;
        self.cutoff(
            root,
            "servo.velocity_cutoff_hz",
            axis.servo.velocity_cutoff_hz,
            rate_hz,
        )?;
        self.converters(
            root,
            "",
            (&axis.adc, [low, high]),
            Some((&axis.dac, [-axis.max_n, axis.max_n])),
        )
    }

    pub(super) fn channels(&mut self) -> Result<(), Mistake> {
        let hand = self.hand;
        for (index, (channel, second)) in hand.wires().enumerate() {
            let mut earlier = hand.wires().take(index);
            let Some((_, first)) = earlier.find(|(other, _)| *other == channel) else {
                continue;
            };
            let first = self.place(root_of(channel, first).0, "").owner;
            let (root, field) = root_of(channel, second);
            let problem = Problem::SameChannel { channel, first };
            return Err(self.wrong(root, field, problem));
        }
        Ok(())
    }
}

/// Returns the owner of a wire, and the table of its configuration that names the channel.
fn root_of(channel: Channel, wire: Wire) -> (Root, &'static str) {
    use crate::config::Converter::{Adc, Dac};
    match (wire, channel.converter) {
        (Wire::Position { finger, joint }, _) => (Root::Joint(finger, joint), "adc.channel"),
        (Wire::Flexor { finger, joint }, Adc) => (Root::Joint(finger, joint), "flexor.adc.channel"),
        (Wire::Flexor { finger, joint }, Dac) => (Root::Joint(finger, joint), "flexor.dac.channel"),
        (Wire::Extensor { finger, joint }, Adc) => {
            (Root::Joint(finger, joint), "extensor.adc.channel")
        }
        (Wire::Extensor { finger, joint }, Dac) => {
            (Root::Joint(finger, joint), "extensor.dac.channel")
        }
        (Wire::Touch { finger }, _) => (Root::Finger(finger), "touch.adc.channel"),
        (Wire::Axis { axis }, Adc) => (Root::Axis(axis), "adc.channel"),
        (Wire::Axis { axis }, Dac) => (Root::Axis(axis), "dac.channel"),
    }
}

impl<const F: usize, const J: usize> Examiner<'_, F, J> {
    pub(super) fn load(&mut self) -> Result<(), Mistake> {
        let hand = self.hand;
        for (index, processor) in hand.processors.iter().enumerate() {
            let load = hand.load(processor);
            if load > processor.budget {
                let budget = processor.budget;
                let problem = Problem::Load { load, budget };
                return Err(self.wrong(Root::ControlProcessor(index), "budget", problem));
            }
        }
        Ok(())
    }
}
