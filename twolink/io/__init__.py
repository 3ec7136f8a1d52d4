"""Files: tables of named columns, texts within a limit, files written whole or not at all."""
