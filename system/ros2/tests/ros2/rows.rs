use std::collections::BTreeSet;

use condor_ros2::{DecodeError, Head, Layout, LayoutError, RosField, Time};
use condor_vars::{AnyValue, ValueKind};
use proptest::collection::vec;
use proptest::prelude::*;

const KINDS: [ValueKind; 12] = [
    ValueKind::F32,
    ValueKind::F64,
    ValueKind::I8,
    ValueKind::I16,
    ValueKind::I32,
    ValueKind::I64,
    ValueKind::U8,
    ValueKind::U16,
    ValueKind::U32,
    ValueKind::U64,
    ValueKind::Bool,
    ValueKind::Choice,
];

fn field(name: &str, kind: ValueKind) -> RosField {
    RosField {
        name: name.into(),
        kind,
        unit: String::new(),
        about: String::new(),
        labels: Vec::new(),
    }
}

#[test]
fn a_schema_that_no_layout_writes_is_an_error() {
    let head = Layout::new([]).schema();
    let (head, types) = head.split_once("====").unwrap();
    let of = |fields: &str| Layout::of_schema(&format!("{head}{fields}===={types}"));
    let (a, b) = ("uint32 A=0 # a\n", "uint32 B=1 # b\n");
    let choice = "uint32 x # x\t\t\n";
    assert!(of(&format!("{a}{b}{choice}")).is_ok());
    for fields in [
        format!("{a}float64 x # x\t\t\n"),
        format!("{b}{choice}"),
        format!("{a}{a}{choice}"),
        format!("uint8 A=0 # a\n{choice}"),
        a.to_owned(),
    ] {
        assert!(of(&fields).is_err(), "{fields}");
    }
    for text in ["", "====", &head[..head.find('\n').unwrap()]] {
        assert!(Layout::of_schema(text).is_err(), "{text}");
    }
}

#[test]
fn the_schema_names_types_variables_and_labels() {
    let mode = RosField {
        unit: "µ#".into(),
        about: "what it does".into(),
        labels: vec!["idle".into(), "hold on".into()],
        ..field("hand.mode", ValueKind::Choice)
    };
    let layout = Layout::new([
        mode,
        field("hand-mode", ValueKind::I8),
        field("tick", ValueKind::F64),
    ]);
    let expected = "\
builtin_interfaces/Time stamp # when the tick was released
uint64 tick # the number of the tick
uint64 lost # rows that were lost before this one
uint32 HAND_MODE_IDLE=0 # idle
uint32 HAND_MODE_HOLD_ON=1 # hold on
uint32 hand_mode # hand.mode\tµ#\twhat it does
int8 hand_mode_2 # hand-mode\t\t
float64 tick_2 # tick\t\t
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";
    assert_eq!(layout.schema(), expected);
}

#[test]
fn fields_are_aligned_to_their_sizes() {
    let layout = Layout::new([
        field("a", ValueKind::Bool),
        field("b", ValueKind::U64),
        field("c", ValueKind::I8),
        field("d", ValueKind::U16),
        field("e", ValueKind::F32),
    ]);
    let head = Head {
        stamp: Time { sec: 1, nanosec: 2 },
        tick: 3,
        lost: 4,
    };
    let words = [2, 5, 6, (-1_i32).cast_unsigned(), 0x0102, 1.5_f32.to_bits()];
    let bytes = layout.encode(&head, &words).unwrap();
    let expected: [&[u8]; 7] = [
        &[0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0],
        &[3, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0],
        // True is 1, whatever the word.
        &[1, 0, 0, 0, 0, 0, 0, 0],
        &[5, 0, 0, 0, 6, 0, 0, 0],
        &[0xff, 0],
        &[2, 1],
        &1.5_f32.to_le_bytes(),
    ];
    assert_eq!(bytes, expected.concat());
}

