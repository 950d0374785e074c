"""Verified, reproducible force fields for haptic rendering, from any triangle mesh.

The public interface is ``__all__`` and every package of `pandis.bridges`. All other modules are
internal and may change. Names are imported on first use, so that ``import pandis`` costs nothing.
"""

from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pandis.base.errors import ArtifactError, PandisError, RepairError
    from pandis.pipeline.api.checking import Report, check
    from pandis.pipeline.api.comparing import Comparison, compare
    from pandis.pipeline.api.datasets import label_meshes
    from pandis.pipeline.api.fields import field
    from pandis.pipeline.api.labelling import Labels, labels, signed_distance
    from pandis.pipeline.api.meshes import Mesh, repair
    from pandis.pipeline.dataset.store import LabelStore
    from pandis.runtime.contact import NativeContact as Contact
    from pandis.runtime.contact import TouchedScene, Touches
    from pandis.runtime.contact.surfaces import Material, Texture
    from pandis.runtime.field import NativeAnswer as Answer
    from pandis.runtime.field import NativeField as Field
    from pandis.runtime.field.handover import SharedField
    from pandis.runtime.field.moving import MovingField
    from pandis.runtime.scene import NativeScene as Scene
    from pandis.runtime.scene import Placed
    from pandis.runtime.scene.poses import Poses

__version__ = "0.2.0"

__all__ = [
    "Answer", "ArtifactError", "Comparison", "Contact", "Field", "LabelStore", "Labels",
    "Material", "Mesh", "MovingField", "PandisError", "Placed", "Poses", "RepairError",
    "Report", "Scene", "SharedField", "Texture", "TouchedScene", "Touches", "check", "compare",
    "field", "label_meshes", "labels", "load", "repair", "sample", "signed_distance",
]  # fmt: skip

#: Module and name in it of each public name that is imported on first use.
_PLACES = {
    "Answer": "runtime.field:NativeAnswer",
    "ArtifactError": "base.errors:ArtifactError",
    "Comparison": "pipeline.api.comparing:Comparison",
    "Contact": "runtime.contact:NativeContact",
    "Field": "runtime.field:NativeField",
    "LabelStore": "pipeline.dataset.store:LabelStore",
    "Labels": "pipeline.api.labelling:Labels",
    "Material": "runtime.contact.surfaces:Material",
    "Mesh": "pipeline.api.meshes:Mesh",
    "MovingField": "runtime.field.moving:MovingField",
    "PandisError": "base.errors:PandisError",
    "Placed": "runtime.scene:Placed",
    "Poses": "runtime.scene.poses:Poses",
    "RepairError": "base.errors:RepairError",
    "Report": "pipeline.api.checking:Report",
    "Scene": "runtime.scene:NativeScene",
    "SharedField": "runtime.field.handover:SharedField",
    "Texture": "runtime.contact.surfaces:Texture",
    "TouchedScene": "runtime.contact:TouchedScene",
    "Touches": "runtime.contact:Touches",
    "check": "pipeline.api.checking:check",
    "compare": "pipeline.api.comparing:compare",
    "field": "pipeline.api.fields:field",
    "label_meshes": "pipeline.api.datasets:label_meshes",
    "labels": "pipeline.api.labelling:labels",
    "repair": "pipeline.api.meshes:repair",
    "signed_distance": "pipeline.api.labelling:signed_distance",
}


def load(path: str | PathLike[str]) -> "Field":
    """Return the field of a ``.pandis`` file: ``load("bunny.pandis").force(points, k=400)``.

    The C code is compiled on first use, with the system's compiler.

    Raises
    ------
    ArtifactError
        The file cannot be read, is damaged or has an unsupported version.
    """
    from pandis.runtime.field import NativeField

    return NativeField(path)


def sample(shape: str, *sizes: float | int) -> "Field":
    """Return the field of a closed-form shape, for experiments: ``sample("torus", 0.03, 0.01)``.

    See `pandis.runtime.samples.sample`.
    """
    from pandis.runtime import samples

    return samples.sample(shape, *sizes)


def __getattr__(name: str) -> object:
    """Import a public class or function on first access."""
    if name not in _PLACES:
        raise AttributeError(f"module 'pandis' has no attribute {name!r}")
    module, _, attribute = _PLACES[name].partition(":")
    try:
        globals()[name] = getattr(import_module(f"pandis.{module}"), attribute)
    except ModuleNotFoundError as error:
        if str(error.name).partition(".")[0] == "pandis":
            raise
        raise ModuleNotFoundError(
            f"pandis.{name} needs the package {error.name}: pip install 'pandis-fields[make]'",
            name=error.name,
        ) from None
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
