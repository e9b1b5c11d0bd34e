//! Slots, selections and parameters, by messages.

use condor_mbox::Processor;
use condor_vars::{
    AnyValue, Catalog, Param, Params, RequestError, RowHead, Tune, ValueKind, Var,
    VariableTableError, Vars, Watch, WatchError, choice,
};

use crate::support::{Loop, OWNER, Rig, TIMEOUT, ask, released, tick};

choice! {
    /// What the hand does.
    enum Mode {
        Idle = "idle",
        Hold = "hold",
        Move = "move",
    }
}

/// What each test shows.
struct Hand {
    angles: Vars<f64, 3>,
    count: Var<i16>,
    mode: Var<Mode>,
    limits: Params<u8, 2>,
    gain: Param<f32>,
    task: Param<Mode>,
}

fn hand() -> (&'static Hand, Catalog<'static>) {
    let hand: &'static Hand = Box::leak(Box::new(Hand {
        angles: Vars::named(&["proximal", "medial", "distal"], "rad"),
        count: Var::new("count", "").about("Of grasps."),
        mode: Var::new("mode", ""),
        limits: Params::named(&["least", "most"], "", [1, 9], 0..=10),
        gain: Param::new("gain", "N m/rad", 2.0, 0.5..=50.0),
        task: Param::new("task", "", Mode::Idle, Mode::Idle..=Mode::Hold),
    }));
    let watched: [&dyn Watch; 3] = [&hand.angles, &hand.count, &hand.mode];
    let params: [&dyn Tune; 3] = [&hand.gain, &hand.task, &hand.limits];
    let catalog = Catalog::new(Box::leak(Box::new(watched)), Box::leak(Box::new(params)));
    (hand, catalog)
}

fn start(rows: u32) -> (Rig, &'static Hand, Loop) {
    let rig = Rig::new();
    let (hand, catalog) = hand();
    let sampler = rig.start(catalog, rows);
    (rig, hand, sampler)
}

#[test]
fn a_table_says_what_there_is() {
    let (rig, _, _sampler) = start(4);
    let table = rig.table();
    assert_eq!((table.len(), table.slots(), table.rate()), (9, 2, (400, 1)));
    let names: Vec<_> = table.entries().map(|it| it.unwrap().name).collect();
    let expected = [
        "proximal", "medial", "distal", "count", "mode", "gain", "task", "least", "most",
    ];
    assert_eq!(names, expected);
    let count = table.find("count").unwrap().unwrap();
    assert_eq!(
        (count.kind, count.about.as_str()),
        (ValueKind::I16, "Of grasps.")
    );
    assert_eq!((count.position, count.bounds), (24, None));
    let gain = table.find("gain").unwrap().unwrap();
    assert_eq!(gain.bounds, Some([AnyValue::F32(0.5), AnyValue::F32(50.0)]));
    assert_eq!(gain.unit, "N m/rad");
    let mode = table.find("mode").unwrap().unwrap();
    assert_eq!(table.label(&mode, 2).unwrap().unwrap(), "move");
    assert_eq!(table.label(&mode, 3).unwrap(), None);
    assert_eq!(table.find("yaw").unwrap(), None);
    let missing = VariableTableError::NoEntry {
        number: 9,
        entries: 9,
    };
    assert_eq!(table.entry(9), Err(missing));
}

#[test]
fn a_watcher_gets_what_it_selects() {
    let (rig, hand, mut sampler) = start(4);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let mut watcher = client.claim(&rig.table(), TIMEOUT).unwrap();
    let mut values = [0; 16];
    assert_eq!(watcher.read(&mut values), Err(WatchError::Unselected));
    client.select(&mut watcher, &[5, 1, 3], 2, TIMEOUT).unwrap();
    assert_eq!(watcher.read(&mut values), Ok(None));
    for number in 0..4 {
        sampler.begin().unwrap();
        hand.angles.set_at(1, 0.25);
        hand.count.set(-3);
        sampler.end(number, released(number)).unwrap();
    }
    for number in [0, 2] {
        let row = watcher.read(&mut values).unwrap().unwrap();
        let expected = RowHead {
            tick: number,
            released: released(number),
            lost: 0,
            words: 4,
        };
        assert_eq!(row, expected);
        let (angle, rest) = ValueKind::F64.split(&values[..row.words]).unwrap();
        let (count, rest) = ValueKind::I16.split(rest).unwrap();
        let (gain, rest) = ValueKind::F32.split(rest).unwrap();
        let expected = [AnyValue::F64(0.25), AnyValue::Int(-3), AnyValue::F32(2.0)];
        assert_eq!([angle, count, gain], expected);
        assert!(rest.is_empty());
    }
    assert_eq!(watcher.read(&mut values), Ok(None));
    let room = WatchError::Room { words: 4, room: 3 };
    assert_eq!(watcher.read(&mut values[..3]), Err(room));
}

