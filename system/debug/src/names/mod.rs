//! Variables by their names in the debug information of a program, to be read while it runs.
//!
//! [`Names::find`] takes an expression such as `SERVO.joints[2].gain` or `servo::SERVO.0`: the path of a
//! static variable, or its last segments, then fields and indices.

mod dwarf;
mod expression;
mod number;
mod value;

pub use number::Number;

use dwarf::{Bits, Debug, Shape, TypeAt, VariableLocation};
use expression::{Expression, Step};

/// The greatest number of bytes of a value.
const MOST_BYTES: u64 = 1 << 16;

/// The reason why the debug information of a program cannot be read, or why a value is not found in
/// it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NamesError {
    /// The file has no debug information, or a damaged one.
    #[error("the program has no usable debug information: {0}")]
    NoInformation(String),
    /// The expression cannot be read.
    #[error("`{expression}` is not an expression such as `SERVO.joints[2].gain`")]
    Expression {
        /// The text that was given as the expression.
        expression: String,
    },
    /// No static variable has this name.
    #[error(
        "there is no static variable `{name}` in the program's debug information; if the program uses one, build it with \
         `debug = 2`"
    )]
    NoVariable {
        /// The name in the expression.
        name: String,
    },
    /// The compiler has merged, split or changed the variable, so that its bytes are at no one address.
    #[error(
        "`{name}` has no address of its own: the compiler {reason}; build the program with a lower `opt-level`"
    )]
    NoAddress {
        /// The name in the expression.
        name: String,
        /// The change that the compiler makes to the variable.
        reason: &'static str,
    },
    /// Several static variables have this name.
    #[error("several variables have the name `{name}`; write one of {}", .there.join(", "))]
    Several {
        /// The name in the expression.
        name: String,
        /// The whole paths of all variables with this name.
        there: Vec<String>,
    },
    /// The value before the step has no such part.
    #[error("`{before}` has no part `{step}`{}", NameParts(there))]
    NoPart {
        /// The expression before the step.
        before: String,
        /// The part that was asked for, such as `.gain` or `[2]`.
        step: String,
        /// The parts that the value has.
        there: Vec<String>,
    },
    /// The value is too large.
    #[error("`{expression}` has {bytes} bytes; name a part of at most {MOST_BYTES}")]
    TooLarge {
        /// The text that was given as the expression.
        expression: String,
        /// The size of the value.
        bytes: u64,
    },
}

struct NameParts<'p>(&'p [String]);

impl core::fmt::Display for NameParts<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if self.0.is_empty() {
            return Ok(());
        }
        write!(f, "; it has {}", self.0.join(", "))
    }
}

/// Returns the address at which a program begins, as its file counts addresses. A loader that places the program
/// elsewhere moves all addresses by the same distance. `file` has all bytes of the program's ELF file.
///
/// # Errors
/// [`NamesError::NoInformation`] if the file is not an ELF file, or is damaged.
pub fn entry(file: &[u8]) -> Result<u64, NamesError> {
    dwarf::entry(file).map_err(NamesError::NoInformation)
}

/// The debug information of a program, in which [`find`](Self::find) looks up static variables by
/// their names.
#[derive(Debug)]
pub struct Names<'f> {
    debug: Debug<'f>,
}

/// A value in the memory of a program, such as a static variable or a field of one. [`Names::find`]
/// returns it.
#[derive(Debug)]
pub struct NamedValue<'n, 'f> {
    names: &'n Names<'f>,
    at: TypeAt,
    /// For a bit field, its bits in the bytes at `address`; `None` for other values.
    bits: Option<Bits>,
    /// The address of the value in the program's file.
    pub address: u64,
    /// The size of the value in bytes; for a bit field, the size of the bytes that contain its
    /// bits.
    pub bytes: usize,
}

impl<'f> Names<'f> {
    /// Reads the debug information of a program. `file` has all bytes of the program's ELF file.
    ///
    /// # Errors
    /// [`NamesError::NoInformation`] if the file has no debug information, or if it is damaged.
    pub fn read(file: &'f [u8]) -> Result<Self, NamesError> {
        let debug = Debug::read(file).map_err(NamesError::NoInformation)?;
        Ok(Self { debug })
    }

