//! The motion that a hand makes of a text: the set-points of its master, and the torques and efforts that they
//! take.

use condor_hand::config;
use condor_hand::dynamics::{DriveDynamics, Dynamics};
use condor_hand::kinematics::Chain;
use condor_hand::trajectory::{
    Generator, Happening, MotionEnd, MotionError, MotionTicket, Observations, Primitive, SetPoint,
};
use condor_hand::transmission::{Efforts, Linear};
use condor_host::error::AnyError;
use condor_host::robot::{
    ActuatorPlan, Collision, JointPlan, Overload, Plan, PlanEvent, Robot as _, Simulator as _, What,
};
use nalgebra::{SVector, Vector3};

use crate::HandView;

/// Joints of a generator: as many as a mask has bits, whatever the hand has.
const ALL: usize = 32;
/// Primitives that wait in the generator.
const QUEUE: usize = 16;
/// Primitives that the generator has, at most.
const GIVEN: usize = 64;
/// Ticks of a plan, at most.
const TICKS: usize = 20_000;

/// Makes the plan of a text, from rest at `from`.
pub(crate) fn plan<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>(
    view: &HandView<FINGERS, JOINTS, ACTUATORS>,
    from: &[f64],
    text: &str,
    file: &str,
) -> Result<Plan, AnyError> {
    let motions = motions(view, text, file)?;
    let rate_hz = view.hand.trajectory_hz;
    let period_s = 1.0 / f64::from(rate_hz);
    let mut player = Player::new(view, from, motions, period_s)?;
    let mut fingers = Vec::new();
    for finger in &view.hand.fingers {
        fingers.push(Model::new(finger, &view.hand)?);
    }
    let mut plan = empty(view, &fingers, period_s);
    let joints = view.joints.len();
    let (mut short, mut met) = (vec![Vec::new(); joints], Vec::new());
    let mut points = player.generator.set_points();
    for tick in 0.. {
        let positions: Vec<f64> = points.iter().take(joints).map(|it| it.position).collect();
        let mut first = 0;
        for model in &fingers {
            let own = points.get(first..first + model.joints).unwrap_or(&[]);
            let (torque, efforts) = model.loads(own);
            for (place, point) in own.iter().enumerate() {
                let joint = first + place;
                let (Some(to), Some(&torque)) = (plan.joints.get_mut(joint), torque.get(place))
                else {
                    continue;
                };
                to.position.push(point.position);
                to.velocity.push(point.velocity);
                to.acceleration.push(point.acceleration);
                to.torque.push(torque);
                for (actuator, number) in to.actuators.iter_mut().zip(model.own(place)) {
                    actuator.effort.extend(efforts.effort.get(number));
                }
                let possible = efforts.torque.get(place).copied().unwrap_or(torque);
                let is_short = (efforts.saturated | efforts.not_finite) >> place & 1 == 1;
                if let Some(short) = short.get_mut(joint) {
                    short.push(is_short.then_some((torque, possible)));
                }
            }
            first += model.joints;
        }
        let clearances = view.clearances(&positions);
        met.resize_with(clearances.len(), Vec::new);
        for (met, clearance) in met.iter_mut().zip(clearances) {
            met.push((clearance.distance_m < 0.0).then_some(clearance));
        }
        if player.is_over {
            break;
        }
        if tick == TICKS {
            let text = format!(
                "{file}: the motion takes longer than {} s; a plan has at most {TICKS} ticks of {rate_hz} Hz",
                seconds(TICKS, period_s)
            );
            return Err(text.into());
        }
        points = player.tick(tick);
    }
    plan.events = player.events;
    for (joint, short) in view.joints.iter().zip(&short) {
        let beyond = |it: &(f64, f64)| (it.0 - it.1).abs();
        for (from, to, (torque, possible)) in spells(short, beyond) {
            plan.overloads.push(Overload {
                joint: joint.name.clone(),
                from_s: seconds(from, period_s),
                to_s: seconds(to, period_s),
                torque,
                possible,
            });
        }
    }
    for met in &met {
        for (from, to, deepest) in spells(met, |it| -it.distance_m) {
            plan.collisions.push(Collision {
                from_s: seconds(from, period_s),
                to_s: seconds(to, period_s),
                deepest,
            });
        }
    }
    Ok(plan)
}

/// Reads the motions of a text.
pub(crate) fn motions<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>(
    view: &HandView<FINGERS, JOINTS, ACTUATORS>,
    text: &str,
    file: &str,
) -> Result<Vec<Primitive<ALL>>, AnyError> {
    if view.joints.len() > ALL {
        let joints = view.joints.len();
        let text = format!("the hand has {joints} joints, but a plan can have at most {ALL}");
        return Err(text.into());
    }
    Ok(view.hand.motions(text, file)?)
}

