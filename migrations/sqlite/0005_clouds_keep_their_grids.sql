-- Scales and offsets of x, y and z in a file of scaled integers (LAS, LAZ), as JSON; null for other files. Coordinates
-- that lie on them are written on them again, bit for bit.
ALTER TABLE clouds ADD COLUMN grids TEXT CHECK (grids IS NULL OR json_valid(grids));