    /// Finds the value that the expression `text` names, such as `SERVO.joints[2].gain`. An
    /// expression begins with the path of a static variable, or with the last segments of that
    /// path; fields and indices may follow.
    ///
    /// # Errors
    /// [`NamesError::Expression`] if the text cannot be read; [`NamesError::NoVariable`] or
    /// [`NamesError::Several`] if no variable, or more than one, has the name; [`NamesError::NoAddress`] if
    /// the compiler left the variable no address; [`NamesError::NoPart`] if a value has no part that the
    /// expression names; [`NamesError::TooLarge`] if the value is too large; [`NamesError::NoInformation`]
    /// if the debug information is damaged.
    pub fn find(&self, text: &str) -> Result<NamedValue<'_, 'f>, NamesError> {
        let expression = Expression::parse(text).ok_or_else(|| NamesError::Expression {
            expression: text.into(),
        })?;
        let (mut at, mut address) = self.variable(&expression.path)?;
        let mut bits = None;
        let mut before = expression.path.clone();
        for step in &expression.steps {
            (at, address, bits) = self.step(at, address, step, &before)?;
            before += &step.to_string();
        }
        let bytes = bits.map_or_else(|| self.debug.size(at), Bits::bytes);
        if bytes > MOST_BYTES {
            let expression = text.into();
            return Err(NamesError::TooLarge { expression, bytes });
        }
        Ok(NamedValue {
            names: self,
            at,
            bits,
            address,
            bytes: bytes as usize,
        })
    }

    fn variable(&self, name: &str) -> Result<(TypeAt, u64), NamesError> {
        let found = self
            .debug
            .variables(name)
            .map_err(NamesError::NoInformation)?;
        match &*found {
            [] => Err(NamesError::NoVariable { name: name.into() }),
            [(_, at, VariableLocation::Address(address))] => Ok((*at, *address)),
            [(.., VariableLocation::None(reason))] => Err(NamesError::NoAddress {
                name: name.into(),
                reason,
            }),
            several => Err(NamesError::Several {
                name: name.into(),
                there: several.iter().map(|(path, ..)| path.clone()).collect(),
            }),
        }
    }

    /// A part of a value. What wraps another value, such as an atomic or a cell, has the parts of that
    /// value, too.
    fn step(
        &self,
        mut at: TypeAt,
        mut address: u64,
        step: &Step,
        before: &str,
    ) -> Result<(TypeAt, u64, Option<Bits>), NamesError> {
        loop {
            let shape = self.debug.shape(at);
            let part = match (&shape, step) {
                (Shape::Fields(fields), Step::Field(name)) => {
                    let field = fields.iter().find(|field| field.has_name(name));
                    field.map(|field| (field.at, field.offset, field.bits))
                }
                (Shape::Array { of, count }, Step::Index(index)) if index < count => {
                    let offset = self.debug.size(*of).checked_mul(*index);
                    offset.map(|offset| (*of, offset, None))
                }
                _ => None,
            };
            let part = part.map(|(at, offset, bits)| (at, address.wrapping_add(offset), bits));
            if let Some(part) = part {
                return Ok(part);
            }
            if let Shape::Fields(fields) = &shape
                && let Some(wrapped) = self.debug.wrapped(fields)
            {
                (at, address) = (wrapped.at, address.wrapping_add(wrapped.offset));
                continue;
            }
            let there = match shape {
                Shape::Fields(fields) => fields.into_iter().map(|field| field.name).collect(),
                Shape::Array { count, .. } => vec![format!("indices below {count}")],
                _ => Vec::new(),
            };
            return Err(NamesError::NoPart {
                before: before.into(),
                step: step.to_string(),
                there,
            });
        }
    }
}

impl NamedValue<'_, '_> {
    /// Returns the value as a text for people. `bytes` are the bytes that the memory of the program
    /// has at the address of the value.
    #[must_use]
    pub fn text(&self, bytes: &[u8]) -> String {
        let mut text = String::new();
        match self.bits {
            Some(bits) => value::write_bits(&self.names.debug, self.at, bits, bytes, &mut text),
            None => value::write(&self.names.debug, self.at, bytes, &mut text),
        }
        text
    }
}
