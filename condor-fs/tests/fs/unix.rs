//! Names and errors are those of Linux: every operation is done in a tree by a client, and in one
//! like it by system calls.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::ffi::CStr;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::Path;

use crate::support::{Fs, disk, with_server};
use condor_fs::{Errno, FileError, OpenOptions};
use rustix::fs::{AtFlags, CWD, Mode, OFlags, RenameFlags};
use rustix::io::Errno as Linux;

const READ: OpenOptions = OpenOptions::new().read();
const WRITE: OpenOptions = OpenOptions::new().write();

/// What a call gives, without what it opened.
fn linux<T>(outcome: Result<T, Linux>) -> Result<(), u16> {
    outcome
        .map(drop)
        .map_err(|errno| errno.raw_os_error().try_into().unwrap())
}

fn ours<T>(outcome: Result<T, FileError>) -> Result<(), u16> {
    outcome.map(drop).map_err(|error| match error {
        FileError::Errno(errno) => errno.0,
        other => panic!("{other}"),
    })
}

/// A tree with a bit of everything.
fn plant(root: &Path) {
    std::fs::create_dir_all(root.join("d/e")).unwrap();
    std::fs::create_dir(root.join("empty")).unwrap();
    std::fs::write(root.join("f"), b"f").unwrap();
    std::fs::write(root.join("d/g"), b"g").unwrap();
    symlink("empty", root.join("to-directory")).unwrap();
    symlink("f", root.join("to-file")).unwrap();
    symlink("nothing", root.join("to-nothing")).unwrap();
}

/// Paths of all kinds; those that leave the tree are not among them.
fn paths() -> Vec<String> {
    let mut paths: Vec<String> = [
        ".",
        "./",
        "./.",
        "..x",
        "d",
        "empty",
        "d/e",
        "f",
        "d/g",
        "new",
        "d/new",
        "f/new",
        "new/new",
        "to-directory",
        "to-directory/new",
        "to-file",
        "to-nothing",
        "to-file/new",
        "d//e",
        "./d/./e",
        "d/../empty",
        "d/e/../../f",
        ".condor-fs-not",
        "d/.condor-fs",
    ]
    .map(String::from)
    .into();
    for behind in ["/", "/.", "/./", "//"] {
        for of in [
            "d",
            "empty",
            "f",
            "new",
            "new/new",
            "to-directory",
            "to-file",
            "to-nothing",
        ] {
            paths.push(format!("{of}{behind}"));
        }
    }
    for behind in ["/..", "/../"] {
        // Of a link to a directory, `..` is the directory above that.
        for of in ["d", "empty", "f", "new", "d/e", "to-directory", "to-file"] {
            paths.push(format!("{of}{behind}"));
        }
    }
    paths.push("n".repeat(256));
    paths.push(format!("new/{}", "n".repeat(256)));
    paths
}

/// An operation on a path: its name, what the client does, and what a program of the host does.
type Operation = (
    &'static str,
    fn(&Fs<'_, '_>, &str) -> Result<(), u16>,
    fn(&Path) -> Result<(), u16>,
);

fn opened(path: &Path, flags: OFlags) -> Result<(), u16> {
    // The last component is not followed, as clients are promised.
    let flags = flags | OFlags::NOFOLLOW;
    linux(rustix::fs::open(path, flags, Mode::RUSR | Mode::WUSR))
}

/// Opening a directory is an error of its own to clients.
fn opened_file(path: &Path, flags: OFlags) -> Result<(), u16> {
    let file = rustix::fs::open(path, flags | OFlags::NOFOLLOW, Mode::RUSR | Mode::WUSR);
    let file = file.and_then(|file| {
        let is_directory = rustix::fs::fstat(&file)?.st_mode & 0o170_000 == 0o040_000;
        if is_directory {
            Err(Linux::ISDIR)
        } else {
            Ok(())
        }
    });
    linux(file)
}