#[test]
fn what_a_parameter_began_with_is_known_after_it_has_been_set() {
    let (rig, hand, mut sampler) = start(4);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let table = rig.table();
    let entry = table.find("gain").unwrap().unwrap();
    let [two, three] = [2.0, 3.0].map(AnyValue::F32);
    client.set(&table, &entry, two, three, TIMEOUT).unwrap();
    sampler.begin().unwrap();
    assert!((hand.gain.get() - 3.0).abs() < f32::EPSILON);
    assert_eq!(client.get(&table, &entry, TIMEOUT), Ok(three));
    assert_eq!(client.initial(&table, &entry, TIMEOUT), Ok(two));
    let most = table.find("most").unwrap().unwrap();
    let initial = client.initial(&table, &most, TIMEOUT);
    assert_eq!(initial, Ok(AnyValue::Uint(9)));
    let count = table.find("count").unwrap().unwrap();
    let wrong = client.initial(&table, &count, TIMEOUT);
    assert_eq!(wrong, Err(RequestError::NoParam { number: 3 }));
}

#[test]
fn what_is_overwritten_is_counted() {
    let (rig, _, mut sampler) = start(2);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let mut watcher = client.claim(&rig.table(), TIMEOUT).unwrap();
    client
        .select(&mut watcher, &[0, 1, 2, 3, 4, 5, 6], 1, TIMEOUT)
        .unwrap();
    assert_eq!((watcher.rows(), watcher.words()), (2, 10));
    for number in 0..7 {
        tick(&mut sampler, number);
    }
    let mut values = [0; 10];
    let row = watcher.read(&mut values).unwrap().unwrap();
    assert_eq!((row.tick, row.lost), (5, 5));
    let row = watcher.read(&mut values).unwrap().unwrap();
    assert_eq!((row.tick, row.lost), (6, 0));
    assert_eq!(watcher.read(&mut values), Ok(None));
    assert_eq!(watcher.lost(), 5);
    // Of fewer variables, the slot keeps more rows.
    client.select(&mut watcher, &[3], 1, TIMEOUT).unwrap();
    assert_eq!(watcher.rows(), 4);
}

#[test]
fn a_parameter_is_changed_by_compare_and_set() {
    let (rig, hand, mut sampler) = start(2);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let table = rig.table();
    let gain = table.find("gain").unwrap().unwrap();
    let mut set = |expected, new| client.set(&table, &gain, expected, new, TIMEOUT);
    let [two, three, sixty] = [2.0, 3.0, 60.0].map(AnyValue::F32);
    let [least, greatest] = [0.5, 50.0].map(AnyValue::F32);
    let bounds = RequestError::OutOfBounds { least, greatest };
    assert_eq!(set(two, sixty), Err(bounds));
    assert_eq!(set(two, AnyValue::F32(f32::NAN)), Err(bounds));
    assert_eq!(set(two, three), Ok(()));
    assert_eq!(
        set(two, three),
        Err(RequestError::Conflict { present: three })
    );
    let wrong = RequestError::WrongKind {
        value: AnyValue::F64(1.0),
        kind: ValueKind::F32,
    };
    assert_eq!(set(three, AnyValue::F64(1.0)), Err(wrong));
    assert_eq!(client.get(&table, &gain, TIMEOUT), Ok(three));
    assert!(
        (hand.gain.get() - 2.0).abs() < f32::EPSILON,
        "not before the next tick"
    );
    tick(&mut sampler, 0);
    assert!((hand.gain.get() - 3.0).abs() < f32::EPSILON);

    let task = table.find("task").unwrap().unwrap();
    let idle = AnyValue::Choice(0);
    client
        .set(&table, &task, idle, AnyValue::Choice(1), TIMEOUT)
        .unwrap();
    for none in [2, 3] {
        let refused = client.set(
            &table,
            &task,
            AnyValue::Choice(1),
            AnyValue::Choice(none),
            TIMEOUT,
        );
        assert!(matches!(refused, Err(RequestError::OutOfBounds { .. })));
    }
    tick(&mut sampler, 1);
    assert_eq!(hand.task.get(), Mode::Hold);

    // Of a block one is set, and the other stays.
    let [least, most] = ["least", "most"].map(|name| table.find(name).unwrap().unwrap());
    let [one, nine, ten, eleven] = [1, 9, 10, 11].map(AnyValue::Uint);
    let before = hand.limits.version();
    assert_eq!(client.set(&table, &most, nine, ten, TIMEOUT), Ok(()));
    let bounds = RequestError::OutOfBounds {
        least: AnyValue::Uint(0),
        greatest: ten,
    };
    assert_eq!(client.set(&table, &most, ten, eleven, TIMEOUT), Err(bounds));
    let conflict = RequestError::Conflict { present: one };
    assert_eq!(
        client.set(&table, &least, nine, ten, TIMEOUT),
        Err(conflict)
    );
    assert_eq!(client.get(&table, &least, TIMEOUT), Ok(one));
    let limits = || [0, 1, 2].map(|index| hand.limits.get_at(index));
    assert_eq!(limits(), [Some(1), Some(9), None]);
    assert_eq!(hand.limits.version(), before);
    tick(&mut sampler, 2);
    assert_eq!(limits(), [Some(1), Some(10), None]);
    assert_ne!(hand.limits.version(), before);

    let count = table.find("count").unwrap().unwrap();
    let number = count.number;
    let refused = client.get(&table, &count, TIMEOUT);
    assert_eq!(refused, Err(RequestError::NoParam { number }));
}

