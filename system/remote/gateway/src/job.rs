//! [`Job`]: a request that waits for its answer.

use condor_remote::wire::{ClientRequest, RemoteRefusal};
use serde_json::Value as Json;
use zenoh::Wait;
use zenoh::query::Query;

/// A request, and the query that it came by.
#[derive(Debug)]
pub(crate) struct Job {
    /// The request that the query contains.
    pub(crate) asked: ClientRequest,
    /// The query to answer.
    pub(crate) query: Query,
}

impl Job {
    /// Answers it.
    pub(crate) fn answer(&self, answer: Result<Json, RemoteRefusal>) {
        match answer {
            Ok(json) => {
                // A client that has gone needs no answer.
                let _ = self
                    .query
                    .reply(self.query.key_expr(), json.to_string())
                    .wait();
            }
            Err(refusal) => self.refuse(&refusal),
        }
    }

    /// Refuses it.
    pub(crate) fn refuse(&self, refusal: &RemoteRefusal) {
        refuse(&self.query, refusal);
    }
}

/// Refuses what a query asks for.
pub(crate) fn refuse(query: &Query, refusal: &RemoteRefusal) {
    let text = serde_json::to_string(refusal).unwrap_or_default();
    // A client that has gone needs no answer.
    let _ = query.reply_err(text).wait();
}
