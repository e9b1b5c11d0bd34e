//! [`Config`]: the configuration file of a gateway.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use condor_host::error::AnyError;
use condor_platform::linux::read_text;
use condor_remote::network::{configure, connect};
use condor_remote::wire::{Right, alive, all_here, by, check_name, root, stream};
use serde::Deserialize;
use serde_json::{Value as Json, json};

/// The configuration of a gateway, as its TOML file has it. [`read`](Self::read) reads it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The name of the robot in the network.
    pub robot: String,
    /// The places where clients connect, as zenoh writes them, such as `tcp/0.0.0.0:7447`.
    #[serde(default)]
    pub listen: Vec<String>,
    /// The routers to which the gateway connects.
    #[serde(default)]
    pub routers: Option<Routers>,
    /// Whether the gateway answers searches by multicast.
    #[serde(default)]
    pub scouting: bool,
    /// The file with a line `CLIENT:PASSWORD` for each client.
    #[serde(default)]
    pub passwords: Option<PathBuf>,
    /// Certificates.
    #[serde(default)]
    pub tls: Option<GatewayTls>,
    /// The variables of the streams, by name or pattern.
    #[serde(default)]
    pub variables: Vec<String>,
    /// The number of ticks from one row of a stream to the next.
    #[serde(default = "one")]
    pub every: u32,
    /// The time that a client may be away before its motions stop, in milliseconds.
    #[serde(default = "second")]
    pub grace_ms: u64,
    /// The time without any message after which a connection counts as lost, in milliseconds.
    #[serde(default = "seconds")]
    pub lease_ms: u64,
    /// The clients; others may do nothing.
    #[serde(default)]
    pub clients: Vec<ClientRights>,
}

const fn one() -> u32 {
    1
}

const fn second() -> u64 {
    1_000
}

const fn seconds() -> u64 {
    2_000
}

/// The zenoh routers to which a gateway connects, and the user that it is there. If clients connect to a router, the
/// router must check their identities: the gateway cannot.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Routers {
    /// The places where the routers listen.
    pub connect: Vec<String>,
    /// The user that the gateway is there, or without a password the common name of its certificate; by default the
    /// name of the robot.
    #[serde(default)]
    pub user: Option<String>,
    /// The password of that user.
    #[serde(default)]
    pub password: Option<String>,
}

/// The files of the certificates with which a gateway proves its identity, and checks those of clients and routers.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GatewayTls {
    /// The gateway's certificate.
    pub certificate: PathBuf,
    /// The private key of that certificate.
    pub private_key: PathBuf,
    /// The certificates of the authorities by which the certificates of clients and routers are checked. The common
    /// name of a client's certificate is the client's name. `None` if no certificate is checked.
    pub authority: Option<PathBuf>,
}

/// A client that may use the gateway: its name, the requests that it may make, and the fate of its motions when it is
/// gone.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClientRights {
    /// Its name, which is its user or the common name of its certificate, too.
    pub name: String,
    /// The rights of the client.
    pub may: BTreeSet<Right>,
    /// The fate of its motions when it is gone.
    #[serde(default)]
    pub when_gone: WhenGone,
}

/// The fate of a client's motions when the client has been away for longer than [`Config::grace_ms`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhenGone {
    /// All motion stops.
    #[default]
    Stop,
    /// The motions of the client run on.
    GoOn,
}

impl Config {
    /// Reads and checks the configuration in the file `path`. Relative paths in it start at the directory of that file.
    ///
    /// # Errors
    /// Returns an error that says what is wrong, and where, if a file cannot be read, if the configuration is not
    /// valid, or if other users of this machine can read the file of passwords.
    pub fn read(path: &Path) -> Result<Self, AnyError> {
        let shown = path.display();
        let text = read_text(path).map_err(|error| format!("cannot read {shown}: {error}"))?;
        let config = Self::parse(&text).map_err(|error| format!("{shown}: {error}"))?;
        let beside = |file: &mut PathBuf| *file = path.with_file_name("").join(&*file);
        let mut config = config;
        config.passwords.iter_mut().for_each(beside);
        if let Some(tls) = &mut config.tls {
            beside(&mut tls.certificate);
            beside(&mut tls.private_key);
            tls.authority.iter_mut().for_each(beside);
        }
        if let Some(passwords) = &config.passwords {
            let shown = passwords.display();
            let mode =
                fs::metadata(passwords).map_err(|error| format!("cannot read {shown}: {error}"))?;
            if mode.permissions().mode() & 0o077 != 0 {
                return Err(format!(
                    "others can read {shown}; `chmod 600` keeps the passwords secret"
                )
                .into());
            }
        }
        Ok(config)
    }

