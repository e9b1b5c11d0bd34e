//! A library of generics emits no code: the search is made in firmwares that use every call, and in the
//! images of harts, which are whole programs.
//!
//! Their panic handler calls a function of a name of its own. The linker drops what nothing
//! reaches, so the name is in the image if and only if something there can panic. That the search
//! finds a panic is seen with a build that has one.

use crate::Result;
use crate::command::side_by_side;
use crate::context::Context;
use crate::firmware::{self, FIRMWARES, Firmware, HART_IMAGES};
use crate::image::{Image, Origin};
use crate::outcome::Summary;
use crate::tools::need_target;

/// What the panic handlers of the firmwares call.
const PANICKED: &str = "condor_firmware_panicked";
/// What panics in a build with the feature of that purpose.
const ON_PURPOSE: &str = "may_panic";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    for firmware in &FIRMWARES {
        need_target(context, firmware.target)?;
    }
    need_target(context, firmware::HARTS_TARGET)?;
    let images = HART_IMAGES.map(|package| (firmware::HARTS, package, firmware::HARTS_TARGET));
    // The images take longest.
    let mut lanes = vec![images.to_vec()];
    lanes.extend(firmware::lanes().map(|lane| {
        let built = |it: &Firmware| (firmware::WORKSPACE, it.package, it.target);
        lane.into_iter().map(built).collect()
    }));
    let functions = side_by_side(&lanes, |lane| search(context, lane))?;
    Ok(Summary::of(format!(
        "{} firmwares and {} images of harts, {} functions",
        FIRMWARES.len(),
        HART_IMAGES.len(),
        functions.iter().sum::<usize>()
    )))
}

/// Searches packages, each with its workspace and its target, and gives the number of their functions.
fn search(context: &Context, packages: &[(&str, &str, &str)]) -> Result<usize> {
    let mut functions = 0;
    for &(workspace, package, target) in packages {
        let build = |features| firmware::build(context, workspace, package, target, features);
        let name = format!("{package} for {target}");
        let control = Image::read(&build("panicking")?)?;
        let found = control.origins_of(PANICKED)?.unwrap_or_default();
        if !found.iter().any(|origin| origin.what.contains(ON_PURPOSE)) {
            return Err(format!(
                "{name}: the search does not find the panic in `{ON_PURPOSE}`, but {}",
                list(&found)
            )
            .into());
        }
        let image = Image::read(&build("")?)?;
        if let Some(origins) = image.origins_of(PANICKED)? {
            return Err(format!("{name} can panic: {}", list(&origins)).into());
        }
        functions += image.functions();
    }
    Ok(functions)
}

fn list(origins: &[Origin]) -> String {
    if origins.is_empty() {
        return "no call that leads there".into();
    }
    let origins: Vec<String> = origins.iter().map(Origin::to_string).collect();
    origins.join("\n")
}