/// A plan of no ticks.
fn empty<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>(
    view: &HandView<FINGERS, JOINTS, ACTUATORS>,
    models: &[Model<JOINTS, ACTUATORS>],
    period_s: f64,
) -> Plan {
    let mut joints = Vec::new();
    for ((entry, finger), model) in view.hand.fingers.iter().zip(&view.fingers).zip(models) {
        for (place, (joint, link)) in entry.joints.iter().zip(finger.joints()).enumerate() {
            let own = model
                .own(place)
                .filter_map(|number| entry.actuators.get(number));
            let actuators = own.map(|actuator| ActuatorPlan {
                name: format!("{}.{}", entry.name, actuator.name),
                effort: Vec::new(),
                limits: [actuator.limits.low, actuator.limits.high],
            });
            let (limits, torques) = (&joint.limits, model.transmission.torque_range(place));
            joints.push(JointPlan {
                name: link.name.clone(),
                position: Vec::new(),
                velocity: Vec::new(),
                acceleration: Vec::new(),
                torque: Vec::new(),
                position_limits: [limits.low, limits.high],
                velocity_limit: limits.velocity,
                acceleration_limit: limits.acceleration,
                torque_limits: torques.into(),
                actuators: actuators.collect(),
            });
        }
    }
    Plan {
        period_s,
        joints,
        events: Vec::new(),
        overloads: Vec::new(),
        collisions: Vec::new(),
    }
}

/// Returns when so many ticks are over, s.
fn seconds(ticks: usize, period_s: f64) -> f64 {
    u32::try_from(ticks).map_or(f64::INFINITY, f64::from) * period_s
}

/// Returns each time without a gap in which there is something: its first and its last tick, and the worst.
fn spells<T: Clone>(ticks: &[Option<T>], badness: impl Fn(&T) -> f64) -> Vec<(usize, usize, T)> {
    let mut spells: Vec<(usize, usize, T)> = Vec::new();
    for (tick, value) in ticks.iter().enumerate() {
        let Some(value) = value else { continue };
        match spells.last_mut() {
            Some((_, last, worst)) if *last + 1 == tick => {
                *last = tick;
                if badness(value) > badness(worst) {
                    *worst = value.clone();
                }
            }
            _ => spells.push((tick, tick, value.clone())),
        }
    }
    spells
}

/// The master of a hand, as far as it makes set-points of motions.
struct Player {
    generator: Generator<ALL, QUEUE>,
    motions: Vec<Primitive<ALL>>,
    names: Vec<String>,
    tickets: heapless::Vec<MotionTicket, GIVEN>,
    /// Motions that the generator has taken, and those of them that move joints.
    fed: usize,
    moving: usize,
    /// Motions that have begun or were refused.
    begun: usize,
    period_s: f64,
    events: Vec<PlanEvent>,
    is_over: bool,
}

impl Player {
    fn new<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>(
        view: &HandView<FINGERS, JOINTS, ACTUATORS>,
        from: &[f64],
        mut motions: Vec<Primitive<ALL>>,
        period_s: f64,
    ) -> Result<Self, AnyError> {
        let names: Vec<_> = view.joints().iter().map(|it| it.name.clone()).collect();
        if from.len() != names.len() {
            let (given, wanted) = (from.len(), names.len());
            return Err(format!(
                "{given} positions were given to start from, but the hand has {wanted} joints"
            )
            .into());
        }
        let mut joints = names.iter().zip(from);
        if let Some((name, position)) = joints.find(|(_, position)| !position.is_finite()) {
            return Err(format!(
                "{name} cannot start from {position}, which is not a finite number"
            )
            .into());
        }
        for motion in &mut motions {
            view.hand.rest_between_stops(motion);
        }
        // Places without a joint have any limits that are possible.
        let of_hand = view.hand.trajectory_limits();
        let any = config::Limits {
            low: -1.0,
            high: 1.0,
            velocity: 1.0,
            acceleration: 1.0,
        };
        let mut limits = [any.with_jerk(1.0); ALL];
        for (place, own) in limits.iter_mut().zip(of_hand) {
            *place = own;
        }
        let mut start = [0.0; ALL];
        for (place, from) in start.iter_mut().zip(from) {
            *place = *from;
        }
        let generator = Generator::new(limits, start, period_s)?.with_guards_in_servos();
        Ok(Self {
            generator,
            is_over: motions.is_empty(),
            motions,
            names,
            tickets: heapless::Vec::new(),
            fed: 0,
            moving: 0,
            begun: 0,
            period_s,
            events: Vec::new(),
        })
    }

