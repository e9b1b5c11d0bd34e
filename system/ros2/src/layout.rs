//! [`Layout`]: the message of a row of variables, whose fields are known at run time.

use std::collections::HashSet;

use condor_vars::{AnyValue, ValueKind};

use crate::cdr::{CdrWriter, DecodeError, Reader, short};
use crate::messages::{TIME, Time};
use crate::names::{constant_name, field_name};
use crate::schema::{RosMessage, joined};

/// The fields at the beginning of each row.
const HEAD: &str = "\
builtin_interfaces/Time stamp # when the tick was released
uint64 tick # the number of the tick
uint64 lost # rows that were lost before this one
";
/// The names in it.
const RESERVED: [&str; 3] = ["stamp", "tick", "lost"];
/// Its size in bytes.
const HEAD_BYTES: usize = 24;

/// A variable that is a field of the messages of a [`Layout`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RosField {
    /// The name of the variable.
    pub name: String,
    /// The type of its values.
    pub kind: ValueKind,
    /// The unit of the variable; may be empty.
    pub unit: String,
    /// The description of the variable; may be empty.
    pub about: String,
    /// The labels of the values of a [`ValueKind::Choice`], from 0; empty for other kinds.
    pub labels: Vec<String>,
}

/// The type of the messages that carry the rows of one loop or cell: one message for each row. A
/// row has the values of some variables at one tick of the loop.
///
/// All fields have fixed places, so a single value can be read without the others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    fields: Vec<RosField>,
    /// The legal name of each field.
    names: Vec<String>,
    /// The offset of each field behind the header of a message, in bytes.
    places: Vec<usize>,
    /// The size of a message without its header, in bytes.
    bytes: usize,
}

/// The part of a row before its values: the time and number of its tick, and the number of rows
/// lost before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// The time at which the tick was released.
    pub stamp: Time,
    /// The number of the tick.
    pub tick: u64,
    /// The number of rows that were lost between the row before and this one.
    pub lost: u64,
}

/// The message of a row, in which [`Layout::decode`] has found room for all fields.
/// [`value`](Self::value) reads a single field.
#[derive(Clone, Copy, Debug)]
pub struct RowMessage<'m> {
    layout: &'m Layout,
    head: Head,
    body: &'m [u8],
}

/// The reason why a schema is not that of a [`Layout`], or why a row does not fit one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// A line of a schema is not one that a layout has.
    #[error(
        "line {line} of the schema is not one that `Layout::schema` writes, such as `float64 NAME # VARIABLE`, with tabs \
         before the unit and the description: `{text}`"
    )]
    Schema {
        /// The number of the line, from 1.
        line: usize,
        /// The line.
        text: String,
    },
    /// A row has more or fewer words than its fields need.
    #[error(
        "the row has {found} words of 32 bits, but the fields of its layout need {expected}; pass exactly those"
    )]
    Words {
        /// The number of words of the row.
        found: usize,
        /// The number of words of all fields.
        expected: usize,
    },
}

impl Layout {
    /// Makes the layout of rows with the fields `fields`, in this order. In names, units, descriptions and labels,
    /// control characters become spaces.
    #[must_use]
    pub fn new(fields: impl IntoIterator<Item = RosField>) -> Self {
        let mut taken: HashSet<String> = RESERVED.map(str::to_owned).into();
        let mut layout = Self {
            fields: Vec::new(),
            names: Vec::new(),
            places: Vec::new(),
            bytes: HEAD_BYTES,
        };
        for field in fields {
            let name = field_name(&field.name, |name| taken.contains(name));
            taken.insert(name.clone());
            layout.push(field, name);
        }
        layout
    }

    fn push(&mut self, mut field: RosField, name: String) {
        for text in [&mut field.name, &mut field.unit, &mut field.about] {
            *text = printable(text);
        }
        for label in &mut field.labels {
            *label = printable(label);
        }
        let size = field.kind.bytes();
        let place = self.bytes.next_multiple_of(size);
        self.bytes = place + size;
        self.places.push(place);
        self.names.push(name);
        self.fields.push(field);
    }

    /// Reads the layout from `text`, a schema that [`schema`](Self::schema) has written. A [`ValueKind::Choice`]
    /// without labels becomes a [`ValueKind::U32`]: the schema does not tell them apart.
    ///
    /// # Errors
    /// [`LayoutError::Schema`] if a line has another form, or if a line is missing.
    pub fn of_schema(text: &str) -> Result<Self, LayoutError> {
        let mut layout = Self::new([]);
        let mut labels = Vec::new();
        let mut heads = HEAD.lines();
        let mut end = 1;
        for (line, text) in (1..).zip(text.lines()) {
            if text.starts_with("====") {
                break;
            }
            end = line + 1;
            let wrong = || LayoutError::Schema {
                line,
                text: text.to_owned(),
            };
            if let Some(head) = heads.next() {
                if head != text {
                    return Err(wrong());
                }
                continue;
            }
            let (definition, comment) = text.split_once(" # ").ok_or_else(wrong)?;
            let (of_type, name) = definition.split_once(' ').ok_or_else(wrong)?;
            if let Some((_, number)) = name.split_once('=') {
                if of_type != "uint32" || number != labels.len().to_string() {
                    return Err(wrong());
                }
                labels.push(comment.to_owned());
                continue;
            }
            let mut texts = comment.split('\t').map(str::to_owned);
            let mut kind = kind_of(of_type).ok_or_else(wrong)?;
            if !labels.is_empty() {
                if kind != ValueKind::U32 {
                    return Err(wrong());
                }
                kind = ValueKind::Choice;
            }
            let field = RosField {
                name: texts.next().ok_or_else(wrong)?,
                kind,
                unit: texts.next().ok_or_else(wrong)?,
                about: texts.next().ok_or_else(wrong)?,
                labels: core::mem::take(&mut labels),
            };
            layout.push(field, name.to_owned());
        }
        if heads.next().is_some() || !labels.is_empty() {
            let text = text.lines().nth(end - 1).unwrap_or_default().to_owned();
            return Err(LayoutError::Schema { line: end, text });
        }
        Ok(layout)
    }

