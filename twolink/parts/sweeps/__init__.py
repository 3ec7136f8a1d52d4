"""Sweeps: many runs of a scene, on one machine or a cluster, in a store that survives what stops them.

In: a scene, what varies, and where the results go. Out: an `xarray.Dataset` in a Zarr store, with error bar and status
of every run; figures and tables of it. This room knows no command line and no service.
"""
