"""Options of contact: what a surface feels like, and by what a device is driven."""

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from pandis.pipeline.run.ask.values import Options, Positive

#: Length of a texture over its largest height: then a slope is at most 0.65.
_STEEPEST = 5


class TextureOptions(Options):
    """A height over the surface, which a proxy feels."""

    kind: Literal["noise", "waves", "smooth"] = Field(
        "noise",
        description="bumps, as if drawn at random, or waves across `direction`; `smooth`: none, "
        "for a material of an object that has a texture",
    )
    height: Positive = Field(
        1e-4, le=0.01, description="of the highest, m; at most a fifth of the length"
    )
    length: Positive = Field(2e-3, le=1, description="from one to the next, m")
    direction: tuple[float, float, float] = Field(
        (1.0, 0.0, 0.0), description="across which waves lie, in the mesh's coordinates"
    )

    @model_validator(mode="after")
    def _can_be_followed(self):
        if self.height > self.length / _STEEPEST:
            raise ValueError(
                f"height is at most length / {_STEEPEST}: a proxy cannot follow steeper ones"
            )
        return self

    @field_validator("direction")
    @classmethod
    def _leads_somewhere(cls, value):
        if not any(value):
            raise ValueError("a direction is not 0, 0, 0")
        return value


class MaterialOptions(Options):
    """What a surface feels like, beside its stiffness."""

    sticking: float = Field(
        0.0,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="friction at rest: force along the surface per force against it",
    )
    sliding: float | None = Field(
        None,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="friction while the probe slides, at most `sticking`; null: as much",
    )
    damping: float = Field(
        0.0,
        ge=0,
        allow_inf_nan=False,
        description="damping along the normal, Ns/m; never so that the surface pulls",
    )
    drag: float = Field(
        0.0, ge=0, allow_inf_nan=False, description="damping along the surface, Ns/m"
    )
    texture: TextureOptions | None = Field(
        None,
        description="a height over the surface; null: for a material that of the whole object, "
        "otherwise none",
    )

    @model_validator(mode="after")
    def _sticks_more(self):
        if self.sliding is not None and self.sliding > self.sticking:
            raise ValueError("sliding is at most sticking")
        return self


class SurfaceOptions(MaterialOptions):
    """How an object is felt: through a proxy that no wall lets through, or by penalty forces.

    Each material that a mesh file names can have friction, damping and texture of its own. A
    material takes the same options as any other surface.
    """

    kind: Literal["proxy", "penalty"] = Field(
        "proxy",
        description="what a device is driven by. `proxy`: the force goes from the probe to a proxy "
        "that stays outside, so that thin parts hold, and surfaces rub; `penalty`: the paper's, "
        "-k·distance·normal, with which no proxy is tried. Fields without a distance outside "
        "(`nearest`, `trilinear`) have penalty forces alone. Errors are always those of penalty "
        "forces",
    )
    materials: dict[str, MaterialOptions] = Field(
        default_factory=dict,
        description="by the names of materials in the mesh's file (OBJ, glTF, 3MF), or in the "
        "array beside it: friction, damping and texture",
    )


class ContactOptions(SurfaceOptions):
    """How a device feels the object, and with which probe."""

    radius: float = Field(
        0.0,
        ge=0,
        le=0.1,
        description="of the probe, m; 0: a point. On splines and grids at most 0.95 of the height "
        "up to which they are made (`bake.outside`): 1 mm of an object of 100",
    )
    queries: Annotated[int, Field(ge=8, le=1000)] | None = Field(
        None,
        description="queries of the field that a tick may take; what is left goes on in the next "
        "one. null: as many as fit into half of `hardware.deadline` on this machine, from 8 to 24",
    )
