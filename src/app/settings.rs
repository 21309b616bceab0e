//! Every setting of the service, from flags and environment, with its unit.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use axum::http::HeaderValue;

use super::listener::{Connections, Patience};
use super::machine;
use super::secret::Secret;
use super::values::{address, bytes, host, origin, threads};
use crate::cloud::reader;
use crate::http::{self, Limits};
use crate::jobs::{JobsSettings, Retention};
use crate::store::{DatabaseAddress, NodeSettings, StoreSettings};

/// When a client at its turn loses its place to another that waits for one.
const PATIENCE: Patience =
    Patience { idle: Duration::from_secs(1), slow: Duration::from_secs(5), body_rate_min: 4096.0 };

/// How the service runs, and what it accepts at most.
#[derive(Debug, Clone, clap::Args)]
pub struct Settings {
    /// Address and port, or a port of loopback alone; port 0 takes a free one. Other machines reach it only on another
    /// address than loopback.
    #[arg(long, env = "CHLADNI_LISTEN", value_name = "ADDRESS", value_parser = address, default_value_t = Self::default().listen)]
    pub listen: SocketAddr,

    /// File of the database, made when it is not there; or the address of a PostgreSQL database that several nodes share,
    /// such as `postgres://user@host/chladni`. Its password is better given by `CHLADNI_DATABASE` or `PGPASSWORD`: a command
    /// line is seen by every user of the machine.
    #[arg(
        long,
        env = "CHLADNI_DATABASE",
        value_name = "FILE|ADDRESS",
        hide_env_values = true,
        default_value = "chladni.db"
    )]
    pub database: DatabaseAddress,

    /// Answer no requests, only compute: a node beside others on one PostgreSQL database.
    #[arg(long, env = "CHLADNI_NO_LISTEN")]
    pub no_listen: bool,

    /// Threads that compute, 0 for one per processor.
    #[arg(long, env = "CHLADNI_THREADS", value_name = "N", value_parser = threads, default_value_t = Self::default().threads)]
    pub threads: usize,

    /// Jobs that run at the same time; 0 for a node that only answers, beside others on one PostgreSQL database.
    #[arg(long, visible_alias = "workers", env = "CHLADNI_JOBS_AT_ONCE", value_name = "N", value_parser = threads, default_value_t = Self::default().jobs_at_once)]
    pub jobs_at_once: usize,

    /// Bytes of memory that the analyses running at one time may be estimated to take together; 0 for half of what the
    /// machine or container has. A job that needs more by itself is refused.
    #[arg(long, env = "CHLADNI_MEMORY_BUDGET", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().memory_budget)]
    pub memory_budget: u64,

    /// Bytes of memory for the bodies of requests and what they are parsed into: a body reserves five times the
    /// bytes received; large answers get an extra half. 0 for a quarter of what the machine or container has. No key holds
    /// more than half of it.
    #[arg(long, env = "CHLADNI_BODY_MEMORY", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().body_memory)]
    pub body_memory: u64,

    /// Bytes that stay free on the database's disk: below, uploads and jobs are refused, and no job begins.
    #[arg(long, env = "CHLADNI_DISK_FLOOR", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().disk_floor)]
    pub disk_floor: u64,

    /// Bytes of a request's body as it is sent, at most.
    #[arg(long, alias = "max-body", env = "CHLADNI_BODY_BYTES_MAX", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().body_bytes_max)]
    pub body_bytes_max: u64,

    /// Bytes of a compressed body once it is decompressed, at most.
    #[arg(long, alias = "max-decoded", env = "CHLADNI_DECODED_BYTES_MAX", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().decoded_bytes_max)]
    pub decoded_bytes_max: u64,

    /// Largest ratio of decompressed to compressed size beyond the first megabyte.
    #[arg(long, alias = "ratio-max", env = "CHLADNI_DECODED_RATIO_MAX", value_name = "N", default_value_t = Self::default().decoded_ratio_max)]
    pub decoded_ratio_max: u64,

    /// Coordinates per point, at most; 8 at most.
    #[arg(long, env = "CHLADNI_DIMENSION_MAX", value_name = "N", default_value_t = Self::default().dimension_max)]
    pub dimension_max: usize,

    /// Points of a cloud, at most.
    #[arg(long, env = "CHLADNI_POINTS_MAX", value_name = "N", default_value_t = Self::default().points_max)]
    pub points_max: usize,

    /// Triangles of a cloud, at most.
    #[arg(long, env = "CHLADNI_FACES_MAX", value_name = "N", default_value_t = Self::default().faces_max)]
    pub faces_max: usize,

    /// Per-point scalars of a cloud, at most.
    #[arg(long, env = "CHLADNI_FIELDS_MAX", value_name = "N", default_value_t = Self::default().fields_max)]
    pub fields_max: usize,

    /// Bases of a job, at most.
    #[arg(long, env = "CHLADNI_BASES_MAX", value_name = "N", default_value_t = Self::default().bases_max)]
    pub bases_max: usize,

    /// Jobs that wait, at most. When as many do, a key that has fewer than its share among them can still queue jobs.
    #[arg(long, env = "CHLADNI_QUEUE_MAX", value_name = "N", default_value_t = Self::default().queue_max)]
    pub queue_max: u64,

    /// Jobs of one key that wait, at most; 0 for as many as may wait in all.
    #[arg(long, env = "CHLADNI_QUEUE_MAX_PER_KEY", value_name = "N", default_value_t = Self::default().queue_max_per_key)]
    pub queue_max_per_key: u64,

    /// Bytes that the clouds and results of one key may take, at most; 0 for no limit.
    #[arg(long, env = "CHLADNI_STORED_BYTES_MAX_PER_KEY", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().stored_bytes_max_per_key)]
    pub stored_bytes_max_per_key: u64,

    /// Bytes beyond which the database file does not grow, at least 1 MiB; 0 for as many as the disk has.
    #[arg(long, env = "CHLADNI_DATABASE_BYTES_MAX", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().database_bytes_max)]
    pub database_bytes_max: u64,

    /// Seconds that one attempt at a job may take.
    #[arg(long, env = "CHLADNI_JOB_SECONDS", value_name = "SECONDS", default_value_t = Self::default().job_seconds)]
    pub job_seconds: u64,

    /// Open connections, at most; beyond that, idle connections are closed, and only probes are answered.
    #[arg(long, env = "CHLADNI_CONNECTIONS_MAX", value_name = "N", default_value_t = Self::default().connections_max)]
    pub connections_max: usize,

    /// Seconds for the head of a request, and between requests on an open connection.
    #[arg(long, env = "CHLADNI_HEADER_SECONDS", value_name = "SECONDS", default_value_t = Self::default().header_seconds)]
    pub header_seconds: u64,

    /// Seconds for the body of a request.
    #[arg(long, env = "CHLADNI_BODY_SECONDS", value_name = "SECONDS", default_value_t = Self::default().body_seconds)]
    pub body_seconds: u64,

    /// Bytes per second that the body of a request brings at least, on average over the seconds of `--stall-seconds`; 0 for
    /// none. Slower connections are dropped.
    #[arg(long, env = "CHLADNI_BODY_RATE_MIN", value_name = "BYTES", value_parser = bytes, default_value_t = Self::default().body_rate_min)]
    pub body_rate_min: u64,

    /// Seconds without progress in sending a body or reading an answer before the connection is dropped.
    #[arg(long, env = "CHLADNI_STALL_SECONDS", value_name = "SECONDS", default_value_t = Self::default().stall_seconds)]
    pub stall_seconds: u64,

    /// Seconds that open answers and running jobs get at a stop.
    #[arg(long, env = "CHLADNI_GRACE_SECONDS", value_name = "SECONDS", default_value_t = Self::default().grace_seconds)]
    pub grace_seconds: u64,

    /// Days that jobs and their results are kept after their end; forever when not given.
    #[arg(long, env = "CHLADNI_KEEP_JOBS_DAYS", value_name = "DAYS")]
    pub keep_jobs_days: Option<u64>,

    /// Days that clouds without jobs are kept after their upload; forever when not given.
    #[arg(long, env = "CHLADNI_KEEP_CLOUDS_DAYS", value_name = "DAYS")]
    pub keep_clouds_days: Option<u64>,

    /// File of API keys, one per line, each after its owner's name, as `chladni keys` keeps it; requests must then carry
    /// `Authorization: Bearer KEY`, and see the clouds and jobs of that owner only. SIGHUP reads it again.
    #[arg(long, env = "CHLADNI_API_KEYS", value_name = "FILE")]
    pub api_keys: Option<PathBuf>,

    /// The same between commas, beside those of the file. From the environment: a command line is seen by every user of
    /// the machine.
    #[arg(long, env = "CHLADNI_KEYS", value_name = "KEYS", hide_env_values = true)]
    pub keys: Option<Secret>,

    /// Origin of pages that may use the service from a browser, such as `https://viewer.example`; `*` is any. Several
    /// are separated by commas.
    #[arg(long, env = "CHLADNI_CORS_ORIGINS", value_name = "ORIGIN", value_delimiter = ',', value_parser = origin)]
    pub cors_origins: Vec<HeaderValue>,

    /// Host name under which the service may be asked for where it has no keys, beside `localhost` and the address it
    /// listens on; `*` is any. Several are separated by commas.
    #[arg(long, env = "CHLADNI_ALLOWED_HOSTS", value_name = "HOST", value_delimiter = ',', value_parser = host)]
    pub allowed_hosts: Vec<String>,

    /// Serve other machines without asking for a key.
    #[arg(long, env = "CHLADNI_ALLOW_PUBLIC")]
    pub allow_public: bool,
}

