"""The tasks of the worker processes that send sweeps to a Dask cluster. They may use the network."""

from twolink.service.sweep_tasks import sweep

NETWORK = True
TASKS = {"sweep": sweep}
