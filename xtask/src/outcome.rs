//! Running parts, telling how they ended, and what took how long.
//!
//! Each part leaves a record in `target/checks`: a line for the part, and one for each command and each
//! test program that it ran. The closing table is made of the records.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use crate::Result;
use crate::command;
use crate::context::Context;
use crate::parts::{PARTS, Part, Summary};

/// Runs these parts, each ending with its summary line.
pub(crate) fn each(context: &Context, parts: &[&Part]) -> ExitCode {
    let mut failed = false;
    for part in parts {
        let record = run(context, part);
        println!("{}", record.line());
        failed |= record.state == State::Failed;
    }
    if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    }
}

/// Runs every part of `verify`, but for those of which `rest` finds the record of an earlier call;
/// prints the table. The last line is `N passed, N failed`, and `, N skipped` if there is one.
pub(crate) fn verify(context: &Context, rest: bool) -> ExitCode {
    let records: Vec<Record> = PARTS
        .iter()
        .filter(|part| part.in_verify)
        .map(|part| {
            let earlier = rest.then(|| Record::read(context, part)).flatten();
            earlier.unwrap_or_else(|| {
                let record = run(context, part);
                println!("{}\n", record.line());
                record
            })
        })
        .collect();
    print!("{}", table(&records));
    let count = |state| {
        records
            .iter()
            .filter(|record| record.state == state)
            .count()
    };
    let (failed, skipped) = (count(State::Failed), count(State::Skipped));
    print!("\n{} passed, {failed} failed", count(State::Passed));
    if skipped > 0 {
        print!(", {skipped} skipped");
    }
    println!();
    if failed == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Returns a table with a row for each part, and below it the longest of its steps.
fn table(records: &[Record]) -> String {
    /// Commands that took less are in the records alone.
    const LONG: f64 = 5.0;
    let mut text = String::from("\n    s  cpu s  part\n");
    let mut sums = (0.0, 0.0);
    for record in records {
        let _ = writeln!(
            text,
            "{:5.0} {:6.0}  {:8} {}: {}",
            record.seconds,
            record.cpu_seconds,
            record.name,
            record.state.word(),
            record.summary
        );
        sums = (sums.0 + record.seconds, sums.1 + record.cpu_seconds);
        for (seconds, what) in record.steps.iter().filter(|(seconds, _)| *seconds >= LONG) {
            let what: String = what.chars().take(100).collect();
            let _ = writeln!(text, "               {seconds:6.1}  {what}");
        }
    }
    let _ = writeln!(text, "{:5.0} {:6.0}  all", sums.0, sums.1);
    text
}

#[derive(Clone, Copy, PartialEq)]
enum State {
    Passed,
    Failed,
    Skipped,
}

const STATES: [State; 3] = [State::Passed, State::Failed, State::Skipped];

impl State {
    fn word(self) -> &'static str {
        match self {
            State::Passed => "ok",
            State::Failed => "FAILED",
            State::Skipped => "SKIPPED",
        }
    }
}

/// The outcome of a part, and its times.
struct Record {
    name: String,
    state: State,
    summary: String,
    seconds: f64,
    /// The CPU time of all processes that the part started and waited for.
    cpu_seconds: f64,
    /// The seconds of what it ran.
    steps: Vec<(f64, String)>,
}

impl Record {
    fn line(&self) -> String {
        let Self {
            name,
            state,
            summary,
            seconds,
            ..
        } = self;
        format!("xtask {name}: {} ({summary}, {seconds:.1} s)", state.word())
    }

    fn path(context: &Context, part: &str) -> PathBuf {
        context.root.join("target/checks").join(part)
    }

    /// Writes the record. The columns are separated by tabs; the first line is that of the part.
    fn write(&self, context: &Context) -> Result<()> {
        let path = Self::path(context, &self.name);
        fs::create_dir_all(path.parent().unwrap_or(&path))?;
        let mut text = format!(
            "{:.1}\t{:.1}\t{}\t{}\n",
            self.seconds,
            self.cpu_seconds,
            self.state.word(),
            self.summary
        );
        for (seconds, what) in &self.steps {
            let _ = writeln!(text, "{seconds:.1}\t{what}");
        }
        Ok(fs::write(path, text)?)
    }