impl Default for Settings {
    fn default() -> Self {
        let reader = reader::Limits::default();
        Self {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 8080)),
            database: DatabaseAddress::file("chladni.db"),
            no_listen: false,
            threads: 0,
            jobs_at_once: 1,
            memory_budget: 0,
            body_memory: 0,
            disk_floor: 1 << 30,
            body_bytes_max: 1 << 30,
            decoded_bytes_max: 2 << 30,
            decoded_ratio_max: 100,
            dimension_max: reader.dimension_max,
            points_max: reader.points_max,
            faces_max: reader.faces_max,
            fields_max: reader.fields_max,
            bases_max: 1000,
            queue_max: 1000,
            queue_max_per_key: 0,
            stored_bytes_max_per_key: 0,
            database_bytes_max: 0,
            job_seconds: 6 * 60 * 60,
            connections_max: 1024,
            header_seconds: 15,
            body_seconds: 3600,
            body_rate_min: 16 << 10,
            stall_seconds: 30,
            grace_seconds: 20,
            keep_jobs_days: None,
            keep_clouds_days: None,
            api_keys: None,
            keys: None,
            cors_origins: Vec::new(),
            allowed_hosts: Vec::new(),
            allow_public: false,
        }
    }
}

/// A limit; 0 is none.
fn some_unless_zero(limit: u64) -> Option<u64> {
    (limit > 0).then_some(limit)
}

