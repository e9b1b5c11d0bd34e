//! The text of values.

use core::fmt::Write as _;

use super::dwarf::{Bits, Debug, Field, Shape, TypeAt, Variant};

/// The depth to which values are shown.
const DEPTH: u32 = 16;
/// The number of elements of an array that are shown.
const ELEMENTS: u64 = 200;
/// The text for a part that is not shown, or not known.
const UNKNOWN: &str = "…";

/// Appends the text of a value of a type.
pub(super) fn write(debug: &Debug<'_>, at: TypeAt, bytes: &[u8], into: &mut String) {
    write_at(debug, at, bytes, into, DEPTH);
}

/// Appends the text of a bit field of a type.
pub(super) fn write_bits(
    debug: &Debug<'_>,
    at: TypeAt,
    bits: Bits,
    bytes: &[u8],
    into: &mut String,
) {
    let is_signed = matches!(
        debug.shape(at),
        Shape::Base {
            encoding: gimli::DW_ATE_signed | gimli::DW_ATE_signed_char
        }
    );
    let size = usize::try_from(debug.size(at)).unwrap_or(0).min(8);
    write(debug, at, &bits.value(bytes, is_signed, size), into);
}

fn write_at(debug: &Debug<'_>, at: TypeAt, bytes: &[u8], into: &mut String, depth: u32) {
    let Some(deeper) = depth.checked_sub(1) else {
        return into.push_str(UNKNOWN);
    };
    let show = |at, offset, into: &mut String| write_part(debug, at, offset, bytes, into, deeper);
    match debug.shape(at) {
        Shape::Base { encoding } => base(encoding, bytes, into),
        Shape::Pointer => {
            // A string never fails.
            let _ = write!(into, "{:#x}", word(bytes));
        }
        Shape::Enumeration(names) => {
            let value = word(bytes);
            let name = names.iter().find(|(it, _)| mask(*it, bytes.len()) == value);
            match name {
                Some((_, name)) => into.push_str(name),
                None => base(gimli::DW_ATE_unsigned, bytes, into),
            }
        }
        Shape::Fields(fields) => {
            if let Some(wrapped) = debug.wrapped(&fields) {
                return show(wrapped.at, wrapped.offset, into);
            }
            into.push('{');
            write_fields(debug, &fields, 0, true, bytes, into, deeper);
            into.push('}');
        }
        Shape::Variants { tag, of } => match present(debug, tag.as_ref(), &of, bytes) {
            Some(variant) => write_variant(debug, variant, bytes, into, deeper),
            None => into.push_str(UNKNOWN),
        },
        Shape::Array { of, count } => {
            let size = debug.size(of);
            into.push('[');
            for place in 0..count.min(ELEMENTS) {
                if place > 0 {
                    into.push_str(", ");
                }
                show(of, place.saturating_mul(size), into);
            }
            if count > ELEMENTS {
                into.push_str(", …");
            }
            into.push(']');
        }
        Shape::Unknown => into.push_str(UNKNOWN),
    }
}

/// The bytes of a part of a type, `offset` bytes from the beginning of all.
fn part<'b>(debug: &Debug<'_>, at: TypeAt, offset: u64, bytes: &'b [u8]) -> Option<&'b [u8]> {
    let begin = usize::try_from(offset).ok()?;
    let end = begin.checked_add(usize::try_from(debug.size(at)).ok()?)?;
    bytes.get(begin..end)
}

fn write_part(
    debug: &Debug<'_>,
    at: TypeAt,
    offset: u64,
    bytes: &[u8],
    into: &mut String,
    depth: u32,
) {
    match part(debug, at, offset, bytes) {
        Some(bytes) => write_at(debug, at, bytes, into, depth),
        None => into.push_str(UNKNOWN),
    }
}

/// Appends those fields that take room, one after the other; the structure begins `from` bytes behind the
/// beginning of all.
fn write_fields(
    debug: &Debug<'_>,
    fields: &[Field],
    from: u64,
    has_names: bool,
    bytes: &[u8],
    into: &mut String,
    depth: u32,
) {
    let shown = fields.iter().filter(|field| debug.size(field.at) > 0);
    for (place, field) in shown.enumerate() {
        if place > 0 {
            into.push_str(", ");
        }
        if has_names {
            let _ = write!(into, "{}: ", field.shown_name());
        }
        let offset = from.saturating_add(field.offset);
        let Some(bits) = field.bits else {
            write_part(debug, field.at, offset, bytes, into, depth);
            continue;
        };
        let rest = usize::try_from(offset).ok().and_then(|at| bytes.get(at..));
        match rest.filter(|rest| rest.len() as u64 >= bits.bytes()) {
            Some(rest) => write_bits(debug, field.at, bits, rest, into),
            None => into.push_str(UNKNOWN),
        }
    }
}

