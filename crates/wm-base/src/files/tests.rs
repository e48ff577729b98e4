use super::*;

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_file_is_replaced_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for text in ["first", "second"] {
        write_atomically(&path, |out| Ok(out.write_all(text.as_bytes())?)).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }
    write_durably(&path, |out| Ok(out.write_all(b"third")?)).unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "third");
    assert_eq!(names(folder.path()), ["a.ply"]);
}

#[test]
fn an_error_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    fs::write(&path, "old").unwrap();
    let error = write_atomically(&path, |out| {
        out.write_all(&[0; 1_000_000])?;
        Err(io::Error::from(ErrorKind::StorageFull).into())
    });
    let expected = format!(
        "{}: cannot be written: the disk is full; free some space or write elsewhere",
        path.display()
    );
    assert_eq!(error.unwrap_err().to_string(), expected);
    assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    assert_eq!(names(folder.path()), ["a.ply"]);
}

#[cfg(unix)]
#[test]
fn leftovers_of_killed_processes_are_removed_and_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let long_ago = std::time::SystemTime::now() - Duration::from_secs(3600);
    let made = |name: &str| {
        let file = File::create(at(name)).unwrap();
        file.set_modified(long_ago).unwrap();
        file
    };
    let (dead, held, other) = (made("a.ply.123-4.part"), made("b.ply.99-0.part"), made("c.1-x.part"));
    held.try_lock().unwrap();
    drop((dead, other));
    File::create(at("young.1-1.part")).unwrap();
    fs::create_dir(at("site.123-5.parts")).unwrap();
    fs::write(at("site.123-5.parts/a"), "a").unwrap();
    File::open(at("site.123-5.parts")).unwrap().set_modified(long_ago).unwrap();
    write_atomically(&at("a.ply"), |out| Ok(out.write_all(b"a")?)).unwrap();
    let mut left = names(folder.path());
    left.sort();
    assert_eq!(left, ["a.ply", "b.ply.99-0.part", "c.1-x.part", "young.1-1.part"]);
}

#[cfg(unix)]
#[test]
fn a_folder_is_locked_once() {
    let folder = tempfile::tempdir().unwrap();
    let lock = lock_folder(folder.path()).unwrap();
    assert_eq!(lock_folder(folder.path()).unwrap_err().kind(), ErrorKind::WouldBlock);
    drop(lock);
    assert!(lock_folder(folder.path()).unwrap().is_some());
}

#[cfg(unix)]
#[test]
fn a_replaced_file_keeps_its_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("secret.ply");
    fs::write(&path, "old").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    write_atomically(&path, |out| Ok(out.write_all(b"new")?)).unwrap();
    let mode = fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!((fs::read_to_string(&path).unwrap().as_str(), mode & 0o777), ("new", 0o600));
}

#[test]
fn names_as_long_as_systems_allow() {
    let folder = tempfile::tempdir().unwrap();
    for length in [200, 247, 255] {
        let name = format!("{}.ply", "\u{e9}".repeat((length - 4) / 2) + &"x".repeat((length - 4) % 2));
        assert_eq!(name.len(), length);
        let path = folder.path().join(name);
        write_atomically(&path, |out| Ok(out.write_all(b"a")?)).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"a");
    }
    assert!(is_temporary_name(&temporary_name(OsStr::new("a.ply"), "part")));
    assert!(is_temporary_name(&temporary_name(OsStr::new(&"\u{e9}".repeat(120)), "parts")));
    for name in ["a.part", "a.1.part", "a.1-.part", "a.1-2.partial", "a.1-2", "part", "1-2.part.x"] {
        assert!(!is_temporary_name(OsStr::new(name)), "{name}");
    }
}

#[test]
fn a_panic_removes_the_temporary_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let result = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("in the middle")));
    assert!(result.is_err());
    assert_eq!(names(folder.path()), [] as [&str; 0]);
}

#[test]
fn temporary_folders_go_with_what_is_in_them() {
    let folder = tempfile::tempdir().unwrap();
    let made = TempFolder::beside(&folder.path().join("site")).unwrap();
    fs::create_dir(made.path().join("place")).unwrap();
    fs::write(made.path().join("place/a"), "a").unwrap();
    assert_ne!(TempFolder::beside(&folder.path().join("site")).unwrap().path(), made.path());
    assert_eq!(names(folder.path()).len(), 1);
    drop(made);
    assert_eq!(names(folder.path()), [] as [&str; 0]);
    let fault = TempFolder::beside(&folder.path().join("no/site")).unwrap_err().to_string();
    assert!(fault.contains("does not exist; create it first"), "{fault}");
}

#[test]
fn outputs_that_cannot_be_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let say = |path: &Path| {
        let error = write_atomically(path, |_| Ok(())).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error.replace(&folder.path().display().to_string(), "DIR")
    };
    assert_eq!(
        say(&folder.path().join("no/a.ply")),
        "DIR/no/a.ply: cannot be written: the folder \"DIR/no\" does not exist; create it first"
    );
    assert_eq!(say(folder.path()), "DIR: cannot be written: it is a folder; name a file in it");
    let path = folder.path().join("protected.ply");
    fs::write(&path, "mine").unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).unwrap();
    assert_eq!(
        say(&path),
        "DIR/protected.ply: cannot be written: it is write-protected; choose another name"
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
    let below_a_file = say(&path.join("a.ply"));
    assert!(below_a_file.starts_with("DIR/protected.ply/a.ply: cannot be written: "), "{below_a_file}");
}

#[test]
fn refusals_of_the_system_are_told_apart() {
    let say = |kind: ErrorKind| WriteFault::from(io::Error::from(kind));
    assert!(matches!(say(ErrorKind::StorageFull), WriteFault::DiskFull));
    assert!(matches!(say(ErrorKind::ReadOnlyFilesystem), WriteFault::Denied(_)));
    assert!(matches!(say(ErrorKind::IsADirectory), WriteFault::IsFolder));
    assert!(matches!(say(ErrorKind::BrokenPipe), WriteFault::Other(_)));
}

#[cfg(unix)]
#[test]
fn a_folder_that_refuses_is_reported() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o555)).unwrap();
    if File::create(folder.path().join("probe")).is_ok() {
        eprintln!("skipped: this user may write to read-only folders");
        return;
    }
    let path = folder.path().join("a.ply");
    let error = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
    assert!(error.starts_with(&format!("{}: cannot be written: ", path.display())), "{error}");
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_devices_spared() {
    let folder = tempfile::tempdir().unwrap();
    let (real, link) = (folder.path().join("real.ply"), folder.path().join("link.ply"));
    fs::write(&real, "old").unwrap();
    std::os::unix::fs::symlink(&real, &link).unwrap();
    write_atomically(&link, |out| Ok(out.write_all(b"new")?)).unwrap();
    assert_eq!(fs::read_to_string(&real).unwrap(), "new");
    assert!(link.is_symlink());
    let error = write_atomically(Path::new("/dev/null"), |_| Ok(())).unwrap_err().to_string();
    assert_eq!(error, "/dev/null: cannot be written: it is not a regular file; choose another name");
}
