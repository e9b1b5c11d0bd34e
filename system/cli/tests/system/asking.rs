//! What programs ask of their supervisor by message.

use condor_host::control::MemberState;
use condor_host::services::terminals::type_in;

use crate::running::{self, Up, wait};

/// `a` asks; it may do both, or what `MAY` says.
const ASKED: &str = r#"
    [[processors]]
    number = 5
    name = "b"
    program = "THIS"
    arguments = ["writer"]
    on_failure = "leave"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["asker"]
"#;

fn start(may: &str, options: &[&str]) -> Up {
    Up::start(&format!("{ASKED}may_ask = [{may}]\n"), options)
}

/// Types a line at the terminal of the one that asks, and waits until it shows `shown`.
fn asks(up: &Up, line: &str, shown: &str) {
    type_in(&up.directory(), "a", format!("{line}\n").as_bytes()).unwrap();
    up.read_terminal("a", &format!("{shown}\r\n"));
}

#[test]
fn a_processor_restarts_and_loads_what_the_description_lets_it() {
    for options in [&[][..], &["--clock", "simulated", "--speed", "max"]] {
        let up = start("\"restart\", \"load\"", options);
        let before = up.status();
        asks(&up, "restart b", "done: restart b");
        let after = up.status();
        assert_ne!(after.processors[0].pid, before.processors[0].pid);
        assert_eq!(running::state(&after.processors[0]), MemberState::Running);
        assert_eq!(after.processors[0].restarts, 0, "it was asked for");
        assert_eq!(after.processors[1].pid, before.processors[1].pid);

        let this = running::this();
        let line = format!("load 5 {this} writer other");
        asks(&up, &line, &format!("done: {line}"));
        assert_eq!(up.status().processors[0].arguments, ["writer", "other"]);
        up.read_terminal("b", "writer other 0\r\n");

        // A program that fails before it joins is never done.
        let line = format!("load b {this} nothing");
        asks(
            &up,
            &line,
            "error: `b` is not running; its last end: exit status 3",
        );
        let failed = up.status().processors[0].clone();
        assert_eq!(failed.state, MemberState::Failed);
        // An errant program is restarted, here by another one.
        let line = format!("load b {this} writer");
        asks(&up, &line, &format!("done: {line}"));

        for (line, error) in [
            (
                "restart c",
                "there is no processor or service `c`; there are files, terminals, b, a",
            ),
            (
                "restart files",
                "`files` is a service, which a person alone restarts",
            ),
            (
                "load b /bin/sh",
                "a processor may load `self` and the programs that the description names, \
                 not `/bin/sh`; the command `load` may",
            ),
        ] {
            asks(&up, line, &format!("error: {error}"));
        }
        // The asker itself is another one then.
        let events = up.events();
        type_in(&up.directory(), "a", b"restart a\n").unwrap();
        let events = wait(events, "a", MemberState::Starting);
        wait(events, "a", MemberState::Running);
        up.run(&["down"]);
        let (code, summary) = up.end();
        assert_eq!(code, Some(0), "{summary}");
    }
}

#[test]
fn a_processor_without_leave_restarts_nothing() {
    let up = start("", &[]);
    let before = up.status();
    asks(
        &up,
        "restart b",
        "error: the description does not let `a` ask for a restart: \
         its processor needs `may_ask = [\"restart\"]`",
    );
    assert_eq!(up.status().processors[0].pid, before.processors[0].pid);
    asks(&up, "name 5", "name b");
    asks(&up, "name 6", "no name");
    // A message with an offset at which no request can lie is refused.
    asks(&up, "offset 4294967232", "reply 0");
    asks(&up, "offset 3", "reply 0");
    up.run(&["down"]);
    assert_eq!(up.end().0, Some(0));
}
