//! The moves of the hostile processor.
//!
//! The hostile processor knows the layout and reads the memory of every processor, so that it can break any
//! rule by as little as it likes: it writes valid requests and replies, sequence numbers and counts that are
//! off by one, words of its former incarnations, and plain noise.

use crate::Vector;
use crate::error::MemoryObject;
use crate::layout::{self, JOINING, SLOTS, entry, header};

use super::script::Script;
use super::world::{HOSTILE, N, USER_BYTES, World};

const ME: u32 = HOSTILE as u32;
const COUNT: u32 = N as u32;

/// The moves of the hostile processor, repeated until it is stopped.
pub(super) struct Attack {
    bytes: Vec<u8>,
    at: usize,
    /// The number of accesses until the next move.
    pause: u32,
    moves: u64,
    stopped: bool,
    /// A number that is added to words, so that a repetition of the bytes differs.
    round: u32,
}

impl Attack {
    pub(super) fn new(bytes: &[u8]) -> Self {
        Self {
            stopped: bytes.is_empty(),
            bytes: bytes.to_vec(),
            at: 0,
            pause: 0,
            moves: 0,
            round: 0,
        }
    }

    pub(super) const fn moves(&self) -> u64 {
        self.moves
    }

    /// Stops the moves, or lets them go on.
    pub(super) fn pause(&mut self, pause: bool) {
        self.stopped = pause || self.bytes.is_empty();
    }

    /// Writes the header of an honest processor.
    pub(super) fn behave(world: &World) {
        let script = Script::new(&[]);
        let mut hand = Hand {
            world,
            script,
            round: 0,
        };
        hand.behave();
    }

    /// Makes a move if its time has come; several moves may fall between two accesses.
    pub(super) fn step(&mut self, world: &World) {
        if self.stopped {
            return;
        }
        for _ in 0..4 {
            if self.pause > 0 {
                self.pause -= 1;
                return;
            }
            self.turn(world);
        }
    }

    fn turn(&mut self, world: &World) {
        let mut script = Script::new(&self.bytes[self.at..]);
        let pause = script.byte();
        self.pause = u32::from(if pause < 0xc0 { pause & 7 } else { pause });
        let choice = script.byte();
        let mut hand = Hand {
            world,
            script,
            round: self.round,
        };
        hand.play(choice);
        let read = hand.script.position();
        self.moves += 1;
        self.at += read;
        if self.at >= self.bytes.len() {
            self.at = 0;
            self.round = self.round.wrapping_add(1);
        }
    }
}

/// One move.
struct Hand<'a> {
    world: &'a World,
    script: Script<'a>,
    round: u32,
}

