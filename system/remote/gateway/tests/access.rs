//! Who may ask what: by certificates at a gateway, and by passwords at a router for several robots.
//!
//! No system runs, so a request that is let in is refused for that reason, and all others are not answered.

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use condor_gateway::config::{Config, access_control};
use condor_gateway::{Gateway, SystemChoice};
use condor_remote::network::configure;
use condor_remote::wire::{RemoteRequest, by};
use condor_remote::{ClientTls, Network, Remote, RemoteAccess, RemoteError};
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
use serde_json::json;
use zenoh::Wait;

const SOON: Duration = Duration::from_secs(60);
/// Long enough for an answer, if there were one.
const SHORT: Duration = Duration::from_secs(2);

/// The name of a system that does not run.
const NONE: &str = "condor-remote-test-none";

fn gateway(config: &Path) -> Gateway {
    let config = Config::read(config).expect("a configuration");
    Gateway::start(&config, &SystemChoice::Named(Some(NONE.into()))).expect("a gateway")
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("an address").port()
}

/// Returns true if a request has come to the gateway.
fn is_let_in<T: std::fmt::Debug>(answer: Result<T, RemoteError>) -> bool {
    match answer.expect_err("no system runs") {
        RemoteError::Refused(refusal) => {
            assert!(refusal.error.contains("system"), "{refusal}");
            true
        }
        RemoteError::NoAnswer { .. } => false,
        error => panic!("{error}"),
    }
}

/// Waits until a request comes to the gateway: rules and queries need some time to get around.
fn becomes_let_in<T: std::fmt::Debug>(ask: impl Fn() -> Result<T, RemoteError>) {
    let deadline = Instant::now() + SOON;
    while !is_let_in(ask()) {
        assert!(Instant::now() < deadline, "it never comes to the gateway");
    }
}

/// Returns true if the session of one client can ask in the name of another.
fn can_ask_as(access: &RemoteAccess, own: &str, other: &str) -> bool {
    let config = access.config(own, SOON).expect("a configuration");
    let forger = zenoh::open(config).wait().expect("a session");
    let query = forger.get(by("hand", other, "look"));
    let query = query
        .payload(RemoteRequest::Status {}.payload())
        .timeout(SHORT);
    let replies = query.wait().expect("a query");
    // The system does not run, so each answer is an error; one that is empty is zenoh's, for there is none.
    let reply = replies.recv_timeout(SHORT).ok().flatten();
    reply.is_some_and(|reply| match reply.result() {
        Ok(_) => true,
        Err(error) => error.payload().to_bytes().starts_with(b"{"),
    })
}

/// An authority, and the certificates that it signs.
struct Authority {
    issuer: Issuer<'static, KeyPair>,
}

impl Authority {
    fn new(place: &Path, file: &str) -> Self {
        let key = KeyPair::generate().expect("a key");
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let own = params.self_signed(&key).expect("a certificate");
        fs::write(place.join(file), own.pem()).expect("room");
        let issuer = Issuer::new(params, key);
        Self { issuer }
    }

    /// Writes a certificate with its key, for a common name.
    fn sign(&self, place: &Path, name: &str, file: &str) {
        let key = KeyPair::generate().expect("a key");
        let names = vec!["localhost".into(), "127.0.0.1".into()];
        let mut params = CertificateParams::new(names).expect("names");
        params
            .distinguished_name
            .push(DnType::CommonName, name.to_owned());
        let own = params.signed_by(&key, &self.issuer).expect("a certificate");
        fs::write(place.join(format!("{file}.pem")), own.pem()).expect("room");
        fs::write(place.join(format!("{file}.key")), key.serialize_pem()).expect("room");
    }
}

/// The access with a certificate, or without one.
fn with_certificate(place: &Path, port: u16, file: Option<&str>) -> RemoteAccess {
    let path = |end: &str| file.map(|file| place.join(format!("{file}.{end}")));
    RemoteAccess {
        tls: Some(ClientTls {
            authority: place.join("ca.pem"),
            certificate: path("pem"),
            private_key: path("key"),
        }),
        ..RemoteAccess::to(&format!("tls/127.0.0.1:{port}"))
    }
}

#[test]
fn the_name_of_a_client_is_that_of_its_certificate() {
    let directory = tempfile::tempdir().expect("a directory");
    let (place, port) = (directory.path(), free_port());
    let authority = Authority::new(place, "ca.pem");
    for name in ["hand", "lab", "desk"] {
        authority.sign(place, name, name);
    }
    Authority::new(place, "other.pem").sign(place, "lab", "forged");
    let text = format!(
        r#"
        robot = "hand"
        listen = ["tls/127.0.0.1:{port}"]
        tls = {{ certificate = "hand.pem", private_key = "hand.key", authority = "ca.pem" }}
        [[clients]]
        name = "lab"
        may = ["look", "tune"]
        [[clients]]
        name = "desk"
        may = ["look"]
        "#
    );
    fs::write(place.join("gateway.toml"), text).expect("room");
    let _gateway = gateway(&place.join("gateway.toml"));
    let open = |client: &str, file| {
        Network::open(&with_certificate(place, port, file), client, SHORT).map_err(drop)
    };
    let network = open("lab", Some("lab")).expect("it has a certificate");
    assert_eq!(network.robots(SOON).expect("robots"), ["hand"]);
    let lab = Remote::new(&network, "hand").expect("a robot");
    becomes_let_in(|| lab.status(SHORT));
    assert!(is_let_in(lab.set("kp", None, json!(1.0), SHORT)));
    assert!(!is_let_in(lab.stop(SHORT)), "lab may not move");
    let network = open("desk", Some("desk")).expect("it has a certificate");
    let desk = Remote::new(&network, "hand").expect("a robot");
    becomes_let_in(|| desk.status(SHORT));
    assert!(
        !is_let_in(desk.set("kp", None, json!(1.0), SHORT)),
        "desk may not tune"
    );
    let access = with_certificate(place, port, Some("desk"));
    assert!(can_ask_as(&access, "desk", "desk"));
    assert!(!can_ask_as(&access, "desk", "lab"));
    for file in [Some("forged"), None] {
        assert!(open("lab", file).is_err(), "lab with {file:?}");
    }
}

