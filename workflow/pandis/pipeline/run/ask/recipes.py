"""Options of the sine networks' recipes.

A recipe combines a loss with its training options: `PaperRecipe` trains with the paper's seven
terms, `ExactRecipe` on exact distances and directions.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pandis.pipeline.run.ask.values import Count, Force, Missed, Options, Positive

_MUON = (
    "Muon's largest step size, as a step of ω0·W, for the matrices W between sine layers; null: "
    "Adam trains them too"
)
_SCHEDULE = (
    "constant step sizes, or sizes that rise during the warm-up and then fall to zero along half a "
    "cosine"
)


class Recipe(Options):
    """Options that both recipes of the sine network share."""

    width: Annotated[int, Field(ge=1, le=1024)] = Field(256, description="units of each sine layer")
    depth: Annotated[int, Field(ge=1, le=16)] = Field(
        4, description="number of sine layers; 4 gives the paper's 800 KB"
    )
    steps: Count | None = Field(
        None, description="budget in optimiser steps: the result is reproducible"
    )
    seconds: Positive | None = Field(
        None,
        description="budget in seconds instead: the steps reached are recorded, "
        "and the result is not reproducible",
    )
    direction: Literal["output", "gradient"] = Field(
        "output",
        description="source of the normal: three separate outputs, as in the paper, or the "
        "gradient of the distance, which makes the force almost conservative",
    )
    base: Annotated[int, Field(ge=4, le=64)] | None = Field(
        None,
        description="cells per axis of a tricubic spline of the distance over the whole box, which "
        "the network corrects; null: the network alone",
    )
    matrix_rate: Positive | None = Field(None, description=_MUON)
    schedule: Literal["constant", "cosine"] = Field("constant", description=_SCHEDULE)
    warmup: float = Field(
        0.02,
        ge=0,
        lt=1,
        description="with `cosine`: share of the budget during which step sizes rise",
    )
    threads: Count = Field(
        1,
        description="CPU threads; the result depends on this number. With one, `-j2` trains two "
        "networks at once; more threads help only if there are more cores than networks",
    )
    device: Literal["cpu", "cuda", "auto"] = Field(
        "cpu", description="where to train; `auto` uses CUDA if available, and records the choice"
    )

    @model_validator(mode="after")
    def _one_budget(self):
        if self.steps is not None and self.seconds is not None:
            raise ValueError("a budget is in steps or in seconds, not both: remove one")
        return self


class PaperRecipe(Recipe):
    """The paper's recipe: a seven-term loss on surface and box points, without exact distances."""

    loss: Literal["paper"] = "paper"
    omega: Positive = Field(30.0, description="ω0, the factor inside every sine")
    points: Literal["area", "vertices"] = Field(
        "area",
        description="points on the surface: `samples.surface` points spread evenly by area, with "
        "the normals of their faces; or the vertices with their normals, as in the paper",
    )
    batch: Count = Field(1400, description="points on the surface per step, and as many off it")
    weighting: Literal["subset", "batch"] = Field(
        "subset",
        description="how a term that applies to only half of the points is averaged: `subset`, "
        "over that half; `batch`, over the whole batch, as in SIREN's code, which halves its "
        "weight relative to the others. `batch` is as good in short runs, and at least as "
        "good in long ones (docs/benchmarks/ablations.md)",
    )
    learning_rate: Positive = Field(1e-4, description="Adam's largest step size")
    clip: Positive | None = Field(1.0, description="largest norm of the gradient; null: no limit")
    weights: Annotated[list[float], Field(min_length=7, max_length=7)] = Field(
        [50.0, 100.0, 3000.0, 100.0, 50.0, 100.0, 100.0],
        description="weights of the loss terms, in the order printed in the paper",
    )
    alpha: Positive = Field(100.0, description="factor a in the loss term exp(-a·|Φ|)")
    stop_gradient: bool = Field(
        True, description="Ψ·∇Φ trains only Ψ, not Φ (unspecified in the paper)"
    )


class ExactRecipe(Recipe):
    """The default recipe: regression on the exact distance and normal."""

    loss: Literal["exact"] = "exact"
    direction: Literal["output", "gradient"] = Field(
        "gradient",
        description="source of the normal: the gradient of the distance, which makes the force "
        "almost conservative and the error smaller, or three separate outputs, which makes queries "
        "faster",
    )
    width: Annotated[int, Field(ge=1, le=1024)] = Field(
        248,
        description="units of each sine layer; 248 units and the base together take as much "
        "memory as the paper's network",
    )
    base: Annotated[int, Field(ge=4, le=64)] | None = Field(
        16,
        description="cells per axis of a tricubic spline of the distance over the whole box, which "
        "the network corrects; null: the network alone, which creates contacts in free space",
    )
    omega: Positive | None = Field(
        None,
        description="ω0, the factor inside every sine; finer shapes need a larger ω0; null: "
        "80·√(width / 256)",
    )
    force_error: Force | None = Field(
        None,
        description="train the narrowest network, up to `width`, that has at most this mean force "
        "error on the contact set; written as in `budget`",
    )
    tail: Force | None = Field(
        None, description="with `force_error`: its 99th percentile; null: ten times the mean"
    )
    missed: Missed = Field(
        0.005, description="with `force_error`: share of the surface that may lack the force"
    )
    batch: Count = Field(4096, description="points per step, each used once")
    learning_rate: Positive = Field(
        2e-4, description="Adam's largest step size, for the first and last layer and the biases"
    )
    matrix_rate: Positive | None = Field(0.05, description=_MUON)
    schedule: Literal["constant", "cosine"] = Field("cosine", description=_SCHEDULE)
    clip: Positive | None = Field(None, description="largest norm of the gradient; null: no limit")
    near: Positive = Field(
        0.02, description="a point at distance d weighs near / (near + |d|) (unit frame)"
    )
    far: float = Field(
        0.3,
        ge=0,
        le=1,
        description="least weight of a point's distance, however far the point is; its normal has "
        "a third of this",
    )
    normal_weight: Positive = Field(0.05, description="weight of the normal's error in the loss")


#: Recipes that need no entry under ``train``, with their options.
RECIPES = {
    "pandis": {"loss": "paper"},
    "pandis-grad": {"loss": "paper", "direction": "gradient"},
    "pandis-exact": {"loss": "exact"},
}
#: Steps used if a recipe has no budget (about three minutes of one CPU core).
DEFAULT_STEPS = {"paper": 3000, "exact": 1500}


def budgeted(recipe):
    """Return a recipe, with the default number of steps if it has no budget."""
    if recipe.steps is None and recipe.seconds is None:
        return recipe.model_copy(update={"steps": DEFAULT_STEPS[recipe.loss]})
    return recipe
