//! [`Calls`]: the calls of services by one client, and their answers.

use std::collections::VecDeque;

use super::protocol::{AdvertisedService, JSON, ServiceCall, service_response};
use crate::listening::Trust;

/// The greatest number of calls of a client that wait for their answers.
pub(crate) const CALLS: usize = 8;
/// The longest answer, in bytes.
pub(crate) const RESPONSE: usize = 8 << 20;

/// A service that clients call.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Service {
    pub(crate) name: &'static str,
    /// Whether only clients with the token may call it.
    pub(crate) needs_token: bool,
}

impl Service {
    pub(crate) fn advertised(&self, id: u32) -> AdvertisedService<'_> {
        AdvertisedService::new(id, self.name)
    }
}

/// A call to answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Call {
    /// The place of the service in the catalog.
    pub(crate) service: u32,
    /// The number that the client has chosen.
    pub(crate) number: u32,
    pub(crate) payload: Vec<u8>,
}

/// The calls of a client. One at a time is asked, and no other one before the client has been sent the
/// answer: so at most one answer waits for a client that reads slowly.
#[derive(Default)]
pub(crate) struct Calls {
    waiting: VecDeque<Call>,
    is_asked: bool,
    /// The frame of an answer to send.
    response: Option<Vec<u8>>,
}

impl Calls {
    /// Keeps a call. Returns the reason if it is refused.
    pub(crate) fn hear(
        &mut self,
        called: &ServiceCall<'_>,
        trust: Trust,
        services: &[Service],
    ) -> Result<(), String> {
        let Some(service) = services.get(called.service as usize) else {
            return Err(format!("there is no service {}", called.service));
        };
        let name = service.name;
        if service.needs_token && trust == Trust::MayLook {
            return Err(format!(
                "{name} cannot be called without the token: connect to the address with `?token=` that the server \
                 has printed"
            ));
        }
        if called.encoding != JSON.as_bytes() {
            let encoding = String::from_utf8_lossy(called.encoding);
            return Err(format!(
                "{name} understands only `{JSON}`, not {encoding:?}"
            ));
        }
        if self.count() >= CALLS {
            return Err(format!(
                "{CALLS} calls are waiting for their answers, which is the most"
            ));
        }
        self.waiting.push_back(Call {
            service: called.service,
            number: called.number,
            payload: called.payload.into(),
        });
        Ok(())
    }

    /// Returns how many calls are not answered, or their answers not sent.
    pub(crate) fn count(&self) -> usize {
        self.waiting.len() + usize::from(self.is_asked) + usize::from(self.response.is_some())
    }

    /// Returns whether the next call can be asked.
    pub(crate) fn is_ready(&self) -> bool {
        !self.waiting.is_empty() && !self.is_asked && self.response.is_none()
    }

    /// Takes the next call. The client gets the [`answer`](Self::answer).
    pub(crate) fn take(&mut self) -> Option<Call> {
        if !self.is_ready() {
            return None;
        }
        self.is_asked = true;
        self.waiting.pop_front()
    }

    /// Keeps the answer to the call that was taken. Returns the reason if it has failed.
    pub(crate) fn answer(
        &mut self,
        call: &Call,
        result: Result<Vec<u8>, String>,
    ) -> Result<(), String> {
        self.is_asked = false;
        let payload = result?;
        let bytes = payload.len();
        if bytes > RESPONSE {
            return Err(format!(
                "the answer has {bytes} bytes; at most {RESPONSE} can be sent"
            ));
        }
        self.response = Some(service_response(call.service, call.number, &payload));
        Ok(())
    }

    /// Takes the answer to send, if there is one.
    pub(crate) fn next(&mut self) -> Option<Vec<u8>> {
        self.response.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SERVICES: [Service; 2] = [
        Service {
            name: "/look",
            needs_token: false,
        },
        Service {
            name: "/move",
            needs_token: true,
        },
    ];

    fn called(service: u32, number: u32) -> ServiceCall<'static> {
        ServiceCall {
            service,
            number,
            encoding: b"json",
            payload: b"{}",
        }
    }

    fn hear(calls: &mut Calls, called: &ServiceCall<'_>) -> Result<(), String> {
        calls.hear(called, Trust::MayLook, &SERVICES)
    }

    #[test]
    fn calls_are_refused_with_a_reason() {
        let mut calls = Calls::default();
        let told = |called: &ServiceCall<'_>| hear(&mut Calls::default(), called).unwrap_err();
        assert_eq!(told(&called(2, 0)), "there is no service 2");
        assert!(told(&called(1, 0)).contains("/move cannot be called without the token"));
        let encoding = b"cdr";
        let other = ServiceCall {
            encoding,
            ..called(0, 0)
        };
        assert_eq!(told(&other), "/look understands only `json`, not \"cdr\"");
        assert_eq!(calls.hear(&called(1, 0), Trust::MaySet, &SERVICES), Ok(()));
    }

    #[test]
    fn one_call_is_asked_at_a_time_and_eight_wait() {
        let mut calls = Calls::default();
        let all = u32::try_from(CALLS).unwrap();
        for number in 0..all {
            assert_eq!(hear(&mut calls, &called(0, number)), Ok(()));
        }
        let call = calls.take().unwrap();
        assert_eq!((call.number, calls.take()), (0, None));
        let told = hear(&mut calls, &called(0, all)).unwrap_err();
        assert!(told.contains("8 calls are waiting"), "{told}");
        assert_eq!(calls.answer(&call, Ok(b"[1]".into())), Ok(()));
        // The client has not read the answer yet.
        assert_eq!((calls.take(), calls.count()), (None, CALLS));
        assert_eq!(calls.next(), Some(service_response(0, 0, b"[1]")));
        assert_eq!(hear(&mut calls, &called(0, all)), Ok(()));
        let call = calls.take().unwrap();
        let failed = calls.answer(&call, Err("why".into()));
        assert_eq!((failed, calls.next()), (Err("why".into()), None));
        let call = calls.take().unwrap();
        let told = calls.answer(&call, Ok(vec![0; RESPONSE + 1])).unwrap_err();
        assert!(told.contains("8388609 bytes; at most"), "{told}");
        assert_eq!(calls.count(), CALLS - 2);
    }
}
