//! `condor view`: viewers of a running system, good ones and others.

mod services;
mod viewer;

use std::io::{Read, Write};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use condor_vars::AnyValue as Scalar;
use rustix::net::sockopt::set_socket_recv_buffer_size;
use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::http::HeaderValue;
use tungstenite::protocol::frame::coding::CloseCode;

use crate::joint::{load_joint, start, start_one};
use crate::running::{self, DEADLINE};
use viewer::{Live, Ticks, Viewer};

const PRESENT: &str = "foxglove.sdk.v1";
const FORMER: &str = "foxglove.websocket.v1";

#[test]
fn both_names_of_the_subprotocol_are_spoken() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    for name in [PRESENT, FORMER] {
        let mut request = live.request("");
        let offered = HeaderValue::from_static(name);
        let headers = request.headers_mut();
        headers.insert("sec-websocket-protocol", offered.clone());
        let (_, response) = tungstenite::client(request, live.socket()).unwrap();
        assert_eq!(response.headers()["sec-websocket-protocol"], offered);
    }
    let viewer = live.viewer();
    assert_eq!(viewer.info["name"], "tested");
    assert_eq!(
        viewer.info["capabilities"],
        json!(["parameters", "parametersSubscribe"])
    );
    let topics: Vec<_> = viewer.channels.keys().collect();
    let loops = ["contact", "servo", "slow"];
    let expected = ["a", "b"].map(|it| loops.map(|owner| format!("/{it}/{owner}")));
    let others = ["/events".to_owned(), "/parameters".to_owned()];
    let [a, b] = &expected;
    // In the order of the alphabet.
    assert_eq!(topics, a.iter().chain(b).chain(&others).collect::<Vec<_>>());
}

#[test]
fn rows_come_one_after_the_other() {
    let up = start(&[]);
    let live = Live::start(&up, &["b:*", "a:joint.position"]);
    let mut viewer = live.viewer();
    let topics: Vec<_> = viewer.channels.keys().cloned().collect();
    let rows = ["/a/servo", "/b/contact", "/b/servo", "/b/slow"];
    assert_eq!(topics, [&rows[..], &["/events", "/parameters"]].concat());
    let position = viewer.subscribe(7, "/a/servo");
    let contact = viewer.subscribe(8, "/b/contact");
    viewer.subscribe(8, "/b/servo");
    let status = viewer.status("subscription 8 to /b/servo is refused");
    assert_eq!(status["level"], 2);
    let (mut ticks, mut times) = (Ticks::default(), Vec::new());
    for _ in 0..50 {
        let data = loop {
            let data = viewer.data();
            if data.subscription == 7 {
                break data;
            }
            let row = contact.decode(&data.payload).unwrap();
            assert_eq!(data.subscription, 8);
            assert_eq!(row.value(0), Some(Scalar::F32(1.5)));
        };
        ticks.take(&position, &data);
        let row = position.decode(&data.payload).unwrap();
        let expected = 0.5 * f64::from(u32::try_from(row.head().tick).unwrap());
        assert_eq!(row.value(0), Some(Scalar::F64(expected)));
        assert_eq!(row.head().stamp.as_ns(), data.at_ns);
        times.push(data.at_ns);
    }
    assert_eq!(ticks.missed, 0);
    assert!(times.is_sorted(), "{times:?}");
    // The wall clock says the same, as far as a test can tell.
    let now = std::time::UNIX_EPOCH.elapsed().unwrap();
    let age = now.abs_diff(Duration::from_nanos(*times.last().unwrap()));
    assert!(age < DEADLINE, "{age:?}");
    viewer.send(&json!({ "op": "unsubscribe", "subscriptionIds": [7, 9] }));
    viewer.status("there is no subscription 9");
    let told = live.end();
    assert!(told.contains("b:slow: "), "{told}");
    assert!(told.contains("clients: 1; samples: "), "{told}");
    assert!(told.contains(" 0 lost"), "{told}");
}