const OPERATIONS: &[Operation] = &[
    (
        "status",
        |fs, path| ours(fs.status(path)),
        |path| linux(rustix::fs::lstat(path)),
    ),
    (
        "read",
        |fs, path| ours(fs.open(path, READ)),
        |path| opened_file(path, OFlags::RDONLY),
    ),
    (
        "write",
        |fs, path| ours(fs.open(path, WRITE)),
        |path| opened(path, OFlags::WRONLY),
    ),
    (
        "append",
        |fs, path| ours(fs.open(path, OpenOptions::new().append())),
        |path| opened(path, OFlags::WRONLY | OFlags::APPEND),
    ),
    (
        "truncate",
        |fs, path| ours(fs.open(path, WRITE.truncate())),
        |path| opened(path, OFlags::WRONLY | OFlags::TRUNC),
    ),
    (
        "create",
        |fs, path| ours(fs.open(path, WRITE.create())),
        |path| opened(path, OFlags::WRONLY | OFlags::CREATE),
    ),
    (
        "exclusive",
        |fs, path| ours(fs.open(path, WRITE.exclusive())),
        |path| opened(path, OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL),
    ),
    (
        "directory",
        |fs, path| ours(fs.open_directory(path)),
        |path| opened(path, OFlags::RDONLY | OFlags::DIRECTORY),
    ),
    (
        "mkdir",
        |fs, path| ours(fs.make_directory(path)),
        |path| {
            linux(rustix::fs::mkdir(
                path,
                Mode::RWXU | Mode::RWXG | Mode::RWXO,
            ))
        },
    ),
    (
        "rmdir",
        |fs, path| ours(fs.remove_directory(path)),
        |path| linux(rustix::fs::unlinkat(CWD, path, AtFlags::REMOVEDIR)),
    ),
    (
        "unlink",
        |fs, path| ours(fs.unlink(path)),
        |path| linux(rustix::fs::unlink(path)),
    ),
];

/// All names, with what they stand for.
fn tree(root: &Path) -> Vec<(String, String)> {
    let mut tree = Vec::new();
    let mut left = vec![root.to_owned()];
    while let Some(directory) = left.pop() {
        for entry in std::fs::read_dir(directory).unwrap() {
            let (path, kind) = entry
                .map(|it| (it.path(), it.file_type().unwrap()))
                .unwrap();
            let name = path.strip_prefix(root).unwrap().display().to_string();
            if name == ".condor-fs" {
                continue;
            }
            tree.push((
                name,
                if kind.is_symlink() {
                    format!("to {}", std::fs::read_link(&path).unwrap().display())
                } else if kind.is_dir() {
                    left.push(path);
                    "directory".into()
                } else {
                    std::fs::read_to_string(&path).unwrap()
                },
            ));
        }
    }
    tree.sort();
    tree
}

/// The two trees side by side, each made anew after an operation that has changed it.
struct Twins<'f, 'm, 'v> {
    fs: &'f Fs<'m, 'v>,
    ours: &'f Path,
    theirs: &'f Path,
}

impl Twins<'_, '_, '_> {
    fn clear(root: &Path) {
        for entry in std::fs::read_dir(root).unwrap() {
            let path = entry.unwrap().path();
            if path == root.join(".condor-fs") {
                continue;
            }
            if path.symlink_metadata().unwrap().is_dir() {
                std::fs::remove_dir_all(path).unwrap();
            } else {
                std::fs::remove_file(path).unwrap();
            }
        }
    }

    fn compare(
        &self,
        what: &str,
        client: impl FnOnce(&Fs<'_, '_>) -> Result<(), u16>,
        host: impl FnOnce() -> Result<(), u16>,
    ) {
        let (found, expected) = (client(self.fs), host());
        assert_eq!(found.map_err(Errno), expected.map_err(Errno), "{what}");
        assert_eq!(tree(self.ours), tree(self.theirs), "{what}");
        if expected.is_ok() {
            for root in [self.ours, self.theirs] {
                Self::clear(root);
                plant(root);
            }
        }
    }
}

