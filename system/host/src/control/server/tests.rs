use std::io::{BufRead, BufReader};
use std::time::Duration;

use rustix::event::{PollFd, Timespec, poll};

use super::*;

const STATUS: &[u8] = b"{\"do\":\"status\"}\n";
/// How long anything may take on a machine that has much else to do.
const DEADLINE: Duration = Duration::from_secs(60);

struct Tested {
    place: tempfile::TempDir,
    server: Server,
}

impl Tested {
    fn new() -> Self {
        let place = tempfile::tempdir().unwrap();
        let listener = UnixListener::bind(place.path().join("control")).unwrap();
        let server = Server::new(listener).unwrap();
        Self { place, server }
    }

    fn client(&self) -> UnixStream {
        let stream = UnixStream::connect(self.place.path().join("control")).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        stream
    }

    /// Whether a wait for events would end at once.
    fn is_ready(&self) -> bool {
        let mut polled: Vec<_> = self
            .server
            .descriptors()
            .map(|(descriptor, flags)| PollFd::from_borrowed_fd(descriptor, flags))
            .collect();
        poll(&mut polled, Some(&Timespec::default())).unwrap() > 0
    }

    /// Answers all requests that can be carried out; how many.
    fn answer_all(&mut self) -> usize {
        let mut count = 0;
        while let Some((from, _)) = self.server.next() {
            self.server.answer(from, &done());
            count += 1;
        }
        count
    }
}

fn done() -> ControlAnswer {
    ControlAnswer {
        ok: true,
        ..ControlAnswer::default()
    }
}

#[test]
fn requests_that_come_together_are_answered_without_another_event() {
    let mut tested = Tested::new();
    let mut client = tested.client();
    client.write_all(&STATUS.repeat(3)).unwrap();
    client.shutdown(std::net::Shutdown::Write).unwrap();
    tested.server.serve();
    // The first is carried out; the next one comes after its answer, and at once.
    let (from, _) = tested.server.next().unwrap();
    assert!(tested.server.next().is_none() && !tested.server.has_more());
    tested.server.answer(from, &done());
    assert!(tested.server.has_more());
    assert_eq!(tested.answer_all(), 2);
    assert!(!tested.server.has_more() && !tested.is_ready());
    tested.server.serve();
    assert_eq!(BufReader::new(client).lines().count(), 3);
}

#[test]
fn what_cannot_be_read_yet_does_not_end_the_wait() {
    let mut tested = Tested::new();
    let mut client = tested.client();
    client.write_all(STATUS).unwrap();
    tested.server.serve();
    let (from, _) = tested.server.next().unwrap();
    // While it is carried out, more come than are kept.
    client.set_nonblocking(true).unwrap();
    let mut sent = 0;
    while let Ok(count) = client.write(&STATUS.repeat(100)) {
        sent += count;
        tested.server.serve();
    }
    assert!(sent > LONGEST);
    assert!(!tested.is_ready(), "the server would poll busily");
    // Nor does it when the client is gone.
    drop(client);
    tested.server.serve();
    assert!(!tested.is_ready() && !tested.server.has_more());
    tested.server.answer(from, &done());
    tested.server.serve();
    assert!(tested.server.connections.is_empty());
}

#[test]
fn a_client_that_does_not_read_gets_a_bounded_number_of_answers() {
    let mut tested = Tested::new();
    let mut client = tested.client();
    client.set_nonblocking(true).unwrap();
    let mut idle = 0;
    while idle < 3 {
        let sent = client.write(&STATUS.repeat(100)).is_ok();
        tested.server.serve();
        let answered = tested.answer_all();
        idle = if sent || answered > 0 { 0 } else { idle + 1 };
        let [connection] = tested.server.connections.as_slice() else {
            panic!("it was left");
        };
        assert!(connection.output.len() <= LONGEST + 4096);
        assert!(connection.input.len() <= LONGEST + 4096);
    }
    assert!(!tested.is_ready() && !tested.server.has_more());
}

#[test]
fn one_client_more_than_there_can_be_takes_the_place_of_an_idle_one() {
    let mut tested = Tested::new();
    let mut clients: Vec<_> = (0..CLIENTS).map(|_| tested.client()).collect();
    tested.server.serve();
    let followers: Vec<_> = tested.server.connections.iter().map(|it| it.from).collect();
    // All but the second.
    for (place, follower) in followers.iter().enumerate() {
        if place != 1 {
            tested.server.follow(*follower);
        }
    }
    let mut late = tested.client();
    late.write_all(STATUS).unwrap();
    tested.server.serve();
    assert_eq!(tested.server.connections.len(), CLIENTS);
    assert_eq!(tested.answer_all(), 1);
    let mut answer = String::new();
    BufReader::new(&late).read_line(&mut answer).unwrap();
    assert_eq!(answer, "{\"ok\":true}\n");
    assert_eq!(clients[1].read(&mut [0; 1]).unwrap(), 0, "it was left");
    // Where nobody is idle, the one that comes is left.
    tested.server.follow(From(CLIENTS as u64));
    let mut last = tested.client();
    tested.server.serve();
    assert_eq!(last.read(&mut [0; 1]).unwrap(), 0);
    assert_eq!(tested.server.connections.len(), CLIENTS);
    clients.clear();
}
