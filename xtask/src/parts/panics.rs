//! A library of generics emits no code: the search is made in firmwares that contain every call, and in the
//! images of harts, which are whole programs.
//!
//! Their panic handler calls a function of a name of its own. The linker drops what nothing
//! reaches, so the name is in the image if and only if something there can panic. That the search
//! finds a panic is seen with a build that has one.

use crate::Result;
use crate::context::Context;
use crate::firmware::{self, HART_IMAGES, HARTS_TARGET, MACHINES, Machine};
use crate::image::{Image, Origin};
use crate::parts::Summary;
use crate::tools::need_target;

/// The function that the panic handlers of the firmwares call.
pub(super) const PANICKED: &str = "condor_firmware_panicked";
/// The function that panics in a build with the feature of that purpose.
const ON_PURPOSE: &str = "may_panic";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let (mut images, mut functions) = (0, 0);
    let mut look = |programs: &[&str], select: fn(&[&str]) -> String, target, profile| {
        need_target(context, target)?;
        functions += search(context, programs, select, target, profile)?;
        images += programs.len();
        Ok::<(), Box<dyn std::error::Error>>(())
    };
    for machine in &MACHINES {
        look(
            machine.programs,
            Machine::selection,
            machine.target,
            "small",
        )?;
    }
    look(&HART_IMAGES, firmware::packages, HARTS_TARGET, "release")?;
    Ok(Summary::of(format!(
        "{images} images, {functions} functions"
    )))
}

/// Searches programs that are linked alike, and returns the number of their functions.
fn search(
    context: &Context,
    programs: &[&str],
    select: fn(&[&str]) -> String,
    target: &str,
    profile: &str,
) -> Result<usize> {
    let build = |selection: &str| firmware::build(context, selection, target, profile);
    // One control for all that a linker makes in one way.
    let control = programs[0];
    let panicking = select(&[control]) + " --features panicking";
    let found = Image::read(&build(&panicking)?.join(control))?
        .origins_of(PANICKED)?
        .unwrap_or_default();
    if !found.iter().any(|origin| origin.what.contains(ON_PURPOSE)) {
        return Err(format!(
            "the search for panics misses one: {control} for {target} panics in `{ON_PURPOSE}` on purpose, but it found {}",
            list(&found)
        )
        .into());
    }
    let mut functions = 0;
    let images = build(&select(programs))?;
    for program in programs {
        let image = Image::read(&images.join(program))?;
        if let Some(origins) = image.origins_of(PANICKED)? {
            return Err(format!("{program} for {target} can panic: {}", list(&origins)).into());
        }
        functions += image.functions();
    }
    Ok(functions)
}

pub(super) fn list(origins: &[Origin]) -> String {
    if origins.is_empty() {
        return "no call that leads to it".into();
    }
    let origins: Vec<String> = origins.iter().map(Origin::to_string).collect();
    origins.join("\n")
}
