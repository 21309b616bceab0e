-- Rows per chunk of the job's bases: fewer for many bases, so that all bases of a chunk come to a few megabytes whatever
-- their number. Jobs from before this column, those that waited then too, have chunks of 8192 rows.
ALTER TABLE jobs ADD COLUMN chunk_points INTEGER NOT NULL DEFAULT 8192 CHECK (chunk_points > 0);
