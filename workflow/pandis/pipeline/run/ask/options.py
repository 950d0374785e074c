"""Options of every stage but training: their names, defaults and meaning."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pandis.pipeline.run.ask.catalogue import SIZED, TARGETS
from pandis.pipeline.run.ask.targets import GridTarget
from pandis.pipeline.run.ask.values import Count, Fineness, Options, Positive


class MeshOptions(Options):
    """Loading and repair. docs/repair.md describes each rung, and the meshes that it applies to."""

    unit: str = Field(
        "unknown",
        pattern=r"^[A-Za-zµ]{1,12}$",
        description="unit of the mesh (`mm`, `m`, …): recorded, but nothing is scaled by it; "
        "glTF and 3MF files contain their unit",
    )
    weld: float = Field(
        1e-8,
        ge=0,
        le=1e-3,
        description="vertices closer than this share of the diagonal are merged; used only if "
        "exact welding leaves the mesh open; 0: never",
    )
    rungs: list[Literal["clean", "union", "fill", "meshfix", "remesh", "wrap"]] = Field(
        ["clean", "union", "fill", "meshfix", "remesh", "wrap"],
        description="the repairs that may be tried, in this order, on a mesh that is not valid; "
        "leave out those you do not want",
    )
    small_hole: float = Field(
        0.5,
        ge=0,
        le=100,
        description="a hole is small, and filled, if its rim is at most this share of its "
        "component's diagonal",
    )
    max_hole_edges: int = Field(500, ge=0, description="a hole with more edges is not small")
    open: Literal["refuse", "cap", "thicken"] = Field(
        "refuse",
        description="treatment of a surface whose holes are not small: `refuse` it, `cap` the "
        "holes anyway, or `thicken` it into a wall of `thickness`",
    )
    thickness: Positive = Field(
        0.01, le=0.2, description="thickness of the `thicken` wall, as a share of the diagonal"
    )
    nested: Literal["cavity", "solid"] = Field(
        "cavity",
        description="treatment of a component entirely inside another: a `cavity` (inside which "
        "the next one is solid again, and so on), or `solid`: only the outer surface remains",
    )
    deviation_p99: float = Field(
        0.005,
        ge=0,
        description="a repair is kept only if 99 % of the surface, in both directions, moves no "
        "farther than this share of the diagonal (not counting caps of holes and walls inside "
        "the solid)",
    )
    deviation_max: float = Field(0.03, ge=0, description="the same limit for the whole surface")
    solid: Literal["never", "always"] = Field(
        "never",
        description="`always`: a mesh that `clean`, `union` and `fill` cannot repair becomes one "
        "closed surface around its solid (docs/solid.md). Walls may be invented: the record and "
        "the report say which",
    )
    solid_error: Fineness = Field(
        "256 cells",
        description="how finely a solid is drawn: `256 cells` along the longest side (64 to 1024), "
        "or the error allowed, as `0.1 %` of the diagonal, `0.2` mesh units or `0.2 mm`",
    )
    solid_thickness: Positive = Field(
        0.3, ge=0.05, le=1, description="thickness of sheets with air on both sides, cells"
    )
    solid_door: float = Field(
        0.15,
        ge=0,
        le=2,
        description="widest gap between open edges that a solid closes, as a share of the diagonal",
    )
    solid_cap: float = Field(
        1.0, ge=0, le=2, description="widest hole that a solid closes, as a share of the diagonal"
    )
    solid_share: float = Field(
        0.25,
        ge=0,
        le=1,
        description="an open room becomes solid if at most this share of its walls is invented; "
        "else it stays a shell",
    )
    solid_cavities: Literal["kept", "filled"] = Field(
        "kept", description="treatment of closed rooms inside a solid"
    )
    solid_debris: float = Field(
        0.0, ge=0, le=0.5, description="components of a solid below this share of its volume go"
    )
    solid_after: float = Field(
        2.0,
        ge=0,
        description="time that `union` and `fill` may use before a solid is made, CPU s; "
        "only with `solid: always`",
    )
    rung_seconds: Positive = Field(240.0, le=1e6, description="time limit of each rung, s")
    rung_memory_gb: Positive = Field(3.0, le=1e4, description="memory limit of each rung, GiB")
    reader_seconds: Positive = Field(120.0, le=1e6, description="time limit of the reader, s")
    reader_memory_gb: Positive = Field(3.0, le=1e4, description="memory limit of the reader, GiB")


class SampleOptions(Options):
    """Training and held-out points. Lengths are in the unit frame (longest side 1.8).

    Recipes on exact distances draw their own points, in the same proportions.
    """

    surface: int = Field(50_000, ge=0, description="points on the surface")
    offsets: int = Field(
        100_000, ge=0, description="points off the surface along the normal, over all scales"
    )
    scales: Annotated[list[Annotated[float, Field(gt=0, le=2)]], Field(min_length=1)] = Field(
        [0.003, 0.01, 0.03], description="standard deviations of the offsets"
    )
    shallow: int = Field(350_000, ge=0, description="points within 0.0115 below the surface")
    penetration: int = Field(250_000, ge=0, description="points within `depth` below the surface")
    bent: int = Field(
        250_000,
        ge=0,
        description="points below the surface, up to eight times denser where it is curved (by "
        "angles between neighbouring faces per 0.05 of length)",
    )
    depth: Positive = Field(0.045, description="largest depth below the surface")
    core: int = Field(
        50_000,
        ge=0,
        description="points deeper than `depth` along the normal, up to 1: where the part is thin, "
        "they may end up outside",
    )
    box: int = Field(50_000, ge=0, description="points spread uniformly in the box [-1, 1]³")
    held_out: int = Field(
        20_000,
        ge=0,
        description="points that are never trained on: half at most 0.01 deep, half at most 0.04; "
        "networks need at least 100",
    )
    near: int = Field(
        0,
        ge=0,
        description="points on both sides of the surface: each coordinate of a surface point is "
        "moved by normal noise of one of the `scales`",
    )
    volume: int = Field(
        0,
        ge=0,
        description="points spread uniformly in the mesh's bounding box, grown by 0.1 on each side",
    )


class BakeOptions(Options):
    """Grids. Lengths are in the unit frame (longest side 1.8)."""

    inside: Positive = Field(
        0.045, le=1, description="depth below the surface down to which grids are valid"
    )
    outside: Positive = Field(
        0.02, le=1, description="height above the surface up to which grids are valid"
    )
    chunk: Annotated[int, Field(ge=4)] = Field(32, description="nodes per axis of a stored chunk")
    auto: dict[Literal[SIZED], GridTarget] = Field(
        default_factory=dict,
        description="targets of `nearest-auto`, `trilinear-auto`, `compact-auto`, …, by kind: "
        "`force_error` (the smallest field that meets it, `tail` and `missed`) or `bytes` (the "
        "best field that fits); by default `spline-auto` gets 800,000 bytes, and `compact-auto` "
        "500,000",
    )
    vti: bool = Field(
        False, description="also write every grid field as `.vti`, for ParaView and 3D Slicer"
    )

    @model_validator(mode="after")
    def _usual_targets(self):
        for form, target in TARGETS.items():
            self.auto.setdefault(form, GridTarget(**target))
        return self


class NativeOptions(Options):
    """The files for ``pandis.h``."""

    weight_bits: Literal[16, 32] = Field(
        32,
        description="bits per weight of a network's hidden layers in its `.pandis` file; 16 halves "
        "the file size, and the export's log states how much the answers change",
    )
    original_faces: bool = Field(
        False,
        description="the `.pandis` file of a compact mesh also identifies the face of "
        "`mesh.zarr.zip` that contains a closest point (`pandis_answer.face`), at a cost of about "
        "four bytes per face; the file of an exact mesh always does",
    )


class ExportOptions(NativeOptions):
    """The files for user programs."""

    also: list[Literal["mjcf", "newton", "page", "vdb"]] = Field(
        default_factory=list,
        description="files for other programs, in `results/{mesh}/export/`: `mjcf`, a model for "
        "MuJoCo (`mujoco.xml`, with `mesh.obj`); `newton`, distances for Newton's cache "
        "(`newton.npz`); `page`, a page for touching fields in a browser (`touch.html`); "
        "`vdb`, volumes for OpenVDB (`fields.vdb`)",
    )


class TrajectoryOptions(Options):
    """The path of the probe on the mesh, traced on exact distances."""

    kind: Literal["surface", "spiral"] = Field(
        "surface",
        description="surface: along the surface, turning at random; spiral: six turns from pole "
        "to pole of a closed-form sphere, 2 to 5 % of its radius deep, regardless of `shallow` and "
        "`deep`",
    )
    samples: Annotated[int, Field(ge=10)] = Field(2000, description="samples, one per tick")
    step: Positive = Field(0.004, description="distance between samples (unit frame)")
    shallow: Positive = Field(0.001, description="smallest depth (unit frame)")
    deep: Positive = Field(0.02, description="largest depth (unit frame)")

    @model_validator(mode="after")
    def _order(self):
        if self.shallow >= self.deep:
            raise ValueError("shallow must be less than deep")
        return self


class EvaluationOptions(Options):
    """The force error of every field against the exact force."""

    probes: Annotated[int, Field(ge=100)] = Field(50_000, description="points of each probe set")
    paths: Count = Field(
        1,
        description="trajectories on which errors are measured; if more than one, the report gives "
        "means with 95 % intervals",
    )


class StressOptions(Options):
    """The stress suite, with a simulated hand and device, by default a Touch."""

    mass: Positive = Field(0.045, description="moving mass at the tip, kg")
    damping: float = Field(0.1, ge=0, description="viscous damping of the device, Ns/m")
    friction: float = Field(0.26, ge=0, description="Coulomb friction of the device, N")
    encoder: Positive = Field(55e-6, description="step of the reported position, m")
    delay: int = Field(0, ge=0, le=20, description="delay of the force, ticks")
    force_limit: Positive = Field(3.3, description="largest force, N")
    hand_stiffness: float = Field(20.0, ge=0, description="stiffness of the simulated hand, N/m")
    hand_damping: float = Field(3.0, ge=0, description="damping of the hand, Ns/m")
    press: Positive = Field(0.5, description="force with which the hand presses, N")
    loops: Annotated[int, Field(ge=2)] = Field(
        20, description="closed loops around which the work is measured"
    )
    ticks: Annotated[int, Field(ge=1000)] = Field(
        1_000_000, description="ticks of the long run, which is a random walk"
    )


class TimingOptions(Options):
    """Times of single queries and of batches."""

    queries: Annotated[int, Field(ge=100)] = Field(2000, description="single queries per field")
    batch: Count = Field(10_000, description="points of a batch")
    repeats: Count = Field(5, description="batches per field; the median time is used")
    cold: Annotated[int, Field(ge=0)] = Field(
        50, description="single queries with empty caches, per field"
    )
    libtorch: bool = Field(
        False,
        description="also time every network from a C++ program on LibTorch, the paper's way; "
        "needs g++, and half a minute per network to compile the program",
    )


class AttachedOptions(Options):
    """A 3D Systems haptic device that is attached to this machine and held by a person."""

    library: str = Field("libHD.so", description="name or path of OpenHaptics' library")
    name: str = Field("", description="the device's name in OpenHaptics; empty: the default device")
    model: Literal["touch", "touch-x"] = Field(
        "touch", description="model of the device; forces stay within the limits of that model"
    )
    arm: bool = Field(
        False,
        description="send forces, if the environment variable PANDIS_ARM is 1 as well: "
        "`PANDIS_ARM=1 snakemake -j1 hardware`. Otherwise positions are read and no force is sent. "
        "Hold the stylus",
    )


class HardwareOptions(Options):
    """The 1 kHz validation on this machine."""

    seconds: Positive = Field(3.0, description="duration of each field's run, s")
    rate: Positive = Field(1000.0, ge=100, le=20_000, description="ticks per second")
    deadline: Positive = Field(
        0.8e-3,
        description="a tick that takes longer to compute is a miss (s); values above 0.8 of the "
        "period count as 0.8 of it",
    )
    misses: float = Field(
        0.001, ge=0, lt=1, description="largest share of misses at which a field passes"
    )
    loaded_seconds: float = Field(
        0.5, ge=0, le=600, description="duration of a second run, s, with a busy loop on every core"
    )
    ask_again: bool = Field(
        True,
        description="while the loop waits for a tick, query the field again at the probe's last "
        "position, to keep its data in the caches; a device's own scheduler cannot do this",
    )
    devices: list[Literal["touch", "touch-x", "omega-3", "falcon"]] = Field(
        ["touch"],
        description="devices to simulate, with the hand of `stress`, to find the largest safe "
        "stiffness",
    )
    attached: AttachedOptions | None = Field(
        None, description="device on which every field is run, through OpenHaptics; null: none"
    )
