-- A new database.
CREATE TABLE robots (
    id TEXT PRIMARY KEY, created REAL, used REAL, bytes INTEGER, description TEXT
) WITHOUT ROWID;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT, state TEXT, created REAL, started REAL, ended REAL, used REAL,
    bytes INTEGER DEFAULT 0, request TEXT, progress TEXT, problem TEXT, result TEXT
) WITHOUT ROWID;
CREATE INDEX jobs_by_state ON jobs (state);
PRAGMA user_version = 2;
