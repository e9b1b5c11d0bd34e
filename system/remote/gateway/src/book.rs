//! [`Book`]: the outcome of each motion of each client.

use std::collections::BTreeMap;
use std::path::Path;

use condor_remote::wire::{Id, RemoteOutcome, RemoteRefusal, RemoteState};
use condor_robot::queue::RequestIdentity;

use crate::journal::{Journal, JournalError, JournalRecord};

/// The number of ended motions of one client that a [`Book`] remembers at least. Older ones become
/// [`RemoteState::Forgotten`].
pub const REMEMBERED: usize = 256;
/// The greatest number of motions of one client that have been offered to the robot and have not ended. Further ones
/// are refused.
pub const OPEN: usize = 16;

/// The state of each motion that clients have sent to the gateway, kept in a [`Journal`], so that no motion runs twice
/// after the gateway was killed.
#[derive(Debug)]
pub struct Book {
    journal: Journal,
    clients: BTreeMap<String, Client>,
}

#[derive(Debug, Default)]
struct Client {
    /// The last incarnation that it was given; 0 before the first.
    joined: u64,
    /// Motions up to this one that are not among the others are forgotten.
    forgotten: Option<Id>,
    motions: BTreeMap<Id, Motion>,
}

#[derive(Clone, Debug)]
struct Motion {
    digest: u64,
    /// Its request of the queue; `None` if the queue never had it.
    request: Option<RequestIdentity>,
    /// The final state and its reason; `None` if it has not ended.
    end: Option<(RemoteState, String)>,
}

impl Book {
    /// Opens the journal in the file `path`, and reads the states of all motions from it. There are none if the file
    /// does not exist.
    ///
    /// # Errors
    /// [`JournalError::Locked`] if another gateway uses the journal; [`JournalError::Damaged`] if a line is
    /// not a record; [`JournalError::Io`] if the operating system refuses.
    pub fn open(path: &Path) -> Result<Self, JournalError> {
        let (journal, records) = Journal::open(path)?;
        let mut book = Self {
            journal,
            clients: BTreeMap::new(),
        };
        for record in &records {
            book.apply(record);
        }
        Ok(book)
    }

    /// Assigns a number to a new incarnation of the client `client`, and notes it in the journal. The number is greater
    /// than those of all earlier incarnations.
    ///
    /// # Errors
    /// Returns a [`RemoteRefusal`] if no number is left, or if the journal cannot be written.
    pub fn join(&mut self, client: &str) -> Result<u64, RemoteRefusal> {
        let former = self.clients.get(client);
        let former = former.map_or(0, |it| {
            it.last().map_or(0, |id| id.incarnation).max(it.joined)
        });
        let incarnation = former.checked_add(1).ok_or_else(|| {
            let error =
                format!("the client {client} has used the last incarnation, {former}: give the client another name");
            RemoteRefusal::new(error, false)
        })?;
        self.note(&JournalRecord::Joined {
            client: client.into(),
            incarnation,
        })?;
        Ok(incarnation)
    }

    /// Looks up the motion `id` of the client `client`. Returns its outcome if the motion has ended, if it has been
    /// forgotten, or if it was never received. Returns `None` if the motion was offered to the robot's queue and has
    /// not ended: the queue knows its state. `digest` is the [`digest`] of the motion if the client has sent its bytes.
    ///
    /// # Errors
    /// Returns a [`RemoteRefusal`] if another motion, with another digest, had this `id` before.
    pub fn look(
        &self,
        client: &str,
        id: Id,
        digest: Option<u64>,
    ) -> Result<Option<RemoteOutcome>, RemoteRefusal> {
        let Some(of_client) = self.clients.get(client) else {
            return Ok(Some(RemoteState::New.into()));
        };
        let Some(motion) = of_client.motions.get(&id) else {
            let last = of_client.last();
            return Ok(Some(if of_client.forgotten >= Some(id) {
                RemoteState::Forgotten.into()
            } else if last.is_some_and(|last| last.incarnation > id.incarnation) {
                RemoteState::Superseded.into()
            } else {
                RemoteState::New.into()
            }));
        };
        // A motion that was withdrawn before its bytes came may have any.
        if motion.request.is_some() && digest.is_some_and(|it| it != motion.digest) {
            let error = format!("the identity {id} already belongs to another motion");
            return Err(RemoteRefusal::new(error, false));
        }
        let end = motion.end.clone();
        Ok(end.map(|(state, reason)| RemoteOutcome {
            state,
            reason,
            progress: None,
        }))
    }

