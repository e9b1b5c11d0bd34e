//! [`Setup`]: a program says what it does.

use core::cell::RefCell;
use core::time::Duration;

use condor_fs::Area;
use condor_mbox::published::Publisher;
use condor_mbox::{self as mbox, AccessError, Clock as _, MemoryWindow, Messenger as _};
use condor_mbox::{Places, Published, Region, Vector, Waiting};
use condor_mos::{Loops, Overrun, Rate};
use condor_tty::{Terminal, Vectors};
use heapless::Vec;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::directory::{Directory, Kind};
use crate::error::{Error, Text};
use crate::list::{List, fitting};
use crate::loops::LoopReports;
use crate::machine::Machine;
use crate::numbers::PROCESSORS;
use crate::running::{Background, Call, ConsoleOf, FILES, Screen, Tick};
use crate::servo::{LOOPS, ServoLoop};

/// The most handlers of a program.
pub const HANDLERS: usize = 16;
/// Bytes of a terminal's ring.
const SHOWN_BYTES: u32 = 8192;
/// The longest path that a program opens, and the buffer for what is in a file, in bytes.
const PATH_BYTES: u32 = 64;
const BUFFER_BYTES: u32 = 4096;
/// How long the background serves before it looks around.
const NAP: Duration = Duration::from_millis(20);