    /// Reads the record that an earlier call left of a part, if it is whole.
    fn read(context: &Context, part: &Part) -> Option<Self> {
        Self::parse(
            part.name,
            &fs::read_to_string(Self::path(context, part.name)).ok()?,
        )
    }

    fn parse(name: &str, text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let mut columns = lines.next()?.splitn(4, '\t');
        let seconds = columns.next()?.parse().ok()?;
        let cpu_seconds = columns.next()?.parse().ok()?;
        let word = columns.next()?;
        let step = |line: &str| {
            let (seconds, what) = line.split_once('\t')?;
            Some((seconds.parse().ok()?, what.to_owned()))
        };
        Some(Self {
            name: name.to_owned(),
            state: STATES.into_iter().find(|state| state.word() == word)?,
            summary: columns.next()?.to_owned(),
            seconds,
            cpu_seconds,
            steps: lines.map(step).collect::<Option<_>>()?,
        })
    }
}

fn run(context: &Context, part: &Part) -> Record {
    // The record of an earlier call says nothing of this one.
    let _ = fs::remove_file(Record::path(context, part.name));
    command::take_times();
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let result: Result<Summary> = (part.run)(context);
    let (state, summary) = match result {
        Ok(Summary {
            checked,
            left_out,
            skipped,
        }) => {
            let left_out =
                left_out.map_or_else(String::new, |what| format!("; NOT CHECKED: {what}"));
            let state = if skipped {
                State::Skipped
            } else {
                State::Passed
            };
            (state, checked + &left_out)
        }
        Err(problem) => (State::Failed, problem.to_string()),
    };
    let record = Record {
        name: part.name.to_owned(),
        state,
        // A summary is one line even if the problem was told in several.
        summary: summary.replace(['\n', '\t'], "; "),
        seconds: start.elapsed().as_secs_f64(),
        cpu_seconds: cpu_seconds() - cpu,
        steps: command::take_times(),
    };
    if let Err(problem) = record.write(context) {
        eprintln!(
            "xtask: cannot write the outcome of {} to its file: {problem}",
            part.name
        );
    }
    record
}

/// Returns the processor time of all processes that this one has waited for; 0 where the system does not
/// tell.
fn cpu_seconds() -> f64 {
    /// Linux counts these times in hundredths of a second.
    const TICKS: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in parentheses may have blanks; `cutime` and `cstime` are the fields 16 and 17.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let fields = fields.split_whitespace().skip(13).take(2);
    fields
        .filter_map(|field| field.parse::<f64>().ok())
        .sum::<f64>()
        / TICKS
}

#[cfg(test)]
mod tests {
    use super::{Record, State, table};

    const TEXT: &str = "12.5\t20.0\tSKIPPED\tno QEMU\n7.0\t$ a\n1.0\tb\n";

    #[test]
    fn a_record_is_read_whole_or_not_at_all() {
        let record = Record::parse("riscv", TEXT).unwrap();
        assert!(record.state == State::Skipped);
        assert_eq!(record.line(), "xtask riscv: SKIPPED (no QEMU, 12.5 s)");
        assert_eq!(record.steps.len(), 2);
        for text in [
            "",
            "12.5\t20.0\tgreen\tall\n",
            "12.5\t20.0\n",
            "1\t1\tok\tall\nb\n",
        ] {
            assert!(Record::parse("riscv", text).is_none(), "{text}");
        }
    }

    #[test]
    fn the_table_shows_what_was_skipped_and_what_took_long() {
        let text = table(&[Record::parse("riscv", TEXT).unwrap()]);
        assert!(text.contains("riscv    SKIPPED: no QEMU"), "{text}");
        assert!(
            text.contains("7.0  $ a") && !text.contains("1.0  b"),
            "{text}"
        );
    }
}
