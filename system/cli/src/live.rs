//! `condor view`: a running system for a page in browsers, and for viewers that speak the Foxglove websocket protocol;
//! and `condor sim`: the page for a robot without any processor.

mod calls;
mod connection;
mod feeds;
#[cfg(any(feature = "hostile", test))]
pub(crate) mod hostile;
mod page;
mod parameter_worker;
mod protocol;
mod scene;
mod server;
mod session;
mod simulation;
mod worker;

pub(crate) use simulation::Workshop;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::net::{Ipv4Addr, SocketAddr};
use std::thread::Scope;
use std::time::{Duration, Instant};

use crate::listening::{Rules, Token};
use condor_host::control::SystemStatus;
use condor_host::error::{AnyError, me, tell};
use condor_host::events::EventCollector;
use condor_host::messages::wall_ns;
use condor_host::names::VariableName;
use condor_host::plain::plain;
use condor_host::robot::Robot;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_host::watching::{CatalogEntry, NewPrograms, Rows, VariableCatalog};
use feeds::Feeds;
use parameter_worker::{ParameterWorker, WorkerMessage};
use server::Server;
use session::{Ask, Catalog};
use worker::Worker;

/// The time between two messages of the simulated time.
const TIME: Duration = Duration::from_millis(50);
/// The time between two looks whether the system still runs.
const CHECK: Duration = Duration::from_secs(1);
/// The time between two looks at clients where there are no rows.
const LOOK: Duration = Duration::from_millis(5);

/// The system that is shown, and the rules for its viewers.
pub(crate) struct Stage<'s> {
    pub(crate) directory: &'s SystemDirectory,
    pub(crate) status: &'s SystemStatus,
    /// Patterns of the variables to show.
    pub(crate) patterns: &'s [String],
    pub(crate) robot: Option<&'s dyn Robot>,
    /// The parts of a simulation in which clients try postures and motions of the robot.
    pub(crate) workshop: Option<Workshop<'s>>,
    pub(crate) door: Door,
}

/// The address at which clients connect, and the rules for them.
pub(crate) struct Door {
    pub(crate) listen: SocketAddr,
    pub(crate) rules: Rules,
}

/// The parts that run while clients are served.
struct Live<'s> {
    view: &'s View,
    is_simulated: bool,
    rows: Rows<'s>,
    newcomers: NewPrograms,
    events: EventCollector<'s>,
    feeds: Feeds<'s>,
    parameter_worker: ParameterWorker,
    worker: Option<Worker>,
    server: Server,
    /// The parameters of which any client wants to know changes.
    watched: BTreeSet<usize>,
    /// When clients were told the simulated time.
    timed: Option<Instant>,
}

/// Serves until it `ends`, and says who was there. `view` has joined; `still_runs` returns an error
/// when the system has ended.
pub(crate) fn serve(
    stage: Stage<'_>,
    view: &View,
    ends: impl Fn() -> bool,
    still_runs: impl Fn() -> Result<(), AnyError>,
) -> Result<(), AnyError> {
    std::thread::scope(|scope| {
        let mut live = Live::open(stage, view, scope)?;
        let mut checked = Instant::now();
        let result = loop {
            if ends() {
                break Ok(());
            }
            let mut turn = live.turn();
            if checked.elapsed() >= CHECK {
                checked = Instant::now();
                turn = still_runs().and(turn);
            }
            if turn.is_err() {
                break turn;
            }
        };
        live.close()?;
        result
    })
}

/// Serves a robot without a system until it `ends`, under this name.
pub(crate) fn simulate(
    name: &str,
    workshop: Workshop<'_>,
    door: Door,
    ends: impl Fn() -> bool,
) -> Result<(), AnyError> {
    std::thread::scope(|scope| {
        let (mut worker, services) = Worker::start(scope, workshop)?;
        let catalog = Catalog {
            name: name.into(),
            session: wall_ns().to_string(),
            services,
            ..Catalog::default()
        };
        let mut server = door.open(catalog, ["the robot", "save motions"])?;
        while !ends() {
            server.turn(Instant::now())?;
            worker.turn(&mut server, LOOK);
            // There are no parameters.
            if let Some((client, Ask::Get { id, .. } | Ask::Set { id, .. })) = server.ask() {
                server.take(WorkerMessage::Answer {
                    client,
                    parameters: Vec::new(),
                    id,
                    troubles: Vec::new(),
                });
            }
        }
        let clients = server.close().clients;
        writeln!(std::io::stdout(), "clients: {clients}")?;
        Ok(())
    })
}

