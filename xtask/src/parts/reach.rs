//! Modules of the libraries that no program of the tree reaches: each needs a reason in `xtask/reach.toml`.
//!
//! A program is an executable that people or harts run, not a test, a benchmark or an example of a library. The
//! linker drops functions that nothing reaches, and the line tables of an image name the files of all others, with
//! those of derived functions. A file without a function, of types alone for example, needs no reason.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use addr2line::gimli::{
    AttributeValue, Dwarf, DwarfSections, EndianSlice, LineProgramHeader, LineRow, LittleEndian,
    SectionId, Unit,
};
use object::{Object as _, ObjectSection as _, SectionKind};
use serde_json::Value;
use syn::visit::Visit;
use syn::{ImplItemFn, Item, ItemFn, TraitItemFn};

use crate::Result;
use crate::command::side_by_side;
use crate::context::{Context, list, text};
use crate::firmware::{self, HART_IMAGES, HARTS_TARGET};
use crate::parts::Summary;
use crate::parts::imports::Modules;
use crate::parts::test;
use crate::sources::{attributes, is_for_fuzzing, is_for_tests};
use crate::tools::need_target;

const LIBRARIES: [&str; 6] = [
    "condor-dev",
    "condor-fs",
    "condor-hand",
    "condor-mbox",
    "condor-mos",
    "condor-tty",
];

/// The file of reasons: the path of each module from the root, and a sentence.
const REASONS: &str = "xtask/reach.toml";

type Data<'a> = EndianSlice<'a, LittleEndian>;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let modules = modules(context)?;
    let images = images(context)?;
    let reached = side_by_side(&images, |image| {
        let reached = files_in(image)
            .map_err(|problem| format!("{}: {problem}", image.display()))?
            .iter()
            .filter_map(|file| file.strip_prefix(&context.root).ok())
            .filter(|file| modules.contains(*file))
            .map(Path::to_owned)
            .collect::<BTreeSet<_>>();
        if reached.is_empty() {
            let image = image.display();
            return Err(format!("{image} has no line number of any of the libraries").into());
        }
        Ok(reached)
    })?;
    let reached: BTreeSet<_> = reached.into_iter().flatten().collect();
    let reasons = reasons(context).map_err(|problem| format!("{REASONS}: {problem}"))?;
    let problems = problems(&modules, &reached, &reasons);
    for problem in &problems {
        eprintln!("{problem}");
    }
    if !problems.is_empty() {
        return Err(format!(
            "{} modules, printed above: use or remove those that no program reaches, or say in {REASONS} why they are \
             there; remove reasons that do not hold",
            problems.len()
        )
        .into());
    }
    Ok(Summary::of(format!(
        "{} programs reach {} modules, {} others have a reason",
        images.len(),
        reached.len(),
        reasons.len()
    )))
}

/// Returns the modules that have a function, by their paths from the root.
fn modules(context: &Context) -> Result<BTreeSet<PathBuf>> {
    let mut modules = BTreeSet::new();
    for library in LIBRARIES {
        let read = Modules::read(&context.root.join(library).join("src/lib.rs"))?;
        for file in read.files() {
            if has_function(&fs::read_to_string(file)?)? {
                modules.insert(file.strip_prefix(&context.root)?.to_owned());
            }
        }
    }
    Ok(modules)
}

/// Returns true if a file has a function with a body, apart from those of tests.
fn has_function(source: &str) -> Result<bool> {
    struct Found(bool);
    impl<'ast> Visit<'ast> for Found {
        fn visit_item(&mut self, item: &'ast Item) {
            let attributes = attributes(item);
            if !is_for_tests(attributes) && !is_for_fuzzing(attributes) {
                syn::visit::visit_item(self, item);
            }
        }

        fn visit_item_fn(&mut self, _: &'ast ItemFn) {
            self.0 = true;
        }

        fn visit_impl_item_fn(&mut self, function: &'ast ImplItemFn) {
            self.0 |= !is_for_tests(&function.attrs);
        }

        fn visit_trait_item_fn(&mut self, function: &'ast TraitItemFn) {
            self.0 |= function.default.is_some();
        }
    }
    let mut found = Found(false);
    found.visit_file(&syn::parse_file(source)?);
    Ok(found.0)
}

/// Builds the programs as other parts do, and returns their paths.
///
/// The firmwares of tests are left out: they contain every call, so that the search for panics sees it.
fn images(context: &Context) -> Result<Vec<PathBuf>> {
    test::build(context)?;
    let programs = context.target()?.join("debug");
    let mut images = Vec::new();
    for package in context.members()? {
        let manifest = Path::new(text(&package["manifest_path"]));
        let directory = manifest.strip_prefix(&context.root)?;
        if directory.starts_with("tests") || directory.starts_with("xtask") {
            continue;
        }
        let is_program = |target: &&Value| text(&target["kind"][0]) == "bin";
        let targets = list(&package["targets"]).iter().filter(is_program);
        images.extend(targets.map(|target| programs.join(text(&target["name"]))));
    }
    need_target(context, HARTS_TARGET)?;
    let selection = firmware::packages(&HART_IMAGES);
    let folder = firmware::build(context, &selection, HARTS_TARGET, "release")?;
    // The drills are tests.
    let harts = HART_IMAGES.iter().filter(|image| **image != "drills-hart");
    images.extend(harts.map(|image| folder.join(image)));
    Ok(images)
}