    /// Makes the set-points of the tick after so many others.
    fn tick(&mut self, before: usize) -> [SetPoint; ALL] {
        let waiting = self.motions.get(self.fed..).unwrap_or(&[]).iter().cloned();
        let (fed, result) = self.generator.feed(waiting, &mut self.tickets);
        self.fed += fed as usize;
        if let Err(error) = result {
            self.refuse(before, self.fed + 1, &error);
        }
        let points = self.generator.tick(&Observations::none());
        while let Some(event) = self.generator.take_event() {
            // The generator counts its motions, which are all from here.
            let step = event.ticket.0 as usize + 1;
            match event.happening {
                Happening::Started { adjusted } => {
                    (self.begun, self.moving) = (self.begun + 1, self.moving + 1);
                    let begins = if adjusted {
                        What::BeginsAdjusted
                    } else {
                        What::Begins
                    };
                    self.tell(before, step, begins);
                }
                Happening::Refused(error) => {
                    self.begun += 1;
                    self.refuse(before, step, &error);
                }
                Happening::Ended(ended) => {
                    // One that never began is dropped.
                    self.moving = self.moving.saturating_sub(usize::from(step <= self.begun));
                    let what = match ended {
                        MotionEnd::Reached => What::Reached,
                        MotionEnd::Stopped(_) => What::Stopped,
                        MotionEnd::Aborted => What::Dropped,
                        MotionEnd::Superseded { .. } => What::Superseded,
                    };
                    self.tell(before + 1, step, what);
                }
            }
            if !matches!(event.happening, Happening::Started { .. }) {
                self.tickets.retain(|it| *it != event.ticket);
            }
        }
        if self.generator.is_held() {
            self.tell(before + 1, self.begun, What::Holds);
            self.generator.proceed();
        }
        self.is_over = self.generator.is_idle() && self.fed == self.motions.len();
        // Once nothing moves, the turn of the next one has come.
        if let (false, 0, Some(next)) = (self.is_over, self.moving, self.motions.get(self.begun)) {
            let start = &next.start;
            let needs_sensors = start.torque.is_some() || start.effort.is_some() || start.contact;
            if needs_sensors && start.time.is_none() {
                self.tell(before + 1, self.begun + 1, What::Waits);
                self.is_over = true;
            }
        }
        points
    }

    /// All motion ends, since one cannot be.
    fn refuse(&mut self, tick: usize, step: usize, error: &MotionError) {
        let reason = error.named(&self.names).to_string();
        self.tell(tick, step, What::Refused { reason });
        self.motions.truncate(self.fed);
        self.generator.abort();
    }

    fn tell(&mut self, tick: usize, step: usize, what: What) {
        self.events.push(PlanEvent {
            at_s: seconds(tick, self.period_s),
            step,
            what,
        });
    }
}

/// The dynamics of a finger: the torques that a motion takes, and the actuators that produce them.
struct Model<const JOINTS: usize, const ACTUATORS: usize> {
    joints: usize,
    chain: Chain<JOINTS>,
    drive: DriveDynamics<JOINTS>,
    transmission: Linear<JOINTS, ACTUATORS>,
    gravity: Vector3<f64>,
}

impl<const JOINTS: usize, const ACTUATORS: usize> Model<JOINTS, ACTUATORS> {
    fn new<const FINGERS: usize>(
        finger: &config::Finger<JOINTS, ACTUATORS>,
        hand: &config::Hand<FINGERS, JOINTS, ACTUATORS>,
    ) -> Result<Self, AnyError> {
        let sample_hz = f64::from(hand.servo_rate_hz(finger));
        let settings = finger.settings(sample_hz, hand.transition_s);
        Ok(Self {
            joints: finger.joints.len(),
            chain: finger.chain(),
            drive: settings.drive,
            transmission: finger.transmission()?,
            gravity: Vector3::from(hand.gravity),
        })
    }

    /// Iterates over the numbers of the actuators that belong to a joint.
    fn own(&self, joint: usize) -> impl Iterator<Item = usize> {
        let actuators = 0..ACTUATORS;
        actuators.filter(move |actuator| self.transmission.joint_of(*actuator) == Some(joint))
    }

    /// Returns the torques that set-points take in free space, N m, and the efforts for them.
    fn loads(&self, points: &[SetPoint]) -> (SVector<f64, JOINTS>, Efforts<JOINTS, ACTUATORS>) {
        let each = |part: fn(&SetPoint) -> f64| {
            SVector::from_fn(|joint, _| points.get(joint).map_or(0.0, part))
        };
        let q = each(|point| point.position);
        let rates = each(|point| point.velocity);
        let accelerations = each(|point| point.acceleration);
        let links = (self.chain).inverse_dynamics(&q, &rates, &accelerations, &self.gravity);
        let torque =
            links + self.drive.armature.component_mul(&accelerations) + self.drive.torque(&rates);
        (torque, self.transmission.efforts(&torque))
    }
}
