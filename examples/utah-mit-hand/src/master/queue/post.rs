//! [`Post`]: where the handler of messages about the queue and the background meet.

use core::cell::RefCell;

use condor_hand::queue::{Answer, State};
use condor_mbox::Processor;
use condor_rt::PROCESSORS;
use critical_section::Mutex;
use heapless::Deque;

use super::Queue;
use crate::motions::{Code, Request, Response, VERSION, Verb};

/// Offers that the background has not looked at, of different processors.
const INBOX: usize = 8;

/// Where the handler of messages and the background meet.
pub(in crate::master) struct Post {
    /// None while the background works on it.
    pub(in crate::master) queue: Option<Queue>,
    /// At most one offer of each processor.
    pub(in crate::master) inbox: Deque<(Processor, Request), INBOX>,
    /// For each processor the session that was opened for it, or 0 if it is still to be.
    opened: [Option<u32>; PROCESSORS],
    /// The processor that is the first to get a session.
    next: usize,
    /// Who took control, of which the terminal is to tell.
    pub(in crate::master) taken_by: Option<u32>,
    /// Whether a client has ended all motion.
    pub(in crate::master) is_aborted: bool,
    /// How far the request is that runs, in thousandths.
    pub(in crate::master) progress: u32,
}

pub(in crate::master) type SharedPost = Mutex<RefCell<Post>>;

impl Post {
    pub(in crate::master) const fn new() -> Self {
        Self {
            queue: None,
            inbox: Deque::new(),
            opened: [None; PROCESSORS],
            next: 0,
            taken_by: None,
            is_aborted: false,
            progress: 0,
        }
    }

    /// The processor whose turn it is to get a session, if any asks for one.
    pub(in crate::master) fn next_to_open(&mut self) -> Option<Processor> {
        let places = self.opened.iter().enumerate().cycle();
        let mut places = places.skip(self.next).take(PROCESSORS);
        let (place, _) = places.find(|(_, it)| **it == Some(0))?;
        self.next = (place + 1) % PROCESSORS;
        Some(Processor(place as u8))
    }

    /// A session has been opened for a processor; without one it asks again.
    pub(in crate::master) fn open(&mut self, asks: Processor, session: Option<u32>) {
        if let Some(place) = self.opened.get_mut(asks.index()) {
            *place = session;
        }
    }

    /// The handler's part: answers what can be answered at once, and keeps the rest.
    fn receive(&mut self, sender: Processor, request: &Request) -> Response {
        let Some(queue) = &mut self.queue else {
            return Response::new(Code::Busy, 0);
        };
        let identity = request.identity();
        let session = request.session;
        let in_control = |queue: &Queue| queue.in_control().unwrap_or(0);
        let is_of_sender = |queue: &Queue, session| {
            let owner = queue.owner(session);
            owner.is_some_and(|owner| owner.processor == u32::from(sender.0))
                && !queue.is_closed(session)
        };
        // Whoever asks about a session that is gone is told so.
        let is_of_other =
            |queue: &Queue| queue.owner(session).is_some() && !is_of_sender(queue, session);
        let (not_yours, pending) = (
            Response::new(Code::NotYours, 0),
            Response::new(Code::Pending, 0),
        );
        let verb = Verb::from_number(request.verb);
        match verb.filter(|_| request.version == VERSION) {
            Some(Verb::Open) => {
                let Some(opened) = self.opened.get_mut(sender.index()) else {
                    return Response::new(Code::Wrong, 0);
                };
                match opened.take() {
                    Some(session) if session != 0 && is_of_sender(queue, session) => {
                        Response::new(Code::Done, session)
                    }
                    _ => {
                        *opened = Some(0);
                        pending
                    }
                }
            }
            Some(Verb::Control | Verb::Abort | Verb::GiveUp) if is_of_other(queue) => not_yours,
            Some(Verb::Control) => {
                let before = queue.in_control();
                queue.take_control(session, request.number == 1);
                let now = queue.in_control();
                if now != before {
                    self.taken_by = now;
                }
                Response::new(Code::Done, in_control(queue))
            }
            Some(Verb::Offer | Verb::Stream | Verb::Look) => {
                let answer = queue.answer(identity);
                if !matches!(answer, Answer::New | Answer::Never) {
                    let mut response = Response::of(answer, queue.before(identity).unwrap_or(0));
                    if matches!(answer, Answer::Known(State::Started, _)) {
                        response.progress = self.progress;
                    }
                    response
                } else if self.inbox.iter().any(|(_, it)| it.identity() == identity) {
                    pending
                } else if verb == Some(Verb::Look) || answer == Answer::Never {
                    Response::of(answer, 0)
                } else if is_of_other(queue) {
                    not_yours
                } else if request.body().is_none() {
                    Response::new(Code::Wrong, 0)
                } else if self.inbox.iter().all(|(from, _)| *from != sender)
                    && self.inbox.push_back((sender, *request)).is_ok()
                {
                    pending
                } else {
                    Response::new(Code::Busy, 0)
                }
            }
            Some(Verb::Abort) => {
                if queue.in_control() == Some(session) {
                    self.is_aborted = true;
                    // What nobody has decided about is as new as before.
                    self.inbox.clear();
                }
                Response::new(Code::Done, in_control(queue))
            }
            // Points of a stream that runs are taken elsewhere.
            Some(Verb::Points) => match queue.answer(identity) {
                _ if is_of_other(queue) => not_yours,
                Answer::Known(State::Accepted | State::Started, _) => pending,
                answer => Response::of(answer, 0),
            },
            Some(Verb::GiveUp) => {
                queue.give_up_control(session);
                Response::new(Code::Done, 0)
            }
            None => Response::new(Code::Wrong, 0),
        }
    }
}

