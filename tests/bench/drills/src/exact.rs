//! A stress of harts alone, in a machine whose time counts instructions: what comes out is the same each
//! time, and a release that is skipped is a fault of the program's.

use std::time::Duration;

use condor_host::error::AnyError;
use drills::alone::Alone;

use crate::summary;

const HARTS: u8 = 4;
/// An instruction takes 2⁴ ns.
const SHIFT: u8 = 4;
/// The longest time that a second of the machine may take, and that all else may take, in seconds.
const SLOWEST: u64 = 10;
const PATIENCE: Duration = Duration::from_secs(60);

/// Plays it: the arguments are the monitor, the image and how many seconds.
///
/// # Errors
/// Returns an error if an argument is missing, or if the stress goes wrong.
pub(crate) fn run(arguments: &[String]) -> Result<(), AnyError> {
    let [monitor, image, seconds] = arguments else {
        return Err("usage: drills exact MONITOR IMAGE SECONDS".into());
    };
    let parsed = seconds.parse::<u64>();
    let seconds = parsed.map_err(|error| format!("SECONDS: {error}"))?;
    let peers: Vec<_> = (0..HARTS).map(|number| number.to_string()).collect();
    let words = [
        "stress",
        &format!("peers={}", peers.join(",")),
        &format!("seconds={seconds}"),
        "exact",
    ];
    let harts = Alone::new(HARTS, image.as_ref(), &words)?;
    let patience = PATIENCE + Duration::from_secs(SLOWEST * seconds);
    let ended = harts.play(monitor.as_ref(), SHIFT, patience);
    let mut regions = Vec::new();
    for number in 0..HARTS {
        regions.push((format!("hart {number}"), harts.region(number)?));
    }
    let verdicts = summary::verdicts(regions.iter().map(|(name, region)| (name.as_str(), region)));
    // The reason for which a machine ended says more than what its harts did not do.
    ended?;
    verdicts
}
