//! The processors of a description, and whether their programs are there.

use std::collections::{BTreeSet, HashMap};

use condor_platform::linux::open_regular;
use condor_rt::numbers::PROGRAMS;
use condor_toml::{Keys, Spanned, WholeNumber, suggest};

use super::{Own, Restarts, name};
use crate::description::{
    DeclaredLoop, MayAsk, OnFailure, ProcessorEntry, ProgramEntry, response_times_us,
};
use crate::extension::{Extension, FoundProcessor};
use crate::paths::{beside, find_program};

type Number = WholeNumber<u8, { *PROGRAMS.start() as i64 }, { *PROGRAMS.end() as i64 }>;

/// The keys that all processors have; some may be missing if the processor is wrong.
pub(super) struct Common {
    number: Option<Spanned<Number>>,
    name: Option<Spanned<String>>,
    program: Option<ProgramEntry>,
    arguments: Vec<String>,
    headless: Vec<String>,
    kind: &'static str,
    runs_here: bool,
    on_failure: OnFailure,
    restarts: u32,
    stall_seconds: u32,
    hold_exceptions: Option<bool>,
    float_exceptions: Option<bool>,
    loop_times_us: Vec<u32>,
    servo_loops: Vec<DeclaredLoop>,
    may_ask: Vec<MayAsk>,
    serves: Option<Spanned<Vec<String>>>,
}

impl Common {
    /// Returns the number of the processor, and the parts of the robot that it serves, if it names some.
    pub(super) fn served(&self) -> Option<(u8, &Spanned<Vec<String>>)> {
        Some((self.number.as_ref()?.get_ref().0, self.serves.as_ref()?))
    }

    pub(super) fn whole(self) -> Option<ProcessorEntry> {
        Some(ProcessorEntry {
            number: self.number?.get_ref().0,
            name: self.name?.into_inner(),
            program: self.program?,
            arguments: self.arguments,
            headless: self.headless,
            kind: self.kind,
            runs_here: self.runs_here,
            on_failure: self.on_failure,
            restarts: self.restarts,
            stall_seconds: self.stall_seconds,
            hold_exceptions: self.hold_exceptions,
            float_exceptions: self.float_exceptions.unwrap_or_default(),
            loop_times_us: self.loop_times_us,
            servo_loops: self.servo_loops,
            may_ask: self.may_ask,
            serves: self.serves.map(Spanned::into_inner).unwrap_or_default(),
        })
    }
}

/// A processor, and what is left for the extension of this place.
pub(super) type Read<'a, 't> = (Common, usize, FoundProcessor<'a, 't>);

