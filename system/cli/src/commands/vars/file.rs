//! Files of parameters: TOML with a table for each loop, and a key for each parameter.

use core::ops::Range;
use std::fmt::Write as _;
use std::io::Read as _;
use std::path::Path;

use condor_host::error::{AnyError, NamedFileError};
use condor_host::plain::plain;
use condor_host::watching::{CatalogEntry, VariableCatalog};
use condor_platform::linux::open_regular;
use condor_toml::SourceText;
use condor_vars::AnyValue;
use serde::de::{Deserialize, Deserializer, Error, Visitor};

use super::choices;

/// The greatest size of a file, bytes: a hundred times that of a hand.
const MOST_BYTES: u64 = 4 << 20;

/// A parameter of a file: the entry of the catalog, the value that the file says, and the line of the file.
pub(super) struct FileParameter<'c> {
    pub(super) one: &'c CatalogEntry,
    pub(super) value: AnyValue,
    pub(super) line: usize,
}

/// Returns the text of a file with these parameters.
pub(super) fn text<'c>(
    system: &str,
    parameters: impl Iterator<Item = (&'c CatalogEntry, AnyValue)>,
) -> String {
    let mut text = format!(
        "# Parameters of the system `{}`, written by `vars save`; `vars load` sets them.\n",
        plain(system)
    );
    let mut last = String::new();
    for (one, value) in parameters {
        let place = one.place();
        if place != last {
            // A string takes all that is written.
            let _ = write!(text, "\n[{}]\n", quoted(&place));
            last = place;
        }
        let value = match value {
            AnyValue::Choice(_) => quoted(&one.of.text(value)),
            _ => one.of.text(value),
        };
        let unit = match one.entry.unit.as_str() {
            "" => String::new(),
            unit => format!(" # {}", plain(unit)),
        };
        let _ = writeln!(text, "{} = {value}{unit}", quoted(&one.name));
    }
    text
}

/// A text as a string of TOML. Programs have chosen it.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            control if control.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(control));
            }
            letter => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}

/// Reads a file of parameters, and finds each in the catalog.
///
/// # Errors
/// Returns an error if the file cannot be read, or with a line for each parameter that the system does not have, or that
/// cannot have its value.
pub(super) fn read<'c>(
    path: &Path,
    known: &'c VariableCatalog,
) -> Result<Vec<FileParameter<'c>>, AnyError> {
    let file = open_regular(path).map_err(NamedFileError::at("open", path))?;
    let mut content = String::new();
    let read = file.take(MOST_BYTES + 1).read_to_string(&mut content);
    read.map_err(NamedFileError::at("read", path))?;
    if content.len() as u64 > MOST_BYTES {
        let path = path.display();
        return Err(format!(
            "{path} has more than {MOST_BYTES} bytes; a file of parameters is smaller"
        )
        .into());
    }
    let name = path.to_string_lossy();
    Ok(parse(&name, &content, known)?)
}

fn parse<'c>(
    name: &str,
    content: &str,
    known: &'c VariableCatalog,
) -> Result<Vec<FileParameter<'c>>, condor_toml::TextErrors> {
    let text = SourceText::new(name, content);
    let tree = text.parse()?;
    let mut parameters = Vec::new();
    for (place, table) in tree.get_ref().as_table().into_iter().flatten() {
        let Some(entries) = table.get_ref().as_table() else {
            let wrong = "a table is missing here, such as [\"servo-a:servo\"], with the parameters of that loop";
            text.wrong(&place.span(), wrong);
            continue;
        };
        for (key, value) in entries {
            let found = find(known, place.get_ref(), key.get_ref());
            let read = condor_toml::read::<Text>(value);
            let (one, read) = match (found, read) {
                (Ok(one), Ok(read)) => (one, read),
                (Err(error), _) => {
                    text.wrong(&key.span(), error);
                    continue;
                }
                (_, Err(error)) => {
                    let span: Range<usize> = value.span();
                    text.wrong(&span, format_args!("`{}`: {error}", key.get_ref()));
                    continue;
                }
            };
            match value_of(one, &read.0) {
                Ok(new) => parameters.push(FileParameter {
                    one,
                    value: new,
                    line: text.line(key.span().start),
                }),
                Err(error) => text.wrong(&value.span(), error),
            }
        }
    }
    parameters.sort_by_key(|parameter| parameter.line);
    text.finish(Some(parameters))
}

/// Finds the parameter `name` of a loop.
fn find<'c>(
    known: &'c VariableCatalog,
    place: &str,
    name: &str,
) -> Result<&'c CatalogEntry, String> {
    let mut of_place = known
        .all
        .iter()
        .filter(|one| one.place() == place)
        .peekable();
    if of_place.peek().is_none() {
        return Err(format!(
            "`{place}` is not a loop of the system with variables; write PROCESSOR:LOOP, as `vars list` shows them"
        ));
    }
    match of_place.find(|one| one.name == name && one.can_be_set()) {
        Some(one) => Ok(one),
        None => known.parameter(&format!("{place}:{name}")),
    }
}

/// Reads a value of a parameter, and checks its bounds.
fn value_of(one: &CatalogEntry, text: &str) -> Result<AnyValue, String> {
    let (name, unit) = (&one.name, &one.entry.unit);
    let value = one.of.parse(text);
    let value =
        value.map_err(|error| format!("`{name}`: {error}; it can be set to {}", choices(one)))?;
    if let Some([least, greatest]) = one.entry.bounds
        && !(least..=greatest).contains(&value)
    {
        let allowed = format!("{} {unit}", choices(one));
        return Err(format!(
            "`{name}` cannot be {text}; it can be {}",
            allowed.trim_end()
        ));
    }
    Ok(value)
}

/// A number, a boolean or a string of a file, as the text that [`Type::parse`](condor_host::watching::Type::parse)
/// reads.
struct Text(String);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_any(OfAnyType)
    }
}

struct OfAnyType;

impl Visitor<'_> for OfAnyType {
    type Value = Text;

    fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a number, true, false or a label")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Text, E> {
        Ok(Text(value.to_string()))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Text, E> {
        Ok(Text(value.to_string()))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Text, E> {
        Ok(Text(value.to_string()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Text, E> {
        Ok(Text(format!("{value:?}")))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Text, E> {
        Ok(Text(value.to_owned()))
    }
}
