//! What is said of a run at its end: loops, and how well the joints have followed.

use std::error::Error;

use condor_hand::config::{Finger, Hand};
use condor_host::system::{Directory, Windows};
use condor_host::{directory, loops, numbers};
use condor_mbox::linux::{LinuxWindow, SystemError};
use condor_mbox::{Processor, Region};
use utah_mit_hand::{FINGERS, JOINTS, objects};

/// Prints it.
///
/// # Errors
/// The memory's; a configuration that cannot be read.
fn print(windows: &Windows, hand: &Hand<FINGERS, JOINTS>) -> Result<(), Box<dyn Error>> {
    let claim = numbers::VISITORS
        .map(|number| windows.claim(Processor(number)))
        .find(|claim| !matches!(claim, Err(SystemError::NumberTaken { .. })))
        .ok_or("all numbers of visitors are taken")??;
    let (windows, _) = claim.into_parts();
    println!(
        "{:>6}  {:<10} {:>10} {:>10} {:>8} {:>10}",
        "number", "loop", "rate Hz", "runs", "skips", "late µs"
    );
    for (number, windows) in (0..).zip(&windows).take(numbers::PROGRAMS.count()) {
        print_loops(number, &Region::users(windows.data.clone())?)?;
    }
    println!(
        "{:<10} {:<10} {:>10} {:>10}",
        "finger", "joint", "rms deg", "peak deg"
    );
    for (number, finger) in hand.fingers.iter().enumerate() {
        let Some(processor) = finger.processor() else {
            continue;
        };
        let Some(windows) = windows.get(usize::from(processor)) else {
            continue;
        };
        let mut served = hand.fingers_on(processor);
        let place = served.position(|(index, _)| index == number).unwrap_or(0);
        print_joints(finger, place, &Region::users(windows.data.clone())?)?;
    }
    Ok(())
}

fn print_loops(number: u8, region: &Region<LinuxWindow>) -> Result<(), Box<dyn Error>> {
    let entries: Vec<_> = directory::entries(region)?.collect::<Result<_, _>>()?;
    let entries = entries
        .iter()
        .filter(|entry| entry.kind == directory::Kind::Loops);
    for entry in entries {
        for row in 0..loops::count(entry) {
            let Some((name, counts)) = loops::read(region, entry, row)? else {
                continue;
            };
            let late_us = f64::from(counts.worst_lateness) * 1e6 / counts.frequency.as_hz();
            println!(
                "{number:>6}  {:<10} {:>10.1} {:>10} {:>8} {late_us:>10.1}",
                name.as_str(),
                counts.rate.as_hz(),
                counts.run,
                counts.skipped,
            );
        }
    }
    Ok(())
}

fn print_joints(
    finger: &Finger<JOINTS>,
    place: usize,
    region: &Region<LinuxWindow>,
) -> Result<(), Box<dyn Error>> {
    let cell = objects::tracking(region)?;
    let latest = match cell {
        Some(cell) => cell.subscriber(region.clone())?.read().ok(),
        None => None,
    };
    for (number, joint) in finger.joints.iter().enumerate() {
        let tracking = latest.as_ref().map(|latest| &latest.value);
        let rms = tracking.and_then(|tracking| tracking.rms_rad(place, number));
        let peak = tracking.and_then(|tracking| tracking.peak_rad(place, number));
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

/// The configuration that a description names, and the windows of its running system.
///
/// # Errors
/// What cannot be read.
pub(crate) fn of(
    description: &condor_host::description::Description,
    directory: &Directory,
) -> Result<(), Box<dyn Error>> {
    let file = description.hand.as_ref().ok_or("the system has no hand")?;
    let text = std::fs::read_to_string(file)?;
    let hand = Hand::from_toml(&text, &file.to_string_lossy())?;
    print(&directory.system(description.window_bytes)?, &hand)
}
