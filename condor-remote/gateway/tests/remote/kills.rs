//! Motions while everything is killed and cut.

use std::fs;
use std::process::Child;
use std::time::{Duration, Instant};

use condor_remote::network::configure;
use serde_json::json;
use zenoh::Wait;

use crate::client::{CLIENTS, ROBOT};
use crate::proxy::Proxy;
use crate::system::{Outcome, Up, free_port, own};
use crate::verdict;

/// The whole run may take so long on a machine that has much else to do, and so much per motion.
const PATIENCE: Duration = Duration::from_secs(300);
const PATIENCE_EACH: Duration = Duration::from_secs(10);

/// Numbers that look random, the same ones in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// Is a router at a port, until it is killed.
pub(crate) fn route(arguments: &[String]) -> Outcome<()> {
    let port = arguments.first().ok_or("no port")?;
    let config = configure(&[
        ("mode", json!("router")),
        ("listen/endpoints", json!([format!("tcp/127.0.0.1:{port}")])),
        ("scouting/multicast/enabled", json!(false)),
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
    arguments: Vec<String>,
    process: Child,
}

impl Role {
    fn start(up: &Up, arguments: &[&str]) -> Outcome<Self> {
        let process = own(up.place())?.args(arguments).spawn()?;
        Ok(Self {
            arguments: arguments.iter().map(|&it| it.into()).collect(),
            process,
        })
    }

    /// Kills it; returns whether it still ran.
    fn kill(&mut self) -> Outcome<bool> {
        let ran = self.process.try_wait()?.is_none();
        self.process.kill()?;
        self.process.wait()?;
        Ok(ran)
    }

    /// Starts it again if it was killed; returns whether it has ended well.
    fn look(&mut self, up: &Up) -> Outcome<bool> {
        match self.process.try_wait()? {
            Some(status) if status.success() => return Ok(true),
            Some(_) => self.process = own(up.place())?.args(&self.arguments).spawn()?,
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

/// Runs everything.
pub(crate) fn run() -> Outcome<()> {
    let (motions, seed) = (
        number("CONDOR_REMOTE_MOTIONS", 40),
        number("CONDOR_SEED", 1),
    );
    let began = Instant::now();
    let patience = PATIENCE + PATIENCE_EACH * u32::try_from(motions)?;
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let router_port = free_port()?;
    // One for the gateway, one for the clients.
    let proxies = [Proxy::before(router_port)?, Proxy::before(router_port)?];
    let clients: String = CLIENTS
        .map(|name| {
            format!(
                "[[clients]]\nname = {name:?}\nmay = [\"look\", \"move\"]\nwhen_gone = \"go-on\"\n"
            )
        })
        .concat();
    let config = format!(
        "robot = {ROBOT:?}\njournal = \"motions.journal\"\nrouters = {{ connect = [{:?}] }}\n{clients}",
        proxies[0].place()
    );
    let mut up = Up::new(&config, "", "max")?;
    let mut router = Role::start(&up, &["router", &router_port.to_string()])?;
    let mut roles = Vec::new();
    let mut left = motions;
    for index in 0..CLIENTS.len() {
        let own = left / (CLIENTS.len() - index) as u64;
        left -= own;
        let words = [index.to_string(), own.to_string(), proxies[1].place()];
        roles.push(Role::start(
            &up,
            &["client", &words[0], &words[1], &words[2]],
        )?);
    }
    // Of clients, router, gateway, master, supervisor, and cuts.
    let mut kills = [0_usize; 6];
    let mut next = Instant::now();
    loop {
        if began.elapsed() > patience {
            return Err(format!("no end within {patience:?}:\n{}", up.told()).into());
        }
        up.look()?;
        router.look(&up)?;
        let mut done = true;
        for role in &mut roles {
            done &= role.look(&up)?;
        }
        if done {
            break;
        }
        if Instant::now() >= next {
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
                _ => proxies[random.below(2) as usize].cut(),
            };
            next = Instant::now() + Duration::from_millis(50 + random.below(500));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    up.end(began + patience)?;
    let (counts, mut wrong) = verdict::of(up.place(), motions)?;
    let [clients, router, gateway, master, supervisor, cuts] = kills;
    println!(
        "{motions} motions, seed {seed}, {:.0} s: {clients} kills of clients, {router} of the router, {gateway} of the \
         gateway, {master} of the master, {supervisor} of the supervisor, {cuts} connections cut\n{counts}",
        began.elapsed().as_secs_f64()
    );
    if wrong.is_empty() {
        return Ok(());
    }
    let journal = fs::read_to_string(up.place().join("motions.journal"))?;
    wrong.extend([up.told(), journal]);
    Err(wrong.join("\n").into())
}
