//! The grasp of a ball.

use core::fmt::Write as _;
use core::time::Duration;

use condor_fs::OpenOptions;
use condor_hand::grasp::distributed::{
    GraspOrder, GraspSettings, GraspState, LEAST_FINGERS, MeasuredBall,
};
use condor_hand::servo::ServoMode;
use condor_mbox::Clock as _;
use condor_rt::Machine;

use super::{Closing, Commands, FINGERS, Problem, Words, are_all, grasp, with};
use crate::JOINTS;
use crate::master::drive::OfServos;
use crate::master::words::{Path, is_name, names, number};
use crate::{file, objects};

/// The stiffness of a ball, N/m, unless the command has one.
const STIFFNESS: f64 = 200.0;
/// The greatest stiffness that a person can type, N/m: more can only be a mistake.
const MOST_STIFF: f64 = 1e4;
/// The ratio of the damping to the stiffness, s.
const DAMPING: f64 = 0.02;
/// The ratio of the stiffness about an axis to that along one, m²: a lever of about the ball's radius.
const TURNING: f64 = 5e-4;
/// After the ramp, the time in which the fingers come to rest on the ball, s.
const REST_S: f64 = 0.5;
/// The number of looks after which processors must agree.
const AGREEMENT: u32 = 25;
const NAP: Duration = Duration::from_millis(20);

impl<M: Machine> Commands<'_, '_, M> {
    /// Has all fingers that follow close on the ball where it is measured, and hold it as is said.
    pub(super) fn grasp<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let word = words.next();
        words.end()?;
        self.requests.check_free()?;
        let settings = self.settings(word)?;
        let fingers = self.hold(&settings)?;
        let names = names(self.hand, fingers);
        self.say(format_args!("{names}: closing on the ball"));
        let clock = self.background.machine().doorbell();
        let closes = Duration::try_from_secs_f64(settings.ramp_s + REST_S);
        self.closing = closes.ok().map(|closes| Closing {
            settings,
            until: clock.now().after(closes),
        });
        Ok(())
    }

    /// Orders a grasp again when its fingers have closed. They push the ball aside as they come to it, and
    /// the stiffness is to be about its middle.
    pub(super) fn close(&mut self) -> Result<(), Problem<'static>> {
        let now = self.background.machine().doorbell().now();
        let Some(closed) = self.closing.take_if(|it| now >= it.until) else {
            return Ok(());
        };
        // Unless a finger has left it.
        if (0..FINGERS).any(|finger| self.is_in_grasp(finger)) {
            self.hold(&closed.settings)?;
        }
        Ok(())
    }

    /// Orders a grasp of the ball where it is measured. Returns a bit for each finger that takes part.
    fn hold(&mut self, settings: &GraspSettings) -> Result<u64, Problem<'static>> {
        let fingers = self.holding()?;
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
        let tips = grasp::tips(self.hand, &all);
        let seen = self.others.see(self.background)?;
        let ball = MeasuredBall::new(seen.position, seen.orientation, seen.radius_m);
        self.order(&settings.order(fingers, &tips, &ball, &self.hand.gravity))?;
        Ok(fingers)
    }

    /// A number stands for a stiffness without coupling, and any other word for a file.
    fn settings<'l>(&self, word: Option<&'l str>) -> Result<GraspSettings, Problem<'l>> {
        const WHAT: &str = "a stiffness above 0, at most 10000 N/m, or the name of a grasp";
        let along = match word {
            None => STIFFNESS,
            Some(word) => match number(word, WHAT) {
                Ok(along) if along > 0.0 && along <= MOST_STIFF => along,
                Err(_) if is_name(word) => return self.load_grasp(word),
                _ => return Err(Problem::Not { word, what: WHAT }),
            },
        };
        let about = along * TURNING;
        let gains = [along, along, along, about, about, about];
        let mass_kg = self.others.ball.mass;
        Ok(GraspSettings {
            mass_kg,
            ..GraspSettings::diagonal(gains, gains.map(|gain| gain * DAMPING))
        })
    }

    fn load_grasp(&self, name: &str) -> Result<GraspSettings, Problem<'static>> {
        let mut path = Path::new();
        // Names are short enough.
        let _ = write!(path, "grasps/{name}.grasp");
        // One byte more, so that a longer file is not taken for its beginning.
        let mut image = [0; GraspSettings::IMAGE_BYTES + 1];
        let options = OpenOptions::new().read();
        match file::read(self.store.0, &path, options, &mut image) {
            Err(error) => Err(Problem::of_file(path, error)),
            Ok(len) => GraspSettings::from_image(image.get(..len).unwrap_or(&[]))
                .map_err(|error| Problem::GraspImage { name: path, error }),
        }
    }

    pub(super) fn is_in_grasp(&self, finger: usize) -> bool {
        let status = self.servos.status(finger);
        status.is_some_and(|it| are_all(it, ServoMode::Grasp))
    }

    /// Returns the fingers for a grasp, a bit for each: those that follow, or are in a grasp already.
    fn holding(&self) -> Result<u64, Problem<'static>> {
        let (mut fingers, mut missing) = (0_u64, 0);
        for finger in 0..self.hand.fingers.len() {
            let is_ready = self.is_in_grasp(finger) || self.servos.follows(finger);
            let mask = if is_ready { &mut fingers } else { &mut missing };
            *mask |= 1 << finger;
        }
        if missing != 0 && fingers.count_ones() < LEAST_FINGERS {
            return Err(Problem::NotEnabled(names(self.hand, missing)));
        }
        Ok(fingers)
    }

    /// Publishes an order to all servo processors, and waits until they have processed it.
    pub(super) fn order(&mut self, order: &GraspOrder) -> Result<(), Problem<'static>> {
        let mut given = OfServos::new();
        for (number, region) in self.servos.regions() {
            let layout = objects::grasp(region)?.ok_or(Problem::Absent(number))?;
            // As many as there are.
            let _ = given.push((number, region, layout));
        }
        let mut numbers = OfServos::new();
        for (_, region, layout) in &given {
            let _ = numbers.push(layout.give(order, region)?);
        }
        for ((processor, region, layout), number) in given.iter().zip(&numbers) {
            let processor = *processor;
            let wanted = if order.fingers & self.servos.fingers(processor) == 0 {
                GraspState::Idle
            } else {
                GraspState::Holding
            };
            let mut last = None;
            for _ in 0..AGREEMENT {
                self.background.serve(NAP)?;
                let report = layout.report(region).ok();
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
                    let fingers = names(self.hand, self.servos.fingers(processor));
                    let reason = report.reason;
                    return Err(Problem::Grasp { fingers, reason });
                }
                Some(_) => {}
            }
        }
        Ok(())
    }
}
