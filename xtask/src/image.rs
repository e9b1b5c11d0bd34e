//! The calls between the functions of a linked image, by the relocations that the linker has kept.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use addr2line::Context;
use addr2line::gimli::{Dwarf, EndianSlice, LittleEndian, SectionId};
use object::{Architecture, Object as _, ObjectSection as _, ObjectSymbol as _};
use object::{RelocationTarget, SectionKind, SymbolKind};

use crate::Result;

/// An image with symbols, relocations (`--emit-relocs`) and line numbers.
pub(crate) struct Image {
    /// The functions, by address.
    functions: BTreeMap<u64, Function>,
    /// For each function, the addresses in code that refer to it.
    references: BTreeMap<u64, BTreeSet<u64>>,
    /// The sections that say which line an address is of, by name.
    debug: BTreeMap<String, Vec<u8>>,
}

struct Function {
    name: String,
    size: u64,
}

/// Code outside of Rust's own libraries that leads to what was searched for.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Origin {
    /// The function, or what it was inlined into.
    pub what: String,
    /// File and line.
    pub place: String,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.what, self.place)
    }
}

impl Image {
    /// Reads an ELF image.
    ///
    /// # Errors
    /// Returns an error if the file is not an image, or if its relocations were dropped.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path)?;
        let file = object::File::parse(&*bytes)?;
        // The lowest bit of a function's address says that it is Thumb code.
        let mask = if file.architecture() == Architecture::Arm {
            !1
        } else {
            !0
        };
        let functions: BTreeMap<u64, Function> = file
            .symbols()
            .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
            .map(|symbol| {
                let name = symbol.name().unwrap_or_default();
                let function = Function {
                    name: addr2line::demangle_auto(name.into(), None).into_owned(),
                    size: symbol.size(),
                };
                (symbol.address() & mask, function)
            })
            .collect();
        let mut references = BTreeMap::<u64, BTreeSet<u64>>::new();
        let code = file
            .sections()
            .filter(|section| section.kind() == SectionKind::Text);
        for section in code {
            for (at, relocation) in section.relocations() {
                if let RelocationTarget::Symbol(index) = relocation.target() {
                    let target = file.symbol_by_index(index)?.address() & mask;
                    if functions.contains_key(&target) {
                        references.entry(target).or_default().insert(at);
                    }
                }
            }
        }
        // The linker has applied the relocations that it kept: the data is used as it is.
        let mut debug = BTreeMap::new();
        for section in file.sections() {
            let name = section.name()?;
            if name.starts_with(".debug_") {
                let data = section.uncompressed_data()?.into_owned();
                debug.insert(name.to_owned(), data);
            }
        }
        if references.is_empty() {
            return Err(format!(
                "{}: there are no relocations; link it with `--emit-relocs`",
                path.display()
            )
            .into());
        }
        Ok(Self {
            functions,
            references,
            debug,
        })
    }

    /// Returns the number of functions of the image.
    pub(crate) fn functions(&self) -> usize {
        self.functions.len()
    }

    /// Returns the places from which calls lead to `sink`, if it is in the image at all.
    ///
    /// Callers are followed through Rust's own libraries, until code of somebody else is met.
    ///
    /// # Errors
    /// Returns an error if the line numbers cannot be read.
    pub(crate) fn origins_of(&self, sink: &str) -> Result<Option<Vec<Origin>>> {
        let Some((&sink, _)) = self
            .functions
            .iter()
            .find(|(_, function)| function.name == sink)
        else {
            return Ok(None);
        };
        let lines = self.lines()?;
        let mut origins = BTreeSet::new();
        let mut seen = BTreeSet::new();
        let mut to_follow = vec![sink];
        while let Some(target) = to_follow.pop() {
            if !seen.insert(target) {
                continue;
            }
            for &at in self.references.get(&target).into_iter().flatten() {
                let Some((start, function)) = self.containing(at) else {
                    continue;
                };
                // The handler itself is the last step of every path.
                if function.name.ends_with("rust_begin_unwind") {
                    to_follow.push(start);
                    continue;
                }
                match origin(&lines, at, function)? {
                    Some(origin) => drop(origins.insert(origin)),
                    None => to_follow.push(start),
                }
            }
        }
        Ok(Some(origins.into_iter().collect()))
    }

    fn containing(&self, address: u64) -> Option<(u64, &Function)> {
        let (&start, function) = self.functions.range(..=address).next_back()?;
        (address - start < function.size).then_some((start, function))
    }

    fn lines(&self) -> Result<Lines<'_>> {
        let section = |id: SectionId| -> Result<_> {
            let data = self.debug.get(id.name()).map_or(&[][..], Vec::as_slice);
            Ok(EndianSlice::new(data, LittleEndian))
        };
        Ok(Context::from_dwarf(Dwarf::load(section)?)?)
    }
}

type Lines<'a> = Context<EndianSlice<'a, LittleEndian>>;

/// Returns the innermost of the functions inlined at `address` that is not of Rust's own libraries.
fn origin(lines: &Lines<'_>, address: u64, function: &Function) -> Result<Option<Origin>> {
    let mut frames = lines.find_frames(address).skip_all_loads()?;
    let mut known = false;
    while let Some(frame) = frames.next()? {
        let Some(location) = frame.location else {
            continue;
        };
        known = true;
        let file = location.file.unwrap_or_default();
        if !file.starts_with("/rustc/") {
            let name = frame.function.and_then(|name| {
                let name = name.demangle().ok()?;
                Some(name.into_owned())
            });
            return Ok(Some(Origin {
                what: name.unwrap_or_else(|| function.name.clone()),
                place: format!("{file}:{}", location.line.unwrap_or(0)),
            }));
        }
    }
    // Rust's own libraries come with line numbers; assembly may come without.
    Ok((!known).then(|| Origin {
        what: function.name.clone(),
        place: format!("{address:#x}"),
    }))
}
