//! The free space of the disk, where it is this machine's: a server's disk has no line at all.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric};
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Unit;

const UNKNOWN: i64 = -1;

/// Bytes that are free, if that is known.
#[derive(Debug, Clone)]
pub(super) struct DiskFree(Arc<AtomicI64>);

impl Default for DiskFree {
    fn default() -> Self {
        Self(Arc::new(AtomicI64::new(UNKNOWN)))
    }
}

impl DiskFree {
    pub(super) fn set(&self, free: Option<u64>) {
        let free = free.map_or(UNKNOWN, |bytes| i64::try_from(bytes).unwrap_or(i64::MAX));
        self.0.store(free, Ordering::Relaxed);
    }
}

impl Collector for DiskFree {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let free = self.0.load(Ordering::Relaxed);
        if free == UNKNOWN {
            return Ok(());
        }
        let gauge = ConstGauge::new(free);
        let help = "Free on the database's disk.";
        let descriptor =
            encoder.encode_descriptor("chladni_disk_free", help, Some(&Unit::Bytes), gauge.metric_type())?;
        gauge.encode(descriptor)
    }
}
