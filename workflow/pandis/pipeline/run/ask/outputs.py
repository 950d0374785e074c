"""Outputs of each stage for a mesh: paths in the mesh's folder, each with its rule's wildcards."""

from pandis.pipeline.run.ask.catalogue import AUTO, parse_field
from pandis.pipeline.run.ask.sourcing import url_extension


def field_specs(entry):
    """Return the FieldSpec of every field of a mesh's options."""
    return [parse_field(name, entry.train) for name in entry.fields]


def field_holders(entry):
    """Return one FieldSpec for each artifact that contains a field, except the mesh itself.

    A tracked contact point is represented by the field on which it is tracked.
    """
    specs = [spec.through or spec for spec in field_specs(entry)]
    return [s for s in {s.artifact: s for s in specs}.values() if s.artifact != "mesh"]


def one_file(name):
    """Return a function that returns the file ``name`` for every mesh."""
    return lambda entry: [(name, {})]


def source(entry):
    """Return the file to which a mesh from a URL is downloaded."""
    extension = url_extension(entry.source)
    return [(f"source.{extension}", {"extension": extension})] if extension else []


def samples(entry):
    """Return the file of samples, if a field is trained on them."""
    return [("samples.zarr.zip", {})] if models(entry) else []


def models(entry):
    """Return the artifacts that training writes, one per learned field."""
    specs = [spec for spec in field_holders(entry) if spec.learned]
    return [(f"{spec.artifact}.zarr.zip", {"recipe": spec.name}) for spec in specs]


def choice(entry):
    """Return the artifact of `fields: auto`, if that is configured."""
    return [(f"{s.artifact}.zarr.zip", {}) for s in field_holders(entry) if s.kind == AUTO]


def baked(entry):
    """Return the artifacts that are built from the mesh alone."""
    specs = [spec for spec in field_holders(entry) if spec.kind != AUTO and not spec.learned]
    return [(f"{spec.artifact}.zarr.zip", {"artifact": spec.artifact}) for spec in specs]


def graphs(entry):
    """Return graphs and programs for other runtimes."""
    return [
        (f"export/{spec.name}.{ending}", {"field": spec.name, "ending": ending})
        for spec in field_specs(entry)
        for ending in spec.exports
        if ending != "vti"
    ]


def images(entry):
    """Return the VTK images of grids, if `bake.vti` requests them."""
    shown = [spec for spec in field_specs(entry) if "vti" in spec.exports and entry.bake.vti]
    return [(f"export/{spec.name}.vti", {"field": spec.name}) for spec in shown]


def native(entry):
    """Return the files for ``pandis.h``."""
    files = [spec for spec in field_specs(entry) if spec.native]
    return [(f"export/{spec.name}.pandis", {"field": spec.name}) for spec in files]


def distance_fields(entry):
    """Return a mesh's fields that have a file and may have distances outside; `auto` counts."""
    return [spec for spec in field_specs(entry) if spec.native and spec.distances]


def also(kind, name):
    """Return a function that returns a file for another program if the options list its kind."""
    return lambda entry: [(name, {})] if kind in entry.export.also else []


def hardware(entry):
    """Return the files of the hardware validation."""
    return [("hardware.zarr.zip", {}), ("hardware.json", {})]
