-- The tables of migrations/sqlite/, as they are after its tenth file, in the types of PostgreSQL. Times are milliseconds
-- since the Unix epoch by the database's clock, flags 0 or 1, and JSON is text, so that one statement serves both engines;
-- numbers of arrays are little-endian in chunks of at most 4 MiB.
--
-- Names are compared byte by byte: an index in the order of a locale is invalid after an upgrade of that locale.

CREATE TABLE clouds (
    id              UUID   NOT NULL PRIMARY KEY,
    owner           TEXT   COLLATE "C" NOT NULL,
    name            TEXT,
    created         BIGINT NOT NULL,
    digest          BYTEA  NOT NULL CHECK (octet_length(digest) = 32),
    points          BIGINT NOT NULL CHECK (points > 0),
    dimension       BIGINT NOT NULL CHECK (dimension > 0),
    nonfinite       BIGINT NOT NULL,
    duplicates      BIGINT NOT NULL,
    bounding_box    TEXT   NOT NULL,
    coordinate_type TEXT   NOT NULL,
    fields          TEXT   NOT NULL,
    faces           BIGINT NOT NULL,
    grids           TEXT,
    origin          TEXT,
    bytes           BIGINT NOT NULL DEFAULT 0 CHECK (bytes >= 0),
    checksum        BYTEA  CHECK (octet_length(checksum) = 32),
    UNIQUE (owner, digest)
);
CREATE INDEX clouds_by_owner ON clouds (owner, id);

CREATE TABLE cloud_chunks (
    cloud_id UUID   NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    part     TEXT   COLLATE "C" NOT NULL,
    chunk    BIGINT NOT NULL,
    encoding TEXT   NOT NULL,
    data     BYTEA  NOT NULL,
    PRIMARY KEY (cloud_id, part, chunk)
);
-- Coordinates do not get shorter by compression, and trying takes three times as long as writing.
ALTER TABLE cloud_chunks ALTER COLUMN data SET STORAGE EXTERNAL;

CREATE TABLE jobs (
    id               UUID   NOT NULL PRIMARY KEY,
    owner            TEXT   COLLATE "C" NOT NULL DEFAULT '',
    cloud_id         UUID   NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    created          BIGINT NOT NULL,
    kind             TEXT   COLLATE "C" NOT NULL CHECK (kind IN ('operator', 'eigen')),
    parameters       TEXT   COLLATE "C" NOT NULL,
    memory           BIGINT NOT NULL DEFAULT 0 CHECK (memory >= 0),
    chunk_points     BIGINT NOT NULL DEFAULT 8192 CHECK (chunk_points > 0),
    bytes            BIGINT NOT NULL DEFAULT 0 CHECK (bytes >= 0),
    state            TEXT   COLLATE "C" NOT NULL
                     CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'canceled')),
    phase            TEXT,
    progress         DOUBLE PRECISION NOT NULL DEFAULT 0.0 CHECK (progress BETWEEN 0.0 AND 1.0),
    phase_seconds    TEXT   NOT NULL DEFAULT '[]',
    attempt          BIGINT NOT NULL DEFAULT 0 CHECK (attempt >= 0),
    lease            BIGINT NOT NULL DEFAULT 0,
    lease_until      BIGINT,
    -- The node that runs it.
    process_id       UUID,
    not_before       BIGINT NOT NULL DEFAULT 0,
    cancel_requested BIGINT NOT NULL DEFAULT 0 CHECK (cancel_requested IN (0, 1)),
    delete_requested BIGINT NOT NULL DEFAULT 0 CHECK (delete_requested IN (0, 1)),
    started          BIGINT,
    finished         BIGINT,
    report           TEXT,
    report_checksum  BYTEA  CHECK (octet_length(report_checksum) = 32),
    failure          TEXT,
    CHECK ((state = 'running') = (lease_until IS NOT NULL)),
    CHECK ((state = 'running') = (process_id IS NOT NULL)),
    CHECK ((state IN ('succeeded', 'failed', 'canceled')) = (finished IS NOT NULL)),
    CHECK ((state = 'succeeded') = (report IS NOT NULL)),
    CHECK ((state = 'failed') = (failure IS NOT NULL)),
    CHECK (state <> 'succeeded' OR cancel_requested = 0)
) WITH (fillfactor = 70); -- room for heartbeats, which then need no new entries in the indexes

CREATE UNIQUE INDEX jobs_once ON jobs (cloud_id, kind, parameters)
    WHERE state IN ('queued', 'running', 'succeeded') AND cancel_requested = 0;
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_by_cloud ON jobs (cloud_id, id);
CREATE INDEX jobs_by_owner ON jobs (owner, id);
CREATE INDEX jobs_by_end ON jobs (finished) WHERE finished IS NOT NULL;
CREATE INDEX jobs_waiting ON jobs (owner, id) WHERE state = 'queued';

