"""Sweeps: many runs of a scene, on one machine or a cluster, in a store that survives what stops them.

In: a scene, what varies, and where the results go. Out: an `xarray.Dataset` in a Zarr store, with error bar and status
of every run; figures and tables of it. This room knows no command line and no service.
"""

from twolink.sweeps.design import make_design, planned_runs
from twolink.sweeps.results import SweepStatus, plot_sweep, sweep_frame, sweep_status, write_sweep_table
from twolink.sweeps.runs import run_scene
from twolink.sweeps.sweeping import bundled_studies, load_study, open_sweep, run_study, study_of, sweep

__all__ = ["SweepStatus", "bundled_studies", "load_study", "make_design", "open_sweep", "planned_runs", "plot_sweep",
           "run_scene", "run_study", "study_of", "sweep", "sweep_frame", "sweep_status",
           "write_sweep_table"]  # fmt: skip