impl Hand<'_> {
    fn play(&mut self, choice: u8) {
        match choice % 24 {
            0 => self.any_word(),
            1 => self.any_data_word(),
            2 => self.incarnation(),
            3 => self.last_incarnation(),
            4 => self.acknowledge(),
            5 => self.count_taken(),
            6..=9 => self.request(),
            10 | 11 => self.listen_request(),
            12..=14 => self.reply(),
            15 | 16 => self.listen_words(),
            17 => self.set(header::LISTENERS, |hand| hand.script.word()),
            18 => self.set(header::NOTIFY, |hand| u32::from(hand.script.byte())),
            19 => self.set(header::HEARTBEAT, |hand| hand.script.word()),
            20 => self.layout_word(),
            21 => self.truncate(),
            22 => self.behave(),
            _ => self.vector_table(),
        }
    }

    fn set(&mut self, offset: u32, value: impl FnOnce(&mut Self) -> u32) {
        let value = value(self);
        self.world.set_mail_word(offset, value);
    }

    fn mail(&self, owner: u32, offset: u32) -> u32 {
        self.world.mail_word(owner as usize, offset)
    }

    fn incarnation_of(&self, owner: u32) -> u32 {
        self.mail(owner, header::INCARNATION)
    }

    fn somebody(&mut self) -> u32 {
        self.script.below(N) as u32
    }

    /// Returns a word that has a meaning somewhere, or a neighbour of one.
    fn value(&mut self, old: u32) -> u32 {
        match self.script.byte() % 8 {
            0 => 0,
            1 => u32::MAX,
            2 => u32::MAX - 1,
            3 => old.wrapping_add(self.script.difference()),
            4 => old.wrapping_sub(1),
            5 => 1 << (self.script.byte() % 32),
            6 => self
                .incarnation_of(ME)
                .wrapping_add(self.script.difference()),
            _ => self.script.word(),
        }
    }

    fn any_word(&mut self) {
        let words = layout::mail_bytes(COUNT) / 4;
        let place = u32::from(self.script.byte()) | u32::from(self.script.byte()) << 8;
        let offset = place.wrapping_add(self.round) % words * 4;
        let old = self.mail(ME, offset);
        self.set(offset, |hand| hand.value(old));
    }

    fn any_data_word(&mut self) {
        let owner = self.somebody() as usize;
        let words = (layout::BELL_BYTES + USER_BYTES) / 4;
        let offset = u32::from(self.script.byte()).wrapping_add(self.round) % words * 4;
        let value = self.value(0);
        self.world.set_data_word(owner, offset, value);
    }

    fn incarnation(&mut self) {
        let old = self.incarnation_of(ME);
        self.set(header::INCARNATION, |hand| match hand.script.byte() % 6 {
            0 => 0,
            1 => JOINING,
            2 => old.wrapping_add(1),
            3 => old.wrapping_sub(1),
            // There are few incarnations, so that the processor comes back to some of them.
            4 => 1 + u32::from(hand.script.byte() % 4),
            _ => hand.script.word(),
        });
    }

    fn last_incarnation(&mut self) {
        let incarnation = self.incarnation_of(ME);
        self.set(header::LAST_INCARNATION, |hand| {
            incarnation.wrapping_add(hand.script.difference())
        });
    }

    fn acknowledge(&mut self) {
        let peer = self.somebody();
        let incarnation = self.incarnation_of(peer);
        let value = incarnation.wrapping_add(self.script.difference());
        self.set(layout::acknowledged(COUNT, peer), |_| value);
    }

    /// Returns the sequence number of the latest request of `peer` to this processor.
    fn head_of(&self, peer: u32) -> u32 {
        let sequences = (0..SLOTS)
            .map(|index| self.mail(peer, layout::slot(COUNT, ME, index) + entry::SEQUENCE));
        sequences.max().unwrap_or(0)
    }

    fn count_taken(&mut self) {
        let peer = self.somebody();
        let head = self.head_of(peer);
        let count = head.wrapping_add(self.script.difference());
        self.set(layout::taken(COUNT, peer), |_| count);
    }

    fn put(&mut self, at: u32, sequence: u32, epoch: u32, kind: u32, value: u32) {
        for (offset, word) in [
            (entry::VALUE, value),
            (entry::EPOCH, epoch),
            (entry::KIND, kind),
            (entry::SEQUENCE, sequence),
        ] {
            // Now and then a word of the former request stays.
            if self.script.byte() & 0x3f != 0x2a {
                self.set(at + offset, |_| word);
            }
        }
    }

    /// Writes a request to some peer with the right epoch; it is the next one or nearly the next one.
    fn request_of_kind(&mut self, kind: u32) {
        let peer = self.somebody();
        let taken = self.mail(peer, layout::taken(COUNT, ME));
        let sequence = taken.wrapping_add(1).wrapping_add(self.script.difference());
        let epoch = layout::epoch(
            self.mail(peer, layout::acknowledged(COUNT, ME)),
            self.incarnation_of(peer),
        );
        let value = self.script.word();
        self.put(
            layout::slot(COUNT, peer, sequence),
            sequence,
            epoch,
            kind,
            value,
        );
    }

    fn request(&mut self) {
        let class = self.script.one_of(&[1, 1, 2, 2, 2, 5, 0xff]) << 8;
        let vector = self
            .script
            .one_of(&[0, 1, 2, 3, 4, 5, 7, Vector::COUNT as u32, 0xff]);
        let cell = u32::from(self.script.byte()) << 16;
        self.request_of_kind(class | vector | cell);
    }

    fn listen_request(&mut self) {
        let class = self.script.one_of(&[3, 3, 4]) << 8;
        let vector =
            self.script
                .one_of(&[0, 1, Vector::COUNT as u32 - 1, Vector::COUNT as u32, 0xff]);
        self.request_of_kind(class | vector);
    }

    /// Writes a reply to some request of a peer, which is right or nearly right.
    fn reply(&mut self) {
        let peer = self.somebody();
        let slot = layout::slot(COUNT, ME, u32::from(self.script.byte()));
        let sequence = self.mail(peer, slot + entry::SEQUENCE);
        let epoch = self.mail(peer, slot + entry::EPOCH);
        let cell = self.mail(peer, slot + entry::KIND) >> 16;
        let status = self.script.one_of(&[1, 1, 1, 2, 3, 0, 4, u32::MAX]);
        let sequence = sequence.wrapping_add(self.script.difference());
        let value = self.script.word();
        self.put(
            layout::cell(COUNT, peer, cell),
            sequence,
            epoch,
            status,
            value,
        );
        if self.script.byte() & 1 == 0 {
            self.set(layout::taken(COUNT, peer), |_| sequence);
        }
    }

    /// Writes the words of a listener about the messages that it took: of the right epoch, in time or late.
    fn listen_words(&mut self) {
        let (sender, holder) = (self.somebody(), self.somebody());
        let epoch = layout::epoch(self.incarnation_of(sender), self.incarnation_of(holder));
        let sequences = (0..SLOTS)
            .map(|index| self.mail(sender, layout::slot(COUNT, holder, index) + entry::SEQUENCE));
        let head = sequences.max().unwrap_or(0);
        let count = head
            .wrapping_sub(u32::from(self.script.byte() % 12))
            .wrapping_add(self.script.difference());
        self.set(layout::listen(sender), |_| epoch);
        self.set(layout::listen(sender) + 4, |_| count);
    }

    fn layout_word(&mut self) {
        let offset = self.script.below(10) as u32 * 4;
        let old = self.mail(ME, offset);
        self.set(offset, |hand| hand.value(old));
    }

    fn truncate(&mut self) {
        let choice = self.script.byte();
        let object = if choice & 2 == 0 {
            MemoryObject::Mail
        } else {
            MemoryObject::Data
        };
        self.world.lose(object, choice & 1 == 0);
    }

    /// Writes the header of an honest processor, so that others go on sending messages to it.
    fn behave(&mut self) {
        let data_bytes = layout::BELL_BYTES + USER_BYTES;
        self.world.lose(MemoryObject::Mail, false);
        for (offset, value) in [
            (header::MAGIC, layout::MAGIC),
            (header::VERSION, layout::VERSION),
            (header::PROCESSORS, COUNT),
            (header::NUMBER, ME),
            (header::SLOTS, layout::SLOTS),
            (header::VECTORS, layout::VECTORS as u32),
            (header::DATA_SIZE, data_bytes),
        ] {
            self.set(offset, |_| value);
        }
        if matches!(self.incarnation_of(ME), 0 | JOINING) {
            self.set(header::INCARNATION, |_| 1);
        }
        for peer in [0, 2] {
            let incarnation = self.incarnation_of(peer);
            self.set(layout::acknowledged(COUNT, peer), |_| incarnation);
            let head = self.head_of(peer);
            self.set(layout::taken(COUNT, peer), |_| head);
        }
    }

    fn vector_table(&mut self) {
        let bytes = layout::vector_entry(COUNT, Vector::COUNT as u32);
        let table = layout::vector_entry(COUNT, 0);
        let offset = table + self.script.word() % ((bytes - table) / 4) * 4;
        self.set(offset, |hand| hand.script.word());
    }
}
