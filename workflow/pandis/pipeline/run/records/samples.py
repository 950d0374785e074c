"""The attributes of ``samples.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class SamplesRecord(Record):
    """Range of each stratum among the points, and the options they were drawn with."""

    strata: dict[str, tuple[int, int]]
    law: dict
