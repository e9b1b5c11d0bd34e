//! The grasp of a ball.

use core::time::Duration;

use condor_hand::grasp::distributed::{GraspOrder, GraspState, LEAST_FINGERS};
use condor_hand::servo::Mode;
use condor_rt::Machine;
use nalgebra::Vector3;

use super::{Commands, FINGERS, JOINTS, Problem, Words, grasp, with};
use crate::master::drive::OfServos;
use crate::objects;

/// How stiff a ball is held, N/m, unless it is said.
const STIFFNESS: f64 = 200.0;
/// Of the damping to the stiffness, s.
const DAMPING: f64 = 0.02;
/// Of the stiffness about an axis to that along one, m²: a lever of about the ball's radius.
const TURNING: f64 = 5e-4;
/// How long processors may take to agree.
const AGREEMENT: u32 = 25;
const NAP: Duration = Duration::from_millis(20);

impl<M: Machine> Commands<'_, '_, M> {
    /// Has all fingers that follow close on the ball, and hold it with a stiffness.
    pub(super) fn grasp<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let stiffness = words
            .positive("a stiffness above 0, N/m")?
            .unwrap_or(STIFFNESS);
        words.end()?;
        self.requests.check_free()?;
        let mut fingers = 0_u64;
        let mut missing = None;
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            let status = self.servos.status(finger);
            let in_grasp = status.is_some_and(|it| it.modes == [Mode::Grasp; JOINTS]);
            if in_grasp || self.servos.follows(finger) {
                fingers |= 1 << finger;
            } else {
                missing = missing.or_else(|| Some(entry.name.clone()));
            }
        }
        if let Some(name) = missing.filter(|_| fingers.count_ones() < LEAST_FINGERS) {
            return Err(Problem::NotEnabled(name));
        }
        let joints = with(self.shared, |drive| drive.measured);
        let mut all = [[0.0; JOINTS]; FINGERS];
        for (entry, (to, from)) in self
            .hand
            .fingers
            .iter()
            .zip(all.iter_mut().zip(joints.unwrap_or([None; FINGERS])))
        {
            *to = from.ok_or(Problem::NotMeasured(entry.name.clone()))?;
        }
        let ball = self.others.ball;
        let center = Vector3::from(ball.center);
        let mut tips = grasp::tips(self.hand, &all).unwrap_or([[0.0; 3]; FINGERS]);
        for tip in &mut tips {
            // To the nearest point of the ball.
            let from = Vector3::from(*tip) - center;
            let distance = condor_hand::math::sqrt(from.norm_squared());
            if distance > 0.0 {
                *tip = (center + from * (ball.radius / distance)).into();
            }
        }
        let along = stiffness;
        let about = stiffness * TURNING;
        let gains = [along, along, along, about, about, about];
        let weight = -Vector3::from(self.hand.gravity) * ball.mass;
        let order = GraspOrder {
            center: ball.center,
            force: weight.into(),
            ..GraspOrder::hold(fingers, tips, gains, gains.map(|gain| gain * DAMPING))
        };
        self.order(&order)?;
        Ok(())
    }

    /// Gives all servo processors an order, and waits until they have come to it.
    pub(super) fn order(&mut self, order: &GraspOrder<FINGERS>) -> Result<(), Problem<'static>> {
        let mut given = OfServos::new();
        for (number, region) in self.servos.regions() {
            let places = objects::grasp(region)?.ok_or(Problem::Absent(number))?;
            // As many as there are.
            let _ = given.push((number, region, places));
        }
        let mut numbers = OfServos::new();
        for (_, region, places) in &given {
            let _ = numbers.push(places.give(order, region)?);
        }
        for ((processor, region, places), number) in given.iter().zip(&numbers) {
            let processor = *processor;
            let wanted = if order.fingers & self.servos.fingers(processor) == 0 {
                GraspState::Idle
            } else {
                GraspState::Holding
            };
            let mut last = None;
            for _ in 0..AGREEMENT {
                self.background.serve(NAP)?;
                let report = places.report(region).ok();
                last = report.filter(|report| report.order == *number);
                match last.map(|report| report.state) {
                    Some(state) if state == wanted => break,
                    Some(GraspState::Refused | GraspState::Left) => break,
                    _ => {}
                }
            }
            match last {
                None => return Err(Problem::Absent(processor)),
                Some(report) if report.state != wanted => {
                    let reason = report.reason;
                    return Err(Problem::Grasp { processor, reason });
                }
                Some(_) => {}
            }
        }
        Ok(())
    }
}
