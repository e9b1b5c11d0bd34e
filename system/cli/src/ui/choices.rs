//! [`Choices`]: the choices of a person, kept until the user interface shows the same system again.

use std::io;
use std::path::Path;

use condor_platform::linux::WholeFile;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use super::layout::name;
use super::log::Level;
use super::model::{Model, Page};
use crate::plot::PlotChoices;

/// The name of the file in the directory of the system.
pub(super) const FILE: &str = "ui";
/// The first line of the file; JSON follows.
const BEGIN: &str = "condor ui 1";

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Choices {
    /// The names of the page in focus, and of the window that was in focus last.
    focus: String,
    front: String,
    alone: bool,
    log_from: Level,
    plots: PlotChoices,
}

/// Writes the choices into a file.
pub(super) fn keep(model: &Model, path: &Path) -> io::Result<()> {
    let choices = Choices {
        focus: name(model, model.focus).into(),
        front: name(model, model.front).into(),
        alone: model.zoomed,
        log_from: model.least,
        plots: model.plot.choices(),
    };
    let choices = serde_json::to_string(&choices)?;
    WholeFile::write(path, format!("{BEGIN}\n{choices}\n").as_bytes())
}

/// Takes over the choices in a file, if there is one. If it cannot be read, the log says so.
pub(super) fn restore(model: &mut Model, path: &Path) {
    let taken = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return,
        Err(error) => Err(error.to_string()),
        Ok(text) => read(&text).and_then(|choices| take(model, choices)),
    };
    if let Err(why) = taken {
        let (now, path) = (Timestamp::now(), path.display());
        model.own_line = Some(format!(
            "{now:.6} ui: warning: layout and plots are not as they were: {path}: {why}"
        ));
    }
}

fn read(text: &str) -> Result<Choices, String> {
    let (begin, choices) = text.split_once('\n').unwrap_or((text, ""));
    if begin != BEGIN {
        let begin: String = begin.chars().take(2 * BEGIN.len()).collect();
        return Err(format!("it begins with `{begin}`, not with `{BEGIN}`"));
    }
    serde_json::from_str(choices).map_err(|error| error.to_string())
}

fn take(model: &mut Model, choices: Choices) -> Result<(), String> {
    model.plot.restore(choices.plots)?;
    let find = |name_of: &str| model.pages().find(|page| name(model, *page) == name_of);
    let (focus, front) = (find(&choices.focus), find(&choices.front));
    // A tool has no window any more.
    model.focus = focus.unwrap_or(model.focus);
    model.front = front
        .filter(|page| matches!(page, Page::Window(_)))
        .unwrap_or(model.front);
    (model.zoomed, model.least) = (choices.alone, choices.log_from);
    Ok(())
}
