"""The attributes of ``samples.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class SamplesRecord(Record):
    """Range of point indices of each stratum, and the options with which points were drawn."""

    strata: dict[str, tuple[int, int]]
    law: dict
