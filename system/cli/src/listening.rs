//! The checks of services that listen on a network: who may connect, and who may set anything.
//!
//! Web pages can connect to services of the machine that shows them. A page of another site tells
//! its `Origin`, and a name that resolves to this machine (DNS rebinding) shows in `Host`.

use core::fmt;
use std::net::{IpAddr, Ipv6Addr};

/// The bytes of a token before they are written in hexadecimal digits.
const TOKEN_BYTES: usize = 16;
/// The number of characters of a header that a refusal repeats.
const REPEATED: usize = 100;

/// A secret word that a client shows, as `?token=` in the address, to be allowed to set anything.
#[derive(Clone)]
pub(crate) struct Token(String);

impl Token {
    /// Writes random bytes as a token.
    pub(crate) fn of(bytes: [u8; TOKEN_BYTES]) -> Self {
        Self(format!("{:032x}", u128::from_be_bytes(bytes)))
    }

    /// Compares in a time that does not depend on where the texts differ.
    fn is(&self, other: &str) -> bool {
        let (own, other) = (self.0.as_bytes(), other.as_bytes());
        let differences = own.iter().zip(other).fold(0, |all, (a, b)| all | (a ^ b));
        own.len() == other.len() && core::hint::black_box(differences) == 0
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The parts of a client's request that decide whether it is admitted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Visit<'a> {
    /// The header `Host`; `None` if there is none, or more than one.
    pub(crate) host: Option<&'a str>,
    /// The header `Origin`, which all browsers send.
    pub(crate) origin: Option<&'a str>,
    /// The part of the address after the question mark.
    pub(crate) query: Option<&'a str>,
    /// The address of this machine to which the client has connected.
    pub(crate) local: IpAddr,
}

/// The rights of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trust {
    /// The client has not shown the token, and may only look.
    MayLook,
    /// The client has shown the token, and may set parameters.
    MaySet,
}

/// The reason why a client is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Refusal {
    #[error("the request needs one header `Host`")]
    NoHost,
    #[error("`{0}` is not a name of this service: connect to localhost or to its address")]
    Host(String),
    #[error("pages of `{0}` may not connect; allow them by --origin {0}")]
    Origin(String),
    #[error("the token is wrong: it changes each time that the service starts, which prints it")]
    Token,
}

/// The rules by which clients are admitted.
#[derive(Clone)]
pub(crate) struct Rules {
    /// Origins of pages that may connect, beside those of this machine.
    pub(crate) origins: Vec<String>,
    pub(crate) token: Token,
}

impl Rules {
    /// Returns what a client may do.
    pub(crate) fn admit(&self, visit: &Visit<'_>) -> Result<Trust, Refusal> {
        let host = visit.host.ok_or(Refusal::NoHost)?;
        let local = visit.local.to_canonical();
        if !is_loopback(host) && address(name(host)) != Some(local) {
            return Err(Refusal::Host(cut(host)));
        }
        if let Some(origin) = visit.origin
            && !is_own(origin, host)
            && !self.allows(origin)
        {
            return Err(Refusal::Origin(cut(origin)));
        }
        let mut fields = visit.query.unwrap_or_default().split('&');
        match fields.find_map(|field| field.strip_prefix("token=")) {
            None => Ok(Trust::MayLook),
            Some(shown) if self.token.is(shown) => Ok(Trust::MaySet),
            Some(_) => Err(Refusal::Token),
        }
    }

    fn allows(&self, origin: &str) -> bool {
        let http = ["http://", "https://"];
        let host = http.iter().find_map(|scheme| origin.strip_prefix(scheme));
        host.is_some_and(is_loopback)
            || (self.origins.iter()).any(|allowed| allowed.eq_ignore_ascii_case(origin))
    }
}

/// Returns whether an origin is this very service.
fn is_own(origin: &str, host: &str) -> bool {
    origin.strip_prefix("http://") == Some(host)
}

/// Returns what a refusal repeats of a header.
fn cut(text: &str) -> String {
    text.chars().take(REPEATED).collect()
}

