//! The ring against the queue of the standard library.

use std::collections::VecDeque;

use condor_dev::Ring;
use proptest::prelude::*;

#[derive(Clone, Debug)]
enum Step {
    Write(Vec<u8>),
    Read(usize),
    PeekAndSkip,
    Clear,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => prop::collection::vec(any::<u8>(), 0..12).prop_map(Step::Write),
        4 => (0_usize..12).prop_map(Step::Read),
        2 => Just(Step::PeekAndSkip),
        1 => Just(Step::Clear),
    ]
}

proptest! {
    #[test]
    fn the_ring_is_a_queue(steps in prop::collection::vec(step(), 0..100)) {
        let ring = Ring::<8>::new();
        let mut queue = VecDeque::new();
        for step in steps {
            match step {
                Step::Write(bytes) => {
                    let mut writer = ring.writer().unwrap();
                    prop_assert_eq!(writer.room(), 8 - queue.len());
                    let count = writer.write(&bytes);
                    prop_assert_eq!(count, bytes.len().min(8 - queue.len()));
                    queue.extend(&bytes[..count]);
                }
                Step::Read(most) => {
                    let mut bytes = vec![0; most];
                    let count = ring.reader().unwrap().read(&mut bytes);
                    let expected: Vec<u8> = queue.drain(..most.min(queue.len())).collect();
                    prop_assert_eq!(&bytes[..count], &expected);
                }
                Step::PeekAndSkip => {
                    let mut reader = ring.reader().unwrap();
                    prop_assert_eq!(reader.peek(), queue.pop_front());
                    reader.skip();
                }
                Step::Clear => {
                    ring.reader().unwrap().clear();
                    queue.clear();
                }
            }
            prop_assert_eq!(ring.len(), queue.len());
            prop_assert_eq!(ring.is_empty(), queue.is_empty());
            prop_assert_eq!(ring.is_full(), queue.len() == 8);
        }
    }
}

#[test]
fn an_end_belongs_to_one_at_a_time() {
    let ring = Ring::<4>::new();
    let ends = (ring.writer(), ring.reader());
    assert!(ends.0.is_some() && ends.1.is_some());
    for _ in 0..2 {
        assert!(ring.writer().is_none() && ring.reader().is_none());
    }
    drop(ends);
    assert!(ring.writer().is_some() && ring.reader().is_some());
}
