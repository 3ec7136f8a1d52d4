-- Version 4, of processes that may start at the same time.
SELECT pg_advisory_xact_lock(20264);
CREATE TABLE IF NOT EXISTS robots (
    id TEXT PRIMARY KEY, created DOUBLE PRECISION, used DOUBLE PRECISION, bytes BIGINT, description TEXT, owner TEXT
);
CREATE TABLE IF NOT EXISTS jobs (
    id TEXT PRIMARY KEY, kind TEXT, state TEXT, created DOUBLE PRECISION, started DOUBLE PRECISION,
    ended DOUBLE PRECISION, used DOUBLE PRECISION, bytes BIGINT DEFAULT 0, owner TEXT, request TEXT, progress TEXT,
    problem TEXT, result TEXT, process TEXT DEFAULT '', beat DOUBLE PRECISION, tries INTEGER DEFAULT 0,
    cancel INTEGER DEFAULT 0
);
CREATE INDEX IF NOT EXISTS jobs_by_state ON jobs (state);
CREATE TABLE IF NOT EXISTS loading (
    id TEXT, process TEXT, owner TEXT, bytes BIGINT, beat DOUBLE PRECISION, PRIMARY KEY (id, process)
);
CREATE TABLE IF NOT EXISTS spent (owner TEXT, day TEXT, seconds DOUBLE PRECISION, PRIMARY KEY (owner, day));
CREATE TABLE IF NOT EXISTS secrets (version INTEGER, ids TEXT, one INTEGER PRIMARY KEY DEFAULT 1);
INSERT INTO secrets VALUES (4, gen_random_uuid()::text) ON CONFLICT DO NOTHING;
