//! The data of the kernel on processes in `/proc`.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;

use rustix::process::Pid;

/// When a process started, in ticks since the machine did: together with its number, that is one
/// process for ever.
pub(crate) fn started_at(process: u32) -> Option<u64> {
    field(process, 22)?.parse().ok()
}

/// Whether a process has ended, though its number is still its own: nobody has asked how it ended.
pub(super) fn has_ended(process: u32) -> bool {
    field(process, 3).is_none_or(|state| state == "Z" || state == "X")
}

/// Returns the process id of the parent of `process`: of the process that started it, or of the one that adopted it
/// when that process ended. Returns `None` if there is no such process.
#[must_use]
pub fn parent(process: u32) -> Option<u32> {
    field(process, 4)?.parse().ok()
}

/// The children of a process.
pub(super) fn children(of: u32) -> std::io::Result<Vec<Pid>> {
    all(|process| parent(process) == Some(of))
}

/// The processes of a group.
pub(super) fn group(of: u32) -> std::io::Result<Vec<Pid>> {
    all(|process| field(process, 5).is_some_and(|group| group.parse() == Ok(of)))
}

/// The processes that are as wanted.
fn all(is_wanted: impl Fn(u32) -> bool) -> std::io::Result<Vec<Pid>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc")? {
        let name = entry?.file_name();
        let number = name.to_str().and_then(|name| name.parse::<u32>().ok());
        if let Some(number) = number.filter(|&number| is_wanted(number)) {
            found.extend(Pid::from_raw(number.cast_signed()));
        }
    }
    Ok(found)
}

/// Whether a variable of the environment with which a process was started has this value.
pub(super) fn has_in_environment(process: Pid, value: &OsStr) -> bool {
    let path = format!("/proc/{}/environ", process.as_raw_nonzero());
    let variables = std::fs::read(path).unwrap_or_default();
    let mut variables = variables.split(|&byte| byte == 0);
    variables.any(|variable| {
        let mut parts = variable.splitn(2, |&byte| byte == b'=');
        parts.nth(1) == Some(value.as_bytes())
    })
}

/// The children of this thread, with those that this process has adopted if it is the first one; none where the
/// kernel does not list them.
pub(super) fn children_of_this_thread() -> Vec<Pid> {
    let children = std::fs::read_to_string("/proc/thread-self/children").unwrap_or_default();
    let numbers = children.split_whitespace().map(str::parse::<i32>);
    numbers.filter_map(|it| Pid::from_raw(it.ok()?)).collect()
}

/// A field of `/proc/PID/stat`, counted from 1 as its manual does; not one of the first two.
fn field(process: u32, number: usize) -> Option<String> {
    let status = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The second field is a name in parentheses, in which anything may be.
    let (_, rest) = status.rsplit_once(") ")?;
    rest.split(' ').nth(number.checked_sub(3)?).map(Into::into)
}
