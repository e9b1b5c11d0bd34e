//! The MSRV is written once, as `rust-version` of the root manifest.

use serde_json::Value;

use crate::Result;
use crate::command::command;
use crate::context::{Context, text};
use crate::outcome::Summary;
use crate::tools::{need_component, need_toolchain};

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let msrv = promised(&context.members()?)?;
    let Err(problem) = need_toolchain(context, &msrv) else {
        let line = format!("cargo +{msrv} check --workspace --all-features");
        command(context, &line).run()?;
        return Ok(Summary::of(format!("{msrv}, compiled with that toolchain")));
    };
    eprintln!("{problem}");
    need_component(context, None, "clippy")?;
    command(
        context,
        "cargo clippy --workspace --all-targets --all-features -- -D clippy::incompatible_msrv",
    )
    .run()?;
    let dependencies = context.members_and_dependencies()?;
    let too_new = newer_than(&msrv, &dependencies)?;
    if !too_new.is_empty() {
        return Err(format!("need more than {msrv}: {}", too_new.join(", ")).into());
    }
    Ok(Summary::of(format!(
        "{msrv}, by clippy::incompatible_msrv and the rust-version of {} packages",
        dependencies.len()
    ))
    .leaving_out(format!("COMPILING, toolchain {msrv} is not to be had")))
}

/// The one `rust-version` of all members.
fn promised(members: &[Value]) -> Result<String> {
    let mut versions: Vec<&str> = members
        .iter()
        .map(|package| text(&package["rust_version"]))
        .collect();
    versions.sort_unstable();
    versions.dedup();
    match versions[..] {
        [one] if !one.is_empty() => Ok(one.to_owned()),
        _ => Err(format!("not one rust-version, but {versions:?}").into()),
    }
}

/// The packages that say they need a newer toolchain.
fn newer_than(msrv: &str, packages: &[Value]) -> Result<Vec<String>> {
    let msrv = version(msrv)?;
    let mut newer = Vec::new();
    for package in packages {
        let needed = text(&package["rust_version"]);
        if !needed.is_empty() && version(needed)? > msrv {
            newer.push(format!("{} ({needed})", text(&package["name"])));
        }
    }
    Ok(newer)
}

/// `1.88` or `1.88.0` as numbers; a part that is not there is zero.
fn version(text: &str) -> Result<[u32; 3]> {
    let mut parts = [0; 3];
    for (part, digits) in parts.iter_mut().zip(text.split('.')) {
        *part = digits
            .parse()
            .map_err(|_| format!("`{text}` is no version"))?;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{newer_than, promised};

    #[test]
    fn names_what_is_newer() {
        let packages = [
            json!({"name": "same", "rust_version": "1.88"}),
            json!({"name": "patch", "rust_version": "1.88.1"}),
            json!({"name": "older", "rust_version": "1.9.9"}),
            json!({"name": "silent", "rust_version": null}),
        ];
        assert_eq!(newer_than("1.88", &packages).unwrap(), ["patch (1.88.1)"]);
    }

    #[test]
    fn refuses_two_promises_and_none() {
        let one = json!({"rust_version": "1.88"});
        assert_eq!(promised(&[one.clone(), one.clone()]).unwrap(), "1.88");
        assert!(promised(&[one.clone(), json!({"rust_version": "1.89"})]).is_err());
        assert!(promised(&[one, json!({"rust_version": null})]).is_err());
    }
}
