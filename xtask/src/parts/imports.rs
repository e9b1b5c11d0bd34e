//! No circles of imports: between files that are not parent and child, and between the rooms of a folder.
//!
//! A room is a file, or a folder with the file of its module. Without circles the rooms of a folder have
//! an order in which all imports lead downwards.

use std::collections::BTreeSet;
use std::path::Path;

use crate::Result;
use crate::context::{Context, text};
use crate::parts::Summary;

mod circles;
mod modules;

use circles::circles;
use modules::{Import, Modules};

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let (mut files, mut found) = (0, Vec::new());
    for package in context.members()? {
        let root = Path::new(text(&package["manifest_path"])).parent();
        let source = root.ok_or("a package is in no directory")?.join("src");
        let main = ["lib.rs", "main.rs"].map(|name| source.join(name));
        let Some(main) = main.into_iter().find(|file| file.is_file()) else {
            continue;
        };
        let modules = Modules::read(&main)?;
        files += modules.files().count();
        for circle in of_files(&modules).chain(of_rooms(&modules)) {
            found.push(format!("{}: {circle}", text(&package["name"])));
        }
    }
    if files == 0 {
        return Err("no package has a source file".into());
    }
    for circle in &found {
        eprintln!("{circle}");
    }
    if !found.is_empty() {
        return Err(format!("{} circles in {files} files", found.len()).into());
    }
    Ok(Summary::of(format!("no circle in {files} files")))
}

/// The circles of files, without those of a module and what lies in it.
fn of_files(modules: &Modules) -> impl Iterator<Item = String> {
    let imports = modules.imports();
    let others = imports.filter(|import| {
        !import.from.starts_with(&import.to) && !import.to.starts_with(&import.from)
    });
    let edges: BTreeSet<_> = others.map(|Import { from, to }| (from, to)).collect();
    told("files", circles(&edges))
}

/// The circles of rooms in each folder.
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
    told("folders", folders.collect())
}

fn told(what: &str, circles: Vec<Vec<Vec<String>>>) -> impl Iterator<Item = String> {
    circles.into_iter().map(move |circle| {
        let names: Vec<_> = circle.iter().map(|path| path.join("::")).collect();
        format!("a circle of {what}: {}", names.join(", "))
    })
}
