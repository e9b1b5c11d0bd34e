//! The kind of processors and the service of the example `extension`.

use condor_host::application::Programs;
use condor_host::control::{ControlRequest, MemberState};
use condor_host::description::SystemDescription;
use condor_host::error::AnyError;
use condor_host::extension::{Extension, ExtensionPart, Group, StartingExtension};
use condor_host::system::SystemDirectory;
use condor_mbox::MemoryWindow as _;

use crate::running::{Up, wait};

const SYSTEM: &str = r#"
[shared_memory]
bytes = 8192
[adder]
amount = 7
[[processors]]
number = 11
name = "polite"
kind = "nice"
level = 5
program = "THIS"
arguments = ["writer"]
"#;

/// How much more a process gives way to others than this one.
fn niceness(process: u32) -> i32 {
    let nice = |process: u32| -> i32 {
        let status = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
        let (_, after_name) = status.rsplit_once(')').unwrap();
        after_name
            .split_whitespace()
            .nth(16)
            .unwrap()
            .parse()
            .unwrap()
    };
    nice(process) - nice(std::process::id())
}

fn sum(up: &Up, data: &str) -> String {
    let output = up.run(&["send", "adder", "1", data, "--reply"]);
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn a_kind_of_processors_and_a_service_run_like_those_of_condor() {
    let up = Up::extended(SYSTEM);
    let status = up.status();
    let [service, ..] = &status.services[..] else {
        panic!("{status:?}");
    };
    assert_eq!((service.name.as_str(), service.number), ("adder", 15));
    let [polite] = &status.processors[..] else {
        panic!("{status:?}");
    };
    assert_eq!((polite.kind.as_str(), polite.number), ("nice", 11));
    assert_eq!(niceness(polite.pid.unwrap()), 5);
    assert!(sum(&up, "35").starts_with("42 "));

    // All are told where the memory lies that belongs to no processor, which is zeros at first.
    let memory = status.shared_memory.as_ref().unwrap().window().unwrap();
    assert_eq!((memory.size(), memory.word(8188)), (8192, Ok(0)));
    let environment = std::fs::read(format!("/proc/{}/environ", polite.pid.unwrap())).unwrap();
    let environment = String::from_utf8_lossy(&environment);
    assert!(
        environment.contains(r#""shared_memory":{"file":"/"#),
        "{environment}"
    );

    // They are started again, and other programs can be loaded.
    let events = up.events();
    crate::running::kill(service.pid.unwrap());
    let events = wait(events, "adder", MemberState::Running);
    assert!(sum(&up, "1").starts_with("8 "));
    crate::running::kill(polite.pid.unwrap());
    wait(events, "polite", MemberState::Running);
    let load = ControlRequest::Load {
        processor: "polite".into(),
        program: polite.program.clone(),
        arguments: vec!["joint".into()],
    };
    up.client().ask(&load).unwrap();
    let polite = up.status().processors.remove(0);
    assert_eq!(polite.arguments, ["joint"]);
    assert_eq!(niceness(polite.pid.unwrap()), 5);
}

/// Two machines whose harts are of one kind.
struct First;
struct Second;

#[derive(Debug)]
struct Windows;

impl Extension for First {
    fn kind(&self) -> Option<&'static str> {
        Some("hart")
    }

    fn read(&self, _: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        Some(Box::new(Windows))
    }
}

impl Extension for Second {
    fn kind(&self) -> Option<&'static str> {
        Some("hart")
    }

    fn table(&self) -> Option<&'static str> {
        Some("machine")
    }

    fn read(&self, _: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        Some(Box::new(Windows))
    }
}

impl Group for Windows {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        Ok(Box::new(Self))
    }
}

impl StartingExtension for Windows {}

#[test]
fn two_that_provide_the_windows_of_one_kind_are_refused_by_name() {
    let text = r#"
name = "two-machines"
window_bytes = 65536
[machine]
[[processors]]
number = 1
name = "servo"
kind = "hart"
program = "/bin/sh"
"#;
    let read = |extensions| {
        let application = Programs::new(&[]).with(extensions);
        SystemDescription::from_toml(text, "two.toml".as_ref(), &application)
    };
    read(&[&Second]).unwrap();
    let mistakes = read(&[&First, &Second]).unwrap_err().to_string();
    let expected = "two extensions for the kind of processors `hart`: \
                    system::extensions::First and system::extensions::Second;";
    assert!(mistakes.contains(expected), "{mistakes}");
    let twice = read(&[&Second, &Second]).unwrap_err().to_string();
    for word in ["kind of processors `hart`", "table `machine`"] {
        assert!(
            twice.contains(&format!("two extensions for the {word}")),
            "{twice}"
        );
    }
}
