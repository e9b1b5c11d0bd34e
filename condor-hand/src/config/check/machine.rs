//! Rules of what is around the fingers: rates, processors, the table, channels.

use super::at::{At, NOT_NEGATIVE, POSITIVE, Rule};
use crate::Requirement;
use crate::config::{
    Allowed, Axis, Converter, FaultPolicy, Hand, Mistake, MistakeValue, ProcessorKind, Wire,
};
use crate::number::is_within;

impl<const F: usize, const J: usize, const A: usize> Hand<F, J, A> {
    pub(super) fn check_rates(&self, at: &At) -> Result<(), Mistake> {
        let trajectory_hz = self.trajectory_hz;
        self.check_rate(at, "trajectory_hz", trajectory_hz)?;
        self.check_rate(at, "servo_hz", self.servo_hz)?;
        // So many servo ticks can be between two set-points.
        let most = f64::from(u16::MAX) * f64::from(trajectory_hz);
        let servo_hz = f64::from(self.servo_hz);
        at.number("servo_hz", servo_hz, Requirement::AtMost(most))?;
        for (index, processor) in self.processors.iter().enumerate() {
            if let Some(rate_hz) = processor.rate_hz {
                let at = At::processor(index, processor.number);
                self.check_rate(&at, "rate_hz", rate_hz)?;
            }
        }
        Ok(())
    }

    fn check_rate(&self, at: &At, field: &str, rate_hz: u32) -> Result<(), Mistake> {
        at.number(field, f64::from(rate_hz), POSITIVE)?;
        if rate_hz.is_multiple_of(self.trajectory_hz) {
            return Ok(());
        }
        let must = Requirement::MultipleOf(f64::from(self.trajectory_hz));
        Err(at.off(field, rate_hz.into(), must, ", the trajectories' rate"))
    }

    pub(super) fn check_constants(&self, at: &At) -> Result<(), Mistake> {
        at.name(&self.name, core::iter::empty())?;
        at.number("transition_s", self.transition_s, POSITIVE)?;
        at.list("gravity", &self.gravity, Requirement::Finite)?;
        let rules = self.faults.rules(self.servo_hz);
        at.table("faults").numbers(rules)?;
        self.contact.as_ref().map_or(Ok(()), |contact| {
            at.table("contact").numbers([
                ("friction", contact.friction, POSITIVE),
                ("safety", contact.safety, Requirement::AtLeast(1.0)),
            ])
        })
    }

    pub(super) fn check_processors(&self, at: &At) -> Result<(), Mistake> {
        at.not_empty("processors", self.processors.is_empty())?;
        for (index, processor) in self.processors.iter().enumerate() {
            let at = At::processor(index, processor.number);
            let mut earlier = self.processors.iter().take(index);
            if earlier.any(|other| other.number == processor.number) {
                return Err(at.words("number", "taken already", "give each its own"));
            }
            at.numbers([
                ("loop_us", processor.loop_us, NOT_NEGATIVE),
                ("joint_us", processor.joint_us, NOT_NEGATIVE),
                ("budget", processor.budget, POSITIVE),
                ("budget", processor.budget, Requirement::AtMost(1.0)),
            ])?;
        }
        Ok(())
    }

    pub(super) fn check_axes(&self, at: &At) -> Result<(), Mistake> {
        let Some(table) = &self.table else {
            return Ok(());
        };
        at.not_empty("table.axes", table.axes.is_empty())?;
        for (index, axis) in table.axes.iter().enumerate() {
            let at = At::axis(index, &axis.name);
            let earlier = table.axes.iter().take(index);
            at.name(&axis.name, earlier.map(|axis| &axis.name))?;
            let processor = at.served(self, axis.processor, ProcessorKind::Table)?;
            axis.check(&at, self.rate_hz(processor))?;
        }
        Ok(())
    }

    pub(super) fn check_channels(&self) -> Result<(), Mistake> {
        for (index, (channel, second)) in self.wires().enumerate() {
            let mut earlier = self.wires().take(index);
            if let Some((_, first)) = earlier.find(|(other, _)| *other == channel) {
                let field = |wire: Wire| match (wire, channel.converter) {
                    (Wire::Encoder { .. }, _) => "encoder.channel",
                    (_, Converter::Adc) => "adc.channel",
                    (_, Converter::Dac) => "dac.channel",
                };
                let allowed = Allowed::OtherThan(self.end(first).path(field(first)));
                let value = MistakeValue::Channel(channel);
                return Err(self.end(second).wrong(field(second), value, allowed));
            }
        }
        Ok(())
    }

