//! `page`: what the server of the page takes while the hand moves, and what it costs the hand's loops.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::thread::{self, JoinHandle};

use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::client::IntoClientRequest as _;

use super::{Figures, Played, System, WARM_UP, Watchers};
use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::process::Running;

/// The page's wish: 30 samples a second of each channel.
const QUERY: &str = "?hz=30";

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let seconds = if options.quick { 1 } else { 10 };
    let start =
        |system: &System| -> Result<Box<dyn Watchers>> { Ok(Box::new(Page::start(system)?)) };
    let played = Played::new(options, seconds, start)?;
    let cpu = played.of(|it| it.cpu[0]);
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: the Utah/MIT hand on the real\n\
         clock, with nobody, with nobody again, and with the live server and a client that takes what the\n\
         page takes, at most 30 times a second each.\n\n\
         {}\
         messages a second:                    {:.0}\n\
         live server, percent of a core:       {cpu}\n",
        played.0.len(),
        played.overruns("the page"),
        played.of(|it| it.watchers.got),
    );
    let goals = vec![
        played.goal(),
        Goal::most("server_percent_of_a_core", cpu, 10.0),
    ];
    Ok(Report { text, goals })
}

/// Returns true if the page takes a channel.
fn is_shown(channel: &Value) -> bool {
    let text = |key: &str| channel[key].as_str().unwrap_or_default();
    text("schemaName").starts_with("condor_rows/")
        || ["/scene", "/parameters", "/events"].contains(&text("topic"))
}

/// The live server, with a client that counts the messages of the channels that the page takes.
struct Page {
    server: Running,
    client: JoinHandle<f64>,
}

impl Page {
    fn start(system: &System) -> Result<Self> {
        let mut command = system.other(&system.program);
        command.args(["view", "--port", "0"]).stderr(Stdio::null());
        let mut server = Running::of(command.stdout(Stdio::piped()))?;
        let mut told = BufReader::new(server.output()?);
        let mut line = String::new();
        told.read_line(&mut line)?;
        let address = line.split(' ').next().unwrap_or_default();
        let address = address.replacen("http:", "ws:", 1) + QUERY;
        let mut request = address.into_client_request()?;
        let protocol = "foxglove.websocket.v1".parse()?;
        request
            .headers_mut()
            .insert("Sec-WebSocket-Protocol", protocol);
        let (mut socket, _) = tungstenite::connect(request)?;
        loop {
            let message: Value = match socket.read()? {
                Message::Text(text) => serde_json::from_str(&text)?,
                _ => continue,
            };
            let channels = message["channels"].as_array().into_iter().flatten();
            let ids: Vec<_> = channels
                .filter(|it| is_shown(it))
                .map(|it| json!({"id": it["id"], "channelId": it["id"]}))
                .collect();
            if message["op"] == "advertise" && !ids.is_empty() {
                let wish = json!({"op": "subscribe", "subscriptions": ids});
                socket.send(Message::text(wish.to_string()))?;
                break;
            }
        }
        let client = thread::spawn(move || {
            let mut samples = 0.0;
            while let Ok(message) = socket.read() {
                // Other messages, such as of the time, are texts or have another first byte.
                samples +=
                    f64::from(message.is_binary() && message.into_data().first() == Some(&1));
            }
            // The server may write to its output as long as it runs.
            drop(told);
            samples
        });
        Ok(Self { server, client })
    }
}

impl Watchers for Page {
    /// Does nothing: the client counts from the beginning.
    fn count(&mut self) -> Result<()> {
        Ok(())
    }

    fn cpu(&self) -> Result<[f64; 2]> {
        Ok([self.server.cpu()?, 0.0])
    }

    fn end(self: Box<Self>, seconds: f64) -> Result<Figures> {
        self.server.end()?;
        let counted = self.client.join().map_err(|_| "a client has panicked")?;
        Ok(Figures {
            got: counted / (seconds + WARM_UP.as_secs_f64()),
            ..Figures::default()
        })
    }
}