/// What runs for a message, in a program that [`Setup`] makes.
pub type Handler<'e> = &'e (dyn Fn(&Call<'_>) -> u32 + Sync);
/// What a loop runs, in a program that [`Setup`] makes.
pub type Body<'e> = &'e mut (dyn FnMut(&mut Tick<'_>) + Send);

/// A program while it says what it does.
///
/// It lays out the memory, one thing after the other; nothing runs before [`run`](Self::run) or
/// [`background`](Self::background). Handlers and bodies are lent to it, and it has one type whatever is
/// added, so that it can be filled in `if` and `for`. What is wrong with handlers and loops (too many, a
/// vector twice) is told at the end.
pub struct Setup<'e, M: Machine> {
    machine: &'e M,
    own: Region<M::Window>,
    places: Places,
    directory: Directory<M::Window>,
    console: Option<ConsoleOf<M>>,
    area: Option<Area<FILES>>,
    waiting: Waiting,
    handlers: List<(Vector, &'e str, Handler<'e>), HANDLERS>,
    loops: List<Loop<'e>, LOOPS>,
    wrong: Option<Error>,
}

struct Loop<'e> {
    name: &'e str,
    rate: Rate,
    overrun: Overrun,
    body: Body<'e>,
}

impl<'e, M: Machine> Setup<'e, M> {
    /// The setup of the program of `machine`, with an empty object table.
    ///
    /// # Errors
    /// [`Error::Window`] if there is no room for that; the memory's.
    pub fn new(machine: &'e M) -> Result<Self, Error> {
        let own = users(machine, machine.number())?;
        let mut places = Places::new(own.size());
        let directory = Directory::new(own.clone(), &mut places)?;
        Ok(Self {
            machine,
            own,
            places,
            directory,
            console: None,
            area: None,
            waiting: machine.waiting(),
            handlers: List::new(),
            loops: List::new(),
            wrong: None,
        })
    }

    /// Gives the program a terminal, `console`.
    ///
    /// # Errors
    /// [`Error::Twice`], [`Error::Window`]; the object table's.
    pub fn console(&mut self) -> Result<&mut Self, Error> {
        if self.console.is_some() {
            return Err(Error::Twice { what: "console" });
        }
        let (own, exclusion) = (self.own.clone(), self.machine.exclusion());
        let mut room = self.places.clone();
        let made = Terminal::new(own, &mut room, SHOWN_BYTES, exclusion);
        let terminal = made.map_err(|error| match error {
            condor_tty::TerminalError::Access(error) => no_room("console", error),
            error => error.into(),
        })?;
        self.places = room;
        let offset = terminal.offset();
        self.directory
            .enter("console", Kind::Terminal, offset, SHOWN_BYTES)?;
        self.console = Some(terminal);
        Ok(self)
    }

    /// Has the mailbox wait in another way than the machine's.
    pub const fn waiting(&mut self, waiting: Waiting) -> &mut Self {
        self.waiting = waiting;
        self
    }

    /// Lets the background open the host's files.
    ///
    /// # Errors
    /// [`Error::Twice`], [`Error::Window`].
    pub fn files(&mut self) -> Result<&mut Self, Error> {
        if self.area.is_some() {
            return Err(Error::Twice { what: "file area" });
        }
        let area = Area::new(&mut self.places, PATH_BYTES, BUFFER_BYTES);
        self.area = Some(area.map_err(|error| no_room("files", error))?);
        Ok(self)
    }

    /// A cell of a name, for others to read the latest value of.
    ///
    /// # Errors
    /// [`Error::Window`]; the object table's.
    pub fn publish<T>(&mut self, name: &str) -> Result<Publisher<T, Region<M::Window>>, Error>
    where
        T: FromBytes + IntoBytes + Immutable,
    {
        let cell = self.places.published::<T>();
        let cell = cell.map_err(|error| no_room(name, error))?;
        // What a former program has left there is none of this one's.
        for word in (0..Published::<T>::BYTES).step_by(4) {
            self.own.set_word(cell.offset() + word, 0)?;
        }
        self.directory
            .enter(name, Kind::Other, cell.offset(), Published::<T>::BYTES)?;
        Ok(cell.publisher(self.own.clone())?)
    }

    /// Enters what `make` takes of the window, under a name: objects that others know how to read.
    ///
    /// ```
    /// # use condor_rt::{Error, Machine, Setup, directory::Kind};
    /// # fn two<M: Machine>(setup: &mut Setup<'_, M>) -> Result<(), Error> {
    /// let offset = setup.place("points", Kind::Other, |places| places.bytes(64))?;
    /// # let _ = offset;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::Window`]; the object table's.
    pub fn place<T>(
        &mut self,
        name: &str,
        kind: Kind,
        make: impl FnOnce(&mut Places) -> Result<T, AccessError>,
    ) -> Result<T, Error> {
        let mut room = self.places.clone();
        let first = room.used();
        let made = make(&mut room).map_err(|error| no_room(name, error))?;
        let len = room.used() - first;
        self.places = room;
        self.directory.enter(name, kind, first, len)?;
        Ok(made)
    }

    /// The own memory that others see, in which everything is placed.
    #[must_use]
    pub const fn own(&self) -> &Region<M::Window> {
        &self.own
    }

    /// Runs `handler` for messages to `vector`; `name` is for people.
    pub fn on(&mut self, vector: Vector, name: &'e str, handler: Handler<'e>) -> &mut Self {
        if self.handlers.iter().any(|(taken, ..)| *taken == vector) {
            let name = Text::of(name);
            self.wrong
                .get_or_insert(Error::VectorTaken { vector, name });
        } else if self.handlers.push((vector, name, handler)).is_err() {
            self.full("handlers", HANDLERS, name);
        }
        self
    }

    /// Runs `body` at `rate`. A release that comes before it has finished is skipped and counted.
    pub fn servo(&mut self, name: &'e str, rate: Rate, body: Body<'e>) -> &mut Self {
        self.servo_with(name, rate, Overrun::Skip, body)
    }

    /// As [`servo`](Self::servo), with another policy for overruns.
    pub fn servo_with(
        &mut self,
        name: &'e str,
        rate: Rate,
        overrun: Overrun,
        body: Body<'e>,
    ) -> &mut Self {
        let new = Loop {
            name,
            rate,
            overrun,
            body,
        };
        if self.loops.push(new).is_err() {
            self.full("loops", LOOPS, name);
        }
        self
    }

    /// Joins, runs the loops, and serves messages until the machine is stopping.
    ///
    /// # Errors
    /// What was wrong with the setup; those of the mailbox and of the loops.
    pub fn run(&mut self) -> Result<(), Error> {
        self.background(|background| {
            while !background.is_stopping() {
                background.serve(NAP)?;
            }
            Ok(())
        })
    }

    /// Joins, and runs `background` while loops and handlers interrupt it.
    ///
    /// A program that needs to know something before it can be set up, such as a configuration from a
    /// file, asks for that in the background of a first setup, and makes a second one: to others, the
    /// second begins a new incarnation of the program.
    ///
    /// # Errors
    /// What was wrong with the setup; those of the mailbox and of the loops; `background`'s.
    pub fn background<R, E: From<Error>>(
        &mut self,
        background: impl FnOnce(&Background<'_, M>) -> Result<R, E>,
    ) -> Result<R, E> {
        self.run_with(background)?
    }

    fn run_with<R>(
        &mut self,
        background: impl FnOnce(&Background<'_, M>) -> R,
    ) -> Result<R, Error> {
        if let Some(wrong) = self.wrong.take() {
            return Err(wrong);
        }
        let names: Vec<&str, LOOPS> = fitting(self.loops.iter().map(|one| one.name));
        let reports = self.reports(&names)?;
        let (machine, console, area) = (self.machine, self.console.as_ref(), self.area);
        let handlers = &self.handlers;
        let screen = console.map(|console| console as &dyn Screen);

        // One handler knows all others, and wraps the mailbox's call: nothing is filled in late.
        let dispatch = |call: &mbox::Call<'_>| {
            let mut known = handlers.iter();
            let handler = known.find(|(vector, ..)| *vector == call.vector());
            handler.map_or(0, |(.., handler)| handler(&Call { call, screen }))
        };
        let typed = |call: &mbox::Call<'_>| console.map_or(0, |console| console.receive(call));
        let open_files = area.map(Area::handler);
        let mut mailbox = machine.mailbox()?;
        mailbox.set_waiting(self.waiting);
        if console.is_some() {
            mailbox.set_vector(Vectors::DEFAULT.input, &typed, "terminal input")?;
            mailbox.set_vector(Vectors::DEFAULT.room, &typed, "terminal room")?;
        }
        if let Some(open_files) = &open_files {
            mailbox.set_vector(condor_fs::wire::OPEN_FILES, open_files, "open files")?;
        }
        for (vector, name, _) in handlers.iter() {
            mailbox.set_vector(*vector, &dispatch, name)?;
        }
        mailbox.ring_always(machine.mail_interrupts())?;
        mailbox.join()?;

        let (mailbox, own) = (&mailbox, &self.own);
        let bodies = self.loops.iter_mut().map(|one| {
            let mut number = 0_u32;
            let body = &mut *one.body;
            let tick = move |due| {
                body(&mut Tick {
                    due,
                    number,
                    messenger: mailbox,
                    screen,
                });
                number = number.wrapping_add(1);
            };
            (one.rate, one.overrun, tick)
        });
        let mut bodies: Vec<_, LOOPS> = fitting(bodies);
        let loops = bodies.iter_mut().map(|(rate, overrun, body)| ServoLoop {
            rate: *rate,
            overrun: *overrun,
            body,
        });
        let mut loops: Vec<ServoLoop<'_>, LOOPS> = fitting(loops);
        let run = |loops: Option<&dyn Loops<Instant = u64>>| {
            let running = Background {
                machine,
                mailbox,
                console,
                area,
                own,
                loops,
                names: &names,
                reports: RefCell::new((machine.doorbell().now(), reports)),
            };
            running.show_now(&mut running.reports.borrow_mut().1)?;
            Ok(background(&running))
        };
        // What is wrong with the own memory, the background finds out.
        let serve = || mailbox.serve(Duration::ZERO).unwrap_or(0);
        machine.with_mail(serve, || {
            if loops.is_empty() {
                return run(None);
            }
            machine.with_loops(&mut loops, |loops| run(Some(loops)))?
        })?
    }

    fn reports(&mut self, names: &[&str]) -> Result<Option<LoopReports<M::Window, LOOPS>>, Error> {
        if names.is_empty() {
            return Ok(None);
        }
        let (own, places) = (&self.own, &mut self.places);
        let names = names.iter().copied();
        Ok(Some(LoopReports::new(
            own,
            places,
            &mut self.directory,
            names,
        )?))
    }

    fn full(&mut self, what: &'static str, capacity: usize, name: &str) {
        self.wrong.get_or_insert(Error::Full {
            what,
            capacity,
            name: Text::of(name),
        });
    }
}

/// What users have of a processor's `data`.
///
/// # Errors
/// No such processor; the memory's.
pub fn users<M: Machine>(
    machine: &M,
    processor: mbox::Processor,
) -> Result<Region<M::Window>, Error> {
    let mut windows = machine.windows().into_iter();
    let windows = windows.nth(processor.index());
    let windows = windows.ok_or(mbox::Error::NoSuchProcessor {
        number: processor,
        processors: PROCESSORS as u8,
    })?;
    Ok(Region::users(windows.data)?)
}

fn no_room(name: &str, error: AccessError) -> Error {
    let (needed, left) = (error.len as u32, error.size.saturating_sub(error.offset));
    if needed <= left {
        return error.into();
    }
    Error::Window {
        name: Text::of(name),
        needed,
        left,
    }
}
