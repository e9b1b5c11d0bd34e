//! [`Setup`]: the builder of a program.

use core::cell::{Cell, RefCell};
use core::ops::RangeInclusive;
use core::time::Duration;

use condor_dev::InterruptEntry;
use condor_fs::Area;
use condor_mbox::published::Publisher;
use condor_mbox::{self as mbox, AccessError, Clock as _, Doorbell as _, Instant, MemoryWindow};
use condor_mbox::{Allocator, Messenger as _, Published, Region, Vector, Waiting};
use condor_mos::{ClockSpec, LoopId, Loops, Overrun, Rate, Scan};
use condor_platform::FloatExceptions;
use condor_tty::{Terminal, TerminalVectors};
use condor_vars::{Catalog, CellStruct, Respond, Tune, VARS, VariableSettings, Watch, describe};
use heapless::Vec;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::error::ProgramError;
use crate::interrupts::Interrupts;
use crate::list::{List, fitting};
use crate::loops::LoopReport;
use crate::machine::Machine;
use crate::numbers::{self, PROCESSORS};
use crate::objects::{ObjectKind, ObjectTable};
use crate::running::{
    Background, ConsoleOf, FILES, FollowedRate, HandlerCall, LoopTick, Reports, Screen,
};
use crate::servo::{LOOPS, ServoLoop};
use crate::supervisor::Supervisor;
use crate::text::ShortText;
use crate::variables::{
    self, LoopDesk, LoopSampler, LoopServer, Nanoseconds, RateBounds, RateParam, VARIABLES,
    incarnation, name_of, rate_of,
};

/// The greatest number of message handlers that a program can have.
pub const HANDLERS: usize = 16;
/// Bytes of a terminal's ring.
const SHOWN_BYTES: u32 = 8192;
/// The longest path that a program opens, and the buffer for what is in a file, in bytes.
const PATH_BYTES: u32 = 64;
const BUFFER_BYTES: u32 = 4096;
/// The time that the background serves before it looks around.
const NAP: Duration = Duration::from_millis(20);
/// The parameters of a program, with those of the rates of its loops.
const PARAMETERS: usize = VARIABLES + LOOPS;

