//! [`RemoteAccess`]: how a client reaches gateways and routers; [`Network`]: the robots that are there.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::Deserialize;
use serde_json::{Value as Json, json};
use zenoh::{Config, Session, Wait};

use crate::error::RemoteError;
use crate::wire;

/// The places at which a client reaches gateways and routers, and the password or certificate by which it proves its
/// identity.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RemoteAccess {
    /// The places to connect to, as zenoh writes them: `tcp/192.168.0.2:7447`, `tls/robot.local:7447`. The first that
    /// answers is used.
    pub connect: Vec<String>,
    /// The password; its user is the client's name.
    pub password: Option<String>,
    /// Certificates, for places that begin with `tls/`.
    pub tls: Option<ClientTls>,
    /// Whether robots are also searched by multicast.
    pub scouting: bool,
}

/// The files of the certificates with which a client checks a gateway or router, and proves its own identity.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClientTls {
    /// The certificate of the authority that has signed the gateway's.
    pub authority: PathBuf,
    /// The client's certificate, whose common name is the client's name.
    pub certificate: Option<PathBuf>,
    /// The client's private key.
    pub private_key: Option<PathBuf>,
}

impl RemoteAccess {
    /// Makes the access to one place, such as `tcp/192.168.0.2:7447`, without a password or certificate.
    #[must_use]
    pub fn to(place: &str) -> Self {
        Self {
            connect: vec![place.into()],
            ..Self::default()
        }
    }

    /// Returns the configuration with which zenoh opens a session for the client called `client`. Opening waits for a
    /// connection, `timeout` at most.
    ///
    /// # Errors
    /// Returns [`RemoteError::Zenoh`] if zenoh refuses a value.
    pub fn config(&self, client: &str, timeout: Duration) -> Result<Config, RemoteError> {
        let timeout_ms = i64::try_from(timeout.as_millis())
            .unwrap_or(i64::MAX)
            .max(1);
        let tls = self.tls.as_ref();
        let path = |path: Option<&PathBuf>| path.map(|path| path.display().to_string());
        let password = self.password.as_ref();
        configure(&[
            ("mode", json!("client")),
            ("connect", connect(&self.connect, timeout_ms)),
            ("scouting/multicast/enabled", self.scouting.into()),
            ("scouting/gossip/enabled", false.into()),
            (
                "transport/auth/usrpwd/user",
                password.map(|_| client).into(),
            ),
            ("transport/auth/usrpwd/password", json!(password)),
            (
                "transport/link/tls/root_ca_certificate",
                path(tls.map(|it| &it.authority)).into(),
            ),
            (
                "transport/link/tls/connect_certificate",
                path(tls.and_then(|it| it.certificate.as_ref())).into(),
            ),
            (
                "transport/link/tls/connect_private_key",
                path(tls.and_then(|it| it.private_key.as_ref())).into(),
            ),
            (
                "transport/link/tls/enable_mtls",
                tls.is_some_and(|it| it.certificate.is_some()).into(),
            ),
        ])
    }
}

/// Returns the part `connect` of zenoh's configuration for the given `allocator`, such as `tcp/192.168.0.2:7447`.
/// `timeout_ms` is the longest time in milliseconds that opening a session waits for the first connection, and fails
/// without one; with -1, opening does not wait. A connection that is lost is made again, without any limit.
#[must_use]
pub fn connect(places: &[String], timeout_ms: i64) -> Json {
    json!({
        "endpoints": places,
        "timeout_ms": timeout_ms,
        "exit_on_failure": timeout_ms >= 0,
        "retry": { "period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2.0 },
    })
}

/// Makes a configuration of zenoh from the keys and values in `values`. A value of `null` keeps the default of its key.
///
/// # Errors
/// [`RemoteError::Zenoh`] if zenoh refuses a value.
pub fn configure(values: &[(&str, Json)]) -> Result<Config, RemoteError> {
    let mut config = Config::default();
    for (key, value) in values.iter().filter(|(_, value)| !value.is_null()) {
        let set = config.insert_json5(key, &value.to_string());
        set.map_err(|error| RemoteError::Zenoh(format!("{key}: {error}")))?;
    }
    Ok(config)
}

/// A client's connection to gateways and routers. If the connection is lost, it is made again.
/// [`Remote`](crate::Remote) uses it for one robot.
#[derive(Clone, Debug)]
pub struct Network {
    pub(crate) session: Session,
    pub(crate) client: String,
}

impl Network {
    /// Connects under the name `client`, and waits for the connection, `timeout` at most.
    ///
    /// # Errors
    /// Returns [`RemoteError::Name`] if `client` is not a valid name; [`RemoteError::Zenoh`] if there is no connection
    /// within `timeout`: nothing listens there, or the password or the certificate is refused.
    pub fn open(
        access: &RemoteAccess,
        client: &str,
        timeout: Duration,
    ) -> Result<Self, RemoteError> {
        wire::check_name("client", client).map_err(RemoteError::Name)?;
        let session = zenoh::open(access.config(client, timeout)?).wait()?;
        Ok(Self {
            session,
            client: client.into(),
        })
    }

    /// Waits until at least one robot can be reached, `timeout` at most. Returns the names of all robots whose gateways
    /// run, in alphabetical order; none if the time is over.
    ///
    /// # Errors
    /// [`RemoteError::Zenoh`] if zenoh fails.
    pub fn robots(&self, timeout: Duration) -> Result<Vec<String>, RemoteError> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let liveliness = self.session.liveliness();
            let replies = liveliness.get(wire::alive("*")).timeout(left).wait()?;
            let mut robots = Vec::new();
            while let Ok(Some(reply)) = replies.recv_timeout(left) {
                if let Ok(sample) = reply.result() {
                    robots.extend(wire::robot_of(sample.key_expr().as_str()).map(str::to_owned));
                }
            }
            robots.sort_unstable();
            robots.dedup();
            if !robots.is_empty() || Instant::now() >= deadline {
                return Ok(robots);
            }
            std::thread::sleep(crate::PAUSE);
        }
    }
}
