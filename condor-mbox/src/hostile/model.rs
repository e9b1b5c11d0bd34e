//! [`Model`]: the events that must happen, derived from every access of the honest processors.

use std::collections::VecDeque;

use crate::layout::{self, JOINING, SLOTS, entry, header};
use crate::{Call, Processor, StoreOrder, Vector};

use super::world::{HOSTILE, N};

const COUNT: u32 = N as u32;
const WORDS: usize = layout::mail_bytes(COUNT) as usize / 4;

/// A message that an honest processor offered; its data is its index.
pub(super) struct Offer {
    from: usize,
    to: usize,
    vector: Vector,
    /// The place of the message among all that were published.
    published: Option<u64>,
    taken: bool,
    reply: Option<u32>,
}

impl Offer {
    pub(super) const fn to(&self) -> usize {
        self.to
    }

    pub(super) const fn is_taken(&self) -> bool {
        self.taken
    }
}

/// A request as its receiver read it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Request {
    sequence: u32,
    kind: u32,
    value: u32,
}

/// Returns the class of a request in its kind word: send, call, listen, ignore.
const fn class(kind: u32) -> u32 {
    kind >> 8 & 0xff
}

const fn vector_of(kind: u32) -> Vector {
    Vector(kind as u8)
}

const fn is_message(kind: u32) -> bool {
    matches!(class(kind), 1 | 2)
}

/// The state of one honest processor, as far as the model knows it.
struct Known {
    /// The words of the hostile `mail` as this processor read them last.
    seen: Vec<u32>,
    /// The request that it has just taken from a ring, and its sender.
    taken: Option<(usize, Request)>,
    /// The latest request that it took from the hostile ring in the present epoch.
    hostile_tail: u32,
    /// The latest message of each sender that it heard as a listener.
    heard: [u64; N],
    sent: [u32; Vector::COUNT],
    handled: [u32; Vector::COUNT],
}

impl Known {
    fn new() -> Self {
        Self {
            seen: vec![0; WORDS],
            taken: None,
            hostile_tail: 0,
            heard: [0; N],
            sent: [0; Vector::COUNT],
            handled: [0; Vector::COUNT],
        }
    }
}

pub(super) struct Model {
    offers: Vec<Offer>,
    /// The requests that are published and not taken, from each sender to each receiver.
    rings: [[VecDeque<Request>; N]; N],
    known: [Known; N],
    published: u64,
    handled: u64,
    handled_of_hostile: u64,
    /// True if an honest program now has the number [`HOSTILE`].
    replaced: bool,
}

impl Model {
    pub(super) fn new() -> Self {
        Self {
            offers: Vec::new(),
            rings: Default::default(),
            known: core::array::from_fn(|_| Known::new()),
            published: 0,
            handled: 0,
            handled_of_hostile: 0,
            replaced: false,
        }
    }

    pub(super) fn replace_hostile(&mut self) {
        self.replaced = true;
        self.known[HOSTILE] = Known::new();
    }

    /// Records that a new program begins on `number`, with statistics of its own.
    pub(super) fn restart(&mut self, number: usize) {
        self.known[number].sent = [0; Vector::COUNT];
        self.known[number].handled = [0; Vector::COUNT];
    }

    pub(super) fn is_honest(&self, number: usize) -> bool {
        number != HOSTILE || self.replaced
    }

    pub(super) const fn handled_in_all(&self) -> (u64, u64) {
        (self.handled, self.handled_of_hostile)
    }

    /// Returns the numbers of messages of `vector` that `number` sent and handled.
    pub(super) fn statistics(&self, number: usize, vector: Vector) -> (u32, u32) {
        let known = &self.known[number];
        (known.sent[vector.index()], known.handled[vector.index()])
    }

    /// Returns true if all messages between honest processors have been taken.
    pub(super) fn is_drained(&self) -> bool {
        (0..N)
            .flat_map(|from| (0..N).map(move |to| (from, to)))
            .filter(|&(from, to)| self.is_honest(from) && self.is_honest(to))
            .all(|(from, to)| self.rings[from][to].is_empty())
    }