/// The variant that is there: by its tag, or the only one of an enumeration without a tag; `None` if the tag lies
/// outside of what was read, or no variant has it.
fn present<'v>(
    debug: &Debug<'_>,
    tag: Option<&Field>,
    of: &'v [Variant],
    bytes: &[u8],
) -> Option<&'v Variant> {
    let others = of.iter().find(|it| it.tag.is_none());
    let Some(tag) = tag else { return others };
    let value = part(debug, tag.at, tag.offset, bytes)?;
    let is_it = |tag| mask(tag, value.len()) == word(value);
    of.iter().find(|it| it.tag.is_some_and(is_it)).or(others)
}

/// Appends a variant as Rust writes it: `Some(7)`, `Moving {to: 3}`, `None`.
fn write_variant(
    debug: &Debug<'_>,
    variant: &Variant,
    bytes: &[u8],
    into: &mut String,
    depth: u32,
) {
    let field = &variant.field;
    into.push_str(&field.name);
    let Shape::Fields(fields) = debug.shape(field.at) else {
        return;
    };
    if fields.iter().all(|field| debug.size(field.at) == 0) {
        return;
    }
    let has_names = !fields.iter().all(|field| field.name.starts_with("__"));
    let (begin, end) = if has_names { (" {", "}") } else { ("(", ")") };
    into.push_str(begin);
    write_fields(debug, &fields, field.offset, has_names, bytes, into, depth);
    into.push_str(end);
}

/// The first eight bytes, without a sign.
fn word(bytes: &[u8]) -> u64 {
    let bytes = bytes.iter().take(8).rev();
    bytes.fold(0, |word, byte| word << 8 | u64::from(*byte))
}

fn mask(value: u64, bytes: usize) -> u64 {
    match bytes {
        0..8 => value & ((1 << (8 * bytes)) - 1),
        _ => value,
    }
}

fn base(encoding: gimli::DwAte, bytes: &[u8], into: &mut String) {
    let value = word(bytes);
    let unused = 64_u32.saturating_sub(8 * bytes.len() as u32);
    let signed = || value.wrapping_shl(unused).cast_signed() >> unused.min(63);
    // A string never fails.
    let _ = match (encoding, bytes.len()) {
        (gimli::DW_ATE_float, 4) => write!(into, "{}", f32::from_bits(value as u32)),
        (gimli::DW_ATE_float, 8) => write!(into, "{}", f64::from_bits(value)),
        (gimli::DW_ATE_boolean, 1) if value < 2 => write!(into, "{}", value == 1),
        (gimli::DW_ATE_UTF, 4) => match char::from_u32(value as u32) {
            Some(letter) => write!(into, "{letter:?}"),
            None => write!(into, "{value:#x}"),
        },
        (gimli::DW_ATE_signed | gimli::DW_ATE_signed_char, 1..=8) => write!(into, "{}", signed()),
        (_, 0) => Ok(()),
        (_, 1..=8) => write!(into, "{value}"),
        _ => {
            into.push_str("0x");
            let mut digits = bytes.iter().rev();
            digits.try_for_each(|byte| write!(into, "{byte:02x}"))
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(encoding: gimli::DwAte, bytes: &[u8]) -> String {
        let mut text = String::new();
        base(encoding, bytes, &mut text);
        text
    }

    #[test]
    fn base_types_are_shown_as_rust_has_them() {
        assert_eq!(text(gimli::DW_ATE_float, &1.5_f32.to_le_bytes()), "1.5");
        assert_eq!(text(gimli::DW_ATE_float, &(-0.1_f64).to_le_bytes()), "-0.1");
        assert_eq!(text(gimli::DW_ATE_signed, &(-3_i16).to_le_bytes()), "-3");
        assert_eq!(
            text(gimli::DW_ATE_signed, &i64::MIN.to_le_bytes()),
            i64::MIN.to_string()
        );
        assert_eq!(text(gimli::DW_ATE_unsigned, &[255]), "255");
        assert_eq!(text(gimli::DW_ATE_boolean, &[1]), "true");
        assert_eq!(text(gimli::DW_ATE_boolean, &[7]), "7");
        assert_eq!(text(gimli::DW_ATE_UTF, &[65, 0, 0, 0]), "'A'");
        assert_eq!(
            text(gimli::DW_ATE_unsigned, &[1; 16]),
            format!("0x{}", "01".repeat(16))
        );
    }
}