    /// Parses and checks the text of a configuration. Paths stay as they are, and no file is read.
    ///
    /// # Errors
    /// Returns an error text that names the fault if this is not a valid configuration.
    pub fn parse(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        check_name("robot", &self.robot)?;
        let mut names = BTreeSet::new();
        for client in &self.clients {
            check_name("client", &client.name)?;
            if !names.insert(&client.name) {
                return Err(format!("two clients are called `{}`", client.name));
            }
        }
        if self.listen.is_empty() && self.routers.is_none() {
            return Err("neither `listen` nor `routers` says how clients reach the gateway".into());
        }
        if self.every == 0 {
            return Err("`every` is 0; it must be 1 (every tick) or more".into());
        }
        for place in &self.listen {
            if !place.starts_with("tcp/") && !place.starts_with("tls/") {
                return Err(format!(
                    "the address `{place}` must begin with tcp/ or tls/"
                ));
            }
            if !is_loopback(place) && !self.knows_clients() {
                return Err(format!(
                    "other machines can reach `{place}`, and nothing proves who a client is: add `passwords`, or \
                     `tls` with an `authority`"
                ));
            }
            if place.starts_with("tls/") && self.tls.is_none() {
                return Err(format!(
                    "the address `{place}` needs certificates: add the table `tls`"
                ));
            }
        }
        if self.routers.is_some() && !self.listen.is_empty() && self.knows_clients() {
            return Err(
                "with `passwords` or an `authority`, a gateway has either `listen` or `routers`: behind a router, the \
                 router listens to clients"
                    .into(),
            );
        }
        let routers = self.routers.iter();
        for place in routers.flat_map(|routers| &routers.connect) {
            let has_secret = self.tls.is_some()
                || self
                    .routers
                    .as_ref()
                    .is_some_and(|it| it.password.is_some());
            if !is_loopback(place) && !has_secret {
                return Err(format!(
                    "the router `{place}` is another machine, and nothing proves who the gateway is: \
                     add `user` and `password` of `routers`, or `tls`"
                ));
            }
        }
        Ok(())
    }

    /// Returns true if clients must prove who they are.
    fn knows_clients(&self) -> bool {
        self.passwords.is_some() || self.tls.as_ref().is_some_and(|tls| tls.authority.is_some())
    }

    /// Returns true if the client called `client` has the right `right`. A client that is not in the configuration has
    /// none.
    #[must_use]
    pub fn may(&self, client: &str, right: Right) -> bool {
        let mut clients = self.clients.iter();
        clients.any(|it| it.name == client && it.may.contains(&right))
    }

    /// Returns the names of the clients with [`WhenGone::Stop`]: if one of them is gone and a motion of its own has not
    /// ended, all motion stops.
    #[must_use]
    pub fn stops(&self) -> BTreeSet<String> {
        let clients = self
            .clients
            .iter()
            .filter(|it| it.when_gone == WhenGone::Stop);
        clients.map(|it| it.name.clone()).collect()
    }

    /// Returns the time for which a client may be away before [`WhenGone`] applies to its motions.
    #[must_use]
    pub const fn grace(&self) -> Duration {
        Duration::from_millis(self.grace_ms)
    }