fn with_twins(program: impl FnOnce(&Twins<'_, '_, '_>)) {
    let disk = disk();
    let (ours, theirs) = (disk.path().join("ours"), disk.path().join("theirs"));
    for root in [&ours, &theirs] {
        std::fs::create_dir(root).unwrap();
        plant(root);
    }
    with_server(&ours, "", |fs, _, _, _| {
        program(&Twins {
            fs,
            ours: &ours,
            theirs: &theirs,
        });
    });
}

#[test]
fn every_path_gives_the_errors_of_linux() {
    with_twins(|twins| {
        for (name, client, host) in OPERATIONS {
            for path in paths() {
                twins.compare(
                    &format!("{name} {path:?}"),
                    |fs| client(fs, &path),
                    || host(&twins.theirs.join(&path)),
                );
            }
        }
    });
}

#[test]
fn renames_give_the_errors_of_linux() {
    with_twins(|twins| {
        // One of each kind.
        let paths = [
            ".",
            "d",
            "d/",
            "d/.",
            "d/..",
            "d/e",
            "empty",
            "f",
            "f/",
            "d/g",
            "new",
            "new/",
            "new/.",
            "new/new",
            "f/new",
            "to-directory",
            "to-directory/",
            "to-nothing",
        ];
        for from in paths {
            for to in paths {
                for flags in [RenameFlags::empty(), RenameFlags::NOREPLACE] {
                    twins.compare(
                        &format!("rename {from:?} {to:?} {flags:?}"),
                        |fs| {
                            ours(if flags.is_empty() {
                                fs.rename(from, to)
                            } else {
                                fs.rename_new(from, to)
                            })
                        },
                        || {
                            let at = |path| twins.theirs.join(path);
                            linux(rustix::fs::renameat_with(CWD, at(from), CWD, at(to), flags))
                        },
                    );
                }
            }
        }
    });
}

#[test]
fn the_tree_itself_has_a_status() {
    let disk = disk();
    plant(disk.path());
    with_server(disk.path(), "", |fs, _, _, _| {
        for (path, is) in [(".", ""), ("d/..", ""), ("d/.", "d"), ("d/e/..", "d")] {
            let expected = std::fs::metadata(disk.path().join(is)).unwrap();
            let found = fs.status(path).unwrap();
            assert_eq!(
                (found.mode, found.size),
                (expected.mode(), expected.len()),
                "{path}"
            );
        }
        for path in ["..", "d/../..", "../x", "/", "/d"] {
            assert_eq!(ours(fs.status(path)), Err(Errno::XDEV.0), "{path}");
        }
    });
}

#[test]
fn only_the_name_of_the_servers_own_directory_is_hidden() {
    let disk = disk();
    let at = |path: &str| disk.path().join(path);
    std::fs::create_dir(at("d")).unwrap();
    with_server(disk.path(), "", |fs, _, _, _| {
        fs.make_directory("d/.condor-fs").unwrap();
        fs.open("d/.condor-fs/file", WRITE.exclusive())
            .unwrap()
            .close()
            .unwrap();
        let mut name = [0; 255];
        let mut directory = fs.open_directory("d").unwrap();
        let entry = directory.next(&mut name).unwrap().unwrap();
        assert_eq!(entry.name, b".condor-fs");
        directory.close().unwrap();
        for path in [
            ".condor-fs",
            "./.condor-fs",
            ".condor-fs/.",
            "d/../.condor-fs",
            ".condor-fs/..",
        ] {
            assert_eq!(ours(fs.status(path)), Err(Errno::NOENT.0), "{path}");
            assert_eq!(ours(fs.open_directory(path)), Err(Errno::NOENT.0), "{path}");
        }
    });
}

/// A default access list: rwx for the owner and for user 12345, r-x for the group, mask rwx.
const DEFAULT_ACCESS: [u8; 44] = {
    let mut list = [0; 44];
    list[0] = 2; // version
    // Tag, permissions and id of each entry.
    let entries: [(u8, u8, u32); 5] = [
        (0x01, 7, u32::MAX),
        (0x02, 7, 12345),
        (0x04, 5, u32::MAX),
        (0x10, 7, u32::MAX),
        (0x20, 0, u32::MAX),
    ];
    let mut n = 0;
    while n < entries.len() {
        let (tag, permissions, id) = entries[n];
        let id = id.to_le_bytes();
        let at = 4 + 8 * n;
        list[at] = tag;
        list[at + 2] = permissions;
        let mut byte = 0;
        while byte < 4 {
            list[at + 4 + byte] = id[byte];
            byte += 1;
        }
        n += 1;
    }
    list
};

const DEFAULT: &CStr = c"system.posix_acl_default";
const ACCESS: &CStr = c"system.posix_acl_access";

/// Mode, group and access lists of a file or directory.
fn nature(path: &Path) -> (u32, u32, Vec<Option<Vec<u8>>>) {
    let metadata = std::fs::metadata(path).unwrap();
    let lists = [ACCESS, DEFAULT].map(|name| {
        let mut list = [0; 256];
        match rustix::fs::getxattr(path, name, &mut list[..]) {
            Ok(len) => Some(list[..len].to_vec()),
            Err(Linux::NODATA | Linux::NOTSUP) => None,
            Err(errno) => panic!("{errno}"),
        }
    });
    (metadata.mode(), metadata.gid(), lists.into())
}

#[test]
fn what_is_made_has_the_group_and_the_access_list_of_its_directory() {
    let disk = disk();
    let at = |path: &str| disk.path().join(path);
    let group = std::fs::metadata(disk.path()).unwrap().gid() + 1;
    for (name, mode) in [
        ("plain", 0o755),
        ("group", 0o2755),
        ("list", 0o755),
        ("both", 0o2755),
    ] {
        std::fs::create_dir(at(name)).unwrap();
        // Where this program may give files away.
        let _ = std::os::unix::fs::chown(at(name), None, Some(group));
        std::fs::set_permissions(at(name), PermissionsExt::from_mode(mode)).unwrap();
        if matches!(name, "list" | "both") {
            let flags = rustix::fs::XattrFlags::empty();
            match rustix::fs::setxattr(at(name), DEFAULT, &DEFAULT_ACCESS, flags) {
                Ok(()) | Err(Linux::NOTSUP) => {}
                Err(errno) => panic!("{errno}"),
            }
        }
    }
    with_server(disk.path(), "", |fs, _, _, _| {
        for name in ["plain", "group", "list", "both"] {
            for (ours, theirs, options) in [
                ("ours", "theirs", WRITE.exclusive()),
                ("our 2", "their 2", WRITE.create()),
            ] {
                let (ours, theirs) = (format!("{name}/{ours}"), format!("{name}/{theirs}"));
                fs.open(&ours, options).unwrap().close().unwrap();
                std::fs::File::create_new(at(&theirs)).unwrap();
                assert_eq!(nature(&at(&ours)), nature(&at(&theirs)), "{ours}");
            }
            let (ours, theirs) = (format!("{name}/our d"), format!("{name}/their d"));
            fs.make_directory(&ours).unwrap();
            std::fs::create_dir(at(&theirs)).unwrap();
            assert_eq!(nature(&at(&ours)), nature(&at(&theirs)), "{ours}");
        }
    });
}

#[test]
fn a_rename_that_fails_leaves_nothing() {
    let disk = disk();
    let at = |path: &str| disk.path().join(path);
    plant(disk.path());
    with_server(disk.path(), "", |fs, _, _, _| {
        let file = fs.open("f", READ.write()).unwrap();
        let before = tree(disk.path());
        for (from, errno) in [
            ("d", Errno::NOTDIR),
            ("new", Errno::NOENT),
            ("d/g/", Errno::NOTDIR),
        ] {
            assert_eq!(ours(fs.rename(from, "f")), Err(errno.0), "{from}");
            assert_eq!(tree(disk.path()), before, "{from}");
            assert_eq!(std::fs::metadata(at("f")).unwrap().nlink(), 1, "{from}");
            assert_eq!(file.status().unwrap().links, 1, "{from}");
        }
        // Nor does one that succeeds give what it replaces a name more.
        fs.rename("d/g", "f").unwrap();
        assert_eq!(file.status().unwrap().links, 0);
        assert!(!at("d/g").exists());
        file.close().unwrap();
        assert_eq!(std::fs::metadata(at("f")).unwrap().nlink(), 1);
    });
    let own = std::fs::read_dir(at(".condor-fs")).unwrap();
    let names: Vec<_> = own.map(|entry| entry.unwrap().file_name()).collect();
    assert!(
        names.iter().all(|name| name == "lock" || name == "journal"),
        "{names:?}"
    );
}

#[test]
fn names_of_an_open_file_are_counted_as_linux_does() {
    let disk = disk();
    let at = |path: &str| disk.path().join(path);
    std::fs::write(at("a"), b"a").unwrap();
    std::fs::hard_link(at("a"), at("b")).unwrap();
    with_server(disk.path(), "", |fs, _, _, _| {
        let file = fs.open("a", READ).unwrap();
        for (name, links) in [("a", 2), ("b", 1)] {
            assert_eq!(file.status().unwrap().links, links);
            fs.unlink(name).unwrap();
        }
        assert_eq!(file.status().unwrap().links, 0);
        file.close().unwrap();
    });
}

#[test]
fn a_directory_with_a_slash_is_renamed_with_what_is_open_in_it() {
    for (from, to) in [("d/", "e"), ("d", "e/"), ("d//", "e//")] {
        let disk = disk();
        std::fs::create_dir(disk.path().join("d")).unwrap();
        std::fs::write(disk.path().join("d/f"), b"still").unwrap();
        let system = crate::support::system();
        let supervisor = crate::support::Supervisor::start(&system, disk.path(), None, "");
        crate::support::with_client(&system, crate::support::CLIENT, |fs, _, _, _| {
            let mut file = fs.open("d/f", READ).unwrap();
            fs.rename(from, to).unwrap();
            supervisor.die();
            let mut read = [0; 8];
            assert_eq!(file.read(&mut read), Ok(5), "{from} {to}");
        });
    }
}
