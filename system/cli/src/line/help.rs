//! The help of the command line: its commands in groups, each with examples.

use core::fmt::Write as _;

use clap::Command;

/// A command, and examples: what is typed behind the name of the program.
type Examples = (&'static str, &'static [&'static str]);

/// The commands under their headings.
const GROUPS: [(&str, &[Examples]); 7] = [
    (
        "Run",
        &[
            (
                "new",
                &[
                    "new my-loops --path condor",
                    "new my-arm --robot --path condor",
                ],
            ),
            ("check", &["check condor.toml"]),
            (
                "up",
                &[
                    "up",
                    "up condor.toml --clock simulated --speed 10",
                    "up --headless --for 20s",
                ],
            ),
            ("down", &["down"]),
            ("start", &["start servo-a"]),
            ("stop", &["stop servo-a"]),
            ("restart", &["restart servo-a", "restart terminals"]),
            ("load", &["load servo-a ./target/release/my-servo"]),
        ],
    ),
    (
        "Watch",
        &[
            ("ui", &["ui"]),
            ("view", &["view"]),
            ("ps", &["ps", "ps --json"]),
            ("top", &["top"]),
            (
                "plot",
                &[
                    "plot 'index.*.position' --pane 'index.proximal.*.tension' --robot",
                    "plot run.mcap 'index.*.position'",
                ],
            ),
            ("tty", &["tty master", "tty master < commands.txt"]),
            ("vectors", &["vectors", "vectors master"]),
            ("log", &["log", "log --follow"]),
        ],
    ),
    (
        "Tune",
        &[
            (
                "vars",
                &[
                    "vars list",
                    "vars watch 'index.*.position'",
                    "vars set index.proximal.kp 0.8",
                ],
            ),
            ("send", &["send servo-a 64 1"]),
        ],
    ),
    (
        "Record",
        &[
            (
                "record",
                &["record run.mcap --for 10s", "record run.mcap 'index.*'"],
            ),
            (
                "export",
                &[
                    "export run.mcap --csv run.csv",
                    "export run.mcap 'index.*.position' --svg run.svg",
                ],
            ),
        ],
    ),
    (
        "Simulate",
        &[
            (
                "sim",
                &["sim robot.toml", "sim robot.toml --check motions/wave.toml"],
            ),
            (
                "clock",
                &["clock pause", "clock step 10ms", "clock speed max"],
            ),
        ],
    ),
    (
        "Debug",
        &[
            ("print", &["print servo-a 'SERVO.joints[2].gain'"]),
            ("gdb", &["gdb servo-a"]),
            ("debug", &["debug servo-a"]),
        ],
    ),
    (
        "More",
        &[
            ("completions", &["completions bash > condor.bash"]),
            ("man", &["man man1"]),
            ("help", &["help vars"]),
        ],
    ),
];

/// The heading of the commands that an application adds.
const OWN: &str = "Robot";

/// Returns `command` with examples for each of its commands, and with a list of these in groups. Commands in no group are
/// those of an application.
pub(super) fn with_help(mut command: Command, me: &str) -> Command {
    for (name, examples) in GROUPS.iter().flat_map(|(_, commands)| *commands) {
        if command.find_subcommand(name).is_some() {
            let text = examples.iter().fold(String::from("Examples:"), |text, it| {
                format!("{text}\n  {me} {it}")
            });
            command = command.mut_subcommand(name, |it| it.after_help(text));
        }
    }
    let list = list(&command);
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n{list}\nOptions:\n{{options}}{{after-help}}"
    ))
}

fn list(command: &Command) -> String {
    let about = |name: &str| {
        let found = command.find_subcommand(name)?.get_about()?;
        Some(format!("  {name:<12} {found}\n"))
    };
    let mut text = String::new();
    let mut add = |heading: &str, lines: String| {
        if !lines.is_empty() {
            // A string takes everything.
            let _ = write!(text, "\n{heading}:\n{lines}");
        }
    };
    let groups = |name: &str| GROUPS.iter().any(|it| it.1.iter().any(|it| it.0 == name));
    let own = command.get_subcommands().filter(|it| !it.is_hide_set());
    let own = own.map(Command::get_name).filter(|name| !groups(name));
    let mut own = Some(own.filter_map(about).collect::<String>());
    for (heading, commands) in GROUPS {
        if heading == "Watch" {
            add(OWN, own.take().unwrap_or_default());
        }
        let lines = commands.iter().map(|(name, _)| match *name {
            // clap adds it when it reads the arguments.
            "help" => Some("  help         Explains a command, with examples\n".into()),
            name => about(name),
        });
        add(heading, lines.flatten().collect());
    }
    text
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use crate::line::Line;

    #[test]
    fn each_command_is_in_one_group_and_fits_a_line() {
        let command = Line::command();
        for it in command.get_subcommands().filter(|it| !it.is_hide_set()) {
            let name = it.get_name();
            let groups = GROUPS.iter().flat_map(|(_, commands)| *commands);
            assert_eq!(groups.filter(|(it, _)| *it == name).count(), 1, "{name}");
        }
        let help = with_help(command, "condor").render_help().to_string();
        let list = help.split("Options:").next().unwrap_or_default();
        for line in list.lines() {
            assert!(line.chars().count() <= 80, "{line}");
        }
    }

    #[test]
    fn each_example_can_be_typed() {
        for (name, examples) in GROUPS.iter().flat_map(|(_, commands)| *commands) {
            for example in *examples {
                // What the shell takes for itself.
                let typed = example.split(['<', '>']).next().unwrap_or_default();
                let words = typed.split_whitespace().map(|it| it.trim_matches('\''));
                let words: Vec<_> = core::iter::once("condor").chain(words).collect();
                assert_eq!(words.get(1), Some(name));
                let read = Line::command().try_get_matches_from(words);
                let error = read.err().filter(|it| it.exit_code() != 0);
                assert!(error.is_none(), "{example}: {error:?}");
            }
        }
    }
}
