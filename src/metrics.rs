//! What is counted and measured while the service runs, as Prometheus reads it. Names and units in one place.

mod disk;
mod process;

use std::fmt;
use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::{Registry, Unit};

use disk::DiskFree;

/// Media type of the text.
pub const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// A request, as far as it may be counted: routes and methods are few, paths are not.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub struct Request {
    /// Its method, `other` for those of no route.
    pub method: &'static str,
    /// Its route with names in place of ids, `none` when there is none.
    pub route: String,
    /// The status of its answer.
    pub status: u16,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Route {
    route: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct State {
    state: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Phase {
    phase: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Node {
    node: String,
}

/// Gauge values, sampled when `/metrics` is scraped.
#[derive(Debug, Clone, Default)]
pub struct Gauges {
    /// Jobs by state.
    pub jobs: Vec<(&'static str, u64)>,
    /// Bytes that running jobs are estimated to take.
    pub job_memory: u64,
    /// Bytes reserved for bodies and answers.
    pub body_memory: u64,
    /// Seconds since the submission of the job that has waited longest, 0 when none waits.
    pub oldest_queued_seconds: f64,
    /// Bytes that are free on the disk, unless it is a server's.
    pub disk_free: Option<u64>,
    /// This process, by the name that it has in the database.
    pub node: String,
    /// Bytes of the database.
    pub database_file: u64,
    /// Bytes of pages in the database file whose content was deleted.
    pub database_free: u64,
}

/// All counters, histograms and gauges of a service.
pub struct Metrics {
    registry: Registry,
    requests: Family<Request, Counter>,
    request_seconds: Family<Route, Histogram, fn() -> Histogram>,
    received: Counter,
    sent: Counter,
    ended: Family<State, Counter>,
    queue_seconds: Histogram,
    phase_seconds: Family<Phase, Histogram, fn() -> Histogram>,
    jobs: Family<State, Gauge>,
    job_memory: Gauge,
    body_memory: Gauge,
    oldest_queued: Gauge<f64, AtomicU64>,
    disk_free: DiskFree,
    node: Family<Node, Gauge>,
    database_file: Gauge,
    database_free: Gauge,
}

/// From 1 ms to a minute.
fn of_requests() -> Histogram {
    Histogram::new(exponential_buckets(1e-3, 4.0, 9))
}

/// From 10 ms to three hours.
fn of_jobs() -> Histogram {
    Histogram::new(exponential_buckets(1e-2, 4.0, 11))
}

impl Default for Metrics {
    fn default() -> Self {
        let mut metrics = Self {
            registry: Registry::default(),
            requests: Family::default(),
            request_seconds: Family::new_with_constructor(of_requests),
            received: Counter::default(),
            sent: Counter::default(),
            ended: Family::default(),
            queue_seconds: of_jobs(),
            phase_seconds: Family::new_with_constructor(of_jobs),
            jobs: Family::default(),
            job_memory: Gauge::default(),
            body_memory: Gauge::default(),
            oldest_queued: Gauge::default(),
            disk_free: DiskFree::default(),
            node: Family::default(),
            database_file: Gauge::default(),
            database_free: Gauge::default(),
        };
        metrics.register();
        metrics
    }
}

impl Metrics {
    fn register(&mut self) {
        self.registry.register_collector(Box::new(process::Process));
        let registry = self.registry.sub_registry_with_prefix("chladni");
        let (seconds, bytes) = (|| Unit::Seconds, || Unit::Bytes);
        let version = Info::new([("version", env!("CARGO_PKG_VERSION"))]);
        registry.register("build", "The version of the service", version);
        registry.register("http_requests", "Requests by method, route and status", self.requests.clone());
        let help = "Time from a request's head to its answer's head, by route";
        registry.register_with_unit("http_request", help, seconds(), self.request_seconds.clone());
        let help = "Bytes of requests' bodies received";
        registry.register_with_unit("http_received", help, bytes(), self.received.clone());
        let help = "Bytes of answers' bodies sent";
        registry.register_with_unit("http_sent", help, bytes(), self.sent.clone());
        registry.register(
            "jobs",
            "Jobs in the database by state, the same on every node that shares it",
            self.jobs.clone(),
        );
        registry.register(
            "jobs_ended",
            "Attempts at jobs that ended here, by the state after",
            self.ended.clone(),
        );
        let help = "Time from a job's submission to its first attempt";
        registry.register_with_unit("job_queue", help, seconds(), self.queue_seconds.clone());
        let help = "Time of a job's phases, once it has succeeded";
        registry.register_with_unit("job_phase", help, seconds(), self.phase_seconds.clone());
        let help = "Memory that running jobs are estimated to take";
        registry.register_with_unit("job_memory", help, bytes(), self.job_memory.clone());
        let help = "Memory reserved for request bodies and answers";
        registry.register_with_unit("body_memory", help, bytes(), self.body_memory.clone());
        let help = "Time since the submission of the job that has waited longest, the same on every node of the database";
        registry.register_with_unit("job_oldest_queued", help, seconds(), self.oldest_queued.clone());
        let help = "Size of the database, without its write-ahead log";
        registry.register_with_unit("database_file", help, bytes(), self.database_file.clone());
        let help =
            "This process, by its name in the database, where running jobs are marked with it; always 1";
        registry.register("node", help, self.node.clone());
        let help = "Free pages within the database file, which fill before it grows";
        registry.register_with_unit("database_free", help, bytes(), self.database_free.clone());
        self.registry.register_collector(Box::new(self.disk_free.clone()));
    }

    /// A request was answered after `seconds`.
    pub fn answered(&self, request: &Request, seconds: f64) {
        self.request_seconds.get_or_create(&Route { route: request.route.clone() }).observe(seconds);
        self.requests.get_or_create(request).inc();
    }

    /// `bytes` of a request's body came.
    pub fn received(&self, bytes: u64) {
        self.received.inc_by(bytes);
    }

    /// `bytes` of an answer's body went out.
    pub fn sent(&self, bytes: u64) {
        self.sent.inc_by(bytes);
    }

    /// A job was claimed for the first time, `seconds` after its submission.
    pub fn claimed(&self, seconds: f64) {
        self.queue_seconds.observe(seconds);
    }

    /// An attempt at a job ended, and left it in `state`.
    pub fn ended(&self, state: &'static str) {
        self.ended.get_or_create(&State { state }).inc();
    }

    /// A job that succeeded spent `seconds` in `phase`.
    pub fn phase(&self, phase: &'static str, seconds: f64) {
        self.phase_seconds.get_or_create(&Phase { phase }).observe(seconds);
    }

    /// Everything as text, with what stands where now.
    ///
    /// # Errors
    /// [`fmt::Error`], which strings do not raise.
    pub fn text(&self, levels: &Gauges) -> Result<String, fmt::Error> {
        for (state, jobs) in &levels.jobs {
            self.jobs.get_or_create(&State { state }).set(signed(*jobs));
        }
        self.job_memory.set(signed(levels.job_memory));
        self.body_memory.set(signed(levels.body_memory));
        self.oldest_queued.set(levels.oldest_queued_seconds);
        self.disk_free.set(levels.disk_free);
        self.node.get_or_create(&Node { node: levels.node.clone() }).set(1);
        self.database_file.set(signed(levels.database_file));
        self.database_free.set(signed(levels.database_free));
        let mut text = String::new();
        encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

/// Gauges are signed.
fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

impl fmt::Debug for Metrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Metrics")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_counted_is_told_with_its_unit() {
        let metrics = Metrics::default();
        metrics.answered(&Request { method: "GET", route: "/jobs/{id}".to_owned(), status: 200 }, 0.003);
        metrics.received(7);
        metrics.claimed(0.5);
        metrics.ended("succeeded");
        metrics.phase("cells", 2.0);
        let levels = Gauges {
            jobs: vec![("queued", 3)],
            disk_free: Some(1 << 40),
            node: "n1".to_owned(),
            oldest_queued_seconds: 2.5,
            database_file: 30,
            database_free: 20,
            ..Gauges::default()
        };
        let text = metrics.text(&levels).unwrap();
        for line in [
            "chladni_http_requests_total{method=\"GET\",route=\"/jobs/{id}\",status=\"200\"} 1",
            "chladni_http_request_seconds_bucket{le=\"0.004\",route=\"/jobs/{id}\"} 1",
            "chladni_http_received_bytes_total 7",
            "chladni_job_queue_seconds_count 1",
            "chladni_jobs_ended_total{state=\"succeeded\"} 1",
            "chladni_job_phase_seconds_sum{phase=\"cells\"} 2.0",
            "chladni_jobs{state=\"queued\"} 3",
            "chladni_disk_free_bytes 1099511627776",
            concat!("chladni_build_info{version=\"", env!("CARGO_PKG_VERSION"), "\"} 1"),
            "# TYPE process_resident_memory_bytes gauge",
            "# UNIT process_cpu_seconds seconds",
            "process_open_fds ",
            "chladni_job_oldest_queued_seconds 2.5",
            "chladni_database_file_bytes 30",
            "chladni_database_free_bytes 20",
            "chladni_node{node=\"n1\"} 1",
            "# EOF",
        ] {
            assert!(text.contains(line), "{line}\n{text}");
        }
    }
}
