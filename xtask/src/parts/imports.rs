//! No circles of imports: between files that are not parent and child, between the rooms of a folder, and
//! between packages. And no package has sources of another one.
//!
//! A room is a file, or a folder with the file of its module. Without circles the rooms of a folder have
//! an order in which all imports lead downwards, and so have the packages of all workspaces.

use std::collections::BTreeSet;

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;

mod circles;
mod floors;
mod modules;
mod packages;
mod reaches;

use circles::circles;
use floors::floors;
use modules::Import;
pub(super) use modules::Modules;
use packages::Packages;
use reaches::reaches;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let packages = Packages::read(&context.root)?;
    let found = found(&packages);
    for problem in &found {
        eprintln!("{problem}");
    }
    let files = packages.files();
    if files == 0 {
        return Err("nothing was checked: no package has a source file".into());
    }
    if !found.is_empty() {
        return Err(format!(
            "{} faults in {files} files, printed above: imports in a circle, or files of another package that a \
             path includes",
            found.len()
        )
        .into());
    }
    if context.options.picture {
        print!("{}", picture(&packages));
    }
    Ok(Summary::of(format!(
        "no cycle of imports and no source of another package in {files} files of {} packages in {} workspaces",
        packages.all.len(),
        packages.workspaces
    )))
}

/// Returns all circles of the repository, and all sources of others, each in a line.
fn found(packages: &Packages) -> Vec<String> {
    let arrows = circle_lines("packages", circles(&packages.arrows()));
    let inside = packages.all.values().flat_map(|package| {
        let crates = package.crates.iter();
        let circles = crates.flat_map(|modules| of_files(modules).chain(of_rooms(modules)));
        let reaches = package.reaches.iter().cloned();
        let problems = circles.chain(reaches);
        problems.map(|problem| format!("{}: {problem}", package.name))
    });
    arrows.chain(inside).collect()
}

/// Returns the floors of the packages from bottom to top, each in a line: a package depends on those of
/// lower floors alone. The figures are lines of code.
fn picture(packages: &Packages) -> String {
    let floors = floors(packages.all.keys(), &packages.arrows());
    let lines = floors.iter().enumerate().map(|(floor, directories)| {
        let names = directories.iter().map(|directory| {
            let package = &packages.all[directory];
            format!("{} {}", package.name, package.lines)
        });
        let names: Vec<_> = names.collect();
        format!("{floor:2}  {}\n", names.join(", "))
    });
    lines.collect()
}

/// Returns the circles of files, without those of a module and what lies in it.
fn of_files(modules: &Modules) -> impl Iterator<Item = String> {
    let imports = modules.imports();
    let others = imports.filter(|import| {
        !import.from.starts_with(&import.to) && !import.to.starts_with(&import.from)
    });
    let edges: BTreeSet<_> = others.map(|Import { from, to }| (from, to)).collect();
    circle_lines("files", circles(&edges))
}

/// Returns the circles of rooms in each folder.
fn of_rooms(modules: &Modules) -> impl Iterator<Item = String> {
    let edges: BTreeSet<_> = modules
        .imports()
        .filter_map(|Import { from, to }| {
            let pairs = from.iter().zip(&to);
            let common = pairs.take_while(|(from, to)| from == to).count();
            let room = |path: &[String]| path.get(..=common).map(<[_]>::to_vec);
            Some((room(&from)?, room(&to)?))
        })
        .collect();
    let circles = circles(&edges).into_iter();
    // Others are circles of files.
    let folders = circles.filter(|circle| circle.iter().any(|room| modules.has_children(room)));
    circle_lines("folders", folders.collect())
}

fn circle_lines(
    what: &'static str,
    circles: Vec<Vec<Vec<String>>>,
) -> impl Iterator<Item = String> {
    circles.into_iter().map(move |circle| {
        let names: Vec<_> = circle.iter().map(|path| path.join("::")).collect();
        format!("a cycle of {what}: {}", names.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::{Packages, found, picture};

    /// Writes a package whose modules `a` and `b` are these.
    fn package(directory: &Path, manifest: &str, a: &str, b: &str) {
        let source = directory.join("src");
        fs::create_dir_all(&source).unwrap();
        let name = directory.file_name().unwrap().to_str().unwrap();
        let package = format!("[package]\nname = \"{name}\"\nedition = \"2024\"\n{manifest}");
        fs::write(directory.join("Cargo.toml"), package).unwrap();
        fs::write(source.join("lib.rs"), "// Both.\nmod a;\n\nmod b;\n").unwrap();
        fs::write(source.join("a.rs"), a).unwrap();
        fs::write(source.join("b.rs"), b).unwrap();
    }

    #[test]
    fn all_workspaces_are_read_wherever_they_are() {
        let root = tempfile::tempdir().unwrap();
        let (bottom, top) = (root.path().join("bottom"), root.path().join("deep/er/top"));
        let depends = "[dependencies]\nbottom = { path = \"../../../bottom\" }\n[workspace]\n";
        package(
            &bottom,
            "[workspace]\n",
            "pub struct A;\n",
            "use crate::a::A;\n",
        );
        package(
            &top,
            depends,
            "use crate::b::B;\npub struct A;\n",
            "use crate::a::A;\npub struct B;\n",
        );
        // What cargo has built has copies of packages.
        let built = root.path().join("target/package/built");
        package(
            &built,
            "[workspace]\n",
            "use crate::b::B;\npub struct A;\n",
            "use crate::a::A;\npub struct B;\n",
        );

        let packages = Packages::read(root.path()).unwrap();
        assert_eq!((packages.workspaces, packages.files()), (2, 6));
        assert_eq!(found(&packages), ["top: a cycle of files: a, b"]);
        assert_eq!(picture(&packages), " 0  bottom 4\n 1  top 6\n");
    }

    #[test]
    fn no_source_is_that_of_another_package() {
        let root = tempfile::tempdir().unwrap();
        let (one, other) = (root.path().join("one"), root.path().join("other"));
        let own = "#[path = \"../other/c.rs\"]\nmod c;\n";
        let theirs = "#[path = \"../../other/src/a.rs\"]\nmod c;\ninclude!(\"../../d.rs\");\n";
        package(&one, "build = \"../build.rs\"\n[workspace]\n", own, theirs);
        package(&other, "[workspace]\n", "", "");
        fs::write(root.path().join("build.rs"), "fn main() {}\n").unwrap();

        let packages = Packages::read(root.path()).unwrap();
        let script = root.path().canonicalize().unwrap().join("build.rs");
        let script = format!("one: Cargo.toml reaches {}", script.display());
        assert_eq!(
            found(&packages),
            [
                script.as_str(),
                "one: src/b.rs reaches ../../other/src/a.rs",
                "one: src/b.rs reaches ../../d.rs"
            ]
        );
    }
}
