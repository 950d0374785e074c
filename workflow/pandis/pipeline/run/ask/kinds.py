"""The kinds of fields: the one list of the folders of `pandis.pipeline.kinds`.

Planning reads each folder's names alone, and a stage loads of the kinds that it is asked for the
modules that it runs: so they are loaded by name. `kind_module(kind, "file")` is the module ``file``
of a kind's folder; `pandis.pipeline.run.job.provenance` follows it as it follows an import.
"""

from importlib import import_module

#: From cheap to build to dear; tables list fields in this order.
_NAMES = ("exact", "compact", "grid", "spline", "network", "paper")


def kind_module(kind, name):
    """Return a module of a kind's folder."""
    return import_module(f"pandis.pipeline.kinds.{kind}.{name}")


KINDS = {name: kind_module(name, "spec").KIND for name in _NAMES}


def build_task(kind, **options):
    """Return what building a field is asked as its model: what a stage gets back as `options`."""
    model = KINDS[kind].search if "target" in options else KINDS[kind].task
    return model(kind=kind, **options)
