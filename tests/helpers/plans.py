"""What a plan of config/fast.yaml consists of, and changes of that configuration."""

import yaml

FAST = "config/fast.yaml"
DOWNSTREAM = {"evaluate", "timing", "validate"}
#: What a change of a field reaches; the stress suite needs no path.
DEPENDENT = DOWNSTREAM | {"stress"}
LAST = {("summary", None), ("report", None)}
BOTH = ("sphere", "torus")


def native(*names, meshes=BOTH):
    """The jobs that write files for pandis.h."""
    return {("export_native", mesh, name) for mesh in meshes for name in names}


def graphs(*names, meshes=BOTH):
    """The jobs that write graphs, and of networks programs, too."""
    return {
        ("export_graph", mesh, name, ending)
        for mesh in meshes
        for name in names
        for ending in ("onnx", "pt2")
        if ending == "onnx" or name.startswith("pandis")
    }


FIELDS = ("exact", "trilinear-24", "pandis-exact")
EVERYTHING = (
    {(stage, mesh) for stage in ("mesh", "sample", "trajectory", *DEPENDENT) for mesh in BOTH}
    | {("train", mesh, "pandis-exact") for mesh in BOTH}
    | {("bake", mesh, "grid-force-24") for mesh in BOTH}
    | graphs("trilinear-24", "pandis-exact")
    | native(*FIELDS)
    | LAST
)


def change(folder, **sections):
    """Merge sections into the configuration file."""
    path = folder / FAST
    config = yaml.safe_load(path.read_text())
    for key, value in sections.items():
        if isinstance(value, dict):
            config[key] = config.get(key, {}) | value
        else:
            config[key] = value
    path.write_text(yaml.safe_dump(config))


def all_of(*stages, meshes=("sphere", "torus")):
    return {(stage, mesh) for stage in stages for mesh in meshes}
