-- Identifiers are 16-byte UUIDs, times integer milliseconds since the Unix epoch, lists JSON, numbers of arrays
-- little-endian in chunks of 8192 rows.

-- "chld": a database that bears another mark, or tables without a mark, is not ours to migrate.
PRAGMA application_id = 1667787876;

CREATE TABLE clouds (
    id              BLOB    NOT NULL PRIMARY KEY CHECK (length(id) = 16),
    created         INTEGER NOT NULL,
    digest          BLOB    NOT NULL UNIQUE CHECK (length(digest) = 32),
    points          INTEGER NOT NULL CHECK (points > 0),
    dimension       INTEGER NOT NULL CHECK (dimension > 0),
    nonfinite       INTEGER NOT NULL,
    duplicates      INTEGER NOT NULL,
    bounding_box    TEXT    NOT NULL CHECK (json_valid(bounding_box)),
    coordinate_type TEXT    NOT NULL,
    fields          TEXT    NOT NULL CHECK (json_valid(fields)),
    faces           INTEGER NOT NULL
) STRICT;

-- `part` is `coordinates`, `faces` or `field/` and the field's number; `encoding` the scalar type of `data`.
CREATE TABLE cloud_chunks (
    cloud_id BLOB    NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    part     TEXT    NOT NULL,
    chunk    INTEGER NOT NULL,
    encoding TEXT    NOT NULL,
    data     BLOB    NOT NULL,
    UNIQUE (cloud_id, part, chunk)
) STRICT;

CREATE TABLE jobs (
    id               BLOB    NOT NULL PRIMARY KEY CHECK (length(id) = 16),
    cloud_id         BLOB    NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    created          INTEGER NOT NULL,
    kind             TEXT    NOT NULL CHECK (kind IN ('operator', 'eigen')),
    parameters       TEXT    NOT NULL CHECK (json_valid(parameters)),
    state            TEXT    NOT NULL CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'canceled')),
    phase            TEXT,
    progress         REAL    NOT NULL DEFAULT 0.0 CHECK (progress BETWEEN 0.0 AND 1.0),
    phase_seconds    TEXT    NOT NULL DEFAULT '[]' CHECK (json_valid(phase_seconds)),
    -- Claims so far, except those that an orderly stop gave back.
    attempt          INTEGER NOT NULL DEFAULT 0 CHECK (attempt >= 0),
    -- Claims so far, all of them: the number that fences writes.
    lease            INTEGER NOT NULL DEFAULT 0,
    lease_until      INTEGER,
    process_id       BLOB,
    cancel_requested INTEGER NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    started          INTEGER,
    finished         INTEGER,
    report           TEXT    CHECK (report IS NULL OR json_valid(report)),
    failure          TEXT    CHECK (failure IS NULL OR json_valid(failure)),
    CHECK ((state = 'running') = (lease_until IS NOT NULL)),
    CHECK ((state = 'running') = (process_id IS NOT NULL)),
    CHECK ((state IN ('succeeded', 'failed', 'canceled')) = (finished IS NOT NULL)),
    CHECK ((state = 'succeeded') = (report IS NOT NULL)),
    CHECK ((state = 'failed') = (failure IS NOT NULL)),
    -- Whoever was promised a cancellation does not find a result.
    CHECK (state <> 'succeeded' OR cancel_requested = 0)
) STRICT;

-- The same analysis of the same cloud is there once, unless it failed or is being canceled.
CREATE UNIQUE INDEX jobs_once ON jobs (cloud_id, kind, parameters)
    WHERE state IN ('queued', 'running', 'succeeded') AND cancel_requested = 0;
-- UUIDv7 order is submission order: for the claim, the queue position and the listings.
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_by_cloud ON jobs (cloud_id, id);

-- One row per eigenpair. `digest` is SHA-256 over the checksums of the basis' chunks in order.
CREATE TABLE bases (
    job_id         BLOB    NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    idx            INTEGER NOT NULL,
    eigenvalue     REAL,
    raw_eigenvalue REAL    NOT NULL,
    residual       REAL    NOT NULL,
    digest         BLOB    NOT NULL CHECK (length(digest) = 32),
    PRIMARY KEY (job_id, idx)
) STRICT, WITHOUT ROWID;

-- The key's order (chunk before idx) serves both ways of reading:
--   point-wise, all bases of one chunk: one range of the index;
--   column-wise, one basis: one seek per chunk, so n/8192 seeks for n points, each of which then reads 64 KiB.
-- With idx before chunk the second would be one range, but the first as many seeks as there are bases, and it is the
-- first that streams row-major arrays and PLY.
-- A rowid table with an index, because rows are large: an index of keys alone stays dense, and appending never splits
-- pages whatever order the writer takes.
CREATE TABLE basis_chunks (
    job_id   BLOB    NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    chunk    INTEGER NOT NULL,
    idx      INTEGER NOT NULL,
    checksum BLOB    NOT NULL CHECK (length(checksum) = 32),
    data     BLOB    NOT NULL,
    UNIQUE (job_id, chunk, idx)
) STRICT;

-- `name` is `mass` (f64), or `offsets` (u64), `columns` (u32), `values` (f64) of the operator's matrix.
CREATE TABLE arrays (
    job_id  BLOB    NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    name    TEXT    NOT NULL CHECK (name IN ('mass', 'offsets', 'columns', 'values')),
    numbers INTEGER NOT NULL,
    digest  BLOB    NOT NULL CHECK (length(digest) = 32),
    PRIMARY KEY (job_id, name)
) STRICT, WITHOUT ROWID;

CREATE TABLE array_chunks (
    job_id   BLOB    NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    name     TEXT    NOT NULL,
    chunk    INTEGER NOT NULL,
    checksum BLOB    NOT NULL CHECK (length(checksum) = 32),
    data     BLOB    NOT NULL,
    UNIQUE (job_id, name, chunk)
) STRICT;

-- What the readiness probe writes.
CREATE TABLE probes (
    id    INTEGER NOT NULL PRIMARY KEY CHECK (id = 1),
    beats INTEGER NOT NULL
) STRICT;
