//! A library of generics emits no code: the search is made in firmwares that use every call, and in the
//! images of harts, which are whole programs.
//!
//! Their panic handler calls a function of a name of its own. The linker drops what nothing
//! reaches, so the name is in the image if and only if something there can panic. That the search
//! finds a panic is seen with a build that has one.

use crate::Result;
use crate::context::Context;
use crate::firmware::{self, FIRMWARES, HART_IMAGES};
use crate::image::{Image, Origin};
use crate::outcome::Summary;

/// What the panic handlers of the firmwares call.
const PANICKED: &str = "condor_firmware_panicked";
/// What panics in a build with the feature of that purpose.
const ON_PURPOSE: &str = "may_panic";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let firmwares = FIRMWARES
        .iter()
        .map(|firmware| (firmware::WORKSPACE, firmware.package, firmware.target));
    let images = HART_IMAGES
        .iter()
        .map(|package| (firmware::HARTS, *package, firmware::HARTS_TARGET));
    let mut functions = 0;
    for (workspace, package, target) in firmwares.chain(images) {
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
    Ok(Summary::of(format!(
        "{} firmwares and {} images of harts, {functions} functions",
        FIRMWARES.len(),
        HART_IMAGES.len()
    )))
}

fn list(origins: &[Origin]) -> String {
    if origins.is_empty() {
        return "no call that leads there".into();
    }
    let origins: Vec<String> = origins.iter().map(Origin::to_string).collect();
    origins.join("\n")
}