#[test]
fn without_a_proof_the_list_of_clients_decides() {
    let directory = tempfile::tempdir().expect("a directory");
    let (file, port) = (directory.path().join("gateway.toml"), free_port());
    let text = format!(
        "robot = \"hand\"\nlisten = [\"tcp/127.0.0.1:{port}\"]\n\
         [[clients]]\nname = \"desk\"\nmay = [\"look\"]\n"
    );
    fs::write(&file, text).expect("room");
    let _gateway = gateway(&file);
    let access = RemoteAccess::to(&format!("tcp/127.0.0.1:{port}"));
    let remote = |client: &str| {
        let network = Network::open(&access, client, SOON).expect("nobody asks for a proof");
        Remote::new(&network, "hand").expect("a robot")
    };
    let (desk, nobody) = (remote("desk"), remote("nobody"));
    becomes_let_in(|| desk.status(SHORT));
    for (refused, right) in [
        (desk.stop(SOON).map(drop), "move"),
        (desk.set("kp", None, json!(1.0), SOON).map(drop), "tune"),
        (nobody.status(SOON).map(drop), "look"),
    ] {
        let error = refused.expect_err("it has no right").to_string();
        assert!(error.contains(&format!("the right `{right}`")), "{error}");
    }
}

/// Starts the gateway of a robot behind a router; returns its configuration, too.
fn behind_router(place: &Path, port: u16, robot: &str, clients: &[&str]) -> (Gateway, Config) {
    let clients = clients
        .iter()
        .map(|name| format!("[[clients]]\nname = {name:?}\nmay = [\"look\", \"move\"]\n"));
    let clients = clients.collect::<Vec<_>>().concat();
    let text = format!(
        "robot = {robot:?}\n\
         routers = {{ connect = [\"tcp/127.0.0.1:{port}\"], password = \"of-{robot}\" }}\n{clients}"
    );
    let file = place.join(format!("{robot}.toml"));
    fs::write(&file, text).expect("room");
    let config = Config::read(&file).expect("a configuration");
    (gateway(&file), config)
}

#[test]
fn a_router_lets_clients_ask_those_robots_that_know_them() {
    let directory = tempfile::tempdir().expect("a directory");
    let (place, port) = (directory.path(), free_port());
    let passwords = place.join("passwords");
    let lines = ["hand", "arm", "lab", "desk"].map(|name| format!("{name}:of-{name}\n"));
    fs::write(&passwords, lines.concat()).expect("room");
    fs::set_permissions(&passwords, fs::Permissions::from_mode(0o600)).expect("an own file");
    let (_hand, of_hand) = behind_router(place, port, "hand", &["lab", "desk"]);
    let (_arm, of_arm) = behind_router(place, port, "arm", &["lab"]);
    let router = configure(&[
        ("mode", json!("router")),
        ("listen/endpoints", json!([format!("tcp/127.0.0.1:{port}")])),
        ("scouting/multicast/enabled", json!(false)),
        (
            "transport/auth/usrpwd/dictionary_file",
            json!(passwords.display().to_string()),
        ),
        ("access_control", access_control(&[of_hand, of_arm])),
    ]);
    let router = zenoh::open(router.expect("a configuration")).wait();
    let _router = router.expect("a router");
    let access = |name: &str| RemoteAccess {
        password: Some(format!("of-{name}")),
        ..RemoteAccess::to(&format!("tcp/127.0.0.1:{port}"))
    };
    let network = Network::open(&access("lab"), "lab", SOON).expect("it has a password");
    let deadline = Instant::now() + SOON;
    while network.robots(SOON).expect("robots") != ["arm", "hand"] {
        assert!(Instant::now() < deadline, "there are no two robots");
    }
    for robot in ["hand", "arm"] {
        let lab = Remote::new(&network, robot).expect("a robot");
        becomes_let_in(|| lab.status(SHORT));
        // Only a client that is known to be here gets as far as this.
        becomes_let_in(|| lab.run(b"wave", SHORT));
    }
    let network = Network::open(&access("desk"), "desk", SOON).expect("it has a password");
    let desk = |robot| Remote::new(&network, robot).expect("a robot");
    let hand = desk("hand");
    becomes_let_in(|| hand.status(SHORT));
    assert!(!is_let_in(desk("arm").status(SHORT)), "arm knows no desk");
    assert!(can_ask_as(&access("desk"), "desk", "desk"));
    assert!(!can_ask_as(&access("desk"), "desk", "lab"));
    assert!(Network::open(&access("desk"), "lab", SHORT).is_err());
}
