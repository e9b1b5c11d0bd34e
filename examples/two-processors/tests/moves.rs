//! Both programs in virtual time.

use std::fs;
use std::path::Path;
use std::time::Duration;

use condor_rt::{Machine as _, Messenger as _, Processor, ProgramError, shared_log, sim};
use two_processors::{Master, SERVO, Servo, WHERE};

#[test]
fn the_joint_goes_where_the_file_says() -> Result<(), sim::SimError> {
    let root = Path::new(env!("CARGO_TARGET_TMPDIR")).join("files");
    fs::create_dir_all(&root).unwrap();
    fs::copy("files/moves", root.join("moves")).unwrap();
    fs::write(root.join("servo.log"), "").unwrap();
    let mut system = sim::VirtualSystem::new(65536)?;
    system.files(&root)?;
    system.share_memory(shared_log::BYTES)?;
    system.spawn(Processor(0), &Master)?;
    system.spawn(SERVO, &Servo)?;
    system.host(Processor(20), |machine| {
        let mut mailbox = machine.mailbox()?;
        mailbox.join()?;
        // `files/moves` begins with 500, -500; each is held for two seconds.
        for expected in [500, -500] {
            machine.work(1_500_000_000);
            let at = mailbox.send_with_reply(SERVO, WHERE, 0, Duration::from_secs(1))? as i32;
            assert!((at - expected).abs() < 10, "{at} mrad");
            machine.work(500_000_000);
        }
        let mut log = shared_log::reader(&machine.shared_memory().expect("shared memory"))?;
        for text in ["sends the joint to 500 mrad", "from 0 to 500 mrad"] {
            assert_eq!(log.next_entry()?.expect("a line").text(), text);
        }
        Ok::<_, ProgramError>(())
    })?;
    system.run_until(5_000_000_000)?;
    let log = fs::read_to_string(root.join("servo.log")).unwrap();
    assert!(log.starts_with("from 0 to 500 mrad\n"), "{log}");
    Ok(())
}
