//! The page for browsers: its files, and the answers to plain requests for them.

use std::net::IpAddr;

use crate::listening::{Rules, Visit};

/// The greatest head of a request, in bytes.
pub(crate) const HEAD: usize = 8 << 10;
/// The greatest number of headers.
const HEADERS: usize = 64;

/// The rules of the files for a browser: it loads and runs these files alone, connects to their server alone,
/// and shows them within no other page.
const POLICY: &str = "\
Content-Security-Policy: default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
X-Content-Type-Options: nosniff\r\n\
Referrer-Policy: no-referrer\r\n\
Cross-Origin-Resource-Policy: same-origin\r\n\
Cache-Control: no-store\r\n\
Connection: close\r\n";

/// Names the files of the page: path, type and content.
macro_rules! files {
    ($($name:literal: $of_type:ident),* $(,)?) => {
        &[$((concat!("/", $name), $of_type, include_bytes!(concat!("../../page/", $name)))),*]
    };
}

/// The file that stands for the page.
const INDEX: &str = "/index.html";
const FILES: &[(&str, &str, &[u8])] = files![
    "index.html": HTML,
    "style.css": CSS,
    "icon.svg": SVG,
    "page.js": SCRIPT,
    "link.js": SCRIPT,
    "rows.js": SCRIPT,
    "element.js": SCRIPT,
    "figure.js": SCRIPT,
    "chart.js": SCRIPT,
    "plot.js": SCRIPT,
    "parameters.js": SCRIPT,
    "simulator.js": SCRIPT,
    "pose.js": SCRIPT,
    "posture.js": SCRIPT,
    "handles.js": SCRIPT,
    "steps.js": SCRIPT,
    "plan.js": SCRIPT,
    "play.js": SCRIPT,
    "history.js": SCRIPT,
    "files.js": SCRIPT,
    "queue.js": SCRIPT,
];
const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const SVG: &str = "image/svg+xml";
const TEXT: &str = "text/plain; charset=utf-8";

/// The kind of a request, by its head.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum PageRequest {
    /// The head is not complete.
    More,
    /// The request asks for a websocket.
    Websocket,
    /// A file: the answer, and the reason why it is a refusal.
    File(Vec<u8>, Option<String>),
}

/// Reads the head of a request of a client that has connected to the address `local`. Returns an error if
/// the head is not one of HTTP, or is too long.
pub(crate) fn read(head: &[u8], rules: &Rules, local: IpAddr) -> Result<PageRequest, String> {
    let mut headers = [httparse::EMPTY_HEADER; HEADERS];
    let mut request = httparse::Request::new(&mut headers);
    match request.parse(head) {
        Ok(httparse::Status::Complete(_)) => {}
        Ok(httparse::Status::Partial) if head.len() < HEAD => return Ok(PageRequest::More),
        Ok(httparse::Status::Partial) => {
            return Err(format!(
                "the head of the request is longer than {HEAD} bytes"
            ));
        }
        Err(error) => return Err(format!("this is not an HTTP request: {error}")),
    }
    let all = |name: &'static str| {
        let headers = request.headers.iter();
        headers.filter(move |header| header.name.eq_ignore_ascii_case(name))
    };
    if all("upgrade").next().is_some() {
        return Ok(PageRequest::Websocket);
    }
    let only = |name| {
        let mut all = all(name);
        let value = all.next().filter(|_| all.next().is_none())?.value;
        core::str::from_utf8(value).ok()
    };
    let target = request.path.unwrap_or_default();
    let (path, query) = match target.split_once('?') {
        Some((path, query)) => (path, Some(query)),
        None => (target, None),
    };
    let visit = Visit {
        host: only("host"),
        origin: all("origin")
            .next()
            .map(|_| only("origin").unwrap_or_default()),
        query,
        local,
    };
    Ok(match rules.admit(&visit) {
        Err(refusal) => refused("403 Forbidden", refusal.to_string()),
        Ok(_) if request.method != Some("GET") => {
            refused("405 Method Not Allowed", "only GET is understood".into())
        }
        Ok(_) => match file(path) {
            Some((_, of_type, content)) => {
                PageRequest::File(answer("200 OK", of_type, content), None)
            }
            None => refused("404 Not Found", "there is no such file".into()),
        },
    })
}

/// Returns the file at a path.
fn file(path: &str) -> Option<&'static (&'static str, &'static str, &'static [u8])> {
    let path = if path == "/" { INDEX } else { path };
    FILES.iter().find(|(name, ..)| *name == path)
}

fn refused(status: &str, reason: String) -> PageRequest {
    let text = format!("{reason}\n");
    PageRequest::File(answer(status, TEXT, text.as_bytes()), Some(reason))
}

fn answer(status: &str, of_type: &str, content: &[u8]) -> Vec<u8> {
    let length = content.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {of_type}\r\nContent-Length: {length}\r\n{POLICY}\r\n"
    );
    [head.as_bytes(), content].concat()
}
