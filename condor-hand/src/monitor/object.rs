use condor_mbox::{
    AccessError, Exclusion, MemoryWindow, Published, Region, StaticMemory, StaticWindow,
};

use super::handler::{MonitorHandler, MonitorPlaces};
use super::ring::{MonitorError, Ring};
use super::selection::{MASK_WORDS, Selection};
use super::variable::Variable;

/// A monitor that answers messages: memory that no other processor reaches, through which its
/// [`MonitorHandler`] hands selections to its [`Monitor`] in the servo loop.
#[derive(Debug)]
pub struct MonitorObject {
    pub(super) words: StaticMemory<16>,
    asked: StaticMemory<{ Published::<Asked>::BYTES as usize / 4 }>,
}

/// The number of a selection, every which tick, and its mask.
pub(super) type Asked = [u32; 2 + MASK_WORDS];

/// Words by byte offset.
pub(super) mod word {
    /// The number of the last selection; stored after the selection.
    pub(in super::super) const NUMBER: u32 = 0;
    /// 1 while a handler is at work.
    pub(in super::super) const DESK: u32 = 4;
}

impl MonitorObject {
    /// An object of which nothing has been asked.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: StaticMemory::new(),
            asked: StaticMemory::new(),
        }
    }

    /// The two ends: for the background and for the servo loop, which writes rows of at most `columns`
    /// values. `region` is the users' region of the processor's own `data`.
    ///
    /// # Errors
    /// See [`MonitorError`].
    pub fn split<W: MemoryWindow + Clone, X: Exclusion>(
        &mut self,
        region: &Region<W>,
        places: MonitorPlaces,
        exclusion: X,
        servo_hz: u32,
        variables: impl Iterator<Item = Variable> + Clone,
        columns: u32,
    ) -> Result<(MonitorHandler<'_, W, X>, Monitor<'_, W>), MonitorError> {
        let ring = Ring::new(places.ring(region)?, servo_hz, variables, columns)?;
        let capacity = ring.capacity();
        let this = &*self;
        let monitor = Monitor {
            object: this,
            words: this.words(),
            ring,
            number: this.words().word(word::NUMBER)?,
            selection: Selection::NOTHING,
            wait: 0,
            ticks: 0,
        };
        let handler = MonitorHandler::new(this, region.clone(), places, exclusion, capacity);
        Ok((handler, monitor))
    }

    pub(super) fn words(&self) -> Region<StaticWindow<'_>> {
        Region::whole(self.words.window())
    }

    pub(super) fn asked(&self) -> (Published<Asked>, StaticWindow<'_>) {
        (Published::at(0), self.asked.window())
    }
}

impl Default for MonitorObject {
    fn default() -> Self {
        Self::new()
    }
}

/// The end of a [`MonitorObject`] in the servo loop.
#[derive(Debug)]
pub struct Monitor<'o, W> {
    object: &'o MonitorObject,
    words: Region<StaticWindow<'o>>,
    ring: Ring<W>,
    number: u32,
    selection: Selection,
    /// Ticks until the next row.
    wait: u32,
    ticks: u32,
}

impl<W: MemoryWindow> Monitor<'_, W> {
    /// One tick: takes over a new selection, and writes a row if one is due. `value` gives the word of
    /// a variable, and is asked for those of the row alone.
    ///
    /// # Errors
    /// As [`MemoryWindow::store`]; then the tick has no row.
    #[inline]
    pub fn tick(&mut self, value: impl FnMut(usize) -> u32) -> Result<(), AccessError> {
        let tick = self.ticks;
        self.ticks = tick.wrapping_add(1);
        // Pairs with the handler's store, after the selection.
        if self.words.word(word::NUMBER)? != self.number {
            self.change()?;
        }
        if let Some(wait) = self.wait.checked_sub(1) {
            self.wait = wait;
            return Ok(());
        }
        if self.selection.mask == [0; MASK_WORDS] {
            return Ok(());
        }
        self.wait = self.selection.every.saturating_sub(1);
        let values = self.selection.variables().map(value);
        self.ring.write(tick, &self.selection, values)
    }

    /// What is selected now.
    #[must_use]
    pub const fn selection(&self) -> &Selection {
        &self.selection
    }

    #[cold]
    fn change(&mut self) -> Result<(), AccessError> {
        let (cell, window) = self.object.asked();
        // If it cannot be read whole, the next tick looks again.
        if let Ok(latest) = cell.subscriber(window)?.read() {
            let [number, every, mask @ ..] = latest.value;
            self.number = number;
            self.selection = Selection { every, mask };
            self.wait = 0;
            self.ring.announce(number, &self.selection)?;
        }
        Ok(())
    }
}
