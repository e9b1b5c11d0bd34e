//! `condor export`.

mod curve;
mod svg;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{ArgGroup, Args};
use condor_platform::linux::WholeFile;

use super::number::duration;
use crate::recording::{Column, RecordingReader};
use condor_host::error::{AnyError, NamedFileError, tell};
use condor_host::watching::{Type, float};
use curve::Curve;

/// The arguments of `condor export`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("output").args(["csv", "svg"]).required(true).multiple(true)))]
pub(crate) struct Export {
    /// The file of the recording
    file: PathBuf,
    /// The names of variables, or patterns with `*` and `?`, as for `vars watch`; by default all
    names: Vec<String>,
    /// Writes a table (CSV) of all rows into this file
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Draws the variables over time into this file (SVG)
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Skips this much time at the beginning of the recording, such as 2.5s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    from: Option<Duration>,
    /// Ends this much time after the first message, such as 10s
    #[arg(long, value_name = "TIME", value_parser = duration)]
    to: Option<Duration>,
}

impl Export {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        for target in self.csv.iter().chain(&self.svg) {
            check_target(&self.file, target)?;
        }
        let reader = RecordingReader::open(&self.file)?;
        let columns = reader.columns(&self.names)?;
        let labels = reader.labels(&columns);
        let columns = Columns::of(&reader, &columns, labels);
        let span = self.span(reader.span());
        if let Some(path) = &self.csv {
            let mut rows = 0;
            written(path, |out| {
                rows = table(&reader, &columns, span.clone(), out)?;
                Ok(())
            })?;
            let (path, count) = (path.display(), columns.all.len());
            tell(format_args!("{path}: {rows} rows, variables: {count}"));
        }
        if let Some(path) = &self.svg {
            let curves = curves(&reader, &columns, span.clone())?;
            let title = self.file.file_name().unwrap_or_default().to_string_lossy();
            let begin_s = seconds(span.start - reader.span().start);
            let drawing = svg::draw(
                &title,
                begin_s..begin_s + seconds(span.end - span.start),
                &curves,
            );
            written(path, |out| Ok(out.write_all(drawing.as_bytes())?))?;
            let (path, count) = (path.display(), columns.all.len());
            tell(format_args!("{path}: a drawing, variables: {count}"));
        }
        Ok(())
    }

    /// Returns the chosen part of the time of the recording.
    fn span(&self, all: Range<u64>) -> Range<u64> {
        let at = |time: Duration| {
            let ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
            all.start.saturating_add(ns).min(all.end)
        };
        let start = self.from.map_or(all.start, at);
        start..self.to.map_or(all.end, at).max(start)
    }
}

/// Writes a file as a whole: it has its name when it is complete, and replaces a former one then. A
/// device or a pipe is written as it is.
pub(super) fn written(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), AnyError>,
) -> Result<(), AnyError> {
    if path.metadata().is_ok_and(|it| !it.is_file()) {
        let file = File::create(path).map_err(NamedFileError::at("open", path))?;
        return flushed(path, file, write);
    }
    let mut file = WholeFile::create(path).map_err(NamedFileError::at("make", path))?;
    flushed(path, &mut file, write)?;
    Ok(file.finish().map_err(NamedFileError::at("write", path))?)
}

fn flushed(
    path: &Path,
    file: impl Write,
    write: impl FnOnce(&mut dyn Write) -> Result<(), AnyError>,
) -> Result<(), AnyError> {
    let mut out = BufWriter::new(file);
    write(&mut out)?;
    Ok(out.flush().map_err(NamedFileError::at("write", path))?)
}

/// Refuses to replace the recording by what is made of it.
fn check_target(recording: &Path, target: &Path) -> Result<(), AnyError> {
    let inode = |path: &Path| {
        let metadata = path.metadata().ok()?;
        Some((metadata.dev(), metadata.ino()))
    };
    let own = inode(recording);
    if own.is_some() && own == inode(target) {
        return Err(format!(
            "{} is the recording itself; name another file",
            target.display()
        )
        .into());
    }
    Ok(())
}

/// The chosen variables.
struct Columns<'r> {
    all: Vec<(String, &'r Column, Type)>,
    /// The columns of each source: their places in `all`, and the fields of a row.
    of_sources: BTreeMap<usize, Vec<(usize, usize)>>,
    sources: Vec<String>,
}

impl<'r> Columns<'r> {
    fn of(reader: &'r RecordingReader, columns: &[&'r Column], labels: Vec<String>) -> Self {
        let mut of_sources = BTreeMap::<_, Vec<_>>::new();
        let mut all = Vec::new();
        for (place, (column, label)) in columns.iter().zip(labels).enumerate() {
            let of_source = of_sources.entry(column.source).or_default();
            of_source.push((place, column.field));
            let variable = &column.variable;
            let of_type = Type {
                kind: variable.kind,
                labels: variable.labels.clone(),
            };
            all.push((label, *column, of_type));
        }
        let sources = reader.sources().iter();
        Self {
            all,
            of_sources,
            sources: sources
                .map(|it| format!("{}:{}", it.processor, it.owner))
                .collect(),
        }
    }

    fn chosen(&self) -> Vec<usize> {
        self.of_sources.keys().copied().collect()
    }
}