#[test]
fn parameters_are_set_by_those_who_have_the_token() {
    let up = start(&[]);
    let live = Live::start(&up, &["a:ticks"]);
    let (mut viewer, mut setter) = (live.viewer(), live.setter());
    viewer.send(&json!({ "op": "getParameters", "parameterNames": [], "id": "all" }));
    let all = viewer.answered("all");
    let names = all["parameters"].as_array().unwrap().iter();
    let names: Vec<_> = names.map(|it| it["name"].as_str().unwrap()).collect();
    let expected = ["joint.stiffness", "mode", "slow.hz", "soft"];
    let expected = ["a", "b"].map(|it| expected.map(|name| format!("{it}:{name}")));
    assert_eq!(names, *expected.as_flattened());
    assert_eq!(
        all["parameters"][0],
        json!({ "name": "a:joint.stiffness", "value": 2.0, "type": "float64" })
    );
    let watched = ["b:joint.stiffness", "b:servo:mode"];
    let watch = json!({ "op": "subscribeParameterUpdates", "parameterNames": watched });
    viewer.send(&watch);
    // The present values come at once.
    assert_eq!(
        viewer.answer("parameterValues")["parameters"][1]["value"],
        "idle"
    );

    viewer.set("b:joint.stiffness", 3.5);
    let status = viewer.status("without the token");
    assert_eq!(status["level"], 2);
    // Who gives an id gets the values that hold.
    assert_eq!(viewer.answered("set")["parameters"][0]["value"], 2.0);
    assert_eq!(viewer.get("b:joint.stiffness"), 2.0);
    setter.send(&json!({
        "op": "setParameters", "id": "7",
        "parameters": [{ "name": "none", "value": 9 }, { "name": "b:mode" }]
    }));
    setter.status("there is no parameter `none`; `b:mode` cannot be removed");
    let held = json!([{ "name": "b:mode", "value": "idle" }]);
    assert_eq!(setter.answered("7")["parameters"], held);

    setter.set("b:joint.stiffness", 3.5);
    let set = setter.answered("set");
    assert_eq!(set["parameters"][0]["value"], 3.5);
    let mut update = || {
        let update = viewer.answer("parameterValues");
        let [one] = &update["parameters"].as_array().unwrap()[..] else {
            panic!("{update}");
        };
        (one["name"].clone(), one["value"].clone())
    };
    let (stiffness, mode) = (json!("b:joint.stiffness"), json!("b:servo:mode"));
    assert_eq!(update(), (stiffness.clone(), json!(3.5)));
    setter.set("b:mode", "hold");
    assert_eq!(setter.answered("set")["parameters"][0]["value"], "hold");
    assert_eq!(update(), (mode, json!("hold")));
    // JavaScript writes it so.
    setter.set("b:joint.stiffness", 4);
    assert_eq!(update(), (stiffness.clone(), json!(4.0)));
    up.run(&["vars", "set", "b:joint.stiffness", "5"]);
    assert_eq!(update(), (stiffness, json!(5.0)));

    for (name, value, reason) in [
        (
            "b:joint.stiffness",
            json!(-1),
            "must be from 0.0 to 50.0 N m/rad, not -1.0",
        ),
        (
            "b:joint.stiffness",
            json!("soft"),
            "`\"soft\"` is not a value of type f64",
        ),
        (
            "b:joint.stiffness",
            json!([1, 2]),
            "`[1,2]` is not a value of type f64",
        ),
        (
            "b:joint.stiffness",
            Value::Null,
            "`b:joint.stiffness` cannot be removed",
        ),
        (
            "b:mode",
            json!("run"),
            "`run` is not one of idle, hold, fault",
        ),
        ("b:soft", json!(1), "`1` is neither true nor false"),
        (
            "b:joint.stiffness",
            json!("6"),
            "`\"6\"` is not a value of type f64",
        ),
        (
            "joint.stiffness",
            json!(1),
            "there is no parameter `joint.stiffness`",
        ),
        ("b:ticks", json!(1), "there is no parameter `b:ticks`"),
    ] {
        setter.set(name, value);
        setter.status(reason);
    }
    assert_eq!(setter.get("b:joint.stiffness"), 5.0);
    viewer.send(&json!({ "op": "unsubscribeParameterUpdates", "parameterNames": [] }));
    setter.set("b:joint.stiffness", 6);
    setter.answered("set");
    assert_eq!(viewer.get("b:joint.stiffness"), 6.0);
}

#[test]
fn strangers_are_refused() {
    let up = start(&[]);
    let live = Live::start(&up, &["--origin", "https://app.example"]);
    let with = |header: &'static str, value: &'static str| {
        let mut request = live.request("");
        let headers = request.headers_mut();
        headers.insert(header, HeaderValue::from_static(value));
        request
    };
    for (header, value, status) in [
        ("origin", "https://evil.example", 403),
        ("origin", "http://192.0.2.1:8765", 403),
        ("origin", "null", 403),
        ("host", "evil.example", 403),
        ("host", "192.0.2.1:8765", 403),
        ("sec-websocket-protocol", "foxglove.sdk.v2, graphql-ws", 400),
    ] {
        let (refused, _) = live.refused(with(header, value));
        assert_eq!(refused, status, "{header}: {value}");
    }
    let (refused, _) = live.refused(live.request("?token=0123456789abcdef0123456789abcdef"));
    assert_eq!(refused, 403);
    for (header, value) in [
        ("origin", "https://app.example"),
        ("origin", "http://localhost:3000"),
        ("host", "127.0.0.1"),
    ] {
        Viewer::of(live.socket(), with(header, value));
    }
    // What a person sees who sends no more than that.
    let mut stream = live.socket();
    let request = "GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: Upgrade\r\n\
        Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
        Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
    stream.write_all(request.as_bytes()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("HTTP/1.1 403 "), "{text}");
    assert!(
        text.contains("`evil.example` is not a name of this service"),
        "{text}"
    );
}