    /// Returns the motions that were offered to the robot's queue and have not ended: the name of the client, the
    /// identity of the motion, and the identity of the request with which the queue got it.
    pub fn open_motions(&self) -> impl Iterator<Item = (&str, Id, RequestIdentity)> {
        self.clients.iter().flat_map(|(client, of_client)| {
            let motions = of_client.motions.iter();
            motions.filter_map(|(id, motion)| match (&motion.end, motion.request) {
                (None, Some(request)) => Some((client.as_str(), *id, request)),
                _ => None,
            })
        })
    }

    /// Returns the identity of the request with which the robot's queue got the motion `id` of the client `client`;
    /// `None` if the queue never got it, or if it is forgotten.
    #[must_use]
    pub fn request(&self, client: &str, id: Id) -> Option<RequestIdentity> {
        self.clients.get(client)?.motions.get(&id)?.request
    }

    /// Notes in the journal that a new motion is about to be offered to the robot's queue. `id` is the identity of the
    /// motion, `digest` the [`digest`] of its bytes, and `request` the identity of the request to the queue.
    ///
    /// # Errors
    /// Returns a [`RemoteRefusal`] if [`OPEN`] motions of the client have not ended, or if the journal cannot be
    /// written. The motion must not be offered then.
    pub fn offer(
        &mut self,
        client: &str,
        id: Id,
        digest: u64,
        request: RequestIdentity,
    ) -> Result<(), RemoteRefusal> {
        let open = self.open_motions().filter(|(of, ..)| *of == client).count();
        if open >= OPEN {
            let error = format!(
                "{OPEN} motions of the client {client} have not ended, and no more are accepted; try \
                                 again later"
            );
            return Err(RemoteRefusal::new(error, true));
        }
        let RequestIdentity { session, number } = request;
        self.note(&JournalRecord::Offered {
            client: client.into(),
            id,
            digest,
            session,
            number,
        })
    }

    /// Notes in the journal that the motion `id` of the client `client` has ended, or will never begin: its final
    /// state, and the reason for it.
    ///
    /// # Errors
    /// Returns a [`RemoteRefusal`] if the journal cannot be written; then the end must not be reported.
    pub fn end(
        &mut self,
        client: &str,
        id: Id,
        state: RemoteState,
        reason: String,
    ) -> Result<(), RemoteRefusal> {
        let of_client = self.clients.get(client);
        let motion = of_client.and_then(|it| it.motions.get(&id));
        let digest = motion.map_or(0, |motion| motion.digest);
        self.note(&JournalRecord::Ended {
            client: client.into(),
            id,
            digest,
            state,
            reason,
        })
    }

    fn note(&mut self, record: &JournalRecord) -> Result<(), RemoteRefusal> {
        self.apply(record);
        let clients = &self.clients;
        let added = self.journal.add(record, || all(clients));
        added.map_err(|error| {
            // The record is on the disk, or not: here the harmless one of the two counts.
            self.take_back(record);
            RemoteRefusal::new(error.to_string(), true)
        })
    }