/// Answers a request that came by message.
pub(in crate::master) fn receive(
    post: &SharedPost,
    sender: Processor,
    request: &Request,
) -> Response {
    with(post, |post| post.receive(sender, request)).unwrap_or(Response::new(Code::Busy, 0))
}

/// Does something with the post; `None` if that is in progress already.
pub(in crate::master) fn with<R>(
    post: &SharedPost,
    work: impl FnOnce(&mut Post) -> R,
) -> Option<R> {
    critical_section::with(|section| {
        let mut post = post.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut post))
    })
}

#[cfg(test)]
mod tests {
    use core::convert::Infallible;

    use condor_hand::queue::{Owner, Row};

    use super::*;
    use crate::motions::BODY_BYTES;

    const FIRST: Processor = Processor(20);
    const SECOND: Processor = Processor(21);

    fn request(verb: Verb, session: u32, number: u32) -> Request {
        Request {
            version: VERSION,
            verb: verb as u32,
            session,
            number,
            length: 0,
            body: [0; BODY_BYTES],
        }
    }

    /// A post with a session of each processor, and one of the terminal.
    fn post() -> (Post, [u32; 3]) {
        let mut rows = [Row::default(); Queue::ROWS];
        let mut write = |row: usize, bytes: &Row| {
            rows[row] = *bytes;
            Ok::<_, Infallible>(())
        };
        let mut queue = Queue::restore(&[], 1, &mut write).unwrap();
        let mut open = |processor, life| {
            let owner = Owner { processor, life };
            queue.open(owner, &mut write).unwrap().unwrap()
        };
        let sessions = [open(20, 1), open(21, 1), open(0, 0)];
        let mut post = Post::new();
        post.queue = Some(queue);
        (post, sessions)
    }

    fn code(post: &mut Post, sender: Processor, request: &Request) -> u32 {
        post.receive(sender, request).code
    }

    #[test]
    fn a_session_is_used_by_its_owner_alone() {
        let (mut post, [first, _, terminal]) = post();
        let (not_yours, done) = (Code::NotYours as u32, Code::Done as u32);
        for session in [first, terminal] {
            for verb in [Verb::Control, Verb::Abort, Verb::GiveUp, Verb::Offer] {
                let request = request(verb, session, 1);
                assert_eq!(code(&mut post, SECOND, &request), not_yours, "{verb:?}");
            }
            let look = request(Verb::Look, session, 1);
            assert_eq!(code(&mut post, SECOND, &look), Code::New as u32);
        }
        assert_eq!(post.queue.as_ref().unwrap().in_control(), None);
        let control = request(Verb::Control, first, 0);
        assert_eq!(code(&mut post, FIRST, &control), done);
        assert_eq!(post.taken_by, Some(first));
        // Its life has ended.
        let queue = post.queue.as_mut().unwrap();
        assert!(queue.close(first, |_, _| Ok::<_, Infallible>(())).unwrap());
        assert_eq!(code(&mut post, FIRST, &control), not_yours);
        let never = Code::Never as u32;
        for verb in [Verb::Look, Verb::Offer] {
            assert_eq!(code(&mut post, FIRST, &request(verb, first, 1)), never);
        }
        assert!(post.inbox.is_empty());
    }

    #[test]
    fn one_client_leaves_room_for_others() {
        let (mut post, [first, second, _]) = post();
        let (pending, busy) = (Code::Pending as u32, Code::Busy as u32);
        let offer = |session, number| request(Verb::Offer, session, number);
        assert_eq!(code(&mut post, FIRST, &offer(first, 1)), pending);
        assert_eq!(code(&mut post, FIRST, &offer(first, 2)), busy);
        assert_eq!(code(&mut post, FIRST, &offer(first, 1)), pending);
        assert_eq!(code(&mut post, SECOND, &offer(second, 1)), pending);
        // Whoever asks about one of them is not told that it is new.
        let look = request(Verb::Look, first, 1);
        assert_eq!(code(&mut post, SECOND, &look), pending);
        assert_eq!(post.inbox.len(), 2);
    }

    #[test]
    fn sessions_are_opened_in_turn() {
        let (mut post, [first, second, _]) = post();
        let open = request(Verb::Open, 0, 0);
        let mut served = std::vec::Vec::new();
        for _ in 0..4 {
            for sender in [FIRST, SECOND] {
                post.receive(sender, &open);
            }
            let asks = post.next_to_open().unwrap();
            served.push(asks);
            post.open(asks, Some([first, second][asks.index() - 20]));
        }
        assert_eq!(served, [FIRST, SECOND, FIRST, SECOND]);
    }

    #[test]
    fn a_session_that_was_taken_away_is_not_given() {
        let (mut post, [first, second, _]) = post();
        let open = request(Verb::Open, 0, 0);
        for wrong in [99, second] {
            post.open(FIRST, Some(wrong));
            assert_eq!(code(&mut post, FIRST, &open), Code::Pending as u32);
        }
        post.open(FIRST, Some(first));
        assert_eq!(post.receive(FIRST, &open).value, first);
    }
}
