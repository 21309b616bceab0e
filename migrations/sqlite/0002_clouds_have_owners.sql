-- no-transaction
-- Every cloud belongs to an owner: the name behind an API key, or nobody ('') where no key is asked for. The same
-- content from two owners is two clouds, so that neither learns of the other's.
--
-- A table's UNIQUE constraint goes only with the table. Dropping it must not cascade to the points, and foreign keys can
-- be switched off only outside of a transaction: this file brings its own (https://www.sqlite.org/lang_altertable.html,
-- "making other kinds of table schema changes"), and may run twice when the process dies right after it.
PRAGMA foreign_keys = OFF;
BEGIN IMMEDIATE;

CREATE TABLE clouds_with_owner (
    id              BLOB    NOT NULL PRIMARY KEY CHECK (length(id) = 16),
    owner           TEXT    NOT NULL,
    created         INTEGER NOT NULL,
    digest          BLOB    NOT NULL CHECK (length(digest) = 32),
    points          INTEGER NOT NULL CHECK (points > 0),
    dimension       INTEGER NOT NULL CHECK (dimension > 0),
    nonfinite       INTEGER NOT NULL,
    duplicates      INTEGER NOT NULL,
    bounding_box    TEXT    NOT NULL CHECK (json_valid(bounding_box)),
    coordinate_type TEXT    NOT NULL,
    fields          TEXT    NOT NULL CHECK (json_valid(fields)),
    faces           INTEGER NOT NULL,
    UNIQUE (owner, digest)
) STRICT;

INSERT INTO clouds_with_owner
SELECT id, '', created, digest, points, dimension, nonfinite, duplicates, bounding_box, coordinate_type, fields, faces
FROM clouds;

DROP TABLE clouds;
ALTER TABLE clouds_with_owner RENAME TO clouds;
CREATE INDEX clouds_by_owner ON clouds (owner, id);

COMMIT;
PRAGMA foreign_keys = ON;
