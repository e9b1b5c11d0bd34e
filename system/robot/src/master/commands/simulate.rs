//! The commands that change the simulated robot: `ball`, `letgo`, `push`, `fault` and `clear`.

use condor_hand::decimal::Decimal;
use condor_rt::Machine;

use super::super::others::Ball;
use super::super::words::{Problem, Words};
use super::Commands;
use crate::joints::ActuatorName;
use crate::plant::{NumberRange, PlantRequest, PlantSensor};

impl<M: Machine> Commands<'_, '_, M> {
    pub(super) fn ball<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        if words.peek().next() == Some("none") {
            words.next();
            words.end()?;
            self.others.plant(&PlantRequest::RemoveBall)?;
            self.say(format_args!("there is no ball any more"));
            return Ok(());
        }
        let former = self.others.ball;
        let radius = words.maybe_within("a radius, m", NumberRange::RADIUS)?;
        let mass = words.maybe_within("a mass, kg", NumberRange::MASS)?;
        let center = match words.peek().next() {
            None => former.center,
            Some(_) => words.three_within("a position, m", NumberRange::PLACE)?,
        };
        words.end()?;
        let ball = Ball {
            center,
            radius: radius.unwrap_or(former.radius),
            mass: mass.unwrap_or(former.mass),
        };
        self.others.plant(&PlantRequest::PlaceBall {
            center: ball.center,
            radius: ball.radius,
            mass: ball.mass,
        })?;
        self.others.ball = ball;
        let [radius, mass] = [ball.radius, ball.mass].map(Decimal);
        let [x, y, z] = ball.center.map(Decimal);
        self.say(format_args!(
            "a ball of {radius} m and {mass} kg is held at {x} {y} {z} m from the palm until `letgo`"
        ));
        Ok(())
    }

    pub(super) fn letgo<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let seconds = words.maybe_within("a time, s", NumberRange::LET_GO)?;
        let seconds = seconds.unwrap_or(1.0);
        words.end()?;
        self.others.plant(&PlantRequest::LetGo { seconds })?;
        let seconds = Decimal(seconds);
        self.say(format_args!(
            "the support of the ball vanishes within {seconds} s"
        ));
        Ok(())
    }

    pub(super) fn push<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let force = words.three_within("a force, N", NumberRange::FORCE)?;
        let moment = match words.peek().next() {
            None => [0.0; 3],
            Some(_) => words.three_within("a moment, N m", NumberRange::MOMENT)?,
        };
        words.end()?;
        self.others.plant(&PlantRequest::Push { force, moment })?;
        if [force, moment].as_flattened().iter().all(|it| *it == 0.0) {
            self.say(format_args!("nothing pushes the ball any more"));
            return Ok(());
        }
        let [[fx, fy, fz], [mx, my, mz]] = [force, moment].map(|it| it.map(Decimal));
        self.say(format_args!(
            "the ball is pushed with {fx} {fy} {fz} N and {mx} {my} {mz} N m"
        ));
        Ok(())
    }

    pub(super) fn fault<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let what = "position, effort or drive";
        let kind = words.peek().nth(1);
        if let Some("effort" | "drive") = kind {
            let (finger, actuator) = words.actuator(self.hand)?;
            words.next();
            words.end()?;
            let name = ActuatorName(self.hand, finger, actuator);
            let described = self.hand.fingers.get(finger);
            let described = described.zip(self.hand.actuator(finger, actuator));
            let (finger, actuator) = (finger as u32, actuator as u32);
            if kind == Some("drive") {
                self.others
                    .plant(&PlantRequest::CutDrive { finger, actuator })?;
                self.say(format_args!("the drive {name} is cut; `clear` mends it"));
                return Ok(());
            }
            if let Some((finger, actuator)) = described.filter(|(_, it)| it.adc.is_none()) {
                return Err(Problem::NotSensed {
                    finger: finger.name.clone(),
                    actuator: actuator.name.clone(),
                });
            }
            let sensor = PlantSensor::Effort(actuator);
            self.others
                .plant(&PlantRequest::StickSensor { finger, sensor })?;
            self.say(format_args!(
                "the effort sensor of {name} stays as it is; `clear` mends it"
            ));
            return Ok(());
        }
        let name = words.peek().next().unwrap_or_default();
        let mut ahead = words.clone();
        let (finger, sensor) = match (words.joint(self.hand), ahead.actuator(self.hand)) {
            (Err(_), Ok((finger, actuator))) => {
                *words = ahead;
                (finger, PlantSensor::Encoder(actuator as u32))
            }
            (joint, _) => {
                let (finger, joint) = joint?;
                (finger, PlantSensor::Position(joint as u32))
            }
        };
        match words.word(what)? {
            "position" => words.end()?,
            word => return Err(Problem::Not { word, what }),
        }
        self.others.plant(&PlantRequest::StickSensor {
            finger: finger as u32,
            sensor,
        })?;
        self.say(format_args!(
            "the position sensor of {name} stays as it is; `clear` mends it"
        ));
        Ok(())
    }

    pub(super) fn clear<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let has_failed = matches!(self.others.failed(), Some(1..));
        self.others.plant(&PlantRequest::Mend)?;
        let text = if has_failed {
            "the simulated robot is at its start again"
        } else {
            "all sensors and drives are whole"
        };
        self.say(format_args!("{text}"));
        Ok(())
    }
}
