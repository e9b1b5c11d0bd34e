//! [`WatchedStream`]: streams, with those of their variables that are meant.

use std::io::{Write, stdout};
use std::time::{Duration, Instant};

use condor_remote::{Remote, RemoteError, RemoteMessage, RemoteStream, RowMessage};
use serde_json::{Map, Value as Json, json};

use crate::AnyError;

/// The time for which one stream is waited for before the next one.
const LOOK: Duration = Duration::from_millis(5);

/// A stream with some of its variables.
pub(crate) struct WatchedStream {
    stream: RemoteStream,
    /// Their columns, and their names.
    pub(crate) columns: Vec<(usize, String)>,
    /// The numbers of rows that have come, and of those that were lost.
    pub(crate) rows: u64,
    pub(crate) lost: u64,
}

impl WatchedStream {
    /// Subscribes to the streams that have variables of these names or patterns. A name that begins with `/` is that of
    /// a topic, and means all of its variables.
    pub(crate) fn find(
        remote: &Remote,
        names: &[String],
        timeout: Duration,
    ) -> Result<Vec<Self>, AnyError> {
        let mut found = Vec::new();
        let mut is_known = vec![false; names.len()];
        for topic in remote.topics(timeout)?.iter().filter(|it| it.has_rows) {
            let stream = remote.subscribe(&topic.name, timeout)?;
            let mut columns = Vec::new();
            for (column, variable) in stream.columns().enumerate() {
                let mut is_meant = false;
                for (name, is_known) in names.iter().zip(&mut is_known) {
                    if *name == topic.name || is_like(name, variable) {
                        (is_meant, *is_known) = (true, true);
                    }
                }
                if is_meant {
                    columns.push((column, variable.to_owned()));
                }
            }
            if !columns.is_empty() {
                found.push(Self {
                    stream,
                    columns,
                    rows: 0,
                    lost: 0,
                });
            }
        }
        match names.iter().zip(is_known).find(|(_, is_known)| !is_known) {
            None => Ok(found),
            Some((name, _)) => Err(format!(
                "no stream has the variable `{name}`; the key `variables` of the gateway's configuration says which \
                 are streamed"
            )
            .into()),
        }
    }

    /// The name of the topic.
    pub(crate) fn name(&self) -> &str {
        &self.stream.topic().name
    }

    /// Waits a moment for the next row.
    pub(crate) fn next(&mut self) -> Result<Option<RemoteMessage>, AnyError> {
        let message = self.stream.next(LOOK)?;
        if let Some(message) = &message {
            let lost = self.row(message)?.head().lost + message.lost;
            self.rows += 1;
            self.lost += lost;
        }
        Ok(message)
    }

    /// The row of a message.
    pub(crate) fn row<'m>(
        &'m self,
        message: &'m RemoteMessage,
    ) -> Result<RowMessage<'m>, AnyError> {
        let row = self.stream.row(message)?;
        Ok(row.ok_or_else(|| RemoteError::Strange(self.name().into()))?)
    }
}

/// Prints rows until there were so many, until a time is over, or for ever.
pub(crate) fn print(
    json: bool,
    mut all: Vec<WatchedStream>,
    most: Option<u64>,
    limit: Option<Duration>,
    timeout: Duration,
) -> Result<(), AnyError> {
    let mut out = stdout().lock();
    let begun = Instant::now();
    let mut heard = begun;
    let mut rows = 0;
    while most.is_none_or(|most| rows < most) && limit.is_none_or(|limit| begun.elapsed() < limit) {
        for watched in &mut all {
            let Some(message) = watched.next()? else {
                continue;
            };
            heard = Instant::now();
            rows += 1;
            let row = watched.row(&message)?;
            writeln!(out, "{}", line(json, watched, &row))?;
        }
        if heard.elapsed() >= timeout {
            return Err(format!(
                "no row has come within {timeout:?}; is the loop of the variables running?"
            )
            .into());
        }
    }
    for watched in &all {
        let WatchedStream { rows, lost, .. } = watched;
        eprintln!("{}: {rows} rows, {lost} lost", watched.name());
    }
    Ok(())
}

fn line(json: bool, watched: &WatchedStream, row: &RowMessage<'_>) -> String {
    let (head, name) = (row.head(), watched.name());
    let columns = watched.columns.iter();
    let values = columns.filter_map(|(column, name)| Some((name, row.value(*column)?.to_string())));
    if json {
        let values: Map<String, Json> = values
            .map(|(name, text)| {
                // A float that is not a number has no JSON.
                let value = serde_json::from_str(&text).unwrap_or(Json::Null);
                (name.clone(), value)
            })
            .collect();
        let released_ns = head.stamp.as_ns();
        return json!({
            "loop": name, "tick": head.tick, "released_ns": released_ns, "lost": head.lost, "values": values,
        })
        .to_string();
    }
    let values: Vec<_> = values
        .map(|(name, text)| format!("{name}={text}"))
        .collect();
    format!("{name} {} {}", head.tick, values.join(" "))
}

/// Returns whether a name is like a pattern, in which `*` stands for any characters, and `?` for one.
fn is_like(pattern: &str, name: &str) -> bool {
    let mut rest = pattern.chars();
    match rest.next() {
        None => name.is_empty(),
        Some('*') => name
            .char_indices()
            .map(|(at, _)| at)
            .chain([name.len()])
            .any(|at| is_like(rest.as_str(), &name[at..])),
        Some(letter) => {
            let mut name = name.chars();
            name.next().is_some_and(|it| letter == '?' || letter == it)
                && is_like(rest.as_str(), name.as_str())
        }
    }
}

/// Reads a time of the line, such as 10s or 500ms.
pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let end = text
        .find(|letter: char| letter.is_ascii_alphabetic())
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let scale = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let scale = scale.into_iter().find(|(name, _)| *name == unit.trim());
    let number = number.trim().parse::<f64>().ok();
    let time = number.zip(scale).map(|(number, (_, scale))| number * scale);
    let time = time.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.ok_or_else(|| "write a time such as 10s or 500ms".into())
}

/// Reads a number of seconds of the line.
pub(crate) fn seconds(text: &str) -> Result<Duration, String> {
    let number = text.parse().ok();
    let time = number.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    time.ok_or_else(|| "write a number of seconds such as 10 or 0.5".into())
}

#[cfg(test)]
mod tests {
    use super::{Duration, duration, is_like, seconds};

    #[test]
    fn a_time_is_a_number_of_seconds() {
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        for text in ["nan", "-1", "1e30", "5s", ""] {
            assert!(seconds(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_pattern_stands_for_names() {
        for (pattern, name, is) in [
            ("a.b", "a.b", true),
            ("a.b", "a.bc", false),
            ("*", "", true),
            ("index.*.kp", "index.proximal-flexor.gains.kp", true),
            ("index.*.kp", "index.proximal-flexor.gains.kpp", false),
            ("a?", "aé", true),
            ("a?", "a", false),
            ("*a*b", "xaabb", true),
        ] {
            assert_eq!(is_like(pattern, name), is, "{pattern} {name}");
        }
    }

    #[test]
    fn times_have_units() {
        assert_eq!(duration("10s"), Ok(Duration::from_secs(10)));
        assert_eq!(duration("1.5 ms"), Ok(Duration::from_micros(1500)));
        for wrong in ["10", "s", "-1s", "1 year", "1e99h"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }
}
