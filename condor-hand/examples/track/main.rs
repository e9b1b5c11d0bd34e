//! The shipped hand, simulated, follows a motion of a text file; errors as a table and as a plot.
//!
//! All is as on the machine: set-points at the master's rate from the primitives of the file, servos at
//! theirs, sensors and commands as counts of the converters of the configuration. The program fails
//! where an error is larger than its bound.
//!
//! ```text
//! cargo run --release -p condor-hand --example track [PLOT.svg [MOTION.toml]]
//! ```

mod converters;
mod plot;
#[allow(dead_code, reason = "each program takes what it needs")]
#[path = "../closed_loop/rig.rs"]
mod rig;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use condor_hand::math::{abs, max, sqrt};
use condor_hand::trajectory::motion::load;
use condor_hand::trajectory::{Generator, Happening, Limits, Observations, SetPoint};

use converters::Converters;
use plot::{Curve, Panel};
use rig::{Configuration, FINGERS, JOINTS, OfJoints, Plant, Result, Rig, Simulated, posture};

/// Of the hand.
const COUNT: usize = FINGERS * JOINTS;
/// How many motions a file may have.
const QUEUE: usize = 32;
/// How long the hand rests before and after its motion, s.
const REST_S: f64 = 0.5;

/// The errors that quantised sensors, actuators of 20 Hz and fast motion may leave, degrees.
const PEAK_DEG: f64 = 0.3;
const FINAL_DEG: f64 = 0.1;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let plot = arguments.next().map_or_else(
        || root.with_file_name("target").join("track.svg"),
        PathBuf::from,
    );
    let motion = arguments
        .next()
        .map_or_else(|| root.join("hands/wave.toml"), PathBuf::from);
    match track(&motion, &plot) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("track: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn track(motion: &Path, plot: &Path) -> Result<bool> {
    let configuration = rig::shipped()?;
    let names = names(&configuration);
    let mut generator: Generator<COUNT, QUEUE> = generator(&configuration)?;
    let text = std::fs::read_to_string(motion)
        .map_err(|error| format!("{}: {error}", motion.display()))?;
    for primitive in load(&text, &motion.to_string_lossy(), &names)? {
        generator.enqueue(primitive)?;
    }
    let plant = Converters::new(&configuration, Simulated::new(&configuration)?);
    let mut rig = Rig::new(&configuration, plant)?;
    let run = follow(&mut rig, &mut generator, &configuration)?;
    let panels: Vec<Panel> = names
        .into_iter()
        .zip(run.target.iter().zip(&run.actual))
        .map(|(name, (target, actual))| Panel::new(name, run.period_s, target, actual))
        .collect();
    let kept = print(&panels);
    plot::write(plot, &configuration.name, JOINTS, &panels)?;
    println!("plot: {}", plot.display());
    Ok(kept)
}

/// FINGER.JOINT, in the order of the joints' numbers.
fn names(configuration: &Configuration) -> Vec<String> {
    let fingers = configuration.fingers.iter();
    let names = fingers.flat_map(|finger| {
        let joints = finger.joints.iter();
        joints.map(|joint| format!("{}.{}", finger.name, joint.name))
    });
    names.collect()
}

/// The set-points of all joints of the hand, at rest in [`posture`].
fn generator(configuration: &Configuration) -> Result<Generator<COUNT, QUEUE>> {
    let rate_hz = f64::from(configuration.trajectory_hz);
    let limits = std::array::from_fn(|number| {
        let joint = &configuration.fingers[number / JOINTS].joints[number % JOINTS];
        Limits {
            low: joint.limits.low,
            high: joint.limits.high,
            velocity: joint.limits.velocity,
            acceleration: joint.limits.acceleration,
            // None is configured: all acceleration may come within a tick.
            jerk: joint.limits.acceleration * rate_hz,
        }
    });
    let start = std::array::from_fn(|number| posture()[number % JOINTS]);
    Ok(Generator::new(limits, start, 1.0 / rate_hz)?)
}

