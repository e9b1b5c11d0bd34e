//! Loom on the ring between a processor and its host, while the one overwrites what the other
//! copies, and on the wait for room.

use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, Exclusion, LoadOrder, MemoryWindow, Processor, Region};
use condor_tty::{InputResult, Policy, Terminal, TerminalReader, TerminalSettings};
use loom::sync::{Arc, Mutex};
use loom::thread;

struct Section(Mutex<()>);

impl Exclusion for Section {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        let _alone = self.0.lock().unwrap();
        body()
    }
}

type Hand = Terminal<SimWindow, Section, 4>;

/// A terminal whose output is the echo of what is typed.
fn hand(policy: Policy) -> (Region<SimWindow>, Arc<Hand>) {
    let region = Region::whole(SimWindow::new(192));
    let section = Section(Mutex::new(()));
    let terminal = Terminal::new(
        region.clone(),
        &mut Allocator::new(region.size()),
        8,
        section,
    )
    .unwrap();
    let echo = true;
    terminal
        .configure(&TerminalSettings {
            echo,
            ..TerminalSettings::COOKED
        })
        .unwrap();
    terminal.set_policy(policy).unwrap();
    (region, Arc::new(terminal))
}

fn model(body: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(body);
}

#[test]
fn what_is_overwritten_is_never_read_as_something_else() {
    model(|| {
        let (region, terminal) = hand(Policy::DropOld);
        for _ in 0..3 {
            // Three columns for each character that is wiped out, of "a" and "\x08 \x08".
            assert_eq!(terminal.accept(b'a').unwrap(), InputResult::Taken);
            assert_eq!(terminal.accept(0x7f).unwrap(), InputResult::Taken);
        }
        let mut reader = TerminalReader::attach(region, 0, Processor(0)).unwrap();
        let writer = Arc::clone(&terminal);
        let writing = thread::spawn(move || {
            writer.accept(b'b').unwrap();
        });
        let mut position = 0;
        for _ in 0..2 {
            let mut bytes = [0; 8];
            let fetched = reader.fetch(&mut bytes).unwrap();
            position += fetched.skipped as usize;
            for (index, byte) in bytes[..fetched.len].iter().enumerate() {
                // The twelve before, and what is written now in the place of the fifth.
                let text = b"a\x08 \x08a\x08 \x08a\x08 \x08b";
                assert_eq!(*byte, text[position + index]);
            }
            reader.acknowledge(fetched.len).unwrap();
            position += fetched.len;
        }
        writing.join().unwrap();
        let mut bytes = [0; 8];
        let fetched = reader.fetch(&mut bytes).unwrap();
        assert_eq!(position + fetched.skipped as usize + fetched.len, 13);
    });
}

#[test]
fn room_is_given_only_after_the_bytes_were_copied() {
    model(|| {
        let (region, terminal) = hand(Policy::DropNew);
        let mut reader = TerminalReader::attach(region.clone(), 0, Processor(0)).unwrap();
        terminal.accept(b'a').unwrap();
        terminal.accept(0x7f).unwrap();
        terminal.accept(b'a').unwrap();
        terminal.accept(0x7f).unwrap();
        let writer = Arc::clone(&terminal);
        let writing = thread::spawn(move || {
            writer.accept(b'b').unwrap();
        });
        let mut bytes = [0; 4];
        assert_eq!(reader.fetch(&mut bytes).unwrap().len, 4);
        assert_eq!(&bytes, b"a\x08 \x08");
        reader.acknowledge(4).unwrap();
        writing.join().unwrap();
        let lost = terminal.lost() as usize;
        let mut bytes = [0; 8];
        let fetched = reader.fetch(&mut bytes).unwrap();
        assert_eq!(bytes[..fetched.len], b"a\x08 \x08b"[..5 - lost]);
        assert_eq!(region.load(24, LoadOrder::Relaxed).unwrap() as usize, lost);
    });
}

#[test]
fn two_contexts_write_beside_each_other() {
    model(|| {
        let (region, terminal) = hand(Policy::DropNew);
        let other = Arc::clone(&terminal);
        let writing = thread::spawn(move || {
            other.accept(b'b').unwrap();
        });
        terminal.accept(b'a').unwrap();
        writing.join().unwrap();
        let mut reader = TerminalReader::attach(region, 0, Processor(0)).unwrap();
        let mut bytes = [0; 8];
        assert_eq!(reader.fetch(&mut bytes).unwrap().len, 2);
        bytes[..2].sort_unstable();
        assert_eq!(&bytes[..2], b"ab");
    });
}
