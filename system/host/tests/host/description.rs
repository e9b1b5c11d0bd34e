//! Every mistake of a description is told, with its place and with what would be right.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::mpsc;
use std::time::Duration;

use condor_host::application::{Application, Programs};
use condor_host::description::{
    ClockKind, ClockSpeed, OnFailure, ProgramEntry, SystemDescription, response_times_us,
};
use condor_host::error::AnyError;
use condor_host::services::terminals::Script;

/// An application for robots with legs.
struct Walker(Programs<'static>);

static OWN: Walker = Walker(Programs::new(&[
    ("servo", |_| ExitCode::SUCCESS),
    ("table", |_| ExitCode::SUCCESS),
]));

impl Application for Walker {
    fn programs(&self) -> Vec<&'static str> {
        self.0.programs()
    }

    fn run_program(&self, program: &str, arguments: Vec<String>) -> ExitCode {
        self.0.run_program(program, arguments)
    }

    fn check_robot(&self, robot: &Path, served: &[(u8, &str)]) -> Result<(), AnyError> {
        if let Some((number, part)) = served.iter().find(|(_, part)| *part != "leg") {
            return Err(format!("processor {number} cannot serve {part}").into());
        }
        match std::fs::read_to_string(robot) {
            Ok(text) if text.contains("legs") => Ok(()),
            _ => Err(format!("it has no legs: {}", robot.display()).into()),
        }
    }
}

const RIGHT: &str = r#"
name = "hand"
window_bytes = 262144
[files]
root = "files"
[[processors]]
number = 4
name = "plant"
program = "self"
arguments = ["servo", "a"]
"#;

fn place() -> (tempfile::TempDir, PathBuf) {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("hand.toml");
    (place, file)
}

/// What is said of a text, without the name of the file.
fn told(text: &str, file: &Path) -> Vec<String> {
    let Err(mistakes) = SystemDescription::from_toml(text, file, &OWN) else {
        return Vec::new();
    };
    let name = format!("{}:", file.display());
    let told = mistakes.0.iter().map(|mistake| {
        let text = mistake.to_string();
        let text = text.strip_prefix(&name).unwrap().to_owned();
        text.lines().next().unwrap().to_owned()
    });
    told.collect()
}

fn one(text: &str) -> String {
    let (_place, file) = place();
    let told = told(text, &file);
    assert_eq!(told.len(), 1, "{told:#?}");
    told[0].clone()
}

#[test]
fn what_is_left_out_has_a_default() {
    let (place, file) = place();
    let description = SystemDescription::from_toml(RIGHT, &file, &OWN).unwrap();
    assert_eq!(description.files.unwrap().root, place.path().join("files"));
    assert_eq!(description.robot, None);
    assert_eq!(
        (description.bus_bytes, description.shared_bytes),
        (None, None)
    );
    assert_eq!(description.terminals.replay_bytes, 65536);
    assert_eq!(description.terminals.log_bytes, 4 << 20);
    assert_eq!(description.service_restarts, 20);
    let processor = &description.processors[0];
    assert_eq!(processor.program, ProgramEntry::Own);
    assert_eq!(processor.kind, "process");
    assert!(processor.runs_here);
    assert_eq!(
        (processor.on_failure, processor.restarts),
        (OnFailure::Restart, 10)
    );
    assert_eq!(processor.stall_seconds, 5);
}

