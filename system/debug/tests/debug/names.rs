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
    .byte 12, 0x11, 1, 0x03, 0x08, 0, 0
    .byte 13, 0x34, 0, 0x47, 0x10, 0x02, 0x18, 0, 0
    .byte 14, 0x39, 1, 0x03, 0x08, 0, 0
    .byte 15, 0x34, 0, 0x03, 0x08, 0x49, 0x10, 0x02, 0x18, 0, 0
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
    .byte 14
    .asciz "space"
distant:
    .byte 6
    .asciz "distant"
    .4byte int - begin
    .byte 0
    .byte 15
    .asciz "twin"
    .4byte int - begin
    .byte 9, 3, 0, 0x60, 0, 0, 0, 0, 0, 0
    .byte 0
end:
second:
    .4byte last - . - 4
    .2byte 5
    .byte 1, 8
    .4byte 0
    .byte 12
    .asciz "second.c"
    .byte 13
    .4byte distant - begin
    .byte 9, 3, 0, 0x70, 0, 0, 0, 0, 0, 0
    .byte 15
    .asciz "twin"
    .4byte int - begin
    .byte 9, 3, 0, 0x80, 0, 0, 0, 0, 0, 0
    .byte 0
last:
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
        // What another unit declares.
        ("distant", 0x7000),
        ("space::distant", 0x7000),
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
    let twin = names.find("twin").map(|value| value.address).unwrap_err();
    assert_eq!(
        twin.to_string(),
        "several variables have the name `twin`; write one of twin, twin (second.c)"
    );
}

#[test]
fn a_bit_field_is_shown_exactly_and_is_no_number_to_write() {
    let file = object_file();
    let names = Names::read(&file).unwrap();
    for (name, address, text) in [("flags.mode", 0x4000, "-3"), ("one.bit", 0x5000, "0")] {
        let found = names.find(name).unwrap();
        assert_eq!((found.address, found.bytes), (address, 1), "{name}");
        assert_eq!(found.text(&[155]), text, "{name}");
        assert_eq!(found.number(), None, "{name}");
    }
    let flags = names.find("flags").unwrap();
    assert_eq!(
        flags.text(&[155, 0, 0, 0, 7, 0, 0, 0]),
        "{mode: -3, plain: 7}"
    );
    assert_eq!(flags.text(&[155]), "{mode: -3, plain: …}");
    let one = names.find("one").unwrap();
    assert_eq!(one.text(&[4, 0, 0, 0]), "{bit: -1}");
    assert_eq!(one.number(), None);
    assert_eq!(names.find("flags.plain").unwrap().address, 0x4004);
}

/// The program that a compiler makes of a source, with debug information.
fn compiled(name: &str, source: &str, compiler: &str, options: &[&str]) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let [source_file, program] = [name, "program"].map(|name| directory.path().join(name));
    std::fs::write(&source_file, source).unwrap();
    let mut command = std::process::Command::new(compiler);
    command
        .args(options)
        .arg(&source_file)
        .arg("-o")
        .arg(&program);
    let output = command.output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{told}");
    std::fs::read(program).unwrap()
}

/// The text of a static variable as the program begins.
fn first_text(file: &[u8], name: &str) -> String {
    use object::{Object as _, ObjectSection as _};
    let names = Names::read(file).unwrap();
    let found = names.find(name).unwrap();
    let sections = object::File::parse(file).unwrap();
    let section = sections
        .sections()
        .find(|it| (it.address()..it.address() + it.size()).contains(&found.address));
    let section = section.unwrap();
    let begin = (found.address - section.address()) as usize;
    // What is 0 at the beginning has no bytes in the file.
    let mut data = section.data().unwrap().to_vec();
    data.resize(section.size() as usize, 0);
    found.text(&data[begin..begin + found.bytes])
}

#[test]
fn enumerations_with_data_are_shown_as_rust_writes_them() {
    let source = r"
        use std::sync::Mutex;
        pub enum Mode { Idle, Moving { to: f32, fast: bool }, Held(u8, i16), Only(Empty) }
        pub struct Empty;
        pub enum Single { One(u32) }
        #[used] pub static LOCKED: Mutex<Option<u32>> = Mutex::new(Some(7));
        #[used] pub static SOME: [Option<u32>; 2] = [Some(1), None];
        #[used] pub static RESULTS: [Result<u8, i32>; 2] = [Ok(3), Err(-4)];
        #[used] pub static MODES: [Mode; 4] =
            [Mode::Idle, Mode::Moving { to: 1.5, fast: true }, Mode::Held(2, -3), Mode::Only(Empty)];
        #[used] pub static NICHE: Option<&'static u32> = None;
        #[used] pub static LETTERS: [Option<char>; 2] = [Some('a'), None];
        #[used] pub static NESTED: [Option<Option<bool>>; 3] = [Some(Some(true)), Some(None), None];
        #[used] pub static SINGLE: Single = Single::One(9);
        fn main() {}
    ";
    let file = compiled("enums.rs", source, "rustc", &["-g"]);
    for (name, text) in [
        ("LOCKED.data", "Some(7)"),
        ("SOME", "[Some(1), None]"),
        ("SOME[1]", "None"),
        ("RESULTS", "[Ok(3), Err(-4)]"),
        (
            "MODES",
            "[Idle, Moving {to: 1.5, fast: true}, Held(2, -3), Only]",
        ),
        ("NICHE", "None"),
        ("LETTERS", "[Some('a'), None]"),
        ("NESTED", "[Some(Some(true)), Some(None), None]"),
        ("SINGLE", "One(9)"),
    ] {
        assert_eq!(first_text(&file, name), text, "{name}");
    }
}

