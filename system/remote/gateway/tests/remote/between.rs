//! [`Between`]: what is between the robot, the router of zenoh and the clients, and fails.

use crate::hosts::{Host, Hosts};
use crate::proxy::Proxy;
use crate::random::Random;
use crate::system::{Outcome, free_port};

/// The way from one process to another.
pub(crate) enum Between {
    /// All on this host; a proxy for the gateway, and one for the clients.
    Proxies { port: u16, proxies: [Proxy; 2] },
    /// On hosts of their own.
    Links(Hosts),
}

impl Between {
    /// Makes the proxies.
    pub(crate) fn proxies() -> Outcome<Self> {
        let port = free_port()?;
        let proxies = [Proxy::before(port)?, Proxy::before(port)?];
        Ok(Self::Proxies { port, proxies })
    }

    /// The namespace in which the processes of a host run.
    pub(crate) fn namespace(&self, host: Host) -> Option<String> {
        match self {
            Self::Proxies { .. } => None,
            Self::Links(hosts) => Some(hosts.namespace(host)),
        }
    }

    /// The place to which a host connects, or where the router listens.
    pub(crate) fn place(&self, of: Host) -> String {
        match self {
            Self::Links(_) => Hosts::place(),
            Self::Proxies { port, proxies } => match of {
                Host::Robot => proxies[0].place(),
                Host::Clients => proxies[1].place(),
                Host::Router => format!("tcp/127.0.0.1:{port}"),
            },
        }
    }

    /// Lets something fail; returns how many connections or links.
    pub(crate) fn fail(&mut self, random: &mut Random) -> Outcome<usize> {
        match self {
            Self::Proxies { proxies, .. } => Ok(proxies[random.below(2) as usize].cut()),
            Self::Links(hosts) => hosts.part(random).map(usize::from),
        }
    }

    /// Repairs what has failed for long enough.
    pub(crate) fn look(&mut self) -> Outcome<()> {
        match self {
            Self::Proxies { .. } => Ok(()),
            Self::Links(hosts) => hosts.look(),
        }
    }

    /// Tells what has failed, of which there were so many.
    pub(crate) fn told(&self, failures: usize) -> Outcome<String> {
        match self {
            Self::Proxies { .. } => Ok(format!("{failures} connections cut by proxies")),
            Self::Links(hosts) => hosts.told(),
        }
    }
}
