-- What the file of a cloud was called when it was first uploaded; of the owner's content with this digest there is one
-- cloud, so that there is one name.
ALTER TABLE clouds ADD COLUMN name TEXT;

-- Asked to be deleted while it ran: it goes with the end of its attempt, whatever ends it.
ALTER TABLE jobs ADD COLUMN delete_requested INTEGER NOT NULL DEFAULT 0 CHECK (delete_requested IN (0, 1));

CREATE TRIGGER jobs_deleted_at_their_end AFTER UPDATE OF state ON jobs
WHEN NEW.delete_requested = 1 AND NEW.state IN ('succeeded', 'failed', 'canceled')
BEGIN
    DELETE FROM jobs WHERE id = NEW.id;
END;
