//! The summary of a run at its end, beside loops and messages: how well the joints have followed, in the whole
//! run and in each motion.

use std::error::Error;

use condor_hand::config::{Finger, Hand};
use condor_host::description::SystemDescription;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Processor, Region};

use crate::{ACTUATORS, FINGERS, JOINTS, RobotDescription, objects};

/// Prints the tracking errors of all joints.
///
/// # Errors
/// Returns an error if the memory of the system cannot be accessed.
fn print(view: &View, hand: &Hand<FINGERS, JOINTS, ACTUATORS>) -> Result<(), Box<dyn Error>> {
    println!(
        "{:<10} {:<10} {:>10} {:>10}",
        "finger", "joint", "rms deg", "peak deg"
    );
    for (number, finger) in hand.fingers.iter().enumerate() {
        let Some(processor) = finger.processor() else {
            continue;
        };
        print_joints(finger, number, &view.region(Processor(processor))?)?;
    }
    Ok(())
}

fn print_joints(
    finger: &Finger<JOINTS, ACTUATORS>,
    number: usize,
    region: &Region<LinuxWindow>,
) -> Result<(), Box<dyn Error>> {
    let cell = objects::tracking(region)?;
    let latest = match cell {
        Some(cell) => cell.subscriber(region.clone())?.read().ok(),
        None => None,
    };
    for (place, joint) in finger.joints.iter().enumerate() {
        let tracking = latest.as_ref().map(|latest| &latest.value.whole);
        let rms = tracking.and_then(|tracking| tracking.rms_rad(number, place));
        let peak = tracking.and_then(|tracking| tracking.peak_rad(number, place));
        match rms.zip(peak) {
            Some((rms, peak)) => println!(
                "{:<10} {:<10} {:>10.3} {:>10.3}",
                finger.name,
                joint.name,
                rms.to_degrees(),
                peak.to_degrees()
            ),
            None => println!(
                "{:<10} {:<10} {:>10} {:>10}",
                finger.name, joint.name, "-", "-"
            ),
        }
    }
    Ok(())
}

/// Prints the summary of a running system, with the configuration that its description names.
///
/// # Errors
/// Returns an error if the configuration or the system's memory cannot be read.
pub(crate) fn of(
    hand: &RobotDescription,
    description: &SystemDescription,
    directory: &SystemDirectory,
) -> Result<(), Box<dyn Error>> {
    let view = View::open(directory, description.window_bytes)?;
    print(&view, hand)?;
    print_motions(&view, hand, description)?;
    print_hash(&view, description)
}

/// Prints the joint that was farthest from where it was to be in each motion.
fn print_motions(
    view: &View,
    hand: &Hand<FINGERS, JOINTS, ACTUATORS>,
    description: &SystemDescription,
) -> Result<(), Box<dyn Error>> {
    for processor in &description.processors {
        let region = view.region(Processor(processor.number))?;
        let Some(cell) = objects::followed(&region)? else {
            continue;
        };
        let Ok(latest) = cell.subscriber(region)?.read() else {
            continue;
        };
        let mut title = Some(());
        for (name, motion) in latest.value.motions() {
            let Some(worst) = motion.figures.worst() else {
                continue;
            };
            let finger = hand.fingers.get(worst.finger);
            let Some((finger, joint)) =
                finger.and_then(|finger| Some((finger, finger.joints.get(worst.joint)?)))
            else {
                continue;
            };
            if title.take().is_some() {
                println!(
                    "{:<24} {:>5} {:<20} {:>10} {:>10}",
                    "motion", "runs", "worst joint", "rms deg", "peak deg"
                );
            }
            println!(
                "{:<24} {:>5} {:<20} {:>10.3} {:>10.3}",
                name,
                motion.runs,
                format!("{}.{}", finger.name, joint.name),
                worst.rms_rad.to_degrees(),
                worst.peak_rad.to_degrees()
            );
        }
    }
    Ok(())
}

/// Prints by what the joints of a simulated robot can be compared with those of another run.
fn print_hash(view: &View, description: &SystemDescription) -> Result<(), Box<dyn Error>> {
    for processor in &description.processors {
        let region = view.region(Processor(processor.number))?;
        if let Some(cell) = objects::truth(&region)?
            && let Ok(latest) = cell.subscriber(region)?.read()
        {
            let (seconds, hash) = (latest.value.time_s, latest.value.hash);
            println!(
                "joint positions over {seconds:.4} s of the robot's time: hash {hash:016x}, equal in equal runs"
            );
        }
    }
    Ok(())
}
