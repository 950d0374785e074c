"""The attributes of ``samples.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class SamplesRecord(Record):
    """Where each stratum lies among the points, and the options that they were drawn by."""

    strata: dict[str, tuple[int, int]]
    law: dict
