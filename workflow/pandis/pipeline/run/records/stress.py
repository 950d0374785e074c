"""The attributes of ``stress.zarr.zip``."""

from pandis.pipeline.run.records.record import Record


class StressRecord(Record):
    """What all fields do to a device and a hand.

    Attributes
    ----------
    fields : dict of str to dict of str to dict
        By field and question of `pandis.pipeline.judge.stress.suite.QUESTIONS`: its figures.
    failed : dict of str to list of str
        By field: the questions that it failed.
    proxies, proxies_failed : dict
        Likewise of `pandis.pipeline.judge.stress.suite.PROXY_QUESTIONS`, of the fields that have a
        proxy.
    controls : dict of str to list of str
        By control.
    skipped : dict of str to str
        By field: why it was not asked.
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
