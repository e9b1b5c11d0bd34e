//! What the command line asks of a sub-command.

use std::path::PathBuf;

/// The options, for the usage text.
pub(crate) const USAGE: &str = "[--json] [--rounds N] [--quick] [--record] [--pinocchio VENV]";

/// An interval of a median over fewer rounds says nothing.
const LEAST_ROUNDS: usize = 7;

/// The options that every sub-command takes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Options {
    /// Print one JSON object instead of tables.
    pub(crate) json: bool,
    /// How many rounds to play; the sub-command's own number if `None`.
    rounds: Option<usize>,
    /// Write what comes out to `RESULTS.md`, too.
    pub(crate) record: bool,
    /// Take some ten seconds, at the price of wider intervals.
    pub(crate) quick: bool,
    /// The virtual environment with Pinocchio, which `hand` asks for; its own if `None`.
    pub(crate) pinocchio: Option<PathBuf>,
}

impl Options {
    /// How many rounds to play: what was asked for, or the usual number, or that of a quick run.
    pub(crate) fn rounds(&self, usual: usize, quick: usize) -> usize {
        self.rounds
            .unwrap_or(if self.quick { quick } else { usual })
    }

    /// Reads the arguments that follow the sub-command.
    ///
    /// # Errors
    /// The argument that is not understood.
    pub(crate) fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Self, String> {
        let mut options = Self::default();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--json" => options.json = true,
                "--quick" => options.quick = true,
                "--record" => options.record = true,
                "--pinocchio" => {
                    options.pinocchio = Some(arguments.next().ok_or(argument)?.into());
                }
                "--rounds" => {
                    let rounds = arguments.next().and_then(|text| text.parse().ok());
                    options.rounds = Some(rounds.filter(|n| *n >= LEAST_ROUNDS).ok_or(argument)?);
                }
                _ => return Err(argument),
            }
        }
        Ok(options)
    }
}
