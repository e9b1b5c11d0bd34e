//! What a description says of the machine and its harts.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use condor_host::application::Programs;
use condor_host::description::{ProgramEntry, SystemDescription};
use qemu_virt_host::{HARTS as EXTENSION, Map, Qemu};

use crate::elf;

const OWN: Programs<'_> = Programs::new(&[("servo", |_| ExitCode::SUCCESS)]).with(&[EXTENSION]);

fn told(text: &str, file: &Path) -> Vec<String> {
    let Err(mistakes) = SystemDescription::from_toml(text, file, &OWN) else {
        return Vec::new();
    };
    let mistakes = mistakes.0.iter();
    let lines = mistakes.map(|it| format!("{}:{}: {}", it.line, it.column, it.problem));
    lines.collect()
}

const HARTS: &str = r#"
name = "hand"
window_bytes = 262144
[bus]
bytes = 16384
[machine]
memory_bytes = 33554432
monitor = "monitor.elf"
qemu = "qemu"
options = ["-icount", "shift=0"]
[[processors]]
number = 4
name = "plant"
program = "self"
arguments = ["servo", "a"]
[[processors]]
number = 1
name = "a"
kind = "hart"
hart = 1
program = "servo.elf"
arguments = ["a"]
[[processors]]
number = 0
name = "b"
kind = "hart"
hart = 0
program = "servo.elf"
"#;

/// A place with all files that `HARTS` names.
fn place_of_harts() -> (tempfile::TempDir, PathBuf) {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("hand.toml");
    std::fs::write(&file, HARTS).unwrap();
    let executable = std::fs::Permissions::from_mode(0o755);
    for name in ["monitor.elf", "servo.elf", "qemu"] {
        std::fs::write(place.path().join(name), elf::File::pie().build()).unwrap();
    }
    std::fs::set_permissions(place.path().join("qemu"), executable).unwrap();
    (place, file)
}

#[test]
fn a_machine_is_laid_out_by_its_harts() {
    let (place, file) = place_of_harts();
    let description = SystemDescription::from_toml(HARTS, &file, &OWN).unwrap();
    let kinds = description
        .processors
        .iter()
        .map(|processor| processor.kind);
    assert!(kinds.eq(["process", "hart", "hart"]));
    let servo = ProgramEntry::File(place.path().join("servo.elf"));
    assert_eq!(description.processors[1].program, servo);
    let shown = format!("{description:?}");
    let qemu = Qemu {
        command: place.path().join("qemu"),
        monitor: place.path().join("monitor.elf"),
        options: vec!["-icount".into(), "shift=0".into()],
    };
    assert!(shown.contains(&format!("{qemu:?}")), "{shown}");
    let map = Map::new(32 << 20, &[0, 1], 262_144, 16384, 0).unwrap();
    assert!(shown.contains(&format!("{map:?}")), "{shown}");
}

