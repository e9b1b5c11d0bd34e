//! The services by which a page tries motions, with the arm of the example `arm` and no system.

use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::protocol::frame::coding::CloseCode;

use super::viewer::{Live, Viewer};

const SERVICES: [&str; 5] = [
    "/sim/robot",
    "/sim/pose",
    "/sim/plan",
    "/sim/steps",
    "/sim/text",
];
const ROBOT: usize = 0;
const POSE: usize = 1;
const PLAN: usize = 2;
const STEPS: usize = 3;
const TEXT: usize = 4;

/// The command `sim` of the arm.
fn sim(place: &Path, arguments: &[&str]) -> Command {
    let file = place.join("arm.toml");
    std::fs::write(&file, "lengths = [0.3, 0.25, 0.1]\n").unwrap();
    let arm = Path::new(env!("CARGO_BIN_EXE_condor")).with_file_name("examples/planar_arm");
    let mut command = Command::new(arm);
    command.arg("sim").arg(file).args(arguments);
    command
}

fn start() -> (Live, Viewer) {
    let place = tempfile::tempdir().unwrap();
    let live = Live::of(sim(place.path(), &["--port", "0"]));
    let mut viewer = live.viewer();
    assert_eq!(viewer.services(), SERVICES);
    (live, viewer)
}

fn call(viewer: &mut Viewer, service: usize, payload: &Value) -> Value {
    viewer
        .call(service, payload.to_string().as_bytes())
        .unwrap()
}