/// Writes a line for each row, in the order of time.
fn table(
    reader: &RecordingReader,
    columns: &Columns<'_>,
    span: Range<u64>,
    out: &mut dyn Write,
) -> Result<u64, AnyError> {
    let titles = columns.all.iter().map(|(label, column, _)| {
        let unit = &column.variable.unit;
        let title = if unit.is_empty() {
            label.clone()
        } else {
            format!("{label} [{unit}]")
        };
        quoted(&title)
    });
    let head = ["time_ns", "loop", "tick", "lost"].map(String::from);
    let titles: Vec<_> = head.into_iter().chain(titles).collect();
    writeln!(out, "{}", titles.join(","))?;
    let mut cells = vec![String::new(); columns.all.len()];
    let mut rows = 0;
    reader.rows(&columns.chosen(), span, |source, at_ns, row| {
        cells.iter_mut().for_each(String::clear);
        for (place, field) in columns.of_sources.get(&source).into_iter().flatten() {
            if let (Some(cell), Some((.., of_type)), Some(value)) = (
                cells.get_mut(*place),
                columns.all.get(*place),
                row.value(*field),
            ) {
                *cell = quoted(&of_type.text(value));
            }
        }
        let owner = columns.sources.get(source).map(|name| quoted(name));
        let (owner, head) = (owner.unwrap_or_default(), row.head());
        let (tick, lost) = (head.tick, head.lost);
        rows += 1;
        writeln!(out, "{at_ns},{owner},{tick},{lost},{}", cells.join(","))?;
        Ok::<_, AnyError>(())
    })?;
    Ok(rows)
}

/// Returns a cell of a table, in quotes if it needs them.
pub(super) fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// Reads the curves of the chosen variables; times are seconds after the first message.
fn curves(
    reader: &RecordingReader,
    columns: &Columns<'_>,
    span: Range<u64>,
) -> Result<Vec<Curve>, AnyError> {
    let begin = reader.span().start;
    let shown = seconds(span.start - begin)..seconds(span.end - begin);
    let curve = |(label, column, _): &(String, &Column, _)| {
        Curve::new(label, &column.variable.unit, shown.clone())
    };
    let mut curves: Vec<_> = columns.all.iter().map(curve).collect();
    reader.rows(&columns.chosen(), span, |source, at_ns, row| {
        let at_s = seconds(at_ns - begin);
        for (place, field) in columns.of_sources.get(&source).into_iter().flatten() {
            if let (Some(curve), Some(value)) = (curves.get_mut(*place), row.value(*field)) {
                if row.head().lost > 0 {
                    curve.interrupt();
                }
                curve.add(at_s, float(value));
            }
        }
        Ok::<_, AnyError>(())
    })?;
    Ok(curves)
}

#[expect(
    clippy::cast_precision_loss,
    reason = "a drawing has some thousand pixels"
)]
const fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_if_they_must_be() {
        assert_eq!(quoted("a:kp [N/rad]"), "a:kp [N/rad]");
        assert_eq!(quoted("a,\"b\""), "\"a,\"\"b\"\"\"");
    }

    #[test]
    fn a_file_that_cannot_be_written_stays_as_it_is() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run.csv");
        std::fs::write(&path, "former").unwrap();
        let failed = written(&path, |out| {
            out.write_all(b"half")?;
            Err("damaged".into())
        });
        assert_eq!(failed.unwrap_err().to_string(), "damaged");
        assert_eq!(std::fs::read(&path).unwrap(), b"former");
        written(&path, |out| Ok(out.write_all(b"whole")?)).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert_eq!(directory.path().read_dir().unwrap().count(), 1);
    }

    #[test]
    fn a_device_stays_one() {
        written(Path::new("/dev/null"), |out| Ok(out.write_all(b"any")?)).unwrap();
        assert!(!Path::new("/dev/null").metadata().unwrap().is_file());
    }

    #[test]
    fn the_recording_is_no_target() {
        let directory = tempfile::tempdir().unwrap();
        let [run, hard, soft, other] =
            ["run", "hard", "soft", "other"].map(|name| directory.path().join(name));
        std::fs::write(&run, "rows").unwrap();
        std::fs::hard_link(&run, &hard).unwrap();
        std::os::unix::fs::symlink(&run, &soft).unwrap();
        for target in [&run, &hard, &soft] {
            assert!(check_target(&run, target).is_err(), "{}", target.display());
        }
        assert!(check_target(&run, &other).is_ok());
    }
}