-- Asked to be deleted while it ran: it goes with the end of its attempt, whatever ends it.
CREATE FUNCTION delete_ended_job() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    DELETE FROM jobs WHERE id = NEW.id;
    RETURN NULL;
END
$$;
CREATE TRIGGER jobs_deleted_at_their_end AFTER UPDATE OF state ON jobs FOR EACH ROW
WHEN (NEW.delete_requested = 1 AND NEW.state IN ('succeeded', 'failed', 'canceled'))
EXECUTE FUNCTION delete_ended_job();

CREATE TABLE turns (
    owner TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    turn  BIGINT NOT NULL
);

CREATE TABLE bases (
    job_id UUID   NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    idx    BIGINT NOT NULL,
    digest BYTEA  NOT NULL CHECK (octet_length(digest) = 32),
    PRIMARY KEY (job_id, idx)
);

CREATE TABLE basis_chunks (
    job_id   UUID   NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    chunk    BIGINT NOT NULL,
    idx      BIGINT NOT NULL,
    checksum BYTEA  NOT NULL CHECK (octet_length(checksum) = 32),
    data     BYTEA  NOT NULL,
    PRIMARY KEY (job_id, chunk, idx)
);
ALTER TABLE basis_chunks ALTER COLUMN data SET STORAGE EXTERNAL;

CREATE TABLE arrays (
    job_id  UUID   NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    name    TEXT   COLLATE "C" NOT NULL CHECK (name IN ('mass', 'offsets', 'columns', 'values')),
    numbers BIGINT NOT NULL,
    digest  BYTEA  NOT NULL CHECK (octet_length(digest) = 32),
    PRIMARY KEY (job_id, name)
);

CREATE TABLE array_chunks (
    job_id   UUID   NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    name     TEXT   COLLATE "C" NOT NULL,
    chunk    BIGINT NOT NULL,
    checksum BYTEA  NOT NULL CHECK (octet_length(checksum) = 32),
    data     BYTEA  NOT NULL,
    PRIMARY KEY (job_id, name, chunk)
);
ALTER TABLE array_chunks ALTER COLUMN data SET STORAGE EXTERNAL;

CREATE TABLE coefficients (
    job_id        UUID   NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    place         BIGINT NOT NULL,
    name          TEXT   NOT NULL,
    energy        DOUBLE PRECISION NOT NULL,
    checksum      BYTEA  NOT NULL CHECK (octet_length(checksum) = 32),
    numbers       BYTEA  NOT NULL,
    head_checksum BYTEA  CHECK (octet_length(head_checksum) = 32),
    PRIMARY KEY (job_id, place)
);

CREATE TABLE idempotency_keys (
    owner         TEXT   COLLATE "C" NOT NULL,
    name          TEXT   COLLATE "C" NOT NULL,
    request       BYTEA  NOT NULL CHECK (octet_length(request) = 32),
    created       BIGINT NOT NULL,
    cloud_id      UUID   NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    job_id        UUID   REFERENCES jobs (id) ON DELETE CASCADE,
    cloud_created BIGINT NOT NULL,
    job_created   BIGINT NOT NULL,
    PRIMARY KEY (owner, name)
);
CREATE INDEX idempotency_keys_by_age ON idempotency_keys (created);
CREATE INDEX idempotency_keys_by_cloud ON idempotency_keys (cloud_id);
CREATE INDEX idempotency_keys_by_job ON idempotency_keys (job_id);

-- What the readiness probe writes.
CREATE TABLE probes (
    id    BIGINT NOT NULL PRIMARY KEY CHECK (id = 1),
    beats BIGINT NOT NULL
);

-- The processes that serve or compute, and when each was last seen. What a job may need is judged by the largest that
-- computes, not by the one that is asked.
CREATE TABLE nodes (
    id            UUID   NOT NULL PRIMARY KEY,
    version       TEXT   NOT NULL,
    memory_budget BIGINT NOT NULL,
    threads       BIGINT NOT NULL,
    -- Jobs that it runs at one time; 0 for a node that only answers.
    workers       BIGINT NOT NULL,
    heartbeat     BIGINT NOT NULL
);

-- Files whose content was or is being moved here. One that is not finished is gone on with; two at a time there are not.
CREATE TABLE moves (
    source   TEXT   COLLATE "C" NOT NULL PRIMARY KEY,
    begun    BIGINT NOT NULL,
    finished BIGINT
);
