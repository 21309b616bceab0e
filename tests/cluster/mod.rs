//! A PostgreSQL cluster of the tests' own, on a socket in a temporary folder. It ends with the process that began it,
//! however that ends: a shell keeps it for as long as it can read from that process.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// The oldest version that is supported.
const VERSION_MIN: u32 = 15;

/// Makes a cluster, says where, and keeps it until its input ends. What is written to its disk need not survive a crash of
/// the machine. Only the user `guarded` needs a password.
const KEEP: &str = r#"
set -e
folder=$(mktemp -d "${TMPDIR:-/tmp}/chladni-postgres.XXXXXX")
trap '"$1/pg_ctl" -D "$folder/data" -m immediate stop > /dev/null 2>&1 || true; rm -rf "$folder"' EXIT
trap 'exit 1' INT TERM HUP
"$1/initdb" --no-sync -A trust -U postgres -E UTF8 --locale=C -D "$folder/data" > /dev/null
cat >> "$folder/data/postgresql.conf" <<END
unix_socket_directories = '$folder'
listen_addresses = ''
fsync = off
max_connections = 300
END
sed -i '1i local all guarded scram-sha-256' "$folder/data/pg_hba.conf"
"$1/pg_ctl" -D "$folder/data" -w -l "$folder/log" start > /dev/null
echo "$folder"
cat > /dev/null
"#;

/// A running cluster.
pub(crate) struct Cluster {
    programs: PathBuf,
    folder: PathBuf,
    /// Its input is open as long as this lives.
    _keeper: Child,
}

impl Cluster {
    /// Starts one; `Err` says why there cannot be one here.
    pub(crate) fn start() -> Result<Self, String> {
        let programs = programs().ok_or_else(|| {
            format!("there are no programs of PostgreSQL {VERSION_MIN} or newer in /usr/lib/postgresql")
        })?;
        let mut keeper = as_postgres("sh")
            .args(["-c", KEEP, "sh"])
            .arg(&programs)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| error.to_string())?;
        let mut folder = String::new();
        let said = BufReader::new(keeper.stdout.take().unwrap()).read_line(&mut folder);
        if said.is_err() || folder.trim().is_empty() {
            return Err("the server did not start".to_owned());
        }
        Ok(Self { programs, folder: PathBuf::from(folder.trim()), _keeper: keeper })
    }

    /// As `--database` takes it.
    pub(crate) fn address(&self, database: &str) -> String {
        self.address_as("postgres", database)
    }

    pub(crate) fn address_as(&self, user: &str, database: &str) -> String {
        format!("postgresql:///{database}?host={}&user={user}", self.folder.display())
    }

    /// The server's socket.
    #[allow(dead_code)] // the tests of the store have no use for it
    pub(crate) fn socket(&self) -> PathBuf {
        self.folder.join(".s.PGSQL.5432")
    }

    /// Runs statements, each in a transaction of its own.
    pub(crate) fn sql(&self, database: &str, statements: &str) -> String {
        let mut psql = Command::new(self.programs.join("psql"));
        psql.args(["-qAtX", "-v", "ON_ERROR_STOP=1", "-U", "postgres", "-d", database, "-h"])
            .arg(&self.folder);
        for statement in statements.split(";;").filter(|statement| !statement.trim().is_empty()) {
            psql.args(["-c", statement]);
        }
        let output = psql.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }

    /// Ends the server as a crash does, and starts it again.
    #[allow(dead_code)] // the tests of the store leave it alone
    pub(crate) fn restart(&self) {
        let control = |arguments: &[&str]| {
            let mut command = as_postgres(self.programs.join("pg_ctl").to_str().unwrap());
            command.arg("-D").arg(self.folder.join("data")).args(arguments);
            assert!(command.stdout(Stdio::null()).status().unwrap().success(), "{arguments:?}");
        };
        control(&["-m", "immediate", "stop"]);
        let log = self.folder.join("log");
        control(&["-w", "-l", log.to_str().unwrap(), "start"]);
    }
}

/// PostgreSQL refuses to run as root.
fn as_postgres(program: &str) -> Command {
    if rustix::process::geteuid().is_root() {
        let mut command = Command::new("runuser");
        command.args(["-u", "postgres", "--", program]).current_dir("/");
        command
    } else {
        Command::new(program)
    }
}

/// Where the newest version's programs are.
fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir("/usr/lib/postgresql").ok()?;
    let version = |path: &Path| path.file_name()?.to_str()?.parse::<u32>().ok();
    versions
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| version(path) >= Some(VERSION_MIN) && path.join("bin/initdb").exists())
        .max_by_key(|path| version(path))
        .map(|path| path.join("bin"))
}