#[test]
fn the_page_is_served_by_the_same_rules() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let get = |line: &str, header: &str| {
        let mut stream = live.socket();
        let request = format!("{line} HTTP/1.1\r\n{header}\r\n\r\n");
        // In pieces, as they may come.
        for piece in request.as_bytes().chunks(7) {
            stream.write_all(piece).unwrap();
        }
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    let host = "Host: localhost";
    let page = get("GET /", host);
    let (head, page) = page.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    for header in [
        "Content-Security-Policy: default-src 'self';",
        "X-Content-Type-Options: nosniff",
        "Referrer-Policy: no-referrer",
    ] {
        assert!(head.contains(header), "{head}");
    }
    // All that the page names is there, and nothing is from elsewhere.
    let mut files: Vec<String> = vec!["page.js".into()];
    let named = |text: &str| {
        let quoted = text.split(['"', '\'']);
        let names = quoted.map(|it| it.trim_start_matches("./").to_owned());
        let is_file = |name: &String| [".js", ".css", ".svg"].iter().any(|it| name.ends_with(it));
        names.filter(is_file).collect::<Vec<_>>()
    };
    files.extend(named(page));
    let mut place = 0;
    while let Some(file) = files.get(place) {
        let content = get(&format!("GET /{file}"), host);
        assert!(
            content.starts_with("HTTP/1.1 200 OK\r\n"),
            "{file}: {content}"
        );
        for name in named(&content) {
            if !files.contains(&name) {
                files.push(name);
            }
        }
        place += 1;
    }
    assert!(files.len() >= 8, "{files:?}");
    for (line, header, status) in [
        ("GET /", "Host: evil.example", 403),
        ("GET /", "Host: localhost\r\nHost: localhost", 403),
        ("GET /", "Accept: */*", 403),
        (
            "GET /",
            "Host: localhost\r\nOrigin: https://evil.example",
            403,
        ),
        ("GET /?token=0123", host, 403),
        ("POST /", host, 405),
        ("GET /../Cargo.toml", host, 404),
        ("GET /page", host, 404),
    ] {
        let answer = get(line, header);
        let expected = format!("HTTP/1.1 {status} ");
        assert!(answer.starts_with(&expected), "{line} {header}: {answer}");
    }
    // As many as the greatest page has at once: none pushes out another one.
    let mut all: Vec<_> = (0..24).map(|_| live.socket()).collect();
    for stream in &mut all {
        stream
            .write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            .unwrap();
    }
    for mut stream in all {
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{answer}");
    }
    // A viewer is one all the same.
    assert_eq!(live.viewer().info["name"], "tested");
}

#[test]
fn the_page_is_told_what_parameters_are_and_what_happens() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let mut viewer = Viewer::of(live.socket(), live.request("?hz=30"));
    viewer.follow(1, "/parameters");
    let payload = viewer.data().payload;
    // The header of CDR, the length, and a zero at the end.
    let text = core::str::from_utf8(&payload[8..payload.len() - 1]).unwrap();
    let parameters: Value = text.parse().unwrap();
    assert_eq!(
        parameters[0],
        json!({
            "name": "a:joint.stiffness", "type": "f64", "unit": "N m/rad", "about": "",
            "bounds": [0.0, 50.0], "labels": []
        })
    );
    assert_eq!(parameters[1]["labels"], json!(["idle", "hold", "fault"]));
    viewer.follow(2, "/events");
    up.run(&["stop", "b"]);
    loop {
        let data = viewer.data();
        assert_eq!(data.subscription, 2);
        let event = condor_ros2::Log::decode(&data.payload).unwrap();
        if event.name == "b" && event.text.contains("stop") {
            break;
        }
    }
    let (refused, _) = live.refused(live.request("?hz=0"));
    assert_eq!(refused, 400);
}

#[test]
fn the_printed_address_can_be_used_when_all_are_listened_at() {
    let up = start(&[]);
    let live = Live::start(&up, &["--listen", "0.0.0.0"]);
    assert_eq!(live.viewer().info["name"], "tested");
}

