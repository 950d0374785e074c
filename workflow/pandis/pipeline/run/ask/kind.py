"""Kinds of fields for planning: their names and options, without the code for queries."""

from typing import ClassVar, NamedTuple

from pandis.pipeline.run.ask.targets import DeviceOptions, GridTarget
from pandis.pipeline.run.ask.values import Options

#: Stands for a size that is searched for; also the name of the field described by `budget`.
AUTO = "auto"


class FieldSpec(NamedTuple):
    """One entry of a configuration's ``fields``.

    Attributes
    ----------
    name : str
        As the user wrote it.
    kind : str
        A key of `pandis.pipeline.run.ask.kinds.KINDS`; AUTO if only the artifact states the kind.
    form : str
        Variant within its kind, as named in the tables of times, targets and colours.
    artifact : str
        Stem of the artifact that contains it: ``results/{mesh}/{artifact}.zarr.zip``.
    size : int, "auto" or None
        Nodes per axis of a grid; bits of a compact mesh.
    exports : tuple of str
        Endings of its files under ``results/{mesh}/export/``, except ``.pandis``.
    native : bool
        Whether it has a file for ``pandis.h``, ``results/{mesh}/export/{name}.pandis``.
    distances : bool
        Whether it has distances outside the surface.
    through : FieldSpec or None
        The field on which a contact point is tracked; None for all other fields.
    """

    name: str
    kind: str
    form: str
    artifact: str
    size: int | str | None = None
    exports: tuple[str, ...] = ()
    native: bool = True
    distances: bool = True
    through: "FieldSpec | None" = None

    @property
    def learned(self):
        """Whether it is trained on samples."""
        return self.artifact.startswith("model-")


class BuildTask(Options):
    """Build the data of fields of one kind."""

    kind: str


class SearchTask(BuildTask):
    """Find a field's size and build the field; ``band``: depth and height of grids (unit frame)."""

    form: str
    target: GridTarget
    device: DeviceOptions
    band: tuple[float, float]
    seed: int


class Kind:
    """The names and options of a kind of field; `pandis.pipeline.kinds` contains its code.

    Attributes
    ----------
    name : str
        Name of its folder.
    help : str
        Notation of its field names, for the table of options.
    forms : tuple of str
        Forms of its fields, in the order in which tables list them.
    examples : tuple of str
        Field names that the message about an unknown field lists.
    sized : tuple of str
        Forms for which `bake.auto` may set a target.
    targets : dict of str to dict
        Default targets, by form.
    chosen : bool
        Whether `fields: auto` tries it. Kinds are tried in the order of `KINDS`, cheapest first.
    regions : bool
        Whether its files state the material at each point of the surface.
    colours : dict of str to str
        Colours in figures, by form.
    growth : float
        Beyond the largest size in the table of times, a query's time is assumed to grow at least
        in proportion to its work raised to this power.
    task, search : type
        Models of the options for building it: with a given size, and with a size to search for.
    """

    name = help = ""
    forms, examples, sized = (), (), ()
    targets: ClassVar = {}
    colours: ClassVar = {}
    chosen = regions = False
    growth = 0.0
    task, search = BuildTask, SearchTask

    def parse(self, name, parse):
        """Return the `FieldSpec` of a field's name; None if the field is of another kind.

        Parameters
        ----------
        name : str
        parse : callable
            Returns the `FieldSpec` of another name, of any kind.

        Raises
        ------
        ValueError
            The name is of this kind, but its size is out of range.
        """
        return None

    def parse_recipe(self, name):
        """Return the `FieldSpec` of a recipe's name; None if the kind is not trained."""
        return None

    def options(self, job, spec):
        """Return the options for building an artifact: a `BuildTask`.

        Parameters
        ----------
        job : pandis.pipeline.run.plan.stages.PlannedJob
        spec : FieldSpec
            A field that the artifact contains.
        """
        if spec.size != AUTO:
            return self.sized_options(job, spec)
        target = job.entry.bake.auto[spec.form]
        return SearchTask(
            kind=self.name, form=spec.form, target=target, device=job.scale_of(target),
            band=job.band, seed=job.seed,
        )  # fmt: skip

    def sized_options(self, job, spec):
        """Return the options for building an artifact of a given size; by default, only `kind`."""
        return self.task(kind=self.name)

    def unused(self, options):
        """Return the modules that a stage imports but does not run with these options."""
        return []

    def work(self, size):
        """Return the work that determines a query's time. Sizes are as in the table of times."""
        return size

    def stream(self, spec):
        """Return the names from which the seed for building an artifact is derived."""
        return (f"bake_{self.name}",)


def check_size(name, size, limits, *, unit):
    """Return the size in a field's name as a number. Raise a ValueError if it is out of range."""
    smallest, largest = limits
    if not smallest <= int(size) <= largest:
        raise ValueError(f"{name}: it must have {smallest} to {largest} {unit}")
    return int(size)