impl<'s> Live<'s> {
    fn open<'scope>(
        stage: Stage<'s>,
        view: &'s View,
        scope: &'scope Scope<'scope, 's>,
    ) -> Result<Self, AnyError> {
        let status = stage.status;
        let is_simulated = status.clock.is_some();
        let known = VariableCatalog::all(view, &status.processors)?;
        known.tell_troubles();
        let newcomers = NewPrograms::after(&known, &status.processors, stage.patterns);
        let columns = columns(&known, stage.patterns, stage.robot)?;
        let rows = Rows::of(view, &columns, 1)?;
        let now_ns = view.now().as_ns();
        // Simulated time is shown as it is.
        let at_ns = if is_simulated { now_ns } else { wall_ns() };
        let ahead_ns = at_ns.wrapping_sub(now_ns);
        let (parameters, names) = parameters(&known);
        let (feeds, channels) = Feeds::new(
            &known,
            &rows.sources,
            &columns,
            &parameters,
            stage.robot,
            [ahead_ns, at_ns],
        );
        let events = EventCollector::of(stage.directory, status, view)?;
        let parameter_worker = ParameterWorker::open(
            scope,
            stage.directory.clone(),
            status.window_bytes,
            status.processors.clone(),
            parameters.clone(),
        )?;
        let worker = stage.workshop.map(|it| Worker::start(scope, it));
        let (worker, services) = worker.transpose()?.unzip();
        let catalog = Catalog {
            name: status.system.clone(),
            session: wall_ns().to_string(),
            has_time: is_simulated,
            channels,
            services: services.unwrap_or_default(),
            parameters,
            names,
        };
        let server = stage.door.open(catalog, ["the system", "set parameters"])?;
        Ok(Self {
            view,
            is_simulated,
            rows,
            newcomers,
            events,
            feeds,
            parameter_worker,
            worker,
            server,
            watched: BTreeSet::new(),
            timed: None,
        })
    }

    /// Hands on what has come from the system and from the clients, and waits for more.
    fn turn(&mut self) -> Result<(), AnyError> {
        let (server, feeds) = (&mut self.server, &mut self.feeds);
        let wanted = server.wanted();
        self.rows
            .read(|source, row| feeds.row(source, row, &wanted, |sample| server.push(&sample)))?;
        for change in self.rows.changes() {
            tell(plain(&change.text));
            server.tell(&change.text);
        }
        let at_ns = self.view.now().as_ns();
        self.events.look(self.view, |level, source, text| {
            server.push(&feeds.event(at_ns, level, source, text));
        })?;
        let now = Instant::now();
        if self.is_simulated && self.timed.is_none_or(|timed| now - timed >= TIME) {
            server.set_time(self.view.now().as_ns());
            self.timed = Some(now);
        }
        server.turn(now)?;
        self.parameter_worker
            .messages()
            .for_each(|message| server.take(message));
        if self.parameter_worker.is_free()
            && let Some((client, ask)) = server.ask()
        {
            self.parameter_worker.ask(client, ask);
        }
        let watched = server.watched();
        if watched != self.watched {
            self.parameter_worker.watch(watched.clone());
            self.watched = watched;
        }
        if let Some(worker) = &mut self.worker {
            worker.turn(server, Duration::ZERO);
        }
        self.take_newcomers();
        self.rows.pause()
    }

    /// Shows the rows of programs that have come since.
    fn take_newcomers(&mut self) {
        let ones = self.newcomers.look(self.view);
        if ones.is_empty() {
            return;
        }
        let columns: Vec<_> = ones.iter().collect();
        let known = self.rows.sources.len();
        self.rows.extend(&columns);
        let sources = self.rows.sources.get(known..).unwrap_or_default();
        let first = self.server.channels();
        let channels = self.feeds.add(first, sources, &columns);
        self.server.advertise(channels);
        if ones.iter().any(CatalogEntry::can_be_set) {
            let me = me();
            let text = format!(
                "parameters of programs that started later can be set by `{me} vars set`, or here after `{me} view` is \
                 started again"
            );
            tell(&text);
            self.server.tell(&text);
        }
    }

    fn close(self) -> Result<(), AnyError> {
        let totals = self.server.close();
        let mut out = std::io::stdout().lock();
        for source in &self.rows.sources {
            let (name, kept) = (source.name(), source.kept(source.rows));
            writeln!(out, "{}: {kept}", plain(&name))?;
        }
        let (clients, sent, lost) = (totals.clients, totals.sent, totals.lost);
        writeln!(out, "clients: {clients}; samples: {sent} sent, {lost} lost")?;
        Ok(())
    }
}

