//! [`Look`]: fetches counts out of memory.

use std::time::Instant;

use condor_fs::wire::FILES as FILES_VECTOR;

use super::model::{FileServiceState, Model};
use crate::counts::{self, LastLook};
use condor_host::control::ControlClient;
use condor_host::error::AnyError;
use condor_host::plain::plain;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_rt::numbers::FILES;

/// The counts of a running system, and those of the look before.
pub(super) struct Look {
    directory: SystemDirectory,
    view: Option<View>,
    last: LastLook,
    served: Option<(Instant, u32)>,
}

impl Look {
    pub(super) fn new(directory: &SystemDirectory) -> Self {
        Self {
            directory: directory.clone(),
            view: None,
            last: LastLook::default(),
            served: None,
        }
    }

    /// Puts the present counts into the model.
    pub(super) fn look(&mut self, model: &mut Model) {
        if model.gone.is_some() {
            // Its successor may have other windows.
            self.view = None;
        }
        if let Err(error) = self.fetch(model) {
            self.view = None;
            model.blind = Some(plain(&error.to_string()).into_owned());
        } else {
            model.blind = None;
        }
    }

    fn fetch(&mut self, model: &mut Model) -> Result<(), AnyError> {
        let view = match &self.view {
            Some(view) => view,
            None => self.view.insert(open(&self.directory)?),
        };
        let processors = model.members.get(..model.processors);
        let loops = self.last.since(view, processors.unwrap_or_default())?;
        let vectors = counts::vectors(view, &model.members)?;
        let messages = view.post().vector_statistics(FILES, FILES_VECTOR);
        let messages = messages.map_or(0, |counts| counts.handled);
        let now = Instant::now();
        model.served = FileServiceState {
            messages,
            per_second: self.served.and_then(|(then, before)| {
                let seconds = now.duration_since(then).as_secs_f64();
                let more = messages.checked_sub(before)?;
                (seconds > 0.0).then(|| f64::from(more) / seconds)
            }),
        };
        self.served = Some((now, messages));
        (model.loops, model.vectors) = (loops, vectors);
        Ok(())
    }
}

fn open(directory: &SystemDirectory) -> Result<View, AnyError> {
    let status = ControlClient::connect(directory)?.status()?;
    Ok(View::open(directory, status.window_bytes)?)
}
