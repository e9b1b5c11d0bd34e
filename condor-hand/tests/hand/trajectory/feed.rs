//! Sequences that are longer than the queue.

use condor_hand::trajectory::{MotionTicket, Observations, Pace, Primitive, Profile, Target};
use heapless::Vec;

use super::generator::{Hand, Motion, hand};

fn to(position: f64) -> Motion {
    let motion = Primitive::new(Pace::Duration(0.1), Profile::MinimumJerk);
    motion.with(1, Target::Absolute(position)).unwrap()
}

fn tick(hand: &mut Hand) -> f64 {
    hand.tick(&Observations::none())[1].position
}

#[test]
fn a_sequence_goes_in_as_far_as_there_is_room_and_goes_on_from_there() {
    let sequence = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0].map(|number| to(0.05 * number));
    let (mut hand, mut tickets, mut fed) = (hand(), Vec::<MotionTicket, 16>::new(), 0);
    let mut ends = Vec::<f64, 64>::new();
    while fed < sequence.len() || !hand.is_idle() {
        let (taken, result) = hand.feed(sequence[fed..].iter().cloned(), &mut tickets);
        result.unwrap();
        // The queue has four places.
        assert!(taken <= 4 && (fed > 0 || taken == 4), "{taken}");
        fed += taken as usize;
        ends.push(tick(&mut hand)).unwrap();
    }
    assert_eq!(
        tickets,
        core::array::from_fn::<_, 7, _>(|number| MotionTicket(number as u32))
    );
    // Five ticks each, without one between them.
    assert_eq!(ends.len(), 7 * 5);
    assert_eq!(ends[4], 0.05);
    assert_eq!(ends[34], 0.05 * 7.0);
}

#[test]
fn it_ends_at_one_that_is_refused_and_at_the_last_ticket() {
    let (mut hand, mut tickets) = (hand(), Vec::<MotionTicket, 3>::new());
    let (fed, result) = hand.feed([to(0.05), to(99.0), to(0.1)], &mut tickets);
    assert_eq!(fed, 1);
    assert!(result.unwrap_err().to_string().contains("99"), "joint 1");
    let (fed, result) = hand.feed([to(0.05), to(0.1), to(0.15)], &mut tickets);
    assert_eq!((fed, result), (2, Ok(())));
    assert!(tickets.is_full());
}