#[test]
fn all_mistakes_are_told_in_the_order_of_the_lines() {
    let text = r#"
nam = "hand"
window_bytes = 1000
[files]
root = "files"
raed_only = true
[[processors]]
number = 12
name = "a b"
program = "self"
arguments = ["sevro"]
on_failure = "rstart"
[[processors]]
name = 5
program = "no-such-program"
loops = "quickly"
priority = 100
uio = [{ vector = 128, file = "/dev/uio0" }]
"#;
    let (place, file) = place();
    assert_eq!(
        told(text, &file),
        [
            "1:1: the key `name` is missing here; it is a name in quotes".to_owned(),
            "2:1: there is no key `nam` here; did you mean `name`?".into(),
            "3:16: the number 1000 stands where a multiple of 4096 from 4096 to 1073741824 should be".into(),
            "6:1: there is no key `raed_only` here; did you mean `read_only`?".into(),
            "8:10: the number 12 stands where a whole number from 0 to 11 should be".into(),
            "9:8: \"a b\" cannot be a name: a name has 1 to 32 letters, digits, `-` and `_`".into(),
            "11:13: this binary contains no program `sevro`; did you mean `servo`?".into(),
            "12:14: `rstart` is none of the choices here; did you mean `restart`?".into(),
            "13:1: the key `number` is missing here; it is a whole number from 0 to 11".into(),
            "14:8: the number 5 stands where a text should be".into(),
            format!(
                "15:11: there is no program `no-such-program`; searched {}, {}, and PATH",
                place.path().join("no-such-program").display(),
                std::env::current_exe()
                    .unwrap()
                    .with_file_name("no-such-program")
                    .display(),
            ),
            "16:9: `quickly` is none of the choices here; it can be `threads`, `signals`, `spin`"
                .into(),
            "17:12: the number 100 stands where a whole number from 1 to 99 should be".into(),
            "18:19: the number 128 stands where a whole number from 1 to 127 should be".into(),
        ]
    );
}

#[test]
fn names_and_numbers_are_there_once() {
    let more = |number: u8, name: &str| {
        format!(
            "{RIGHT}[[processors]]\nnumber = {number}\nname = \"{name}\"\nprogram = \"self\"\narguments = [\"table\"]\n"
        )
    };
    assert_eq!(
        one(&more(4, "other")),
        "12:10: the processor in line 7 has the number 4, too; these numbers are free: 0, 1, 2, 3, 5, 6, 7, 8, 9, 10, \
         11"
    );
    assert_eq!(
        one(&more(3, "plant")),
        "13:8: the processor in line 8 has the name `plant`, too; choose another name"
    );
    assert_eq!(
        one(&more(3, "files")),
        "13:8: `files` is the name of a service; choose another name"
    );
}

#[test]
fn a_serial_port_is_of_one_processor() {
    let two = |port: &str| {
        format!(
            "{RIGHT}serial = \"/dev/ttyUSB0\"\n[[processors]]\nnumber = 3\nname = \"other\"\nprogram = \"self\"\n\
             arguments = [\"table\"]\nserial = \"{port}\"\n"
        )
    };
    let (_place, file) = place();
    assert_eq!(told(&two("/dev/ttyUSB1"), &file), [""; 0]);
    assert_eq!(
        one(&two("/dev/ttyUSB0")),
        "17:10: the processor with the `serial` in line 11 has this device, too; name another one"
    );
}

#[test]
fn what_is_no_toml_is_told_where_it_is() {
    let told = one(&RIGHT.replace("262144", "= 262144"));
    assert!(told.starts_with("3:16: "), "{told}");
    let told = one("name = \"a\"\nname = \"b\"\nwindow_bytes = 4096\nprocessors = []\n");
    assert!(told.starts_with("2:1: duplicate key"), "{told}");
}

#[test]
fn sizes_are_whole_pages() {
    let text = RIGHT.replace("[files]", "[bus]\nbytes = 100\n[files]");
    assert_eq!(
        one(&text),
        "5:9: the number 100 stands where a multiple of 4096 from 4096 to 1073741824 should be"
    );
    let text = RIGHT.replace("[files]", "[bus]\nbytes = 4096.0\n[files]");
    assert_eq!(
        one(&text),
        "5:9: the number 4096.0 stands where a multiple of 4096 from 4096 to 1073741824 should be"
    );
}

#[test]
fn a_log_has_room_for_what_is_shown_of_it() {
    let terminals = |text: &str| RIGHT.replace("[files]", &format!("[terminals]\n{text}\n[files]"));
    assert_eq!(
        one(&terminals("log_bytes = 65535")),
        "5:13: 65535 is too small; it must be at least 65536"
    );
    assert_eq!(
        one(&terminals("replay_bytes = 0\nlog_bytes = 4095")),
        "6:13: 4095 is too small; it must be at least 4096"
    );
    let (_place, file) = place();
    let read = |text: &str| {
        let description = SystemDescription::from_toml(&terminals(text), &file, &OWN);
        description.unwrap().terminals.log_bytes
    };
    assert_eq!(read("replay_bytes = 100\nlog_bytes = 5000"), 5000);
    assert_eq!(read("replay_bytes = 5000000"), 5_000_000);
}

