//! The variables of a running system: their names, and their values while programs run.
//!
//! [`VariableCatalog`] finds names, and [`NewPrograms`] those of programs that come later. [`Rows`] reads the
//! rows that loops write for this visitor (the values of variables at one tick), and the values of
//! published cells. [`Clients`] gets and sets parameters. The commands `vars`, `plot`, `record` and `view` are
//! made of these.
//!
//! ```no_run
//! use condor_host::control::ControlClient;
//! use condor_host::view::View;
//! use condor_host::watching::{VariableCatalog, Rows};
//!
//! # fn main() -> Result<(), condor_host::error::AnyError> {
//! let directory = condor_host::system::find(None)?;
//! let status = ControlClient::connect(&directory)?.status()?;
//! let mut view = View::open(&directory, status.window_bytes)?;
//! view.join()?;
//! let known = VariableCatalog::all(&view, &status.processors)?;
//! let positions = known.matching(&["*.position".to_owned()])?;
//! let mut rows = Rows::of(&view, &positions, 1)?;
//! loop {
//!     rows.read(|source, row| println!("{source}: tick {}, {} rows lost", row.tick, row.lost))?;
//!     rows.pause()?;
//! }
//! # }
//! ```

mod catalog;
mod clients;
mod new_programs;
mod present;
mod rows;
mod types;

pub use catalog::{CatalogEntry, VariableCatalog};
pub use clients::{Clients, SetError};
pub use new_programs::NewPrograms;
pub use present::{patience, present, silence};
pub use rows::{Change, RowField, RowSource, Rows, SourceRow};
pub use types::Type;
pub use types::float;

/// Returns the loops and cells to which the variables `ones` belong, as `processor:loop` or `processor:cell`, each
/// once.
pub fn places(ones: &[CatalogEntry]) -> std::collections::BTreeSet<String> {
    ones.iter().map(CatalogEntry::place).collect()
}
