-- What the file said beside its points, JSON: notes of the reader, header and records of a LAS file.
ALTER TABLE clouds ADD COLUMN origin TEXT CHECK (origin IS NULL OR json_valid(origin));