    /// Returns the schema of the messages, as a text in the format `ros2msg`.
    ///
    /// Each field has the name, unit and description of its variable in a comment, with tabs between them. The labels
    /// of a choice are constants before the field, each with the label in a comment.
    #[must_use]
    pub fn schema(&self) -> String {
        let mut text = HEAD.to_owned();
        let mut taken = HashSet::new();
        for (field, name) in self.fields() {
            for (number, label) in field.labels.iter().enumerate() {
                let constant = constant_name(name, label, |name| taken.contains(name));
                let line = format!("uint32 {constant}={number} # {label}\n");
                text.push_str(&line);
                taken.insert(constant);
            }
            let RosField {
                name: of,
                unit,
                about,
                ..
            } = field;
            let of_type = ros_type(field.kind);
            let line = format!("{of_type} {name} # {of}\t{unit}\t{about}\n");
            text.push_str(&line);
        }
        joined(&text, &[TIME])
    }

    /// Iterates over the fields in their order, each with the name that it has in the schema.
    pub fn fields(&self) -> impl ExactSizeIterator<Item = (&RosField, &str)> {
        self.fields
            .iter()
            .zip(self.names.iter().map(String::as_str))
    }

    /// Returns the bytes of the message of a row. `head` is the part of the row before the values. `words` are the
    /// values in the order of the fields, each as [`ValueKind`] stores it in one or two 32-bit words.
    ///
    /// # Errors
    /// [`LayoutError::Words`] if `words` has another length than the fields need.
    pub fn encode(&self, head: &Head, words: &[u32]) -> Result<Vec<u8>, LayoutError> {
        let mut to = CdrWriter::new();
        head.stamp.write(&mut to);
        to.number(head.tick.to_le_bytes());
        to.number(head.lost.to_le_bytes());
        let mut rest = words;
        for field in &self.fields {
            rest = match (rest, field.kind.bytes()) {
                ([low, rest @ ..], 1) => {
                    // Each value that is not false is true, and CDR has only one value for that.
                    let is_true = u32::from(*low != 0);
                    let low = if field.kind == ValueKind::Bool {
                        is_true
                    } else {
                        *low
                    };
                    to.number([low as u8]);
                    rest
                }
                ([low, rest @ ..], 2) => {
                    to.number((*low as u16).to_le_bytes());
                    rest
                }
                ([low, rest @ ..], 4) => {
                    to.u32(*low);
                    rest
                }
                ([low, high, rest @ ..], 8) => {
                    let long = u64::from(*high) << 32 | u64::from(*low);
                    to.number(long.to_le_bytes());
                    rest
                }
                _ => return Err(self.words_error(words)),
            };
        }
        if rest.is_empty() {
            Ok(to.finish())
        } else {
            Err(self.words_error(words))
        }
    }

    fn words_error(&self, words: &[u32]) -> LayoutError {
        LayoutError::Words {
            found: words.len(),
            expected: self.fields.iter().map(|field| field.kind.words()).sum(),
        }
    }

    /// Reads the bytes `message` as the message of a row.
    ///
    /// # Errors
    /// [`DecodeError::Header`] if `message` is not little-endian CDR, [`DecodeError::Short`] if it is too short for all
    /// fields.
    pub fn decode<'m>(&'m self, message: &'m [u8]) -> Result<RowMessage<'m>, DecodeError> {
        let mut from = Reader::new(message)?;
        let head = Head {
            stamp: Time::read(&mut from)?,
            tick: u64::from_le_bytes(from.number()?),
            lost: u64::from_le_bytes(from.number()?),
        };
        let body = from.body();
        if body.len() < self.bytes {
            return Err(short(body, self.bytes));
        }
        Ok(RowMessage {
            layout: self,
            head,
            body,
        })
    }
}

impl RowMessage<'_> {
    /// Returns the part of the row before its values: the time and number of its tick, and the
    /// number of rows lost before it.
    #[must_use]
    pub const fn head(&self) -> Head {
        self.head
    }

    /// Returns the value of the field `column`, counted from 0; `None` if there is no such field.
    #[must_use]
    pub fn value(&self, column: usize) -> Option<AnyValue> {
        let place = *self.layout.places.get(column)?;
        let kind = self.layout.fields.get(column)?.kind;
        kind.value_of_bytes(self.body.get(place..)?)
    }
}

/// The types of ROS, without that of choices, which are `uint32`.
const TYPES: [(&str, ValueKind); 11] = [
    ("float32", ValueKind::F32),
    ("float64", ValueKind::F64),
    ("int8", ValueKind::I8),
    ("int16", ValueKind::I16),
    ("int32", ValueKind::I32),
    ("int64", ValueKind::I64),
    ("uint8", ValueKind::U8),
    ("uint16", ValueKind::U16),
    ("uint32", ValueKind::U32),
    ("uint64", ValueKind::U64),
    ("bool", ValueKind::Bool),
];

fn ros_type(kind: ValueKind) -> &'static str {
    let found = TYPES.iter().find(|(_, other)| *other == kind);
    found.map_or("uint32", |(name, _)| name)
}

fn kind_of(name: &str) -> Option<ValueKind> {
    let found = TYPES.iter().find(|(other, _)| *other == name)?;
    Some(found.1)
}

fn printable(text: &str) -> String {
    text.replace(char::is_control, " ")
}
