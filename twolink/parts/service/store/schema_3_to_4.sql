-- process: which one runs a job, until `beat` is long ago; tries: how often one began; cancel: it is to end.
ALTER TABLE jobs ADD COLUMN process TEXT DEFAULT '';
ALTER TABLE jobs ADD COLUMN beat REAL;
ALTER TABLE jobs ADD COLUMN tries INTEGER DEFAULT 0;
ALTER TABLE jobs ADD COLUMN cancel INTEGER DEFAULT 0;
-- Uploads that load, and the bytes they may take.
CREATE TABLE loading (id TEXT, process TEXT, owner TEXT, bytes INTEGER, beat REAL, PRIMARY KEY (id, process))
    WITHOUT ROWID;
-- Seconds of processor that owners have had, by day.
CREATE TABLE spent (owner TEXT, day TEXT, seconds REAL, PRIMARY KEY (owner, day)) WITHOUT ROWID;
PRAGMA user_version = 4;
