//! Requests larger than one word, in virtual time.

use std::time::Duration;

use condor_mbox::exchange::{Blocks, ExchangeError, answer};
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    AccessError, Allocator, Call, Exchange, MailboxError, MemoryWindow, Messenger, Processor,
    Region, SendProgress, Vector,
};

const ASKER: Processor = Processor(0);
const SERVER: Processor = Processor(1);
const V: Vector = Vector(20);
const SECOND: Duration = Duration::from_secs(1);

#[derive(
    Clone, Copy, Debug, PartialEq, zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable,
)]
#[repr(C)]
struct Pose {
    joints: [u32; 16],
}

type PoseExchange<'m> = Exchange<'m, SimMailbox<'static, 2>, &'m SimWindow, Pose, [u32; 16]>;

fn system() -> (SimSystem<2>, SimMailbox<'static, 2>) {
    let system = SimSystem::<2>::in_virtual_time(4096);
    let data = system
        .windows(SERVER)
        .map(|windows| Region::users(windows.data).unwrap());
    let double = move |call: &Call<'_>| {
        answer(call, &data[call.sender().index()], |pose: Pose| {
            pose.joints.map(|q| q.wrapping_mul(2))
        })
    };
    let mut server = system.mailbox(SERVER).unwrap();
    server
        .set_vector(V, Box::leak(Box::new(double)), "doubles a pose")
        .unwrap();
    server.join().unwrap();
    system.while_waiting(SERVER, move || {
        server.serve(Duration::ZERO).unwrap();
    });
    let mut asker = system.mailbox(ASKER).unwrap();
    asker.join().unwrap();
    (system, asker)
}

fn exchange<'m>(
    asker: &'m SimMailbox<'static, 2>,
    offset: usize,
) -> Result<PoseExchange<'m>, AccessError> {
    let region = asker.region(ASKER).unwrap();
    let mut allocator = Allocator::new(region.size());
    allocator.bytes(offset)?;
    Exchange::new(asker, region, &mut allocator)
}

fn pose(first: u32) -> Pose {
    Pose {
        joints: core::array::from_fn(|joint| first.wrapping_add(joint as u32)),
    }
}

#[test]
fn a_block_goes_there_and_back() {
    let (_system, asker) = system();
    let mut exchange = exchange(&asker, 100).unwrap();
    for first in [0, 77, u32::MAX] {
        let response = exchange.call(SERVER, V, &pose(first), SECOND).unwrap();
        assert_eq!(response, pose(first).joints.map(|q| q.wrapping_mul(2)));
    }
}

#[test]
fn a_block_is_in_doubt_until_its_late_reply_came() {
    let (system, asker) = system();
    let mut exchange = exchange(&asker, 0).unwrap();
    assert!(exchange.call(SERVER, V, &pose(1), SECOND).is_ok());
    system.stall(SERVER, true);
    let stalled = MailboxError::Stalled {
        to: SERVER,
        vector: V,
        progress: SendProgress::MayRun,
    };
    assert_eq!(
        exchange.call(SERVER, V, &pose(2), SECOND),
        Err(stalled.into())
    );
    assert_eq!(
        exchange.call(SERVER, V, &pose(3), SECOND),
        Err(ExchangeError::InDoubt)
    );
    system.stall(SERVER, false);
    // The server answers the late request while this processor waits for something else.
    assert_eq!(asker.serve(SECOND), Ok(0));
    let response = exchange.call(SERVER, V, &pose(4), SECOND);
    assert_eq!(response, Ok(pose(4).joints.map(|q| q.wrapping_mul(2))));
}

#[test]
fn an_offset_outside_of_the_region_is_refused() {
    let (_system, asker) = system();
    assert!(exchange(&asker, 4096).is_err());
    for offset in [1, 4096, 4096 - 64, u32::MAX - 3, u32::MAX] {
        assert_eq!(
            asker.send_with_reply(SERVER, V, offset, SECOND),
            Ok(0),
            "{offset:#x}"
        );
    }
}

#[test]
fn blocks_of_the_server_belong_to_one_asker_each() {
    let system = SimSystem::<2>::in_virtual_time(4096);
    let [_, own] = system.windows(SERVER);
    let data = Region::users(own.data).unwrap();
    let mut allocator = Allocator::new(data.size());
    allocator.bytes(100).unwrap();
    let blocks = Blocks::<Pose, u32>::new(&mut allocator, 2).unwrap();
    let first = move |call: &Call<'_>| blocks.answer(call, &data, |pose: Pose| pose.joints[0]);
    let mut server = system.mailbox(SERVER).unwrap();
    server
        .set_vector(V, Box::leak(Box::new(first)), "the first joint")
        .unwrap();
    server.join().unwrap();
    system.while_waiting(SERVER, move || {
        server.serve(Duration::ZERO).unwrap();
    });
    let mut asker = system.mailbox(ASKER).unwrap();
    asker.join().unwrap();

    let region = asker.region(SERVER).unwrap();
    let found = Blocks::<Pose, u32>::at(blocks.offset(), 2);
    assert_eq!(found, blocks);
    let mut exchange = found.client(&asker, &region).unwrap();
    assert_eq!(exchange.call(SERVER, V, &pose(9), SECOND), Ok(9));
    drop(exchange);

    // Neither the block of another processor nor a place that is none.
    for data in [blocks.block(SERVER).unwrap(), blocks.offset() + 4, u32::MAX] {
        let reply = asker.send_with_reply(SERVER, V, data, SECOND);
        assert_eq!(reply, Ok(0), "{data:#x}");
    }
    assert_eq!(blocks.block(Processor(2)), None);
    let few = Blocks::<Pose, u32>::at(blocks.offset(), 0);
    assert!(few.client(&asker, &region).is_err());
    let far = Blocks::<Pose, u32>::at(u32::MAX, 2);
    assert!(far.client(&asker, &region).is_err());
    assert_eq!(far.block(SERVER), None);
    let mut small = Allocator::new(blocks.bytes() as u32 - 1);
    assert!(Blocks::<Pose, u32>::new(&mut small, 2).is_err());
}
