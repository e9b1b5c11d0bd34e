//! Motions while everything is killed and cut.

use std::fs;
use std::path::PathBuf;
use std::process::Child;
use std::time::{Duration, Instant};

use condor_gateway::config::{Config, access_control};
use condor_remote::network::configure;
use serde_json::json;
use verdict::log::{CLIENTS, PLACE};
use zenoh::Wait;

use crate::between::Between;
use crate::client::{ROBOT, count_done, password};
use crate::hosts::{Host, Hosts};
use crate::random::Random;
use crate::system::{Outcome, Up, own};

/// The whole run may take so long on a machine that has much else to do, and so much per motion.
const PATIENCE: Duration = Duration::from_secs(300);
const PATIENCE_EACH: Duration = Duration::from_secs(10);
/// At most so many kills and failures, and so many for each motion that was done.
const EVENTS: usize = 10;
const EVENTS_EACH: usize = 2;
/// The file of the rules of the router.
const RULES: &str = "access.json";

/// Is a router at a place, for those whom its passwords and rules let in, until it is killed.
pub(crate) fn route(arguments: &[String]) -> Outcome<()> {
    let place = arguments.first().ok_or("no place")?;
    let files = PathBuf::from(std::env::var_os(PLACE).ok_or("no directory")?);
    let rules = fs::read_to_string(files.join(RULES))?;
    let config = configure(&[
        ("mode", json!("router")),
        ("listen/endpoints", json!([place])),
        ("scouting/multicast/enabled", json!(false)),
        (
            "transport/auth/usrpwd/dictionary_file",
            json!(files.join("passwords")),
        ),
        ("access_control", serde_json::from_str(&rules)?),
    ])?;
    let _session = zenoh::open(config)
        .wait()
        .map_err(|error| error.to_string())?;
    loop {
        std::thread::park();
    }
}

/// A process of the test, which is started again when it has ended.
struct Role {
    namespace: Option<String>,
    arguments: Vec<String>,
    process: Child,
}

impl Role {
    fn start(up: &Up, namespace: Option<String>, arguments: &[&str]) -> Outcome<Self> {
        let mut command = own(up.place(), namespace.as_deref())?;
        let process = command.args(arguments).spawn()?;
        Ok(Self {
            namespace,
            arguments: arguments.iter().map(|&it| it.into()).collect(),
            process,
        })
    }

    /// Kills it; returns true if it still ran.
    fn kill(&mut self) -> Outcome<bool> {
        let ran = self.process.try_wait()?.is_none();
        self.process.kill()?;
        self.process.wait()?;
        Ok(ran)
    }

    /// Starts it again if it was killed; returns true if it has ended well.
    fn look(&mut self, up: &Up) -> Outcome<bool> {
        match self.process.try_wait()? {
            Some(status) if status.success() => return Ok(true),
            Some(_) => {
                let mut command = own(up.place(), self.namespace.as_deref())?;
                self.process = command.args(&self.arguments).spawn()?;
            }
            None => {}
        }
        Ok(false)
    }
}

impl Drop for Role {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.kill();
    }
}

fn number(name: &str, usual: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(usual, |text| text.parse().expect("a number"))
}

/// Runs everything on this host, with proxies that cut connections.
pub(crate) fn with_proxies() -> Outcome<()> {
    run(Between::proxies()?)
}

/// Runs everything on hosts whose links fail, if this machine has network namespaces.
pub(crate) fn with_hosts() -> Outcome<()> {
    match Hosts::new()? {
        Ok(hosts) => run(Between::Links(hosts)),
        Err(error) => {
            println!(
                "NOT RUN: there are no network namespaces here, so only proxies cut connections: {error}"
            );
            Ok(())
        }
    }
}

/// The configuration of the gateway; the robot is a user of the router.
fn config(between: &Between) -> String {
    let clients: String = CLIENTS
        .map(|name| {
            format!(
                "[[clients]]\nname = {name:?}\nmay = [\"look\", \"move\"]\nwhen_gone = \"go-on\"\n"
            )
        })
        .concat();
    let (place, password) = (between.place(Host::Robot), password(ROBOT));
    format!(
        "robot = {ROBOT:?}\nrouters = {{ connect = [{place:?}], password = {password:?} \
         }}\n{clients}"
    )
}

fn run(mut between: Between) -> Outcome<()> {
    let (motions, seed) = (
        number("CONDOR_REMOTE_MOTIONS", 40),
        number("CONDOR_SEED", 1),
    );
    let began = Instant::now();
    let patience = PATIENCE + PATIENCE_EACH * u32::try_from(motions)?;
    let mut random = Random::new(seed);
    let config = config(&between);
    let users = CLIENTS.iter().chain([&ROBOT]);
    let passwords = users.map(|name| format!("{name}:{}\n", password(name)));
    let passwords = passwords.collect::<Vec<_>>().concat();
    let mut up = Up::new(&config, &passwords, "max", between.namespace(Host::Robot))?;
    let access = access_control(&[Config::parse(&config)?]);
    fs::write(up.place().join(RULES), access.to_string())?;
    let place = between.place(Host::Router);
    let mut router = Role::start(&up, between.namespace(Host::Router), &["router", &place])?;
    let mut roles = Vec::new();
    let mut left = motions;
    for index in 0..CLIENTS.len() {
        let own = left / (CLIENTS.len() - index) as u64;
        left -= own;
        let words = [
            index.to_string(),
            own.to_string(),
            between.place(Host::Clients),
        ];
        let [index, own, place] = &words;
        let namespace = between.namespace(Host::Clients);
        roles.push(Role::start(&up, namespace, &["client", index, own, place])?);
    }
    // Of clients, router, gateway, master, supervisor, and cuts.
    let mut kills = [0_usize; 6];
    let mut next = Instant::now();
    let mut events = 0;
    loop {
        if began.elapsed() > patience {
            return Err(format!("no end within {patience:?}:\n{}", up.told()).into());
        }
        up.look()?;
        between.look()?;
        router.look(&up)?;
        let mut done = true;
        for role in &mut roles {
            done &= role.look(&up)?;
        }
        if done {
            break;
        }
        // Where each start takes long, nothing would be done at all between two failures.
        if Instant::now() >= next && events < EVENTS + EVENTS_EACH * count_done(up.place()) {
            events += 1;
            let what = match random.below(16) {
                0 => 4,
                1..4 => 3,
                4..6 => 2,
                6..8 => 1,
                8..12 => 0,
                _ => 5,
            };
            kills[what] += match what {
                0 => {
                    let role = random.below(CLIENTS.len() as u64) as usize;
                    usize::from(roles[role].kill()?)
                }
                1 => usize::from(router.kill()?),
                2 => usize::from(up.kill("gateway")?),
                3 => usize::from(up.kill("master")?),
                4 => usize::from(up.kill("supervisor")?),
                _ => between.fail(&mut random)?,
            };
            next = Instant::now() + Duration::from_millis(50 + random.below(500));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    up.end(began + patience)?;
    let verdict = verdict::of(up.place())?;
    let [clients, router, gateway, master, supervisor, failures] = kills;
    let failures = between.told(failures)?;
    println!(
        "{motions} motions, seed {seed}, {:.0} s: {clients} kills of clients, {router} of the router, {gateway} of the \
         gateway, {master} of the master, {supervisor} of the supervisor; {failures}\n{verdict}",
        began.elapsed().as_secs_f64()
    );
    let mut wrong = verdict.wrong_of(motions);
    if wrong.is_empty() {
        return Ok(());
    }
    wrong.push(up.told());
    Err(wrong.join("\n").into())
}
