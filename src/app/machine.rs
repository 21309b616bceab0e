//! How much memory the process may use: the machine's, or less where a control group limits it.
//!
//! A limit may stand on the process's own group (a systemd unit, a container) or on any group above it (a slice, a pod),
//! and the smallest of them counts. `/proc/self/cgroup` names the group
//! (<https://www.kernel.org/doc/html/latest/admin-guide/cgroup-v2.html>, "Processes"; cgroups(7) for version 1).

use std::fs;
use std::path::{Component, Path, PathBuf};

/// Where a hierarchy of control groups may be mounted, and the files with a group's limits.
struct Hierarchy {
    mounts: &'static [&'static str],
    limits: &'static [&'static str],
}

/// Version 2; beside version 1 it is mounted one level lower.
const UNIFIED: Hierarchy =
    Hierarchy { mounts: &["sys/fs/cgroup", "sys/fs/cgroup/unified"], limits: &["memory.max", "memory.high"] };
/// Version 1, its hierarchy for memory.
const MEMORY: Hierarchy = Hierarchy { mounts: &["sys/fs/cgroup/memory"], limits: &["memory.limit_in_bytes"] };

/// Bytes of memory that the process may use.
pub(super) fn memory() -> u64 {
    let machine = rustix::system::sysinfo();
    let machine = (machine.totalram as u64).saturating_mul(u64::from(machine.mem_unit));
    memory_below(Path::new("/"), machine)
}

/// The same on a file system with this root, for a machine of `machine` bytes.
fn memory_below(root: &Path, machine: u64) -> u64 {
    let groups = fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    groups
        .lines()
        .filter_map(membership)
        // Where the file cannot be read, the mount's root may still have a limit, as in a container.
        .chain([(&UNIFIED, Path::new("/")), (&MEMORY, Path::new("/"))])
        .flat_map(|(hierarchy, group)| limits_on(root, hierarchy, group))
        .fold(machine, u64::min)
}

/// The hierarchy that limits memory and the group in it, of a line `number:controllers:path`.
fn membership(line: &str) -> Option<(&'static Hierarchy, &Path)> {
    let mut parts = line.splitn(3, ':');
    let (number, controllers, path) = (parts.next()?, parts.next()?, parts.next()?);
    let is_memory = controllers.split(',').any(|controller| controller == "memory");
    match (number, controllers) {
        ("0", "") => Some((&UNIFIED, Path::new(path))),
        _ if is_memory => Some((&MEMORY, Path::new(path))),
        _ => None,
    }
}

/// The limits of a group and of those above it. `max`, which is not a number, is none.
fn limits_on(root: &Path, hierarchy: &'static Hierarchy, group: &Path) -> Vec<u64> {
    // `..` leads to a group outside of the process's namespace, which is not mounted.
    let group: PathBuf =
        group.components().filter(|component| matches!(component, Component::Normal(_))).collect();
    let files = hierarchy.mounts.iter().flat_map(|mount| {
        let mount = root.join(mount);
        group.ancestors().map(|group| mount.join(group)).collect::<Vec<_>>()
    });
    files
        .flat_map(|folder| hierarchy.limits.iter().map(move |name| folder.join(name)))
        .filter_map(|file| fs::read_to_string(file).ok()?.trim().parse().ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINE: u64 = 64 << 30;

    /// The memory with these files below the root.
    fn with(files: &[(&str, &str)]) -> u64 {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        memory_below(root.path(), MACHINE)
    }

    #[test]
    fn a_machine_has_some_memory() {
        assert!((1 << 26..1 << 48).contains(&memory()));
    }

    #[test]
    fn a_unit_of_systemd_has_its_own_limit() {
        let unit = "sys/fs/cgroup/system.slice/chladni.service/memory.max";
        let group = ("proc/self/cgroup", "0::/system.slice/chladni.service\n");
        assert_eq!(with(&[group, (unit, "8589934592\n")]), 8 << 30);
        assert_eq!(with(&[group, (unit, "max\n")]), MACHINE);
        let throttled = "sys/fs/cgroup/system.slice/chladni.service/memory.high";
        assert_eq!(with(&[group, (unit, "8589934592\n"), (throttled, "4294967296\n")]), 4 << 30);
    }

    #[test]
    fn the_smallest_limit_of_the_groups_above_counts() {
        let group = ("proc/self/cgroup", "0::/kubepods.slice/pod1.slice/box.scope\n");
        let limits = [
            ("sys/fs/cgroup/kubepods.slice/memory.max", "34359738368"),
            ("sys/fs/cgroup/kubepods.slice/pod1.slice/memory.max", "2147483648"),
            ("sys/fs/cgroup/kubepods.slice/pod1.slice/box.scope/memory.max", "max"),
            ("sys/fs/cgroup/other.slice/memory.max", "1024"),
        ];
        assert_eq!(with(&[&[group][..], &limits].concat()), 2 << 30);
    }

    #[test]
    fn a_container_has_its_limit_at_the_root_of_the_mount() {
        let limit = ("sys/fs/cgroup/memory.max", "1073741824\n");
        assert_eq!(with(&[("proc/self/cgroup", "0::/\n"), limit]), 1 << 30);
        assert_eq!(with(&[("proc/self/cgroup", "0::/../../above\n"), limit]), 1 << 30);
        assert_eq!(with(&[limit]), 1 << 30, "also when the group cannot be read");
    }

    #[test]
    fn version_1_of_control_groups_is_read_too() {
        let groups =
            "12:pids:/user.slice\n9:cpu,memory:/docker/abc\n1:name=systemd:/docker/abc\n0::/docker/abc\n";
        let group = ("proc/self/cgroup", groups);
        let own = ("sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes", "3221225472\n");
        let none = ("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(with(&[group, own, none]), 3 << 30);
        let hidden = ("sys/fs/cgroup/memory/memory.limit_in_bytes", "5368709120\n");
        assert_eq!(with(&[group, hidden]), 5 << 30, "only the container's own part is mounted");
    }

    #[test]
    fn lines_that_cannot_be_understood_are_passed_over() {
        assert_eq!(with(&[("proc/self/cgroup", "\n0:\nx:memory\n0::\n")]), MACHINE);
    }
}