    /// After a failed write: a motion that was not offered has not come, and an end is found out again.
    fn take_back(&mut self, record: &JournalRecord) {
        match record {
            JournalRecord::Offered { client, id, .. } => {
                if let Some(of_client) = self.clients.get_mut(client) {
                    of_client.motions.remove(id);
                }
            }
            JournalRecord::Ended { client, id, .. } => {
                if let Some(of_client) = self.clients.get_mut(client)
                    && let Some(motion) = of_client.motions.get_mut(id)
                {
                    motion.end = None;
                    if motion.request.is_none() {
                        of_client.motions.remove(id);
                    }
                }
            }
            // A number that nobody has harms nobody.
            JournalRecord::Joined { .. } | JournalRecord::Forgotten { .. } => {}
        }
    }

    fn apply(&mut self, record: &JournalRecord) {
        let (JournalRecord::Joined { client, .. }
        | JournalRecord::Offered { client, .. }
        | JournalRecord::Ended { client, .. }
        | JournalRecord::Forgotten { client, .. }) = record;
        let of_client = self.clients.entry(client.clone()).or_default();
        match record {
            JournalRecord::Joined { incarnation, .. } => {
                of_client.joined = of_client.joined.max(*incarnation);
            }
            JournalRecord::Offered {
                id,
                digest,
                session,
                number,
                ..
            } => {
                let request = RequestIdentity {
                    session: *session,
                    number: *number,
                };
                let motion = Motion {
                    digest: *digest,
                    request: Some(request),
                    end: None,
                };
                of_client.motions.insert(*id, motion);
            }
            JournalRecord::Ended {
                id,
                digest,
                state,
                reason,
                ..
            } => {
                let motion = of_client.motions.entry(*id).or_insert(Motion {
                    digest: *digest,
                    request: None,
                    end: None,
                });
                motion.end = Some((*state, reason.clone()));
            }
            JournalRecord::Forgotten { id, .. } => {
                of_client.forgotten = of_client.forgotten.max(Some(*id));
            }
        }
        of_client.forget();
    }
}

impl Client {
    /// Returns the identity of its last motion, if it had any.
    fn last(&self) -> Option<Id> {
        let last = self.motions.keys().next_back().copied();
        last.max(self.forgotten)
    }

    /// Forgets the oldest motions that have ended, if there are too many.
    fn forget(&mut self) {
        while self.motions.len() > REMEMBERED + OPEN {
            let mut motions = self.motions.iter();
            let Some((id, _)) = motions.find(|(_, motion)| motion.end.is_some()) else {
                return;
            };
            let id = *id;
            self.motions.remove(&id);
            self.forgotten = self.forgotten.max(Some(id));
        }
    }
}

/// The records that the journal needs.
fn all(clients: &BTreeMap<String, Client>) -> Vec<JournalRecord> {
    let mut records = Vec::new();
    for (client, of_client) in clients {
        let client = || client.clone();
        if of_client.joined > 0 {
            records.push(JournalRecord::Joined {
                client: client(),
                incarnation: of_client.joined,
            });
        }
        records.extend(of_client.forgotten.map(|id| JournalRecord::Forgotten {
            client: client(),
            id,
        }));
        for (id, motion) in &of_client.motions {
            let (id, digest) = (*id, motion.digest);
            records.extend(motion.request.map(|request| JournalRecord::Offered {
                client: client(),
                id,
                digest,
                session: request.session,
                number: request.number,
            }));
            records.extend(
                motion
                    .end
                    .clone()
                    .map(|(state, reason)| JournalRecord::Ended {
                        client: client(),
                        id,
                        digest,
                        state,
                        reason,
                    }),
            );
        }
    }
    records
}

