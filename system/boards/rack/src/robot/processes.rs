use condor_robot::processes::Processes;

use super::Rack;

/// The programs of a robot on the rack, as processes of Linux: compiled once for all robots.
pub static PROCESSES: Processes = Processes::simulated_on::<Rack>();
