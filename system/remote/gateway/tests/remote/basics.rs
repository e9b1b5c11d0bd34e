//! Looking, tuning and moving, and what is refused.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use condor_remote::wire::{RemoteRequest, by};
use condor_remote::{Id, Network, Remote, RemoteAccess, RemoteError, RemoteState};
use serde_json::{Value as Json, json};
use zenoh::Wait;

use crate::client::{ROBOT, motion};
use crate::proxy::Proxy;
use crate::system::{Outcome, Up, free_port, own};

const SOON: Duration = Duration::from_secs(60);
/// Long enough for an answer, if there were one.
const SHORT: Duration = Duration::from_secs(2);

/// Runs all of it.
pub(crate) fn run() -> Outcome<()> {
    let port = free_port()?;
    let place = format!("tcp/127.0.0.1:{port}");
    let config = format!(
        r#"
        robot = "{ROBOT}"
        listen = ["{place}"]
        passwords = "passwords"
        variables = ["index.proximal.position", "index.proximal-flexor.gains.kp"]
        grace_ms = 100
        [[clients]]
        name = "lab"
        may = ["look", "tune", "move"]
        [[clients]]
        name = "notebook"
        may = ["look", "tune", "move"]
        [[clients]]
        name = "desk"
        may = ["look"]
        [[clients]]
        name = "night"
        may = ["look", "move"]
        when_gone = "go-on"
        "#
    );
    let mut up = Up::new(
        &config,
        "lab:secret\nnotebook:fourth\ndesk:other\nnight:third\n",
        "4",
        None,
    )?;
    let result = checks(&mut up, &place);
    let told = up.told();
    up.end(Instant::now() + SOON)?;
    result.map_err(|error| format!("{error}\n{told}").into())
}

fn open(place: &str, user: &str, password: &str) -> Outcome<Network> {
    let access = RemoteAccess {
        password: Some(password.into()),
        ..RemoteAccess::to(place)
    };
    Ok(Network::open(&access, user, SHORT)?)
}

fn checks(up: &mut Up, place: &str) -> Outcome<()> {
    let deadline = Instant::now() + SOON;
    let network = loop {
        match open(place, "lab", "secret") {
            Ok(network) => break network,
            Err(error) => check(Instant::now() < deadline, error.to_string())?,
        }
    };
    let robots = network.robots(SOON)?;
    check(robots == [ROBOT], format!("robots: {robots:?}"))?;
    let lab = Remote::new(&network, ROBOT)?;
    looks(&lab)?;
    tunes(&lab)?;
    moves(up, &lab)?;
    refuses(place, &lab)?;
    program(up, place)?;
    python(place)?;
    dies(up, place, lab, network)?;
    let told = up.told();
    for line in [
        "lab: sets index.proximal-flexor.gains.kp",
        "lab: offers motion",
        "lab: stops all motion",
        "lab: withdraws motion",
        "lab: sends 7 to vector 99 of plant",
    ] {
        check(told.contains(line), format!("the log has no `{line}`"))?;
    }
    Ok(())
}

fn check(is_right: bool, otherwise: String) -> Outcome<()> {
    if is_right {
        Ok(())
    } else {
        Err(otherwise.into())
    }
}

fn looks(lab: &Remote) -> Outcome<()> {
    let status = lab.status(SOON)?;
    let names: Vec<_> = status["processors"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|it| it["name"].clone())
        .collect();
    check(names.contains(&json!("master")), format!("{names:?}"))?;
    let deadline = Instant::now() + SOON;
    // The programs are about to start.
    let mut stream = loop {
        match lab.subscribe("/servo_a/", SOON) {
            Ok(stream) => break stream,
            Err(RemoteError::NoTopic { .. }) if Instant::now() < deadline => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Err(error) => return Err(error.into()),
        }
    };
    let columns: Vec<_> = stream.columns().map(str::to_owned).collect();
    check(
        columns.contains(&"index.proximal-flexor.gains.kp".into()),
        format!("{columns:?}"),
    )?;
    let mut last = None;
    for _ in 0..200 {
        let message = stream.next(SOON)?.ok_or("no row")?;
        let row = stream.row(&message)?.ok_or("no row")?;
        let head = row.head();
        if let Some(last) = last.replace(head.tick) {
            // Every tick comes, or is counted.
            let expected = last + 1 + head.lost + message.lost;
            check(
                message.lost > 0 || head.tick == expected,
                format!("tick {} after {last}, {} lost", head.tick, head.lost),
            )?;
        }
    }
    let mut events = lab.subscribe("/events", SOON)?;
    lab.get("index.proximal-flexor.gains.kp", SOON)?;
    check(events.next(SOON)?.is_some(), "no event".into())
}

