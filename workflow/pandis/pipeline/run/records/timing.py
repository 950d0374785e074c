"""The attributes of ``timing.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class TimingRecord(Record):
    """How long all fields take: µs by what was timed, by field; the machine."""

    fields: dict[str, dict[str, float | str]]
    machine: dict
    reproducible: bool = False
