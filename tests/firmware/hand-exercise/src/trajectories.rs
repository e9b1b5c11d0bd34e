use condor_hand::trajectory::{
    Begin, Bounds, Generator, Happening, Interpolator, MotionEnd, MotionError, MotionGuard,
    Observations, Pace, Polynomial, Primitive, Profile, ProfileLimits, ProfilePeaks, Segments,
    SetPoint, Spline, Target, Via,
};

use crate::Shipped;
use crate::corpus::{Between, FINITE, HOSTILE};
use crate::digest::Digest;

/// Samples of one profile, from before its begin to after its end.
const SAMPLES: u32 = 9;

fn sampled(digest: &mut Digest, duration: f64, peaks: &ProfilePeaks, at: impl Fn(f64) -> SetPoint) {
    digest.numbers(&[
        duration,
        peaks.low,
        peaks.high,
        peaks.velocity,
        peaks.acceleration,
    ]);
    for sample in 0..SAMPLES {
        let share = (f64::from(sample) - 1.0) / f64::from(SAMPLES - 3);
        digest.point(&at(duration * share));
    }
}

/// Computes polynomials, splines and time-optimal motions between states of all kinds.
pub(crate) fn profiles(digest: &mut Digest, _: &Shipped) -> Option<()> {
    let mut between = Between::seeded(7);
    let ends = FINITE.into_iter().chain(HOSTILE);
    for end in ends {
        for moving in [0.0, 1.0] {
            let start = SetPoint {
                position: between.one(-1.0, 1.0),
                velocity: between.one(-4.0 * moving, 4.0 * moving),
                acceleration: between.one(-50.0 * moving, 50.0 * moving),
            };
            let stop = SetPoint::rest(end);
            let duration = between.one(0.1, 2.0);
            let quintic = Polynomial::quintic(&start, &stop, duration);
            let smooth = Polynomial::minimum_jerk(start.position, end, duration);
            for polynomial in [quintic, smooth] {
                if let Some(found) = digest.answer(polynomial.ok()) {
                    sampled(digest, found.duration(), &found.peaks(), |t| found.at(t));
                }
            }
            for jerk in [None, Some(2e4)] {
                let bounds = Bounds {
                    velocity: 3.0,
                    acceleration: 200.0,
                    jerk,
                };
                let found = Segments::fastest(&start, end, &bounds);
                let Some(fastest) = digest.answer(found.ok()) else {
                    continue;
                };
                sampled(digest, fastest.duration(), &fastest.peaks(), |t| {
                    fastest.at(t)
                });
                let longer = fastest.duration() * 1.5;
                let found = Segments::lasting(&start, end, &bounds, longer);
                if let Some(found) = digest.answer(found.ok().flatten()) {
                    sampled(digest, found.duration(), &found.peaks(), |t| found.at(t));
                }
            }
        }
    }
    for _ in 0..20 {
        let times = [0.0, 0.3, 0.4, 1.1, 2.0];
        let positions: [f64; 5] = core::array::from_fn(|_| between.one(-1.0, 1.0));
        let velocities = (between.one(-1.0, 1.0), 0.0);
        let spline = Spline::<5>::clamped(&times, &positions, velocities).ok()?;
        sampled(digest, spline.duration(), &spline.peaks(), |t| spline.at(t));
    }
    Some(())
}

const JOINTS: usize = 8;
const TICKS: u32 = 220;
const SUBSTEPS: u16 = 8;

