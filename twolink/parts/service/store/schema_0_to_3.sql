-- A new database.
CREATE TABLE robots (
    id TEXT PRIMARY KEY, created REAL, used REAL, bytes INTEGER, description TEXT, owner TEXT
) WITHOUT ROWID;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT, state TEXT, created REAL, started REAL, ended REAL, used REAL,
    bytes INTEGER DEFAULT 0, owner TEXT, request TEXT, progress TEXT, problem TEXT, result TEXT
) WITHOUT ROWID;
CREATE INDEX jobs_by_state ON jobs (state);
CREATE TABLE secrets AS SELECT hex(randomblob(16)) AS ids;
PRAGMA user_version = 3;
