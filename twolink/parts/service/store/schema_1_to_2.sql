-- Results of version 1 have another form: their jobs can be run again.
DROP INDEX jobs_by_state;
ALTER TABLE jobs RENAME TO jobs_1;
CREATE TABLE jobs (
    id TEXT PRIMARY KEY, kind TEXT, state TEXT, created REAL, started REAL, ended REAL, used REAL,
    bytes INTEGER DEFAULT 0, request TEXT, progress TEXT, problem TEXT, result TEXT
) WITHOUT ROWID;
CREATE INDEX jobs_by_state ON jobs (state);
INSERT INTO jobs (id, kind, state, created, started, ended, used, bytes, request)
    SELECT id, kind, 'interrupted', created, started, ended, used, bytes, request FROM jobs_1;
DROP TABLE jobs_1;
PRAGMA user_version = 2;