#[test]
fn mistakes_with_machines_are_told() {
    let cases = [
        (
            "hart = 0",
            "hart = 1",
            "27:8: the processor in line 20 has hart 1, too",
            2,
        ),
        (
            "hart = 0",
            "hart = 2",
            "27:8: this is hart 2, but no processor is hart 0; number harts from 0 on without a gap",
            1,
        ),
        (
            "hart = 0",
            "",
            "23:1: the key `hart` is missing here; it is a whole number from 0 to 11",
            2,
        ),
        (
            "hart = 0",
            "hart = 0\ncpu = 1",
            "28:1: there is no key `cpu` here",
            1,
        ),
        (
            "arguments = [\"servo\", \"a\"]",
            "arguments = [\"servo\", \"a\"]\nhart = 3",
            "16:1: there is no key `hart` here",
            1,
        ),
        (
            "\"servo.elf\"\narguments = [\"a\"]",
            "\"self\"\narguments = [\"servo\"]",
            "21:11: `self` is a program for this machine; name a file that this processor can run",
            1,
        ),
        (
            "qemu = \"qemu\"",
            "qemu = \"qemu-system-none\"",
            "9:8: the simulator of the machine, `qemu-system-none`, is not found: install QEMU \
             (package qemu-system-misc of Debian and Ubuntu), or give its path with the key `qemu`",
            1,
        ),
        (
            "monitor.elf",
            "no.elf",
            "8:11: cannot read PLACE/no.elf: No such file or directory (os error 2)",
            1,
        ),
        (
            "memory_bytes = 33554432",
            "memory_bytes = 7340032",
            "7:16: the memory has 0x700000 bytes, but the machine needs 0x",
            1,
        ),
        (
            "memory_bytes = 33554432",
            "memory_bytes = 4096",
            "7:16: the number 4096 stands where a multiple of 1048576 from 1048576 to 1073741824 should be",
            1,
        ),
        (
            "program = \"servo.elf\"\narguments",
            "program = \"none.elf\"\narguments",
            "21:11: cannot read PLACE/none.elf: No such file or directory (os error 2)",
            1,
        ),
        (
            "program = \"servo.elf\"\narguments",
            "program = \"hand.toml\"\narguments",
            "21:11: hart 1 cannot run PLACE/hand.toml: it is not an ELF file",
            1,
        ),
        (
            "name = \"b\"",
            "name = \"machine\"",
            "25:8: `machine` is the name of a service",
            1,
        ),
        ("\"-icount\", ", "", "", 0),
    ];
    for (part, instead, expected, count) in cases {
        let (place, file) = place_of_harts();
        let text = HARTS.replacen(part, instead, 1);
        std::fs::write(&file, &text).unwrap();
        let told = told(&text, &file);
        let expected = expected.replace("PLACE", &place.path().display().to_string());
        assert_eq!(told.len(), count, "{instead}: {told:#?}");
        if count > 0 {
            let found = told.iter().any(|one| one.starts_with(&expected));
            assert!(found, "{told:#?}\nexpected {expected}");
        }
    }
    let long = format!("arguments = [\"{}\"]", "a".repeat(512));
    let (_place, file) = place_of_harts();
    let told = told(&HARTS.replace("arguments = [\"a\"]", &long), &file);
    let expected =
        "22:13: the arguments need 513 bytes, with a zero after each; a hart has room for 512";
    assert_eq!(told, [expected]);
}

#[test]
fn some_harts_have_a_serial_port() {
    let (_place, file) = place_of_harts();
    let told = |hart: &str| told(&HARTS.replacen("hart = 0", hart, 1), &file);
    assert_eq!(told("hart = 0\nserial = \"/dev/ttyUSB0\""), [""; 0]);
    let expected =
        "28:10: only harts 0 to 3 can have a serial port; use one of them, or leave `serial` out";
    let told = told("hart = 4\nserial = \"/dev/ttyUSB0\"");
    assert_eq!((told.len(), told[1].as_str()), (2, expected));
}

#[test]
fn harts_and_machines_go_together() {
    let (_place, file) = place_of_harts();
    let (before, rest) = HARTS.split_once("[machine]").unwrap();
    let (_, processors) = rest.split_once("[[processors]]").unwrap();
    let told_ = told(&format!("{before}[[processors]]{processors}"), &file);
    assert_eq!(
        told_,
        [
            "15:8: a processor of `kind = \"hart\"` needs a machine; add the table `[machine]`, or use another kind"
        ]
    );
    let (_, process) = HARTS.split_once("name = \"plant\"").unwrap();
    let (process, _) = process.split_once("[[processors]]").unwrap();
    let (before, _) = HARTS.split_once("[[processors]]").unwrap();
    let text = format!("{before}[[processors]]\nnumber = 4\nname = \"plant\"{process}");
    let told = told(&text, &file);
    let expected = "6:1: no processor is a hart of this machine; add one with";
    assert!(
        told.len() == 1 && told[0].starts_with(expected),
        "{told:#?}"
    );
}