#[test]
fn a_client_that_reads_too_slowly_loses_alone() {
    let up = start(&["--clock", "simulated", "--speed", "20"]);
    let live = Live::start(&up, &[]);
    let stream = live.socket();
    set_socket_recv_buffer_size(&stream, 4096).unwrap();
    let mut slow = Viewer::of(stream, live.request(""));
    let mut quick = live.viewer();
    for (id, topic) in (0..).zip(["/a/servo", "/b/servo"]) {
        slow.subscribe(id, topic);
    }
    let layout = quick.subscribe(5, "/b/servo");
    let mut ticks = Ticks::default();
    // The operating system ends a connection whose client takes nothing for 30 s, however slow this machine is.
    let (allow, allowed) = mpsc::channel();
    let slow = thread::spawn(move || {
        let mut told = None;
        for () in allowed {
            for _ in 0..200 {
                if let Message::Text(text) = slow.read()
                    && text.contains("samples were lost")
                {
                    told = Some(text.parse::<Value>().unwrap());
                }
            }
        }
        told.unwrap_or_else(|| {
            slow.status("samples were lost because this client reads too slowly")
        })
    });
    // More than the operating system, and then the server, keeps for the slow client.
    for number in 0..12_000 {
        let data = quick.data();
        ticks.take(&layout, &data);
        if number % 500 == 0 {
            allow.send(()).unwrap();
        }
    }
    drop(allow);
    let status = slow.join().unwrap();
    assert_eq!(ticks.missed, 0);
    assert_eq!(
        (&status["level"], &status["id"]),
        (&json!(1), &json!("lost"))
    );
    assert!(
        status["message"].to_string().contains(" of /b/servo"),
        "{status}"
    );
    let told = live.end();
    assert!(told.contains("clients: 2; "), "{told}");
    let lost = told.rsplit_once(", ").unwrap().1;
    let lost: u64 = lost.split(' ').next().unwrap().parse().unwrap();
    assert!(lost > 0, "{told}");
}

#[test]
fn simulated_time_is_told() {
    let up = start(&["--clock", "simulated"]);
    let live = Live::start(&up, &[]);
    let mut viewer = live.viewer();
    let capabilities = json!(["parameters", "parametersSubscribe", "time"]);
    assert_eq!(viewer.info["capabilities"], capabilities);
    let time = |viewer: &mut Viewer| u64::from_le_bytes(viewer.binary(2).try_into().unwrap());
    let begin = time(&mut viewer);
    viewer.subscribe(0, "/a/servo");
    let data = viewer.data();
    let mut last = begin;
    while last < data.at_ns {
        let now = time(&mut viewer);
        assert!(now >= last, "{now} after {last}");
        last = now;
    }
    // The system began a moment ago, and not in 1970.
    let seconds = up.status().clock.unwrap().seconds;
    assert!(Duration::from_nanos(last).as_secs_f64() <= seconds);
}

#[test]
fn handshakes_end_in_time() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let mut slow = live.socket();
    // A byte now and then: each read of the server is soon over.
    slow.set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let mut request = b"GET / HTTP/1.1\r\nX-Slow: ".to_vec();
    loop {
        if slow.write_all(&request).is_err() {
            break;
        }
        request = b"a".to_vec();
        // Others come and go meanwhile.
        live.viewer();
        match slow.read(&mut [0]) {
            Ok(0) => break,
            Ok(_) => panic!("an answer to half a request"),
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(_) => break,
        }
    }
    // 65 that say nothing are more than may be in their handshakes.
    let silent: Vec<_> = (0..65).map(|_| live.socket()).collect();
    live.viewer();
    let mut oldest = &silent[0];
    assert_eq!(oldest.read(&mut [0]).unwrap_or(0), 0);
    let mut long = live.socket();
    let header = format!("GET / HTTP/1.1\r\nX-Long: {}", "a".repeat(70_000));
    // It may end while this is being written.
    let _ = long.write_all(header.as_bytes());
    assert_eq!(long.read(&mut [0]).unwrap_or(0), 0);
}