    /// Returns the configuration with which the gateway opens its session of zenoh: places, certificates, passwords,
    /// and access control.
    ///
    /// # Errors
    /// Returns [`RemoteError::Zenoh`](condor_remote::RemoteError::Zenoh) if zenoh refuses a value; its text names the
    /// value.
    pub fn zenoh(&self) -> Result<zenoh::Config, AnyError> {
        let (tls, routers) = (self.tls.as_ref(), self.routers.as_ref());
        let path = |path: Option<&PathBuf>| json!(path.map(|path| path.display().to_string()));
        let certificate = path(tls.map(|it| &it.certificate));
        let private_key = path(tls.map(|it| &it.private_key));
        let authority = tls.and_then(|it| it.authority.as_ref());
        let connects = routers.map_or(&[][..], |it| &it.connect);
        let access = if self.knows_clients() && !self.listen.is_empty() {
            access_control(core::slice::from_ref(self))
        } else {
            Json::Null
        };
        let password = routers.and_then(|it| it.password.as_ref());
        Ok(configure(&[
            ("mode", "peer".into()),
            ("listen/endpoints", json!(self.listen)),
            ("connect", connect(connects, -1)),
            ("scouting/multicast/enabled", self.scouting.into()),
            ("scouting/gossip/enabled", false.into()),
            ("transport/link/tx/lease", self.lease_ms.into()),
            ("transport/unicast/max_sessions", 64.into()),
            (
                "transport/auth/usrpwd/user",
                json!(password.map(|_| self.own_user())),
            ),
            ("transport/auth/usrpwd/password", json!(password)),
            (
                "transport/auth/usrpwd/dictionary_file",
                path(self.passwords.as_ref()),
            ),
            ("transport/link/tls/root_ca_certificate", path(authority)),
            ("transport/link/tls/listen_certificate", certificate.clone()),
            ("transport/link/tls/listen_private_key", private_key.clone()),
            ("transport/link/tls/connect_certificate", certificate),
            ("transport/link/tls/connect_private_key", private_key),
            ("transport/link/tls/enable_mtls", authority.is_some().into()),
            ("access_control", access),
        ])?)
    }

    /// Returns the user that the gateway is at routers, or the common name of its certificate.
    fn own_user(&self) -> &str {
        let user = self.routers.as_ref().and_then(|it| it.user.as_deref());
        user.unwrap_or(&self.robot)
    }

    /// Adds the rules for the clients of this robot, and for its gateway at a router.
    fn add_rules(&self, access: &mut AccessControl) {
        let (robot, any) = (&self.robot, "*");
        let password = self.routers.as_ref().and_then(|it| it.password.as_ref());
        let property = if self.passwords.is_some() || password.is_some() {
            "usernames"
        } else {
            "cert_common_names"
        };
        let found = ["liveliness_query", "declare_liveliness_subscriber"];
        let answers = ["liveliness_token", "reply", "declare_queryable"];
        let both = [
            rule("ingress", &found, &[alive(any)]),
            rule("egress", &answers, &[alive(robot), by(robot, any, any)]),
        ];
        for client in &self.clients {
            let name = &client.name;
            let keys = client.may.iter();
            let keys: Vec<_> = keys.map(|right| by(robot, name, right.word())).collect();
            let mut rules = Vec::from(both.clone());
            rules.push(rule("ingress", &["query"], &keys));
            let here = [all_here(robot, name)];
            rules.push(rule("ingress", &["liveliness_token"], &here));
            if client.may.contains(&Right::Look) {
                let streams = [stream(robot, "/**")];
                rules.push(rule("ingress", &["declare_subscriber"], &streams));
                rules.push(rule("egress", &["put"], &streams));
            }
            access.add(robot, property, name, rules);
        }
        if self.routers.is_some() {
            let all = [
                "put",
                "declare_subscriber",
                "query",
                "reply",
                "declare_queryable",
                "liveliness_token",
                "liveliness_query",
                "declare_liveliness_subscriber",
            ];
            let keys = [alive(any), format!("{}/**", root(robot))];
            let rules = ["ingress", "egress"].map(|flow| rule(flow, &all, &keys));
            access.add(robot, property, self.own_user(), rules.into());
        }
    }
}

/// Returns the part `access_control` of zenoh's configuration for the gateways that have these `configs`. Each client
/// may use only the keys that have its own name and its rights; zenoh knows the client by its user or its certificate.
/// A gateway needs it for its own configuration; a router between clients and gateways, for those of all its gateways.
#[must_use]
pub fn access_control(configs: &[Config]) -> Json {
    let mut access = AccessControl::default();
    for config in configs {
        config.add_rules(&mut access);
    }
    let AccessControl {
        rules,
        subjects,
        policies,
    } = access;
    json!({
        "enabled": true, "default_permission": "deny",
        "rules": rules, "subjects": subjects, "policies": policies,
    })
}

/// The lists of zenoh's access control.
#[derive(Default)]
struct AccessControl {
    rules: Vec<Json>,
    subjects: Vec<Json>,
    policies: Vec<Json>,
}