/// A function that handles messages, for [`Setup::on`]. Its result is the reply to the message.
pub type MessageHandler<'e> = &'e (dyn Fn(&HandlerCall<'_>) -> u32 + Sync);
/// A function that hears messages to another processor, for [`Setup::listen`].
pub type ListenerFunction<'e> = &'e (dyn Fn(&HandlerCall<'_>) + Sync);
/// The body of a servo loop, for [`Setup::servo`]. It runs once at each release of the loop.
pub type LoopFunction<'e> = &'e mut (dyn FnMut(&mut LoopTick<'_>) + Send);

/// The builder of a program: it adds a terminal, handlers of messages, variables, servo loops and
/// other parts, and then runs the program.
///
/// Each method places a part in the shared memory of the processor, behind the parts that were
/// added before. Nothing runs before [`run`](Self::run) or [`background`](Self::background). A
/// setup borrows handlers and the bodies of loops. The type of a setup does not depend on what is
/// added, so that parts can be added in `if` and `for`. `run` and `background` report mistakes with
/// handlers, loops and variables, such as too many of them or a vector that is used twice.
///
/// ```
/// use condor_rt::{Machine, ProgramError, Rate, Setup, Var, Vector};
///
/// fn servo<M: Machine>(machine: &M) -> Result<(), ProgramError> {
///     let position = Var::new("joint.position", "rad");
///     Setup::new(machine)?
///         .console()?
///         .on(Vector(1), "add", &|call| call.data().wrapping_add(1))
///         .watch(&position)
///         .servo("servo", Rate::hz(400), &mut |_tick| position.set(0.5))
///         .run()
/// }
/// ```
pub struct Setup<'e, M: Machine> {
    machine: &'e M,
    own: Region<M::Window>,
    allocator: Allocator,
    objects: ObjectTable<M::Window>,
    console: Option<ConsoleOf<M>>,
    area: Option<Area<FILES>>,
    /// The room for requests to the supervisor.
    asks: Option<Allocator>,
    waiting: Waiting,
    ahead: Duration,
    interrupts: Option<&'e dyn InterruptEntry>,
    handlers: List<(Vector, &'e str, MessageHandler<'e>), HANDLERS>,
    listens: Option<(mbox::Processor, ListenerFunction<'e>)>,
    loops: List<Loop<'e>, LOOPS>,
    /// The rates that others may set for the loop that is added next.
    bounds: RateBounds,
    /// The variables, and below the parameters: those of the first loop, then those of the second, and so on.
    watched: List<&'e dyn Watch, VARIABLES>,
    tuned: List<&'e dyn Tune, VARIABLES>,
    wrong: Option<ProgramError>,
}

/// The two ends of the tables of all loops.
type Tables<'d, M> = (
    Vec<LoopServer<'d, M>, LOOPS>,
    Vec<Option<LoopSampler<'d, M>>, LOOPS>,
);

struct Loop<'e> {
    name: &'e str,
    rate: Rate,
    overrun: Overrun,
    body: LoopFunction<'e>,
    /// The rates that others may set.
    bounds: RateBounds,
    /// The number of variables and parameters of this loop and the loops before it.
    watched: usize,
    tuned: usize,
}

impl Loop<'_> {
    /// Returns the function that runs at a release.
    fn ticks<M: Machine>(
        &mut self,
        mut sampler: Option<LoopSampler<'_, M>>,
        time: Nanoseconds,
        machine: &M,
        messenger: &(dyn mbox::Messenger + Sync),
        screen: Option<&dyn Screen>,
    ) -> impl FnMut(u64) + Send {
        let (mut number, name) = (0_u64, self.name);
        let looks_at_floats = machine.is_float_exception_fatal();
        move |due| {
            let due = Instant::from_ns(time.at(due));
            // Without its own memory it has no watchers; the body runs all the same.
            if let Some(sampler) = &mut sampler {
                let _ = sampler.begin();
            }
            if looks_at_floats {
                // The background, which this loop may have interrupted, may have raised some.
                let _ = FloatExceptions::take();
            }
            (self.body)(&mut LoopTick {
                due,
                number: number as u32,
                messenger,
                screen,
            });
            if looks_at_floats {
                let exceptions = FloatExceptions::take();
                if exceptions.any() {
                    let name = ShortText::of(name);
                    machine.fail(&ProgramError::FloatExceptions { name, exceptions });
                }
            }
            if let Some(sampler) = &mut sampler {
                let _ = sampler.end(number, due);
            }
            number += 1;
        }
    }
}

impl<'e, M: Machine> Setup<'e, M> {
    /// Begins the setup of the program that runs on `machine`: writes an empty object table into
    /// the processor's shared memory.
    ///
    /// # Errors
    /// [`ProgramError::Objects`] if the processor's shared memory has no room for the table;
    /// [`ProgramError::Access`] if the shared memory is even smaller than the line that the
    /// doorbell uses.
    pub fn new(machine: &'e M) -> Result<Self, ProgramError> {
        let own = users(machine, machine.number())?;
        let mut allocator = Allocator::new(own.size());
        let objects = ObjectTable::new(own.clone(), &mut allocator)?;
        Ok(Self {
            machine,
            own,
            allocator,
            objects,
            console: None,
            area: None,
            asks: None,
            waiting: machine.waiting(),
            ahead: Duration::ZERO,
            interrupts: None,
            handlers: List::new(),
            listens: None,
            loops: List::new(),
            bounds: RateBounds::Slower,
            watched: List::new(),
            tuned: List::new(),
            wrong: None,
        })
    }

    /// Creates the program's terminal, which edits lines on the processor. The object table lists
    /// it as `console`.
    ///
    /// # Errors
    /// [`ProgramError::Twice`] if the program has a terminal already; [`ProgramError::Window`] if there is
    /// no room; [`ProgramError::Objects`] if a terminal of this name is in the object table already.
    pub fn console(&mut self) -> Result<&mut Self, ProgramError> {
        self.console_with(&condor_tty::TerminalSettings::COOKED)
    }

    /// Creates the program's terminal as [`console`](Self::console) does, with `settings` for its
    /// input and output.
    ///
    /// # Errors
    /// [`ProgramError::Twice`] if the program has a terminal already; [`ProgramError::Window`] if there is
    /// no room; [`ProgramError::Objects`] if a terminal of this name is in the object table already.
    pub fn console_with(
        &mut self,
        settings: &condor_tty::TerminalSettings,
    ) -> Result<&mut Self, ProgramError> {
        if self.console.is_some() {
            return Err(ProgramError::Twice { what: "console" });
        }
        let (own, exclusion) = (self.own.clone(), self.machine.exclusion());
        let mut room = self.allocator.clone();
        let made = Terminal::new(own, &mut room, SHOWN_BYTES, exclusion);
        let terminal = made.map_err(|error| match error {
            condor_tty::TerminalError::Access(error) => ProgramError::no_room("console", error),
            error => error.into(),
        })?;
        terminal
            .configure(settings)
            .map_err(|error| ProgramError::no_room("console", error))?;
        self.allocator = room;
        self.enter("console", ObjectKind::Terminal, terminal.offset())?;
        self.console = Some(terminal);
        Ok(self)
    }

    /// Sets the way in which the program's mailbox waits for messages and replies: spinning,
    /// sleeping or both. The default is [`Machine::waiting`].
    pub const fn waiting(&mut self, waiting: Waiting) -> &mut Self {
        self.waiting = waiting;
        self
    }

    /// Has the program's boards interrupt: `entry` serves them. It is usually a
    /// [`Switch`](condor_dev::Switch) with the controller that
    /// [`interrupt_controller`](Machine::interrupt_controller) returns. The counts of interrupts are
    /// published in a cell called `interrupts`, see [`Interrupts`].
    ///
    /// An entry replaces the one that was set before.
    pub fn interrupts(&mut self, entry: &'e dyn InterruptEntry) -> &mut Self {
        self.interrupts = Some(entry);
        self
    }

    /// Takes room for a client of the file service, so that the background can open the host's
    /// files.
    ///
    /// # Errors
    /// [`ProgramError::Twice`] if `files` was called before, [`ProgramError::Window`] if there is no room.
    pub fn files(&mut self) -> Result<&mut Self, ProgramError> {
        if self.area.is_some() {
            return Err(ProgramError::Twice { what: "file area" });
        }
        let area = Area::new(&mut self.allocator, PATH_BYTES, BUFFER_BYTES);
        self.area = Some(area.map_err(|error| ProgramError::no_room("files", error))?);
        Ok(self)
    }

    /// Takes room for requests to the supervisor, so that the background can restart and load the
    /// programs of processors, if the system's description allows that.
    ///
    /// # Errors
    /// [`ProgramError::Twice`] if `supervisor` was called before, [`ProgramError::Window`] if the window has no room.
    pub fn supervisor(&mut self) -> Result<&mut Self, ProgramError> {
        if self.asks.is_some() {
            return Err(ProgramError::Twice {
                what: "room for requests to the supervisor",
            });
        }
        let free = self.allocator.clone();
        let taken = self.allocator.bytes(Supervisor::<M>::BYTES);
        taken.map_err(|error| ProgramError::no_room("supervisor", error))?;
        self.asks = Some(free);
        Ok(self)
    }

    /// Makes a cell called `name`, in which others can read the latest value of type `T`. Returns
    /// the publisher, through which the program writes a new value.
    ///
    /// # Errors
    /// [`ProgramError::Window`] if there is no room, [`ProgramError::Objects`] if the name is too long, or another cell
    /// has it.
    pub fn publish<T>(
        &mut self,
        name: &str,
    ) -> Result<Publisher<T, Region<M::Window>>, ProgramError>
    where
        T: FromBytes + IntoBytes + Immutable,
    {
        Ok(self.cell(name)?.publisher(self.own.clone())?)
    }

    /// Makes a cell as [`publish`](Self::publish) does, with a table that describes its fields.
    /// With that table, programs that do not know the type `T` can show each field by its name.
    ///
    /// # Errors
    /// [`ProgramError::Window`] if there is no room, [`ProgramError::Objects`] if the name is too long, or another cell
    /// has it, [`ProgramError::Variables`] if the fields cannot be described.
    pub fn publish_fields<T>(
        &mut self,
        name: &str,
    ) -> Result<Publisher<T, Region<M::Window>>, ProgramError>
    where
        T: FromBytes + IntoBytes + Immutable + CellStruct,
    {
        let cell = self.cell::<T>(name)?;
        let first = self.allocator.used();
        let described = describe(cell, &self.own, &mut self.allocator);
        described.map_err(|error| variables::wrong(name, error))?;
        self.enter(name, ObjectKind::Variables, first)?;
        Ok(cell.publisher(self.own.clone())?)
    }

    fn cell<T>(&mut self, name: &str) -> Result<Published<T>, ProgramError> {
        let cell = self
            .objects
            .cell(&mut self.allocator, name, ObjectKind::Other);
        cell.map_err(|error| ProgramError::not_entered(name, error))
    }

    /// Calls `make` to take room in the processor's shared memory, enters that room in the object
    /// table as `name`, and returns the result of `make`. Use this for objects of types of your
    /// own, if other programs know how to read them.
    ///
    /// ```
    /// # use condor_rt::{ProgramError, Machine, Setup, objects::ObjectKind};
    /// # fn two<M: Machine>(setup: &mut Setup<'_, M>) -> Result<(), ProgramError> {
    /// let offset = setup.place("points", ObjectKind::Other, |allocator| allocator.bytes(64))?;
    /// # let _ = offset;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`ProgramError::Window`] if there is no room, [`ProgramError::Objects`] if the name is too long, or another
    /// object of this kind has it.
    pub fn place<T>(
        &mut self,
        name: &str,
        kind: ObjectKind,
        make: impl FnOnce(&mut Allocator) -> Result<T, AccessError>,
    ) -> Result<T, ProgramError> {
        let mut room = self.allocator.clone();
        let first = room.used();
        let placed = make(&mut room).map_err(|error| ProgramError::no_room(name, error))?;
        self.allocator = room;
        self.enter(name, kind, first)?;
        Ok(placed)
    }

    /// Returns the users' region of this processor's `data`: the shared memory in which the setup
    /// places all parts, and which others can read.
    #[must_use]
    pub const fn own(&self) -> &Region<M::Window> {
        &self.own
    }

    /// Sets the handler that runs for each message on `vector`, which must be one of
    /// [`OWN_VECTORS`](numbers::OWN_VECTORS). Tools show `name` to people.
    pub fn on(&mut self, vector: Vector, name: &'e str, handler: MessageHandler<'e>) -> &mut Self {
        let is_taken = self.handlers.iter().any(|(taken, ..)| *taken == vector);
        let own = is_taken.then_some("another handler of the program");
        if let Some(by) = numbers::reserved(vector).or(own) {
            let name = ShortText::of(name);
            self.wrong
                .get_or_insert(ProgramError::VectorTaken { vector, by, name });
        } else if self.handlers.push((vector, name, handler)).is_err() {
            self.full("handlers", HANDLERS, name);
        }
        self
    }

    /// Has the program hear the messages to the processor `number`, which gets them all the same and answers them.
    /// `listener` runs for each of them, like a handler of [`on`](Self::on), and says by the vector, the sender and the
    /// data which of them interest it.
    ///
    /// Hearing begins when that processor is up, and goes on after it was restarted. The background begins it, within
    /// 50 ms, if it calls [`serve`](Background::serve) or [`show`](Background::show) often enough. Messages that come
    /// too fast for this program are missed;
    /// [`Background::mailbox`] counts them: see [`Mailbox::missed`](mbox::Mailbox::missed). A program can listen to one
    /// number only. A.I. Memo 977, section 3.4: all that have expressed an interest are signalled.
    pub fn listen(&mut self, number: mbox::Processor, listener: ListenerFunction<'e>) -> &mut Self {
        if self.listens.replace((number, listener)).is_some() {
            self.wrong
                .get_or_insert(ProgramError::Twice { what: "listener" });
        }
        let problem = if number == self.machine.number() {
            mbox::MailboxError::ListensToItself { number }
        } else if number.index() >= PROCESSORS {
            let processors = PROCESSORS as u8;
            mbox::MailboxError::NoSuchProcessor { number, processors }
        } else {
            return self;
        };
        self.wrong.get_or_insert(problem.into());
        self
    }

    /// Adds a variable, or a block of variables, to the servo loop that is added next, so that
    /// other programs can watch it. While a watcher has selected the variable, the loop samples it
    /// at each of its releases.
    pub fn watch(&mut self, variable: &'e dyn Watch) -> &mut Self {
        if self.watched.push(variable).is_err() {
            self.full("variables", VARIABLES, name_of(variable).as_str());
        }
        self
    }

    /// Adds a parameter to the servo loop that is added next, so that other programs can read and
    /// set it while the loop runs.
    pub fn tune(&mut self, parameter: &'e dyn Tune) -> &mut Self {
        if self.tuned.push(parameter).is_err() {
            self.full("parameters", VARIABLES, name_of(parameter).as_str());
        }
        self
    }

    /// Adds a servo loop called `name`, which runs `body` at `rate`. If a release comes before the
    /// last run of `body` has finished, that release is skipped and counted.
    ///
    /// The first release is in the middle of a period of the program's fastest loop; periods are
    /// counted from the beginning of the machine's time. So loops of the same rate are due at the
    /// same instants on all processors that share a clock.
    ///
    /// Others may set the rate while the loop runs, by the parameter `NAME.hz` (see [`tune`](Self::tune)) in Hz, of which
    /// thousandths count. At 0 Hz the loop rests. The greatest rate is that of the beginning, so that loops which were
    /// in time still are; [`rates`](Self::rates) sets other bounds, and [`fixed`](Self::fixed) keeps the rate. The
    /// background applies a new rate within 50 ms if it calls [`serve`](Background::serve) or
    /// [`show`](Background::show) often enough.
    pub fn servo(&mut self, name: &'e str, rate: Rate, body: LoopFunction<'e>) -> &mut Self {
        self.servo_with(name, rate, Overrun::Skip, body)
    }

    /// Sets the rates in Hz that others may set for the servo loop that is added next. If 0 is among them, the loop may
    /// rest. [`run`](Self::run) fails if the loop cannot have the greatest rate, or if its rate is not among them.
    pub const fn rates(&mut self, hz: RangeInclusive<f64>) -> &mut Self {
        self.bounds = RateBounds::Within(hz);
        self
    }

    /// Has the servo loop that is added next keep its rate: it has no parameter by which others could set it. A loop
    /// needs this if it computes with the period that it had at the beginning, or if a robot would fall while it rests.
    pub const fn fixed(&mut self) -> &mut Self {
        self.bounds = RateBounds::Fixed;
        self
    }

    /// Releases all loops of the program that much earlier than [`servo`](Self::servo) says. So what this program does
    /// is done when the loops of others begin that use it. It is less than 10 s.
    pub const fn ahead(&mut self, ahead: Duration) -> &mut Self {
        self.ahead = ahead;
        self
    }

    /// Adds a servo loop as [`servo`](Self::servo) does. `overrun` says what happens to a release
    /// that comes before the last run has finished.
    pub fn servo_with(
        &mut self,
        name: &'e str,
        rate: Rate,
        overrun: Overrun,
        body: LoopFunction<'e>,
    ) -> &mut Self {
        let new = Loop {
            name,
            rate,
            overrun,
            body,
            bounds: core::mem::replace(&mut self.bounds, RateBounds::Slower),
            watched: self.watched.iter().count(),
            tuned: self.tuned.iter().count(),
        };
        if self.loops.push(new).is_err() {
            self.full("loops", LOOPS, name);
        }
        self
    }

    /// Joins the system, runs the loops, and serves messages until the machine tells the program to
    /// stop.
    ///
    /// # Errors
    /// Returns the error of [`background`](Self::background) if that fails.
    pub fn run(&mut self) -> Result<(), ProgramError> {
        self.background(|background| {
            while !background.is_stopping() {
                background.serve(NAP)?;
            }
            Ok(())
        })
    }

    /// Joins the system, runs `background` once, and returns its result; loops and handlers
    /// interrupt it meanwhile. If `background` returns an error, the error is also printed on the
    /// terminal.
    ///
    /// A program may have to read a configuration, such as a file, before it can be set up. It does so in the
    /// background of a first setup, and then makes a second setup. To other processors the second setup is a new start
    /// of the program, with a new incarnation: it keeps nothing of the first setup. If the first setup has a terminal,
    /// set it up with [`TerminalSettings::OUTPUT`](condor_tty::TerminalSettings::OUTPUT): then text that is typed is
    /// left for the terminal of the second setup.
    ///
    /// # Errors
    /// [`ProgramError::Full`], [`ProgramError::VectorTaken`], [`ProgramError::LeftOver`], [`ProgramError::Variables`]
    /// or [`ProgramError::Window`] if something was wrong with the setup; [`ProgramError::Mailbox`] if the mailbox
    /// cannot join; [`ProgramError::Rate`], [`ProgramError::Loop`] or [`ProgramError::Start`] if the loops cannot run;
    /// otherwise the error that `background` returned.
    pub fn background<R>(
        &mut self,
        background: impl FnOnce(&Background<'_, M>) -> Result<R, ProgramError>,
    ) -> Result<R, ProgramError> {
        self.run_with(|running| {
            let outcome = background(running);
            if let Err(error) = &outcome {
                running.print(format_args!("ended: {error}\n"));
            }
            outcome
        })?
    }

    fn run_with<R>(
        &mut self,
        background: impl FnOnce(&Background<'_, M>) -> R,
    ) -> Result<R, ProgramError> {
        self.check()?;
        let names: Vec<&str, LOOPS> = fitting(self.loops.iter().map(|one| one.name));
        let reports = self.reports()?;
        let watched: Vec<&dyn Watch, VARIABLES> = fitting(self.watched.iter().copied());
        let rates = self.rate_params()?;
        let tuned = self.parameters(&rates)?;
        let (windows, doorbell) = (self.machine.windows(), self.machine.doorbell());
        let lives = |processor| incarnation::<M, PROCESSORS>(&windows, &doorbell, processor);
        let mut all_selections = [const { LoopDesk::new() }; LOOPS];
        let (servers, mut samplers) = self.tables(&mut all_selections, &watched, &tuned, &lives)?;
        let servers: Vec<&dyn Respond, LOOPS> = fitting(servers.iter().map(|one| one as _));
        let time = Nanoseconds::of(self.machine.timer_frequency());
        let (machine, console, area) = (self.machine, self.console.as_ref(), self.area);
        let screen = console.map(|console| console as &dyn Screen);

        // One handler knows all others, and wraps the mailbox's call: nothing is filled in late.
        let (handlers, listens) = (&self.handlers, self.listens);
        let dispatch =
            |call: &mbox::Call<'_>| handle(handlers, listens, &HandlerCall { call, screen });
        let typed = |call: &mbox::Call<'_>| console.map_or(0, |console| console.receive(call));
        let open_files = area.map(Area::handler);
        let asked = |call: &mbox::Call<'_>| {
            let data = windows.get(call.sender().index()).map(|it| &it.data);
            let data = data.and_then(|data| Region::users(data).ok());
            data.map_or(0, |data| condor_vars::answer(call, &data, &servers))
        };
        let mut mailbox = machine.mailbox()?;
        mailbox.set_waiting(self.waiting);
        if console.is_some() {
            mailbox.set_vector(TerminalVectors::DEFAULT.input, &typed, "terminal input")?;
            mailbox.set_vector(TerminalVectors::DEFAULT.room, &typed, "terminal room")?;
        }
        if let Some(open_files) = &open_files {
            mailbox.set_vector(condor_fs::wire::OPEN_FILES, open_files, "open files")?;
        }
        if !servers.is_empty() {
            mailbox.set_vector(VARS, &asked, "variables")?;
        }
        for (vector, name, _) in self.handlers.iter() {
            mailbox.set_vector(*vector, &dispatch, name)?;
        }
        mailbox.set_listener(&dispatch);
        mailbox.ring_always(machine.mail_interrupts())?;
        mailbox.join()?;

        let (mailbox, own) = (&mailbox, &self.own);
        let rates = followed(&rates);
        // The list itself would panic where it ends.
        let bodies = self.loops.iter_mut().zip(samplers.iter_mut());
        let bodies = bodies.map(|(one, sampler)| {
            let (rate, overrun) = (one.rate, one.overrun);
            (
                rate,
                overrun,
                one.ticks(sampler.take(), time, self.machine, mailbox, screen),
            )
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
                asks: self.asks.as_ref(),
                own,
                loops,
                names: &names,
                rates: &rates,
                interrupts: self.interrupts,
                listens: listens.map(|(number, _)| number),
                reports: RefCell::new((machine.doorbell().now(), reports)),
            };
            if let Some(loops) = loops {
                running.follow_rates(loops);
            }
            running.listen();
            if let Ok(mut reports) = running.reports.try_borrow_mut() {
                running.show_now(&mut reports.1)?;
            }
            Ok(background(&running))
        };
        // An error of the processor's own memory is found by the background.
        let serve = || mailbox.serve(Duration::ZERO).unwrap_or(0);
        let run = || {
            machine.with_mail(serve, || {
                // A ring since the mailbox joined, but before `serve` was connected, was not heard.
                if machine.mail_interrupts() {
                    machine.doorbell().ring(machine.number());
                }
                if loops.is_empty() {
                    return run(None);
                }
                machine.with_loops(&mut loops, self.ahead, |loops| run(Some(loops)))?
            })?
        };
        with_boards(machine, self.interrupts, run)
    }

    /// Returns the first mistake with what was added.
    fn check(&mut self) -> Result<(), ProgramError> {
        let name = ShortText::of(&"hz");
        match self.wrong.take() {
            Some(wrong) => Err(wrong),
            None if matches!(self.bounds, RateBounds::Slower) => Ok(()),
            None => Err(ProgramError::LeftOver { name }),
        }
    }

    /// Makes the parameters by which others set the rates of loops.
    fn rate_params(&self) -> Result<Vec<Option<RateParam<'e>>, LOOPS>, ProgramError> {
        let clock = ClockSpec::of::<u64>(self.machine.timer_frequency());
        for one in self.loops.iter() {
            if let RateBounds::Within(hz) = &one.bounds
                && let Some(greatest) = rate_of(*hz.end())
            {
                Scan::<1>::try_new(&[greatest], clock)?;
            }
        }
        let params = (self.loops.iter()).map(|one| RateParam::new(one.name, one.rate, &one.bounds));
        Ok(fitting(params))
    }

    /// Returns the parameters of the first loop, with that of its rate, then those of the second, and so on.
    fn parameters<'d>(
        &self,
        rates: &'d [Option<RateParam<'e>>],
    ) -> Result<Vec<&'d dyn Tune, PARAMETERS>, ProgramError>
    where
        'e: 'd,
    {
        let (mut all, mut tuned) = (Vec::new(), self.tuned.iter());
        let mut taken = 0;
        for (one, rate) in self.loops.iter().zip(rates) {
            let own = tuned.by_ref().take(one.tuned - taken);
            let own = own.map(|it| *it as &dyn Tune);
            for parameter in own.chain(rate.iter().map(|it| it as &dyn Tune)) {
                // As many as there are parameters and loops.
                let _ = all.push(parameter);
            }
            taken = one.tuned;
        }
        let left = tuned.next().map(|it| name_of(*it));
        left.map_or(Ok(all), |name| Err(ProgramError::LeftOver { name }))
    }

    /// Makes the tables of the loops that have variables or parameters.
    fn tables<'d>(
        &mut self,
        all_selections: &'d mut [LoopDesk; LOOPS],
        watched: &'d [&'d dyn Watch],
        tuned: &'d [&'d dyn Tune],
        lives: &'d (dyn Fn(mbox::Processor) -> u32 + Sync),
    ) -> Result<Tables<'d, M>, ProgramError> {
        let (mut servers, mut samplers) = (Vec::new(), Vec::new());
        let (mut watched, mut tuned, mut before) = (watched, tuned, (0, 0));
        for (one, selections) in self.loops.iter().zip(all_selections) {
            let own = one.tuned - before.1;
            let has_rate = !matches!(one.bounds, RateBounds::Fixed);
            let (blocks, later) = watched
                .split_at_checked(one.watched - before.0)
                .unwrap_or_default();
            let (parameters, rest) = tuned
                .split_at_checked(own + usize::from(has_rate))
                .unwrap_or_default();
            (watched, tuned, before) = (later, rest, (one.watched, one.tuned));
            if blocks.is_empty() && parameters.is_empty() {
                let _ = samplers.push(None);
                continue;
            }
            let settings = VariableSettings {
                rate: (one.rate.numerator(), one.rate.denominator()),
                rows: variables::rows(one.rate, blocks.is_empty() && own == 0),
                watchers: condor_vars::MOST_WATCHERS as u32,
            };
            let (catalog, first) = (Catalog::new(blocks, parameters), self.allocator.used());
            let exclusion = self.machine.exclusion();
            let opened = selections.open(
                catalog,
                &self.own,
                &mut self.allocator,
                &settings,
                exclusion,
                lives,
            );
            let (server, sampler) = opened.map_err(|error| variables::wrong(one.name, error))?;
            let (objects, allocator) = (&mut self.objects, &mut self.allocator);
            enter(objects, allocator, one.name, ObjectKind::Variables, first)?;
            let _ = samplers.push(Some(sampler));
            // As many as there are loops.
            let _ = servers.push(server);
        }
        match watched.first().map(|it| name_of(*it)) {
            Some(name) => Err(ProgramError::LeftOver { name }),
            None => Ok((servers, samplers)),
        }
    }

    /// Makes the cells of the counts of interrupts and loops.
    fn reports(&mut self) -> Result<Reports<M>, ProgramError> {
        let interrupts = (self.interrupts).map(|_| self.publish_fields(Interrupts::NAME));
        let mut reports = Vec::new();
        for one in self.loops.iter() {
            let report =
                LoopReport::new(&self.own, &mut self.allocator, &mut self.objects, one.name);
            // As many as there are loops.
            let _ =
                reports.push(report.map_err(|error| ProgramError::not_entered(one.name, error))?);
        }
        Ok((interrupts.transpose()?, reports))
    }

    /// Enters what has been placed from `first` on.
    fn enter(&mut self, name: &str, kind: ObjectKind, first: u32) -> Result<(), ProgramError> {
        enter(&mut self.objects, &mut self.allocator, name, kind, first)
    }

    fn full(&mut self, what: &'static str, capacity: usize, name: &str) {
        self.wrong.get_or_insert(ProgramError::Full {
            what,
            capacity,
            name: ShortText::of(name),
        });
    }
}