fn tunes(lab: &Remote) -> Outcome<()> {
    let before = lab.get("index.proximal-flexor.gains.kp", SOON)?;
    let new = json!(before.as_f64().ok_or("no number")? * 1.25);
    let was = lab.set(
        "index.proximal-flexor.gains.kp",
        Some(before.clone()),
        new.clone(),
        SOON,
    )?;
    check(was == before, format!("it was {was}"))?;
    let now = lab.get("index.proximal-flexor.gains.kp", SOON)?;
    check(now == new, format!("it is {now}"))?;
    for (from, value, complaint) in [
        (None, json!(2e9), "must be from"),
        (Some(before.clone()), before.clone(), "present value"),
        (None, json!("soft"), "is not a value"),
    ] {
        let error = lab
            .set("index.proximal-flexor.gains.kp", from, value, SOON)
            .err()
            .ok_or("it was set")?;
        check(error.to_string().contains(complaint), error.to_string())?;
    }
    lab.set("index.proximal-flexor.gains.kp", None, before, SOON)?;
    let reply = lab.send("plant", "99", 7, SOON);
    check(reply.is_err(), format!("nobody has it, but: {reply:?}"))?;
    let error = lab
        .get("index.proximal-flexor.gains.kpp", SOON)
        .err()
        .ok_or("there is no such name")?;
    check(
        error.to_string().contains("index.proximal-flexor.gains.kp"),
        error.to_string(),
    )
}

/// Has a motion run, as soon as the hand is enabled.
fn until_done(up: &mut Up, remote: &Remote, motion: &[u8]) -> Outcome<Id> {
    let deadline = Instant::now() + SOON;
    loop {
        up.look()?;
        let id = remote.next_id(SOON)?;
        remote.offer(id, motion, false, SOON)?;
        let outcome = remote.wait(id, SOON)?;
        match outcome.state {
            RemoteState::Done => return Ok(id),
            RemoteState::Refused if Instant::now() < deadline => {
                std::thread::sleep(Duration::from_millis(50));
            }
            _ => return Err(format!("{outcome:?}").into()),
        }
    }
}

fn moves(up: &mut Up, lab: &Remote) -> Outcome<()> {
    let id = until_done(up, lab, b"open")?;
    let again = lab.offer(id, b"open", false, SOON)?;
    check(again.state == RemoteState::Done, format!("{again:?}"))?;
    let unknown = lab.run(b"no-such-motion", SOON)?;
    check(
        unknown.state == RemoteState::Refused && unknown.state.did_not_run(),
        format!("{unknown:?}"),
    )?;
    // One that was withdrawn does not run, though it comes later.
    let id = lab.next_id(SOON)?;
    check(
        lab.outcome(id, SOON)?.state == RemoteState::New,
        "it is not new".into(),
    )?;
    check(
        lab.withdraw(id, SOON)?.state == RemoteState::Refused,
        "it is not withdrawn".into(),
    )?;
    let late = lab.offer(id, b"fist", false, SOON)?;
    check(late.reason == "it was withdrawn", format!("{late:?}"))?;
    // One of a session that does not exist.
    let early = Id {
        session: 1,
        number: 1,
    };
    check(
        lab.offer(early, b"fist", false, SOON)?.state == RemoteState::Forgotten,
        "an early one".into(),
    )?;
    let id = lab.next_id(SOON)?;
    lab.offer(id, &motion(2, 0.9, 100.0)?, false, SOON)?;
    lab.stop(SOON)?;
    let stopped = lab.wait(id, SOON)?;
    check(
        stopped.state == RemoteState::Aborted,
        format!("{stopped:?}"),
    )
}

