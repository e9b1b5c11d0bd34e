//! [`Hosts`]: a host for the robot, one for the router of zenoh and one for the clients, as network namespaces with a
//! router of packets between them, whose links are slow, lose packets, and part.

use std::process::{Command, id};
use std::time::{Duration, Instant};

use crate::random::Random;
use crate::system::Outcome;

/// A host of the test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Host {
    Robot,
    Router,
    Clients,
}

impl Host {
    const ALL: [Self; 3] = [Self::Robot, Self::Router, Self::Clients];

    /// The name of its namespace after the prefix, and of its link at the router of packets.
    const fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Router => "router",
            Self::Clients => "clients",
        }
    }
}

/// What makes a link slow, the best one first: not every kernel has it. In the other one packets wait for those before
/// them.
const SLOW: [&str; 2] = [
    "netem delay 3ms 1ms",
    "tbf rate 512kbit burst 2kb limit 20kb",
];
/// What loses one packet in a hundred: a program for the kernel's packet filter that compares a random number with
/// 2^32 / 100.
const LOSSY: &str = "4,32 0 0 4294963256,53 0 1 42949673,6 0 0 0,6 0 0 2";
/// What parts a link in the direction to a host.
const PARTED: &str = "pfifo limit 0";

/// The namespaces, which are removed with it.
pub(crate) struct Hosts {
    prefix: String,
    slow: &'static str,
    /// Until when each link is parted.
    parted: [Option<Instant>; 3],
    one_way: usize,
    both_ways: usize,
}

impl Hosts {
    /// Makes the namespaces; or else tells why this machine allows none.
    pub(crate) fn new() -> Outcome<Result<Self, String>> {
        let mut hosts = Self {
            prefix: format!("condor-{}", id()),
            slow: SLOW[0],
            parted: [None; 3],
            one_way: 0,
            both_ways: 0,
        };
        let between = hosts.between();
        if let Err(error) = call(&format!("ip netns add {between}")) {
            return Ok(Err(error.to_string()));
        }
        let forward = "echo 1 > /proc/sys/net/ipv4/ip_forward";
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &between, "sh", "-c", forward]);
        output(&mut command)?;
        for host in Host::ALL {
            let (space, link, net) = (hosts.namespace(host), host.name(), host as u8);
            for line in [
                format!("ip netns add {space}"),
                format!("ip link add {link} netns {between} type veth peer name up netns {space}"),
                format!("ip -n {between} address add 10.77.{net}.1/24 dev {link}"),
                format!("ip -n {between} link set dev {link} up"),
                format!("ip -n {space} address add 10.77.{net}.2/24 dev up"),
                format!("ip -n {space} link set dev lo up"),
                format!("ip -n {space} link set dev up up"),
                format!("ip -n {space} route add default via 10.77.{net}.1"),
            ] {
                call(&line)?;
            }
        }
        for host in Host::ALL {
            let link = host.name();
            call(&format!("tc -n {between} qdisc add dev {link} clsact"))?;
            let filter = format!("tc -n {between} filter add dev {link} egress bpf da bytecode");
            let mut command = Command::new("tc");
            output(command.args(filter.split(' ').skip(1)).arg(LOSSY))?;
        }
        if let Err(error) = hosts.shape(Host::Robot, SLOW[0]) {
            println!("{error}; instead: {}", SLOW[1]);
            hosts.slow = SLOW[1];
        }
        for host in Host::ALL {
            hosts.shape(host, hosts.slow)?;
        }
        Ok(Ok(hosts))
    }

    fn between(&self) -> String {
        format!("{}-between", self.prefix)
    }

    /// The namespace of a host.
    pub(crate) fn namespace(&self, host: Host) -> String {
        format!("{}-{}", self.prefix, host.name())
    }

    /// The place of the router of zenoh.
    pub(crate) fn place() -> String {
        format!("tcp/10.77.{}.2:7447", Host::Router as u8)
    }

    fn shape(&self, host: Host, how: &str) -> Outcome<()> {
        let (between, link) = (self.between(), host.name());
        call(&format!(
            "tc -n {between} qdisc replace dev {link} root {how}"
        ))
        .map(drop)
    }

    /// Parts a link for a while, in one direction or in both. Returns true if it was not parted.
    pub(crate) fn part(&mut self, random: &mut Random) -> Outcome<bool> {
        let host = Host::ALL[random.below(3) as usize];
        let (time, both) = (50 + random.below(1500), random.below(2) == 0);
        // Longer than a connection may be silent.
        let time = if random.below(12) == 0 { 3000 } else { time };
        if self.parted[host as usize].is_some() {
            return Ok(false);
        }
        if both {
            self.set(host, "down")?;
            self.both_ways += 1;
        } else {
            self.shape(host, PARTED)?;
            self.one_way += 1;
        }
        self.parted[host as usize] = Some(Instant::now() + Duration::from_millis(time));
        Ok(true)
    }

    fn set(&self, host: Host, state: &str) -> Outcome<()> {
        let (between, link) = (self.between(), host.name());
        call(&format!("ip -n {between} link set dev {link} {state}")).map(drop)
    }

    /// Joins the links whose time is over.
    pub(crate) fn look(&mut self) -> Outcome<()> {
        for host in Host::ALL {
            let parted = &mut self.parted[host as usize];
            if parted.take_if(|until| Instant::now() >= *until).is_some() {
                self.set(host, "up")?;
                self.shape(host, self.slow)?;
            }
        }
        Ok(())
    }

    /// The packets that were lost at random before a link to a host.
    fn lost(&self, host: Host) -> Outcome<u64> {
        let (between, link) = (self.between(), host.name());
        let told = call(&format!("tc -n {between} -s qdisc show dev {link}"))?;
        let (_, filter) = told.split_once("qdisc clsact").unwrap_or_default();
        let lost = filter.split("(dropped ").nth(1);
        let lost = lost.and_then(|rest| rest.split(',').next()?.parse().ok());
        Ok(lost.ok_or("tc does not tell what was lost")?)
    }

    /// Tells what the links did.
    pub(crate) fn told(&self) -> Outcome<String> {
        let lost = Host::ALL.map(|host| self.lost(host));
        let lost: u64 = lost.into_iter().sum::<Outcome<u64>>()?;
        let Self {
            slow,
            one_way,
            both_ways,
            ..
        } = self;
        Ok(format!(
            "three links with `{slow}`, parted {one_way} times in one direction and {both_ways} times in both, and \
             {lost} packets lost at random"
        ))
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        let hosts = Host::ALL.map(|host| self.namespace(host));
        for space in hosts.into_iter().chain([self.between()]) {
            // It may not have been made.
            let _ = call(&format!("ip netns delete {space}"));
        }
    }
}

/// Runs a line of words; returns what it prints.
fn call(line: &str) -> Outcome<String> {
    let mut words = line.split(' ');
    let mut command = Command::new(words.next().unwrap_or_default());
    output(command.args(words))
}

fn output(command: &mut Command) -> Outcome<String> {
    let output = command
        .output()
        .map_err(|error| format!("{command:?}: {error}"))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let told = String::from_utf8_lossy(&output.stderr);
    Err(format!("{command:?}: {}", told.trim()).into())
}
