//! [`Bridge`]: rings, from processes to harts and back.

use std::io::{self, Read as _, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use condor_clock::linux::Futex;
use condor_mbox::linux::LinuxDoorbell;
use condor_mbox::{Clock as _, Doorbell as _, Processor};

use condor_rt::linux::MappedPage;
use condor_rt::numbers::PROCESSORS;

/// The time for which a thread waits for a ring before it checks if it must end.
const LOOK: Duration = Duration::from_millis(200);

/// A bridge between the doorbells of Linux processes and the serial line of a machine: it passes on
/// each ring (the wake-up of a processor for a message) in both directions, until it is dropped. It
/// has a thread for each hart, and one for what comes from the machine.
#[derive(Debug)]
pub struct Bridge {
    stream: UnixStream,
    ending: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Bridge {
    /// Starts a bridge. `stream` is the connection to the machine's serial line. `harts` lists the
    /// harts of the machine: the processor number of each, and the doorbell on which processes ring
    /// it. `page` is the page of the simulated clock, if there is one: a ring then also wakes a
    /// processor that sleeps on that page.
    ///
    /// # Errors
    /// Returns the operating system's error if it has no descriptors or threads left.
    pub fn start(
        stream: UnixStream,
        harts: Vec<(Processor, LinuxDoorbell<PROCESSORS>)>,
        page: Option<MappedPage>,
    ) -> io::Result<Self> {
        let mut bridge = Self {
            stream,
            ending: Arc::default(),
            threads: Vec::new(),
        };
        if let Some((_, doorbell)) = harts.first() {
            let (stream, doorbell) = (bridge.stream.try_clone()?, doorbell.clone());
            bridge.spawn("from the machine", move |_| {
                from_machine(&stream, &doorbell, page.as_ref());
            })?;
        }
        for (number, doorbell) in harts {
            let stream = bridge.stream.try_clone()?;
            let name = format!("to processor {}", number.0);
            bridge.spawn(&name, move |ending| {
                to_hart(&stream, number, &doorbell, ending);
            })?;
        }
        Ok(bridge)
    }

    fn spawn(
        &mut self,
        name: &str,
        body: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> io::Result<()> {
        let ending = self.ending.clone();
        let thread = std::thread::Builder::new().name(name.into());
        self.threads.push(thread.spawn(move || body(&ending))?);
        Ok(())
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        self.ending.store(true, Ordering::Relaxed);
        // This ends reads and writes that are in progress.
        let _ = self.stream.shutdown(Shutdown::Both);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Rings the processors whose numbers come from the machine; ignores bytes that are no number.
fn from_machine(
    mut stream: &UnixStream,
    doorbell: &LinuxDoorbell<PROCESSORS>,
    page: Option<&MappedPage>,
) {
    let (mut bytes, futex) = ([0; 64], Futex::new());
    loop {
        match stream.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => {
                let rung = bytes.iter().take(count).fold(0_u64, |rung, &byte| {
                    rung | 1_u64.checked_shl(byte.into()).unwrap_or(0)
                });
                for number in (0..PROCESSORS as u8).filter(|&number| rung >> number & 1 != 0) {
                    if let Some(page) = page {
                        page.wake(number, &futex);
                    }
                    doorbell.ring(Processor(number));
                }
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(_) => return,
        }
    }
}

/// Tells the machine that a hart has been rung. Many rings may be one, as at every doorbell.
fn to_hart(
    mut stream: &UnixStream,
    number: Processor,
    doorbell: &LinuxDoorbell<PROCESSORS>,
    ending: &AtomicBool,
) {
    let mut told = None;
    while !ending.load(Ordering::Relaxed) {
        let rings = doorbell.prepare();
        if told == Some(rings) {
            let until = doorbell.now().after(LOOK);
            doorbell.wait(rings, until, None);
        } else if stream.write_all(&[number.0]).is_ok() {
            // A ring from before the first look is passed on, too.
            told = Some(rings);
        } else {
            return;
        }
    }
}