fn unless_zero(limit: u64) -> u64 {
    some_unless_zero(limit).unwrap_or(u64::MAX)
}

impl Settings {
    pub(super) fn threads(&self) -> usize {
        if self.threads > 0 {
            self.threads
        } else {
            std::thread::available_parallelism().map_or(1, usize::from)
        }
    }

    pub(super) fn jobs(&self) -> JobsSettings {
        let days = |days: u64| Duration::from_secs(days.saturating_mul(24 * 60 * 60));
        let retention =
            Retention { jobs: self.keep_jobs_days.map(days), clouds: self.keep_clouds_days.map(days) };
        let time_max = Duration::from_secs(self.job_seconds);
        JobsSettings {
            concurrent: self.jobs_at_once,
            memory: self.memory_budget(),
            time_max,
            retention,
            ..JobsSettings::default()
        }
    }

    pub(super) fn store(&self) -> StoreSettings {
        StoreSettings {
            queue_max: self.queue_max,
            queue_max_per_owner: unless_zero(self.queue_max_per_key),
            stored_bytes_max_per_owner: unless_zero(self.stored_bytes_max_per_key),
            file_bytes_max: unless_zero(self.database_bytes_max),
            memory_budget: self.memory_budget(),
            disk_floor: self.disk_floor,
            node: NodeSettings { threads: self.threads() as u64, workers: self.jobs_at_once as u64 },
            ..StoreSettings::default()
        }
    }