    // Calls by the honest programs.

    /// Records that `listener` begins to listen: it hears the messages that the holder has not taken by then,
    /// some of them perhaps again.
    pub(super) fn listens(&mut self, listener: usize) {
        self.known[listener].heard = [0; N];
    }

    /// Records that `from` is about to send a message; returns the message's data.
    pub(super) fn offer(&mut self, from: usize, to: Processor, vector: Vector) -> u32 {
        self.offers.push(Offer {
            from,
            to: to.index(),
            vector,
            published: None,
            taken: false,
            reply: None,
        });
        self.offers.len() as u32 - 1
    }

    /// Returns the number of messages that have been offered.
    pub(super) fn offers(&self) -> usize {
        self.offers.len()
    }

    /// Returns true if `from` sent a message to `to` that was offered after the first `before` messages.
    pub(super) fn has_sent(&self, before: usize, from: usize, to: usize) -> bool {
        let later = self.offers.iter().skip(before);
        later
            .filter(|offer| offer.published.is_some())
            .any(|offer| (offer.from, offer.to) == (from, to))
    }

    pub(super) fn offered(&self, data: u32) -> &Offer {
        &self.offers[data as usize]
    }

    pub(super) fn is_published(&self, data: u32) -> bool {
        self.offered(data).published.is_some()
    }

    pub(super) fn check_reply(&self, data: u32, value: u32) {
        let offer = self.offered(data);
        if self.is_honest(offer.to) {
            assert_eq!(offer.reply, Some(value), "a reply that nobody gave");
        }
    }

    /// Checks the call with which a handler of `me` begins.
    pub(super) fn started(&mut self, me: usize, call: &Call<'_>) {
        let sender = call.sender().index();
        if call.addressee().index() == me {
            let taken = self.known[me].taken.take();
            let (from, request) = taken.expect("a handler runs for what was taken");
            assert_eq!((from, request.value), (sender, call.data()));
            assert_eq!(vector_of(request.kind), call.vector());
            assert!(is_message(request.kind));
        } else if self.is_honest(sender) {
            self.heard(me, call);
        } else {
            self.heard_hostile(me, call);
        }
        self.handled_of_hostile += u64::from(!self.is_honest(sender));
    }

    fn heard(&mut self, me: usize, call: &Call<'_>) {
        let sender = call.sender().index();
        let offer = self.offered(call.data());
        assert_eq!(
            (offer.from, offer.to, offer.vector),
            (sender, call.addressee().index(), call.vector())
        );
        let order = offer.published.expect("heard what was published");
        // A holder that lies about its incarnation can have its listeners hear a message again.
        if self.is_honest(offer.to) {
            let last = &mut self.known[me].heard[sender];
            assert!(order > *last, "heard twice or out of order");
            *last = order;
        }
    }

    fn heard_hostile(&self, me: usize, call: &Call<'_>) {
        let seen = &self.known[me].seen;
        let holder = call.addressee().index() as u32;
        let found = (0..SLOTS).any(|index| {
            let slot = layout::slot(COUNT, holder, index) as usize / 4;
            let kind = seen[slot + entry::KIND as usize / 4];
            seen[slot + entry::VALUE as usize / 4] == call.data()
                && vector_of(kind) == call.vector()
                && is_message(kind)
        });
        assert!(found, "heard what nobody wrote");
    }

    /// Records that a handler of `me` for `call` is about to return `value`.
    pub(super) fn ended(&mut self, me: usize, call: &Call<'_>, value: u32) {
        self.handled += 1;
        if call.addressee().index() != me {
            return;
        }
        let counts = &mut self.known[me].handled;
        counts[call.vector().index()] = counts[call.vector().index()].wrapping_add(1);
        if self.is_honest(call.sender().index()) {
            let offer = &mut self.offers[call.data() as usize];
            assert_eq!(offer.reply, None, "a message ran twice");
            offer.reply = Some(value);
        }
    }

    // Calls by the windows.

