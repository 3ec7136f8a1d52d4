"""The command line: one file a command group; `app` assembles them. Nothing else imports this room."""
