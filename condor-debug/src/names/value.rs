//! The text of values.

use core::fmt::Write as _;

use super::dwarf::{Bits, Debug, Field, Shape, TypeAt, Variant};

/// How deep values are shown.
const DEPTH: u32 = 16;
/// How many elements of an array are shown.
const ELEMENTS: u64 = 200;
/// What is not shown, or not known.
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
    let part = |at: TypeAt, offset: u64| {
        let begin = usize::try_from(offset).ok()?;
        let end = begin.checked_add(usize::try_from(debug.size(at)).ok()?)?;
        bytes.get(begin..end)
    };
    let show = |at, offset, into: &mut String| match part(at, offset) {
        Some(bytes) => write_at(debug, at, bytes, into, deeper),
        None => into.push_str(UNKNOWN),
    };
    let has_size = |field: &&Field| debug.size(field.at) > 0;
    let show_field = |field: &Field, into: &mut String| match field.bits {
        Some(bits) => {
            let bytes = usize::try_from(field.offset)
                .ok()
                .and_then(|at| bytes.get(at..));
            match bytes.filter(|rest| rest.len() as u64 >= bits.bytes()) {
                Some(bytes) => write_bits(debug, field.at, bits, bytes, into),
                None => into.push_str(UNKNOWN),
            }
        }
        None => show(field.at, field.offset, into),
    };
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
            for (place, field) in fields.iter().filter(|it| has_size(it)).enumerate() {
                let comma = if place > 0 { ", " } else { "" };
                let _ = write!(into, "{comma}{}: ", field.shown_name());
                show_field(field, into);
            }
            into.push('}');
        }
        Shape::Variants { tag, of } => {
            let value = tag.as_ref().and_then(|tag| part(tag.at, tag.offset));
            let is_it = |it: &&Variant| match (it.tag, value) {
                (Some(tag), Some(value)) => mask(tag, value.len()) == word(value),
                _ => false,
            };
            let has_no_tag = |it: &&Variant| it.tag.is_none() && (tag.is_none() || value.is_some());
            let variant = of.iter().find(is_it);
            let Some(variant) = variant.or_else(|| of.iter().find(has_no_tag)) else {
                return into.push_str(UNKNOWN);
            };
            into.push_str(&variant.field.name);
            let Shape::Fields(fields) = debug.shape(variant.field.at) else {
                return;
            };
            // As Rust writes it: `Some(7)`, `Moving {to: 3}`, `None`.
            let is_tuple = fields.iter().all(|field| field.name.starts_with("__"));
            let (begin, end) = if is_tuple { ("(", ")") } else { (" {", "}") };
            let mut shown = fields.iter().filter(|it| has_size(it)).peekable();
            if shown.peek().is_none() {
                return;
            }
            into.push_str(begin);
            for (place, field) in shown.enumerate() {
                let comma = if place > 0 { ", " } else { "" };
                into.push_str(comma);
                if !is_tuple {
                    let _ = write!(into, "{}: ", field.name);
                }
                show(
                    field.at,
                    variant.field.offset.saturating_add(field.offset),
                    into,
                );
            }
            into.push_str(end);
        }
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