/// Returns a hash (FNV-1a) of the bytes of a motion, by which two motions with the same identity are told apart. It is
/// the same in each version of this program.
#[must_use]
pub fn digest(motion: &[u8]) -> u64 {
    motion.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(incarnation: u64, number: u64) -> Id {
        Id {
            incarnation,
            number,
        }
    }

    fn state(book: &Book, id: Id) -> Option<RemoteState> {
        book.look("lab", id, None)
            .expect("no other motion")
            .map(|it| it.state)
    }

    const REQUEST: RequestIdentity = RequestIdentity {
        session: 3,
        number: 9,
    };

    #[test]
    fn what_became_of_a_motion_outlives_the_gateway() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("journal");
        let mut book = Book::open(&path).expect("room");
        assert_eq!(state(&book, id(1, 1)), Some(RemoteState::New));
        book.offer("lab", id(1, 1), digest(b"wave"), REQUEST)
            .expect("room");
        book.offer("lab", id(1, 2), digest(b"fist"), REQUEST)
            .expect("room");
        book.end("lab", id(1, 1), RemoteState::Done, String::new())
            .expect("room");
        book.end("lab", id(2, 1), RemoteState::Withdrawn, String::new())
            .expect("room");
        for _ in 0..2 {
            assert_eq!(state(&book, id(1, 1)), Some(RemoteState::Done));
            assert_eq!(state(&book, id(1, 2)), None);
            // Of an incarnation that is over, nothing new comes.
            assert_eq!(state(&book, id(1, 3)), Some(RemoteState::Superseded));
            assert_eq!(state(&book, id(2, 1)), Some(RemoteState::Withdrawn));
            assert_eq!(state(&book, id(2, 2)), Some(RemoteState::New));
            let other = book.look("lab", id(1, 1), Some(digest(b"fist")));
            assert!(other.unwrap_err().error.contains("1.1"));
            let open: Vec<_> = book.open_motions().collect();
            assert_eq!(open, [("lab", id(1, 2), REQUEST)]);
            drop(book);
            book = Book::open(&path).expect("a journal");
        }
    }

    #[test]
    fn each_incarnation_of_a_client_has_a_greater_incarnation_than_all_before() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("journal");
        let mut last = 0;
        for incarnation in 0..3 {
            let mut book = Book::open(&path).expect("a journal");
            for _ in 0..3 {
                let incarnation = book.join("lab").expect("room");
                assert!(incarnation > last, "{incarnation}");
                last = incarnation;
            }
            // An identity may be one that no gateway has given.
            last += 7;
            book.end("lab", id(last, 1), RemoteState::Withdrawn, String::new())
                .expect("room");
            assert_eq!(book.join("other").expect("room"), incarnation + 1);
        }
        let mut book = Book::open(&path).expect("a journal");
        book.end("lab", id(u64::MAX, 1), RemoteState::Done, String::new())
            .expect("room");
        let refusal = book.join("lab").expect_err("no number is left");
        assert!(!refusal.again, "{refusal}");
        assert_eq!(book.join("other").expect("room"), 4);
    }

    #[test]
    fn what_is_forgotten_is_bounded_and_never_new() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("journal");
        let mut book = Book::open(&path).expect("room");
        let all = (REMEMBERED + OPEN + 100) as u64;
        for number in 1..=all {
            book.end("lab", id(1, number), RemoteState::Withdrawn, String::new())
                .expect("room");
        }
        for number in 1..=all {
            let expected = if number <= 100 {
                RemoteState::Forgotten
            } else {
                RemoteState::Withdrawn
            };
            assert_eq!(state(&book, id(1, number)), Some(expected));
        }
    }

    #[test]
    fn a_client_has_few_motions_that_have_not_ended() {
        let place = tempfile::tempdir().expect("a directory");
        let mut book = Book::open(&place.path().join("journal")).expect("room");
        for number in 1..=OPEN as u64 {
            book.offer("lab", id(1, number), 0, REQUEST).expect("room");
        }
        let refusal = book.offer("lab", id(1, 99), 0, REQUEST).unwrap_err();
        assert!(refusal.again, "{refusal}");
        assert_eq!(state(&book, id(1, 99)), Some(RemoteState::New));
        book.offer("other", id(1, 1), 0, REQUEST)
            .expect("of another client");
    }
}
