"""What planning knows of a kind of field: names and options alone, no code that answers a query."""

from typing import ClassVar, NamedTuple

from pandis.pipeline.run.ask.targets import DeviceOptions, GridTarget
from pandis.pipeline.run.ask.values import Options

#: A size that is searched, and the field that a budget alone describes.
AUTO = "auto"


class FieldSpec(NamedTuple):
    """One entry of a configuration's ``fields``.

    Attributes
    ----------
    name : str
        As the user wrote it.
    kind : str
        A key of `pandis.pipeline.run.ask.kinds.KINDS`, or AUTO: the artifact says which.
    form : str
        Which field of its kind it is, as tables of times, targets and colours call it.
    artifact : str
        Stem of the artifact that holds it: ``results/{mesh}/{artifact}.zarr.zip``.
    size : int, "auto" or None
        Nodes per axis of a grid; bits of a compact mesh.
    exports : tuple of str
        Endings of its files under ``results/{mesh}/export/``, except ``.pandis``.
    native : bool
        It has a file for ``pandis.h``, ``results/{mesh}/export/{name}.pandis``.
    distances : bool
        It knows distances outside of the surface.
    through : FieldSpec or None
        The field that a contact point is tracked on.
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
    """Build what fields of a kind are answered from."""

    kind: str


class SearchTask(BuildTask):
    """Search the size of a field, and build it; the band is that of grids (unit frame)."""

    form: str
    target: GridTarget
    device: DeviceOptions
    band: tuple[float, float]
    seed: int


class Kind:
    """A kind of field, as planning sees it; `pandis.pipeline.kinds` says what else it has.

    Attributes
    ----------
    name : str
        That of its folder.
    help : str
        How its fields are written, for the table of options.
    forms : tuple of str
        In the order of tables.
    examples : tuple of str
        Names of fields that an error lists as known.
    sized : tuple of str
        Forms of which `bake.auto` may name a target.
    targets : dict of str to dict
        Targets of these, what holds where the user names none.
    chosen : bool
        `fields: auto` tries it; the list of kinds goes from cheap to dear.
    regions : bool
        Its files say which material a place is made of.
    colours : dict of str to str
        In figures, by form.
    growth : float
        The least power of its work that the time of a query grows with beyond the table of times.
    task, search : type
        The models of what building it is asked: of a given size, and of one that is searched.
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
            Returns that of another name, of any kind.

        Raises
        ------
        ValueError
            The name is of this kind, but its size cannot be.
        """
        return None

    def parse_recipe(self, name):
        """Return the `FieldSpec` of a recipe's name, for a kind that is trained; else None."""
        return None

    def options(self, job, spec):
        """Return what building an artifact is asked: a `BuildTask`.

        Parameters
        ----------
        job : pandis.pipeline.run.plan.stages.PlannedJob
        spec : FieldSpec
            A field that the artifact holds.
        """
        if spec.size != AUTO:
            return self.sized_options(job, spec)
        target = job.entry.bake.auto[spec.form]
        return SearchTask(
            kind=self.name, form=spec.form, target=target, device=job.scale_of(target),
            band=job.band, seed=job.seed,
        )  # fmt: skip

    def sized_options(self, job, spec):
        """Return what building an artifact of a given size is asked; by default its kind alone."""
        return self.task(kind=self.name)

    def unused(self, options):
        """Return modules that a stage imports but, with these options, never runs."""
        return []

    def work(self, size):
        """Return what the time of a query follows, by the size in the table of times."""
        return size

    def stream(self, spec):
        """Return the names that the seed of building an artifact is drawn by."""
        return (f"bake_{self.name}",)


def check_size(name, size, smallest, largest, unit):
    """Return the size in a field's name as a number, or raise a ValueError with its limits."""
    if not smallest <= int(size) <= largest:
        raise ValueError(f"{name}: it has {smallest} to {largest} {unit}")
    return int(size)
