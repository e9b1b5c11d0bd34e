//! The help of the command line: its commands in groups, each with examples.

use core::fmt::Write as _;
use std::path::Path;
use std::{fs, io};

use clap::Command;
use clap_complete::{Generator as _, Shell};
use condor_host::error::NamedFileError;

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
            ("demo", &["demo"]),
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
                    "plot 'index.*.position' --pane 'index.proximal-*.effort' --robot",
                    "plot run.mcap 'index.*.position'",
                ],
            ),
            ("tty", &["tty master", "tty master < commands.txt"]),
            ("vectors", &["vectors", "vectors master --follow"]),
            ("log", &["log", "log --follow", "log --shared"]),
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
                    "vars set index.proximal.servo.kp 0.8",
                    "vars diff",
                    "vars save tuned.toml",
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
                &[
                    "record run.mcap --for 10s",
                    "record run.mcap 'index.*' --messages master",
                ],
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

/// Writes the script by which `shell` completes the commands of the program `me`.
///
/// # Errors
/// Returns the error of `out`.
pub(super) fn complete(
    mut command: Command,
    me: &str,
    shell: Shell,
    out: &mut impl io::Write,
) -> io::Result<()> {
    command.set_bin_name(me);
    command.build();
    shell.try_generate(&command, out)
}

/// Writes a manual page for each command of the program `me` into a directory, and makes that if necessary.
///
/// # Errors
/// Returns an error with the directory if it cannot be made or written to.
pub(super) fn write_pages(
    command: Command,
    me: &str,
    directory: &Path,
) -> Result<(), NamedFileError> {
    let made = fs::create_dir_all(directory);
    made.map_err(NamedFileError::at("make", directory))?;
    let written = clap_mangen::generate_to(command.display_name(me.to_owned()), directory);
    written.map_err(NamedFileError::at("write to", directory))
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
    fn commands_are_completed_and_have_pages() {
        let command = || with_help(Line::command(), "robot");
        for shell in [Shell::Bash, Shell::Fish, Shell::Zsh] {
            let mut script = Vec::new();
            complete(command(), "robot", shell, &mut script).unwrap();
            let script = String::from_utf8(script).unwrap();
            for word in ["robot", "vectors", "speed"] {
                assert!(script.contains(word), "{shell}: {word}");
            }
        }
        let mut full = fs::File::options().write(true).open("/dev/full").unwrap();
        assert!(complete(command(), "robot", Shell::Bash, &mut full).is_err());
        let place = tempfile::tempdir().unwrap();
        let pages = place.path().join("man/man1");
        write_pages(command(), "robot", &pages).unwrap();
        for page in ["robot.1", "robot-vars.1", "robot-clock-step.1"] {
            assert!(pages.join(page).is_file(), "{page}");
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
