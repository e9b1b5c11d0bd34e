//! The variables of a processor: the tables of its loops and of its described cells.

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Messenger, Processor};
use condor_rt::objects::ObjectKind;
use condor_vars::{VARS, VariableClient, VariableTable, VariableTableError};

use super::{Post, View, ViewError};

/// The table in which a program describes the variables of one loop, or the fields of one published cell.
#[derive(Debug)]
pub struct Variables {
    /// The name of the loop or the cell.
    pub name: String,
    /// The table, or the reason why it cannot be read.
    pub table: Result<VariableTable<LinuxWindow>, VariableTableError>,
}

impl View {
    /// Opens the tables of variables of `processor`: one for each loop that shows variables, and one for each published
    /// cell whose fields are described.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be read, [`ViewError::Version`] if the object table has another version.
    pub fn variables(&self, processor: Processor) -> Result<Vec<Variables>, ViewError> {
        let region = self.region(processor)?;
        let entries = self.objects(processor, ObjectKind::Variables)?.into_iter();
        Ok(entries
            .map(|entry| Variables {
                name: entry.name.as_str().to_owned(),
                table: VariableTable::open(&region, entry.offset),
            })
            .collect())
    }

    /// Makes a client for the loops of `processor`. It asks them for rows, which are the values of variables at one
    /// release, and sets parameters. The view must have [joined](Self::join) before the first request.
    ///
    /// Each client takes a block of the visitor's own memory, which is never returned.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if the visitor's own memory cannot be accessed; [`ViewError::Memory`]
    /// if there is no room.
    pub fn client(
        &self,
        processor: Processor,
    ) -> Result<VariableClient<'_, Post, LinuxWindow>, ViewError> {
        let me = self.post.number();
        let own = self.region(me)?;
        let allocator = &mut self.allocator.borrow_mut();
        let client = VariableClient::new(&self.post, own, allocator, processor, VARS);
        client.map_err(|source| ViewError::Memory {
            processor: me,
            source,
        })
    }
}
