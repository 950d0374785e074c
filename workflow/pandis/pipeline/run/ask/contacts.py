"""Options of contact: how a surface feels, and which force drives a device."""

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from pandis.pipeline.run.ask.values import Options, Positive

#: Smallest ratio of a texture's length to its height. It limits slopes to 0.65.
_STEEPEST = 5


class TextureOptions(Options):
    """Bumps or waves on the surface, which are felt through a proxy."""

    kind: Literal["noise", "waves", "smooth"] = Field(
        "noise",
        description="`noise`: pseudo-random bumps; `waves`: waves along `direction`; `smooth`: "
        "no texture, for a material of an object that has one",
    )
    height: Positive = Field(
        1e-4, le=0.01, description="largest height, m; at most a fifth of the length"
    )
    length: Positive = Field(
        2e-3, le=1, description="distance from one bump or wave to the next, m"
    )
    direction: tuple[float, float, float] = Field(
        (1.0, 0.0, 0.0), description="direction from wave to wave, in mesh coordinates"
    )

    @model_validator(mode="after")
    def _can_be_followed(self):
        if self.height > self.length / _STEEPEST:
            raise ValueError(
                f"height must be at most length / {_STEEPEST}: a proxy cannot follow steeper slopes"
            )
        return self

    @field_validator("direction")
    @classmethod
    def _leads_somewhere(cls, value):
        if not any(value):
            raise ValueError("direction must not be 0, 0, 0")
        return value


class MaterialOptions(Options):
    """How a surface feels, apart from its stiffness."""

    sticking: float = Field(
        0.0,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="coefficient of static friction: tangential force over normal force",
    )
    sliding: float | None = Field(
        None,
        ge=0,
        le=100,
        allow_inf_nan=False,
        description="coefficient of sliding friction, at most `sticking`; null: the same",
    )
    damping: float = Field(
        0.0,
        ge=0,
        allow_inf_nan=False,
        description="damping along the normal, Ns/m; the surface never pulls",
    )
    drag: float = Field(
        0.0, ge=0, allow_inf_nan=False, description="damping along the surface, Ns/m"
    )
    texture: TextureOptions | None = Field(
        None,
        description="bumps or waves on the surface; null: none, or, for a material, the texture of "
        "the whole object",
    )

    @model_validator(mode="after")
    def _sticks_more(self):
        if self.sliding is not None and self.sliding > self.sticking:
            raise ValueError("sliding must be at most sticking")
        return self


class SurfaceOptions(MaterialOptions):
    """How an object feels: through a proxy that cannot pass through walls, or by penalty forces.

    Each material that a mesh file names can have its own friction, damping and texture, with the
    same options as any other surface.
    """

    kind: Literal["proxy", "penalty"] = Field(
        "proxy",
        description="force that drives a device. `proxy`: a spring to a proxy that stays outside, "
        "so that thin parts resist and surfaces have friction; `penalty`: the paper's force, "
        "-k·distance·normal; no proxy is tested. Fields without a distance outside "
        "(`nearest`, `trilinear`) have only penalty forces. Errors are always those of penalty "
        "forces",
    )
    materials: dict[str, MaterialOptions] = Field(
        default_factory=dict,
        description="friction, damping and texture by material; the names are those in the mesh's "
        "file (OBJ, glTF, 3MF) or in the array file beside it (for part.stl: "
        "part.stl.regions.npy)",
    )


class ContactOptions(SurfaceOptions):
    """How the object feels on a device, and with which probe."""

    radius: float = Field(
        0.0,
        ge=0,
        le=0.1,
        description="radius of the probe, m; 0: a point. On splines and grids at most 0.95 of the "
        "height up to which they are valid (`bake.outside`): 1 mm on an object of 100 mm",
    )
    queries: Annotated[int, Field(ge=8, le=1000)] | None = Field(
        None,
        description="largest number of field queries per tick; the next tick makes the rest. "
        "null: the number that fits into half of `hardware.deadline` on this machine, 8 to 24",
    )
