//! Each feature, and with `--whole` each two: a mistake between features shows with two of them, or with all, which
//! `lint` looks at. The same builds show that the oldest toolchain suffices: the MSRV is written once, as `rust-version` of
//! the root manifest.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use crate::Result;
use crate::command::Line;
use crate::context::{Context, list, text};
use crate::parts::Summary;
use crate::tools::need_toolchain;

/// Programs: `lint`, `no-std` and `riscv` build the sets in which they are used.
const PROGRAMS: [&str; 3] = ["drills", "utah-mit-hand", "xtask"];

/// The feature for fuzz targets, which is combined with none: nothing of a library depends on it.
const ALONE: &str = "hostile";

/// The features of a package, each with all that it enables of its own package.
type Features = BTreeMap<String, BTreeSet<String>>;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let members = context.members()?;
    let msrv = promised(&members)?;
    let (toolchain, left_out) = match need_toolchain(context, &msrv) {
        Ok(()) => (format!("+{msrv}"), None),
        Err(problem) => (
            String::new(),
            Some(format!("{msrv}, which cannot be installed: {problem}")),
        ),
    };
    let check = |what: &str| -> Line {
        context
            .command(&format!("cargo {toolchain} check {what}"))
            .env("RUSTFLAGS", "-D warnings")
            .env("CARGO_TARGET_DIR", "target/features")
    };
    // The dependencies of all, side by side.
    check("--workspace --all-features").run()?;
    let mut combinations = 0;
    for package in &members {
        let name = text(&package["name"]);
        if PROGRAMS.contains(&name) {
            continue;
        }
        for set in combined(&features(package), context.options.whole) {
            let set: Vec<_> = set.into_iter().collect();
            let set = set.join(",");
            check(&format!("-p {name} --no-default-features --features={set}")).run()?;
            combinations += 1;
        }
    }
    if combinations == 0 {
        return Err("nothing was checked: no package has features".into());
    }
    let pairs = if context.options.whole {
        ", with all pairs"
    } else {
        ""
    };
    let summary = Summary::of(format!("{combinations} combinations{pairs}, Rust {msrv}"));
    Ok(match left_out {
        Some(what) => summary.leaving_out(what),
        None => summary,
    })
}

/// Returns the one `rust-version` of all members.
fn promised(members: &[Value]) -> Result<String> {
    let versions: BTreeSet<&str> = members
        .iter()
        .map(|package| text(&package["rust_version"]))
        .collect();
    match versions.iter().collect::<Vec<_>>()[..] {
        [one] if !one.is_empty() => Ok((*one).to_owned()),
        _ => Err(format!("the packages must have the same rust-version, not {versions:?}").into()),
    }
}

fn features(package: &Value) -> Features {
    let Value::Object(features) = &package["features"] else {
        return Features::new();
    };
    let enabled = |first: &str| {
        let (mut all, mut next) = (BTreeSet::new(), vec![first.to_owned()]);
        while let Some(name) = next.pop() {
            if let Some(enables) = features.get(&name)
                && all.insert(name)
            {
                next.extend(list(enables).iter().map(|name| text(name).to_owned()));
            }
        }
        all
    };
    let names = features.keys().filter(|name| *name != "default");
    names.map(|name| (name.clone(), enabled(name))).collect()
}

/// Returns no feature, each, and if it is wished for each two except [`ALONE`], as the sets that they enable: every set
/// once.
fn combined(features: &Features, pairs: bool) -> BTreeSet<BTreeSet<String>> {
    let mut sets = BTreeSet::from([BTreeSet::new()]);
    for (first, enabled) in features {
        sets.insert(enabled.clone());
        for (second, others) in features {
            if pairs && first != ALONE && second != ALONE {
                sets.insert(enabled | others);
            }
        }
    }
    sets
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{combined, features, promised};

    #[test]
    fn every_set_is_there_once() {
        let package = json!({"features": {
            "default": [], "a": [], "b": ["a", "dep:c"], "c": ["other/b"], "d": [], "hostile": ["a"],
        }});
        let sets = |pairs| -> Vec<String> {
            let sets = combined(&features(&package), pairs);
            sets.into_iter()
                .map(|set| set.into_iter().collect())
                .collect()
        };
        assert_eq!(sets(false), ["", "a", "ab", "ahostile", "c", "d"]);
        assert_eq!(
            sets(true),
            [
                "", "a", "ab", "abc", "abd", "ac", "ad", "ahostile", "c", "cd", "d"
            ]
        );
    }

    #[test]
    fn the_members_promise_one_version() {
        let member = |version: &str| json!({"rust_version": version});
        assert_eq!(promised(&[member("1.88"), member("1.88")]).unwrap(), "1.88");
        assert!(promised(&[member("1.88"), member("1.89")]).is_err());
        assert!(promised(&[json!({})]).is_err());
    }
}
