//! `condor vectors`.

mod follow;

use std::time::Duration;

use clap::Args;
use serde::Serialize;

use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use crate::counts::{self, Row, table_of_vectors};
use condor_host::error::AnyError;
use condor_host::view::VectorCounts;

#[derive(Debug, Args)]
pub(crate) struct Vectors {
    /// The name or the number of a processor or service; all of them by default
    processor: Option<String>,
    /// Shows each message to the processor as it comes, or to all processors by default; Ctrl-C ends it
    #[arg(long)]
    follow: bool,
    /// Ends following after this time, such as 10s
    #[arg(long = "for", value_name = "TIME", requires = "follow", value_parser = duration)]
    limit: Option<Duration>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    vectors: &'s [Row<VectorCounts>],
}

impl Vectors {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let members = match &self.processor {
            Some(text) => vec![running.member(text)?],
            None if self.follow => running.status.processors.iter().collect(),
            None => running.status.members().collect(),
        };
        if self.follow {
            return follow::follow(&running, &members, self.limit, self.how.json);
        }
        let vectors = counts::vectors(&running.view()?, members)?;
        if self.how.json {
            let system = &running.status.system;
            return print_json(&Answer {
                system,
                vectors: &vectors,
            });
        }
        print(table_of_vectors(&vectors))
    }
}
