//! Tests of the memory through which orders and reports of a grasp pass.

use condor_hand::grasp::distributed::{GraspOrder, GraspReason, GraspReport, GraspState};
use condor_mbox::{Allocator, MemoryWindow, Region, StaticMemory};
use condor_robot::message::GraspLayout;

#[test]
fn an_order_comes_once_and_a_report_when_it_has_news() {
    static MEMORY: StaticMemory<1024> = StaticMemory::new();
    let region = Region::whole(MEMORY.window());
    let layout = GraspLayout::new(&mut Allocator::new(region.size())).unwrap();
    let mut end = layout.servo_end(region).unwrap();
    assert!(layout.report(&region).is_err());
    assert_eq!(end.order(), None);

    let mut order = GraspOrder {
        center: [0.1, -0.2, 0.3],
        force: [1.0, 2.0, 3.0],
        moment: [4.0, 5.0, 6.0],
        friction: 0.7,
        ..GraspOrder::hold(0b1_0101, [[7.0, 8.0, 9.0]; 5], [10.0; 6], [11.0; 6])
    };
    order.stiffness[1][5] = 12.0;
    order.tips[4][2] = f64::MIN_POSITIVE;
    let number = layout.give(&order, &region).unwrap();
    assert_eq!(end.order(), Some((number, order)));
    assert_eq!(end.order(), None);

    let mut report = GraspReport {
        order: u64::MAX,
        state: GraspState::Left,
        reason: GraspReason::Switched,
        squeeze_share: 0.5,
        deviation: [f64::MIN_POSITIVE; 6],
        margins: [-1.0, 0.0, 1.0, 2.0, 3.0],
    };
    end.tell(&report);
    assert_eq!(layout.report(&region), Ok(report));
    // Numbers alone are no news; they come with every 16th report.
    let former = report;
    report.squeeze_share = 1.0;
    for _ in 1..16 {
        end.tell(&report);
        assert_eq!(layout.report(&region), Ok(former));
    }
    end.tell(&report);
    assert_eq!(layout.report(&region), Ok(report));
}
