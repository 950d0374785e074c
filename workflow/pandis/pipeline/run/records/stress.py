"""The attributes of ``stress.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class StressRecord(Record):
    """Results of the stress suite for all fields of a mesh.

    Attributes
    ----------
    fields : dict of str to dict of str to dict
        Figures by field and question of `pandis.pipeline.judge.stress.suite.QUESTIONS`.
    failed : dict of str to list of str
        Failed questions, by field.
    proxies, proxies_failed : dict
        The same for `pandis.pipeline.judge.stress.suite.PROXY_QUESTIONS`, for the fields that have
        a proxy.
    controls : dict of str to list of str
        Failed questions, by control.
    skipped : dict of str to str
        Fields that were not tested, and why.
    device : dict
        See `pandis.pipeline.judge.stress.physical.Device`.
    size, stiffness : float
        m, N/m.
    """

    fields: dict[str, dict[str, dict]]
    failed: dict[str, list[str]]
    proxies: dict[str, dict[str, dict]]
    proxies_failed: dict[str, list[str]]
    controls: dict[str, list[str]]
    skipped: dict[str, str]
    device: dict
    size: float
    stiffness: float
