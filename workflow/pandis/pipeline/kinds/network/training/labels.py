"""Labels of training points on the GPU that trains: else its steps wait for the host's cores."""

from contextlib import contextmanager

import numpy as np
import torch

from pandis.engine.bvh import Labels
from pandis.pipeline.geometry.distance import SURFACE_DISTANCE, MeshDistance


class GpuDistance:
    """The exact distance to a mesh, whose labels without ties come from a CUDA device.

    They have the signs of the host's, and their distances but for rounding: the same search with
    the same tree, also in double precision. Signs are not compared with winding numbers, as those
    of the stored samples have been.

    Parameters
    ----------
    engine : pandis.pipeline.geometry.distance.MeshDistance
    device : str
        Of Warp.
    """

    def __init__(self, engine, device="cuda"):
        # not above: trainings on a CPU have no need of Warp, which takes a second to load
        from pandis.engine.cuda.meshes import MeshLabels

        self.engine = engine
        self._labels = MeshLabels(engine.tree_parts(), engine.reach, device)

    def label(self, points, ties=True, check=True):
        """Answer as `MeshDistance.label` does; without ties no faces and no barycentrics."""
        if ties:
            return self.engine.label(points, ties, check)
        distance, normal = self._labels.label(points, SURFACE_DISTANCE)
        return Labels(distance, normal, None, None, np.zeros(len(points), np.uint8))

    def distance_and_normal(self, points, progress=None, check=True):
        """Answer as `MeshDistance.distance_and_normal` does, on the host."""
        return self.engine.distance_and_normal(points, progress, check)


def on_device(engine, device, log):
    """Return an engine whose labels come from the device, where there is one that can.

    Parameters
    ----------
    engine : object
        The exact distance of a `pandis.pipeline.geometry.body.Body`.
    device : {"cpu", "cuda"}
    log : callable
        Takes a line of text.
    """
    if device != "cuda" or not isinstance(engine, MeshDistance):
        return engine
    try:
        return GpuDistance(engine, device)
    except (ImportError, RuntimeError) as error:
        log(f"labels come from the host's cores, and the GPU may wait for them: {error}")
        return engine


@contextmanager
def own_stream(device):
    """Let what follows run on a stream of its own, if it is to run on a GPU's default one.

    Labels, which are made on another, would wait there for all steps that wait to be taken.
    """
    if device != "cuda" or torch.cuda.current_stream() != torch.cuda.default_stream():
        yield
        return
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        yield
    torch.cuda.current_stream().wait_stream(stream)
