//! What the machine has.

/// Limits of the container that the process may run in, by version of control groups.
const CONTAINER_LIMITS: [&str; 2] =
    ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];

/// Bytes of memory that the process may use: the machine's, or its container's if that has less.
pub(super) fn memory() -> u64 {
    let machine = rustix::system::sysinfo();
    let machine = (machine.totalram as u64).saturating_mul(u64::from(machine.mem_unit));
    let limit = |file: &str| std::fs::read_to_string(file).ok()?.trim().parse::<u64>().ok();
    CONTAINER_LIMITS.into_iter().filter_map(limit).fold(machine, u64::min)
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_machine_has_some_memory() {
        assert!((1 << 26..1 << 48).contains(&super::memory()));
    }
}