#[test]
fn a_robot_is_served_without_a_system() {
    let (live, mut viewer) = start();
    assert_eq!(viewer.info["name"], "arm.toml");
    let capabilities = json!(["parameters", "parametersSubscribe", "services"]);
    assert_eq!(viewer.info["capabilities"], capabilities);
    assert_eq!(viewer.info["supportedEncodings"], json!(["json"]));
    assert!(viewer.channels.is_empty());
    let robot = call(&mut viewer, ROBOT, &json!({}));
    let joint = |name: &str| json!({ "name": name, "limits": [-2.5, 2.5], "position": format!("{name}.position") });
    let expected = json!({
        "joints": [joint("shoulder"), joint("elbow"), joint("wrist")],
        "handles": ["tip"],
        "hasMotions": false,
        "hasQueue": false,
        "start": [0.0, 0.0, 0.0],
    });
    assert_eq!(robot, expected);

    let up = core::f64::consts::FRAC_PI_2;
    let posed = call(&mut viewer, POSE, &json!({ "positions": [up, 9.0, 0.0] }));
    assert_eq!(posed["positions"], json!([up, 2.5, 0.0]));
    assert_eq!(posed["held"], json!([{ "joint": "elbow", "limit": 2.5 }]));
    assert_eq!(posed["clearances"], json!([]));
    assert!(posed.get("isReached").is_none(), "{posed}");
    let drawn = &posed["scene"]["lines"][0];
    assert_eq!(drawn["name"], "arm");
    assert_eq!(drawn["points"][1], json!([0.0, 0.3, 0.0]));
    // The frame of the tip is where the line ends.
    let at = |place: &Value| -> Vec<f64> {
        let numbers = place.as_array().unwrap().iter();
        numbers.map(|it| it.as_f64().unwrap()).collect()
    };
    let (tip, end) = (at(&posed["handles"][0]["at"]), at(&drawn["points"][3]));
    let is_near = tip
        .iter()
        .zip(&end)
        .all(|(one, other)| (one - other).abs() < 1e-5);
    assert!(is_near, "{tip:?} {end:?}");

    let to = [0.2, 0.3, 0.0];
    let drag = json!({ "positions": [0.1, 0.2, 0.3], "drag": { "frame": "tip", "to": to } });
    let dragged = call(&mut viewer, POSE, &drag);
    assert_eq!(dragged["isReached"], true, "{dragged}");
    let tip = at(&dragged["handles"][0]["at"]);
    let is_near = tip
        .iter()
        .zip(&to)
        .all(|(one, other)| (one - other).abs() < 2e-6);
    assert!(is_near, "{tip:?}");

    // Nobody plots anything, and whoever asks is told so.
    viewer.send(&json!({ "op": "getParameters", "parameterNames": [], "id": "all" }));
    assert_eq!(viewer.answered("all")["parameters"], json!([]));
    let mut stream = live.socket();
    stream
        .write_all(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    let mut page = String::new();
    stream.read_to_string(&mut page).unwrap();
    assert!(page.starts_with("HTTP/1.1 200 OK\r\n"), "{page}");
    assert_eq!(live.end(), "clients: 1\n");
}

#[test]
fn a_motion_is_planned_and_edited() {
    let (_live, mut viewer) = start();
    let motion = json!({ "motion": [
        { "duration": 1.0, "to": { "elbow": 1.0 } },
        { "duration": 14.0, "to": { "elbow": -1.0, "wrist": 0.5 } },
    ] });
    let text = call(&mut viewer, TEXT, &json!({ "steps": motion }));
    let text = text["text"].as_str().unwrap();
    let steps = call(&mut viewer, STEPS, &json!({ "text": text }));
    assert_eq!(steps["steps"], motion);
    let from = [0.2, 0.0, 0.0];
    let plan = call(&mut viewer, PLAN, &json!({ "from": from, "text": text }));
    // 1501 ticks: every second one, and the last one.
    assert_eq!(plan["period"], 0.02);
    assert_eq!(plan["duration"], 15.0);
    let elbow = &plan["joints"][1];
    assert_eq!(elbow["name"], "elbow");
    let positions = elbow["position"].as_array().unwrap();
    assert_eq!((positions.len(), &positions[0]), (751, &json!(0.0)));
    assert_eq!(positions[50], 1.0);
    assert_eq!(positions[750], -1.0);
    assert_eq!(elbow["velocity"].as_array().unwrap().len(), 751);
    assert_eq!(elbow["torque"].as_array().unwrap().len(), 751);
    let limits = json!({ "position": [-2.5, 2.5], "velocity": 3.0, "torque": [-2.0, 2.0] });
    assert_eq!(elbow["limits"], limits);
    assert_eq!(plan["joints"][0]["position"][700], 0.2);
    // The greatest speed of a motion of least jerk is 15/8 of its mean one.
    let peak = &plan["peaks"][1];
    assert_eq!(peak["joint"], "elbow");
    assert!((peak["velocity"].as_f64().unwrap() - 1.875 / 3.0).abs() < 1e-3);
    assert_eq!(peak["effort"], Value::Null);
    let events = plan["events"].as_array().unwrap();
    assert_eq!(
        events[1],
        json!({ "at_s": 1.0, "step": 1, "what": "reached" })
    );
    assert_eq!(events.len(), 4);
}

#[test]
fn calls_that_cannot_be_answered_fail_with_a_reason() {
    let (live, mut viewer) = start();
    let mut failed = |service: usize, payload: &str, reason: &str| {
        let told = viewer.call(service, payload.as_bytes()).unwrap_err();
        assert!(told.contains(reason), "{service} {payload}: {told}");
    };
    failed(99, "{}", "there is no service 99");
    failed(POSE, "{", "/sim/pose cannot understand the request: EOF");
    failed(POSE, "{}", "missing field `positions`");
    failed(POSE, r#"{"positions":["a"]}"#, "expected f64");
    failed(ROBOT, r#"{"all":true}"#, "unknown field `all`");
    let drag = r#"{"positions":[],"drag":{"frame":"toe","to":[0,0,0]}}"#;
    failed(POSE, drag, "the frame \"toe\" cannot be dragged");
    let text = r#"{"from":[],"text":"{}"}"#;
    failed(PLAN, text, "motion: missing field `motion`");
    failed(
        TEXT,
        r#"{"steps":{"motion":[{"duration":-1,"to":{}}]}}"#,
        "-1 s",
    );
    // Many at once: each one is answered or refused.
    let motion = json!({ "motion": vec![json!({ "duration": 60.0, "to": {} }); 20] });
    let plan = json!({ "from": [], "text": motion.to_string() }).to_string();
    for number in 0..200 {
        viewer.write_call(PLAN, number, plan.as_bytes());
    }
    viewer.socket.flush().unwrap();
    let (mut numbers, mut refused) = (Vec::new(), 0);
    for _ in 0..200 {
        let (number, result) = viewer.result();
        numbers.push(number);
        match result {
            Ok(plan) => assert_eq!(plan["duration"], 1200.0),
            Err(reason) => {
                assert!(reason.contains("8 calls are waiting"), "{reason}");
                refused += 1;
            }
        }
    }
    numbers.sort_unstable();
    assert_eq!(numbers, (0..200).collect::<Vec<_>>());
    assert!((1..=192).contains(&refused), "{refused}");
    call(&mut viewer, ROBOT, &json!({}));
    for (frame, reason) in [
        (
            &[2, 0, 0][..],
            "the call of a service ends too early, after 3 bytes",
        ),
        (
            &[1, 0, 0, 0, 0, 5],
            "only calls of services may be binary messages",
        ),
    ] {
        viewer.socket.send(Message::binary(frame.to_vec())).unwrap();
        assert_eq!(viewer.status(reason)["level"], 2);
    }
    viewer.write_call(STEPS, 0, &vec![b' '; 64 << 10]);
    viewer.socket.flush().unwrap();
    assert_eq!(viewer.closed(), CloseCode::Size);
    // Others go on.
    live.viewer();
}