#[test]
fn a_program_is_looked_for_and_must_be_one() {
    let (place, file) = place();
    let path = place.path().join("program");
    std::fs::write(&path, "").unwrap();
    let text = RIGHT.replace("\"self\"", "\"program\"");
    let expected = format!(
        "9:11: {} is not a program: it is not an executable file",
        path.display()
    );
    assert_eq!(told(&text, &file), [expected]);
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    let description = SystemDescription::from_toml(&text, &file, &OWN).unwrap();
    assert_eq!(description.processors[0].program, ProgramEntry::File(path));
    let text = RIGHT.replace("\"self\"", "\"sh\"");
    let description = SystemDescription::from_toml(&text, &file, &OWN).unwrap();
    let ProgramEntry::File(path) = &description.processors[0].program else {
        panic!("it is in PATH");
    };
    assert!(path.is_absolute() && path.ends_with("sh"), "{path:?}");
}

#[test]
fn an_own_program_must_be_named() {
    let text = RIGHT.replace("arguments = [\"servo\", \"a\"]\n", "");
    assert_eq!(
        one(&text),
        "9:11: `arguments` must begin with the name of a program that this binary contains; it can be `servo`, `table`"
    );
}

#[test]
fn what_is_served_is_a_directory() {
    let (place, file) = place();
    std::fs::write(place.path().join("files"), "").unwrap();
    let path = place.path().join("files");
    assert_eq!(
        told(RIGHT, &file),
        [format!(
            "5:8: {} is not a directory; name a directory, or a path at which one can be made",
            path.display()
        )]
    );
}

#[test]
fn the_application_checks_the_configuration_of_the_robot() {
    let (place, file) = place();
    let text = RIGHT.replace("[files]", "robot = \"robot.toml\"\n[files]");
    let told_ = told(&text, &file);
    let path = place.path().join("robot.toml");
    let refusal = format!("4:9: it has no legs: {}", path.display());
    assert_eq!(told_, [refusal]);
    std::fs::write(&path, "legs = 2").unwrap();
    assert_eq!(told(&text, &file), [""; 0]);
    let alone = OWN.0;
    let mistakes = SystemDescription::from_toml(&text, &file, &alone).unwrap_err();
    let text = mistakes.to_string();
    assert!(
        text.contains("does not use a robot's configuration"),
        "{text}"
    );
    assert!(text.contains("remove the key `robot`"), "{text}");
}

#[test]
fn a_file_that_is_not_there_is_told() {
    let (_place, file) = place();
    let text = SystemDescription::read(&file, &OWN)
        .unwrap_err()
        .to_string();
    assert!(
        text.starts_with(&format!("{}:1:1: cannot read it: ", file.display())),
        "{text}"
    );
}

