//! Variables by name: where they are, and files that are no programs.

use condor_debug::names::{Names, NamesError};
use proptest::prelude::*;

proptest! {
    #[test]
    fn any_file_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..200), elf in any::<bool>()) {
        let magic: &[u8] = if elf { b"\x7fELF\x02\x01\x01" } else { b"" };
        let file = [magic, &bytes].concat();
        prop_assert!(matches!(Names::read(&file), Err(NamesError::NoInformation(_))));
    }
}

/// An object file with the debug information of variables in every kind of place.
const PLACES: &str = r#"
    .section .debug_abbrev,"",%progbits
    .byte 1, 0x11, 1, 0, 0
    .byte 2, 0x24, 0, 0x03, 0x08, 0x0b, 0x0b, 0x3e, 0x0b, 0, 0
    .byte 3, 0x34, 0, 0x03, 0x08, 0x49, 0x13, 0x02, 0x18, 0, 0
    .byte 4, 0x34, 0, 0x03, 0x08, 0x49, 0x13, 0x1c, 0x0b, 0, 0
    .byte 5, 0x34, 0, 0x03, 0x08, 0x49, 0x13, 0, 0
    .byte 6, 0x34, 0, 0x03, 0x08, 0x49, 0x13, 0x3c, 0x19, 0, 0
    .byte 7, 0x34, 0, 0x47, 0x13, 0x02, 0x18, 0, 0
    .byte 8, 0x2e, 1, 0x03, 0x08, 0, 0
    .byte 9, 0x13, 1, 0x0b, 0x0b, 0, 0
    .byte 10, 0x0d, 0, 0x03, 0x08, 0x49, 0x13, 0x0d, 0x0b, 0x6b, 0x0b, 0, 0
    .byte 11, 0x0d, 0, 0x03, 0x08, 0x49, 0x13, 0x38, 0x0b, 0, 0
    .byte 0
    .section .debug_info,"",%progbits
begin:
    .4byte end - . - 4
    .2byte 5
    .byte 1, 8
    .4byte 0
    .byte 1
int:
    .byte 2
    .asciz "int"
    .byte 4, 5
    .macro variable name:req, bytes:vararg
    .byte 3
    .asciz "\name"
    .4byte int - begin
    .byte 9f - . - 1, \bytes
9:
    .endm
    variable plain, 3, 0, 0x10, 0, 0, 0, 0, 0, 0
    variable moved, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0x23, 0x84, 1
    variable whole, 3, 8, 0x10, 0, 0, 0, 0, 0, 0, 0x93, 4
    variable part, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0x93, 2
    variable parts, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0x93, 2, 0x93, 2
    variable computed, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0x94, 1, 0x30, 0x1e, 0x9f
    variable value, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0x9f
    variable damaged, 3, 0, 0x10, 0, 0, 0, 0, 0, 0, 0xff
    variable local_to_thread, 0x0e, 0, 0x10, 0, 0, 0, 0, 0, 0, 0xe0
    variable only_value, 0x32, 0x9f
    .byte 4
    .asciz "constant"
    .4byte int - begin
    .byte 2
    .byte 5
    .asciz "removed"
    .4byte int - begin
declared:
    .byte 6
    .asciz "declared"
    .4byte int - begin
    .byte 6
    .asciz "elsewhere"
    .4byte int - begin
    .byte 7
    .4byte declared - begin
    .byte 9, 3, 0, 0x20, 0, 0, 0, 0, 0, 0
struct:
    .byte 9, 8
    .byte 10
    .asciz "mode"
    .4byte int - begin
    .byte 3, 1
    .byte 11
    .asciz "plain"
    .4byte int - begin
    .byte 4
    .byte 0
one_bit:
    .byte 9, 4
    .byte 10
    .asciz "bit"
    .4byte int - begin
    .byte 1, 2
    .byte 0
    .byte 3
    .asciz "flags"
    .4byte struct - begin
    .byte 9, 3, 0, 0x40, 0, 0, 0, 0, 0, 0
    .byte 3
    .asciz "one"
    .4byte one_bit - begin
    .byte 9, 3, 0, 0x50, 0, 0, 0, 0, 0, 0
    .byte 8
    .asciz "main"
    variable counter, 3, 0, 0x30, 0, 0, 0, 0, 0, 0
    variable plain, 0x91, 0
    .byte 4
    .asciz "moved"
    .4byte int - begin
    .byte 2
    .byte 0
    .byte 0
end:
"#;

fn object_file() -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [source, object] = ["places.s", "places.o"].map(|name| directory.path().join(name));
    std::fs::write(&source, PLACES).unwrap();
    let mut cc = std::process::Command::new("cc");
    let status = cc.arg("-c").arg(&source).arg("-o").arg(&object).status();
    assert!(status.unwrap().success());
    std::fs::read(object).unwrap()
}

#[test]
fn only_a_variable_with_an_address_of_its_own_is_found() {
    let file = object_file();
    let names = Names::read(&file).unwrap();
    let addresses = [
        ("plain", 0x1000),
        ("moved", 0x1084),
        ("whole", 0x1008),
        ("declared", 0x2000),
        ("counter", 0x3000),
        ("main::counter", 0x3000),
    ];
    for (name, address) in addresses {
        let found = names.find(name).map(|value| (value.address, value.bytes));
        assert_eq!(found, Ok((address, 4)), "{name}");
    }
    let others = [
        "part",
        "parts",
        "computed",
        "value",
        "damaged",
        "local_to_thread",
        "only_value",
        "constant",
        "removed",
    ];
    for name in others {
        let found = names.find(name).map(|value| value.address);
        let error = found.expect_err(name).to_string();
        let says = error.starts_with(&format!("`{name}` has no address of its own"));
        assert!(says, "{error}");
    }
    let elsewhere = names.find("elsewhere").map(|value| value.address);
    assert!(matches!(elsewhere, Err(NamesError::NoVariable { .. })));
}

#[test]
fn a_bit_field_is_neither_shown_nor_written_as_a_whole_number() {
    let file = object_file();
    let names = Names::read(&file).unwrap();
    for (name, text) in [("flags.mode", "mode"), ("one.bit", "bit")] {
        let error = names.find(name).map(|value| value.address);
        let error = error.expect_err(text).to_string();
        assert!(
            error.starts_with(&format!("`{name}` is a bit field")),
            "{error}"
        );
    }
    let flags = names.find("flags").unwrap();
    assert_eq!(
        flags.text(&[155, 0, 0, 0, 7, 0, 0, 0]),
        "{mode: …, plain: 7}"
    );
    let one = names.find("one").unwrap();
    assert_eq!(one.text(&[155, 0, 0, 0]), "{bit: …}");
    assert_eq!(one.number(), None);
    assert_eq!(names.find("flags.plain").unwrap().address, 0x4004);
}

proptest! {
    #[test]
    fn damaged_debug_information_is_no_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        static FILE: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(object_file);
        let mut file = FILE.clone();
        for (place, byte) in damage {
            let place = place.index(file.len());
            file[place] = byte;
        }
        if let Ok(names) = Names::read(&file) {
            for name in ["plain", "parts", "declared", "flags", "flags.plain", "main::counter"] {
                if let Ok(value) = names.find(name) {
                    let _ = value.text(&[155; 8]);
                }
            }
        }
    }
}
