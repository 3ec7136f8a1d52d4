"""The service: queries, simulations, studies and playback over HTTP, with a page; `client` asks it from Python.

In: HTTP requests. Out: records as JSON or npz, jobs, problems after RFC 9457. `http` stands on `work`, and that on
`store`. `http.app.build` makes the application, `http.server.run` serves it. Nothing but the command line imports the
server; the client needs no web framework.
"""