#[test]
fn the_slot_of_a_dead_watcher_is_claimed_by_the_next() {
    let (rig, _, mut sampler) = start(2);
    let table = rig.table();
    let (first, second) = (rig.join(Processor(1)), rig.join(Processor(2)));
    let mut dies = rig.client(&first).claim(&table, TIMEOUT).unwrap();
    rig.client(&first)
        .select(&mut dies, &[0], 1, TIMEOUT)
        .unwrap();
    let mut lives = rig.client(&second).claim(&table, TIMEOUT).unwrap();
    rig.client(&second)
        .select(&mut lives, &[1], 1, TIMEOUT)
        .unwrap();
    let third = rig.join(Processor(3));
    let mut client = rig.client(&third);
    let none = client.claim(&table, TIMEOUT).err().unwrap();
    assert_eq!(none, RequestError::NoSlot { slots: 2 });
    tick(&mut sampler, 0);

    rig.system.kill(Processor(1));
    let mut watcher = client.claim(&table, TIMEOUT).unwrap();
    let mut values = [0; 10];
    assert_eq!(
        dies.read(&mut values),
        Err(WatchError::Displaced { slot: 0 })
    );
    client.select(&mut watcher, &[2, 3], 1, TIMEOUT).unwrap();
    tick(&mut sampler, 1);
    assert_eq!(watcher.read(&mut values).unwrap().unwrap().tick, 1);
    assert_eq!(lives.read(&mut values).unwrap().unwrap().tick, 0);
    // A watcher that gives its slot back leaves it to anybody.
    client.release(&mut watcher, TIMEOUT).unwrap();
    assert_eq!(watcher.read(&mut values), Err(WatchError::Unselected));
    tick(&mut sampler, 2);
    client.claim(&table, TIMEOUT).unwrap();
    std::mem::forget(first);
}

#[test]
fn a_loop_that_stands_still_is_busy() {
    let (rig, _, mut sampler) = start(2);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let mut watcher = client.claim(&rig.table(), TIMEOUT).unwrap();
    client.select(&mut watcher, &[0], 1, TIMEOUT).unwrap();
    let busy = RequestError::Busy {
        to: OWNER,
        timeout: TIMEOUT,
    };
    assert_eq!(client.select(&mut watcher, &[1], 1, TIMEOUT), Err(busy));
    tick(&mut sampler, 0);
    client.select(&mut watcher, &[1], 1, TIMEOUT).unwrap();
}

#[test]
fn an_owner_that_has_restarted_is_told_from_the_former() {
    let (rig, _, mut sampler) = start(2);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let former = rig.table();
    let gain = former.find("gain").unwrap().unwrap();
    let mut watcher = client.claim(&former, TIMEOUT).unwrap();
    client.select(&mut watcher, &[0], 1, TIMEOUT).unwrap();
    tick(&mut sampler, 0);
    let mut sampler = rig.start(hand().1, 2);
    tick(&mut sampler, 0);
    let restarted = VariableTableError::Restarted {
        found: 2,
        expected: 1,
    };
    let mut values = [0; 10];
    assert_eq!(watcher.read(&mut values), Err(restarted.into()));
    assert_eq!(client.get(&former, &gain, TIMEOUT), Err(restarted.into()));
    assert_eq!(former.entry(0), Err(restarted));
    assert_eq!(
        client.claim(&former, TIMEOUT).err().unwrap(),
        restarted.into()
    );
    client.claim(&rig.table(), TIMEOUT).unwrap();
}

#[test]
fn requests_that_make_no_sense_are_refused() {
    let (rig, _, mut sampler) = start(2);
    tick(&mut sampler, 0);
    let mailbox = rig.join(Processor(1));
    let mut client = rig.client(&mailbox);
    let mut watcher = client.claim(&rig.table(), TIMEOUT).unwrap();
    let missing = VariableTableError::NoEntry {
        number: 9,
        entries: 9,
    };
    let none = client.select(&mut watcher, &[9], 1, TIMEOUT);
    assert_eq!(none, Err(missing.into()));
    for (request, code) in [
        ([9, 0, 1, 0, 0, 0, 0, 0], 4),
        ([1, 64, 1, 0, 0, 0, 0, 0], 2),
        ([2, 0, 1, 0, 7, 1, 0, 0], 6),
        ([2, 0, 1, u32::MAX, 1, 1, 0, 0], 6),
        ([3, 0, 1, 1, 0, 0, 0, 0], 6),
        ([4, 0, 1, u32::MAX, 0, 0, 0, 0], 7),
        ([5, 0, 1, 0, 0, 0, 0, 0], 9),
        ([5, 0, 2, 0, 0, 0, 0, 0], 3),
    ] {
        assert_eq!(ask(&mailbox, request)[0], code, "{request:?}");
    }
}
