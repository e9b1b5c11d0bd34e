//! The ring of what has been printed, beside a queue of std.

use std::collections::VecDeque;

use proptest::prelude::*;

use super::Ring;

#[derive(Clone, Debug)]
enum Step {
    Push(Vec<u8>),
    Lose(Vec<u8>),
    Take(usize),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let bytes = || prop::collection::vec(any::<u8>(), 0..40);
    let step = prop_oneof![
        bytes().prop_map(Step::Push),
        bytes().prop_map(Step::Lose),
        (0..60_usize).prop_map(Step::Take),
    ];
    prop::collection::vec(step, 0..30)
}

proptest! {
    #[test]
    fn a_ring_is_a_bounded_queue(steps in steps()) {
        let ring = Ring::<37>::new();
        let (mut model, mut lost) = (VecDeque::new(), 0);
        for step in steps {
            match step {
                Step::Push(bytes) => {
                    let fits = bytes.len().min(37 - model.len());
                    prop_assert_eq!(ring.push(&bytes), fits);
                    model.extend(&bytes[..fits]);
                }
                Step::Lose(bytes) => {
                    ring.push_or_lose(&bytes);
                    let fits = bytes.len().min(37 - model.len());
                    model.extend(&bytes[..fits]);
                    lost += bytes.len() - fits;
                }
                Step::Take(count) => {
                    let mut into = vec![0; count];
                    let peeked = ring.peek(&mut into);
                    prop_assert_eq!(peeked, count.min(model.len()));
                    let expected: Vec<u8> = model.iter().take(count).copied().collect();
                    prop_assert_eq!(&into[..peeked], &expected);
                    ring.consume(peeked);
                    model.drain(..peeked);
                }
            }
            prop_assert_eq!(ring.held(), model.len());
            prop_assert_eq!(ring.lost() as usize, lost);
        }
    }
}