    /// The table that names the channels of a wire.
    fn end(&self, wire: Wire) -> At {
        let of_finger = |finger: usize| {
            let name = self.fingers.get(finger).map(|finger| finger.name.clone());
            At::finger(finger, &name.unwrap_or_default())
        };
        let of_joint = |finger: usize, joint: usize| {
            let name = self.joint(finger, joint).map(|joint| joint.name.clone());
            of_finger(finger).joint(joint, &name.unwrap_or_default())
        };
        match wire {
            Wire::Position { finger, joint } => of_joint(finger, joint),
            Wire::Actuator { finger, actuator } | Wire::Encoder { finger, actuator } => {
                let entry = self.actuator(finger, actuator);
                let name = entry.map(|actuator| actuator.name.clone());
                of_finger(finger).actuator(actuator, &name.unwrap_or_default())
            }
            Wire::Touch { finger } => of_finger(finger).table("touch"),
            Wire::Axis { axis } => {
                let entry = self.table.as_ref().and_then(|table| table.axes.get(axis));
                let name = entry.map(|axis| axis.name.clone());
                At::axis(axis, &name.unwrap_or_default())
            }
        }
    }

    pub(super) fn check_load(&self) -> Result<(), Mistake> {
        for (index, processor) in self.processors.iter().enumerate() {
            let (load, budget) = (self.load(processor), processor.budget);
            if load > budget {
                let at = At::processor(index, processor.number);
                let reason = ", which its loop takes of its time; give it fewer joints or axes, or a lower rate";
                return Err(at.off("budget", budget, Requirement::AtLeast(load), reason));
            }
        }
        Ok(())
    }
}

impl FaultPolicy {
    /// The rules of its numbers, with servos of this rate.
    pub(in crate::config) fn rules(&self, servo_hz: u32) -> [Rule; 11] {
        // The way to rest takes two ticks or more, which 32 bits count.
        let servo_hz = f64::from(servo_hz);
        let least = Requirement::AtLeast(2.0 / servo_hz);
        let most = Requirement::AtMost(f64::from(u32::MAX) / servo_hz);
        [
            ("safe_s", self.safe_s, least),
            ("safe_s", self.safe_s, most),
            ("stale_s", self.stale_s, POSITIVE),
            ("effort_samples", self.effort_samples.into(), POSITIVE),
            ("sensor_samples", self.sensor_samples.into(), POSITIVE),
            ("lost_samples", self.lost_samples.into(), POSITIVE),
            ("frozen_rad", self.frozen_rad, POSITIVE),
            ("tracking_rad", self.tracking_rad, POSITIVE),
            ("tracking_samples", self.tracking_samples.into(), POSITIVE),
            ("overtravel_rad", self.overtravel_rad, NOT_NEGATIVE),
            ("missed_deadlines", self.missed_deadlines.into(), POSITIVE),
        ]
    }
}

impl Axis {
    /// The rules of its numbers that do not depend on others.
    pub(in crate::config) fn rules(&self) -> [Rule; 7] {
        [
            ("mass_kg", self.mass_kg, POSITIVE),
            ("viscous", self.viscous, NOT_NEGATIVE),
            ("max_n", self.max_n, POSITIVE),
            ("servo.kp", self.servo.kp, NOT_NEGATIVE),
            ("servo.kv", self.servo.kv, NOT_NEGATIVE),
            ("servo.ki", self.servo.ki, NOT_NEGATIVE),
            ("servo.integral_max", self.servo.integral_max, NOT_NEGATIVE),
        ]
    }

    fn check(&self, at: &At, rate_hz: u32) -> Result<(), Mistake> {
        at.unit("direction", self.direction)?;
        at.limits(&self.limits)?;
        let (low, high) = (self.limits.low, self.limits.high);
        if !is_within(self.home, low, high) {
            at.numbers([
                ("home", self.home, Requirement::AtLeast(low)),
                ("home", self.home, Requirement::AtMost(high)),
            ])?;
        }
        at.numbers(self.rules())?;
        let cutoff_hz = Some(self.servo.velocity_cutoff_hz);
        at.cutoff("servo.velocity_cutoff_hz", cutoff_hz, rate_hz)?;
        at.input("adc", &self.adc, [low, high])?;
        at.output(&self.dac, [-self.max_n, self.max_n])
    }
}
