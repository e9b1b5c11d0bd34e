//! A library of generics emits no code: the search is made in firmwares that use every call, and in the
//! images of harts, which are whole programs.
//!
//! Their panic handler calls a function of a name of its own. The linker drops what nothing
//! reaches, so the name is in the image if and only if something there can panic. That the search
//! finds a panic is seen with a build that has one.

use crate::Result;
use crate::context::Context;
use crate::firmware::{self, HART_IMAGES};
use crate::image::{Image, Origin};
use crate::parts::Summary;
use crate::tools::need_target;

/// The function that the panic handlers of the firmwares call.
pub(super) const PANICKED: &str = "condor_firmware_panicked";
/// The function that panics in a build with the feature of that purpose.
const ON_PURPOSE: &str = "may_panic";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let (mut images, mut functions) = (0, 0);
    let mut look = |packages: &[&str], target, profile| -> Result<()> {
        need_target(context, target)?;
        functions += search(context, packages, target, profile)?;
        images += packages.len();
        Ok(())
    };
    for group in firmware::groups() {
        let packages: Vec<_> = group.iter().map(|firmware| firmware.package).collect();
        look(&packages, group[0].target, "small")?;
    }
    look(&HART_IMAGES, firmware::HARTS_TARGET, "release")?;
    Ok(Summary::of(format!(
        "{images} images, {functions} functions"
    )))
}

/// Searches packages, which are linked alike, and returns the number of their functions.
fn search(context: &Context, packages: &[&str], target: &str, profile: &str) -> Result<usize> {
    let build = |packages: &[&str], features: &[String]| {
        firmware::build(context, packages, target, profile, features)
    };
    // One control for all that a linker makes in one way.
    let control = packages[0];
    let panicking = build(&[control], &[format!("{control}/panicking")])?.join(control);
    let found = Image::read(&panicking)?
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
    let images = build(packages, &[])?;
    for package in packages {
        let image = Image::read(&images.join(package))?;
        if let Some(origins) = image.origins_of(PANICKED)? {
            return Err(format!("{package} for {target} can panic: {}", list(&origins)).into());
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
