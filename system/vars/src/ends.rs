//! [`Ends`]: the two ends of a [`Selections`].

use condor_mbox::{Allocator, Exclusion, MemoryWindow, Processor, Region};

use crate::catalog::{self, Body, Catalog, CatalogError};
use crate::sampler::Sampler;
use crate::selections::{MOST_WATCHERS, Selections};
use crate::server::VariableServer;

/// The result of [`Selections::open`]: the server that answers requests in a message handler, and the sampler that the
/// loop calls.
pub type Ends<'e, W, X, const N: usize> = (VariableServer<'e, W, X, N>, Sampler<'e, W, N>);

/// The settings of a loop's table, for [`Selections::open`]: the rate of the loop, and the room for
/// watchers.
#[derive(Clone, Copy, Debug)]
pub struct VariableSettings {
    /// The rate of the loop as a number of ticks in a number of seconds, such as `(400, 1)`.
    pub rate: (u32, u32),
    /// The number of rows of all variables for which each watcher's ring has room, rounded up to a
    /// power of two. There is room for half as many rows, but at least 2, that have all parameters, too. If
    /// fewer are selected, there is room for more rows.
    pub rows: u32,
    /// The number of programs that can watch the loop at a time, at most [`MOST_WATCHERS`]. Each
    /// one takes a slot of the table, with its ring.
    pub watchers: u32,
}

impl<const N: usize> Selections<N> {
    /// Makes the table of a loop, through which other programs find the variables and parameters in
    /// `catalog`. The table takes room from `allocator` in `own`, the users' region of the program's
    /// own `data`. Returns the server, for the handler of requests, and the sampler, which the loop
    /// calls in each tick.
    ///
    /// `exclusion` has the critical sections in which the server works. `incarnation` returns the incarnation of a
    /// processor's program, a number that differs for each run of the program, or 0 if none runs. With this function
    /// the server takes slots back from watchers that have died.
    ///
    /// # Errors
    /// Returns [`CatalogError::TooLong`] or [`CatalogError::Block`] if an entry of the catalog is invalid,
    /// [`CatalogError::Initial`] if an initial value is out of bounds, [`CatalogError::TooMany`] if there are
    /// too many watchers, blocks or words of variables, [`CatalogError::Access`] if there is no room for the
    /// table or its memory cannot be accessed.
    pub fn open<'e, W, X>(
        &'e mut self,
        catalog: Catalog<'e>,
        own: &Region<W>,
        allocator: &mut Allocator,
        settings: &VariableSettings,
        exclusion: X,
        incarnation: &'e (dyn Fn(Processor) -> u32 + Sync),
    ) -> Result<Ends<'e, W, X, N>, CatalogError>
    where
        W: MemoryWindow + Clone,
        X: Exclusion,
    {
        *self = Self::new();
        let selections = &*self;
        let at_most = |most, count, what| match count {
            count if count > most => Err(CatalogError::TooMany { what, count, most }),
            _ => Ok(()),
        };
        at_most(MOST_WATCHERS, settings.watchers as usize, "watchers")?;
        at_most(3 * N, catalog.blocks().count(), "blocks of variables")?;
        let shape = catalog.shape(settings.watchers, settings.rows)?;
        let items = |body: &mut Body<'_>| catalog.each(body);
        let (table, offset, table_incarnation) =
            catalog::write(own, allocator, shape, settings.rate, (0, 0), items)?;
        let sampler = Sampler::new(selections, table.clone(), shape, &catalog);
        let server = VariableServer {
            selections,
            table,
            offset,
            table_incarnation,
            shape,
            catalog,
            exclusion,
            incarnation,
        };
        Ok((server, sampler))
    }
}
