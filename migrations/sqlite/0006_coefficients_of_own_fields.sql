-- Coefficients of the cloud's coordinates and fields in a job's bases, in this order: `numbers` are little-endian doubles,
-- one per basis, `energy` is the whole function's. Jobs from before this table have none.
CREATE TABLE coefficients (
    job_id   BLOB    NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    place    INTEGER NOT NULL,
    name     TEXT    NOT NULL,
    energy   REAL    NOT NULL,
    checksum BLOB    NOT NULL CHECK (length(checksum) = 32),
    numbers  BLOB    NOT NULL,
    PRIMARY KEY (job_id, place)
) STRICT, WITHOUT ROWID;