/// Of every joint at every tick of the servos, degrees.
struct Run {
    period_s: f64,
    target: Vec<Curve>,
    actual: Vec<Curve>,
}

fn follow<P: Plant>(
    rig: &mut Rig<Converters<P>>,
    generator: &mut Generator<COUNT, QUEUE>,
    configuration: &Configuration,
) -> Result<Run> {
    let rest_ticks = rig.ticks_in(REST_S) / rig.substeps();
    // Tensions come up first.
    for _ in 0..rest_ticks {
        rig.follow(&by_finger(&generator.set_points()))?;
        for _ in 0..rig.substeps() {
            rig.tick()?;
        }
    }
    let mut run = Run {
        period_s: rig.master_period_s() / f64::from(rig.substeps()),
        target: vec![Curve::new(); COUNT],
        actual: vec![Curve::new(); COUNT],
    };
    let mut rested = 0;
    while rested < rest_ticks {
        rested = if generator.is_idle() { rested + 1 } else { 0 };
        let points = generator.tick(&observations(rig, configuration)?);
        while let Some(event) = generator.take_event() {
            if let Happening::Refused(error) = event.happening {
                return Err(format!("motion {}: {error}", event.ticket.0).into());
            }
        }
        rig.follow(&by_finger(&points))?;
        for _ in 0..rig.substeps() {
            // What the sensors of this tick have seen.
            let truth = *rig.plant().truth();
            let ticks = rig.tick()?;
            for (finger, (tick, truth)) in ticks.iter().zip(&truth).enumerate() {
                for joint in 0..JOINTS {
                    let target = tick.target[joint].ok_or("a joint has no set-point")?;
                    let number = JOINTS * finger + joint;
                    run.target[number].push(target.to_degrees());
                    run.actual[number].push(truth.position[joint].to_degrees());
                }
            }
        }
    }
    Ok(run)
}

/// The set-points of the joints of each finger.
fn by_finger(points: &[SetPoint<f64>; COUNT]) -> OfJoints<SetPoint<f64>> {
    std::array::from_fn(|finger| std::array::from_fn(|joint| points[JOINTS * finger + joint]))
}

/// What the guards of motions look at.
fn observations<P: Plant>(
    rig: &Rig<Converters<P>>,
    configuration: &Configuration,
) -> Result<Observations<COUNT>> {
    let mut seen = Observations::none();
    for (number, (sensed, finger)) in rig.state.iter().zip(&configuration.fingers).enumerate() {
        let torque = finger.moment_arms()?.torque(&sensed.tension);
        for joint in 0..JOINTS {
            let tension = sensed.tension[joint];
            seen.torques[JOINTS * number + joint] = torque[joint];
            seen.tensions[JOINTS * number + joint] = max(tension.flexor, tension.extensor);
        }
    }
    Ok(seen)
}

/// The table of the errors, and whether all are within their bounds.
fn print(panels: &[Panel]) -> bool {
    println!("error, degrees    |   peak     rms    final");
    println!("at most           | {PEAK_DEG:6.3}          {FINAL_DEG:6.3}");
    let mut kept = true;
    for panel in panels {
        let errors = panel.errors();
        let peak = errors.iter().copied().map(abs).fold(0.0, max);
        let count = f64::from(u32::try_from(errors.len()).unwrap_or(u32::MAX));
        let rms = sqrt(errors.iter().map(|error| error * error).sum::<f64>() / count);
        let last = errors.last().copied().map_or(f64::NAN, abs);
        // A NaN is not kept.
        let good = peak <= PEAK_DEG && last <= FINAL_DEG;
        kept &= good;
        let mark = if good { "" } else { "   TOO LARGE" };
        println!(
            "{:18}| {peak:6.3}  {rms:6.3}  {last:6.3}{mark}",
            panel.name()
        );
    }
    kept
}