    pub(super) fn loaded(&mut self, user: usize, owner: usize, offset: u32, value: u32) {
        if owner == HOSTILE {
            self.known[user].seen[offset as usize / 4] = value;
        }
    }

    /// Records that `owner` stored a word of its `mail`; the function `mail` returns the words of that `mail`.
    pub(super) fn stored(
        &mut self,
        owner: usize,
        offset: u32,
        value: u32,
        order: StoreOrder,
        mail: impl Fn(u32) -> u32,
    ) {
        if offset == header::INCARNATION {
            for other in 0..N {
                self.rings[other][owner].clear();
                // Messages that it sent before it left are still taken.
                if !matches!(value, 0 | JOINING) {
                    self.rings[owner][other].clear();
                }
            }
        }
        if offset < layout::acknowledged(COUNT, 0) {
            return;
        }
        for peer in 0..N {
            let number = peer as u32;
            let acknowledged = layout::acknowledged(COUNT, number);
            if offset == acknowledged {
                if peer == HOSTILE {
                    self.known[owner].hostile_tail = 0;
                    self.rings[owner][peer].clear();
                }
                continue;
            }
            // Words that are cleared at the beginning of an incarnation are not messages.
            if order != StoreOrder::Release {
                continue;
            }
            if offset == layout::taken(COUNT, number) {
                self.took(owner, peer, value, &mail);
            }
            for index in 0..SLOTS {
                let slot = layout::slot(COUNT, number, index);
                if offset == slot + entry::SEQUENCE {
                    let request = Request {
                        sequence: value,
                        kind: mail(slot + entry::KIND),
                        value: mail(slot + entry::VALUE),
                    };
                    self.sent(owner, peer, request);
                }
            }
        }
    }

    fn sent(&mut self, from: usize, to: usize, request: Request) {
        self.published += 1;
        let ring = &mut self.rings[from][to];
        if let Some(last) = ring.back() {
            assert_eq!(request.sequence, last.sequence.wrapping_add(1));
        }
        ring.push_back(request);
        if is_message(request.kind) {
            let vector = vector_of(request.kind);
            let sent = &mut self.known[from].sent[vector.index()];
            *sent = sent.wrapping_add(1);
            let offer = &mut self.offers[request.value as usize];
            assert_eq!((offer.from, offer.to, offer.vector), (from, to, vector));
            assert_eq!(offer.published, None, "a message was sent twice");
            offer.published = Some(self.published);
        }
    }

    fn took(&mut self, me: usize, from: usize, sequence: u32, mail: &impl Fn(u32) -> u32) {
        let request = if self.is_honest(from) {
            let next = self.rings[from][me].pop_front();
            let request = next.expect("took what was sent");
            assert_eq!(request.sequence, sequence);
            if is_message(request.kind) {
                self.offers[request.value as usize].taken = true;
            }
            request
        } else {
            self.took_from_hostile(me, sequence, mail)
        };
        self.known[me].taken = Some((from, request));
    }

    /// Checks the request that `me` took from the hostile ring, which must be valid as `me` read it.
    fn took_from_hostile(
        &mut self,
        me: usize,
        sequence: u32,
        mail: &impl Fn(u32) -> u32,
    ) -> Request {
        let known = &mut self.known[me];
        let slot = layout::slot(COUNT, me as u32, sequence);
        let word = |offset| known.seen[(slot + offset) as usize / 4];
        assert_eq!(sequence, known.hostile_tail.wrapping_add(1));
        assert_eq!(sequence, word(entry::SEQUENCE));
        let incarnation = mail(layout::acknowledged(COUNT, HOSTILE as u32));
        assert!(!matches!(incarnation, 0 | JOINING));
        let epoch = layout::epoch(incarnation, mail(header::INCARNATION));
        assert_eq!(epoch, word(entry::EPOCH), "a request of another epoch");
        let request = Request {
            sequence,
            kind: word(entry::KIND),
            value: word(entry::VALUE),
        };
        known.hostile_tail = sequence;
        request
    }
}
