-- The owner of the cloud, kept with the job so that listings need not look through the jobs of others.
ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';
-- Bytes that its analysis is estimated to take; 0 for jobs older than the estimate, which are claimed whatever is free.
ALTER TABLE jobs ADD COLUMN memory INTEGER NOT NULL DEFAULT 0 CHECK (memory >= 0);
-- Not claimed before: a job whose result could not be stored waits for the disk to have room again.
ALTER TABLE jobs ADD COLUMN not_before INTEGER NOT NULL DEFAULT 0;

CREATE INDEX jobs_by_owner ON jobs (owner, id);
-- For the retention of jobs.
CREATE INDEX jobs_by_end ON jobs (finished) WHERE finished IS NOT NULL;