/// Runs primitives at 50 Hz, and servos at 400 Hz that follow them when some ticks do not come.
pub(crate) fn motion(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let mut joints = hand.fingers.iter().flat_map(|finger| &finger.joints);
    let mut limits = [ProfileLimits {
        low: 0.0,
        high: 1.0,
        velocity: 1.0,
        acceleration: 1.0,
        jerk: 1.0,
    }; JOINTS];
    for (limits, joint) in limits.iter_mut().zip(&mut joints) {
        *limits = ProfileLimits {
            low: joint.limits.low,
            high: joint.limits.high,
            velocity: joint.limits.velocity,
            acceleration: joint.limits.acceleration,
            jerk: 3e4,
        };
    }
    let start = limits.map(|limits| (limits.low + limits.high) * 0.5);
    let tick_s = 1.0 / f64::from(hand.trajectory_hz);
    let bounds = limits.map(|limits| Bounds {
        velocity: limits.velocity,
        acceleration: limits.acceleration,
        jerk: None,
    });
    let mut generator = Generator::<JOINTS, 4>::new(limits, start, tick_s).ok()?;
    let mut interpolator = Interpolator::<JOINTS>::new(SUBSTEPS, tick_s, start, bounds).ok()?;
    let mut between = Between::seeded(8);
    let mut seen = Observations::none();
    for tick in 0..TICKS {
        if let Some(primitive) = primitive(tick, &limits, &mut between) {
            let ticket = generator.enqueue(primitive.ok()?);
            digest.answer(ticket.ok());
        }
        match tick {
            90 => generator.pause(),
            100 => generator.resume(),
            200 => generator.abort(),
            _ => {}
        }
        // A torque that stops one of the motions, and sensors that say nothing of use.
        seen.torques = [between.one(0.0, if tick == 70 { 3.0 } else { 0.5 }); JOINTS];
        if tick % 32 == 31 {
            seen.torques = [f64::NAN; JOINTS];
        }
        let points = generator.tick(&seen);
        for point in &points {
            digest.point(point);
        }
        while let Some(event) = generator.take_event() {
            digest.bits(u64::from(event.ticket.0));
            digest.bits(number(&event.happening));
        }
        // Ticks of the master that are lost, and one that makes no sense.
        let lost = (110..115).contains(&tick);
        if !lost {
            let taken = interpolator.tick(&points);
            digest.answer(taken.ok());
        }
        if tick == 150 {
            let nonsense = HOSTILE.map(|value| interpolator.tick(&[SetPoint::rest(value); JOINTS]));
            for taken in nonsense {
                digest.answer(taken.ok());
            }
        }
        for _ in 0..SUBSTEPS {
            let points = interpolator.step();
            for point in &points {
                digest.point(point);
            }
        }
    }
    Some(())
}

/// Returns the primitive that begins with a tick, if one does.
fn primitive(
    tick: u32,
    limits: &[ProfileLimits; JOINTS],
    between: &mut Between,
) -> Option<Result<Primitive<JOINTS>, MotionError>> {
    let (profile, pace) = match tick {
        1 => (Profile::Trapezoid, Pace::Speed(0.5)),
        3 => (Profile::JerkLimited, Pace::Speed(0.3)),
        5 => (Profile::MinimumJerk, Pace::Duration(0.8)),
        60 => (Profile::Cubic, Pace::Duration(1.2)),
        120 => (Profile::Trapezoid, Pace::Speed(1.0)),
        125 => (Profile::JerkLimited, Pace::Speed(1.0)),
        190 => (Profile::MinimumJerk, Pace::Duration(0.01)),
        _ => return None,
    };
    let mut primitive = Primitive::new(pace, profile);
    for (joint, limits) in limits.iter().enumerate() {
        if tick == 3 && joint < 4 {
            continue;
        }
        let share = between.one(0.1, 0.9);
        let position = limits.low + (limits.high - limits.low) * share;
        primitive = match primitive.with(joint, Target::Absolute(position)) {
            Ok(primitive) => primitive,
            Err(error) => return Some(Err(error)),
        };
    }
    primitive.begin = match tick {
        3 => Begin::Beside,
        125 => Begin::Now,
        _ => Begin::After,
    };
    if tick == 60 {
        let positions = limits.map(|limits| (limits.low + limits.high) * 0.5);
        // As many as there is room for.
        let _ = primitive.vias.push(Via { at: 0.4, positions });
    }
    primitive.stop.torque = (tick == 60).then_some(2.5);
    Some(Ok(primitive))
}

fn number(happening: &Happening) -> u64 {
    match happening {
        Happening::Started { adjusted } => u64::from(*adjusted),
        Happening::Ended(MotionEnd::Reached) => 2,
        Happening::Ended(MotionEnd::Stopped(MotionGuard::Torque { .. })) => 3,
        Happening::Ended(MotionEnd::Stopped(_)) => 4,
        Happening::Ended(MotionEnd::Aborted) => 5,
        Happening::Ended(MotionEnd::Superseded { .. }) => 6,
        Happening::Refused(_) => 7,
    }
}
