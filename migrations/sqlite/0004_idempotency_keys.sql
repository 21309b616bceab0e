-- Submissions that clients have named: the same name with the same request is answered with the same cloud and job.

CREATE TABLE idempotency_keys (
    -- Whose name it is: those of others are others.
    owner TEXT NOT NULL,
    -- As in the header Idempotency-Key.
    name TEXT NOT NULL,
    -- SHA-256 of the request: path, query and body.
    request BLOB NOT NULL CHECK (length(request) = 32),
    -- Milliseconds since the Unix epoch; names are forgotten after a day.
    created INTEGER NOT NULL,
    -- What the request was answered with. With the cloud or the job the name is forgotten too.
    cloud_id BLOB NOT NULL REFERENCES clouds (id) ON DELETE CASCADE,
    job_id BLOB REFERENCES jobs (id) ON DELETE CASCADE,
    cloud_created INTEGER NOT NULL,
    job_created INTEGER NOT NULL,
    PRIMARY KEY (owner, name)
) STRICT, WITHOUT ROWID;

CREATE INDEX idempotency_keys_by_age ON idempotency_keys (created);
CREATE INDEX idempotency_keys_by_cloud ON idempotency_keys (cloud_id);
CREATE INDEX idempotency_keys_by_job ON idempotency_keys (job_id);
