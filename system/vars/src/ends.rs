//! [`Ends`]: the two ends of a [`Selections`].

use condor_mbox::{Allocator, Exclusion, MemoryWindow, Processor, Region};

use crate::catalog::{self, Body, Catalog, CatalogError};
use crate::sampler::Sampler;
use crate::selections::Selections;
use crate::server::VariableServer;

/// The two ends of a [`Selections`]: the server for the request handler, and the sampler for the loop.
pub type Ends<'e, W, X, const BLOCKS: usize, const PIECES: usize, const SLOTS: usize> = (
    VariableServer<'e, W, X, PIECES, SLOTS>,
    Sampler<'e, W, BLOCKS, PIECES, SLOTS>,
);

/// The settings of a loop's table.
#[derive(Clone, Copy, Debug)]
pub struct VariableSettings {
    /// The rate of the loop as a number of ticks in a number of seconds, such as `(400, 1)`.
    pub rate: (u32, u32),
    /// The number of rows of all variables for which each watcher's ring has room, rounded up to a
    /// power of two. If fewer variables are selected, there is room for more rows.
    pub rows: u32,
}

impl<const PIECES: usize, const SLOTS: usize> Selections<PIECES, SLOTS> {
    /// Makes the table of a loop in the next of `places`. The table lies in `own`, the users'
    /// region of the program's own `data`. Returns the server for the request handler and the
    /// sampler for the loop.
    ///
    /// `incarnation` returns the incarnation of a processor's program, a number that differs for each
    /// run of it, or 0 if none runs. With it the server takes slots back from watchers that have died.
    /// `BLOCKS` is the greatest number of blocks in the catalog; each parameter counts as one block.
    ///
    /// # Errors
    /// [`CatalogError`] if an entry of the catalog is invalid, an initial value is out of bounds,
    /// there are too many, or there is no room for the table.
    pub fn open<'e, W, X, const BLOCKS: usize>(
        &'e mut self,
        catalog: Catalog<'e>,
        own: &Region<W>,
        places: &mut Allocator,
        settings: &VariableSettings,
        exclusion: X,
        incarnation: &'e (dyn Fn(Processor) -> u32 + Sync),
    ) -> Result<Ends<'e, W, X, BLOCKS, PIECES, SLOTS>, CatalogError>
    where
        W: MemoryWindow + Clone,
        X: Exclusion,
    {
        *self = Self::new();
        let desk = &*self;
        let shape = catalog.shape(SLOTS as u32, settings.rows)?;
        let mut blocks = heapless::Vec::new();
        for block in catalog.blocks() {
            blocks
                .push(block.words())
                .map_err(|_| CatalogError::TooMany {
                    what: "blocks of variables",
                    count: catalog.blocks().count(),
                    most: BLOCKS,
                })?;
        }
        let items = |body: &mut Body<'_>| catalog.each(body);
        let (table, offset, table_incarnation) =
            catalog::write(own, places, shape, settings.rate, (0, 0), items)?;
        let sampler = Sampler::new(desk, table.clone(), shape, blocks, catalog.params());
        let server = VariableServer {
            desk,
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