impl AccessControl {
    /// Adds the rules for a robot of those whose `property` is `name`.
    fn add(&mut self, robot: &str, property: &str, name: &str, rules: Vec<Json>) {
        let subject = format!("{robot}/{name}");
        let mut ids = Vec::new();
        // A rule without keys is refused.
        let rules = rules.into_iter().filter(|it| it["key_exprs"] != json!([]));
        for (number, mut rule) in rules.enumerate() {
            let id = format!("{subject}/{number}");
            rule["id"] = json!(id);
            ids.push(id);
            self.rules.push(rule);
        }
        self.subjects
            .push(json!({ "id": subject, property: [name] }));
        self.policies
            .push(json!({ "rules": ids, "subjects": [subject] }));
    }
}

/// Makes a rule, which has no identity yet.
fn rule(flow: &str, messages: &[&str], keys: &[String]) -> Json {
    json!({ "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys })
}

/// Returns true if a place can be reached from this machine alone.
fn is_loopback(place: &str) -> bool {
    let address = place.split_once('/').map_or(place, |(_, address)| address);
    let address = address.split(['#', '?']).next().unwrap_or_default();
    let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    host == "localhost"
        || host
            .parse::<std::net::IpAddr>()
            .is_ok_and(|host| host.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        robot = "hand"
        listen = ["tcp/127.0.0.1:7447"]
        [[clients]]
        name = "lab"
        may = ["look", "move"]
        [[clients]]
        name = "desk"
        may = ["look"]
        when_gone = "go-on"
    "#;

    #[test]
    fn a_client_may_what_its_list_says_and_others_nothing() {
        let config = Config::parse(TEXT).expect("a configuration");
        let may = |client| Right::ALL.map(|right| config.may(client, right));
        assert_eq!(may("lab"), [true, false, true]);
        assert_eq!(may("desk"), [true, false, false]);
        assert_eq!(may("other"), [false; 3]);
        assert_eq!(config.stops(), ["lab".to_owned()].into());
    }

    #[test]
    fn nobody_listens_to_a_network_without_knowing_who_speaks() {
        for place in [
            "tcp/0.0.0.0:7447",
            "tcp/[::]:7447",
            "tcp/robot.local:7447",
            "tcp/192.168.0.2:1",
        ] {
            let text = TEXT.replace("tcp/127.0.0.1:7447", place);
            let error = Config::parse(&text).unwrap_err();
            assert!(
                error.contains(place) && error.contains("passwords"),
                "{error}"
            );
            let text = format!("passwords = \"passwords\"\n{text}");
            Config::parse(&text).expect("clients have passwords");
        }
        for place in ["tcp/[::1]:7447", "tcp/localhost:7447#iface=lo"] {
            Config::parse(&TEXT.replace("tcp/127.0.0.1:7447", place)).expect("this machine");
        }
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (from, to, complaint) in [
            ("\"hand\"", "\"my hand\"", "`my hand`"),
            ("\"desk\"", "\"lab\"", "two clients are called `lab`"),
            ("\"move\"", "\"fly\"", "unknown variant `fly`"),
            ("robot", "robots", "unknown field `robots`"),
            ("tcp/", "udp/", "must begin with tcp/ or tls/"),
            ("tcp/", "tls/", "certificates"),
            (
                "[\"tcp/127.0.0.1:7447\"]",
                "[]",
                "neither `listen` nor `routers`",
            ),
            (
                "[[clients]]\n        name = \"lab\"",
                "passwords = \"passwords\"\nrouters = { connect = [\"tcp/127.0.0.1:1\"] }\n[[clients]]\nname = \"lab\"",
                "either `listen` or `routers`",
            ),
        ] {
            let error = Config::parse(&TEXT.replace(from, to)).unwrap_err();
            assert!(error.contains(complaint), "{error}");
        }
    }

    #[test]
    fn zenoh_takes_the_rules_for_clients() {
        let text = format!("passwords = \"passwords\"\n{TEXT}");
        let config = Config::parse(&text).expect("a configuration");
        config.zenoh().expect("zenoh takes it");
        let access = access_control(&[config]);
        assert_eq!(access["subjects"][0]["usernames"][0], "lab");
        let rules = access["rules"].to_string();
        assert!(rules.contains("condor/hand/by/lab/move"), "{rules}");
        assert!(!rules.contains("condor/hand/by/desk/move"), "{rules}");
    }
}
