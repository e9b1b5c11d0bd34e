//! [`Errno`]: the error numbers of Linux, with their names.

use core::fmt;

/// An error number of Linux, as a Unix program would get it from the same operation. The numbers
/// are those that Linux has on most kinds of processors.
///
/// ```
/// use condor_fs::Errno;
///
/// assert_eq!(Errno::NOENT.name(), Some("ENOENT"));
/// assert_eq!(Errno(2).meaning(), "No such file or directory");
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Errno(pub u16);

macro_rules! errnos {
    ($($name:ident $number:literal $means:literal)*) => {
        impl Errno {
            $(#[doc = concat!($means, ".")] pub const $name: Self = Self($number);)*

            /// Returns the name, such as "ENOENT"; `None` if this crate does not know the number.
            #[must_use]
            pub const fn name(self) -> Option<&'static str> {
                match self.0 {
                    $($number => Some(concat!("E", stringify!($name))),)*
                    _ => None,
                }
            }

            /// Returns a short description for people, in English; empty if this crate does not
            /// know the number.
            #[must_use]
            pub const fn meaning(self) -> &'static str {
                match self.0 {
                    $($number => $means,)*
                    _ => "",
                }
            }
        }
    };
}

errnos! {
    PERM 1 "Operation not permitted"
    NOENT 2 "No such file or directory"
    INTR 4 "Interrupted"
    IO 5 "Input/output error"
    NXIO 6 "There is no data or no hole from this position on"
    BADF 9 "The file is not open, or not open for this operation"
    AGAIN 11 "Try again"
    NOMEM 12 "Out of memory"
    ACCES 13 "Permission denied"
    FAULT 14 "Bad address"
    BUSY 16 "Busy"
    EXIST 17 "File exists"
    XDEV 18 "The path is outside of the served tree, or on another filesystem"
    NODEV 19 "No such device"
    NOTDIR 20 "Not a directory"
    ISDIR 21 "Is a directory"
    INVAL 22 "Invalid argument"
    NFILE 23 "Too many open files on the host"
    MFILE 24 "Too many open files"
    TXTBSY 26 "The program is running"
    FBIG 27 "File too large"
    NOSPC 28 "No space left"
    ROFS 30 "Read-only"
    MLINK 31 "Too many links"
    NAMETOOLONG 36 "Name too long"
    NOSYS 38 "Not implemented"
    NOTEMPTY 39 "Directory not empty"
    LOOP 40 "The path has a forbidden symbolic link, or too many of them"
    OVERFLOW 75 "Number too large for its type"
    OPNOTSUPP 95 "The file server or its filesystem does not support this"
    STALE 116 "The file was replaced or removed after it was opened"
    DQUOT 122 "Quota exceeded"
    CANCELED 125 "The request was given up: the server died while it ran"
}

impl fmt::Display for Errno {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => write!(f, "{} ({name})", self.meaning()),
            None => write!(f, "error {}", self.0),
        }
    }
}

impl fmt::Debug for Errno {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => f.write_str(name),
            None => write!(f, "Errno({})", self.0),
        }
    }
}

impl core::error::Error for Errno {}

impl embedded_io::Error for Errno {
    fn kind(&self) -> embedded_io::ErrorKind {
        use embedded_io::ErrorKind;
        match *self {
            Self::NOENT => ErrorKind::NotFound,
            Self::PERM | Self::ACCES | Self::ROFS => ErrorKind::PermissionDenied,
            Self::EXIST => ErrorKind::AlreadyExists,
            Self::INVAL | Self::NAMETOOLONG | Self::BADF => ErrorKind::InvalidInput,
            Self::NOMEM | Self::MFILE | Self::NFILE => ErrorKind::OutOfMemory,
            Self::INTR => ErrorKind::Interrupted,
            _ => ErrorKind::Other,
        }
    }
}

#[cfg(all(test, feature = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_linux() {
        use rustix::io::Errno as Linux;
        for (ours, linux) in [
            (Errno::NOENT, Linux::NOENT),
            (Errno::NXIO, Linux::NXIO),
            (Errno::FAULT, Linux::FAULT),
            (Errno::XDEV, Linux::XDEV),
            (Errno::NOTEMPTY, Linux::NOTEMPTY),
            (Errno::NAMETOOLONG, Linux::NAMETOOLONG),
            (Errno::LOOP, Linux::LOOP),
            (Errno::OPNOTSUPP, Linux::OPNOTSUPP),
            (Errno::STALE, Linux::STALE),
            (Errno::DQUOT, Linux::DQUOT),
            (Errno::CANCELED, Linux::CANCELED),
            (Errno::EXIST, Linux::EXIST),
        ] {
            assert_eq!(i32::from(ours.0), linux.raw_os_error(), "{ours}");
        }
        assert_eq!(
            std::format!("{}", Errno::NOENT),
            "No such file or directory (ENOENT)"
        );
        assert_eq!(
            std::format!("{:?} {}", Errno::STALE, Errno(999)),
            "ESTALE error 999"
        );
    }
}
