"""What each stage makes of a mesh: paths below the mesh's folder, and the wildcards of its rule."""

from pandis.pipeline.run.ask.catalogue import AUTO, COMPACT, GRID_FIELDS, parse_field
from pandis.pipeline.run.ask.sourcing import url_extension


def field_specs(entry):
    """Return the FieldSpec of every field of a mesh's options."""
    return [parse_field(name, entry.train) for name in entry.fields]


def field_holders(entry):
    """Return one FieldSpec for each artifact that holds a field, except the mesh itself.

    The field that a contact point's runs through is among them.
    """
    specs = [spec.through or spec for spec in field_specs(entry)]
    return [s for s in {s.artifact: s for s in specs}.values() if s.artifact != "mesh"]


def one_file(name):
    """Return the function that returns one file that every mesh has."""
    return lambda entry: [(name, {})]


def source(entry):
    """Return the file that a mesh is downloaded to."""
    extension = url_extension(entry.source)
    return [(f"source.{extension}", {"extension": extension})] if extension else []


def networks(entry):
    """Return the FieldSpec of every network that is trained."""
    return [spec for spec in field_holders(entry) if spec.kind == "network"]


def samples(entry):
    """Return the samples, where a network learns from them."""
    return [("samples.zarr.zip", {})] if networks(entry) else []


def models(entry):
    """Return the trained networks."""
    return [(f"{s.artifact}.zarr.zip", {"recipe": s.name}) for s in networks(entry)]


def programs(entry):
    """Return the graphs and programs of networks."""
    asked = [spec for spec in field_specs(entry) if spec.kind == "network"]
    return [
        (f"export/{spec.name}.{ending}", {"recipe": spec.name})
        for spec in asked
        for ending in ("onnx", "pt2")
    ]


def holders(wanted, wildcards=lambda spec: {}):
    """Return the function that returns the artifacts that hold the wanted fields."""
    return lambda entry: [
        (f"{spec.artifact}.zarr.zip", wildcards(spec))
        for spec in field_holders(entry)
        if wanted(spec)
    ]


def is_sized(spec):
    """Tell whether a field is a grid of a given size."""
    return spec.kind in GRID_FIELDS and spec.size != AUTO


def is_dense(spec):
    """Tell whether it is one that stores every node."""
    return is_sized(spec) and GRID_FIELDS[spec.kind] != "spline"


def is_spline(spec):
    """Tell whether it is a spline of a given size."""
    return is_sized(spec) and GRID_FIELDS[spec.kind] == "spline"


def is_searched(spec):
    """Tell whether it is a grid whose size is searched."""
    return spec.kind in GRID_FIELDS and spec.size == AUTO


def is_compact(spec):
    """Tell whether it is a compact mesh of given bits."""
    return spec.kind == COMPACT and spec.size != AUTO


def grids(entry):
    """Return the FieldSpec of every grid."""
    return [spec for spec in field_specs(entry) if spec.kind in GRID_FIELDS]


def graphs(entry):
    """Return the graphs of grids."""
    drawn = [spec for spec in grids(entry) if "onnx" in spec.exports]
    return [(f"export/{spec.name}.onnx", {"field": spec.name}) for spec in drawn]


def images(entry):
    """Return the images of grids."""
    shown = grids(entry) if entry.bake.vti else []
    return [(f"export/{spec.name}.vti", {"field": spec.name}) for spec in shown]


def native(entry):
    """Return the files for ``pandis.h``."""
    files = [spec for spec in field_specs(entry) if spec.native]
    return [(f"export/{spec.name}.pandis", {"name": spec.name}) for spec in files]


def distance_fields(entry):
    """Return the fields of a mesh that have a file and may know distances; of `auto` it says."""
    forces = ("force", "force-box")
    files = [spec for spec in field_specs(entry) if spec.native]
    return [spec for spec in files if GRID_FIELDS.get(spec.kind) not in forces]


def also(kind, name):
    """Return the function that returns a file for another program if its kind is asked for."""
    return lambda entry: [(name, {})] if kind in entry.export.also else []


def hardware(entry):
    """Return what the validation writes."""
    return [("hardware.zarr.zip", {}), ("hardware.json", {})]