/// Returns a host without its port.
fn name(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

fn address(name: &str) -> Option<IpAddr> {
    let inside = |name: &str| name.strip_prefix('[')?.strip_suffix(']')?.parse().ok();
    let bracketed: Option<Ipv6Addr> = inside(name);
    let address = bracketed.map(IpAddr::V6);
    let address = address.or_else(|| name.parse().ok().map(IpAddr::V4))?;
    Some(address.to_canonical())
}

fn is_loopback(host: &str) -> bool {
    let name = name(host);
    name.eq_ignore_ascii_case("localhost")
        || address(name).is_some_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "00112233445566778899aabbccddeeff";

    fn rules() -> Rules {
        let bytes = core::array::from_fn(|place| u8::try_from(place).unwrap() * 0x11);
        Rules {
            origins: vec!["https://app.example".into()],
            token: Token::of(bytes),
        }
    }

    fn admit(host: &str, origin: Option<&str>, query: Option<&str>) -> Result<Trust, Refusal> {
        rules().admit(&Visit {
            host: Some(host),
            origin,
            query,
            local: "192.0.2.7".parse().unwrap(),
        })
    }

    #[test]
    fn hosts_are_of_this_machine() {
        for host in [
            "localhost",
            "LocalHost:8765",
            "127.0.0.1:8765",
            "127.1.2.3",
            "[::1]:80",
            "[::1]",
            "192.0.2.7:8765",
            "[::ffff:192.0.2.7]:1",
        ] {
            assert_eq!(admit(host, None, None), Ok(Trust::MayLook), "{host}");
        }
        for host in [
            "",
            ":",
            "evil.example",
            "localhost.evil.example:8765",
            "192.0.2.8",
            "[::2]",
            "::1",
            "127.0.0.1.evil.example",
            "localhost:80:80",
            "evil@localhost",
        ] {
            assert_eq!(admit(host, None, None), Err(Refusal::Host(host.into())));
        }
        let none = Visit {
            host: None,
            origin: None,
            query: None,
            local: "127.0.0.1".parse().unwrap(),
        };
        assert_eq!(rules().admit(&none), Err(Refusal::NoHost));
    }

    #[test]
    fn origins_are_of_this_machine_or_listed() {
        for origin in [
            "http://localhost:8080",
            "https://127.0.0.1",
            "http://[::1]:3000",
            "https://app.example",
            "HTTPS://APP.EXAMPLE",
        ] {
            let admitted = admit("localhost", Some(origin), None);
            assert_eq!(admitted, Ok(Trust::MayLook), "{origin}");
        }
        for origin in [
            "",
            "null",
            "file://",
            "https://evil.example",
            "https://app.example.evil",
            "https://app.example:444",
            "http://app.example",
            "http://localhost.evil.example",
            "http://192.0.2.7",
        ] {
            let refused = admit("localhost", Some(origin), None);
            assert_eq!(refused, Err(Refusal::Origin(origin.into())));
        }
    }

    #[test]
    fn the_origin_of_the_own_page_is_its_host() {
        let page = "http://192.0.2.7:8765";
        let admitted = admit("192.0.2.7:8765", Some(page), None);
        assert_eq!(admitted, Ok(Trust::MayLook));
        for host in ["192.0.2.7:8766", "192.0.2.7", "localhost:8765"] {
            let refused = admit(host, Some(page), None);
            assert_eq!(refused, Err(Refusal::Origin(page.into())), "{host}");
        }
    }

    #[test]
    fn refusals_repeat_little() {
        let (long, short) = ("x".repeat(1000), "x".repeat(REPEATED));
        let refused = admit(&long, None, None);
        assert_eq!(refused, Err(Refusal::Host(short.clone())));
        let refused = admit("localhost", Some(&long), None);
        assert_eq!(refused, Err(Refusal::Origin(short)));
    }

    #[test]
    fn a_token_is_whole_or_wrong() {
        let with = |token: &str| admit("localhost", None, Some(&format!("a=b&token={token}")));
        assert_eq!(with(TOKEN), Ok(Trust::MaySet));
        assert_eq!(admit("localhost", None, Some("a=b")), Ok(Trust::MayLook));
        let (last, first) = (&TOKEN[..31], &TOKEN[1..]);
        let long = format!("{TOKEN}0");
        let other = TOKEN.replace('f', "e");
        for wrong in ["", last, first, &long, &other] {
            assert_eq!(with(wrong), Err(Refusal::Token), "{wrong}");
        }
    }
}
