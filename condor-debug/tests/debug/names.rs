//! Files that are no programs.

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