#[test]
fn a_clock_is_real_unless_it_is_simulated_at_a_speed() {
    let (_place, file) = place();
    let text = |clock: &str| RIGHT.replace("[files]", &format!("[clock]\n{clock}\n[files]"));
    let read = |text: &str| SystemDescription::from_toml(text, &file, &OWN).unwrap();
    assert_eq!(read(RIGHT).clock, ClockKind::Real);
    assert_eq!(read(&text("kind = \"real\"")).clock, ClockKind::Real);
    for (speed, expected) in [
        ("", ClockSpeed::ONE),
        ("speed = 0.5", ClockSpeed(500)),
        ("speed = 2", ClockSpeed(2000)),
        ("speed = \"max\"", ClockSpeed::MAX),
    ] {
        let description = read(&text(&format!("kind = \"simulated\"\n{speed}")));
        assert_eq!(description.clock, ClockKind::Simulated(expected), "{speed}");
    }
    for (speed, shown) in [
        ("0", "0"),
        ("-1.0", "-1"),
        ("1001", "1001"),
        ("\"fast\"", "fast"),
    ] {
        let told = one(&text(&format!("kind = \"simulated\"\nspeed = {speed}")));
        let range = "a speed is a number from 0.001 to 1000, or `max`";
        assert!(told.starts_with("6:"), "{told}");
        assert!(
            told.contains(&format!("\"{shown}\" is not a speed: {range}")),
            "{told}"
        );
    }
    assert_eq!(
        one(&text("speed = 2")),
        "5:9: a real clock has no speed; with `kind = \"simulated\"` the system has a clock of its own"
    );
    assert_eq!(
        one(&text("kind = \"clockwork\"")),
        "5:8: `clockwork` is none of the choices here; it can be `real`, `simulated`"
    );
    let times = |times: &str| RIGHT.to_owned() + "loop_times_us = " + times;
    assert_eq!(
        read(&times("[80, 200]")).processors[0].loop_times_us,
        [80, 200]
    );
    assert_eq!(
        one(&times("[1, 1, 1, 1, 1, 1, 1, 1, 1]")),
        "11:17: a program has at most 8 servo loops, but here are 9 times"
    );
}

#[test]
fn declared_loops_end_in_time_or_are_named() {
    let text = |more: &str| {
        let fast = "{ name = \"servo\", hz = 400, worst_us = 900, blocked_us = 50 }";
        format!("{RIGHT}servo_loops = [{fast}, {{ name = \"slow\", hz = 50, {more} }}]")
    };
    let (_place, file) = place();
    let described = SystemDescription::from_toml(&text("worst_us = 3000"), &file, &OWN).unwrap();
    let loops = &described.processors[0].servo_loops;
    // 3000 µs, and two runs of the faster loop.
    assert_eq!(response_times_us(loops), [Some(950), Some(4800)]);
    assert_eq!(
        one(&text("worst_us = 13000, blocked_us = 20")),
        "11:15: `slow` may end later than its period of 20000 µs: it runs for up to 13000 µs, is blocked for up to 20 µs, \
         and faster loops take 36.0 % of the time; shorten runs, or lower the rate of `slow` or of a faster loop"
    );
    assert!(
        one(&text("worst_us = 1").replace("= 50,", "= 0,")).contains("`slow` has the rate 0 Hz")
    );
    assert!(one(&text("worst = 1")).contains("worst_us"));
}

#[test]
fn its_file_is_found_from_every_directory() {
    let text = RIGHT.replace("[files]\nroot = \"files\"\n", "");
    let description = SystemDescription::from_toml(&text, Path::new("hand.toml"), &OWN).unwrap();
    let here = std::env::current_dir().unwrap();
    assert_eq!(description.file, here.join("hand.toml"));
    // Mistakes name it as it was typed.
    let wrong = SystemDescription::from_toml("", Path::new("hand.toml"), &OWN).unwrap_err();
    assert!(wrong.to_string().starts_with("hand.toml:1:1"), "{wrong}");
}

#[test]
fn a_fifo_is_refused_at_once_wherever_a_file_is_read() {
    let (place, _) = place();
    let fifo = place.path().join("fifo");
    let made = Command::new("mkfifo").arg(&fifo).status().unwrap();
    assert!(made.success());
    let reads: [fn(&Path) -> String; 2] = [
        |fifo| SystemDescription::read(fifo, &OWN).unwrap_err().to_string(),
        |fifo| Script::read(fifo, &["a"]).unwrap_err().to_string(),
    ];
    let (sender, receiver) = mpsc::channel();
    for read in reads {
        // A read that waits for ever must not take the test with it.
        let (fifo, sender) = (fifo.clone(), sender.clone());
        std::thread::spawn(move || sender.send(read(&fifo)).unwrap());
        let told = receiver.recv_timeout(Duration::from_secs(60)).unwrap();
        assert!(told.contains("it is a FIFO, not a regular file"), "{told}");
        assert!(told.contains("fifo"), "{told}");
    }
}