fn refuses(place: &str, lab: &Remote) -> Outcome<()> {
    let desk = Remote::new(&open(place, "desk", "other")?, ROBOT)?;
    desk.status(SOON)?;
    let error = desk
        .set("index.proximal-flexor.gains.kp", None, json!(1.0), SHORT)
        .err()
        .ok_or("desk has tuned")?;
    println!("desk tunes: {error}");
    let error = desk.run(b"open", SHORT).err().ok_or("desk has moved")?;
    println!("desk moves: {error}");
    // With another password, and with a name that is not in the list.
    for (user, password) in [("lab", "other"), ("nobody", "secret")] {
        check(
            open(place, user, password).is_err(),
            format!("{user} is connected"),
        )?;
    }
    // With a password of its own, and the name of another.
    let access = RemoteAccess {
        password: Some("other".into()),
        ..RemoteAccess::to(place)
    };
    let forger = zenoh::open(access.config("desk", SHORT)?)
        .wait()
        .map_err(|error| error.to_string())?;
    let ask = |client: &str| -> Outcome<bool> {
        let query = forger
            .get(by(ROBOT, client, "look"))
            .payload(RemoteRequest::Status {}.payload());
        let replies = query
            .timeout(SHORT)
            .wait()
            .map_err(|error| error.to_string())?;
        Ok(replies.recv().is_ok_and(|reply| reply.result().is_ok()))
    };
    let deadline = Instant::now() + SOON;
    while !ask("desk")? {
        check(Instant::now() < deadline, "desk cannot look".into())?;
    }
    check(!ask("lab")?, "desk has looked as lab".into())?;
    lab.status(SOON)?;
    Ok(())
}

/// `condor --remote`, if `CONDOR_REMOTE_PROGRAM` is the program `condor-remote`.
fn program(up: &Up, place: &str) -> Outcome<()> {
    let Some(program) = std::env::var_os("CONDOR_REMOTE_PROGRAM") else {
        return Ok(());
    };
    let robots = up.place().join("remote.toml");
    let text = format!(
        "client = \"notebook\"\n[robots.{ROBOT}]\nconnect = [{place:?}]\npassword = \"fourth\"\n"
    );
    fs::write(&robots, text)?;
    let folder = Path::new(&program).parent().ok_or("no folder")?;
    let call = |is_remote: bool, words: &[&str]| -> Outcome<String> {
        let mut command = own(up.place(), None)?;
        if is_remote {
            command.env("PATH", folder).args(["--remote", ROBOT]);
            command.arg("--robots").arg(&robots);
        }
        let output = command.args(words).stdout(Stdio::piped()).output()?;
        let told = String::from_utf8(output.stdout)?;
        check(output.status.success(), format!("{words:?}: {told}"))?;
        Ok(told)
    };
    let both = |words: &[&str], key: &str| -> Outcome<[Json; 2]> {
        let answer = |is_remote| -> Outcome<Json> {
            let answer: Json = serde_json::from_str(&call(is_remote, words)?)?;
            Ok(answer[key].clone())
        };
        Ok([answer(true)?, answer(false)?])
    };
    let gain = "index.proximal-flexor.gains.kp";
    let [remote, local] = both(&["vars", "get", gain, "--json"], "variables")?;
    check(
        remote == local && remote[0]["value"].is_number(),
        format!("{remote} {local}"),
    )?;
    let [remote, local] = both(&["vars", "list", "--json"], "variables")?;
    let names = |rows: &Json| -> Vec<Json> {
        let rows = rows.as_array().into_iter().flatten();
        rows.map(|row| row["name"].clone()).collect()
    };
    check(
        names(&remote) == names(&local) && names(&local).len() > 10,
        format!("{remote} {local}"),
    )?;
    let [remote, local] = both(&["ps", "--json"], "processors")?;
    check(names(&remote) == names(&local), format!("{remote} {local}"))?;
    // A row of each value, and what people read.
    for (words, expected) in [
        (&["ps"][..], "mailbox"),
        (&["vars", "get", gain], gain),
        (&["vars", "get", "index.proximal.position"], "rad"),
        (&["vars", "list", "servo-a"], "can be set to"),
        (&["vars", "watch", "index.*", "--rows", "3"], gain),
        (&["vars", "watch", gain, "--for", "100ms", "--json"], gain),
        (&["plot", gain, "--span", "100ms"], "values"),
        (&["run", "open"], "open: done"),
    ] {
        let told = call(true, words)?;
        check(told.contains(expected), format!("{words:?}: {told}"))?;
    }
    println!("checked by `condor --remote`");
    Ok(())
}

