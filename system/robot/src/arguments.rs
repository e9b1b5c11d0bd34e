//! The arguments of the programs that make and read recordings.

use condor_rt::{Machine, ShortText};

use crate::failure::Failure;

/// The file and the ticks that a servo processor records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Record<'m> {
    pub(crate) file: &'m str,
    pub(crate) ticks: u32,
}

/// The files that a replay reads and writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Replay<'m> {
    pub(crate) from: &'m str,
    pub(crate) to: Option<&'m str>,
}

impl<'m> Record<'m> {
    pub(crate) fn of<M: Machine>(machine: &'m M) -> Result<Option<Self>, Failure> {
        Self::parse(all(machine))
    }

    fn parse(arguments: impl Iterator<Item = &'m str>) -> Result<Option<Self>, Failure> {
        let (mut file, mut ticks) = (None, None);
        for argument in arguments {
            let wrong = || Failure::Argument {
                argument: ShortText::of(&argument),
                known: "record=FILE, ticks=COUNT above 0",
            };
            match argument.split_once('=') {
                Some(("record", name)) if !name.is_empty() => file = Some(name),
                Some(("ticks", number)) => {
                    let number = number.parse().ok().filter(|&number: &u32| number > 0);
                    ticks = Some(number.ok_or_else(wrong)?);
                }
                _ => return Err(wrong()),
            }
        }
        let ticks = ticks.unwrap_or(u32::MAX);
        Ok(file.map(|file| Self { file, ticks }))
    }
}

impl<'m> Replay<'m> {
    pub(crate) fn of<M: Machine>(machine: &'m M) -> Result<Self, Failure> {
        Self::parse(all(machine))
    }

    fn parse(arguments: impl Iterator<Item = &'m str>) -> Result<Self, Failure> {
        const KNOWN: &str = "from=FILE, to=FILE";
        let (mut from, mut to) = (None, None);
        for argument in arguments {
            match argument.split_once('=') {
                Some(("from", name)) if !name.is_empty() => from = Some(name),
                Some(("to", name)) if !name.is_empty() => to = Some(name),
                _ => {
                    return Err(Failure::Argument {
                        argument: ShortText::of(&argument),
                        known: KNOWN,
                    });
                }
            }
        }
        let from = from.ok_or(Failure::NoArgument {
            wanted: "from=FILE",
        })?;
        Ok(Self { from, to })
    }
}

fn all<M: Machine>(machine: &M) -> impl Iterator<Item = &str> {
    (0..).map_while(|index| machine.argument(index))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_has_a_name_and_may_have_an_end() {
        let parse = |arguments: &[&'static str]| Record::parse(arguments.iter().copied());
        assert_eq!(parse(&[]), Ok(None));
        let (file, ticks) = ("a.rec", u32::MAX);
        assert_eq!(parse(&["record=a.rec"]), Ok(Some(Record { file, ticks })));
        let ticks = 7;
        let both = parse(&["ticks=7", "record=a.rec"]);
        assert_eq!(both, Ok(Some(Record { file, ticks })));
        for wrong in ["record", "record=", "ticks=0", "ticks=-1", "from=a"] {
            let refused = parse(&["record=a.rec", wrong]);
            assert!(
                matches!(refused, Err(Failure::Argument { .. })),
                "{refused:?}"
            );
        }
    }

    #[test]
    fn a_replay_needs_a_recording() {
        let parse = |arguments: &[&'static str]| Replay::parse(arguments.iter().copied());
        assert!(matches!(parse(&[]), Err(Failure::NoArgument { .. })));
        let (from, to) = ("a", None);
        assert_eq!(parse(&["from=a"]), Ok(Replay { from, to }));
        let to = Some("b");
        assert_eq!(parse(&["from=a", "to=b"]), Ok(Replay { from, to }));
        assert!(parse(&["from=a", "b"]).is_err());
    }
}