/// The rates that the background follows, each with the one that it has set last, in Hz.
fn followed<'r>(rates: &'r [Option<RateParam<'r>>]) -> Vec<FollowedRate<'r>, LOOPS> {
    let numbered = (0..).map(LoopId).zip(rates);
    fitting(numbered.filter_map(|(id, rate)| {
        let rate = rate.as_ref()?;
        Some((id, rate, Cell::new(rate.wanted())))
    }))
}

/// Runs the handler of a message to this program, or the listener for a message that it hears.
fn handle(
    handlers: &List<(Vector, &str, MessageHandler<'_>), HANDLERS>,
    listens: Option<(mbox::Processor, ListenerFunction<'_>)>,
    call: &HandlerCall<'_>,
) -> u32 {
    if call.addressee() != call.number() {
        if let Some((_, listener)) = listens {
            listener(call);
        }
        return 0;
    }
    let mut known = handlers.iter();
    let handler = known.find(|(vector, ..)| *vector == call.vector());
    handler.map_or(0, |(.., handler)| handler(call))
}

/// Runs `run`, and serves the interrupts of boards meanwhile, if there are some.
fn with_boards<M: Machine, R>(
    machine: &M,
    entry: Option<&dyn InterruptEntry>,
    run: impl FnOnce() -> Result<R, ProgramError>,
) -> Result<R, ProgramError> {
    match entry {
        Some(entry) => machine.with_interrupts(entry, run)?,
        None => run(),
    }
}

fn enter<W: MemoryWindow>(
    objects: &mut ObjectTable<W>,
    allocator: &mut Allocator,
    name: &str,
    kind: ObjectKind,
    first: u32,
) -> Result<(), ProgramError> {
    let len = allocator.used() - first;
    let entered = objects.enter(allocator, name, kind, first, len);
    entered.map_err(|error| ProgramError::not_entered(name, error))
}

/// Returns the users' region of the `data` of `processor`: the part of its shared memory in which
/// programs place objects, behind the line that the doorbell uses.
///
/// # Errors
/// [`ProgramError::Mailbox`] if there is no such processor; [`ProgramError::Access`] if its memory is too small.
pub fn users<M: Machine>(
    machine: &M,
    processor: mbox::Processor,
) -> Result<Region<M::Window>, ProgramError> {
    let mut windows = machine.windows().into_iter();
    let windows = windows.nth(processor.index());
    let windows = windows.ok_or(mbox::MailboxError::NoSuchProcessor {
        number: processor,
        processors: PROCESSORS as u8,
    })?;
    Ok(Region::users(windows.data)?)
}
