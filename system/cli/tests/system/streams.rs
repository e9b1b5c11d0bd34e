//! Rows and events that a program hands on.

use std::time::Instant;

use condor_host::streams::Streams;
use condor_host::view::View;
use condor_ros2::Layout;

use crate::joint::{load_joint, start_one};
use crate::running::DEADLINE;

#[test]
fn rows_of_a_program_that_is_loaded_later_have_a_topic() {
    let up = start_one();
    let (directory, status) = (up.directory(), up.status());
    let mut view = View::open(&directory, status.window_bytes).unwrap();
    view.join().unwrap();
    let patterns = ["*:ticks".to_owned()];
    let mut streams = Streams::open(&directory, &status, &view, &patterns, 1).unwrap();
    let names = |streams: &Streams<'_>| -> Vec<_> {
        let topics = streams.topics().iter();
        topics.map(|topic| topic.name.clone()).collect()
    };
    assert_eq!(names(&streams), ["/a/servo", "/events"]);
    load_joint(&up);
    let mut rows = [0; 3];
    let mut read_until = |is_enough: &dyn Fn(&[u32; 3]) -> bool| {
        let begun = Instant::now();
        while !is_enough(&rows) {
            assert!(begun.elapsed() < DEADLINE, "{rows:?}");
            let topics = streams.topics().to_vec();
            let read = streams.read(|message| {
                let topic = &topics[message.topic];
                assert_eq!(topic.has_rows, message.topic != 1);
                if topic.has_rows {
                    let layout = Layout::of_schema(&topic.schema).unwrap();
                    layout.decode(&message.payload).unwrap();
                } else {
                    condor_ros2::Log::decode(&message.payload).unwrap();
                }
                rows[message.topic] += 1;
            });
            assert!(read.unwrap());
            streams.pause().unwrap();
        }
        rows
    };
    let [_, events, _] = read_until(&|rows| rows[0] > 0 && rows[2] >= 10);
    // Events keep their topic.
    up.run(&["stop", "a"]);
    read_until(&|rows| rows[1] > events);
    assert_eq!(names(&streams), ["/a/servo", "/events", "/b/servo"]);
}
