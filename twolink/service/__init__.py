"""The service: queries, experiments and playback over HTTP. `twolink serve` starts it; `app.build` makes it."""
