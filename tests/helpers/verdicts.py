"""Records of a validation that has found nothing amiss, to be changed where a test wants it."""

from pandis.pipeline.run.records.hardware import (
    DeviceVerdict,
    FieldVerdict,
    HardwareRecord,
    WallVerdict,
)

TIMES = dict.fromkeys(("p50", "p99", "p99.9", "max"), 4.0)
WHOLE = WallVerdict(
    missing=0.0, felt=0.0, judged=1.0, left_out=0.0, strongly_felt=0.0, patch=0.0, p99_n=0.0,
    points=4000, pressed_missing=0, ghost_n=0.0, holds=True,
)  # fmt: skip
PRESSED = DeviceVerdict(
    hand=3.0, hands={"0.3": 1e3}, released_n_m=100.0, stiffness=400.0, strongest_n=0.5,
    steepest_n_per_ms=0.1, cut=0, energy_j=0.0, quiet=1.0, unarmed=0, reach_m=0.05, ended="",
    within_limits=True, passive=True, safe_n_m=1e3, limited_by="", device="touch",
    pressed_missing=0, holds=True, verdict="pass", sentence="",
)  # fmt: skip
SOUND = FieldVerdict(
    ticks=50, compute_us=TIMES, lateness_us=TIMES, late_share=0.0, miss_share=0.0, misses=0,
    longest_run_of_misses=0, agreement=0.0, agrees=True, in_time=True, punctual=True, walls=WHOLE,
    verdict="pass", sentence="", devices={"touch": PRESSED}, advice="", sha256="",
    proxy=None, no_proxy="", attached=None,
)  # fmt: skip


def changed(record, **changes):
    """Return a record with some of its fields changed."""
    return record.model_copy(update=changes)


def validated(fields, **changes):
    """Return the record of a mesh: of these fields, by name."""
    record = HardwareRecord(
        statement="", devices={}, machine={}, locked=False, realtime=False, rate=1000.0,
        deadline=8e-4, size=0.1, stiffness=400.0, contact="proxy", newtons=22.2,
        clock_alone_us=TIMES, clock_alone_late_share=0.0, fields=fields,
    )  # fmt: skip
    return changed(record, **changes)
