//! A processor shows a variable and a parameter of its loop; a host, in another thread, sets the
//! parameter and watches both, by message.
//!
//! ```text
//! cargo run -p condor-vars --example watch
//! ```

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use condor_mbox::sim::SimSystem;
use condor_mbox::{
    Allocator, Call, CriticalSection, Instant, MemoryWindow, Messenger, Processor, Region,
};
use condor_vars::{
    AnyValue, Catalog, Param, Respond, Selections, Tune, VARS, ValueKind, Var, VariableClient,
    VariableSettings, VariableTable, Watch, answer,
};

const HAND: Processor = Processor(0);
const HOST: Processor = Processor(1);
const SECONDS: Duration = Duration::from_secs(10);

static POSITION: Var<f64> = Var::new("joint.position", "rad");
static STIFFNESS: Param<f64> = Param::new("joint.stiffness", "N m/rad", 2.0, 0.0..=50.0);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let system = SimSystem::<2>::in_real_time(4096);
    let [hand_data, host_data] = system.windows(HAND).map(|windows| windows.data);
    let data = [Region::users(hand_data)?, Region::users(host_data)?];

    // The processor: a table in its window, a handler, a loop.
    let (watched, params): ([&dyn Watch; 1], [&dyn Tune; 1]) = ([&POSITION], [&STIFFNESS]);
    let mut selections = Selections::<4>::new();
    let (server, mut sampler) = selections.open(
        Catalog::new(&watched, &params),
        &data[0],
        &mut Allocator::new(data[0].size()),
        &VariableSettings {
            rate: (400, 1),
            rows: 16,
            watchers: 2,
        },
        CriticalSection,
        &|_| 1, // nobody dies here
    )?;
    let answer_all = |call: &Call<'_>| answer(call, &data[call.sender().index()], &[&server]);
    let mut hand = system.mailbox(HAND)?;
    hand.set_vector(VARS, &answer_all, "variables")?;
    hand.join()?;
    let mut host = system.mailbox(HOST)?;
    host.join()?;
    let is_done = AtomicBool::new(false);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let mut tick = 0;
            while !is_done.load(Ordering::Relaxed) {
                let _ = sampler.begin();
                POSITION.set(0.1 * STIFFNESS.get());
                let _ = sampler.end(tick, Instant::from_ns(2_500_000 * tick));
                tick += 1;
                let _ = hand.serve(Duration::from_millis(1));
            }
        });
        let watched = watch(&host, &data, server.offset());
        is_done.store(true, Ordering::Relaxed);
        watched
    })
}

fn watch<M: Messenger, W: MemoryWindow + Clone>(
    host: &M,
    [hand, own]: &[Region<W>; 2],
    offset: u32,
) -> Result<(), Box<dyn std::error::Error>> {
    let table = VariableTable::open(hand, offset)?;
    let mut client = VariableClient::new(
        host,
        own.clone(),
        &mut Allocator::new(own.size()),
        HAND,
        VARS,
    )?;
    let stiffness = table
        .find("joint.stiffness")?
        .ok_or("it has no stiffness")?;
    client.set(
        &table,
        &stiffness,
        AnyValue::F64(2.0),
        AnyValue::F64(3.0),
        SECONDS,
    )?;

    let mut watcher = client.claim(&table, SECONDS)?;
    client.select(&mut watcher, &[0, stiffness.number], 1, SECONDS)?;
    let mut values = [0; 4];
    let row = loop {
        match watcher.read(&mut values)? {
            Some(row) => break row,
            None => host.serve(Duration::from_millis(1))?,
        };
    };
    let (position, rest) = ValueKind::F64.split(&values).ok_or("too short")?;
    let (stiffness, _) = ValueKind::F64.split(rest).ok_or("too short")?;
    println!(
        "tick {}: {position} rad at {stiffness} N m/rad, {} lost",
        row.tick, row.lost
    );
    client.release(&mut watcher, SECONDS)?;
    Ok(())
}
