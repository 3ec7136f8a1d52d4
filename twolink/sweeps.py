"""Public names of sweeps; the part is `twolink.parts.sweeps`."""

from twolink.parts.sweeps.design import make_design, planned_runs
from twolink.parts.sweeps.results import SweepStatus, plot_sweep, sweep_frame, sweep_status, write_sweep_table
from twolink.parts.sweeps.runs import run_scene
from twolink.parts.sweeps.sweeping import bundled_studies, landing, load_study, open_sweep, run_study, study_of, sweep

__all__ = ["SweepStatus", "bundled_studies", "landing", "load_study", "make_design", "open_sweep", "planned_runs",
           "plot_sweep", "run_scene", "run_study", "study_of", "sweep", "sweep_frame", "sweep_status",
           "write_sweep_table"]  # fmt: skip