/// The client in Python, if `CONDOR_REMOTE_PYTHON` names an interpreter that has `eclipse-zenoh`.
fn python(place: &str) -> Outcome<()> {
    let Some(python) = std::env::var_os("CONDOR_REMOTE_PYTHON") else {
        return Ok(());
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/check.py");
    let output = Command::new(python).args([script, place]).output()?;
    let told = String::from_utf8_lossy(&output.stderr);
    check(
        output.status.success(),
        format!("the client in Python: {told}"),
    )?;
    print!("{}", String::from_utf8_lossy(&output.stdout));
    Ok(())
}

/// A client goes while its motion runs.
fn dies(up: &mut Up, place: &str, lab: Remote, network: Network) -> Outcome<()> {
    let night_network = open(place, "night", "third")?;
    let night = Remote::new(&night_network, ROBOT)?;
    until_done(up, &night, &motion(2, 0.6, 0.2)?)?;
    let id = night.next_id(SOON)?;
    night.offer(id, &motion(2, 0.9, 4.0)?, false, SOON)?;
    let error = lab.offer(night.next_id(SOON)?, b"fist", false, SOON);
    let error = error.err().ok_or("lab has used a session of night")?;
    check(
        error.to_string().contains("one of another client"),
        error.to_string(),
    )?;
    drop((night, night_network));
    let night_network = open(place, "night", "third")?;
    let night = Remote::new(&night_network, ROBOT)?;
    let outcome = night.wait(id, SOON)?;
    check(
        outcome.state == RemoteState::Done,
        format!("night was away: {outcome:?}"),
    )?;

    let id = begin(&lab)?;
    drop((lab, network));
    is_stopped(up, place, id, 1)?;
    // The same without an end of the connection.
    let port = place.rsplit(':').next().ok_or("no port")?;
    let proxy = Proxy::before(port.parse()?)?;
    let network = open(&proxy.place(), "lab", "secret")?;
    let id = begin(&Remote::new(&network, ROBOT)?)?;
    let remote = Remote::new(&network, ROBOT)?;
    proxy.fall_silent();
    is_stopped(up, place, id, 2)?;
    drop(remote);
    // Its end waits for nobody.
    proxy.cut();

    // The gateway itself goes: nobody is left to see whether the client is there.
    let network = open(place, "lab", "secret")?;
    let lab = Remote::new(&network, ROBOT)?;
    let id = begin(&lab)?;
    up.kill("gateway")?;
    let outcome = lab.wait(id, SOON)?;
    check(
        outcome.state == RemoteState::Aborted,
        format!("the gateway was away: {outcome:?}"),
    )?;
    let next = lab.next_id(SOON)?;
    check(next.session > id.session, format!("{next} after {id}"))
}

/// Begins a motion that does not end by itself.
fn begin(lab: &Remote) -> Outcome<Id> {
    let id = lab.next_id(SOON)?;
    let outcome = lab.offer(id, &motion(2, 0.6, 1000.0)?, false, SOON)?;
    check(!outcome.state.is_final(), format!("lab moves: {outcome:?}"))?;
    Ok(id)
}

/// Waits until it is noticed for the `count`-th time that lab is gone, and checks that its motion was stopped.
fn is_stopped(up: &Up, place: &str, id: Id, count: usize) -> Outcome<()> {
    let deadline = Instant::now() + SOON;
    while up.told().matches("lab: has disconnected").count() < count {
        check(
            Instant::now() < deadline,
            "nobody notices that lab is gone".into(),
        )?;
        std::thread::sleep(Duration::from_millis(20));
    }
    let network = open(place, "lab", "secret")?;
    let lab = Remote::new(&network, ROBOT)?;
    let outcome = lab.wait(id, SOON)?;
    check(
        outcome.state == RemoteState::Aborted,
        format!("lab was away: {outcome:?}"),
    )
}