/// Returns the variables to read: what the patterns stand for, and those of the robot that there are.
fn columns<'k>(
    known: &'k VariableCatalog,
    patterns: &[String],
    robot: Option<&dyn Robot>,
) -> Result<Vec<&'k CatalogEntry>, AnyError> {
    let joints = robot.map(Robot::joints).unwrap_or_default();
    let of_joints = joints.iter().flat_map(feeds::variables).cloned();
    let of_robot = of_joints.chain(robot.map(scene::variables).unwrap_or_default());
    let mut wanted: Vec<_> = of_robot.filter(|name| known.find(name).is_ok()).collect();
    if patterns.is_empty() {
        wanted.push("*".into());
    }
    wanted.extend_from_slice(patterns);
    Ok(known.matching(&wanted)?)
}

/// Returns the shortest name of each parameter, and all names that one has and no other variable.
fn parameters(known: &VariableCatalog) -> (Vec<String>, BTreeMap<String, usize>) {
    let all: Vec<_> = known.all.iter().filter(|one| one.can_be_set()).collect();
    let shortest = known.labels(&all);
    let mut names = BTreeMap::new();
    for (place, one) in all.iter().enumerate() {
        let own = one.names().into_iter();
        let own = own.filter(|name| known.find(name).is_ok());
        names.extend(own.map(|name| (name, place)));
    }
    (shortest, names)
}

impl Door {
    /// Opens the door, and tells where it is: what is shown there, and what those may do who have the token.
    fn open(self, catalog: Catalog, told: [&str; 2]) -> Result<Server, AnyError> {
        let token = self.rules.token.clone();
        let server = Server::bind(self.listen, self.rules, catalog)?;
        invite(server.address()?, &token, told)?;
        Ok(server)
    }
}

/// Says where to connect: numerically, since another user may listen at what else `localhost` stands
/// for, and would be told the token.
fn invite(address: SocketAddr, token: &Token, [what, trusted]: [&str; 2]) -> Result<(), AnyError> {
    let mut host = address;
    let mut others = "";
    if address.ip().is_unspecified() {
        host.set_ip(Ipv4Addr::LOCALHOST.into());
        others = " (or at any address of this machine)";
    }
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "http://{host}/ shows {what}{others} in a browser, and ws://{host}/ in Foxglove, Lichtblick or PlotJuggler"
    )?;
    writeln!(
        out,
        "http://{host}/#token={token} and ws://{host}/?token={token} also {trusted}"
    )?;
    writeln!(
        out,
        "applications of the desktop may need `--origin file://`"
    )?;
    Ok(out.flush()?)
}

#[cfg(test)]
mod tests {
    use super::hostile;
    use proptest::prelude::*;

    #[test]
    fn fragments_without_content_do_not_keep_a_turn() {
        hostile::fragments();
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]

        #[test]
        fn samples_are_sent_in_order_or_counted(bytes: Vec<u8>) {
            hostile::session(&bytes);
        }

        #[test]
        fn connections_bear_anything(bytes: Vec<u8>) {
            hostile::connection(&bytes);
        }
    }
}
