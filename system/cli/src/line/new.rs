//! `condor new`: a project of one's own, made from an example.

use std::fs::{self, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use clap::Args;
use rustix::fs::{CWD, RenameFlags, renameat_with};
use tempfile::Builder;

use super::AnyError;

/// An example that becomes a project.
struct Template {
    /// The name of its package, and of its directory in `examples`.
    name: &'static str,
    /// The files that are made there when it is built or run.
    made: &'static [&'static str],
    /// The text that only the manifest of a package outside of another workspace has.
    workspace: &'static str,
    /// The commands to type next.
    next: &'static str,
}

const PROCESSORS: Template = Template {
    name: "two-processors",
    made: &["target", "Cargo.lock", ".condor-fs"],
    workspace: "
[workspace]
members = [\"hart\"]

[profile.release]
debug = 1
lto = \"fat\"
",
    next: "    \
           cargo test         # both programs in virtual time\n    \
           cargo run -- up    # both as processes of this machine; F1 is help",
};

const ROBOT: Template = Template {
    name: "one-finger",
    made: &["target", "Cargo.lock", "files"],
    workspace: "
[workspace]

[profile.release]
debug = 1
",
    next: "    \
           cargo test                   # the robot moves in simulated time\n    \
           cargo run --release -- up    # the robot, with its master's terminal; F1 is help",
};

#[derive(Debug, Args)]
pub(super) struct NewArguments {
    /// The directory to make; its last part becomes the name of the package
    directory: PathBuf,
    /// The directory with Condor's source tree; the project depends on the crates there
    #[arg(long, value_name = "CONDOR")]
    path: PathBuf,
    /// Makes a project for a robot with one finger, which a file describes, instead of programs for two processors
    #[arg(long)]
    robot: bool,
}

/// The remedy for a wrong `--path`.
const SOURCES: &str = "--path is the directory with Condor's source tree";

impl NewArguments {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let (directory, condor) = (self.directory.display(), self.path.display());
        let name = self.directory.file_name().unwrap_or_default();
        let name = name.to_str().filter(|name| is_package(name)).ok_or_else(|| {
            format!(
                "`{directory}` cannot be the name of a package: it begins with a small letter, and has small \
                 letters, digits and `-` alone"
            )
        })?;
        let tree = fs::canonicalize(&self.path)
            .map_err(|error| format!("`{condor}`: {error}; {SOURCES}"))?;
        let template = if self.robot { ROBOT } else { PROCESSORS };
        let from = tree.join("examples").join(template.name);
        if !from.is_dir() {
            let text = format!("`{condor}` has no `examples/{}`; {SOURCES}", template.name);
            return Err(text.into());
        }
        let plain = |path: &&str| !path.contains(['"', '\\']);
        let tree_name = tree.to_str().filter(plain);
        let tree_name = tree_name.ok_or_else(|| {
            format!("`{condor}` has a character that no path in Cargo.toml can have")
        })?;
        let io = |error: io::Error| match error.kind() {
            io::ErrorKind::AlreadyExists => {
                format!("`{directory}` exists already; choose another name")
            }
            _ => format!("`{directory}`: {error}"),
        };
        // The directory gets its name when it is complete.
        let parent = self.directory.parent();
        let parent = parent.filter(|it| !it.as_os_str().is_empty());
        let part = Builder::new()
            .permissions(Permissions::from_mode(0o777))
            .tempdir_in(parent.unwrap_or(Path::new(".")))
            .map_err(io)?;
        copy(&from, part.path(), template.made, &|text| {
            text.replace("../../../", "../../")
                .replace("../../", &format!("{tree_name}/"))
                .replace(template.name, name)
                .replace(&template.name.replace('-', "_"), &name.replace('-', "_"))
        })?;
        let manifest = part.path().join("Cargo.toml");
        let text = fs::read_to_string(&manifest)? + template.workspace;
        fs::write(manifest, text)?;
        // The versions with which the crates are tested.
        let lock = tree.join("Cargo.lock");
        if lock.is_file() {
            fs::copy(lock, part.path().join("Cargo.lock"))?;
        }
        let named = renameat_with(
            CWD,
            part.path(),
            CWD,
            &self.directory,
            RenameFlags::NOREPLACE,
        );
        named.map_err(|error| io(error.into()))?;
        // The directory has its own name now, and nothing is left to remove.
        let _ = part.keep();
        println!(
            "`{directory}` is made. Its README.md says what to do next:\n\n    cd {directory}\n{}",
            template.next
        );
        Ok(())
    }
}

/// Whether a package can have this name, and its crate, too.
fn is_package(name: &str) -> bool {
    let begins = name.starts_with(|first: char| first.is_ascii_lowercase());
    let is_known = |one: char| one.is_ascii_lowercase() || one.is_ascii_digit() || one == '-';
    begins && name.chars().all(is_known)
}

/// Copies what is in a directory, with its texts changed.
fn copy(
    from: &Path,
    to: &Path,
    made: &[&str],
    change: &dyn Fn(String) -> String,
) -> Result<(), AnyError> {
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        if made.iter().any(|made| entry.file_name() == *made) {
            continue;
        }
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            fs::create_dir(&to)?;
            copy(&from, &to, made, change)?;
        } else {
            let text = fs::read_to_string(&from);
            let text = text.map_err(|error| format!("`{}`: {error}", from.display()))?;
            fs::write(&to, change(text))?;
        }
    }
    Ok(())
}