#[test]
fn what_does_not_fit_is_refused() {
    let layout = Layout::new([field("a", ValueKind::F64)]);
    let head = Head::default();
    for (words, found) in [(vec![1], 1), (vec![1, 2, 3], 3)] {
        let error = LayoutError::Words { found, expected: 2 };
        assert_eq!(layout.encode(&head, &words), Err(error));
    }
    let message = layout.encode(&head, &[0, 0]).unwrap();
    let error = layout.decode(&message[..message.len() - 1]).err();
    let (found, needed) = (message.len() - 1, message.len());
    assert_eq!(error, Some(DecodeError::Short { found, needed }));
    let big_endian = [0, 0, 0, 0, 1];
    let error = layout.decode(&big_endian).err().unwrap();
    let found = big_endian[..4].to_vec();
    assert_eq!(error, DecodeError::Header { found });
}

#[test]
fn a_schema_of_something_else_is_refused() {
    let text = "string name\n";
    let error = Layout::of_schema(text).unwrap_err();
    let text = "string name".into();
    assert_eq!(error, LayoutError::Schema { line: 1, text });
    let schema = Layout::new([field("a", ValueKind::F64)]).schema();
    let other = schema.replace("float64 a", "string a");
    let error = Layout::of_schema(&other).unwrap_err();
    let text = "string a # a\t\t".into();
    assert_eq!(error, LayoutError::Schema { line: 4, text });
}

fn fields() -> impl Strategy<Value = Vec<RosField>> {
    let text = || "[^\\p{Cc}]{0,12}";
    let field = (text(), 0..KINDS.len(), text(), text(), vec(text(), 1..4));
    let field = field.prop_map(|(name, kind, unit, about, labels)| RosField {
        name,
        kind: KINDS[kind],
        unit,
        about,
        labels: if KINDS[kind] == ValueKind::Choice {
            labels
        } else {
            Vec::new()
        },
    });
    vec(field, 0..20)
}

fn rows() -> impl Strategy<Value = (Vec<RosField>, Vec<u32>)> {
    fields().prop_flat_map(|fields| {
        let words = fields.iter().map(|field| field.kind.words()).sum::<usize>();
        (Just(fields), vec(any::<u32>(), words))
    })
}

fn bits(value: AnyValue) -> u64 {
    match value {
        AnyValue::F32(value) => value.to_bits().into(),
        AnyValue::F64(value) => value.to_bits(),
        AnyValue::Int(value) => value.cast_unsigned(),
        AnyValue::Uint(value) => value,
        AnyValue::Bool(value) => value.into(),
        AnyValue::Choice(value) => value.into(),
    }
}

proptest! {
    #[test]
    fn rows_are_read_by_their_schema_alone((fields, words) in rows(), tick: u64, lost: u64) {
        let layout = Layout::new(fields.clone());
        let head = Head { stamp: Time { sec: 9, nanosec: 1 }, tick, lost };
        let message = layout.encode(&head, &words).unwrap();
        let read = Layout::of_schema(&layout.schema()).unwrap();
        prop_assert_eq!(&read, &layout);
        let row = read.decode(&message).unwrap();
        prop_assert_eq!(row.head(), head);
        let mut rest = words.as_slice();
        for (column, field) in fields.iter().enumerate() {
            let (value, others) = field.kind.split(rest).unwrap();
            prop_assert_eq!(row.value(column).map(bits), Some(bits(value)));
            rest = others;
        }
        prop_assert_eq!(row.value(fields.len()), None);
    }

    #[test]
    fn names_of_fields_are_legal_and_unique(fields in fields()) {
        let layout = Layout::new(fields);
        let names: BTreeSet<_> = layout.fields().map(|(_, name)| name).collect();
        prop_assert_eq!(names.len(), layout.fields().len());
        for name in names {
            let is_plain = |it: char| it.is_ascii_lowercase() || it.is_ascii_digit() || it == '_';
            prop_assert!(name.chars().all(is_plain), "{}", name);
            prop_assert!(name.starts_with(|it: char| it.is_ascii_lowercase()), "{}", name);
            prop_assert!(!name.contains("__") && !name.ends_with('_'), "{}", name);
        }
    }

    #[test]
    fn any_text_is_a_layout_or_an_error(text in ".*", lines in vec(".*", 0..5)) {
        let _ = Layout::of_schema(&text);
        let schema = Layout::new([]).schema();
        let head = schema.lines().take(3).map(str::to_owned);
        let text: Vec<_> = head.chain(lines).collect();
        let _ = Layout::of_schema(&text.join("\n"));
    }
}