#[test]
fn garbage_ends_nobody_else() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let mut viewer = live.viewer();
    let layout = viewer.subscribe(1, "/a/servo");
    let mut ticks = Ticks::default();
    let mut other = live.viewer();
    for (text, reason) in [
        ("", "cannot understand the message"),
        ("[[[[", "cannot understand the message"),
        (
            r#"{"op":"advertise","channels":[]}"#,
            "unknown variant `advertise`",
        ),
        (
            r#"{"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]}"#,
            "no channel 99",
        ),
    ] {
        other.socket.send(Message::text(text)).unwrap();
        assert_eq!(other.status(reason)["level"], 2);
    }
    other
        .socket
        .send(Message::binary(vec![1, 0, 0, 0, 0, 5]))
        .unwrap();
    other.status("only calls of services may be binary");
    assert_eq!(other.get("a:soft"), false);
    // Many at once.
    for _ in 0..1000 {
        other.socket.write(Message::text("{")).unwrap();
    }
    other.socket.flush().unwrap();
    for _ in 0..1000 {
        other.status("EOF while parsing");
    }
    assert_eq!(other.get("a:soft"), false);
    let long = "a".repeat((64 << 10) + 1);
    other.socket.send(Message::text(long)).unwrap();
    assert_eq!(other.closed(), CloseCode::Size);
    // A frame that is not masked, and one of an operation that there is not.
    for frame in [&[0x81, 1, b'a'][..], &[0x83, 0x80, 0, 0, 0, 0]] {
        let mut other = live.viewer();
        other.socket.get_mut().write_all(frame).unwrap();
        assert_eq!(other.closed(), CloseCode::Protocol);
    }
    for _ in 0..50 {
        let data = viewer.data();
        ticks.take(&layout, &data);
    }
    assert_eq!(ticks.missed, 0);
}

#[test]
fn eight_clients_may_be_connected() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let mut all: Vec<_> = (0..8).map(|_| live.viewer()).collect();
    let (status, _) = live.refused(live.request(""));
    assert_eq!(status, 503);
    let mut first = all.remove(0);
    first.socket.close(None).unwrap();
    // The server ends the connection at last.
    while first.socket.read().is_ok() {}
    live.viewer();
    assert_eq!(all[6].get("a:mode"), "idle");
}

#[test]
fn a_restarted_program_is_told_and_shown_again() {
    let up = start(&[]);
    let live = Live::start(&up, &[]);
    let (mut viewer, mut setter) = (live.viewer(), live.setter());
    let layout = viewer.subscribe(1, "/a/servo");
    viewer.data();
    setter.set("a:joint.stiffness", 7);
    assert_eq!(setter.answered("set")["parameters"][0]["value"], 7.0);
    running::kill(up.status().processors[0].pid.unwrap());
    viewer.status("a:servo: the program was restarted");
    viewer.status("a:servo: its rows go on");
    let data = viewer.data();
    layout.decode(&data.payload).unwrap();
    assert_eq!(setter.get("a:joint.stiffness"), 2.0);
    setter.set("a:joint.stiffness", 8);
    assert_eq!(setter.answered("set")["parameters"][0]["value"], 8.0);
}

#[test]
fn a_stopped_program_is_shown_when_it_starts() {
    let up = start(&[]);
    up.run(&["stop", "b"]);
    let live = Live::start(&up, &[]);
    let mut viewer = live.viewer();
    viewer.subscribe(1, "/a/servo");
    assert_eq!(viewer.data().subscription, 1);
    viewer.send(&json!({ "op": "unsubscribe", "subscriptionIds": [1] }));
    let layout = viewer.subscribe(2, "/b/servo");
    up.run(&["start", "b"]);
    viewer.status("b:servo: its rows begin");
    let data = core::iter::repeat_with(|| viewer.data()).find(|it| it.subscription == 2);
    layout.decode(&data.unwrap().payload).unwrap();
}

#[test]
fn a_program_that_is_loaded_later_is_offered() {
    let up = start_one();
    let live = Live::start(&up, &[]);
    let mut viewer = live.viewer();
    assert!(!viewer.channels.contains_key("/b/servo"));
    load_joint(&up);
    while !viewer.channels.contains_key("/b/servo") {
        viewer.take_offer();
    }
    let layout = viewer.subscribe(3, "/b/servo");
    let data = viewer.data();
    let row = layout.decode(&data.payload).unwrap();
    let expected = 0.5 * f64::from(u32::try_from(row.head().tick).unwrap());
    assert_eq!(row.value(0), Some(Scalar::F64(expected)));
    // Who comes later is offered all at once.
    assert!(live.viewer().channels.contains_key("/b/servo"));
    // The former channels have kept their numbers.
    viewer.follow(4, "/events");
    up.run(&["stop", "b"]);
    let data = core::iter::repeat_with(|| viewer.data()).find(|it| it.subscription == 4);
    condor_ros2::Log::decode(&data.unwrap().payload).unwrap();
    let told = live.end();
    assert!(told.contains("b:servo: "), "{told}");
}
