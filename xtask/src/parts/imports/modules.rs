//! [`Modules`]: the files of a crate, and what they take from each other.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};
use syn::{Item, UseTree};

use crate::Result;
use crate::sources::{attributes, is_for_fuzzing, is_for_tests};

/// The path of a module from the root of its crate; that of the root is empty.
type Name = Vec<String>;

/// The modules of a crate, each in a file of its own.
#[derive(Default)]
pub(in crate::parts) struct Modules(BTreeMap<Name, Module>);

#[derive(Default)]
struct Module {
    file: PathBuf,
    /// The names of the items that it defines.
    items: BTreeSet<String>,
    /// The names that it imports, and the path of each.
    names: BTreeMap<String, Vec<String>>,
    /// The modules of which it takes everything.
    globs: Vec<Vec<String>>,
    /// Paths in its code that begin with `crate`, `self` or `super`.
    paths: BTreeSet<Vec<String>>,
}

/// A file takes something from another one.
pub(super) struct Import {
    pub from: Name,
    pub to: Name,
}

impl Modules {
    /// Reads the files of a crate, of which this is the first. What is for tests alone is left out.
    pub(in crate::parts) fn read(main: &Path) -> Result<Self> {
        let mut modules = Self::default();
        let directory = main.parent().unwrap_or(main);
        modules.read_file(main, directory, &[])?;
        Ok(modules)
    }

    pub(in crate::parts) fn files(&self) -> impl Iterator<Item = &Path> {
        self.0.values().map(|module| module.file.as_path())
    }

    pub(super) fn has_children(&self, name: &[String]) -> bool {
        self.0
            .keys()
            .any(|it| it.len() > name.len() && it.starts_with(name))
    }

    pub(super) fn imports(&self) -> impl Iterator<Item = Import> {
        self.0.iter().flat_map(|(from, module)| {
            let paths = module
                .names
                .values()
                .chain(&module.globs)
                .chain(&module.paths);
            let targets = paths.filter_map(|path| self.resolve(from, path, 0));
            let targets: BTreeSet<_> = targets.filter(|to| to != from).collect();
            targets.into_iter().map(|to| Import {
                from: from.clone(),
                to,
            })
        })
    }

    fn read_file(&mut self, file: &Path, directory: &Path, name: &[String]) -> Result<()> {
        let source = fs::read_to_string(file)?;
        let syntax =
            syn::parse_file(&source).map_err(|error| format!("{}: {error}", file.display()))?;
        let mut module = Module {
            file: file.to_owned(),
            ..Module::default()
        };
        let mut children = Vec::new();
        module.add(&syntax.items, &mut children);
        self.0.insert(name.to_vec(), module);
        for child in children {
            let mut path = name.to_vec();
            path.push(child.clone());
            let own = directory.join(&child);
            let candidates = [directory.join(format!("{child}.rs")), own.join("mod.rs")];
            if let Some(file) = candidates.iter().find(|file| file.is_file()) {
                self.read_file(file, &own, &path)?;
            }
        }
        Ok(())
    }

    /// Returns the module in whose file the item of a path is, as far as it is one of the crate.
    fn resolve(&self, from: &Name, path: &[String], depth: u32) -> Option<Name> {
        // Names that stand for each other would not end.
        if depth > 16 {
            return None;
        }
        let (first, mut rest) = path.split_first()?;
        let mut at = match first.as_str() {
            "crate" => Vec::new(),
            "self" => from.clone(),
            "super" => from.split_last()?.1.to_vec(),
            _ => {
                rest = path;
                from.clone()
            }
        };
        while let Some((next, after)) = rest.split_first() {
            if next == "super" {
                at.pop()?;
                rest = after;
                continue;
            }
            let mut child = at.clone();
            child.push(next.clone());
            if self.0.contains_key(&child) {
                (at, rest) = (child, after);
                continue;
            }
            let module = self.0.get(&at)?;
            if module.items.contains(next) {
                return Some(at);
            }
            if let Some(target) = module.names.get(next) {
                let mut target = target.clone();
                target.extend_from_slice(after);
                return (target != path || &at != from)
                    .then(|| self.resolve(&at, &target, depth + 1))?;
            }
            let mut globs = module.globs.iter();
            return globs.find_map(|glob| {
                let mut target = glob.clone();
                target.extend_from_slice(rest);
                self.resolve(&at, &target, depth + 1)
            });
        }
        Some(at)
    }
}

impl Module {
    fn add(&mut self, items: &[Item], children: &mut Vec<String>) {
        for item in items {
            let attributes = attributes(item);
            if is_for_tests(attributes) || is_for_fuzzing(attributes) {
                continue;
            }
            match item {
                Item::Use(item) => self.import(&item.tree, &mut Vec::new()),
                Item::Mod(item) if item.content.is_none() => children.push(item.ident.to_string()),
                Item::Mod(item) => drop(self.items.insert(item.ident.to_string())),
                item => {
                    self.items.extend(defined(item));
                    Paths(&mut self.paths).visit_item(item);
                }
            }
        }
    }

    fn import(&mut self, tree: &UseTree, path: &mut Vec<String>) {
        let mut name = |path: &[String], name: String| {
            self.names.insert(name, path.to_vec());
        };
        match tree {
            UseTree::Path(tree) => {
                path.push(tree.ident.to_string());
                self.import(&tree.tree, path);
                path.pop();
            }
            UseTree::Name(tree) if tree.ident == "self" => {
                name(path, path.last().cloned().unwrap_or_default());
            }
            UseTree::Name(tree) => {
                path.push(tree.ident.to_string());
                name(path, tree.ident.to_string());
                path.pop();
            }
            UseTree::Rename(tree) => {
                path.push(tree.ident.to_string());
                // Several may be called `_`.
                name(path, format!("{} as {}", tree.ident, tree.rename));
                name(path, tree.rename.to_string());
                path.pop();
            }
            UseTree::Glob(_) => self.globs.push(path.clone()),
            UseTree::Group(tree) => {
                for tree in &tree.items {
                    self.import(tree, path);
                }
            }
        }
    }
}

/// Finds paths that lead out of a file.
struct Paths<'p>(&'p mut BTreeSet<Vec<String>>);

impl<'ast> Visit<'ast> for Paths<'_> {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names = path
            .segments
            .iter()
            .map(|segment| segment.ident.to_string());
        let names: Vec<_> = names.collect();
        if names.len() > 1 && ["crate", "self", "super"].contains(&names[0].as_str()) {
            self.0.insert(names);
        }
        visit::visit_path(self, path);
    }

    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}
}

/// Returns the names that an item defines.
fn defined(item: &Item) -> Option<String> {
    let name = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        _ => return None,
    };
    Some(name.to_string())
}
