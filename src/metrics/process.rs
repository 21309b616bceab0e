//! The process itself: memory, processor time, descriptors, under the names that client libraries of Prometheus share
//! (<https://prometheus.io/docs/instrumenting/writing_clientlibs/#process-metrics>). Read from `/proc` when asked for.

use std::fmt;
use std::fs;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric};
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Unit;

/// `USER_HZ`, in which the kernel tells times, whatever its own clock is.
const TICKS_PER_SECOND: f64 = 100.0;

/// Tells what the process uses.
#[derive(Debug)]
pub(super) struct Process;

impl Collector for Process {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let mut gauge = |name: &str, help: &str, unit: Option<&Unit>, value: Option<u64>| {
            let Some(value) = value else { return Ok(()) };
            let gauge = ConstGauge::new(i64::try_from(value).unwrap_or(i64::MAX));
            gauge.encode(encoder.encode_descriptor(name, help, unit, gauge.metric_type())?)
        };
        let (bytes, status) =
            (Some(&Unit::Bytes), fs::read_to_string("/proc/self/status").unwrap_or_default());
        gauge(
            "process_resident_memory",
            "Memory of the process that is resident.",
            bytes,
            kibibytes(&status, "VmRSS:"),
        )?;
        gauge(
            "process_virtual_memory",
            "Address space of the process.",
            bytes,
            kibibytes(&status, "VmSize:"),
        )?;
        gauge("process_threads", "Threads of the process.", None, number(&status, "Threads:"))?;
        let open = fs::read_dir("/proc/self/fd").ok().map(|entries| entries.count() as u64);
        gauge("process_open_fds", "File descriptors that are open.", None, open)?;
        let limits = fs::read_to_string("/proc/self/limits").unwrap_or_default();
        gauge(
            "process_max_fds",
            "File descriptors that may be open.",
            None,
            number(&limits, "Max open files"),
        )?;
        let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
        if let Some(seconds) = processor_seconds(&stat) {
            let counter = ConstCounter::new(seconds);
            let help = "Processor time that the process has used.";
            let seconds = Some(&Unit::Seconds);
            counter.encode(encoder.encode_descriptor(
                "process_cpu",
                help,
                seconds,
                counter.metric_type(),
            )?)?;
        }
        Ok(())
    }
}

/// The number of the line that begins so.
fn number(text: &str, begins: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(begins))?;
    rest.split_whitespace().next()?.parse().ok()
}

/// The same of a line in KiB, in bytes.
fn kibibytes(text: &str, begins: &str) -> Option<u64> {
    number(text, begins).map(|kibibytes| kibibytes << 10)
}

/// Time of all threads of the process, in user and kernel mode: fields 14 and 15 (proc(5)).
fn processor_seconds(stat: &str) -> Option<f64> {
    // The second field is a name, and may hold anything.
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = fields.split_whitespace().skip(11).take(2).map(str::parse::<u64>);
    let ticks: u64 = ticks.collect::<Result<Vec<_>, _>>().ok()?.into_iter().sum();
    Some(ticks as f64 / TICKS_PER_SECOND)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_kernel_are_read() {
        let status = "Name:\tchladni\nVmSize:\t  2048 kB\nVmRSS:\t    1024 kB\nThreads:\t5\n";
        assert_eq!(kibibytes(status, "VmRSS:"), Some(1 << 20));
        assert_eq!(number(status, "Threads:"), Some(5));
        let limits = "Max open files            1024                 524288               files     \n";
        assert_eq!(number(limits, "Max open files"), Some(1024));
        assert_eq!(number("Max open files            unlimited  unlimited\n", "Max open files"), None);
        assert_eq!(number(status, "Nothing:"), None);
    }

    #[test]
    fn processor_time_is_read_behind_the_name() {
        let stat = "17 (a b) c) S 1 17 17 0 -1 4194304 99 0 0 0 150 50 0 0 20 0 5 0 1234 1 2";
        assert_eq!(processor_seconds(stat), Some(2.0));
        assert_eq!(processor_seconds("17 (x) S 1"), Some(0.0));
        assert_eq!(processor_seconds(""), None);
    }
}