pub(super) fn read<'a, 't>(
    mut keys: Keys<'a, 't>,
    extensions: &[&'static dyn Extension],
    own: &Own<'_>,
) -> Read<'a, 't> {
    let number: Option<Spanned<Number>> = keys.need("number", "a whole number from 0 to 11");
    let name = name(&mut keys);
    let program: Option<Spanned<String>> =
        keys.need("program", "\"self\", or the path of a program");
    let arguments: Option<Spanned<Vec<String>>> = keys.get("arguments");
    let kinds = extensions.iter().enumerate();
    let kinds = kinds.filter_map(|(place, it)| Some((it.kind()?, (place, it.runs_here()))));
    let kinds: Vec<_> = kinds.collect();
    let (place, runs_here) = keys.word("kind", &kinds).unwrap_or((0, true));
    let kind = extensions.get(place).and_then(|it| it.kind());
    let on_failure = keys.word(
        "on_failure",
        &[
            ("restart", OnFailure::Restart),
            ("stop", OnFailure::Stop),
            ("leave", OnFailure::Leave),
        ],
    );
    let restarts: Option<Restarts> = keys.get("restarts");
    let stall_seconds: Option<WholeNumber<_, 0, 86400>> = keys.get("stall_seconds");
    let hold_exceptions = keys.get("hold_exceptions");
    let float_exceptions = keys.get("float_exceptions");
    let headless = keys.get("headless");
    let may_ask = keys.get("may_ask");
    let serves = keys.get("serves");
    let loop_times_us = loop_times(&mut keys);
    let servo_loops = servo_loops(&mut keys);
    let entry = program.as_ref().and_then(|program| {
        if runs_here {
            self::program(&keys, program, arguments.as_ref(), own)
        } else {
            file(&keys, program, own)
        }
    });
    let arguments = arguments.unwrap_or_else(|| Spanned::new(keys.span(), Vec::new()));
    let file = match (&entry, program) {
        (Some(ProgramEntry::File(path)), Some(program)) => {
            Some(Spanned::new(program.span(), path.clone()))
        }
        _ => None,
    };
    let found = FoundProcessor {
        number: number.as_ref().map(|number| number.get_ref().0),
        keys,
        program: file,
        arguments: arguments.clone(),
    };
    let common = Common {
        number,
        name,
        program: entry,
        arguments: arguments.into_inner(),
        headless: headless.unwrap_or_default(),
        kind: kind.unwrap_or_default(),
        runs_here,
        on_failure: on_failure.unwrap_or(OnFailure::Restart),
        restarts: restarts.map_or(10, |restarts| restarts.0),
        stall_seconds: stall_seconds.map_or(5, |seconds| seconds.0),
        hold_exceptions,
        float_exceptions,
        loop_times_us,
        servo_loops,
        may_ask: may_ask.unwrap_or_default(),
        serves,
    };
    (common, place, found)
}

fn loop_times(keys: &mut Keys<'_, '_>) -> Vec<u32> {
    type Time = WholeNumber<u32, 0, 10_000_000>;
    let times: Option<Spanned<Vec<Time>>> = keys.get("loop_times_us");
    let Some(times) = times else {
        return Vec::new();
    };
    let most = condor_clock::LOOPS;
    if times.get_ref().len() > most {
        let count = times.get_ref().len();
        let problem =
            format!("a program has at most {most} servo loops, but here are {count} times");
        keys.wrong(&times.span(), problem);
    }
    times.into_inner().into_iter().map(|time| time.0).collect()
}

/// Reads the servo loops that a processor declares, and checks that they end in time.
fn servo_loops(keys: &mut Keys<'_, '_>) -> Vec<DeclaredLoop> {
    let Some(loops) = keys.get::<Spanned<Vec<DeclaredLoop>>>("servo_loops") else {
        return Vec::new();
    };
    let (span, loops) = (loops.span(), loops.into_inner());
    let (count, most) = (loops.len(), condor_clock::LOOPS);
    if count > most {
        let problem = format!("a program has at most {most} servo loops, but here are {count}");
        keys.wrong(&span, problem);
    }
    if let Some(one) = loops.iter().find(|one| one.hz == 0) {
        let problem = format!("`{}` has the rate 0 Hz; a loop has at least 1 Hz", one.name);
        keys.wrong(&span, problem);
        return loops;
    }
    let mut late = loops.iter().zip(response_times_us(&loops));
    if let Some((one, _)) = late.find(|(_, response)| response.is_none()) {
        let period_us = 1_000_000 / one.hz;
        let (name, worst_us, blocked_us) = (&one.name, one.worst_us, one.blocked_us);
        let faster = loops.iter().filter(|other| other.hz > one.hz);
        let share = |other: &DeclaredLoop| 1e-4 * f64::from(other.worst_us) * f64::from(other.hz);
        let taken: f64 = faster.map(share).sum();
        let problem = format!(
            "`{name}` may end later than its period of {period_us} µs: it runs for up to {worst_us} µs, is blocked for up to \
             {blocked_us} µs, and faster loops take {taken:.1} % of the time; shorten runs, or lower the rate of `{name}` \
             or of a faster loop"
        );
        keys.wrong(&span, problem);
    }
    loops
}

/// The names of services, which commands accept in the place of a processor's name.
const SERVICES: [&str; 3] = ["files", "terminals", "supervisor"];

pub(super) fn check(top: &Keys<'_, '_>, all: &[Read<'_, '_>], extensions: &[&dyn Extension]) {
    let all: Vec<_> = all.iter().map(|(common, ..)| common).collect();
    let of_extensions = extensions.iter().filter_map(|extension| extension.table());
    let services: Vec<_> = SERVICES.into_iter().chain(of_extensions).collect();
    let numbers = all.iter().filter_map(|one| one.number.as_ref());
    let taken: BTreeSet<u8> = numbers.map(|number| number.get_ref().0).collect();
    let free = PROGRAMS.filter(|number| !taken.contains(number));
    let free: Vec<_> = free.map(|number| number.to_string()).collect();
    let free = match free.join(", ") {
        none if none.is_empty() => "all numbers are taken".into(),
        free => format!("these numbers are free: {free}"),
    };
    let (mut names, mut numbers) = (HashMap::new(), HashMap::new());
    for one in &all {
        if let Some(name) = &one.name {
            if services.contains(&name.get_ref().as_str()) {
                let problem = format!("`{name}` is the name of a service; choose another name");
                top.wrong(&name.span(), problem);
            }
            let first = *names.entry(name.get_ref()).or_insert(name.span().start);
            if first != name.span().start {
                let line = top.line(first);
                let problem = format!(
                    "the processor in line {line} has the name `{name}`, too; choose another name"
                );
                top.wrong(&name.span(), problem);
            }
        }
        if let Some(number) = &one.number {
            let value = number.get_ref().0;
            let first = *numbers.entry(value).or_insert(number.span().start);
            if first != number.span().start {
                let line = top.line(first);
                let problem =
                    format!("the processor in line {line} has the number {value}, too; {free}");
                top.wrong(&number.span(), problem);
            }
        }
    }
}

/// The file of a program that does not run on this machine.
fn file(keys: &Keys<'_, '_>, program: &Spanned<String>, own: &Own<'_>) -> Option<ProgramEntry> {
    if program.get_ref() == "self" {
        let problem =
            "`self` is a program for this machine; name a file that this processor can run";
        keys.wrong(&program.span(), problem);
        return None;
    }
    let path = beside(own.file, program.get_ref());
    if let Err(error) = open_regular(&path) {
        let problem = format!("cannot read {}: {error}", path.display());
        keys.wrong(&program.span(), problem);
    }
    Some(ProgramEntry::File(path))
}

fn program(
    keys: &Keys<'_, '_>,
    program: &Spanned<String>,
    arguments: Option<&Spanned<Vec<String>>>,
    own: &Own<'_>,
) -> Option<ProgramEntry> {
    if program.get_ref() != "self" {
        return match find_program(own.file, program.get_ref()) {
            Ok(path) => Some(ProgramEntry::File(path)),
            Err(problem) => {
                keys.wrong(&program.span(), problem);
                None
            }
        };
    }
    let known = own.application.programs();
    let first =
        arguments.and_then(|arguments| Some((arguments.span(), arguments.get_ref().first()?)));
    let (span, problem) = match first {
        None => {
            let known = suggest("", &known);
            let problem = format!(
                "`arguments` must begin with the name of a program that this binary contains; {known}"
            );
            (program.span(), problem)
        }
        Some((_, word)) if known.contains(&word.as_str()) => return Some(ProgramEntry::Own),
        Some((span, word)) => {
            let known = suggest(word, &known);
            let problem = format!("this binary contains no program `{word}`; {known}");
            (span, problem)
        }
    };
    keys.wrong(&span, problem);
    None
}
