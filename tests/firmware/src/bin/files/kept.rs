//! The calls that this program does not make, which the search for paths that panic must see all the same.

use core::fmt::{Display as _, Write as _};
use core::future::Future as _;
use core::hint::black_box;

use condor_dev::stdio::{BufReader, BufWriter, LineError, WriteError};
use condor_fs::{
    Buffer, BufferError, Directory, Errno, File, FileError, FileStatus, FileTicket, OpenOptions,
    OperationResult, Space, Times,
};
use condor_mbox::CriticalSection;
use condor_tty::{
    Console, ConsoleError, Poster, TerminalError, TerminalReader, TerminalReaderError,
};
use embedded_io::{BufRead, Read, ReadReady, Seek, Write, WriteReady};
use firmware::keep;

use crate::ends::FILES;
use crate::files::System;
use crate::{Mail, Tty, Window};

type Opened = File<'static, 'static, Mail, Window, FILES>;
type Reader = BufReader<Opened, 16>;
type Writer = BufWriter<Reader, 16>;
type Ticket<T> = FileTicket<'static, 'static, 'static, Mail, Window, FILES, T>;
type Screen = Console<'static, Window, CriticalSection, Mail, 16>;
type Post = Poster<'static, Window, CriticalSection, Mail, 16>;

pub(crate) fn kept() {
    black_box(named as *const ());
    keep! {
        System: connect, set_timeout, wait_for_turn, settle, in_doubt, take_buffer, space, ticket;
        Ticket<usize>: wait, poll;
        Ticket<()>: wait;
        Ticket<Opened>: wait;
        Ticket<FileStatus>: wait;
        Ticket<Space>: wait;
        Ticket<OperationResult<'_, '_, Mail, Window, FILES>>: wait;
        Buffer<Window>: new;
        Opened: read_at, write_at, read_buffer, read_buffer_at, write_buffer, write_buffer_at,
            position, status, set_mode, set_times, truncate, sync, next_data, next_hole, allocate,
            begin_read, begin_write, begin_close;
        Directory<'_, '_, Mail, Window, FILES>: next, rewind, sync, status, close;
        Writer: drain;
        Tty: new, receive, accept, configure, settings, set_policy, policy, take_interrupt,
            attached, unread, written, lost, ignored, overlong;
        Screen: fill_buf, consume, read_ready, write_ready, write_str;
        Post: post, write_str;
        TerminalReader<Window>: attach, fetch, acknowledge, detach, status;
    }
    reads::<Opened>();
    reads::<Reader>();
    reads::<Screen>();
    writes::<Opened>();
    writes::<Writer>();
    writes::<Screen>();
    writes::<Post>();
    seeks::<Opened>();
    errors();
}

fn reads<T: Read>() {
    keep! { T: read, read_exact; }
}

fn writes<T: Write>() {
    keep! { T: write, flush, write_all, write_fmt; }
}

fn seeks<T: Seek>() {
    keep! { T: seek, rewind, stream_position, seek_relative; }
}

fn errors() {
    keep! {
        Errno: fmt;
        FileError: fmt;
        BufferError<Window>: fmt;
        LineError<FileError>: fmt;
        WriteError<FileError>: fmt;
        TerminalError: fmt;
        TerminalReaderError: fmt;
        ConsoleError: fmt;
    }
}

/// Makes each call with a name.
fn named(system: &System, path: &[u8], times: Times) -> Result<(), FileError> {
    let opened = system.open(path, OpenOptions::new().read().mode(0o600))?;
    opened.close()?;
    system.status(path)?;
    system.set_mode(path, 0o600)?;
    system.set_times(path, times)?;
    system.make_directory(path)?;
    system.make_directory_with(path, 0o700)?;
    system.remove_directory(path)?;
    system.unlink(path)?;
    system.rename(path, path)?;
    system.rename_new(path, path)?;
    system.exchange(path, path)?;
    system.open_directory(path)?.close()
}
