-- The queue serves owners in turn: next is the one who was served longest ago. `turn` counts claims, not time, so that a
-- clock set back changes nothing.
CREATE TABLE turns (
    owner TEXT    NOT NULL PRIMARY KEY,
    turn  INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX jobs_waiting ON jobs (owner, id) WHERE state = 'queued';

-- Bytes that a cloud's or a result's numbers take; of a job without a result, those that its result will take.
ALTER TABLE clouds ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0 CHECK (bytes >= 0);
UPDATE clouds SET bytes = (SELECT coalesce(sum(length(data)), 0) FROM cloud_chunks c WHERE c.cloud_id = clouds.id);
ALTER TABLE jobs ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0 CHECK (bytes >= 0);
UPDATE jobs SET bytes = (SELECT coalesce(sum(length(data)), 0) FROM basis_chunks b WHERE b.job_id = jobs.id)
                      + (SELECT coalesce(sum(length(data)), 0) FROM array_chunks a WHERE a.job_id = jobs.id)
    WHERE state = 'succeeded';

-- SHA-256 of what is not an array: of the report's text, of a cloud's description, of a function's name and energy. Absent
-- in rows from before these columns, which are not checked.
ALTER TABLE jobs ADD COLUMN report_checksum BLOB CHECK (report_checksum IS NULL OR length(report_checksum) = 32);
ALTER TABLE clouds ADD COLUMN checksum BLOB CHECK (checksum IS NULL OR length(checksum) = 32);
ALTER TABLE coefficients ADD COLUMN head_checksum BLOB CHECK (head_checksum IS NULL OR length(head_checksum) = 32);

-- The report has them; nobody read these.
ALTER TABLE bases DROP COLUMN eigenvalue;
ALTER TABLE bases DROP COLUMN raw_eigenvalue;
ALTER TABLE bases DROP COLUMN residual;