    /// Bytes of memory that analyses may be estimated to take together: half of what the process may use where none are set.
    #[must_use]
    pub fn memory_budget(&self) -> u64 {
        if self.memory_budget > 0 { self.memory_budget } else { machine::memory() / 2 }
    }

    fn body_memory(&self) -> u64 {
        if self.body_memory > 0 { self.body_memory } else { machine::memory() / 4 }
    }

    fn stall(&self) -> Duration {
        Duration::from_secs(self.stall_seconds)
    }

    pub(super) fn grace(&self) -> Duration {
        Duration::from_secs(self.grace_seconds)
    }

    pub(super) fn connections(&self) -> Connections {
        Connections {
            at_once: self.connections_max.max(1),
            patience: PATIENCE,
            header: Duration::from_secs(self.header_seconds),
            stall: self.stall(),
            grace: self.grace(),
        }
    }

    pub(super) fn limits(&self) -> Limits {
        let reader = reader::Limits::default();
        Limits {
            body_bytes: self.body_bytes_max,
            decoded_bytes: self.decoded_bytes_max,
            decoded_ratio_max: self.decoded_ratio_max,
            body_seconds: self.body_seconds,
            body_rate_min_bytes: self.body_rate_min,
            stall_seconds: self.stall_seconds,
            header_seconds: self.header_seconds,
            connections_max: self.connections_max.max(1),
            body_memory_bytes: self.body_memory(),
            points_max: self.points_max,
            dimension_max: self.dimension_max.min(reader.dimension_max),
            fields_max: self.fields_max,
            faces_max: self.faces_max,
            reader_memory_max: reader.memory_max,
            memory_budget_bytes: self.memory_budget(),
            disk_floor_bytes: self.disk_floor,
            jobs_at_once: self.jobs_at_once,
            keep_jobs_days: self.keep_jobs_days,
            keep_clouds_days: self.keep_clouds_days,
            bases_max: self.bases_max,
            queue_max: self.queue_max,
            queue_max_per_key: some_unless_zero(self.queue_max_per_key),
            stored_bytes_max_per_key: some_unless_zero(self.stored_bytes_max_per_key),
            database_bytes_max: some_unless_zero(self.database_bytes_max),
            job_seconds: self.job_seconds,
            json_bytes: http::JSON_BYTES_MAX,
            wait_seconds_max: http::WAIT_SECONDS_MAX,
            page_max: http::PAGE_MAX as u64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The figure that a word of the page stands for; `None` of words such as "half of the memory".
    fn figure(shown: &str) -> Option<u64> {
        let (number, unit) = shown.split_once(' ').unwrap_or((shown, ""));
        let number: u64 = number.replace(',', "").parse().ok()?;
        Some(match unit {
            "" => number,
            "KiB" => number << 10,
            "GiB" => number << 30,
            "hours" => number * 3600,
            _ => panic!("what unit is {shown}?"),
        })
    }

    #[test]
    fn defaults_are_those_that_the_page_on_operation_shows() {
        let command = <Settings as clap::Args>::augment_args(clap::Command::new("serve"));
        let default = |flag: &str| {
            let argument =
                command.get_arguments().find(|argument| argument.get_long() == Some(flag)).unwrap();
            argument.get_default_values().first().map(|value| value.to_str().unwrap().to_owned())
        };
        let page = include_str!("../../docs/operation.md");
        let mut compared = 0;
        for row in page.lines().filter(|line| line.starts_with("| `--")) {
            let mut cells = row.split(" | ");
            let flags = cells.next().unwrap().split(" (or").next().unwrap();
            let flags: Vec<_> = flags.split('`').filter_map(|word| word.strip_prefix("--")).collect();
            let shown: Vec<_> = cells.next().unwrap().split(", ").collect();
            for (place, flag) in flags.iter().enumerate() {
                // One word may speak for all flags of a row.
                match figure(shown.get(place).unwrap_or(&shown[0])) {
                    Some(figure) => {
                        assert_eq!(default(flag), Some(figure.to_string()), "--{flag}");
                        compared += 1;
                    }
                    None => assert!(default(flag).is_none_or(|value| value == "0"), "--{flag}"),
                }
            }
        }
        assert!(compared >= 15, "{compared}");
    }
}