#[test]
fn bit_fields_of_c_are_shown_exactly() {
    let source = r"
        struct { unsigned ready : 1, mode : 3, err : 4; } flags = { 1, 5, 9 };
        struct { int low : 5; long wide : 40; _Bool last : 1; } mixed = { -3, -5000000000, 1 };
        int main(void) { return 0; }
    ";
    for version in ["-gdwarf-3", "-gdwarf-4", "-gdwarf-5"] {
        let file = compiled("bits.c", source, "cc", &[version, "-O1"]);
        assert_eq!(
            first_text(&file, "flags"),
            "{ready: 1, mode: 5, err: 9}",
            "{version}"
        );
        for (name, text) in [
            ("flags.ready", "1"),
            ("flags.mode", "5"),
            ("flags.err", "9"),
            ("mixed.low", "-3"),
            ("mixed.wide", "-5000000000"),
            ("mixed.last", "true"),
        ] {
            assert_eq!(first_text(&file, name), text, "{name} {version}");
        }
    }
}

#[test]
fn variables_that_a_namespace_declares_are_found_by_their_paths_there() {
    let source = r"
        namespace left { extern int gain; struct Servo { static int mode; }; }
        namespace right { extern int gain; }
        int left::gain = 1;
        int right::gain = 2;
        int left::Servo::mode = 3;
        int gain = 4;
        int main() { return 0; }
    ";
    for version in ["-gdwarf-4", "-gdwarf-5"] {
        let file = compiled("spaces.cc", source, "c++", &[version]);
        for (name, text) in [
            ("left::gain", "1"),
            ("right::gain", "2"),
            ("left::Servo::mode", "3"),
            ("Servo::mode", "3"),
        ] {
            assert_eq!(first_text(&file, name), text, "{name} {version}");
        }
        let names = Names::read(&file).unwrap();
        let error = names.find("gain").map(|it| it.address).unwrap_err();
        assert_eq!(
            error.to_string(),
            "several variables have the name `gain`; write one of left::gain, right::gain, gain"
        );
    }
}

/// With all of its optimizations the compiler keeps few statics as they were written: it has a number with two
/// values as a truth value, and parts of structures apart.
#[test]
fn what_a_compiler_has_changed_is_an_error_or_right() {
    let source = r"
        static mut POWER: i32 = 2;
        static mut TRIM: [i32; 2] = [3, 4];
        static mut LAST: Option<u32> = None;
        static mut GAIN: (f32, u8) = (1.5, 6);
        static KEPT: std::sync::atomic::AtomicI32 = std::sync::atomic::AtomicI32::new(5);
        fn main() {
            let count = std::env::args().count();
            let before = unsafe { (POWER, TRIM[0], LAST, GAIN.1) };
            unsafe {
                if count > 2 { POWER = 40; }
                TRIM[0] += count as i32;
                LAST = Some(count as u32);
                GAIN.1 = count as u8;
            }
            KEPT.store(count as i32, std::sync::atomic::Ordering::Relaxed);
            std::hint::black_box((before, unsafe { (POWER, TRIM[0], LAST, GAIN.1) }));
        }
    ";
    let mut seen = 0;
    for options in [
        &["-g"][..],
        &["-g", "-Copt-level=3", "-Clto=fat", "-Ccodegen-units=1"],
    ] {
        let file = compiled("statics.rs", source, "rustc", options);
        let names = Names::read(&file).unwrap();
        for (name, text) in [
            ("statics::POWER", "2"),
            ("statics::TRIM", "[3, 4]"),
            ("statics::LAST", "None"),
            ("statics::GAIN", "{0: 1.5, 1: 6}"),
            ("statics::KEPT", "5"),
        ] {
            match names.find(name) {
                Ok(_) => {
                    assert_eq!(first_text(&file, name), text, "{name} {options:?}");
                    seen += 1;
                }
                Err(NamesError::NoAddress { .. } | NamesError::NoVariable { .. }) => {}
                Err(other) => panic!("{name} {options:?}: {other}"),
            }
        }
    }
    // Without optimizations all are as they were written.
    assert!(seen >= 5, "{seen}");
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
