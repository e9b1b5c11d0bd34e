//! The places of parameters in the description of a robot.

use std::format;
use std::string::String;

use condor_hand::config::line_of;
use condor_host::robot::DescribedKey;

use crate::RobotDescription;

/// Finds the key whose value the parameter `name` of a loop began with, in the text of the robot's description.
pub(super) fn find(robot: &RobotDescription, text: &str, name: &str) -> Option<DescribedKey> {
    let key = key(robot, name)?;
    let line = line_of(text, &key);
    Some(DescribedKey { key, line })
}

/// The way from the top of the description to the number that a parameter has the name of.
fn key(robot: &RobotDescription, name: &str) -> Option<String> {
    if name.starts_with("faults.") {
        return Some(name.into());
    }
    if let Some(rest) = after(name, "table")
        && let Some(table) = &robot.table
    {
        let mut axes = table.axes.iter().enumerate();
        return axes.find_map(|(axis, entry)| {
            let key = after(rest, &entry.name)?;
            Some(format!("table.axes[{axis}].{key}"))
        });
    }
    robot
        .fingers
        .iter()
        .enumerate()
        .find_map(|(finger, entry)| {
            let rest = after(name, &entry.name)?;
            let mut joints = entry.joints.iter().enumerate();
            joints.find_map(|(joint, entry)| {
                let key = after(rest, &entry.name)?;
                Some(format!("fingers[{finger}].joints[{joint}].{key}"))
            })
        })
}

/// Returns the rest of a name after the name of a part and a period.
fn after<'n>(name: &'n str, part: &str) -> Option<&'n str> {
    name.strip_prefix(part)?.strip_prefix('.')
}
