"""The kinds of fields: the only list of the folders of `pandis.pipeline.kinds`.

Kinds are loaded by name: planning needs only the names and options of each kind, and a stage needs
only the modules that it runs. `kind_module(kind, "file")` is the module ``file`` in a kind's
folder; `pandis.pipeline.run.job.provenance` treats such calls like imports.
"""

from importlib import import_module

#: Kinds by building cost, the cheapest first. Tables list fields in this order.
_NAMES = ("exact", "compact", "grid", "spline", "network", "paper")


def kind_module(kind, name):
    """Return a module of a kind's folder."""
    return import_module(f"pandis.pipeline.kinds.{kind}.{name}")


KINDS = {name: kind_module(name, "spec").KIND for name in _NAMES}


def build_task(kind, **options):
    """Return the options for building a field: `search` if a target is given, otherwise `task`."""
    model = KINDS[kind].search if "target" in options else KINDS[kind].task
    return model(kind=kind, **options)