/// Returns the source files of the code of an image.
fn files_in(image: &Path) -> Result<BTreeSet<PathBuf>> {
    let bytes = fs::read(image)?;
    let image = object::File::parse(&*bytes)?;
    let code: Vec<_> = image
        .sections()
        .filter(|section| section.kind() == SectionKind::Text)
        .map(|section| section.address()..section.address() + section.size())
        .collect();
    let sections = DwarfSections::load(|id: SectionId| -> Result<_> {
        let section = image.section_by_name(id.name());
        let data = section.map(|section| section.uncompressed_data());
        Ok(data.transpose()?.unwrap_or_default())
    })?;
    let dwarf = sections.borrow(|data| EndianSlice::new(data, LittleEndian));
    let mut files = BTreeSet::new();
    let mut units = dwarf.units();
    while let Some(unit) = units.next()? {
        let unit = dwarf.unit(unit)?;
        let Some(program) = unit.line_program.clone() else {
            continue;
        };
        let mut found = HashMap::new();
        let mut rows = program.rows();
        while let Some((header, row)) = rows.next_row()? {
            // The rows of dropped functions have addresses from 0 on, below all code. Code of no line is of the
            // compiler, which names the file of the crate.
            let has_line = !row.end_sequence() && row.line().is_some();
            let is_code = has_line && code.iter().any(|it| it.contains(&row.address()));
            if is_code && !found.contains_key(&row.file_index()) {
                found.insert(row.file_index(), path(&dwarf, &unit, header, row)?);
            }
        }
        files.extend(found.into_values().flatten());
    }
    Ok(files)
}

/// Returns the path of the file of a row, if it has one.
fn path(
    dwarf: &Dwarf<Data<'_>>,
    unit: &Unit<Data<'_>>,
    header: &LineProgramHeader<Data<'_>>,
    row: &LineRow,
) -> Result<Option<PathBuf>> {
    let Some(file) = row.file(header) else {
        return Ok(None);
    };
    let folder = unit.comp_dir.map(AttributeValue::String);
    let parts = folder.into_iter().chain(file.directory(header));
    let mut path = PathBuf::new();
    for part in parts.chain([file.path_name()]) {
        let part = dwarf.attr_string(unit, part)?;
        path.push(&*part.to_string_lossy());
    }
    Ok(Some(path))
}

fn reasons(context: &Context) -> Result<BTreeMap<PathBuf, String>> {
    let text = fs::read_to_string(context.root.join(REASONS))?;
    Ok(toml::from_str(&text)?)
}

/// Returns the modules that lack a reason and the reasons that do not hold, each in a line.
fn problems(
    modules: &BTreeSet<PathBuf>,
    reached: &BTreeSet<PathBuf>,
    reasons: &BTreeMap<PathBuf, String>,
) -> Vec<String> {
    let unreached = modules.difference(reached);
    let lacking = unreached.filter(|module| !reasons.contains_key(*module));
    let lacking = lacking.map(|module| (module, "no program reaches it, and it has no reason"));
    let wrong = reasons.iter().filter_map(|(module, reason)| {
        let problem = if reached.contains(module) {
            "it has a reason, but a program reaches it"
        } else if !modules.contains(module) {
            "it has a reason, but there is no such module with a function"
        } else if reason.trim().is_empty() {
            "its reason is empty"
        } else {
            return None;
        };
        Some((module, problem))
    });
    lacking
        .chain(wrong)
        .map(|(module, problem)| format!("{}: {problem}", module.display()))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::{has_function, problems};

    #[test]
    fn a_function_has_a_body_and_is_not_for_tests() {
        for source in [
            "fn f() {}",
            "mod m { impl S { const fn f() {} } }",
            "trait T { fn f() {} }",
        ] {
            assert!(has_function(source).unwrap(), "{source}");
        }
        for source in [
            "pub use a::b; struct S; const C: u8 = 1; trait T { fn f(); }",
            "#[cfg(test)] mod tests { fn f() {} }",
            "impl S { #[cfg(test)] fn f() {} }",
            "#[cfg(feature = \"hostile\")] fn f() {}",
        ] {
            assert!(!has_function(source).unwrap(), "{source}");
        }
    }

    #[test]
    fn each_unreached_module_has_a_reason_and_no_other_has() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect();
        let (modules, reached) = (paths(&["a", "b", "c"]), paths(&["a"]));
        let judged = |reasons: &[(&str, &str)]| {
            let reasons = reasons
                .iter()
                .map(|(path, why)| (path.into(), (*why).into()));
            problems(&modules, &reached, &reasons.collect()).len()
        };
        assert_eq!(judged(&[("b", "for boards"), ("c", "for boards")]), 0);
        assert_eq!(judged(&[("b", "for boards")]), 1);
        assert_eq!(judged(&[("b", "for boards"), ("c", " ")]), 1);
        assert_eq!(
            judged(&[("a", "reached"), ("b", "x"), ("c", "x"), ("d", "none")]),
            2
        );
    }
}
