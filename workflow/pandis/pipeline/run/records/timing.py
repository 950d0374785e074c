"""The attributes of ``timing.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class TimingRecord(Record):
    """Query times of all fields (µs, by field and measurement), and the machine."""

    fields: dict[str, dict[str, float | str]]
    machine: dict
    reproducible: bool = False
