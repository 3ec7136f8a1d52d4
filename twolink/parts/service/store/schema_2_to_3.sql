-- What there is has an owner without a name.
ALTER TABLE robots ADD COLUMN owner TEXT DEFAULT '';
ALTER TABLE jobs ADD COLUMN owner TEXT DEFAULT '';
CREATE TABLE secrets AS SELECT hex(randomblob(16)) AS ids;
PRAGMA user_version = 3;
