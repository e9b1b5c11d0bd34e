//! What the fuzz targets share with the property tests of the crates: scenarios out of bytes.

#[path = "../../system/debug/tests/debug/hostile.rs"]
mod debug_words;
#[path = "../../condor-dev/tests/dev/scenario/mod.rs"]
mod devices;
#[path = "../../condor-fs/tests/fs/hostile/mod.rs"]
mod files;
#[path = "../../condor-hand/tests/hand/hostile/mod.rs"]
mod hands;
#[path = "../../system/cli/src/listening.rs"]
mod listening;
#[allow(dead_code)]
#[path = "../../condor-fs/tests/fs/peer/mod.rs"]
mod peer;
#[allow(dead_code)]
#[path = "../../system/cli/src/live"]
mod live {
    pub(crate) mod calls;
    pub(crate) mod connection;
    pub(crate) mod hostile;
    pub(crate) mod page;
    pub(crate) mod protocol;
    pub(crate) mod session;
}
#[path = "../../system/debug/tests/debug/packets.rs"]
mod packets;
mod progress;
#[path = "../../system/mcap/tests/mcap/recordings.rs"]
mod recordings;
#[allow(dead_code)]
#[path = "../../system/remote/src/wire.rs"]
mod remote_wire;
#[path = "../../condor-mbox/tests/mbox/scenario/mod.rs"]
mod scenario;
#[path = "../../condor-tty/tests/tty/terminals/host.rs"]
mod terminal_host;
#[path = "../../condor-tty/tests/tty/terminals/mod.rs"]
mod terminals;
#[path = "../../system/vars/tests/vars/haunted.rs"]
mod variables;

/// Two honest processors keep every promise while a third writes whatever it can, also behind caches
/// that nothing keeps coherent.
///
/// # Panics
/// If a promise of the mailbox was broken.
pub fn hostile_mailbox(bytes: &[u8]) {
    progress::report("hostile_mailbox", scenario::run(bytes));
    scenario::run_behind_caches(bytes);
}

/// Regions, published values and locks bear any words in their memory.
///
/// # Panics
/// If one of them broke a promise.
pub fn regions(bytes: &[u8]) {
    progress::report("regions", scenario::regions::run(bytes));
}

/// A gateway bears any query: key, payload and attachment, with a zero between them. What it takes for a request is within
/// its bounds, and is read as the same again.
///
/// # Panics
/// If it is not.
pub fn remote_request(bytes: &[u8]) {
    use remote_wire::{ClientRequest, MOTION_BYTES, by, check_name};
    let mut parts = bytes.splitn(3, |byte| *byte == 0);
    let mut part = || parts.next().unwrap_or_default();
    let (key, payload, attachment) = (String::from_utf8_lossy(part()), part(), part());
    let Ok(asked) = ClientRequest::read("hand", &key, payload, attachment) else {
        return;
    };
    check_name("client", &asked.client).unwrap();
    assert!(asked.motion.len() <= MOTION_BYTES);
    let key = by("hand", &asked.client, asked.request.right().word());
    let again = ClientRequest::read("hand", &key, &asked.request.payload(), &asked.motion);
    assert_eq!(again, Ok(asked));
}

/// Drivers bear boards whose registers say anything, a bus that fails anywhere, and any interrupts.
///
/// # Panics
/// If one of them broke a promise.
pub fn drivers(bytes: &[u8]) {
    devices::run(bytes);
}

/// The gateway of a debugger bears any bytes, and leaves the program running and without breakpoints.
///
/// # Panics
/// If it does not.
pub fn debug_gateway(bytes: &[u8]) {
    packets::run(bytes);
}

/// The debugger's stub bears any words in its area, which change while it works.
///
/// # Panics
/// If it does not.
pub fn debug_stub(bytes: &[u8]) {
    debug_words::run(bytes);
}

/// Texts and images of hands, some of them good ones with faults, give hands that can be, or errors.
///
/// # Panics
/// If one of them gave something else.
pub fn hand_config(bytes: &[u8]) {
    hands::configuration::run(bytes);
}

/// A finger's controller bears any user and any sensors.
///
/// # Panics
/// If a command left what actuators have, or a fault was forgotten.
pub fn hand_control(bytes: &[u8]) {
    hands::control::run(bytes);
}

/// A reader of MCAP files reads any bytes or refuses them, and what it has read can be written and
/// read again.
///
/// # Panics
/// If it is something else then.
pub fn mcap_reader(bytes: &[u8]) {
    recordings::run(bytes);
}

/// A line editor bears any bytes, and any words that it is offered, and shows the line that it has.
///
/// # Panics
/// If it broke a promise.
pub fn tty_editor(bytes: &[u8]) {
    terminals::typing::run(bytes);
}

/// A terminal bears a host that writes anything anywhere at any moment.
///
/// # Panics
/// If it broke a promise.
pub fn tty_processor(bytes: &[u8]) {
    terminals::processor::run(bytes);
}

/// The host's end of a terminal bears a processor that writes and replies anything at any moment.
///
/// # Panics
/// If it broke a promise.
pub fn tty_host(bytes: &[u8]) {
    match bytes.split_first() {
        Some((0..128, rest)) => terminals::reader::run(rest),
        Some((_, rest)) => terminal_host::run(rest),
        None => {}
    }
}

/// A session of the live server keeps its promises to a client, whatever the client asks and however
/// slowly it reads.
///
/// # Panics
/// If a sample was neither sent in its order nor counted as lost, or if something grew without bound.
pub fn live_session(bytes: &[u8]) {
    live::hostile::session(bytes);
}

/// The live server bears any bytes of a client, before and after the handshake.
///
/// # Panics
/// If it goes on with a client that does not finish its handshake.
pub fn live_connection(bytes: &[u8]) {
    live::hostile::connection(bytes);
}

/// Both ends of a loop's variables bear any words in the table, and any requests.
///
/// # Panics
/// If one of them broke a promise.
pub fn vars(bytes: &[u8]) {
    variables::run(bytes);
}

/// A file server bears any client, which goes on writing while it works.
///
/// # Panics
/// If something outside of the tree or of the client's window was read or written.
pub fn fs_client(bytes: &[u8]) {
    files::client::run(bytes);
}

/// A client of the file service bears any host.
///
/// # Panics
/// If a call did not end, gave more than it was asked for, or wrote outside of its area.
pub fn fs_host(bytes: &[u8]) {
    files::host::run(bytes);
}

/// No offset and length that pass the check reach outside of a window, and all others are refused.
///
/// # Panics
/// If the check is wrong.
pub fn window_bounds(bytes: &[u8]) {
    let mut words = bytes.chunks(4).map(|chunk| {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        u32::from_le_bytes(word)
    });
    let mut word = || words.next().unwrap_or_default();
    let (size, offset, len) = (word(), word(), u64::from(word()) | u64::from(word()) << 32);
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    let end = u128::from(offset) + len as u128;
    let inside = offset % 4 == 0 && end <= u128::from(size);
    assert_eq!(
        condor_mbox::window::check_access(size, offset, len).is_ok(),
        inside
    );
}
