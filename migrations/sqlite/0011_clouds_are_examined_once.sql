-- What admission looks at of a cloud, found at its upload (JSON); absent in rows from before this column, whose clouds are
-- loaded and looked at again.
ALTER TABLE clouds ADD COLUMN examined TEXT CHECK (examined IS NULL OR json_valid(examined));
